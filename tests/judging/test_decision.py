"""The last fits of hypotheses: each rule of a decision on residuals that are functions of parameters and step."""

from __future__ import annotations

import math
from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from dem_bridge.judging import kernels
from dem_bridge.judging.decision import STEPS_IN_INTERVAL
from dem_bridge.judging.fitting import Fit, Stepping
from dem_bridge.judging.hypotheses import Variant
from dem_bridge.trajectory.trajectory import Floats
from tests.helpers.synthetic_file import ENDLESS, SyntheticFile, block, hypothesis

VERLET, DRIFT_FIRST, RK4 = kernels.VERLET, kernels.DRIFT_FIRST, kernels.RK4
NOTHING, ORIGIN = np.zeros(0), np.zeros(1)
#: another hypothesis that leaves so little that others are no candidates for all steps
RIVAL = Fit(hypothesis(), NOTHING, 1.5, 0.0, 1e-3, np.zeros(0))


def rival(rms: float, stepping: Stepping | None = None) -> Fit:
    return Fit(hypothesis(), NOTHING, rms, 0.0, 1e-3, np.zeros(0), stepping)


def rms(values: Any) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


# ---------------------------------------------------------------- the step of the search
@pytest.mark.parametrize(
    ("dt", "end", "stiffness", "depth", "step"),
    [
        (1e-3, 2.0, 6.0, 1.0, 1e-3),
        (2.0**-10, 400_000 * 2.0**-10, 6.0, 1.0, 2.0**-10),
        (1e-3, 401.0, 0.0, 1.0, 401.0 / 2e4),  # too many steps
        (None, 1e4, 0.0, 1.0, 0.5),
        (None, 1e4, 0.125 / 1.5, 1.0, 0.2),  # a tenth of the time in which bodies of 2 kg swing, 0.5/s
        (None, 1e4, 1e8, 1.0, 0.025),
        (None, 1e4, 0.125 / 1.5 * 1e6, 1e-12, 0.2),
        (None, 1e4, 0.125 / 1.5 / math.sqrt(1e-15), 0.0, 0.2),
        (None, 1e4, 1e-9, 1.0, 0.5),
    ],
)
def test_a_step_of_the_search_resolves_the_stiffest_contact(
    dt: float | None, end: float, stiffness: float, depth: float, step: float
) -> None:
    # the least mass is 1 kg: twice the stiffness over it is the square of the rate
    file = SyntheticFile(time=(0.0, 0.25 * end, end), dt=dt)
    file.model.depth = depth
    file.model.system = SimpleNamespace(
        exponent=np.array([2.5, 2.5, 1.5]), stiffness=np.array([0.5 * stiffness, stiffness, 0.0]),
        mass=np.array([3.0, 1.0, 2.0]),
    )  # fmt: skip
    assert file.decision().step == pytest.approx(step, rel=1e-9)


def with_steps(exact: Sequence[Any], stepped: Sequence[Any], scales: Sequence[float]) -> SyntheticFile:
    """Return a file of quantities by the exact motion and by velocity Verlet at the step 0.25."""
    blocks = [block(values, scale=scale) for values, scale in zip(exact, scales, strict=True)]
    file = SyntheticFile(blocks=blocks)

    def predict(variant: Any, rows: int, tolerance: float, stepping: Stepping | None = None) -> list[Floats]:
        assert (rows, tolerance, stepping) in [(3, 1e-13, None), (3, 1e-13, Stepping(VERLET, 0.25))]
        return [np.array(values, dtype=float) for values in (exact if stepping is None else stepped)]

    file.predict = predict  # type: ignore[assignment]
    return file


@pytest.mark.parametrize(("size", "sane"), [(1.45, True), (1.5, False), (2.0, False)])
def test_the_error_of_an_unstable_step_is_none(size: float, sane: bool) -> None:
    file = with_steps([[[1.0], [1.0]], [[2.0], [np.nan]]], [[[1.0], [1.0 - size]], [[3.0], [5.0]]], (0.5, 9.0))
    first, second = file.decision(0.25).time_step_error()
    assert first.ravel().tolist() == ([0.0, -size] if sane else [0.0, 0.0])
    assert second.ravel().tolist() == ([1.0, 0.0] if sane else [0.0, 0.0])


def test_an_error_of_a_small_quantity_is_measured_by_its_own_scale() -> None:
    decision = with_steps([[[0.0], [0.0]]], [[[0.2], [0.2]]], (0.1,)).decision(0.25)
    assert decision.time_step_error()[0].tolist() == [[0.2], [0.2]]


# ---------------------------------------------------------------- which fits are tried
def of_methods(exact: float, verlet: float, drift_first: float, rk4: float) -> Any:
    """Return a residual that depends on the method alone."""
    by_method = {VERLET: verlet, DRIFT_FIRST: drift_first, RK4: rk4}
    return lambda p, stepping: np.full(4, exact if stepping is None else by_method[stepping.method])


