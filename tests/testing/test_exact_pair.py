"""The backend with closed forms agrees with the reference, and says nan where nothing is compressed."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from dem_bridge.backends.base import Resolution, Sampling
from dem_bridge.scene.scene import Scene
from dem_bridge.testing import ExactPair, plain_scene
from dem_bridge.trajectory.trajectory import QUANTITIES
from tests.conftest import Solve

PAIR = plain_scene(2, exponent=2.0)


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"gap": 2e-5},
        {"gap": -1e-5},
        {"gap": -1e-5, "velocity": (0.2, 0.3)},
        {"gap": 1e-3},
        {"velocity": (0.1, 0.4)},
        {"velocity": (0.8, -0.7), "gravity": 500.0, "gap": 1e-5},
        {"duration": 1e-5},
        {"duration": 1e-5, "gap": -1e-5, "velocity": (-0.1, 0.0)},
    ],
    ids=str,
)
def test_it_is_the_solution_of_the_reference(changes: dict[str, Any], solved: Solve) -> None:
    scene: Scene = replace(PAIR, **changes)
    run = ExactPair().run(scene, Resolution(), Sampling(count=scene.samples))
    reference = solved(scene, "reference")
    for name in QUANTITIES:
        exact, other = getattr(run, name), getattr(reference, name)
        np.testing.assert_array_equal(np.isnan(exact), np.isnan(other))
        allowed = np.max(reference.uncertainty[name]) + np.max(run.uncertainty[name])
        assert np.nanmax(np.abs(exact - other), initial=0.0) <= allowed, name
    scale = float(np.max(reference.peak_force))
    np.testing.assert_allclose(run.contact_force, reference.contact_force, rtol=0.0, atol=1e-11 * scale)


def test_a_single_body_falls() -> None:
    run = ExactPair().run(replace(plain_scene(1), gravity=9.81), Resolution(), Sampling(count=4))
    np.testing.assert_allclose(run.velocity[:, 0], 0.8 + 9.81 * run.time, rtol=1e-15)
    np.testing.assert_allclose(run.displacement[:, 0], 0.8 * run.time + 0.5 * 9.81 * run.time**2, rtol=1e-15)
    assert run.contact_force.shape == (5, 0)
