"""Forces of contacts between samples, and the uncertainty of those at samples."""

from __future__ import annotations

import numpy as np

from dem_bridge.observables.interpolate import FEWER, NODES, contact_motion, hermite
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import Floats, Trajectory


def first_peak_force(scene: Scene, trajectory: Trajectory) -> tuple[Floats, Floats]:
    """Return the elastic force of each contact at its first maximal compression and its uncertainty, N.

    Dashpots do not act at that moment. The overlap is interpolated between samples (:mod:`.interpolate`), with the
    difference between six and four samples as one more uncertainty. Theories, whose displacements are not those of
    forces, know one wave and its peak force.

    Returns
    -------
    force, uncertainty : ndarray ``(n_contact,)``
        In N; nan where the contact is never compressed to a maximum.

    """
    peak, uncertainty = trajectory.peak_force, np.asarray(trajectory.uncertainty["peak_force"])
    if trajectory.provenance.get("equations", "hertz") != "hertz":
        return peak, uncertainty
    c, time = scene.contacts, trajectory.crossing_time

    overlap, closing = contact_motion(scene, trajectory)

    def force(nodes: int) -> Floats:
        pressed = np.maximum(hermite(trajectory, overlap, closing, time, nodes=nodes), 0.0)
        return c.force(pressed, np.arange(len(time)))

    elastic = force(NODES)
    return elastic, uncertainty + np.abs(elastic - force(FEWER))


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
