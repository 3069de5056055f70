"""Data of a study: claims, tables, figures and verdicts. Nothing is computed or drawn here.

A figure is its numbers: ``report`` draws them, and writes the same numbers as CSV beside the picture.
"""

from __future__ import annotations

import csv
import hashlib
import io
import json
import sys
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dem_bridge.foundation.notebook import study_html
from dem_bridge.foundation.numbers import check_number
from dem_bridge.foundation.wording import counted, summary
from dem_bridge.observables.verdict import Outcome, Verdict, exit_code, plain
from dem_bridge.trajectory.trajectory import Floats

if TYPE_CHECKING:
    from pandas import DataFrame

    from dem_bridge.runs.store import Store

#: effects on the exit code that failures by known defects of LAMMPS may have
EFFECTS = ("fail", "ok")


@dataclass(frozen=True, kw_only=True)
class ClaimValue:
    """One number that speaks for or against a claim, and who says so."""

    name: str
    """What it is, such as "largest residence time"."""
    backend: str
    """Of :data:`~dem_bridge.backends.base.BACKENDS`, or "paper" for what is printed there."""
    value: float
    uncertainty: float = float("nan")
    """Its error bar in the same unit; nan: none can be given."""
    unit: str = ""

    def as_json(self) -> dict[str, Any]:
        """Return the fields; a number that is not finite is None."""
        return {key: plain(value) for key, value in vars(self).items()}


@dataclass(frozen=True, kw_only=True)
class Margin:
    """Hold over which criteria and in which windows the outcome of a claim stays."""

    sentence: str
    """The range of the criterion, and the other windows."""
    changes: str = ""
    """What changes the outcome within reason: a limit within a quarter of ours, another window or definition."""
    quantity: str = ""
    """What the criterion limits; empty where there is no number to limit."""
    limit: float = float("nan")
    """Our limit of the quantity."""
    changes_at: float = float("nan")
    """The limit at which the outcome changes: the value of the quantity in our window."""
    window: str = ""
    """Our window; empty where there is one reading only."""
    windows: tuple[tuple[str, float], ...] = ()
    """Other windows, with the value of the quantity there."""

    def as_json(self) -> dict[str, Any]:
        """Return the fields; a number that is not finite is None."""
        windows = [{"window": name, "value": plain(value)} for name, value in self.windows]
        return {key: plain(value) for key, value in vars(self).items()} | {"windows": windows}


@dataclass(frozen=True, kw_only=True)
class Claim:
    """A statement of the paper with what was found.

    ``outcome``: PASS where it holds, FAIL where it does not, UNDECIDED where bars straddle what it asks,
    MODEL_DIFFERENCE where it is about a theory and a number is all that can be said, NOT_RUN with the reason.
    """

    id: str
    where: str
    """Section and figure of the paper."""
    statement: str
    outcome: Outcome
    sentence: str
    """What was found, with the number that decides."""
    short: str = ""
    """The number that was found and the criterion, in a few words."""
    kind: str = ""
    """How the page counts it: "holds", "print", "theory", "limit", "undecided" or "not run"."""
    margin: Margin | None = None
    values: tuple[ClaimValue, ...] = ()

    def as_json(self) -> dict[str, Any]:
        """Return the fields, the values as mappings."""
        margin = None if self.margin is None else self.margin.as_json()
        return vars(self) | {"margin": margin, "values": [value.as_json() for value in self.values]}


@dataclass(frozen=True, kw_only=True)
class Headline:
    """A number that a page shows large, and the sentence that says what it is."""

    number: str
    sentence: str


@dataclass(frozen=True, kw_only=True)
class Points:
    """Short sentences under one heading, such as "Question"."""

    heading: str
    points: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class Table:
    """Rows of texts and numbers; numbers stay numbers, so that a page can sort and round them."""

    id: str
    """Also the stem of its CSV file."""
    title: str
    caption: str
    columns: tuple[str, ...]
    """Names with units in brackets: "arrival (ms)"."""
    rows: tuple[tuple[str | float, ...], ...]

    def __post_init__(self) -> None:
        for row in self.rows:
            if len(row) != len(self.columns):
                raise ValueError(f"table {self.id}: {len(row)} cells in a row of {len(self.columns)} columns: {row}")

    def as_csv(self) -> str:
        """Return the table as CSV with a header; numbers have full precision."""
        return _csv(self.columns, self.rows)

    def as_json(self) -> list[dict[str, Any]]:
        """Return each row as a mapping by the names of the columns, JSON without NaN."""
        rows = ((cell if isinstance(cell, str) else plain(cell) for cell in row) for row in self.rows)
        return [dict(zip(self.columns, row, strict=True)) for row in rows]


