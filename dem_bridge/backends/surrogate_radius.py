"""The radius of the bodies of a code that keeps positions.

Only overlaps enter the equations, so the radius in a deck is arbitrary: a small power of two minimises round-off.
"""

from __future__ import annotations

import math

import numpy as np

from dem_bridge.backends.base import Resolution
from dem_bridge.backends.prescan import Prescan
from dem_bridge.errors import UsageError
from dem_bridge.scene.scene import Scene

#: surrogate radius over the largest overlap, at least
SURROGATE_MARGIN = 1.25


def surrogate_radius(peak_overlap: float) -> float:
    """Radius for a deck, m: the next power of two above 1.25 times the largest overlap (m).

    Neighbours of neighbours then never touch, and the round-off floor follows the scene's own scale.

    >>> surrogate_radius(16e-6) == 2.0**-15
    True
    """
    if not (math.isfinite(peak_overlap) and peak_overlap >= 0.0):
        raise ValueError(f"peak overlap = {peak_overlap!r} m; allowed: finite, >= 0")
    if peak_overlap == 0.0:
        return 2.0**-15  # nothing touches: any radius serves
    return 2.0 ** (math.floor(math.log2(SURROGATE_MARGIN * peak_overlap)) + 1)


def radius_after(prescan: Prescan) -> float:
    """Return the surrogate radius of a scene, m, by the largest overlap in its prescan."""
    return surrogate_radius(float(np.max(prescan.peak_overlap, initial=0.0)))


def radius_of(scene: Scene, resolution: Resolution, prescan: Prescan) -> float:
    """Return the radius of the bodies of a code that keeps positions, m: a given one, or that of the geometry."""
    if resolution.surrogate_radius is not None:
        return resolution.surrogate_radius
    if resolution.geometry == "surrogate":
        return radius_after(prescan)
    if scene.spacing is None:
        raise UsageError(
            f"geometry = 'physical' on {scene.name}, which has no spacing of its bodies; allowed: 'surrogate', a"
            " surrogate_radius, or a scene in physical form"
        )
    return 0.5 * scene.spacing
