"""Corrections of steps in which a contact opens or closes.

Hertz's force has no second derivative at touch, so that a step of a smooth method that meets a touch has an error of
order 2.5 (n in general), however high the order of the method is. That error is the same as in a model of two bodies
alone: the closing acceleration by all other forces is linear in time, from its value at the begin of the step to that
at its end, and the contact's own force follows its law. The model is solved twice for such a step, once with the stages
of the method and once from the touch on, by the rule of Gauss and Jacobi whose weight is the power of time with which
the force sets in. The difference of impulse and of its moment is added to both bodies. Momentum is conserved exactly.
A contact that opens is one that closes in reverse time, because the method is symmetric in time.

Steps next to that of a touch are not corrected, although the force has large derivatives there, so that the order of
the error stays n for exponents n that are no integers; it is 30 to 100 times smaller. The differences are proportional
to (closing rate)^(n-1), and nothing is corrected at rates that are too small to matter.
"""

from __future__ import annotations

import numpy as np

from dem_bridge.foundation.compiled import kernel
from dem_bridge.trajectory.trajectory import Floats

#: nodes of the rule; more change nothing at steps up to 1/omega
_NODES = 4
#: iterations of Newton's method for the time of touch, which starts from the solution for a constant acceleration
_ITERATIONS = 4


def jacobi_rules(exponent: Floats) -> Floats:
    """Return nodes and weights of the integral of x^(n-1) g(x) from 0 to 1 for each n, ``(n_contact, 2, n_node)``."""
    from scipy.special import roots_jacobi

    distinct, of_contact = np.unique(exponent, return_inverse=True)
    rules = [roots_jacobi(_NODES, 0.0, n - 1.0) for n in distinct.tolist()]
    return np.array([(0.5 * (x + 1.0), 0.5**n * w) for (x, w), n in zip(rules, distinct, strict=True)])[of_contact]


@kernel(nogil=False)
def law_power(depth: float, law: int, exponent: float) -> float:
    """Return depth^(n-1) of a positive depth, else 0; ``law`` is 0 for n = 5/2, 1 for n = 2, 2 for any other n."""
    closed = depth if depth > 0.0 else 0.0
    if law == 0:
        return float(closed * np.sqrt(closed))
    return closed if law == 1 else float(closed ** (exponent - 1.0))


@kernel(nogil=False)
def touch_defect(
    overlap: float, closing: float, acceleration: float, acceleration_end: float, mobility: float, stiffness: float,
    law: int, exponent: float, rule: Floats, least: float, drifts: Floats, kicks: Floats, step: float,
) -> tuple[float, float]:  # fmt: skip
    """Return exact minus numerical impulse (N s) of a step that closes a contact, and its moment (N s^2).

    The moment is the integral of force times the time that is left of the step. ``overlap``, ``closing`` and
    ``acceleration`` are those at the begin of the step, and accelerations are without the contact's own force.
    ``mobility`` is the sum of both inverse masses; both results are 0 where the closing rate at touch is below
    ``least``, and where the model does not close.
    """
    jerk = (acceleration_end - acceleration) / step
    root = closing + np.sqrt(max(closing * closing - 2.0 * acceleration * overlap, 0.0))
    if root <= least:
        return 0.0, 0.0
    time = min(-2.0 * overlap / root, step)
    for _ in range(_ITERATIONS):
        rate = closing + time * (acceleration + 0.5 * time * jerk)
        if rate <= least:
            return 0.0, 0.0
        depth = overlap + time * (closing + time * (0.5 * acceleration + time * jerk / 6.0))
        time = min(max(time - depth / rate, 0.0), step)
    rate = closing + time * (acceleration + 0.5 * time * jerk)
    if rate <= least:
        return 0.0, 0.0
    rest, bend = step - time, acceleration + jerk * time
    # what the contact's own force, stiffness (rate t)^(n-1), takes from the overlap
    reduction = mobility * stiffness * law_power(rate, law, exponent) / (exponent * (exponent + 1.0))
    impulse, moment = 0.0, 0.0
    for node in range(rule.shape[1]):
        since = rest * rule[0, node]
        mean = rate + since * (0.5 * bend + since * jerk / 6.0) - reduction * since * law_power(since, law, exponent)
        force = rule[1, node] * stiffness * law_power(mean, law, exponent)
        impulse += force
        moment += force * (rest - since)
    scale = rest * law_power(rest, law, exponent)
    impulse, moment = scale * impulse, scale * moment
    time, depth, rate = 0.0, overlap, closing
    for stage in range(len(kicks)):
        force = stiffness * law_power(depth, law, exponent)
        kick = step * kicks[stage]
        impulse -= kick * force
        moment -= kick * force * (step - time)
        if stage < len(drifts):
            rate += kick * (acceleration + jerk * time - mobility * force)
            depth += step * drifts[stage] * rate
            time += step * drifts[stage]
    return impulse, moment
