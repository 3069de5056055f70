"""The times of a scene, from its bodies and its contacts."""

from __future__ import annotations

from dataclasses import replace

import pytest

from dem_bridge.physics.rayleigh import rayleigh_time
from dem_bridge.scene.file import load_scene
from dem_bridge.scene.geometry import Body, Geometry, Material
from dem_bridge.scene.scene import Scene, Wall
from dem_bridge.scene.timescales import contact_time_of, rayleigh_time_of

PAIR = Scene(name="pair", duration=1e-3, mass=(8.1e-3, 1.0077e-2), stiffness=(3.98e9,), velocity=(0.8, 0.0))


def test_the_smallest_body_decides_of_several() -> None:
    tapered = load_scene("tapered-forward")
    smallest = 9e-3 * 0.98**39
    expected = rayleigh_time(radius=smallest, density=2200.0, modulus=72e9 / 2.34, poisson=0.17)
    # radii by forty multiplications
    assert rayleigh_time_of(tapered) == pytest.approx(expected, rel=1e-14)


def test_the_softer_material_is_slower() -> None:
    quartz = Material(youngs_modulus=72e9, poissons_ratio=0.17, density=2200.0)
    steel = Material(youngs_modulus=210e9, poissons_ratio=0.3, density=7850.0)
    both = (Body(shape="sphere", radius=9e-3, material=m) for m in (quartz, steel))
    times = [rayleigh_time_of(replace(PAIR, geometry=Geometry(bodies=(body, body)))) for body in both]
    mixed = Geometry(bodies=tuple(Body(shape="sphere", radius=9e-3, material=m) for m in (quartz, steel)))
    assert None not in times
    assert rayleigh_time_of(replace(PAIR, geometry=mixed)) == min(t for t in times if t is not None)


def test_masses_and_stiffnesses_alone_have_no_rayleigh_time() -> None:
    assert rayleigh_time_of(PAIR) is None


def test_the_contact_time_is_that_of_two_bodies() -> None:
    # the truth's own pair: 5.596816463565898e-05 s with a mass of 1.00770...e-2 kg, here rounded to five digits;
    # the time goes as the reduced mass to the power 2/5
    assert contact_time_of(PAIR) == pytest.approx(5.5968e-5, rel=1e-4)


def test_the_stiffest_contact_decides_and_a_wall_is_one() -> None:
    walled = replace(PAIR, wall_right=Wall(stiffness=7e10))
    alone = Scene(name="alone", duration=1e-3, mass=(1.0077e-2,), stiffness=(), velocity=(0.8,),
                  wall_right=Wall(stiffness=7e10))  # fmt: skip
    assert contact_time_of(walled) == contact_time_of(alone)


def test_what_is_at_rest_has_no_contact_time() -> None:
    assert contact_time_of(replace(PAIR, velocity=(0.0, 0.0))) is None


def test_the_fastest_body_decides_in_whichever_direction_it_moves() -> None:
    for velocity in ((0.1, -0.8), (0.8, 0.1), (-0.8, 0.8)):
        assert contact_time_of(replace(PAIR, velocity=velocity)) == contact_time_of(PAIR)
