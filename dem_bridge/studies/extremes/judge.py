"""Right within its bar, or refused with the reason: a run beside what it must be.

A run is right where, for each of the quantities that have bars, ``|run - truth| <= bar of the run + bar of the truth``
at every sample, body and contact. A bar of a whole scale says nothing of velocities, and is told as that. What is
further away than both bars is wrong in silence, which no backend may be.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from dem_bridge.errors import BackendUnavailable
from dem_bridge.observables.verdict import Outcome
from dem_bridge.runs.campaign import Crashed, Result
from dem_bridge.trajectory.relative import own_scale, relative_size
from dem_bridge.trajectory.trajectory import QUANTITIES, Trajectory

#: of the largest velocity: a bar as large as that leaves nothing known
WHOLE = 1.0


class Word(StrEnum):
    """Possible findings on a backend and an extreme scene."""

    RIGHT = "right"
    NO_BAR = "no bar"
    """A number whose bar is a whole scale or more: it says that it says nothing."""
    MODEL = "model"
    """Other equations: a number, and nothing to be right or wrong by."""
    REFUSED = "refused"
    WRONG = "wrong"
    """Further from the truth than its bar and that of the truth allow."""
    NO_TRUTH = "no truth"
    """Nothing that it could be judged by has a bar."""
    BROKEN = "broken"
    """An exception that none of ours is."""
    NOT_RUN = "not run"
    """The engine is not on this machine, or it would take too long."""


@dataclass(frozen=True)
class Expected:
    """Findings that are expected of a backend; several where round-off decides between them.

    >>> Expected(Word.REFUSED, because="gaps").fits(Word.REFUSED, "there are gaps")
    True
    """

    word: Word
    because: str = ""
    """A part of the reason, where the scene is refused."""
    otherwise: Word | None = None

    def fits(self, word: Word, reason: str) -> bool:
        """Return whether a finding is the expected one."""
        if word not in (self.word, self.otherwise):
            return False
        # a scene is refused in one clear line
        return word is not Word.REFUSED or (bool(reason) and "\n" not in reason and self.because in reason)

    def __str__(self) -> str:
        words = self.word if self.otherwise is None else f"{self.word} or {self.otherwise}"
        return f"{words}: {self.because}" if self.because else str(words)


@dataclass(frozen=True, kw_only=True)
class Standard:
    """Trajectory with uncertainties that a run is compared with, and its source; or the reason why there is none."""

    says: str
    run: Trajectory | None
    reason: str = ""
    to_the_bit: bool = False
    """Whether the run must be this one, whatever the bars."""


@dataclass(frozen=True, kw_only=True)
class Finding:
    """Finding on one backend and one entry with the deciding quantity; all numbers are relative to its scale."""

    word: Word
    reason: str = ""
    standard: str = ""
    quantity: str = ""
    error: float = math.nan
    bar: float = math.nan
    """Of the run, where its error is the largest part of what is allowed."""
    standard_bar: float = math.nan
    ratio: float = math.nan
    """Error over both bars: above 1 it is wrong."""
    velocity_bar: float = math.nan
    """Of the run, over the largest velocity: what it says of itself."""
    unsaid: str = ""
    """Quantities of which nothing is said: without a bar, or with one of a whole scale."""

    @property
    def cell(self) -> str:
        """A few words."""
        cells = {
            Word.RIGHT: f"right (bar {self.velocity_bar:.0e})",
            Word.MODEL: f"model ({self.error:.0e})",
            Word.WRONG: f"WRONG (error / bar {self.ratio:.2g})",
        }
        return cells.get(self.word, str(self.word))


def judge(result: Result, standards: Sequence[Standard], *, model: bool) -> Finding:
    """Compare ``result`` with its ``standards``; the one that it differs from most decides.

    ``model``: whether it solves other equations, so that only a number can be stated.
    """
    run, failure = result.trajectory, result.failure
    if run is None:
        words = {BackendUnavailable: Word.NOT_RUN, Crashed: Word.BROKEN}
        word = next((word for kind, word in words.items() if isinstance(failure, kind)), Word.REFUSED)
        return Finding(word=word, reason=str(failure))
    if model:
        return _model(run, standards)
    results, truths = [], []
    for standard in standards:
        if standard.run is None:
            return Finding(word=Word.NO_TRUTH, standard=standard.says, reason=standard.reason)
        truths.append(standard.run)
        results.append(_worst(run, standard.run, standard))
    worst = max(results, key=lambda item: item.ratio)
    if worst.ratio <= 1.0 and worst.velocity_bar >= WHOLE:
        return replace(worst, word=Word.NO_BAR, reason="its bar is a whole scale: it says nothing")
    if worst.ratio <= 1.0 and min(map(_said, truths)) >= WHOLE:
        return replace(worst, word=Word.NO_TRUTH, reason="no truth has a bar")
    return worst


def outcome(finding: Finding, expected: Expected) -> Outcome:
    """Return PASS where what was found is expected; a missing engine is NOT_RUN, a crash BROKEN."""
    outcomes = {Word.NOT_RUN: Outcome.NOT_RUN, Word.BROKEN: Outcome.BROKEN}
    fits = expected.fits(finding.word, finding.reason)
    return outcomes.get(finding.word, Outcome.PASS if fits else Outcome.FAIL)


def _said(run: Trajectory) -> float:
    """Return the bar of the velocities over the largest of them; 0 where all are at rest and known to be."""
    return relative_size(float(run.uncertainty["velocity"]), float(np.max(np.abs(run.velocity))))


def _model(run: Trajectory, standards: Sequence[Standard]) -> Finding:
    """Return the deviation of a theory from the first standard.

    It is that of arrival times or, where none falls into the duration of the scene, the median of the contacts' forces.
    """
    if not np.all(np.isfinite(run.velocity)):
        return Finding(word=Word.WRONG, reason="velocities that are not finite", ratio=math.inf)
    truth = standards[0].run
    for name in ("crossing_time", "peak_force") if truth is not None else ():
        other = getattr(truth, name)
        apart = relative_size(np.abs(getattr(run, name) - other), own_scale(other))
        if np.isfinite(apart).any():
            error = float(np.median(apart[np.isfinite(apart)]))
            return Finding(word=Word.MODEL, standard=standards[0].says, quantity=name, error=error)
    return Finding(word=Word.MODEL, standard=standards[0].says)


def _worst(run: Trajectory, truth: Trajectory, standard: Standard) -> Finding:
    """Return the finding on the quantity of which the error is the largest part of both bars."""
    results: list[Finding] = []
    unsaid: list[str] = []
    for name in QUANTITIES:
        first, other = getattr(run, name), getattr(truth, name)
        error = np.abs(first - other)
        # neither has a value: agreed; only one has: infinitely far apart
        error = np.where(np.isnan(first) & np.isnan(other), 0.0, np.where(np.isnan(error), math.inf, error))
        sampled = name in ("velocity", "displacement")
        if sampled:
            error = np.max(error, initial=0.0, keepdims=True).ravel()
            scale = np.array([np.max(np.abs(other), initial=0.0)])
        else:
            scale = own_scale(other)
        bars = [np.broadcast_to(np.atleast_1d(item.uncertainty[name]), error.shape) for item in (run, truth)]
        allowed = np.zeros_like(error) if standard.to_the_bit else bars[0] + bars[1]
        # 0: right to the last digit, or nothing was said
        ratio = np.where((error == 0.0) | np.isinf(allowed), 0.0, math.inf)
        np.divide(error, allowed, out=ratio, where=np.isinf(ratio) & (allowed > 0.0))
        if not len(ratio):
            continue
        # of what never happens there is no scale: any bar but an infinite one says that it does not
        vague = int(np.sum(np.isinf(bars[0]) | ((scale > 0.0) & (bars[0] >= WHOLE * scale))))
        if vague:
            unsaid.append(name if sampled else f"{name} of {vague} of {len(ratio)}")
        at = int(np.argmax(ratio))
        of = float(scale[at])
        results.append(
            Finding(
                word=Word.RIGHT if ratio[at] <= 1.0 else Word.WRONG,
                standard=standard.says,
                quantity=name if sampled else f"{name} of contact {at}",
                error=relative_size(float(error[at]), of),
                bar=relative_size(float(bars[0][at]), of),
                standard_bar=relative_size(float(bars[1][at]), of),
                ratio=float(ratio[at]),
                velocity_bar=_said(run),
            )
        )
    return replace(max(results, key=lambda result: result.ratio), unsaid=", ".join(unsaid))
