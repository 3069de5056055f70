"""Samples beside a motion in closed form: noise, predictions, residuals and fits, with exact values."""

from __future__ import annotations

import math
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from dem_bridge.judging.fitting import Data, Fitter, Stepping, least
from dem_bridge.judging.hypotheses import Hypothesis, Variant
from dem_bridge.judging.model import Motion
from dem_bridge.scene.scene import Scene, Wall
from dem_bridge.trajectory.trajectory import Floats

SCENE = Scene(
    name="two", duration=2.0, mass=(1.0, 1.0), stiffness=(1.0,), velocity=(1.0, 0.0), wall_left=Wall(stiffness=1.0)
)


class Parabola:
    """A model whose bodies are at a t^2 and 2 a t^2 for a system a, with forces a t, 2 a t and 3 a t along the line."""

    scene, system = SCENE, 1.0

    def __init__(self) -> None:
        self.calls: list[tuple[object, ...]] = []

    def exact(self, system: Any, times: Floats, tolerance: float = 0.0) -> Motion:
        self.calls.append((times.tolist(), tolerance))
        bodies, t = system * np.array([1.0, 2.0]), times[:, None]
        return Motion(bodies * t**2, 2.0 * bodies * t, 2.0 * bodies + 0.0 * t, system * np.array([1.0, 2.0, 3.0]) * t)

    def stepped_at(self, system: Any, times: Floats, dt: float, method: int) -> Motion:
        motion = self.exact(system, times)
        self.calls[-1] = (times.tolist(), dt, method)
        return motion


TIME = np.array([0.0, 0.5, 1.0, 1.5])


def data_of(values: dict[str, Any], *, time: Floats = TIME, rounding: dict[str, Any] | None = None,
            columns: dict[str, tuple[int, ...]] | None = None, dt: float | None = None,
            floor: dict[str, float] | None = None, **fields: Any) -> Data:  # fmt: skip
    arrays = {name: np.array(part, dtype=float) for name, part in values.items()}
    record = SimpleNamespace(
        time=time,
        values=arrays,
        columns=columns or {name: tuple(range(part.shape[1])) for name, part in arrays.items()},
        rounding=rounding or {},
        dt=dt,
        **fields,
    )
    model: Any = Parabola()
    return Data(record, model, floor or {})


RIGHT = {
    "velocity": np.outer(TIME, [2.0, 4.0]),
    "displacement": np.outer(TIME**2, [1.0, 2.0]),
    "contact_force": np.outer(TIME, [2.0, 1.0]),
}


def test_noise_is_that_of_digits_of_times_of_the_model_and_of_round_off() -> None:
    late = np.array([0.0, 0.03, 0.0, 0.06])
    rounding = {"velocity": np.full((4, 2), 0.3), "displacement": np.full((4, 2), 0.02), "time": late}
    data = data_of(RIGHT, rounding=rounding, floor={"displacement": 0.5})
    velocity, displacement, force = data.blocks
    # the standard deviation of a uniform error is its largest value over the square root of 3; slopes: a, v and 1, 2
    noise = np.sqrt((0.3**2 + (late[:, None] * [2.0, 4.0]) ** 2) / 3.0 + (1e-11 * 6.0) ** 2)
    np.testing.assert_allclose(velocity.sigma, noise, rtol=1e-12)
    slope = np.abs(RIGHT["velocity"])
    noise = np.sqrt((0.02**2 + (late[:, None] * slope) ** 2) / 3.0 + (1e-11 * 4.5) ** 2 + 0.5**2)
    np.testing.assert_allclose(displacement.sigma, noise, rtol=1e-12)
    # forces have no digits of their own; without digits of times, too, the model's repetition remains
    np.testing.assert_allclose(force.sigma[1:2], late[1] * np.array([[2.0, 1.0]]) / math.sqrt(3.0), rtol=1e-9)
    np.testing.assert_allclose(force.sigma[::2], 1e-11 * 3.0, rtol=1e-9)
    assert data.floors == pytest.approx([0.3, 0.5, 1e-12 * 3.0], rel=1e-12, abs=0.0)
    # the largest of all contacts of the line is 3 t, that of the file 2 t
    assert [block.scale for block in data.blocks] == [6.0, 4.5, 4.5]
    assert [block.columns.tolist() for block in data.blocks] == [[0, 1], [0, 1], [1, 0]]
    assert [block.quantity for block in data.blocks] == [0, 1, 2]


