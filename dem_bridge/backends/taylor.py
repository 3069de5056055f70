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

from enum import IntEnum
from heapq import heappop, heappush
from typing import NamedTuple

import numpy as np

from dem_bridge.backends.polynomials import MOST_TURNS, root, swing, turning_points, value
from dem_bridge.foundation.compiled import Bools, Floats, Ints, kernel

#: coefficients looked at for the length of a step: by symmetry some may vanish
_TAIL = 5
#: steps without an event after which the pace is examined
_PATIENCE = 500_000


class Event(IntEnum):
    """What ends a step."""

    #: the length for which the series serve
    NONE = 0
    #: the nearest contact opens
    OPENS = 1
    #: a contact closes
    CLOSES = 2
    #: a contact at rest in touch is pressed until its force is felt
    FELT = 3
    #: the end of the run, or a collision of bodies that coast
    STOPS = 4


class _Bodies(NamedTuple):
    """All bodies and the wall, ``(n_body + 1,)``."""

    x: Floats
    v: Floats
    t: Floats
    """When ``x`` and ``v`` were so."""
    inverse: Floats
    """1 by mass."""
    weight: Floats
    """Acceleration without contact."""
    where: Ints
    """Place among those that have series, -1: none."""


class _Contacts(NamedTuple):
    """All contacts, ``(n_contact,)``."""

    left: Ints
    right: Ints
    stiffness: Floats
    exponent: Floats
    touch: Floats
    resting: Floats
    s: Floats
    """Overlap."""
    t: Floats
    """When it was so."""
    shut: Bools
    seen: Bools
    """Whether the contact is among those that have series."""
    stamp: Ints
    """Number of the only valid entry in the heap."""
    shut_list: Ints
    """The closed contacts, one more than there can be."""
    shut_at: Ints
    """Place in that list."""
    deepest: Floats
    crossing: Floats


class _Local(NamedTuple):
    """Those that need series now."""

    body: Ints
    contact: Ints
    a: Ints
    """Left body of each contact, by its place here; ``b`` right body."""
    b: Ints
    closed: Bools
    stiffness: Floats
    exponent: Floats
    touch: Floats
    overlap: Floats
    position: Floats
    velocity: Floats
    inverse: Floats
    weight: Floats


class _Series(NamedTuple):
    """Coefficients of all series of a step."""

    w: Floats
    power: Floats
    """Row q is w^(q+2)."""
    t: Floats
    v: Floats
    """``(n_body, order + 1)``."""
    x: Floats
    g: Floats
    """Acceleration."""
    s: Floats
    """``(n_contact, order + 1)``."""
    u: Floats
    f: Floats


@kernel()
def _expand(order: int, near: int, bodies: int, contacts: int, local: _Local, series: _Series) -> None:
    """Make all series around the present moment. ``near``: the local contact that sets dt = w dr (-1: dt = dr)."""
    _, _, a, b, closed, stiffness, exponent, _, overlap, position, velocity, inverse, weight = local
    w, power, t, v, x, g, s, u, f = series
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
def _length(
    order: int, near: int, bodies: int, contacts: int, speed: float, accuracy: float, local: _Local, series: _Series
) -> float:
    """Return the length of a step for which the last coefficients contribute ``accuracy`` of speeds and overlaps."""
    closed, touch, overlap, v, s = local.closed, local.touch, local.overlap, series.v, series.s
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
    if not step < np.inf:
        step = 1.0
    # a closed contact other than the nearest must stay well away from its own singularity
    for q in range(contacts):
        if closed[q] and q != near:
            for _ in range(80):
                if value(s[q], order, step) > 0.1 * overlap[q]:
                    break
                step *= 0.7
    return step


@kernel()
def _nearest(bodies: int, contacts: int, local: _Local, every: _Bodies, of: _Contacts) -> int:
    """Take over the present state, and return the closed contact that is nearest to its opening or closing."""
    x_all, v_all, s_all, shut = every.x, every.v, of.s, of.shut
    body, contact, a, b, closed, _, _, touch, overlap, position, velocity, _, _ = local
    for q in range(bodies):
        position[q], velocity[q] = x_all[body[q]], v_all[body[q]]
    near, least = -1, np.inf
    for q in range(contacts):
        overlap[q] = s_all[contact[q]]
        if shut[contact[q]]:
            rate = velocity[a[q]] - velocity[b[q]]
            soon = max(overlap[q], 0.0) / abs(rate) if rate != 0.0 else np.inf
            if soon < least or near < 0:
                near, least = q, soon
    # of contacts that close at the same moment one is the nearest; the others wait until they are felt
    for q in range(contacts):
        closed[q] = shut[contact[q]] and (q == near or overlap[q] >= touch[q])
    return near


