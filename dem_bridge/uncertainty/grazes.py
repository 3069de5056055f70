"""Contacts that every run with a fixed step may miss alike, so that the differences of such runs say nothing of them.

A contact that turns back just before it touches may touch in the exact solution: its first compression is then unknown,
and the force of such a touch is added to the uncertainty. A step may also be too long for a compression that exists.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dem_bridge.backends.steps import Dense, approach_of
from dem_bridge.dense import PHASE_PER_DENSE_SAMPLE, Approaches, Schedule, approaches
from dem_bridge.scene import Scene
from dem_bridge.trajectory import Floats, Trajectory


def may_graze(turns: Approaches, displacement: float) -> bool:
    """Return whether an open contact turns so near to touch that errors of ``displacement`` (m) could close it."""
    return bool(np.any(turns.overlap + 2.0 * displacement > 0.0))


def widen_for_grazes(
    uncertainty: Mapping[str, Any],
    scene: Scene,
    run: Trajectory,
    turns: Approaches,
    elsewhere: Mapping[float, Approaches],
    *,
    safety: Mapping[float, float],
    roundoff: float,
) -> dict[str, Any]:
    """Return an uncertainty of ``run`` that covers touches which no run of a family has.

    Where some of the runs touch and some do not, their differences cover the touch already.

    Parameters
    ----------
    uncertainty : mapping
        Uncertainty of each quantity without such touches.
    turns : Approaches
        Turns of open contacts in the run with absolute positions.
    elsewhere : mapping
        Those of the runs at other steps, by the ratio of their step.
    safety : mapping
        Factor of a difference to the run at another step, by the ratio of its step.
    roundoff : float
        Round-off of displacements, m.
    """
    c, widened = scene.contacts, dict(uncertainty)
    doubt = [safety[ratio] * _difference_of_turns(turns, other) for ratio, other in elsewhere.items()]
    deepest = np.nan_to_num(turns.overlap + 2.0 * roundoff + np.max(doubt, axis=0), nan=-1.0)
    near = np.flatnonzero(deepest > 0.0)
    deepest, at = deepest[near], turns.contact[near]
    widened["crossing_time"] = np.array(np.broadcast_to(widened["crossing_time"], c.left.shape))
    widened["crossing_time"][at[~(turns.time[near] > run.crossing_time[at])]] = math.inf  # nan: it never crosses
    with np.errstate(over="ignore"):  # of a stiff law it may be infinite, and is then unknown
        force = c.force(deepest, at)
    widened["peak_force"] = np.array(np.broadcast_to(widened["peak_force"], c.left.shape))
    np.maximum.at(widened["peak_force"], at, force)
    inverse_mass = np.append(1.0 / np.array(scene.mass), 0.0)
    duration = np.minimum(np.sqrt(8.0 * deepest / np.maximum(turns.bend[near], 1e-300)), scene.duration)
    kick = float(np.sum(force * duration * np.maximum(inverse_mass[c.left[at]], inverse_mass[c.right[at]])))
    widened["velocity"] += kick
    widened["displacement"] += kick * scene.duration
    return widened


def _difference_of_turns(turns: Approaches, other: Approaches) -> Floats:
    """Return how much nearer or farther each of the ``turns`` is in another run, m; nan where it has none."""
    differences = np.full(len(turns.contact), math.nan)
    for k in np.unique(turns.contact):
        here, there = np.flatnonzero(turns.contact == k), np.flatnonzero(other.contact == k)
        if len(there):
            nearest = there[np.argmin(np.abs(turns.time[here, None] - other.time[there]), axis=1)]
            differences[here] = np.abs(turns.overlap[here] - other.overlap[nearest])
    return differences


def open_turns(scene: Scene, plan: Schedule, dense: Dense) -> Approaches:
    """Return where open contacts turn back in a run on the steps of ``plan``."""
    return approaches(**approach_of(scene, plan, dense))


def unresolved_contacts(scene: Scene, plan: Schedule, dense: Dense, run: Trajectory) -> NDArray[np.bool_]:
    """Return the contacts, ``(n_contact,)``, whose first compression is too brief for the step.

    They have been closed and part, but no maximum of their compression is seen between samples. With n < 2 a contact
    is the stiffer the smaller its overlap, so that no step is small enough for the first motions ahead of a front.
    """
    c, inverse_mass = scene.contacts, np.append(1.0 / np.array(scene.mass), 0.0)
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
