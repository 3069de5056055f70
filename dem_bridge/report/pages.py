"""Fill the templates of pages, of texts for pull requests, and of files for continuous integration.

Cells of tables have numbers with significant digits, and outcomes in words.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterable
from functools import cache
from typing import Any, NamedTuple

from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape

from dem_bridge.foundation.wording import relative_number
from dem_bridge.observables.verdict import Outcome, Verdict
from dem_bridge.report.images import alternative_text, inline
from dem_bridge.report.study import Claim, ClaimValue, Table

#: outcomes in the order in which they are sorted, the worst first
SEVERITY = (
    Outcome.BROKEN,
    Outcome.FAIL,
    Outcome.UNDECIDED,
    Outcome.NOT_RUN,
    Outcome.MODEL_DIFFERENCE,
    Outcome.PASS,
)


class Kind(NamedTuple):
    """Hold how a page shows a kind of claims."""

    name: str
    mark: str
    """A sign that keeps its meaning without colour."""
    colour: Outcome
    """The outcome that has the same colour."""


#: kinds of claims, in the order in which they are counted
KINDS = {
    "holds": Kind("holds", "✓", Outcome.PASS),
    "print": Kind("wrong in print", "✗", Outcome.FAIL),
    "theory": Kind("theory off", "≈", Outcome.MODEL_DIFFERENCE),
    "limit": Kind("exceeds our limit", "↑", Outcome.FAIL),
    "undecided": Kind("undecided", "?", Outcome.UNDECIDED),
    "not run": Kind("not run", "–", Outcome.NOT_RUN),
}
#: letters of formulas
_GREEK = {"beta": "β", "gamma": "γ", "mu": "μ"}


class Outcomes(NamedTuple):
    """Hold in words how many checks pass."""

    worst: Outcome
    judged: str
    """Such as "385 of 385 checks pass"."""
    others: str
    """Checks that cannot pass or fail, such as "11 not run"; empty without any."""


#: outcomes of checks that can pass or fail; and what the others are called
_JUDGED = (Outcome.BROKEN, Outcome.FAIL, Outcome.UNDECIDED, Outcome.PASS)
_UNJUDGED = {
    Outcome.MODEL_DIFFERENCE: "comparisons with a theory, which have no pass or fail",
    Outcome.NOT_RUN: "not run",
}
_MISSED = {Outcome.BROKEN: "broken", Outcome.FAIL: "failed", Outcome.UNDECIDED: "undecided"}


def outcomes_of(verdicts: Iterable[Verdict], of: str = "") -> Outcomes | None:
    """Return in words how many verdicts ``of`` something pass; None without a verdict that can.

    >>> from dataclasses import replace
    >>> passed = Verdict(scene="", quantity="", backend="", reference="", outcome=Outcome.PASS, sentence="")
    >>> outcomes_of([passed, replace(passed, outcome=Outcome.FAIL), replace(passed, outcome=Outcome.NOT_RUN)])
    Outcomes(worst=<Outcome.FAIL: 'FAIL'>, judged='1 of 2 checks pass: 1 failed', others='1 not run')
    >>> outcomes_of([passed], "LAMMPS").judged
    '1 check of LAMMPS: passed'
    """
    counts = Counter(verdict.outcome for verdict in verdicts)
    total = sum(counts[outcome] for outcome in _JUDGED)
    if not total:
        return None
    missed = ", ".join(f"{counts[outcome]} {word}" for outcome, word in _MISSED.items() if counts[outcome])
    others = "; ".join(f"{counts[outcome]} {words}" for outcome, words in _UNJUDGED.items() if counts[outcome])
    worst = next(outcome for outcome in _JUDGED if counts[outcome])
    judged = f"{counts[Outcome.PASS]} of {total} checks{of and f' of {of}'} pass{missed and f': {missed}'}"
    return Outcomes(
        worst, judged if total > 1 else f"1 check{of and f' of {of}'}: {_MISSED.get(worst, 'passed')}", others
    )


class Valued(NamedTuple):
    """Count the values of claims."""

    total: int
    known: int
    """Values with an uncertainty."""
    reference: int
    """Values by the reference without one."""


def valued(claims: Iterable[Claim]) -> Valued:
    """Return how many values of claims have an uncertainty.

    >>> speeds = tuple(ClaimValue(name="v", backend="bca", value=1.0, uncertainty=u) for u in (math.nan, 0.1))
    >>> valued([Claim(id="C", where="", statement="", outcome=Outcome.PASS, sentence="", values=speeds)])
    Valued(total=2, known=1, reference=0)
    """
    values = [value for claim in claims for value in claim.values]
    unknown = [value for value in values if math.isnan(value.uncertainty)]
    by_reference = sum(value.backend == "reference" for value in unknown)
    return Valued(total=len(values), known=len(values) - len(unknown), reference=by_reference)


def numeric(table: Table, column: int) -> bool:
    """Return True if a column has numbers, and otherwise only empty cells."""
    cells = {row[column] for row in table.rows} - {""}
    return bool(cells) and not any(isinstance(cell, str) for cell in cells)


def by_backend(claim: Claim) -> tuple[list[str], list[tuple[str, list[ClaimValue | None]]]]:
    """Return the backends of a claim, and rows with the name of a quantity and its value by each backend.

    >>> speeds = tuple(ClaimValue(name="speed", backend=name, value=1.9, unit="m/s") for name in ("bca", "ode45"))
    >>> claim = Claim(id="C", where="", statement="", outcome=Outcome.PASS, sentence="", values=speeds)
    >>> backends, rows = by_backend(claim)
    >>> backends, [(name, [value.value for value in values if value]) for name, values in rows]
    (['bca', 'ode45'], [('speed (m/s)', [1.9, 1.9])])
    """
    backends = list(dict.fromkeys(value.backend for value in claim.values))
    rows: list[tuple[str, list[ClaimValue | None]]] = []
    for value in claim.values:
        name, column = value.name + (f" ({value.unit})" if value.unit else ""), backends.index(value.backend)
        row = next((values for row_name, values in rows if row_name == name and values[column] is None), None)
        if row is None:
            row = [None] * len(backends)
            rows.append((name, row))
        row[column] = value
    return backends, rows


def number(value: float | None, digits: int = 2) -> str:
    """Return a number as text with ``digits`` significant digits, or a dash if it is unknown.

    Whole numbers keep all digits.

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


