"""Components of a chain, compiled: steps, each on a clock of its own, and touches in physical time; see :mod:`.taylor`.

A component is a run of closed contacts with their bodies. Its step is under way from ``begin`` to ``end``, and others
may cut it short at any time between. Bodies outside of components coast. The overlap of an open contact follows from
the ways of its two bodies, whatever the clocks on which they move.
"""

from __future__ import annotations

from heapq import heappush
from typing import NamedTuple

import numpy as np

from dem_bridge.backends.taylor_series import (
    MOST_TURNS,
    Event,
    G,
    S,
    Series,
    T,
    Table,
    U,
    V,
    W,
    X,
    expand,
    is_slow,
    nearest_contact,
    next_event,
    note_peaks,
    series_length,
    value_of,
)
from dem_bridge.foundation.compiled import Floats, kernel

#: parts of a step shorter than this share of it are searched for a touch by the signs at their ends alone
_SHORTEST = 1.0 / 32.0

#: moments at which something happens: time, contact (or number of contacts + first contact of a component whose step
#: ends), and stamp
Heap = list[tuple[float, int, int]]


class Rows(NamedTuple):
    """The samples, without walls."""

    time: Floats
    x: Floats
    v: Floats
    """``(n_t, n_body)``."""
    force: Floats
    """``(n_t, n_contact)``."""


class Chain(NamedTuple):
    """All of a run between two events, in few arrays: kernels count the references to each in every call."""

    bodies: Table
    contacts: Table
    components: Table
    series: Series
    end: float
    """Time of the end of the run."""
    lowest: int
    """First contact that exists."""
    highest: int
    """Last contact that exists."""
    speed: float
    accuracy: float


@kernel()
def renew(first: int, last: int, now: float, chain: Chain, heap: Heap) -> int:
    """Find the components among contacts ``first`` to ``last`` and start their steps; return their number.

    It is -1 where coefficients are beyond doubles. All their bodies are those of ``now``, and so are the overlaps up to
    the next contact on either side.
    """
    bodies, contacts, components = chain.bodies, chain.contacts, chain.components
    count, number = len(contacts), 0
    for i in range(first, last + 2):
        bodies[i].owner = -1
    begin = -1
    for j in range(first, last + 1):
        components[j].stamp += 1
        if not contacts[j].shut:
            continue
        if begin < 0:
            begin = j
        bodies[j].owner, bodies[j + 1].owner = begin, begin
        if j == last or not contacts[j + 1].shut:
            if not _plan(begin, j, now, chain):
                return -1
            heappush(heap, (components[begin].end, count + begin, components[begin].stamp))
            begin, number = -1, number + 1
    for j in range(max(first - 1, chain.lowest), min(last + 1, chain.highest) + 1):
        if j >= first:
            contacts[j].left_way = 0.0
        if j <= last:
            contacts[j].right_way = 0.0
        contacts[j].stamp += 1
        if not contacts[j].shut:
            contacts[j].t = now
            touch, felt = next_touch(j, now, chain)
            contacts[j].felt = felt
            if touch <= chain.end:
                heappush(heap, (touch, j, contacts[j].stamp))
    return number


@kernel()
def _plan(first: int, last: int, now: float, chain: Chain) -> bool:
    """Make the series of a component, plan its step, and return whether its end is a number."""
    contacts, series, component = chain.contacts, chain.series, chain.components[first]
    near = nearest_contact(first, last, chain.bodies, contacts)
    expand(near, first, last, chain.bodies, contacts, series)
    length = series_length(near, first, last, chain.speed, chain.accuracy, contacts, series)
    length, event, which = next_event(
        near, first, last, length, chain.end - now, contacts, series, np.empty(MOST_TURNS)
    )
    end = chain.end if event == Event.STOPS else now + value_of(series, T, first, length)
    component.last, component.near, component.begin, component.end = last, near, now, min(end, chain.end)
    component.length, component.event, component.which = length, event, which
    return bool(end >= now)


@kernel()
def meet(j: int, now: float, chain: Chain, rows: Rows) -> tuple[int, int]:
    """Begin the open contact ``j``; return the first and the last contact of what it joins, brought to ``now``."""
    contact, first, last = chain.contacts[j], j, j
    for i, outer in ((j, j - 1), (j + 1, j + 1)):
        owner = chain.bodies[i].owner
        if owner >= 0:
            commit(owner, now, chain, rows)
            first, last = min(first, owner), max(last, chain.components[owner].last)
            continue
        if chain.lowest <= outer <= chain.highest:
            bring_overlap(outer, now, chain)
        coast(i, now, chain, rows)
    contact.shut, contact.t = True, now
    contact.s = contact.touch if contact.felt else 0.0
    return first, last