@dataclass(frozen=True, kw_only=True, eq=False)
class Series:
    """One line or set of marks of a panel: ``x`` and ``y`` ``(n,)``; ``bar`` ``(n,)`` where it has one."""

    label: str
    style: str
    """Who it is from: a backend's name, "fit" or "guide"; the drawing follows from it."""
    x: Floats
    y: Floats
    bar: Floats | None = None
    drawn: bool = True
    """False: it lies on another line of its panel, so that only the CSV has it."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Map:
    """Values over two axes: ``values (n_y, n_x)``."""

    label: str
    """Of the colour scale, with unit."""
    x: Floats
    y: Floats
    values: Floats
    diverging: bool = False
    """Whether zero is the middle of the scale."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Panel:
    """One pair of axes."""

    title: str
    x_label: str
    y_label: str
    series: tuple[Series, ...] = ()
    map: Map | None = None
    log: bool = False
    """Both axes logarithmic."""
    log_y: bool = False
    """The y axis alone logarithmic."""
    notes: tuple[str, ...] = ()
    """Short lines to stand in the panel."""
    rows: tuple[str, ...] = ()
    """Names of the places 0, 1, ... on the y axis, the first on top; without ``bars`` the x axis is logarithmic.

    A name that ends in a colon is the heading of the rows below it.
    """
    row_kinds: tuple[str, ...] = ()
    """Where the value of each row comes from, for its colour: "round-off", "time step", "model" or ""."""
    bars: bool = False
    """Whether each series has a horizontal bar in each of its rows, from zero to its x."""
    tall: bool = False
    """Half as high again as others."""
    shares_scale_with: tuple[int, ...] = ()
    """Places of panels of the same figure with the same colour scale, or without map the same y axis."""


@dataclass(frozen=True, kw_only=True, eq=False)
class FigureData:
    """A figure as numbers, such as "figure-2"."""

    id: str
    title: str
    caption: str
    panels: tuple[Panel, ...]
    columns: int = 2
    """Panels side by side."""
    small: bool = False
    """Whether panels are small multiples: without axes, each with a scale of its own."""
    last_beside: bool = False
    """Whether the last panel stands right of all others and is as high as they are together."""
    width: float | None = None
    """Part of the width of a sheet; None follows from the panels."""

    def content(self) -> bytes:
        """All that the picture is made of, arrays by their checksums: figures with the same content look the same."""
        return json.dumps(asdict(self), default=_checksum).encode()

    def as_csv(self) -> str:
        """All panels, long form: panel, series, x, y, value, bar. Numbers in full precision; empty where there is none.

        >>> line = Series(label="law", style="guide", x=np.array([1.0]), y=np.array([0.1]))
        >>> panel = Panel(title="a", x_label="i", y_label="V (m/s)", series=(line,))
        >>> print(FigureData(id="figure-3", title="", caption="", panels=(panel,)).as_csv(), end="")
        panel,series,x,y,value,bar
        a,law,1.0,0.1,,
        """
        rows: list[tuple[str | float, ...]] = []
        for panel in self.panels:
            if panel.map is not None:
                x, y = (axis.ravel().tolist() for axis in np.meshgrid(panel.map.x, panel.map.y))
                cells = zip(x, y, panel.map.values.ravel().tolist(), strict=True)
                rows += [(panel.title, panel.map.label, *cell, "") for cell in cells]
            for line in panel.series:
                bars = [""] * len(line.x) if line.bar is None else line.bar.tolist()
                rows += [
                    (panel.title, line.label, x, y, "", bar)
                    for x, y, bar in zip(line.x.tolist(), line.y.tolist(), bars, strict=True)
                ]
        return _csv(("panel", "series", "x", "y", "value", "bar"), rows)


def _checksum(array: Floats) -> list[str]:
    return [str(array.dtype), str(array.shape), hashlib.sha256(array.tobytes()).hexdigest()]


#: all classes of the parts of a study that are read off runs, for a store that keeps them
PARTS = (
    Claim, ClaimValue, FigureData, Headline, Map, Margin, Outcome, Panel, Points, Series, Table, Verdict,
)  # fmt: skip


