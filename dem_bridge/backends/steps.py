"""The steps of a fixed-step run, alike for LAMMPS, the twin and ASE: they fall on the samples, and on each other."""

from __future__ import annotations

import math

from dem_bridge.backends.base import Resolution, Sampling
from dem_bridge.backends.survey import Survey
from dem_bridge.dense import Schedule, schedule
from dem_bridge.scene import Scene

#: default step: the next of the 1-2-5 series below this fraction of 1/omega of the stiffest contact
DEFAULT_PHASE = 2.5e-3


def round_step(dt: float) -> float:
    """The largest of 1, 2, 5 times a power of ten that is at most ``dt`` (up to round-off).

    >>> round_step(1.3e-8), round_step(9.9e-9), round_step(1e-8)
    (1e-08, 5e-09, 1e-08)
    """
    power = math.floor(math.log10(dt))
    series = [float(f"{digit}e{decade}") for decade in (power - 1, power, power + 1) for digit in (1, 2, 5)]
    return max(step for step in series if step <= dt * (1.0 + 1e-12))


def default_step(scene: Scene, sampling: Sampling, look: Survey) -> float:
    """Step of a fixed-step run that was asked for none, s."""
    if look.frequency > 0.0:
        return round_step(DEFAULT_PHASE / look.frequency)
    return scene.duration / sampling.count


def fixed_step_plan(scene: Scene, resolution: Resolution, sampling: Sampling, look: Survey) -> Schedule:
    """The steps of a fixed-step run, the same for LAMMPS and twin."""
    dt = resolution.dt if resolution.dt is not None else default_step(scene, sampling, look)
    return schedule(
        duration=scene.duration, samples=sampling.count, dt=dt, frequency=look.frequency, bodies=scene.n_body
    )
