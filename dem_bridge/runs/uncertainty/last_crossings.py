"""First maxima of compression so near to the end of an adaptive run that they may be after it, or before it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import Trajectory, Uncertainty


def widen_for_the_end(uncertainty: Uncertainty, scene: Scene, run: Trajectory) -> Uncertainty:
    """Return an uncertainty that is inf for crossings which the end of a run leaves undecided.

    A crossing may be after the end if its uncertainty reaches so far. A contact that is compressed at the end may have
    had its crossing if both its velocities are so uncertain; one that has been slower all the time is at rest so far.

    Parameters
    ----------
    uncertainty : Uncertainty
        Uncertainty of ``run`` by its further runs.
    scene : Scene
    run : Trajectory
    """
    c, crossing = scene.contacts, np.array(np.broadcast_to(uncertainty.crossing_time, run.crossing_time.shape))
    late = run.crossing_time + crossing > run.time[-1]
    velocity = np.column_stack([run.velocity, np.zeros(len(run.velocity))])
    rate, slow = np.abs(velocity[:, c.left] - velocity[:, c.right]), 2.0 * float(uncertainty.velocity)
    pressed = np.isnan(run.crossing_time) & (run.contact_force[-1] != 0.0)
    early = pressed & (rate[-1] <= slow) & (np.max(rate, axis=0) > slow)
    return replace(uncertainty, crossing_time=np.where(late | early, math.inf, crossing))
