"""Families of runs made by hand, whose uncertainty follows without a calculator."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from dem_bridge.runs.uncertainty.fixed_step import DenseReadings, TwinFamily
from dem_bridge.runs.uncertainty.moments import Moments, Reached
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.dense import Schedule
from dem_bridge.trajectory.trajectory import Trajectory
from tests.helpers.fake_runs import free_flight

#: three bodies, two contacts of n = 2: forces are stiffness times overlap
SCENE = Scene(
    name="three", duration=1.0, mass=(2.0, 4.0, 8.0), stiffness=(100.0, 100.0), exponent=2.0, velocity=(1.0, 2.0, 3.0)
)
#: speeds 1, 2, 3 m/s, so displacements up to 3 m; peak forces of 10 and 20 N; crossings at 0.1 and 0.2 s
OWN = free_flight()
#: few steps, so that sums and last digits are far below all else
PLAN = Schedule(step=2.5e-3, per_sample=100, subdivisions=10, samples=4)
#: both contacts are open, 1 m apart, and at rest
FAR = Reached(*(np.full(2, value) for value in (-1.0, 0.0, -1.0, 0.0)))


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


def moment(contact: int, time: float, *, overlap: float = 0.0, rate: float = 0.0, bend: float, **parts: Any) -> Moments:
    """One moment: a contact turns between two open samples, unless ``parts`` say otherwise."""
    numbers = {
        "overlap": overlap,
        "rate": rate,
        "bend": bend,
        "lost": 0.0,
        "speed": 1.0,
        "lasting": time,
        "fastest": 2.0,
    }
    kinds = {"last": False, "touches": True, "felt": False, "stops": False, "fresh": False}
    values = {"contact": contact, "time": time, **numbers, **kinds} | parts
    return Moments(**{name: np.array([value]) for name, value in values.items()})


def there(overlap: float, rate: float = 0.0) -> tuple[Any, Any]:
    """What a run at another step has at one moment."""
    return np.array([overlap]), np.array([rate])


def family(
    *,
    others: Mapping[float, Trajectory] | None = None,
    secondary: tuple[float, float] = (0.0, 0.0),
    thinned: tuple[Any, Any] | None = None,
    unresolved: tuple[bool, bool] = (False, False),
    moments: Moments | None = None,
    elsewhere: Mapping[float, tuple[Any, Any]] | None = None,
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
            drift=np.zeros(2),
            reached=FAR,
            moments=moments,
            elsewhere=elsewhere or {},
        ),
    }
    return TwinFamily(**(parts | changes))