@pytest.mark.parametrize(
    ("first", "methods", "best", "tried"),
    [
        (1.19, (0.1, 0.1, 0.1), None, []),
        (1.2, (1.1, 0.1, 0.1), VERLET, [VERLET]),
        (9.0, (5.0, 7.0, 1.5), RK4, [VERLET, DRIFT_FIRST, RK4]),
        (9.0, (5.0, 7.0, 6.0), VERLET, [VERLET, DRIFT_FIRST, RK4]),
        (9.0, (5.0, 1.19, 0.1), DRIFT_FIRST, [VERLET, DRIFT_FIRST]),
        (9.0, (5.0, 1.2, 0.9), RK4, [VERLET, DRIFT_FIRST, RK4]),
        (9.0, (10.0, 9.0, 11.0), None, [VERLET, DRIFT_FIRST, RK4]),  # an equal one does not replace a fit
    ],
)
def test_methods_at_the_step_of_a_file_are_tried_up_to_a_fit_to_the_digits(
    first: float, methods: tuple[float, float, float], best: int | None, tried: list[int]
) -> None:
    file = SyntheticFile(of_methods(first, *methods), dt=0.125)
    fit = file.decision().decide(hypothesis(), NOTHING)
    assert [stepping for *_, stepping in file.predicted] == [None, *(Stepping(method, 0.125) for method in tried)]
    assert fit.stepping == (None if best is None else Stepping(best, 0.125))
    assert fit.rms == (first if best is None else dict(zip((VERLET, DRIFT_FIRST, RK4), methods, strict=True))[best])


@pytest.mark.parametrize(
    ("verlet", "error", "other", "tried"),
    [
        (9e4, 9.1, None, [VERLET, DRIFT_FIRST, RK4]),
        (9e4, 8.9, None, [VERLET]),  # ten thousand errors of the step are left
        (9e4, 8.9, 3001.0, [VERLET]),
        (9e4, 899.0, 2999.0, [VERLET]),  # another hypothesis leaves thirty times less
        (9e4, 899.0, 3001.0, [VERLET, DRIFT_FIRST, RK4]),
        (9e4, 901.0, 2999.0, [VERLET, DRIFT_FIRST, RK4]),
        (9.0, 89.0, None, [VERLET, DRIFT_FIRST, RK4]),
        (9.0, 91.0, None, [VERLET, DRIFT_FIRST]),  # a method of order 4 would leave 91
        (9.0, 99.0, 0.01, [VERLET, DRIFT_FIRST]),
        (9.0, 101.0, None, [VERLET, DRIFT_FIRST, RK4]),  # it may err at a step so coarse
    ],
)
def test_methods_that_cannot_leave_less_than_verlet_are_not_tried(
    verlet: float, error: float, other: float | None, tried: list[int]
) -> None:
    file = SyntheticFile(of_methods(9.5e4, verlet, 1e5, 1e5), dt=0.125, error_of_verlet=error)
    file.decision().decide(hypothesis(), NOTHING, None if other is None else rival(other))
    assert [stepping.method for *_, stepping in file.predicted if stepping is not None] == tried


def test_a_method_of_order_four_is_tried_where_a_parameter_takes_the_error_of_verlet() -> None:
    def linear(p: Floats, stepping: Stepping | None) -> Floats:
        return np.array([5.0, -5.0, 5.0, -5.0, 5.0, -5.0]) + (9.0 + float(p[0]) if stepping is None else 0.0)

    file = SyntheticFile(linear, blocks=[block(np.zeros((3, 2)), scale=1e4)], dt=0.125, error_of_verlet=91.0)
    file.decision().decide(hypothesis(1), ORIGIN)
    assert file.steps(RK4)


@pytest.mark.parametrize(
    ("dt", "end", "size", "runs"),
    [
        (2.0**-18, 400_000 * 2.0**-18, 1, True),
        (ENDLESS, 1.0, 1, False),
        (ENDLESS, 1.0, 0, True),  # one run without parameters may have more steps
        (1e-8, 0.09, 0, True),
        (1e-8, 0.11, 0, False),
    ],
)
def test_where_a_run_at_the_step_of_the_file_would_take_long_the_exact_motion_is_all(
    dt: float, end: float, size: int, runs: bool
) -> None:
    file = SyntheticFile(of_methods(9.0, 1.0, 9.0, 9.0), dt=dt, time=(0.0, 0.5 * end, end))
    fit = file.decision().decide(hypothesis(size), np.zeros(size))
    assert fit.stepping == (Stepping(VERLET, dt) if runs else None)


def tried(exact: float, other: Fit | None = None, *, error: float = 0.05, even: bool = True) -> SyntheticFile:
    """Return a file without a step, after a decision: every method leaves as much as the exact motion at any step."""
    file = SyntheticFile(of_methods(exact, exact, exact, exact), scale=exact / error, even=even)
    file.decision(0.1).decide(hypothesis(), NOTHING, other)
    return file


