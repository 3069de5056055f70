"""Taylor series of a chain from contact event to contact event: the compiled core of the reference.

The force beta s^(n-1) is singular where a contact opens or closes (s = 0). With w = sqrt(s) of the contact nearest to
such a moment and the time transformation dt = w dr (a Sundman transformation; Stiefel & Scheifele 1971, *Linear and
Regular Celestial Mechanics*, for the same trick at collisions) its motion is analytic through it::

    w' = u/2    t' = w    v' = w a    s_j' = w u_j    F = beta w^(2(n-1))

with u the closing rate: w passes through 0 with a finite slope, so that openings are simple roots. All series are made
by recurrences (Jorba & Zou 2005, *Exp. Math.* 14, 99), steps follow from the decay of the last coefficients, and
events, samples and peaks are roots of the polynomials, as accurate as the rest.

Only bodies with a closed contact and their neighbours have series. All others coast: their flight is exact and costs
nothing until a collision, whose time waits in a heap. The index n_body stands for a wall: at rest, infinitely heavy.
"""

from __future__ import annotations

from heapq import heappop, heappush

import numpy as np

from dem_bridge.backends.polynomials import MOST_TURNS, root, swing, turning_points, value
from dem_bridge.foundation.compiled import Bools, Floats, Ints, kernel

#: coefficients looked at for the length of a step: by symmetry some may vanish
_TAIL = 5
#: steps without an event after which the pace is examined
_PATIENCE = 500_000


@kernel()
def _series(
    order: int, near: int, bodies: int, contacts: int, closed: Bools, a: Ints, b: Ints, stiffness: Floats,
    exponent: Floats, overlap: Floats, velocity: Floats, position: Floats, inverse: Floats, weight: Floats, w: Floats,
    power: Floats, t: Floats, v: Floats, x: Floats, s: Floats, u: Floats, f: Floats, g: Floats,
) -> None:  # fmt: skip
    """All series around the present moment. ``near``: the local contact that sets dt = w dr (-1: dt = dr).

    Local arrays: ``a``, ``b`` left and right body of each contact; ``weight`` the free acceleration of each body.
    Filled: ``w``, ``t``, ``v``, ``x`` per body; overlap ``s``, closing rate ``u``, force ``f`` per contact; ``g``
    acceleration.
    """
    w[: order + 1] = 0.0
    t[0] = 0.0
    w[0] = 1.0
    folds = 0
    if near >= 0:
        w[0] = np.sqrt(max(overlap[near], 0.0))
        folds = round(2.0 * (exponent[near] - 1.0)) - 1
    for i in range(bodies):
        v[i, 0] = velocity[i]
        x[i, 0] = position[i]
    for j in range(contacts):
        s[j, 0] = overlap[j]
    for o in range(order + 1):
        if near >= 0:
            # powers of w: power[q] is w^(q+2); those of w itself up to order o are known
            for q in range(folds):
                total = 0.0
                for d in range(o + 1):
                    total += (w[d] if q == 0 else power[q - 1, d]) * w[o - d]
                power[q, o] = total
        for i in range(bodies):
            g[i, o] = weight[i] if o == 0 else 0.0
        for j in range(contacts):
            u[j, o] = v[a[j], o] - v[b[j], o]
            if not closed[j]:
                continue
            if j == near:
                f[j, o] = stiffness[j] * (power[folds - 1, o] if folds > 0 else w[o])
            elif o == 0:
                f[j, 0] = stiffness[j] * overlap[j] ** (exponent[j] - 1.0)
            else:
                total = 0.0
                for d in range(1, o + 1):
                    total += (exponent[j] * d - o) * s[j, d] * f[j, o - d]
                f[j, o] = total / (o * overlap[j])
            g[a[j], o] -= f[j, o] * inverse[a[j]]
            g[b[j], o] += f[j, o] * inverse[b[j]]
        if o == order:
            break
        t[o + 1] = w[o] / (o + 1)
        if near < 0:
            for i in range(bodies):
                v[i, o + 1] = g[i, o] / (o + 1)
                x[i, o + 1] = v[i, o] / (o + 1)
            for j in range(contacts):
                s[j, o + 1] = u[j, o] / (o + 1)
            continue
        w[o + 1] = 0.5 * u[near, o] / (o + 1)
        for i in range(bodies):
            kick, drift = 0.0, 0.0
            for d in range(o + 1):
                kick += w[d] * g[i, o - d]
                drift += w[d] * v[i, o - d]
            v[i, o + 1] = kick / (o + 1)
            x[i, o + 1] = drift / (o + 1)
        for j in range(contacts):
            total = 0.0
            if j == near:
                for d in range(o + 2):
                    total += w[d] * w[o + 1 - d]
                s[j, o + 1] = total
            else:
                for d in range(o + 1):
                    total += w[d] * u[j, o - d]
                s[j, o + 1] = total / (o + 1)


