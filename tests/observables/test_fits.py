"""Fits: laws that are put in come out, uncertainties and spreads are as stated, and the paper's chains agree."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import linregress

import dem_bridge as db
from dem_bridge.errors import UsageError
from dem_bridge.observables.fits import (
    force_exponent,
    inner_bodies,
    inner_contacts,
    log_velocity_slope,
    speed_power_law,
    straight_line,
)
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import Trajectory
from tests.conftest import Solve
from tests.helpers.fake_runs import free_flight, uncertain
from tests.helpers.strategies import examples
from tests.helpers.waves import long_chain, tapered_chain, uniform_chain

EPS = float(np.finfo(float).eps)
BODIES = 41


def _chain(stiffness: np.ndarray | None = None, *, exponent: float = 2.5) -> Scene:
    beta = np.linspace(1e10, 4e10, BODIES - 1) if stiffness is None else stiffness
    return Scene(name="made", duration=1.0, mass=(0.01,) * BODIES, stiffness=tuple(beta.tolist()), exponent=exponent,
                 velocity=(1.0, *[0.0] * (BODIES - 1)), spacing=18e-3)  # fmt: skip


def _run(*, speed: np.ndarray | None = None, force: np.ndarray | None = None, **uncertainties: object) -> Trajectory:
    """A fake whose front has the ``speed`` (m/s) at bodies 1.. and whose contacts have the peak ``force`` (N)."""
    changes: dict[str, Any] = {}
    if speed is not None:
        changes["crossing_time"] = np.concatenate([[1e-5], 1e-5 + np.cumsum(18e-3 / speed)])
    if force is not None:
        changes["peak_force"] = force
    return free_flight(bodies=BODIES, contacts=BODIES - 1, uncertainty=uncertain(**uncertainties), **changes)


BODY = np.arange(1.0, BODIES - 1.0)


@examples(40)
@given(start=st.floats(100.0, 5000.0), end=st.floats(100.0, 5000.0), n=st.sampled_from([2.2, 2.5, 3.0]))
def test_a_power_law_of_the_speed_that_is_put_in_comes_out(start: float, end: float, n: float) -> None:
    b2 = (end**n - start**n) / (BODIES - 3)
    b1 = start**n - b2
    fit = speed_power_law(_chain(exponent=n), _run(speed=(b1 + b2 * BODY) ** (1.0 / n)))
    size = max(start, end) ** n
    # speeds are differences of crossing times, which are up to 40 times as large: 100 eps, times n; least squares 1e-10
    assert (fit.b1, fit.b2 * BODIES) == pytest.approx((b1, b2 * BODIES), abs=1e-9 * size)
    assert fit.residual < 1e-11
    assert fit.speed(np.array([1, BODIES - 2])) == pytest.approx([start, end], rel=1e-5)
    assert (fit.exponent, fit.first, fit.last) == (n, 3, BODIES - 3)


def test_the_covariance_is_that_of_repeated_noise() -> None:
    rng = np.random.default_rng(5)
    exact = (1e7 + 1e6 * BODY) ** 0.4
    fits = [speed_power_law(_chain(), _run(speed=exact + 5.0 * rng.standard_normal(len(exact)))) for _ in range(200)]
    found = np.cov(np.array([(fit.b1, fit.b2) for fit in fits]).T)
    told = np.mean([fit.covariance for fit in fits], axis=0)
    # a variance from 200 is good to sqrt(2/200) = 10 %: three of them
    assert found == pytest.approx(told, rel=0.3)
    noise = 5.0 * math.sqrt(float(np.mean(exact[2:-1] ** -2.0)))
    assert np.mean([fit.residual for fit in fits]) == pytest.approx(noise, rel=0.05)


def test_the_least_squares_are_in_the_speed_and_not_in_its_power() -> None:
    speed = (1e6 + 1e6 * BODY) ** 0.4
    speed[20] *= 1.1
    fit = speed_power_law(_chain(), _run(speed=speed))

    def cost(b1: float, b2: float) -> float:
        return float(np.sum((speed - (b1 + b2 * BODY) ** 0.4)[2:-1] ** 2))

    best = cost(fit.b1, fit.b2)
    for one, other in ((1e-3, 0.0), (-1e-3, 0.0), (0.0, 1e-3), (0.0, -1e-3)):
        assert cost(fit.b1 * (1.0 + one), fit.b2 * (1.0 + other)) > best
    linear = np.polyfit(BODY[2:-1], speed[2:-1] ** 2.5, 1)
    assert cost(linear[1], linear[0]) > 1.01 * best


def test_bars_of_the_power_law_are_reached_by_speeds_that_err_in_its_direction() -> None:
    speed = (1e7 + 1e6 * BODY) ** 0.4
    uncertainty = 1e-9
    fit = speed_power_law(_chain(), _run(speed=speed, crossing_time=uncertainty))
    residence = 18e-3 / speed
    changes = []
    for j in range(2, len(speed) - 1):
        moved = residence.copy()
        moved[j] += 2.0 * uncertainty  # both crossings err
        again = speed_power_law(_chain(), _run(speed=18e-3 / moved))
        changes.append((again.b1 - fit.b1, again.b2 - fit.b2))
    # to first order in 2e-9 / 2e-5 s
    assert fit.uncertainty == pytest.approx(np.sum(np.abs(changes), axis=0), rel=1e-2)


def test_the_window_of_bodies_is_the_callers() -> None:
    speed = (1e7 + 1e6 * BODY) ** 0.4
    speed[:10] = 1.0
    fit = speed_power_law(_chain(), _run(speed=speed), first=11, last=20)
    assert (fit.first, fit.last) == (11, 20)
    assert fit.b2 == pytest.approx(1e6, rel=1e-8)


def test_windows_leave_the_ends_out() -> None:
    assert inner_bodies(_chain()) == (3, 38)
    assert inner_contacts(_chain()) == (4, 37)
    assert inner_contacts(long_chain("decelerating")) == (20, 189)


@examples(40)
@given(power=st.floats(-1.0, 1.0), level=st.floats(1e-3, 1e6))
def test_a_force_exponent_that_is_put_in_comes_out_of_every_window(power: float, level: float) -> None:
    scene = _chain()
    fit = force_exponent(scene, _run(force=level * (np.array(scene.stiffness) / 1e10) ** power))
    assert fit.slope == pytest.approx(power, abs=1e-12)
    assert fit.spread == pytest.approx((power, power), abs=1e-11)
    assert fit.stderr < 1e-12


def test_slope_and_its_error_are_those_of_linear_regression() -> None:
    scene, rng = _chain(), np.random.default_rng(7)
    force = np.array(scene.stiffness) ** 0.4 * np.exp(0.01 * rng.standard_normal(BODIES - 1))
    fit = force_exponent(scene, _run(force=force), window=(5, 30))
    beta = np.array(scene.stiffness)
    told = linregress(np.log(beta[5:31]), np.log(force[5:31]))
    assert (fit.slope, fit.stderr) == pytest.approx((told.slope, told.stderr), rel=1e-10)
    assert (fit.first, fit.last) == (5, 30)


def test_the_spread_is_that_of_moving_and_shrinking_windows() -> None:
    scene = _chain()
    x = np.log(np.array(scene.stiffness))
    # a curved line: the slope at the low end is 0.3, at the high end 0.5
    fit = force_exponent(scene, _run(force=np.exp(0.3 * x + 0.1 * (x - x[0]) ** 2 / (x[-1] - x[0]))))
    assert len(fit.windows) == len(fit.slopes) == 16
    assert (4, 37) in fit.windows
    assert {high - low + 1 for low, high in fit.windows} == {34, 31, 27, 24, 20, 17}
    assert fit.spread == (fit.slopes.min(), fit.slopes.max())
    by_window = dict(zip(fit.windows, fit.slopes, strict=True))
    assert by_window[4, 37] == pytest.approx(fit.slope, rel=1e-12)
    assert min(by_window, key=by_window.__getitem__) == (4, 20)
    assert max(by_window, key=by_window.__getitem__) == (21, 37)
    told = linregress(x[4:21], (0.3 * x + 0.1 * (x - x[0]) ** 2 / (x[-1] - x[0]))[4:21]).slope
    assert fit.spread[0] == pytest.approx(told, rel=1e-10)
    # a standard error knows nothing of it
    assert fit.spread[1] - fit.spread[0] > 10.0 * fit.stderr


def test_the_bar_of_a_slope_is_reached_by_forces_that_err_in_its_direction() -> None:
    scene = _chain()
    force, uncertainty = np.array(scene.stiffness) ** 0.4, np.linspace(1.0, 3.0, BODIES - 1)
    fit = force_exponent(scene, _run(force=force, peak_force=uncertainty))
    x = np.log(np.array(scene.stiffness))
    worst = force + uncertainty * np.sign(x - np.mean(x[4:38]))
    moved = force_exponent(scene, _run(force=worst))
    # to first order in 3/1e4
    assert moved.slope - fit.slope == pytest.approx(fit.uncertainty, rel=1e-3)


def test_a_straight_line_of_three_points_has_one_degree_of_freedom() -> None:
    fit = straight_line(np.array([0.0, 1.0, 2.0]), np.array([0.0, 1.0, 3.0]), np.full(3, 0.1), 7)
    assert (fit.slope, fit.uncertainty) == pytest.approx((1.5, 0.1), rel=1e-14)
    assert fit.stderr == pytest.approx(math.sqrt(1.0 / 12.0), rel=1e-12)
    assert (fit.first, fit.last) == (7, 9)


@pytest.mark.parametrize(
    ("direction", "slope", "spread"),
    [("decelerating", 0.39498, (0.39335, 0.39740)), ("accelerating", 0.40529, (0.40268, 0.40725))],
)
def test_the_force_exponents_of_the_long_chains_differ_from_two_fifths(
    direction: str, slope: float, spread: tuple[float, float], solved: Solve
) -> None:
    scene = long_chain(direction)
    fit = force_exponent(scene, solved(scene, "reference", uncertainty=False))
    assert fit.slope == pytest.approx(slope, abs=1e-5)
    assert fit.spread == pytest.approx(spread, abs=1e-5)
    assert fit.stderr < 1.2e-4
    assert not fit.spread[0] < 0.4 < fit.spread[1]
    # known to three digits, over all but the ends: 0.395 and 0.406
    wide = force_exponent(scene, solved(scene, "reference", uncertainty=False), window=(10, 189))
    assert f"{wide.slope:.3f}" == {"decelerating": "0.395", "accelerating": "0.406"}[direction]


def test_the_speed_of_the_long_chains_is_the_papers_power_law_to_a_thousandth(solved: Solve) -> None:
    for direction in ("decelerating", "accelerating"):
        scene = long_chain(direction)
        fit = speed_power_law(scene, solved(scene, "reference", uncertainty=False))
        assert fit.residual < 1e-3
        assert math.copysign(1.0, fit.b2) == (-1.0 if direction == "decelerating" else 1.0)


@pytest.mark.parametrize(("ratio", "slope"), [(0.98, 0.0295), (1.0 / 0.98, -0.0309)])
def test_peak_velocities_of_tapered_chains_have_their_known_slopes(ratio: float, slope: float, solved: Solve) -> None:
    scene = tapered_chain(ratio)
    fit = log_velocity_slope(scene, solved(scene, "reference", uncertainty=False), 15, 35)
    assert f"{fit.slope:.4f}" == f"{slope:.4f}"
    assert math.isinf(fit.uncertainty)  # a run without uncertainties
    coarse = replace(scene, samples=500)
    again = log_velocity_slope(coarse, solved(coarse, "reference", uncertainty=False), 15, 35)
    assert again.slope == pytest.approx(fit.slope, abs=1e-9)


@pytest.mark.parametrize("ratio", [0.98, 1.0 / 0.98])
def test_binary_collisions_of_tapered_chains_have_the_slope_of_their_formula(ratio: float, solved: Solve) -> None:
    scene = tapered_chain(ratio)
    fit = log_velocity_slope(scene, solved(scene, "bca"), 15, 35)
    assert fit.slope == pytest.approx(math.log(2.0 / (1.0 + ratio**3)), rel=1e-12)
    assert fit.spread == pytest.approx((fit.slope, fit.slope), rel=1e-12)


def test_the_shortest_and_the_longest_windows_are_allowed() -> None:
    force = np.array(_chain().stiffness) ** 0.4
    run = _run(speed=(1e7 + 1e6 * BODY) ** 0.4, force=force)
    for first, last in ((11, 13), (1, BODIES - 2)):
        fit = speed_power_law(_chain(), run, first=first, last=last)
        assert (fit.first, fit.last, fit.b2) == (first, last, pytest.approx(1e6, rel=1e-6))
    for window in ((5, 8), (0, BODIES - 2)):
        assert force_exponent(_chain(), run, window=window).slope == pytest.approx(0.4, abs=1e-9)
    grown = np.exp(0.1 * np.arange(BODIES)) * np.ones((5, 1))
    came = np.linspace(0.1, 0.9, BODIES - 1)
    pulse = free_flight(bodies=BODIES, contacts=BODIES - 1, velocity=grown, crossing_time=came)
    for first, last in ((0, 2), (BODIES - 3, BODIES - 1), (0, BODIES - 1)):
        assert log_velocity_slope(_chain(), pulse, first, last).slope == pytest.approx(0.1, rel=1e-12)
    for first, last in ((-1, 5), (5, BODIES - 1), (5, 6)):
        with pytest.raises(UsageError, match=rf"^bodies {first}..{last}; allowed: 3 or more of 1..39, first and last"):
            speed_power_law(_chain(), run, first=first, last=last)
    with pytest.raises(UsageError, match=r"^contacts 0..40; allowed"):
        force_exponent(_chain(), run, window=(0, BODIES - 1))


@pytest.mark.parametrize(("span", "gradient"), [(0.9e-6, False), (1.1e-6, True)])
def test_a_gradient_is_a_millionth_in_the_logarithm(span: float, gradient: bool) -> None:
    beta = 1e10 * np.exp(np.linspace(0.0, span, BODIES - 1))
    run = _run(force=beta**0.4)
    if gradient:
        # logarithms near 20, rounded, over a millionth
        assert force_exponent(_chain(beta), run, window=(0, 39)).slope == pytest.approx(0.4, abs=0.1)
    else:
        with pytest.raises(UsageError, match=r"one stiffness in contacts 0\.\.39"):
            force_exponent(_chain(beta), run, window=(0, 39))


def test_an_unknown_uncertainty_in_the_middle_does_not_matter_and_others_do() -> None:
    x, y = np.array([0.0, 1.0, 2.0]), np.array([0.0, 1.0, 3.0])
    # weights -1/2, 0 and 1/2
    assert straight_line(x, y, np.array([0.1, math.inf, 0.3]), 0).uncertainty == pytest.approx(0.2, rel=1e-14)
    assert math.isinf(straight_line(x, y, np.array([math.inf, 0.1, 0.1]), 0).uncertainty)


def test_windows_of_a_line_are_parts_of_it_at_start_middle_and_end() -> None:
    x = np.arange(10.0)
    fit = straight_line(x, x**2, np.zeros(10), 3)
    # sizes 9, 8, 7, 6, 5 of 10
    places = {(start, start + size) for size in (9, 8, 7, 6, 5) for start in (0, (10 - size) // 2, 10 - size)}
    assert fit.windows == tuple(sorted((3 + a, 2 + b) for a, b in places | {(0, 10)}))
    # of a parabola the slope of a line is the sum of the ends
    assert fit.slopes == pytest.approx([low + high - 6 for low, high in fit.windows], rel=1e-12)
    assert fit.spread == pytest.approx((4.0, 14.0), rel=1e-12)
    # of four points windows of three are the smallest, and no window has one x alone
    assert straight_line(np.arange(4.0), np.arange(4.0), np.zeros(4), 0).windows == ((0, 2), (0, 3), (1, 3))
    flat = straight_line(np.array([0.0, 0.0, 0.0, 1.0]), np.arange(4.0), np.zeros(4), 0)
    assert flat.windows == ((0, 3), (1, 3))


def _never_came() -> Trajectory:
    crossing = np.linspace(1e-5, 2e-4, BODIES - 1)
    crossing[30:] = np.nan
    force = np.ones(BODIES - 1)
    force[30:] = 0.0
    return free_flight(bodies=BODIES, contacts=BODIES - 1, crossing_time=crossing, peak_force=force)


def test_what_cannot_be_fitted_is_refused_with_the_reason() -> None:
    run = _run(speed=(1e7 + 1e6 * BODY) ** 0.4)
    with pytest.raises(UsageError, match="one exponent"):
        speed_power_law(replace(_chain(), exponent=tuple(np.linspace(2.4, 2.5, BODIES - 1))), run)
    with pytest.raises(UsageError, match="made has no spacing"):
        speed_power_law(replace(_chain(), spacing=None), run)
    with pytest.raises(UsageError, match=r"bodies 0..38; allowed: 3 or more of 1..39"):
        speed_power_law(_chain(), run, first=0)
    with pytest.raises(UsageError, match=r"contacts 5..7; allowed: 4 or more of 0..39"):
        force_exponent(_chain(), run, window=(5, 7))
    with pytest.raises(UsageError, match=r"bodies 15..41; allowed: 3 or more of 0..40"):
        log_velocity_slope(_chain(), run, 15, 41)
    with pytest.raises(UsageError, match="one stiffness in contacts"):
        force_exponent(uniform_chain(41), _run(force=np.ones(40)))
    with pytest.raises(UsageError, match="the wave speed at 30 is not known: the pulse never came"):
        speed_power_law(_chain(), _never_came())
    with pytest.raises(UsageError, match="the peak force at 30 is not known"):
        force_exponent(_chain(), _never_came())
    with pytest.raises(UsageError, match="the peak velocity at 31 is not known"):
        log_velocity_slope(_chain(), _never_came(), 10, 35)


def test_a_solved_chain_and_its_copy_at_another_speed_have_the_same_exponent(solved: Solve) -> None:
    # v -> 32 v: forces times 32^(6/5) = 64, times over 2, for every contact
    scene = db.load_scene("accelerating-40")
    fast = replace(scene, velocity=tuple(32.0 * v for v in scene.velocity), duration=scene.duration / 2.0)
    slow, quick = (force_exponent(one, solved(one, "reference", uncertainty=False)) for one in (scene, fast))
    assert quick.slope == pytest.approx(slow.slope, abs=1e-11)
    assert quick.spread == pytest.approx(slow.spread, abs=1e-11)


def test_a_tiny_gradient_of_large_values_keeps_its_digits() -> None:
    x = 300.0 + 1e-6 * np.arange(20.0)
    slope = straight_line(x, 0.4 * x + 5.0, np.zeros(20), 0).slope
    # x and y are rounded by up to 2.8e-14 and 7e-15, and lie within 1e-5 of their means: 3e-9 and 2e-9 of the slope
    assert slope == pytest.approx(0.4, abs=1e-8)
