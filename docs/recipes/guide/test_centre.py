# tests/observables/test_centre.py
"""The centre of mass of bodies in free flight, by hand."""

from __future__ import annotations

import pytest

from dem_bridge.observables.centre import centre_of_mass, centre_of_mass_uncertainty
from dem_bridge.scene.scene import Scene
from tests.helpers.fake_runs import free_flight, uncertain

#: a second definition, by the momentum of the start, for the tests of all observables
SECOND = {
    "centre_of_mass": (lambda scene, run: run.time * scene.mass[0] * scene.velocity[0] / sum(scene.mass), 1e-12),
}
THREE = Scene(name="three", duration=1.0, mass=(2.0, 3.0, 5.0), stiffness=(7.0, 11.0), velocity=(1.0, 2.0, 3.0))


def test_it_moves_at_the_speed_of_the_momentum() -> None:
    run = free_flight(contacts=2, uncertainty=uncertain(displacement=1e-3))
    # momentum 2 + 6 + 15 over mass 10, at t = 0 and 1 s
    assert centre_of_mass(THREE, run)[[0, -1]] == pytest.approx([0.0, 2.3], rel=1e-15)
    assert centre_of_mass_uncertainty(THREE, run)[-1] == 1e-3
