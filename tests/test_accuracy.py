"""The observed order: fitted on log(dt), with its sign, its residual and the points it used."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dem_bridge.accuracy import observed_order
from tests.strategies import log_uniform

#: a fit of a handful of logarithms loses a few units of their last place, each below 50 in magnitude
ROUND_OFF = 1e-12


@given(
    order=st.floats(-4.0, 8.0),
    factor=log_uniform(1e-12, 1e6),
    steps=st.lists(log_uniform(1e-6, 1.0), min_size=2, max_size=8, unique=True).filter(lambda s: max(s) > 2 * min(s)),
)
def test_a_pure_power_gives_its_own_order_for_any_steps(order: float, factor: float, steps: list[float]) -> None:
    fit = observed_order(steps, [factor * h**order for h in steps])
    # the steps span at least a factor 2, so an error of the logarithms is magnified by at most 1/log(2)
    assert fit.order == pytest.approx(order, abs=10.0 * ROUND_OFF)
    assert fit.residual == pytest.approx(0.0, abs=10.0 * ROUND_OFF)
    assert fit.points == len(steps)


def test_errors_that_grow_under_refinement_have_a_negative_order() -> None:
    assert observed_order([9.0, 3.0, 1.0], [1.0, 3.0, 9.0]).order == pytest.approx(-1.0, abs=ROUND_OFF)


def test_the_residual_is_the_largest_factor_off_the_line() -> None:
    # off a straight line of order 2 by factors b, 1/b^2, b, even in log dt: the fit keeps the order and the mean
    b = 1.1
    fit = observed_order([4.0, 2.0, 1.0], [16.0 * b, 4.0 / b**2, 1.0 * b])
    assert fit.order == pytest.approx(2.0, abs=ROUND_OFF)
    assert fit.residual == pytest.approx(b**2 - 1.0, abs=ROUND_OFF)


def test_points_at_or_below_the_floor_are_left_out() -> None:
    dt = [8.0, 4.0, 2.0, 1.0]
    fit = observed_order(dt, [64.0, 16.0, 4.0, 3.9], floor=4.0)
    assert (fit.points, fit.order) == (2, pytest.approx(2.0, abs=ROUND_OFF))


@pytest.mark.parametrize("bad", [math.nan, math.inf, 0.0])
def test_errors_that_are_no_numbers_or_zero_are_left_out(bad: float) -> None:
    fit = observed_order([4.0, 2.0, 1.0], [16.0, bad, 1.0])
    assert (fit.points, fit.order) == (2, pytest.approx(2.0, abs=ROUND_OFF))


@pytest.mark.parametrize(
    ("dt", "error"), [([], []), ([1.0], [1.0]), ([1.0, 2.0], [0.0, 1.0]), ([2.0, 2.0], [1.0, 4.0])]
)
def test_an_order_that_cannot_be_had_is_not_invented(dt: list[float], error: list[float]) -> None:
    fit = observed_order(dt, error)
    assert math.isnan(fit.order)
    assert math.isnan(fit.residual)


def test_unequal_lengths_are_refused() -> None:
    with pytest.raises(ValueError, match="zip"):
        observed_order([1.0, 2.0], [1.0])
