"""Interpolation, adjustment, fits and scalars are those of brute force and closed forms."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.stats import chi2

import dem_bridge as db
from dem_bridge.errors import UsageError
from dem_bridge.scene.geometry import Body, Geometry, Material
from dem_bridge.scene.scene import Scene, Wall
from dem_bridge.studies.measurement.comparison import compare
from dem_bridge.studies.measurement.fit import chosen, fit_parameters
from dem_bridge.studies.measurement.parameters import Parameter, changed, parameters_of
from dem_bridge.studies.measurement.prediction import Adjusted, Prediction, adjust, derivatives
from dem_bridge.studies.measurement.readings import QUANTITIES, Reading, read_measurement
from dem_bridge.studies.measurement.scalars import Scalar, joint_of, scalars_of
from dem_bridge.trajectory.trajectory import UNKNOWN, Floats, Trajectory
from tests.studies.measurement.test_values import SPEED, SPRING, _comparison, _exact, _prediction, _pulses, _series

# interpolation


@dataclass(frozen=True, kw_only=True, eq=False)
class Sampled(Prediction):
    """A prediction whose run has given samples of the velocity of body 1, and its uncertainty."""

    samples_of_run: Floats = field(default_factory=lambda: np.zeros(501))
    error_of_run: float = 0.0

    @property
    def run(self) -> Trajectory:
        run = db.solve(SPRING, backend="verlet", dt=2e-6, uncertainty=False)
        count = len(self.samples_of_run)
        velocity = np.stack([np.zeros(count), self.samples_of_run], axis=1)
        wide: dict[str, Any] = {
            "time": np.linspace(0.0, SPRING.duration, count),
            "velocity": velocity,
            "displacement": velocity,
        }
        return replace(
            run, **wide, contact_force=velocity[:, :1], uncertainty=replace(UNKNOWN, velocity=self.error_of_run)
        )


def _sampled(samples: Floats, time: Floats, **more: Any) -> Sampled:
    reading = Reading(quantity="velocity", place=1, time=time, value=0.0 * time, uncertainty=1.0 + 0.0 * time)
    return Sampled(scene=SPRING, readings=(reading,), backend="verlet", samples_of_run=samples, **more)


def _through(samples: Floats, place: float, nodes: int) -> float:
    """Return the polynomial through the samples around a place, in units of the distance of samples."""
    last = len(samples) - 1
    first = min(max(math.floor(place) - (nodes // 2 - 1), 0), last + 1 - nodes)
    total = 0.0
    for j in range(first, first + nodes):
        others = [i for i in range(first, first + nodes) if i != j]
        total += samples[j] * math.prod((place - i) / (j - i) for i in others)
    return total


PLACES = np.array([0.0, 0.4, 1.7, 2.2, 3.5, 77.25, 250.0, 496.5, 497.6, 498.7, 499.9, 500.0])


def test_values_between_samples_are_those_of_the_polynomial_through_six_of_them() -> None:
    samples = np.random.default_rng(4).standard_normal(501)
    prediction = _sampled(samples, PLACES * SPRING.duration / 500.0)
    assert prediction.sampling.count == 500
    expected = np.array([_through(samples, place, 6) for place in PLACES])
    np.testing.assert_allclose(prediction.simulated, expected, rtol=1e-9, atol=1e-9)
    # its error is taken to be the distance from the polynomial through four
    coarse = np.array([_through(samples, place, 4) for place in PLACES])
    np.testing.assert_allclose(prediction.numerical, np.abs(expected - coarse), rtol=1e-9, atol=1e-9)
    # the scene is as at its ends before and after them
    [reading] = prediction.readings
    np.testing.assert_allclose(prediction.series(reading), expected, rtol=1e-9, atol=1e-9)
    for shift, end in ((-1.0, samples[0]), (1.0, samples[-1])):
        np.testing.assert_allclose(prediction.series(reading, shift), np.full(len(PLACES), end), rtol=1e-12)
    # the slope is a difference over one distance of samples
    step = SPRING.duration / 500.0
    late, early = (np.clip(PLACES + side, 0.0, 500.0) for side in (0.5, -0.5))
    slope = [(_through(samples, b, 6) - _through(samples, a, 6)) / step for a, b in zip(early, late, strict=True)]
    np.testing.assert_allclose(prediction.slope, slope, rtol=1e-7, atol=1e-7 / step)


def test_the_uncertainty_of_a_value_is_that_of_the_run_and_of_its_interpolation() -> None:
    # a straight line is that of any polynomial
    straight, time = np.linspace(0.0, 1.0, 501), PLACES[:3] * 1e-6
    np.testing.assert_allclose(_sampled(straight, time, error_of_run=0.5).numerical, [0.5] * 3, rtol=1e-9)
    rough = np.random.default_rng(4).standard_normal(501)
    alone, both = (_sampled(rough, time, error_of_run=error).numerical for error in (0.0, 0.5))
    np.testing.assert_allclose(both, np.hypot(0.5, alone), rtol=1e-9)


def test_a_series_with_an_unknown_value_is_refused() -> None:
    samples = np.linspace(0.0, 1.0, 501)
    samples[400] = math.nan
    assert np.all(np.isfinite(_sampled(samples, np.array([1e-5, 2e-5])).simulated))
    with pytest.raises(UsageError, match=r"velocity of body 1 is measured, but verlet has no value of it on spring"):
        _ = _sampled(samples, np.array([1e-5, 400.5 * SPRING.duration / 500.0])).simulated


def test_runs_have_between_500_and_20000_samples() -> None:
    counts = [Prediction(scene=replace(SPRING, duration=time), readings=()).sampling.count for time in (1e-5, 1e3)]
    assert counts == [500, 20_000]


def test_changes_of_a_scene_and_of_the_clock_add_up() -> None:
    prediction = _prediction()
    declared = parameters_of({"velocity": 0.01, "time": 1e-6}, SPRING)
    late = prediction.at(declared, [0.02, 2e-5])[:10]
    time = np.minimum(prediction.readings[0].time + 2e-5, SPRING.duration)
    np.testing.assert_allclose(late, 1.02 * np.concatenate([_exact(1, time), _exact(0, time)]), atol=2e-4 * SPEED)
    with pytest.raises(ValueError, match="zip"):
        prediction.at(declared, [0.02])
    with pytest.raises(ValueError, match="zip"):
        changed(SPRING, declared, [0.02])


# adjustment


@dataclass(frozen=True, kw_only=True, eq=False)
class Linear(Prediction):
    """Values that are ``base + slopes x + bend (slopes x)^2``; x are changes in standard uncertainties of 0.02."""

    base: Floats = field(default_factory=lambda: np.zeros(1))
    slopes: Floats = field(default_factory=lambda: np.zeros((1, 1)))
    bend: float = 0.0
    calls: list[Floats] = field(default_factory=list)

    @property
    def simulated(self) -> Floats:
        return self.base

    @property
    def numerical(self) -> Floats:
        return np.zeros(len(self.base))

    def at(self, parameters: Sequence[Parameter], changes: Sequence[float]) -> Floats:
        names = [int(item.place or 0) for item in parameters]
        self.calls.append(np.array(changes))
        first = self.slopes[:, names] @ (np.array(changes) / 0.02)
        return np.asarray(self.base + first + self.bend * first**2)


def _linear(slopes: Any, base: Any = 0.0, **more: Any) -> tuple[Linear, tuple[Parameter, ...]]:
    array = np.array(slopes, dtype=float)
    count = array.shape[1]
    scene = Scene(name="row", duration=1e-3, mass=(1.0,) * 5, stiffness=(1e9,) * 4, velocity=(1.0, 0.0, 0.0, 0.0, 0.0))
    values = np.zeros(len(array)) + base
    reading = Reading(
        quantity="peak_force", place=0, time=values * np.nan, value=values, uncertainty=1.0 + 0.0 * values
    )
    prediction = Linear(scene=scene, readings=(reading,), base=values, slopes=array, **more)
    return prediction, parameters_of({f"stiffness[{k}]": 0.02 for k in range(count)}, scene)


SLOPES = [[1.0, 0.5], [0.0, 2.0], [1.0, -1.0], [0.25, 0.0]]


@pytest.mark.parametrize("free", [0, 1, 2])
def test_adjusted_parameters_are_those_of_the_normal_equations(free: int) -> None:
    prediction, parameters = _linear(SLOPES, base=0.5)
    measured, sigma = np.array([2.0, 1.0, -1.0, 0.5]), np.array([0.5, 1.0, 0.25, np.nan])
    found = adjust(prediction, parameters, measured, sigma, free=free)
    # a value of unknown uncertainty counts for nothing, nor does the declared one of a free parameter
    weight = np.diag(np.array([4.0, 1.0, 16.0, 0.0]))
    slopes = np.array(SLOPES)
    normal = slopes.T @ weight @ slopes + np.diag([0.0] * free + [1.0] * (2 - free))
    x = np.linalg.solve(normal, slopes.T @ weight @ (measured - 0.5))
    np.testing.assert_allclose(found.x, x, rtol=1e-9)
    np.testing.assert_allclose(found.values, 0.5 + slopes @ x, rtol=1e-9)
    np.testing.assert_allclose(found.linear, np.full(4, 0.5), rtol=1e-9)
    np.testing.assert_allclose(found.slopes, slopes, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(found.jacobian.T @ found.jacobian, normal, rtol=1e-9)
    terms = found.residuals(np.zeros(2))
    np.testing.assert_allclose(terms[4:], np.zeros(2 - free))
    np.testing.assert_allclose(terms[:4], [-3.0, -0.5, 6.0, 0.0], atol=1e-12)
    assert found.converged
    assert found.decides()
    # derivatives are central differences over a tenth of an uncertainty
    bent, parameters = _linear([[2.0]], bend=0.5)
    np.testing.assert_allclose(
        derivatives(bent, parameters, np.array([3.0])), [[2.0 + 2.0 * 0.5 * 2.0 * 6.0]], rtol=1e-9
    )
    assert sorted(float(call[0]) for call in bent.calls) == pytest.approx([0.02 * 2.9, 0.02 * 3.1])


def test_without_parameters_the_sum_is_the_least_one_and_decides() -> None:
    prediction, _ = _linear(np.zeros((2, 0)), base=1.0)
    found = adjust(prediction, (), np.array([1.0, 3.0]), np.array([1.0, 2.0]))
    assert found.converged is True
    assert found.decides() is True
    np.testing.assert_array_equal(found.values, [1.0, 1.0])
    assert found.slopes.shape == (2, 0)


@pytest.mark.parametrize(("decrease", "rounds"), [(0.0099, 1), (0.0101, 2), (0.0199, 2)])
def test_a_decrease_of_less_than_a_hundredth_is_the_last(decrease: float, rounds: int) -> None:
    # one value with a slope of 1: from E^2 to half of it, because the declared uncertainty takes its share
    prediction, parameters = _linear([[1.0]])
    found = adjust(prediction, parameters, np.array([math.sqrt(2.0 * decrease)]), np.array([1.0]))
    assert found.converged
    assert found.x[0] == pytest.approx(0.5 * math.sqrt(2.0 * decrease), rel=1e-6)
    # the sum at the start, two values for derivatives in each round and one after it, and the last values
    steps = [call for call in prediction.calls if abs(abs(call[0] - 0.02 * found.x[0]) - 0.002) < 1e-9]
    assert len(steps) == 2 * (rounds - 1)


def _judged(bend: float, count: int, *, converged: bool = True) -> Adjusted:
    """Return an adjusted parameter of uncertainty 0.5 with terms that bend."""
    return Adjusted(
        x=np.array([1.0]),
        values=np.zeros(count),
        slopes=np.zeros((count, 1)),
        residuals=lambda x: np.array([2.0 * x[0] + bend * (x[0] - 1.0) ** 2, 1.0]),
        jacobian=np.array([[2.0], [0.0]]),
        converged=converged,
    )


@pytest.mark.parametrize("count", [1, 8])
def test_a_sum_decides_if_its_bend_is_small_beside_its_spread(count: int) -> None:
    # eight points with the uncertainty of the parameter, and half a standard deviation of the sum
    steps = 0.5 * np.random.default_rng(0).standard_normal((8, 1))[:, 0]
    limit = math.sqrt(0.5 * math.sqrt(2.0 * count) / float(np.mean(steps**4)))
    assert [_judged(part * limit, count).decides() for part in (0.0, 0.99, 1.01)] == [True, True, False]
    assert not _judged(0.0, count, converged=False).decides()


def test_parameters_that_no_scene_can_have_are_not_adjusted_to() -> None:
    class Limited(Linear):
        def at(self, parameters: Sequence[Parameter], changes: Sequence[float]) -> Floats:
            if abs(changes[0]) > 0.05:
                raise UsageError("no scene")
            return super().at(parameters, changes)

    _, parameters = _linear([[1.0]])
    limited = Limited(scene=SPRING, readings=(), base=np.zeros(1), slopes=np.ones((1, 1)))
    # the step would go to four uncertainties: its half, 2, is the first within the limit of 2.5
    found = adjust(limited, parameters, np.array([4.0]), np.array([1e-3]))
    assert 0.0 < found.x[0] <= 2.5
    assert not found.converged


# comparison


def test_spreads_of_two_samples_are_those_of_their_standard_deviation() -> None:
    prediction, parameters = _linear(SLOPES, bend=0.7)
    for count in (2, 5):
        _, changes = prediction.samples(parameters, count=count, seed=3)
        both = compare(prediction, parameters, count=count, seed=3)
        np.testing.assert_allclose(both.input, np.std(changes, axis=0, ddof=1), rtol=1e-9)
    assert both.readings == prediction.readings


def test_values_at_their_limit_are_within() -> None:
    both = _comparison(
        simulated=np.array([1.0, 2.0, 12.0]), measured=np.array([0.5, 1.0, 10.0]), numerical=np.array([0.5, 0.5, 2.0]),
        input=np.zeros(3), data=np.zeros(3),
    )  # fmt: skip
    assert both.share_within(1.0) == pytest.approx(2.0 / 3.0)
    assert both.words(1.0) == ["within", "larger", "within"]
    small: dict[str, Any] = {"input": np.zeros(3), "data": np.full(3, 0.1)}
    values, missing = np.array([1.0, 2.0, 12.0]), np.array([np.nan, 2.0, 12.0])
    for unknown in (_comparison(simulated=missing, **small), _comparison(simulated=values, measured=missing, **small)):
        assert not unknown.decides("velocity", 0.1)
        assert unknown.decides("peak_force", 0.1)


@pytest.mark.parametrize(("size", "word"), [(2.0, 1.0), (0.5, 1.0), (3.0, 2.0)])
def test_a_limit_is_known_to_the_doubt_of_its_part_from_samples(size: float, word: float) -> None:
    # u_val = 5/3 of u_input; the limit k u_val is known to k doubt u_input^2 / u_val
    bar = word * 0.25 * size**2 / (size * 5.0 / 3.0)
    limit = word * size * 5.0 / 3.0
    for part, expected in ((-1.02, "within"), (-0.98, "undecided"), (0.98, "undecided"), (1.02, "larger")):
        error = limit + part * bar
        item = Scalar(
            name="", reading=_series(0), unit="", simulated=error, measured=0.0, numerical=size * 4.0 / 3.0, input=size,
            data=0.0, doubt=0.25,
        )  # fmt: skip
        assert item.word(word) == expected
        both = _comparison(
            simulated=np.full(3, error), measured=np.zeros(3), numerical=np.full(3, size * 4.0 / 3.0),
            input=np.full(3, size), data=np.zeros(3), count=9,
        )  # fmt: skip
        assert both.words(word) == [expected] * 3


# fits


def _fitted(prediction: Linear, parameters: Sequence[Parameter], count: int, measured: Any, noise: Any) -> Any:
    array = np.array(measured, dtype=float)
    return fit_parameters(prediction, parameters[:count], parameters[count:], array, np.zeros(len(array)) + noise)


def test_two_fitted_parameters_have_the_covariance_of_the_normal_equations() -> None:
    prediction, parameters = _linear([*SLOPES, [1.0, 1.0]], base=0.5)
    slopes, measured = np.array([*SLOPES, [1.0, 1.0]]), np.array([2.0, 1.0, -1.0, 0.5, 0.0])
    fit = _fitted(prediction, parameters, 2, measured, 0.1)
    covariance = 0.01 * np.linalg.inv(slopes.T @ slopes)
    x = np.linalg.solve(slopes.T @ slopes, slopes.T @ (measured - 0.5))
    errors = np.sqrt(np.diag(covariance))
    assert [item.change for item in fit.fitted] == pytest.approx((0.02 * x).tolist(), rel=1e-6)
    assert [item.uncertainty for item in fit.fitted] == pytest.approx((0.02 * errors).tolist(), rel=1e-6)
    assert fit.correlation == pytest.approx(abs(covariance[0, 1]) / (errors[0] * errors[1]), rel=1e-6)
    for item, value, error in zip(fit.fitted, x, errors, strict=True):
        assert (item.low, item.high) == pytest.approx(
            (0.02 * (value - 1.96 * error), 0.02 * (value + 1.96 * error)), rel=1e-2
        )
    assert (fit.joint.count, fit.joint.statistic) == (
        3, pytest.approx(100.0 * np.sum((0.5 + slopes @ x - measured) ** 2), rel=1e-6),
    )  # fmt: skip
    assert fit.declared is not None
    assert (fit.declared.count, fit.declared.statistic) == (
        2, pytest.approx(x @ np.linalg.solve(covariance + np.eye(2), x), rel=1e-6),
    )  # fmt: skip
    # another uncertain parameter counts as an error of the values: the second one by its declared uncertainty
    alone = _fitted(prediction, parameters, 1, measured, 0.1)
    inverse = np.linalg.inv(0.01 * np.eye(5) + np.outer(slopes[:, 1], slopes[:, 1]))
    information = slopes[:, 0] @ inverse @ slopes[:, 0]
    assert alone.fitted[0].uncertainty == pytest.approx(0.02 / math.sqrt(information), rel=1e-6)
    assert alone.fitted[0].change == pytest.approx(
        0.02 * (slopes[:, 0] @ inverse @ (measured - 0.5)) / information, rel=1e-6
    )
    assert alone.correlation == pytest.approx(0.0, abs=1e-12)


def test_a_value_and_a_parameter_leave_one_degree_of_freedom() -> None:
    prediction, parameters = _linear([[2.0]])
    assert _fitted(prediction, parameters, 1, [1.0], 0.1).joint.count == 1


def test_parameters_without_an_effect_and_those_that_do_the_same_are_named() -> None:
    prediction, parameters = _linear([[1.0, 0.0, 1e-3], [1.0, 0.0, 0.0], [0.5, 0.0, 1.0]], base=[1.0, 2.0, 3.0])
    nothing = _fitted(prediction, parameters, 3, [1.5, 2.0, 2.0], [0.5, 1.0, 0.25])
    assert (nothing.fitted, nothing.undetermined, nothing.correlation) == ((), ("stiffness[1]",), 1.0)
    # the sum of squares of the values as they are
    assert (nothing.joint.statistic, nothing.joint.count) == (pytest.approx(1.0 + 16.0), 3)
    assert nothing.joint.p == pytest.approx(chi2.sf(17.0, 3))
    np.testing.assert_array_equal(nothing.values, [1.0, 2.0, 3.0])
    # small effects determine as well as large ones
    small, parameters = _linear(1e-6 * np.array(SLOPES))
    assert _fitted(small, parameters, 2, np.zeros(4), 1e-9).undetermined == ()
    # the first and the last of four do the same, a thousand times as strongly
    same = np.random.default_rng(2).standard_normal((9, 4))
    same[:, 3] = 1e3 * same[:, 0]
    twice, parameters = _linear(same)
    assert _fitted(twice, parameters, 4, np.zeros(9), 1.0).undetermined == ("stiffness[0]", "stiffness[3]")


@pytest.mark.parametrize(("share", "named"), [(0.125, True), (0.08, False)])
def test_a_parameter_is_named_if_it_has_a_tenth_of_what_the_values_leave(share: float, named: bool) -> None:
    # the third effect is the sum of the first and of a part of the second: a direction that moves no value
    part = share * math.sqrt(2.0 / (1.0 - share**2))  # (-1, -part, sqrt(1 + part^2)) in effects of length 1
    third = [1.0, part, 0.0]
    prediction, parameters = _linear(np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], third]).T)
    direction = np.array([-1.0, -part, math.sqrt(1.0 + part**2)])
    assert abs(direction[1]) / np.linalg.norm(direction) == pytest.approx(share, rel=0.05)
    names = ("stiffness[0]", *(("stiffness[1]",) if named else ()), "stiffness[2]")
    assert _fitted(prediction, parameters, 3, [0.0] * 3, 1.0).undetermined == names


@pytest.mark.parametrize(("angle", "names"), [(0.9, ("stiffness[0]", "stiffness[1]")), (1.1, ())])
def test_parameters_are_told_apart_by_a_thousandth(angle: float, names: tuple[str, ...]) -> None:
    # two effects of equal length whose directions differ by twice an angle: singular values are its cotangent apart
    half = angle * 1e-3
    prediction, parameters = _linear([[5.0 * math.cos(half)] * 2, [5.0 * math.sin(half), -5.0 * math.sin(half)]])
    assert _fitted(prediction, parameters, 2, [0.0, 0.0], 1e-4).undetermined == names


def test_ends_of_an_interval_are_those_of_the_likelihood_far_from_normal() -> None:
    # values x + 0.4 x^2 with a noise of 1: the sum is 3.841 where x + 0.4 x^2 is 1.96
    prediction, parameters = _linear([[1.0]], bend=0.4)
    [found] = _fitted(prediction, parameters, 1, [0.0], 1.0).fitted
    high = (math.sqrt(1.0 + 1.6 * 1.959964) - 1.0) / 0.8
    assert found.high == pytest.approx(0.02 * high, rel=0.02)
    assert found.low == pytest.approx(0.02 * (-math.sqrt(1.0 + 1.6 * 1.959964) - 1.0) / 0.8, rel=0.02)
    # within three normal ends of x + 0.2 x^2 the values do not go so far below, and the normal end stands
    turned, parameters = _linear([[1.0]], bend=0.2)
    [found] = _fitted(turned, parameters, 1, [0.0], 1.0).fitted
    assert found.low == pytest.approx(-0.02 * 1.959964, rel=1e-3)
    # a second value that no parameter moves adds 9 to the sum everywhere, and nothing to its differences
    offset, parameters = _linear([[1.0], [0.0]], bend=0.4)
    [found] = _fitted(offset, parameters, 1, [0.0, 3.0], 1.0).fitted
    assert found.high == pytest.approx(0.02 * high, rel=0.02)
    bent, parameters = _linear([[1.0]], bend=3.0)
    [found] = _fitted(bent, parameters, 1, [0.0], 1.0).fitted
    assert found.high == pytest.approx(0.02 * (math.sqrt(1.0 + 12.0 * 1.959964) - 1.0) / 6.0, rel=0.03)


def test_parameters_at_one_place_are_not_fitted_unless_they_are_named() -> None:
    _, parameters = _linear(SLOPES)
    assert chosen(parameters, None) == ([], list(parameters))
    assert chosen(parameters, ["stiffness[1]"]) == ([parameters[1]], [parameters[0]])


# parameters


@pytest.mark.parametrize(("change", "angle"), [(5.0, None), (-200.0, None), (95.0, None), (179.0, None)])
def test_an_angle_between_axes_is_at_most_a_right_one(change: float, angle: None) -> None:
    scene = db.load_scene("decelerating-40")
    assert scene.geometry is not None
    own = scene.geometry.angle[3]
    assert own is not None
    turned = changed(scene, parameters_of({"angle[3]": 0.1}, scene), [change])
    assert turned.geometry is not None
    # the angle between two lines, by their directions
    first, second = (
        np.array([1.0, 0.0]),
        np.array([math.cos(math.radians(own + change)), math.sin(math.radians(own + change))]),
    )
    between = math.degrees(math.acos(min(abs(float(first @ second)), 1.0)))
    assert turned.geometry.angle[3] == pytest.approx(between, abs=1e-6)
    assert turned.geometry.angle[:3] == scene.geometry.angle[:3]


GLASS = Material(youngs_modulus=72e9, poissons_ratio=0.17, density=2200.0, name="glass")
SPHERE = Body(shape="sphere", radius=9e-3, material=GLASS)
CYLINDER = replace(SPHERE, shape="cylinder", height=18e-3)


def _crossed(*angles: float | None) -> Scene:
    """Return a chain that a sphere hits if the first of these angles is None, of cylinders if another is a number."""
    alone = all(angle is None for angle in angles)
    bodies = [SPHERE if angles[0] is None else CYLINDER, *(SPHERE if alone else CYLINDER for _ in angles)]
    geometry = Geometry(bodies=tuple(bodies), angles=angles)
    stiffness = tuple(geometry.contact(k).stiffness for k in range(len(angles)))
    speed = (0.8, *(0.0,) * len(angles))
    mass = tuple(body.mass for body in bodies)
    return Scene(name="crossed", duration=2e-4, mass=mass, stiffness=stiffness, velocity=speed, geometry=geometry)


@pytest.mark.parametrize(("change", "angle"), [(10.0, 40.0), (-10.0, 20.0), (-45.0, 15.0), (75.0, 75.0)])
def test_a_turned_contact_has_the_stiffness_of_its_new_angle_and_others_keep_theirs(
    change: float, angle: float
) -> None:
    scene = _crossed(None, 30.0, 50.0)
    turned = changed(scene, parameters_of({"angle[1]": 0.1}, scene), [change])
    expected = _crossed(None, angle, 50.0)
    assert turned.stiffness == pytest.approx(expected.stiffness, rel=1e-9)
    assert turned.stiffness[::2] == scene.stiffness[::2]
    # all contacts that have an angle turn with the parameter of the whole scene
    every = changed(scene, parameters_of({"angle": 0.1}, scene), [2.0])
    assert every.stiffness == pytest.approx(_crossed(None, 32.0, 52.0).stiffness, rel=1e-9)
    # relative to the stiffness that the scene states, which may be another than that of its geometry
    own = replace(scene, stiffness=tuple(1.5 * value for value in scene.stiffness))
    softer = changed(own, parameters_of({"angle[1]": 0.1}, own), [change])
    assert softer.stiffness[1] == pytest.approx(1.5 * expected.stiffness[1], rel=1e-9)


def test_a_chain_of_spheres_has_no_angle_to_turn() -> None:
    with pytest.raises(UsageError, match="parameter angle: crossed has no contact angles; allowed: a scene with cyl"):
        parameters_of({"angle": 0.1}, _crossed(None, None))


def test_contacts_of_both_walls_change_in_the_order_of_their_places() -> None:
    walls = {side: Wall(stiffness=value, exponent=2.0) for side, value in (("wall_left", 1e6), ("wall_right", 3e6))}
    scene = replace(SPRING, **walls)  # type: ignore[arg-type]
    declared = parameters_of({f"{kind}[{k}]": 0.1 for kind in ("stiffness", "exponent") for k in range(3)}, scene)
    found = changed(scene, declared, [0.1, 0.2, 0.3, 0.01, 0.02, 0.03])
    assert found.wall_left is not None
    assert found.wall_right is not None
    of_walls = [(wall.stiffness, wall.exponent) for wall in (found.wall_left, found.wall_right)]
    assert np.array(of_walls).ravel().tolist() == pytest.approx([1.2e6, 2.02, 3.9e6, 2.03], rel=1e-12)
    assert (*found.stiffness, *np.atleast_1d(found.contacts.exponent[:1])) == pytest.approx((2.2e6, 2.01), rel=1e-12)


def test_the_largest_of_several_changes_is_named_with_its_sign() -> None:
    declared = parameters_of({"mass[0]": 0.5, "mass[1]": 0.5}, SPRING)
    for changes, said in (([-1.2, 0.5], "-1.2"), ([0.5, -1.5], "-1.5"), ([-1.2, 1.5], "1.5")):
        with pytest.raises(UsageError, match=rf"^parameter mass: a change by {re.escape(said)} gives an invalid scene"):
            changed(SPRING, declared, changes)


def test_a_body_without_contacts_has_values_that_go_with_its_start_velocity() -> None:
    alone = Scene(name="alone", duration=1e-3, mass=(0.5,), stiffness=(), velocity=(2.0,))
    time = np.array([1e-4, 9e-4])
    reading = Reading(quantity="displacement", place=0, time=time, value=2.0 * time, uncertainty=0.0 * time + 1e-6)
    prediction = Prediction(scene=alone, readings=(reading,))
    assert prediction.frequency == 0.0
    np.testing.assert_allclose(prediction.simulated, 2.0 * time, rtol=1e-9)
    faster = prediction.at(parameters_of({"velocity": 0.01}, alone), [0.25])
    np.testing.assert_allclose(faster, 2.5 * time, rtol=1e-9)


def test_a_chain_of_cylinders_behind_a_ball_has_angles() -> None:
    scene = db.load_scene("decelerating-40")
    assert scene.geometry is not None
    if None in scene.geometry.angle:
        assert parameters_of({"angle": 0.1}, scene)
    assert [item.independent for item in parameters_of({"mass": 0.1, "mass[*]": 0.1}, SPRING)] == [False, True, True]
    assert not Parameter(kind="mass", place=None, uncertainty=0.1).independent


@pytest.mark.parametrize(
    ("declared", "said"),
    [
        ({"mass": 0.0}, "parameter mass = 0.0; allowed: a standard uncertainty > 0"),
        ({"mass": math.inf}, "parameter mass = inf; allowed: a standard uncertainty > 0"),
        ({"mass": math.nan}, "parameter mass = nan; allowed: a standard uncertainty > 0"),
        ({"gain[0]": 0.1}, "parameter 'gain[0]'; allowed: no place"),
        ({"mass[2]": 0.1}, "parameter 'mass[2]'; allowed: body 0 to 1"),
        ({"stiffness[1]": 0.1}, "parameter 'stiffness[1]'; allowed: contact 0 to 0"),
    ],
)
def test_declared_uncertainties_are_positive_and_places_exist(declared: dict[str, float], said: str) -> None:
    with pytest.raises(UsageError) as error:
        parameters_of(declared, SPRING)
    assert said in str(error.value)


# scalars


@pytest.mark.parametrize(("sigma", "count"), [(0.2, 2), (0.25, 0), (0.133, 2), (0.07, 2)])
def test_pulses_above_three_uncertainties_are_seen(sigma: float, count: int) -> None:
    time = np.linspace(1e-6, 2.5e-4, 60)
    # body 0 begins with 0.8 m/s: three uncertainties are at most 0.267 m/s each
    reading = _series(0, time, sigma * 0.8 / 0.64)
    prediction = Prediction(scene=SPRING, readings=(reading,), backend="verlet", dt=2e-8)
    assert len(scalars_of(prediction, compare(prediction, (), count=3, seed=0))) == (
        count if sigma * 1.25 < 0.2666 else 0
    )


def test_four_values_of_a_pulse_are_enough() -> None:
    reading = _series(1, np.array([4e-5, 7e-5, 1e-4, 1.3e-4]), 0.001)
    prediction = Prediction(scene=SPRING, readings=(reading,), backend="verlet", dt=2e-8)
    assert len(scalars_of(prediction, compare(prediction, (), count=3, seed=0))) == 2
    # at rest after they have parted no shift is seen
    flat = _series(1, np.linspace(3e-4, 3.9e-4, 9), 0.001)
    rest = Prediction(scene=SPRING, readings=(flat,), backend="verlet", dt=2e-8)
    assert scalars_of(rest, compare(rest, (), count=3, seed=0)) == []


@pytest.mark.parametrize("sigma", [1e-3, 1e-9])
def test_a_pulse_whose_delay_looks_like_a_factor_is_not_read(sigma: float) -> None:
    # a body slows down as exp(-b t) by its drag: a later pulse is a larger one
    drag, mass = 2e3, 1e-3
    alone = Scene(name="alone", duration=1e-3, mass=(mass,), stiffness=(), velocity=(0.8,), drag=drag)
    time = np.linspace(1e-5, 9e-4, 20)
    value = 0.8 * np.exp(-drag * time)
    reading = Reading(quantity="velocity", place=0, time=time, value=value, uncertainty=np.full(20, sigma))
    prediction = Prediction(scene=alone, readings=(reading,))
    np.testing.assert_allclose(prediction.simulated, value, rtol=1e-6)
    assert scalars_of(prediction, compare(prediction, (), count=3, seed=0)) == []


def test_a_pulse_is_that_of_the_largest_value_and_of_its_time() -> None:
    time = np.linspace(1e-6, 2.5e-4, 60)
    for body, at in ((0, 0), (1, int(np.argmax(_exact(1, time))))):
        reading = _series(body, time, 0.004)
        prediction = Prediction(scene=SPRING, readings=(reading,), backend="verlet", dt=2e-8)
        peak, arrival = scalars_of(prediction, compare(prediction, (), count=3, seed=0))
        assert peak.simulated == pytest.approx(_exact(body, time)[at], rel=1e-4)
        assert abs(arrival.simulated - time[at]) < 1e-12 or body == 1
        assert _exact(1, np.array([arrival.simulated]))[0] == pytest.approx(_exact(1, time)[at], rel=1e-4)


def test_peak_and_time_have_the_uncertainties_of_a_linear_fit() -> None:
    time = np.linspace(1e-6, 2.5e-4, 60)
    late = 1.5e-5
    value = 1.1 * _exact(1, np.maximum(time - late, 0.0))
    sigma = np.linspace(0.002, 0.006, 60)
    reading = replace(_series(1, time), value=value, uncertainty=sigma)
    prediction = Prediction(scene=SPRING, readings=(reading,), backend="verlet", dt=2e-8)
    declared = parameters_of({"gain": 0.03, "time": 2e-6}, SPRING)
    both = compare(prediction, declared, count=3, seed=0)
    peak, arrival = scalars_of(prediction, both)
    assert (peak.measured / peak.simulated, -arrival.error) == (
        pytest.approx(1.1, rel=1e-3),
        pytest.approx(late, rel=1e-2),
    )
    # the measured pulse is a(t - s): its derivatives by the factor and by the shift, weighted
    step = 1e-8
    pulse = [_exact(1, np.maximum(time - late + side * step, 0.0)) for side in (-1.0, 0.0, 1.0)]
    columns = np.stack([pulse[1], -1.1 * (pulse[2] - pulse[0]) / (2.0 * step)], axis=1)
    inverse = np.linalg.inv(columns.T @ (columns / sigma[:, None] ** 2))
    functional = inverse @ (columns / sigma[:, None] ** 2).T * np.array([[peak.simulated], [1.0]])
    for item, row in zip((peak, arrival), functional, strict=True):
        np.testing.assert_allclose(item.weights, row, atol=0.05 * float(np.max(np.abs(row))))
    effects = both.of_measurement
    data = np.sqrt(np.sum((functional * sigma) ** 2, axis=1) + np.sum((functional @ effects) ** 2, axis=1))
    assert (peak.data, arrival.data) == (pytest.approx(data[0], rel=0.05), pytest.approx(data[1], rel=0.05))
    assert (peak.input, peak.doubt) == (0.0, both.doubt)
    np.testing.assert_allclose([peak.numerical, arrival.numerical], np.abs(functional) @ both.numerical, rtol=0.1)
    # with an unknown numerical uncertainty the scalars have none, and their comparison leaves them out
    unknown = replace(both, numerical=np.where(np.arange(60) == 3, np.inf, both.numerical))
    infinite = scalars_of(prediction, unknown)
    assert [item.numerical for item in infinite] == [math.inf] * 2
    assert joint_of(infinite, unknown) is None


def test_the_joint_comparison_of_pulses_has_all_of_their_uncertainties() -> None:
    prediction, both = _pulses(1.02, 2e-6)
    scalars = [replace(item, numerical=0.5 * item.data) for item in scalars_of(prediction, both)]
    slopes = np.random.default_rng(1).standard_normal((120, 3)) * 0.004
    spoiled = replace(both, slopes=slopes)
    direct = Scalar(
        name="", reading=scalars[0].reading, unit="", simulated=9.0, measured=0.0, numerical=0.1,
        input=0.0, data=0.0, doubt=0.0,
    )  # fmt: skip
    assert direct.weights.shape == (0,)
    assert joint_of([direct], spoiled) is None
    joint = joint_of([direct, *scalars], spoiled)
    assert joint is not None
    # all values at once: a matrix of the weights of each scalar over the values of both readings
    weights = np.zeros((4, 120))
    for k, item in enumerate(scalars):
        weights[k, spoiled.rows(item.reading)] = item.weights
    covariance = weights @ (np.diag(spoiled.noise**2) + slopes @ slopes.T) @ weights.T
    covariance += np.diag([item.numerical**2 for item in scalars])
    errors = weights @ spoiled.linear_error
    scale = np.sqrt(np.diag(covariance))
    expected = (errors / scale) @ np.linalg.inv(covariance / np.outer(scale, scale)) @ (errors / scale)
    assert (joint.count, joint.statistic) == (4, pytest.approx(expected, rel=1e-6))


# files


def _read(folder: Path, text: str) -> tuple[Reading, ...]:
    (folder / "laser.csv").write_text(text, encoding="utf-8")
    return read_measurement([folder / "laser.csv"], SPRING)


@pytest.mark.parametrize(
    ("quantity", "unit", "axis", "sampled"),
    [
        ("velocity", "m_per_s", "body", True), ("displacement", "m", "body", True),
        ("contact_force", "N", "contact", True), ("arrival", "s", "body", False),
        ("peak_velocity", "m_per_s", "body", False), ("peak_force", "N", "contact", False),
    ],
)  # fmt: skip
def test_each_quantity_has_its_unit_place_and_times(
    quantity: str, unit: str, axis: str, sampled: bool, tmp_path: Path
) -> None:
    text = f"time_s,{axis},{quantity}_{unit},uncertainty_{unit}\n1e-5,0,0.5,0.1\n"
    [reading] = _read(tmp_path, text)
    assert (reading.quantity, reading.sampled, reading.label) == (
        quantity, sampled, f"{quantity.replace('_', ' ')} of {axis} 0",
    )  # fmt: skip
    assert reading.time[0] == 1e-5 if sampled else math.isnan(reading.time[0])
    assert len(QUANTITIES) == 6


@pytest.mark.parametrize("heading", ["arrival", "arrival_time"])
def test_a_name_of_two_words_is_not_taken_for_a_name_and_a_unit(heading: str, tmp_path: Path) -> None:
    [reading] = _read(tmp_path, f"body,{heading}_us,{heading}_uncertainty_us\n1,50,2\n")
    assert (reading.quantity, reading.value[0], reading.uncertainty[0]) == (
        "arrival", pytest.approx(5e-5), pytest.approx(2e-6),
    )  # fmt: skip
    with pytest.raises(UsageError, match=f"column '{heading}' has no unit; write {heading}_s"):
        _read(tmp_path, f"body,{heading},uncertainty_s\n1,50,2\n")


@pytest.mark.parametrize(
    ("quantity", "units"),
    [("displacement", ("m", "mm", "um", "µm", "nm")), ("force", ("N", "kN", "mN")), ("arrival", ("s", "ms", "us"))],
)
def test_the_uncertainty_of_all_places_has_a_unit_of_its_own(
    quantity: str, units: tuple[str, ...], tmp_path: Path
) -> None:
    values = {"m": 1.0, "mm": 1e-3, "um": 1e-6, "µm": 1e-6, "nm": 1e-9, "N": 1.0, "kN": 1e3, "mN": 1e-3}
    values |= {"s": 1.0, "ms": 1e-3, "us": 1e-6}
    for unit in units:
        text = f"time_s,body,contact,{quantity}_{units[0]},uncertainty_{unit}\n1e-5,0,0,0.5,0.25\n"
        [reading] = _read(tmp_path, text)
        assert (reading.value[0], reading.uncertainty[0]) == (0.5, pytest.approx(0.25 * values[unit]))


def test_values_of_several_files_stand_in_the_order_of_their_times(tmp_path: Path) -> None:
    head = "time_us,body,velocity_m_per_s,uncertainty_m_per_s\n"
    (tmp_path / "a.csv").write_text(head + "# comment\n\n30,1,0.3,0.03\n10,1,0.1,0.01\n")
    (tmp_path / "b.csv").write_text(head + "20,1,0.2,0.02\n5,0,0.5,0.05\n")
    zero, one = read_measurement([tmp_path / "a.csv", tmp_path / "b.csv"], SPRING)
    assert (zero.place, one.place) == (0, 1)
    assert (one.value.tolist(), one.uncertainty.tolist()) == ([0.1, 0.2, 0.3], [0.01, 0.02, 0.03])
    assert one.time == pytest.approx([1e-5, 2e-5, 3e-5])
    # lines are counted with comments and empty ones
    (tmp_path / "b.csv").write_text("# comment\n\n" + head + "20,2,0.2,0.02\n")
    with pytest.raises(UsageError, match=r"b\.csv: line 4: body = 2; allowed: a whole number from 0 to 1"):
        read_measurement([tmp_path / "a.csv", tmp_path / "b.csv"], SPRING)


def test_a_line_without_the_delimiter_of_the_headings_is_refused_by_its_number(tmp_path: Path) -> None:
    text = "time_s;body;velocity_m_per_s;uncertainty_m_per_s\n1e-5 1 0.5 0.1\n2e-5;1;0.5;0.1\n"
    with pytest.raises(UsageError, match="line 2 has 1 cells; allowed: 4, one for each heading"):
        _read(tmp_path, text)
    for time, fine in ((0.9e-9, True), (1.1e-9, False)):
        late = text.replace("1e-5 1 0.5 0.1", f"{SPRING.duration * (1.0 + time)!r};1;0.5;0.1")
        if fine:
            assert len(_read(tmp_path, late)[0].time) == 2
        else:
            with pytest.raises(UsageError, match="line 2: time = "):
                _read(tmp_path, late)
