"""Momentum and energy: against sums written out by hand, and constant where nothing dissipates.

Drift of a long run: bars that hold for swings and for walks, and a swing that is known from the step.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from numpy.typing import NDArray
from scipy.stats import linregress

import dem_bridge as db
from dem_bridge.backends.twin import solve_plan
from dem_bridge.errors import UsageError
from dem_bridge.observables.conserved import (
    drift_of,
    energy,
    energy_parts,
    energy_uncertainty,
    measure_energy,
    measure_energy_less_work,
    measure_momentum,
    momentum,
    momentum_uncertainty,
    swing_of,
    work,
)
from dem_bridge.scene.scene import Damping, Scene, Wall
from dem_bridge.trajectory.dense import Schedule
from dem_bridge.trajectory.trajectory import UNKNOWN, Trajectory
from tests.conftest import Solve
from tests.helpers.driven_chains import DRIVES, PRESSED, SINE, TOUCHING, driven, free_body
from tests.helpers.fake_runs import free_flight, uncertain
from tests.helpers.quadruple_truth import Truth
from tests.helpers.strategies import examples, scenes

EPS = float(np.finfo(float).eps)

THREE = Scene(
    name="three",
    duration=1.0,
    mass=(2.0, 3.0, 5.0),
    stiffness=(7.0, 11.0),
    velocity=(1.0, 2.0, 3.0),
    exponent=(2.5, 2.0),
    gap=(-0.25, 0.0),
    wall_left=Wall(stiffness=13.0, gap=-1.0, exponent=3.0),
    wall_right=Wall(stiffness=17.0, gap=2.0, exponent=2.0),
    gravity=10.0,
)


def test_momentum_is_the_sum_of_mass_times_velocity() -> None:
    assert momentum(THREE, free_flight(contacts=4)).tolist() == [2.0 + 6.0 + 15.0] * 5


def test_energy_is_kinetic_stored_and_of_position() -> None:
    # displacements at t = 0 and t = 1: (0, 0, 0) and (1, 2, 3)
    found = energy(THREE, free_flight(contacts=4))
    kinetic = 0.5 * (2.0 * 1.0 + 3.0 * 4.0 + 5.0 * 9.0)
    start = kinetic + 7.0 * 0.25**2.5 / 2.5 + 13.0 * 1.0 / 3.0
    # all contacts of the chain are open at the end; the right wall is pressed by 3 - 2, the left one touches no more
    end = kinetic + 17.0 * 1.0**2 / 2.0 - 10.0 * (2.0 * 1.0 + 3.0 * 2.0 + 5.0 * 3.0)
    assert found[0] == pytest.approx(start, rel=8.0 * EPS)
    assert found[-1] == pytest.approx(end, rel=8.0 * EPS)


def test_a_load_has_the_potential_of_its_work() -> None:
    # displacements at the end: (1, 2, 3); all contacts start pressed by 8 N
    scene = replace(THREE, gap=0.0, wall_left=Wall(stiffness=1.0, exponent=2.0), wall_right=None, gravity=0.0,
                    exponent=2.0, stiffness=(1.0, 1.0), precompression=8.0)  # fmt: skip
    kinetic, stored, potential = energy_parts(scene, free_flight(contacts=3))
    assert (stored[0], potential[0]) == (3 * 0.5 * 8.0**2, 0.0)
    # the wall's contact is less deep by 1, those of the chain by 1 each; the load on body 2 points to body 1
    assert (stored[-1], potential[-1]) == (3 * 0.5 * 7.0**2, 8.0 * 3.0)
    assert np.all(kinetic == kinetic[0])


def test_energy_of_the_truth_is_constant_to_the_last_digits(free_chain: Truth) -> None:
    data = free_chain.data
    rows = len(data["t"]) + 1
    start = np.array(free_chain.scene.velocity)
    exact = free_flight(
        bodies=41,
        contacts=40,
        samples=500,
        displacement=np.vstack([np.zeros(41), data["x"]]),
        velocity=np.vstack([start, data["v"]]),
        contact_force=np.zeros((rows, 40)),
    )
    found = energy(free_chain.scene, exact)
    # displacements of 2 mm lose 3 digits in overlaps of 2 um
    assert found == pytest.approx(np.full(rows, 0.5 * 8.1e-3 * 0.8**2), rel=1e4 * EPS)
    assert momentum(free_chain.scene, exact) == pytest.approx(np.full(rows, 8.1e-3 * 0.8), rel=41 * EPS)


@examples(20)
@given(scene=scenes(bodies=(1, 5), walls=True, gravity=True))
def test_energy_does_not_change_when_all_is_seen_in_a_mirror(scene: Scene) -> None:
    run = db.solve(scene, backend="verlet", dt=2.5e-7, uncertainty=False)
    mirrored = replace(
        scene,
        mass=scene.mass[::-1],
        stiffness=scene.stiffness[::-1],
        gap=tuple(scene.contacts.gap[: scene.n_body - 1][::-1].tolist()),
        velocity=tuple(-v for v in scene.velocity[::-1]),
        wall_left=scene.wall_right,
        wall_right=scene.wall_left,
        gravity=-scene.gravity,
    )
    image = replace(run, velocity=-run.velocity[:, ::-1], displacement=-run.displacement[:, ::-1])
    size = float(np.max(np.abs(energy(scene, run)))) + abs(scene.gravity) * sum(scene.mass) * 1e-3
    # another order of the same sums
    assert energy(mirrored, image) == pytest.approx(energy(scene, run), abs=100 * EPS * size)


@pytest.mark.lammps
def test_lammps_conserves_momentum_to_the_last_digits(free_chain: Truth, solved: Solve) -> None:
    scene = free_chain.scene
    total = momentum(scene, solved(scene, "lammps-granular", dt=1e-8))
    # 3e5 steps of 40 contacts that round at random: sqrt of their number
    assert total == pytest.approx(np.full(501, 8.1e-3 * 0.8), rel=40 * EPS * np.sqrt(3e5))


# work


def test_the_work_on_a_free_body_is_its_kinetic_energy() -> None:
    scene = free_body(replace(SINE, rise=0.0))
    run = db.solve(scene, backend="scipy", uncertainty=False)
    kinetic = energy_parts(scene, run)[0]
    done, unknown = work(scene, run)
    # 2.6e-8 (omega h)^12 with omega h = 0.2 is far below the run's own 1e-12
    assert np.max(np.abs(done - kinetic)) < 1e-11 * np.max(kinetic)
    assert unknown < 1e-4 * np.max(kinetic)


@pytest.mark.parametrize("shape", DRIVES)
@pytest.mark.parametrize("scene", [TOUCHING, PRESSED], ids=lambda one: one.name)
def test_energy_less_work_is_constant_within_what_the_work_is_known_to(scene: Scene, shape: str) -> None:
    scene = driven(scene, shape)
    run = db.solve(scene, backend="scipy", uncertainty=False)
    done, unknown = work(scene, run)
    balance, moved = energy(scene, run) - done, float(np.max(energy_parts(scene, run)[0] + np.abs(done)))
    # the run has 1e-10 of its velocities and more
    assert np.max(np.abs(balance - balance[0])) <= unknown + 1e-10 * moved
    assert unknown < 1e-5 * moved
    # planted: no work at all, and that of a drive 1 % too strong
    assert np.max(np.abs(energy(scene, run) - balance[0])) > 0.1 * moved
    assert scene.drive is not None
    wrong = energy(scene, run) - work(replace(scene, drive=scene.drive.times(1.01)), run)[0]
    assert np.max(np.abs(wrong - wrong[0])) > 1e-3 * moved


def test_without_a_drive_no_work_is_done() -> None:
    done, unknown = work(replace(TOUCHING, drive=None), free_flight(bodies=4, contacts=3))
    assert (done.tolist(), unknown) == ([0.0] * 5, 0.0)


def test_what_is_conserved() -> None:
    assert (PRESSED.conserves_energy, PRESSED.conserves_momentum) == (False, False)
    still = replace(PRESSED, drive=None)
    assert (still.conserves_energy, still.conserves_momentum) == (True, True)
    for changes, expected in (
        ({"wall_left": Wall(stiffness=1e9)}, (True, False)), ({"wall_right": Wall(stiffness=1e9)}, (True, False)),
        ({"gravity": 1.0}, (True, False)), ({"drag": 1.0}, (False, False)),
        ({"damping": Damping(law="dashpot", coefficient=1.0)}, (False, True)),
        ({"damping": Damping(law="dashpot", coefficient=0.0)}, (True, True)),
    ):  # fmt: skip
        scene = replace(still, **changes)
        assert (scene.conserves_energy, scene.conserves_momentum) == expected, changes


def test_uncertainties_are_those_of_all_velocities_and_displacements_together() -> None:
    run = free_flight(contacts=4, samples=1, uncertainty=uncertain(velocity=0.1, displacement=0.01))
    np.testing.assert_allclose(momentum_uncertainty(THREE, run), 10.0 * 0.1, rtol=1e-12)
    moving = 0.1 * (2.0 * 1.0 + 3.0 * 2.0 + 5.0 * 3.0)
    weight = 10.0 * 10.0
    # at the start contact 0, with both bodies, and the left wall's, with one; at the end the right wall's
    start, end = 2.0 * 7.0 * 0.25**1.5 + 13.0 * 1.0**2, 17.0 * 1.0
    expected = [moving + 0.01 * (weight + force) for force in (start, end)]
    np.testing.assert_allclose(energy_uncertainty(THREE, run), expected, rtol=1e-12)
    assert np.all(np.isinf(energy_uncertainty(THREE, replace(run, uncertainty=UNKNOWN))))


def test_what_is_conserved_is_measured_in_one_pass_with_its_scale_by_hand() -> None:
    run = free_flight(contacts=4, samples=1, uncertainty=uncertain(velocity=0.1, displacement=0.01))
    found = measure_momentum(THREE, run)
    np.testing.assert_array_equal(found[0], momentum(THREE, run))
    np.testing.assert_array_equal(found[1], momentum_uncertainty(THREE, run))
    assert found[2] == (2.0 + 3.0 + 5.0) * 3.0
    done, unknown = work(THREE, run)
    kinetic, stored, potential = energy_parts(THREE, run)
    for measured, less, scale in (
        (measure_energy(THREE, run), 0.0, np.max(kinetic + stored + np.abs(potential))),
        (measure_energy_less_work(THREE, run), done, np.max(kinetic + np.abs(done))),
    ):
        np.testing.assert_array_equal(measured[0], energy(THREE, run) - less)
        np.testing.assert_array_equal(measured[1], energy_uncertainty(THREE, run) + unknown)
        assert measured[2] == pytest.approx(scale, rel=1e-14)


Floats = NDArray[np.float64]
TIME = np.linspace(0.0, 2.0, 2001)
#: series without a drift, of about the same size
SERIES: dict[str, Callable[[np.random.Generator], Floats]] = {
    "noise": lambda rng: rng.standard_normal(len(TIME)),
    "walk": lambda rng: np.cumsum(rng.standard_normal(len(TIME))) / np.sqrt(len(TIME)),
    "swing": lambda rng: np.sin(50.0 * TIME + rng.uniform(0.0, 6.0)),
}


@pytest.mark.parametrize("kind", SERIES)
def test_bars_hold_for_swings_and_for_walks(kind: str) -> None:
    rng, slope = np.random.default_rng(6), 0.3
    found = [drift_of(TIME, slope * TIME + SERIES[kind](rng)) for _ in range(300)]
    inside = np.mean([abs(one.slope - slope) <= one.bar for one in found])
    # 95 %; of 300 such drawings, fewer than 91 % are inside once in a thousand
    assert inside >= 0.91


def test_a_bar_that_took_a_walk_for_noise_would_not_hold() -> None:
    """What a least-squares fit says of its own slope is many times too small on a walk."""
    rng = np.random.default_rng(7)
    found = [drift_of(TIME, SERIES["walk"](rng)) for _ in range(300)]
    assert np.mean([abs(one.slope) <= 2.1 * one.swing for one in found]) < 0.8
    assert np.mean([abs(one.slope) <= one.bar for one in found]) > 0.91


@pytest.mark.parametrize("kind", SERIES)
def test_a_drift_above_its_bar_is_found(kind: str) -> None:
    quiet = drift_of(TIME, SERIES[kind](np.random.default_rng(8)))
    for sign in (-1.0, 1.0):
        loud = drift_of(TIME, SERIES[kind](np.random.default_rng(8)) + sign * 3.0 * quiet.bar * TIME)
        assert loud.found
        # the fit is linear in the series
        assert loud.slope == pytest.approx(quiet.slope + sign * 3.0 * quiet.bar, rel=1e-9)
        assert loud.bar == pytest.approx(quiet.bar, rel=0.5)


def test_slope_and_standard_errors_are_those_of_a_line_through_the_means_of_twenty_blocks() -> None:
    # two samples a block; block means by hand, and a regression that shares nothing with the code
    time = 5.0 + 0.5 * np.arange(40.0)
    series = 3.0 + 0.2 * time + np.random.default_rng(11).standard_normal(40)
    found = drift_of(time, series)
    when, means = time.reshape(20, 2).mean(axis=1), series.reshape(20, 2).mean(axis=1)
    line = linregress(when, means)
    assert (found.slope, found.swing) == pytest.approx((line.slope, line.stderr), rel=1e-10)
    # a walk: 19 steps from block to block, of which a mean sees 2/3 of the variance, and a line 6/5
    steps = means[1:] - means[:-1]
    variance = np.sum((steps - np.mean(steps)) ** 2) / 18.0
    assert found.walk == pytest.approx(np.sqrt(6 / 5 * 3 / 2 * 19.0 * variance) / 19.0, rel=1e-10)
    # Student's t of 18 degrees of freedom leaves 2.5 % on each side
    assert found.bar == pytest.approx(2.10092204024 * max(found.walk, found.swing), rel=1e-10)
    assert found.duration == 19.5
    assert found.total == pytest.approx((19.5 * found.slope, 19.5 * found.bar), rel=1e-15)
    assert found.found == (abs(found.slope) > found.bar)
    assert not replace(found, slope=-found.bar).found
    assert replace(found, slope=-1.0001 * found.bar).found
    with pytest.raises(UsageError, match=r"^39 samples of a series; allowed: at least 40,"):
        drift_of(time[:39], series[:39])


def test_too_short_a_series_has_no_drift() -> None:
    with pytest.raises(UsageError, match="30 samples of a series; allowed: at least 40"):
        drift_of(TIME[:30], TIME[:30])


def held(exponent: float) -> Scene:
    wall = Wall(stiffness=1e6 if exponent == 2.0 else 4e9)
    return Scene(name="held", duration=0.02, mass=(1e-2,) * 4, stiffness=(wall.stiffness,) * 3, exponent=exponent,
                 velocity=(0.01, 0.0, 0.0, 0.0), wall_left=wall, wall_right=wall, precompression=10.0)  # fmt: skip


def run(scene: Scene, dt: float) -> Trajectory:
    count = round(scene.duration / dt)
    return solve_plan(scene, Schedule(step=dt, per_sample=1, subdivisions=1, samples=count))


@pytest.mark.parametrize("exponent", [2.0, 2.5])
def test_what_velocity_verlet_conserves_is_known_to_fourth_order(exponent: float) -> None:
    """No contact opens here, so that the law is smooth."""
    scene = held(exponent)
    found: dict[float, tuple[float, float, float]] = {}
    for dt in (4e-6, 2e-6):
        one = run(scene, dt)
        total = energy(scene, one)
        kept = total + swing_of(scene, one, dt)
        found[dt] = (
            float(np.ptp(total)),
            float(np.ptp(kept)),
            float(np.ptp(total - swing_of(scene, one, dt))),
        )
    (swing, left, wrong), (half_swing, half_left, _) = found.values()
    # second and fourth order; what is left is of two orders more, 3 % at these steps
    assert swing / half_swing == pytest.approx(4.0, rel=0.05)
    assert left / half_left == pytest.approx(16.0, rel=0.1)
    assert left < 0.05 * swing
    # planted: of the wrong sign it is twice the swing
    assert wrong == pytest.approx(2.0 * swing, rel=0.1)


def test_a_code_that_loses_energy_is_told_from_one_that_does_not() -> None:
    scene = held(2.5)
    drag = 0.02
    for one, lost in ((scene, 0.0), (replace(scene, drag=drag), drag)):
        motion = run(one, 4e-6)
        kinetic, _, _ = energy_parts(one, motion)
        kept = energy(one, motion) + swing_of(one, motion, 4e-6)
        found = drift_of(motion.time, kept)
        # the power of the drag is -b m v^2
        expected = -2.0 * lost * float(np.mean(kinetic))
        assert abs(found.slope - expected) <= 2.0 * found.bar + 0.05 * abs(expected)
        assert found.found == (lost > 0.0)
