"""The study of extremes as sentences, tables and a figure."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dem_bridge.studies.extremes.entry import Entry
from dem_bridge.studies.extremes.judge import Expected, Finding, Word, outcome
from dem_bridge.studies.study import FigureData, Panel, Series, Table
from dem_bridge.verification.verdict import Outcome, Verdict

NOTES = (
    "right: for velocity, displacement, peak force and crossing time |run - truth| <= bar of the run + bar of the truth"
    " at every sample, body and contact. The number beside it is the bar of the run's velocities over the largest.",
    "no bar: the bar is a whole scale or more, so the run says that it says nothing. refused: an error of one line,"
    " before or in the run. model: other equations; the number is the median difference of arrivals from the truth.",
    "The truth is the reference, of references the other one (where both are one code, the twin), a closed form, and"
    " the code's own run of a scene that must move alike: scaled, mirrored, in another frame, in two parts.",
    "Expected outcomes stand in the catalogue. Where a scene is no single pulse, theories must refuse it.",
)
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
    found: Finding

    @property
    def outcome(self) -> Outcome:
        """Return PASS if the finding is the expected one, otherwise FAIL."""
        return outcome(self.found, self.expected)

    @property
    def verdict(self) -> Verdict:
        """The same with its numbers."""
        result = self.found
        return Verdict(
            scene=self.entry.name,
            quantity=result.quantity,
            backend=self.backend,
            reference=result.standard,
            outcome=self.outcome,
            sentence=f"{self.backend} on {self.entry.name}: expected {self.expected}, found {result.cell}"
            + (f" ({result.reason})" if result.reason else "")
            + ".",
            difference=result.error,
            uncertainty=result.bar,
            reference_uncertainty=result.standard_bar,
            tolerance=result.bar + result.standard_bar,
        )


def answer(rows: Sequence[Row]) -> tuple[str, ...]:
    """Return the answer: whether any backend is wrong without saying so."""
    count = Counter(row.found.word for row in rows)
    entries, backends = len({row.entry.name for row in rows}), len({row.backend for row in rows})
    wrong = [row for row in rows if row.found.word is Word.WRONG]
    failed = [row for row in rows if row.outcome in (Outcome.FAIL, Outcome.BROKEN)]
    judged = [row for row in rows if row.found.word is Word.RIGHT]
    said = (
        "No backend is wrong in silence"
        if not wrong
        else f"{len(wrong)} of {len(rows)} are wrong in silence ({_named(wrong)})"
    )
    details = ", ".join(f"{count[word]} {what}" for word, what in _WORDS.items() if count[word])
    sentences = [f"{said}: {entries} extremes by {backends} backends, {details}."]
    if judged:
        nearest = max(judged, key=lambda row: row.found.ratio)
        sentences.append(
            f"Of the right ones the error is {np.median([row.found.ratio for row in judged]):.2g} of both bars in the"
            f" median, at most {nearest.found.ratio:.2g} ({nearest.backend} on {nearest.entry.name}, "
            f"{nearest.found.quantity})."
        )
    vague = [row for row in rows if row.found.word is Word.NO_BAR]
    if vague:
        sentences.append(f"That their bars say nothing is what these answer: {_named(vague)}.")
    without = [row for row in judged if row.found.unsaid]
    if without:
        sentences.append(
            f"{len(without)} of the right ones say nothing of a quantity, or of that of some contacts: the table of"
            " findings names them."
        )
    sentences.append(
        f"{len(rows) - len(failed)} of {len(rows)} are what the catalogue expects"
        + (f"; not so: {_named(failed)}." if failed else ".")
    )
    return tuple(sentences)


_WORDS = {
    Word.RIGHT: "right within their bars",
    Word.REFUSED: "refused with the reason",
    Word.MODEL: "numbers of a theory",
    Word.NO_BAR: "that say that they say nothing",
    Word.WRONG: "beyond their bars",
    Word.NO_TRUTH: "without a truth to be judged by",
    Word.BROKEN: "crashed",
    Word.NOT_RUN: "not run",
}


def _named(rows: Sequence[Row]) -> str:
    """Entries with their backends; the first few."""
    by_entry: dict[str, list[str]] = {}
    for row in rows:
        by_entry.setdefault(row.entry.name, []).append(row.backend)
    details = [f"{name}: {', '.join(backends)}" for name, backends in by_entry.items()]
    more = len(details) - 8
    return "; ".join(details[:8]) + (f"; and {more} more" if more > 0 else "")


def tables(rows: Sequence[Row]) -> tuple[Table, ...]:
    """Return counts, the matrix of outcomes, all numbers, and the catalogue."""
    return (_counts(rows), _matrix(rows), _findings(rows), _asked(rows))


def _counts(rows: Sequence[Row]) -> Table:
    words = [word for word in Word if any(row.found.word is word for row in rows)]
    backends = list(dict.fromkeys(row.backend for row in rows))
    lines: list[tuple[str | float, ...]] = []
    for name in backends:
        first = [row for row in rows if row.backend == name]
        ratios = [row.found.ratio for row in first if row.found.word is Word.RIGHT]
        count = Counter(row.found.word for row in first)
        expected = sum(row.outcome is Outcome.PASS for row in first)
        lines.append((name, float(expected), *(float(count[word]) for word in words), max(ratios, default=math.nan)))
    return Table(
        id="counts",
        title="What each backend answers",
        caption=f"Of {len({row.entry.name for row in rows})} extremes.",
        columns=("backend", "as expected", *map(str, words), "largest error / bars where right"),
        rows=tuple(lines),
    )


def _matrix(rows: Sequence[Row]) -> Table:
    backends = list(dict.fromkeys(row.backend for row in rows))
    cells: dict[str, dict[str, str]] = {}
    for row in rows:
        mark = "" if row.outcome in (Outcome.PASS, Outcome.NOT_RUN) else f" [{row.outcome}]"
        cells.setdefault(row.entry.name, {})[row.backend] = row.found.cell + mark
    return Table(
        id="outcomes",
        title="Every extreme by every backend",
        caption="right: with the bar of velocities over the largest; model: with the median difference of arrivals."
        " What is not as expected is marked.",
        columns=("extreme", *backends),
        rows=tuple((name, *(line[backend] for backend in backends)) for name, line in cells.items()),
    )


def _findings(rows: Sequence[Row]) -> Table:
    return Table(
        id="findings",
        title="All numbers",
        caption="Of each backend on each extreme the quantity that is the furthest from a truth, beside both bars; all"
        " over the scale of that quantity.",
        columns=(
            "extreme",
            "backend",
            "outcome",
            "found",
            "expected",
            "quantity",
            "error",
            "bar",
            "bar of the truth",
            "error / bars",
            "bar of velocity",
            "nothing said of",
            "judged by",
            "reason",
        ),
        rows=tuple(
            (
                row.entry.name,
                row.backend,
                row.outcome.value,
                str(row.found.word),
                str(row.expected),
                row.found.quantity,
                row.found.error,
                row.found.bar,
                row.found.standard_bar,
                row.found.ratio,
                row.found.velocity_bar,
                row.found.unsaid,
                row.found.standard,
                row.found.reason,
            )
            for row in rows
        ),
    )


def _asked(rows: Sequence[Row]) -> Table:
    entries = {row.entry.name: row.entry for row in rows}
    return Table(
        id="entries",
        title="What is asked",
        caption="And what a run must be, all of it.",
        columns=("extreme", "asks", "bodies", "truths"),
        rows=tuple(
            (entry.name, entry.asks, float(entry.scene.n_body), "; ".join(truth.says for truth in entry.truths))
            for entry in entries.values()
        ),
    )


def figures(rows: Sequence[Row]) -> tuple[FigureData, ...]:
    """Error over both bars, a row for each extreme; nothing without a number to draw."""
    judged = [row for row in rows if not math.isnan(row.found.ratio)]
    names = list(dict.fromkeys(row.entry.name for row in judged))
    if not names:
        return ()
    panels = []
    for begin in range(0, len(names), _ROWS):
        some = names[begin : begin + _ROWS]
        series = [
            Series(label="error = bars", style="guide", x=np.ones(2), y=np.array([-0.5, len(some) - 0.5])),
        ]
        for name in dict.fromkeys(row.backend for row in judged):
            first = [row for row in judged if row.backend == name and row.entry.name in some]
            series.append(
                Series(
                    label=name,
                    style=f"mark/{name}",
                    x=np.array([min(max(row.found.ratio, LEAST), MOST) for row in first]),
                    y=np.array([float(some.index(row.entry.name)) for row in first]),
                )
            )
        panels.append(
            Panel(
                title=f"({chr(97 + begin // _ROWS)})",
                x_label="error / (bar + bar of the truth)",
                y_label="",
                series=tuple(series),
                rows=tuple(some),
            )
        )
    return (
        FigureData(
            id="error-over-bars",
            title="How far from the truth, in bars",
            caption="Of each backend the quantity that is the furthest from a truth, over both bars: right of 1 it is"
            f" wrong in silence. What is below {LEAST:g} or above {MOST:g} stands there.",
            panels=tuple(panels),
        ),
    )
