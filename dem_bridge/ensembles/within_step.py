"""What happens within a step of chains in lanes: largest overlaps, velocities and forces between both ends.

Largest overlaps are read from Hermite polynomials of degree 5 through overlap, closing rate and closing acceleration at
the ends of a step, largest velocities and forces from those of degree 3 through a value and its rate.
"""

from __future__ import annotations

import numpy as np

from dem_bridge.foundation.compiled import Floats, kernel
from dem_bridge.trajectory.dense import first_turn, may_turn, quintic

#: chains in a group; eight doubles fill one vector of AVX-512 and two of AVX2
LANES = 8
#: steps between two looks at whether the observables are final
LOOK = 16


@kernel(nogil=False)
def law_power(depth: float, law: int, exponent: float) -> float:
    """Return depth^(n-1) of a positive depth, else 0; ``law`` is 0 for n = 5/2, 1 for n = 2, 2 for any other n."""
    closed = depth if depth > 0.0 else 0.0
    if law == 0:
        return float(closed * np.sqrt(closed))
    return closed if law == 1 else float(closed ** (exponent - 1.0))


@kernel(nogil=False)
def touch_time(
    overlap: float, closing: float, acceleration: float, jerk: float, step: float, slow: float, iterations: int
) -> float:  # fmt: skip
    """Return when a contact touches within a step, s; inf if it does not, or not faster than ``slow`` (m/s).

    ``acceleration`` is the closing one at the begin of the step, without the contact's own force, and ``jerk`` its
    rate. Newton's method starts from the solution for a constant acceleration.
    """
    root = closing + np.sqrt(max(closing * closing - 2.0 * acceleration * overlap, 0.0))
    if root <= slow:
        return np.inf
    time = min(-2.0 * overlap / root, step)
    for _ in range(iterations):
        rate = closing + time * (acceleration + 0.5 * time * jerk)
        if rate <= slow:
            return np.inf
        depth = overlap + time * (closing + time * (0.5 * acceleration + time * jerk / 6.0))
        time = min(max(time - depth / rate, 0.0), step)
    return float(time)


@kernel(nogil=False)
def maximum(step: float, v0: float, a0: float, v1: float, a1: float) -> tuple[float, float]:
    """Return the part of a step at which the cubic polynomial of the velocity is largest, and the velocity there."""
    jump = (v1 - v0) / step
    tilt = 2.0 * (3.0 * jump - 2.0 * a0 - a1)
    bend = 3.0 * (a0 + a1 - 2.0 * jump)
    # the slope a0 + tilt part + bend part^2 goes from above 0 to below: its root without cancellation
    root = np.sqrt(max(tilt * tilt - 4.0 * bend * a0, 0.0))
    if root <= tilt:  # by underflow
        return 1.0, v1
    part = 2.0 * a0 / (root - tilt)
    return part, cubic(part, step, v0, a0, v1, a1)


@kernel(nogil=False)
def cubic(part: float, step: float, v0: float, a0: float, v1: float, a1: float) -> float:
    """Return the velocity at a part of a step by the cubic polynomial through velocity and acceleration at its ends."""
    jump = (v1 - v0) / step
    tilt, bend = 2.0 * (3.0 * jump - 2.0 * a0 - a1), 3.0 * (a0 + a1 - 2.0 * jump)
    return v0 + step * part * (a0 + part * (0.5 * tilt + part * bend / 3.0))


@kernel(nogil=False)
def deepest(
    s0: float, s1: float, closing: float, opening: float, bend0: float, bend1: float, step: float
) -> tuple[float, float]:
    """Return the part of a step at which an overlap turns from growing to falling, and the overlap there.

    The numbers are overlap, its rate and acceleration at both ends of the step.
    """
    square = step * step
    c0, c1, c2, c3, c4, c5 = quintic(s0, s1, step * closing, step * opening, square * bend0, square * bend1)
    if closing > 0.0 and opening < 0.0 and bend0 < 0.0 and bend1 < 0.0:
        part, change = closing / (closing - opening), 1.0
        # Newton's method as long as it converges: round-off ends it
        while True:
            slope = c1 + part * (2.0 * c2 + part * (3.0 * c3 + part * (4.0 * c4 + part * 5.0 * c5)))
            curvature = 2.0 * c2 + part * (6.0 * c3 + part * (12.0 * c4 + part * 20.0 * c5))
            ahead = min(max(part - slope / curvature, 0.0), 1.0) if curvature < 0.0 else part
            if abs(ahead - part) >= 0.5 * change:
                break
            part, change = ahead, abs(ahead - part)
    else:
        part = first_turn(c1, c2, c3, c4, c5, step * opening)
    return part, c0 + part * (c1 + part * (c2 + part * (c3 + part * (c4 + part * c5))))


@kernel(nogil=False)
def read_turn(
    j: int, ahead: int, nth: int, step: float, law: int, exponent: float, stiffness: float, resting: float,
    least: float, last: bool,
    s0: Floats, u0: Floats, a0: Floats, s: Floats, u: Floats, a: Floats, crossing: Floats, peak: Floats,
    fastest: Floats,
) -> None:  # fmt: skip
    """Read a contact's largest overlap and its body's largest velocity within a step.

    ``ahead``: place of the next body; ``least``: an overlap (m) up to which a turn is none.
    """
    closing, opening = u0[j] - u0[ahead], u[j] - u[ahead]
    bend0, bend1 = a0[j] - a0[ahead], a[j] - a[ahead]
    # a contact at rest has accelerations that are round-off: where the rate keeps its sign neither may be
    falls = closing > 0.0 and opening <= 0.0
    bend = max(abs(bend0), abs(bend1)) if falls else min(abs(bend0), abs(bend1))
    if max(s0[j], s[j]) > 0.0 and bend >= resting and may_turn(closing, opening, bend0, bend1, step):
        part, depth = deepest(s0[j], s[j], closing, opening, bend0, bend1, step)
        if depth > least:
            if crossing[j] == np.inf:
                crossing[j] = (nth + part) * step
                # a body that is still accelerated then is fastest then
                fastest[j] = max(fastest[j], cubic(part, step, u0[j], a0[j], u[j], a[j]))
            peak[j] = max(peak[j], stiffness * law_power(depth, law, exponent))
    if a0[j] > 0.0 and a[j] < 0.0:
        part, top = maximum(step, u0[j], a0[j], u[j], a[j])
        if (nth + part) * step <= crossing[j] or last:
            fastest[j] = max(fastest[j], top)
    if (nth + 1) * step <= crossing[j] or last:
        fastest[j] = max(fastest[j], u[j])


@kernel(nogil=False)
def store(kept: Floats, nth: int, u: Floats, lanes: int) -> None:
    """Store the velocities of a sample chain by chain."""
    for lane in range(lanes):
        for i in range(kept.shape[2]):
            kept[lane, nth, i] = u[(i + 1) * lanes + lane]
