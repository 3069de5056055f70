"""The reference: Taylor series against quadruple-precision truth, and against scipy where there is none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import dem_bridge as db
from dem_bridge.backends.reference import Reference
from dem_bridge.observables.conserved import energy
from dem_bridge.scene.scene import Scene, Wall
from tests.helpers.quadruple_truth import Truth
from tests.helpers.strategies import examples, scenes

EPS = float(np.finfo(float).eps)
QUANTITIES = ("velocity", "displacement", "peak_force", "crossing_time")


@pytest.mark.parametrize("chain", ["decelerating", "accelerating", "two_bodies"])
def test_every_sample_of_the_free_chains_is_that_of_the_truth(chain: str, request: pytest.FixtureRequest) -> None:
    truth: Truth = request.getfixturevalue(chain)
    run = db.solve(truth.scene, backend="reference", uncertainty=False)
    # one part in 1e16 of the inputs moves v by 1e-14 v0 and x by 4e-16: some hundred steps leave ten times that
    assert truth.error(run, "velocity") < 1e-12 * truth.v0
    assert truth.error(run, "displacement") < 1e-13 * float(np.max(np.abs(truth.data["x"])))
    assert np.all(truth.error(run, "peak_force") < 1e-12 * truth.data["F_peak"])
    assert np.all(truth.error(run, "crossing_time") < 1e-12 * truth.data["t_cross"])


def test_the_ill_conditioned_wall_is_that_of_the_truth(walled: Truth) -> None:
    run = db.solve(walled.scene, backend="reference", uncertainty=False)
    assert walled.error(run, "velocity") < 1e-10 * walled.v0
    assert walled.error(run, "displacement") < 1e-12 * float(np.max(np.abs(walled.data["x"])))
    assert run.provenance["openings"] + run.provenance["closings"] == len(walled.data["events"]) + 1  # the first touch


#: of v0, of the largest displacement, of each peak force and crossing time: as above, the two last for the wall too
BOUNDS = {
    "decelerating": (1e-12, 1e-13, 1e-12, 1e-12),
    "accelerating": (1e-12, 1e-13, 1e-12, 1e-12),
    "two_bodies": (1e-12, 1e-13, 1e-12, 1e-12),
    "walled": (1e-10, 1e-12, 1e-12, 1e-12),
}


@pytest.mark.parametrize("speed", [1e-9, 1e3])
@pytest.mark.parametrize("chain", BOUNDS)
def test_at_any_speed_it_is_the_scaled_truth(chain: str, speed: float, request: pytest.FixtureRequest) -> None:
    truth: Truth = request.getfixturevalue(chain)
    scene, data = truth.scene, truth.data
    s = speed / truth.v0
    scaled = replace(scene, velocity=(speed, *scene.velocity[1:]), duration=s**-0.2 * scene.duration)
    run = db.solve(scaled, backend="reference", uncertainty=False)
    # The scene has no scale, so the rounding of s, s v0 and s^(-1/5) T is itself a scaling, which the ill-conditioning
    # of the wall does not touch: two roundings shift the times by 2 ulp at most, and nothing else
    late = 2.0 * EPS * scene.duration
    fastest, strongest = float(np.max(np.abs(data["v"]))), float(np.max(data["F_peak"])) / float(np.min(data["m"]))
    of_v, of_x, of_force, of_time = BOUNDS[chain]
    largest = float(np.max(np.abs(data["x"])))
    assert np.max(np.abs(run.velocity[1:] / s - data["v"])) < of_v * truth.v0 + late * strongest
    assert np.max(np.abs(run.displacement[1:] / s**0.8 - data["x"])) < of_x * largest + late * fastest
    assert np.all(np.abs(run.peak_force / s**1.2 - data["F_peak"]) < of_force * data["F_peak"])
    assert np.all(np.abs(run.crossing_time * s**0.2 - data["t_cross"]) < of_time * data["t_cross"])


@pytest.mark.parametrize("chain", ["decelerating", "accelerating", "walled", "two_bodies"])
def test_its_bars_hold_against_the_truth(chain: str, request: pytest.FixtureRequest) -> None:
    truth: Truth = request.getfixturevalue(chain)
    run = db.solve(truth.scene, backend="reference")
    for quantity in QUANTITIES:
        assert np.all(truth.error(run, quantity) <= run.uncertainty[quantity]), quantity


@pytest.mark.slow
@examples(20)
@given(scene=scenes(bodies=(1, 6), exponents=st.just(2.5), walls=True, gravity=True, samples=50))
def test_it_agrees_with_scipy_within_their_bars_on_random_scenes(scene: Scene) -> None:
    mine, other = db.solve(scene, backend="reference"), db.solve(scene, backend="scipy")
    for quantity in ("velocity", "displacement"):
        apart = float(np.max(np.abs(getattr(mine, quantity) - getattr(other, quantity))))
        assert apart <= mine.uncertainty[quantity] + other.uncertainty[quantity], quantity
    drift = energy(scene, mine)
    assert float(np.max(np.abs(drift - drift[0]))) <= 1e-11 * float(np.max(np.abs(drift))) + 1e-30


SPECIAL = {
    "a stack that rests on the floor": {
        "mass": (0.01,) * 5, "stiffness": (4e9,) * 4, "velocity": (0.0,) * 5, "gravity": 9.81,
        "wall_right": Wall(stiffness=4e9), "duration": 1e-2,
    },
    "thrown up in touch with the floor": {
        "mass": (0.01, 0.02, 0.01), "stiffness": (4e9,) * 2, "velocity": (-0.1, -0.3, 0.0), "gravity": 9.81,
        "wall_right": Wall(stiffness=4e9), "duration": 0.1,
    },
    "two strikers at the same moment": {
        "mass": (0.01,) * 5, "stiffness": (4e9,) * 4, "velocity": (1.0, 0.0, 0.0, 0.0, -1.0), "duration": 1e-3,
    },
    "the same with gaps": {
        "mass": (0.01,) * 6, "stiffness": (4e9,) * 5, "velocity": (1.0, 0.0, 0.0, 0.0, 0.0, -1.0), "gap": 1e-6,
        "duration": 1e-3,
    },
    "n = 2, 2.5, 3, 4 side by side": {
        "mass": (0.01,) * 5, "stiffness": (4e6, 4e9, 1e12, 1e17), "velocity": (1.0, 0.0, 0.0, 0.0, 0.0),
        "exponent": (2.0, 2.5, 3.0, 4.0), "duration": 1e-3,
    },
    "a body a million times lighter": {
        "mass": (1.0, 1e-4, 1.0), "stiffness": (4e9,) * 2, "velocity": (1.0, 0.0, 0.0), "duration": 1e-4,
    },
    # 1.5e-11 m/s off, and a bar of 5e-13, where a force that others do not feel is nothing to the lightest body
    "a push that grows from next to nothing finds a body a million times lighter": {
        "mass": (0.048, 0.071, 0.067, 0.012, 8.9e-9, 0.0089), "stiffness": (3.9e8, 2.6e10, 4.8e9, 5.7e9, 3.2e10),
        "velocity": (64.0, 0.0, 0.0, 0.0, 0.0, 0.0), "duration": 1.4e-5,
    },
}  # fmt: skip


@pytest.mark.parametrize("name", SPECIAL)
def test_it_agrees_with_scipy_where_events_coincide(name: str) -> None:
    scene = Scene(name="special", samples=50, **SPECIAL[name])  # type: ignore[arg-type]
    mine, other = db.solve(scene, backend="reference"), db.solve(scene, backend="scipy")
    for quantity in QUANTITIES:
        apart = np.abs(getattr(mine, quantity) - getattr(other, quantity))
        assert np.all(np.isnan(mine.crossing_time) == np.isnan(other.crossing_time))
        bars = mine.uncertainty[quantity] + other.uncertainty[quantity]
        assert np.all(np.nan_to_num(apart) <= bars), quantity


def test_an_exponent_without_a_series_is_answered_by_scipy_and_says_so() -> None:
    scene = Scene(
        name="odd", duration=1e-4, mass=(0.01, 0.01), stiffness=(4e9,), velocity=(1.0, 0.0), exponent=2.4, samples=5
    )
    assert db.solve(scene, backend="reference", uncertainty=False).provenance["answered_by"] == "scipy"


def test_a_quiet_chain_costs_nothing() -> None:
    """Steps to cross the first 20 contacts do not depend on how many cylinders rest behind them."""

    def steps(bodies: int) -> int:
        scene = Scene(
            name="long", duration=3e-4, mass=(0.01,) * bodies, stiffness=(4e9,) * (bodies - 1),
            velocity=(1.0, *[0.0] * (bodies - 1)), samples=5,
        )  # fmt: skip
        return db.solve(scene, backend="reference", uncertainty=False).cost.steps

    assert steps(40) == pytest.approx(steps(400), rel=0.02)


def test_it_has_no_limits_to_refuse() -> None:
    assert Reference().availability().available


#: heavy strikers on light bodies: a shallow first maximum, and a minimum shortly after it
DOUBLE_TURNS = {
    "three bodies": {"mass": (0.0618, 0.0026, 0.0039), "stiffness": (1.5e9, 3.07e9), "velocity": (1.0, 0.0, 0.0)},
    "another three": {"mass": (0.0455, 0.0018, 0.0044), "stiffness": (5.62e9, 1.02e10), "velocity": (1.0, 0.0, 0.0)},
    "four bodies": {
        "mass": (0.025819322451222374, 0.0031264087574076936, 0.006710992655526428, 0.006112308777281643),
        "stiffness": (1763900508.2985415, 4236774214.3869305, 2709476826.516224),
        "velocity": (0.7840299973379409, 0.0, 0.0, 0.0), "gap": (0.0, 0.0, 1e-06), "gravity": 9.81,
    },
}  # fmt: skip


@pytest.mark.parametrize("name", DOUBLE_TURNS)
def test_a_maximum_closely_followed_by_a_minimum_is_still_the_first_maximum(name: str) -> None:
    scene = Scene(name="double", duration=3e-4, samples=50, **DOUBLE_TURNS[name])  # type: ignore[arg-type]
    mine, twin = db.solve(scene, backend="reference"), db.solve(scene, backend="verlet", dt=1e-8)
    # the twin's bars are 1e-10 s, a millionth of what is missed
    assert np.all(np.abs(mine.crossing_time - twin.crossing_time) <= twin.uncertainty["crossing_time"])