def test_values_in_a_smaller_unit_have_smaller_noise_and_absent_ones_none() -> None:
    values = 1e-6 * np.array(RIGHT["velocity"])
    values[2, 1] = np.nan
    rounding = {"velocity": np.where(np.isnan(values), 9.0, 1e-20)}
    (block,) = (data := data_of({"velocity": values}, rounding=rounding)).blocks
    assert (block.scale, data.floors) == (6.0, [pytest.approx(1e-12 * 6e-6, rel=1e-12, abs=0.0)])
    np.testing.assert_allclose(block.sigma[block.present], 1e-11 * 6e-6, rtol=1e-6)
    assert (block.present == np.isfinite(values)).all()
    # nothing moves: the scale is that of the file, or one
    for factor, scale in ((0.0, 1.0), (-7.0, 7.0)):
        record = SimpleNamespace(
            time=TIME, values={"velocity": np.full((4, 2), factor)}, columns={"velocity": (0, 1)}, rounding={}, dt=None
        )
        model: Any = Parabola()
        model.system = 0.0
        (block,) = Data(record, model, {}).blocks
        assert block.scale == scale


@pytest.mark.parametrize(
    ("time", "interval", "even"),
    [
        ([0.0, 0.5, 1.0, 1.5], 0.5, True),
        ([0.0, 0.5, 1.0, 1.5 + 0.45e-6], 0.5, True),
        ([0.0, 0.5, 1.0, 1.5 + 0.75e-6], 0.5, False),
        ([0.0, 1.0, 3.0, 6.0], 2.0, False),
    ],
)
def test_even_samples_have_one_interval(time: list[float], interval: float, even: bool) -> None:
    data = data_of({"velocity": np.ones((len(time), 2))}, time=np.array(time))
    assert (data.interval, data.even) == (pytest.approx(interval), even)


@pytest.mark.parametrize(
    ("dt", "whole"),
    [
        (None, True), (0.05, True), (0.5, True), (1.0, True), (0.5 / 10.005, True), (0.5 / 10.015, False),
        (0.5 / 10.5, False), (0.5 / 0.9993, True), (0.5 / 0.9985, False), (0.5 / 0.0005, True),
    ],
)  # fmt: skip
def test_a_step_that_does_not_divide_the_interval_is_in_another_unit(dt: float | None, whole: bool) -> None:
    expected = whole if dt != 1.0 else False  # half of a step is no whole number of them
    assert data_of(RIGHT, dt=dt).whole is expected
    assert data_of(RIGHT, dt=dt, time=np.array([0.0, 0.5, 1.0, 1.7])).whole


@pytest.mark.parametrize(("end", "latest"), [(5.5, 6.0), (7.0, 7.0), (40.0, 40.0)])
def test_the_motion_is_known_up_to_three_durations_or_to_the_end_of_the_file(end: float, latest: float) -> None:
    data = data_of(RIGHT, time=np.array([-1.0, 1.0, 5.0, end]))
    assert data.model.calls == [([0.0, 1.0, 5.0, end], 0.0)]  # type: ignore[attr-defined]
    _, times = data.motion(Variant(1.0, scale=10.0), 4, 1e-5, None)  # type: ignore[arg-type]
    assert times.tolist() == [-10.0, 10.0, 50.0, 10.0 * end]
    reached = [0.0, min(10.0, latest), min(50.0, latest), min(10.0 * end, latest)]
    assert data.model.calls[-1] == (reached, 1e-5)  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("variant", "times"),
    [
        ({}, [0.0, 0.5, 1.0]),
        ({"shift": 0.25}, [-0.25, 0.25, 0.75]),
        ({"scale": 2.0}, [0.0, 1.0, 2.0]),
        ({"scale": 2.0, "shift": 0.25}, [-0.25, 0.75, 1.75]),
        ({"lag": 1}, [-0.5, 0.0, 0.5]),
        ({"lag": 2}, [-1.0, -0.5, 0.0]),
        ({"lag": -1}, [0.5, 1.0, 1.5]),
        ({"lag": -3}, [1.5, 2.0, 2.5]),
    ],
)
def test_samples_are_shifted_scaled_and_late(variant: dict[str, Any], times: list[float]) -> None:
    data = data_of(RIGHT)
    assert data.motion(Variant(1.0, **variant), 3, 0.0, None)[1].tolist() == times  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("variant", "stepping", "used"),
    [
        ({}, Stepping(4, 0.1), (0.1, 4)),
        ({"method": 2, "dt": 0.05}, Stepping(4, 0.1), (0.05, 2)),
        ({"method": 2}, Stepping(4, 0.1), (0.1, 4)),
        ({"dt": 0.05}, Stepping(4, 0.1), (0.1, 4)),
        ({"scale": 3.0}, Stepping(4, 0.1), (0.1 * 3.0, 4)),
    ],
)
def test_a_method_has_its_own_step_or_that_of_the_file(
    variant: dict[str, Any], stepping: Stepping, used: tuple[float, int]
) -> None:
    data = data_of(RIGHT, dt=0.1)
    data.motion(Variant(1.0, **variant), 4, 0.0, stepping)  # type: ignore[arg-type]
    assert data.model.calls[-1][1:] == used  # type: ignore[attr-defined]
    data.whole = False  # the step is in seconds although the times are not
    data.motion(Variant(1.0, **variant), 4, 0.0, stepping)  # type: ignore[arg-type]
    assert data.model.calls[-1][1:] == (0.05 if used[0] == 0.05 else 0.1, used[1])  # type: ignore[attr-defined]


