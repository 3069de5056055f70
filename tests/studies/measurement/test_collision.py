"""A measured collision on a spring: force, time and speed have closed forms in stiffness and start velocity.

``F = v sqrt(k m)`` and ``t = (pi/2) sqrt(m/k)`` with the reduced mass m, so that measured forces and times give both
parameters, with uncertainties by propagation.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dem_bridge.scene.scene import Scene, Wall
from dem_bridge.studies.measurement.comparison import compare
from dem_bridge.studies.measurement.fit import Fit, chosen, fit_parameters
from dem_bridge.studies.measurement.parameters import changed, parameters_of
from dem_bridge.studies.measurement.prediction import Prediction
from dem_bridge.studies.measurement.readings import Reading
from dem_bridge.studies.measurement.scalars import scalars_of
from tests.helpers.strategies import examples

MASS, STIFFNESS, SPEED = (0.01, 0.03), 1e6, 0.8
REDUCED = MASS[0] * MASS[1] / sum(MASS)
OMEGA = math.sqrt(STIFFNESS / REDUCED)
SPRING = Scene(
    name="spring", duration=1.2 * math.pi / OMEGA, mass=MASS, stiffness=(STIFFNESS,), exponent=2.0,
    velocity=(SPEED, 0.0),
)  # fmt: skip
FORCE, TIME = SPEED * math.sqrt(STIFFNESS * REDUCED), 0.5 * math.pi / OMEGA


def reading(quantity: str, place: int, value: object, uncertainty: float, time: object = math.nan) -> Reading:
    values = np.atleast_1d(np.asarray(value, dtype=float))
    return Reading(
        quantity=quantity, place=place, value=values, uncertainty=np.full(len(values), uncertainty),
        time=np.broadcast_to(np.asarray(time, dtype=float), len(values)).copy(),
    )  # fmt: skip


def fitted(readings: tuple[Reading, ...], declared: Mapping[str, float], *names: str) -> Fit:
    to_fit, others = chosen(parameters_of(declared, SPRING), names)
    measured, noise = (np.concatenate([getattr(one, part) for one in readings]) for part in ("value", "uncertainty"))
    return fit_parameters(Prediction(scene=SPRING, readings=readings), to_fit, others, measured, noise)


def test_simulated_values_are_those_of_the_closed_form() -> None:
    times = np.linspace(0.05, 0.95, 30) * math.pi / OMEGA
    common = SPEED * MASS[0] / sum(MASS)
    second = common * (1.0 - np.cos(OMEGA * times))
    readings = (
        reading("velocity", 1, second, 1e-3, times),
        reading("displacement", 1, common * (times - np.sin(OMEGA * times) / OMEGA), 1e-9, times),
        reading("contact_force", 0, FORCE * np.sin(OMEGA * times), 1.0, times),
        reading("arrival", 1, TIME, 1e-7),
        reading("peak_velocity", 1, 2.0 * common, 1e-3),
        reading("peak_force", 0, FORCE, 1.0),
    )
    prediction = Prediction(scene=SPRING, readings=readings)
    values = np.concatenate([one.value for one in readings])
    scale = np.concatenate([np.full(len(one.value), np.max(np.abs(one.value))) for one in readings])
    # polynomials through six samples of which 500 lie in 1.2 pi
    assert np.abs(prediction.simulated - values) / scale == pytest.approx(np.zeros(len(values)), abs=1e-9)
    slope = common * OMEGA * np.sin(OMEGA * times)
    assert prediction.slope[:30] == pytest.approx(slope, rel=1e-4, abs=1e-4 * np.max(slope))
    # an arrival is the earlier, the later the clock begins
    assert prediction.slope[-3:] == pytest.approx([-1.0, 0.0, 0.0], abs=1e-12)


@examples(12)
@given(stiffer=st.floats(-0.05, 0.05), faster=st.floats(-0.05, 0.05))
def test_force_and_time_give_stiffness_and_speed(stiffer: float, faster: float) -> None:
    force, time = (1.0 + faster) * math.sqrt(1.0 + stiffer) * FORCE, TIME / math.sqrt(1.0 + stiffer)
    noise = (1e-3, 2e-3)  # relative
    readings = (reading("peak_force", 0, force, noise[0] * force), reading("arrival", 1, time, noise[1] * time))
    fit = fitted(readings, {"stiffness": 0.03, "velocity": 0.01}, "stiffness", "velocity")
    stiffness, speed = fit.fitted
    # changes are those of velocity-Verlet at 1/20 of a radian: a thousandth of themselves
    assert stiffness.change == pytest.approx(stiffer, abs=2e-3 * abs(stiffer) + 1e-6)
    assert speed.change == pytest.approx(faster, abs=2e-3 * (abs(stiffer) + abs(faster)) + 1e-6)
    # ln k = -2 ln t, ln v = ln F + ln t
    of_stiffness = 2.0 * noise[1] * (1.0 + stiffer)
    of_speed = math.hypot(*noise) * (1.0 + faster)
    assert stiffness.uncertainty == pytest.approx(of_stiffness, rel=5e-3)
    assert speed.uncertainty == pytest.approx(of_speed, rel=5e-3)
    assert fit.correlation == pytest.approx(noise[1] / math.hypot(*noise), rel=1e-2)
    assert fit.values == pytest.approx([force, time], rel=1e-5)
    # two values and two parameters leave nothing to be explained
    assert fit.joint.statistic < 1e-6
    # an interval of 95 % has both ends at 1.96 of them, but for the bend of the square
    for item in fit.fitted:
        half = 0.5 * (item.high - item.low)
        assert half == pytest.approx(1.96 * item.uncertainty, rel=1e-2)
        assert item.low < item.change < item.high


def test_a_fit_says_how_far_it_is_from_what_was_declared() -> None:
    # force alone: d ln k = 2 d ln F, so that 2 % of force are 4 % of stiffness
    stiffer, noise, declared = 0.04, 2e-3, 0.02
    force = math.sqrt(1.0 + stiffer) * FORCE
    fit = fitted((reading("peak_force", 0, force, noise * force),), {"stiffness": declared}, "stiffness")
    error = 2.0 * noise * (1.0 + stiffer)
    assert fit.fitted[0].change == pytest.approx(stiffer, rel=2e-3)
    assert fit.declared is not None
    assert fit.declared.statistic == pytest.approx(stiffer**2 / (declared**2 + error**2), rel=1e-2)


def test_a_fit_far_from_normal_ends_where_the_likelihood_does() -> None:
    # the mass of the second body, from the time: t = (pi/2) sqrt(m/k); the noise is a tenth of the time
    noise = 0.1
    fit = fitted((reading("arrival", 1, TIME, noise * TIME),), {"stiffness": 0.1}, "stiffness")
    [item] = fit.fitted
    # t is 1.96 standard uncertainties off at k = (1 -+ 0.196)^-2
    ends = [(1.0 + side * 1.96 * noise) ** -2 - 1.0 for side in (1.0, -1.0)]
    assert (item.low, item.high) == pytest.approx(ends, rel=2e-2)
    assert item.high > 1.5 * -item.low


def test_uncertain_parameters_spread_values_as_their_derivatives_say() -> None:
    readings = (reading("peak_force", 0, FORCE, 1.0), reading("arrival", 1, TIME, 1e-6))
    declared = {"stiffness": 0.02, "velocity": 0.01, "mass": 0.03, "gain": 0.015, "time": 2e-6}
    prediction = Prediction(scene=SPRING, readings=readings)
    found = compare(prediction, parameters_of(declared, SPRING), count=400, seed=3)
    # relative: F = v sqrt(k m), t ~ sqrt(m / k); a Latin hypercube of 400 has its standard deviations to a few percent
    force, time = math.hypot(0.5 * 0.02, 0.01, 0.5 * 0.03), math.hypot(0.5 * 0.02, 0.5 * 0.03)
    assert found.input / np.array([FORCE, TIME]) == pytest.approx([force, time], rel=0.08)
    # a gain acts on forces alone, a shift of the clock on times alone
    assert found.data == pytest.approx([math.hypot(1.0, 0.015 * FORCE), math.hypot(1e-6, 2e-6)], rel=1e-6)
    # all of them at once, with their signs: stiffness raises forces and shortens times
    slopes = dict(zip(declared, (found.slopes / np.array([[FORCE], [TIME]])).T, strict=True))
    assert slopes["stiffness"] == pytest.approx([0.01, -0.01], rel=5e-3)
    assert slopes["velocity"] == pytest.approx([0.01, 0.0], abs=1e-5)
    assert slopes["mass"] == pytest.approx([0.015, 0.015], rel=5e-3)
    assert slopes["gain"] == pytest.approx([0.015, 0.0], abs=1e-9)
    # a clock that begins later reads an earlier arrival
    assert slopes["time"] == pytest.approx([0.0, -2e-6 / TIME], abs=1e-9)


@pytest.mark.parametrize("delay", [0.0, 3e-5])
def test_the_peak_of_a_sine_pulse_is_its_amplitude_and_a_late_clock_is_its_delay(delay: float) -> None:
    times = np.linspace(0.1, 0.9, 60) * math.pi / OMEGA
    # read by a clock that is late, and by a gauge that reads 2 % too much
    force = 1.02 * FORCE * np.sin(OMEGA * (times - 0.1 * delay))
    prediction = Prediction(scene=SPRING, readings=(reading("contact_force", 0, force, 1e-3 * FORCE, times),))
    peak, when = scalars_of(prediction, compare(prediction, (), count=2, seed=0))
    assert peak.measured / peak.simulated == pytest.approx(1.02, rel=1e-6)
    assert when.measured - when.simulated == pytest.approx(0.1 * delay, abs=1e-6 * TIME)
    # of a sum of squares of sines and of one of cosines
    weight = np.sin(OMEGA * times) ** 2
    assert peak.data == pytest.approx(1e-3 * FORCE / math.sqrt(np.sum(weight)), rel=1e-3)
    assert when.data == pytest.approx(1e-3 / OMEGA / math.sqrt(np.sum(1.0 - weight)) / 1.02, rel=1e-3)


def test_stiffer_walls_and_contacts_change_as_their_parameters_say() -> None:
    scene = replace(SPRING, wall_right=Wall(stiffness=2e6, exponent=2.0, gap=1.0))
    declared = parameters_of({"stiffness": 0.02, "stiffness[1]": 0.05, "exponent[0]": 0.1}, scene)
    other = changed(scene, declared, [0.02, 0.05, 0.1])
    assert other.stiffness == pytest.approx((1.02 * STIFFNESS,), rel=1e-12)
    assert other.wall_right is not None
    # changes of one contact by two parameters add up
    assert other.wall_right.stiffness == pytest.approx(1.07 * 2e6, rel=1e-12)
    assert other.contacts.exponent == pytest.approx([2.1, 2.0])
