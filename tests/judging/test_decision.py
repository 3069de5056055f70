"""The last fits of hypotheses: each rule by itself, on residuals that are functions of parameters and step."""

from __future__ import annotations

import math
from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from dem_bridge.judging import kernels
from dem_bridge.judging.decision import DIVISORS, Decision
from dem_bridge.judging.fitting import Block, Fit, Stepping
from dem_bridge.judging.hypotheses import Hypothesis, Variant
from dem_bridge.trajectory.trajectory import Floats

VERLET, DRIFT_FIRST, RK4 = kernels.VERLET, kernels.DRIFT_FIRST, kernels.RK4
NOTHING = np.zeros(0)


def hypothesis(size: int = 0, *, method: int | None = None, bounds: tuple[float, float] = (-9.0, 9.0)) -> Hypothesis:
    make: Any = lambda p: SimpleNamespace(method=method, p=p, factors=(1.0, 1.0, 1.0))  # noqa: E731
    return Hypothesis("mass", make, "", starts=((0.0,) * size,), bounds=bounds)


def fit(rms: float, *, error: float = 1e-3, stepping: Stepping | None = None, p: Floats = NOTHING) -> Fit:
    return Fit(hypothesis(), p, rms, 0.0, error, np.zeros(0), stepping)


def block(values: Any, *, sigma: float = 1.0, scale: float = 1.0, quantity: int = 0) -> Block:
    array = np.array(values, dtype=float)
    return Block(
        quantity, array, np.arange(array.shape[1]), np.full(array.shape, sigma), np.isfinite(array), scale,
        np.zeros(array.shape),
    )  # fmt: skip


def decision_of(*, time: Sequence[float] | Floats = (0.0, 0.5, 1.0), dt: float | None = None, even: bool = True,
                blocks: Sequence[Block] = (), **fields: Any) -> Any:  # fmt: skip
    """Return a decision without a file; the interval of its samples is 0.5."""
    decision: Any = Decision.__new__(Decision)
    decision.data = SimpleNamespace(
        time=np.array(time), dt=dt, even=even, interval=0.5, blocks=list(blocks), floors=[1.0] * len(blocks)
    )
    decision.rows, decision.base, decision.step = len(time), "base", 0.1
    for name, value in fields.items():
        setattr(decision, name, value)
    return decision


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
    system = SimpleNamespace(
        exponent=np.array([2.5, 2.5, 1.5]), stiffness=np.array([0.5 * stiffness, stiffness, 0.0]),
        mass=np.array([3.0, 1.0, 2.0]),
    )  # fmt: skip
    decision = decision_of(time=(0.0, 0.25 * end, end), dt=dt)
    decision.data.model = SimpleNamespace(system=system, depth=depth)
    assert decision._step() == pytest.approx(step, rel=1e-9)


@pytest.mark.parametrize(("size", "sane"), [(1.45, True), (1.5, False), (2.0, False)])
def test_the_error_of_an_unstable_step_is_none(size: float, sane: bool) -> None:
    decision = decision_of(blocks=[block([[0.0]], scale=0.5), block([[0.0]], scale=9.0)], base="b", step=0.25)
    decision.exact = [np.ones((2, 1)), np.array([[2.0], [np.nan]])]
    requests = []

    def predict(*arguments: Any) -> list[Floats]:
        requests.append(arguments)
        return [np.array([[1.0], [1.0 - size]]), np.array([[3.0], [5.0]])]

    decision.data.predict = predict
    first, second = decision.time_step_error()
    assert requests == [("b", 3, 1e-13, Stepping(VERLET, 0.25))]
    assert first.ravel().tolist() == ([0.0, -size] if sane else [0.0, 0.0])
    assert second.ravel().tolist() == ([1.0, 0.0] if sane else [0.0, 0.0])


def test_lists_of_other_lengths_are_an_error() -> None:
    decision = decision_of(blocks=[block([[0.0]])])
    decision.exact = [np.zeros((2, 1))]
    decision.data.predict = lambda *arguments: [np.zeros((2, 1))] * 2
    with pytest.raises(ValueError, match="zip"):
        decision.time_step_error()


def test_an_error_of_a_small_quantity_is_measured_by_its_own_scale() -> None:
    decision = decision_of(blocks=[block([[0.0]], scale=0.1)])
    decision.exact = [np.zeros((2, 1))]
    decision.data.predict = lambda *arguments: [np.full((2, 1), 0.2)]
    assert decision.time_step_error()[0].tolist() == [[0.2], [0.2]]