def test_a_prediction_is_what_the_file_would_hold() -> None:
    data = data_of(RIGHT)
    system: Any = 1.0
    v, x, f = data.predict(Variant(system), 4)
    np.testing.assert_allclose(v, RIGHT["velocity"])
    np.testing.assert_allclose(x, RIGHT["displacement"])
    np.testing.assert_allclose(f, RIGHT["contact_force"])
    assert data.model.calls[-1][1] == 1e-9  # type: ignore[attr-defined]
    # half a step before: v - late a, but not before the start
    v, x, f = data.predict(Variant(system, late=0.1), 4)
    np.testing.assert_allclose(v, np.where(TIME[:, None] > 0.0, RIGHT["velocity"] - [0.2, 0.4], np.nan))
    np.testing.assert_allclose(x[0], np.nan)
    np.testing.assert_allclose(x[1:], RIGHT["displacement"][1:])
    turned = data.predict(Variant(system, order=(1, 0), factors=(-1.0, 2.0, 3.0)), 4)
    np.testing.assert_allclose(turned[0], -RIGHT["velocity"][:, ::-1])
    np.testing.assert_allclose(turned[1], 2.0 * RIGHT["displacement"][:, ::-1])
    # contacts of the line are turned as a whole: 0, 1, 2 become 2, 1, 0
    np.testing.assert_allclose(turned[2], 3.0 * np.outer(TIME, [2.0, 3.0]))
    np.testing.assert_allclose(data.predict(Variant(system * np.nan), 4)[0], np.inf)


@pytest.mark.parametrize(("shift", "absent"), [(0.5e-9, 0), (1.0e-9, 1), (0.75, 2)])
def test_samples_before_the_start_are_absent(shift: float, absent: int) -> None:
    # a billionth of the interval, 0.5 s, is none
    (value, *_) = data_of(RIGHT).predict(Variant(1.0, shift=0.99 * shift if shift < 0.1 else shift), 4)  # type: ignore[arg-type]
    assert int(np.isnan(value[:, 0]).sum()) == absent


def test_displacements_from_the_first_sample_are_those_less_the_first() -> None:
    data = data_of(RIGHT, time=TIME + 1.0, displacement_from_first=True)
    v, x, _ = data.predict(Variant(1.0), 4)  # type: ignore[arg-type]
    np.testing.assert_allclose(x, np.outer((TIME + 1.0) ** 2 - 1.0, [1.0, 2.0]))
    np.testing.assert_allclose(v, np.outer(TIME + 1.0, [2.0, 4.0]))
    assert not data_of(RIGHT).from_first


def test_residuals_and_errors_are_differences_in_their_units() -> None:
    rounding = {"velocity": np.full((4, 2), 0.5 * math.sqrt(3.0)), "displacement": np.full((4, 2), math.sqrt(3.0))}
    values = {name: np.array(RIGHT[name]) for name in ("velocity", "displacement")}
    values["displacement"][3, 1] = np.nan
    data = data_of(values, rounding=rounding)
    exact = [RIGHT["velocity"].copy(), RIGHT["displacement"].copy()]
    exact[0][1, 0] += 3.0
    exact[1][2, 1] -= 2.0
    residual = data.residual(exact)
    assert residual[[2, 8 + 5]] == pytest.approx([6.0, -2.0])
    assert np.count_nonzero(residual) == 2
    # a hundredth of the scales, 6 and 4.5, is noise, too
    residual = data.residual(exact, 0.1)
    assert residual[[2, 13]] == pytest.approx([3.0 / math.hypot(0.5, 0.6), -2.0 / math.hypot(1.0, 0.45)])
    assert data.residual([part[:2] for part in exact]).shape == (8,)
    assert data.errors(exact).tolist() == pytest.approx([0.0, 3.0 / 6.0, 2.0 / 4.5, 0.0])
    assert data.largest(exact, [RIGHT["velocity"], RIGHT["displacement"]]) == pytest.approx([3.0, 2.0])
    assert data.largest(exact, [exact[0] * np.nan, exact[1]]) == [0.0, 0.0]
    assert data.largest([exact[0][:0]], [exact[0][:0]]) == [0.0]
    assert data.errors([np.full((4, 2), np.inf), exact[1]])[0] == pytest.approx(1e150 / 6.0)
    assert data.residual([np.full((4, 2), -np.inf), exact[1]])[0] == -1e150
    assert data.residual([np.full((4, 2), np.inf), exact[1]])[0] == 1e150
    assert data.residual([np.full((4, 2), 1e200), exact[1]])[0] == 1e150
    assert data.residual([np.full((4, 2), np.nan), exact[1]])[0] == 0.0
    part = [np.where(TIME[:, None] < 0.7, np.nan, exact[0]), exact[1]]
    assert data.coverage(part) == pytest.approx(12.0 / 16.0)
    for call in (data.residual, data.errors):
        with pytest.raises(ValueError, match="zip"):
            call(exact[:1])
    with pytest.raises(ValueError, match="zip"):
        data.largest(exact, exact[:1])


