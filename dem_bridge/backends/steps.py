"""The steps of a fixed-step run, alike for LAMMPS, the twin and ASE: they fall on the samples, and on each other.

And what twin and ASE read off them, alike as well, so that it drops out of their difference.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dem_bridge.backends.base import Named, Resolution, Sampling, run_provenance
from dem_bridge.backends.prescan import Prescan
from dem_bridge.backends.scales import resting_acceleration
from dem_bridge.errors import RunBroken
from dem_bridge.foundation.stopwatch import Stopwatch
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.dense import Schedule, damped_peaks, extremes, schedule
from dem_bridge.trajectory.trajectory import Cost, Floats, Trajectory

#: default step: the next of the 1-2-5 series below this fraction of 1/omega of the stiffest contact
DEFAULT_PHASE = 2.5e-3


def order_on(scene: Scene) -> int:
    """Return the order of velocity-Verlet: 1 where forces jump, or depend on velocities, known at half steps only."""
    return 1 if scene.dissipates or scene.adhesive else 2


def round_step(dt: float) -> float:
    """Return the largest of 1, 2, 5 times a power of ten that is at most ``dt`` (up to round-off).

    >>> round_step(1.3e-8), round_step(9.9e-9), round_step(1e-8)
    (1e-08, 5e-09, 1e-08)
    """
    power = math.floor(math.log10(dt))
    series = [float(f"{digit}e{decade}") for decade in (power - 1, power, power + 1) for digit in (1, 2, 5)]
    return max(step for step in series if step <= dt * (1.0 + 1e-12))


def default_step(scene: Scene, sampling: Sampling, prescan: Prescan, phase: float = DEFAULT_PHASE) -> float:
    """Return the step of a run for which none is given, s; ``phase``: part of 1/omega of the stiffest contact."""
    if prescan.frequency > 0.0:
        return round_step(phase / prescan.frequency)
    return scene.duration / sampling.equal_steps


def fixed_step_plan(
    scene: Scene, resolution: Resolution, sampling: Sampling, prescan: Prescan, phase: float = DEFAULT_PHASE
) -> Schedule:
    """Return the steps of a fixed-step run, the same for LAMMPS and twin; ``phase``: as in :func:`default_step`."""
    dt = resolution.dt if resolution.dt is not None else default_step(scene, sampling, prescan, phase)
    return schedule(
        duration=scene.duration, samples=sampling.equal_steps, dt=dt, frequency=prescan.frequency, bodies=scene.n_body
    )


def check_finite(code: Named, scene: Scene, plan: Schedule, velocity: Floats) -> None:
    """Raise RunBroken if velocities are not finite."""
    if not np.all(np.isfinite(velocity)):
        raise RunBroken(
            f"{code.name} on {scene.name}: velocities are not finite; dt = {plan.step:g} s is beyond stability"
        )


class Dense(NamedTuple):
    """A run at its dense samples.

    Arrays are ``(n_dense, n_body + 1)``, the last column the walls, at rest; overlap and force ``(n_dense,
    n_contact)``.
    """

    velocity: Floats
    displacement: Floats
    acceleration: Floats
    overlap: Floats
    force: Floats
    farthest: float = 0.0
    """m: the largest coordinate that the run subtracts from another for its overlaps; 0: none beyond displacements."""

    @property
    def overlap_in_flight(self) -> float:
        """Overlap, m, that is no collision, see :func:`touching_in_flight`."""
        way = float(np.max(self.displacement)), -float(np.min(self.displacement))
        return touching_in_flight(max(self.farthest, *way))


def approach_of(scene: Scene, plan: Schedule, dense: Dense, every: int = 1) -> dict[str, NDArray[Any]]:
    """Return time, overlap, closing rate and closing acceleration of the contacts at one in ``every`` dense samples."""
    c, links = scene.contacts, len(scene.stiffness)

    def closing(motion: Floats) -> Floats:
        of_chain = motion[:, :links] - motion[:, 1 : links + 1]  # three times sooner than by the indices of all bodies
        at_walls = motion[:, c.left[links:]] - motion[:, c.right[links:]]
        return np.hstack((of_chain, at_walls)) if at_walls.size else of_chain

    return {
        "time": plan.dense_steps[::every] * plan.step,
        "overlap": dense.overlap[::every],
        "rate": closing(dense.velocity[::every]),
        "acceleration": closing(dense.acceleration[::every]),
    }


def touching_in_flight(farthest: float) -> float:
    """Return the overlap, m, that is no collision: bodies that fly in touch overlap by the last digit of their way."""
    return 4.0 * math.ulp(farthest)


def peaks_and_crossings(scene: Scene, plan: Schedule, dense: Dense, every: int = 1) -> tuple[Floats, Floats]:
    """Return peak forces and crossing times from one in ``every`` dense samples."""
    c = scene.contacts
    seen = {**approach_of(scene, plan, dense, every), "force": dense.force[::every]}
    peak_force, crossing = extremes(
        **seen,
        exponent=c.exponent,
        resting=resting_acceleration(scene),
        laws=c if scene.law is not None or scene.adhesive else None,
        resolution=dense.overlap_in_flight,
    )
    if scene.damped:
        peak_force = np.where(c.damping > 0.0, damped_peaks(**seen, contacts=c), peak_force)
    return peak_force, crossing


def read_off(
    code: Named,
    scene: Scene,
    plan: Schedule,
    dense: Dense,
    settings: Mapping[str, Any],
    *,
    watch: Stopwatch,
    evaluations: int,
    peaks: Callable[[], tuple[Floats, Floats]] | None = None,
    provenance: Mapping[str, Any] = MappingProxyType({}),
    child_cpu: float = 0.0,
) -> Trajectory:
    """Return the trajectory of a run of ``code``, which began with ``watch``; ``dense`` may be the samples alone.

    ``peaks`` returns peak forces and crossing times; None: read off the dense samples. ``provenance``: more than all
    codes have; ``child_cpu``: CPU time of a child process, s. Raises RunBroken where velocities are not finite.
    """
    check_finite(code, scene, plan, dense.velocity)
    peak_force, crossing = peaks() if peaks is not None else peaks_and_crossings(scene, plan, dense)
    keep = slice(None, None, (len(dense.velocity) - 1) // plan.samples)
    return Trajectory(
        time=Sampling(count=plan.samples).times(scene.duration),
        displacement=dense.displacement[keep, :-1],
        velocity=dense.velocity[keep, :-1],
        contact_force=dense.force[keep],
        peak_force=peak_force,
        crossing_time=crossing,
        cost=Cost.since(watch, steps=plan.steps, force_evaluations=evaluations, child_cpu=child_cpu),
        provenance={**run_provenance(code, scene, settings), **provenance},
    )