# ---------------------------------------------------------------- which fits are tried
@pytest.mark.parametrize(
    ("first", "trials", "best", "tried"),
    [
        (1.19, [0.1], 1.19, 0),
        (1.2, [1.1], 1.1, 1),
        (1.5, [1.1], 1.1, 1),
        (9.0, [5.0, 7.0, 1.5, 1.19, 0.1], 1.19, 4),
        (9.0, [5.0, 1.2, 0.9, 0.1], 0.9, 3),
        (9.0, [10.0], 9.0, 1),
    ],
)
def test_trials_end_with_a_fit_to_the_digits(first: float, trials: list[float], best: float, tried: int) -> None:
    count = []

    def stepped(chosen: Any, exact: Fit, rival: Any) -> Any:
        assert rival == "rival"
        for rms in trials:
            count.append(rms)
            yield fit(rms)

    decision = decision_of(dt=1e-3, _evaluated=lambda chosen, p: fit(first), _stepped=stepped)
    assert decision.decide(hypothesis(), NOTHING, "rival").rms == best
    assert len(count) == tried
    # where a run at the step of the file would take long, the exact motion is all
    for dt, runs in ((2.0**-18, True), (1.0 / 400_000, True), (1.0 / 400_100, False), (None, True)):
        long = decision_of(dt=dt, time=(0.0, 0.5, 2.0**-18 * 400_000 if dt == 2.0**-18 else 1.0))
        long._evaluated, long._stepped = (lambda chosen, p: fit(9.0)), (lambda *arguments: [fit(1.0)])
        assert long.decide(hypothesis(1), np.zeros(1)).rms == (1.0 if runs else 9.0)
        # one run without parameters may have more steps
        assert long.decide(hypothesis(), NOTHING).rms == 1.0
    endless = decision_of(dt=1e-8, time=(0.0, 0.5, 0.11))
    endless._evaluated, endless._stepped = (lambda chosen, p: fit(9.0)), (lambda *arguments: [fit(1.0)])
    assert endless.decide(hypothesis(), NOTHING).rms == 9.0


def test_an_equal_trial_does_not_replace_a_fit_and_methods_of_other_codes_have_a_way_of_their_own() -> None:
    decision = decision_of(_evaluated=lambda chosen, p: fit(9.0, error=1.0))
    decision._stepped = lambda *arguments: [fit(9.0, error=2.0)]
    assert decision.decide(hypothesis(), NOTHING).error == 1.0
    decision._rounded = lambda chosen, p: "rounded"
    assert decision.decide(hypothesis(method=3), NOTHING) == "rounded"


def trials(exact: Fit, rival: Fit | None, *, dt: float | None = None, even: bool = True) -> list[Any]:
    """Return what is tried for a file, as words and numbers."""
    decision = decision_of(
        dt=dt, even=even, _improved=lambda chosen, p, stepping: ("at", *stepping),
        _found_step=lambda chosen, fit, method: ("found", method),
        _tried_steps=lambda chosen, p, method, counts: [("tried", method, len(counts), counts[-1])],
    )  # fmt: skip
    return list(decision._stepped(hypothesis(), exact, rival))


def test_methods_are_tried_at_the_step_of_the_file_or_at_steps_that_are_found() -> None:
    assert trials(fit(9.0), None, dt=0.25) == [("at", VERLET, 0.25), ("at", DRIFT_FIRST, 0.25), ("at", RK4, 0.25)]
    by_error = [("found", VERLET), ("found", DRIFT_FIRST)]
    many = [("tried", method, 27, 100) for method in (RK4, DRIFT_FIRST, VERLET)]
    few = [("tried", method, 20, 20) for method in (RK4, DRIFT_FIRST, VERLET)]
    assert trials(fit(9.0, error=0.09), None) == by_error + many
    # few steps only make a large error
    assert trials(fit(9.0, error=0.1), None) == by_error + few
    assert trials(fit(9.0, error=0.15), None) == by_error + few
    assert trials(fit(9.0), None, even=False) == by_error
    # a hypothesis that leaves ten times what another one leaves is not promising
    assert trials(fit(29.0), fit(3.0)) == by_error + many
    assert trials(fit(30.0), fit(3.0)) == by_error
    assert trials(fit(45.0), fit(3.0)) == by_error
    # where another one explains the file, its method and step are those of the file
    step = Stepping(RK4, 0.125)
    assert trials(fit(5.0), fit(1.1, stepping=step)) == [("at", RK4, 0.125), *by_error]
    assert trials(fit(5.0), fit(1.1)) == by_error
    for rms in (1.2, 1.5):
        assert trials(fit(5.0), fit(rms, stepping=step)) == by_error + many
    assert (*range(1, 21), 25, 30, 40, 50, 64, 80, 100) == DIVISORS


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
    seen: list[float] = []

    def fitted(chosen: Any, p: Floats, residual: float) -> Fit:
        seen.append(math.exp(-p[0]))
        assert residual == 2.0 * p[0]
        return fit(abs(seen[-1] - 6.1), p=p)

    decision = decision_of(even=even, _fit=fitted, _residual=lambda chosen, p: 2.0 * p[0])
    best = decision._rounded(hypothesis(size), np.array([-math.log(count)]))
    assert seen == pytest.approx(counts)
    assert math.exp(-best.parameters[0]) == pytest.approx(min(counts, key=lambda k: abs(k - 6.1)))


