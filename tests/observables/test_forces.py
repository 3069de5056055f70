"""Forces at the first maximum and uncertainties of forces, by hand."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from dem_bridge.observables.forces import first_peak_force
from dem_bridge.observables.interpolate import contact_motion
from dem_bridge.observables.traces import contact_force_uncertainty
from dem_bridge.scene.scene import Adhesion, Damping, Scene, Wall
from dem_bridge.trajectory.trajectory import UNKNOWN
from tests.conftest import Solve
from tests.helpers.fake_runs import free_flight, uncertain

#: two bodies between a wall and nothing, n = 2: forces are linear in overlaps
SPRINGS = Scene(
    name="springs",
    duration=1.0,
    mass=(1.0, 1.0),
    stiffness=(10.0,),
    exponent=2.0,
    velocity=(1.0, 2.0),
    gap=-4.0,
    wall_right=Wall(stiffness=7.0, gap=0.5, exponent=2.0),
)


def test_a_wall_is_a_body_at_rest() -> None:
    overlap, closing = contact_motion(SPRINGS, free_flight(bodies=2, contacts=2, samples=1))
    # displacements (0, 0) and (1, 2), velocities (1, 2)
    np.testing.assert_array_equal(overlap, [[4.0, -0.5], [3.0, 1.5]])
    np.testing.assert_array_equal(closing, [[-1.0, 2.0], [-1.0, 2.0]])


def test_forces_may_be_off_by_twice_the_uncertainty_of_positions_and_of_velocities() -> None:
    run = free_flight(bodies=2, contacts=2, samples=1, uncertainty=uncertain(displacement=0.01, velocity=0.1))
    # the wall's contact is open at the start and stays so within its uncertainty
    np.testing.assert_allclose(contact_force_uncertainty(SPRINGS, run), [[0.2, 0.0], [0.2, 0.14]], rtol=1e-12)
    damped = replace(SPRINGS, damping=Damping(law="dashpot", coefficient=3.0))
    np.testing.assert_allclose(contact_force_uncertainty(damped, run), [[0.8, 0.0], [0.8, 0.74]], rtol=1e-12)
    assert np.all(np.isinf(contact_force_uncertainty(None, run)))
    for lost in (UNKNOWN, uncertain(displacement=np.inf), uncertain(velocity=np.inf)):
        assert np.all(np.isinf(contact_force_uncertainty(SPRINGS, replace(run, uncertainty=lost))))


@pytest.mark.parametrize(
    ("overlap", "jumps"),
    [(-0.75, False), (-0.5, True), (0.0, True), (0.5, True), (math.nextafter(0.5, 1.0), False), (0.75, False)],
)
def test_adhesion_may_have_begun_or_not_within_twice_the_uncertainty_of_positions(overlap: float, jumps: bool) -> None:
    scene = Scene(
        name="sticky", duration=1.0, mass=(1.0, 1.0), stiffness=(10.0,), velocity=(1.0, 0.0),
        adhesion=Adhesion(law="dmt", pull_off=3.0),
    )  # fmt: skip
    x = np.array([[overlap, 0.0]])
    run = free_flight(bodies=2, contacts=1, samples=0, displacement=x, velocity=0.0 * x,
                      uncertainty=uncertain(displacement=0.25))  # fmt: skip
    # overlaps may be larger by 0.5 m; the part of the pull-off is on top
    elastic = 10.0 * (max(overlap + 0.5, 0.0) ** 1.5 - max(overlap, 0.0) ** 1.5)
    held = 3.0 * ((overlap + 0.5 > 0.0) != (overlap > 0.0))
    assert contact_force_uncertainty(scene, run)[0, 0] == pytest.approx(abs(elastic - held) + 3.0 * jumps, rel=1e-12)


def test_a_second_wave_does_not_change_the_first_peak(solved: Solve) -> None:
    # the light body between two heavy ones rattles, and a contact is pressed harder the second time
    scene = Scene(
        name="echo",
        duration=3e-4,
        mass=(1e-2, 2e-3, 1e-2),
        stiffness=(4e9, 4e9),
        velocity=(0.8, 0.0, 0.0),
        samples=3000,
    )
    run = solved(scene, "reference")
    force, bar = first_peak_force(scene, run)
    rows = [np.flatnonzero(np.diff(run.contact_force[:, k]) < 0.0)[0] for k in range(2)]
    expected = [run.contact_force[row, k] for k, row in enumerate(rows)]
    # the largest of samples 1e-7 s apart misses the peak by (omega h)^2/8 or less
    np.testing.assert_allclose(force, expected, rtol=1e-4)
    assert force[0] < 0.9 * run.peak_force[0] or force[1] < 0.9 * run.peak_force[1]
    assert np.all(bar < 1e-6 * force)


def test_a_theory_knows_one_wave_and_its_peak(solved: Solve) -> None:
    scene = Scene(name="pair", duration=1e-4, mass=(8e-3, 1e-2), stiffness=(4e9,), velocity=(0.8, 0.0), samples=4)
    theory = solved(scene, "bca")
    np.testing.assert_array_equal(first_peak_force(scene, theory)[0], theory.peak_force)
    assert first_peak_force(scene, theory)[0] == pytest.approx(solved(scene, "reference").peak_force, rel=1e-9)
