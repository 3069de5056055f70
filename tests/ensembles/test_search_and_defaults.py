"""The number of steps of an ensemble with made-up errors, its speed, indices with closed forms, and its defaults."""

from __future__ import annotations

import inspect
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import dem_bridge as db
from dem_bridge.backends.prescan import prescan_hertz
from dem_bridge.ensembles import run, sensitivity, solve
from dem_bridge.ensembles.draw import Variation
from dem_bridge.ensembles.lanes import march
from dem_bridge.ensembles.run import run_ensemble
from dem_bridge.ensembles.sensitivity import sobol_indices
from dem_bridge.ensembles.solve import OBSERVABLES, solve_chains, steps_for
from dem_bridge.errors import RunBroken, UsageError
from dem_bridge.scene.scene import Scene, Wall

TWO = Scene(name="two", duration=1e-4, mass=(0.01, 0.02), stiffness=(2e10,), velocity=(0.8, 0.0))
CHAINS = Variation(scene=TWO, vary={"mass": 0.1}).block(0, 2)


class Solver:
    """Solves no chains: one observable, or the velocity at one sample, is off by ``error(steps)``."""

    def __init__(self, error: Any, off: str = "peak_force", broken: int = 0) -> None:
        self.error, self.off, self.broken, self.steps = error, off, broken, list[int]()

    def __call__(self, scene: Scene, chains: Any, steps: int, samples: int = 0) -> dict[str, Any]:
        self.steps.append(steps)
        if steps <= self.broken:
            raise RunBroken("a velocity is not finite")
        values = {name: np.ones((2, 3)) for name in OBSERVABLES}
        if samples:
            values["velocity"] = np.full((2, samples + 1, 2), -4.0)
        values[self.off].reshape(-1)[1] *= 1.0 + self.error(steps)
        return values


def _trials(count: int, first: float, every: int = 1) -> list[int]:
    """Return the numbers of steps that are tried: each sqrt(2) times the one before, in whole multiples."""
    return [every * math.ceil(first * math.sqrt(2.0) ** nth / every) for nth in range(count)]