def test_steps_of_all_methods_are_tried_where_a_hypothesis_is_promising() -> None:
    assert (*range(1, 21), 25, 30, 40, 50, 64, 80, 100) == STEPS_IN_INTERVAL
    # the method of velocity Verlet's order is found from its error; RK4 from a list, at the best of which it is fitted
    many, few = [*STEPS_IN_INTERVAL, 1], [*range(1, 21), 1]
    assert tried(9.0, error=0.09).counts(RK4) == many
    # few steps only make a large error
    assert tried(9.0, error=0.1).counts(RK4) == few
    assert tried(9.0, error=0.15).counts(RK4) == few
    assert tried(9.0, even=False).counts(RK4) == []
    # the methods of which a list is all are the first
    methods = [stepping.method for *_, stepping in tried(9.0).predicted if stepping and 0.5 / stepping.dt > 90.0]
    assert methods == [RK4, DRIFT_FIRST, VERLET]
    # a hypothesis that leaves ten times what another one leaves is not promising
    assert tried(29.0, rival(3.0)).counts(RK4) == many
    assert tried(30.0, rival(3.0)).counts(RK4) == []
    assert tried(45.0, rival(3.0)).counts(RK4) == []
    for method in (VERLET, DRIFT_FIRST):
        assert set(STEPS_IN_INTERVAL) <= {*tried(9.0).counts(method)}
        # by its error alone: at the first step, which has none and is fitted, and at those nearby
        assert tried(9.0, even=False).counts(method) == [5, 5]
        assert tried(30.0, rival(3.0)).counts(method) == [5, 5, 4, 5, 6, 4]


def test_where_another_hypothesis_explains_a_file_its_method_and_step_are_those_of_the_file() -> None:
    step = Stepping(RK4, 0.125)
    file = tried(5.0, rival(1.1, step))
    first = next(stepping for *_, stepping in file.predicted if stepping is not None)
    assert (first, file.counts(RK4)) == (step, [4])
    assert file.counts(VERLET)[:2] == file.counts(DRIFT_FIRST)[:2] == [5, 5]
    assert tried(5.0, rival(1.1)).counts(RK4) == []
    for left in (1.2, 1.5):
        assert tried(5.0, rival(left, step)).counts(RK4) == [*STEPS_IN_INTERVAL, 1]


@pytest.mark.parametrize(
    ("size", "even", "count", "counts"),
    [
        (1, True, 7.4, [7.4, 5, 6, 7, 8, 9]),
        (1, True, 2.2, [2.2, 1, 2, 3, 4]),
        (1, False, 7.4, [7.4]),
        (0, True, 7.4, [7.4]),
    ],
)
def test_a_step_of_a_method_divides_the_interval(size: int, even: bool, count: float, counts: list[float]) -> None:
    file = SyntheticFile(lambda p, stepping: np.full(4, abs(math.exp(-p[0]) - 6.1)), even=even)
    fit = file.decision().decide(hypothesis(size, method=3), np.array([-math.log(count)]))
    assert [math.exp(-p) for p in file.parameters()] == pytest.approx(counts)
    assert math.exp(-fit.parameters[0]) == pytest.approx(min(counts, key=lambda k: abs(k - 6.1)))


# ---------------------------------------------------------------- linear improvements
def overestimated(p: Floats, stepping: Stepping | None) -> Floats:
    """Return a residual of which a difference quotient at 0 is twice the slope elsewhere."""
    return np.full(4, (2.0 if abs(p[0]) < 1e-2 else 1.0) * p[0] - 8.0)


def test_the_exact_motion_is_improved_twice() -> None:
    file = SyntheticFile(overestimated, dt=ENDLESS)
    fit = file.decision().decide(hypothesis(1), ORIGIN)
    assert file.parameters() == pytest.approx([0.0, 4.0, 6.0])
    assert (fit.parameters[0], fit.rms) == (pytest.approx(6.0), pytest.approx(2.0))
    limited = SyntheticFile(overestimated, dt=ENDLESS).decision()
    assert limited.decide(hypothesis(1, bounds=(-1.0, 3.0)), ORIGIN).parameters[0] == 3.0


@pytest.mark.parametrize(
    ("sizes", "count", "best"),
    [
        ([90.0, 80.0, 70.0, 60.0, 50.0, 40.0], 5, 50.0),
        ([90.0, 90.0 * 0.9994, 70.0, 60.0, 50.0], 5, 50.0),
        ([90.0, 90.0 * 0.9996, 70.0], 2, 90.0 * 0.9996),  # nothing is gained
        ([90.0, 100.0, 70.0], 2, 90.0),
        ([90.0, 90.0, 70.0], 2, 90.0),
        ([90.0, 80.0, 85.0, 10.0], 3, 80.0),
    ],
)
def test_improvements_by_all_samples_end_when_nothing_is_gained(sizes: list[float], count: int, best: float) -> None:
    given = iter(sizes[:count])

    def residual(p: Floats, stepping: Stepping | None) -> list[float]:
        if stepping is None:
            return [4.0 * p[0], 5e3]
        # the slope is a quarter of that of the exact motion, and the second value makes the rms that is asked for
        moved, size = p[0] - 8.0, next(given, 1e3) if stepping.method == VERLET else 1e3
        return [moved, math.sqrt(2.0 * size**2 - moved**2)]

    file = SyntheticFile(residual, dt=0.125, blocks=[block(np.zeros((2, 1)))], time=(0.0, 1.0))
    fit = file.decision().decide(hypothesis(1), ORIGIN)
    # five samples that lead, and two fits without a gain, are of the second try
    steps = file.parameters(VERLET)
    assert steps[:count] == pytest.approx([8.0 * (1.0 - 0.75**k) for k in range(count)])
    assert (len(steps), fit.rms, fit.stepping) == (count + 7, pytest.approx(best), Stepping(VERLET, 0.125))
    assert fit.parameters[0] == steps[sizes.index(best)]