# ---------------------------------------------------------------- fits
def test_the_nuisance_is_fitted_and_half_of_the_samples_must_be_predicted() -> None:
    rounding = {"velocity": np.full((4, 2), math.sqrt(3.0))}
    values = RIGHT["velocity"] + np.outer([0.0, 1.0, 2.0, 3.0], [1.0, 0.0]) + np.outer([1.0, 0.0, 0.0, 0.0], [0.0, 4.0])
    data = data_of({"velocity": values}, rounding=rounding)
    system: Any = 1.0
    nuisance = [np.outer([0.0, 1.0, 2.0, 3.0], [0.1, 0.0])]
    fitter = Fitter(data, nuisance, 1e-7)
    residual = fitter.residual(Variant(system), 4, 0.0)
    np.testing.assert_allclose(residual, [0.0, -4.0, *[0.0] * 6], atol=1e-9)
    assert data.model.calls[-1][1] == 1e-7  # type: ignore[attr-defined]
    # the shape is in units of the noise, with a tenth of the scale in addition: 0.6 of 6
    shape, size = fitter.shape(3, 0.1)
    np.testing.assert_allclose(shape, nuisance[0][:3].ravel() / math.hypot(1.0, 0.6), rtol=1e-9)
    assert size == pytest.approx(0.05 / 1.36)
    assert fitter.shape(3, 0.1)[0] is shape
    plain = [0.0, -4.0, -1.0, 0.0, -2.0, 0.0, -3.0, 0.0]
    np.testing.assert_allclose(Fitter(data, None, 1e-7).residual(Variant(system), 4, 0.0), plain, atol=1e-9)
    nothing = Fitter(data, [np.zeros((4, 2))], 1e-7)
    np.testing.assert_allclose(nothing.residual(Variant(system), 4, 0.0), plain, atol=1e-9)
    np.testing.assert_allclose(fitter.residual(Variant(system), 4, 0.0, Stepping(0, 0.1)), plain, atol=1e-9)
    method = Variant(system, method=3, dt=0.1)
    np.testing.assert_allclose(fitter.residual(method, 4, 0.0), plain, atol=1e-9)
    # two of four samples are before the start: half is enough; one is not
    assert np.max(np.abs(fitter.residual(Variant(system, lag=2), 4, 0.0))) < 100.0
    assert fitter.residual(Variant(system, lag=3), 4, 0.0).tolist() == [1e6] * 8


class Trace(Fitter):
    """Fits to a residual that is a function of the parameters, with a list of all parameters that were tried."""

    def __init__(self, residual: Callable[[Floats], Any]) -> None:
        self.function, self.tried = residual, list[list[float]]()

    def residual(self, variant: Any, rows: int, extra: float, stepping: Stepping | None = None) -> Floats:
        assert (rows, extra, stepping) == (7, 0.25, Stepping(1, 0.5))
        self.tried.append(variant.tolist())
        return np.array(self.function(variant), dtype=float)

    def from_start(self, start: float, bounds: tuple[float, float] = (-math.inf, math.inf)) -> tuple[float, float]:
        make: Any = lambda p: p  # noqa: E731
        hypothesis = Hypothesis("", make, "", starts=((start,),), bounds=bounds)
        p, rms = self.fit(hypothesis, np.array([start]), 7, 0.25, Stepping(1, 0.5))
        return float(p[0]), rms