# ---------------------------------------------------------------- linear improvements
def linear(target: float, slope: float = 1.0, *, rows: int = 4, **fields: Any) -> Any:
    """Return a decision with residuals ``p - target``, whose derivative is overestimated by a factor."""
    tried: list[float] = []

    def residual(chosen: Any, p: Floats, stepping: Any = None) -> Floats:
        assert stepping in (None, Stepping(RK4, 0.125))
        tried.append(float(p[0]) if p.size else math.nan)
        return np.full(rows, (p[0] if p.size else 0.0) - target)

    def fitted(chosen: Any, p: Floats, residual: Floats, derivative: Any = None, stepping: Any = None) -> Fit:
        assert derivative is not None
        return fit(float(np.abs(residual[0])), p=p, stepping=stepping)

    return decision_of(
        time=np.linspace(0.0, 1.0, rows), tried=tried, _residual=residual, _fit=fitted,
        _derivative=lambda chosen, p: np.full((rows, p.size), slope), **fields,
    )  # fmt: skip


def test_the_exact_motion_is_improved_twice() -> None:
    decision = linear(8.0, 2.0)
    best = decision._evaluated(hypothesis(1), np.zeros(1))
    assert decision.tried == pytest.approx([0.0, 4.0, 6.0])
    assert best.parameters[0] == pytest.approx(6.0)
    limited = linear(8.0)
    assert limited._evaluated(hypothesis(1, bounds=(-1.0, 3.0)), np.zeros(1)).parameters[0] == 3.0
    nothing = linear(8.0)
    nothing._evaluated(hypothesis(0), NOTHING)
    assert len(nothing.tried) == 1


@pytest.mark.parametrize(
    ("sizes", "count", "best"),
    [
        ([9.0, 8.0, 7.0, 6.0, 5.0, 4.0], 5, 5.0),
        ([9.0, 9.0 * 0.9994, 7.0, 6.0, 5.0], 5, 5.0),
        ([9.0, 9.0 * 0.9996, 7.0], 2, 9.0 * 0.9996),  # nothing is gained
        ([9.0, 10.0, 7.0], 2, 9.0),
        ([9.0, 9.0, 7.0], 2, 9.0),
        ([9.0, 8.0, 8.5, 1.0], 3, 8.0),
    ],
)
def test_improvements_by_all_samples_end_when_nothing_is_gained(sizes: list[float], count: int, best: float) -> None:
    decision, answers = linear(8.0, 4.0), iter(sizes)
    decision._fit = lambda chosen, p, residual, derivative, stepping: fit(next(answers), p=p, stepping=stepping)
    stepping = Stepping(RK4, 0.125)
    result = decision._linear_steps(hypothesis(1), np.zeros(1), stepping, np.full((4, 1), 4.0))
    assert (len(decision.tried), result.rms, result.stepping) == (count, best, stepping)
    assert decision.tried == pytest.approx([8.0 * (1.0 - 0.75**k) for k in range(count)])
    assert result.parameters[0] == decision.tried[sizes.index(best)]


def test_a_hypothesis_without_parameters_is_fitted_once_and_bounds_hold() -> None:
    decision = linear(8.0)
    decision._linear_steps(hypothesis(0), NOTHING, Stepping(RK4, 0.125), np.zeros((4, 0)))
    assert len(decision.tried) == 1
    decision = linear(8.0)
    result = decision._linear_steps(
        hypothesis(1, bounds=(-1.0, 3.0)), np.zeros(1), Stepping(RK4, 0.125), np.ones((4, 1))
    )
    assert result.parameters[0] == 3.0