def test_bounds_hold_at_every_step() -> None:
    file = SyntheticFile(lambda p, stepping: [4.0 * p[0], 5e3] if stepping is None else [p[0] - 8.0, 50.0], dt=0.125,
                         blocks=[block(np.zeros((2, 1)))], time=(0.0, 1.0))  # fmt: skip
    assert file.decision().decide(hypothesis(1, bounds=(-1.0, 3.0)), ORIGIN).parameters[0] == 3.0
    assert max(file.parameters(VERLET)) == 3.0


def test_the_first_samples_lead_to_the_parameters_of_all() -> None:
    places, zigzag = np.arange(10.0), 50.0 * (-1.0) ** np.arange(20.0)

    def residual(p: Floats, stepping: Stepping | None) -> Floats:
        return np.asarray((p[0] - 1.0) + zigzag if stepping is None else np.repeat(p[0] - places, 2))

    file = SyntheticFile(residual, dt=0.125, blocks=[block(np.zeros((10, 2)))], time=places)
    file.decision().decide(hypothesis(1, bounds=(-1.0, 2.0)), ORIGIN)
    # all samples, up to a bound; then the mean place of the first 1, 2, 4, 6 and 8 of ten; and all once more
    assert file.parameters(VERLET) == pytest.approx(
        [*(1.0, 2.0, 2.0), *(1.0, 0.0, 0.5, 1.5, 2.0), *(2.0, 2.0)], abs=1e-6
    )


def test_late_samples_that_depend_strongly_on_a_parameter_do_not_mislead() -> None:
    places = np.arange(10.0)

    def residual(p: Floats, stepping: Stepping | None) -> Floats:
        return np.asarray(50.0 * places * p[0] + 500.0 if stepping is None else 50.0 * np.sin(places * (p[0] - 1.0)))

    file = SyntheticFile(residual, dt=0.125, blocks=[block(np.zeros((10, 1)))], time=places)
    fit = file.decision().decide(hypothesis(1, bounds=(0.0, 9.0)), ORIGIN)
    assert (fit.parameters[0], fit.stepping) == (pytest.approx(1.0, abs=1e-3), Stepping(VERLET, 0.125))
    assert fit.rms < 1.2


# ---------------------------------------------------------------- a step that is found from its error
SHAPE = np.array([1.0, -2.0, 3.0, 0.5])
FIRST_TWO = np.array([1.0, 1.0, 0.0, 0.0])


class Planted(SyntheticFile):
    """A file by velocity Verlet at the step ``target``: the error of a step is ``size (dt^power - target^power)``."""

    def __init__(
        self, *, power: float = 2.0, size: float = 1e6, shift: float = 0.0, target: float = 0.01, kink: float = 0.0,
        turn: float = 0.0, **fields: Any,
    ) -> None:  # fmt: skip
        fields.setdefault("even", False)
        super().__init__(self.of_step, **{"time": (0.0, 0.5, 1.0, 2.0), "scale": 1e7, **fields})
        self.power, self.factor, self.shift, self.target = power, size, shift, target
        #: what is left at every step, and a change of the shape of the error with the step
        self.kink, self.turn = kink * np.array([0.0, 0.0, 0.0, 1.0]), turn * np.array([0.0, 0.0, 0.0, 1.0])

    def error(self, dt: float) -> Floats:
        return np.asarray(self.factor * dt**self.power * (SHAPE + dt * self.turn))

    def of_step(self, p: Floats, stepping: Stepping | None) -> Floats:
        known = stepping is not None and stepping.method == VERLET
        error = self.error(stepping.dt) if known and stepping is not None else 0.0 * SHAPE
        shifted = (p[0] if p.size else 0.0) - self.shift
        return np.asarray(error - self.error(self.target) + shifted * FIRST_TWO + self.kink)

    def search(self, size: int = 0) -> Fit:
        """Return the fit of a hypothesis, from a step of 0.02 on."""
        fit = self.decision(0.02).decide(hypothesis(size), np.zeros(size), RIVAL)
        assert isinstance(fit, Fit)
        return fit


def test_a_step_of_second_order_is_found_at_once() -> None:
    planted = Planted()
    fit = planted.search()
    # the error at 0.02 is four times that of the file; the step that explains it is fitted
    assert planted.steps(VERLET) == pytest.approx([0.02, 0.01, 0.01])
    assert fit.stepping == pytest.approx((VERLET, 0.01))
    assert fit.rms == pytest.approx(0.0, abs=1e-6)
    assert planted.steps(DRIFT_FIRST) == []


