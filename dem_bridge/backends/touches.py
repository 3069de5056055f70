"""Touches that all runs at fixed steps may pass by alike, so that their differences say nothing of them.

Where a contact turns so near to touch that nobody can tell whether it does, nothing is said of its first compression,
and what such a touch could do is added to the bars. A step may also be too long for a compression that is there.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dem_bridge.backends.bars import Answer
from dem_bridge.backends.steps import Dense
from dem_bridge.dense import PHASE_PER_DENSE_SAMPLE, Approaches, Schedule, approaches
from dem_bridge.scene import Scene


@dataclass(frozen=True, kw_only=True)
class UndetectedGrazes:
    """Contacts that turned before they touched, and what a touch would have done."""

    scene: Scene
    seen: Approaches
    """Of the twin in positions."""
    others: Callable[[], Mapping[float, Approaches]]
    """Of those at other steps, by the ratio of their step; run again where something comes near."""

    def widen(self, bars: dict[str, Any], run: Answer, safe: Mapping[float, float], rounding: float) -> None:
        """``bars`` of ``run`` for touches that may be where no twin has one, in place.

        ``safe``: what a difference to a run at another step is multiplied by, by the ratio of the steps; ``rounding``:
        of displacements, m. Where some twins touch and some do not, their differences know it already.
        """
        seen, c = self.seen, self.scene.contacts
        if not np.any(seen.overlap + 2.0 * bars["displacement"] > 0.0):
            return
        doubt = [safe[ratio] * _apart_by(seen, other) for ratio, other in self.others().items()]
        deep = np.nan_to_num(seen.overlap + 2.0 * rounding + np.max(doubt, axis=0), nan=-1.0)
        near = np.flatnonzero(deep > 0.0)
        deep, at = deep[near], seen.contact[near]
        bars["crossing_time"] = np.array(np.broadcast_to(bars["crossing_time"], c.left.shape))
        bars["crossing_time"][at[~(seen.time[near] > run.crossing_time[at])]] = math.inf  # nan: never
        force = c.force(deep, at)
        np.maximum.at(bars["peak_force"], at, force)
        inverse_mass = np.append(1.0 / np.array(self.scene.mass), 0.0)
        brief = np.minimum(np.sqrt(8.0 * deep / np.maximum(seen.bend[near], 1e-300)), self.scene.duration)
        kick = float(np.sum(force * brief * np.maximum(inverse_mass[c.left[at]], inverse_mass[c.right[at]])))
        bars["velocity"] += kick
        bars["displacement"] += kick * self.scene.duration


def _apart_by(seen: Approaches, other: Approaches) -> NDArray[np.float64]:
    """How much nearer or farther another run turned, m, for each of those ``seen``; nan where it did not."""
    found = np.full(len(seen.contact), math.nan)
    for k in np.unique(seen.contact):
        mine, theirs = np.flatnonzero(seen.contact == k), np.flatnonzero(other.contact == k)
        if len(theirs):
            same = theirs[np.argmin(np.abs(seen.time[mine, None] - other.time[theirs]), axis=1)]
            found[mine] = np.abs(seen.overlap[mine] - other.overlap[same])
    return found


def turns_of(scene: Scene, plan: Schedule, dense: Dense) -> Approaches:
    """Where open contacts turn in a run on the steps of ``plan``."""
    c, v, a = scene.contacts, dense.velocity, dense.acceleration
    return approaches(
        time=plan.dense_steps * plan.step,
        overlap=dense.overlap,
        rate=v[:, c.left] - v[:, c.right],
        acceleration=a[:, c.left] - a[:, c.right],
    )


def too_brief(scene: Scene, plan: Schedule, dense: Dense, run: Answer) -> NDArray[np.bool_]:
    """Contacts, ``(n_contact,)``, whose first compression is too brief for the step: with n < 2 a contact is the
    stiffer the less deep it is, so that no step is small enough for the first motions ahead of a front."""
    c, inverse_mass = scene.contacts, np.append(1.0 / np.array(scene.mass), 0.0)
    known = np.flatnonzero(np.isfinite(run.crossing_time) & (c.exponent < 2.0))
    found = np.zeros(scene.n_contact, dtype=bool)
    if scene.law is None and len(known):
        after = np.searchsorted(plan.dense_steps * plan.step, run.crossing_time[known])
        after = np.clip(after, 1, len(plan.dense_steps) - 1)
        deep = np.maximum(dense.overlap[after - 1, known], dense.overlap[after, known])
        slope = (c.exponent - 1.0)[known] * c.stiffness[known] * np.maximum(deep, 1e-300) ** (c.exponent[known] - 2.0)
        mobility = (inverse_mass[c.left] + inverse_mass[c.right])[known]
        found[known] = plan.step**2 * slope * mobility > PHASE_PER_DENSE_SAMPLE**2
    return found
