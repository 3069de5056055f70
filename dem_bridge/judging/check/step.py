"""Whether the time step of a script is right for an accuracy, and the largest that is."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from dem_bridge.errors import DemBridgeError
from dem_bridge.foundation.wording import number, share
from dem_bridge.judging.check.edits import tidy_factor
from dem_bridge.judging.check.laboratory import Laboratory
from dem_bridge.judging.check.neighbours import SAFE_COMMAND, neighbour_list
from dem_bridge.judging.model import MotionTooLong
from dem_bridge.observables.largest_step import LargestStep, StepError, with_sources
from dem_bridge.observables.verdict import Outcome, judge

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
#: part by which the error of LAMMPS at a step of our code may be above the accuracy: samples and durations differ
_SLACK_OF_CONFIRMED_ERROR = 0.05
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
    steps: Mapping[float, LargestStep | None] = field(default_factory=dict)
    """Largest step for an accuracy; None where it is not known."""
    factor: int = 1
    """How many times shorter the steps to write are; 0: no step serves."""
    only_coarse: bool = False
    """True if only the coarse ones of several steps are to be divided."""
    confirmed: float = math.nan
    """Error of LAMMPS with the lines to write; nan where it was not run."""
    limit: float = math.nan
    """Largest stable step, s."""
    list_limit: float = math.nan
    """Step, s, above which the neighbour list may miss contacts; nan where it does not limit the steps."""
    with_safe_list: float = math.nan
    """Largest step, s, for the accuracy with a list that misses none; nan if no run confirms it."""
    list_words: str = ""
    """The neighbour list in words."""
    unit: str = "s"
    """Unit of time in words."""
    order: float = 2.0
    """Order of the error in the step."""
    outcome: Outcome = Outcome.UNDECIDED
    assumed: str = ""
    """What the step is that was assumed because a scene gives none; '' where it was given."""
    why: str = ""
    """Why the step is undecided, or further words."""

    @property
    def largest_for_accuracy(self) -> float:
        """Largest step, s, for the accuracy; nan where it is not known."""
        return self.largest.get(self.accuracy, math.nan)

    @property
    def largest(self) -> dict[float, float]:
        """Largest step, s, for each accuracy; nan where it is not known."""
        return {accuracy: math.nan if step is None else step.dt for accuracy, step in self.steps.items()}

    @property
    def step(self) -> str:
        """The step in words."""
        return f"{number(self.dt)} {self.unit}" if self.dt else "the time steps"

    @property
    def sentence(self) -> str:
        """The answer in a sentence with numbers."""
        return "; ".join(part for part in (self._first(), self._others()) if part) + "."

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

    def _others(self) -> str:
        told = [
            (f"{self._words(step.dt)} gives {share(a)}", step) for a, step in self.steps.items() if step is not None
        ]
        steps = [with_sources(told, self._words)] if told else []
        limit = [f"unstable above {number(self.limit)} {self.unit}"] if self.limit > 0.0 else []
        return ", ".join((*steps, *limit, *self._of_list()))

    def _of_list(self) -> list[str]:
        """Return the limit that the neighbour list sets, and what is possible without it."""
        if math.isnan(self.list_limit):
            return []
        more = f"{self._words(self.with_safe_list)} gives {share(self.accuracy)}"
        more = more if self.with_safe_list > 0.0 else "larger steps are possible"
        said = f"the neighbour list is safe up to {self._words(self.list_limit)} ({self.list_words})"
        return [f"{said}: with `{SAFE_COMMAND}` {more}"]

    def _words(self, step: float) -> str:
        """Return a step with its unit."""
        return f"{number(step)} {self.unit}"


def step_of(lab: Laboratory, accuracy: float, *, law_is_right: bool, lost: bool) -> StepAnswer:
    """Return the answer on the step by our code, which repeats LAMMPS, and by LAMMPS with the lines to write.

    ``lost``: LAMMPS lost bodies at this step.
    """
    dt = lab.subject.deck.dt
    assert dt is not None  # see ``Laboratory.problem``
    lab.say("largest steps")
    try:
        curve = lab.predicted(dt, (accuracy, _SHARE_OF_ACCURACY_TOLD_TOO * accuracy))
    except MotionTooLong as problem:
        why = f"the largest steps are not answered, because {problem}"
        return StepAnswer(dt=dt, accuracy=accuracy, unit=lab.subject.time_unit, why=why)
    curve = curve or StepError(dt=dt, stated=True, curve=((dt, 0.0),))
    now = math.inf if lost else lab.error(lab.lammps()) if law_is_right else curve.error
    answer = StepAnswer(
        dt=dt,
        accuracy=accuracy,
        error=now,
        uncertainty=lab.reference.uncertainty["velocity"] / lab.speed,
        scale=lab.speed,
        limit=lab.limit,
        unit=lab.subject.time_unit,
    )
    if now < _LARGEST_ROUNDOFF and curve.error < _LARGEST_ROUNDOFF:
        why = f"no step is seen at {answer.step}: the velocities do not depend on it"
        return replace(answer, outcome=Outcome.PASS if law_is_right else Outcome.UNDECIDED, why=why)
    # a step beyond the limit of stability, or longer than the run, is none
    most = min((value for value in (answer.limit, float(lab.times[-1])) if value > 0.0), default=math.inf)
    answer = _limited_by_list(lab, answer, curve, most, dt if law_is_right and not lost else 0.0)
    outcome = Outcome.FAIL if lost else judge(now, answer.uncertainty, accuracy)
    if outcome is Outcome.UNDECIDED:
        asked = f"{share(accuracy)} is asked"
        why = f"the reference is uncertain by {share(answer.uncertainty)} of the largest velocity, {asked}"
        return replace(answer, outcome=outcome, why=why)
    if outcome is Outcome.PASS and (missed := _missed(lab, answer)):
        return replace(answer, outcome=Outcome.UNDECIDED, why=missed)
    by_chance = max((error for step, error in curve.curve if step < dt), default=0.0)
    if outcome is Outcome.PASS and by_chance <= accuracy:
        return replace(answer, outcome=outcome)
    why = f"its error is small by chance: finer steps err by {share(by_chance)}" if outcome is Outcome.PASS else ""
    largest = curve.largest_for(accuracy)
    if math.isnan(largest):  # runs with so fine a step were too long to be tried
        largest = min(dt, most) * _FIRST_STEP_OF_LIMIT
    factor, confirmed = _factor(lab, largest, accuracy, confirm=law_is_right)
    if factor == 0:
        why = f"no step was found that gives {share(accuracy)}"
    return replace(answer, outcome=Outcome.FAIL, factor=factor, confirmed=confirmed, why=why)


def _limited_by_list(lab: Laboratory, answer: StepAnswer, curve: StepError, most: float, safe: float) -> StepAnswer:
    """Return the answer with its largest steps, in which the neighbour list of the script misses no contact.

    ``most``: longest step, s, that is possible; ``safe``: step at which LAMMPS was seen to miss none.
    """
    steps = _largest_steps(curve, answer.accuracy, most=most)
    neighbours = neighbour_list(lab.subject.deck)
    limit = math.inf if neighbours is None or lab.subject.of_scene else neighbours.largest_step(lab.speed)
    largest = steps[answer.accuracy]
    seen = {accuracy: safe if answer.error <= accuracy else 0.0 for accuracy in steps}
    if neighbours is None or largest is None or largest.dt <= max(limit, seen[answer.accuracy]):
        return replace(answer, steps=steps)
    error = lab.error_with_safe_list(largest.dt)
    return replace(
        answer,
        steps={accuracy: curve.largest_step(accuracy, most=max(limit, seen[accuracy])) for accuracy in steps},
        list_limit=limit,
        with_safe_list=largest.dt if error <= answer.accuracy * (1.0 + _SLACK_OF_CONFIRMED_ERROR) else math.nan,
        list_words=neighbours.words,
    )


def _largest_steps(
    curve: StepError, accuracy: float, *, order: float | None = None, most: float = math.inf
) -> dict[float, LargestStep | None]:
    """Return the largest steps for the accuracy and for a part of it; None where they are not known."""
    accuracies = (accuracy, _SHARE_OF_ACCURACY_TOLD_TOO * accuracy)
    return {a: curve.largest_step(a, order=order, most=most) for a in accuracies}


def _missed(lab: Laboratory, answer: StepAnswer) -> str:
    """Return why the error may be larger than at the samples; '' if they resolve the run, or leave a factor of two."""
    if lab.resolves or 2.0 * answer.error <= answer.accuracy:
        return ""
    size = f"the error is {share(answer.error)} at the samples"
    return f"{size}, and the run is so long that larger ones may be between them: check a shorter run"


def _factor(lab: Laboratory, largest: float, accuracy: float, *, confirm: bool) -> tuple[int, float]:
    """Return by what to divide the steps, and the error of LAMMPS then; 0 if none serves."""
    dt = lab.subject.deck.dt
    assert dt is not None  # see ``Laboratory.problem``
    least, runs = (dt / largest if largest > 0.0 else 2.0), 0
    for _ in range(_MOST_FACTORS_TRIED):
        factor = tidy_factor(dt, max(least, 2.0))
        if factor * _work(lab) > _MOST_STEPS_TIMES_BODIES:
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


def _work(lab: Laboratory) -> int:
    """Return the steps times bodies of one run of the script."""
    return lab.subject.deck.state.steps * len(lab.subject.deck.state.particles.atoms)


def _confirmed(lab: Laboratory, factor: int) -> float:
    """Return the error of LAMMPS with steps so many times shorter; nan if the steps of the script cannot be changed."""
    try:
        return lab.confirmed_error(factor)
    except DemBridgeError:
        return math.nan


# ---------------------------------------------------------------- by LAMMPS alone
def step_by_lammps(lab: Laboratory, accuracy: float, base: int = 1) -> StepAnswer:
    """Return the answer on the step by runs of LAMMPS at the step, a half and a quarter of it; no scene is needed.

    ``base``: the first of these runs has steps so many times shorter, because LAMMPS loses bodies at those of the
    script.
    """
    dt = lab.subject.deck.dt
    first, second, third = (lab.lammps(factor * base) for factor in (1, 2, 4))
    scale = float(np.max(np.abs(third.velocity)))
    answer = StepAnswer(dt=dt, accuracy=accuracy, scale=scale, unit=lab.subject.time_unit)
    if not np.all(np.isfinite(third.velocity)):
        return replace(answer, why="velocities of LAMMPS are not numbers")
    if not scale > 0.0:
        return replace(answer, why="nothing moves during the run, so no step is tested")
    if np.all(third.velocity == third.velocity[0]) and np.all(third.active == third.velocity[0]):
        return replace(answer, why="no velocity changes during the run, so no step is tested")
    coarse, fine = first.apart(second) / scale, second.apart(third) / scale
    if not math.isfinite(coarse):
        return replace(answer, why="velocities of LAMMPS are not numbers")
    answer = (
        _by_order(answer, coarse, fine)
        if fine >= _LARGEST_ROUNDOFF
        else replace(answer, error=coarse, uncertainty=fine)
    )
    order, error = answer.order, answer.error
    # a script with several steps has no largest one
    errors = ((2.0, _of_difference(fine, order)), (1.0, error))
    curve = StepError(curve=() if dt is None else tuple((dt / (part * base), size) for part, size in errors))
    ordered = fine >= _LARGEST_ROUNDOFF and not answer.why
    steps = _largest_steps(curve, accuracy, order=order) if ordered else {}
    outcome = Outcome.UNDECIDED if answer.why else judge(error, answer.uncertainty, accuracy)
    answer = replace(answer, steps=steps, outcome=outcome)
    if base == 1 and outcome is Outcome.PASS and (missed := _missed(lab, answer)):
        return replace(answer, outcome=Outcome.UNDECIDED, why=missed)
    if base > 1:
        answer = replace(answer, error=math.inf, outcome=Outcome.FAIL, why="")
        if outcome is Outcome.PASS:
            return replace(answer, factor=base, confirmed=error)
    if answer.outcome is not Outcome.FAIL:
        return answer
    least = base * (error / (_SHARE_OF_ACCURACY_AIMED_AT * accuracy)) ** (1.0 / order)
    for _ in range(_MOST_CONFIRMING_RUNS):
        factor = tidy_factor(dt or 1.0, max(least, 2.0))
        if factor * _work(lab) > _MOST_STEPS_TIMES_BODIES:
            break
        apart = lab.lammps(factor).apart(lab.lammps(2 * factor)) / scale
        if (left := _of_difference(apart, order)) <= accuracy:
            return _only_coarse(lab, replace(answer, factor=factor, confirmed=left))
        least = 1.5 * factor
    return replace(answer, factor=0, why=f"no step was found that gives {share(accuracy)}")


def _only_coarse(lab: Laboratory, answer: StepAnswer) -> StepAnswer:
    """Return an answer whose lines change only the coarse ones of several steps, if a run with these is right, too."""
    if answer.dt is not None or lab.scene is None:
        return answer
    edits = lab.subject.edits_of_coarse(answer.factor)
    error = lab.error_of(edits) if edits else math.nan
    return replace(answer, only_coarse=True, confirmed=error) if error <= answer.accuracy else answer


def _by_order(answer: StepAnswer, coarse: float, fine: float) -> StepAnswer:
    """Return error and uncertainty by the differences of runs at a step, a half and a quarter of it."""
    ratio = coarse / fine
    if ratio < _LEAST_CONVERGING_RATIO and coarse > _SHARE_OF_ACCURACY_TOLD_TOO * answer.accuracy:
        sizes = f"{share(coarse)} and {share(fine)} of the largest velocity"
        why = f"runs at halved steps differ by {sizes}: no order is seen"
        return replace(answer, error=coarse, uncertainty=coarse, why=why)
    order = min(max(math.log2(ratio), 0.5), 2.0)
    error = _of_difference(coarse, order)
    bound = abs(error - _of_difference(coarse, max(0.7 * order, 0.5))) + _LARGEST_ROUNDOFF
    return replace(answer, error=error, uncertainty=bound, order=order)


def _of_difference(difference: float, order: float) -> float:
    """Return the error of a run by its difference from one at half of its step.

    Examples
    --------
    >>> round(_of_difference(3e-3, 2.0), 9)
    0.004
    """
    return float(difference / (1.0 - 2.0**-order))
