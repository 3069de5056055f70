"""The kernel of an ensemble: several chains side by side, one in each lane of the processor's vectors.

All chains of a group have the same bodies, contacts and steps, and differ in numbers only. An array has one row for
each place along the line and one column for each chain, so that every operation is the same for all lanes. Places are
those of :mod:`dem_bridge.backends.fused`: entry 0 is the left wall, then come the bodies, then the right wall; contact
k is between places k and k + 1. The method is Blanes and Moan's SRKN_6^b (2002), as in
:mod:`dem_bridge.backends.blanes_moan`; no force law and no step of the integration is shared with LAMMPS or the
reference.

Maximal compressions and largest velocities lie between steps. They are read from Hermite polynomials through the two
ends of a step: of degree 5 through overlap, closing rate and closing acceleration, of degree 3 through velocity and
acceleration.
"""

from __future__ import annotations

import numpy as np

from dem_bridge.compiled import kernel

#: chains in a group; eight doubles fill one vector of AVX-512 and two of AVX2
LANES = 8


@kernel(nogil=False)
def _force(stiffness, depth, law, exponent):  # type: ignore[no-untyped-def]
    """Return the force of an overlap; ``law`` is 0 for n = 5/2, 1 for n = 2 and 2 for any other exponent n."""
    closed = depth if depth > 0.0 else 0.0
    if law == 0:
        return stiffness * closed * np.sqrt(closed)
    return stiffness * closed if law == 1 else stiffness * closed ** (exponent - 1.0)


@kernel(nogil=False)
def _quintic(part, step, ends):  # type: ignore[no-untyped-def]
    """Return the value and the slope of the quintic polynomial through both ends of a step, at a part of the step.

    ``ends`` has value, slope and second derivative at the begin of the step, then those at its end.
    """
    jump = ends[3] - ends[0]
    slope0, slope1 = step * ends[1], step * ends[4]
    bend0, bend1 = step * step * ends[2], step * step * ends[5]
    third = 10.0 * jump - 6.0 * slope0 - 4.0 * slope1 - 1.5 * bend0 + 0.5 * bend1
    fourth = -15.0 * jump + 8.0 * slope0 + 7.0 * slope1 + 1.5 * bend0 - bend1
    fifth = 6.0 * jump - 3.0 * (slope0 + slope1) - 0.5 * (bend0 - bend1)
    value = ends[0] + part * (slope0 + part * (0.5 * bend0 + part * (third + part * (fourth + part * fifth))))
    slope = slope0 + part * (bend0 + part * (3.0 * third + part * (4.0 * fourth + part * 5.0 * fifth)))
    return value, slope / step


@kernel(nogil=False)
def _turning_point(step, ends):  # type: ignore[no-untyped-def]
    """Return the part of a step at which the closing rate is zero, and the overlap there; by bisection and Newton."""
    low, high = 0.0, 1.0
    part = ends[1] / (ends[1] - ends[4])
    for _ in range(60):
        closing = _quintic(part, step, ends)[1]
        if closing > 0.0:
            low = part
        else:
            high = part
        away = 1e-6
        ahead = _quintic(part + away, step, ends)[1]
        change = closing * away / (closing - ahead) if closing != ahead else 0.0
        guess = part + change
        if not low < guess < high:
            guess = 0.5 * (low + high)
        if abs(guess - part) < 1e-12:
            part = guess
            break
        part = guess
    return part, _quintic(part, step, ends)[0]


@kernel(nogil=False)
def _maximum(step, v0, a0, v1, a1):  # type: ignore[no-untyped-def]
    """Return the part of a step at which the cubic polynomial of the velocity is largest, and the velocity there."""
    jump = (v1 - v0) / step
    tilt = 2.0 * (3.0 * jump - 2.0 * a0 - a1)
    bend = 3.0 * (a0 + a1 - 2.0 * jump)
    # the slope a0 + tilt part + bend part^2 goes from above 0 to below: its root without cancellation
    root = np.sqrt(max(tilt * tilt - 4.0 * bend * a0, 0.0))
    part = 2.0 * a0 / (root - tilt)
    return part, _cubic(part, step, v0, a0, v1, a1)


@kernel(nogil=False)
def _cubic(part, step, v0, a0, v1, a1):  # type: ignore[no-untyped-def]
    """Return the velocity at a part of a step by the cubic polynomial through velocity and acceleration at its ends."""
    jump = (v1 - v0) / step
    tilt, bend = 2.0 * (3.0 * jump - 2.0 * a0 - a1), 3.0 * (a0 + a1 - 2.0 * jump)
    return v0 + step * part * (a0 + part * (0.5 * tilt + part * bend / 3.0))


