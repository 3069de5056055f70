"""Register an observable for a while, and provide one that the package does not have."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from dem_bridge.observables import registry
from dem_bridge.observables.observable import LARGEST, Observable
from dem_bridge.observables.registry import register

#: the mean of the velocities of all bodies
MEAN_VELOCITY = Observable(
    name="mean_velocity",
    definition="Mean velocity of all bodies at each sample.",
    unit="m/s",
    axis=("time",),
    value=lambda scene, run: np.mean(run.velocity, axis=1),
    uncertainty=lambda scene, run: np.full(len(run.time), run.uncertainty["velocity"]),
    scale=LARGEST,
)


@contextmanager
def registered(observable: Observable) -> Iterator[Observable]:
    """Register an observable, and remove it at the end."""
    try:
        yield register(observable)
    finally:
        del registry._REGISTRY[observable.name]
