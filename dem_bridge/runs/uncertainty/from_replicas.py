"""The uncertainty of an adaptive run: its differences to further runs of the same code at another tolerance or order.

Two kinds of further runs: replicas, which a backend makes itself (``Backend.replicas``), as runs whose inputs are
perturbed by their last digit; and ordinary runs at looser tolerances, of which one has perturbed speeds.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dem_bridge.backends.scales import RESTING, in_common_frame, resting_acceleration
from dem_bridge.runs.uncertainty.run_differences import absolute_differences, at_least_the_median
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import QUANTITIES, SAMPLED, Cost, Floats, Trajectory, Uncertainty

_EPSILON = float(np.finfo(float).eps)
#: 16 units in the last place: what a few thousand steps may lose, whatever the further runs show
LEAST = 16.0 * 2.0**-52


@dataclass(frozen=True, kw_only=True)
class ReplicaRule:
    """Factors between the differences of runs and the uncertainty.

    ``samples`` is that of velocity and displacement, ``contacts`` that of peak forces and crossing times.
    """

    samples: float
    contacts: float
    peaks_follow_velocities: bool = False
    """The relative uncertainty of a peak force is at least that of velocities: which collision is the largest follows
    from them."""
    crossings_follow_velocities: bool = False
    """The uncertainty of a crossing, relative to its time, is at least that of velocities: a closing velocity is lost
    within that time, so that its error divided by the mean acceleration is this part of the time."""
    rounded_length: float = 0.0
    """Length, m, whose last digit every step rounds, in all runs alike."""
    tolerances: float = 0.0
    """Velocities are uncertain by so many tolerances (``rtol``) of the largest speed at least."""
    unresolved: Any = False
    """Which contacts have a crossing that cannot be told from round-off, ``(n_contact,)``, or one value."""
    force_condition: Floats | float = 1.0
    """Relative change of each contact's force over that of its overlap, ``(n_contact,)`` or one value; at least 1."""


#: six runs with perturbed inputs: the error exceeds nine times the largest of six differences once in 10,000 (Student's
#: t of six)
REFERENCE = ReplicaRule(samples=9.0, contacts=9.0)
#: runs at a hundredth and a ten-thousandth of the tolerance. With the first alone, over 200 random scenes (2 to 60
#: bodies, four decades of mass and stiffness, 1e-9 to 1e3 m/s) the error was up to 1.5, 2.4, 16 and 182 differences at
#: the default tolerances, but at most 1.1, 1.4, 6.1 and 4.8 in 99 % of them (on 200 others the uncertainty held in
#: 99.5 % and more of the scenes for each quantity); at tighter tolerances less
ODE45 = ReplicaRule(samples=2.0, contacts=8.0, peaks_follow_velocities=True)
#: the rules for replicas that a backend makes
RULES: Mapping[str, ReplicaRule] = MappingProxyType({"reference": REFERENCE, "ode45": ODE45})
#: runs at these multiples of the tolerance, the first of them from speeds that are moved by a last digit: where
#: round-off dominates, two runs can agree with a third by chance, and no tolerance shows what the digits of a scene
#: leave unknown. Of 2,999 scenes whose truth is known, runs at 10 and 20 tolerances left 3 outside, with a third one 1,
#: and with that one moved none
LOOSER = (5.0, 10.0, 20.0)
#: tolerances of the largest speed by which velocities are uncertain where a damping force that is not clipped ends as
#: ``overlap^p``, p < 1: the ten last steps of such a contact err by their tolerance each, all in one direction. On 33
#: scenes it was up to 24 tolerances; in one of them three runs agreed by chance, 2.1 uncertainties off, and in one with
#: p = 0, a force that jumps, displacements 4.8
SINGULAR_ENDS = 32.0
#: part of a velocity that bodies have in common below which their relative velocity is unknown: a few of the default
#: tolerances of scipy
COMMON = 1e-13
#: parts of the duration and of the crossing itself above which the uncertainty of a crossing says that nothing is known
#: of it. Ahead of a front each run may have a turn of its own: three of ode45 were 1e-9 to 1e-7 s after the start
UNSURE, UNSURE_OF_ITSELF = 0.1, 1.0


