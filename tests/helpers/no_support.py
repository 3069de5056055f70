"""The declaration of a code that solves no scene."""

from __future__ import annotations

from dem_bridge.scene.support import Condition, Support

NOTHING = Support(frozenset(), conditions=(Condition("no scene at all", lambda _: "it is a scene"),))