@kernel()
def _step(
    order: int, near: int, bodies: int, contacts: int, closed: Bools, overlap: Floats, speed: float, touch: Floats,
    accuracy: float, v: Floats, s: Floats,
) -> float:  # fmt: skip
    """Length of a step for which the last coefficients contribute ``accuracy`` of speeds and overlaps."""
    step = np.inf
    for o in range(order - _TAIL + 1, order + 1):
        largest = 0.0
        for i in range(bodies):
            largest = max(largest, abs(v[i, o]) / speed)
        for j in range(contacts):
            if closed[j] and j != near:
                largest = max(largest, abs(s[j, o]) / max(overlap[j], touch[j]))
        if largest > 0.0:
            step = min(step, (accuracy / largest) ** (1.0 / o))
    return step


@kernel()
def integrate(
    mass: Floats, velocity: Floats, all_contacts: tuple[Ints, Ints, Floats, Floats, Floats], of_left: Ints,
    of_right: Ints, free: Floats, times: Floats, touch: Floats, speed: float, resting: Floats, order: int,
    accuracy: float, most_steps: int,
) -> tuple[Floats, Floats, Floats, Floats, Floats, int, int, int]:  # fmt: skip
    """Integrate a chain through ``times`` (s; the first is 0) by Taylor series.

    Returns displacement and velocity ``(n_t, n_body)``, force ``(n_t, n_contact)``, largest overlap, crossing time
    ``(n_contact,)``, steps, openings and closings.

    ``all_contacts``: left and right body, stiffness, exponent and gap of each contact; ``of_left``, ``of_right``:
    contacts of each body (-1: none); ``free``: acceleration of each body without contact; ``touch``: overlap of each
    contact below which its force is nothing; ``resting``: its closing acceleration below which it is at rest; after
    ``most_steps``, or where their coefficients are beyond doubles, it gives up, and velocities are nan from there on.
    """
    c_left, c_right, stiffness, exponent, gap = all_contacts
    n, k, rows, end = mass.shape[0], c_left.shape[0], times.shape[0], times[-1]
    x_all, v_all, t_all = np.zeros(n + 1), np.zeros(n + 1), np.zeros(n + 1)
    v_all[:n] = velocity
    inverse_all, weight_all = np.zeros(n + 1), np.zeros(n + 1)
    inverse_all[:n] = 1.0 / mass
    weight_all[:n] = free
    s_all, ts_all = -gap, np.zeros(k)
    shut = np.zeros(k, dtype=np.bool_)
    stamp = np.zeros(k, dtype=np.int64)
    out_x, out_v, out_f = np.zeros((rows, n)), np.zeros((rows, n)), np.zeros((rows, k))
    deepest, crossing = np.maximum(s_all, 0.0), np.full(k, np.nan)
    # local: those that need series now
    cap = n + 2
    body, contact = np.empty(cap, dtype=np.int64), np.empty(k + 1, dtype=np.int64)
    where = np.full(n + 1, -1, dtype=np.int64)
    seen = np.zeros(k, dtype=np.bool_)
    shut_list, shut_at, shut_count = np.empty(k + 1, dtype=np.int64), np.empty(k, dtype=np.int64), 0
    a, b = np.empty(k + 1, dtype=np.int64), np.empty(k + 1, dtype=np.int64)
    closed = np.empty(k + 1, dtype=np.bool_)
    stiff, expo, tiny, overlap = np.empty(k + 1), np.empty(k + 1), np.empty(k + 1), np.empty(k + 1)
    pos, vel, inv, wei = np.empty(cap), np.empty(cap), np.empty(cap), np.empty(cap)
    w, t_series, power = np.empty(order + 1), np.empty(order + 1), np.empty((8, order + 1))
    v, x, g = np.empty((cap, order + 1)), np.empty((cap, order + 1)), np.empty((cap, order + 1))
    s, u, f = np.empty((k + 1, order + 1)), np.empty((k + 1, order + 1)), np.empty((k + 1, order + 1))
    turns = np.empty(MOST_TURNS)
    bodies, contacts = 0, 0
    heap = [(np.inf, -1, -1)]
    for j in range(k):
        if s_all[j] > touch[j]:
            shut[j] = True
            shut_list[shut_count], shut_at[j] = j, shut_count
            shut_count += 1
        else:
            _await(heap, j, 0, 0.0, c_left[j], c_right[j], s_all, v_all, weight_all, touch)
    now, row, steps, opened, shuttings, dirty = 0.0, 0, 0, 0, 0, True
    idle, since, patience = 0, 0.0, min(_PATIENCE, most_steps)
    while row < rows and steps < most_steps and now >= 0.0:
        if dirty:
            idle, since = 0, now
            # states of all that had series are already those of this moment
            for i in range(bodies):
                where[body[i]] = -1
            old = contacts
            for j in range(old):
                seen[contact[j]] = False
            former = contact[:old].copy()
            bodies, contacts = 0, 0
            for q in range(shut_count):
                bodies = _join(shut_list[q], c_left, c_right, seen, contact, contacts, where, body, bodies)
                contacts += 1
            driven = bodies
            for q in range(driven):
                i = body[q]
                if i == n:
                    continue
                for j in (of_left[i], of_right[i]):
                    if j >= 0 and not seen[j]:
                        bodies = _join(j, c_left, c_right, seen, contact, contacts, where, body, bodies)
                        contacts += 1
            for q in range(bodies):
                i = body[q]
                _coast(i, now, x_all, v_all, t_all, weight_all)
                inv[q], wei[q] = inverse_all[i], weight_all[i]
            for q in range(contacts):
                j = contact[q]
                lag = now - ts_all[j]
                if lag > 0.0 and not shut[j]:
                    rate = v_all[c_left[j]] - v_all[c_right[j]]
                    pull = weight_all[c_left[j]] - weight_all[c_right[j]]
                    s_all[j] += lag * (rate - 0.5 * lag * pull)
                ts_all[j] = now
                stamp[j] += 1
                a[q], b[q] = where[c_left[j]], where[c_right[j]]
                stiff[q], expo[q], tiny[q] = stiffness[j], exponent[j], touch[j]
            for j in former:
                if not seen[j]:
                    # both its bodies coast now
                    stamp[j] += 1
                    _await(heap, j, stamp[j], now, c_left[j], c_right[j], s_all, v_all, weight_all, touch)
            dirty = False
        while heap[0][1] >= 0 and heap[0][2] != stamp[heap[0][1]]:
            heappop(heap)
        due = heap[0][0]
        steps, idle = steps + 1, idle + 1
        if idle == patience and (now - since) * most_steps < (end - now) * patience:
            break  # at this pace the end is beyond reach
        kind, which, near, r = 0, -1, -1, 0.0
        stop = min(due, end)
        if shut_count > 0:
            for q in range(bodies):
                pos[q], vel[q] = x_all[body[q]], v_all[body[q]]
            least = np.inf
            for q in range(contacts):
                overlap[q] = s_all[contact[q]]
                if shut[contact[q]]:
                    rate = vel[a[q]] - vel[b[q]]
                    soon = max(overlap[q], 0.0) / abs(rate) if rate != 0.0 else np.inf
                    if soon < least or near < 0:
                        near, least = q, soon
            # of contacts that close at the same moment one is the nearest; the others wait until they are felt
            for q in range(contacts):
                closed[q] = shut[contact[q]] and (q == near or overlap[q] >= tiny[q])
            _series(
                order, near, bodies, contacts, closed, a, b, stiff, expo, overlap, vel, pos, inv, wei,
                w, power, t_series, v, x, s, u, f, g,
            )  # fmt: skip
            r = _step(order, near, bodies, contacts, closed, overlap, speed, tiny, accuracy, v, s)
            if not r < np.inf:
                r = 1.0
            # a closed contact other than the nearest must stay well away from its own singularity
            for q in range(contacts):
                if closed[q] and q != near:
                    for _ in range(80):
                        if value(s[q], order, r) > 0.1 * overlap[q]:
                            break
                        r *= 0.7
            if value(t_series, order, r) > stop - now and value(w, order, r) > 0.0:
                r = root(t_series, order, stop - now, 0.0, r)
                kind = 4
            if value(w, order, r) <= 0.0:
                low = 0.0
                if w[0] == 0.0:  # it has just closed: look for the next zero
                    low = 1e-3 * r
                    while value(w, order, low) <= 0.0 and low > 0.0:
                        low *= 0.1
                r = root(w, order, 0.0, low, r)
                kind, which = 1, near
                if now + value(t_series, order, r) > stop:
                    r = root(t_series, order, stop - now, 0.0, r)
                    kind, which = 4, -1
            for q in range(contacts):
                if closed[q]:
                    continue
                # at rest in touch, and then pressed: force begins where it begins to be felt
                level = 0.0 if overlap[q] < 0.0 else tiny[q]
                if overlap[q] + swing(s[q], order, r) <= level:
                    continue
                upto = r
                count, falls = turning_points(u[q], order, r, turns)
                for turn in range(0 if falls else 1, count, 2):
                    if value(s[q], order, turns[turn]) > level:
                        upto = turns[turn]  # it may come and go
                        break
                if value(s[q], order, upto) <= level:
                    continue
                at = root(s[q], order, level, 0.0, upto)
                if level == 0.0:
                    pull = value(g[a[q]], order, at) - value(g[b[q]], order, at)
                    if _is_slow(value(u[q], order, at), pull, tiny[q]):
                        level = tiny[q]
                        if value(s[q], order, upto) <= level:
                            continue
                        at = root(s[q], order, level, at, upto)
                r, kind, which = at, 2 if level == 0.0 else 3, q
            if kind != 4:
                stop = min(now + value(t_series, order, r), end)
            for q in range(contacts):
                if not closed[q]:
                    continue
                j = contact[q]
                count, falls = turning_points(u[q], order, r, turns)
                for turn in range(0 if falls else 1, count, 2):
                    top = turns[turn]
                    deepest[j] = max(deepest[j], value(s[q], order, top))
                    pull = value(g[b[q]], order, top) - value(g[a[q]], order, top)
                    if np.isnan(crossing[j]) and abs(pull) >= resting[j]:
                        crossing[j] = now + value(t_series, order, top)
        while row < rows and times[row] <= stop:
            at = r
            if shut_count > 0 and times[row] < stop:
                at = root(t_series, order, times[row] - now, 0.0, r) if times[row] > now else 0.0
            for i in range(n):
                q = where[i]
                if shut_count > 0 and q >= 0:
                    out_x[row, i], out_v[row, i] = value(x[q], order, at), value(v[q], order, at)
                else:
                    lag = times[row] - t_all[i]
                    out_x[row, i] = x_all[i] + lag * (v_all[i] + 0.5 * lag * weight_all[i])
                    out_v[row, i] = v_all[i] + lag * weight_all[i]
            for q in range(contacts):
                if closed[q]:
                    out_f[row, contact[q]] = value(f[q], order, at)
            row += 1
        if shut_count > 0:
            for q in range(bodies):
                i = body[q]
                x_all[i], v_all[i], t_all[i] = value(x[q], order, r), value(v[q], order, r), stop
            for q in range(contacts):
                j = contact[q]
                s_all[j] = value(w, order, r) ** 2 if q == near else value(s[q], order, r)
                ts_all[j] = stop
                deepest[j] = max(deepest[j], s_all[j])
        now = stop
        x_all[n], v_all[n], t_all[n] = 0.0, 0.0, now
        joins = -1
        if kind == 1:
            j = contact[which]
            opened += 1
            dirty = True
            s_all[j] = 0.0
            shut_count = _open(j, shut, shut_list, shut_at, shut_count)
        elif kind == 2:
            joins = contact[which]
            s_all[joins] = 0.0
            shuttings += 1
        elif kind == 3:
            joins = contact[which]
        elif due <= now and due < np.inf:
            joins = heappop(heap)[1]
            for i in (c_left[joins], c_right[joins]):
                if where[i] < 0:
                    _coast(i, now, x_all, v_all, t_all, weight_all)
            pull = weight_all[c_left[joins]] - weight_all[c_right[joins]]
            lag = now - ts_all[joins]
            rate = v_all[c_left[joins]] - v_all[c_right[joins]] - lag * pull
            if _is_pulled(s_all[joins], rate, pull, touch[joins]):
                s_all[joins] = touch[joins]
            elif lag > 0.0 or s_all[joins] < 0.0:
                s_all[joins] = 0.0
            ts_all[joins] = now
            shuttings += 1
        if joins >= 0 and not shut[joins]:
            shut[joins] = True
            shut_list[shut_count], shut_at[joins] = joins, shut_count
            shut_count += 1
            dirty = True
        # contacts that fade out together with another one: too weak to be felt, and opening
        for q in range(contacts):
            j = contact[q]
            if shut[j] and j != joins and s_all[j] < touch[j] and v_all[c_left[j]] < v_all[c_right[j]]:
                shut_count = _open(j, shut, shut_list, shut_at, shut_count)
                dirty = True
    out_v[row:] = np.nan
    return out_x, out_v, out_f, deepest, crossing, steps, opened, shuttings