def looser_rule(scene: Scene) -> ReplicaRule:
    """Return the rule for runs at the tolerances :data:`LOOSER`.

    Beyond an open contact displacements follow from its gap, which every step rounds. In a precompressed chain the last
    digits of forces in balance disturb all runs: three of them erred alike by 2.5e-12 of a peak force (n = 3.52), which
    is 2.7 uncertainties from their differences, and a quarter of the one of velocities; with another libm a crossing of
    that chain was 1.08 uncertainties from the truth, and is 0.13 of what follows from the velocities.
    """
    c = scene.contacts
    singular = not c.clip and bool(np.any((c.damping > 0.0) & (c.damping_power < 1.0)))
    return ReplicaRule(
        samples=3.0,
        contacts=3.0,
        peaks_follow_velocities=scene.precompression > 0.0 or singular,
        crossings_follow_velocities=scene.precompression > 0.0,
        tolerances=SINGULAR_ENDS if singular else 0.0,
        unresolved=unresolved_crossings(scene),
        rounded_length=float(np.max(np.abs(scene.contacts.gap), initial=0.0)),
        force_condition=force_condition(scene),
    )


def moved_by_a_digit(scene: Scene) -> Scene:
    """Return a scene whose velocities are moved by their last digit, those that are equal alike; 0 stays.

    >>> pair = Scene(name="pair", duration=1e-4, mass=(1.0, 1.0), stiffness=(1.0,), velocity=(3.0, 0.0))
    >>> [(3.0 - v) * 2.0**52 for v in moved_by_a_digit(pair).velocity if v]
    [4.0]
    """
    # towards 1 m/s, so that no speed leaves the range of speeds
    moved = tuple(v * (1.0 - _EPSILON if abs(v) > 1.0 else 1.0 + _EPSILON) for v in scene.velocity)
    return replace(scene, velocity=moved)


def rule_of(backend: str, scene: Scene) -> ReplicaRule:
    """Return the rule for the replicas that a backend makes of a scene."""
    return replace(RULES[backend], force_condition=force_condition(scene), unresolved=unresolved_crossings(scene))


def unresolved_crossings(scene: Scene) -> NDArray[np.bool_]:
    """Return the contacts whose first maximal compression may be one of round-off, ``(n_contact,)``.

    The two bodies begin in balanced forces and at one velocity. Its last digits are a relative velocity, which the
    contact turns into an oscillation; its acceleration exceeds that of a compression that counts.
    """
    scene = in_common_frame(scene)[0]
    c, resting = scene.contacts, resting_acceleration(scene)
    if scene.law is not None:
        return np.zeros(scene.n_contact, dtype=bool)
    velocity = np.append(scene.velocity, 0.0)
    left, right, overlap = velocity[c.left], velocity[c.right], np.maximum(-c.gap, 0.0)
    noise = COMMON * np.minimum(np.abs(left), np.abs(right))
    # an oscillation at that speed with the tangent stiffness (n - 1) F / overlap; ``resting`` is RESTING F / mass
    shaken = (c.exponent - 1.0) * noise**2 > RESTING * resting * overlap
    return np.asarray((resting > 0.0) & (np.abs(left - right) <= noise) & shaken)


def force_condition(scene: Scene) -> Floats:
    """Return how many units in the last place a force changes with one of its overlap, ``(n_contact,)``, at least 1.

    It is n - 1 for a power: 49 where n = 50.
    """
    powers = np.ones(scene.n_contact) if scene.law is not None else scene.contacts.exponent - 1.0
    return np.maximum(powers, 1.0)


