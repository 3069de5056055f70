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

from dem_bridge.backends.polynomials import MOST_TURNS, root, value
from dem_bridge.backends.taylor_series import (
    Bodies,
    Contacts,
    Event,
    Local,
    Series,
    expand,
    nearest_contact,
    next_event,
    note_peaks,
    series_length,
)
from dem_bridge.foundation.compiled import Bools, Floats, Ints, kernel

#: steps without an event after which the pace is examined
_PATIENCE = 500_000


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
    left, right, stiffness, exponent, gap = all_contacts
    n, k, rows, end = mass.shape[0], left.shape[0], times.shape[0], times[-1]
    x, v, t, _, weight, _ = every = _all_bodies(mass, velocity, free)
    s, ts, deepest, crossing = -gap, np.zeros(k), np.maximum(-gap, 0.0), np.full(k, np.nan)
    shut, seen, stamp = np.zeros(k, dtype=np.bool_), np.zeros(k, dtype=np.bool_), np.zeros(k, dtype=np.int64)
    shut_list, shut_at = np.empty(k + 1, dtype=np.int64), np.empty(k, dtype=np.int64)
    of = Contacts(
        left, right, stiffness, exponent, touch, resting, s, ts, shut, seen, stamp, shut_list, shut_at, deepest,
        crossing,
    )  # fmt: skip
    local, series, turns = _room(n + 2, k + 1), _room_of_series(n + 2, k + 1, order), np.empty(MOST_TURNS)
    contact, t_series = local.contact, series.t
    out_x, out_v, out_f = np.zeros((rows, n)), np.zeros((rows, n)), np.zeros((rows, k))
    bodies, contacts, shut_count = 0, 0, 0
    heap = [(np.inf, -1, -1)]
    for j in range(k):
        if s[j] > touch[j]:
            shut_count = _shut(j, shut, shut_list, shut_at, shut_count)
        else:
            _await(heap, j, 0, 0.0, left[j], right[j], s, v, weight, touch)
    now, row, steps, opened, shuttings, dirty = 0.0, 0, 0, 0, 0, True
    idle, since, patience = 0, 0.0, min(_PATIENCE, most_steps)
    while row < rows and steps < most_steps and now >= 0.0:
        if dirty:
            idle, since, dirty = 0, now, False
            bodies, contacts = _gather(
                now, bodies, contacts, shut_count, heap, of_left, of_right, local, every, of
            )  # fmt: skip
        while heap[0][1] >= 0 and heap[0][2] != stamp[heap[0][1]]:
            heappop(heap)
        due = heap[0][0]
        steps, idle = steps + 1, idle + 1
        if idle == patience and (now - since) * most_steps < (end - now) * patience:
            break  # at this pace the end is beyond reach
        event, which, near, r = Event.NONE, -1, -1, 0.0
        stop = min(due, end)
        if shut_count > 0:
            near = nearest_contact(bodies, contacts, local, every, of)
            expand(order, near, bodies, contacts, local, series)
            r = series_length(order, near, bodies, contacts, speed, accuracy, local, series)
            r, event, which = next_event(order, near, contacts, r, now, stop, local, series, turns)
            if event != Event.STOPS:
                stop = min(now + value(t_series, order, r), end)
            note_peaks(order, contacts, r, now, local, series, of, turns)
        while row < rows and times[row] <= stop:
            at = r if shut_count > 0 else -1.0
            if shut_count > 0 and times[row] < stop:
                at = root(t_series, order, times[row] - now, 0.0, r) if times[row] > now else 0.0
            _sample(times[row], at, order, contacts, local, series, every, out_x[row], out_v[row], out_f[row])
            row += 1
        if shut_count > 0:
            _carry(order, near, bodies, contacts, r, stop, local, series, every, of)
        now = stop
        x[n], v[n], t[n] = 0.0, 0.0, now
        joins = -1
        if event == Event.OPENS:
            j = contact[which]
            opened, dirty = opened + 1, True
            s[j] = 0.0
            shut_count = _open(j, shut, shut_list, shut_at, shut_count)
        elif event == Event.CLOSES:
            joins = contact[which]
            s[joins] = 0.0
            shuttings += 1
        elif event == Event.FELT:
            joins = contact[which]
        elif due <= now and due < np.inf:
            joins = heappop(heap)[1]
            _meet(joins, now, every, of)
            shuttings += 1
        if joins >= 0 and not shut[joins]:
            shut_count, dirty = _shut(joins, shut, shut_list, shut_at, shut_count), True
        # contacts that fade out together with another one: too weak to be felt, and opening
        for q in range(contacts):
            j = contact[q]
            if shut[j] and j != joins and s[j] < touch[j] and v[left[j]] < v[right[j]]:
                shut_count, dirty = _open(j, shut, shut_list, shut_at, shut_count), True
    out_v[row:] = np.nan
    return out_x, out_v, out_f, deepest, crossing, steps, opened, shuttings


@kernel()
def _all_bodies(mass: Floats, velocity: Floats, free: Floats) -> Bodies:
    """Return all bodies at the start, and the wall."""
    n = len(mass)
    v, inverse, weight = np.zeros(n + 1), np.zeros(n + 1), np.zeros(n + 1)
    v[:n], inverse[:n], weight[:n] = velocity, 1.0 / mass, free
    return Bodies(np.zeros(n + 1), v, np.zeros(n + 1), inverse, weight, np.full(n + 1, -1, dtype=np.int64))


