"""Choose the reference of a scene, and the second method by which the reference itself is checked.

The reference is the Taylor series in 80-bit numbers where these have the laws of the scene. Elsewhere the backend
"reference" answers through scipy, and the second method is that of Blanes & Moan, as far as it has the laws.
"""

from __future__ import annotations

from typing import NamedTuple

from dem_bridge.backends.base import Resolution, Sampling, supports_of
from dem_bridge.backends.blanes_moan import PHASE
from dem_bridge.backends.reference import SERIES
from dem_bridge.backends.scene_prescan import prescan_scene
from dem_bridge.backends.steps import default_step
from dem_bridge.scene.scene import Scene

REFERENCE, SCIPY, BLANES_MOAN = "reference", "scipy", "blanes-moan"
#: as a second reference, the method of Blanes & Moan takes steps that are finer than its default by this factor
FACTOR_OF_SECOND_REFERENCE = 8
#: uncertainty of scipy, relative to the largest velocity, where it was not estimated: its maximum over the shipped
#: scenes
SCIPY_UNCERTAINTY = 2e-10


class References(NamedTuple):
    """The backends that solve a scene to the accuracy of a reference."""

    solver: str
    """The backend that solves for the reference: "reference", or "scipy" where the Taylor series do not fit."""
    second: str | None
    """A backend of another method than the solver's; None: no other backend solves the scene to that accuracy."""


def choose_references(scene: Scene) -> References:
    """Choose the reference of a scene and the second method.

    >>> from dem_bridge.scene.file import load_scene
    >>> choose_references(load_scene("decelerating-40"))
    References(solver='reference', second='scipy')
    """
    if SERIES.covers(scene):
        return References(REFERENCE, SCIPY)
    return References(SCIPY, BLANES_MOAN if supports_of(BLANES_MOAN).covers(scene) else None)


def second_settings(scene: Scene, second: str, sampling: Sampling) -> Resolution:
    """Return the settings of the second method: scipy has its own, and that of Blanes & Moan takes fine steps."""
    if second == SCIPY:
        return Resolution()
    return Resolution(dt=default_step(scene, sampling, prescan_scene(scene), PHASE) / FACTOR_OF_SECOND_REFERENCE)