def power(value: float) -> Markup:
    """Return a relative error as HTML, as :func:`~dem_bridge.foundation.wording.relative_number` writes it.

    >>> str(power(1.12e-6)), str(power(0.0234)), str(power(1.0)), str(power(0.0))
    ('1.1×10<sup>−6</sup>', '2.3 %', '100 %', '0')
    """
    return typeset(relative_number(value))


def digits_of(value: float, uncertainty: float) -> int:
    """Return the number of digits of a value: one more than its uncertainty leaves, or 6 without an uncertainty.

    >>> digits_of(0.907470078412, 3e-13), digits_of(41.2, 0.3), digits_of(41.2, float("nan")), digits_of(0.0, 0.1)
    (14, 4, 6, 6)
    """
    if not (0.0 < uncertainty < math.inf and value):
        return 6
    return min(max(math.ceil(math.log10(abs(value) / uncertainty)) + 1, 4), 16)


def typeset(text: str) -> Markup:
    """Return a text with its subscripts, powers, powers of ten and Greek letters as HTML.

    >>> str(typeset("beta_0 > 4.7e+10 N/m^1.5, to 1.1e-06 of pair_style"))
    'β<sub>0</sub> &gt; 4.7×10<sup>10</sup> N/m<sup>1.5</sup>, to 1.1×10<sup>−6</sup> of pair_style'
    >>> str(typeset("v_max in f_exponent,mass.csv and f_one.csv"))
    'v<sub>max</sub> in f_exponent,mass.csv and f_one.csv'
    """
    html = str(escape(text))
    html = re.sub(r"\b(beta|[A-Za-z])_(\w+)(?!\S*\.[a-z])", r"\1<sub>\2</sub>", html)  # names of files stay
    html = re.sub(r"\^(\([^)]*\)|[\d.]*\d)", r"<sup>\1</sup>", html)
    html = re.sub(
        r"\b([\d.]+)e([-+]?)0*(\d+)", lambda m: f"{m[1]}×10<sup>{m[2].strip('+').replace('-', '−')}{m[3]}</sup>", html
    )
    for name, letter in _GREEK.items():
        html = re.sub(rf"\b{name}\b", letter, html)
    return Markup(html)


def sortable(value: float | str | None) -> str:
    """Return the key by which a cell is sorted: all digits of a number, the rank of an outcome, or the text.

    >>> sortable(0.1), sortable(float("inf")), sortable(None), sortable("FAIL"), sortable("verlet")
    ('0.1', 'Infinity', '', '1', 'verlet')
    """
    if value is None or value != value:
        return ""
    if isinstance(value, str):
        return str(SEVERITY.index(Outcome(value))) if value in set(Outcome) else value
    return repr(float(value)).replace("inf", "Infinity")


_HERE = "dem_bridge.report"


@cache
def _environment(package: str) -> Environment:
    """Return the environment of the templates of a package and of this one; HTML and XML escape their values."""
    environment = Environment(
        loader=ChoiceLoader([PackageLoader(name, "templates") for name in dict.fromkeys((package, _HERE))]),
        undefined=StrictUndefined,
        autoescape=lambda name: name is not None and name.endswith((".html.j2", ".xml.j2")),
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters |= {
        "by_backend": by_backend,
        "alternative_text": alternative_text,
        "digits": lambda value: digits_of(value.value, value.uncertainty),
        "inline": lambda svg, name, alt: Markup(inline(svg, name, alt)),
        "number": number,
        "numeric": numeric,
        "power": power,
        "sortable": sortable,
        "typeset": typeset,
    }
    return environment


def fill(template: str, package: str = _HERE, **values: Any) -> str:
    """Return a template of a package, or of this one, filled with values."""
    return _environment(package).get_template(template).render(values)
