"""Provide trajectories with closed-form answers, for tests that need no integration."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from dem_bridge.trajectory.trajectory import Cost, Trajectory, Uncertainty

#: a scene file of three bodies
CHAIN = """\
name = "small"
duration = 2.0e-4
[chain]
mass = [8.1e-3, 1.0e-2, 1.0e-2]
stiffness = [4.0e9, 5.0e9]
velocity = [0.8, 0.0, 0.0]
[sampling]
count = 20
"""

NO_COST = Cost(wall=0.0, cpu=0.0, steps=0, force_evaluations=0)
NO_ERROR = Uncertainty(velocity=0.0, displacement=0.0, peak_force=0.0, crossing_time=0.0)


def uncertain(**values: Any) -> Uncertainty:
    """Return an uncertainty with these values, 0 for the other quantities."""
    return replace(NO_ERROR, **values)


def free_flight(
    *, bodies: int = 3, contacts: int = 2, samples: int = 4, duration: float = 1.0, **changes: Any
) -> Trajectory:
    """Return a run: body i flies at i + 1 m/s, contact k has peak force 10 (k + 1) N and crosses at 0.1 (k + 1) s."""
    time = np.linspace(0.0, duration, samples + 1)
    speed = np.arange(1.0, bodies + 1.0)
    parts: dict[str, Any] = {
        "time": time,
        "displacement": time[:, None] * speed,
        "velocity": np.ones((samples + 1, 1)) * speed,
        "contact_force": np.zeros((samples + 1, contacts)),
        "peak_force": 10.0 * np.arange(1, contacts + 1),
        "crossing_time": 0.1 * np.arange(1, contacts + 1),
        "uncertainty": NO_ERROR,
        "cost": NO_COST,
        "provenance": {"backend": "fake"},
    }
    return Trajectory(**(parts | changes))