@kernel()
def commit(first: int, now: float, chain: Chain, rows: Rows) -> None:
    """Bring a component to ``now``, which is within its step, with the overlaps on both sides of it."""
    bodies, contacts, series, component = chain.bodies, chain.contacts, chain.series, chain.components[first]
    last, near, row = component.last, component.near, bodies[first].row
    for j in (first - 1, last + 1):
        if chain.lowest <= j <= chain.highest:
            bring_overlap(j, now, chain)
    while row < len(rows.time) and rows.time[row] <= now:
        at, _ = _clock(first, rows.time[row], chain.components, series)
        for i in range(max(first, 1), min(last + 2, len(bodies) - 1)):
            rows.x[row, i - 1], rows.v[row, i - 1] = value_of(series, X, i, at), value_of(series, V, i, at)
        for j in range(first, last + 1):
            contact = contacts[j]
            if contact.closed:
                overlap = value_of(series, W, first, at) ** 2 if j == near else value_of(series, S, j, at)
                rows.force[row, contact.column] = contact.stiffness * max(overlap, 0.0) ** (contact.exponent - 1.0)
        row += 1
    r, lag = _clock(first, now, chain.components, series)
    note_peaks(first, last, r, component.begin, contacts, series, np.empty(MOST_TURNS))
    for i in range(first, last + 2):
        body = bodies[i]
        body.v = value_of(series, V, i, r) + lag * value_of(series, G, i, r)
        body.x, body.t, body.row = value_of(series, X, i, r) + lag * body.v, now, row
    for j in range(first, last + 1):
        contact = contacts[j]
        overlap = value_of(series, W, first, r) ** 2 if j == near else value_of(series, S, j, r)
        contact.s, contact.t = overlap + lag * value_of(series, U, j, r), now
        contact.deepest = max(contact.deepest, contact.s)


@kernel()
def coast(i: int, now: float, chain: Chain, rows: Rows) -> None:
    """Bring body ``i``, which flies freely, to ``now``; the overlaps on both sides must be those of ``now``."""
    body, row = chain.bodies[i], chain.bodies[i].row
    while row < len(rows.time) and rows.time[row] <= now:
        if 0 < i < len(chain.bodies) - 1:
            way, velocity, _ = _motion(i, rows.time[row], chain)
            rows.x[row, i - 1], rows.v[row, i - 1] = body.x + way, velocity
        row += 1
    way, velocity, _ = _motion(i, now, chain)
    body.x, body.v, body.t, body.row = body.x + way, velocity, now, row


@kernel()
def bring_overlap(j: int, now: float, chain: Chain) -> None:
    """Bring the overlap of the open contact ``j`` to ``now``."""
    left, right, contact = chain.bodies[j], chain.bodies[j + 1], chain.contacts[j]
    left_way, rate, _ = _motion(j, now, chain)
    right_way, other, _ = _motion(j + 1, now, chain)
    if left.owner < 0 and right.owner < 0:
        # a velocity that both have in common leaves no round-off
        lag = now - contact.t
        contact.s += lag * (rate - other - 0.5 * lag * (left.weight - right.weight))
    else:
        contact.s += (left_way - contact.left_way) - (right_way - contact.right_way)
    contact.left_way, contact.right_way, contact.t = left_way, right_way, now


@kernel()
def _motion(i: int, time: float, chain: Chain) -> tuple[float, float, float]:
    """Return the way of body ``i`` since its ``t``, its velocity and its acceleration."""
    body, series = chain.bodies[i], chain.series
    if body.owner < 0:
        lag = time - body.t
        return lag * (body.v + 0.5 * lag * body.weight), body.v + lag * body.weight, body.weight
    r, lag = _clock(body.owner, time, chain.components, series)
    if r == 0.0:
        return 0.0, series[V, i, 0], series[G, i, 0]
    order = series.shape[2] - 1
    way, velocity, pull = 0.0, series[V, i, order], series[G, i, order]
    for o in range(order - 1, -1, -1):
        way, velocity = (way + series[X, i, o + 1]) * r, velocity * r + series[V, i, o]
        pull = pull * r + series[G, i, o]
    return way + lag * velocity, velocity + lag * pull, pull


