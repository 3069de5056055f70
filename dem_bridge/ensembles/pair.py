"""Two bodies alone: the exact step of a damped contact that touches, opens or is clipped, against that of the method.

The closing acceleration by all other forces is linear in time, from its value at the begin of the step to that at its
end. From the touch on, or from the begin where the contact is closed, the motion is computed in parts of the step that
grow from the touch on, and a contact that opens does so at the time at which its overlap is zero.
"""

from __future__ import annotations

import numpy as np

from dem_bridge.ensembles.within_step import law_power, touch_time
from dem_bridge.foundation.compiled import kernel

#: parts of a step, and iterations for the times of touch and opening
PARTS, _ITERATIONS = 8, 5
#: stiffness, exponent, its law; damping, power of the overlap, its law; clip: see :mod:`.damped`
Contact = tuple[float, float, int, float, float, int, bool]


@kernel(nogil=False)
def elastic_force(depth: float, stiffness: float, exponent: float, law: int) -> float:
    """Return the elastic force of a contact, N."""
    return stiffness * law_power(depth, law, exponent)


@kernel(nogil=False)
def contact_force(closed: bool, depth: float, rate: float, contact: Contact) -> float:
    """Return elastic and damping force, N; a contact that is ``closed`` may have an overlap below 0 by round-off."""
    stiffness, exponent, law, damping, power, of_damping, clip = contact
    if not closed:
        return 0.0
    deep = depth if depth > 0.0 else 0.0
    force = elastic_force(deep, stiffness, exponent, law)
    if damping > 0.0:
        factor = 1.0
        if of_damping == 1:
            factor = np.sqrt(deep)
        elif of_damping == 2:
            factor = np.sqrt(np.sqrt(deep))
        elif of_damping == 3 and power > 0.0:
            factor = deep**power
        force += damping * factor * rate
        if clip and force < 0.0:
            force = 0.0
    return force


@kernel(nogil=False)
def _runge_kutta(
    closed: bool, s: float, r: float, time: float, part: float, acceleration: float, jerk: float, mobility: float,
    contact: Contact,
) -> tuple[float, float]:  # fmt: skip
    """Return overlap and closing rate after a step of the classical method; a contact not ``closed`` is if s > 0."""
    middle, last = acceleration + jerk * (time + 0.5 * part), acceleration + jerk * (time + part)
    a1 = acceleration + jerk * time - mobility * contact_force(closed or s > 0.0, s, r, contact)
    s2, r2 = s + 0.5 * part * r, r + 0.5 * part * a1
    a2 = middle - mobility * contact_force(closed or s2 > 0.0, s2, r2, contact)
    s3, r3 = s + 0.5 * part * r2, r + 0.5 * part * a2
    a3 = middle - mobility * contact_force(closed or s3 > 0.0, s3, r3, contact)
    s4, r4 = s + part * r3, r + part * a3
    a4 = last - mobility * contact_force(closed or s4 > 0.0, s4, r4, contact)
    return s + part * (r + part / 6.0 * (a1 + a2 + a3)), r + part / 6.0 * (a1 + 2.0 * (a2 + a3) + a4)


@kernel(nogil=False)
def pair_defect(
    overlap: float, closing: float, before: float, after: float, mobility: float, contact: Contact, step: float,
    slow: float, velocity: float, own: tuple[float, float], inverse_mass: float, until: float,
) -> tuple[float, float, float, float]:  # fmt: skip
    """Return exact minus numerical impulse (N s) of a step, its moment (N s^2), largest force and velocity.

    ``before`` and ``after``: closing acceleration at both ends of the step without the contact's own force, ``own``
    that of the body behind, whose ``velocity`` and ``inverse_mass`` follow; its largest velocity is that of the times
    up to ``until`` s after the begin. ``slow``: closing rate below which a touch is not corrected.
    """
    jerk, bend = (after - before) / step, (own[1] - own[0]) / step
    numerical_s, numerical_r = _runge_kutta(False, overlap, closing, 0.0, step, before, jerk, mobility, contact)
    begin, s, r = 0.0, overlap, closing
    if overlap <= 0.0:
        begin = touch_time(overlap, closing, before, jerk, step, slow, _ITERATIONS)
        if begin == np.inf:
            return 0.0, 0.0, 0.0, -np.inf
        s, r = 0.0, closing + begin * (before + 0.5 * begin * jerk)
    most, top, time, closed = contact_force(True, s, r, contact), -np.inf, begin, True
    if begin <= until:
        top = velocity + begin * (own[0] + 0.5 * begin * bend)
    for nth in range(1, PARTS + 1):
        following = begin + (step - begin) * (nth / PARTS) ** 2
        part = following - time
        ahead_s, ahead_r = _runge_kutta(True, s, r, time, part, before, jerk, mobility, contact)
        if ahead_s < 0.0:
            part = _opening(s, r, time, part, ahead_s, before, jerk, mobility, contact)
            _, r = _runge_kutta(True, s, r, time, part, before, jerk, mobility, contact)
            time, closed = time + part, False
            break
        s, r, time = ahead_s, ahead_r, following
        most = max(most, contact_force(True, s, r, contact))
        if time <= until:
            impulse = (closing + time * (before + 0.5 * time * jerk) - r) / mobility
            top = max(top, velocity + time * (own[0] + 0.5 * time * bend) - inverse_mass * impulse)
    if not closed:
        left = step - time
        bend_then = before + jerk * time
        s = left * (r + left * (0.5 * bend_then + left * jerk / 6.0))
        r += left * (bend_then + 0.5 * left * jerk)
    return (numerical_r - r) / mobility, (numerical_s - s) / mobility, most, top


@kernel(nogil=False)
def _opening(
    s: float, r: float, time: float, part: float, beyond: float, acceleration: float, jerk: float, mobility: float,
    contact: Contact,
) -> float:  # fmt: skip
    """Return after how many seconds the overlap falls to zero, by the rule of false position (Illinois)."""
    low, at_low, high, at_high = 0.0, s, part, beyond
    root = 0.0
    for _ in range(_ITERATIONS):
        if at_low <= 0.0:
            return low
        root = low + (high - low) * at_low / (at_low - at_high)
        at_root, _ = _runge_kutta(True, s, r, time, root, acceleration, jerk, mobility, contact)
        if at_root > 0.0:
            low, at_low, at_high = root, at_root, 0.5 * at_high
        else:
            high, at_high, at_low = root, at_root, 0.5 * at_low
    return root
