"""Taylor series of one step of a component, compiled: coefficients, length, and what ends the step; see :mod:`.taylor`.

A component is a run of closed contacts, from ``first`` to ``last``, with the bodies ``first`` to ``last + 1``.
Events, samples and peaks are roots and turning points of the polynomials, with coefficients ``c[0..order]``, lowest
first.
"""

from __future__ import annotations

from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from dem_bridge.foundation.compiled import Floats, kernel

#: pieces of a step that are looked at for a turning point of their own; the first is halved so many times where the
#: closing rate is exactly 0 at the start: what it does then may be round-off, and a turning point follow at once
PIECES, HALVINGS = 8, 20
MOST_TURNS = 2 * (PIECES + HALVINGS)


@kernel()
def value(c: Floats, order: int, r: float) -> float:
    """Return the value of the polynomial at ``r``."""
    total: float = c[order]
    for o in range(order - 1, -1, -1):
        total = total * r + c[o]
    return total


@kernel()
def root(c: Floats, order: int, level: float, low: float, high: float) -> float:
    """Return where the polynomial passes ``level`` in [low, high], whose ends lie on different sides.

    The method is regula falsi with the Illinois weight, and bisection where that is slow. The end on the far side of
    the passage is returned.
    """
    a, b = low, high
    fa, fb = value(c, order, a) - level, value(c, order, b) - level
    for _ in range(120):
        if b - a <= 2.3e-16 * b or fb == 0.0:
            break
        width = b - a
        # ends in the range of denormal numbers may differ by nothing
        middle = b - fb * (b - a) / (fb - fa) if fb != fa else a
        if not a < middle < b:
            middle = 0.5 * (a + b)
        f = value(c, order, middle) - level
        if (f > 0.0) == (fb > 0.0):
            b, fb = middle, f
            fa *= 0.5
        else:
            a, fa = middle, f
            fb *= 0.5
        if b - a > 0.5 * width:
            middle = 0.5 * (a + b)
            f = value(c, order, middle) - level
            if (f > 0.0) == (value(c, order, b) - level > 0.0):
                b = middle
            else:
                a = middle
            fa, fb = value(c, order, a) - level, value(c, order, b) - level
    return b


@kernel()
def first_nonzero(c: Floats, order: int, start: int) -> int:
    """Return the index of the first coefficient from ``start`` on that is not 0; ``order + 1``: there is none.

    Its sign is that of the polynomial right after 0.
    """
    o = start
    while o <= order and c[o] == 0.0:
        o += 1
    return o


@kernel()
def swing(c: Floats, order: int, r: float) -> float:
    """Return the most by which the polynomial can leave its value at 0 within [0, r]."""
    most = 0.0
    for o in range(order, 0, -1):
        most = (most + abs(c[o])) * r
    return most


@kernel()
def between(c: Floats, order: int, low: float, high: float) -> float:
    """Return the root between ``low`` and ``high``, on which the signs differ; a root at 0 itself is divided out."""
    lead = first_nonzero(c, order, 0) if low == 0.0 else 0
    return root(c[lead:], order - lead, 0.0, low, high)


@kernel()
def turning_points(c: Floats, order: int, r: float, turns: Floats) -> tuple[int, bool]:
    """Write where the polynomial changes its sign in (0, r] into ``turns`` (room for MOST_TURNS), in order.

    Returns their number and whether the first goes from + to -; every other one then does. The interval is searched
    piece by piece; a piece whose ends are on the same side may hold an extremum on the other.
    """
    lead = first_nonzero(c, order, 0)
    if lead > order or (lead == 0 and swing(c, order, r) < abs(c[0])):
        return 0, False
    count, before, falls = 0, c[lead], c[lead] > 0.0
    tilt = c[max(lead, min(first_nonzero(c, order, 1), order))]
    low = 0.0
    for piece in range(1 - (HALVINGS if lead > 0 else 0), PIECES + 1):
        high = r * (piece if piece > 0 else 2.0 ** (piece - 1)) / PIECES
        after, slope = c[order], 0.0
        for o in range(order - 1, -1, -1):
            slope = slope * high + after
            after = after * high + c[o]
        if (before > 0.0 and after <= 0.0) or (before < 0.0 and after >= 0.0):
            turns[count] = between(c, order, low, high)
            count += 1
        elif (before > 0.0 and tilt < 0.0 and slope > 0.0) or (before < 0.0 and tilt > 0.0 and slope < 0.0):
            middle = between(c[1:] * np.arange(1, order + 1), order - 1, low, high)
            extreme = value(c, order, middle)
            if extreme * before < 0.0:
                turns[count] = between(c, order, low, middle)
                turns[count + 1] = root(c, order, 0.0, middle, high)
                count += 2
        # exactly 0 at the end of a piece: it is on the other side, or comes back at once
        if after == 0.0:
            after = -before if slope * before < 0.0 else before
        low, before, tilt = high, after, slope
    return count, falls


