"""The kernel of an ensemble: several chains side by side, one in each lane of the processor's vectors.

All chains of a group have the same bodies, contacts and steps, and differ in numbers only. An array has one row for
each place along the line and one column for each chain, so that every operation is the same for all lanes. Places are
those of :mod:`dem_bridge.backends.fused`: entry 0 is the left wall, then come the bodies, then the right wall; contact
k is between places k and k + 1. The method is Blanes and Moan's SRKN_6^b (2002), as in
:mod:`dem_bridge.backends.blanes_moan`, and steps that meet a touch are corrected. No force law and no
step of the integration is shared with LAMMPS or the reference.

Maximal compressions and largest velocities lie between steps. They are read from Hermite polynomials through the two
ends of a step: of degree 5 through overlap, closing rate and closing acceleration, of degree 3 through velocity and
acceleration. A run ends where nothing that follows can change the observables (:mod:`.settled`).

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

from dem_bridge.ensembles.settled import all_settled, is_free
from dem_bridge.ensembles.within_step import LOOK, law_power, read_turn, store, touch_time
from dem_bridge.foundation.compiled import Floats, kernel
from dem_bridge.trajectory.dense import may_turn

#: nodes of the rule; more change nothing at steps up to 1/omega
_NODES = 4
#: iterations for the time of touch
_ITERATIONS = 4


def jacobi_rules(exponent: Floats) -> Floats:
    """Return nodes and weights of the integral of x^(n-1) g(x) from 0 to 1 for each n, ``(n_contact, 2, n_node)``."""
    from scipy.special import roots_jacobi

    distinct, of_contact = np.unique(exponent, return_inverse=True)
    rules = [roots_jacobi(_NODES, 0.0, n - 1.0) for n in distinct.tolist()]
    return np.array([(0.5 * (x + 1.0), 0.5**n * w) for (x, w), n in zip(rules, distinct, strict=True)])[of_contact]


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
    time = touch_time(overlap, closing, acceleration, jerk, step, least, _ITERATIONS)
    if time == np.inf:
        return 0.0, 0.0
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


@kernel()
def march(
    mass: Floats, velocity: Floats, weight: Floats, stiffness: Floats, overlap: Floats, exponent: Floats, law: int,
    resting: Floats, rules: Floats, slow: float, drifts: Floats, kicks: Floats, step: float, steps: int, drag: float,
    kept: Floats,
) -> tuple[Floats, Floats, Floats]:  # fmt: skip
    """Solve a group of chains, and return the observables of an ensemble.

    ``mass``, ``velocity``, ``weight (n_body + 2, n_lane)`` (walls: infinite mass), ``stiffness``, ``overlap``,
    ``resting (n_body + 1, n_lane)``, ``exponent (n_body + 1,)`` and ``law`` (see :func:`.law_power`); ``rules``
    and ``slow`` are for :func:`.touch_defect`; a step of ``step`` seconds, ``steps`` of them. The results are the
    time of the first maximal compression of each contact (s; nan: never), its largest force (N), the largest velocity
    of the body behind the contact until that time (m/s; the first row is that of the wall, and the last body has no
    such time; nan: the velocities are not finite), ``(n_body + 1, n_lane)`` each. ``drag`` is in 1/s. The
    velocities at the start and after equal numbers of steps are written to ``kept (n_lane, n_kept, n_body)``, which may
    be empty.
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
    _fill(0, size - lanes, 1, lanes, step, law, exponent, beta, rate, w, drag, u, s, f, a)
    peak = f[: size - lanes].copy()
    fastest, crossing = v[: size - lanes].copy(), np.full(size - lanes, np.inf)
    # what needs more than the vectors do is marked, and looked for eight places at a time
    marks = np.zeros(size, np.uint8)
    words = marks.view(np.int64)
    # the last body hands the impulse on to nobody, not to a wall either
    front, last_body = 0, (places - 2) * lanes
    for j in range(size - lanes):
        if v[j] != 0.0 or w[j] != 0.0 or f[j] != 0.0:
            front = min(j // lanes + 1, places - 2)
    keep = steps // (kept.shape[1] - 1) if kept.shape[1] > 1 else 0
    none = np.zeros_like(stiffness)
    may_settle = keep == 0 and is_free(weight, stiffness)
    for nth in range(steps):
        if keep > 0 and nth % keep == 0:
            store(kept, nth // keep, u, lanes)
        # a stage carries a disturbance to the next body and no further
        most = min(places - 2, front + stages)
        end = (most + 1) * lanes
        for j in range(end):
            s0[j], u0[j], a0[j] = s[j], u[j], a[j]
        for stage in range(stages):
            drift = step * drifts[stage]
            # the last kick of a step and the first of the next have the same force
            stays, kick = _kick(2.0 * kicks[0] if stage == 0 and nth > 0 else kicks[stage], drag, step)
            for j in range(end - lanes):
                v_next[j] = stays * v_next[j] + kick * rate_next[j] * (w_next[j] + f[j] - f_next[j])
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
        stays, last = _kick(kicks[stages], drag, step)
        for j in range(end - lanes):
            gained = rate_next[j] * (w_next[j] + f[j] - f_next[j])
            u_next[j] = stays * v_next[j] + last * gained
            a_next[j] = gained / step - drag * u_next[j]
        for j in range(end):
            marks[j] = (s0[j] > 0.0) != (s[j] > 0.0)
        for word in range(end // 8):
            if words[word] != 0:
                for j in range(8 * word, 8 * word + 8):
                    if marks[j] == 0:
                        continue
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
                        _fill(
                            j - lanes, j + 2 * lanes, lanes, lanes, step, law, exponent, beta, rate, w, drag, u, s, f, a
                        )
        while most > front and np.all(u[most * lanes : end] == 0.0) and np.all(f[(most - 1) * lanes : end] == 0.0):
            most -= 1
        front = most
        for j in range(end):
            peak[j] = f[j] if f[j] > peak[j] else peak[j]
            deep = (s0[j] > 0.0) | (s[j] > 0.0)
            turn = may_turn(u0[j] - u0_next[j], u[j] - u_next[j], a0[j] - a0_next[j], a[j] - a_next[j], step)
            top = (a0[j] > 0.0) & (a[j] < 0.0) & ((nth * step <= crossing[j]) | (j >= last_body))
            marks[j] = (deep & turn) | top
            counts = (((nth + 1) * step <= crossing[j]) | (j >= last_body)) & (marks[j] == 0)
            fastest[j] = u[j] if (u[j] > fastest[j]) & counts else fastest[j]
        for word in range(end // 8):
            if words[word] != 0:
                for j in range(8 * word, 8 * word + 8):
                    if marks[j] != 0:
                        read_turn(
                            j, j + lanes, nth, step, law, exponent[j // lanes], beta[j], rest[j], 0.0, j >= last_body,
                            s0, u0, a0, s, u, a, crossing, peak, fastest,
                        )  # fmt: skip
        slowed = np.exp(-drag * step * (steps - 1 - nth))
        looks = may_settle and nth % LOOK == 0 and front == places - 2
        if looks and all_settled(mass, stiffness, none, exponent, exponent, u, s, crossing, peak, slowed):
            break
    if keep > 0:
        store(kept, steps // keep, u, lanes)
    fastest = np.where(np.isfinite(u[: size - lanes]), fastest, np.nan)
    return np.where(crossing < np.inf, crossing, np.nan), peak, fastest


@kernel(nogil=False)
def _kick(kick: float, drag: float, step: float) -> tuple[float, float]:
    """Return what a kick leaves of a velocity under ``drag`` (1/s), and its mean weight, in units of the step."""
    slowed = drag * kick * step
    return np.exp(-slowed), (kick if slowed == 0.0 else -np.expm1(-slowed) / (drag * step))


@kernel(nogil=False)
def _fill(
    first: int, end: int, stride: int, lanes: int, step: float, law: int, exponent: Floats, beta: Floats, rate: Floats,
    w: Floats, drag: float, u: Floats, s: Floats, f: Floats, a: Floats,
) -> None:  # fmt: skip
    """Fill in the forces of the contacts from ``first`` to ``end``, and the accelerations next to them."""
    for i in range(max(first, 0), min(end, len(s)), stride):
        f[i] = beta[i] * law_power(s[i], law, exponent[i // lanes])
    for i in range(max(first, lanes), min(end + lanes, len(s)), stride):
        a[i] = rate[i] / step * (w[i] + f[i - lanes] - f[i]) - drag * u[i]


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
