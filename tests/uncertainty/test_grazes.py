"""Grazes and compressions that all runs at fixed steps miss alike: nothing may be said of them then."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

import dem_bridge as db
from dem_bridge.backends.base import Resolution, Sampling
from dem_bridge.backends.steps import Dense
from dem_bridge.dense import Approaches, Schedule
from dem_bridge.scene import Scene, Wall
from dem_bridge.uncertainty.fixed_step import fixed_step_uncertainty
from dem_bridge.uncertainty.grazes import unresolved_contacts
from dem_bridge.uncertainty.twins import twin_family
from tests.helpers.fake_runs import free_flight

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
    none = Approaches(contact=np.zeros(0, dtype=np.int64), time=np.zeros(0), overlap=np.zeros(0), bend=np.zeros(0))
    blind = replace(family, readings=replace(family.readings, turns=none))
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
    assert np.all(np.isfinite(run.uncertainty["crossing_time"][:6]))


@pytest.mark.parametrize(
    ("overlap", "rate", "gap", "unresolved"),
    [(1e-3, -1.0, 0.0, True), (1e-3, 1.0, 0.0, False), (1e-19, -1.0, 0.0, False), (1e-3, -1.0, -1e-3, False)],
    ids=["closed and parting", "still closing", "in flight, in touch", "compressed at the start"],
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
