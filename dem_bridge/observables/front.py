"""The wave front along the chain: arrival, residence time and wave speed, by the paper's crossing definition.

The paper (section 4a): cylinder i holds the impulse from t_i^i, when its velocity exceeds that of cylinder i-1, to
t_i^f, when that of cylinder i+1 exceeds its own. These are the first maximal compressions of contacts i-1 and i, the
``crossing_time`` of a Trajectory, so the accuracy is that of the run and not of its samples.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dem_bridge.errors import UsageError
from dem_bridge.scene import Scene
from dem_bridge.trajectory import Trajectory

Floats = NDArray[np.float64]


def arrival_by_crossing(scene: Scene, trajectory: Trajectory) -> Floats:
    """When the impulse reaches body i = 1..n_body-1, s, ``(n_body - 1,)``; nan where it never does."""
    return np.array(trajectory.crossing_time[: scene.n_body - 1])


def residence_by_crossing(scene: Scene, trajectory: Trajectory) -> Floats:
    """How long body i = 1..n_body-2 holds the impulse, s, ``(n_body - 2,)``: t_i^f - t_i^i.

    >>> import dem_bridge as db
    >>> scene = db.load_scene("decelerating-40")
    >>> residence = residence_by_crossing(scene, db.solve(scene, backend="bca"))
    >>> f"{1e6 * residence[0]:.3f} us, {1e6 * residence[-1]:.3f} us"
    '9.380 us, 28.082 us'
    """
    return np.diff(arrival_by_crossing(scene, trajectory))


def wave_speed_by_crossing(scene: Scene, trajectory: Trajectory) -> Floats:
    """Speed of the front at body i = 1..n_body-2, m/s, ``(n_body - 2,)``: spacing over residence time (eq. 3.6).

    Raises UsageError for a scene without ``spacing``: bodies per second are then ``1 / residence_by_crossing``.
    """
    if scene.spacing is None:
        raise UsageError(f"{scene.name} has no spacing; a wave speed in m/s needs [chain] spacing = ... (m)")
    return scene.spacing / residence_by_crossing(scene, trajectory)
