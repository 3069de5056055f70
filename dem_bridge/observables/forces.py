"""The first maximal compression of a contact, its force, and the largest force of the run."""

from __future__ import annotations

import numpy as np

from dem_bridge.observables.interpolate import FEWER, NODES, contact_motion, hermite
from dem_bridge.observables.observable import OWN, Measured, measured, stored
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


DECLARED = (
    stored("peak_force", "Largest compressive force of the contact during the run.", OWN),
    measured(
        lambda scene, run: Measured(*first_peak_force(scene, run)),
        name="first_peak_force",
        definition="Elastic force of the contact at its first maximal compression; a later wave may press harder.",
        unit="N",
        axis=("contact",),
        follows="peak_force",
    ),
    stored("crossing_time", "Time of the first maximal compression of the contact.", OWN),
)
