"""Error bars: what a run may err by, each part measured apart and with other runs than the one that is judged.

*Time step.* The twin at the run's step, at twice and at a third of it. A second-order error is a third of the first
difference and nine eighths of the second; three times the error is taken, so that the bar holds where the order is not
clean, and the larger of the two, because one of them can be small by chance.

*Round-off.* A code that keeps absolute positions rounds them at every step and subtracts them for every overlap. The
twin can do the same; its difference to the twin in overlap variables is that round-off, with the scene's conditioning
in it. On the paper's chains it predicts LAMMPS' to 1 %; three times it is taken, because it is one realisation.

*Sampling.* Peaks and crossings from every second dense sample beside those from all, see :mod:`dem_bridge.dense`.

*A reference* has no step: its bar is made of runs at another order or tolerance with every input moved by its last
digit.

How often bars hold is measured on 300 random scenes in tests/bench.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from dem_bridge.dense import CROSSING_ERROR, PEAK_ERROR, Schedule
from dem_bridge.trajectory import Trajectory, own_scale

QUANTITIES = ("velocity", "displacement", "peak_force", "crossing_time")
#: no bars at all
UNKNOWN = dict.fromkeys(QUANTITIES, math.inf)
#: 16 units in the last place: what a few thousand steps of a reference may lose whatever its second run says
_LEAST = 16.0 * 2.0**-52
#: one realisation of round-off stands for others up to this factor
REALISATIONS = 3.0
#: bars of the time step are so many times a second-order error: they hold where the order is not clean, too
STEP_SAFETY = 3.0
#: of what every second dense sample changes: by order 7/2 (a neighbour that opens between them) a tenth is lost
THINNING = 0.5


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


def _not_below_the_median(found: NDArray[np.float64], scale: NDArray[np.float64]) -> NDArray[np.float64]:
    """Differences per contact, none smaller, relative to its own ``scale``, than the median: where the error changes
    its sign along the chain two resolutions can agree by chance."""
    relative = found[scale > 0.0] / scale[scale > 0.0]
    return np.maximum(found, scale * float(np.median(relative))) if len(relative) else found


def reference_bars(run: Answer, others: Sequence[Answer], *, factor: float) -> dict[str, Any]:
    """Bars of a reference from runs beside it: their largest difference times ``factor``, none below 16 units in the
    last place, and none of a contact below the median of all, where runs can agree by chance."""
    found = [apart(run, other) for other in others]
    bars: dict[str, Any] = {}
    for name in QUANTITIES:
        scale = np.nan_to_num(np.abs(getattr(run, name)))
        largest = float(np.max(scale, initial=0.0))
        most = np.max([one[name] for one in found], axis=0)
        if name in ("velocity", "displacement"):
            bars[name] = factor * float(most) + _LEAST * largest
        else:
            share = scale if name == "peak_force" else np.ones_like(scale)
            bars[name] = factor * _not_below_the_median(most, share) + _LEAST * largest
    return bars


@dataclass(frozen=True, kw_only=True)
class Twins:
    """Runs of the twin that a fixed-step run gets its bars from."""

    plan: Schedule
    """Steps of the run that is judged, and of ``own`` and ``positional``."""
    own: Answer
    others: Mapping[float, Answer]
    """The same at other steps, by the ratio of their step to that of the plan."""
    positional: Answer
    """As ``own``, in absolute positions."""
    thinned: tuple[NDArray[np.float64], NDArray[np.float64]]
    """Peak forces and crossing times of ``positional`` from every second dense sample."""
    rivals: NDArray[np.float64]
    """Largest force of each contact outside the collision that has its largest, N."""

    def of_step(self) -> dict[str, Any]:
        """Bars for the time step, before contacts are compared with each other."""
        safe = {ratio: STEP_SAFETY / abs(ratio**2 - 1.0) for ratio in self.others}
        found = {ratio: apart(self.own, other) for ratio, other in self.others.items()}
        return {name: np.max([safe[ratio] * one[name] for ratio, one in found.items()], axis=0) for name in QUANTITIES}


def with_bars(run: Trajectory, twins: Twins) -> Trajectory:
    """``run`` with its bars."""
    plan, own = twins.plan, twins.own
    step, rounding = twins.of_step(), apart(own, twins.positional)
    speed = float(np.max(np.abs(own.velocity)))
    # no run is better than a random walk of its last digit
    digit = np.finfo(float).eps * math.sqrt(plan.steps)
    bars: dict[str, NDArray[np.float64] | float] = {}
    for name in QUANTITIES:
        size = np.nan_to_num(np.abs(getattr(own, name)))
        if name in ("velocity", "displacement"):
            bars[name] = float(step[name]) + REALISATIONS * (rounding[name] + digit * float(np.max(size)))
        else:
            # force errors go with the force; a late crossing is late by what all before it were
            share = size if name == "peak_force" else np.ones_like(size)
            bars[name] = _not_below_the_median(step[name], share) + REALISATIONS * (rounding[name] + digit * size)
    # equal increments round alike: a sum may be off by half a unit in the last place for every step
    summation = 0.5 * plan.steps * np.finfo(float).eps
    bars["displacement"] += summation * float(np.max(np.abs(own.displacement)))
    bars["velocity"] += summation * speed
    # forces come as running sums of net forces: an untouched contact may show the last digit of the largest
    bars["peak_force"] += 8.0 * np.finfo(float).eps * float(np.max(own.peak_force, initial=0.0))
    thin_peak, thin_crossing = twins.thinned
    lost = {
        "peak_force": THINNING * np.abs(thin_peak - twins.positional.peak_force),
        "crossing_time": THINNING * np.nan_to_num(np.abs(thin_crossing - twins.positional.crossing_time)),
    }
    bars["peak_force"] += lost["peak_force"] + PEAK_ERROR * own.peak_force
    bars["crossing_time"] += lost["crossing_time"] + CROSSING_ERROR * plan.spacing
    # a share of the velocities is not known, and so of the force of the next largest collision: it may be the largest
    unknown = min(1.0, float(bars["velocity"]) / speed) if speed > 0.0 else 0.0
    bars["peak_force"] += np.maximum(0.0, twins.rivals * (1.0 + unknown) - own.peak_force)
    if not plan.resolved:
        # all twins look too rarely, so their differences say nothing of what lies between the looks
        bars["peak_force"] = bars["crossing_time"] = math.inf
    parts = {
        "time_step": float(step["velocity"]) / speed if speed > 0.0 else 0.0,
        "round_off": float(REALISATIONS * (rounding["velocity"] / speed + digit)) if speed > 0.0 else 0.0,
        "summation": float(summation),
        "last_digit": digit if speed > 0.0 else 0.0,
    }
    # samples are steps: only what lies between them is read off a curve
    sampling = dict.fromkeys(QUANTITIES, 0.0) | {
        name: float(np.max(amount / np.maximum(own_scale(getattr(own, name)), 1e-300), initial=0.0))
        for name, amount in lost.items()
    }
    return replace(run, uncertainty=bars, provenance={**run.provenance, "velocity_bar": parts, "sampling": sampling})
