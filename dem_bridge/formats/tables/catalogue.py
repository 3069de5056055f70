"""The tables by name, with the settings that each accepts, and those of a run: observables and the energy ledger."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from types import MappingProxyType

import numpy as np

from dem_bridge.errors import UsageError
from dem_bridge.formats.tables.angles import angles, stiffness_curve
from dem_bridge.formats.tables.constants.table import constants
from dem_bridge.formats.tables.parameters import bodies, contacts, origin, pair_coeffs
from dem_bridge.formats.tables.table import Column, Table, column, with_uncertainty
from dem_bridge.observables.differences import Reading, read
from dem_bridge.observables.ledger import Ledger, energy_ledger
from dem_bridge.observables.registry import OBSERVABLES
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.relative import relative_size
from dem_bridge.trajectory.trajectory import Floats, Trajectory


def ledger(scene: Scene, run: Trajectory) -> Table:
    """Return the table of the energy that each contact stores and dissipates; the rest of the ledger is in notes."""
    entries, ends = energy_ledger(scene, run), np.array([0, -1])
    start, end = (float(value) for value in entries.kinetic[ends])
    notes = [
        f"the run is by {run.provenance['backend']}",
        f"kinetic energy at the start {start:.9g} J, at the end {end:.9g} J",
        f"potential energy of weight and loads at the end {entries.potential[-1]:.9g} J (0 at the start)",
        f"work of the drive {entries.work[-1]:.9g} J; dissipated by drag {entries.drag[-1]:.9g} J; walls do no work",
        f"balance: the sum of all entries changes by {np.max(np.abs(entries.balance)):.2g} J at most",
    ]
    notes += _engine_notes(entries, run)
    dissipated = with_uncertainty(
        "dissipated", "dissipated until the end", "J", entries.dissipated[-1], entries.dissipated_uncertainty
    )
    return Table(
        id="energy-ledger",
        title=f"Energy of the contacts of {scene.name}",
        columns=(
            column("contact", "contact", range(scene.n_contact), kind="count"),
            column("most_stored", "most stored at samples", entries.stored.max(axis=0), unit="J"),
            column("stored", "stored at the end", entries.stored[-1], unit="J"),
            *dissipated,
        ),
        notes=tuple(notes),
        provenance=origin(scene, run),
    )


def _engine_notes(entries: Ledger, run: Trajectory) -> Iterator[str]:
    """Yield the energies that LAMMPS itself reports at the end of its run, beside those of the ledger."""
    reported = run.provenance.get("energies")
    if not reported:
        return
    _, potential, kinetic = reported[-1]
    of_ledger = float(entries.kinetic[-1])
    difference = relative_size(abs(kinetic - of_ledger), float(entries.kinetic.max()))
    yield f"kinetic energy at the end by LAMMPS (thermo ke) {kinetic:.9g} J; difference {difference:.1e} of the largest"
    stored = float(entries.stored[-1].sum())
    comment = f"the contacts store {stored:.9g} J" if potential else "granular styles report none, and no dissipation"
    yield f"potential energy at the end by LAMMPS (thermo pe) {potential:.9g} J: {comment}"


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


_DECK = ("geometry", "types", "surrogate_radius")
_CYLINDERS = ("radius", "youngs_modulus", "poissons_ratio")
#: by table name the function, True if it needs a run (None if it shows none), and the settings; the function is
#: f(scene, run, **settings) for tables with results of a run, and f(scene, **settings) for others
TABLES: Mapping[str, tuple[Callable[..., Table], bool | None, tuple[str, ...]]] = MappingProxyType(
    {
        "contacts": (contacts, False, _DECK),
        "pair-coeffs": (pair_coeffs, None, _DECK),
        "bodies": (bodies, None, _DECK),
        "observables": (observables, True, ()),
        "energy-ledger": (ledger, True, ()),
        "stiffness-curve": (stiffness_curve, None, ("angles", *_CYLINDERS)),
        "angles": (angles, None, ("law", *_CYLINDERS, "within")),
        "constants": (constants, None, ()),
    }
)
#: tables of no scene; their function takes none
WITHOUT_SCENE = ("constants",)


def table_named(name: str) -> tuple[Callable[..., Table], bool | None, tuple[str, ...]]:
    """Return the entry of :data:`TABLES`; raise UsageError with the allowed names if the name is unknown."""
    if name not in TABLES:
        raise UsageError(f"table = {name!r} is unknown; allowed: {', '.join(TABLES)}")
    return TABLES[name]
