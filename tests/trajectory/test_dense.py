"""Schedules whose steps fall on the samples, and peaks found between dense samples."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from dem_bridge.errors import UsageError
from dem_bridge.trajectory.dense import PHASE_PER_DENSE_SAMPLE, Schedule, extremes, schedule
from tests.helpers.strategies import log_uniform

Floats = NDArray[np.float64]
EPS = float(np.finfo(float).eps)


def _plan(**changes: float) -> Schedule:
    paper: dict[str, Any] = {"duration": 3e-3, "samples": 500, "dt": 1e-8, "frequency": 2e5, "bodies": 41}
    return schedule(**(paper | changes))


@given(
    duration=log_uniform(1e-6, 1e1),
    samples=st.integers(1, 400),
    ratio=log_uniform(0.1, 1e4),
    frequency=st.just(0.0) | log_uniform(1e-2, 1e9),
)
def test_a_step_is_at_most_dt_and_a_whole_part_of_the_interval(
    duration: float, samples: int, ratio: float, frequency: float
) -> None:
    dt = duration / samples / ratio
    plan = schedule(duration=duration, samples=samples, dt=dt, frequency=frequency, bodies=3)
    # a ratio that is whole up to 1e-12 counts as whole
    assert plan.step <= dt * (1.0 + 2e-12)
    assert plan.step * plan.per_sample == pytest.approx(duration / samples, rel=2.0 * EPS)
    assert plan.per_sample == 1 or duration / samples / (plan.per_sample - 1) > dt * (1.0 - 2e-12)
    assert plan.steps == plan.per_sample * samples


@given(per_sample=st.integers(1, 5000), subdivisions=st.integers(1, 5000), samples=st.integers(1, 50))
def test_dense_steps_rise_and_every_so_many_are_the_samples(per_sample: int, subdivisions: int, samples: int) -> None:
    plan = Schedule(step=1.0, per_sample=per_sample, subdivisions=min(subdivisions, per_sample), samples=samples)
    steps = plan.dense_steps
    assert len(steps) == samples * plan.subdivisions + 1
    assert np.all(np.diff(steps) > 0)
    np.testing.assert_array_equal(steps[:: plan.subdivisions], per_sample * np.arange(samples + 1))


@pytest.mark.parametrize("dt", [1e-8, 6e-6 / 7, 6e-6 / 601, 6e-6 / 600])
def test_a_step_that_divides_the_interval_is_kept(dt: float) -> None:
    plan = _plan(dt=dt)
    assert plan.per_sample == round(6e-6 / dt)
    assert plan.step == pytest.approx(dt, rel=2.0 * EPS)


def test_a_dt_longer_than_the_interval_gives_one_step_a_sample() -> None:
    plan = _plan(dt=1.0)
    assert (plan.per_sample, plan.subdivisions, plan.step) == (1, 1, 3e-3 / 500)


def test_dense_samples_are_as_close_as_the_fastest_contact_needs() -> None:
    plan = _plan(frequency=2e5)
    spacing = plan.step * plan.per_sample / plan.subdivisions
    # the rule of the module, and not one sample more than it asks for
    assert 2e5 * spacing <= PHASE_PER_DENSE_SAMPLE
    assert 2e5 * spacing * plan.subdivisions / (plan.subdivisions - 1) > PHASE_PER_DENSE_SAMPLE


def test_without_contacts_no_dense_samples_are_taken() -> None:
    assert _plan(frequency=0.0).subdivisions == 1


def test_memory_bounds_the_dense_samples_and_the_plan_says_so() -> None:
    free, bound = _plan(frequency=2e6), _plan(frequency=2e6, memory=1e7)
    assert free.resolved
    assert not bound.resolved
    assert bound.subdivisions < free.subdivisions
    # overlap, rate, acceleration, force and position: five doubles a body and dense sample
    assert 8 * 5 * 41 * 500 * bound.subdivisions <= 1e7
    assert _plan(frequency=2e6, memory=1.0).subdivisions == 1


def _sampled(time: Floats, overlap: np.polynomial.Polynomial, stiffness: float, exponent: float) -> dict[str, Any]:
    """One contact whose overlap is a polynomial in time."""
    values = overlap(time)[:, None]
    return {
        "time": time,
        "overlap": values,
        "rate": overlap.deriv()(time)[:, None],
        "acceleration": overlap.deriv(2)(time)[:, None],
        "force": stiffness * np.maximum(values, 0.0) ** (exponent - 1.0),
        "exponent": np.array([exponent]),
    }


@given(
    top=st.floats(0.05, 0.95),
    depth=log_uniform(1e-9, 1.0),
    width=log_uniform(1e-2, 0.7),
    skew=st.floats(-0.2, 0.2),
    exponent=st.floats(1.5, 4.0),
)
def test_a_smooth_peak_between_two_samples_is_found_exactly(
    top: float, depth: float, width: float, skew: float, exponent: float
) -> None:
    # overlap = depth (1 - u^2 + skew u^3 - skew u^5 / 10) with u = width (t - top): a quintic, so Hermite's is it
    u = np.polynomial.Polynomial([-width * top, width])
    overlap = depth * (1.0 - u**2 + skew * u**3 - 0.1 * skew * u**5)
    sampled = _sampled(np.array([0.0, 1.0]), overlap, 3.0, exponent)
    peak, crossing = extremes(**sampled)
    # the coefficients (up to 15) cancel by a few ulps of depth; dividing by the curvature 2 width^2 gives the time
    lost = 100.0 * EPS
    assert crossing[0] == pytest.approx(top, abs=lost / width**2)
    assert peak[0] == pytest.approx(3.0 * depth ** (exponent - 1.0), rel=lost * exponent)


def test_the_first_maximal_compression_counts_and_the_largest_force() -> None:
    time = np.linspace(0.0, 4.0, 401)
    # two humps, the second higher: overlap = (1 + t/4) sin^2(pi t / 2)
    a, s, c = 1.0 + time / 4.0, np.sin(np.pi * time), np.cos(np.pi * time)
    overlap = a * 0.5 * (1.0 - c)
    rate = 0.125 * (1.0 - c) + a * 0.5 * np.pi * s
    acceleration = 0.25 * np.pi * s + a * 0.5 * np.pi**2 * c
    columns: dict[str, Any] = {"overlap": overlap, "rate": rate, "acceleration": acceleration, "force": overlap**1.5}
    peak, crossing = extremes(
        time=time, exponent=np.array([2.5]), **{name: values[:, None] for name, values in columns.items()}
    )
    # maxima where 0.125 (1 - cos) + a pi/2 sin = 0, found by Newton's method from the humps
    tops = []
    for t in (1.0, 3.0):
        for _ in range(50):
            slope = 0.125 * (1 - math.cos(math.pi * t)) + (1 + t / 4) * 0.5 * math.pi * math.sin(math.pi * t)
            bend = 0.25 * math.pi * math.sin(math.pi * t) + (1 + t / 4) * 0.5 * math.pi**2 * math.cos(math.pi * t)
            t -= slope / bend
        tops.append(t)
    # at the spacing omega h = 0.03 the quintic errs by (omega h)^6/46080 < 1e-13 of the amplitude
    assert crossing[0] == pytest.approx(tops[0], abs=1e-10)
    height = (1.0 + tops[1] / 4.0) * 0.5 * (1.0 - math.cos(math.pi * tops[1]))
    assert peak[0] == pytest.approx(height**1.5, rel=1e-12)


def test_a_contact_that_never_closes_has_no_crossing_and_no_force() -> None:
    overlap = np.polynomial.Polynomial([-2.0, 1.5, -0.375])  # at most -0.5
    peak, crossing = extremes(**_sampled(np.linspace(0.0, 4.0, 9), overlap, 1.0, 2.5))
    assert peak.tolist() == [0.0]
    assert np.isnan(crossing).tolist() == [True]


def test_an_initial_overlap_that_only_opens_has_a_peak_at_the_start_and_no_crossing() -> None:
    overlap = np.polynomial.Polynomial([1.0, 0.0, -1.0])
    peak, crossing = extremes(**_sampled(np.linspace(0.0, 2.0, 21), overlap, 5.0, 2.5))
    assert peak.tolist() == [5.0]
    assert np.isnan(crossing).tolist() == [True]


def test_a_contact_still_closing_at_the_end_has_no_crossing_but_its_force() -> None:
    overlap = np.polynomial.Polynomial([0.0, 1.0])
    peak, crossing = extremes(**_sampled(np.linspace(0.0, 4.0, 5), overlap, 1.0, 2.5))
    assert peak.tolist() == [8.0]
    assert np.isnan(crossing).tolist() == [True]


def test_overlaps_up_to_the_resolution_are_no_contact() -> None:
    ripple = np.polynomial.Polynomial([-1e-15, 4e-15, -2e-15])  # tops at 1e-15 at t = 1
    sampled = _sampled(np.linspace(0.0, 2.0, 6), ripple, 1.0, 2.5)
    assert extremes(**sampled)[1][0] == pytest.approx(1.0, abs=1e-9)
    assert np.isnan(extremes(**sampled, resolution=2e-15)[1][0])


def test_a_wrong_force_of_the_run_shows_in_the_peak() -> None:
    overlap = np.polynomial.Polynomial([0.0, 2.0, -1.0])
    sampled = _sampled(np.linspace(0.0, 2.0, 8), overlap, 1.0, 2.5)
    right = extremes(**sampled)[0][0]
    wrong = extremes(**(sampled | {"force": 1.01 * sampled["force"]}))[0][0]
    assert wrong == pytest.approx(1.01 * right, rel=4.0 * EPS)


def test_no_contacts_give_no_extremes() -> None:
    none = np.zeros((5, 0))
    peak, crossing = extremes(
        time=np.arange(5.0), overlap=none, rate=none, acceleration=none, force=none, exponent=np.zeros(0)
    )
    assert (peak.shape, crossing.shape) == ((0,), (0,))


def test_a_stiff_law_extrapolates_a_tiny_force_by_a_huge_ratio() -> None:
    # between two samples of 4e-7 m the quintic rises by 5/16 of the rates' 3.2 m; n = 50, beta = 1e40
    shallow, power = 4e-7, 49.0
    force = math.exp(power * math.log(shallow) + 40.0 * math.log(10.0))
    peak, crossing = extremes(
        time=np.array([0.0, 1.0]), overlap=np.full((2, 1), shallow), rate=np.array([[3.2], [-3.2]]),
        acceleration=np.zeros((2, 1)), force=np.full((2, 1), force), exponent=np.array([power + 1.0]),
    )  # fmt: skip
    assert crossing[0] == pytest.approx(0.5)
    # 49 times the last digits of the ratio's logarithm
    assert peak[0] == pytest.approx(1e40 * (1.0 + shallow) ** power, rel=1e-11)


def test_more_steps_than_lammps_can_count_are_refused() -> None:
    with pytest.raises(UsageError, match=r"dt = 1e-13 s needs 1e\+13 steps; allowed: up to \d"):
        schedule(duration=1.0, samples=10, dt=1e-13, frequency=1e5, bodies=2)
