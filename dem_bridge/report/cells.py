"""What stands in the cells of a page: numbers with the digits they deserve, outcomes in words, small pictures."""

from __future__ import annotations

import base64
import io
import math

from matplotlib.figure import Figure
from PIL import Image

from dem_bridge.report.drawing import settled
from dem_bridge.studies.study import Claim, ClaimValue, Paper, Table
from dem_bridge.verification.verdict import Outcome

#: dots to the inch
_DPI = 120

#: the worst first: how outcomes sort
SEVERITY = (
    Outcome.BROKEN,
    Outcome.FAIL,
    Outcome.UNDECIDED,
    Outcome.NOT_RUN,
    Outcome.MODEL_DIFFERENCE,
    Outcome.PASS,
)
#: what outcomes are called where a claim has them
CLAIMED = {
    Outcome.PASS: "holds",
    Outcome.FAIL: "does not hold",
    Outcome.UNDECIDED: "undecided",
    Outcome.MODEL_DIFFERENCE: "a number",
    Outcome.NOT_RUN: "not run",
    Outcome.BROKEN: "run broke",
}


def by_outcome(paper: Paper) -> list[tuple[Outcome, list[Claim]]]:
    """Claims by what became of them: those that hold first, then by severity."""
    order = (Outcome.PASS, *SEVERITY[:-1])
    found = {outcome: [claim for claim in paper.claims if claim.outcome is outcome] for outcome in order}
    return [(outcome, claims) for outcome, claims in found.items() if claims]


def numeric(table: Table, column: int) -> bool:
    """Whether a column has numbers, and beside them at most empty cells."""
    cells = {row[column] for row in table.rows} - {""}
    return bool(cells) and not any(isinstance(cell, str) for cell in cells)


def by_backend(claim: Claim) -> tuple[list[str], list[tuple[str, list[ClaimValue | None]]]]:
    """The values of a claim side by side: who says something, and each quantity with what each of them says of it.

    >>> said = tuple(ClaimValue(name="speed", backend=who, value=1.9, unit="m/s") for who in ("bca", "ode45"))
    >>> claim = Claim(id="C", where="", statement="", outcome=Outcome.PASS, sentence="", values=said)
    >>> backends, rows = by_backend(claim)
    >>> backends, [(name, [one.value for one in values if one]) for name, values in rows]
    (['bca', 'ode45'], [('speed (m/s)', [1.9, 1.9])])
    """
    backends = list(dict.fromkeys(value.backend for value in claim.values))
    rows: list[tuple[str, list[ClaimValue | None]]] = []
    for value in claim.values:
        name, column = value.name + (f" ({value.unit})" if value.unit else ""), backends.index(value.backend)
        row = next((values for known, values in rows if known == name and values[column] is None), None)
        if row is None:
            row = [None] * len(backends)
            rows.append((name, row))
        row[column] = value
    return backends, rows


def number(value: float | None, digits: int = 2) -> str:
    """A number as a person reads it; a dash where there is none. Whole numbers have all their digits.

    >>> number(1.6e-9), number(None), number(float("inf")), number(0.0), number(300000)
    ('1.6e-09', '–', '∞', '0', '300000')
    """
    if value is None or value != value:
        return "–"
    if value in (float("inf"), float("-inf")):
        return "∞" if value > 0 else "−∞"
    if isinstance(value, int):
        return str(value)
    return "0" if value == 0 else f"{value:.{digits}g}"


def digits_of(value: float, uncertainty: float) -> int:
    """Digits that a number deserves: one more than its error bar leaves, 6 where there is none.

    >>> digits_of(0.907470078412, 3e-13), digits_of(41.2, 0.3), digits_of(41.2, float("nan")), digits_of(0.0, 0.1)
    (14, 4, 6, 6)
    """
    if not (0.0 < uncertainty < math.inf and value):
        return 6
    return min(max(math.ceil(math.log10(abs(value) / uncertainty)) + 1, 4), 16)


def sortable(value: float | str | None) -> str:
    """What a cell is sorted by: a number in full, an outcome by its severity, else the text; '' where there is none.

    >>> sortable(0.1), sortable(float("inf")), sortable(None), sortable("FAIL"), sortable("verlet")
    ('0.1', 'Infinity', '', '1', 'verlet')
    """
    if value is None or value != value:
        return ""
    if isinstance(value, str):
        return str(SEVERITY.index(Outcome(value))) if value in set(Outcome) else value
    return repr(float(value)).replace("inf", "Infinity")


def picture(figure: Figure) -> str:
    """A figure as a data URI, so that the page is one file."""
    drawn = io.BytesIO()
    settled(figure).savefig(drawn, format="png", dpi=_DPI)
    return "data:image/png;base64," + base64.b64encode(packed(drawn.getvalue())).decode("ascii")


def packed(png: bytes) -> bytes:
    """A picture in a third of its bytes: 256 colours of its own, chosen so that a thin line keeps its colour, then
    moved to where most of the picture is, without which a map has a dozen steps.

    Without date or software: the same picture gives the same bytes.
    """
    small = io.BytesIO()
    colours = Image.open(io.BytesIO(png)).convert("RGB")
    indexed = colours.quantize(256, method=Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE, kmeans=2)
    indexed.save(small, format="png", optimize=True)
    return small.getvalue()
