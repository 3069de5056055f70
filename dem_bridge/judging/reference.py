"""The reference solution at the times of a file, with its uncertainty."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from dem_bridge.backends.base import Resolution, Sampling, backend, unsupported_reason
from dem_bridge.errors import UnsupportedScene, UsageError
from dem_bridge.observables.traces import contact_force_uncertainty
from dem_bridge.runs.cache import RunCache
from dem_bridge.runs.case import Case
from dem_bridge.runs.uncertainty.estimate import solve
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import Floats

#: quantities of a file that can be judged, with their units
UNITS: Mapping[str, str] = MappingProxyType({"velocity": "m/s", "displacement": "m", "contact_force": "N"})


@dataclass(frozen=True, kw_only=True, eq=False)
class ReferenceSamples:
    """The reference solution at given times, see :func:`reference_at`."""

    time: Floats
    """Times, s, ``(n_t,)``."""
    values: Mapping[str, Floats]
    """"velocity" and "displacement", ``(n_t, n_body)``, and "contact_force", ``(n_t, n_contact)``; SI."""
    uncertainty: Mapping[str, float]
    """Largest error of each quantity over all samples, in its unit."""
    bounds: Mapping[str, Floats]
    """Largest error of each quantity at each sample: that of forces is large where a damped contact closes."""
    largest: Mapping[str, float]
    """Largest magnitude of each quantity over all bodies or contacts and times: the scale of errors."""


def reference_at(scene: Scene, time: Floats) -> ReferenceSamples:
    """Solve the reference at given times, which need not be even nor end with the scene.

    Parameters
    ----------
    scene : Scene
        Any scene that the backend "reference" supports. Its duration and number of samples are not used.
    time : ndarray, shape (n_t,)
        Times from 0 on, s, increasing.

    Raises
    ------
    UsageError
        If times are negative, do not increase or are not finite, or if none is later than 0.
    UnsupportedScene
        If the backend "reference" does not support the scene.

    Examples
    --------
    >>> scene = Scene(name="pair", duration=1e-4, mass=(8e-3, 1e-2), stiffness=(4e9,), velocity=(0.8, 0.0))
    >>> samples = reference_at(scene, np.array([1e-6, 5e-5, 3e-4]))
    >>> samples.values["velocity"].shape, samples.uncertainty["velocity"] < 1e-12
    ((3, 2), True)
    """
    time = np.asarray(time, dtype=np.float64)
    if not (time.ndim == 1 and np.all(np.isfinite(time)) and np.all(np.diff(time) > 0.0)):
        raise UsageError("the times of the samples do not increase or are not finite; give increasing times (s)")
    if not len(time) or time[0] < 0.0 or time[-1] <= 0.0:
        first, last = (time[0], time[-1]) if len(time) else (np.nan, np.nan)
        raise UsageError(
            f"the samples go from {first:.6g} to {last:.6g} s; allowed: from the start of the scene, 0 s, to any later"
            " time"
        )
    if reason := unsupported_reason(backend("reference"), scene):
        raise UnsupportedScene(f"there is no reference solution of {scene.name}, so nothing can be judged: {reason}")
    instants = time if time[0] == 0.0 else np.concatenate([[0.0], time])
    scene = replace(scene, duration=float(time[-1]))
    sampling = Sampling(given=tuple(instants.tolist()))
    run = solve(Case(scene=scene, backend="reference", resolution=Resolution(), sampling=sampling), RunCache())
    rows = slice(len(instants) - len(time), None)
    values = {name: getattr(run, name)[rows] for name in UNITS}
    largest = {name: run.uncertainty[name] for name in ("velocity", "displacement")}
    bounds = {name: np.broadcast_to(bound, values[name].shape) for name, bound in largest.items()}
    bounds["contact_force"] = contact_force_uncertainty(scene, run)[rows]
    return ReferenceSamples(
        time=time,
        values=values,
        uncertainty={name: float(np.max(bound, initial=0.0)) for name, bound in bounds.items()},
        bounds=bounds,
        largest={name: float(np.max(np.abs(array), initial=0.0)) for name, array in values.items()},
    )
