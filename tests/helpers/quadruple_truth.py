"""Read the quadruple-precision truth in tests/data as scenes and arrays; no code of this project computed it.

A truth file's samples start at T/500; a Trajectory has the start in addition, so its row i + 1 is the file's row i.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dem_bridge.scene.scene import Scene, Wall
from dem_bridge.trajectory.trajectory import Trajectory

DATA = Path(__file__).parent.parent / "data"

#: what a truth file calls each quantity of a Trajectory
NAMES = {"velocity": "v", "displacement": "x", "peak_force": "F_peak", "crossing_time": "t_cross"}


@dataclass(frozen=True)
class Truth:
    """Hold the arrays of a truth file and the Scene that they solve."""

    data: Mapping[str, NDArray[np.float64]]
    scene: Scene

    @property
    def v0(self) -> float:
        """Return the impact speed, m/s: the scale of velocities."""
        return float(self.data["v0"])

    def error(self, run: Trajectory, quantity: str) -> NDArray[np.float64]:
        """Return |run - truth| in the quantity's unit: the maximum over samples and bodies, or one per contact."""
        truth = self.data[NAMES[quantity]]
        if quantity in ("velocity", "displacement"):
            return np.asarray(np.max(np.abs(getattr(run, quantity)[1:] - truth)))
        return np.asarray(np.abs(getattr(run, quantity) - truth))


def load_truth(name: str) -> Truth:
    """Return the truth file of that name with its raw-form scene."""
    with np.load(DATA / f"{name}.npz") as file:
        data = {key: file[key] for key in file.files}
    bodies = len(data["m"])
    stiffness = tuple(data["beta"].tolist())
    scene = Scene(
        name=name,
        duration=float(data["T"]),
        mass=tuple(data["m"].tolist()),
        stiffness=stiffness[: bodies - 1],
        velocity=(float(data["v0"]), *[0.0] * (bodies - 1)),
        wall_right=Wall(stiffness=stiffness[-1]) if data["wall"] else None,
        samples=len(data["t"]),
    )
    return Truth(data=data, scene=scene)
