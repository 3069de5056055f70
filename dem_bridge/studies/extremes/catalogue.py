"""The extremes by name."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import cache

from dem_bridge.studies.extremes import of_numerics, of_scales, of_touch
from dem_bridge.studies.extremes.entry import Entry, checked

PARTS: tuple[Callable[[], Iterator[Entry]], ...] = (
    of_scales.speeds,
    of_scales.angles,
    of_scales.ratios,
    of_scales.sizes,
    of_scales.exponents,
    of_scales.symmetries,
    of_touch.touches,
    of_touch.gaps,
    of_touch.presses,
    of_touch.nothing,
    of_numerics.tables,
    of_numerics.steps,
)


@cache
def catalogue() -> Mapping[str, Entry]:
    """All entries by name; one of them asks the reference for the state from which it runs backwards."""
    return checked([entry for part in PARTS for entry in part()])
