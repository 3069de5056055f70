"""The round-off of absolute positions as a number for the comment of a deck: the twin in positions and in overlaps."""

from __future__ import annotations

import numpy as np

from dem_bridge.backends.twin import solve_plan
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.dense import Schedule


def roundoff_floor(scene: Scene, plan: Schedule, radius: float) -> float:
    """Return the round-off of positions of bodies of ``radius`` (m) in velocities, relative to the largest of them."""
    exact, positional = solve_plan(scene, plan), solve_plan(scene, plan, radius)
    speed = float(np.max(np.abs(exact.velocity)))
    return float(np.max(np.abs(exact.velocity - positional.velocity))) / speed if speed > 0.0 else 0.0