@pytest.mark.parametrize(
    ("power", "second"),
    # by the power 2 from an error of 2^power times as much, and then by that of the last two steps, 1 to 4
    [(1.0, math.sqrt(0.5)), (3.0, 2.0**-1.5), (4.0, 0.25), (5.0, 2.0**-2.5), (0.5, 2.0**-0.25)],
)
def test_the_power_of_an_error_is_that_of_the_last_two_steps(power: float, second: float) -> None:
    planted = Planted(power=power, size=1e6 / 0.01**power)
    planted.search()
    third = second * (2.0 * second) ** (-power / min(max(power, 1.0), 4.0))
    assert planted.steps(VERLET)[:3] == pytest.approx([0.02, 0.02 * second, 0.02 * third])


def test_a_parameter_is_found_with_the_step() -> None:
    planted = Planted(shift=3.0)
    fit = planted.search(size=1)
    # beside the error of the step the exact motion would have another parameter
    assert planted.parameters()[1] == pytest.approx(3.0 - 50.0)
    assert (planted.steps(VERLET)[:2], fit.parameters[0]) == (pytest.approx([0.02, 0.01]), pytest.approx(3.0))
    # what the parameter has changed is no error of the step
    plain, shifted = (Planted(power=3.0, size=1e12, shift=shift) for shift in (0.0, 3.0))
    plain.search()
    shifted.search(size=1)
    assert shifted.steps(VERLET)[:4] == pytest.approx(plain.steps(VERLET)[:4], rel=1e-6)


def test_small_values_have_no_more_weight_than_large_ones() -> None:
    planted = Planted(blocks=[block(np.zeros((4, 1)), sigma=np.array([[1.0], [1.0], [1.0], [1e-3]]), scale=3e5)])
    plain = planted.function

    def residual(p: Floats, stepping: Stepping | None) -> Floats:
        # a value that is small and has fine digits has an error of first order, 500 times as much in its noise
        out = np.array(plain(p, stepping))
        out[3] = 5e6 * ((0.0 if stepping is None else stepping.dt) - 0.01)
        return out

    planted.function = residual
    planted.search()
    assert planted.steps(VERLET)[1] == pytest.approx(0.01, rel=0.01)


def test_ten_steps_are_tried_at_most() -> None:
    # whatever the step, it explains half of what is left
    file = SyntheticFile(of_methods(100.0, 50.0, 100.0, 100.0), even=False)
    fit = file.decision(0.02).decide(hypothesis(), NOTHING, RIVAL)
    assert file.steps(VERLET) == pytest.approx([0.02, *(0.02 * math.sqrt(2.0) * 2.0**k for k in range(9))])
    # the linear combination of the scene and the error of the first step leaves nothing
    assert (fit.rms, fit.stepping) == (pytest.approx(0.0, abs=1e-6), None)
    # so that steps nearby, of which 18 make an interval, are not tried
    even = SyntheticFile(of_methods(100.0, 50.0, 100.0, 100.0))
    even.decision(0.02).decide(hypothesis(), NOTHING, RIVAL)
    assert even.counts(VERLET)[:2] == [25, 18]
    assert 17 not in even.counts(VERLET)


def test_the_best_of_the_steps_is_kept_if_the_linear_combination_is_worse() -> None:
    # the shape of the error depends on the step, and 9 in one value is left at all of them
    planted = Planted(power=3.0, size=1e12, kink=9.0, turn=150.0)
    fit = planted.search()
    assert fit.stepping is not None
    assert (fit.stepping.method, fit.stepping.dt) == (VERLET, pytest.approx(0.01, rel=0.01))
    assert 3.0 < fit.rms < 4.6


@pytest.mark.parametrize(
    ("factor", "ends"),
    # the error of a step has the wrong sign, is a billionth of the difference, or a little more than that
    [(-2.0, True), (1e-12, True), (25.0 / 1.5e9, True), (25.0 / 0.9e9, False)],
)
def test_a_step_that_grows_without_limit_ends_the_search(factor: float, ends: bool) -> None:
    def residual(p: Floats, stepping: Stepping | None) -> Floats:
        error = 0.0 if stepping is None or stepping.method != VERLET else factor * 1e4 * stepping.dt**2
        return np.full(4, 100.0 - error)

    file = SyntheticFile(residual, interval=5.0, even=False)
    file.decision(0.02).decide(hypothesis(), NOTHING, RIVAL)
    assert (len(file.steps(VERLET)) == 1) is ends


@pytest.mark.parametrize(("step", "tried"), [(6e-6, True), (4e-6, False)])
def test_a_step_of_which_four_hundred_thousand_make_the_run_is_the_shortest(step: float, tried: bool) -> None:
    planted = Planted(size=1e16, target=step)
    planted.search()
    assert (len(planted.steps(VERLET)) > 1) is tried


def test_a_parameter_of_the_linear_combination_is_that_of_least_squares() -> None:
    # the error of the step has the wrong sign, so that the search ends with what it would leave
    def residual(p: Floats, stepping: Stepping | None) -> Floats:
        size = 75.0 if stepping is not None and stepping.method == VERLET else 50.0
        return np.asarray((p[0] - 3.0) * FIRST_TWO + size * np.array([1.0, 0.0, 1.0, 0.0]))

    file = SyntheticFile(residual, even=False)
    fit = file.decision(0.02).decide(hypothesis(1), ORIGIN, RIVAL)
    assert (fit.stepping, fit.parameters[0]) == (None, pytest.approx(3.0))
    assert fit.rms == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize(("error", "even", "nearby"), [(0.09, True, True), (0.15, True, False), (0.09, False, False)])
