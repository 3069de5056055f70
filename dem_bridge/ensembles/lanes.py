"""The kernel of an ensemble: several chains side by side, one in each lane of the processor's vectors.

All chains of a group have the same bodies, contacts and steps, and differ in numbers only. An array has one row for
each place along the line and one column for each chain, so that every operation is the same for all lanes. Places are
those of :mod:`dem_bridge.backends.fused`: entry 0 is the left wall, then come the bodies, then the right wall; contact
k is between places k and k + 1. The method is Blanes and Moan's SRKN_6^b (2002), as in
:mod:`dem_bridge.backends.blanes_moan`, and steps that meet a touch are corrected by :mod:`.touch`. No force law and no
step of the integration is shared with LAMMPS or the reference.

Maximal compressions and largest velocities lie between steps. They are read from Hermite polynomials through the two
ends of a step: of degree 5 through overlap, closing rate and closing acceleration, of degree 3 through velocity and
acceleration.
"""

from __future__ import annotations

import numpy as np

from dem_bridge.ensembles.touch import law_power, touch_defect
from dem_bridge.foundation.compiled import Floats, kernel
from dem_bridge.trajectory.dense import first_turn, may_turn, quintic

#: chains in a group; eight doubles fill one vector of AVX-512 and two of AVX2
LANES = 8


@kernel(nogil=False)
def _maximum(step: float, v0: float, a0: float, v1: float, a1: float) -> tuple[float, float]:
    """Return the part of a step at which the cubic polynomial of the velocity is largest, and the velocity there."""
    jump = (v1 - v0) / step
    tilt = 2.0 * (3.0 * jump - 2.0 * a0 - a1)
    bend = 3.0 * (a0 + a1 - 2.0 * jump)
    # the slope a0 + tilt part + bend part^2 goes from above 0 to below: its root without cancellation
    root = np.sqrt(max(tilt * tilt - 4.0 * bend * a0, 0.0))
    if root <= tilt:  # by underflow
        return 1.0, v1
    part = 2.0 * a0 / (root - tilt)
    return part, _cubic(part, step, v0, a0, v1, a1)


@kernel(nogil=False)
def _cubic(part: float, step: float, v0: float, a0: float, v1: float, a1: float) -> float:
    """Return the velocity at a part of a step by the cubic polynomial through velocity and acceleration at its ends."""
    jump = (v1 - v0) / step
    tilt, bend = 2.0 * (3.0 * jump - 2.0 * a0 - a1), 3.0 * (a0 + a1 - 2.0 * jump)
    return v0 + step * part * (a0 + part * (0.5 * tilt + part * bend / 3.0))


@kernel(nogil=False)
def _deepest(
    s0: float, s1: float, closing: float, opening: float, bend0: float, bend1: float, step: float
) -> tuple[float, float]:
    """Return the part of a step at which an overlap turns from growing to falling, and the overlap there.

    The numbers are overlap, its rate and acceleration at both ends of the step.
    """
    square = step * step
    c0, c1, c2, c3, c4, c5 = quintic(s0, s1, step * closing, step * opening, square * bend0, square * bend1)
    part = first_turn(c1, c2, c3, c4, c5, step * opening)
    return part, c0 + part * (c1 + part * (c2 + part * (c3 + part * (c4 + part * c5))))


