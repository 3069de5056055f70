"""Errors of a run in several norms, by observable: numbers alone, for tables that keep them all.

Users of work-precision studies want every norm kept and any of them plotted (DiffEqDevTools.jl, issues 125 and 128).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from dem_bridge.observables.front import arrival_by_crossing, residence_bar, residence_by_crossing
from dem_bridge.scene import Scene
from dem_bridge.trajectory import Trajectory, own_scale

Floats = NDArray[np.float64]

#: observable -> its scale, in words
OBSERVABLES: Mapping[str, str] = MappingProxyType(
    {
        "velocity": "the largest velocity",
        "displacement": "the largest displacement",
        "peak_force": "each contact's own peak force",
        "arrival_time": "each body's own arrival",
        "residence_time": "each body's own residence time",
    }
)
_OF_NORM: Mapping[str, Callable[[Floats], float]] = MappingProxyType(
    {
        "max": lambda e: float(np.max(e, initial=0.0)),
        "rms": lambda e: float(np.sqrt(np.mean(e**2))) if e.size else 0.0,
        "mean": lambda e: float(np.mean(e)) if e.size else 0.0,
    }
)
NORMS = tuple(_OF_NORM)


def errors_of(scene: Scene, run: Trajectory, truth: Trajectory) -> dict[tuple[str, str], float]:
    """(observable, norm) -> difference to ``truth``, relative; over all samples and bodies, or over all contacts.

    The scale is that of :mod:`dem_bridge.differences`: of ``velocity`` and ``displacement`` the largest in ``truth``,
    of the others each contact's or body's own value, or a thousandth of the largest. The norm "max" is its ``value``.
    inf: only one of the two has a value. Both must have the same samples.
    """
    found: dict[tuple[str, str], float] = {}
    for name in OBSERVABLES:
        mine, true = _values(scene, run, name), _values(scene, truth, name)
        apart = np.abs(mine - true)
        apart = np.where(np.isnan(mine) & np.isnan(true), 0.0, np.where(np.isnan(apart), np.inf, apart))
        found |= _normed(name, apart, true)
    return found


def bars_of(scene: Scene, truth: Trajectory) -> dict[tuple[str, str], float]:
    """What ``truth`` itself may err by, as :func:`errors_of`: errors below it are not known."""
    found: dict[tuple[str, str], float] = {}
    for name in OBSERVABLES:
        true = _values(scene, truth, name)
        if name == "residence_time":
            bar = residence_bar(scene, truth)
        elif name == "arrival_time":
            bar = np.asarray(truth.uncertainty["crossing_time"])[: scene.n_body - 1]
        else:
            bar = np.asarray(truth.uncertainty[name])
        # what has no value in the reference has no bar either
        found |= _normed(name, np.where(np.isnan(true), 0.0, np.broadcast_to(bar, true.shape)), true)
    return found


def _values(scene: Scene, run: Trajectory, name: str) -> Floats:
    if name == "arrival_time":
        return arrival_by_crossing(scene, run)
    if name == "residence_time":
        return residence_by_crossing(scene, run)
    return np.asarray(getattr(run, name))


def _normed(name: str, size: Floats, true: Floats) -> dict[tuple[str, str], float]:
    sampled = name in ("velocity", "displacement")
    scale = np.broadcast_to(np.max(np.abs(true), initial=0.0) if sampled else own_scale(true), size.shape)
    # nothing over nothing is no error
    relative = np.divide(size, scale, out=np.where(size > 0.0, np.inf, 0.0), where=scale > 0.0)
    return {(name, norm): of(relative) for norm, of in _OF_NORM.items()}
