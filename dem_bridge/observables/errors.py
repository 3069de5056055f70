"""Relative differences between two runs in any observable: in a window, by place, and reduced to one number.

A place is a sample, body or contact. Where neither run has a value there is no difference, and the place does not
count; where only one has, they are infinitely far apart.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from dem_bridge.errors import UsageError
from dem_bridge.observables.observable import ALL as ALL
from dem_bridge.observables.observable import Observable
from dem_bridge.observables.observable import Reading as Reading
from dem_bridge.observables.observable import Window as Window
from dem_bridge.observables.registry import observable_named
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.relative import relative_size
from dem_bridge.trajectory.trajectory import Floats, Trajectory


def read(observable: Observable | str, scene: Scene, run: Trajectory, window: Window = ALL) -> Reading:
    """Return an observable of a run inside a window."""
    if isinstance(observable, str):
        observable = observable_named(observable)
    return observable.read(scene, run, window)


@dataclass(frozen=True, kw_only=True, eq=False)
class RelativeError:
    """Hold the differences of a run from a reference, relative to the scale of the reference, one for each place."""

    values: Floats
    """With their sign; nan where neither run has a value, inf where only one has."""
    uncertainty: Floats
    """Of the run; nan where it has no value."""
    reference_uncertainty: Floats
    """Of the reference; nan where it has no value."""

    @property
    def worst(self) -> tuple[int, ...] | None:
        """Return the place of the largest magnitude; None where no run has any value."""
        size = np.where(np.isnan(self.values), -1.0, np.abs(self.values))
        if not np.any(size >= 0.0):
            return None
        return tuple(int(index) for index in np.unravel_index(int(np.argmax(size)), size.shape))

    def reduced(self, reduce: str = "max") -> float:
        """Return one number of all places, by one of :data:`REDUCTIONS`; nan where no run has any value."""
        return reduced(self.values, reduce)


#: name -> norm of magnitudes
REDUCTIONS: Mapping[str, Callable[[Floats], float]] = MappingProxyType(
    {
        "max": lambda size: float(np.max(size)),
        "rms": lambda size: float(np.sqrt(np.mean(size**2))),
        "mean": lambda size: float(np.mean(size)),
    }
)


def reduced(values: Floats, reduce: str = "max") -> float:
    """Return the norm of the magnitudes of values that are not nan; nan where all are."""
    sizes = np.abs(values[~np.isnan(values)])
    return REDUCTIONS[reduce](sizes) if sizes.size else math.nan


def relative_to(reference: Reading, reading: Reading) -> RelativeError:
    """Return the differences of a reading from that of the reference, relative to the scale of the reference.

    UsageError where the two have different numbers of samples, bodies or contacts.
    """
    if reading.values.shape != reference.values.shape:
        raise UsageError(
            f"{reference.observable.name} of runs with {reading.values.shape} and {reference.values.shape} values along"
            f" {', '.join(reference.observable.axis)}; allowed: two runs of one scene at the same samples"
        )
    missing = np.isnan(reading.values), np.isnan(reference.values)
    with np.errstate(invalid="ignore"):
        apart = reading.values - reference.values
    apart = np.where(np.isnan(apart), math.inf, apart)
    # samples always have a value: one that is not a number is no agreement
    agreed = missing[0] & missing[1] & ("time" not in reference.observable.axis)
    return RelativeError(
        values=np.where(agreed, np.nan, relative_size(apart, reference.scale)),
        uncertainty=relative_size(reading.uncertainty, reference.scale),
        reference_uncertainty=relative_size(reference.uncertainty, reference.scale),
    )


def relative_error(
    observable: Observable | str,
    scene: Scene,
    run: Trajectory,
    reference: Trajectory,
    window: Window = ALL,
    reduce: str = "max",
) -> float:
    """Return how far a run is from a reference in one observable, relative to the scale of the observable.

    Parameters
    ----------
    observable : Observable or str
        One of :data:`~dem_bridge.observables.registry.OBSERVABLES`, by its name.
    scene : Scene
        Of both runs.
    run, reference : Trajectory
        At the same samples.
    window : Window
        The part of both runs that counts.
    reduce : str
        "max", "rms" or "mean" of the magnitudes at all samples, bodies or contacts.

    Returns
    -------
    float
        nan where neither run has a value of the observable, inf where only one has.

    Examples
    --------
    >>> import dem_bridge as db
    >>> scene = db.load_scene("decelerating-40")
    >>> theory, reference = (db.solve(scene, backend=name, samples=2) for name in ("bca", "reference"))
    >>> f"{relative_error('arrival_at_end', scene, theory, reference):.3f}"
    '0.023'

    """
    readings = (read(observable, scene, item, window) for item in (reference, run))
    return relative_to(*readings).reduced(reduce)


def relative_uncertainty(
    observable: Observable | str, scene: Scene, run: Trajectory, window: Window = ALL, reduce: str = "max"
) -> float:
    """Return the estimated numerical error of a run in one observable, relative as :func:`relative_error` has it."""
    reading = read(observable, scene, run, window)
    return reduced(relative_to(reading, reading).uncertainty, reduce)
