"""Errors of a run in every registered observable and several norms, as plain numbers for tables.

Users of work-precision studies want every norm stored and any of them plotted (DiffEqDevTools.jl, issues 125 and 128).
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from dem_bridge.observables.errors import REDUCTIONS, Reading, read, reduced, relative_to
from dem_bridge.observables.registry import OBSERVABLES
from dem_bridge.scene import Scene
from dem_bridge.trajectory import Trajectory

NORMS = tuple(REDUCTIONS)
#: (observable, norm) -> number
Norms = dict[tuple[str, str], float]


def readings_of(scene: Scene, reference: Trajectory) -> dict[str, Reading]:
    """Return every registered observable of which the reference has at least one value, by name."""
    readings = {name: read(observable, scene, reference) for name, observable in OBSERVABLES.items()}
    return {name: reading for name, reading in readings.items() if np.any(np.isfinite(reading.values))}


def errors_of(scene: Scene, run: Trajectory, reference: Mapping[str, Reading]) -> Norms:
    """Return the relative errors of a run over all samples, bodies or contacts, at the samples of the reference.

    An error is inf where only one of the two has a value.
    """
    errors = {name: relative_to(reading, read(name, scene, run)) for name, reading in reference.items()}
    return {(name, norm): error.reduced(norm) for name, error in errors.items() for norm in NORMS}


def uncertainties_of(reference: Mapping[str, Reading]) -> Norms:
    """Return the uncertainty of the reference as :func:`errors_of`: the size of an error below it is unknown."""
    errors = {name: relative_to(reading, reading) for name, reading in reference.items()}
    return {(name, norm): reduced(error.uncertainty, norm) for name, error in errors.items() for norm in NORMS}