@kernel()
def _event(
    order: int, near: int, contacts: int, length: float, now: float, stop: float, local: _Local,
    series: _Series, turns: Floats,
) -> tuple[float, Event, int]:  # fmt: skip
    """Return where a step ends, at most at its ``length``, what ends it, and which local contact that is.

    ``stop``: time at which it ends at the latest; ``turns``: room for turning points.
    """
    w, t, r, event, which = series.w, series.t, length, Event.NONE, -1
    if value(t, order, r) > stop - now and value(w, order, r) > 0.0:
        r, event = root(t, order, stop - now, 0.0, r), Event.STOPS
    if value(w, order, r) <= 0.0:
        low = 0.0
        if w[0] == 0.0:  # it has just closed: look for the next zero
            low = 1e-3 * r
            while value(w, order, low) <= 0.0 and low > 0.0:
                low *= 0.1
        r, event, which = root(w, order, 0.0, low, r), Event.OPENS, near
        if now + value(t, order, r) > stop:
            r, event, which = root(t, order, stop - now, 0.0, r), Event.STOPS, -1
    a, b, closed, touch, overlap = local.a, local.b, local.closed, local.touch, local.overlap
    s, u, g = series.s, series.u, series.g
    for q in range(contacts):
        if closed[q]:
            continue
        # at rest in touch, and then pressed: force begins where it begins to be felt
        level = 0.0 if overlap[q] < 0.0 else touch[q]
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
            if _is_slow(value(u[q], order, at), pull, touch[q]):
                level = touch[q]
                if value(s[q], order, upto) <= level:
                    continue
                at = root(s[q], order, level, at, upto)
        r, event, which = at, Event.CLOSES if level == 0.0 else Event.FELT, q
    return r, event, which


@kernel()
def _compress(
    order: int, contacts: int, r: float, now: float, local: _Local, series: _Series, of: _Contacts, turns: Floats
) -> None:
    """Note the maximal compressions within a step of length ``r``."""
    contact, a, b, closed, s, u, g, t = (
        local.contact,
        local.a,
        local.b,
        local.closed,
        series.s,
        series.u,
        series.g,
        series.t,
    )
    deepest, crossing, resting = of.deepest, of.crossing, of.resting
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
                crossing[j] = now + value(t, order, top)


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
    of = _Contacts(
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
            near = _nearest(bodies, contacts, local, every, of)
            _expand(order, near, bodies, contacts, local, series)
            r = _length(order, near, bodies, contacts, speed, accuracy, local, series)
            r, event, which = _event(order, near, contacts, r, now, stop, local, series, turns)
            if event != Event.STOPS:
                stop = min(now + value(t_series, order, r), end)
            _compress(order, contacts, r, now, local, series, of, turns)
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
def _all_bodies(mass: Floats, velocity: Floats, free: Floats) -> _Bodies:
    """Return all bodies at the start, and the wall."""
    n = len(mass)
    v, inverse, weight = np.zeros(n + 1), np.zeros(n + 1), np.zeros(n + 1)
    v[:n], inverse[:n], weight[:n] = velocity, 1.0 / mass, free
    return _Bodies(np.zeros(n + 1), v, np.zeros(n + 1), inverse, weight, np.full(n + 1, -1, dtype=np.int64))


@kernel()
def _room(bodies: int, contacts: int) -> _Local:
    """Return room for so many bodies and contacts that need series."""
    return _Local(
        np.empty(bodies, dtype=np.int64), np.empty(contacts, dtype=np.int64), np.empty(contacts, dtype=np.int64),
        np.empty(contacts, dtype=np.int64), np.empty(contacts, dtype=np.bool_), np.empty(contacts), np.empty(contacts),
        np.empty(contacts), np.empty(contacts), np.empty(bodies), np.empty(bodies), np.empty(bodies), np.empty(bodies),
    )  # fmt: skip


@kernel()
def _room_of_series(bodies: int, contacts: int, order: int) -> _Series:
    """Return room for the series of so many bodies and contacts."""
    size = order + 1
    v, x, g = np.empty((bodies, size)), np.empty((bodies, size)), np.empty((bodies, size))
    s, u, f = np.empty((contacts, size)), np.empty((contacts, size)), np.empty((contacts, size))
    return _Series(np.empty(size), np.empty((8, size)), np.empty(size), v, x, g, s, u, f)


@kernel()
def _gather(
    now: float, bodies: int, contacts: int, shut_count: int, heap: list[tuple[float, int, int]], of_left: Ints,
    of_right: Ints, local: _Local, every: _Bodies, of: _Contacts,
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
    order: int, near: int, bodies: int, contacts: int, r: float, stop: float, local: _Local, series: _Series,
    every: _Bodies, of: _Contacts,
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
def _meet(j: int, now: float, every: _Bodies, of: _Contacts) -> None:
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
    time: float, at: float, order: int, contacts: int, local: _Local, series: _Series, every: _Bodies, out_x: Floats,
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