def test_a_fit_goes_by_steps_of_one_and_a_half_at_most() -> None:
    trace = Trace(lambda p: [p[0] - 5.0, 3.0])
    p, rms = trace.from_start(0.0)
    assert (p, rms) == (pytest.approx(5.0, abs=1e-9), pytest.approx(3.0 / math.sqrt(2.0)))
    ends = [0.0, 1e-4, 1.5, 1.5001, 3.0, 3.0001, 4.5, 4.5001, 5.0]
    assert [q[0] for q in trace.tried[:9]] == pytest.approx(ends, abs=1e-9)
    assert Trace(lambda p: [p[0] + 5.0]).from_start(-4.0)[0] == pytest.approx(-5.0)
    assert Trace(lambda p: [p[0] + 5.0]).from_start(0.0, (-2.0, 9.0))[0] == -2.0
    # twelve steps, and a start beyond a bound
    assert Trace(lambda p: [p[0] - 100.0]).from_start(0.0)[0] == pytest.approx(18.0)
    limited = Trace(lambda p: [p[0] - 2.0])
    limited.from_start(5.0, (0.0, 3.0))
    assert limited.tried[0] == [3.0]


def test_a_derivative_is_a_difference_quotient_over_a_ten_thousandth() -> None:
    # of p^2 - 4 at 1 it is 2.0001
    trace = Trace(lambda p: [p[0] ** 2 - 2.0])
    trace.from_start(1.0)
    assert trace.tried[2][0] == pytest.approx(1.0 + 1.0 / 2.0001, abs=1e-9)


@pytest.mark.parametrize(("reach", "p"), [(0.01, 0.0081), (0.005, 0.0), (1.0, 1.0)])
def test_a_step_that_does_not_improve_is_shortened_four_times(reach: float, p: float) -> None:
    trace = Trace(lambda q: [1.0 - q[0] if -0.1 < q[0] <= reach else 10.0, 0.0])
    trace.from_start(0.0)
    tried = [q[0] for q in trace.tried[2:7]]
    expected = [1.0, 0.3, 0.09, 0.027, 0.0081]
    assert tried[: 1 if p == 1.0 else 5] == pytest.approx(expected[: 1 if p == 1.0 else 5])
    if p == 0.0:
        assert len(trace.tried) == 7


def test_a_step_that_leaves_as_much_as_before_is_no_improvement() -> None:
    trace = Trace(lambda q: [1.0 - q[0] if q[0] < 0.5 else 1.0])
    trace.from_start(0.0)
    assert [q[0] for q in trace.tried[2:4]] == pytest.approx([1.0, 0.3])


@pytest.mark.parametrize(("share", "steps"), [(1.5e-3, 2), (0.9e-3, 1)])
def test_a_fit_ends_with_a_gain_of_a_thousandth(share: float, steps: int) -> None:
    # from 5 away to 3.5 away the sum of squares falls by 12.75
    rest = 12.75 / share - 12.25
    trace = Trace(lambda p: [p[0] - 5.0, math.sqrt(rest)])
    trace.from_start(0.0)
    # the scene, and for each step a derivative and a trial
    assert len(trace.tried) == 1 + 2 * steps


@pytest.mark.parametrize(("distance", "ends"), [(0.8e-12, True), (1.5e-12, False)])
def test_a_fit_ends_with_a_step_of_round_off(distance: float, ends: bool) -> None:
    trace = Trace(lambda p: [1e13 * (p[0] - distance), 0.0])
    trace.from_start(0.0)
    assert (len(trace.tried) == 3) is ends


def test_nothing_is_fitted_without_a_parameter() -> None:
    make: Any = lambda p: p  # noqa: E731
    trace = Trace(lambda p: [3.0, 4.0])
    p, rms = trace.fit(Hypothesis("", make, ""), np.zeros(0), 7, 0.25, Stepping(1, 0.5))
    assert (p.size, rms, len(trace.tried)) == (0, pytest.approx(math.sqrt(12.5)), 1)


def test_least_squares_of_scaled_columns() -> None:
    # a normal equation of ones has 1e-13 added
    assert least(np.ones((1, 1)), np.ones(1))[0] == pytest.approx(1.0 - 1e-13, abs=3e-14)
    columns = np.array([[0.0, 1e-9], [0.0, 2e-9]])
    np.testing.assert_allclose(least(columns, np.array([1.0, 2.0])), [0.0, 1e9], rtol=1e-12)
    with np.errstate(all="ignore"):
        assert least(np.ones((2, 1)), np.array([np.inf, 1.0])).tolist() == [0.0]
        assert least(np.array([[np.inf], [1.0]]), np.ones(2)).tolist() == [0.0]