@kernel()
def _join(
    j: int, left: Ints, right: Ints, seen: Bools, contact: Ints, contacts: int, where: Ints, body: Ints, bodies: int
) -> int:
    """Add contact ``j`` and its bodies to those that have series; return the new number of bodies."""
    seen[j] = True
    contact[contacts] = j
    for i in (left[j], right[j]):
        if where[i] < 0:
            where[i] = bodies
            body[bodies] = i
            bodies += 1
    return bodies


@kernel()
def _coast(i: int, now: float, x: Floats, v: Floats, t: Floats, weight: Floats) -> None:
    """Bring body ``i``, which flies freely, to ``now``."""
    lag = now - t[i]
    x[i] += lag * (v[i] + 0.5 * lag * weight[i])
    v[i] += lag * weight[i]
    t[i] = now


@kernel()
def _await(
    heap: list[tuple[float, int, int]], j: int, stamp: int, now: float, left: int, right: int, s: Floats, v: Floats,
    weight: Floats, touch: Floats,
) -> None:  # fmt: skip
    """Put the time at which contact ``j``, whose bodies coast, will close into the heap, if it will."""
    wait = _collision(s[j], v[left] - v[right], weight[left] - weight[right], touch[j])
    if wait < np.inf:
        heappush(heap, (now + wait, j, stamp))


