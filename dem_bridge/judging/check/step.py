"""Whether the time step of a script is right for an accuracy, and the largest that is."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from dem_bridge.errors import DemBridgeError
from dem_bridge.judging.check.edits import tidy_factor
from dem_bridge.judging.check.laboratory import Laboratory
from dem_bridge.judging.check.words import number, share
from dem_bridge.judging.step import StepError
from dem_bridge.observables.verdict import Outcome, judge
from dem_bridge.scene.timescales import contact_time_of
from dem_bridge.trajectory.trajectory import Floats

#: part of the accuracy that a step by LAMMPS alone aims at; steps finer than one to write by these factors must serve,
#: too
_SHARE_OF_ACCURACY_AIMED_AT, _FACTORS_THAT_MUST_SERVE = 0.85, (1.0, 1.31, 1.83)
#: part of the accuracy for which the largest step is told, too
_SHARE_OF_ACCURACY_TOLD_TOO = 0.1
#: first step, of the stability limit, that is tried where the largest is not known
_FIRST_STEP_OF_LIMIT = 0.05
#: factors that are tried for a step that serves, each larger by a fifth, and runs of LAMMPS that confirm one
_MOST_FACTORS_TRIED, _MOST_CONFIRMING_RUNS = 16, 3
#: steps times bodies of one run of our code that a check makes at most
_MOST_STEPS_TIMES_BODIES = 2e9
#: relative error below which no contact acted, or round-off alone is left
_LARGEST_ROUNDOFF = 1e-13
#: two differences of runs at halved steps whose ratio is below this show no convergence
_LEAST_CONVERGING_RATIO = 1.4


@dataclass(frozen=True, kw_only=True)
class StepAnswer:
    """The error of the time step of a script and the steps that serve; errors relative to the largest velocity."""

    dt: float | None
    """Time step, s; None if the script has several."""
    accuracy: float
    error: float = math.nan
    """Error at the step of the script; inf where LAMMPS loses bodies, nan where it is not known."""
    uncertainty: float = math.nan
    scale: float = math.nan
    """Largest velocity, m/s, or in the units of the script where it has no scene."""
    largest: dict[float, float] = field(default_factory=dict)
    """Largest step, s, for an accuracy; nan where it is not known."""
    factor: int = 1
    """How many times shorter the steps to write are; 0: no step serves."""
    confirmed: float = math.nan
    """Error of LAMMPS with the lines to write; nan where it was not run."""
    limit: float = math.nan
    """Stability limit 2/omega of the stiffest contact, s."""
    contact: float = math.nan
    """Shortest contact time, s."""
    outcome: Outcome = Outcome.UNDECIDED
    why: str = ""
    """Why the step is undecided, or further words."""

    @property
    def largest_for_accuracy(self) -> float:
        """Largest step, s, for the accuracy; nan where it is not known."""
        return self.largest.get(self.accuracy, math.nan)

    @property
    def step(self) -> str:
        """The step in words."""
        return f"{number(self.dt)} s" if self.dt else "the time steps"

    @property
    def sentence(self) -> str:
        """The answer in a sentence with numbers."""
        return "; ".join(part for part in (self._first(), self._shares(), self._others()) if part) + "."

    @property
    def headline(self) -> str:
        """The error of a step that is too coarse, in words."""
        if math.isinf(self.error):
            return f"at {self.step} LAMMPS loses bodies"
        why = f"; {self.why}" if self.why else ""
        return f"at {self.step} velocities are wrong by {share(self.error)} of the largest{why}"

    def _first(self) -> str:
        if self.outcome is Outcome.BROKEN:
            return self.why
        if self.outcome is Outcome.UNDECIDED:
            return self.why or f"the error at {self.step} is {share(self.error)} +- {share(self.uncertainty)}"
        if self.outcome is Outcome.PASS and not self.error > _LARGEST_ROUNDOFF:
            return self.why or f"at {self.step} no error is seen"
        return f"{self.headline}, {share(self.accuracy)} allowed"

    def _shares(self) -> str:
        if not self.dt or not self.contact > 0.0:
            return ""
        ratio = self.contact / self.dt
        return f"1/{ratio:.0f} of the shortest contact" if ratio >= 1.5 else f"{1 / ratio:.2g} shortest contacts"

    def _others(self) -> str:
        told = [f"{number(step)} s gives {share(a)}" for a, step in self.largest.items() if step > 0.0]
        limit = [f"above {number(self.limit)} s (2/omega) bodies are lost"] if self.limit > 0.0 else []
        return ", ".join((*told, *limit))


def step_of(lab: Laboratory, accuracy: float, *, law_is_right: bool, lost: bool) -> StepAnswer:
    """Return the answer on the step by our code, which repeats LAMMPS, and by LAMMPS with the lines to write.

    ``lost``: LAMMPS lost bodies at this step.
    """
    dt, scene, prescan = lab.subject.deck.dt, lab.scene, lab.prescan
    assert dt is not None  # see ``Laboratory.problem``
    assert scene is not None
    lab.say("largest steps")
    curve = lab.predicted(dt, (accuracy, _SHARE_OF_ACCURACY_TOLD_TOO * accuracy)) or StepError(
        dt=dt, stated=True, curve=((dt, 0.0),)
    )
    now = math.inf if lost else lab.error(lab.lammps().velocity) if law_is_right else curve.error
    answer = StepAnswer(
        dt=dt,
        accuracy=accuracy,
        error=now,
        uncertainty=lab.reference.uncertainty["velocity"] / lab.speed,
        scale=lab.speed,
        contact=contact_time_of(scene) or math.nan,
        limit=2.0 / prescan.frequency if prescan is not None and prescan.frequency > 0.0 else math.nan,
    )
    if now < _LARGEST_ROUNDOFF and curve.error < _LARGEST_ROUNDOFF:
        why = f"no step is seen at {number(dt)} s: the velocities do not depend on it"
        return replace(answer, outcome=Outcome.PASS if law_is_right else Outcome.UNDECIDED, why=why)
    answer = replace(
        answer, largest={a: curve.largest_for(a) for a in (accuracy, _SHARE_OF_ACCURACY_TOLD_TOO * accuracy)}
    )
    outcome = Outcome.FAIL if lost else judge(now, answer.uncertainty, accuracy)
    if outcome is Outcome.UNDECIDED:
        asked = f"{share(accuracy)} is asked"
        why = f"the reference is uncertain by {share(answer.uncertainty)} of the largest velocity, {asked}"
        return replace(answer, outcome=outcome, why=why)
    by_chance = max((error for step, error in curve.curve if step < dt), default=0.0)
    if outcome is Outcome.PASS and by_chance <= accuracy:
        return replace(answer, outcome=outcome)
    why = f"its error is small by chance: finer steps err by {share(by_chance)}" if outcome is Outcome.PASS else ""
    largest = curve.largest_for(accuracy)
    if math.isnan(largest):  # runs with so fine a step were too long to be tried
        largest = min(dt, answer.limit) * _FIRST_STEP_OF_LIMIT
    factor, confirmed = _factor(lab, largest, accuracy, confirm=law_is_right)
    if factor == 0:
        why = f"no step was found that gives {share(accuracy)}"
    return replace(answer, outcome=Outcome.FAIL, factor=factor, confirmed=confirmed, why=why)


def _factor(lab: Laboratory, largest: float, accuracy: float, *, confirm: bool) -> tuple[int, float]:
    """Return by what to divide the steps, and the error of LAMMPS then; 0 if none serves."""
    dt, state = lab.subject.deck.dt, lab.subject.deck.state
    assert dt is not None  # see ``Laboratory.problem``
    least, runs = (dt / largest if largest > 0.0 else 2.0), 0
    for _ in range(_MOST_FACTORS_TRIED):
        factor = tidy_factor(dt, max(least, 2.0))
        if factor * state.steps * len(state.particles.atoms) > _MOST_STEPS_TIMES_BODIES:
            break
        finer = (lab.predicted(dt / (factor * part)) for part in _FACTORS_THAT_MUST_SERVE)
        if all(curve is not None and curve.error <= accuracy for curve in finer):
            error = _confirmed(lab, factor) if confirm else math.nan
            if not error > accuracy:
                return factor, error
            runs += 1
            if runs == _MOST_CONFIRMING_RUNS:
                break
        least = 1.2 * factor
    return 0, math.nan


def _confirmed(lab: Laboratory, factor: int) -> float:
    """Return the error of LAMMPS with steps so many times shorter; nan if the steps of the script cannot be changed."""
    try:
        return lab.confirmed_error(factor)
    except DemBridgeError:
        return math.nan


# ---------------------------------------------------------------- by LAMMPS alone
def step_by_lammps(lab: Laboratory, accuracy: float) -> StepAnswer:
    """Return the answer on the step by runs of LAMMPS at the step, a half and a quarter of it; no scene is needed."""
    dt = lab.subject.deck.dt
    first, second, third = (lab.lammps(factor).velocity for factor in (1, 2, 4))
    answer = StepAnswer(dt=dt, accuracy=accuracy, scale=float(np.max(np.abs(third))))
    coarse, fine = _apart(first, second, answer.scale), _apart(second, third, answer.scale)
    if not (math.isfinite(coarse) and answer.scale > 0.0):
        return replace(answer, why="velocities of LAMMPS are not numbers, or nothing moves")
    if fine < _LARGEST_ROUNDOFF:
        return replace(answer, error=coarse, uncertainty=fine, outcome=judge(coarse, fine, accuracy))
    ratio = coarse / fine
    if ratio < _LEAST_CONVERGING_RATIO and coarse > _SHARE_OF_ACCURACY_TOLD_TOO * accuracy:
        sizes = f"{share(coarse)} and {share(fine)} of the largest velocity"
        why = f"runs at halved steps differ by {sizes}: no order is seen"
        return replace(answer, error=coarse, uncertainty=coarse, why=why)
    order = min(max(math.log2(ratio), 0.5), 2.0)
    error = _of_difference(coarse, order)
    answer = replace(
        answer,
        error=error,
        uncertainty=abs(error - _of_difference(coarse, max(0.7 * order, 0.5))) + _LARGEST_ROUNDOFF,
        largest={
            a: (dt or math.nan) * (a / error) ** (1.0 / order)
            for a in (accuracy, _SHARE_OF_ACCURACY_TOLD_TOO * accuracy)
        },
    )
    outcome = judge(error, answer.uncertainty, accuracy)
    if outcome is not Outcome.FAIL:
        return replace(answer, outcome=outcome)
    least = (error / (_SHARE_OF_ACCURACY_AIMED_AT * accuracy)) ** (1.0 / order)
    for _ in range(_MOST_CONFIRMING_RUNS):
        factor = tidy_factor(dt or 1.0, max(least, 2.0))
        apart = _apart(lab.lammps(factor).velocity, lab.lammps(2 * factor).velocity, answer.scale)
        if (left := _of_difference(apart, order)) <= accuracy:
            return replace(answer, outcome=outcome, factor=factor, confirmed=left)
        least = 1.5 * factor
    return replace(answer, outcome=outcome, factor=0, why=f"no step was found that gives {share(accuracy)}")


def _of_difference(difference: float, order: float) -> float:
    """Return the error of a run by its difference from one at half of its step.

    Examples
    --------
    >>> round(_of_difference(3e-3, 2.0), 9)
    0.004
    """
    return float(difference / (1.0 - 2.0**-order))


def _apart(one: Floats, other: Floats, scale: float) -> float:
    """Return the largest difference of the velocities of two runs relative to the largest velocity."""
    rows = min(len(one), len(other))
    with np.errstate(all="ignore"):
        return float(np.max(np.abs(one[:rows] - other[:rows]))) / scale
