"""LAMMPS, the code under test: a deck is written, run in a child process and its dump read back and checked.

Positions, velocities and net forces are LAMMPS' own. Contact forces are the running sum of the net forces along the
chain, so a wrong coefficient in a deck shows in them.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dem_bridge.backends.base import Availability, Resolution, Sampling, unsupported_reason
from dem_bridge.backends.prescan import Prescan
from dem_bridge.backends.roundoff import roundoff_floor
from dem_bridge.backends.scene_prescan import prescan_scene
from dem_bridge.backends.steps import Dense, fixed_step_plan, read_off
from dem_bridge.backends.surrogate_radius import radius_of
from dem_bridge.backends.tabled import measured, predicted_energy_error, predicted_error, tables_for
from dem_bridge.errors import BackendUnavailable, RunBroken, UnsupportedScene, UsageError
from dem_bridge.foundation import progress
from dem_bridge.foundation.stopwatch import Stopwatch
from dem_bridge.lmp.binary_dump import read_binary_dump
from dem_bridge.lmp.deck import DUMP_COLUMNS, Deck, deck_of, positions
from dem_bridge.lmp.engine import Engine
from dem_bridge.lmp.known_defects import defects_of
from dem_bridge.lmp.pair_coefficients import GRANULAR_STYLE, TABLE_STYLE, TableSet, line_order
from dem_bridge.lmp.process import EngineReport, check_room, load_engine, require, run_deck, workspace
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import Trajectory


@dataclass(frozen=True, kw_only=True)
class Written:
    """A deck, and the tables in it where it has any."""

    deck: Deck
    tables: TableSet | None = None


class LammpsGranular:
    """LAMMPS with ``pair_style granular`` and ``fix nve``."""

    name = "lammps-granular"
    equations = "hertz"
    order: int | None = 2
    supports = GRANULAR_STYLE
    #: what the engine must have
    styles: tuple[str, ...] = ("pair granular",)
    #: makes the tables of a deck; None: it has none
    tables_of: Callable[[Scene, Resolution, Prescan], TableSet] | None = None

    def __init__(self, engine: Engine | None = None) -> None:
        self.engine = engine or Engine.chosen()

    def availability(self) -> Availability:
        """Return whether the engine starts and has the pair style."""
        try:
            require(self.engine, *self.styles)
        except BackendUnavailable as error:
            return Availability(False, str(error))
        return Availability(True)

    def run(self, scene: Scene, resolution: Resolution, sampling: Sampling) -> Trajectory:
        """Write the deck, run it and read its dump."""
        return self._run(
            scene, lambda: self.written(scene, resolution, sampling, prescan_scene(scene)), resolution.time_limit
        )

    def run_written(self, scene: Scene, written: Written, *, time_limit: float) -> Trajectory:
        """Return the run of a deck of the scene."""
        return self._run(scene, lambda: written, time_limit)

    def _run(self, scene: Scene, write: Callable[[], Written], time_limit: float) -> Trajectory:
        """Return the run of the deck that ``write`` returns, which it makes while the engine loads."""
        watch = Stopwatch()
        with workspace() as folder:
            load_engine(self.engine)
            written = write()
            deck, plan = written.deck, written.deck.schedule
            check_room(folder, dump_size(deck))
            for file, text in deck.files.items():
                (folder / file).write_text(text, encoding="utf-8")
            # the dump grows evenly with the steps: its size tells how far the run is
            monitor = dump_progress(folder / deck.dump_file, deck) if progress.has_listener() else None
            try:
                report = run_deck(folder, deck.input_file, time_limit=time_limit, watch=monitor, engine=self.engine)
            except RunBroken as error:
                raise explained(error, scene, plan.step) from error
            dumps = [
                read_binary_dump(folder / file, columns=len(DUMP_COLUMNS))
                for file in (deck.dump_file, *deck.more_dumps)
            ]
        steps, values = dumps[0] if len(dumps) == 1 else (np.concatenate(part) for part in zip(*dumps, strict=True))
        checked_values(deck, steps, values)
        dense = dense_of(scene, deck, steps, values)
        provenance: dict[str, Any] = {
            "lammps": engine_certificate(self.engine, report, scene.n_body, deck),
            "engine_wall": report.wall,
            "engine_loop": report.loop,
            "engine_memory": report.memory,
            "deck_hash": deck.content_hash,
            "atom_types": deck.types,
            "pair_style": report.pair_style,
            "energies": [[step * plan.step, *energies] for step, energies in sorted(report.energies.items())],
        }
        if written.tables is not None:
            provenance["table"] = {
                "style": written.tables.style,
                "points": written.tables.points,
                "files": len(written.tables.tables),
                "predicted_error": predicted_error(scene, written.tables),
                "predicted_energy_error": predicted_energy_error(written.tables),
                **measured(scene, written.tables, dense, plan, {step: pe for step, (pe, _) in report.energies.items()}),
            }
        return read_off(
            self,
            scene,
            plan,
            dense,
            {"dt": plan.step, "samples": plan.samples, "surrogate_radius": deck.surrogate_radius},
            watch=watch,
            evaluations=plan.steps + 1,
            provenance=provenance,
            child_cpu=report.cpu,
        )

    def deck(self, scene: Scene, resolution: Resolution, sampling: Sampling) -> Deck:
        """Return the deck that :meth:`run` runs."""
        return self.written(scene, resolution, sampling, prescan_scene(scene)).deck

    def written(self, scene: Scene, resolution: Resolution, sampling: Sampling, prescan: Prescan) -> Written:
        """Return the deck with its tables; UnsupportedScene or UsageError if there can be none."""
        reason = unsupported_reason(self, scene)
        if reason:
            raise UnsupportedScene(f"{self.name} cannot do {scene.name}: {reason}")
        deepest = float(np.max(prescan.peak_overlap, initial=0.0))
        radius = radius_of(scene, resolution, prescan)
        if radius < deepest:
            raise UsageError(
                f"surrogate_radius = {radius:g} m; allowed: more than the largest overlap, {deepest:.3g} m"
            )
        if (grain := float(np.spacing(np.max(np.abs(positions(scene, radius)))))) >= deepest > 0.0:
            raise UnsupportedScene(
                f"{self.name} cannot do {scene.name}: it keeps positions, which the gaps make so large that they are"
                f" known to {grain:.2g} m, and overlaps are of {deepest:.2g} m; take backend='reference'"
            )
        plan = fixed_step_plan(scene, resolution, sampling, prescan)
        physical = resolution.geometry == "physical" and resolution.surrogate_radius is None
        tables = self.tables_of(scene, resolution, prescan) if self.tables_of is not None else None
        deck = deck_of(
            scene,
            radius=radius,
            schedule=plan,
            tables=tables,
            travel=prescan.highest - prescan.lowest,
            types=resolution.types,
            floor=roundoff_floor(scene, plan, radius) if physical else None,
        )
        return Written(deck=deck, tables=tables)


def explained(error: RunBroken, scene: Scene, dt: float) -> RunBroken:
    """Return the error of a run of LAMMPS, for lost atoms with the limit of stability if the step passed it.

    The limit is 2/omega, where omega is the angular frequency of a contact with its two bodies alone at the largest
    overlap of a prescan.
    """
    if "lost atoms" not in str(error).lower():
        return error
    c, mobility = scene.contacts, scene.mobility
    overlap = np.maximum(prescan_scene(scene).peak_overlap, np.finfo(float).tiny)
    stiffness = (c.exponent - 1.0) * c.stiffness * overlap ** (c.exponent - 2.0)
    limit = 2.0 / float(np.sqrt((stiffness * (mobility[c.left] + mobility[c.right])).max()))
    if dt <= limit:
        return error
    text = f"the step of {dt:.3g} s passed the limit of stability, 2/omega = {limit:.2g} s of the stiffest contact"
    return RunBroken(f"{error}; {text}; take a smaller --dt, or --accuracy in its place", log=error.log)


class LammpsTable(LammpsGranular):
    """Run LAMMPS with ``pair_style table``: n from 2 to 5, or a law given as a function, another in each contact.

    A damped contact has ``granular`` where that has its law (n = 5/2 and 2). Elsewhere the damping is added to the
    table and the contact may become tensile, as no contact of the scene does: LAMMPS clips no sum of two pair styles.
    The twin with tables does the same, so the uncertainty has it (part ``table``); ``provenance["table"]["pull"]`` is
    the largest tension, N.
    """

    name = "lammps-table"
    supports = TABLE_STYLE
    styles = ("pair table",)
    tables_of = staticmethod(tables_for)


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
    time, first = steps * deck.schedule.step, deck.first_id - 1
    if scene.driving_force is not None:
        outer = np.array(np.broadcast_to(outer, net.shape))
        outer[:, first] += scene.driving_force.at(time)
    # a frozen wall has net force but no acceleration
    acceleration = net * deck.mobility
    if scene.piston is not None:
        acceleration[:, first] = scene.piston.acceleration(time)
    bodies = slice(deck.first_id - 1, deck.first_id - 1 + scene.n_body)

    def at_rest_beside(moving: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.pad(moving[:, bodies], ((0, 0), (0, 1)))

    return Dense(
        velocity=at_rest_beside(velocity),
        displacement=at_rest_beside(position - deck.line),
        acceleration=at_rest_beside(acceleration),
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