def leading(first: float, last: float, size: int = 1) -> tuple[Fit, list[float], list[float]]:
    """Return the best fit, the parameters on the way, and those from which linear steps started."""
    places, ways, starts = np.arange(10.0), list[float](), list[float]()
    answers = iter((first, last))

    def steps(chosen: Any, p: Floats, stepping: Stepping, derivative: Floats) -> Fit:
        starts.append(float(p[0]))
        return fit(next(answers), error=len(starts))

    def residual(chosen: Any, p: Floats, stepping: Stepping) -> Floats:
        ways.append(float(p[0]))
        return np.repeat(p[0] - places, 2)

    decision = decision_of(
        time=places, blocks=[block(np.zeros((10, 2)))], _linear_steps=steps, _residual=residual,
        _derivative=lambda chosen, p: np.ones((20, 1)),
    )  # fmt: skip
    return decision._improved(hypothesis(size, bounds=(-1.0, 2.0)), np.ones(1), Stepping(RK4, 0.125)), ways, starts


def test_the_first_samples_lead_to_the_parameters_of_all() -> None:
    # the mean place of the first 1, 2, 4, 6 and 8 of ten samples, up to a bound
    best, ways, starts = leading(9.0, 5.0)
    assert ways == pytest.approx([1.0, 0.0, 0.5, 1.5, 2.0])
    assert (starts, best.rms) == ([1.0, 2.0], 5.0)
    assert leading(9.0, 9.0)[0].error == 1
    assert leading(9.0, 9.5)[0].error == 1
    assert leading(1.19, 0.5)[2] == [1.0]
    assert leading(1.2, 0.5)[0].rms == 0.5
    assert leading(1.5, 0.5)[0].rms == 0.5
    assert leading(9.0, 0.5, size=0)[2] == [1.0]


# ---------------------------------------------------------------- a step that is found from its error
class Planted:
    """A file by a method of power 2 at the step 0.01: the error of the step is ``c (dt^power - 0.01^power)``."""

    def __init__(
        self, *, power: float = 2.0, size: float = 1e4, shift: float = 0.0, target: float = 0.01, **fields: Any
    ) -> None:
        self.tried: list[float] = []
        self.parts: list[Any] = []
        self.rms = 0.25
        shape = np.array([1.0, -2.0, 3.0, 0.5])
        self.decision = decision_of(time=(0.0, 1.0, 2.0), blocks=[block(np.zeros((4, 1)))], step=0.02, **fields)

        def residual(chosen: Any, p: Floats, stepping: Stepping | None = None) -> Floats:
            error = -(target**power)
            if stepping is not None:
                self.tried.append(stepping.dt)
                error += stepping.dt**power
            shifted = (p[0] if p.size else 0.0) - shift
            return np.asarray(size * error * shape + shifted * np.array([1.0, 1.0, 0.0, 0.0]))

        def fitted(chosen: Any, p: Floats, residual: Floats, derivative: Any = None, stepping: Any = None) -> Fit:
            return fit(float(np.sqrt(np.mean(residual**2))), p=p, stepping=stepping)

        self.decision._residual, self.decision._fit = residual, fitted
        self.decision._derivative = lambda chosen, p: np.repeat(np.array([[1.0], [1.0], [0.0], [0.0]]), p.size, axis=1)
        self.decision._improved = self.improved
        self.decision._tried_steps = self.tried_steps
        self.decision._whole = lambda dt: dt

    def improved(self, chosen: Any, p: Floats, stepping: Stepping) -> Fit:
        self.parts.append(("improved", stepping.dt, list(p)))
        return fit(self.rms, p=p, stepping=stepping)

    def tried_steps(self, chosen: Any, p: Floats, method: int, counts: Any) -> list[Fit]:
        self.parts.append(("tried", list(p), method, list(counts)))
        return [fit(0.5)]

    def search(self, *, error: float = 1e-3, size: int = 0) -> Fit:
        exact = fit(1e6, error=error, p=np.zeros(size))
        return self.decision._found_step(hypothesis(size), exact, VERLET)  # type: ignore[no-any-return]


def test_a_step_of_second_order_is_found_at_once() -> None:
    planted = Planted()
    assert planted.search().rms == 0.25
    # the error at 0.02 is four times that of the file
    assert planted.tried == pytest.approx([0.02, 0.01])
    assert planted.parts == [("improved", pytest.approx(0.01), [])]


