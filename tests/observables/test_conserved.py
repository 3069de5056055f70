"""Momentum and energy: against sums written out by hand, and constant where nothing dissipates."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given

import dem_bridge as db
from dem_bridge.observables.conserved import (
    energy,
    energy_parts,
    energy_uncertainty,
    measure_energy,
    measure_energy_less_work,
    measure_momentum,
    momentum,
    momentum_uncertainty,
    work,
)
from dem_bridge.scene.scene import Damping, Scene, Wall
from dem_bridge.trajectory.trajectory import UNKNOWN
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
