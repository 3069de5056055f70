"""Velocity, displacement and contact force at samples, as every trajectory stores them."""

from __future__ import annotations

import numpy as np

from dem_bridge.observables.interpolate import contact_motion
from dem_bridge.observables.observable import LARGEST, stored
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import Floats, Trajectory


def contact_force_uncertainty(scene: Scene | None, trajectory: Trajectory) -> Floats:
    """Return how far contact forces may be off where displacements and velocities are, N, ``(n_t, n_contact)``.

    Both ends of a contact may be off by the uncertainty of the run, on opposite sides. inf without a scene, whose laws
    are needed for it.
    """
    u_x, u_v = (trajectory.uncertainty[name] for name in ("displacement", "velocity"))
    if scene is None or not np.isfinite((u_x, u_v)).all():
        return np.full(trajectory.contact_force.shape, np.inf)
    c, every = scene.contacts, np.arange(scene.n_contact)
    overlap, closing = contact_motion(scene, trajectory)

    def largest(overlap: Floats, speed: Floats) -> Floats:
        pressed = np.maximum(overlap, 0.0)
        return c.force(pressed, every) + c.damping_force(overlap, speed, every)

    speed = np.abs(closing)
    change = np.abs(largest(overlap + 2.0 * u_x, speed + 2.0 * u_v) - largest(overlap, speed))
    # adhesion begins with a jump
    return np.asarray(change + np.where(np.abs(overlap) <= 2.0 * u_x, c.pull_off, 0.0))


DECLARED = (
    stored("velocity", "Velocity of the body at each sample.", LARGEST),
    stored("displacement", "Displacement of the body from its start at each sample.", LARGEST),
    stored(
        "contact_force",
        "Compressive force of the contact at each sample, with its damping.",
        LARGEST,
        uncertainty=contact_force_uncertainty,
        follows="displacement",
    ),
)