@kernel()
def march(  # type: ignore[no-untyped-def]
    mass, velocity, weight, stiffness, overlap, exponent, law, resting, drifts, kicks, step, steps, keep,
):  # fmt: skip
    """Solve a group of chains, and return what is asked of an ensemble.

    ``mass``, ``velocity``, ``weight (n_body + 2, n_lane)`` (walls: infinite mass), ``stiffness``, ``overlap``,
    ``resting (n_body + 1, n_lane)``, ``exponent (n_body + 1,)`` and ``law`` (see :func:`_force`); a step of ``step``
    seconds, ``steps`` of them. The results are the time of the first maximal compression of each contact (s; nan:
    never), its largest force (N), the largest velocity of the body behind the contact until that time (m/s; the
    first row is that of the wall, and the last body has no such time), ``(n_body + 1, n_lane)`` each, and the
    velocities after every ``keep``-th step, ``(steps // keep + 1, n_body + 2, n_lane)`` (none for ``keep = 0``).
    """
    places, lanes = mass.shape
    size, stages = places * lanes, len(drifts)
    rate, v, w = (step / mass).ravel(), velocity.ravel().copy(), weight.ravel()
    beta, s, rest = stiffness.ravel(), overlap.ravel().copy(), resting.ravel()
    f, a, u = np.zeros(size), np.zeros(size), v.copy()
    s0, u0, a0 = np.zeros(size), np.zeros(size), np.zeros(size)
    # the same arrays from the next place on: an index that cannot be negative lets the compiler use whole vectors
    rate_next, v_next, w_next, f_next, u_next, a_next = (
        rate[lanes:],
        v[lanes:],
        w[lanes:],
        f[lanes:],
        u[lanes:],
        a[lanes:],
    )
    u0_next, a0_next = u0[lanes:], a0[lanes:]
    peak = np.zeros(size - lanes)
    fastest, ends, crossing = v[: size - lanes].copy(), np.zeros(6), np.full(size - lanes, np.inf)
    kept = np.zeros((steps // keep + 1 if keep > 0 else 0, places, lanes))
    if keep > 0:
        kept[0] = velocity
    # the last body hands the impulse on to nobody, not to a wall either
    front, last_body = 0, (places - 2) * lanes
    for j in range(size - lanes):
        f[j] = _force(beta[j], s[j], law, exponent[j // lanes])
        peak[j] = f[j]
        if v[j] != 0.0 or w[j] != 0.0 or f[j] != 0.0:
            front = min(j // lanes + 1, places - 2)
    for j in range(lanes, size - lanes):
        a[j] = rate[j] / step * (w[j] + f[j - lanes] - f[j])
    for nth in range(steps):
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
                    f[j] = _force(beta[j], s[j], law, exponent[j // lanes])
        last = kicks[stages]
        for j in range(end - lanes):
            gained = rate_next[j] * (w_next[j] + f[j] - f_next[j])
            u_next[j] = v_next[j] + last * gained
            a_next[j] = gained / step
        while most > front and np.all(u[most * lanes : end] == 0.0) and np.all(f[(most - 1) * lanes : end] == 0.0):
            most -= 1
        front = most
        turned = 0
        for j in range(end):
            peak[j] = f[j] if f[j] > peak[j] else peak[j]
            turned += (u0[j] - u0_next[j] > 0.0) & (u[j] - u_next[j] <= 0.0)
            turned += (a0[j] > 0.0) & (a[j] < 0.0)
        if turned > 0:
            for j in range(end):
                closing, opening = u0[j] - u0_next[j], u[j] - u_next[j]
                if closing > 0.0 and opening <= 0.0 and max(s0[j], s[j]) > 0.0:
                    bend0, bend1 = a0[j] - a0_next[j], a[j] - a_next[j]
                    if max(abs(bend0), abs(bend1)) >= rest[j]:
                        ends[:] = (s0[j], closing, bend0, s[j], opening, bend1)
                        part, depth = _turning_point(step, ends)
                        if depth > 0.0:
                            if crossing[j] == np.inf:
                                crossing[j] = (nth + part) * step
                                # a body that is still accelerated then is fastest then
                                fastest[j] = max(fastest[j], _cubic(part, step, u0[j], a0[j], u[j], a[j]))
                            peak[j] = max(peak[j], _force(beta[j], depth, law, exponent[j // lanes]))
                if a0[j] > 0.0 and a[j] < 0.0:
                    part, top = _maximum(step, u0[j], a0[j], u[j], a[j])
                    if (nth + part) * step <= crossing[j] or j >= last_body:
                        fastest[j] = max(fastest[j], top)
        for j in range(end):
            open_still = ((nth + 1) * step <= crossing[j]) | (j >= last_body)
            fastest[j] = u[j] if (u[j] > fastest[j]) & open_still else fastest[j]
        if keep > 0 and (nth + 1) % keep == 0:
            kept[(nth + 1) // keep] = u.reshape(places, lanes)
    return np.where(crossing < np.inf, crossing, np.nan), peak, fastest, kept
