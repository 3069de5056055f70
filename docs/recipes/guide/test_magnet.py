# tests/backends/test_magnet.py
"""A magnet accelerates all bodies alike; backends that do not list it refuse it by name."""

from __future__ import annotations

import numpy as np
import pytest

import dem_bridge as db
from dem_bridge.backends.base import BACKENDS, backend, unsupported_reason
from dem_bridge.scene.file import parse_scene
from dem_bridge.testing import Check, backend_checks

SCENE = parse_scene("""
name = "attracted"
duration = 1e-4
[chain]
mass = [1e-2, 2e-2]
stiffness = [4e9]
velocity = [0.0, 0.1]
[environment]
magnet = 500.0
[sampling]
count = 10
""")


def test_bodies_that_move_apart_are_accelerated_alike() -> None:
    run = db.solve(SCENE, backend="verlet", dt=1e-6)
    # a constant acceleration is exact for velocity-Verlet; each of 100 steps rounds
    assert run.velocity == pytest.approx(np.array([0.0, 0.1]) + 500.0 * run.time[:, None], rel=1e-14)


@pytest.mark.parametrize("name", [name for name in BACKENDS if name != "verlet"])
def test_other_backends_refuse_it_and_name_one_that_does_not(name: str) -> None:
    reason = str(unsupported_reason(backend(name), SCENE))
    assert "a magnet; " in reason
    assert reason.endswith("; use backend = 'verlet'")


@pytest.mark.parametrize(
    "check", [check for name in BACKENDS for check in backend_checks(backend(name)) if "magnet" in check.name]
)
def test_the_checks_that_follow_from_the_declarations_pass(check: Check) -> None:
    check()
