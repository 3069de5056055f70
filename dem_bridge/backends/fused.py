"""The fast kernel, for Hertz's law alone: bit for bit what :mod:`.splitting` answers, several times sooner.

Kick, drift, overlap and force are one loop along the line, which compilers make vectors of, where a loop each would
read and write all of it again. Bodies at rest ahead of a front are left out: at an evaluation of the forces a
disturbance goes no further than to the next body, so it is known how far it may have got, and what is behind would not
change by a bit. Peaks are bracketed on the way, so that only samples are kept.

All arrays are along the line: entry 0 is the left wall, then come the bodies, the right wall, and ``PADDING`` entries
that nothing acts on; contact k is between k and k + 1, without stiffness where there is no wall.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dem_bridge.foundation.compiled import Floats, Ints, kernel
from dem_bridge.trajectory.dense import may_turn

#: bodies that are worked on come in such blocks, so that no loop has a remainder
BLOCK = 16
PADDING = BLOCK
#: ... and in such where there are fewer than half a block of them, for 0.7 of the time
SHORT_BLOCK = 4
#: evaluations of the forces after which it is looked again how far the front is
_LOOK = 16


class Kept(NamedTuple):
    """Kept samples: bodies ``(n_kept, n_body + 1)``, contacts ``(n_kept, n_contact)`` in the order of a scene."""

    velocity: Floats
    displacement: Floats
    acceleration: Floats
    """Like ``overlap`` without rows unless all is kept."""
    overlap: Floats
    force: Floats


@kernel()
def advance(
    n_body: int, first: int, last: int, mass: Floats, velocity: Floats, weight: Floats, stiffness: Floats,
    overlap: Floats, positional: bool, reach: Floats, start: Floats, drifts: Floats, kicks: Floats, dt: float,
    dense_steps: Ints, keep: int, full: bool, resting: Floats,
) -> tuple[Kept, Floats, float, Ints, Floats]:  # fmt: skip
    """Integrate a chain of Hertz' contacts in one vector loop per evaluation of the forces.

    The results are what is kept at every ``keep``-th of ``dense_steps``, all of it if ``full``. Then, of all dense
    steps: the largest force of each contact ``(size,)``, the farthest displacement (m), and possible turns from closing
    to opening: dense step and contact ``(n_turn, 2)``, overlap, closing rate, closing acceleration and force, before
    and then after ``(n_turn, 8)``.

    ``mass (size,)`` is inf for walls and padding; contacts ``first`` to ``last - 1`` are there. ``reach`` and
    ``start``: distances at touch and positions, m, if ``positional``. Turns with less acceleration than ``resting
    (size,)`` on both sides are left out.

    Arguments are single arrays, since the loop takes a tenth longer where they are fields of a named tuple.
    """
    stages, size = len(drifts), len(mass)
    rate, v, x, s, f, a = dt / mass, velocity.copy(), np.zeros(size), overlap.copy(), np.zeros(size), np.zeros(size)
    place, top, farthest = start.copy(), np.zeros(size), np.zeros(size)
    was_overlap, was_closing, was_ending, was_force = np.zeros(size), np.zeros(size), np.zeros(size), np.zeros(size)
    n_kept, columns = (len(dense_steps) - 1) // keep + 1, last - first
    out_v, out_x, out_f = np.zeros((n_kept, n_body + 1)), np.zeros((n_kept, n_body + 1)), np.zeros((n_kept, columns))
    n_full = n_kept if full else 0
    kept = Kept(out_v, out_x, np.zeros((n_full, n_body + 1)), np.zeros((n_full, columns)), out_f)
    where, sides, turns = np.zeros((256, 2), dtype=np.int64), np.zeros((256, 8)), 0
    # nothing beyond ``front`` moves or is pressed; the first ``count`` bodies are worked on
    front = 0
    for k in range(n_body + 1):
        if positional:
            s[k] = reach[k] - (place[k + 1] - place[k])
        closed = max(s[k], 0.0)
        f[k] = stiffness[k] * closed * np.sqrt(closed)
        if v[k] != 0.0 or weight[k] != 0.0 or f[k] != 0.0:
            front = min(k + 1, n_body)
    block = BLOCK if 2 * n_body >= BLOCK else SHORT_BLOCK
    step, count = 0, front // block * block + block
    for row in range(len(dense_steps)):
        begun = False
        while step < dense_steps[row]:
            steps = dense_steps[row] - step
            if front < n_body:
                steps = min(steps, max(1, _LOOK // stages))
            step += steps
            most = min(n_body, front + steps * stages)
            count = most // block * block + block
            for turn in range(steps * stages):
                stage = turn % stages
                # the last kick of a step is the next one's first: the same force, for the same part of the step
                twice = stage == 0 and (begun or turn > 0)
                kick, drift = kicks[stage], dt * drifts[stage]
                pushed = f[0]
                behind = place[0] if positional else v[0]
                for i in range(count):
                    ahead = f[i + 1]
                    gained = kick * rate[i + 1] * ((weight[i + 1] + pushed) - ahead)
                    u = v[i + 1] + gained
                    if twice:
                        u += gained
                    v[i + 1] = u
                    if positional:
                        here = place[i + 1] + drift * u
                        place[i + 1] = here
                        depth = reach[i] - (here - behind)
                    else:
                        here = u
                        x[i + 1] += drift * u
                        depth = s[i] + drift * (behind - u)
                        s[i] = depth
                    closed = depth if depth > 0.0 else 0.0
                    f[i] = stiffness[i] * closed * np.sqrt(closed)
                    pushed, behind = ahead, here
            begun = True
            while most > front and not (v[most] or x[most] or place[most] - start[most] or f[most - 1]):
                most -= 1
            front = most
        last_kick = kicks[stages] if begun else 0.0
        touched = min(count, n_body + 1)
        for k in range(touched):
            net = (weight[k + 1] + f[k]) - f[k + 1]
            v[k + 1] += last_kick * rate[k + 1] * net
            a[k + 1] = net / mass[k + 1]
        if positional:
            for k in range(touched):
                x[k + 1] = place[k + 1] - start[k + 1]
                s[k] = reach[k] - (place[k + 1] - place[k])
        stopped = 0
        # the first of the dense steps has none before it
        width = (dense_steps[row] - dense_steps[max(row - 1, 0)]) * dt
        for k in range(touched):
            away = abs(x[k + 1])
            farthest[k + 1] = away if away > farthest[k + 1] else farthest[k + 1]
            top[k] = f[k] if f[k] > top[k] else top[k]
            stopped += may_turn(was_closing[k], v[k] - v[k + 1], was_ending[k], a[k] - a[k + 1], width)
        if stopped > 0:
            for k in range(first, min(touched, last)):
                turning = may_turn(was_closing[k], v[k] - v[k + 1], was_ending[k], a[k] - a[k + 1], width)
                if turning and max(was_overlap[k], s[k]) > 0.0:
                    if turns == len(where):
                        # room for as many again
                        where, sides = np.concatenate((where, where)), np.concatenate((sides, sides))
                    where[turns, 0], where[turns, 1] = row, k
                    sides[turns, 0], sides[turns, 1], sides[turns, 2] = was_overlap[k], was_closing[k], was_ending[k]
                    sides[turns, 3], sides[turns, 4], sides[turns, 5] = was_force[k], s[k], v[k] - v[k + 1]
                    sides[turns, 6], sides[turns, 7] = a[k] - a[k + 1], f[k]
                    turns += max(abs(sides[turns, 2]), abs(sides[turns, 6])) >= resting[k]
        for k in range(touched):
            was_overlap[k], was_closing[k], was_ending[k], was_force[k] = s[k], v[k] - v[k + 1], a[k] - a[k + 1], f[k]
        if row % keep == 0:
            _keep(kept, row // keep, n_body, first, v, x, a, s, f)
    return kept, top, np.max(farthest), where[:turns], sides[:turns]


@kernel()
def _keep(kept: Kept, row: int, n_body: int, first: int, v: Floats, x: Floats, a: Floats, s: Floats, f: Floats) -> None:
    """Keep a sample; a scene has the chain's contacts first, then those of the walls."""
    velocity, displacement, acceleration, overlap, force = kept
    full, columns = len(overlap) > 0, force.shape[1]
    for i in range(n_body):
        velocity[row, i], displacement[row, i] = v[i + 1], x[i + 1]
        if full:
            acceleration[row, i] = a[i + 1]
    for k in range(first, first + columns):
        column = k - 1 if 0 < k < n_body else (columns - 1 if k > 0 else n_body - 1)
        force[row, column] = f[k]
        if full:
            overlap[row, column] = s[k]