#: coefficients looked at for the length of a step: by symmetry some may vanish
_TAIL = 5
#: smallest number with all digits
_SMALLEST = float(np.finfo(np.float64).tiny)


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
    #: the end of the run
    STOPS = 4


#: a body between the walls, or one of these at either end: state, which is that at the start of a step or of a free
#: flight, and the time of it, inverse mass, acceleration without contact, the next sample that is not written yet, and
#: the first contact of its component (-1: it coasts)
BODY = np.dtype(
    [(name, "f8") for name in ("x", "v", "t", "inverse", "weight")] + [(name, "i8") for name in ("row", "owner")]
)
#: a contact; number q joins the bodies q and q + 1. ``s``: overlap, of a closed contact at the start of the step of its
#: component, of an open one at the time ``t``, when its bodies had gone ``left_way`` and ``right_way`` since their own
#: times; ``felt``: it begins at an overlap of ``touch`` and not of 0; ``closed``: it is shut and has a force in this
#: step; ``column`` of its forces in the results (-1: no contact); ``stamp`` of its only valid entry in the heap
CONTACT = np.dtype(
    [(name, "f8") for name in ("stiffness", "exponent", "touch", "resting", "s", "t", "left_way", "right_way")]
    + [("shut", "?"), ("felt", "?"), ("closed", "?"), ("deepest", "f8"), ("crossing", "f8")]
    + [("column", "i8"), ("stamp", "i8")],
    align=True,
)
#: the step of a component, which is named after its first contact: times of both ends, r at the end,
#: last contact, contact that sets dt = w dr, what ends it and at which contact, and stamp
COMPONENT = np.dtype(
    [(name, "f8") for name in ("begin", "end", "length")]
    + [(name, "i8") for name in ("last", "near", "event", "which", "stamp")]
)
#: arrays of these
Table = NDArray[np.void]
#: coefficients by quantity, by body, contact or first contact of a component, and by order: clock (w, t), velocity,
#: displacement and acceleration of bodies, overlap, its rate and force of contacts
Series = NDArray[np.float64]
W, T, V, X, G, S, U, F = range(8)


@kernel()
def value_of(series: Series, quantity: int, i: int, r: float) -> float:
    """Return the value of a quantity at ``r``; a view of its coefficients would cost counts of references."""
    order = series.shape[2] - 1
    total = series[quantity, i, order]
    for o in range(order - 1, -1, -1):
        total = total * r + series[quantity, i, o]
    return float(total)


@kernel()
def expand(near: int, first: int, last: int, bodies: Table, contacts: Table, series: Series) -> None:
    """Make all series of a component around the present moment. ``near``: the contact that sets dt = w dr."""
    order = series.shape[2] - 1
    v, x, g, s, u, f = series[V], series[X], series[G], series[S], series[U], series[F]
    w, t, power = series[W, first], series[T, first], np.empty((8, order + 1))
    w[:] = 0.0
    t[0], w[0] = 0.0, np.sqrt(max(contacts[near].s, 0.0))
    folds = round(2.0 * (contacts[near].exponent - 1.0)) - 1
    for i in range(first, last + 2):
        v[i, 0], x[i, 0] = bodies[i].v, bodies[i].x
    for j in range(first, last + 1):
        s[j, 0] = contacts[j].s
    for o in range(order + 1):
        # powers of w: power[q] is w^(q+2), and the first is the overlap; those of w itself up to order o are known
        if folds > 0:
            power[0, o] = s[near, o]
        for q in range(1, folds):
            total = 0.0
            for d in range(o + 1):
                total += power[q - 1, d] * w[o - d]
            power[q, o] = total
        for i in range(first, last + 2):
            g[i, o] = bodies[i].weight if o == 0 else 0.0
        for j in range(first, last + 1):
            u[j, o] = v[j, o] - v[j + 1, o]
            contact = contacts[j]
            if not contact.closed:
                continue
            if j == near:
                f[j, o] = contact.stiffness * (power[folds - 1, o] if folds > 0 else w[o])
            elif o == 0:
                f[j, 0] = contact.stiffness * contact.s ** (contact.exponent - 1.0)
            else:
                total, n = 0.0, contact.exponent
                for d in range(1, o + 1):
                    total += (n * d - o) * s[j, d] * f[j, o - d]
                f[j, o] = total / (o * contact.s)
            g[j, o] -= f[j, o] * bodies[j].inverse
            g[j + 1, o] += f[j, o] * bodies[j + 1].inverse
        if o == order:
            break
        t[o + 1] = w[o] / (o + 1)
        w[o + 1] = 0.5 * u[near, o] / (o + 1)
        for i in range(first, last + 2):
            kick, drift = 0.0, 0.0
            for d in range(o + 1):
                kick += w[d] * g[i, o - d]
                drift += w[d] * v[i, o - d]
            v[i, o + 1], x[i, o + 1] = kick / (o + 1), drift / (o + 1)
        for j in range(first, last + 1):
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
    near: int, first: int, last: int, speed: float, accuracy: float, contacts: Table, series: Series
) -> float:
    """Return the length of a step for which the last coefficients contribute ``accuracy`` of speeds and overlaps."""
    order, v, s, step = series.shape[2] - 1, series[V], series[S], np.inf
    for o in range(order - _TAIL + 1, order + 1):
        # those of a faint contact are 0 because they are smaller than doubles can be
        largest = max(_SMALLEST / speed, _SMALLEST)
        for i in range(first, last + 2):
            largest = max(largest, abs(v[i, o]) / speed)
        for j in range(first, last + 1):
            if contacts[j].closed and j != near:
                largest = max(largest, max(abs(s[j, o]), _SMALLEST) / max(contacts[j].s, contacts[j].touch))
        step = min(step, (accuracy / largest) ** (1.0 / o))
    # a closed contact other than the nearest must stay well away from its own singularity
    for j in range(first, last + 1):
        if contacts[j].closed and j != near:
            for _ in range(80):
                if value_of(series, S, j, step) > 0.1 * contacts[j].s:
                    break
                step *= 0.7
    return step


