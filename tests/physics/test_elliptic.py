"""Complete elliptic integrals of an ellipse against Carlson's, by scipy, and their definition by quadrature."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from scipy.integrate import quad
from scipy.special import elliprd

from dem_bridge.physics.elliptic import ellipse_integrals
from tests.helpers.strategies import log_uniform

EPS = 2.0**-52


@given(ratio=log_uniform(1e-12, 1e3))
def test_they_are_carlsons_integrals(ratio: float) -> None:
    squared = ratio * ratio  # Carlson (1979), *Numer. Math.* 33, eq. 4.6; DLMF 19.25.1
    expected = squared * elliprd(0.0, 1.0, squared) / 3.0, elliprd(0.0, squared, 1.0) / 3.0
    # ten steps of the mean, and b = K - d of K = ln(4/k) = 29 b at the line: measured 74 eps there
    assert ellipse_integrals(ratio) == pytest.approx(expected, rel=(16.0 + 4.0 * abs(math.log(ratio))) * EPS)


@pytest.mark.parametrize("distance", [0.0, 1e-16, 1e-12, 1e-8, 1e-4])
def test_no_digit_is_lost_next_to_the_circle(distance: float) -> None:
    ratio = 1.0 - distance
    squared = ratio * ratio
    expected = squared * elliprd(0.0, 1.0, squared) / 3.0, elliprd(0.0, squared, 1.0) / 3.0
    assert ellipse_integrals(ratio) == pytest.approx(expected, rel=8.0 * EPS)


@pytest.mark.parametrize("ratio", [0.01, 0.3, 0.9, 1.0, 2.0])
def test_they_are_the_integrals_of_their_definition(ratio: float) -> None:
    def part(numerator: float, angle: float) -> float:
        return numerator / math.hypot(math.cos(angle), ratio * math.sin(angle))

    of_cosine = quad(lambda angle: part(math.cos(angle) ** 2, angle), 0.0, 0.5 * math.pi, epsrel=1e-13)[0]
    of_sine = quad(lambda angle: part(math.sin(angle) ** 2, angle), 0.0, 0.5 * math.pi, epsrel=1e-13)[0]
    assert ellipse_integrals(ratio) == pytest.approx((of_cosine, of_sine), rel=1e-12)
