"""The extremes by name."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache

from dem_bridge.studies.extremes.entry import Entry, checked
from dem_bridge.studies.extremes.of_numerics import steps, tables
from dem_bridge.studies.extremes.of_scales import angles, exponents, ratios, sizes, speeds, symmetries
from dem_bridge.studies.extremes.of_touch import gaps, nothing, presses, touches

PARTS = (
    *(speeds, angles, ratios, sizes, exponents, symmetries),
    *(touches, gaps, presses, nothing),
    *(tables, steps),
)


@cache
def catalogue() -> Mapping[str, Entry]:
    """Return all entries by name; the state from which one of them runs backwards is computed by the reference."""
    return checked([entry for part in PARTS for entry in part()])
