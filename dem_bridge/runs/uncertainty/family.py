"""A family of runs with common settings, as data: the runs, and what is read off their dense samples."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from dem_bridge.runs.uncertainty.moments import Moments, Reached
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.dense import Schedule
from dem_bridge.trajectory.trajectory import FREE, Cost, Floats, Trajectory


@dataclass(frozen=True, kw_only=True, eq=False)
class DenseReadings:
    """Numbers read off the dense samples of a run, between those that its trajectory keeps."""

    thinned: tuple[Floats, Floats]
    """Peak forces (N) and crossing times (s) from every second dense sample."""
    secondary_peak_force: Floats
    """Largest force of each contact outside the collision that has its largest, N."""
    unresolved: NDArray[np.bool_]
    """Contacts whose first compression is briefer than the step."""
    drift: Floats
    """Overlap, m, that round-off may give to each contact whose bodies fly in touch; 0 for all others."""
    reached: Reached
    """How far each contact was closed, at most and at the end."""
    moments: Moments | None = None
    """Moments that errors of the size of the uncertainty could decide otherwise; None: there are none."""
    elsewhere: Mapping[float, tuple[Floats, Floats]] = field(default_factory=dict)
    """Overlaps (m) and closing rates (m/s) of the runs at other steps at these moments, by the ratio of their step."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TwinFamily:
    """Runs of one method from which the uncertainty of a run with the same settings follows."""

    scene: Scene
    plan: Schedule
    """Steps of ``main``, ``positional``, ``tabled`` and ``halved``."""
    order: int
    main: Trajectory
    """The run in overlap variables, with the laws themselves."""
    others: Mapping[float, Trajectory]
    """The same at a coarser and a finer step, by the ratio of their step to that of the plan."""
    positional: Trajectory
    """As ``main``, in absolute positions; with the tables if there are any, for these are looked up by a distance."""
    tabled: Trajectory | None = None
    """As ``main``, with tables; None: the code has the laws themselves."""
    halved: Trajectory | None = None
    """As ``main``, with laws that are functions from half as many cells; None: the laws are powers."""
    readings: DenseReadings
    """Of ``positional``."""
    thinning: float
    """Part of the change by thinning that counts."""
    scatter: float = 0.0
    """Factor of the difference between the ``others`` that counts as an error of the time step, too."""
    cost: Cost = FREE
    """Cost of all runs of the family."""

    @property
    def speed(self) -> float:
        """Largest velocity, m/s."""
        return float(np.max(np.abs(self.main.velocity)))
