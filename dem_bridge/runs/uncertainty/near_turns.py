"""First turns of contacts that are so near to touch that adaptive runs cannot tell a graze from a miss."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dem_bridge.backends.scales import unfelt_overlap
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import Trajectory, Uncertainty

#: factor of the largest difference to the further runs, as for samples
SAFETY = 3.0


def widen_for_near_turns(
    uncertainty: Uncertainty, scene: Scene, run: Trajectory, others: Sequence[Trajectory]
) -> Uncertainty:
    """Return an uncertainty that covers touches which all runs may miss alike, or see where there is none.

    The overlap at a turn is known to the overlap below which no contact is seen, and to its differences to the further
    runs. Where it may have either sign, the first crossing is unknown, and a peak force up to that of the overlap.

    Parameters
    ----------
    uncertainty : Uncertainty
        Uncertainty of ``run`` without such touches.
    scene : Scene
    run : Trajectory
        The run, with ``first_turns`` in its provenance.
    others : sequence of Trajectory
        Further runs of the same code.
    """
    turns = run.provenance.get("first_turns", {})
    if not turns:
        return uncertainty
    c, unfelt = scene.contacts, unfelt_overlap(scene)
    crossing = np.array(np.broadcast_to(uncertainty.crossing_time, c.left.shape))
    peak = np.array(np.broadcast_to(uncertainty.peak_force, c.left.shape))
    for key, overlap in turns.items():
        k = np.array([int(key)])
        apart = [abs(overlap - other.provenance["first_turns"].get(key, math.inf)) for other in others]
        # a run that has no such turn is as far away as displacements are uncertain
        apart = [min(value, 2.0 * float(uncertainty.displacement)) for value in apart]
        doubt = float(unfelt[k[0]]) + SAFETY * max(apart, default=0.0)
        if abs(overlap) <= doubt:
            crossing[k] = math.inf
            peak[k] = np.maximum(peak[k], c.force(np.array([max(overlap, 0.0) + doubt]), k))
    return replace(uncertainty, crossing_time=crossing, peak_force=peak)
