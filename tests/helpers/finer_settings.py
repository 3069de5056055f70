"""Measure the errors at the settings of a plan and at finer ones, by the reference and without the planner's code."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

import dem_bridge as db
from dem_bridge.runs.planning.answer import Plan
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import Trajectory

#: so many settings, evenly spaced in their logarithm, from that of the plan down to a quarter of it
COUNT, FINEST = 40, 0.25
#: the settings that are refined; backends without any of them have one answer only
REFINED = ("dt", "rtol", "atol")


def finer_settings(plan: Plan, count: int = COUNT) -> Iterator[dict[str, Any]]:
    """Yield the settings of a plan, and ``count`` - 1 finer ones where it has a step or a tolerance."""
    refined = [key for key in REFINED if key in plan.resolution]
    for factor in np.geomspace(1.0, FINEST, count) if refined else [1.0]:
        yield {**plan.resolution, **{key: float(factor * plan.resolution[key]) for key in refined}}


def largest_error(scene: Scene, plan: Plan, truth: Trajectory, count: int = COUNT) -> float:
    """Return the largest velocity error at the settings of a plan and at finer ones, relative to the largest speed.

    Settings of one step between two samples are one run.
    """
    errors: dict[float, float] = {}
    for settings in finer_settings(plan, count):
        between = math.ceil(scene.duration / scene.samples / settings.get("dt", math.inf) * (1.0 - 1e-12))
        key = float(settings.get("rtol", between))
        if key not in errors:
            run = db.solve(scene, backend=plan.backend, uncertainty=False, **settings)
            errors[key] = float(np.max(np.abs(run.velocity - truth.velocity)))
    return max(errors.values()) / float(np.max(np.abs(truth.velocity)))