def test_steps_nearby_are_tried_at_last(error: float, even: bool, nearby: bool) -> None:
    # 40 steps in an interval of 0.5; something is left at every step
    planted = Planted(target=0.0125, kink=9.0, even=even)
    planted.blocks = [block(np.zeros((4, 1)), scale=3.0 * 1e6 * 0.0125**2 / error)]
    fit = planted.search()
    counts = planted.counts(VERLET)
    assert ({*range(35, 46)} <= {*counts}) is nearby
    assert all(count in (*range(35, 46), 25) for count in counts)
    assert fit.rms == pytest.approx(4.5, rel=0.05)
    # from the parameter of the step that is found
    with_parameter = Planted(target=0.0125, kink=9.0, shift=3.0, even=True)
    with_parameter.search(size=1)
    assert {*range(35, 46)} <= {*with_parameter.counts(VERLET)}
    assert 0.0 not in with_parameter.parameters(VERLET)


@pytest.mark.parametrize(("count", "nearby"), [(1.7, False), (2.0, True), (2.3, True), (3.0, True)])
def test_steps_nearby_are_tried_where_two_make_an_interval(count: float, nearby: bool) -> None:
    planted = Planted(target=0.5 / count, kink=9.0, even=True)
    planted.search()
    # from 12 % fewer steps on
    assert (int(0.88 * count) in planted.counts(VERLET)) is nearby


@pytest.mark.parametrize(
    ("count", "whole"),
    [(7.19, 7), (7.25, None), (12.23, 12), (12.3, None), (20.39, 20), (100.9, 101), (1.1, 1), (0.9, 1), (0.1, None),
     (0.51, None)],
)  # fmt: skip
def test_a_step_near_a_part_of_the_interval_is_this_part(count: float, whole: int | None) -> None:
    even, uneven = (Planted(target=0.5 / count, size=1e10, even=even) for even in (True, False))
    for planted, used in ((even, whole or count), (uneven, count)):
        planted.search()
        assert 0.5 / planted.steps(VERLET)[1] == pytest.approx(used, rel=1e-9)


# ---------------------------------------------------------------- steps of a list
def of_counts(best: float) -> Any:
    """Return a residual that RK4 leaves by the number of steps in an interval, with a parameter of 2."""

    def residual(p: Floats, stepping: Stepping | None) -> list[float]:
        rk4 = stepping is not None and stepping.method == RK4
        count = 0.5 / stepping.dt if rk4 and stepping is not None else 1e3
        return [10.0 * abs(count - best) + 2.0, (p[0] if p.size else 2.0) - 2.0]

    return residual


@pytest.mark.parametrize(
    ("best", "then"),
    [
        (9.0, [9]),
        # the best of the list, those between its neighbours, and the best of these
        (21.2, [20, 21, 22, 23, 24, 21]),
        (33.0, [30, *range(26, 30), *range(31, 40), 33]),
        (120.0, [100, *range(81, 100), 99]),
        (0.0, [1]),
    ],
)
def test_steps_of_a_list_and_then_those_between_are_tried(best: float, then: list[int]) -> None:
    file = SyntheticFile(of_counts(best), blocks=[block(np.zeros((2, 1)), scale=1e6)])
    fit = file.decision().decide(hypothesis(), NOTHING)
    assert file.counts(RK4) == [*STEPS_IN_INTERVAL, *then]
    assert fit.stepping is not None
    assert (fit.stepping.method, round(0.5 / fit.stepping.dt)) == (RK4, min(then, key=lambda count: abs(count - best)))


def test_eight_hundred_thousand_steps_of_a_list_are_enough() -> None:
    # the end is 2e4 intervals away: 1 + 2 + ... + 8 = 36 times as many steps, and nine more would be too many
    file = SyntheticFile(of_counts(30.0), blocks=[block(np.zeros((2, 1)), scale=1e6)], time=(0.0, 0.5, 1e4))
    file.decision().decide(hypothesis(), NOTHING)
    assert file.counts(RK4) == [*range(1, 9), 8]


def test_a_parameter_is_changed_within_its_bounds_at_the_steps_of_a_list() -> None:
    file = SyntheticFile(of_counts(9.0), blocks=[block(np.zeros((2, 1)), scale=1e6)], time=(0.0, 0.5))
    fit = file.decision().decide(hypothesis(1, bounds=(-9.0, 1.5)), ORIGIN)
    assert (fit.parameters[0], max(file.parameters(RK4))) == (1.5, 1.5)


