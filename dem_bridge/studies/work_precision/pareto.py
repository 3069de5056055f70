"""Cost against error: which settings no other beats in both, and the cheapest that is good enough."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from typing import TypeVar

Setting = TypeVar("Setting")


def front(cost: Sequence[float], error: Sequence[float]) -> list[int]:
    """Places of the points that no other beats, by rising cost and falling error; those that are no numbers are none.

    A point is beaten by another with at most its cost and less error, or with less cost and at most its error.

    >>> front([1.0, 2.0, 3.0, 2.5, float("nan")], [0.1, 0.3, 0.01, 0.01, 0.0])
    [0, 3]
    """
    results: list[int] = []
    real = (at for at in range(len(cost)) if math.isfinite(cost[at]) and math.isfinite(error[at]))
    for at in sorted(real, key=lambda at: (cost[at], error[at])):
        if not results or error[at] < error[results[-1]]:
            results.append(at)
    return results


def cheapest(
    settings: Iterable[Setting],
    target: float,
    *,
    cost: Callable[[Setting], float],
    error: Callable[[Setting], float],
) -> Setting | None:
    """Return the cheapest setting with an error of at most ``target``; None where there is none.

    >>> cheapest([(1.0, 0.1), (3.0, 0.001), (2.0, 0.01)], 0.02, cost=lambda s: s[0], error=lambda s: s[1])
    (2.0, 0.01)
    """
    enough = [setting for setting in settings if error(setting) <= target and math.isfinite(cost(setting))]
    return min(enough, key=cost, default=None)
