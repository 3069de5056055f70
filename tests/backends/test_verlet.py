"""The twin: second order against the truth, and the symmetries that velocity-Verlet keeps to the last bit."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given
from numpy.typing import NDArray

import dem_bridge as db
from dem_bridge.backends.base import Sampling
from dem_bridge.backends.prescan import prescan_hertz
from dem_bridge.backends.steps import default_step, round_step
from dem_bridge.errors import RunBroken, UsageError
from dem_bridge.observables.conserved import energy, momentum
from dem_bridge.observables.convergence import observed_order
from dem_bridge.scene.scene import Scene, Wall
from dem_bridge.trajectory.trajectory import Trajectory
from tests.conftest import Solve
from tests.helpers.quadruple_truth import Truth
from tests.helpers.strategies import ANY, HALVES, examples, log_uniform, scenes, thirty_two_times_as_fast

EPS = float(np.finfo(float).eps)

#: halved from 1e-7 s, where order 2 sets in, to 1.25e-8 s
REFINEMENT = (1e-7, 5e-8, 2.5e-8, 1.25e-8)


def _solve(scene: Scene, dt: float | None = None, *, uncertainty: bool = False) -> Trajectory:
    return db.solve(scene, backend="verlet", dt=dt, uncertainty=uncertainty)


# accuracy


def test_the_order_is_two_on_the_papers_chains(free_chain: Truth, solved: Solve) -> None:
    runs = [solved(free_chain.scene, "verlet", dt=dt) for dt in REFINEMENT]
    fit = observed_order(REFINEMENT, [float(free_chain.error(run, "velocity")) for run in runs])
    # round-off is at 1e-11, four decades below the smallest of these errors
    assert (fit.points, fit.order) == (4, pytest.approx(2.0, abs=0.05))
    assert fit.residual < 0.02  # a straight line: 2 % over a factor 64 in error


@pytest.mark.parametrize("dt", [*REFINEMENT, 1e-8])
def test_the_bars_hold_on_the_papers_chains(free_chain: Truth, solved: Solve, dt: float) -> None:
    run = solved(free_chain.scene, "verlet", dt=dt)
    for quantity, bar in run.uncertainty.items():
        assert np.all(free_chain.error(run, quantity) <= bar), quantity


@pytest.mark.parametrize("dt", [*REFINEMENT, 1e-8])
def test_the_velocity_bar_is_at_most_five_times_the_error(free_chain: Truth, solved: Solve, dt: float) -> None:
    run = solved(free_chain.scene, "verlet", dt=dt)
    assert run.uncertainty["velocity"] <= 5.0 * free_chain.error(run, "velocity")


@pytest.mark.parametrize("dt", [1e-7, 1e-8])
def test_the_bars_hold_on_the_ill_conditioned_wall(walled: Truth, solved: Solve, dt: float) -> None:
    run = solved(walled.scene, "verlet", dt=dt)
    for quantity, bar in run.uncertainty.items():
        assert np.all(walled.error(run, quantity) <= bar), quantity


def test_the_error_at_a_hundredth_of_a_microsecond_is_that_of_the_time_step(free_chain: Truth, solved: Solve) -> None:
    # measured 1.4e-6 and 1.1e-6 of v0 (LAMMPS.md: 1.4e-6); more is a change of the integrator
    assert free_chain.error(solved(free_chain.scene, "verlet", dt=1e-8), "velocity") < 2e-6 * free_chain.v0


def test_the_twin_is_velocity_verlet_as_written_down_by_hand() -> None:
    scene = Scene(
        name="hand",
        duration=2e-4,
        mass=(8e-3, 1e-2, 2e-2),
        stiffness=(4e9, 5e9),
        velocity=(0.8, 0.0, -0.2),
        gap=(1e-6, -5e-7),
        wall_left=Wall(stiffness=2e9, gap=5e-6),
        wall_right=Wall(stiffness=3e9, gap=2e-5),
        gravity=100.0,
        samples=40,
    )
    run = _solve(scene, 1e-7)
    dt, m, g = scene.duration / 2000, np.array(scene.mass), scene.gravity

    def acceleration(x: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return accelerations from displacements, contact by contact, as in PHYSICS.md."""
        f01 = 4e9 * max(x[0] - x[1] - 1e-6, 0.0) ** 1.5
        f12 = 5e9 * max(x[1] - x[2] + 5e-7, 0.0) ** 1.5
        left = 2e9 * max(-x[0] - 5e-6, 0.0) ** 1.5
        right = 3e9 * max(x[2] - 2e-5, 0.0) ** 1.5
        return np.asarray(np.array([left - f01, f01 - f12, f12 - right]) / m + g)

    x, v = np.zeros(3), np.array(scene.velocity)
    a = acceleration(x)
    for step in range(1, 2001):
        v = v + 0.5 * dt * a
        x = x + dt * v
        a = acceleration(x)
        v = v + 0.5 * dt * a
        if step % 50 == 0:
            # displacements of 1e-4 m against overlaps of 1e-6 m: two digits lost in each of up to 2000 steps
            assert run.velocity[step // 50] == pytest.approx(v, abs=2000 * 100 * EPS)
            assert run.displacement[step // 50] == pytest.approx(x, abs=2000 * 100 * EPS * 1e-4)


# symmetries


@examples(25)
@given(scene=scenes(walls=True, gravity=True))
def test_a_hertzian_scene_has_no_scale_and_repeats_bit_for_bit(scene: Scene) -> None:
    fast = thirty_two_times_as_fast(scene)
    dt = 2.5e-7
    run, other = _solve(scene, dt), _solve(fast, 0.5 * dt)
    assert (other.time * 2.0).tobytes() == run.time.tobytes()
    np.testing.assert_array_equal(other.velocity, 32.0 * run.velocity)
    np.testing.assert_array_equal(other.displacement, 16.0 * run.displacement)
    np.testing.assert_array_equal(other.contact_force, 64.0 * run.contact_force)


def _mirrored(scene: Scene) -> Scene:
    links = scene.n_body - 1
    return replace(
        scene,
        mass=scene.mass[::-1],
        velocity=tuple(-v for v in scene.velocity[::-1]),
        stiffness=scene.stiffness[::-1],
        exponent=tuple(scene.contacts.exponent[:links][::-1].tolist()),
        gap=tuple(scene.contacts.gap[:links][::-1].tolist()),
        wall_left=scene.wall_right,
        wall_right=scene.wall_left,
        gravity=-scene.gravity,
    )


@examples(25)
@given(scene=scenes(exponents=ANY, walls=True))
def test_a_chain_in_a_mirror_moves_as_the_mirror_image_bit_for_bit(scene: Scene) -> None:
    run, other = _solve(scene, 2.5e-7), _solve(_mirrored(scene), 2.5e-7)
    np.testing.assert_array_equal(other.velocity[:, ::-1], -run.velocity)
    np.testing.assert_array_equal(other.displacement[:, ::-1], -run.displacement)
    links = scene.n_body - 1
    np.testing.assert_array_equal(other.contact_force[:, :links][:, ::-1], run.contact_force[:, :links])


def _speed(scene: Scene) -> float:
    """Scale of velocities, m/s: bodies that start slowly may be set moving by an initial overlap."""
    stored = sum(k * max(-g, 0.0) ** 2.5 for k, g in zip(scene.contacts.stiffness, scene.contacts.gap, strict=True))
    return max(*(abs(v) for v in scene.velocity), math.sqrt(stored / min(scene.mass)))


def _sensitivity(scene: Scene, dt: float) -> float:
    """Measure the relative change of velocities over a relative change of stiffnesses, a million times round-off."""
    size = 1e-9
    signs = [size if k % 2 else -size for k in range(len(scene.stiffness))]
    moved = replace(scene, stiffness=tuple(k * (1.0 + s) for k, s in zip(scene.stiffness, signs, strict=True)))
    run, other = _solve(scene, dt), _solve(moved, dt)
    return float(np.max(np.abs(run.velocity - other.velocity))) / _speed(scene) / size


@examples(20)
@given(scene=scenes(bodies=(2, 6)))
def test_a_moving_observer_sees_the_same_motion(scene: Scene) -> None:
    shift, dt = 0.75, 2.5e-7
    speed = _speed(scene)
    assume(speed > 1e-3)
    at_rest = _solve(scene, dt)
    other = _solve(replace(scene, velocity=tuple(v + shift for v in scene.velocity)), dt)
    # v + shift rounds at each of the 1200 steps and changes overlaps by that share of a step; the scene magnifies it
    lost = 1200 * EPS * (shift + speed) * (1.0 + _sensitivity(scene, dt))
    assert other.velocity == pytest.approx(at_rest.velocity + shift, abs=4.0 * lost)
    drift = shift * at_rest.time[:, None]
    assert other.displacement == pytest.approx(at_rest.displacement + drift, abs=4.0 * lost * scene.duration)


@examples(20)
@given(scene=scenes(bodies=(2, 6), exponents=HALVES, walls=True))
def test_a_motion_run_backwards_returns_to_its_start(scene: Scene) -> None:
    dt = 2.5e-7
    assume(_speed(scene) > 1e-3)
    there = _solve(scene, dt)
    x = np.append(there.displacement[-1], 0.0)
    c, links = scene.contacts, scene.n_body - 1
    gap = c.gap - (x[c.left] - x[c.right])
    walls = iter(gap[links:].tolist())
    back = _solve(
        replace(
            scene,
            velocity=tuple((-there.velocity[-1]).tolist()),
            gap=tuple(gap[:links].tolist()),
            wall_left=replace(scene.wall_left, gap=next(walls)) if scene.wall_left else None,
            wall_right=replace(scene.wall_right, gap=next(walls)) if scene.wall_right else None,
        ),
        dt,
    )
    # each of 2400 steps rounds an overlap at the last digit of the distance that its bodies have flown apart, `far`
    # times the overlap: steps of free flight are equal and round alike; the scene magnifies it
    deepest = float(np.max((there.peak_force / c.stiffness) ** (1.0 / (c.exponent - 1.0))))
    far = float(np.max(np.abs([c.gap, gap]))) / deepest if deepest > 0.0 else 0.0
    lost = 2400 * (1.0 + far) * EPS * (1.0 + _sensitivity(scene, dt)) * _speed(scene)
    assert back.velocity[::-1] == pytest.approx(-there.velocity, abs=4.0 * lost)


@examples(25)
@given(scene=scenes(exponents=ANY))
def test_momentum_is_exact(scene: Scene) -> None:
    run = _solve(scene, 2.5e-7)
    total = momentum(scene, run)
    # both kicks of 1200 steps round each momentum to half an ulp
    size = float(np.max(np.abs(run.velocity)) * np.sum(scene.mass))
    assert total == pytest.approx(np.full(21, float(np.dot(scene.mass, scene.velocity))), abs=2400 * EPS * size)


@examples(25)
@given(scene=scenes(walls=True, gravity=True))
def test_energy_is_conserved_to_the_size_of_the_error(scene: Scene) -> None:
    run = _solve(scene, uncertainty=True)
    error = np.abs(energy(scene, run) - energy(scene, run)[0])
    # dE = sum m v dv - sum F dx - m g dx, with dv and dx at most the bars
    mass = np.array(scene.mass)
    momenta = float(np.max(np.abs(run.velocity) @ mass))
    forces = float(np.max(np.sum(run.contact_force, axis=1, initial=0.0)))
    weight = abs(scene.gravity) * float(np.sum(mass))
    allowed = momenta * run.uncertainty["velocity"] + (2.0 * forces + weight) * run.uncertainty["displacement"]
    second_order = 0.5 * float(np.sum(mass)) * run.uncertainty["velocity"] ** 2
    # round-off of the sum itself
    assert np.all(error <= allowed + second_order + 100 * EPS * float(np.max(np.abs(energy(scene, run)))))


# steps


@given(dt=log_uniform(1e-15, 1e3))
def test_steps_are_1_2_or_5_times_a_power_of_ten_and_not_above_what_is_asked(dt: float) -> None:
    step = round_step(dt)
    assert f"{step:e}".split("e")[0].rstrip("0").rstrip(".") in ("1", "2", "5")
    assert dt / 2.5 * (1.0 - 1e-11) <= step <= dt * (1.0 + 1e-11)
    assert step == float(f"{step:.0e}")  # the very number that a person would write


def test_the_default_step_of_the_papers_chains_is_a_hundredth_of_a_microsecond(free_chain: Truth) -> None:
    # what the ladder and the committed decks use
    scene = free_chain.scene
    assert default_step(scene, Sampling(count=scene.samples), prescan_hertz(scene)) == 1e-8


def test_the_step_is_at_most_what_is_asked_and_in_the_provenance() -> None:
    scene = Scene(name="pair", duration=1e-4, mass=(1e-2, 1e-2), stiffness=(4e9,), velocity=(0.8, 0.0), samples=10)
    run = _solve(scene, 3e-8)
    # interval 1e-5 s: 334 steps a sample
    assert run.provenance["settings"]["dt"] == pytest.approx(1e-5 / 334, rel=4.0 * EPS)
    assert run.cost.steps == 3340


def test_one_step_a_sample_still_has_a_bar_that_holds() -> None:
    scene = Scene(name="pair", duration=1e-4, mass=(1e-2, 1e-2), stiffness=(4e9,), velocity=(0.8, 0.0), samples=1000)
    run, exact = _solve(scene, 1.0, uncertainty=True), db.solve(scene, backend="scipy", samples=1000)
    assert run.cost.steps == 1000
    assert np.max(np.abs(run.velocity - exact.velocity)) <= run.uncertainty["velocity"]
    # a finer twin instead of a coarser one: its difference times 2 is 3/2 of the error at order 2
    assert run.uncertainty["velocity"] <= 5.0 * np.max(np.abs(run.velocity - exact.velocity))


def test_a_large_step_within_stability_gives_a_finite_run_that_is_off_by_a_percent(decelerating: Truth) -> None:
    run = db.solve(decelerating.scene, backend="verlet", dt=1e-6, uncertainty=False)
    assert np.all(np.isfinite(run.displacement))
    # measured: 1.08 % of v0
    assert decelerating.error(run, "velocity") == pytest.approx(0.0108 * decelerating.v0, rel=0.01)


@pytest.mark.parametrize("dt", [1e-5, 1e-4])
def test_a_step_beyond_stability_is_a_broken_run_and_never_nan(decelerating: Truth, dt: float) -> None:
    with pytest.raises(RunBroken, match=rf"velocities are not finite; dt = {dt:g} s is beyond stability"):
        db.solve(decelerating.scene, backend="verlet", dt=dt, samples=10, uncertainty=False)


def test_more_steps_than_can_be_counted_are_refused() -> None:
    scene = Scene(name="pair", duration=1e-4, mass=(1e-2, 1e-2), stiffness=(4e9,), velocity=(0.8, 0.0), samples=10)
    # the smallest number that is a time step at all
    with pytest.raises(UsageError, match=r"dt = 1e-40 s needs 1e\+36 steps; allowed: up to 2e\+09"):
        _solve(scene, 1e-40)


def test_a_contact_made_of_round_off_is_no_crossing(solved: Solve) -> None:
    # touching bodies in free fall move alike; that their overlap is an ulp above zero is no collision
    scene = Scene(
        name="ghost",
        duration=3e-4,
        mass=(0.0017255358031763315, 0.07638728628910182, 0.002732011251263888, 0.027181962726174593, 0.001585748309),
        stiffness=(115744892.72787969, 113964307.63378143, 921377939.4945136, 683521232.3937557),
        velocity=(1.7904875203681332, 0.0, 0.0, 0.0, 0.0),
        gap=(2e-5, 0.0, 0.0, 0.0),
        gravity=-1000.0,
        samples=50,
    )
    run, exact = solved(scene, "verlet"), solved(scene, "scipy")
    np.testing.assert_array_equal(np.isnan(run.crossing_time), np.isnan(exact.crossing_time))
    real = ~np.isnan(exact.crossing_time)
    assert run.crossing_time[real] == pytest.approx(exact.crossing_time[real], rel=1e-4)
