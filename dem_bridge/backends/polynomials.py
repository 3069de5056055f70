"""Values, roots and turning points of polynomials, compiled: what :mod:`.taylor` reads off its series.

Coefficients ``c[0..order]``, lowest first. Compiled callers keep what they were compiled with: after a change here
their cache (``__pycache__``) is out of date.
"""

from __future__ import annotations

import numpy as np

from dem_bridge.foundation.compiled import Floats, kernel

#: pieces of a step that are looked at for a turning point of their own; the first is halved so many times where the
#: closing rate is exactly 0 at the start: what it does then may be round-off, and a turning point follow at once
PIECES, HALVINGS = 8, 20
MOST_TURNS = 2 * (PIECES + HALVINGS)


@kernel()
def value(c: Floats, order: int, r: float) -> float:
    """Return the value of the polynomial at ``t``."""
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
