"""Write a study as files: one self-contained HTML page, tables as CSV, figures as SVG and CSV, and everything as JSON.

All files are written, or none. Templates are filled here: cells have numbers with significant digits, and outcomes in
words.
"""

from __future__ import annotations

import csv
import io
import json
import math
import re
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import replace
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape

from dem_bridge.foundation.files import check_report_folder, write_whole
from dem_bridge.foundation.notebook import picture
from dem_bridge.foundation.wording import relative_number
from dem_bridge.observables.verdict import Outcome, Verdict
from dem_bridge.report.images import alternative_text, begin_picture_of_data, inline
from dem_bridge.report.study import Claim, ClaimValue, FigureData, Map, Panel, Study, Table
from dem_bridge.report.template_cache import TemplateCache
from dem_bridge.report.texts import without_repeats
from dem_bridge.runs.store import Store
from dem_bridge.version import __version__

_MONTHS = ("Jan", "Feb", "Mar", "Apr", "May", "Jun", "Jul", "Aug", "Sep", "Oct", "Nov", "Dec")


def write_study(study: Study, folder: Path, store: Store | None = None) -> tuple[str, ...]:
    """Write the files of a study into ``folder`` (made if need be), all or none; return the names, the page first."""
    files = study.page_files(store)
    check_report_folder(folder)
    write_whole(folder, files)
    return tuple(files)


def about(provenance: Mapping[str, Any]) -> tuple[str, ...]:
    """Return version of dem_bridge, release of LAMMPS (if it ran) and date, as the head of a page names them.

    >>> about({"lammps": {"version": 20250722}, "date": "2026-11-23 20:34 UTC"})[1:]
    ('LAMMPS 22 Jul 2025', '2026-11-23')
    """
    release = provenance.get("lammps")
    release = release.get("version") if isinstance(release, Mapping) else release
    named = re.fullmatch(r"(\d{4})(\d\d)(\d\d)", str(release))
    lammps = f"{int(named[3])} {_MONTHS[int(named[2]) - 1]} {named[1]}" if named else release
    day = str(provenance.get("date") or datetime.now(UTC).date())[:10]
    return (f"dem_bridge {__version__}", *([f"LAMMPS {lammps}"] if lammps else []), day)


def study_files(
    study: Study,
    store: Store | None = None,
    *,
    template: tuple[str, str] = ("study.html.j2", __package__),
    **shown: Any,
) -> dict[str, str | bytes]:
    """Return the files of a study by name.

    These are ``index.html``, the JSON, ``tables/ID.csv``, ``figures/ID.svg``, ``figures/ID.csv`` and the study's own
    ``files``. Pictures are kept in ``store``. ``template``: that of the page, and the package that has it; ``shown``:
    what it shows beside the parts that every study has, and with ``reload`` the seconds after which a browser reads it
    again.
    """
    pictures = [begin_picture_of_data(figure, store) for figure in study.figures]
    figures: dict[str, dict[str, str | bytes]] = {
        figure.id: {
            f"figures/{figure.id}.svg": picture(),
            **{f"figures/{name}": text for name, text in csv_texts(figure).items()},
        }
        for figure, picture in zip(study.figures, pictures, strict=True)
    }
    shown = {"about": about(study.provenance), "outcomes": outcomes_of(study.verdicts)} | shown
    failures = list(without_repeats(verdict for verdict in study.verdicts if verdict.outcome in SEVERITY[:3]))
    files: dict[str, str | bytes] = {
        "index.html": fill(*template, study=study, files=figures, failures=failures, **shown),
        study.record_name: json.dumps(study.as_json(), indent=1, ensure_ascii=False, allow_nan=False) + "\n",
    }
    parts: list[dict[str, str | bytes]] = [{name: content()} for name, content in study.files.items()]
    parts += [{f"tables/{table.id}.csv": table.as_csv()} for table in study.tables]
    for part in (*parts, *figures.values()):
        if twice := set(part) & set(files):
            raise ValueError(f"study {study.id}: two parts have the file name {min(twice)}; allowed: distinct names")
        files |= part
    return files


def csv_texts(data: FigureData) -> dict[str, str]:
    """Return CSV files by name: all lines in ``<id>.csv`` in the long layout, each map as a matrix in a file.

    The file of a map is ``<id>-<letter>.csv``; its first row has x and its first column y. A map of 200 by 200 values
    has 0.25 MB as a matrix and 1.5 MB in the long layout. Small multiples have no files, because they only give an
    overview of runs.

    >>> import numpy as np
    >>> data = Map(label="velocity (m/s)", x=np.array([1.0, 2.0]), y=np.array([0.5]), values=np.array([[0.1, 0.25]]))
    >>> panel = Panel(title="(a) slow", x_label="cylinder", y_label="time (ms)", map=data)
    >>> texts = csv_texts(FigureData(id="figure-2", title="", caption="", panels=(panel,)))
    >>> print(texts["figure-2-a.csv"], end="")
    velocity (m/s): time (ms) by cylinder,1.0,2.0
    0.5,0.1,0.25
    """
    texts: dict[str, str] = {}
    if data.small:
        return texts
    if any(panel.series for panel in data.panels):
        only_lines = tuple(replace(panel, map=None) for panel in data.panels)
        texts[f"{data.id}.csv"] = replace(data, panels=only_lines).as_csv()
    for place, panel in enumerate(data.panels, start=1):
        if panel.map is None:
            continue
        letter = re.match(r"\((\w+)\)", panel.title)
        name = f"{data.id}-{letter[1] if letter else place}.csv"
        if name in texts:
            raise ValueError(f"{data.id}: two maps have the file name {name}; give each panel its own letter")
        texts[name] = _matrix(panel, panel.map)
    return texts


def _matrix(panel: Panel, data: Map) -> str:
    """Return a map as CSV with x in the first row and y in the first column."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([f"{data.label}: {panel.y_label} by {panel.x_label}", *data.x.tolist()])
    writer.writerows([y, *row] for y, row in zip(data.y.tolist(), data.values.tolist(), strict=True))
    return text.getvalue()


def picture_of_study(study: Study) -> str:
    """Return the HTML of the first figure of a study for a notebook; empty where it has none."""
    if not study.figures:
        return ""
    from dem_bridge.report.drawing import draw_figure  # imports matplotlib

    figure = study.figures[0]
    return picture(draw_figure(figure), f"{figure.title}. {figure.caption}")


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
    html = str(escape(text)).replace("+-", "±")
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
        bytecode_cache=TemplateCache(),
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
