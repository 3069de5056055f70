"""The choice of a step, on errors that are powers of it: each trial by hand, and the reason where no step will do."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from dem_bridge.backends.base import Resolution, Sampling
from dem_bridge.errors import UnsupportedScene, UsageError
from dem_bridge.runs.cache import RunCache
from dem_bridge.runs.case import Case
from dem_bridge.runs.uncertainty import step_choice
from dem_bridge.runs.uncertainty.step_choice import step_for_accuracy
from dem_bridge.scene.scene import Damping, Scene
from dem_bridge.trajectory.trajectory import Trajectory
from tests.helpers.fake_runs import free_flight, uncertain

PAIR = Scene(name="pair", duration=1e-4, mass=(8e-3, 1e-2), stiffness=(4e9,), velocity=(0.8, 0.0), samples=20)
DAMPED = replace(PAIR, damping=Damping(law="dashpot", coefficient=10.0))
#: parts of an uncertainty that the step alone makes
CLEAN = {"time_step": 1.0, "round_off": 0.0, "table": 0.0}


class Trials:
    """Runs whose velocity uncertainty is a function of the step; notes the steps."""

    def __init__(self, error: Callable[[float], float], parts: dict[str, float], **changes: Any) -> None:
        self.error, self.parts, self.changes = error, parts, changes
        self.steps: list[float] = []

    def solve(self, case: Case, cache: RunCache) -> Trajectory:
        dt = case.resolution.dt
        assert dt is not None
        self.steps.append(dt)
        # the largest velocity is 2 m/s
        uncertainty = replace(uncertain(velocity=2.0 * self.error(dt)), parts=self.parts, roundoff_floor=3e-5)
        parts = {"uncertainty": uncertainty, "provenance": {"settings": {"dt": dt}}} | self.changes
        run = free_flight(bodies=2, contacts=1, **parts)
        cache.keep(case, run)
        return run


@pytest.fixture
def choose(monkeypatch: pytest.MonkeyPatch) -> Callable[..., Resolution]:
    """Choose a step by trials, the first of them from a default step."""

    def chosen(
        trials: Trials, accuracy: float, *, default: float = 1e-8, scene: Scene = PAIR, **how: Any
    ) -> Resolution:
        monkeypatch.setattr(step_choice, "solve", trials.solve)
        monkeypatch.setattr(step_choice, "default_step", lambda *_: default)
        resolution = how.pop("resolution", Resolution())
        return step_for_accuracy(scene, accuracy, resolution, Sampling(count=scene.samples), **how)

    return chosen


@pytest.mark.parametrize(
    ("how", "power", "accuracy", "default", "steps"),
    [
        # from 100 default steps by the root of what is missing, to a tenth at most
        ({}, 2, 1.01e-6, 1e-8, [1e-6, 1e-7, 1e-8]),
        ({}, 2, 2.6e-3, 1e-8, [1e-6, 5e-7]),
        ({}, 2, 1.01e-4, 2e-8, [2e-6, 2e-7, 1e-7]),
        # by 0.7 at least
        ({}, 2, 0.0155, 1.3e-8, [1.3e-6, 5e-7]),
        ({}, 2, 0.02, 1.3e-8, [1.3e-6]),
        # dashpots are of first order
        ({"scene": DAMPED}, 1, 2.1e-3, 1e-8, [1e-6, 2e-7]),
        # the first step of a method of order 4 is twice as long
        ({"by": "blanes-moan"}, 4, 2e-3, 1e-8, [2e-6, 5e-7]),
    ],
)  # fmt: skip
def test_each_trial_follows_from_the_last(
    how: dict[str, Any], power: int, accuracy: float, default: float, steps: list[float],
    choose: Callable[..., Resolution],
) -> None:  # fmt: skip
    trials = Trials(lambda dt: 1e-2 * (dt / 1e-6) ** power, CLEAN)
    found = choose(trials, accuracy, default=default, resolution=Resolution(table_points=300), **how)
    assert trials.steps == pytest.approx(steps, rel=1e-12)
    assert found == Resolution(dt=trials.steps[-1], table_points=300)


def test_an_uncertainty_of_the_accuracy_itself_will_do_and_runs_of_the_choice_are_kept(
    choose: Callable[..., Resolution],
) -> None:
    cache = RunCache()
    trials = Trials(lambda dt: {1e-6: 0.25, 1e-7: 0.125}.get(round(dt, 12), 0.0), CLEAN)
    assert choose(trials, 0.125, cache=cache).dt == pytest.approx(5e-7)
    assert [case.resolution.dt for case in cache.runs] == [trials.steps[-1]]
    exact = Trials(lambda dt: 0.125, CLEAN)
    choose(exact, 0.125)
    assert len(exact.steps) == 1


def test_where_nothing_moves_the_first_step_will_do(choose: Callable[..., Resolution]) -> None:
    still = Trials(lambda dt: 1.0, CLEAN, velocity=np.zeros((5, 2)))
    choose(still, 1e-6)
    assert len(still.steps) == 1


@pytest.mark.parametrize(
    ("parts", "changes", "resolution", "words"),
    [
        ({"round_off": 2.0}, {}, {}, r"round-off with a radius of \S+ m is 3e-05 of the largest velocity at dt = 1e-0"),
        ({"round_off": 2.0}, {}, {"geometry": "physical"}, r"at dt = 1e-06 s \(take geometry='surrogate'\);"),
        ({"round_off": 1.0, "table": 1.0}, {}, {}, "round-off with a radius"),
        ({"table": 2.0}, {}, {}, r"the interpolation error of the tables is 2 of the largest velocity \(take more"),
        ({"table": 2.0}, {"contact_force": np.full((5, 1), -1.0)}, {}, "contacts with damping beside a table become t"),
    ],
)  # fmt: skip
def test_limits_of_any_step_end_the_search_with_a_remedy(
    parts: dict[str, float], changes: dict[str, Any], resolution: dict[str, Any], words: str,
    choose: Callable[..., Resolution],
) -> None:  # fmt: skip
    trials = Trials(lambda dt: 0.5, CLEAN | parts, **changes)
    scene = replace(DAMPED, spacing=0.018) if changes else replace(PAIR, spacing=0.018)
    with pytest.raises(UsageError, match=rf"^accuracy = 1e-06 on pair cannot be reached: .*{words}") as caught:
        choose(trials, 1e-6, scene=scene, resolution=Resolution(**resolution))
    assert "; the smallest uncertainty is 0.5; ask for less" in str(caught.value)
    assert len(trials.steps) == 1


def test_a_limit_below_the_error_of_the_step_or_the_accuracy_does_not_end_it(choose: Callable[..., Resolution]) -> None:
    for parts, accuracy in (
        ({"time_step": 1.0, "round_off": 0.5, "table": 0.5}, 1e-6),
        (CLEAN | {"time_step": 0.0, "table": 0.09}, 0.1),
    ):
        trials = Trials(lambda dt: 0.5 if dt > 0.9e-6 else 0.0, parts)
        choose(trials, accuracy)
        assert len(trials.steps) == 2


def test_more_steps_than_can_be_waited_for_are_refused(
    choose: Callable[..., Resolution], monkeypatch: pytest.MonkeyPatch
) -> None:
    # 1e-4 s in steps of 1e-6, 1e-7 and 1e-8 s
    monkeypatch.setattr(step_choice, "MOST_STEPS", 1001)
    trials = Trials(lambda dt: 0.9, CLEAN)
    with pytest.raises(
        UsageError, match=r"^accuracy = 1e-06 on pair needs a step below 1e-08 s, more than 1e\+03 steps"
    ):
        choose(trials, 1e-6)
    assert trials.steps == pytest.approx([1e-6, 1e-7])
    # as many as the limit are allowed
    monkeypatch.setattr(step_choice, "MOST_STEPS", PAIR.duration / 1e-6)
    once = Trials(lambda dt: 0.9, CLEAN)
    with pytest.raises(UsageError, match="needs a step below 1e-07 s"):
        choose(once, 1e-6)
    assert len(once.steps) == 1


def test_a_scene_that_the_code_does_not_do_is_refused_first(choose: Callable[..., Resolution]) -> None:
    trials = Trials(lambda dt: 0.0, CLEAN)
    with pytest.raises(UnsupportedScene, match=r"^accuracy = 1e-06 on pair: "):
        choose(trials, 1e-6, scene=DAMPED, by="blanes-moan")
    for accuracy in (0.0, 1.0):
        with pytest.raises(UsageError, match="allowed: a number between 0 and 1"):
            choose(trials, accuracy)
    assert trials.steps == []
