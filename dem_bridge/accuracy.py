"""Plain numbers in, plain numbers out: the observed order of convergence, and what an accuracy may be.

Knows nothing of scenes or backends. The order is fitted on log(dt), with its sign and its residual, because
a mean of log2 ratios hides both (Roache 1998, *Verification and Validation in Computational Science and
Engineering*, ch. 5).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from dem_bridge.errors import UsageError


@dataclass(frozen=True)
class ObservedOrder:
    """Result of :func:`observed_order`."""

    order: float
    """Slope of log(error) on log(dt); negative where refinement makes things worse."""
    residual: float
    """Largest distance of a point from the line, as a factor minus one (0.05 = 5 %)."""
    points: int
    """Points used: those above the round-off floor."""


def observed_order(dt: Sequence[float], error: Sequence[float], *, floor: float = 0.0) -> ObservedOrder:
    """Least-squares order of ``error ~ dt**order`` over the points with ``error > floor``.

    Parameters: ``dt`` in s, all > 0; ``error`` in any one unit; ``floor``: errors at or below it are round-off
    and left out. Fewer than two usable points give ``nan``: an order that cannot be had is not invented.

    >>> fit = observed_order([4e-8, 2e-8, 1e-8], [1.6e-5, 4e-6, 1e-6])
    >>> round(fit.order, 12), fit.points
    (2.0, 3)
    >>> round(observed_order([9e-8, 3e-8, 1e-8], [1.0, 9.0, 81.0]).order, 12)
    -2.0
    """
    pairs = [(math.log(h), math.log(e)) for h, e in zip(dt, error, strict=True) if math.isfinite(e) and e > floor]
    n = len(pairs)
    if n < 2:
        return ObservedOrder(math.nan, math.nan, n)
    mean_x = sum(x for x, _ in pairs) / n
    mean_y = sum(y for _, y in pairs) / n
    spread = sum((x - mean_x) ** 2 for x, _ in pairs)
    if spread == 0.0:
        return ObservedOrder(math.nan, math.nan, n)
    slope = sum((x - mean_x) * (y - mean_y) for x, y in pairs) / spread
    residual = max(abs(y - mean_y - slope * (x - mean_x)) for x, y in pairs)
    return ObservedOrder(slope, math.expm1(residual), n)


def checked_accuracy(accuracy: object) -> float:
    """``accuracy`` as a float; UsageError, in one line, where it is none.

    >>> checked_accuracy(1e-6)
    1e-06
    """
    if isinstance(accuracy, bool) or not isinstance(accuracy, int | float) or not 0.0 < accuracy < 1.0:
        raise UsageError(f"accuracy = {accuracy!r}; allowed: a number between 0 and 1, as 1e-6")
    return float(accuracy)