@kernel()
def nearest_contact(first: int, last: int, bodies: Table, contacts: Table) -> int:
    """Return the contact of a component that is nearest to its opening or closing, and note which have a force."""
    near, least = first, np.inf
    for j in range(first, last + 1):
        rate = bodies[j].v - bodies[j + 1].v
        soon = max(contacts[j].s, 0.0) / abs(rate) if rate != 0.0 else np.inf
        if soon < least:
            near, least = j, soon
    # of contacts that close at the same moment one is the nearest; the others wait until they are felt
    for j in range(first, last + 1):
        contacts[j].closed = j == near or contacts[j].s >= contacts[j].touch
    return near


@kernel()
def next_event(
    near: int, first: int, last: int, length: float, remaining: float, contacts: Table, series: Series, turns: Floats
) -> tuple[float, Event, int]:
    """Return where a step ends, at most at its ``length``, what ends it, and which contact that is.

    ``remaining``: time until it ends at the latest; ``turns``: room for turning points.
    """
    order, w, t, r, event, which = series.shape[2] - 1, series[W, first], series[T, first], length, Event.NONE, -1
    if value(t, order, r) > remaining and value(w, order, r) > 0.0:
        r, event = root(t, order, remaining, 0.0, r), Event.STOPS
    if value(w, order, r) <= 0.0:
        low = 0.0
        if w[0] == 0.0:  # it has just closed: look for the next zero
            low = 1e-3 * r
            while value(w, order, low) <= 0.0 and low > 0.0:
                low *= 0.1
        r, event, which = root(w, order, 0.0, low, r), Event.OPENS, near
        if value(t, order, r) > remaining:
            r, event, which = root(t, order, remaining, 0.0, r), Event.STOPS, -1
    for j in range(first, last + 1):
        if contacts[j].closed:
            continue
        # at rest in touch, and then pressed: force begins where it begins to be felt
        s, u, touch, overlap = series[S, j], series[U, j], contacts[j].touch, contacts[j].s
        level = 0.0 if overlap < 0.0 else touch
        if overlap + swing(s, order, r) <= level:
            continue
        upto = r
        count, falls = turning_points(u, order, r, turns)
        for turn in range(0 if falls else 1, count, 2):
            if value(s, order, turns[turn]) > level:
                upto = turns[turn]  # it may come and go
                break
        if value(s, order, upto) <= level:
            continue
        at = root(s, order, level, 0.0, upto)
        if level == 0.0:
            pull = value_of(series, G, j, at) - value_of(series, G, j + 1, at)
            if is_slow(value(u, order, at), pull, touch):
                level = touch
                if value(s, order, upto) <= level:
                    continue
                at = root(s, order, level, at, upto)
        r, event, which = at, Event.CLOSES if level == 0.0 else Event.FELT, j
    return r, event, which


@kernel()
def note_peaks(first: int, last: int, r: float, begin: float, contacts: Table, series: Series, turns: Floats) -> None:
    """Note the maximal compressions within a step of length ``r`` of a component, which began at a time."""
    order = series.shape[2] - 1
    for j in range(first, last + 1):
        contact = contacts[j]
        if not contact.closed:
            continue
        count, falls = turning_points(series[U, j], order, r, turns)
        for turn in range(0 if falls else 1, count, 2):
            top = turns[turn]
            contact.deepest = max(contact.deepest, value_of(series, S, j, top))
            pull = value_of(series, G, j + 1, top) - value_of(series, G, j, top)
            if np.isnan(contact.crossing) and abs(pull) >= contact.resting:
                contact.crossing = begin + value_of(series, T, first, top)


@kernel()
def is_slow(rate: float, pull: float, touch: float) -> bool:
    """Return whether a contact with this closing rate at an overlap of 0 reaches ``touch`` by its acceleration.

    Without a rate nothing can start at 0, for dt = w dr stands still there. Such a contact starts at ``touch``, where
    its force begins to be felt.
    """
    return rate * rate <= 2.0 * pull * touch
