"""Error of integrators with adaptive steps against their tolerance, with contact events located and not located."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from dem_bridge.backends.base import Resolution, Sampling
from dem_bridge.backends.ode45 import Ode45
from dem_bridge.backends.reference import Reference
from dem_bridge.backends.scales import natural_scales
from dem_bridge.backends.scipy_dop853 import ScipyDop853
from dem_bridge.errors import RunBroken
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import Floats

TOLERANCES = tuple(10.0**-k for k in range(3, 14))
#: absolute over relative tolerance of ode45, m and m/s
ATOL_PER_RTOL = 1e-3


@dataclass(frozen=True, kw_only=True)
class Row:
    """One run of one integrator."""

    name: str
    """Key of its texts: an integrator of :data:`INTEGRATORS`."""
    tolerance: float
    error: float
    """Largest velocity error of all samples and bodies, over the largest velocity."""
    evaluations: float
    """Of all contact forces; for a Taylor series, the orders computed."""


def _taylor(scene: Scene, sampling: Sampling, tolerance: float) -> tuple[Floats, int]:
    run = Reference().solve_series(scene, sampling, accuracy=tolerance)
    return run.velocity, run.cost.force_evaluations


def _located(scene: Scene, sampling: Sampling, tolerance: float) -> tuple[Floats, int]:
    run = ScipyDop853(largest_rtol=1.0).run(scene, Resolution(rtol=tolerance), sampling)
    return run.velocity, run.cost.force_evaluations


def _ode45(scene: Scene, sampling: Sampling, tolerance: float) -> tuple[Floats, int]:
    run = Ode45().run(scene, Resolution(rtol=tolerance, atol=ATOL_PER_RTOL * tolerance), sampling)
    return run.velocity, run.cost.force_evaluations


def _unlocated(scene: Scene, sampling: Sampling, tolerance: float) -> tuple[Floats, int]:
    """Return a run of scipy's DOP853 that steps across openings and closings; variables and scales as in `scipy`."""
    from scipy.integrate import solve_ivp

    from dem_bridge.backends.scipy_integration import ATOL_SHARE

    c, n, inverse = scene.contacts, scene.n_body, 1.0 / np.append(scene.mass, np.inf)
    free, power = np.append(scene.free_acceleration, 0.0), c.exponent - 1.0
    speed, depth = natural_scales(scene)

    def slope(t: float, y: Floats) -> Floats:
        force, velocity = c.stiffness * np.maximum(y[:-n], 0.0) ** power, np.append(y[-n:], 0.0)
        acceleration = free.copy()
        np.subtract.at(acceleration, c.left, force * inverse[c.left])
        np.add.at(acceleration, c.right, force * inverse[c.right])
        return np.concatenate([velocity[c.left] - velocity[c.right], acceleration[:n]])

    start = np.concatenate([-c.gap, scene.velocity])
    absolute = np.maximum(ATOL_SHARE * tolerance * np.concatenate([depth, np.full(n, speed)]), 1e-300)
    times = sampling.times(scene.duration)
    run = solve_ivp(slope, (0.0, scene.duration), start, method="DOP853", rtol=tolerance, atol=absolute, t_eval=times)
    if not run.success:
        raise RunBroken(f"DOP853 on {scene.name}: {run.message}")
    return run.y[-n:].T, run.nfev


#: name -> run; the first two locate openings and closings
INTEGRATORS = {"taylor": _taylor, "located": _located, "unlocated": _unlocated, "ode45": _ode45}


def tolerance_rows(scene: Scene, sampling: Sampling, exact: Floats) -> Iterator[Row]:
    """Yield the errors of every integrator at every tolerance; ``exact``: velocities of the reference."""
    scale = float(np.max(np.abs(exact)))
    for name, run in INTEGRATORS.items():
        for tolerance in TOLERANCES:
            velocity, evaluations = run(scene, sampling, tolerance)
            error = float(np.max(np.abs(velocity - exact))) / scale
            yield Row(name=name, tolerance=tolerance, error=error, evaluations=float(evaluations))
