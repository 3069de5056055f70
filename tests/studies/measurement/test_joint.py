"""The joint statistic of many uncertain parameters has its stated distribution, for linear and other simulations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import pytest
from scipy.stats import binom, chi2

import dem_bridge as db
from dem_bridge.observables.verdict import Outcome
from dem_bridge.scene.file import parse_scene
from dem_bridge.studies.measurement.comparison import Comparison, Whitening, compare, deviations_of
from dem_bridge.studies.measurement.parameters import Parameter, parameters_of
from dem_bridge.studies.measurement.prediction import Prediction, adjust
from dem_bridge.studies.measurement.readings import Reading
from dem_bridge.studies.measurement.study import outcome_of
from dem_bridge.trajectory.trajectory import Floats
from tests.helpers.synthetic import SCENE, motion

SPREAD, NOISE = 0.02, 0.01


@dataclass(frozen=True, kw_only=True, eq=False)
class StandIn(Prediction):
    """Stand in for a simulation: values are ``slopes @ x + bend * (slopes @ x)^2``, x in standard uncertainties."""

    slopes: Floats = field(default_factory=lambda: np.zeros((1, 1)))
    bend: float = 0.0

    @property
    def simulated(self) -> Floats:
        return np.zeros(len(self.slopes))

    @property
    def numerical(self) -> Floats:
        return np.zeros(len(self.slopes))

    def at(self, parameters: Sequence[Parameter], changes: Sequence[float]) -> Floats:
        first = self.slopes @ (np.array(changes) / SPREAD)
        return np.asarray(first + self.bend * first**2)


def compared(slopes: Floats, deviates: Floats, noise: Floats, bend: float = 0.0, count: int = 10) -> Comparison:
    """Return the comparison of a stand-in whose parameters deviate from those of the scene."""
    links = max(slopes.shape[1], 2)
    scene = db.Scene(
        name="row", duration=1e-3, mass=(1.0,) * (links + 1), stiffness=(1e9,) * links, velocity=(1.0, *[0.0] * links)
    )
    parameters = parameters_of({f"stiffness[{k}]": SPREAD for k in range(slopes.shape[1])}, scene)
    right = StandIn(scene=scene, readings=(), slopes=slopes, bend=bend)
    value = right.at(parameters, (SPREAD * deviates).tolist()) + NOISE * noise
    reading = Reading(
        quantity="peak_force",
        place=0,
        time=np.full(len(value), np.nan),
        value=value,
        uncertainty=np.full(len(value), NOISE),
    )
    stand_in = StandIn(scene=scene, readings=(reading,), slopes=slopes, bend=bend)
    return compare(stand_in, parameters, count=count, seed=0)


@pytest.mark.parametrize(
    ("count", "models"),
    [(1, 150), (40, 150), *(pytest.param(count, 400, marks=pytest.mark.slow) for count in (1, 5, 20, 40))],
)
def test_right_models_of_many_parameters_are_excluded_as_rarely_as_stated(count: int, models: int) -> None:
    random = np.random.default_rng(count)
    slopes = random.standard_normal((count + 2, count))
    missed, by_samples = 0, 0
    for _ in range(models):
        found = compared(slopes, random.standard_normal(count), random.standard_normal(count + 2))
        assert found.linear
        missed += found.joint().deviations > 2.0
    # 4.55 % are stated; a right method is outside of these limits once in 500 times
    low, high = binom.interval(0.998, models, 0.0455)
    assert low <= missed <= high
    # planted: a covariance from 100 samples that is taken for exact
    for _ in range(40):
        found = compared(slopes, random.standard_normal(count), random.standard_normal(count + 2), count=100)
        sampled = Whitening(found.noise, found.of_samples)(found.error)
        by_samples += _deviates(sampled)
    assert count < 40 or by_samples > 10


def _deviates(whitened: Floats) -> bool:
    return deviations_of(float(chi2.sf(np.sum(whitened**2), len(whitened)))) > 2.0


def test_a_right_model_is_no_difference_where_values_are_not_linear_in_the_parameters() -> None:
    random, models, count = np.random.default_rng(3), 100, 5
    slopes = random.standard_normal((8, count)) / np.sqrt(count)
    missed, nominal = 0, 0
    for _ in range(models):
        # the square is a tenth of the change: ten standard uncertainties of a value
        found = compared(slopes, random.standard_normal(count), random.standard_normal(8), bend=0.1)
        missed += found.joint().deviations > 2.0
        # planted: derivatives at the scene's own parameters
        nominal += _deviates(Whitening(found.noise, slopes)(found.error))
    assert missed <= binom.ppf(0.999, models, 0.0455)
    assert nominal > 0.5 * models


def test_a_simulation_that_is_not_linear_within_what_the_values_leave_decides_nothing() -> None:
    # the values leave 0.45 of the second parameter, over which its square is 8e-6 or 4 times the noise
    slopes = np.array([[1.0, 0.0], [0.0, 0.02]])
    assert compared(slopes, np.zeros(2), np.zeros(2), bend=1e-3).linear
    assert not compared(slopes, np.zeros(2), np.zeros(2), bend=500.0).linear
    assert outcome_of(1e-9, 2.0, True) is Outcome.MODEL_DIFFERENCE
    assert outcome_of(1e-9, 2.0, False) is Outcome.UNDECIDED
    assert outcome_of(0.5, 2.0, False) is Outcome.PASS


def test_a_stiffness_at_two_uncertainties_is_no_alarm_although_the_pulse_is_shifted_far() -> None:
    times = np.linspace(2e-6, 2.4e-4, 120)
    velocity = motion(times, stiffness=1.2)[0][:, 3] + 1e-3 * np.random.default_rng(1).standard_normal(len(times))
    reading = Reading(quantity="velocity", place=3, time=times, value=velocity, uncertainty=np.full(len(times), 1e-3))
    scene = parse_scene(SCENE)
    prediction = Prediction(scene=scene, readings=(reading,))
    parameters = parameters_of({"stiffness": 0.1}, scene)
    found = compare(prediction, parameters, count=10, seed=0)
    assert found.linear
    assert found.joint().deviations < 2.0
    adjusted = adjust(prediction, parameters, velocity, np.full(len(times), 1e-3))
    assert adjusted.x[0] == pytest.approx(2.0, abs=0.05)
    # planted: the linear model at the scene's own stiffness
    linear = (prediction.at(parameters, [1e-3]) - prediction.at(parameters, [-1e-3])) / 0.02
    assert _deviates(Whitening(found.noise, linear[:, None])(found.error))