@kernel()
def march(
    mass: Floats, velocity: Floats, weight: Floats, stiffness: Floats, overlap: Floats, exponent: Floats, law: int,
    resting: Floats, rules: Floats, slow: float, drifts: Floats, kicks: Floats, step: float, steps: int, kept: Floats,
) -> tuple[Floats, Floats, Floats]:  # fmt: skip
    """Solve a group of chains, and return the observables of an ensemble.

    ``mass``, ``velocity``, ``weight (n_body + 2, n_lane)`` (walls: infinite mass), ``stiffness``, ``overlap``,
    ``resting (n_body + 1, n_lane)``, ``exponent (n_body + 1,)`` and ``law`` (see :func:`.touch.law_power`); ``rules``
    and ``slow`` are for :func:`.touch.touch_defect`; a step of ``step`` seconds, ``steps`` of them. The results are the
    time of the first maximal compression of each contact (s; nan: never), its largest force (N), the largest velocity
    of the body behind the contact until that time (m/s; the first row is that of the wall, and the last body has no
    such time; nan: the velocities are not finite), ``(n_body + 1, n_lane)`` each. The velocities at the start and after
    equal numbers of steps are written to ``kept (n_lane, n_kept, n_body)``, which may be empty.
    """
    places, lanes = mass.shape
    size, stages = places * lanes, len(drifts)
    rate, v, w = (step / mass).ravel(), velocity.ravel().copy(), weight.ravel()
    beta, s, rest = stiffness.ravel(), overlap.ravel().copy(), resting.ravel()
    f, a, u = np.zeros(size), np.zeros(size), v.copy()
    s0, u0, a0 = np.zeros(size), np.zeros(size), np.zeros(size)
    # the same arrays from the next place on: an index that cannot be negative lets the compiler use whole vectors
    rate_next, v_next, w_next, f_next = rate[lanes:], v[lanes:], w[lanes:], f[lanes:]
    u_next, a_next, u0_next, a0_next = u[lanes:], a[lanes:], u0[lanes:], a0[lanes:]
    _fill(0, size - lanes, 1, lanes, step, law, exponent, beta, rate, w, s, f, a)
    peak = f[: size - lanes].copy()
    fastest, crossing = v[: size - lanes].copy(), np.full(size - lanes, np.inf)
    # the last body hands the impulse on to nobody, not to a wall either
    front, last_body = 0, (places - 2) * lanes
    for j in range(size - lanes):
        if v[j] != 0.0 or w[j] != 0.0 or f[j] != 0.0:
            front = min(j // lanes + 1, places - 2)
    keep = steps // (kept.shape[1] - 1) if kept.shape[1] > 1 else 0
    for nth in range(steps):
        if keep > 0 and nth % keep == 0:
            _store(kept, nth // keep, u, lanes)
        # a stage carries a disturbance to the next body and no further
        most = min(places - 2, front + stages)
        end = (most + 1) * lanes
        for j in range(end):
            s0[j], u0[j], a0[j] = s[j], u[j], a[j]
        for stage in range(stages):
            kick, drift = kicks[stage], step * drifts[stage]
            if stage == 0 and nth > 0:
                kick *= 2.0  # the last kick of a step and the first of the next have the same force
            for j in range(end - lanes):
                v_next[j] += kick * rate_next[j] * (w_next[j] + f[j] - f_next[j])
            if law == 0:
                for j in range(end):
                    depth = s[j] + drift * (v[j] - v_next[j])
                    s[j] = depth
                    closed = depth if depth > 0.0 else 0.0
                    f[j] = beta[j] * closed * np.sqrt(closed)
            else:
                for j in range(end):
                    s[j] += drift * (v[j] - v_next[j])
                    f[j] = beta[j] * law_power(s[j], law, exponent[j // lanes])
        last = kicks[stages]
        for j in range(end - lanes):
            gained = rate_next[j] * (w_next[j] + f[j] - f_next[j])
            u_next[j] = v_next[j] + last * gained
            a_next[j] = gained / step
        touches = 0
        for j in range(end):
            touches += (s0[j] > 0.0) != (s[j] > 0.0)
        if touches > 0:
            for j in range(end):
                if (s0[j] > 0.0) != (s[j] > 0.0):
                    k, mobility = j // lanes, (rate[j] + rate_next[j]) / step
                    before = a0[j] - a0_next[j] + mobility * beta[j] * law_power(s0[j], law, exponent[k])
                    after = a[j] - a_next[j] + mobility * f[j]
                    numbers = (mobility, beta[j], law, exponent[k], rules[k], slow, drifts, kicks, step)
                    if s[j] > 0.0:
                        impulse, moment = touch_defect(s0[j], u0[j] - u0_next[j], before, after, *numbers)
                    else:
                        impulse, moment = touch_defect(s[j], u_next[j] - u[j], after, before, *numbers)
                        moment = step * impulse - moment
                    if impulse != 0.0:
                        _correct(j, lanes, impulse / step, moment / step, rate, v, u, s)
                        _fill(j - lanes, j + 2 * lanes, lanes, lanes, step, law, exponent, beta, rate, w, s, f, a)
        while most > front and np.all(u[most * lanes : end] == 0.0) and np.all(f[(most - 1) * lanes : end] == 0.0):
            most -= 1
        front = most
        turned = 0
        for j in range(end):
            peak[j] = f[j] if f[j] > peak[j] else peak[j]
            turned += may_turn(u0[j] - u0_next[j], u[j] - u_next[j], a0[j] - a0_next[j], a[j] - a_next[j], step)
            turned += (a0[j] > 0.0) & (a[j] < 0.0)
        if turned > 0:
            for j in range(end):
                closing, opening = u0[j] - u0_next[j], u[j] - u_next[j]
                bend0, bend1 = a0[j] - a0_next[j], a[j] - a_next[j]
                # a contact at rest has accelerations that are round-off: where the rate keeps its sign neither may be
                falls = closing > 0.0 and opening <= 0.0
                bend = max(abs(bend0), abs(bend1)) if falls else min(abs(bend0), abs(bend1))
                deep, felt = max(s0[j], s[j]) > 0.0, bend >= rest[j]
                if deep and felt and may_turn(closing, opening, bend0, bend1, step):
                    part, depth = _deepest(s0[j], s[j], closing, opening, bend0, bend1, step)
                    if depth > 0.0:
                        if crossing[j] == np.inf:
                            crossing[j] = (nth + part) * step
                            # a body that is still accelerated then is fastest then
                            fastest[j] = max(fastest[j], _cubic(part, step, u0[j], a0[j], u[j], a[j]))
                        peak[j] = max(peak[j], beta[j] * law_power(depth, law, exponent[j // lanes]))
                if a0[j] > 0.0 and a[j] < 0.0:
                    part, top = _maximum(step, u0[j], a0[j], u[j], a[j])
                    if (nth + part) * step <= crossing[j] or j >= last_body:
                        fastest[j] = max(fastest[j], top)
        for j in range(end):
            open_still = ((nth + 1) * step <= crossing[j]) | (j >= last_body)
            fastest[j] = u[j] if (u[j] > fastest[j]) & open_still else fastest[j]
    if keep > 0:
        _store(kept, steps // keep, u, lanes)
    fastest = np.where(np.isfinite(u[: size - lanes]), fastest, np.nan)
    return np.where(crossing < np.inf, crossing, np.nan), peak, fastest


@kernel(nogil=False)
def _fill(
    first: int, end: int, stride: int, lanes: int, step: float, law: int, exponent: Floats, beta: Floats, rate: Floats,
    w: Floats, s: Floats, f: Floats, a: Floats,
) -> None:  # fmt: skip
    """Fill in the forces of the contacts from ``first`` to ``end``, and the accelerations next to them."""
    for i in range(max(first, 0), min(end, len(s)), stride):
        f[i] = beta[i] * law_power(s[i], law, exponent[i // lanes])
    for i in range(max(first, lanes), min(end + lanes, len(s)), stride):
        a[i] = rate[i] / step * (w[i] + f[i - lanes] - f[i])


@kernel(nogil=False)
def _correct(j: int, lanes: int, impulse: float, moment: float, rate: Floats, v: Floats, u: Floats, s: Floats) -> None:
    """Add an impulse and its moment to both bodies of a contact; both are in units of the step, like ``rate``."""
    for i, sign in ((j, -1.0), (j + lanes, 1.0)):
        v[i] += sign * impulse * rate[i]
        u[i] += sign * impulse * rate[i]
        shift = sign * moment * rate[i]
        if i < len(s):  # the right wall has no contact behind it
            s[i] += shift
        if i >= lanes:
            s[i - lanes] -= shift


@kernel(nogil=False)
def _store(kept: Floats, nth: int, u: Floats, lanes: int) -> None:
    """Store the velocities of a sample chain by chain."""
    for lane in range(lanes):
        for i in range(kept.shape[2]):
            kept[lane, nth, i] = u[(i + 1) * lanes + lane]
