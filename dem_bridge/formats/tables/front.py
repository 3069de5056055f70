"""Tabulate the registered observables along the chain, a row for each body."""

from __future__ import annotations

import numpy as np

from dem_bridge.formats.tables.parameters import origin
from dem_bridge.formats.tables.table import Column, Table, column, with_uncertainty
from dem_bridge.observables.errors import Reading, read
from dem_bridge.observables.registry import OBSERVABLES
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import Floats, Trajectory

#: at the body behind its contact a crossing time is the arrival
SAME_AS_ARRIVAL = "crossing_time"


def observables(scene: Scene, run: Trajectory) -> Table:
    """Return the table of all registered observables of a run.

    Observables with one value for each body have a column, and those with one for each contact of the chain, at the
    body on its far side. Observables of the whole chain, and the largest magnitudes of sampled ones, stand in notes.
    """
    columns: list[Column] = [column("body", "body", range(scene.n_body), kind="count")]
    definitions, numbers = [], []
    for name, observable in OBSERVABLES.items():
        reading = read(observable, scene, run)
        if observable.axis not in (("body",), ("contact",)):
            numbers.append(_sentence(reading))
        elif name != SAME_AS_ARRIVAL:
            values, uncertainty = (_at_bodies(scene, reading, part) for part in (reading.values, reading.uncertainty))
            columns += with_uncertainty(name, observable.words, observable.unit, values, uncertainty)
            definitions.append(f"{observable.words}: {observable.definition.removesuffix('.')}")
    notes = [f"the run is by {run.provenance['backend']}", *definitions]
    notes.append("values of contacts stand at the body on the far side of the contact; empty uncertainties are unknown")
    if scene.spacing is None:
        notes.append("the scene has no spacing: the speed of the front is known in bodies per second only")
    return Table(
        id="observables",
        title=f"Observables along {scene.name}",
        columns=tuple(columns),
        notes=(*notes, *numbers),
        provenance=origin(scene, run),
    )


def _at_bodies(scene: Scene, reading: Reading, values: Floats) -> Floats:
    """Return one value for each body; nan where it has none."""
    if reading.observable.axis == ("body",):
        return values
    return np.concatenate([[np.nan], values[: scene.n_body - 1]])


def _sentence(reading: Reading) -> str:
    """Return the value of the whole chain, or the largest magnitude at samples, with its uncertainty."""
    observable, size = reading.observable, np.abs(reading.values)
    sampled = "largest magnitude at samples, " if "time" in observable.axis else ""
    if not np.any(np.isfinite(size)):
        return f"{observable.words}: unknown"
    place = int(np.nanargmax(size))
    value = float((size if sampled else reading.values).flat[place])
    uncertainty = float(reading.uncertainty.flat[place])
    available = (
        f"uncertainty {uncertainty:.1e} {observable.unit}" if np.isfinite(uncertainty) else "unknown uncertainty"
    )
    return f"{observable.words}: {sampled}{value:.6g} {observable.unit} ({available})"
