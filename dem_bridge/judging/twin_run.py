"""Runs of our velocity-Verlet code beside what is judged, and scenes whose gaps are others."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from dem_bridge.backends.base import Resolution, Sampling
from dem_bridge.runs.case import Case
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import Floats, Trajectory


def twin_run(scene: Scene, dt: float | None, radius: float | None = None) -> Trajectory:
    """Return the run of a scene by velocity Verlet at its samples, without its uncertainty.

    Parameters
    ----------
    scene : Scene
        The scene.
    dt : float or None
        Time step, s; None: the one that the code chooses.
    radius : float, optional
        Radius of bodies with absolute positions, m; None: the code keeps overlaps.
    """
    return Case(
        scene=scene,
        backend="verlet",
        resolution=Resolution(dt=dt, surrogate_radius=radius),
        sampling=Sampling(count=scene.samples),
        uncertainty=False,
    ).solve()


def with_wider_gaps(scene: Scene, by: Floats) -> Scene:
    """Return a scene whose gaps are wider by so much, m, ``(n_contact,)``; it must have no precompression.

    Examples
    --------
    >>> pair = Scene(name="pair", duration=1e-4, mass=(8e-3, 1e-2), stiffness=(4e9,), velocity=(0.8, 0.0))
    >>> with_wider_gaps(pair, np.array([1e-6])).gap
    (1e-06,)
    """
    links = scene.n_body - 1
    further, walls = iter(by[links:].tolist()), (scene.wall_left, scene.wall_right)
    left, right = (None if wall is None else replace(wall, gap=wall.gap + next(further)) for wall in walls)
    gap = tuple((np.array(scene.gap) + by[:links]).tolist())
    return replace(scene, gap=gap, wall_left=left, wall_right=right)
