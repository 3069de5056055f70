"""The error of a touch: Hurwitz' zeta function by its identities, and the coefficient by sums over steps."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dem_bridge.backends.blanes_moan import SRKN_6B
from dem_bridge.backends.splitting import Method
from dem_bridge.backends.twin import VERLET
from dem_bridge.physics.touch_error import hurwitz_zeta, touch_coefficient, touch_coefficients, touch_rms

PHASES = (0.0, 0.1, 0.5, 0.8)


@given(power=st.floats(0.1, 4.0), start=st.floats(0.0, 2.0))
def test_the_zeta_function_loses_one_term_per_unit(power: float, start: float) -> None:
    # sums of a dozen terms up to 14^4 in double precision
    assert hurwitz_zeta(power, start) == pytest.approx(start**power + hurwitz_zeta(power, start + 1.0), abs=1e-10)


@pytest.mark.parametrize("start", [0.0, 0.3, 1.0])
def test_for_whole_powers_it_is_a_bernoulli_polynomial(start: float) -> None:
    a = start
    polynomials = {1: a**2 - a + 1 / 6, 2: a**3 - 1.5 * a**2 + 0.5 * a, 3: a**4 - 2 * a**3 + a**2 - 1 / 30}
    for power, polynomial in polynomials.items():
        assert hurwitz_zeta(power, start) == pytest.approx(-polynomial / (power + 1), abs=1e-12)


#: Riemann's zeta function at -1/2, -3/2 and -5/2 (Abramowitz & Stegun 1964, table 23.3, and its functional equation)
RIEMANN = {0.5: -0.207886224977354566, 1.5: -0.025485201889833036, 2.5: 0.008516928777850330}


@pytest.mark.parametrize("power", RIEMANN)
def test_for_half_powers_it_is_riemanns(power: float) -> None:
    # at 1/2 the multiplication theorem; sums of a dozen terms up to 12^3.5 / 3.5
    expected = [RIEMANN[power], RIEMANN[power], (2.0**-power - 1.0) * RIEMANN[power]]
    assert hurwitz_zeta(power, [0.0, 1.0, 0.5]) == pytest.approx(expected, abs=8.0 * 2.2e-16 * 12.5 ** (power + 1.0))


@pytest.mark.parametrize(("exponent", "zeta"), [(2.0, np.pi**4 / 90), (3.0, np.pi**6 / 945), (2.5, 1.036927755143370)])
def test_the_mean_square_of_velocity_verlet_is_a_zeta_function(exponent: float, zeta: float) -> None:
    expected = math.sqrt(2.0 * zeta) * math.gamma(exponent) / (2.0 * math.pi) ** exponent
    # the series has 200 terms: 200^-3/3 is left for n = 2
    assert touch_rms(*VERLET, exponent=exponent) == pytest.approx(expected, rel=2.5e-8)


@pytest.mark.parametrize(("power", "exponent"), [(0.0, 1.0), (-1.0, 0.5)])
def test_powers_are_positive(power: float, exponent: float) -> None:
    with pytest.raises(ValueError, match=r"^power = .*; allowed: a finite number > 0"):
        hurwitz_zeta(power, 1.0)
    with pytest.raises(ValueError, match=r"^exponent = .*; allowed: a finite number > 1"):
        touch_coefficients(*VERLET, exponent=exponent, phase=[0.0])


def _sum_error(method: Method, exponent: float, phase: float, step: float) -> float:
    """Error of the method's sum of t^(n-1) exp(-t) from t = 0 at the phase of a step, over step^n."""
    nodes = np.concatenate([[0.0], np.cumsum(method.drifts)])
    t = step * (np.arange(round(50.0 / step))[:, None] + nodes - phase)
    values = np.where(t > 0.0, np.maximum(t, 0.0) ** (exponent - 1.0) * np.exp(-np.maximum(t, 0.0)), 0.0)
    return (step * float(np.sum(values @ method.kicks)) - math.gamma(exponent)) / float(step**exponent)


@pytest.mark.parametrize("method", [VERLET, SRKN_6B], ids=["verlet", "blanes-moan"])
@pytest.mark.parametrize("exponent", [2.0, 2.5, 3.5])
def test_the_coefficient_is_that_of_sums_over_steps(method: Method, exponent: float) -> None:
    step = 4e-3
    expected, following = (
        np.array([touch_coefficient(*method, exponent=n, phase=phase) for phase in PHASES])
        for n in (exponent, exponent + 1.0)
    )
    sums = [_sum_error(method, exponent, phase, step) for phase in PHASES]
    # the second term of exp(-t) has the coefficient of the next power; the third, h^2/2 zeta of order 1, and round-off
    # (1e-15 / step^3.5 = 2e-7) are below 1e-6
    np.testing.assert_allclose(sums, expected - step * following, rtol=0.0, atol=1e-6)
    # planted: the next power in place of this one
    assert np.max(np.abs(sums - following)) > 1e-4


@pytest.mark.parametrize("exponent", [2.0, 2.5, 3.0, 3.5])
def test_its_mean_over_all_places_of_the_touch_is_zero(exponent: float) -> None:
    phases = (np.arange(500) + 0.5) / 500
    values = [touch_coefficient(*SRKN_6B, exponent=exponent, phase=phase) for phase in phases.tolist()]
    # midpoint rule with kinks at the nodes: errors of 500^-2
    assert abs(np.mean(values)) < 4e-6 < 1e-2 * np.max(np.abs(values))


def test_on_the_step_grid_it_vanishes_for_whole_exponents_below_the_order_alone() -> None:
    values = {n: abs(touch_coefficient(*SRKN_6B, exponent=n, phase=0.0)) for n in (2.0, 2.5, 3.0, 3.5)}
    assert max(values[2.0], values[3.0]) < 1e-12
    assert values[2.5] > 3e-4
    assert values[3.5] > 6e-5


@pytest.mark.parametrize("method", [VERLET, SRKN_6B], ids=["verlet", "blanes-moan"])
@pytest.mark.parametrize("exponent", [2.0, 2.5, 3.0])
def test_the_fourier_series_has_its_mean_square(method: Method, exponent: float) -> None:
    values = touch_coefficients(*method, exponent=exponent, phase=(np.arange(4000) + 0.5) / 4000)
    assert np.std(values) == pytest.approx(touch_rms(*method, exponent=exponent), rel=1e-4)  # midpoint rule with kinks
    # planted: the places of the kicks as those of equal drifts
    equal = Method(drifts=np.full(len(method.drifts), 1.0 / len(method.drifts)), kicks=method.kicks[::-1] ** 2)
    assert touch_rms(*equal, exponent=exponent) != pytest.approx(np.std(values), rel=1e-2)
