"""The Rayleigh time, against Rayleigh's own cubic for the speed of the surface wave."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dem_bridge.physics.rayleigh import rayleigh_time
from tests.helpers.strategies import log_uniform


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