@pytest.mark.parametrize(
    ("power", "second"),
    # by the power 2 from an error of 2^power times as much, and then by that of the last two steps, 1 to 4
    [(1.0, math.sqrt(0.5)), (3.0, 2.0**-1.5), (4.0, 0.25), (5.0, 2.0**-2.5), (0.5, 2.0**-0.25)],
)
def test_the_power_of_an_error_is_that_of_the_last_two_steps(power: float, second: float) -> None:
    planted = Planted(power=power, size=1e6 / 0.01**power)
    planted.search()
    third = second * (2.0 * second) ** (-power / min(max(power, 1.0), 4.0))
    assert planted.tried[:3] == pytest.approx([0.02, 0.02 * second, 0.02 * third])


def test_a_parameter_is_found_with_the_step() -> None:
    planted = Planted(shift=3.0)
    result = planted.search(size=1)
    assert (planted.tried, list(result.parameters)) == (pytest.approx([0.02, 0.01]), [pytest.approx(3.0)])
    # what the parameter has changed is no error of the step
    plain, shifted = (Planted(power=3.0, size=1e12, shift=shift) for shift in (0.0, 3.0))
    plain.search()
    shifted.search(size=1)
    assert shifted.tried == pytest.approx(plain.tried, rel=1e-6)


def test_a_step_without_an_error_stays_and_is_improved() -> None:
    planted = Planted()
    planted.decision._residual = lambda chosen, p, stepping=None: np.full(4, 5.0)
    assert planted.search().rms == 0.25
    assert planted.parts == [("improved", 0.02, [])]


def test_ten_steps_are_tried_at_most() -> None:
    planted = Planted()
    requests: list[float] = []

    def weight(extra: float) -> Floats:
        requests.append(extra)
        return np.ones(4)

    planted.decision._weight = weight

    def residual(chosen: Any, p: Floats, stepping: Stepping | None = None) -> Floats:
        # whatever the step, it explains half of what is left
        if stepping is not None:
            planted.tried.append(stepping.dt)
        return np.full(4, 100.0 if stepping is None else 50.0)

    planted.decision._residual = residual
    result = planted.search(error=0.02)
    assert planted.tried == pytest.approx([0.02, *(0.02 * math.sqrt(2.0) * 2.0**k for k in range(9))])
    assert requests == [pytest.approx(0.002)]
    # the linear combination of the scene and the error of the first step leaves nothing
    assert (result.rms, result.stepping) == (pytest.approx(0.0, abs=1e-6), None)


def test_the_best_of_the_steps_is_kept_if_the_linear_combination_is_worse() -> None:
    planted = Planted(power=3.0, size=1e12)
    planted.decision.data.even = False
    planted.rms = 1e9
    plain = planted.decision._fit

    def fitted(chosen: Any, p: Floats, residual: Floats, derivative: Any = None, stepping: Any = None) -> Fit:
        result = plain(chosen, p, residual, derivative, stepping)
        return fit(result.rms + (7.0 if stepping else 1e5), p=p, stepping=stepping)

    planted.decision._fit = fitted
    result = planted.search()
    assert result.stepping is not None
    assert result.stepping.dt == pytest.approx(0.01, rel=0.05)
    assert 7.0 <= result.rms < 1e5


def test_a_step_that_grows_without_limit_or_takes_long_ends_the_search() -> None:
    # the error of a step has the wrong sign, or is a billionth of the difference
    for factor, tried in ((-2.0, 1), (1e-12, 1), (25.0 / 1.5e9, 1)):
        planted = Planted()
        seen: list[float] = []

        def residual(chosen: Any, p: Floats, stepping: Stepping | None = None, factor: float = factor,
                     seen: list[float] = seen) -> Floats:  # fmt: skip
            if stepping is None:
                return np.full(4, 100.0)
            seen.append(stepping.dt)
            return np.full(4, 100.0) - factor * 1e4 * stepping.dt**2

        planted.decision._residual = residual
        planted.decision.data.interval = 5.0
        planted.search()
        assert (len(seen), planted.parts) == (tried, [])
    # a step of which 400,000 make the run, 2 s, is tried, and a shorter one is not
    for step, tried in ((6e-6, 2), (4e-6, 1)):
        planted = Planted(size=1e14, target=step)
        planted.search()
        assert len(planted.tried) == tried


