# dem_bridge/backends/leapfrog.py
"""Position-Verlet: half a drift, a kick, half a drift. Forces are those of the middle of the step."""

from __future__ import annotations

import numpy as np

from dem_bridge import features
from dem_bridge.backends.base import Availability, Resolution, Sampling
from dem_bridge.backends.prescan import prescan_hertz
from dem_bridge.backends.splitting import Method, solve
from dem_bridge.backends.steps import fixed_step_plan
from dem_bridge.scene.scene import Scene
from dem_bridge.scene.support import Support
from dem_bridge.trajectory.trajectory import Trajectory

METHOD = Method(drifts=np.array([0.5, 0.5]), kicks=np.array([0.0, 1.0, 0.0]))


class Leapfrog:
    """Position-Verlet in overlap variables."""

    name = "leapfrog"
    equations = "hertz"
    order: int | None = 2
    #: of the forces in a step; the planner counts with it
    evaluations = 2
    supports = Support(
        {features.WALLS, features.GAPS, features.INITIAL_OVERLAPS, features.SEVERAL_MOVING}
        | {features.OTHER_EXPONENTS, features.GRADED_EXPONENTS, features.GRAVITY, features.PRECOMPRESSION}
        | {features.SINE_DRIVE, features.CHIRP_DRIVE, features.TABLE_DRIVE}
    )

    def availability(self) -> Availability:
        return Availability(True)

    def run(self, scene: Scene, resolution: Resolution, sampling: Sampling) -> Trajectory:
        plan = fixed_step_plan(scene, resolution, sampling, prescan_hertz(scene))
        run, _ = solve(self, METHOD, scene, plan, full=False)
        return run
