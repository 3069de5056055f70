"""Chains in lanes against closed forms: springs, Hertz contacts, walls, weight, and bodies that nothing reaches."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import dem_bridge as db
from dem_bridge.ensembles import solve
from dem_bridge.ensembles.draw import Chains, Variation
from dem_bridge.ensembles.lanes import march
from dem_bridge.ensembles.run import run_ensemble
from dem_bridge.ensembles.solve import OBSERVABLES, difference, solve_chains, steps_for
from dem_bridge.errors import RunBroken, UsageError
from dem_bridge.observables.registry import observable_named
from dem_bridge.scene.scene import Scene, Wall

Floats = NDArray[np.float64]
#: more than one group of lanes, and not a multiple of them
COUNT, STEPS = 11, 1000


def _pair(**more: Any) -> tuple[Scene, Chains]:
    fields: dict[str, Any] = {
        "name": "pair", "duration": 4e-4, "mass": (0.01, 0.03), "stiffness": (4e9,), "velocity": (0.8, 0.0),
    }  # fmt: skip
    scene = Scene(**fields | more)
    vary = {"mass": 0.1, "stiffness": 0.1, "velocity": 0.1}
    return scene, Variation(scene=scene, vary=vary, seed=4).block(0, COUNT)


def _collision(mass: Floats, stiffness: Floats, speed: Floats, exponent: float) -> tuple[Floats, Floats]:
    """Return the time of the largest compression and the force there, of a power law with energy k/n overlap^n."""
    overlap = (0.5 * exponent * mass * speed**2 / stiffness) ** (1.0 / exponent)
    # the integral of 1/sqrt(1 - x^n) from 0 to 1
    integral = math.sqrt(math.pi) * math.gamma(1.0 + 1.0 / exponent) / math.gamma(0.5 + 1.0 / exponent)
    return integral * overlap / speed, stiffness * overlap ** (exponent - 1.0)


@pytest.mark.parametrize(("exponent", "stiffness"), [(2.5, 4e9), (2.0, 1e6), (3.0, 4e12), (2.2, 3e7), (1.5, 3e4)])
@pytest.mark.parametrize("gap", [0.0, 1e-5])
def test_two_bodies_collide_as_in_the_closed_form(exponent: float, stiffness: float, gap: float) -> None:
    scene, chains = _pair(exponent=exponent, stiffness=(stiffness,), gap=(gap,))
    values = solve_chains(scene, chains, STEPS)
    first, second = chains.mass.T
    speed = chains.velocity[:, 0]
    time, force = _collision(first * second / (first + second), chains.stiffness[:, 0], speed, exponent)
    time += gap / speed
    # of the order of the method, less in the first step of a soft law
    close = 1e-4 if exponent < 2.0 else 2e-7
    np.testing.assert_allclose(values["crossing_time"][:, 0], time, rtol=close)
    np.testing.assert_allclose(values["arrival_at_end"], time, rtol=close)
    np.testing.assert_allclose(values["peak_force"][:, 0], force, rtol=close)
    # the striker is fastest at the start, the other body after they have parted
    np.testing.assert_allclose(values["peak_velocity"][:, 0], speed, rtol=1e-12)
    np.testing.assert_allclose(values["peak_velocity"][:, 1], 2.0 * first * speed / (first + second), rtol=close)
    assert np.all(np.isnan(values["residence_time"]))


@pytest.mark.parametrize("side", ["wall_left", "wall_right"])
def test_a_wall_is_a_body_of_infinite_mass(side: str) -> None:
    wall = Wall(stiffness=4e9, gap=2e-5, exponent=2.5)
    speed = -0.8 if side == "wall_left" else 0.8
    # the body beside the wall flies into it, and the other is too far away to be met
    velocity, gap = ((speed, 0.0), 1.0) if side == "wall_left" else ((0.0, speed), 1.0)
    sides: dict[str, Any] = {side: wall}
    scene = Scene(
        name="wall", duration=3e-4, mass=(0.01, 0.01), stiffness=(4e9,), velocity=velocity, gap=(gap,), **sides
    )
    chains = Variation(scene=scene, vary={"mass": 0.1, "stiffness": 0.1}, seed=2).block(0, COUNT)
    values = solve_chains(scene, chains, STEPS, 2)
    mass = chains.mass[:, 0 if side == "wall_left" else 1]
    time, force = _collision(mass, chains.stiffness[:, 1], np.full(COUNT, 0.8), 2.5)
    np.testing.assert_allclose(values["crossing_time"][:, 1], time + 2e-5 / 0.8, rtol=2e-7)
    np.testing.assert_allclose(values["peak_force"][:, 1], force, rtol=2e-7)
    # it flies back as fast
    moving = values["velocity"][:, :, 0 if side == "wall_left" else 1]
    np.testing.assert_allclose(moving[:, [0, 2]], np.tile([speed, -speed], (COUNT, 1)), rtol=1e-6)
    assert np.all(np.isnan(values["crossing_time"][:, 0]))
    assert np.all(np.isnan(values["arrival_at_end"]))
    assert np.all(values["peak_force"][:, 0] == 0.0)


def test_what_the_wave_has_not_reached_has_no_values() -> None:
    # a body that moves away on its own is not reached, although it is fast
    scene = Scene(
        name="apart",
        duration=1e-4,
        mass=(0.01, 0.01, 0.01),
        stiffness=(4e9, 4e9),
        velocity=(0.8, 0.0, 0.5),
        gap=(0.0, 1.0),
    )
    values = solve_chains(scene, Variation(scene=scene, vary={"mass": 0.05}).block(0, 3), STEPS)
    assert np.all(np.isfinite(values["peak_velocity"][:, :2]))
    assert np.all(np.isnan(values["peak_velocity"][:, 2]))
    assert np.all(np.isfinite(values["crossing_time"][:, 0]))
    assert np.all(np.isnan(values["crossing_time"][:, 1]))
    assert np.all(np.isnan(values["residence_time"]))


def test_weight_accelerates_free_bodies_and_samples_are_equally_far_apart() -> None:
    scene = Scene(
        name="fall", duration=2e-3, mass=(0.01, 0.02), stiffness=(4e9,), velocity=(0.0, 0.1), gap=(1.0,), gravity=9.81
    )
    velocity = solve_chains(scene, Variation(scene=scene, vary={"mass": 0.1}).block(0, 9), 40, 4)["velocity"]
    expected = np.array([0.0, 0.1]) + 9.81 * np.linspace(0.0, 2e-3, 5)[:, None]
    np.testing.assert_allclose(velocity, np.tile(expected, (9, 1, 1)), rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize("exponent", [2.5, (2.5, 3.0, 2.2, 2.5)])
def test_a_chain_in_lanes_is_that_of_the_reference_to_many_digits(exponent: Any) -> None:
    scene = Scene(
        name="five", duration=2e-4, mass=(0.01, 0.02, 0.015, 0.01, 0.03), stiffness=(2e10, 1e10, 3e10, 2e10),
        gap=(1e-6, 0.0, -2e-7, 1e-6), velocity=(0.8, 0.0, -0.1, 0.0, 0.0), exponent=exponent,
        wall_left=Wall(stiffness=2e10, gap=1e-5), wall_right=Wall(stiffness=1e10, gap=2e-6),
    )  # fmt: skip
    chains = Variation(scene=scene, vary={"mass": 0.05, "gap": 1e-7}, seed=1).block(0, 9)
    values = solve_chains(scene, chains, 8000)
    for nth in (0, 8):
        one = chains.scene(scene, nth)
        exact = db.solve(one, backend="reference", uncertainty=False, samples=8000)
        for name in OBSERVABLES:
            read = np.atleast_1d(observable_named(name).value(one, exact))
            # largest velocities of the reference are read between samples
            assert difference(values[name][nth : nth + 1], read[None])[0] < 1e-6, (name, nth)


# choice of the step


def test_the_steps_for_an_accuracy_are_a_multiple_of_the_samples_and_few() -> None:
    scene, chains = _pair()
    for samples in (7, 50):
        assert steps_for(scene, chains, 1e-4, samples) % samples == 0
    coarse, fine = (steps_for(scene, chains, accuracy) for accuracy in (1e-2, 1e-6))
    assert 8 <= coarse < fine < 10_000
    # the accuracy is that of the observables, within some factor: neither missed nor exceeded at any price
    exact = solve_chains(scene, chains, 20_000)
    for accuracy, steps in ((1e-2, coarse), (1e-6, fine)):
        values = solve_chains(scene, chains, steps)
        assert max(float(np.max(difference(values[name], exact[name]))) for name in OBSERVABLES) < accuracy


def test_an_accuracy_that_no_number_of_steps_gives_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    scene, chains = _pair()
    monkeypatch.setattr(solve, "MOST_STEPS", 500)
    with pytest.raises(UsageError, match=r"pair: accuracy = 1e-12 needs more than 500 steps; give a larger accuracy"):
        steps_for(scene, chains, 1e-12)


def test_a_step_that_is_too_long_is_an_error() -> None:
    scene, chains = _pair(stiffness=(4e39,), exponent=5.0)
    with pytest.raises(RunBroken, match="pair: a velocity is not finite at 40 steps; give a smaller accuracy"):
        solve_chains(scene, chains, 40)


@pytest.mark.parametrize("exponent", [2.5, 2.0, 3.0])
@pytest.mark.parametrize("walls", [(), ("wall_left",), ("wall_right",), ("wall_left", "wall_right")])
def test_no_step_reads_or_writes_beyond_its_arrays(
    walls: tuple[str, ...], exponent: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    # compiled code does not check the ends of arrays; the same function without the compiler does
    monkeypatch.setattr(solve, "march", march.interpret)
    # forces at an overlap of 5 um are the same for all exponents
    stiffness = 2e10 * 5e-6 ** (2.5 - exponent)
    sides: dict[str, Any] = dict.fromkeys(walls, Wall(stiffness=0.5 * stiffness, gap=1e-6, exponent=exponent))
    scene = Scene(
        name="short", duration=1e-4, mass=(0.01, 0.02), stiffness=(stiffness,), velocity=(0.8, 0.5), gap=(1e-6,),
        exponent=exponent, **sides,
    )  # fmt: skip
    chains = Variation(scene=scene, vary={"mass": 0.05}).block(0, 2)
    interpreted = solve_chains(scene, chains, 40, 4)
    monkeypatch.setattr(solve, "march", march)
    compiled = solve_chains(scene, chains, 40, 4)
    for name, values in compiled.items():
        np.testing.assert_allclose(interpreted[name], values, rtol=1e-9, atol=1e-15)


def test_the_difference_of_observables_is_relative_to_each_value() -> None:
    nan, inf = math.nan, math.inf
    reference = np.array([[1.0, 100.0, nan], [2.0, 4.0, nan], [1.0, 1.0, 1.0], [nan, nan, nan]])
    values = np.array([[1.1, 100.0, nan], [2.0, 5.0, 1.0], [1.0, nan, 1.0], [nan, nan, nan]])
    np.testing.assert_allclose(difference(values, reference), [0.1, inf, inf, 0.0])
    # a value below a thousandth of the largest counts relative to that
    small = difference(np.array([[2e-6, 1.0]]), np.array([[1e-6, 1.0]]))
    np.testing.assert_allclose(small, [1e-3], rtol=1e-3)


def test_samples_and_progress_of_an_ensemble_are_those_of_its_chains() -> None:
    scene, _ = _pair()
    variation = Variation(scene=scene, vary={"mass": 0.1}, seed=5)
    calls: list[tuple[float, int, str]] = []
    ensemble = run_ensemble(variation, 5, samples=20, checks=0, progress=lambda *words: calls.append(words))
    assert ensemble.values["velocity"].shape == (5, 21, 2)
    assert ensemble.steps % 20 == 0
    np.testing.assert_array_equal(
        ensemble.values["velocity"], solve_chains(scene, variation.block(0, 5), ensemble.steps, 20)["velocity"]
    )
    assert calls == [(5, 5, "pair: 5 chains")]
    assert "velocity" not in run_ensemble(variation, 2, checks=0).values
    for name, wrong in (("n", 0), ("checks", -1), ("samples", 0), ("samples", True), ("n", 1.5)):
        with pytest.raises(UsageError, match=rf"^{name} = {wrong}; allowed: a whole number >= \d$"):
            run_ensemble(variation, **{"n": 1, "checks": 0, name: wrong})  # type: ignore[arg-type]
    for accuracy in (0.99e-9, 0.1001):
        with pytest.raises(UsageError, match=r"allowed: a number from 1e-9 to 0\.1"):
            run_ensemble(variation, 1, accuracy=accuracy)
