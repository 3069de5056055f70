"""Blanes & Moan's method: order 4 where the force is smooth, bars that hold where it is not, and refusals."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given

import dem_bridge as db
from dem_bridge.backends.blanes_moan import SRKN_6B
from dem_bridge.errors import UnsupportedScene
from dem_bridge.observables.convergence import observed_order
from dem_bridge.scene.scene import Damping, Scene
from dem_bridge.trajectory.trajectory import QUANTITIES, Trajectory
from tests.bench.bench_bars import trials
from tests.conftest import Solve
from tests.helpers.quadruple_truth import Truth
from tests.helpers.random_scenes import COUNT
from tests.helpers.strategies import ANY, examples, scenes, thirty_two_times_as_fast

EPS = float(np.finfo(float).eps)
DRIFTS, KICKS = SRKN_6B

#: a precompressed chain in which no contact opens: there the force is smooth
SMOOTH = Scene(
    name="smooth",
    duration=4e-4,
    mass=(8e-3, 1e-2, 2e-2, 5e-3, 1e-2),
    stiffness=(4e9, 5e9, 6e9, 5e9),
    velocity=(0.05, 0.0, 0.0, -0.02, 0.0),
    precompression=2000.0,
    samples=20,
)


def _solve(scene: Scene, dt: float, *, uncertainty: bool = False) -> Trajectory:
    return db.solve(scene, backend="blanes-moan", dt=dt, uncertainty=uncertainty)


def _error(run: Trajectory, reference: Trajectory, quantity: str = "velocity") -> float:
    return float(np.max(np.abs(getattr(run, quantity) - getattr(reference, quantity))))


# the method


def test_the_fractions_are_whole_and_the_same_backwards() -> None:
    assert math.fsum(DRIFTS) == pytest.approx(1.0, abs=EPS)
    assert math.fsum(KICKS) == pytest.approx(1.0, abs=EPS)
    assert DRIFTS.tolist() == DRIFTS.tolist()[::-1]
    assert KICKS.tolist() == KICKS.tolist()[::-1]


def _one_step(h: float, omega: float) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    """The step's matrix for an oscillator (x, v/omega)."""
    phase = h * omega
    found = np.array([[1.0, 0.0], [-KICKS[0] * phase, 1.0]])
    for drift, kick in zip(DRIFTS, KICKS[1:], strict=True):
        found = np.array([[1.0, 0.0], [-kick * phase, 1.0]]) @ np.array([[1.0, drift * phase], [0.0, 1.0]]) @ found
    return found


def test_a_step_of_an_oscillator_is_right_to_the_fifth_power() -> None:
    """The linear order conditions, free of everything but the fractions."""
    sizes = (0.2, 0.1, 0.05)
    exact = [np.array([[math.cos(h), math.sin(h)], [-math.sin(h), math.cos(h)]]) for h in sizes]
    errors = [float(np.max(np.abs(_one_step(h, 1.0) - e))) for h, e in zip(sizes, exact, strict=True)]
    assert observed_order(sizes, errors).order == pytest.approx(5.0, abs=0.02)


def test_a_step_keeps_areas() -> None:
    assert float(np.linalg.det(_one_step(0.5, 1.0))) == pytest.approx(1.0, abs=20 * EPS)


def test_the_order_is_four_where_no_contact_opens() -> None:
    reference = db.solve(SMOOTH, backend="reference", uncertainty=False)
    refinement = (4e-6, 2e-6, 1e-6, 5e-7)
    runs = [_solve(SMOOTH, dt) for dt in refinement]
    assert all(np.all(run.contact_force > 0.0) for run in runs)
    for quantity in ("velocity", "displacement"):
        fit = observed_order(refinement, [_error(run, reference, quantity) for run in runs])
        assert (fit.points, fit.order) == (4, pytest.approx(4.0, abs=0.1)), quantity


def test_richardson_takes_the_order_of_the_method() -> None:
    reference = db.solve(SMOOTH, backend="reference", uncertainty=False)
    plain, better = (db.solve(SMOOTH, backend="blanes-moan", dt=1e-6, order=order) for order in (None, "richardson"))
    # of dt/2 by order 4, less what is of order 6: (1 - 1/16) of the error is gone with that of dt/2 alone
    assert _error(better, reference) < 1e-2 * _error(plain, reference)
    assert _error(better, reference) <= better.uncertainty["velocity"]


