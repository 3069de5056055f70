"""The reference at any times is the reference of the scene."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import dem_bridge as db
from dem_bridge.errors import UnsupportedScene, UsageError
from dem_bridge.judging import reference as module
from dem_bridge.judging.reference import UNITS, reference_at
from tests.helpers.judged_records import CHAIN

WALLED = replace(CHAIN, name="walled", wall_right=db.Wall(stiffness=4e9, gap=1e-6), gravity=9.81)
DAMPED = replace(CHAIN, name="damped", damping=db.Damping(law="dashpot", coefficient=12.0))


@pytest.mark.parametrize("scene", [CHAIN, WALLED, DAMPED], ids=lambda scene: scene.name)
def test_at_the_times_of_the_scene_it_is_the_run_of_the_backend(scene: db.Scene) -> None:
    run = db.solve(scene, backend="reference")
    samples = reference_at(scene, run.time)
    for name in UNITS:
        assert np.max(np.abs(samples.values[name] - getattr(run, name))) <= samples.uncertainty[name]
    assert samples.uncertainty["velocity"] < 1e-9 * samples.largest["velocity"]


@pytest.mark.parametrize("scene", [CHAIN, DAMPED], ids=lambda scene: scene.name)
def test_uneven_times_beyond_the_end_are_those_of_a_longer_scene(scene: db.Scene) -> None:
    longer = db.solve(replace(scene, duration=2.0 * scene.duration, samples=80), backend="reference")
    rows = np.array([3, 4, 17, 41, 80])
    samples = reference_at(scene, longer.time[rows])
    for name in UNITS:
        error = np.max(np.abs(samples.values[name] - getattr(longer, name)[rows]))
        assert error <= 2.0 * samples.uncertainty[name], name


def test_an_impact_agrees_with_its_closed_form() -> None:
    pair = db.Scene(name="pair", duration=1e-4, mass=(8.1e-3, 1e-2), stiffness=(4e9,), velocity=(0.8, 0.0))
    end = reference_at(pair, np.array([3e-4, 7e-4]))
    left = 0.8 * (8.1e-3 - 1e-2) / 1.81e-2
    np.testing.assert_allclose(end.values["velocity"], [[left, left + 0.8]] * 2, atol=1e-13)
    step = (end.values["displacement"][1] - end.values["displacement"][0]) / 4e-4
    np.testing.assert_allclose(step, [left, left + 0.8], rtol=1e-11)


@pytest.mark.parametrize(
    ("time", "part"),
    [
        ([-1e-6, 1e-6], "go from -1e-06"),
        ([0.0], "any later time"),
        ([], "any later time"),
        ([0.0, 1e-6, 1e-6], "increasing times"),
        ([0.0, np.nan], "increasing times"),
    ],
)
def test_times_that_cannot_be_judged_are_refused(time: list[float], part: str) -> None:
    with pytest.raises(UsageError, match=part):
        reference_at(CHAIN, np.array(time))


def test_a_scene_without_reference_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "unsupported_reason", lambda backend, scene: "the scene has glue")
    with pytest.raises(UnsupportedScene, match=r"no reference solution of five, .*: the scene has glue"):
        reference_at(CHAIN, np.array([0.0, 1e-6]))
