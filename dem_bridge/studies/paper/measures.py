"""Numbers of one run with uncertainties that follow from those of the run.

A measure is a function of a scene and a trajectory. Registered observables have an uncertainty (:func:`at_body`). For
other numbers it is estimated by perturbing parts of the trajectory within their uncertainties: crossing times and peak
forces one at a time, and the changes are added, which is the largest change to first order; velocities, which have one
uncertainty for all samples, with random signs, three times.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from dem_bridge.errors import DemBridgeError
from dem_bridge.observables.differences import SAMPLED
from dem_bridge.observables.registry import Reader, observable_named
from dem_bridge.observables.verdict import Outcome
from dem_bridge.report.study import ClaimValue
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import Floats, Trajectory

#: theories, whose numbers have no uncertainty
THEORIES = ("bca", "adiabatic")
#: number of random perturbations of all velocities
MOVES = 3


@dataclass(frozen=True, kw_only=True)
class Measure:
    """Define a number that is read off a run: ``of(scene, trajectory)`` in ``unit``."""

    name: str
    of: Callable[[Scene, Trajectory], float]
    unit: str = ""
    made_of: tuple[str, ...] = ("crossing_time",)
    """Parts of the trajectory that are perturbed: "crossing_time", "peak_force", "velocity"."""
    uncertainty: Callable[[Scene, Trajectory], float] | None = None
    """Function for the uncertainty, in place of perturbations."""


def at_body(observable: str, body: int | None, name: str) -> Measure:
    """Return a registered observable at one body, or of the whole chain (None), with its uncertainty."""
    registered = observable_named(observable)

    def reader(read: Reader) -> Callable[[Scene, Trajectory], float]:
        return lambda scene, run: float(read(scene, run) if body is None else read(scene, run)[body])

    value, uncertainty = reader(registered.value), reader(registered.uncertainty)
    return Measure(name=name, of=value, unit=registered.unit, uncertainty=uncertainty)


def measured(measure: Measure, scene: Scene, run: Trajectory, backend: str) -> ClaimValue:
    """Return the number with its uncertainty; nan where the run does not have it.

    The uncertainty is nan for a theory, and inf where no estimate exists.
    """
    try:
        value = float(measure.of(scene, run))
    except (DemBridgeError, ValueError):  # for example, the wave reached too few contacts
        value = float("nan")
    uncertainty = float("nan")
    if backend not in THEORIES and np.isfinite(value):
        try:
            uncertainty = _uncertainty(measure, scene, run, value)
        except (DemBridgeError, ValueError):  # the perturbed run cannot be measured
            uncertainty = float("inf")
        uncertainty = uncertainty if np.isfinite(uncertainty) else float("inf")
    return ClaimValue(name=measure.name, backend=backend, value=value, uncertainty=uncertainty, unit=measure.unit)


def _uncertainty(measure: Measure, scene: Scene, run: Trajectory, value: float) -> float:
    if measure.uncertainty is not None:
        return float(measure.uncertainty(scene, run))
    total = 0.0
    for part in ("crossing_time", "peak_force"):
        if part in measure.made_of:
            total += sum(_moves(measure, scene, run, part, value))
    if "velocity" in measure.made_of:
        if not np.isfinite(run.uncertainty["velocity"]):
            return float("inf")
        moved = [measure.of(scene, perturbed) for perturbed in _with_moved_velocities(run)]
        total += float(np.max(np.abs(np.array(moved) - value)))
    return total


@lru_cache(maxsize=8)  # several measures are read off the runs of one scene
def _with_moved_velocities(run: Trajectory) -> tuple[Trajectory, ...]:
    """Return the run with all velocities changed by their uncertainty, with random signs, :data:`MOVES` times."""
    size, chance = run.uncertainty["velocity"], np.random.default_rng(1)
    moved = (run.velocity + size * _signs(chance, run.velocity.shape) for _ in range(MOVES))
    return tuple(replace(run, velocity=velocity) for velocity in moved)


def _moves(measure: Measure, scene: Scene, run: Trajectory, part: str, value: float) -> list[float]:
    uncertainties, values = run.uncertainty[part], getattr(run, part)
    if not np.all(np.isfinite(uncertainties[np.isfinite(values)])):
        return [float("inf")]
    if "velocity" not in measure.made_of:  # samples are not read, and need not be copied for every perturbation
        run = replace(run, **{name: getattr(run, name)[:1] for name in ("time", *SAMPLED)})
    results = []
    for k in np.flatnonzero(np.isfinite(values)):
        # a minimum or a maximum may change in one direction only
        moved = []
        for away in (uncertainties[k], -uncertainties[k]):
            shifted = values.copy()
            shifted[k] += away
            moved.append(abs(float(measure.of(scene, replace(run, **{part: shifted}))) - value))
        results.append(max(moved))
    return results


def _signs(chance: np.random.Generator, shape: tuple[int, ...]) -> Floats:
    return np.asarray(chance.choice((-1.0, 1.0), size=shape))


def inside(claim_value: ClaimValue, low: float, high: float) -> Outcome:
    """Judge whether a value lies between ``low`` and ``high`` within its uncertainty.

    PASS and FAIL need the whole interval of the value and its uncertainty to be inside or outside. An uncertainty of
    nan counts as zero (a formula or a theory has none); one of inf gives UNDECIDED.

    >>> one = ClaimValue(name="ratio", backend="reference", value=0.4, uncertainty=0.01)
    >>> [inside(one, *range_).value for range_ in ((0.3, 0.5), (0.5, 1.0), (0.395, 1.0))]
    ['PASS', 'FAIL', 'UNDECIDED']
    """
    uncertainty = 0.0 if np.isnan(claim_value.uncertainty) else claim_value.uncertainty
    if not np.isfinite(claim_value.value):
        return Outcome.UNDECIDED
    if low <= claim_value.value - uncertainty and claim_value.value + uncertainty <= high:
        return Outcome.PASS
    if claim_value.value + uncertainty < low or claim_value.value - uncertainty > high:
        return Outcome.FAIL
    return Outcome.UNDECIDED
