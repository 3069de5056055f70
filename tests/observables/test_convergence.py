"""The observed order with all it rests on; extrapolation that is refused where it is not earned; the GCI."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

import dem_bridge as db
from dem_bridge.errors import NotAsymptotic, UsageError
from dem_bridge.observables import convergence
from dem_bridge.observables.convergence import (
    FINEST_ACCURACY,
    MOST_ORDER,
    checked_accuracy,
    grid_convergence_index,
    observed_order,
    richardson,
)
from tests.helpers.quadruple_truth import Truth
from tests.helpers.strategies import log_uniform

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
    with pytest.raises(ValueError, match="allowed: as many finite steps"):
        observed_order([1.0, 2.0], [1.0])


def test_a_fit_tells_its_sign_its_steps_its_floor_and_where_it_turned() -> None:
    # errors 4 h^2 + 1e-3/h, as of round-off that grows with the number of steps
    dt = [0.02, 0.64, 0.32, 0.16, 0.08, 0.04]
    fit = observed_order(dt, [4.0 * h**2 + 1e-3 / h for h in dt])
    assert fit.steps == (0.64, 0.32, 0.16, 0.08, 0.04, 0.02)
    assert (fit.sign, fit.turning_step) == (1, 0.04)  # minimum of 4 h^2 + 1e-3/h at 0.05
    above = observed_order(dt, [4.0 * h**2 + 1e-3 / h for h in dt], floor=0.1)
    assert (above.floor, above.points, above.left_out, above.steps) == (0.1, 3, 3, (0.64, 0.32, 0.16))
    assert math.isnan(above.turning_step)
    worse = observed_order([2.0, 1.0], [1.0, 2.0])
    assert (worse.sign, worse.turning_step) == (-1, 2.0)
    assert observed_order([2.0], [1.0]).sign == 0
    assert observed_order([2.0, 1.0], [1.0, 1.0]).sign == 0


def test_of_two_steps_with_one_error_the_finer_is_the_best() -> None:
    # not a turning point: nothing grew
    assert math.isnan(observed_order([4.0, 2.0, 1.0], [2.0, 1.0, 1.0]).turning_step)
    assert observed_order([4.0, 2.0, 1.0], [2.0, 1.0, 1.5]).turning_step == 2.0


@pytest.mark.parametrize("step", [0.0, -1.0, math.inf, math.nan])
def test_steps_are_finite_and_positive(step: float) -> None:
    with pytest.raises(UsageError, match="3 steps and 3 errors; allowed: as many finite steps > 0"):
        observed_order([4.0, 2.0, step], [3.0, 2.0, 1.0])


@pytest.mark.parametrize("value", [0.0, 1.0, -1e-6, 2.0, math.nan, math.inf, True, "1e-6", None])
def test_an_accuracy_is_a_number_between_0_and_1_and_neither_of_them(value: object) -> None:
    with pytest.raises(UsageError, match="allowed: a number between 0 and 1, such as 1e-6"):
        checked_accuracy(value)


def test_accuracies_next_to_0_and_1_are_allowed() -> None:
    least, most = FINEST_ACCURACY, math.nextafter(1.0, 0.0)
    assert (checked_accuracy(least), checked_accuracy(most)) == (least, most)


@pytest.mark.parametrize("value", [5e-324, 1e-16, math.nextafter(FINEST_ACCURACY, 0.0)])
def test_an_accuracy_that_double_precision_excludes_is_refused(value: float) -> None:
    with pytest.raises(UsageError, match="cannot be reached: double precision"):
        checked_accuracy(value)


# Richardson

steps_of_three = st.tuples(st.floats(1.2, 4.0), st.floats(1.2, 4.0), log_uniform(1e-8, 1.0)).map(
    lambda r: (r[2] * r[0] * r[1], r[2] * r[0], r[2])
)
rows = st.lists(st.tuples(st.floats(-10.0, 10.0), st.floats(-1.0, 1.0)), min_size=1, max_size=6)


@given(steps=steps_of_three, order=st.floats(1.0, 4.0), elements=rows, swap=st.permutations([0, 1, 2]))
def test_a_pure_power_is_extrapolated_to_its_limit_for_any_steps(
    steps: tuple[float, ...], order: float, elements: list[tuple[float, float]], swap: list[int]
) -> None:
    assume(max(abs(c) for _, c in elements) > 0.1)
    values = [[f + c * (h / steps[0]) ** order for f, c in elements] for h in steps]
    found = richardson([steps[i] for i in swap], [values[i] for i in swap], order=order)
    # differences of numbers up to 11, the finest at least 0.1 (1.2^p - 1)/16^p of them: a few ulps over that in p
    smallest = 0.1 * (steps[1] ** order - steps[2] ** order) / steps[0] ** order
    lost = 4.0 * 11.0 * 2.3e-16 / smallest / (1.0 - 1.2**-order)
    assert found.order == pytest.approx(order, abs=10.0 * lost + ROUND_OFF)
    assert found.value == pytest.approx([f for f, _ in elements], abs=40.0 * 2.3e-16 / (1.2**order - 1.0) * 11.0)
    assert found.uncertainty < 1e-12 / (1.2**order - 1.0)


@pytest.mark.parametrize(
    ("values", "says"),
    [
        ([17.0, 5.0, 3.0], "observed order 2.585"),
        ([1.0, 2.0, 4.0], "observed order -1.000"),
        ([1.0, 5.0, 4.0], "oscillate under refinement"),
        ([17.0, 5.0, 5.0], "differ by 0 .*; allowed: more than the floor, 0"),
        ([5.0, 5.0, 2.0], "observed order nan"),
        ([[17.0, 0.0], [5.0, 2.0], [2.0, -0.9]], "finer and the coarser pair differ by"),
        ([[17.0, math.nan], [5.0, 1.0], [2.0, 1.0]], "nan in some resolutions only"),
        ([17.0, 5.0, math.inf], "a value is infinite"),
    ],
)
def test_results_without_a_clean_order_are_refused_with_the_reason(values: list[float], says: str) -> None:
    with pytest.raises(NotAsymptotic, match=says):
        richardson([4.0, 2.0, 1.0], values, order=2)


def test_differences_below_the_floor_are_round_off() -> None:
    dt, values = [4.0, 2.0, 1.0], [1.0 + 16e-12, 1.0 + 4e-12, 1.0 + 1e-12]
    # the rounding of values near 1 in their differences: 2.2e-16 of 3e-12 and 12e-12
    assert richardson(dt, values, order=2).value[0] == pytest.approx(1.0, abs=1e-15)
    with pytest.raises(NotAsymptotic, match="more than the floor, 1e-11"):
        richardson(dt, values, order=2, floor=1e-11)


def _of_order(order: float) -> list[float]:
    """Values 1 + dt^order at the steps 4, 2 and 1."""
    return [1.0 + 4.0**order, 1.0 + 2.0**order, 2.0]


@pytest.mark.parametrize("order", [1.89, 2.11])
def test_an_order_more_than_a_tenth_from_the_formal_one_is_refused(order: float) -> None:
    with pytest.raises(NotAsymptotic, match=rf"observed order {order}0 .* allowed: 2 \+- 0\.1;"):
        richardson([4.0, 2.0, 1.0], _of_order(order), order=2)


@pytest.mark.parametrize("order", [1.91, 2.09])
def test_an_order_less_than_a_tenth_from_the_formal_one_is_clean(order: float) -> None:
    found = richardson([4.0, 2.0, 1.0], _of_order(order), order=2)
    assert found.order == pytest.approx(order, abs=ROUND_OFF)
    # from the finer pair f1 + (f1 - f2)/3, from the coarser f2 + (f2 - f3)/3
    f3, f2, f1 = _of_order(order)
    assert found.value[0] == pytest.approx(f1 + (f1 - f2) / 3.0, rel=ROUND_OFF)
    assert found.uncertainty == pytest.approx(abs(f1 + (f1 - f2) / 3.0 - f2 - (f2 - f3) / 3.0), rel=1e-10)


def test_the_window_of_the_order_is_closed(monkeypatch: pytest.MonkeyPatch) -> None:
    distance = abs(richardson([4.0, 2.0, 1.0], _of_order(2.05), order=2).order - 2.0)
    monkeypatch.setattr(convergence, "ORDER_WINDOW", distance)
    assert richardson([4.0, 2.0, 1.0], _of_order(2.05), order=2).order > 2.0
    monkeypatch.setattr(convergence, "ORDER_WINDOW", math.nextafter(distance, 0.0))
    with pytest.raises(NotAsymptotic, match=r"observed order 2\.050"):
        richardson([4.0, 2.0, 1.0], _of_order(2.05), order=2)


def test_a_difference_of_the_size_of_the_floor_is_round_off() -> None:
    dt, values = [4.0, 2.0, 1.0], [17.0, 5.0, 2.0]
    with pytest.raises(NotAsymptotic, match=r"differ by 3 at dt = 1 .. 4 s; allowed: more than the floor, 3$"):
        richardson(dt, values, order=2, floor=3.0)
    assert richardson(dt, values, order=2, floor=math.nextafter(3.0, 0.0)).value == (pytest.approx(1.0, rel=4e-16),)


def test_elements_that_change_in_turn_do_not_oscillate() -> None:
    # (3, 0) and (0, 12): their product is 0, and each element alone follows no order
    with pytest.raises(NotAsymptotic, match=r"finer and the coarser pair differ by 4 "):
        richardson([4.0, 2.0, 1.0], [[12.0, 3.0], [0.0, 3.0], [0.0, 0.0]], order=2)


@pytest.mark.parametrize("order", [0.0, -1.0, math.inf, math.nan])
def test_a_formal_order_is_finite_and_positive(order: float) -> None:
    with pytest.raises(UsageError, match=r"^order = .*; allowed: the method's formal order, a number > 0$"):
        richardson([4.0, 2.0, 1.0], [17.0, 5.0, 2.0], order=order)


def test_what_is_nan_everywhere_stays_nan() -> None:
    found = richardson([4.0, 2.0, 1.0], [[math.nan, 17.0], [math.nan, 5.0], [math.nan, 2.0]], order=2)
    assert math.isnan(found.value[0])
    assert found.value[1] == pytest.approx(1.0, abs=1e-14)


@pytest.mark.parametrize(
    ("dt", "values", "says"),
    [
        ([1.0], [1.0], "1 resolutions with 1 results; allowed: three"),
        ([1.0, 2.0, 4.0], [1.0], "3 resolutions with 1 results"),
        ([1.0, 2.0], [1.0, 2.0], "2 resolutions with 2 results; allowed: three"),
        ([1.0, 1.0, 2.0], [1.0, 2.0, 3.0], "allowed: distinct numbers > 0"),
        ([1.0, -2.0, 4.0], [1.0, 2.0, 3.0], "allowed: distinct numbers > 0"),
        ([1.0, 0.0, 4.0], [1.0, 2.0, 3.0], "allowed: distinct numbers > 0"),
        ([1.0, 2.0, math.inf], [1.0, 2.0, 3.0], "allowed: distinct numbers > 0"),
        ([1.0, 2.0], [1.0, 2.0, 3.0], "2 resolutions with 3 results; allowed: three"),
        ([1.0, 2.0, 4.0], [[1.0], [1.0, 2.0], [1.0]], "allowed: the same number in every resolution"),
    ],
)
def test_resolutions_that_do_not_fit_together_are_wrong_use(dt: list[float], values: list[float], says: str) -> None:
    with pytest.raises(UsageError, match=says):
        richardson(dt, values, order=2)


def _twins(truth: Truth, steps: list[float]) -> tuple[list[float], list[np.ndarray]]:
    runs = [db.solve(truth.scene, backend="verlet", dt=dt, uncertainty=False) for dt in steps]
    return [float(run.provenance["settings"]["dt"]) for run in runs], [run.velocity for run in runs]


def test_extrapolation_is_refused_where_it_is_worse_than_the_plain_result(decelerating: Truth) -> None:
    steps, velocity = _twins(decelerating, [8e-7, 4e-7, 2e-7])
    truth = decelerating.data["v"]
    blind = velocity[2] + (velocity[2] - velocity[1]) / ((steps[1] / steps[2]) ** 2 - 1.0)
    # the final velocities: plain 8.4e-5 v0, extrapolated 2.7e-4 v0
    plain, extrapolated = (float(np.max(np.abs(v[-1] - truth[-1]))) for v in (velocity[2], blind))
    assert extrapolated > 3.0 * plain
    for rows in ([v[-1].tolist() for v in velocity], [v.ravel().tolist() for v in velocity]):
        with pytest.raises(NotAsymptotic, match=r"no extrapolation: .* dt = 2e-07 .. 7.5e-07 s"):
            richardson(steps, rows, order=2)


def test_extrapolation_of_a_clean_order_gains_digits_and_its_bar_holds(decelerating: Truth) -> None:
    steps, velocity = _twins(decelerating, [5e-8, 2.5e-8, 1.25e-8])
    found = richardson(steps, [v.ravel().tolist() for v in velocity], order=2)
    truth = decelerating.data["v"]
    error = float(np.max(np.abs(np.reshape(found.value, velocity[0].shape)[1:] - truth)))
    plain = float(np.max(np.abs(velocity[2][1:] - truth)))
    assert error < 0.02 * plain  # found: 2e-6 -> 2e-8 of v0
    assert error <= found.uncertainty < plain
    assert found.order == pytest.approx(2.0, abs=0.1)


# GCI

NASA = ([1.0, 2.0, 4.0], [0.97050, 0.96854, 0.96178])


def test_nasas_example() -> None:
    found = grid_convergence_index(*NASA)
    # "Examining Spatial (Grid) Convergence", NPARC verification archive: printed to these digits
    assert found.order == pytest.approx(1.786170, abs=0.5e-6)
    assert 100.0 * found.fine == pytest.approx(0.103083, abs=0.5e-6)
    assert 100.0 * found.coarse == pytest.approx(0.356249, abs=0.5e-6)
    assert found.extrapolated == pytest.approx(0.97130, abs=0.5e-5)
    assert found.uncertainty == pytest.approx(found.fine * 0.97050, rel=1e-14)
    assert (found.asymptotic, found.reason) == (True, "")
    assert found.asymptotic_ratio == pytest.approx(0.97050 / 0.96854, rel=1e-12)  # all that is left of it


def _celik(spacing: list[float], values: list[float]) -> float:
    """Second writing: eq. 3 of Celik et al. (2008) as printed, by their fixed-point iteration."""
    (h1, h2, h3), (f1, f2, f3) = spacing, values
    r21, r32, ratio = h2 / h1, h3 / h2, (f3 - f2) / (f2 - f1)
    sign, p = math.copysign(1.0, ratio), 1.0
    for _ in range(500):
        p = abs(math.log(abs(ratio)) + math.log((r21**p - sign) / (r32**p - sign))) / math.log(r21)
    return p


def test_celiks_example_with_ratios_that_differ() -> None:
    # their table 1: 18000, 8000, 4500 cells in two dimensions, reattachment lengths 6.063, 5.972, 5.863
    spacing = [1.0, 1.5, 1.5 * 4.0 / 3.0]
    found = grid_convergence_index(spacing, [6.063, 5.972, 5.863])
    assert found.order == pytest.approx(1.53, abs=0.006)
    assert 100.0 * found.fine == pytest.approx(2.2, abs=0.06)
    assert found.extrapolated == pytest.approx(6.1685, abs=1e-4)


@given(steps=steps_of_three, order=st.floats(0.5, 6.0), limit=st.floats(1.0, 10.0), factor=st.floats(0.1, 1.0))
def test_the_order_is_that_of_celiks_iteration_and_of_the_power_it_came_from(
    steps: tuple[float, ...], order: float, limit: float, factor: float
) -> None:
    spacing = sorted(steps)
    values = [limit + factor * (h / spacing[2]) ** order for h in spacing]
    assume(values[1] - values[0] > 1e-7)
    found = grid_convergence_index(spacing, values)
    # rounding of the values over their smallest difference
    assert found.order == pytest.approx(order, abs=1e-5)
    equal = [1.0, 2.0, 4.0]  # for equal ratios the iteration is explicit, and surely converges
    values = [limit + factor * (h / 4.0) ** order for h in equal]
    assert grid_convergence_index(equal, values).order == pytest.approx(_celik(equal, values), abs=1e-9)


@given(order=st.floats(0.5, 6.0), limit=st.floats(1.0, 10.0), factor=st.floats(0.1, 1.0), safety=st.floats(1.0, 3.0))
def test_the_bar_is_the_error_times_the_safety_where_the_order_is_true(
    order: float, limit: float, factor: float, safety: float
) -> None:
    spacing = [1.0, 2.0, 4.0]
    values = [limit + factor * (h / 4.0) ** order for h in spacing]
    found = grid_convergence_index(spacing, values, safety=safety)
    error = values[0] - limit
    assert found.uncertainty == pytest.approx(safety * error, rel=1e-7)
    assert found.extrapolated == pytest.approx(limit, abs=1e-9)


def test_an_order_above_the_formal_one_is_capped_and_shows_in_the_ratio() -> None:
    spacing, values = [1.0, 2.0, 4.0], [1.0, 1.01, 1.09]  # order 3
    free, capped = (grid_convergence_index(spacing, values, formal_order=p) for p in (None, 2.0))
    assert (free.order, capped.order) == (pytest.approx(3.0, abs=1e-9), pytest.approx(3.0, abs=1e-9))
    assert free.fine == pytest.approx(1.25 * 0.01 / 7.0, rel=1e-9)
    # of order 2 the finer pair gives 0.01/3, the coarser 0.08/3 and a quarter of it on the finest: the larger holds
    assert capped.fine == pytest.approx(1.25 * 0.02 / 3.0, rel=1e-9)
    assert capped.asymptotic_ratio == pytest.approx(2.0 / 1.01, rel=1e-9)
    assert (free.asymptotic, capped.asymptotic) == (True, False)
    assert not grid_convergence_index(*NASA, formal_order=2.0).asymptotic  # 1.79 is not yet 2
    assert grid_convergence_index(*NASA, formal_order=2.0, window=0.25).asymptotic


@pytest.mark.parametrize(
    ("values", "says"),
    [
        ([1.0, 1.1, 1.0], "oscillate"),
        ([1.0, 0.9, 1.3], "oscillate"),
        ([1.0, 1.0, 1.1], "two values are equal"),
        ([1.0, 1.1, 1.1], "two values are equal"),
        ([1.0, 1.0, 1.0], "two values are equal"),
        ([1.0, 1.2, 1.3], "diverge under refinement"),
        ([1.0, 1.1, 1.2], "diverge under refinement"),  # order 0: no limit
        ([1.0, 1.0 + 1e-9, 2.0], "agree by chance"),
        ([1.0, math.nan, 2.0], "not a finite number"),
        ([1.0, 1.1, math.inf], "not a finite number"),
    ],
)
def test_a_bar_that_cannot_be_had_is_inf_and_never_small(values: list[float], says: str) -> None:
    found = grid_convergence_index([1.0, 2.0, 4.0], values)
    assert says in found.reason
    assert found.fine == found.coarse == found.uncertainty == math.inf
    assert math.isnan(found.extrapolated)
    assert not found.asymptotic


def test_values_without_any_change_of_their_differences_diverge() -> None:
    found = grid_convergence_index([1.0, 2.0, 4.0], [0.0, 1.0, 2.0])  # order 0 exactly
    assert (found.order, found.fine) == (pytest.approx(0.0, abs=1e-50), math.inf)
    assert "diverge under refinement (observed order 0.000)" in found.reason


@pytest.mark.parametrize(("order", "chance"), [(7.9, False), (8.1, True)])
def test_an_order_above_eight_is_by_chance(order: float, chance: bool) -> None:
    found = grid_convergence_index([1.0, 2.0, 4.0], _of_order(order)[::-1])
    assert found.order == pytest.approx(order, abs=1e-9)
    assert ("agree by chance" in found.reason) is chance


def test_the_largest_order_itself_is_none_by_chance(monkeypatch: pytest.MonkeyPatch) -> None:
    order = grid_convergence_index(*NASA).order
    monkeypatch.setattr(convergence, "MOST_ORDER", order)
    assert grid_convergence_index(*NASA).reason == ""
    monkeypatch.setattr(convergence, "MOST_ORDER", math.nextafter(order, 0.0))
    assert "agree by chance" in grid_convergence_index(*NASA).reason


def test_both_windows_of_the_asymptotic_range_are_closed() -> None:
    found = grid_convergence_index(*NASA)
    of_order, of_ratio = 2.0 - found.order, found.asymptotic_ratio - 1.0
    for formal, distance in ((2.0, of_order), (None, of_ratio)):
        for window, inside in ((distance, True), (math.nextafter(distance, 0.0), False)):
            assert grid_convergence_index(*NASA, formal_order=formal, window=window).asymptotic is inside


def test_a_safety_of_one_is_the_least() -> None:
    found = grid_convergence_index(*NASA, safety=1.0)
    assert found.uncertainty == pytest.approx(grid_convergence_index(*NASA).uncertainty / 1.25, rel=1e-14)


def test_the_order_of_values_that_nearly_agree_is_at_most_64() -> None:
    values = [1.0, 1.0 + 2.0**-52, 1e300]
    assert grid_convergence_index([1.0, 2.0, 4.0], values, formal_order=2.0).order == 64.0


def test_two_values_that_agree_by_chance_have_a_bar_where_the_formal_order_is_known() -> None:
    found = grid_convergence_index([1.0, 2.0, 4.0], [1.0, 1.0 + 1e-9, 2.0], formal_order=2.0)
    assert found.order > MOST_ORDER
    assert not found.asymptotic
    assert found.asymptotic_ratio > 1e6
    assert found.fine == pytest.approx(1.25 / 12.0, rel=1e-6)  # what the coarser pair predicts: not small


def test_a_value_of_zero_has_an_absolute_bar_only() -> None:
    found = grid_convergence_index([1.0, 2.0, 4.0], [0.0, 3.0, 15.0])
    assert (found.fine, found.uncertainty) == (math.inf, pytest.approx(1.25, rel=1e-12))
    assert not found.asymptotic
    middle = grid_convergence_index([1.0, 2.0, 4.0], [-3.0, 0.0, 12.0])
    assert (middle.coarse, middle.fine) == (math.inf, pytest.approx(1.25 / 3.0, rel=1e-12))
    assert math.isnan(middle.asymptotic_ratio)
    assert not middle.asymptotic


@pytest.mark.parametrize(
    ("spacing", "values", "says"),
    [
        ([1.0, 2.0], [1.0, 2.0], "2 resolutions with 2 results; allowed: three"),
        ([1.0, 2.0, 2.0], [1.0, 2.0, 3.0], "distinct numbers"),
    ],
)
def test_a_grid_convergence_index_takes_three_and_three(spacing: list[float], values: list[float], says: str) -> None:
    with pytest.raises(UsageError, match=says):
        grid_convergence_index(spacing, values)
    with pytest.raises(UsageError, match=r"safety = 0.5; allowed: a number >= 1"):
        grid_convergence_index(*NASA, safety=0.5)


@pytest.mark.parametrize("order", [0.0, -1.0, math.inf, math.nan])
def test_an_order_that_is_none_is_refused(order: float) -> None:
    with pytest.raises(UsageError, match=f"order = {order!r}; allowed: the method's formal order, a number > 0"):
        richardson([4e-8, 2e-8, 1e-8], [1.16, 1.04, 1.01], order=order)