@kernel()
def _room(bodies: int, contacts: int) -> Local:
    """Return room for so many bodies and contacts that need series."""
    return Local(
        np.empty(bodies, dtype=np.int64), np.empty(contacts, dtype=np.int64), np.empty(contacts, dtype=np.int64),
        np.empty(contacts, dtype=np.int64), np.empty(contacts, dtype=np.bool_), np.empty(contacts), np.empty(contacts),
        np.empty(contacts), np.empty(contacts), np.empty(bodies), np.empty(bodies), np.empty(bodies), np.empty(bodies),
    )  # fmt: skip


@kernel()
def _room_of_series(bodies: int, contacts: int, order: int) -> Series:
    """Return room for the series of so many bodies and contacts."""
    size = order + 1
    v, x, g = np.empty((bodies, size)), np.empty((bodies, size)), np.empty((bodies, size))
    s, u, f = np.empty((contacts, size)), np.empty((contacts, size)), np.empty((contacts, size))
    return Series(np.empty(size), np.empty((8, size)), np.empty(size), v, x, g, s, u, f)


@kernel()
def _gather(
    now: float, bodies: int, contacts: int, shut_count: int, heap: list[tuple[float, int, int]], of_left: Ints,
    of_right: Ints, local: Local, every: Bodies, of: Contacts,
) -> tuple[int, int]:  # fmt: skip
    """Find the bodies and contacts that need series from now on, and return their numbers, given those until now."""
    body, contact, a, b, _, local_stiffness, local_exponent, local_touch, _, _, _, local_inverse, local_weight = local
    x, v, t, inverse, weight, where = every
    c_left, c_right, stiffness, exponent, touch, _, s, ts, shut, seen, stamp, shut_list, _, _, _ = of
    n = len(of_left)
    # states of all that had series are already those of this moment
    for i in range(bodies):
        where[body[i]] = -1
    for j in range(contacts):
        seen[contact[j]] = False
    former = contact[:contacts].copy()
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
        _coast(i, now, x, v, t, weight)
        local_inverse[q], local_weight[q] = inverse[i], weight[i]
    for q in range(contacts):
        j = contact[q]
        left, right, lag = c_left[j], c_right[j], now - ts[j]
        if lag > 0.0 and not shut[j]:
            rate = v[left] - v[right]
            pull = weight[left] - weight[right]
            s[j] += lag * (rate - 0.5 * lag * pull)
        ts[j] = now
        stamp[j] += 1
        a[q], b[q] = where[left], where[right]
        local_stiffness[q], local_exponent[q], local_touch[q] = stiffness[j], exponent[j], touch[j]
    for j in former:
        if not seen[j]:
            # both its bodies coast now
            stamp[j] += 1
            _await(heap, j, stamp[j], now, c_left[j], c_right[j], s, v, weight, touch)
    return bodies, contacts


@kernel()
def _carry(
    order: int, near: int, bodies: int, contacts: int, r: float, stop: float, local: Local, series: Series,
    every: Bodies, of: Contacts,
) -> None:  # fmt: skip
    """Bring all that have series to the end of a step of length ``r``, which is at the time ``stop``."""
    x, v, t, s, ts, deepest = every.x, every.v, every.t, of.s, of.t, of.deepest
    body, contact, w, x_series, v_series, s_series = local.body, local.contact, series.w, series.x, series.v, series.s
    for q in range(bodies):
        i = body[q]
        x[i], v[i], t[i] = value(x_series[q], order, r), value(v_series[q], order, r), stop
    for q in range(contacts):
        j = contact[q]
        s[j] = value(w, order, r) ** 2 if q == near else value(s_series[q], order, r)
        ts[j] = stop
        deepest[j] = max(deepest[j], s[j])


@kernel()
def _meet(j: int, now: float, every: Bodies, of: Contacts) -> None:
    """Bring contact ``j``, whose bodies coast, to ``now``, when it begins."""
    x, v, t, _, weight, where = every
    left, right, s, ts, touch = of.left[j], of.right[j], of.s, of.t, of.touch
    for i in (left, right):
        if where[i] < 0:
            _coast(i, now, x, v, t, weight)
    pull = weight[left] - weight[right]
    lag = now - ts[j]
    rate = v[left] - v[right] - lag * pull
    if _is_pulled(s[j], rate, pull, touch[j]):
        s[j] = touch[j]
    elif lag > 0.0 or s[j] < 0.0:
        s[j] = 0.0
    ts[j] = now


@kernel()
def _sample(
    time: float, at: float, order: int, contacts: int, local: Local, series: Series, every: Bodies, out_x: Floats,
    out_v: Floats, out_f: Floats,
) -> None:  # fmt: skip
    """Write a row of the results, at a ``time``; ``at``: where that is in the step; < 0: there are no series."""
    x, v, t, _, weight, where = every
    contact, closed, x_series, v_series, f = local.contact, local.closed, series.x, series.v, series.f
    for i in range(len(out_x)):
        q = where[i]
        if not at < 0.0 and q >= 0:
            out_x[i], out_v[i] = value(x_series[q], order, at), value(v_series[q], order, at)
        else:
            lag = time - t[i]
            out_x[i] = x[i] + lag * (v[i] + 0.5 * lag * weight[i])
            out_v[i] = v[i] + lag * weight[i]
    for q in range(contacts):
        if closed[q]:
            out_f[contact[q]] = value(f[q], order, at)


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
def _shut(j: int, shut: Bools, shut_list: Ints, shut_at: Ints, count: int) -> int:
    """Add contact ``j`` to the list of closed ones; the new length."""
    shut[j] = True
    shut_list[count], shut_at[j] = j, count
    return count + 1


@kernel()
def _open(j: int, shut: Bools, shut_list: Ints, shut_at: Ints, count: int) -> int:
    """Take contact ``j`` from the list of closed ones; the new length."""
    shut[j] = False
    last = shut_list[count - 1]
    shut_list[shut_at[j]], shut_at[last] = last, shut_at[j]
    return count - 1


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
