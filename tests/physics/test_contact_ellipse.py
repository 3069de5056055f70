"""Elliptic integrals against Carlson's, by scipy, and by quadrature; the paper's stiffness in 60 digits."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.special import ellipe, ellipk, elliprd

from dem_bridge.physics.contact_ellipse import axis_ratio_paper, cylinder_stiffness_paper, ellipse_integrals
from tests.helpers.high_precision import cylinder_stiffness
from tests.helpers.strategies import log_uniform

EPS = 2.0**-52
QUARTZ = {"radius": 9e-3, "young": 72e9, "poisson": 0.17}


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


def test_stiffness_at_2_degrees_is_that_of_the_paper() -> None:
    # the printed 12 digits of PHYSICS.md: half a unit of the last
    assert cylinder_stiffness_paper(2.0, **QUARTZ) == pytest.approx(7.27299328384e10, abs=0.5e-1)


def test_stiffness_at_90_degrees_is_the_limit_of_two_spheres() -> None:
    found = cylinder_stiffness_paper(90.0, **QUARTZ)
    assert found == pytest.approx(4.689197642511e9, abs=0.5e-3)  # the printed 13 digits
    # all elliptic integrals are elementary there; three roundings a square root
    limit = 2.0 * 72e9 * math.sqrt(9e-3) / (3.0 * (1.0 - 0.17**2))
    assert found == pytest.approx(limit, rel=8.0 * EPS)


@pytest.mark.parametrize(
    "angle", [1e-3, 0.01, 0.1, 0.5, 1.0, 2.0, 5.0, 17.3, 30.0, 45.0, 60.0, 77.7, 85.0, 89.0, 89.99]
)
def test_stiffness_agrees_with_the_printed_formula_in_60_digits(angle: float) -> None:
    # tan^(4/3), two Carlson integrals and a handful of roots, an ulp or two each
    expected = cylinder_stiffness(angle, **QUARTZ)
    assert cylinder_stiffness_paper(angle, **QUARTZ) == pytest.approx(expected, rel=20.0 * EPS)


@given(
    angle=st.floats(5.0, 85.0),
    radius=log_uniform(1e-4, 1.0),
    young=log_uniform(1e6, 1e12),
    poisson=st.floats(-0.5, 0.5),
)
def test_stiffness_agrees_with_legendres_integrals_where_those_do_not_cancel(
    angle: float, radius: float, young: float, poisson: float
) -> None:
    cos = math.cos(math.radians(angle))
    ratio = ((1.0 + cos) / (1.0 - cos)) ** (-2.0 / 3.0)
    squared = 1.0 - ratio**2  # scipy takes the parameter m = e^2
    k, e = ellipk(squared), ellipe(squared)
    braces = 4.0 / (math.pi * squared) * math.sqrt((e / ratio**2 - k) * (k - e))
    modulus = 2.0 * young / (3.0 * (1.0 - poisson**2))
    expected = (
        modulus * math.sqrt(radius / math.sin(math.radians(angle))) * (2.0 * k / math.pi) ** -1.5 * math.sqrt(braces)
    )
    # at 85 degrees e^2 = 0.2 and both differences are about e^2 / 4 of their terms: a factor 20 on a few ulps
    found = cylinder_stiffness_paper(angle, radius=radius, young=young, poisson=poisson)
    assert found == pytest.approx(expected, rel=20.0 * 10.0 * EPS)


def test_stiffness_falls_with_the_angle_and_stays_finite_down_to_a_thousandth_of_a_degree() -> None:
    angles = np.concatenate([np.geomspace(1e-3, 1.0, 60), np.linspace(1.0, 90.0, 400)[1:]])
    found = np.array([cylinder_stiffness_paper(angle, **QUARTZ) for angle in angles])
    assert np.all(np.isfinite(found))
    # next to 90 degrees it is flat to second order: steps of 0.2 degrees change it by 1e-6 of itself, far above an ulp
    assert np.all(np.diff(found) < 0.0)


def test_one_ulp_below_90_degrees_nothing_jumps() -> None:
    beside = cylinder_stiffness_paper(math.nextafter(90.0, 0.0), **QUARTZ)
    assert beside == pytest.approx(cylinder_stiffness_paper(90.0, **QUARTZ), rel=8.0 * EPS)


def test_the_axis_ratio_is_the_printed_quotient_of_cosines() -> None:
    for angle in np.linspace(5.0, 85.0, 33):
        cos = math.cos(math.radians(angle))
        # 1 - cos loses a factor 260 at 5 degrees, raised to 2/3
        assert axis_ratio_paper(angle) == pytest.approx(((1 + cos) / (1 - cos)) ** (-2.0 / 3.0), rel=300.0 * EPS)


@pytest.mark.parametrize("angle", [0.0, -2.0, 90.0001, math.inf, math.nan])
def test_angles_that_no_two_cylinders_have_are_refused_with_the_value(angle: float) -> None:
    with pytest.raises(ValueError, match=rf"contact angle = {angle!r} degrees; allowed: 0 < angle <= 90"):
        cylinder_stiffness_paper(angle, **QUARTZ)