def test_what_a_parameter_explains_does_not_count_in_the_choice_of_a_step() -> None:
    # (30, 30) along the derivative is nothing, (10, -10) is
    sizes = {10: [30.0, 30.0], 20: [10.0, -10.0]}

    def residual(p: Floats, stepping: Stepping | None) -> Floats:
        rk4 = stepping is not None and stepping.method == RK4
        count = round(0.5 / stepping.dt) if rk4 and stepping is not None else 0
        return np.asarray(np.array(sizes.get(count, [90.0, -90.0])) + p[0])

    file = SyntheticFile(residual, blocks=[block(np.zeros((2, 1)), scale=1e6)], time=(0.0, 0.5))
    fit = file.decision().decide(hypothesis(1), ORIGIN)
    assert fit.stepping == pytest.approx((RK4, 0.05))
    assert (fit.parameters[0], fit.rms) == (pytest.approx(-30.0), pytest.approx(0.0, abs=1e-6))


# ---------------------------------------------------------------- residuals and fits
@pytest.mark.parametrize(("size", "tolerance"), [(0.9e-4, 1e-13), (1e-4, 1e-11), (1.5e-4, 1e-11)])
def test_derivatives_are_difference_quotients_by_the_exact_motion(size: float, tolerance: float) -> None:
    def residual(p: Floats, stepping: Stepping | None) -> list[float]:
        return [p[0] ** 2 - 1.1, p[0] * p[1] - 2.0, 3.0 * p[1] - 6.0]

    file = SyntheticFile(residual, blocks=[block(np.zeros((3, 1)))], dt=ENDLESS, size=size)
    fit = file.decision().decide(hypothesis(2), np.array([1.0, 2.0]))
    # each parameter is moved by itself, around the first ones; the motions are computed side by side
    moved = sorted([p for p, accuracy, _ in file.predicted if accuracy == tolerance][:3])
    assert moved == [[1.0, 2.0], pytest.approx([1.0, 2.0001]), pytest.approx([1.0001, 2.0])]
    slope = np.array([[2.0001, 0.0], [2.0, 1.0], [0.0, 3.0]])
    change = np.linalg.lstsq(slope, np.array([0.1, 0.0, 0.0]), rcond=None)[0]
    exact = [p for p, accuracy, _ in file.predicted if accuracy == 1e-13]
    assert exact[-2] == pytest.approx(np.array([1.0, 2.0]) + change, rel=1e-6)
    assert fit.rms < rms(residual(np.array([1.0, 2.0]), None))


def fit_of(residual: Sequence[float], slope: Any, **changes: Any) -> Fit:
    """Return the fit of a residual of two values of 0.5 of 4 units and one of 0.1 of 2; its parameters stay at 0."""
    slopes = np.array(slope, dtype=float).reshape(3, -1)
    blocks = [block([[0.0, 0.0]], sigma=0.5, scale=4.0), block([[0.0]], sigma=0.1, scale=2.0, quantity=1)]
    file = SyntheticFile(lambda p, stepping: np.array(residual) + slopes @ p, blocks=blocks, dt=ENDLESS * 1e-3)
    file.floors = [0.25, 0.01]
    chosen = hypothesis(slopes.shape[1], bounds=(0.0, 0.0), **changes)
    fit = file.decision().decide(chosen, np.zeros(slopes.shape[1]))
    assert isinstance(fit, Fit)
    return fit


def test_a_fit_has_the_sizes_of_its_residual() -> None:
    residual, slope = [3.0, -4.0, -12.0], [3.0, 0.0, 4.0]
    fit = fit_of(residual, slope)
    assert (fit.rms, fit.largest, fit.stepping) == (pytest.approx(math.sqrt(169.0 / 3.0)), 12.0, None)
    # 0.5, 0.5 and 0.1 of a scale of 4 and 2: 2 and 1.2 in units of the quantities
    assert (fit.error, fit.floors) == (pytest.approx(0.6), pytest.approx(120.0))
    assert fit.deviation[0] == pytest.approx(fit.rms / 5.0)
    # noise of less than one is one; values in another unit are compared in that of the scene
    scaled = fit_of([0.03, -0.04, 0.12], slope, factors=(-10.0, 1.0, 1.0))
    assert (scaled.deviation[0], scaled.error) == (pytest.approx(0.2), pytest.approx(0.006))
    plain = fit_of([3.0, -4.0, 0.0], np.zeros((3, 0)), factors=(-10.0, 1.0, 1.0))
    assert (plain.error, plain.floors) == (pytest.approx(0.05), pytest.approx(0.8))
    assert plain.deviation.size == 0
    assert fit_of(residual, [0.0, 0.0, 0.0]).deviation[0] > 1e100


def test_each_of_two_parameters_is_uncertain_by_what_the_other_may_take() -> None:
    # directions of 5 and 10 units with a cosine of 0.6: least squares has the factor 1 / sqrt(1 - 0.36)
    fit = fit_of([0.0, 0.0, 0.0], [[5.0, 6.0], [0.0, 8.0], [0.0, 0.0]])
    assert fit.deviation.tolist() == pytest.approx([1.0 / (5.0 * 0.8), 1.0 / (10.0 * 0.8)])