def test_a_parameter_of_the_linear_combination_is_that_of_least_squares() -> None:
    # the error of the step has the wrong sign, so that the search ends with what it would leave
    planted = Planted()

    def residual(chosen: Any, p: Floats, stepping: Stepping | None = None) -> Floats:
        shifted = (p[0] - 3.0) * np.array([1.0, 1.0, 0.0, 0.0])
        return np.asarray(shifted + (50.0 if stepping is None else 75.0) * np.array([0.0, 0.0, 1.0, 0.0]))

    planted.decision._residual = residual
    result = planted.search(size=1)
    assert (result.stepping, result.parameters[0]) == (None, pytest.approx(3.0))
    assert result.rms == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize(("error", "even", "tried"), [(0.09, True, True), (0.15, True, False), (0.09, False, False)])
def test_steps_nearby_are_tried_at_last(error: float, even: bool, tried: bool) -> None:
    planted = Planted(size=1e4)
    planted.decision.data.even = even
    # a kink: something is left at every step
    plain, kink = planted.decision._residual, np.array([0.0, 0.0, 0.0, 9.0])
    planted.decision._residual = lambda chosen, p, stepping=None: plain(chosen, p, stepping) + kink
    planted.decision._whole = lambda dt: 0.0125 if abs(dt - 0.0125) < 0.006 else dt
    planted.rms = 50.0
    result = planted.search(error=error)
    ways = [part for part in planted.parts if part[0] == "tried"]
    assert bool(ways) is tried
    if tried:
        # 40 steps in an interval of 0.5, and those from 12 % fewer to 12 % more
        assert ways == [("tried", [], VERLET, list(range(35, 46)))]
        assert result.rms == 0.5


@pytest.mark.parametrize(("count", "tried"), [(1.9, 0), (2.0, 1), (2.1, 1), (3.0, 1)])
def test_steps_nearby_are_tried_where_two_make_an_interval(count: float, tried: int) -> None:
    planted = Planted(target=0.5 / count, size=1e4)
    plain, kink = planted.decision._residual, np.array([0.0, 0.0, 0.0, 9.0])
    planted.decision._residual = lambda chosen, p, stepping=None: plain(chosen, p, stepping) + kink
    planted.decision._whole = lambda dt: 0.5 / count
    planted.rms = 50.0
    planted.search()
    assert [part[0] for part in planted.parts].count("tried") == tried


def test_weights_leave_small_values_no_more_weight_than_large_ones() -> None:
    decision = decision_of(blocks=[block([[0.0, 0.0]], sigma=3.0, scale=2.0), block([[0.0]], sigma=1.0, scale=0.0)])
    assert decision._weight(2.0).tolist() == pytest.approx([0.6, 0.6, 1.0])


@pytest.mark.parametrize(
    ("count", "whole"),
    [(7.19, 7), (7.25, None), (12.23, 12), (12.3, None), (20.39, 20), (100.9, 101), (1.1, 1), (0.9, 1), (0.1, None),
     (0.51, None)],
)  # fmt: skip
def test_a_step_near_a_part_of_the_interval_is_this_part(count: float, whole: int | None) -> None:
    expected = 0.5 / (whole or count)
    assert decision_of()._whole(0.5 / count) == pytest.approx(expected, rel=1e-12)
    assert decision_of(even=False)._whole(0.5 / count) == 0.5 / count


def tried_steps(counts: Sequence[int], best: float, *, end: float = 1.0) -> tuple[list[float], list[float]]:
    """Return the numbers of steps in an interval that were tried and those that were improved."""
    tried, improved = list[float](), list[float]()

    def residual(chosen: Any, p: Floats, stepping: Stepping) -> Floats:
        assert stepping.method == RK4
        tried.append(0.5 / stepping.dt)
        return np.array([abs(tried[-1] - best), p[0] - 2.0])

    def better(chosen: Any, p: Floats, stepping: Stepping) -> str:
        improved.append(0.5 / stepping.dt)
        assert p[0] == pytest.approx(1.5 if end == 1.0 else 2.0)
        return "fit"

    decision = decision_of(
        time=(0.0, 0.5, end), _residual=residual, _improved=better,
        _derivative=lambda chosen, p: np.array([[0.0], [1.0]]),
    )  # fmt: skip
    bounds = (-9.0, 1.5 if end == 1.0 else 9.0)
    list(decision._tried_steps(hypothesis(1, bounds=bounds), np.zeros(1), RK4, counts))
    return [round(count) for count in tried], [round(count) for count in improved]


