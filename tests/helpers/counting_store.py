"""A store that counts what a study computes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from dem_bridge.runs.store import Store
from dem_bridge.trajectory.trajectory import Trajectory


class Counting(Store):
    """Count what was computed: every run and every part of a study that is not read from the store is saved."""

    computed = 0

    def save(self, key: str, run: Trajectory) -> bool:
        self.computed += 1
        return super().save(key, run)

    def save_arrays(self, key: str, arrays: Mapping[str, Any]) -> None:
        self.computed += 1
        super().save_arrays(key, arrays)
