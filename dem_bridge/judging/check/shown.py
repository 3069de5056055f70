"""The page of a check: answer and lines to write first, then one picture a question, then the rest folded."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from dem_bridge.backends.base import versions_of
from dem_bridge.foundation.wording import release
from dem_bridge.judging.check.answer import Check, Pictures
from dem_bridge.observables.verdict import Outcome
from dem_bridge.report.columns import SECOND, Column
from dem_bridge.report.study import FigureData, Map, Series, Study, Table
from dem_bridge.report.texts import Texts

if TYPE_CHECKING:
    from dem_bridge.runs.store import Store

TEXTS = Texts("check", "dem_bridge.judging")
PLAUSIBILITY_COLUMNS = ("property", "value", "usual", "outcome", "sentence")
TIES_COLUMNS = ("moment", "contacts", "step", Column("time", SECOND), "effect / largest velocity", "what mends it")
STEPS_COLUMNS = ("accuracy", Column("largest step", SECOND))
#: most rows of the map of errors, so that the page stays small
_MAP_ROWS = 200


@dataclass(frozen=True, kw_only=True)
class Row:
    """One row of the first screen: part, its outcome in a word with its colour, and a sentence."""

    part: str
    word: str
    outcome: str
    sentence: str


@dataclass(frozen=True, kw_only=True, eq=False)
class CheckStudy(Study):
    """A check as a study, whose JSON file is the answer."""

    check: Check

    @property
    def exit_code(self) -> int:
        """Exit code of the check."""
        return self.check.exit_code

    def as_json(self) -> dict[str, Any]:
        """Return the keys of the check, its name and provenance; JSON without NaN."""
        return {
            "schema": "dem-bridge/check/1",
            "file": self.check.name,
            **self.check.as_json(),
            "provenance": dict(self.provenance),
        }

    def page_files(self, store: Store | None = None) -> dict[str, str | bytes]:
        """Return the page, JSON, tables and figures by their names; pictures are kept in ``store``."""
        from dem_bridge.report.page import study_files

        parts = {"check": self.check, "rows": list(rows_of(self.check)), "release": release}
        return study_files(self, store, template=("check.html.j2", "dem_bridge.judging"), **parts)


def check_study(check: Check) -> Study:
    """Return the page of a check as data."""
    corrected: dict[str, str | bytes] = {**check.companions, **check.corrected}
    return CheckStudy(
        id="check",
        title=check.title,
        answer=(f"{check.outcome}: {check.headline}",),
        tables=tuple(_tables(check)),
        figures=() if check.pictures is None else (_error(check.pictures), _sources(check)),
        notes=check.notes,
        provenance={
            "file": check.name,
            "accuracy": check.accuracy,
            "lammps": check.engine_answer.version,
            "versions": versions_of("dem-bridge", "numpy", "scipy", "numba"),
        },
        files={f"corrected/{name}": partial(_unchanged, body) for name, body in corrected.items()},
        check=check,
    )


def _unchanged(body: str | bytes) -> str | bytes:
    """Return the content of a file as it is."""
    return body


def rows_of(check: Check) -> Iterator[Row]:
    """Yield the rows of the first screen, in the order of the lines of the terminal."""
    for part, text in check.lines():
        if part in ("law", "step"):
            word, _, sentence = text.partition(": ")
            answer = check.law_answer if part == "law" else check.step_answer
            yield Row(part=part, word=word, outcome=answer.outcome.value, sentence=sentence)
    engine = check.engine_answer
    found = len(engine.defects)
    word = "no known defect" if not found else f"{found} known defect{'s' * (found != 1)}"
    yield Row(part="release", word=word, outcome=engine.outcome.value, sentence=engine.sentence)
    looks = any(entry.look for entry in check.plausible)
    word, _, sentence = check.plausible_text.partition(": ")
    yield Row(
        part="plausible", word=word, outcome=(Outcome.UNDECIDED if looks else Outcome.PASS).value, sentence=sentence
    )


def _tables(check: Check) -> Iterator[Table]:
    """Yield the tables of the folded part."""
    rows = [(accuracy, dt) for accuracy, dt in check.step_answer.largest.items()]
    if rows:
        yield TEXTS.table("steps", STEPS_COLUMNS, rows)
    if check.plausible:
        fields = ("name", "value", "usual", "outcome", "sentence")
        entries = [entry.as_json() for entry in check.plausible]
        yield TEXTS.table(
            "plausibility",
            PLAUSIBILITY_COLUMNS,
            [tuple(np.nan if entry[key] is None else entry[key] for key in fields) for entry in entries],
        )

    if check.tie_answers:
        rows_of_ties = [
            (tie.kind, ", ".join(map(str, tie.contacts)), tie.step, tie.time, tie.effect, tie.mend)
            for tie in check.tie_answers
        ]
        yield TEXTS.table("ties", TIES_COLUMNS, rows_of_ties)


def _error(pictures: Pictures) -> FigureData:
    """Return the error over bodies and time."""
    every = -(-len(pictures.time) // _MAP_ROWS)
    end = float(pictures.time[-1])
    unit, factor = ("s", 1.0) if end > 1.0 else ("ms", 1e3) if end > 1e-3 else ("µs", 1e6)
    data = Map(
        label="error / largest velocity",
        x=np.arange(pictures.error.shape[1], dtype=float),
        y=factor * pictures.time[::every],
        values=pictures.error[::every],
        diverging=True,
    )
    return TEXTS.figure("error", [TEXTS.panel("error", map=data, unit=unit)], columns=1, width=0.56)


def _sources(check: Check) -> FigureData:
    """Return the parts of the error on one scale."""
    assert check.pictures is not None  # the caller has asked
    least = 1e-17  # a part of 0 stands at the left end
    sources = check.pictures.sources
    places = np.arange(len(sources), dtype=float)
    values = np.array([max(value, least) for _, value in sources])
    ends = np.array([-0.5, len(sources) - 0.5])
    series = [
        Series(label="_part", style="mark-2", x=values, y=places),
        Series(label="_accuracy", style="guide", x=np.full(2, check.accuracy), y=ends),
    ]
    return TEXTS.figure(
        "sources",
        [TEXTS.panel("sources", series, rows=tuple(name for name, _ in sources), accuracy=check.accuracy)],
        columns=1,
        width=0.56,
    )
