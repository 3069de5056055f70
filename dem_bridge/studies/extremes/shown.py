"""The study of extremes as sentences, tables and a figure."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dem_bridge.studies.extremes.entry import Entry
from dem_bridge.studies.extremes.judge import Expected, Finding, Word, outcome
from dem_bridge.studies.study import FigureData, Series, Table
from dem_bridge.studies.texts import Texts
from dem_bridge.verification.verdict import Outcome, Verdict

TEXTS = Texts("extremes")
#: errors that are less, or more, than this part of both bars are drawn here
LEAST, MOST = 1e-3, 1e3
#: names beside one pair of axes
_ROWS = 18


@dataclass(frozen=True, kw_only=True)
class Row:
    """One backend on one entry."""

    entry: Entry
    backend: str
    expected: Expected
    finding: Finding

    @property
    def outcome(self) -> Outcome:
        """Return PASS if the finding is the expected one, otherwise FAIL."""
        return outcome(self.finding, self.expected)

    @property
    def verdict(self) -> Verdict:
        """Return the outcome with its numbers."""
        result = self.finding
        return Verdict(
            scene=self.entry.name,
            quantity=result.quantity,
            backend=self.backend,
            reference=result.standard,
            outcome=self.outcome,
            sentence=TEXTS("verdict", row=self, reason=f" ({result.reason})" if result.reason else ""),
            difference=result.error,
            uncertainty=result.bar,
            reference_uncertainty=result.standard_bar,
            tolerance=result.bar + result.standard_bar,
        )


def answer(rows: Sequence[Row]) -> tuple[str, ...]:
    """Return the answer: whether any backend is wrong without saying so."""
    count = Counter(row.finding.word for row in rows)
    wrong, judged, vague = (_with(word, rows) for word in (Word.WRONG, Word.RIGHT, Word.NO_BAR))
    failed = [row for row in rows if row.outcome in (Outcome.FAIL, Outcome.BROKEN)]
    start = TEXTS("wrong", wrong=len(wrong), count=len(rows), named=_named(wrong)) if wrong else TEXTS("right")
    details = ", ".join(
        f"{count[Word(word)]} {what}" for word, what in TEXTS.data["words"].items() if count[Word(word)]
    )
    entries, backends = ({row.entry.name for row in rows}, {row.backend for row in rows})
    sentences = [TEXTS("summary", start=start, entries=len(entries), backends=len(backends), details=details)]
    if judged:
        nearest = max(judged, key=lambda row: row.finding.ratio)
        sentences.append(TEXTS("nearest", median=np.median([row.finding.ratio for row in judged]), row=nearest))
    if vague:
        sentences.append(TEXTS("vague", named=_named(vague)))
    if without := sum(bool(row.finding.unsaid) for row in judged):
        sentences.append(TEXTS("without", count=without))
    exceptions = f"; not so: {_named(failed)}" if failed else ""
    return (*sentences, TEXTS("expected", passed=len(rows) - len(failed), count=len(rows), failed=exceptions))


def _with(word: Word, rows: Sequence[Row]) -> list[Row]:
    return [row for row in rows if row.finding.word is word]


def _named(rows: Sequence[Row]) -> str:
    """Return the first few entries with their backends."""
    by_entry: dict[str, list[str]] = {}
    for row in rows:
        by_entry.setdefault(row.entry.name, []).append(row.backend)
    details = [f"{name}: {', '.join(backends)}" for name, backends in by_entry.items()]
    more = len(details) - 8
    return "; ".join(details[:8]) + (f"; and {more} more" if more > 0 else "")


def tables(rows: Sequence[Row]) -> tuple[Table, ...]:
    """Return counts, the matrix of outcomes, all numbers, and the catalogue."""
    entries = {row.entry.name: row.entry for row in rows}
    backends = {row.backend: [other for other in rows if other.backend == row.backend] for row in rows}
    words = [word for word in Word if _with(word, rows)]
    cells: dict[str, dict[str, str]] = {}
    for row in rows:
        mark = "" if row.outcome in (Outcome.PASS, Outcome.NOT_RUN) else f" [{row.outcome}]"
        cells.setdefault(row.entry.name, {})[row.backend] = row.finding.cell + mark
    return (
        TEXTS.table(
            "counts",
            [(name, *_counts(some, words)) for name, some in backends.items()],
            columns=("backend", "as expected", *words, "largest error / uncertainties where right"),
            count=len(entries),
        ),
        TEXTS.table(
            "outcomes",
            [(name, *(line[backend] for backend in backends)) for name, line in cells.items()],
            columns=("extreme", *backends),
        ),
        TEXTS.table("findings", rows),
        TEXTS.table("entries", entries.values()),
    )


def _counts(rows: Sequence[Row], words: Sequence[Word]) -> tuple[float, ...]:
    """Return the numbers of expected findings and of each word, and the largest ratio of those that are right."""
    expected = sum(row.outcome is Outcome.PASS for row in rows)
    ratios = (row.finding.ratio for row in _with(Word.RIGHT, rows))
    return (float(expected), *(float(len(_with(word, rows))) for word in words), max(ratios, default=math.nan))


def figures(rows: Sequence[Row]) -> tuple[FigureData, ...]:
    """Return the error over both bars, a row for each extreme; nothing without a number to draw."""
    judged = [row for row in rows if not math.isnan(row.finding.ratio)]
    names = list(dict.fromkeys(row.entry.name for row in judged))
    panels = []
    for begin in range(0, len(names), _ROWS):
        some = names[begin : begin + _ROWS]
        series = [Series(label="error = bars", style="guide", x=np.ones(2), y=np.array([-0.5, len(some) - 0.5]))]
        for name in dict.fromkeys(row.backend for row in judged):
            drawn = [row for row in judged if row.backend == name and row.entry.name in some]
            x = np.array([min(max(row.finding.ratio, LEAST), MOST) for row in drawn])
            y = np.array([float(some.index(row.entry.name)) for row in drawn])
            series.append(Series(label=name, style=f"mark/{name}", x=x, y=y))
        panels.append(TEXTS.panel("errors", series, rows=tuple(some), letter=chr(97 + begin // _ROWS)))
    return (TEXTS.figure("error-over-bars", panels, least=LEAST, most=MOST),) if panels else ()
