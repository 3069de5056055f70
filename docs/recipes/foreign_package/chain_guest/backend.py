"""Position-Verlet: half a drift, a kick, half a drift."""

import numpy as np

from dem_bridge.backends.base import Availability, Resolution, Sampling
from dem_bridge.backends.prescan import prescan_hertz
from dem_bridge.backends.splitting import Method, solve
from dem_bridge.backends.steps import fixed_step_plan
from dem_bridge.scene import features
from dem_bridge.scene.scene import Scene
from dem_bridge.scene.support import Support
from dem_bridge.trajectory.trajectory import Trajectory

METHOD = Method(drifts=np.array([0.5, 0.5]), kicks=np.array([0.0, 1.0, 0.0]))


class GuestVerlet:
    """Position-Verlet in overlap variables."""

    name = "guest-verlet"
    equations = "hertz"
    order = 2
    uncertainty_from = "twins"
    supports = Support({features.WALLS, features.GAPS, features.INITIAL_OVERLAPS, features.SEVERAL_MOVING})

    def availability(self) -> Availability:
        """Return that the backend can run."""
        return Availability(True)

    def run(self, scene: Scene, resolution: Resolution, sampling: Sampling) -> Trajectory:
        """Solve a scene."""
        plan = fixed_step_plan(scene, resolution, sampling, prescan_hertz(scene))
        run, _ = solve(self, METHOD, scene, plan, full=False)
        return run
