"""Each value has its own place, time and uncertainty, and statistics are those of hand-computed numbers."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.stats import chi2, norm

import dem_bridge as db
from dem_bridge.errors import UsageError
from dem_bridge.scene.scene import Scene, Wall
from dem_bridge.studies.measurement.comparison import Comparison, Joint, compare
from dem_bridge.studies.measurement.fit import fit_parameters
from dem_bridge.studies.measurement.parameters import changed, parameters_of
from dem_bridge.studies.measurement.prediction import FEWEST, MOST, Prediction
from dem_bridge.studies.measurement.readings import Reading, read_measurement
from dem_bridge.studies.measurement.scalars import Scalar, joint_of, scalars_of
from dem_bridge.trajectory.trajectory import Floats

#: two bodies on a linear spring: the relative velocity is v cos(omega t) until they part
MASS, STIFFNESS, SPEED = (0.01, 0.03), 2e6, 0.8
OMEGA = math.sqrt(STIFFNESS * sum(MASS) / math.prod(MASS))
SPRING = Scene(
    name="spring", duration=4e-4, mass=MASS, stiffness=(STIFFNESS,), velocity=(SPEED, 0.0), exponent=2.0, samples=10
)
PARTED = math.pi / OMEGA
#: of times without a sample, before and after the bodies have parted
TIMES = np.array([3.3e-6, 5.7e-5, 1.234e-4, 2.01e-4, 3.9e-4])


def _exact(body: int, time: Floats) -> Floats:
    """Return the velocity of a body of the spring by the closed form."""
    common, share = SPEED * MASS[0] / sum(MASS), (MASS[1], -MASS[0])[body] / sum(MASS)
    relative = SPEED * np.cos(OMEGA * np.minimum(time, PARTED))
    return np.asarray(common + share * relative)


def _series(body: int, time: Floats = TIMES, sigma: float = 0.01) -> Reading:
    value, uncertainty = _exact(body, time), np.full(len(time), sigma)
    return Reading(quantity="velocity", place=body, time=time, value=value, uncertainty=uncertainty)


def _scalar(quantity: str, place: int, *values: float) -> Reading:
    number = np.array(values)
    return Reading(
        quantity=quantity, place=place, time=np.full(len(number), np.nan), value=number, uncertainty=0.01 * number
    )


FORCE = SPEED * math.sqrt(STIFFNESS * math.prod(MASS) / sum(MASS))
ARRIVAL = 0.5 * math.pi / OMEGA
READINGS = (_series(1), _series(0), _scalar("peak_force", 0, FORCE), _scalar("arrival", 1, ARRIVAL))


@cache
def _prediction() -> Prediction:
    return Prediction(scene=SPRING, readings=READINGS, backend="verlet", dt=2e-8)


def test_values_at_any_time_are_those_of_the_closed_form() -> None:
    expected = np.concatenate([reading.value for reading in READINGS])
    np.testing.assert_allclose(_prediction().simulated, expected, rtol=1e-5, atol=1e-7)


def test_slopes_and_later_times_are_those_of_the_closed_form() -> None:
    prediction = _prediction()
    slope = -OMEGA * SPEED * np.sin(OMEGA * TIMES) * (TIMES < PARTED)
    exact = np.concatenate([-slope * MASS[0] / sum(MASS), slope * MASS[1] / sum(MASS), [0.0]])
    np.testing.assert_allclose(prediction.slope[:11], exact, atol=1e-4 * OMEGA * SPEED)
    late = np.array([1e-5, 5e-5])
    reading = _series(0, late)
    later = Prediction(scene=SPRING, readings=(reading,), backend="verlet", dt=2e-8).series(reading, 2e-5)
    np.testing.assert_allclose(later, _exact(0, late + 2e-5), atol=1e-6)
    # a clock that is late by 2e-5 s: pulses are read later, and an arrival comes earlier on it
    shifted = prediction.at(parameters_of({"time": 1e-6}, SPRING), [2e-5])
    np.testing.assert_allclose(shifted[:5], _exact(1, np.minimum(TIMES + 2e-5, SPRING.duration)), atol=1e-5)
    assert shifted[10] == pytest.approx(FORCE, rel=1e-5)
    assert shifted[11] == pytest.approx(ARRIVAL - 2e-5, rel=1e-5)


def test_a_gain_multiplies_all_values_but_times() -> None:
    prediction, gain = _prediction(), parameters_of({"gain": 0.1}, SPRING)
    ratio = prediction.at(gain, [0.25])[prediction.simulated != 0.0] / prediction.simulated[prediction.simulated != 0.0]
    np.testing.assert_allclose(ratio, [*[1.25] * (len(ratio) - 1), 1.0], rtol=1e-14)


def test_a_change_of_a_parameter_has_the_size_of_the_closed_form() -> None:
    # to 1 %: the fast code's step is coarse. Times of a spring go with stiffness^(-1/2), forces with ^(1/2)
    prediction = _prediction()
    stiff = prediction.at(parameters_of({"stiffness": 0.01}, SPRING), [0.02]) - prediction.simulated
    assert stiff[10] == pytest.approx(FORCE * (math.sqrt(1.02) - 1.0), rel=1e-2)
    assert stiff[11] == pytest.approx(ARRIVAL * (1.0 / math.sqrt(1.02) - 1.0), rel=1e-2)
    fast = prediction.at(parameters_of({"velocity": 0.01}, SPRING), [0.02]) - prediction.simulated
    np.testing.assert_allclose(fast[:10], 0.02 * prediction.simulated[:10], atol=2e-4 * SPEED)


def test_the_uncertainty_of_a_value_is_that_of_its_own_place() -> None:
    scene = replace(db.load_scene("accelerating-40"), duration=2e-4)
    own = np.asarray(db.solve(scene, backend="verlet", dt=1e-7).uncertainty["peak_force"])
    # contacts at some way along the chain: the first, and the one whose uncertainty differs most from it
    places = (int(np.argmax(np.abs(np.log(own[:20] / own[0])))), 0)
    assert abs(math.log(own[places[0]] / own[0])) > 0.3
    readings = tuple(_scalar("peak_force", place, 1.0, 1.0) for place in places)
    prediction = Prediction(scene=scene, readings=readings, backend="verlet", dt=1e-7)
    np.testing.assert_allclose(prediction.numerical, np.repeat(own[list(places)], 2), rtol=0.1)
    np.testing.assert_array_equal(prediction.simulated, np.repeat(prediction.run.peak_force[list(places)], 2))


def test_samples_fill_each_interval_of_a_normal_number_once_and_have_a_seed() -> None:
    prediction = _prediction()
    declared = parameters_of({"gain": 0.1, "time": 1e-7}, SPRING)
    first, again, other = (prediction.samples(declared, count=50, seed=seed)[0] for seed in (1, 1, 2))
    assert np.array_equal(first, again)
    assert np.max(np.abs(first - other)) > 0.1
    for column in first.T:  # a Latin hypercube
        assert sorted(np.floor(50.0 * norm.cdf(column)).astype(int)) == list(range(50))
    none, nothing = prediction.samples((), count=3, seed=0)
    assert (none.shape, nothing.shape) == ((3, 0), (3, 12))


def test_the_number_of_samples_follows_the_contact_and_has_limits() -> None:
    # the spring's half period has pi/0.25 samples, and the whole run four per radian
    long = replace(SPRING, duration=0.2)
    count = Prediction(scene=long, readings=()).sampling.count
    assert count == pytest.approx(4.0 * OMEGA * 0.2, rel=0.05)
    assert Prediction(scene=SPRING, readings=()).sampling.count == FEWEST
    assert Prediction(scene=replace(SPRING, duration=100.0), readings=()).sampling.count == MOST


# statistics


def _comparison(**changes: Any) -> Comparison:
    velocity, force = _series(0, np.array([1e-5, 2e-5])), _scalar("peak_force", 0, 10.0)
    fields: dict[str, Any] = {
        "readings": (velocity, force),
        "simulated": np.array([1.0, 2.0, 12.0]),
        "measured": np.array([1.3, 1.75, 10.0]),
        "numerical": np.array([0.0, 0.3, 0.0]),
        "input": np.array([0.3, 0.0, 1.0]),
        "data": np.array([0.4, 0.4, 1.0]),
        "of_samples": np.array([[0.3, 0.0], [0.0, 0.0], [0.0, 1.0]]),
        "of_measurement": np.array([[0.0], [0.0], [0.6]]),
        # a linear simulation: two parameters of the scene and one of the measurement
        "linear_error": np.array([-0.3, 0.25, 2.0]),
        "slopes": np.array([[0.3, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 1.0, 0.6]]),
        "linear": True,
        "noise": np.array([0.4, 0.4, 0.8]),
        "count": 9,
    }
    return Comparison(**fields | changes)


def test_a_comparison_is_the_arithmetic_of_its_definition() -> None:
    both = _comparison()
    np.testing.assert_allclose(both.error, [-0.3, 0.25, 2.0], rtol=1e-15)
    # 3-4-5 triangles, and the diagonal of a square
    np.testing.assert_allclose(both.validation, [0.5, 0.5, math.sqrt(2.0)], rtol=1e-15)
    assert both.share_within(1.0) == pytest.approx(2.0 / 3.0)
    assert both.share_within(2.0) == 1.0
    assert both.share_within(1.0, both.rows(both.readings[1])) == 0.0
    assert (both.rows(both.readings[0]), both.rows(both.readings[1])) == (slice(0, 2), slice(2, 3))
    assert both.of("velocity").tolist() == [True, True, False]
    assert both.of(None).tolist() == [True] * 3
    assert both.doubt == pytest.approx(0.25)  # 1 / sqrt(2 (9 - 1))
    # |E| = 2, limits 1.414, 1.838 and 2.828; the limit is known to k doubt u_input^2 / u_val = 0.177 k
    assert [both.words(k)[2] for k in (1.0, 1.3, 1.5, 2.0)] == ["larger", "undecided", "undecided", "within"]
    assert both.words(1.0)[:2] == ["within", "within"]


def test_the_joint_statistic_is_that_of_the_whole_covariance() -> None:
    both = _comparison()
    covariance = both.slopes @ both.slopes.T + np.diag(both.noise**2 + both.numerical**2)
    expected = float(both.error @ np.linalg.solve(covariance, both.error))
    joint = both.joint()
    assert (joint.statistic, joint.count) == (pytest.approx(expected, rel=1e-12), 3)
    assert joint.p == pytest.approx(chi2.sf(expected, 3), rel=1e-12)
    assert both.joint("peak_force").statistic == pytest.approx(4.0 / (0.64 + 1.0 + 0.36), rel=1e-12)
    assert (both.joint("velocity").statistic, both.joint("velocity").count) == (
        pytest.approx(0.09 / 0.25 + 0.0625 / 0.25),
        2,
    )


def test_a_probability_is_a_number_of_standard_deviations() -> None:
    # with one degree of freedom the statistic is the square of a normal number
    for deviations in (0.5, 1.0, 3.0):
        assert Joint(statistic=deviations**2, count=1).deviations == pytest.approx(deviations, rel=1e-9)
    assert Joint(statistic=0.0, count=1).deviations == 0.0
    assert Joint(statistic=1e9, count=1).deviations == 40.0


def test_uncertainties_as_large_as_the_quantity_decide_nothing() -> None:
    both = _comparison()
    # the median of u_val is 0.5 for velocities up to 2
    assert [both.decides("velocity", k) for k in (3.9, 4.0)] == [True, False]
    unknown = _comparison(simulated=np.array([np.nan, 2.0, 12.0]))
    assert not unknown.decides("velocity", 1.0)


def test_the_parts_of_the_uncertainty_are_those_of_the_declared_parameters() -> None:
    prediction = _prediction()
    declared = parameters_of({"velocity": 0.02, "gain": 0.05, "time": 3e-7}, SPRING)
    both = compare(prediction, declared, count=400, seed=3)
    own = np.concatenate([reading.uncertainty for reading in READINGS])
    simulated, rows = prediction.simulated, slice(0, 10)
    # all velocities go with the start velocity: their standard deviation is 2 % of each
    np.testing.assert_allclose(both.input[rows], 0.02 * np.abs(simulated[rows]), atol=2e-4)
    # a gain multiplies, and a late clock adds the slope times the time
    expected = np.sqrt(own**2 + (0.05 * simulated) ** 2 + (3e-7 * prediction.slope) ** 2)
    np.testing.assert_allclose(both.data[rows], expected[rows], rtol=1e-3)
    # the spread is about the mean of the samples: its square is the variance
    np.testing.assert_allclose(np.sum(both.of_samples**2, axis=1), both.input**2, rtol=1e-12, atol=1e-30)
    assert both.count == 400
    nothing = compare(prediction, (), count=5, seed=0)
    assert (nothing.of_samples.shape, nothing.of_measurement.shape) == ((12, 0), (12, 0))
    np.testing.assert_array_equal(nothing.data, own)


# scalars


def _pulses(factor: float, late: float) -> tuple[Prediction, Comparison]:
    """Return the comparison with measured pulses that are larger by a factor and late, without noise."""
    time = np.linspace(1e-6, 2.5e-4, 60)
    readings = tuple(
        replace(_series(body, time, 0.004), value=factor * _exact(body, np.maximum(time - late, 0.0)))
        for body in (0, 1)
    )
    prediction = Prediction(scene=SPRING, readings=readings, backend="verlet", dt=2e-8)
    return prediction, compare(prediction, (), count=3, seed=0)


def test_peak_and_arrival_of_a_measured_pulse_are_its_own() -> None:
    prediction, both = _pulses(1.01, 1e-6)
    scalars = scalars_of(prediction, both)
    assert [item.name for item in scalars] == ["peak velocity", "time of the peak velocity"] * 2
    assert [item.unit for item in scalars] == ["m/s", "s"] * 2
    peak, time = scalars[2:]
    largest = SPEED * 2.0 * MASS[0] / sum(MASS)
    assert peak.simulated == pytest.approx(largest, rel=1e-4)
    assert peak.measured == pytest.approx(1.01 * largest, rel=1e-3)
    # the simulated pulse is the earlier one
    assert time.error == pytest.approx(-1e-6, rel=0.02)
    # 60 values of 0.004 m/s: the factor of a pulse p is known to 0.004 / |p| where its shift is known
    assert peak.data == pytest.approx(largest * 0.004 / np.linalg.norm(_exact(1, both.readings[1].time)), rel=0.5)
    assert peak.input == peak.doubt * 0.0
    assert peak.validation == pytest.approx(math.hypot(peak.numerical, peak.data), rel=1e-12)
    assert peak.word(2.0) == ("within" if abs(peak.error) <= 2.0 * peak.validation else "larger")


def test_a_scalar_that_was_measured_is_compared_as_it_is() -> None:
    prediction = _prediction()
    both = compare(prediction, parameters_of({"velocity": 0.02}, SPRING), count=50, seed=1)
    force, arrival = scalars_of(prediction, both)[-2:]
    assert (force.name, force.unit, arrival.name, arrival.unit) == ("peak force", "N", "arrival", "s")
    for item, row in ((force, 10), (arrival, 11)):
        assert (item.simulated, item.measured) == (both.simulated[row], both.measured[row])
        assert (item.numerical, item.input, item.data) == (both.numerical[row], both.input[row], both.data[row])
    # forces go with the start velocity, times of a spring do not
    assert force.input == pytest.approx(0.02 * FORCE, rel=0.1)
    assert arrival.input < 1e-3 * 0.02 * ARRIVAL


def test_pulses_below_the_noise_and_displacements_have_no_peak() -> None:
    time = np.linspace(1e-6, 2.5e-4, 60)
    loud = Prediction(scene=SPRING, readings=(_series(0, time, 0.3),), backend="verlet", dt=2e-8)
    assert scalars_of(loud, compare(loud, (), count=3, seed=0)) == []
    moved = replace(_series(0, time, 1e-9), quantity="displacement")
    still = Prediction(scene=SPRING, readings=(moved,), backend="verlet", dt=2e-8)
    assert scalars_of(still, compare(still, (), count=3, seed=0)) == []
    few = Prediction(scene=SPRING, readings=(_series(0, time[:3], 0.004),), backend="verlet", dt=2e-8)
    assert scalars_of(few, compare(few, (), count=3, seed=0)) == []


def test_pulses_of_one_reading_share_its_noise_and_those_of_two_do_not() -> None:
    prediction, both = _pulses(1.01, 1e-6)
    scalars = scalars_of(prediction, both)
    joint = joint_of(scalars, both)
    assert joint is not None
    expected = 0.0
    for pair in (scalars[:2], scalars[2:]):
        noise = both.noise[both.rows(pair[0].reading)]
        weights = np.stack([item.weights for item in pair])
        covariance = (weights * noise**2) @ weights.T + np.diag([item.numerical**2 for item in pair])
        errors = np.array([item.error for item in pair])
        expected += float(errors @ np.linalg.inv(covariance) @ errors)
    # errors count to first order there: pulses are 1 % off, and squares of their errors differ by up to twice that
    assert (joint.count, joint.statistic) == (4, pytest.approx(expected, rel=0.02))


def test_a_scalar_is_within_as_its_uncertainties_say() -> None:
    shared: dict[str, Any] = {"name": "peak", "reading": READINGS[0], "unit": "N", "simulated": 5.0, "measured": 4.0}
    item = Scalar(**shared, numerical=0.0, input=0.6, data=0.8, doubt=0.1)
    assert (item.error, item.validation) == (1.0, pytest.approx(1.0))
    # the limit k u_val is known to k * 0.1 * 0.36
    assert [item.word(k) for k in (0.9, 0.98, 1.02, 1.1)] == ["larger", "undecided", "undecided", "within"]


# files


def _read(folder: Path, text: str, scene: Scene = SPRING) -> tuple[Reading, ...]:
    (folder / "laser.csv").write_text(text, encoding="utf-8")
    return read_measurement([folder / "laser.csv"], scene)


def test_every_value_has_the_uncertainty_of_its_own_column(tmp_path: Path) -> None:
    head = "time_us,velocity_0_m_per_s,velocity_1_m_per_s"
    own = f"{head},velocity_0_uncertainty_m_per_s,velocity_1_uncertainty_m_per_s\n10,0.5,0.25,0.01,0.02\n"
    assert [reading.uncertainty.tolist() for reading in _read(tmp_path, own)] == [[0.01], [0.02]]
    # its own before the one of all places
    mixed = f"{head},uncertainty_m_per_s,velocity_1_uncertainty_mm_per_s\n10,0.5,0.25,0.01,20\n"
    assert [reading.uncertainty.tolist() for reading in _read(tmp_path, mixed)] == [[0.01], [pytest.approx(0.02)]]
    # that of another place is none
    other = f"{head},velocity_0_uncertainty_m_per_s\n10,0.5,0.25,0.01\n"
    with pytest.raises(UsageError, match=r"column 'velocity_1_m_per_s' has no uncertainty"):
        _read(tmp_path, other)


def test_times_at_both_ends_of_a_scene_are_read_and_those_beyond_are_not(tmp_path: Path) -> None:
    text = "time_s,body,velocity_m_per_s,uncertainty_m_per_s\n{},1,0.5,0.1\n"
    for time in (0.0, SPRING.duration, SPRING.duration * (1.0 + 5e-10), -5e-10 * SPRING.duration):
        (reading,) = _read(tmp_path, text.format(repr(time)))
        assert reading.time[0] == pytest.approx(time, rel=1e-12)
    for time in (SPRING.duration * (1.0 + 5e-9), -5e-9 * SPRING.duration):
        with pytest.raises(UsageError, match=r"allowed: 0 to 0\.0004 s, the duration of spring"):
            _read(tmp_path, text.format(repr(time)))


# parameters and fits


def test_changes_of_one_place_and_of_all_add_up() -> None:
    scene = replace(SPRING, wall_right=Wall(stiffness=2e6, exponent=2.0))
    declared = parameters_of({"stiffness": 0.1, "stiffness[1]": 0.1, "mass[*]": 0.1}, scene)
    assert [item.name for item in declared] == ["stiffness", "stiffness[1]", "mass[0]", "mass[1]"]
    assert [item.independent for item in declared] == [False, False, True, True]
    both = changed(scene, declared, [0.1, 0.2, 1.0, 0.5])
    assert both.stiffness == pytest.approx((1.1 * STIFFNESS,), rel=1e-14)
    assert both.wall_right is not None
    assert both.wall_right.stiffness == pytest.approx(2.6e6, rel=1e-14)
    assert both.mass == pytest.approx((0.02, 0.045), rel=1e-14)
    # a body at rest has no uncertain velocity of its own
    assert [item.name for item in parameters_of({"velocity[*]": 0.1}, scene)] == ["velocity[0]"]
    # and no change leaves the scene as it is
    assert changed(scene, declared, [0.0] * 4) is scene


def test_a_fit_of_a_gain_is_a_linear_least_squares_fit() -> None:
    prediction = _prediction()
    gain = parameters_of({"gain": 0.1}, SPRING)
    noise = 0.01 * np.arange(1.0, 13.0)
    noise[10:] = 1e6  # the force and the arrival say nothing here
    measured = 1.07 * prediction.simulated + noise * np.cos(np.arange(12.0))
    fit = fit_parameters(prediction, gain, (), measured, noise)
    (found,) = fit.fitted
    sigma = np.hypot(noise, prediction.numerical)
    weighted = prediction.simulated / sigma
    weighted[11] = 0.0
    slope = weighted @ ((measured - prediction.simulated) / sigma) / (weighted @ weighted)
    deviation = 1.0 / math.sqrt(weighted @ weighted)
    assert found.change == pytest.approx(slope, rel=1e-6)
    assert found.uncertainty == pytest.approx(deviation, rel=1e-6)
    # 95 % of a normal number
    assert (found.low, found.high) == (
        pytest.approx(slope - 1.959964 * deviation, rel=5e-3),
        pytest.approx(slope + 1.959964 * deviation, rel=5e-3),
    )
    residual = (prediction.at(gain, [slope]) - measured) / sigma
    assert (fit.joint.statistic, fit.joint.count) == (pytest.approx(residual @ residual, rel=1e-6), 11)
    assert fit.correlation == pytest.approx(0.0, abs=1e-12)
    np.testing.assert_allclose(fit.values, prediction.at(gain, [slope]), rtol=1e-6)
    # the change beside its declared standard uncertainty of 0.1 and that of the fit
    assert fit.declared is not None
    assert (fit.declared.statistic, fit.declared.count) == (
        pytest.approx(slope**2 / (0.1**2 + deviation**2), rel=1e-6),
        1,
    )


def test_an_interval_has_the_ends_of_the_likelihood_and_need_not_be_symmetric() -> None:
    prediction = _prediction()
    # the time of the clock: a value near the top of a pulse rises ever slower with it, so that its error is not linear
    declared = parameters_of({"time": 1e-5}, SPRING)
    noise = np.full(12, 1e6)
    noise[2] = 0.015
    fit = fit_parameters(prediction, declared, (), prediction.simulated, noise)
    (found,) = fit.fitted
    assert found.change == pytest.approx(0.0, abs=1e-3 * found.uncertainty)

    def excess(change: float) -> float:
        return float(((prediction.at(declared, [change])[2] - prediction.simulated[2]) / 0.015) ** 2)

    # the 95 % quantile of chi-square of one number is 3.841
    assert excess(found.low) == pytest.approx(3.841, rel=0.05)
    assert excess(found.high) == pytest.approx(3.841, rel=0.05)
    assert found.low < 0.0 < found.high
    assert abs(found.high + found.low) > 0.05 * found.uncertainty, "the closed form is not symmetric"
