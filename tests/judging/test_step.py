"""The error of a time step and the largest steps for accuracies are those of runs of the package's own code."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import dem_bridge as db
from dem_bridge.formats.readers import Record
from dem_bridge.judging import plain_kernels
from dem_bridge.judging.decision import METHODS_OF_RIGHT_CODES
from dem_bridge.judging.diagnosis import Diagnosis
from dem_bridge.judging.fitting import TOLERANCE_OF_DECISION
from dem_bridge.judging.kernels import DRIFT_FIRST, RK4, VERLET
from dem_bridge.judging.model import Model, model_of
from dem_bridge.judging.reference import file_errors
from dem_bridge.judging.search import Search
from dem_bridge.judging.step import errors_by_step, predict_step_error
from dem_bridge.physics.contact_law import law_of

PAIR = db.Scene(name="pair", duration=1e-4, mass=(8e-3, 1e-2), stiffness=(4e9,), velocity=(0.8, 0.0), samples=80)
CHAIN = db.Scene(
    name="chain",
    duration=4e-4,
    mass=(8e-3, 2e-3, 2e-2, 1e-2, 1e-2),
    stiffness=(1e10, 2e9, 2e10, 9e9),
    velocity=(0.8, 0.0, 0.0, 0.0, -0.1),
    gap=(0.0, 1e-6, 0.0, 2e-6),
    wall_right=db.Wall(stiffness=3e9, gap=1e-6),
    gravity=9.81,
    samples=100,
)
DAMPED = replace(PAIR, name="damped", damping=db.Damping(law="dashpot", coefficient=12.0))


def error_of_verlet(scene: db.Scene, dt: float) -> float:
    """Return the largest error of velocities of the twin, relative to the largest velocity."""
    run = db.solve(scene, backend="verlet", dt=dt, uncertainty=False)
    right = db.solve(scene, backend="reference", uncertainty=False)
    return float(np.max(np.abs(run.velocity - right.velocity)) / np.max(np.abs(right.velocity)))


@pytest.mark.parametrize("scene", [PAIR, CHAIN, DAMPED], ids=lambda scene: scene.name)
def test_the_error_of_a_step_is_that_of_a_run_with_it(scene: db.Scene) -> None:
    interval = scene.duration / scene.samples
    for count in (2, 16):
        step = predict_step_error(scene, interval / count)
        assert step is not None
        # both are the error of one method at one step; the exact motions differ by 1e-11
        assert step.error == pytest.approx(error_of_verlet(scene, interval / count), rel=1e-3)


@pytest.mark.parametrize("scene", [PAIR, CHAIN, DAMPED], ids=lambda scene: scene.name)
@pytest.mark.parametrize("dt", [None, 3e-8, 4e-5])
def test_a_run_with_the_largest_step_is_within_its_accuracy_and_one_with_twice_of_it_is_not(
    scene: db.Scene, dt: float | None
) -> None:
    step = predict_step_error(scene, dt)
    assert step is not None
    largest_steps: Any = step.as_json()["largest_for"]
    assert list(largest_steps) == ["1e-2", "1e-3", "1e-4"]
    for accuracy in (1e-2, 1e-3, 1e-4):
        largest = step.largest_for(accuracy)
        # a run takes the next smaller step that divides the interval of samples, whose error may be larger by chance
        assert error_of_verlet(scene, largest) < 1.2 * accuracy
        twice = predict_step_error(scene, 2.0 * largest, accuracies=())
        assert twice is not None
        assert not twice.error <= accuracy
        assert largest_steps[f"1e-{round(-np.log10(accuracy))}"] == largest


def test_a_step_that_resolves_nothing_has_an_error_and_largest_steps() -> None:
    step = predict_step_error(PAIR, 1e-4)
    assert step is not None
    assert step.as_json()["error"] is None or step.error > 0.1
    assert 1e-7 < step.largest_for(1e-3) < 1e-5


def test_a_law_that_is_a_function_has_no_predicted_error() -> None:
    law = law_of(lambda overlap: overlap**1.5, reach=1e-3)
    assert predict_step_error(replace(PAIR, law=law), 1e-7) is None


@pytest.mark.parametrize(
    ("method", "wrong_from", "expected"),
    [
        (VERLET, 60, VERLET),
        (DRIFT_FIRST, 60, DRIFT_FIRST),
        (RK4, 60, RK4),
        (RK4, 1, VERLET),
        (DRIFT_FIRST, 2, DRIFT_FIRST),
    ],
)
def test_errors_of_the_step_are_those_of_the_method_with_which_a_wrong_file_agrees_longest(
    method: int, wrong_from: int, expected: int
) -> None:
    model, time, dt = Model(CHAIN), np.linspace(0.0, CHAIN.duration, 101), CHAIN.duration / 1000
    velocity = (
        model.stepped_at(model.system, time, dt, method).velocity + 1e-3 * (np.arange(101) >= wrong_from)[:, None]
    )
    record = Record(
        name="file", time=time, values={"velocity": velocity}, columns={"velocity": tuple(range(CHAIN.n_body))}, dt=dt,
        rounding={"velocity": np.full_like(velocity, 1e-13), "time": np.zeros(101)},
    )  # fmt: skip
    errors = errors_by_step(CHAIN, Diagnosis(cause="unknown", evidence=""), file_errors(CHAIN, [record])[0])
    assert errors is not None
    exact = model.exact(model.system, time, TOLERANCE_OF_DECISION).velocity
    of_each = [model.stepped_at(model.system, time, dt, each).velocity - exact for each in METHODS_OF_RIGHT_CODES]
    assert np.array_equal(errors["velocity"], of_each[METHODS_OF_RIGHT_CODES.index(expected)])


@pytest.mark.parametrize("last", [0.0, 0.4])
def test_a_motion_of_some_of_the_times_has_the_numbers_of_all(last: float) -> None:
    model, dt = Model(CHAIN), CHAIN.duration / 1000
    # on the steps, but for a part of 5e-6 of one; the last time may be between two
    times = dt * np.array([0.0, 10.0, 20.0 + 5e-6, 30.0, 40.0 + last])
    whole, part = (model.stepped_at(model.system, times, dt, RK4, rows) for rows in (None, 3))
    for name in ("displacement", "velocity", "acceleration", "force"):
        assert np.array_equal(getattr(part, name), getattr(whole, name)[:3])


def test_the_motion_of_a_scene_is_computed_once_for_all_answers_about_a_file(monkeypatch: pytest.MonkeyPatch) -> None:
    integrate, computed = plain_kernels.adaptive, []

    def counted(*words: Any) -> Any:
        computed.append(words[5])
        return integrate(*words)

    monkeypatch.setattr(plain_kernels, "adaptive", counted)
    model_of.cache_clear()
    time = np.linspace(0.0, CHAIN.duration, 101)
    velocity = model_of(CHAIN).stepped_at(model_of(CHAIN).system, time, 1e-7).velocity + 1e-3
    record = Record(
        name="file", time=time, values={"velocity": velocity}, columns={"velocity": (0, 1, 2, 3, 4)}, dt=1e-7,
        rounding={"velocity": np.full_like(velocity, 1e-13), "time": np.zeros(101)},
    )  # fmt: skip
    search = Search(CHAIN, record, {})
    errors_by_step(CHAIN, Diagnosis(cause="unknown", evidence=""), file_errors(CHAIN, [record])[0])
    predict_step_error(CHAIN, 1e-7, times=time)
    assert computed.count(TOLERANCE_OF_DECISION) == 1
    assert search.model is model_of(CHAIN)