@pytest.mark.parametrize("samples", [None, 20])
@pytest.mark.parametrize("name", OBSERVABLES)
def test_steps_are_the_first_whose_difference_from_the_next_is_a_sixth_of_the_accuracy(
    name: str, samples: int | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    # one step for each 1/omega at first; ten times the duration, so that there are many
    scene = replace(TWO, duration=1e-3)
    first = scene.duration * prescan_hertz(scene).frequency
    trials = _trials(9, first, samples or 1)
    for factor, nth in ((0.99, 6), (1.01, 7)):
        # the error of the seventh trial is just below or just above a sixth
        def error(steps: int, at_seventh: float = factor * 1e-3 / 6.0) -> float:
            return 1.0 / (1.0 + trials.index(steps)) if steps < trials[6] else at_seventh if steps == trials[6] else 0.0

        solver = Solver(error, name)
        monkeypatch.setattr(solve, "solve_chains", solver)
        steps = steps_for(scene, CHAINS, 1e-3, samples)
        assert steps == trials[nth]
        assert solver.steps == trials[: len(solver.steps)]
        assert solver.steps[-2] == steps


def test_velocities_at_samples_count_relative_to_the_largest(monkeypatch: pytest.MonkeyPatch) -> None:
    short = replace(TWO, duration=1e-8)
    for factor, steps in ((0.99, 20), (1.01, 40)):
        # one velocity of all samples is off, in the first trial, by a little less or more than a third
        solver = Solver(lambda steps, off=factor * 1e-2 / 3.0: off if steps == 20 else 0.0, "velocity")
        monkeypatch.setattr(solve, "solve_chains", solver)
        assert steps_for(short, CHAINS, 1e-2, 20) == steps


def test_the_least_number_of_steps_is_eight_and_broken_runs_are_passed_over(monkeypatch: pytest.MonkeyPatch) -> None:
    short = replace(TWO, duration=1e-8)
    solver = Solver(lambda steps: 0.0)
    monkeypatch.setattr(solve, "solve_chains", solver)
    assert steps_for(short, CHAINS, 1e-9) == 8
    assert solver.steps == [8, 12]
    broken = Solver(lambda steps: 0.0, broken=17)
    monkeypatch.setattr(solve, "solve_chains", broken)
    assert steps_for(short, CHAINS, 1e-9) == 23
    # 8 times a power of 2 may be a last digit above a whole number
    assert broken.steps in ([8, 12, first, 23, last] for first in (16, 17) for last in (32, 33))
    never = Solver(lambda steps: 1.0 / math.log(steps))
    monkeypatch.setattr(solve, "solve_chains", never)
    with pytest.raises(UsageError, match=r"two: accuracy = 1e-09 needs more than 1e\+06 steps; give a larger"):
        steps_for(short, CHAINS, 1e-9)
    # the last trial is the first above the limit
    assert never.steps[-2] < 1e6 <= never.steps[-1] < 1.5e6


@pytest.mark.parametrize("exponent", [2.5, 2.0, 3.0])
def test_touches_are_corrected_above_a_millionth_of_the_speed_of_all_energy(
    exponent: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    given: list[tuple[Any, ...]] = []

    def noting(*arguments: Any) -> Any:
        given.append(arguments)
        return march(*arguments)

    monkeypatch.setattr(solve, "march", noting)
    # an overlap of 5 um holds as much energy for each exponent
    stiffness = exponent * 1e-3 / 5e-6**exponent
    scene = Scene(
        name="three", duration=1e-6, mass=(0.01, 0.02, 0.03), stiffness=(stiffness, stiffness), exponent=exponent,
        velocity=(0.8, 0.0, -0.1), gap=(-5e-6, 3e-6), wall_left=Wall(stiffness=stiffness, gap=1e-5, exponent=exponent),
    )  # fmt: skip
    solve_chains(scene, Variation(scene=scene, vary={"mass": 0.0}).block(0, 1), 10)
    [arguments] = given
    # twice the energies, 2 E = m v^2: the open contacts hold none
    energy = 0.01 * 0.8**2 + 0.03 * 0.1**2 + 2.0 * 1e-3
    assert arguments[9] == pytest.approx(1e-6 * math.sqrt(energy / 0.06), rel=1e-9)
    # each exponent with a kernel of its own has it
    assert arguments[6] == {2.5: 0, 2.0: 1, 3.0: 2}[exponent]
    assert arguments[12:14] == (pytest.approx(1e-7), 10)
    assert arguments[0].shape == (5, 8)
    assert arguments[3].shape == arguments[4].shape == arguments[7].shape == (4, 8)


def test_bodies_that_do_not_move_forward_have_no_largest_velocity() -> None:
    still = replace(TWO, velocity=(0.0, 0.0), gap=1e-3)
    values = solve_chains(still, Variation(scene=still, vary={"mass": 0.1}).block(0, 3), 8)
    assert np.all(np.isnan(values["peak_velocity"]))
    assert np.all(np.isnan(values["arrival_at_end"]))
    assert np.all(values["peak_force"] == 0.0)
    moving = replace(TWO, velocity=(-0.5, 0.0), gap=1e-3)
    speeds = solve_chains(moving, Variation(scene=moving, vary={"mass": 0.1}).block(0, 3), 8)["peak_velocity"]
    assert np.all(np.isnan(speeds))


@pytest.mark.parametrize("walls", [("wall_left",), ("wall_right",), ("wall_left", "wall_right")])
def test_a_precompressed_chain_between_walls_rests_with_its_force(walls: tuple[str, ...]) -> None:
    sides: dict[str, Any] = dict.fromkeys(walls, Wall(stiffness=3e10))
    scene = Scene(
        name="rest", duration=1e-4, mass=(0.01, 0.02, 0.03), stiffness=(2e10, 1e10), velocity=(0.0,) * 3,
        precompression=50.0, **sides,
    )  # fmt: skip
    values = solve_chains(scene, Variation(scene=scene, vary={"stiffness": 0.1}).block(0, 4), 50, 5)
    # what carries 50 N in every contact does not move, whatever the stiffnesses are; round-off alone is left
    assert np.max(np.abs(values["velocity"])) < 1e-9
    np.testing.assert_allclose(values["peak_force"][np.isfinite(values["peak_force"])], 50.0, rtol=1e-6)


# indices with closed forms


@pytest.fixture
def plain(monkeypatch: pytest.MonkeyPatch) -> Variation:
    """Chains whose observables are the numbers by which they were drawn: the measures are functions of these."""
    scene = Scene(name="two", duration=1e-4, mass=(0.01, 0.02, 0.03), stiffness=(2e10, 1e10), velocity=(0.8, 0.0, 0.0))

    def values(scene: Scene, chains: Any, steps: int, samples: int = 0) -> dict[str, Any]:
        return {"peak_force": chains.mass / np.array(scene.mass) - 1.0}

    monkeypatch.setattr(sensitivity, "solve_chains", values)
    monkeypatch.setattr(sensitivity, "steps_for", lambda *_: 8)
    return Variation(scene=scene, vary={"mass": 0.1}, seed=4)


def test_indices_of_a_sum_and_of_a_product_are_those_of_their_variances(plain: Variation) -> None:
    def measures(values: dict[str, Any]) -> Any:
        x, y, z = (values["peak_force"] / 0.1).T
        return np.array([5.0 + 2.0 * x + y, 7.0 + x * y, 1e3 * (3.0 + x + y * z)])

    indices = sobol_indices(plain, measures, base=1024)
    # for independent standard normal numbers: 4/5 and 1/5; all of x y is of both; 1/2 of x, 1/2 of both others
    first = [[0.8, 0.2, 0.0], [0.0, 0.0, 0.0], [0.5, 0.0, 0.0]]
    total = [[0.8, 0.2, 0.0], [1.0, 1.0, 0.0], [0.5, 0.5, 0.5]]
    np.testing.assert_allclose(indices.first, first, atol=0.06)
    np.testing.assert_allclose(indices.total, total, atol=0.06)
    np.testing.assert_allclose(indices.mean, [5.0, 7.0, 3e3], rtol=0.02)
    np.testing.assert_allclose(indices.deviation, [5.0**0.5, 1.0, 1e3 * 2.0**0.5], rtol=0.04)
    # intervals contain the estimates, and have their sizes; the sum of first-order indices has one of its own
    sums = np.sum(indices.first, axis=1)
    for (low, high), inside in (
        (indices.first_interval, indices.first),
        (indices.total_interval, indices.total),
        (indices.sum_interval, sums),
    ):
        assert np.all((low <= inside + 1e-12) & (inside <= high + 1e-12))
        assert 1e-3 < np.max(high - low) < 0.5
    # a sum of numbers has a sum of indices of 1, where the product has 0
    assert indices.sum_interval[0][0] < 1.0 < indices.sum_interval[1][0] + 0.05
    assert abs(indices.sum_interval[0][1]) < 0.3
    assert indices.leading[0].tolist() == [True, False, False]
    assert indices.chains == 1024 * 8


def test_the_least_base_is_two_and_a_missing_value_is_refused(plain: Variation) -> None:
    def measures(values: dict[str, Any]) -> Any:
        return values["peak_force"].T[:2]

    assert sobol_indices(plain, measures, base=2).chains == 16
    for base in (1, 3, 6, True, 4.0):
        with pytest.raises(UsageError, match=rf"^base = {base}; allowed: a power of 2 from 2 on"):
            sobol_indices(plain, measures, base=base)  # type: ignore[arg-type]

    def lacking(values: dict[str, Any]) -> Any:
        found = measures(values)
        found[1, :3] = np.nan
        return found

    with pytest.raises(UsageError, match=r"^two: 3 of 64 chains lack a value of a measure, because the wave"):
        sobol_indices(plain, lacking, base=8)


def test_a_measure_that_varies_less_than_a_hundredth_of_the_accuracy_has_no_indices(plain: Variation) -> None:
    def measures(values: dict[str, Any]) -> Any:
        x = values["peak_force"][:, 0] / 0.1
        x = (x - x.mean()) / x.std()
        return np.array([1.0 + 0.98e-5 * x, 1.0 + 1.02e-5 * x])

    first = sobol_indices(plain, measures, base=64, accuracy=1e-3).first
    assert np.isnan(first[0]).all()
    assert np.isfinite(first[1]).all()


# defaults and limits of an ensemble


def test_an_ensemble_has_the_defaults_that_it_states() -> None:
    for function in (run_ensemble, db.ensemble):
        defaults = {name: each.default for name, each in inspect.signature(function).parameters.items()}
        assert (defaults["accuracy"], defaults["checks"], defaults["samples"]) == (1e-4, 4, None)


def test_the_limits_of_accuracies_and_samples_belong_to_them(monkeypatch: pytest.MonkeyPatch) -> None:
    variation = Variation(scene=TWO, vary={"mass": 0.1}, seed=5)
    pilots: list[Any] = []

    def steps(scene: Scene, chains: Any, accuracy: float, samples: int | None = None) -> int:
        pilots.append(chains)
        return 64

    monkeypatch.setattr(run, "steps_for", steps)
    for accuracy in (1e-9, 0.1):
        assert run_ensemble(variation, 1, accuracy=accuracy, checks=0).accuracy == accuracy
    assert run_ensemble(variation, 1, samples=1, checks=0).values["velocity"].shape == (1, 2, 2)
    # the steps are those of the first chains of the ensemble itself
    np.testing.assert_array_equal(pilots[0].mass, variation.block(0, len(pilots[0])).mass)