def replica_uncertainty(run: Trajectory, replicas: Sequence[Trajectory], rule: ReplicaRule) -> Uncertainty:
    """Return the uncertainty of a run from its largest differences to ``replicas``.

    It is never below 16 units in the last place (of the duration for times, of overlaps for forces). No peak force is
    less uncertain than the median of all, because runs can agree by chance; no crossing is less uncertain than those
    before it, whose errors it inherits.
    """
    differences = [absolute_differences(run, other) for other in replicas]
    duration = float(run.time[-1])
    total: dict[str, Any] = {}
    for name in QUANTITIES:
        factor = rule.samples if name in SAMPLED else rule.contacts
        size = np.nan_to_num(np.abs(getattr(run, name)))
        most = factor * np.max([each[name] for each in differences], axis=0)
        largest = duration if name == "crossing_time" else float(np.max(size, initial=0.0))
        if name == "peak_force":
            # below the last digits of the largest force nothing is known of others, nor of this code's errors
            most = np.maximum(most, at_least_the_median(np.maximum(most - LEAST * largest, 0.0), size))
        elif name == "crossing_time":
            order = np.argsort(run.crossing_time, kind="stable")  # nan, never, comes last
            finite = np.where(np.isfinite(most), most, 0.0)
            most[order] = np.maximum(most[order], np.maximum.accumulate(finite[order]))
        condition = rule.force_condition if name == "peak_force" else 1.0
        total[name] = most + LEAST * condition * largest
    # round-off can turn bodies that move alike: such a crossing is not there
    unsure = total["crossing_time"] > np.fmin(UNSURE * duration, UNSURE_OF_ITSELF * run.crossing_time)
    total["crossing_time"] = np.where(unsure | rule.unresolved, math.inf, total["crossing_time"])
    if rule.tolerances:
        relative = rule.tolerances * run.provenance["settings"]["rtol"]
        least = relative * float(np.max(np.abs(run.velocity)))
        total["velocity"] = max(total["velocity"], least)
        total["displacement"] = max(total["displacement"], least * duration)
        total["crossing_time"] = np.maximum(total["crossing_time"], relative * duration)
    total["displacement"] += 0.5 * run.cost.steps * _EPSILON * rule.rounded_length
    speed = float(np.max(np.abs(run.velocity)))
    follow = speed > 0.0 and (rule.peaks_follow_velocities or rule.crossings_follow_velocities)
    share = total["velocity"] / speed if follow else 0.0
    if rule.peaks_follow_velocities:
        total["peak_force"] = np.maximum(total["peak_force"], share * run.peak_force)
    if rule.crossings_follow_velocities:
        total["crossing_time"] = np.maximum(total["crossing_time"], share * np.nan_to_num(run.crossing_time))
    return Uncertainty(**total, cost=summed_cost(replicas))


def summed_cost(runs: Sequence[Trajectory]) -> Cost:
    """Return the cost of several runs together."""
    return Cost(
        wall=sum(run.cost.wall for run in runs),
        cpu=sum(run.cost.cpu for run in runs),
        steps=sum(run.cost.steps for run in runs),
        force_evaluations=sum(run.cost.force_evaluations for run in runs),
    )


def widen_for_the_end(uncertainty: Uncertainty, scene: Scene, run: Trajectory) -> Uncertainty:
    """Return an uncertainty that is inf for crossings which the end of a run leaves undecided.

    A crossing may be after the end if its uncertainty reaches so far. A contact that is compressed at the end may have
    had its crossing if both its velocities are so uncertain; one that has been slower all the time is at rest so far.

    Parameters
    ----------
    uncertainty : Uncertainty
        Uncertainty of ``run`` by its further runs.
    scene : Scene
    run : Trajectory
    """
    c, crossing = scene.contacts, np.array(np.broadcast_to(uncertainty.crossing_time, run.crossing_time.shape))
    late = run.crossing_time + crossing > run.time[-1]
    velocity = np.column_stack([run.velocity, np.zeros(len(run.velocity))])
    rate, slow = np.abs(velocity[:, c.left] - velocity[:, c.right]), 2.0 * float(uncertainty.velocity)
    pressed = np.isnan(run.crossing_time) & (run.contact_force[-1] != 0.0)
    early = pressed & (rate[-1] <= slow) & (np.max(rate, axis=0) > slow)
    return replace(uncertainty, crossing_time=np.where(late | early, math.inf, crossing))
