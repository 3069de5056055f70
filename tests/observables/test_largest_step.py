"""There is one rule for the largest step of an accuracy: a step that was run is measured, others are between runs."""

from __future__ import annotations

import math

import pytest

from dem_bridge.observables.largest_step import (
    LargestStep,
    StepError,
    accuracy_key,
    measure_steps,
    two_digits_below,
    with_sources,
)

#: errors of order 2 at three steps
ERRORS = StepError(curve=((1e-6, 1e-3), (2e-6, 4e-3), (4e-6, 1.6e-2)))


def test_a_step_that_was_run_and_is_within_the_accuracy_is_measured() -> None:
    assert ERRORS.largest_step(4e-3) == LargestStep(dt=2e-6)
    # planted fault: the run with this step errs by more, so that nothing measured it
    wrong = StepError(curve=((1e-6, 1e-3), (2e-6, 4.1e-3), (4e-6, 1.6e-2)))
    step = wrong.largest_step(4e-3)
    assert step is not None
    assert not step.measured
    assert (step.dt, step.finer, step.coarser) == (1.9e-6, 1e-6, 2e-6)


def test_a_larger_error_of_a_finer_step_counts() -> None:
    # by chance the coarsest run errs by little: the step is below the first one that is beyond the accuracy
    chance = StepError(curve=((1e-6, 1e-3), (2e-6, 4e-3), (4e-6, 1e-5)))
    assert chance.largest_for(2e-3) == pytest.approx(1.4e-6)


def test_a_step_beyond_those_that_were_run_follows_from_the_order_and_not_from_far_away() -> None:
    for order in (2.0, None):
        step = ERRORS.largest_step(1e-5, order=order)
        assert step is not None
        assert (step.dt, step.coarser, step.measured) == (1e-7, 1e-6, False)
    assert ERRORS.largest_step(1e-9) is None
    assert StepError(curve=((1e-6, 1e-3),)).largest_step(1e-4) is None
    assert StepError(curve=((1e-6, 1e-3),)).largest_step(1e-4, order=2.0) is not None


def test_a_step_beyond_the_longest_possible_one_is_not_measured_there() -> None:
    tried = StepError(curve=ERRORS.curve, largest={4e-3: 2e-6})
    assert tried.largest_step(4e-3) == LargestStep(dt=2e-6)
    assert tried.largest_step(4e-3, most=1.5e-6) == LargestStep(dt=1.5e-6, measured=False, finer=1e-6, coarser=2e-6)


def test_each_step_of_a_series_was_run_within_its_accuracy() -> None:
    ran: list[float] = []

    def error_at(dt: float) -> float:
        ran.append(dt)
        return (dt / 1e-5) ** 2 * (1.3 if round(dt / 1e-8) % 2 else 1.0)  # depends on where the step falls

    errors = measure_steps(error_at, {3e-6: math.nan}, [1e-2, 1e-3], shortest=1e-9, longest=1e-4)
    for accuracy in (1e-2, 1e-3):
        step = errors.largest_step(accuracy)
        assert step is not None
        assert step.measured
        assert step.dt in ran
        assert error_at(step.dt) <= accuracy


def test_what_steps_share_is_said_once() -> None:
    beyond = LargestStep(dt=3e-6, measured=False, finer=1e-6)
    said = with_sources([("a", beyond), ("b", beyond), ("c", LargestStep(dt=1e-6))], "{:g} s".format)
    assert said == "a, b (above 1e-06 s, the coarsest that was run), c (measured)"


@pytest.mark.parametrize(
    ("step", "below"), [(3.59e-7, 3.5e-7), (1e-7, 1e-7), (9.99e-8, 9.9e-8), (2.14e-7, 2.1e-7), (5.0, 5.0)]
)
def test_a_step_is_rounded_down_to_two_digits(step: float, below: float) -> None:
    assert two_digits_below(step) == below


def test_an_accuracy_has_one_key() -> None:
    assert [accuracy_key(accuracy) for accuracy in (1e-2, 1e-3, 2.5e-5, 0.5)] == ["1e-2", "1e-3", "2.5e-5", "5e-1"]
