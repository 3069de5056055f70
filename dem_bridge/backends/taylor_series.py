"""Taylor series of one step of a chain, compiled: coefficients, length, and what ends the step; see :mod:`.taylor`."""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple

import numpy as np

from dem_bridge.backends.polynomials import root, swing, turning_points, value
from dem_bridge.foundation.compiled import Bools, Floats, Ints, kernel

#: coefficients looked at for the length of a step: by symmetry some may vanish
_TAIL = 5


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


class Bodies(NamedTuple):
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


class Contacts(NamedTuple):
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


class Local(NamedTuple):
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


class Series(NamedTuple):
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
def expand(order: int, near: int, bodies: int, contacts: int, local: Local, series: Series) -> None:
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
def series_length(
    order: int, near: int, bodies: int, contacts: int, speed: float, accuracy: float, local: Local, series: Series
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
def nearest_contact(bodies: int, contacts: int, local: Local, every: Bodies, of: Contacts) -> int:
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
def next_event(
    order: int, near: int, contacts: int, length: float, now: float, stop: float, local: Local,
    series: Series, turns: Floats,
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
def note_peaks(
    order: int, contacts: int, r: float, now: float, local: Local, series: Series, of: Contacts, turns: Floats
) -> None:
    """Note the maximal compressions within a step of length ``r``."""
    contact, a, b, closed = local.contact, local.a, local.b, local.closed
    s, u, g, t = series.s, series.u, series.g, series.t
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
def _is_slow(rate: float, pull: float, touch: float) -> bool:
    """Return whether a contact with this closing rate at an overlap of 0 reaches ``touch`` by its acceleration.

    Without a rate nothing can start at 0, for dt = w dr stands still there. Such a contact starts at ``touch``, where
    its force begins to be felt.
    """
    return rate * rate <= 2.0 * pull * touch
