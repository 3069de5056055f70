"""Error bars: how two runs are compared for them, and the bars of references.

A reference has no step: its bar is made of runs at another order or tolerance with every input moved by its last digit.
Bars of fixed-step runs: :mod:`.twin_bars`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from dem_bridge.trajectory import QUANTITIES

#: 16 units in the last place: what a few thousand steps of a reference may lose whatever its second run says
_LEAST = 16.0 * 2.0**-52


class Answer(Protocol):
    """What two runs are compared by: a Trajectory, or a run that will become one."""

    @property
    def velocity(self) -> NDArray[np.float64]: ...
    @property
    def displacement(self) -> NDArray[np.float64]: ...
    @property
    def peak_force(self) -> NDArray[np.float64]: ...
    @property
    def crossing_time(self) -> NDArray[np.float64]: ...


def apart(one: Answer, other: Answer) -> dict[str, Any]:
    """Absolute difference of each quantity: max-norm for the sampled ones, per contact for the others.

    A crossing that one run has and the other has not leaves nothing to say (inf); one that neither has is agreed (0).
    """
    found: dict[str, Any] = {}
    for name in QUANTITIES:
        a, b = getattr(one, name), getattr(other, name)
        distance = np.abs(a - b)
        if name in ("velocity", "displacement"):
            found[name] = float(np.max(distance))
        else:
            lonely = np.where(np.isnan(distance), np.inf, distance)
            found[name] = np.where(np.isnan(a) & np.isnan(b), 0.0, lonely)
    return found


def not_below_the_median(found: NDArray[np.float64], scale: NDArray[np.float64]) -> NDArray[np.float64]:
    """Differences per contact, none smaller, relative to its own ``scale``, than the median: where the error changes
    its sign along the chain two resolutions can agree by chance."""
    relative = found[scale > 0.0] / scale[scale > 0.0]
    return np.maximum(found, scale * float(np.median(relative))) if len(relative) else found


def reference_bars(run: Answer, others: Sequence[Answer], *, factor: float, duration: float) -> dict[str, Any]:
    """Bars of a reference from runs beside it: their largest difference times ``factor``.

    None is below 16 units in the last place (of the ``duration``, s, for times), no peak force is better known than the
    median of all, where runs can agree by chance, and no crossing better than those before it, whose errors it has.
    """
    found = [apart(run, other) for other in others]
    bars: dict[str, Any] = {}
    for name in QUANTITIES:
        scale = np.nan_to_num(np.abs(getattr(run, name)))
        most = factor * np.max([one[name] for one in found], axis=0)
        largest = duration if name == "crossing_time" else float(np.max(scale, initial=0.0))
        if name == "peak_force":
            most = not_below_the_median(most, scale)
        elif name == "crossing_time":
            order = np.argsort(run.crossing_time, kind="stable")  # nan last: never
            known = np.where(np.isfinite(most), most, 0.0)
            most[order] = np.maximum(most[order], np.maximum.accumulate(known[order]))
        bars[name] = most + _LEAST * largest
    return bars
