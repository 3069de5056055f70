"""The states that a unit test of LAMMPS recorded, against our velocity-Verlet code at the step of the test.

A state was recorded by the LAMMPS that its authors had, which need not be here: so that release is judged, too.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dem_bridge.backends.base import backend, unsupported_reason
from dem_bridge.errors import BackendUnavailable, DemBridgeError, RunBroken
from dem_bridge.foundation.wording import number, release, share
from dem_bridge.judging.check.law import LARGEST_ROUNDOFF, MULTIPLE_OF_RADIUS_CHANGE
from dem_bridge.judging.check.ties import Tie
from dem_bridge.judging.deck import UserDeck
from dem_bridge.judging.twin_run import twin_run, with_wider_gaps
from dem_bridge.judging.unit_test.driver import TestRun, run_unit_test
from dem_bridge.lmp.engine import Engine
from dem_bridge.lmp.unit_test import UnitTest, component_error, recorded_states
from dem_bridge.observables.verdict import Outcome, plain
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import Floats


@dataclass(frozen=True, kw_only=True)
class RecordedAnswer:
    """The recorded velocities of a unit test minus those of our code at the same step."""

    outcome: Outcome
    sentence: str
    difference: float = math.nan
    """Largest difference of velocities, relative to the largest velocity."""
    allowed: float = math.nan
    """What round-off explains, relative to the largest velocity."""
    by_component: float = math.nan
    """Largest difference as the test program measures it, which must be at most the ``epsilon`` of the test."""
    result: TestRun | None = None
    """The result of the test by the LAMMPS that is here; None if it could not be executed."""

    @property
    def sentences(self) -> str:
        """The sentence on the recorded states, and the one on the test by the LAMMPS that is here."""
        if self.result is None:
            return self.sentence
        words = {Outcome.PASS: "passes", Outcome.FAIL: "fails"}.get(self.result.outcome, "has nothing to compare")
        return f"{self.sentence} The test {words} with LAMMPS {release(self.result.version)}: {self.result.sentence}"

    def as_json(self) -> dict[str, object]:
        """Return outcome, sentence and numbers, and the result of the test."""
        result = self.result
        return {
            "outcome": self.outcome.value,
            "sentence": self.sentence,
            "difference": plain(self.difference),
            "allowed": plain(self.allowed),
            "by_component": plain(self.by_component),
            "test": None
            if result is None
            else {
                "outcome": result.outcome.value,
                "sentence": result.sentence,
                "release": result.version,
                "largest": plain(result.largest),
                "comparisons": result.comparisons,
            },
        }


def recorded_of(
    test: UnitTest, deck: UserDeck, ties: Sequence[Tie], engine: Engine | None, time_limit: float
) -> RecordedAnswer:
    """Return the answer on the recorded states of a test with these ties, with the result of the test by an engine."""
    answer = judge_recorded(test, deck, ties)
    try:
        return replace(answer, result=run_unit_test(test, engine=engine, time_limit=time_limit))
    except (RunBroken, BackendUnavailable) as error:
        return replace(answer, sentence=f"{answer.sentence} The test was not executed: {str(error).rstrip('.')}.")


def judge_recorded(test: UnitTest, deck: UserDeck, ties: Sequence[Tie] = ()) -> RecordedAnswer:
    """Return the answer on the recorded states of a test, whose script is ``deck`` and has these ties."""
    if deck.read is None or deck.dt is None:
        return _not_judged("the test cannot be read as a scene with one time step")
    states = recorded_states(test, deck.read)
    if states is None:
        return _not_judged("the test has no recorded positions and velocities after a step")
    if reason := unsupported_reason(backend("verlet"), deck.read.scene):
        return _not_judged(reason)
    try:
        velocity, displacement = in_segments(deck.read.scene, deck.dt, states.steps, deck.radius)
        plainly, _ = in_segments(deck.read.scene, deck.dt, states.steps, None)
    except DemBridgeError as error:
        return _not_judged(str(error))
    speed = max(float(np.max(np.abs(velocity))), max(map(abs, deck.read.scene.velocity))) or 1.0
    apart = np.abs(states.velocity - velocity)
    round_off = float(np.max(np.abs(velocity - plainly))) / speed
    by_ties = sum(tie.effect for tie in ties if tie.told)
    difference = float(np.max(apart)) / speed
    allowed = max(LARGEST_ROUNDOFF, MULTIPLE_OF_RADIUS_CHANGE * round_off) + by_ties
    places = (states.place + states.displacement, states.place + displacement)
    measured = max(
        component_error(a, b)
        for ours, theirs in ((states.velocity, velocity), places)
        for a, b in zip(ours.ravel().tolist(), theirs.ravel().tolist(), strict=True)
    )
    row, body = np.unravel_index(int(np.argmax(apart)), apart.shape)
    said = (
        f"the velocities that {test.recorder} recorded and those of our code at the same step differ by"
        f" {share(difference)} of the"
        f" largest, most for body {body} at {number(states.steps[int(row)] * deck.dt)} s; by component"
        f" {number(measured)}, and epsilon is {number(test.epsilon)}"
    )
    if measured <= test.epsilon:
        rest, outcome = "", Outcome.PASS
    elif difference <= allowed:
        why = "the rounding at a tie" if by_ties else "round-off"
        rest, outcome = f"; {why} explains it, and epsilon holds for one rounding only", Outcome.PASS
    else:
        rest, outcome = "; round-off does not explain it", Outcome.FAIL
    return RecordedAnswer(
        outcome=outcome, sentence=f"{said}{rest}.", difference=difference, allowed=allowed, by_component=measured
    )


def in_segments(scene: Scene, dt: float, ends: Sequence[int], radius: float | None) -> tuple[Floats, Floats]:
    """Return velocities and displacements of our code after so many steps of ``dt`` s, ``(n_state, n_body)`` each.

    LAMMPS evaluates forces again where a run begins, with the velocity of that step and not of the half step before.
    Forces that depend on velocities then differ a little, so that such a run begins anew after each state here, too.
    ``radius``: of the bodies, m; None: our code keeps overlaps.
    """
    anew = (scene.damped or scene.drag > 0.0) and not scene.drive and not scene.precompression
    velocity, displacement = list[Floats](), list[Floats]()
    part, before, moved = scene, 0, np.zeros(scene.n_body)
    for end in ends:
        if anew and before:
            part = _continued(scene, velocity[-1], moved)
        run = twin_run(replace(part, duration=dt * (end - before if anew else end), samples=1), dt, radius)
        moved = run.displacement[-1] + (moved if anew else 0.0)
        velocity.append(run.velocity[-1])
        displacement.append(moved)
        before = end
    return np.array(velocity), np.array(displacement)


def _continued(scene: Scene, velocity: Floats, moved: Floats) -> Scene:
    """Return the scene from a state on: its velocities, and gaps with these displacements, m."""
    c, place = scene.contacts, np.append(moved, 0.0)
    return with_wider_gaps(replace(scene, velocity=tuple(velocity.tolist())), place[c.right] - place[c.left])


def _not_judged(why: str) -> RecordedAnswer:
    return RecordedAnswer(outcome=Outcome.NOT_RUN, sentence=f"the recorded states were not judged: {why.rstrip('.')}.")