@kernel()
def _open(j: int, shut: Bools, shut_list: Ints, shut_at: Ints, count: int) -> int:
    """Take contact ``j`` from the list of closed ones; the new length."""
    shut[j] = False
    last = shut_list[count - 1]
    shut_list[shut_at[j]], shut_at[last] = last, shut_at[j]
    return count - 1


@kernel()
def _is_slow(rate: float, pull: float, touch: float) -> bool:
    """Return whether a contact with this closing rate at an overlap of 0 reaches ``touch`` by its acceleration.

    Without a rate nothing can start at 0, for dt = w dr stands still there. Such a contact starts at ``touch``, where
    its force begins to be felt.
    """
    return rate * rate <= 2.0 * pull * touch


@kernel()
def _is_pulled(overlap: float, rate: float, pull: float, touch: float) -> bool:
    """Return whether two coasting bodies meet at an overlap of ``touch`` and not of 0."""
    return pull > 0.0 and rate * rate - 2.0 * pull * min(overlap, 0.0) <= 2.0 * pull * touch


@kernel()
def _collision(overlap: float, rate: float, pull: float, touch: float) -> float:
    """Return the time until two coasting bodies begin a contact, s; inf: never.

    ``pull``: difference of their accelerations.
    """
    if _is_pulled(overlap, rate, pull, touch):
        way = max(touch - overlap, 0.0)
        wide: float = np.sqrt(rate * rate + 2.0 * pull * way)
        return 2.0 * way / (rate + wide) if rate > 0.0 else (wide - rate) / pull
    if overlap >= 0.0 and rate > 0.0:
        return 0.0
    if overlap >= 0.0:
        return float((np.sqrt(rate * rate - 2.0 * pull * overlap) - rate) / pull) if pull > 0.0 else np.inf
    if pull == 0.0:
        return -overlap / rate if rate > 0.0 else np.inf
    # overlap + rate t + pull t^2 / 2 = 0, the first root > 0, without cancellation
    inside = rate * rate - 2.0 * pull * overlap
    if inside < 0.0:
        return np.inf
    wide = np.sqrt(inside)
    first, second = np.inf, np.inf
    if rate > 0.0:
        first = -2.0 * overlap / (rate + wide) if rate + wide > 0.0 else np.inf
        second = (-rate - wide) / pull
    else:
        first = (-rate + wide) / pull
        second = -2.0 * overlap / (rate - wide) if rate - wide < 0.0 else np.inf
    best = np.inf
    for candidate in (first, second):
        if candidate > 0.0:
            best = min(best, candidate)
    return best
