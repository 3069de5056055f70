"""Uncertainties of measures: for linear ones they are known in closed form."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dem_bridge.errors import UsageError
from dem_bridge.observables.verdict import Outcome
from dem_bridge.report.study import ClaimValue
from dem_bridge.scene.scene import Scene
from dem_bridge.studies.paper.measures import MOVES, Measure, inside, measured
from dem_bridge.trajectory.trajectory import Trajectory
from tests.helpers.fake_runs import free_flight, uncertain

CHAIN = Scene(name="three", duration=1.0, mass=(1.0,) * 3, stiffness=(1e9,) * 2, velocity=(1.0, 0.0, 0.0))
RUN = free_flight()
EVERY_PART = ("crossing_time", "peak_force", "velocity")
numbers = st.floats(-1e3, 1e3)
sizes = st.floats(0.0, 1e3)


def _with(**uncertainties: object) -> Trajectory:
    return replace(RUN, uncertainty=uncertain(**uncertainties))


@given(w=st.tuples(numbers, numbers, numbers, numbers), b=st.tuples(sizes, sizes, sizes, sizes))
def test_bars_of_linear_measures_are_exact(w: tuple[float, ...], b: tuple[float, ...]) -> None:
    def of(scene: Scene, run: Trajectory) -> float:
        return float(np.dot(w[:2], run.crossing_time) + np.dot(w[2:], run.peak_force))

    run = _with(crossing_time=np.array(b[:2]), peak_force=np.array(b[2:]))
    found = measured(Measure(name="sum", of=of, made_of=EVERY_PART[:2]), CHAIN, run, "reference")
    wanted = float(np.abs(w) @ b)
    # each of four moves is a difference of sums of up to 6e4 + 1e6
    size = float(np.abs(w) @ (*(np.abs(RUN.crossing_time) + b[:2]), *(RUN.peak_force + b[2:])))
    assert found.uncertainty == pytest.approx(wanted, rel=1e-12, abs=16.0 * np.finfo(float).eps * size)


@given(uncertainty=st.floats(1e-6, 1.0), body=st.integers(0, 2))
def test_one_velocity_moves_by_its_bar_and_a_mean_by_no_more(uncertainty: float, body: int) -> None:
    one = Measure(name="one", of=lambda s, r: float(r.velocity[2, body]), made_of=("velocity",))
    mean = Measure(name="mean", of=lambda s, r: float(np.mean(r.velocity)), made_of=("velocity",))
    # v + uncertainty - v, with v up to 3
    assert measured(one, CHAIN, _with(velocity=uncertainty), "reference").uncertainty == pytest.approx(
        uncertainty, abs=2e-15
    )
    assert 0.0 < measured(mean, CHAIN, _with(velocity=uncertainty), "reference").uncertainty <= uncertainty + 2e-15


def test_velocities_move_more_than_once_and_the_same_each_time() -> None:
    seen: list[float] = []

    def of(scene: Scene, run: Trajectory) -> float:
        seen.append(float(np.sum(run.velocity[1:] * np.arange(12.0).reshape(4, 3))))
        return seen[-1]

    run = _with(velocity=0.1)
    first, again = (measured(Measure(name="", of=of, made_of=("velocity",)), CHAIN, run, "ode45") for _ in range(2))
    assert first == again
    assert len(set(seen)) == 1 + MOVES


def test_only_what_a_measure_is_made_of_has_a_part_in_its_bar() -> None:
    run = _with(crossing_time=1.0, peak_force=10.0, velocity=100.0)

    def of(scene: Scene, run: Trajectory) -> float:
        return float(run.crossing_time[0] + run.peak_force[0] + run.velocity[0, 0])

    alone = {part: measured(Measure(name="", of=of, made_of=(part,)), CHAIN, run, "x") for part in EVERY_PART}
    assert {part: found.uncertainty for part, found in alone.items()} == pytest.approx(
        {"crossing_time": 1.0, "peak_force": 10.0, "velocity": 100.0}
    )
    together = measured(Measure(name="", of=of, made_of=EVERY_PART), CHAIN, run, "x")
    assert together.uncertainty == pytest.approx(111.0)
    assert measured(Measure(name="", of=of, made_of=()), CHAIN, run, "x").uncertainty == 0.0


def test_a_measure_that_knows_its_bar_gives_it_and_theories_have_none() -> None:
    own = Measure(name="speed", of=lambda s, r: 2.0, uncertainty=lambda s, r: 0.25, unit="m/s")
    wanted = ClaimValue(name="speed", backend="lammps", value=2.0, uncertainty=0.25, unit="m/s")
    assert measured(own, CHAIN, RUN, "lammps") == wanted
    for theory in ("bca", "adiabatic"):
        assert math.isnan(measured(own, CHAIN, RUN, theory).uncertainty)


def test_what_a_run_cannot_say_is_no_number_and_no_exception() -> None:
    def refused(scene: Scene, run: Trajectory) -> float:
        raise UsageError("too few contacts were reached")

    found = measured(Measure(name="", of=refused), CHAIN, RUN, "reference")
    assert math.isnan(found.value)
    assert math.isnan(found.uncertainty)


def test_contacts_that_were_never_reached_do_not_move() -> None:
    run = replace(_with(crossing_time=np.array([0.5, np.inf])), crossing_time=np.array([0.1, np.nan]))
    first = Measure(name="", of=lambda s, r: float(r.crossing_time[0]))
    assert measured(first, CHAIN, run, "reference").uncertainty == 0.5


@pytest.mark.parametrize("part", EVERY_PART)
def test_where_nothing_can_be_said_of_the_errors_the_bar_is_infinite(part: str) -> None:
    measure = Measure(name="", of=lambda s, r: float(getattr(r, part).flat[0]), made_of=(part,))
    assert measured(measure, CHAIN, _with(**{part: np.inf}), "ode45").uncertainty == math.inf


@pytest.mark.parametrize("made_of", [("crossing_time",), ("velocity",)])
@pytest.mark.parametrize("answer", ["raises", "nan"])
def test_bars_that_carry_a_run_to_where_nothing_is_measured_are_infinite(made_of: tuple[str], answer: str) -> None:
    def of(scene: Scene, run: Trajectory) -> float:
        if run.crossing_time[0] == RUN.crossing_time[0] and run.velocity[0, 0] == RUN.velocity[0, 0]:
            return 1.0
        if answer == "raises":
            raise UsageError("the pulse never came")
        return math.nan

    found = measured(Measure(name="", of=of, made_of=made_of), CHAIN, _with(crossing_time=0.1, velocity=0.1), "x")
    assert (found.value, found.uncertainty) == (1.0, math.inf)


INF, NAN = math.inf, math.nan


@pytest.mark.parametrize(
    ("value", "uncertainty", "low", "high", "outcome"),
    [
        (0.4, 0.1, 0.3, 0.5, "PASS"),  # both edges are inside
        (0.25, 0.0, 0.25, 0.25, "PASS"),
        (0.5, 0.125, 0.25, 0.5, "UNDECIDED"),
        (0.5, 0.125, 0.75, 1.0, "FAIL"),
        (0.5, 0.25, 0.75, 1.0, "UNDECIDED"),  # touches
        (0.5, 0.25, 0.0, 0.25, "UNDECIDED"),
        (0.5, 0.125, 0.0, 0.25, "FAIL"),
        (0.4, NAN, 0.3, 0.5, "PASS"),  # of a formula
        (0.4, NAN, 0.5, 0.6, "FAIL"),
        (0.4, INF, 0.3, 0.5, "UNDECIDED"),  # nothing is known
        (0.4, INF, -INF, 0.5, "UNDECIDED"),
        (0.4, INF, 0.5, INF, "UNDECIDED"),
        (0.4, 0.1, -INF, 0.5, "PASS"),
        (0.4, 0.1, 0.3, INF, "PASS"),
        (NAN, 0.1, -INF, INF, "UNDECIDED"),
        (INF, 0.1, 0.0, INF, "UNDECIDED"),
    ],
)
def test_inside_and_its_edges(value: float, uncertainty: float, low: float, high: float, outcome: str) -> None:
    found = ClaimValue(name="", backend="reference", value=value, uncertainty=uncertainty)
    # 0.4 - 0.1 is 0.30000000000000004, and 0.4 + 0.1 is 0.5
    assert inside(found, low, high) == Outcome(outcome)


@given(value=numbers, uncertainty=sizes, low=numbers, high=numbers)
def test_a_wider_bar_never_turns_one_decision_into_the_other(
    value: float, uncertainty: float, low: float, high: float
) -> None:
    def outcome(uncertainty: float) -> Outcome:
        return inside(ClaimValue(name="", backend="reference", value=value, uncertainty=uncertainty), low, high)

    assert {outcome(0.0), outcome(uncertainty)} != {Outcome.PASS, Outcome.FAIL}
    assert outcome(0.0) == (Outcome.PASS if low <= value <= high else Outcome.FAIL)