def test_a_step_that_is_not_named_is_as_accurate_as_velocity_verlets_own(free_chain: Truth) -> None:
    run, twin = (db.solve(free_chain.scene, backend=name, uncertainty=False) for name in ("blanes-moan", "verlet"))
    assert free_chain.error(run, "velocity") < free_chain.error(twin, "velocity")
    assert run.cost.force_evaluations < 0.4 * twin.cost.force_evaluations


# chains that open


@pytest.mark.parametrize(("dt", "accuracy"), [(1.2e-6, 1e-4), (2e-7, 1e-6), (3e-8, 1e-8)])
def test_a_large_step_is_accurate_in_spite_of_the_kink(free_chain: Truth, dt: float, accuracy: float) -> None:
    # 5, 30 and 200 steps of six evaluations to a sample; velocity-Verlet needs 76, 724 and 8200 evaluations
    assert free_chain.error(_solve(free_chain.scene, dt), "velocity") <= accuracy * free_chain.v0


@pytest.mark.parametrize("dt", [2e-6, 5e-7, 1e-7])
def test_bars_hold_on_the_papers_chains(free_chain: Truth, walled: Truth, solved: Solve, dt: float) -> None:
    for truth in (free_chain, walled):
        run = solved(truth.scene, "blanes-moan", dt=dt)
        for quantity in QUANTITIES:
            assert np.all(truth.error(run, quantity) <= run.uncertainty[quantity]), quantity
        # at 2 us the errors of the walled chain, 6 um, leave open whether nine contacts close before its end
        if truth is free_chain or dt < 2e-6:
            assert run.uncertainty["velocity"] <= 5.0 * truth.error(run, "velocity")


@pytest.mark.slow
def test_bars_hold_on_random_scenes() -> None:
    # at steps that are a fifth of the shortest contact time, too
    found = list(trials("blanes-moan", range(0, COUNT, 15), (1 / 5, 1 / 50)))
    for quantity in QUANTITIES:
        outside = [trial.seed for trial in found if trial.outside[quantity] > 1.0]
        assert outside == [], quantity
        assert all(trial.finite[quantity] for trial in found), quantity
    assert np.nanmedian([trial.wide["velocity"] for trial in found]) <= 5.0


@examples(25)
@given(scene=scenes(exponents=ANY, walls=True, gravity=True))
def test_any_exponent_wall_and_gap_is_as_the_twin_has_it(scene: Scene) -> None:
    run, twin = _solve(scene, 2.5e-7, uncertainty=True), db.solve(scene, backend="verlet", dt=1e-7)
    for quantity in ("velocity", "displacement"):
        assert _error(run, twin, quantity) <= run.uncertainty[quantity] + twin.uncertainty[quantity], quantity


def test_a_law_that_is_a_function_is_as_its_power() -> None:
    power = replace(SMOOTH, precompression=0.0)
    given_as_function = replace(power, stiffness=(4e9,) * 4)
    function = replace(given_as_function, law=lambda overlap: 4e9 * np.asarray(overlap) ** 1.5)
    one, other = _solve(given_as_function, 5e-7), _solve(function, 5e-7)
    # splines of 16,384 cells in the root of the overlap: exact for 3/2 but for their rounding
    assert other.velocity == pytest.approx(one.velocity, abs=1e-11)


# symmetries


@examples(25)
@given(scene=scenes(walls=True, gravity=True))
def test_a_hertzian_scene_has_no_scale_and_repeats_bit_for_bit(scene: Scene) -> None:
    fast = thirty_two_times_as_fast(scene)
    one, other = _solve(scene, 1e-6), _solve(fast, 5e-7)
    np.testing.assert_array_equal(other.velocity, 32.0 * one.velocity)
    np.testing.assert_array_equal(other.displacement, 16.0 * one.displacement)


# refusals


@pytest.mark.parametrize(
    "change", [{"damping": Damping(law="dashpot", coefficient=10.0)}, {"drag": 5.0}], ids=["damping", "drag"]
)
def test_forces_that_depend_on_velocities_are_refused(change: dict[str, object]) -> None:
    scene = replace(SMOOTH, precompression=0.0, **change)  # type: ignore[arg-type]
    with pytest.raises(UnsupportedScene, match=r"the scene has (dashpot damping|drag); the method evaluates forces"):
        _solve(scene, 1e-7)


def test_evaluations_are_counted_by_stage(solved: Solve) -> None:
    run = solved(SMOOTH, "blanes-moan", dt=1e-6)
    assert run.cost.force_evaluations == 6 * run.cost.steps + 1
