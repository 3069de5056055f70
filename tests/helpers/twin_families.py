"""Families of runs made by hand, whose uncertainty follows without a calculator."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from dem_bridge.dense import Approaches, Schedule
from dem_bridge.scene import Scene
from dem_bridge.trajectory import Trajectory
from dem_bridge.uncertainty.family import DenseReadings, TwinFamily
from tests.helpers.fake_runs import free_flight

#: three bodies, two contacts of n = 2: forces are stiffness times overlap
SCENE = Scene(
    name="three", duration=1.0, mass=(2.0, 4.0, 8.0), stiffness=(100.0, 100.0), exponent=2.0, velocity=(1.0, 2.0, 3.0)
)
#: speeds 1, 2, 3 m/s, so displacements up to 3 m; peak forces of 10 and 20 N; crossings at 0.1 and 0.2 s
OWN = free_flight()
#: few steps, so that sums and last digits are far below all else
PLAN = Schedule(step=2.5e-3, per_sample=100, subdivisions=10, samples=4)
NO_TURNS = Approaches(contact=np.zeros(0, dtype=np.int64), time=np.zeros(0), overlap=np.zeros(0), bend=np.zeros(0))


def changed(run: Trajectory = OWN, **differences: Any) -> Trajectory:
    """The run with these numbers added: to one velocity or displacement, or to both contacts."""
    values = {}
    for name, difference in differences.items():
        value = getattr(run, name).copy()
        if value.ndim == 2:
            value[2, 1] += difference
        else:
            value += difference
        values[name] = value
    return replace(run, **values)


def turn(contact: int, time: float, overlap: float, bend: float) -> Approaches:
    """One turn of an open contact."""
    return Approaches(
        contact=np.array([contact]), time=np.array([time]), overlap=np.array([overlap]), bend=np.array([bend])
    )


def family(
    *,
    others: Mapping[float, Trajectory] | None = None,
    secondary: tuple[float, float] = (0.0, 0.0),
    thinned: tuple[Any, Any] | None = None,
    unresolved: tuple[bool, bool] = (False, False),
    turns: Approaches = NO_TURNS,
    elsewhere: Mapping[float, Approaches] | None = None,
    **changes: Any,
) -> TwinFamily:
    """A family whose runs agree in all but what is given."""
    positional = changes.get("positional", OWN)
    same = positional.peak_force, positional.crossing_time
    parts: dict[str, Any] = {
        "scene": SCENE,
        "plan": PLAN,
        "order": 2,
        "main": OWN,
        "others": others or {2.0: OWN, 1.0 / 3.0: OWN},
        "positional": positional,
        "thinning": 0.5,
        "readings": DenseReadings(
            thinned=thinned or same,
            secondary_peak_force=np.array(secondary),
            unresolved=np.array(unresolved),
            turns=turns,
            turns_elsewhere=elsewhere or {},
        ),
    }
    return TwinFamily(**(parts | changes))
