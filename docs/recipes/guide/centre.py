# dem_bridge/observables/centre.py
"""The centre of mass."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dem_bridge.observables.observable import LARGEST, Observable
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import Trajectory


def centre_of_mass(scene: Scene, trajectory: Trajectory) -> NDArray[np.float64]:
    """Return the displacement of the centre of mass from its start, m, ``(n_t,)``.

    >>> import dem_bridge as db
    >>> scene = db.load_scene("accelerating-40")
    >>> path = centre_of_mass(scene, db.solve(scene, backend="verlet", dt=1e-6, uncertainty=False))
    >>> f"{1e6 * path[-1]:.1f} um"
    '47.3 um'
    """
    mass = np.array(scene.mass)
    return np.asarray(trajectory.displacement @ mass / mass.sum())


def centre_of_mass_uncertainty(scene: Scene, trajectory: Trajectory) -> NDArray[np.float64]:
    """Return the uncertainty of :func:`centre_of_mass`, m, ``(n_t,)``: that of all displacements."""
    return np.full(len(trajectory.time), trajectory.uncertainty["displacement"])


DECLARED = (
    Observable(
        name="centre_of_mass",
        definition="Displacement of the centre of mass from its start at each sample.",
        unit="m",
        axis=("time",),
        value=centre_of_mass,
        uncertainty=centre_of_mass_uncertainty,
        scale=LARGEST,
    ),
)
