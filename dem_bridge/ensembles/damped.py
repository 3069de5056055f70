"""The kernel of ensembles with damping and drag: the classical Runge-Kutta method for chains in lanes.

Arrays are those of :mod:`.lanes`. Forces depend on velocities here, so that the method of that kernel does not apply.
The classical method of order 4 takes four forces a step. A damped force jumps, or has no derivative, where a contact
touches, opens or is clipped: :mod:`.pair` corrects these steps by the motion of two bodies alone. No force law and no
step of the integration is shared with LAMMPS or the reference.
"""

from __future__ import annotations

import numpy as np

from dem_bridge.ensembles.pair import contact_force, elastic_force, pair_defect
from dem_bridge.ensembles.settled import all_settled, is_free
from dem_bridge.ensembles.within_step import LOOK, maximum, read_turn, store
from dem_bridge.foundation.compiled import Bools, Floats, kernel
from dem_bridge.trajectory.dense import may_turn

#: law of damping by the power of the overlap in its force: 0, 1/2, 1/4, any other
POWERS = (0.0, 0.5, 0.25)


@kernel()
def march_damped(
    mass: Floats, velocity: Floats, weight: Floats, stiffness: Floats, overlap: Floats, damping: Floats,
    exponent: Floats, power: Floats, laws: tuple[int, int], clip: bool, drag: float, resting: Floats, slow: float,
    unfelt: Floats, step: float, steps: int, kept: Floats,
) -> tuple[Floats, Floats, Floats]:  # fmt: skip
    """Solve a group of damped chains, and return the observables of an ensemble, as :func:`.lanes.march` does.

    ``damping (n_body + 1, n_lane)`` and ``power (n_body + 1,)``: the force is damping overlap^power overlap'. ``laws``:
    that of the elastic force (:func:`.law_power`) and the number of the power in :data:`POWERS`, 3 for others. With
    ``clip`` no contact pulls. ``drag``: 1/s. A compression counts above ``unfelt`` (m): ahead of a front the stages
    leave motions of alternating sign and almost no size, which would otherwise be collisions.
    """
    places, lanes = mass.shape
    size = places * lanes
    rows, inner = size - lanes, (places - 2) * lanes
    mobility, u, w, beta = (1.0 / mass).ravel(), velocity.ravel().copy(), weight.ravel(), stiffness.ravel()
    c, s, rest, least = damping.ravel(), overlap.ravel().copy(), resting.ravel(), unfelt.ravel()
    f, g, a = np.zeros(size), np.zeros(size), np.zeros(size)
    s0, u0, a0, f0, g0 = np.zeros(rows), np.zeros(size), np.zeros(size), np.zeros(size), np.zeros(rows)
    bends, pushes = np.zeros(size), np.zeros(size)
    marks, events, young = np.zeros(size, np.uint8), np.zeros(size, np.uint8), np.zeros(size, np.bool_)
    words, event_words = marks.view(np.int64), events.view(np.int64)
    numbers = mobility, w, beta, c, exponent, power, laws, clip, drag, lanes
    _push(0, rows, numbers, s, u, f, a)
    _slopes(rows, numbers, s, u, a, f, g)
    peak, fastest, crossing = f[:rows].copy(), u[:rows].copy(), np.full(rows, np.inf)
    front = 0
    for j in range(rows):
        if u[j] != 0.0 or w[j] != 0.0 or f[j] != 0.0:
            front = min(j // lanes + 1, places - 2)
    keep = steps // (kept.shape[1] - 1) if kept.shape[1] > 1 else 0
    may_settle = keep == 0 and is_free(weight, stiffness)
    for nth in range(steps):
        if keep > 0 and nth % keep == 0:
            store(kept, nth // keep, u, lanes)
        # a stage carries a disturbance to the next body and no further
        most = min(places - 2, front + 4)
        end = (most + 1) * lanes
        for j in range(end):
            s0[j], u0[j], a0[j], f0[j], g0[j] = s[j], u[j], a[j], f[j], g[j]
            bends[j], pushes[j] = a[j], a[j]
        for stage in range(3):
            part = step if stage == 2 else 0.5 * step
            _drift(end, lanes, part, s0, u0, s, u, a)
            _push(0, end, numbers, s, u, f, a)
            twice = 1.0 if stage == 2 else 2.0
            for j in range(end):
                pushes[j] += twice * a[j]
                bends[j] += a[j] if stage < 2 else 0.0
        _finish(end, lanes, step, s0, u0, bends, pushes, s, u)
        _push(0, end, numbers, s, u, f, a)
        _mark_events(end, clip, s0, f0, s, f, c, young, events)
        for word in range(end // 8):
            if event_words[word] != 0:
                for j in range(8 * word, 8 * word + 8):
                    if events[j] != 0:
                        _correct(j, nth, step, slow, numbers, s0, u0, a0, f0, s, u, a, f, crossing, peak, fastest)
        _slopes(end, numbers, s, u, a, f, g)
        while most > front and np.all(u[most * lanes : end] == 0.0) and np.all(f[(most - 1) * lanes : end] == 0.0):
            most -= 1
        front = most
        _mark_turns(end, inner, lanes, nth, step, s0, u0, a0, g0, s, u, a, g, f, events, crossing, peak, fastest, marks)
        for word in range(end // 8):
            if words[word] != 0:
                for j in range(8 * word, 8 * word + 8):
                    if marks[j] != 0:
                        k = j // lanes
                        read_turn(
                            j, j + lanes, nth, step, laws[0], exponent[k], beta[j] if c[j] == 0.0 else 0.0, rest[j],
                            least[j], j >= inner, s0, u0, a0, s, u, a, crossing, peak, fastest,
                        )  # fmt: skip
                        if g0[j] > 0.0 and g[j] < 0.0 and events[j] == 0:
                            peak[j] = max(peak[j], maximum(step, f0[j], g0[j], f[j], g[j])[1])
        slowed = np.exp(-drag * step * (steps - 1 - nth))
        looks = may_settle and nth % LOOK == 0 and front == places - 2
        if looks and all_settled(mass, stiffness, damping, exponent, power, u, s, crossing, peak, slowed):
            break
    if keep > 0:
        store(kept, steps // keep, u, lanes)
    fastest = np.where(np.isfinite(u[:rows]), fastest, np.nan)
    return np.where(crossing < np.inf, crossing, np.nan), peak, fastest


#: inverse masses, weights, stiffnesses, damping, exponents, powers, laws, clip, drag and lanes of :func:`march_damped`
Numbers = tuple[Floats, Floats, Floats, Floats, Floats, Floats, tuple[int, int], bool, float, int]


@kernel(nogil=False)
def _push(first: int, end: int, numbers: Numbers, s: Floats, u: Floats, f: Floats, a: Floats) -> None:
    """Fill in the forces of the contacts from ``first`` to ``end`` and the accelerations of the bodies before them."""
    mobility, w, beta, c, exponent, power, laws, clip, drag, lanes = numbers
    law, of_damping = laws
    u_next, least = u[lanes:], 0.0 if clip else -np.inf
    if law == 0 and of_damping < 3:
        for j in range(first, end):
            depth = s[j] if s[j] > 0.0 else 0.0
            root = np.sqrt(depth)
            factor = c[j] if s[j] > 0.0 else 0.0
            if of_damping == 1:
                factor = c[j] * root
            elif of_damping == 2:
                factor = c[j] * np.sqrt(root)
            total = beta[j] * depth * root + factor * (u[j] - u_next[j])
            f[j] = total if total > least else least
    else:
        for j in range(first, end):
            k = j // lanes
            f[j] = contact_force(
                s[j] > 0.0, s[j], u[j] - u_next[j], (beta[j], exponent[k], law, c[j], power[k], of_damping, clip)
            )
    f_next, a_next, w_next, u_ahead, mobility_next = f[lanes:], a[lanes:], w[lanes:], u[lanes:], mobility[lanes:]
    for j in range(first, end):
        a_next[j] = mobility_next[j] * (w_next[j] + f[j] - f_next[j]) - drag * u_ahead[j]


@kernel(nogil=False)
def _drift(end: int, lanes: int, part: float, s0: Floats, u0: Floats, s: Floats, u: Floats, a: Floats) -> None:
    """Go on to the next stage, ``part`` seconds after the begin of the step."""
    u_next = u[lanes:]
    for j in range(end):
        s[j] = s0[j] + part * (u[j] - u_next[j])
    for j in range(end):
        u[j] = u0[j] + part * a[j]


@kernel(nogil=False)
def _finish(
    end: int, lanes: int, step: float, s0: Floats, u0: Floats, bends: Floats, pushes: Floats, s: Floats, u: Floats
) -> None:
    """Go on to the end of the step with the sums of the stages' accelerations."""
    u0_next, bends_next, sixth = u0[lanes:], bends[lanes:], step / 6.0
    for j in range(end):
        s[j] = s0[j] + step * (u0[j] - u0_next[j] + sixth * (bends[j] - bends_next[j]))
    for j in range(end):
        u[j] = u0[j] + sixth * pushes[j]


@kernel(nogil=False)
def _slopes(end: int, numbers: Numbers, s: Floats, u: Floats, a: Floats, f: Floats, g: Floats) -> None:
    """Fill in the rates of the contact forces, N/s; 0 where a contact is open or clipped."""
    _, _, beta, c, exponent, power, laws, clip, _, lanes = numbers
    u_next, a_next = u[lanes:], a[lanes:]
    for j in range(end):
        g[j] = 0.0
        if s[j] > 0.0 and (f[j] > 0.0 or not clip):
            k, rate = j // lanes, u[j] - u_next[j]
            elastic = elastic_force(s[j], beta[j], exponent[k], laws[0])
            g[j] = (exponent[k] - 1.0) * elastic * rate / s[j]
            if c[j] > 0.0:
                g[j] += (f[j] - elastic) * power[k] * rate / s[j]
                g[j] += (f[j] - elastic) / rate * (a[j] - a_next[j]) if rate != 0.0 else 0.0


@kernel(nogil=False)
def _mark_events(
    end: int, clip: bool, s0: Floats, f0: Floats, s: Floats, f: Floats, c: Floats, young: Bools, events: Floats
) -> None:
    """Mark contacts that touch, open or are clipped within a step, and damped ones that have touched in the last."""
    for j in range(end):
        touches = (s0[j] > 0.0) != (s[j] > 0.0)
        clipped = clip & (c[j] > 0.0) & ((f0[j] > 0.0) != (f[j] > 0.0))
        events[j] = touches | clipped | young[j]
        young[j] = touches & (s[j] > 0.0) & (c[j] > 0.0)


@kernel(nogil=False)
def _correct(
    j: int, nth: int, step: float, slow: float, numbers: Numbers, s0: Floats, u0: Floats, a0: Floats, f0: Floats,
    s: Floats, u: Floats, a: Floats, f: Floats, crossing: Floats, peak: Floats, fastest: Floats,
) -> None:  # fmt: skip
    """Correct a step of one contact by the motion of its two bodies alone, and read its force and velocity."""
    mobility, _, beta, c, exponent, power, laws, clip, _, lanes = numbers
    ahead, k = j + lanes, j // lanes
    both = mobility[j] + mobility[ahead]
    before, after = a0[j] - a0[ahead] + both * f0[j], a[j] - a[ahead] + both * f[j]
    contact = beta[j], exponent[k], laws[0], c[j], power[k], laws[1], clip
    own = a0[j] + mobility[j] * f0[j], a[j] + mobility[j] * f[j]
    until = crossing[j] - nth * step if k < len(exponent) - 1 else np.inf
    impulse, moment, most, top = pair_defect(
        s0[j], u0[j] - u0[ahead], before, after, both, contact, step, slow, u0[j], own, mobility[j], until
    )
    peak[j], fastest[j] = max(peak[j], most), max(fastest[j], top)
    if impulse == 0.0 and moment == 0.0:
        return
    for i, sign in ((j, -1.0), (ahead, 1.0)):
        u[i] += sign * impulse * mobility[i]
        if i < len(s):
            s[i] += sign * moment * mobility[i]
        if i >= lanes:
            s[i - lanes] -= sign * moment * mobility[i]
    for i in (j - lanes, j, ahead):
        if 0 <= i < len(s):
            rate, kk = u[i] - u[i + lanes], i // lanes
            f[i] = contact_force(
                s[i] > 0.0, s[i], rate, (beta[i], exponent[kk], laws[0], c[i], power[kk], laws[1], clip)
            )
    _push_bodies(j - lanes, numbers, u, f, a)


@kernel(nogil=False)
def _push_bodies(first: int, numbers: Numbers, u: Floats, f: Floats, a: Floats) -> None:
    """Fill in the accelerations of the four bodies beside a contact of a lane and its neighbours."""
    mobility, w, _, _, _, _, _, _, drag, lanes = numbers
    for i in range(first, first + 4 * lanes, lanes):
        if lanes <= i < len(f):
            a[i] = mobility[i] * (w[i] + f[i - lanes] - f[i]) - drag * u[i]


@kernel(nogil=False)
def _mark_turns(
    end: int, inner: int, lanes: int, nth: int, step: float, s0: Floats, u0: Floats, a0: Floats, g0: Floats, s: Floats,
    u: Floats, a: Floats, g: Floats, f: Floats, events: Floats, crossing: Floats, peak: Floats, fastest: Floats,
    marks: Floats,
) -> None:  # fmt: skip
    """Mark contacts and bodies of which something is largest within the step; elsewhere the end of it counts."""
    u_next, a_next, u0_next, a0_next = u[lanes:], a[lanes:], u0[lanes:], a0[lanes:]
    for j in range(end):
        peak[j] = f[j] if f[j] > peak[j] else peak[j]
        deep = (s0[j] > 0.0) | (s[j] > 0.0)
        turn = may_turn(u0[j] - u0_next[j], u[j] - u_next[j], a0[j] - a0_next[j], a[j] - a_next[j], step)
        top = (a0[j] > 0.0) & (a[j] < 0.0) & ((nth * step <= crossing[j]) | (j >= inner))
        marks[j] = (deep & turn) | top | ((g0[j] > 0.0) & (g[j] < 0.0))
        counts = (((nth + 1) * step <= crossing[j]) | (j >= inner)) & (marks[j] == 0)
        fastest[j] = u[j] if (u[j] > fastest[j]) & counts else fastest[j]