@dataclass(frozen=True, kw_only=True, eq=False)
class Study:
    """Answer to one question by many runs: sentences, tables, figures and verdicts."""

    id: str
    """Also the stem of its files: "stability"."""
    title: str
    answer: tuple[str, ...]
    """Sentences, the one that was asked for first."""
    tables: tuple[Table, ...] = ()
    figures: tuple[FigureData, ...] = ()
    verdicts: tuple[Verdict, ...] = ()
    """On whatever can pass or fail; they decide the exit code."""
    known_defects: str = "fail"
    """ "ok": failures that known defects of LAMMPS explain do not count for the exit code."""
    notes: tuple[str, ...] = ()
    """What a reader should know of how it was made."""
    interrupted: bool = False
    """Whether it was stopped before its end: it has what was finished until then."""
    provenance: Mapping[str, Any] = field(default_factory=dict)
    files: Mapping[str, Callable[[], str | bytes]] = field(default_factory=dict)
    """More files beside its page: name -> what makes the content, asked for only where files are written."""

    @property
    def record_name(self) -> str:
        """Name of the JSON file."""
        return f"{self.id}.json"

    @property
    def exit_code(self) -> int:
        """Exit code of the verdicts."""
        counted = (item for item in self.verdicts if self.known_defects == "fail" or not item.known_defect)
        return exit_code(verdict.outcome for verdict in counted)

    def __str__(self) -> str:
        """Return at most 15 lines: the answer, the verdicts by outcome, and where the rest is."""
        facts = [counted(verdict.outcome.value for verdict in self.verdicts)] if self.verdicts else []
        if self.interrupted:
            facts.append("interrupted: only the results up to the interruption are here")
        if self.tables:
            facts.append(f"tables: {', '.join(table.id for table in self.tables)}; save(folder) writes the page")
        return summary(self.answer, facts, title=self.title)

    __repr__ = __str__

    def _repr_html_(self) -> str:
        return study_html(self, self._picture())

    def _picture(self) -> str:
        """Return the HTML of the picture of a notebook: the first figure."""
        from dem_bridge.report.page import picture_of_study  # it is built on studies

        return picture_of_study(self)

    def table(self) -> DataFrame:
        """Return the verdicts as a table, a row for each.

        Returns
        -------
        pandas.DataFrame
            Its columns are the fields of a :class:`~dem_bridge.observables.verdict.Verdict`; differences,
            uncertainties and tolerances are relative to ``scale``.
        """
        from pandas import DataFrame

        columns = [field.name for field in fields(Verdict)]
        return DataFrame([asdict(verdict) for verdict in self.verdicts], columns=columns)

    def save(self, folder: str | Path) -> None:
        """Write the page, JSON, tables and figures into ``folder``, which is created if need be."""
        from dem_bridge.report.page import write_study  # it is built on studies

        write_study(self, Path(folder))

    def page_files(self, store: Store | None = None) -> dict[str, str | bytes]:
        """Return the page, JSON, tables and figures by their names; pictures are kept in ``store``."""
        from dem_bridge.report.page import study_files  # it is built on studies

        return study_files(self, store)

    def as_json(self) -> dict[str, Any]:
        """JSON without NaN: rows of tables as mappings by the names of their columns."""
        return {
            "schema": f"dem-bridge/study-{self.id}/1",
            "title": self.title,
            "answer": list(self.answer),
            "tables": {item.id: item.as_json() for item in self.tables},
            "verdicts": [verdict.as_json() for verdict in self.verdicts],
            "notes": list(self.notes),
            "interrupted": self.interrupted,
            "provenance": dict(self.provenance),
        }


def check_setting(
    name: str, value: Any, allowed: str, *, least: int | None = None, most: float = sys.float_info.max
) -> None:
    """Raise UsageError unless a value is a whole number from ``least`` to ``most``; without ``least``, a positive one.

    >>> check_setting("points", 2.5, "a whole number from 2 to 100", least=2, most=100)
    Traceback (most recent call last):
    dem_bridge.errors.UsageError: points = 2.5; allowed: a whole number from 2 to 100
    """
    if least is None:
        check_number(name, value, allowed, above=0.0, at_most=most)
    else:
        check_number(name, value, allowed, whole=True, at_least=least, at_most=most)


def _csv(columns: tuple[str, ...], rows: Any) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(rows)
    return text.getvalue()
