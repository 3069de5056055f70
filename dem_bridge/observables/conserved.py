"""Momentum and energy of a trajectory. LAMMPS' granular styles report no contact energy: it is rebuilt from the law."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dem_bridge.scene import Scene
from dem_bridge.trajectory import Trajectory

Floats = NDArray[np.float64]


def momentum(scene: Scene, trajectory: Trajectory) -> Floats:
    """Total momentum, kg m/s, ``(n_t,)``. Constant where there is neither wall nor gravity nor drag.

    Without walls the loads on both ends of a precompressed chain cancel; damping gives one body what it takes from the
    other.
    """
    return np.asarray(trajectory.velocity @ np.array(scene.mass))


def energy_parts(scene: Scene, trajectory: Trajectory) -> tuple[Floats, Floats, Floats]:
    """Energies, J, ``(n_t,)`` each: kinetic, stored in contacts (``beta overlap^n / n``, or what the
    law says), potential (``-(m g + load) x``)."""
    mass, c = np.array(scene.mass), scene.contacts
    kinetic = 0.5 * trajectory.velocity**2 @ mass
    # a wall is one more column at rest
    x = np.concatenate([trajectory.displacement, np.zeros((len(trajectory.time), 1))], axis=1)
    overlap = np.maximum(x[:, c.left] - x[:, c.right] - c.gap, 0.0)
    stored = c.energy(overlap, np.arange(scene.n_contact)).sum(axis=1)
    potential = -scene.gravity * trajectory.displacement @ mass - trajectory.displacement @ scene.load
    return np.asarray(kinetic), np.asarray(stored), np.asarray(potential)


def energy(scene: Scene, trajectory: Trajectory) -> Floats:
    """Total energy, J, ``(n_t,)``: the sum of :func:`energy_parts`. Constant; falling with damping or drag."""
    kinetic, stored, potential = energy_parts(scene, trajectory)
    return kinetic + stored + potential
