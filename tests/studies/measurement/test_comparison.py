"""Synthetic measurements by an independent solver: a right model agrees, a bias is found, and intervals cover it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.stats import binom

from dem_bridge.errors import UsageError
from dem_bridge.scene.file import load_scene, parse_scene
from dem_bridge.scene.scene import Damping, Wall
from dem_bridge.studies.measurement.comparison import Comparison, Joint, compare, word_of
from dem_bridge.studies.measurement.fit import Fit, chosen, fit_parameters
from dem_bridge.studies.measurement.parameters import changed, parameters_of
from dem_bridge.studies.measurement.prediction import Prediction
from dem_bridge.studies.measurement.readings import Reading
from dem_bridge.studies.measurement.scalars import joint_of, scalars_of
from dem_bridge.trajectory.trajectory import Floats
from tests.helpers.synthetic import SCENE, motion

ROW = parse_scene(SCENE)
TIMES = np.linspace(2e-6, 2.4e-4, 120)
NOISE = 0.002
BODIES = (1, 3)


@cache
def truth(**factors: float) -> Floats:
    return motion(TIMES, **factors)[0]


def readings_of(velocity: Floats, seed: int) -> tuple[Reading, ...]:
    random = np.random.default_rng(seed)
    noise, sigma = NOISE * random.standard_normal((len(TIMES), len(BODIES))), np.full(len(TIMES), NOISE)
    return tuple(
        Reading(quantity="velocity", place=body, time=TIMES, value=velocity[:, body] + noise[:, k], uncertainty=sigma)
        for k, body in enumerate(BODIES)
    )


def compared(readings: tuple[Reading, ...], declared: Mapping[str, float], count: int = 40) -> Comparison:
    return compare(Prediction(scene=ROW, readings=readings), parameters_of(declared, ROW), count=count, seed=0)


def fitted(prediction: Prediction, readings: tuple[Reading, ...], declared: Mapping[str, float], *names: str) -> Fit:
    to_fit, others = chosen(parameters_of(declared, ROW), names)
    measured, own = (np.concatenate([getattr(one, name) for one in readings]) for name in ("value", "uncertainty"))
    return fit_parameters(prediction, to_fit, others, measured, own)


def test_the_simulation_is_that_of_the_independent_solver() -> None:
    prediction = Prediction(scene=ROW, readings=readings_of(truth(), 0))
    exact = np.concatenate([truth()[:, body] for body in BODIES])
    # both are good to 1e-8; the rest is the interpolation, which u_num states
    error = np.abs(prediction.simulated - exact)
    assert np.max(error) < 1e-5
    assert np.all(error < 3.0 * prediction.numerical + 1e-7)
    # a change by the fast code, at a step of 1e-3 accuracy: to 1 % of itself
    stiff = np.concatenate([truth(stiffness=1.02)[:, body] for body in BODIES])
    change = prediction.at(parameters_of({"stiffness": 0.01}, ROW), [0.02]) - prediction.simulated
    assert np.max(np.abs(change - (stiff - exact))) < 1e-2 * np.max(np.abs(change))


def test_a_right_model_is_within_and_a_bias_of_2_percent_is_not() -> None:
    right, biased = (compared(readings_of(truth(stiffness=factor), 5), {}) for factor in (1.0, 1.02))
    assert right.joint().deviations < 2.0
    assert biased.joint().deviations > 5.0
    # 240 values: 1 and 2 standard deviations of the binomial shares 0.683 and 0.954 are 0.03 and 0.014
    assert right.share_within(1.0) == pytest.approx(0.683, abs=0.09)
    assert right.share_within(2.0) == pytest.approx(0.954, abs=0.04)


def test_an_error_within_the_declared_uncertainty_is_no_alarm_because_errors_are_joint() -> None:
    readings = readings_of(truth(stiffness=1.04), 6)  # by two declared standard uncertainties
    comparison = compared(readings, {"stiffness": 0.02})
    assert comparison.joint().deviations < 2.0
    # planted: the errors of the parameter as if they were independent at all times
    apart = Joint(statistic=float(np.sum((comparison.error / comparison.validation) ** 2)), count=len(comparison.error))
    assert apart.deviations > 5.0
    # and without the parameter there is an alarm, rightly
    assert compared(readings, {}).joint().deviations > 5.0


def test_peaks_and_arrivals_show_a_common_shift_that_is_lost_among_the_values() -> None:
    seen = []
    for seed in range(12):
        readings = readings_of(truth(stiffness=1.003), seed)
        prediction = Prediction(scene=ROW, readings=readings)
        comparison = compare(prediction, (), count=10, seed=0)
        pulses = joint_of(scalars_of(prediction, comparison), comparison)
        assert pulses is not None
        assert pulses.count == 4
        seen.append((comparison.joint().deviations > 2.0, pulses.deviations > 2.0))
    among_values, among_pulses = np.sum(seen, axis=0)
    # four standard deviations of the stiffness
    assert among_values <= 4 < 9 <= among_pulses


def test_a_sensor_of_wrong_gain_or_trigger_is_no_alarm_if_it_is_declared() -> None:
    readings = readings_of(1.03 * truth(), 7)
    assert compared(readings, {}).joint().deviations > 3.0
    declared = compared(readings, {"gain": 0.03})
    assert declared.joint().deviations < 2.0
    assert np.max(declared.input) == 0.0
    assert np.max(declared.data) > 3.0 * NOISE


def test_the_fit_finds_the_bias_with_an_interval_of_the_right_width() -> None:
    readings = readings_of(truth(stiffness=1.02), 8)
    prediction = Prediction(scene=ROW, readings=readings)
    (stiffness,) = fitted(prediction, readings, {"stiffness": 0.01}, "stiffness").fitted
    assert stiffness.low < 0.02 < stiffness.high
    assert abs(stiffness.change - 0.02) < 3.0 * stiffness.uncertainty < 0.004
    assert stiffness.high - stiffness.low == pytest.approx(2.0 * 1.96 * stiffness.uncertainty, rel=0.05)
    # an uncertain start velocity widens the interval; fitted together, both are determined
    wide = fitted(prediction, readings, {"stiffness": 0.01, "velocity": 0.02}, "stiffness")
    assert wide.fitted[0].uncertainty > 1.05 * stiffness.uncertainty
    both = fitted(prediction, readings, {"stiffness": 0.01, "velocity": 0.02}, "stiffness", "velocity")
    assert [one.low < true < one.high for one, true in zip(both.fitted, (0.02, 0.0), strict=True)] == [True, True]


def test_parameters_that_velocities_do_not_tell_apart_are_not_fitted() -> None:
    readings = readings_of(truth(), 9)
    found = fitted(
        Prediction(scene=ROW, readings=readings), readings, {"stiffness": 0.01, "mass": 0.01}, "stiffness", "mass"
    )
    assert (found.fitted, found.undetermined) == ((), ("stiffness", "mass"))


def test_a_fit_that_ends_where_no_scene_is_gives_no_values() -> None:
    readings = readings_of(-truth(), 9)  # a sensor with the wrong sign
    found = fitted(Prediction(scene=ROW, readings=readings), readings, {"stiffness": 0.01}, "stiffness")
    assert (found.fitted, found.undetermined) == ((), ("stiffness",))


def test_arrival_and_peak_are_unbiased_by_noise_and_show_a_late_pulse() -> None:
    late = (
        motion(TIMES - 1e-6, speed=1.0)[0]
        if False
        else np.stack([np.interp(TIMES - 2e-6, TIMES, column) for column in truth().T], axis=1)
    )
    readings = readings_of(late, 10)
    prediction = Prediction(scene=ROW, readings=readings)
    peak, time = scalars_of(prediction, compare(prediction, (), count=10, seed=0))[-2:]
    assert (peak.name, time.name) == ("peak velocity", "time of the peak velocity")
    assert time.error == pytest.approx(-2e-6, abs=3.0 * time.data)
    assert peak.word(2.0) == "within"


@pytest.mark.parametrize(
    ("name", "change", "field"),
    [
        ("stiffness", 0.1, lambda scene: (scene.stiffness[0] / 4e9, scene.wall_right.stiffness / 3e9)),
        ("mass", 0.1, lambda scene: tuple(np.array(scene.mass) / ROW.mass)),
        ("velocity", 0.1, lambda scene: (scene.velocity[0] / 0.8,)),
        ("exponent", 0.1, lambda scene: (scene.exponent[1] - 1.5, scene.wall_right.exponent - 1.5)),
        ("damping", 0.1, lambda scene: tuple(np.array(scene.damping.coefficient) / 2.0)),
    ],
)
def test_a_parameter_changes_what_its_name_says(name: str, change: float, field: Callable[[Any], Any]) -> None:
    wall, damping = Wall(stiffness=3e9), Damping(law="dashpot", coefficient=2.0)
    scene = replace(ROW, wall_right=wall, damping=damping)
    found = field(changed(scene, parameters_of({name: 0.1}, scene), [change]))
    assert found == pytest.approx([1.0 + change] * len(found), rel=1e-12)


def test_one_place_changes_alone_and_angles_follow_their_law() -> None:
    scene = load_scene("decelerating-40")
    one = changed(scene, parameters_of({"mass[3]": 0.1}, scene), [0.1])
    assert [k for k in range(scene.n_body) if one.mass[k] != scene.mass[k]] == [3]
    turned = changed(scene, parameters_of({"angle[1]": 0.1}, scene), [1.0])
    assert [k for k in range(40) if turned.stiffness[k] != scene.stiffness[k]] == [1]
    # a larger angle between the axes: a smaller contact, a smaller stiffness
    assert turned.stiffness[1] < scene.stiffness[1]
    assert len(parameters_of({"stiffness[*]": 0.1}, scene)) == 40


@pytest.mark.parametrize(
    ("declared", "said"),
    [
        ({"colour": 0.1}, "parameter 'colour' is unknown; allowed: stiffness, mass"),
        ({"mass[4]": 0.1}, "parameter 'mass[4]'; allowed: body 0 to 3"),
        ({f"mass[{'9' * 5000}]": 0.1}, "parameter 'mass[999"),
        ({"stiffness[3]": 0.1}, "parameter 'stiffness[3]'; allowed: contact 0 to 2"),
        ({"gain[1]": 0.1}, "parameter 'gain[1]'; allowed: no place"),
        ({"mass": -0.1}, "parameter mass = -0.1; allowed: a standard uncertainty > 0"),
        ({"damping": 0.1}, "parameter damping: row has none; allowed"),
        ({"angle": 0.1}, "parameter angle: row has no contact angles"),
    ],
)
def test_a_parameter_that_does_not_exist_is_refused(declared: dict[str, float], said: str) -> None:
    with pytest.raises(UsageError) as error:
        parameters_of(declared, ROW)
    assert said in str(error.value)


def test_a_sample_that_no_scene_can_have_is_refused() -> None:
    with pytest.raises(UsageError, match=r"a change by -1\.5 gives an invalid scene"):
        changed(ROW, parameters_of({"mass": 0.5}, ROW), [-1.5])


def test_a_parameter_to_fit_must_be_declared() -> None:
    with pytest.raises(UsageError, match=r"fit = 'mass' is not declared; allowed: stiffness; add it"):
        chosen(parameters_of({"stiffness": 0.1}, ROW), ["mass"])


def test_all_parameters_of_the_whole_scene_are_fitted_unless_some_are_named() -> None:
    declared = parameters_of({"stiffness": 0.1, "mass[0]": 0.1, "velocity": 0.1}, ROW)
    to_fit, others = chosen(declared, None)
    assert ([item.name for item in to_fit], [item.name for item in others]) == (["stiffness", "velocity"], ["mass[0]"])


@pytest.mark.parametrize(
    ("error", "bar", "word"),
    [(0.1, 0.0625, "within"), (0.125, 0.125, "within"), (0.5, 0.125, "larger"), (0.25, 0.125, "undecided"),
     (0.375, 0.125, "undecided")],
)  # fmt: skip
def test_an_error_near_a_limit_is_undecided(error: float, bar: float, word: str) -> None:
    assert word_of(error, 0.25, bar) == word


def test_each_sample_of_the_parameters_is_progress() -> None:
    prediction = Prediction(scene=ROW, readings=readings_of(truth(), 0))
    calls: list[tuple[float, int, str]] = []
    samples, changes = prediction.samples(
        parameters_of({"gain": 0.1}, ROW), count=3, seed=0, progress=lambda *words: calls.append(words)
    )
    assert calls == [(nth, 3, "samples of the parameters") for nth in range(3)]
    # a gain multiplies every velocity
    np.testing.assert_allclose(changes, 0.1 * samples * prediction.simulated, rtol=1e-12, atol=1e-15)


def test_without_pulses_there_is_no_joint_comparison_of_them() -> None:
    assert joint_of([], compared(readings_of(truth(), 0), {}, count=2)) is None


@pytest.mark.slow
def test_intervals_cover_95_percent_and_alarms_are_as_rare_as_stated() -> None:
    count, covered, alarms, within = 200, 0, 0, []
    declared = {"stiffness": 0.01, "velocity": 0.005}
    random = np.random.default_rng(0)
    for seed in range(count):
        # a stiffness 2 % off, and a start velocity that has the declared uncertainty
        speed = 1.0 + 0.005 * random.standard_normal()
        readings = readings_of(motion(TIMES, stiffness=1.02, speed=speed)[0], 1000 + seed)
        prediction = Prediction(scene=ROW, readings=readings)
        (stiffness,) = fitted(prediction, readings, declared, "stiffness").fitted
        covered += stiffness.low < 0.02 < stiffness.high
        right = compared(readings_of(motion(TIMES, speed=speed)[0], 5000 + seed), {"velocity": 0.005})
        alarms += right.joint().deviations > 2.0
        within.append(right.share_within(2.0))
    low, high = binom.interval(0.99, count, 0.95)
    assert low <= covered <= high, covered
    low, high = binom.interval(0.99, count, 0.0455)
    assert low <= alarms <= high, alarms
    assert np.mean(within) == pytest.approx(0.954, abs=0.01)
