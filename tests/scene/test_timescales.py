"""The times of a scene, from its bodies and its contacts.

The Rayleigh time, against Rayleigh's own cubic for the speed of the surface wave.
"""

from __future__ import annotations

import math
import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dem_bridge.scene.file import load_scene
from dem_bridge.scene.geometry import Body, Geometry, Material
from dem_bridge.scene.scene import Scene, Wall
from dem_bridge.scene.timescales import contact_time_of, rayleigh_time, rayleigh_time_of
from tests.helpers.strategies import log_uniform

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


def _surface_over_shear(poisson: float) -> float:
    """The root x = (c_R/c_S)^2 in (0, 1) of Rayleigh's cubic x^3 - 8 x^2 + (24 - 16 e) x - 16 (1 - e) = 0."""
    e = (1.0 - 2.0 * poisson) / (2.0 * (1.0 - poisson))
    roots = np.roots([1.0, -8.0, 24.0 - 16.0 * e, -16.0 * (1.0 - e)])
    return math.sqrt(min(float(x.real) for x in roots if abs(x.imag) < 1e-9 and 0.0 < x.real < 1.0))


@given(radius=log_uniform(1e-6, 1.0), density=log_uniform(1e2, 2e4), modulus=log_uniform(1e5, 1e12),
       poisson=st.floats(0.0, 0.49))  # fmt: skip
def test_it_is_half_way_round_at_the_speed_of_the_surface_wave(
    radius: float, density: float, modulus: float, poisson: float
) -> None:
    around = math.pi * radius / (math.sqrt(modulus / density) * _surface_over_shear(poisson))
    # the line in nu stands for the cubic: 0.3 % between nu = 0 and 0.5
    assert rayleigh_time(radius=radius, density=density, modulus=modulus, poisson=poisson) == pytest.approx(
        around, rel=3.1e-3
    )


@pytest.mark.parametrize(("poisson", "ratio"), [(0.0, 0.8766), (0.5, 0.95815), (-0.5, 0.79505), (0.17, 0.904327)])
def test_it_is_by_the_printed_line_in_poissons_ratio(poisson: float, ratio: float) -> None:
    # a wave of 2 m/s around half of a sphere of 3 m; 0.1631 nu + 0.8766 is written out
    found = rayleigh_time(radius=3.0, density=2.0, modulus=8.0, poisson=poisson)
    assert found == pytest.approx(3.0 * math.pi / (2.0 * ratio), rel=1e-14)


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"radius": 0.0}, "radius = 0.0; allowed: a finite number > 0 (m)"),
        ({"density": -1.0}, "density = -1.0; allowed: a finite number > 0 (kg/m^3)"),
        ({"modulus": math.inf}, "modulus = inf; allowed: a finite number > 0 (Pa)"),
        ({"poisson": 0.6}, "poisson = 0.6; allowed: a number above -1 and up to 0.5"),
    ],
)
def test_what_no_body_has_is_said_in_a_line(changed: dict[str, float], said: str) -> None:
    quartz = {"radius": 9e-3, "density": 2200.0, "modulus": 3.08e10, "poisson": 0.17}
    with pytest.raises(ValueError, match=f"^{re.escape(said)}$"):
        rayleigh_time(**{**quartz, **changed})
