"""The uncertainty of a run by scipy: its differences to looser runs, and what all of them may miss alike.

They may agree by chance on a velocity that two bodies have in common, whose round-off a closing rate has lost, and a
contact may come so near to touch that no run can tell a graze from a miss.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from dem_bridge.backends.scales import frame_velocity, in_common_frame, unfelt_overlap
from dem_bridge.runs.uncertainty.from_replicas import (
    LEAST,
    force_condition,
    looser_rule,
    replica_uncertainty,
    widen_for_the_end,
)
from dem_bridge.runs.uncertainty.grazes import Doubt, widen_for_moments
from dem_bridge.runs.uncertainty.moments import Moments
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import QUANTITIES, Floats, Trajectory, Uncertainty

if TYPE_CHECKING:
    from dem_bridge.backends.scipy_integration import NearTouch

#: tolerances of single steps that a run may err by; the largest error that was seen is 3
TOLERANCES = 8.0
#: part of the time of a touch by which it may be located late: twice the tolerance of the root
LATE = 2e-15
#: factor of the largest difference to the further runs, as for samples
SAFETY = 3.0


def looser_uncertainty(scene: Scene, run: Trajectory, others: Sequence[Trajectory]) -> Uncertainty:
    """Return the uncertainty of a run by scipy from ``others``, runs at looser tolerances."""
    uncertainty = widen_for_common_velocities(replica_uncertainty(run, others, looser_rule(scene)), scene, run)
    uncertainty = widen_for_late_touches(uncertainty, scene, run)
    return widen_for_the_end(widen_for_near_turns(uncertainty, scene, run, others), scene, run)


def widen_for_late_touches(uncertainty: Uncertainty, scene: Scene, run: Trajectory) -> Uncertainty:
    """Return an uncertainty of peaks that covers the last digits of the times of touches.

    A contact that is still being compressed at the end has its largest force there. It may have closed late by
    :data:`LATE` of that time, which runs that round alike do not show: by 1e-12 of the force of a contact that closes
    5e-8 s before the end at 8e-4 s.
    """
    c = scene.contacts
    if scene.law is not None:
        return uncertainty
    velocity, (_, tangent) = np.append(run.velocity[-1], 0.0), _at_peak(scene, run)
    rate = np.maximum(velocity[c.left] - velocity[c.right], 0.0)
    late = np.where(np.isnan(run.crossing_time), tangent * rate * LATE * run.time[-1], 0.0)
    return replace(uncertainty, peak_force=np.maximum(uncertainty.peak_force, late))


def _at_peak(scene: Scene, run: Trajectory) -> tuple[Floats, Floats]:
    """Return overlap, m, and tangent stiffness, N/m, of each contact at its peak force; 0 where there is none."""
    c, peak = scene.contacts, run.peak_force
    overlap = (peak / c.stiffness) ** (1.0 / (c.exponent - 1.0))
    return overlap, np.divide((c.exponent - 1.0) * peak, overlap, out=np.zeros_like(peak), where=overlap > 0.0)


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
    mobility = scene.mobility
    both, peak, (overlap, tangent) = mobility[c.left] + mobility[c.right], run.peak_force, _at_peak(scene, run)
    impedance = np.sqrt(tangent / both) + np.where(peak > 0.0, c.damping * overlap**c.damping_power, 0.0)
    force = np.maximum(uncertainty.peak_force, error * impedance)
    crossing = np.array(np.broadcast_to(uncertainty.crossing_time, peak.shape))
    for key, slowing in run.provenance["slowing"].items():
        k = int(key)
        crossing[k] = max(crossing[k], error[k] / slowing) if slowing > 0.0 else crossing[k]
    return replace(uncertainty, peak_force=force, crossing_time=crossing)


def widen_for_near_turns(
    uncertainty: Uncertainty, scene: Scene, run: Trajectory, others: Sequence[Trajectory]
) -> Uncertainty:
    """Return an uncertainty that covers touches which all runs may miss alike, or see where there is none.

    An overlap is known to that below which no contact is seen, to the displacements of two bodies, and to its
    differences to the further runs. Where it may have either sign, the first crossing is unknown, and the peak force,
    elastic and damping, is up to that of the deepest touch. Of a touch that is certain, the peak force is as uncertain
    as its overlap by the round-off of the gap.

    Parameters
    ----------
    uncertainty : Uncertainty
        Uncertainty of ``run`` without such touches.
    scene : Scene
    run : Trajectory
        The run, with ``near_touches`` in its provenance.
    others : sequence of Trajectory
        Further runs of the same code.
    """
    touches: list[NearTouch] = run.provenance.get("near_touches", [])
    if touches:
        uncertainty = _widened(uncertainty, scene, run, others, touches)
    # a crossing that may be after the end of the run may be none
    late = run.crossing_time + uncertainty.crossing_time > run.time[-1]
    return replace(uncertainty, crossing_time=np.where(late, math.inf, uncertainty.crossing_time))


def _widened(
    uncertainty: Uncertainty, scene: Scene, run: Trajectory, others: Sequence[Trajectory], touches: list[NearTouch]
) -> Uncertainty:
    rounded = 0.5 * run.cost.steps * float(np.finfo(float).eps) * np.abs(scene.contacts.gap)
    overlap = np.array([_overlap_doubt(each, uncertainty, scene, others, rounded) for each in touches])
    moments = _moments(scene, run, touches, overlap)
    doubt = Doubt(overlap, np.full(len(touches), 2.0 * float(uncertainty.velocity)))
    widened = widen_for_moments(uncertainty, scene, run, moments, doubt)
    felt = np.flatnonzero(moments.felt & moments.touches)
    at = moments.contact[felt]
    np.maximum.at(widened["peak_force"], at, _of_felt_peaks(scene, run, moments, overlap, rounded)[felt])
    # what touches do to velocities goes on to the contacts that are later
    kick = 2.0 * (widened["velocity"] - float(uncertainty.velocity))
    found = replace(uncertainty, **{name: widened[name] for name in QUANTITIES})
    return widen_for_closing_rates(found, scene, run, np.full(scene.n_contact, kick))


def _of_felt_peaks(scene: Scene, run: Trajectory, moments: Moments, doubt: Floats, rounded: Floats) -> Floats:
    """Return the uncertainty of the peak force (N) by each moment at which the run has a force, ``(n_moment,)``.

    If its overlap is within ``doubt`` (m) of 0, there may be no touch, and the peak may be of it unless it is far above
    its largest force. If not, the peak is as uncertain as an overlap that is ``rounded`` (m, of each contact).
    """
    c, at = scene.contacts, moments.contact
    deepest = np.maximum(moments.overlap + doubt, 0.0)
    speed = np.sqrt(moments.rate**2 + 2.0 * np.maximum(moments.bend, 0.0) * deepest)
    largest = c.force(deepest, at) + c.damping[at] * deepest ** c.damping_power[at] * speed
    share = np.where(run.peak_force[at] <= 2.0 * largest, 1.0, 0.0)
    certain = moments.overlap > doubt
    digits = force_condition(scene)[at] * rounded[at] / np.where(certain, moments.overlap, 1.0)
    return np.asarray(np.where(certain, digits, share) * run.peak_force[at])


def _overlap_doubt(
    touch: NearTouch, uncertainty: Uncertainty, scene: Scene, others: Sequence[Trajectory], rounded: Floats
) -> float:
    """Return the uncertainty of the overlap at a near touch, m; ``rounded`` is what each contact's gap rounds."""
    k, known, apart = touch["contact"], 2.0 * float(uncertainty.displacement), 0.0
    for other in others:
        same = [
            abs(each["overlap"] - touch["overlap"])
            for each in other.provenance["near_touches"]
            if (each["contact"], each["last"]) == (k, touch["last"])
        ]
        # a run that has no such turn is as far away as displacements are uncertain
        apart = max(apart, min([*same, known]))
    doubt = SAFETY * apart + float(rounded[k])
    # a force that the run has is seen by the further runs, too; of one that it has not only displacements tell
    return float(unfelt_overlap(scene)[k]) + (doubt if touch["felt"] else max(doubt, known))


