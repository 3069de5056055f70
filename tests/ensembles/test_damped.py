"""Damped chains in lanes against closed forms, against scipy on random chains, and against what must be conserved."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

import dem_bridge as db
from dem_bridge.ensembles import solve
from dem_bridge.ensembles.damped import march_damped
from dem_bridge.ensembles.draw import Variation
from dem_bridge.ensembles.pair import contact_force, pair_defect
from dem_bridge.ensembles.solve import OBSERVABLES, difference, solve_chains, steps_for
from dem_bridge.observables.registry import observable_named
from dem_bridge.scene.damping import Damping
from dem_bridge.scene.scene import Scene, Wall
from tests.helpers.strategies import examples

FIVE = Scene(
    name="five", duration=2e-4, mass=(0.01, 0.02, 0.015, 0.01, 0.03), stiffness=(2e10, 1e10, 3e10, 2e10),
    gap=(0.0, 1e-6, 0.0, 1e-6), velocity=(0.8, 0.0, 0.0, 0.0, 0.0),
)  # fmt: skip
#: a coefficient of each law that takes some ten per cent of the energy of an impact
LAWS = {"dashpot": 20.0, "mass_velocity": 4e3, "kuwabara-kono": 3e-6, "coeff_restitution": 0.8, "tsuji": 0.8}
DAMPINGS = [
    pytest.param(Damping(law=law, coefficient=value, clip=clip), id=f"{law}{'' if clip else ', not clipped'}")
    for law, value in LAWS.items()
    for clip in (True, False)
]
#: more than one group of lanes
COUNT = 9


def _assert_as_by_scipy(scene: Scene, accuracy: float) -> None:
    """Assert that chains have the accuracy that their number of steps was chosen for."""
    chains = Variation(scene=scene, vary={"mass": 0.05, "stiffness": 0.05}, seed=2).block(0, COUNT)
    values = solve_chains(scene, chains, steps_for(scene, chains, accuracy))
    for nth in (0, COUNT - 1):
        one = chains.scene(scene, nth)
        exact = db.solve(one, backend="scipy", uncertainty=False, samples=2000)
        for name in OBSERVABLES:
            read = np.atleast_1d(observable_named(name).value(one, exact))
            assert difference(values[name][nth : nth + 1], read[None])[0] <= accuracy, (name, nth)


@examples(30)
@given(
    seed=st.integers(0, 2**32 - 1),
    law=st.sampled_from([*LAWS, "drag"]),
    clip=st.booleans(),
    bodies=st.integers(2, 6),
    exponent=st.sampled_from([2.5, 2.5, 2.0, 3.0]),
    around=st.sampled_from(["free", "walls", "gravity", "drag"]),
)
def test_random_damped_chains_have_the_accuracy_that_is_asked_for(
    seed: int, law: str, clip: bool, bodies: int, exponent: float, around: str
) -> None:
    random = np.random.default_rng(seed)
    stiffness = random.uniform(0.5, 2.0, bodies - 1) * 2e10 * 5e-6 ** (2.5 - exponent)
    wall = Wall(stiffness=2e10 * 5e-6 ** (2.5 - exponent), gap=1e-6, exponent=exponent)
    surroundings: dict[str, dict[str, Any]] = {
        "free": {}, "walls": {"wall_right": wall}, "gravity": {"gravity": 9.81}, "drag": {"drag": 500.0},
    }  # fmt: skip
    more = surroundings[around]
    if law == "drag":
        more |= {"drag": 2e3}
    else:
        # a coefficient of restitution has no other scale, and the others are within a factor of two
        part = 1.0 if LAWS[law] < 1.0 and LAWS[law] > 0.1 else random.uniform(0.5, 1.5)
        more |= {"damping": Damping(law=law, coefficient=part * LAWS[law], clip=clip)}
    scene = Scene(
        name="random", duration=1.5e-4, mass=tuple(random.uniform(0.005, 0.03, bodies)), stiffness=tuple(stiffness),
        exponent=exponent, gap=tuple(random.choice([0.0, 1e-6, 3e-6], bodies - 1)),
        velocity=(0.8, *[0.0] * (bodies - 1)), **more,
    )  # fmt: skip
    _assert_as_by_scipy(scene, 1e-4)


@pytest.mark.parametrize("damping", DAMPINGS)
def test_every_law_has_an_accuracy_of_one_in_a_million(damping: Damping) -> None:
    _assert_as_by_scipy(replace(FIVE, damping=damping), 2e-6)


def test_damping_and_drag_act_together() -> None:
    _assert_as_by_scipy(replace(FIVE, damping=Damping(law="dashpot", coefficient=20.0), drag=2e3), 1e-5)


@pytest.mark.parametrize("clip", [True, False])
def test_a_damped_spring_is_left_as_in_the_closed_form(clip: bool) -> None:
    mass, stiffness, damping, speed = 0.01, 2e6, 20.0, 0.8
    scene = Scene(
        name="spring", duration=8e-4, mass=(mass, mass), stiffness=(stiffness,), exponent=2.0, velocity=(speed, 0.0),
        damping=Damping(law="dashpot", coefficient=damping, clip=clip),
    )  # fmt: skip
    values = solve_chains(scene, Variation(scene=scene, vary={"gap": 0.0}).block(0, 2), 800, 2)
    # overlap = speed/w exp(-d t) sin(w t) of the reduced mass
    decay = damping / mass
    w = math.sqrt(2.0 * stiffness / mass - decay**2)

    def rate(time: float) -> float:
        return speed * math.exp(-decay * time) * (math.cos(w * time) - decay / w * math.sin(w * time))

    turn = math.atan2(w, decay) / w
    np.testing.assert_allclose(values["crossing_time"][:, 0], turn, rtol=1e-7)
    # the force k s + c s' is zero where tan(w t) = w c / (c d - k)
    end = (math.pi - math.atan(w * damping / (stiffness - damping * decay))) / w if clip else math.pi / w
    velocity = values["velocity"][:, -1]
    np.testing.assert_allclose(velocity[:, 1] - velocity[:, 0], -rate(end), rtol=1e-6)
    # the largest force lies where its rate k s' + c s'' is zero, before the turn
    times = np.linspace(0.0, turn, 100_001)
    overlap = speed / w * np.exp(-decay * times) * np.sin(w * times)
    force = stiffness * overlap + damping * np.array([rate(time) for time in times.tolist()])
    np.testing.assert_allclose(values["peak_force"][:, 0], np.max(force), rtol=1e-6)


def test_drag_slows_down_a_free_body_exponentially() -> None:
    scene = Scene(name="drag", duration=2e-3, mass=(0.01, 0.02), stiffness=(4e9,), velocity=(0.0, 0.5), drag=400.0)
    expected = 0.5 * np.exp(-400.0 * np.linspace(0.0, 2e-3, 5))
    for damping in (None, Damping(law="dashpot", coefficient=1.0)):
        damped = replace(scene, damping=damping)
        velocity = solve_chains(damped, Variation(scene=damped, vary={"mass": 0.1}).block(0, 9), 80, 4)["velocity"]
        np.testing.assert_allclose(velocity[:, :, 1], np.tile(expected, (9, 1)), rtol=1e-8)
        assert np.all(velocity[:, :, 0] == 0.0)


@pytest.mark.parametrize("damping", DAMPINGS)
def test_damping_keeps_the_momentum_and_takes_energy(damping: Damping) -> None:
    scene = replace(FIVE, damping=damping)
    chains = Variation(scene=scene, vary={"mass": 0.05}).block(0, 8)
    velocity = solve_chains(scene, chains, 1000, 50)["velocity"]
    carried = chains.mass[:, None, :] * velocity
    assert np.ptp(carried.sum(axis=2), axis=1) == pytest.approx(0.0, abs=1e-14)
    elastic = solve_chains(FIVE, chains, 1000, 50)["velocity"]
    left, kept = (0.5 * np.sum(chains.mass * v[:, -1] ** 2, axis=1) for v in (velocity, elastic))
    assert np.all(left < 0.97 * kept)


def test_without_damping_the_damped_kernel_has_the_elastic_motion() -> None:
    weak = replace(FIVE, damping=Damping(law="dashpot", coefficient=1e-12))
    chains = Variation(scene=FIVE, vary={"mass": 0.05}).block(0, COUNT)
    damped, elastic = solve_chains(weak, chains, 3000), solve_chains(FIVE, chains, 3000)
    for name in OBSERVABLES:
        assert np.max(difference(damped[name], elastic[name])) < 1e-7, name


def test_jumps_of_a_dashpot_are_corrected(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = replace(FIVE, damping=Damping(law="dashpot", coefficient=20.0, clip=False), gap=(1e-6, 2e-6, 1e-6, 3e-6))
    chains = Variation(scene=scene, vary={"mass": 0.05, "velocity": 0.05}).block(0, 16)

    def error() -> float:
        coarse, fine = (solve_chains(scene, chains, steps, 50)["velocity"] for steps in (400, 12_800))
        return float(np.sqrt(np.mean((coarse - fine) ** 2)))

    corrected = error()
    monkeypatch.setattr(solve, "SLOWEST_TOUCH", math.inf)
    assert error() > 100.0 * corrected


def test_a_damped_chain_does_not_depend_on_its_lane_or_on_its_neighbours() -> None:
    scene = replace(FIVE, damping=Damping(law="coeff_restitution", coefficient=0.8))
    chains = Variation(scene=scene, vary={"mass": 0.1, "stiffness": 0.1}, seed=7).block(0, 11)
    together = solve_chains(scene, chains, 500, 5)
    order = np.random.default_rng(0).permutation(11)
    mixed, alone = solve_chains(scene, chains.rows(order), 500, 5), solve_chains(scene, chains.rows(order[:1]), 500, 5)
    for name, values in together.items():
        np.testing.assert_array_equal(mixed[name], values[order], err_msg=name)
        np.testing.assert_array_equal(alone[name], values[order[:1]], err_msg=name)


@pytest.mark.parametrize("more", [{"drag": 300.0}, *({"damping": item.values[0]} for item in DAMPINGS)])
def test_the_observables_of_a_damped_run_that_ends_early_are_final(more: dict[str, Any]) -> None:
    scene = replace(FIVE, duration=2e-3, gap=0.0, **more)
    chains = Variation(scene=scene, vary={"mass": 0.1, "stiffness": 0.1}, seed=3).block(0, COUNT)
    early, whole = solve_chains(scene, chains, 4000), solve_chains(scene, chains, 4000, 2)
    for name in OBSERVABLES:
        np.testing.assert_array_equal(early[name], whole[name], err_msg=name)


@pytest.mark.parametrize("law", ["dashpot", "kuwabara-kono", "tsuji"])
@pytest.mark.parametrize("walls", [(), ("wall_left", "wall_right")])
def test_no_damped_step_reads_or_writes_beyond_its_arrays(
    walls: tuple[str, ...], law: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    sides: dict[str, Any] = dict.fromkeys(walls, Wall(stiffness=1e10, gap=1e-6, exponent=3.0 if walls else 2.5))
    scene = Scene(
        name="short", duration=8e-5, mass=(0.01, 0.02), stiffness=(2e10,), velocity=(0.8, 0.5), gap=(1e-6,), drag=10.0,
        damping=Damping(law=law, coefficient=LAWS[law]), **sides,
    )  # fmt: skip
    chains = Variation(scene=scene, vary={"mass": 0.05}).block(0, 2)
    compiled = solve_chains(scene, chains, 24, 4)
    monkeypatch.setattr(solve, "march_damped", march_damped.interpret)
    for name, values in solve_chains(scene, chains, 24, 4).items():
        np.testing.assert_allclose(compiled[name], values, rtol=1e-9, atol=1e-15)


def test_a_touch_with_linear_forces_of_others_is_that_of_an_integrator_with_events() -> None:
    mobility, step, overlap, closing, before, after = 150.0, 4e-7, -8e-8, 0.5, 2e3, 1e4
    contact = (2e10, 2.5, 0, 20.0, 0.0, 0, True)

    def acceleration(time: float) -> float:
        return before + (after - before) * time / step

    def motion(time: float, state: Any) -> list[float]:
        depth, rate = state
        return [rate, acceleration(time) - mobility * contact_force.py_func(depth > 0.0, depth, rate, contact)]

    exact = solve_ivp(motion, (0.0, step), [overlap, closing], rtol=1e-9, atol=1e-16, max_step=step / 4000).y[:, -1]
    impulse, moment, most, _ = pair_defect(
        overlap, closing, before, after, mobility, contact, step, 0.0, 0.0, (0.0, 0.0), 75.0, math.inf
    )
    s, r = overlap, closing
    stages: list[tuple[float, ...]] = []
    for part, back in ((0.0, 0.0), (0.5, 0.5), (0.5, 0.5), (1.0, 1.0)):
        depth = s + part * step * (stages[-1][0] if stages else 0.0)
        rate = r + back * step * (stages[-1][1] if stages else 0.0)
        stages.append(tuple(motion(part * step, (depth, rate))))
    weights = np.array([1.0, 2.0, 2.0, 1.0]) / 6.0
    numerical = np.array([s, r]) + step * weights @ np.array(stages)
    corrected = numerical - mobility * np.array([moment, impulse])
    assert abs(numerical[1] - exact[1]) > 1e-5 * closing, "without the correction the step is off"
    assert corrected[1] == pytest.approx(exact[1], abs=1e-7 * closing)
    assert corrected[0] == pytest.approx(exact[0], abs=1e-7 * closing * step)
    assert most >= 20.0 * closing