# ---------------------------------------------------------------- effects
def effect_of(left: float, step: float, *, floor: float = 1.0, stepping: bool = True) -> float:
    """Return the effect of a change by 12 and 3 units of two quantities."""
    file = SyntheticFile(blocks=[block([[100.0 + left]]), block([[50.0]])])
    file.floors = [floor, floor]
    decision = file.decision()
    decision.exact = [np.array([[88.0]]), np.array([[47.0]])]

    def predict(variant: Any, rows: int, tolerance: float, stepped: Any = None) -> list[Floats]:
        assert (rows, tolerance) == (3, 1e-13)
        return [np.array([[100.0 + (step if stepped else 0.0)]]), np.array([[50.0]])]

    file.predict = predict  # type: ignore[assignment,method-assign]
    return float(decision.effect(rival(1.0, Stepping(RK4, 0.1) if stepping else None)))


def test_an_effect_is_in_floors_of_digits_of_the_step_and_of_what_is_left() -> None:
    assert effect_of(0.0, 0.0) == 12.0
    assert effect_of(0.0, 0.0, floor=2.0) == 6.0
    assert effect_of(0.0, 2.0, floor=0.5) == 6.0
    # a change of 3 with a floor of 0.5 is the larger one of 12 with a floor of 3
    assert effect_of(3.0, 0.0, floor=0.5) == 6.0
    assert effect_of(6.0, 2.0, floor=0.5, stepping=False) == 6.0


@pytest.mark.parametrize(
    ("dt", "stepping", "left", "effect"),
    [
        # a stated step: what it leaves, 8, in units of its error, 2
        (0.1, Stepping(RK4, 0.3), 1.0, 4.0),
        # without a step a difference of 10, by the step of the search
        (None, Stepping(RK4, 0.3), 9.0, 5.0),
        (None, Stepping(RK4, 0.3), 3.1, 5.0),
        (None, Stepping(RK4, 0.3), 3.0, 5.0),
        (None, Stepping(RK4, 0.3), 2.9, 0.0),  # ... of which a step leaves less than 30 %
        (0.1, None, 9.0, 5.0),
        (0.1, None, 1.0, 0.0),
    ],
)
def test_noise_is_what_no_step_explains(
    dt: float | None, stepping: Stepping | None, left: float, effect: float
) -> None:
    file = SyntheticFile(dt=dt, blocks=[block([[110.0]])])
    file.floors = [0.5]
    decision = file.decision(0.7)
    decision.exact = [np.array([[100.0]])]

    def predict(variant: Any, rows: int, tolerance: float, used: Stepping) -> list[Floats]:
        assert (variant, rows, tolerance) == (decision.base, 3, 1e-13)
        assert used == (stepping if dt is not None and stepping is not None else Stepping(VERLET, 0.7))
        return [np.array([[102.0]])]

    file.predict = predict  # type: ignore[assignment,method-assign]
    file.residual = lambda prediction, extra=0.0: np.full(4, 10.0)  # type: ignore[method-assign]
    assert decision.effect_of_noise(rival(left, stepping)) == effect


def test_the_error_of_an_adaptive_method_is_relative_to_the_scale() -> None:
    file = SyntheticFile(blocks=[block([[0.0]], scale=4.0), block([[0.0]], scale=0.5)])
    decision = file.decision()
    errors = {1e-11: [np.array([[2.0]]), np.array([[0.125]])]}

    def predict(variant: Any, rows: int, tolerance: float) -> list[Floats]:
        return errors[tolerance]

    file.predict = predict  # type: ignore[assignment,method-assign]
    assert decision.adaptive_error() == 0.5


@pytest.mark.parametrize(
    ("quantity", "values", "error"),
    [
        # velocities start at 5 and 0: errors of samples that are there still, in units of the scale, 2
        (0, [[5.0, 0.0], [5.0, 19.5], [7.0, 0.0]], 10.0),
        (0, [[25.0, 0.0], [6.0, 0.0], [7.0, 99.0]], 10.0),
        (0, [[5.0, 0.0], [30.0, 0.0], [7.0, 0.0]], 0.0),  # one deviation from the start is a motion
        (0, [[5.0, 0.0], [6.0, 11.5], [7.0, 0.0]], 0.0),  # digits explain 12 deviations
        (0, [[5.0, 0.0], [6.0, 12.5], [7.0, 0.0]], 6.5),
        (0, [[5.0, 0.0], [6.0, np.nan], [7.0, 0.0]], 0.0),
        (1, [[5.0, 20.5], [6.0, 0.0], [7.0, 0.0]], 10.0),  # displacements start at 0
        (2, [[5.0, 20.0], [6.0, 0.0], [7.0, 0.0]], 0.0),  # forces are not examined
    ],
)
def test_errors_at_rest_are_those_of_bodies_that_have_not_moved(
    quantity: int, values: list[list[float]], error: float
) -> None:
    file = SyntheticFile(blocks=[block(values, scale=2.0, quantity=quantity), block(np.zeros((3, 2)))])
    decision = file.decision()
    decision.exact = [np.array([[5.0, 0.5], [6.0, -0.5], [7.0, 1.5]]), np.zeros((3, 2))]
    decision.base = Variant(SimpleNamespace(velocity=np.array([5.0, 0.0])))  # type: ignore[arg-type]
    assert decision.error_at_rest() == error