@kernel()
def _clock(first: int, time: float, components: Table, series: Series) -> tuple[float, float]:
    """Return where a moment is in the step of a component: r, and the time from there to the moment.

    Newton's method within a bracket finds r. The time is 0 but at the end of the step, which is one in whole digits of
    the time since the start: bodies that went on without it would lose digits against those on other clocks.
    """
    component = components[first]
    low, high, begin, order = 0.0, component.length, component.begin, series.shape[2] - 1
    if time >= component.end:
        return high, time - begin - value_of(series, T, first, high)
    if time <= begin:
        return low, 0.0
    target = time - begin
    r = high * target / (component.end - begin)
    for _ in range(100):
        late, slope = series[T, first, order], series[W, first, order]
        for o in range(order - 1, -1, -1):
            late, slope = late * r + series[T, first, o], slope * r + series[W, first, o]
        late -= target
        if late > 0.0:
            high = r
        else:
            low = r
        following = r - late / slope if slope > 0.0 else low
        if abs(following - r) <= 2.3e-16 * r:
            break
        r = following if low < following < high else 0.5 * (low + high)
        if high - low <= 2.3e-16 * high:
            break
    return r, 0.0


@kernel()
def next_touch(j: int, now: float, chain: Chain) -> tuple[float, bool]:
    """Return when the open contact ``j`` begins within the steps under way (inf: not), and if at its ``touch``.

    A part of the time is passed over where no acceleration of its bodies bends the overlap up to the level. Others are
    halved, and the shortest are searched by the signs at their ends.
    """
    bodies, series = chain.bodies, chain.series
    s, touch = chain.contacts[j].s, chain.contacts[j].touch
    if bodies[j].owner < 0 and bodies[j + 1].owner < 0:
        _, rate, pull = _approach(j, now, chain)
        return now + _collision(s, rate, pull, touch), _is_pulled(s, rate, pull, touch)
    until, bend = np.inf, 0.0
    for i in (j, j + 1):
        first = bodies[i].owner
        if first < 0:
            bend += abs(bodies[i].weight)
            continue
        until, bound, length = min(until, chain.components[first].end), 0.0, chain.components[first].length
        for o in range(series.shape[2] - 1, -1, -1):
            bound = bound * length + abs(series[G, i, o])
        bend += bound
    level = 0.0 if s < 0.0 else touch
    low, span = now, until - now
    part, (at_low, rate_low, _) = span, _approach(j, now, chain)
    while low < until:
        left = until - low
        if max(at_low, at_low + left * (rate_low + 0.5 * bend * left)) <= level:
            break
        high = min(low + part, until)
        if high <= low:
            break
        at_high, rate_high, _ = _approach(j, high, chain)
        if max(at_low, at_high) + 0.125 * bend * (high - low) ** 2 <= level:
            part *= 2.0
        elif part > _SHORTEST * span:
            part *= 0.5
            continue
        else:
            top, at_top = high, at_high
            if at_high <= level and rate_low > 0.0 >= rate_high:
                top = _crossing(j, False, 0.0, low, high, chain)
                at_top, _, _ = _approach(j, top, chain)
            if at_top > level:
                found = _crossing(j, True, level, low, top, chain)
                _, rate, pull = _approach(j, found, chain)
                if level > 0.0 or not is_slow(rate, pull, touch):
                    return found, level > 0.0
                level = touch
                continue
        low, at_low, rate_low = high, at_high, rate_high
        level = 0.0 if at_low < 0.0 else level
    return np.inf, False


@kernel()
def _approach(j: int, time: float, chain: Chain) -> tuple[float, float, float]:
    """Return overlap, closing rate and closing acceleration of the open contact ``j``."""
    contact = chain.contacts[j]
    left, left_velocity, left_pull = _motion(j, time, chain)
    right, right_velocity, right_pull = _motion(j + 1, time, chain)
    overlap = contact.s + ((left - contact.left_way) - (right - contact.right_way))
    return overlap, left_velocity - right_velocity, left_pull - right_pull


@kernel()
def _crossing(j: int, of_overlap: bool, level: float, low: float, high: float, chain: Chain) -> float:
    """Return when overlap or closing rate of the open contact ``j`` passes ``level``, by regula falsi (Illinois)."""
    which = 0 if of_overlap else 1
    a, b = low, high
    fa, fb = _approach(j, a, chain)[which] - level, _approach(j, b, chain)[which] - level
    for _ in range(200):
        if b - a <= 2.3e-16 * b or fb == 0.0:
            break
        width, middle = b - a, b - fb * (b - a) / (fb - fa) if fb != fa else a
        for halved in range(2):
            if halved == 1 or not a < middle < b:
                middle = 0.5 * (a + b)
            if not a < middle < b:
                return b
            f = _approach(j, middle, chain)[which] - level
            if (f > 0.0) == (fb > 0.0):
                b, fb, fa = middle, f, 0.5 * fa
            else:
                a, fa, fb = middle, f, 0.5 * fb
            if b - a <= 0.5 * width:
                break
    return b


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