def _moments(scene: Scene, run: Trajectory, touches: Sequence[NearTouch], doubt: Floats) -> Moments:
    """Return near touches of scipy as moments, with the speed and the time since they came within ``doubt`` (m)."""
    table = {name: np.array([dict(each)[name] for each in touches]) for name in touches[0]}
    last, overlap, rate, bend = (table[name] for name in ("last", "overlap", "rate", "bend"))
    deepest = np.maximum(overlap + doubt, 0.0)
    speed = np.sqrt(rate**2 + 2.0 * np.maximum(bend, 0.0) * deepest)
    with np.errstate(divide="ignore", invalid="ignore"):
        lasting = np.fmin(np.where(last, 2.0 * deepest / rate, np.sqrt(8.0 * deepest / bend)), scene.duration)
    # the time of a first crossing has been made exact since
    felt, crossing = table["felt"], run.crossing_time[table["contact"]]
    slow = last & (bend > 0.0) & felt
    return Moments(
        contact=table["contact"],
        time=np.where(felt, np.fmin(table["time"], crossing), table["time"]),
        last=last,
        overlap=overlap,
        lost=np.zeros(len(touches)),
        rate=rate,
        bend=bend,
        touches=np.ones(len(touches), dtype=bool),
        felt=felt,
        stops=slow,
        fresh=np.zeros(len(touches), dtype=bool),
        speed=np.where(last, speed, math.inf),
        lasting=lasting,
        fastest=np.full(len(touches), math.inf),
    )
