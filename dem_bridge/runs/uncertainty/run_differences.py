"""Differences between two runs of one scene, in the unit of each quantity."""

from __future__ import annotations

from typing import Any

import numpy as np

from dem_bridge.trajectory.trajectory import QUANTITIES, SAMPLED, Floats, Trajectory


def absolute_differences(run: Trajectory, other: Trajectory) -> dict[str, Any]:
    """Return the largest difference of velocity and displacement, and one difference per contact of the others.

    A crossing that only one of the runs has differs by inf; one that neither has, by 0.
    """
    differences: dict[str, Any] = {}
    for name in QUANTITIES:
        a, b = getattr(run, name), getattr(other, name)
        with np.errstate(invalid="ignore"):  # of two forces beyond doubles
            distance = np.abs(a - b)
        if name in SAMPLED:
            differences[name] = float(np.max(distance))
        else:
            unmatched = np.where(np.isnan(distance), np.inf, distance)
            differences[name] = np.where(np.isnan(a) & np.isnan(b), 0.0, unmatched)
    return differences


def at_least_the_median(values: Floats, scale: Floats) -> Floats:
    """Return differences per contact, none smaller, relative to its ``scale``, than the median of all.

    Where the error changes its sign along the chain, two resolutions can agree by chance. What has a scale of 0 is no
    part of the median, and stays as it is.

    >>> at_least_the_median(np.array([0.0, 2.0, 3.0]), np.array([1.0, 1.0, 1.0])).tolist()
    [2.0, 2.0, 3.0]
    >>> at_least_the_median(np.array([0.0, np.inf]), np.array([0.0, 1.0])).tolist()
    [0.0, inf]
    """
    counts = scale > 0.0
    result = values.copy()
    if np.any(counts):
        result[counts] = np.maximum(values[counts], scale[counts] * float(np.median(values[counts] / scale[counts])))
    return result
