"""Grazes and compressions that all runs at fixed steps miss alike: nothing may be said of them then."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

import dem_bridge as db
from dem_bridge.backends.base import Resolution, Sampling
from dem_bridge.backends.steps import Dense
from dem_bridge.runs.uncertainty.fixed_step import fixed_step_uncertainty
from dem_bridge.runs.uncertainty.from_twins import twin_family
from dem_bridge.runs.uncertainty.grazes import Doubt, unresolved_contacts, widen_for_moments
from dem_bridge.scene.scene import Scene, Wall
from dem_bridge.trajectory.dense import Schedule
from tests.helpers.fake_runs import free_flight
from tests.helpers.twin_families import moment

G, UP = -1e3, 0.75
HEIGHT = UP**2 / (2.0 * -G)


def thrown_up(share: float) -> Scene:
    """A ball that turns beyond a ceiling by this share of its way, or before it."""
    return Scene(
        name="ball",
        duration=1.5 * UP / -G,
        mass=(1e-2,),
        stiffness=(),
        velocity=(UP,),
        wall_right=Wall(stiffness=4.7e9, gap=HEIGHT * (1.0 - share)),
        gravity=G,
        samples=20,
    )


@pytest.mark.parametrize("backend", ["verlet", "ase"])
def test_of_a_graze_between_two_steps_nothing_is_said(backend: str) -> None:
    scene = thrown_up(1e-12)
    run, truth = (db.solve(scene, backend=name, dt=4e-7) for name in (backend, "reference"))
    assert np.isnan(run.crossing_time[0])
    assert np.isfinite(truth.crossing_time[0])
    assert math.isinf(run.uncertainty["crossing_time"][0])
    assert run.uncertainty["peak_force"][0] >= truth.peak_force[0] > 0.0
    assert run.uncertainty["velocity"] < 1e-10 * UP


@pytest.mark.parametrize("share", [1e-3, -1e-3])
def test_what_clearly_touches_or_clearly_does_not_keeps_its_bars(share: float) -> None:
    run = db.solve(thrown_up(share), backend="verlet", dt=4e-7)
    assert np.isnan(run.crossing_time[0]) == (share < 0.0)
    assert np.isfinite(run.uncertainty["crossing_time"][0])
    assert run.uncertainty["peak_force"][0] <= 1e-4 * run.peak_force[0]


def test_without_the_look_for_misses_the_bar_would_be_wrong_in_silence() -> None:
    scene = thrown_up(1e-12)
    family = twin_family(scene, Resolution(dt=4e-7), Sampling(count=scene.samples))
    assert family is not None
    blind = replace(family, readings=replace(family.readings, moments=None))
    assert np.isfinite(fixed_step_uncertainty(blind)["crossing_time"][0])
    assert math.isinf(fixed_step_uncertainty(family)["crossing_time"][0])


def test_below_n_2_the_first_motions_ahead_of_a_front_are_too_brief_for_any_step() -> None:
    scene = Scene(
        name="soft", duration=2.9e-4, mass=(1e-2,) * 10, stiffness=(4.7e4,) * 9, exponent=1.5,
        velocity=(0.75, *[0.0] * 9), samples=20,
    )  # fmt: skip
    run, truth = db.solve(scene, backend="verlet", dt=2.9e-7), db.solve(scene, backend="scipy")
    error = np.abs(run.crossing_time - truth.crossing_time)
    allowed = run.uncertainty["crossing_time"] + truth.uncertainty["crossing_time"]
    assert np.any(error > 0.1 * scene.duration), "no contact is seen to turn ahead of the front?"
    assert np.all(error <= allowed)
    # where the front has been they are known
    # (the sixth has a closing rate that falls to 7e-7 m/s on the way, and is uncertain by twice that)
    assert np.all(np.isfinite(run.uncertainty["crossing_time"][:5]))


@pytest.mark.parametrize(
    ("overlap", "rate", "gap", "unresolved"),
    [
        (1e-3, -1.0, 0.0, True),
        (1e-3, 1.0, 0.0, False),
        (1e-19, -1.0, 0.0, False),
        (1e-3, -1.0, -1e-3, False),
        (1e-3, 0.0, 1e-3, True),
    ],
    ids=["closed and parting", "still closing", "in flight, in touch", "compressed at the start", "at its maximum"],
)
def test_a_contact_that_parts_without_a_maximum_of_its_compression_is_unresolved(
    overlap: float, rate: float, gap: float, unresolved: bool
) -> None:
    scene = Scene(name="pair", duration=2.0, mass=(1.0, 1.0), stiffness=(1.0,), velocity=(1.0, 0.0), gap=gap, samples=2)
    plan = Schedule(step=1.0, per_sample=1, subdivisions=1, samples=2)
    velocity = np.array([[1.0, 0.0, 0.0], [1.0, 1.0 - rate, 0.0], [0.0, 1.0, 0.0]])
    still, overlaps = np.zeros((3, 3)), np.array([[-1.0], [overlap], [-1.0]])
    moved = still + np.array([0.0, 1.0, 0.0])
    dense = Dense(velocity, moved, still, overlaps, np.zeros((3, 1)))
    run = free_flight(bodies=2, contacts=1, crossing_time=[math.nan])
    assert unresolved_contacts(scene, plan, dense, run).tolist() == [unresolved]
    crossed = replace(run, crossing_time=np.array([0.5]))
    assert unresolved_contacts(scene, plan, dense, crossed).tolist() == [False]


@pytest.mark.parametrize(
    ("crossing", "exponent", "slope"),
    [
        # (n - 1) beta overlap^(n - 2) at the larger of the overlaps 1e-4 m and 4e-4 m on both sides of the crossing
        (0.4, 1.5, 50.0), (1.0, 1.5, 50.0), (0.0, 1.5, 50.0), (1.4, 1.5, 25.0), (2.0, 1.5, 25.0), (7.0, 1.5, 25.0),
        (0.4, 1.75, 7.5), (0.4, 2.0, 0.0), (0.4, 2.5, 0.0),
    ],
)  # fmt: skip
def test_below_n_2_a_crossing_is_resolved_where_its_contact_is_soft_enough_for_the_step(
    crossing: float, exponent: float, slope: float
) -> None:
    beta = 1.0 if exponent < 2.0 else 1e9
    scene = Scene(
        name="pair", duration=2.0, mass=(1.0, 2.0), stiffness=(beta,), velocity=(1.0, 0.0), exponent=exponent, samples=2
    )
    overlaps, still = np.array([[-1.0], [1e-4], [4e-4]]), np.zeros((3, 3))
    for factor, unresolved in ((0.999, False), (1.001, True)):
        # (step omega)^2 = 0.1^2, with 1/1 + 1/2 per kg
        step = factor * 0.1 / math.sqrt(1.5 * slope) if slope else 1.0
        plan = Schedule(step=step, per_sample=1, subdivisions=1, samples=2)
        run = free_flight(bodies=2, contacts=1, crossing_time=[crossing * step])
        dense = Dense(still, still, still, overlaps, np.zeros((3, 1)))
        assert unresolved_contacts(scene, plan, dense, run).tolist() == [unresolved and slope > 0.0]


@pytest.mark.parametrize(
    ("time", "known"), [(0.0999, False), (0.1, False), (0.1001, True)], ids=["before", "at", "after"]
)
def test_a_crossing_is_known_if_it_is_before_the_turn(time: float, known: bool) -> None:
    scene = Scene(
        name="three", duration=1.0, mass=(2.0, 4.0, 8.0), stiffness=(100.0, 100.0), exponent=2.0,
        velocity=(1.0, 2.0, 3.0),
    )  # fmt: skip
    turn = moment(0, time, overlap=-1e-3, bend=1.0)
    none = {"velocity": 0.0, "displacement": 0.0, "peak_force": 0.0, "crossing_time": 0.0}
    doubt = Doubt(np.array([2e-3]), np.zeros(1))
    found = widen_for_moments(none, scene, free_flight(), turn, doubt)
    assert found["crossing_time"].tolist() == [0.0 if known else math.inf, 0.0]
    # 1 mm deep at 100 N/m; a bend of 1 m/s^2 holds it for sqrt(8e-3) s
    assert found["peak_force"] == pytest.approx([0.1, 0.0], rel=1e-9)
    assert found["velocity"] == pytest.approx(0.1 * math.sqrt(8e-3) / 2.0, rel=1e-9)
