"""The answer of a check: law, step, release, plausibility, and the lines to write."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from dem_bridge.foundation.wording import number, share
from dem_bridge.judging.check.edits import Edit
from dem_bridge.judging.check.law import EngineAnswer, LawAnswer
from dem_bridge.judging.check.plausible import Plausibility
from dem_bridge.judging.check.step import StepAnswer
from dem_bridge.judging.check.ties import Tie
from dem_bridge.judging.judgement import KeyedAnswer
from dem_bridge.judging.unit_test.recorded import RecordedAnswer
from dem_bridge.observables.verdict import Outcome, exit_code, plain

if TYPE_CHECKING:
    from dem_bridge.report.study import Study
    from dem_bridge.trajectory.trajectory import Floats

#: keys of a check, in their order
KEYS = ("outcome", "law", "step", "engine", "recorded", "ties", "plausibility", "advice", "notes")
#: lines to write that the terminal shows
MOST_LINES_TO_WRITE = 3
#: properties that, if they are not plausible, make an answer doubtful
_NAMES_OF_DOUBTS = ("density", "modulus", "overlap")
#: outcomes of the parts in words
_OF_LAW = {Outcome.PASS: "right", Outcome.FAIL: "wrong", Outcome.UNDECIDED: "undecided", Outcome.BROKEN: "not run"}
_OF_STEP = {
    Outcome.PASS: "right",
    Outcome.FAIL: "too coarse",
    Outcome.UNDECIDED: "undecided",
    Outcome.BROKEN: "not run",
}


#: width of a line, room of the names of entries, and the most lines that ``print`` shows
_COLUMNS, _COLUMNS_OF_NAMES, MOST_LINES_PRINTED = 80, 11, 15
#: entries that are not wrapped, because they are copied, and those that ``print`` leaves out first
_WHOLE, _LEAST_NEEDED = ("write", "", "page"), ("release", "plausible")


def _block(name: str, text: str, *, whole: bool) -> list[str]:
    """Return an entry in lines whose words are whole; a ``whole`` one in one line."""
    room = _COLUMNS - _COLUMNS_OF_NAMES
    wrapped = [text] if whole else textwrap.wrap(text, room, break_long_words=False, break_on_hyphens=False)
    return [
        f"{head:{_COLUMNS_OF_NAMES}}{line}"
        for head, line in zip([name, *[""] * (len(wrapped) - 1)], wrapped, strict=True)
    ]


@dataclass(frozen=True, kw_only=True, eq=False)
class Pictures:
    """Samples that the page draws: the error over bodies and time, and where it comes from."""

    time: Floats
    """Sample times, s, ``(n_t,)``."""
    error: Floats
    """LAMMPS minus the reference relative to the largest velocity, ``(n_t, n_body)``."""
    sources: tuple[tuple[str, float], ...]
    """Name and relative size of each part of the error."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Check(KeyedAnswer):
    """The answer of a check: a mapping with the keys :data:`KEYS`, which are attributes, too."""

    answer_keys: ClassVar[tuple[str, ...]] = KEYS

    name: str
    title: str
    accuracy: float
    law_answer: LawAnswer
    step_answer: StepAnswer
    engine_answer: EngineAnswer
    plausible: tuple[Plausibility, ...] = ()
    edits: tuple[Edit, ...] = ()
    """Lines of the script to write."""
    command: str = ""
    """A command in place of lines, for a scene."""
    unsupported: tuple[str, ...] = ()
    """What of the script cannot be read as a scene, with the lines."""
    notes: tuple[str, ...] = ()
    """How it was measured and what was assumed."""
    text: str = ""
    """The script as it was read."""
    corrected: Mapping[str, str] = field(default_factory=dict)
    """Texts of the files with the lines to write, by name; empty if there are none."""
    companions: Mapping[str, bytes] = field(default_factory=dict)
    """Files that the script consists of or reads, by name; empty if there is nothing to write."""
    pictures: Pictures | None = None
    tie_answers: tuple[Tie, ...] = ()
    """Moments that fall on a step within round-off, the largest effect first."""
    recorded_answer: RecordedAnswer | None = None
    """The states that a unit test of LAMMPS recorded; None for another script."""

    @property
    def outcome(self) -> str:
        """PASS, FAIL, UNDECIDED or BROKEN."""
        outcomes = [self.law_answer.outcome, self.step_answer.outcome, self.engine_answer.outcome]
        outcomes += [self.recorded_answer.outcome] if self.recorded_answer is not None else []
        if Outcome.FAIL in outcomes:
            return Outcome.FAIL.value
        order = (Outcome.BROKEN, Outcome.UNDECIDED, Outcome.PASS)
        return next(outcome for outcome in order if outcome in outcomes).value

    @property
    def exit_code(self) -> int:
        """Exit code of the command line: 0 for PASS, 1 for FAIL, 3 for BROKEN, 4 for UNDECIDED."""
        return exit_code([Outcome(self.outcome)])

    @property
    def law(self) -> dict[str, Any]:
        """Outcome and sentence on the law, the difference that is left, its cause, and what is not supported."""
        law = self.law_answer
        return {
            "outcome": law.outcome.value,
            "sentence": law.sentence,
            "difference": plain(law.difference),
            "allowed": plain(law.allowed),
            "cause": law.cause,
            "unsupported": list(self.unsupported),
        }

    @property
    def step(self) -> dict[str, Any]:
        """Step, its error with scale and uncertainty (SI), and the largest steps, s, for some accuracies."""
        step = self.step_answer
        return {
            "dt": step.dt,
            "error": plain(step.error * step.scale),
            "scale": plain(step.scale),
            "uncertainty": plain(step.uncertainty * step.scale),
            "relative_error": plain(step.error),
            "accuracy": step.accuracy,
            "largest_for_accuracy": plain(step.largest_for_accuracy),
            "largest_for": {f"{accuracy:g}": plain(dt) for accuracy, dt in step.largest.items()},
            "confirmed": plain(step.confirmed),
            "outcome": step.outcome.value,
            "sentence": step.sentence,
        }

    @property
    def engine(self) -> dict[str, Any]:
        """The release that ran the script, and its known defects that the script meets."""
        return self.engine_answer.as_json()

    @property
    def recorded(self) -> dict[str, Any] | None:
        """The states that a unit test of LAMMPS recorded, judged by our code, and the result of the test here."""
        return None if self.recorded_answer is None else self.recorded_answer.as_json()

    @property
    def ties(self) -> list[dict[str, Any]]:
        """Moments that fall on a step within round-off: what depends on it, and what mends it."""
        return [tie.as_json() for tie in self.tie_answers]

    @property
    def plausibility(self) -> list[dict[str, Any]]:
        """Properties beside what is usual, those that are worth a look first."""
        return [entry.as_json() for entry in self.plausible]

    @property
    def advice(self) -> list[str]:
        """The lines to write, ready to paste; the comment says where each belongs."""
        return [f"{line}  # {edit.place}" for edit in self.edits for line in edit.new.splitlines()] or (
            [self.command] if self.command else []
        )

    def as_json(self) -> dict[str, Any]:
        """Return the keys :data:`KEYS` with JSON types; a number that is not finite becomes null."""
        return {key: self[key] for key in KEYS} | {"notes": list(self.notes)}

    @property
    def headline(self) -> str:
        """What is right or wrong, with numbers, in one or two sentences."""
        law, step = self.law_answer, self.step_answer
        parts = []
        if law.outcome is Outcome.FAIL:
            parts.append(f"the law is wrong: {law.sentence.partition(': ')[2].rstrip('.')}")
        elif self.engine_answer.outcome is Outcome.FAIL:
            parts.append(f"the script meets a known defect of LAMMPS, {self.engine_answer.defects[0].name}")
        if step.assumed:
            parts.append(f"the scene gives no step; {step.step}, {step.assumed}, was assumed")
        if step.outcome is Outcome.FAIL:
            rest = "; all of it is the time step" if law.outcome is Outcome.PASS and not step.why else ""
            if step.list_limit < (step.dt or 0.0):
                limit = f"{number(step.list_limit)} {step.unit}"
                rest = f"; the neighbour list, which is safe up to {limit}, may miss contacts"
            parts.append(f"the step is too coarse: {step.headline}{rest}")
        if law.outcome is Outcome.BROKEN:
            parts.append(law.sentence.rstrip("."))
        if law.outcome is Outcome.PASS and step.outcome is Outcome.PASS and len(parts) == bool(step.assumed):
            error = f"within {share(step.error)} of the largest, {share(step.accuracy)} is allowed"
            doubts = [entry.sentence for entry in self.plausible if entry.look and entry.name in _NAMES_OF_DOUBTS]
            doubt = f", but look at the numbers: {'; '.join(doubts)}" if doubts else ""
            limit = f"{number(step.list_limit)} {step.unit}"
            unsafe = f"; the neighbour list is safe up to {limit} only" if step.list_limit < (step.dt or 0.0) else ""
            parts.append(f"law and step are right: at {step.step} velocities are {error}{unsafe}{doubt}")
        if law.outcome is Outcome.UNDECIDED:
            parts.append(f"the law was not checked: {law.sentence.rstrip('.')}")
        if step.outcome is Outcome.UNDECIDED and law.outcome is not Outcome.BROKEN:
            parts.append(step.sentence.rstrip("."))
        if law.outcome is Outcome.UNDECIDED and step.outcome is Outcome.PASS:
            parts.append(f"the step changes velocities by {share(step.error)} of the largest at {step.step}")
        return f"{'. '.join(part[:1].upper() + part[1:] for part in parts)}."

    def lines(self, page: str = "") -> Iterator[tuple[str, str]]:
        """Yield at most eight lines as pairs of name and text; ``page`` is the path of the page, if there is one."""
        yield self.outcome, self.headline
        extra = list(self._extra())
        shows_plausible = not extra or any(entry.look for entry in self.plausible)
        lines = self.advice
        most = max(1, MOST_LINES_TO_WRITE + 1 - bool(page) - len(extra) - shows_plausible)
        spare = len(lines) > most and not self.engine_answer.defects
        most += spare  # in place of the line on the release
        for place, line in enumerate(lines[:most]):
            left = len(lines) - most
            more = f"  (and {left} more line{'s' * (left > 1)}: --json)" if place == most - 1 and left > 0 else ""
            yield "write" if place == 0 else "", line + more
        yield "law", f"{_OF_LAW[self.law_answer.outcome]}: {self.law_answer.sentence}"
        yield "step", f"{_OF_STEP[self.step_answer.outcome]}: {self.step_answer.sentence}"
        if not spare:
            yield "release", self.engine_answer.sentence
        yield from extra
        if shows_plausible:
            yield "plausible", self.plausible_text
        if page:
            yield "page", page

    def _extra(self) -> Iterator[tuple[str, str]]:
        """Yield the lines that few scripts have: recorded states, and ties that matter."""
        if self.recorded_answer is not None:
            word = _OF_LAW.get(self.recorded_answer.outcome, "not judged")
            yield "recorded", f"{word}: {self.recorded_answer.sentences}"
        told = [tie for tie in self.tie_answers if tie.told]
        if told:
            more = f" (and {len(told) - 1} more: --json)" if len(told) > 1 else ""
            yield "ties", f"{told[0].sentence}{more}."

    @property
    def plausible_text(self) -> str:
        """What is worth a look, or the usual numbers."""
        looks = [entry.sentence for entry in self.plausible if entry.look]
        if looks:
            return f"look: {'; '.join(looks)}."
        usual = "; ".join(entry.sentence for entry in self.plausible)
        unread = "not examined: the script is not read as a chain" if self.unsupported else "nothing is unusual"
        return f"yes: {usual}." if usual else f"{unread}."

    def shown(self, page: str = "", *, most: int | None = None) -> str:
        """Return the answer in lines of 80 columns without broken words; lines to write and paths stay whole.

        ``most``: number of lines, for which the entries that are needed least are left out.
        """
        blocks = [(name, _block(name, text, whole=name in _WHOLE)) for name, text in self.lines(page)]
        for left_out in _LEAST_NEEDED:
            if most is not None and sum(len(block) for _, block in blocks) > most:
                blocks = [(name, block) for name, block in blocks if name != left_out]
        return "\n".join(line for _, block in blocks for line in block)

    def __repr__(self) -> str:
        return self.shown(most=MOST_LINES_PRINTED)

    @property
    def study(self) -> Study:
        """The answer as a study: its page, table and figures."""
        from dem_bridge.judging.check.shown import check_study  # it is built on answers

        return check_study(self)

    def save(self, folder: str | Path) -> None:
        """Write the page and ``check.json`` into ``folder``, which is created if need be."""
        self.study.save(folder)

    def _repr_html_(self) -> str:
        return self.study._repr_html_()