def test_steps_of_a_list_and_then_those_between_are_tried() -> None:
    assert tried_steps((1, 2, 3), 2.1) == ([1, 2, 3], [2])
    assert tried_steps((10, 20, 30), 21.2) == ([10, 20, 30, *range(11, 20), *range(21, 30), 20], [20, 21, 20])
    assert tried_steps((10, 14, 18), 9.0) == ([10, 14, 18, 11, 12, 13], [10, 11])
    assert tried_steps((10, 14, 18), 30.0) == ([10, 14, 18, 15, 16, 17], [18, 17])
    assert tried_steps((), 30.0) == ([], [])
    # the end is 2e4 intervals away: 800,000 steps in all are enough
    assert tried_steps((10, 20, 30), 15.0, end=1e4) == ([10, 20, 11, 12, 13], [10, 13])


def test_a_change_that_fits_better_decides_which_step_is_the_best() -> None:
    # what a parameter explains does not count: (1, 1) along the derivative is nothing, (1, -1) is
    sizes = {10: [3.0, 3.0], 20: [1.0, -1.0]}
    improved: list[tuple[int, float]] = []
    decision = decision_of(
        _residual=lambda chosen, p, stepping: np.array(sizes.get(round(0.5 / stepping.dt), [9.0, -9.0])),
        _improved=lambda chosen, p, stepping: improved.append((round(0.5 / stepping.dt), float(p[0]))),
        _derivative=lambda chosen, p: np.array([[1.0], [1.0]]),
    )  # fmt: skip
    list(decision._tried_steps(hypothesis(1), np.zeros(1), RK4, (10, 20)))
    assert improved[0] == (10, pytest.approx(-3.0))


# ---------------------------------------------------------------- residuals and fits
def test_derivatives_are_difference_quotients_by_the_exact_motion() -> None:
    requests: list[tuple[list[float], int, float]] = []
    decision = decision_of(blocks=[block(np.zeros((3, 2)))])

    def predict(variant: Any, rows: int, tolerance: float, stepping: Any = None) -> Any:
        requests.append((list(variant.p), rows, tolerance))
        return variant.p

    decision.data.predict = predict
    decision.data.residual = lambda p: np.array([p[0] ** 2, p[0] * p[1], 3.0 * p[1]])
    for size, tolerance in ((0.9e-4, 1e-13), (1e-4, 1e-11), (1.5e-4, 1e-11)):
        decision.errors = np.array([0.0, size])
        requests.clear()
        slope = decision._derivative(hypothesis(2), np.array([1.0, 2.0]))
        np.testing.assert_allclose(slope, [[2.0001, 0.0], [2.0, 1.0], [0.0, 3.0]], atol=1e-9)
        assert requests[0] == ([1.0, 2.0], 3, tolerance)
        assert [part[0] for part in requests[1:]] == [pytest.approx([1.0001, 2.0]), pytest.approx([1.0, 2.0001])]
    assert decision._derivative(hypothesis(0), NOTHING).shape == (6, 0)
    requests.clear()
    assert decision._residual(hypothesis(2), np.array([1.0, 2.0])).tolist() == [1.0, 2.0, 6.0]
    assert requests == [([1.0, 2.0], 3, 1e-13)]


def test_a_fit_has_the_sizes_of_its_residual() -> None:
    blocks = [block([[0.0, 0.0]], sigma=0.5, scale=4.0), block([[0.0]], sigma=0.1, scale=2.0, quantity=1)]
    decision = decision_of(blocks=blocks)
    decision.data.floors = [0.25, 0.01]
    residual, slope = np.array([3.0, -4.0, 12.0]), np.array([[3.0], [0.0], [4.0]])
    result = decision._fit(hypothesis(1), np.zeros(1), residual, slope, Stepping(RK4, 0.1))
    assert (result.rms, result.largest) == (pytest.approx(math.sqrt(169.0 / 3.0)), 12.0)
    # 0.5, 0.5 and 0.1 of a scale of 4 and 2: 2 and 1.2 in units of the quantities
    assert result.error == pytest.approx(0.6)
    assert result.floors == pytest.approx(120.0)
    assert result.deviation[0] == pytest.approx(result.rms / 5.0)
    assert result.stepping == Stepping(RK4, 0.1)
    # noise of less than one is one; values in another unit are compared in that of the scene
    scaled: Any = lambda p: SimpleNamespace(factors=(-10.0, 1.0, 1.0))  # noqa: E731
    result = decision._fit(Hypothesis("", scaled, "", starts=((0.0,),)), np.zeros(1), 0.01 * residual, slope)
    assert result.deviation[0] == pytest.approx(0.2)
    assert result.error == pytest.approx(0.006)
    first = decision._fit(Hypothesis("", scaled, ""), NOTHING, np.array([3.0, -4.0, 0.0]))
    assert (first.error, first.floors) == (pytest.approx(0.05), pytest.approx(0.8))
    assert first.deviation.size == 0
    assert decision._fit(hypothesis(1), np.zeros(1), residual, 0.0 * slope).deviation[0] > 1e100


