"""LAMMPS' dump read as a run: in the order of the scene's contacts and bodies, and checked.

Positions, velocities and net forces are LAMMPS' own. Contact forces are the running sum of the net forces along the
chain, so a wrong coefficient in a deck shows in them.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dem_bridge.backends.steps import Dense
from dem_bridge.errors import RunBroken
from dem_bridge.foundation import progress
from dem_bridge.lmp.coefficients import line_order
from dem_bridge.lmp.deck import DUMP_COLUMNS, Deck
from dem_bridge.lmp.engine import Engine
from dem_bridge.lmp.known_defects import defects_of
from dem_bridge.lmp.process import EngineReport
from dem_bridge.scene.scene import Scene


def checked_values(deck: Deck, steps: NDArray[np.int64], values: NDArray[np.float64]) -> None:
    """Raise RunBroken unless the dump has the frames and atoms of the deck, finite and with small enough overlaps."""
    expected = deck.schedule.dense_steps
    if not np.array_equal(steps, expected) or values.shape[1] != len(deck.line):
        raise RunBroken(
            f"LAMMPS dumped {len(steps)} frames of {values.shape[1]} atoms;"
            f" the deck asks for {len(expected)} of {len(deck.line)}"
        )
    if not np.all(np.isfinite(values)):
        first = int(np.argwhere(~np.isfinite(values).all(axis=(1, 2)))[0, 0])
        raise RunBroken(f"LAMMPS ended without an error, but from step {steps[first]} on its values are not finite")
    check_gauge(values[:, :, DUMP_COLUMNS.index("x")], deck, steps)


def dense_of(scene: Scene, deck: Deck, steps: NDArray[np.int64], values: NDArray[np.float64]) -> Dense:
    """Return the dump in the order of the scene's contacts and bodies."""
    position, velocity, net = (values[:, :, DUMP_COLUMNS.index(name)] for name in ("x", "vx", "fx"))
    columns = np.argsort(line_order(scene))
    outer = deck.weight
    if scene.drag > 0.0:
        # forces are those of the half step's velocity, which is not dumped
        half = velocity - np.where(steps > 0, 0.5 * deck.schedule.step, 0.0)[:, None] * net * deck.mobility
        mass = np.divide(1.0, deck.mobility, out=np.zeros_like(deck.mobility), where=deck.mobility > 0.0)
        outer = deck.weight - scene.drag * mass * half
    if scene.drive is not None:
        outer = np.array(np.broadcast_to(outer, net.shape))
        outer[:, deck.first_id - 1] += scene.drive.at(steps * deck.schedule.step)
    bodies = slice(deck.first_id - 1, deck.first_id - 1 + scene.n_body)

    def at_rest_beside(moving: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.pad(moving[:, bodies], ((0, 0), (0, 1)))

    return Dense(
        velocity=at_rest_beside(velocity),
        displacement=at_rest_beside(position - deck.line),
        # a frozen wall has net force but no acceleration
        acceleration=at_rest_beside(net * deck.mobility),
        overlap=(deck.reach - np.diff(position, axis=1))[:, columns],
        force=np.cumsum(outer - net, axis=1)[:, columns],
        farthest=float(np.max(np.abs(position))),
    )


def check_gauge(position: NDArray[np.float64], deck: Deck, steps: NDArray[np.int64]) -> None:
    """Raise RunBroken if bodies that are not neighbours touch, or may have touched between two samples.

    They may have where an overlap exceeds the surrogate radius.
    """
    if position.shape[1] < 2:
        return
    radii = deck.radii
    smaller = np.minimum(radii[:-1], radii[1:])
    beyond = np.max(deck.reach - smaller - np.diff(position, axis=1), axis=0)
    worst = int(np.argmax(beyond))
    excess = f"an overlap of {beyond[worst] + smaller[worst]:.6g} m exceeds the gauge radius {smaller[worst]:.6g} m"
    across = position[:, 2:] - position[:, :-2] - (radii[2:] + radii[:-2])
    if np.min(across, initial=math.inf) < 0.0:
        row, atom = np.unravel_index(np.argmin(across), across.shape)
        raise RunBroken(
            f"{excess}, and atoms {atom + 1} and {atom + 3}, which are not neighbours, overlap by"
            f" {-float(across[row, atom]):.6g} m at step {steps[row]}; give a larger surrogate_radius"
        )
    if beyond[worst] > 0.0:
        raise RunBroken(f"{excess}: bodies that are not neighbours may have touched; give a larger surrogate_radius")


def dump_progress(path: Path, deck: Deck) -> Callable[[], None]:
    """Return a function that reports the share of the dump that is written."""
    whole = dump_size(deck)

    def watch() -> None:
        if path.exists():
            progress.report(path.stat().st_size / whole)

    return watch


def dump_size(deck: Deck) -> int:
    """Return the number of bytes that a run of the deck writes, roughly."""
    frame = 8 * len(DUMP_COLUMNS) * len(deck.line) + 200  # values and, roughly, a frame's header
    return frame * len(deck.schedule.dense_steps)


def engine_certificate(engine: Engine, report: EngineReport, bodies: int, deck: Deck) -> dict[str, Any]:
    """Return the provenance of the engine: which LAMMPS ran, how, and the known defects that the deck met."""
    defects = defects_of(report.version, deck.files[deck.input_file])
    note = "; ".join(filter(None, (engine.note(bodies), *map(str, defects))))
    return {
        "version": report.version,
        "packages": list(report.packages),
        "build": list(report.build),
        "run_by": engine.label,
        "ranks": report.ranks,
        **({"known_defects": [defect.name for defect in defects]} if defects else {}),
        **({"note": note} if note else {}),
    }
