"""Contacts of which every run with a fixed step may miss something alike, so that their differences say nothing of it.

A contact that comes near touch may close in the exact solution, or not: its first compression is then unknown, and the
force of such a touch is added to the uncertainty. A compression may be largest, or a little later, or after the run. A
step may also be too long for a compression that exists. The moments are those of :mod:`.moments`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dem_bridge.runs.uncertainty.moments import Moments, Reached
from dem_bridge.scene.contacts import Contacts
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.dense import PHASE_PER_DENSE_SAMPLE, Schedule
from dem_bridge.trajectory.trajectory import Floats, Trajectory

if TYPE_CHECKING:
    from dem_bridge.backends.steps import Dense

#: part of a peak force from which on a touch may be the one that has it: the touch is read from another run
OWN_PEAK = 0.9


class Doubt(NamedTuple):
    """Uncertainty of overlap (m) and closing rate (m/s) at each moment, ``(n_moment,)``."""

    overlap: Floats
    rate: Floats


def widen_for_moments(
    uncertainty: Mapping[str, Any],
    scene: Scene,
    run: Trajectory,
    moments: Moments,
    doubt: Doubt,
    reached: Reached | None = None,
) -> dict[str, Any]:
    """Return an uncertainty of ``run`` that covers what may happen at ``moments`` and happens in no run of a family.

    Parameters
    ----------
    uncertainty : mapping
        Uncertainty of each quantity without that.
    moments : Moments
        Of the run with absolute positions.
    doubt : Doubt
        Uncertainty of overlap and closing rate at each moment.
    reached : Reached, optional
        How far each contact was closed. None: what other contacts may be handed is not counted.
    """
    widened = dict(uncertainty)
    for name in ("peak_force", "crossing_time"):
        widened[name] = np.array(np.broadcast_to(widened[name], run.crossing_time.shape))
    deepest = moments.overlap + doubt.overlap
    certain = moments.felt & (moments.overlap > doubt.overlap) & ~moments.fresh
    # bodies that fly in touch approach and part by the last digits of their velocities
    moves = moments.speed > 4.0 * np.spacing(np.max(np.abs(run.velocity)))
    near = np.flatnonzero(moments.touches & moves & (deepest > 0.0) & ~certain)
    touch = _touches(scene, moments, near, deepest[near], doubt.rate[near])
    at, felt = moments.contact[near], moments.felt[near]
    # of a touch that the run has its differences to others cover the impulse
    peak = np.where(felt, run.peak_force[at], 0.0)
    # a peak force of this touch is none if the contact stays open
    none = felt & (moments.overlap[near] <= doubt.overlap[near]) & (touch.own > OWN_PEAK * peak)
    least = np.where(none, peak + widened["peak_force"][at], 0.0)
    np.maximum.at(widened["peak_force"], at, np.maximum(touch.force - peak, least))
    kick = np.where(felt & ~moments.fresh[near], 0.0, touch.kick)
    last = moments.last[near]
    widened["velocity"] += _together(kick, last)
    moved = kick * touch.after
    # since a touch near the end they come no farther apart than twice their depth without it, on either side
    moved = np.where(last, np.minimum(moved, 4.0 * deepest[near]), moved)
    widened["displacement"] += _together(moved, last)
    if reached is not None:
        beside = force_handed_on(scene, reached, 2.0 * _together(kick, last), 2.0 * _together(moved, last))
        np.maximum.at(widened["peak_force"], beside.contact, beside.force - run.peak_force[beside.contact])
        earlier = beside.contact[~beside.last & bool(np.any(kick[~last] > 0.0))]
        widened["crossing_time"][earlier] = math.inf
    widened["crossing_time"][at[touch.stops & ~(moments.time[near] > run.crossing_time[at])]] = math.inf
    # until the end of the run a closing rate may fall to zero within the uncertainty of a crossing, too
    late = np.where(moments.last, widened["crossing_time"][moments.contact], 0.0)
    slowed = doubt.rate + np.maximum(moments.bend, 1e-300) * late
    # a contact that has been slower all the time is at rest so far
    undecided = moments.stops & (np.abs(moments.rate) <= slowed) & (moments.fastest > doubt.rate)
    widened["crossing_time"][moments.contact[undecided]] = math.inf
    return widened


def _together(effects: Floats, last: NDArray[np.bool_]) -> float:
    """Return what the effects of several touches may add up to: all of them if few, as random ones do if many.

    What touches at the end of the run do has not been handed on, and a body between two of them is pushed both ways.
    """
    earlier = effects[~last]
    handed_on = min(float(np.sum(earlier)), 2.0 * math.sqrt(float(np.sum(earlier**2))))
    return handed_on + float(np.max(effects[last], initial=0.0))


class _Touch(NamedTuple):
    """What touches may do, arrays ``(n_touch,)``."""

    force: Floats
    """Largest force, N."""
    own: Floats
    """Largest force in the run itself, N."""
    kick: Floats
    """Change of velocity of the lighter body, m/s."""
    after: Floats
    """Time for which the bodies go on with it, s."""
    stops: NDArray[np.bool_]
    """Whether the compression may reach its maximum."""


def _touches(scene: Scene, moments: Moments, near: NDArray[np.int64], deepest: Floats, slower: Floats) -> _Touch:
    """Return the largest effects of touches ``deepest`` (m) deep, at rates that are uncertain by ``slower`` (m/s).

    A touch is no deeper than without its force, nor than its energy allows; adhesion pulls it in.
    """
    c, at, inverse_mass = scene.contacts, moments.contact[near], scene.mobility
    mobility = inverse_mass[c.left[at]] + inverse_mass[c.right[at]]
    lighter = np.maximum(inverse_mass[c.left[at]], inverse_mass[c.right[at]])
    bend, pull = moments.bend[near], c.pull_off[at]
    end = moments.last[near]
    # at a turn all of the rate comes from the acceleration that ends it
    turning = np.sqrt(2.0 * np.maximum(bend, 0.0) * deepest)
    speed = np.where(end, moments.speed[near], np.minimum(moments.speed[near], turning)) + end * slower
    energy = 0.5 * speed**2 / mobility + np.maximum(-bend, 0.0) * deepest / mobility
    depth = np.minimum(deepest, _depth(c, at, energy))
    depth = np.where(pull > 0.0, deepest + _depth(c, at, 2.0 * energy) + _pulled_in(c, at), depth)
    with np.errstate(over="ignore"):  # of a stiff law it may be infinite, and is then unknown
        force = c.force(depth, at) + c.damping[at] * depth ** c.damping_power[at] * speed
        had = np.maximum(moments.overlap[near], 0.0)
        own = c.force(had, at) + c.damping[at] * had ** c.damping_power[at] * speed
        stored = c.energy(deepest, at) + c.damping[at] * deepest ** (c.damping_power[at] + 1.0) * speed
    turn = np.sqrt(8.0 * deepest / np.maximum(bend, 1e-300))
    lasting = np.minimum(np.where(end, moments.lasting[near], turn), scene.duration)
    # a contact that has just closed is at the rate at which it closed
    closed = deepest / np.maximum(moments.rate[near] - slower, 1e-300)
    lasting = np.where(moments.fresh[near], np.minimum(lasting, closed), lasting)
    rest = scene.duration - moments.time[near] + moments.lasting[near]
    after = np.minimum(rest, 1.0 / scene.drag) if scene.drag > 0.0 else rest
    # a contact gives back no more than it takes
    impulse = np.minimum(force * lasting, 2.0 * speed / mobility + np.maximum(-bend, 0.0) * lasting / mobility)
    held = np.sqrt(2.0 * pull * depth / mobility) + pull * rest
    kick = lighter * np.where(pull > 0.0, impulse + 2.0 * held, impulse)
    least = np.maximum(moments.rate[near] - slower, 0.0)
    stops = ~end | (pull > 0.0) | ((bend >= 0.0) & (stored >= 0.5 * least**2 / mobility))
    return _Touch(force, own, kick, after, stops)


class HandedOn(NamedTuple):
    """Contacts to which undecided touches of others may hand on a force, arrays ``(n,)``."""

    contact: NDArray[np.int64]
    force: Floats
    """Largest force, N, of which the run may miss that beyond its own."""
    last: NDArray[np.bool_]
    """The contact is closed at the end of the run, and has the force then."""


def force_handed_on(scene: Scene, reached: Reached, faster: float, nearer: float) -> HandedOn:
    """Return which contacts may have a force if bodies move ``nearer`` (m) and are ``faster`` (m/s) than in a run.

    Contacts that are open all the time are pressed no deeper than the energy of their bodies allows; those that are
    closed at the end have a larger force then.
    """
    c, inverse_mass = scene.contacts, scene.mobility
    never = (reached.nearest <= 0.0) & (reached.nearest + nearer > 0.0) & (faster > 0.0)
    ending = (reached.last > 0.0) & (faster > 0.0)
    near, end = np.flatnonzero(never), np.flatnonzero(ending)
    speed = np.maximum(reached.nearest_rate[near], 0.0) + faster
    mobility = inverse_mass[c.left[near]] + inverse_mass[c.right[near]]
    pressed = np.minimum(reached.nearest[near] + nearer, _depth(c, near, 0.5 * speed**2 / mobility))
    pressed = np.where(c.pull_off[near] > 0.0, pressed + _pulled_in(c, near), pressed)
    depth = np.concatenate((pressed, reached.last[end] + nearer))
    rate = np.concatenate((speed, np.maximum(reached.last_rate[end], 0.0) + faster))
    contact = np.concatenate((near, end))
    with np.errstate(over="ignore"):  # of a stiff law it may be infinite, and is then unknown
        force = c.force(depth, contact) + c.damping[contact] * depth ** c.damping_power[contact] * rate
    return HandedOn(contact, force, np.isin(contact, end))


def _depth(contacts: Contacts, which: NDArray[np.int64], energy: Floats) -> Floats:
    """Return the overlaps (m) that store an energy (J); inf for a law that is a function."""
    if contacts.laws:
        return np.full(len(which), math.inf)
    n = contacts.exponent[which]
    return np.asarray((n * energy / contacts.stiffness[which]) ** (1.0 / n))


def _pulled_in(contacts: Contacts, which: NDArray[np.int64]) -> Floats:
    """Return twice the overlaps (m) to which adhesion pulls contacts that touch at rest."""
    if contacts.laws:
        return np.where(contacts.pull_off[which] > 0.0, math.inf, 0.0)
    n = contacts.exponent[which]
    return np.asarray((2.0 * n * contacts.pull_off[which] / contacts.stiffness[which]) ** (1.0 / (n - 1.0)))


def drift_in_flight(scene: Scene, plan: Schedule, dense: Dense) -> Floats:
    """Return the overlap (m), ``(n_contact,)``, that round-off may give to bodies that fly in touch; 0 for others.

    Weight and drag accelerate both alike but for the last digit, so that they drift by a rounding a step: that of a
    position, and that of a velocity for the rest of the run.
    """
    c, velocity = scene.contacts, np.append(scene.velocity, math.nan)
    pull = np.append(scene.free_acceleration - scene.drag * np.array(scene.velocity), math.nan)
    alike = (velocity[c.left] == velocity[c.right]) & np.isclose(pull[c.left], pull[c.right], rtol=1e-12, atol=0.0)
    flying = (c.gap == 0.0) & alike & (pull[c.left] != 0.0)
    rounding = dense.overlap_in_flight + scene.duration * float(np.spacing(np.max(np.abs(dense.velocity))))
    return np.where(flying, plan.steps * rounding, 0.0)


def unresolved_contacts(scene: Scene, plan: Schedule, dense: Dense, run: Trajectory) -> NDArray[np.bool_]:
    """Return the contacts, ``(n_contact,)``, whose first compression is too brief for the step.

    They have been closed and part, but no maximum of their compression is seen between samples. With n < 2 a contact
    is the stiffer the smaller its overlap, so that no step is small enough for the first motions ahead of a front.
    """
    c, inverse_mass = scene.contacts, scene.mobility
    crossed = np.flatnonzero(np.isfinite(run.crossing_time) & (c.exponent < 2.0))
    rate = dense.velocity[:, c.left] - dense.velocity[:, c.right]
    # bodies that fly in touch drift into each other by a rounding a step
    flight = plan.steps * dense.overlap_in_flight
    parting = np.any((dense.overlap > flight) & (rate <= 0.0), axis=0)
    unresolved: NDArray[np.bool_] = parting & (c.gap >= 0.0) & np.isnan(run.crossing_time)
    if scene.law is None and len(crossed):
        after = np.searchsorted(plan.dense_steps * plan.step, run.crossing_time[crossed])
        after = np.clip(after, 1, len(plan.dense_steps) - 1)
        overlap = np.maximum(dense.overlap[after - 1, crossed], dense.overlap[after, crossed])
        slope = (c.exponent - 1.0)[crossed] * c.stiffness[crossed]
        slope = slope * np.maximum(overlap, 1e-300) ** (c.exponent[crossed] - 2.0)
        mobility = (inverse_mass[c.left] + inverse_mass[c.right])[crossed]
        unresolved[crossed] = plan.step**2 * slope * mobility > PHASE_PER_DENSE_SAMPLE**2
    return unresolved
