"""Error bars of fixed-step runs: time step and round-off, each measured apart with twins.

Nothing is taken from the run that is judged: a wrong LAMMPS run must not widen its own bar.

*Time step.* The twin at the run's step and at another; their difference over ratio - 1, which bounds the error for any
observed order from 1 up and does not trust the order to be 2.

*Round-off.* A code that keeps absolute positions rounds them at every step and subtracts them for every overlap. The
twin can do the same; its difference to the twin in overlap variables is that round-off, with the scene's conditioning
in it. On the paper's chains it predicts LAMMPS' to 1 %; three times it is taken, because it is one realisation.

*Sampling.* What the estimator of peaks and crossings may err by, see :mod:`dem_bridge.dense`.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from dem_bridge.dense import CROSSING_ERROR, PEAK_ERROR, Schedule
from dem_bridge.trajectory import Trajectory

QUANTITIES = ("velocity", "displacement", "peak_force", "crossing_time")
#: no bars at all
UNKNOWN = dict.fromkeys(QUANTITIES, math.inf)
#: 16 units in the last place: what a few thousand steps of a reference may lose whatever its second run says
_LEAST = 16.0 * 2.0**-52
#: one realisation of round-off stands for others up to this factor
REALISATIONS = 3.0


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


def reference_bars(run: Answer, other: Answer, *, factor: float) -> dict[str, Any]:
    """Bars of a reference from a second run: their difference times ``factor``, none below 16 units in the last place,
    and none of a contact below the median of all, where two runs can agree by chance."""
    found = apart(run, other)
    bars: dict[str, Any] = {}
    for name in QUANTITIES:
        scale = np.nan_to_num(np.abs(getattr(run, name)))
        largest = float(np.max(scale, initial=0.0))
        if name in ("velocity", "displacement"):
            bars[name] = factor * found[name] + _LEAST * largest
        else:
            own_scale = scale if name == "peak_force" else np.ones_like(scale)
            bars[name] = factor * _not_below_the_median(found[name], own_scale) + _LEAST * largest
    return bars


def with_bars(
    run: Trajectory, *, plan: Schedule, own: Trajectory, other: Trajectory, ratio: float, positional: Trajectory
) -> Trajectory:
    """``run`` with its bars.

    ``plan``: the steps of ``run``; ``own``: the twin on them; ``other``: at ``ratio`` times the step (below 1: finer);
    ``positional``: as ``own``, in absolute positions.
    """
    step, rounding = apart(own, other), apart(own, positional)
    # no run is better than a random walk of its last digit
    digit = np.finfo(float).eps * math.sqrt(plan.steps)
    bars: dict[str, NDArray[np.float64] | float] = {}
    for name in QUANTITIES:
        scale = np.nan_to_num(np.abs(getattr(own, name)))
        if name in ("velocity", "displacement"):
            scale, of_step = float(np.max(scale)), step[name]
        else:
            # force errors go with the force; a late crossing is late by what all before it were
            own_scale = scale if name == "peak_force" else np.ones_like(scale)
            of_step = _not_below_the_median(step[name], own_scale)
        bars[name] = of_step / abs(ratio - 1.0) + REALISATIONS * (rounding[name] + digit * scale)
    # equal increments round alike: a sum may be off by half a unit in the last place for every step
    summation = 0.5 * plan.steps * np.finfo(float).eps
    bars["displacement"] += summation * float(np.max(np.abs(own.displacement)))
    bars["velocity"] += summation * float(np.max(np.abs(own.velocity)))
    # forces come as running sums of net forces: an untouched contact may show the last digit of the largest
    bars["peak_force"] += 8.0 * np.finfo(float).eps * float(np.max(own.peak_force, initial=0.0))
    bars["peak_force"] += PEAK_ERROR * np.nan_to_num(own.peak_force)
    bars["crossing_time"] += CROSSING_ERROR * plan.spacing
    if not plan.resolved:
        # all twins look too rarely, so their differences say nothing of what lies between the looks
        bars["peak_force"] = bars["crossing_time"] = math.inf
    speed = float(np.max(np.abs(own.velocity)))
    parts = {
        "time_step": float(step["velocity"] / abs(ratio - 1.0) / speed) if speed > 0.0 else 0.0,
        "round_off": float(REALISATIONS * (rounding["velocity"] / speed + digit)) if speed > 0.0 else 0.0,
        "summation": float(summation),
        "last_digit": digit if speed > 0.0 else 0.0,
    }
    return replace(run, uncertainty=bars, provenance={**run.provenance, "velocity_bar": parts})