# ---------------------------------------------------------------- effects
def effect_of(left: float, step: float, *, floor: float = 1.0, stepping: bool = True) -> float:
    """Return the effect of a change by 12 and 3 units of two quantities."""
    decision = decision_of(blocks=[block([[100.0 + left]]), block([[50.0]])])
    decision.exact = [np.array([[88.0]]), np.array([[47.0]])]
    decision.data.floors = [floor, floor]
    decision.data.largest = lambda first, second: [
        float(np.max(np.abs(a - b))) for a, b in zip(first, second, strict=True)
    ]

    def predict(variant: Any, rows: int, tolerance: float, stepped: Any = None) -> list[Floats]:
        assert (rows, tolerance) == (3, 1e-13)
        return [np.array([[100.0 + (step if stepped else 0.0)]]), np.array([[50.0]])]

    decision.data.predict = predict
    return float(decision.effect(fit(1.0, stepping=Stepping(RK4, 0.1) if stepping else None)))


def test_an_effect_is_in_floors_of_digits_of_the_step_and_of_what_is_left() -> None:
    assert effect_of(0.0, 0.0) == 12.0
    assert effect_of(0.0, 0.0, floor=2.0) == 6.0
    assert effect_of(0.0, 2.0, floor=0.5) == 6.0
    # a change of 3 with a floor of 0.5 is the larger one of 12 with a floor of 3
    assert effect_of(3.0, 0.0, floor=0.5) == 6.0
    assert effect_of(6.0, 2.0, floor=0.5, stepping=False) == 6.0


@pytest.mark.parametrize(
    ("dt", "stepping", "rms", "effect"),
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
def test_noise_is_what_no_step_explains(dt: float | None, stepping: Stepping | None, rms: float, effect: float) -> None:
    decision = decision_of(dt=dt, blocks=[block([[110.0]])], step=0.7)
    decision.exact = [np.array([[100.0]])]
    decision.data.floors = [0.5]
    decision.data.residual = lambda values: np.full(4, 10.0)
    decision.data.largest = lambda first, second: [float(np.max(np.abs(first[0] - second[0])))]

    def predict(variant: Any, rows: int, tolerance: float, used: Stepping) -> list[Floats]:
        assert (variant, rows, tolerance) == ("base", 3, 1e-13)
        assert used == (stepping if dt is not None and stepping is not None else Stepping(VERLET, 0.7))
        return [np.array([[102.0]])]

    decision.data.predict = predict
    assert decision.effect_of_noise(fit(rms, stepping=stepping)) == effect


def test_the_error_of_an_adaptive_method_is_relative_to_the_scale() -> None:
    decision = decision_of(blocks=[block([[0.0]], scale=4.0), block([[0.0]], scale=0.5)])
    decision.exact = "exact"
    decision.data.predict = lambda variant, rows, tolerance: (variant, rows, tolerance)
    answers = {(("base", 3, 1e-11), "exact"): [2.0, 0.125]}
    decision.data.largest = lambda first, second: answers[first, second]
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
        (2, [[5.0, 20.0], [6.0, 0.0], [7.0, 0.0]], 0.0),  # forces are not requests
    ],
)
def test_errors_at_rest_are_those_of_bodies_that_have_not_moved(
    quantity: int, values: list[list[float]], error: float
) -> None:
    decision = decision_of(blocks=[block(values, scale=2.0, quantity=quantity), block(np.zeros((3, 2)))])
    exact = np.array([[5.0, 0.5], [6.0, -0.5], [7.0, 1.5]])
    decision.exact = [exact, np.zeros((3, 2))]
    decision.base = Variant(SimpleNamespace(velocity=np.array([5.0, 0.0])))  # type: ignore[arg-type]
    assert decision.error_at_rest() == error
