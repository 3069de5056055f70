"""Tabulate the energy ledger of a run, a row for each contact."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from dem_bridge.formats.tables.parameters import origin
from dem_bridge.formats.tables.table import Table, column, with_uncertainty
from dem_bridge.observables.ledger import Ledger, energy_ledger
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import Trajectory


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
    of_ledger, scale = float(entries.kinetic[-1]), max(float(entries.kinetic.max()), np.finfo(float).tiny)
    difference = abs(kinetic - of_ledger) / scale
    yield f"kinetic energy at the end by LAMMPS (thermo ke) {kinetic:.9g} J; difference {difference:.1e} of the largest"
    stored = float(entries.stored[-1].sum())
    comment = f"the contacts store {stored:.9g} J" if potential else "granular styles report none, and no dissipation"
    yield f"potential energy at the end by LAMMPS (thermo pe) {potential:.9g} J: {comment}"
