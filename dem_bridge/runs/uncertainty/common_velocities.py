"""Round-off of a velocity that two bodies have in common, where runs at other tolerances may agree by chance."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from dem_bridge.backends.scales import frame_velocity, in_common_frame
from dem_bridge.runs.uncertainty.replicas import LEAST
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import Floats, Trajectory, Uncertainty

#: tolerances of single steps that a run may err by; the largest error that was seen is 3
TOLERANCES = 8.0


def common_velocity(scene: Scene, run: Trajectory) -> Floats:
    """Return the largest velocity at samples that the bodies of each contact have in common, m/s, ``(n_contact,)``.

    It is seen from the frame in which scipy solves the scene. A wall rests.
    """
    c, frame = scene.contacts, in_common_frame(scene)[1]
    seen = run.velocity - frame_velocity(frame, scene.drag, run.time)[:, None]
    speed = np.abs(np.column_stack([seen, np.zeros(len(seen))]))
    return np.asarray(np.max(np.minimum(speed[:, c.left], speed[:, c.right]), axis=0))


def widen_for_common_velocities(uncertainty: Uncertainty, scene: Scene, run: Trajectory) -> Uncertainty:
    """Return an uncertainty of crossings and peaks that covers the round-off of closing rates.

    A closing rate is a difference of velocities, and has lost the last 16 units of that which they have in common, and
    what the tolerance allows, which is relative to it: each of some hundred steps errs by a part of the tolerance, and
    runs that round alike do not show it (2.2 uncertainties of a peak at 170 km/s with one OpenBLAS).

    Parameters
    ----------
    uncertainty : Uncertainty
        Uncertainty of ``run`` by its further runs.
    scene : Scene
    run : Trajectory
        A run by scipy, with ``slowing`` in its provenance.
    """
    lost = max(LEAST, TOLERANCES * run.provenance["settings"]["rtol"])
    return widen_for_closing_rates(uncertainty, scene, run, lost * common_velocity(scene, run))


def widen_for_closing_rates(uncertainty: Uncertainty, scene: Scene, run: Trajectory, error: Floats) -> Uncertainty:
    """Return an uncertainty of crossings and peaks that covers errors of closing rates, m/s, ``(n_contact,)``.

    A crossing is a zero of the closing rate, which falls by ``slowing``: it is uncertain by the quotient. A force is
    uncertain by the product with the impedance of its contact, ``sqrt(tangent stiffness * reduced mass)``, which is
    what an oscillator makes of an initial velocity, and with its damping. ``run`` is as above.
    """
    c = scene.contacts
    if not np.any(error > 0.0) or scene.law is not None:
        return uncertainty
    mobility = np.append(1.0 / np.array(scene.mass), 0.0)
    both, peak = mobility[c.left] + mobility[c.right], run.peak_force
    overlap = (peak / c.stiffness) ** (1.0 / (c.exponent - 1.0))
    tangent = np.divide((c.exponent - 1.0) * peak, overlap, out=np.zeros_like(peak), where=overlap > 0.0)
    impedance = np.sqrt(tangent / both) + np.where(peak > 0.0, c.damping * overlap**c.damping_power, 0.0)
    force = np.maximum(uncertainty.peak_force, error * impedance)
    crossing = np.array(np.broadcast_to(uncertainty.crossing_time, peak.shape))
    for key, slowing in run.provenance["slowing"].items():
        k = int(key)
        crossing[k] = max(crossing[k], error[k] / slowing) if slowing > 0.0 else crossing[k]
    return replace(uncertainty, peak_force=force, crossing_time=crossing)
