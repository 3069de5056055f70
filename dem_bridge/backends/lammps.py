"""LAMMPS, the code under test: a deck is written, run in a child process and its dump read back.

What is read is LAMMPS' own: positions, velocities and net forces. Contact forces are the running sum of the net
forces along the chain, so a wrong coefficient in a deck shows in them.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dem_bridge import progress
from dem_bridge.backends.bars import UNKNOWN
from dem_bridge.backends.base import Availability, Resolution, Sampling, birth_certificate
from dem_bridge.backends.scales import resting_acceleration
from dem_bridge.backends.steps import fixed_step_plan
from dem_bridge.backends.survey import Survey, survey
from dem_bridge.backends.twin_bars import with_twin_bars
from dem_bridge.dense import extremes
from dem_bridge.errors import BackendUnavailable, RunBroken, UnsupportedScene, UsageError
from dem_bridge.lmp.deck import DUMP_COLUMNS, Deck, granular_deck, refusal
from dem_bridge.lmp.engine import Engine
from dem_bridge.lmp.output import read_binary_dump
from dem_bridge.lmp.process import EngineReport, require, run_deck, workspace
from dem_bridge.scene import Scene
from dem_bridge.trajectory import Cost, Trajectory


class LammpsGranular:
    """LAMMPS with ``pair_style granular`` and ``fix nve``. n = 5/2; any masses, gaps, walls, precompression, weight."""

    name = "lammps-granular"
    equations = "hertz"
    order: int | None = 2

    def __init__(self, engine: Engine | None = None) -> None:
        self.engine = engine or Engine.chosen()

    def availability(self) -> Availability:
        try:
            require(self.engine, "pair granular")
        except BackendUnavailable as error:
            return Availability(False, str(error))
        return Availability(True)

    def refusal(self, scene: Scene) -> str | None:
        return refusal(scene)

    def run(self, scene: Scene, resolution: Resolution, sampling: Sampling) -> Trajectory:
        """Solve. The time step's bar comes from the twin at this and twice the step, never from LAMMPS itself."""
        wall, cpu = time.perf_counter(), time.process_time()
        look = survey(scene)
        deck = self.deck(scene, resolution, sampling, look)
        with workspace(dump_size(deck)) as folder:
            for file, text in deck.files.items():
                (folder / file).write_text(text, encoding="utf-8")
            # the dump grows evenly with the steps: its size tells how far the run is
            watch = dump_progress(folder / deck.dump_file, deck) if progress.wanted() else None
            report = run_deck(
                folder, deck.input_file, time_limit=resolution.time_limit, watch=watch, engine=self.engine
            )
            steps, values = read_binary_dump(folder / deck.dump_file, columns=len(DUMP_COLUMNS))
        result = self._trajectory(scene, deck, report, steps, values, wall, cpu)
        if not resolution.bars:
            return result
        weights = float(np.sum(np.abs(deck.weight)))
        return with_twin_bars(result, scene, deck.schedule, look, radius=deck.gauge_radius, summed=weights)

    def deck(self, scene: Scene, resolution: Resolution, sampling: Sampling, look: Survey | None = None) -> Deck:
        """The deck that :meth:`run` runs."""
        reason = self.refusal(scene)
        if reason:
            raise UnsupportedScene(f"{self.name} cannot do {scene.name}: {reason}")
        look = look or survey(scene)
        deepest = float(np.max(look.peak_overlap, initial=0.0))
        radius = resolution.gauge_radius or look.gauge_radius
        if radius < deepest:
            raise UsageError(f"gauge_radius = {radius:g} m; allowed: more than the largest overlap, {deepest:.3g} m")
        plan = fixed_step_plan(scene, resolution, sampling, look)
        return granular_deck(scene, radius=radius, schedule=plan, travel=look.highest - look.lowest)

    def _trajectory(
        self,
        scene: Scene,
        deck: Deck,
        report: EngineReport,
        steps: NDArray[np.int64],
        values: NDArray[np.float64],
        wall: float,
        cpu: float,
    ) -> Trajectory:
        plan = deck.schedule
        expected = plan.dense_steps
        if not np.array_equal(steps, expected) or values.shape[1] != len(deck.line):
            raise RunBroken(
                f"LAMMPS dumped {len(steps)} frames of {values.shape[1]} atoms;"
                f" the deck asks for {len(expected)} of {len(deck.line)}"
            )
        if not np.all(np.isfinite(values)):
            first = int(np.argwhere(~np.isfinite(values).all(axis=(1, 2)))[0, 0])
            raise RunBroken(f"LAMMPS ended without an error, but from step {steps[first]} on its values are not finite")
        position, velocity, net = (values[:, :, DUMP_COLUMNS.index(name)] for name in ("x", "vx", "fx"))
        # along the line of atoms, walls included, then in the order of the scene's contacts
        columns, weight = _columns(scene), np.array(deck.weight)
        overlap = (2.0 * deck.gauge_radius - np.diff(position, axis=1))[:, columns]
        rate = -np.diff(velocity, axis=1)[:, columns]
        # a frozen wall has net force but no acceleration
        acceleration = -np.diff(net * np.array(deck.mobility), axis=1)[:, columns]
        force = np.cumsum(weight - net, axis=1)[:, columns]
        deepest = float(np.max(overlap, initial=0.0))
        if deepest > deck.gauge_radius:
            raise RunBroken(
                f"an overlap of {deepest:.6g} m exceeds the gauge radius {deck.gauge_radius:.6g} m: bodies that are"
                " not neighbours may have touched; give a larger gauge_radius"
            )
        peak_force, crossing = extremes(
            time=steps * plan.step,
            overlap=overlap,
            rate=rate,
            acceleration=acceleration,
            force=force,
            exponent=scene.contacts.exponent,
            resting=resting_acceleration(scene),
            resolution=4.0 * math.ulp(float(np.max(np.abs(position)))),
        )
        rows = slice(None, None, plan.subdivisions)
        bodies = slice(deck.first_id - 1, deck.first_id - 1 + scene.n_body)
        settings = {"dt": plan.step, "samples": plan.samples, "gauge_radius": deck.gauge_radius}
        return Trajectory(
            time=Sampling(count=plan.samples).times(scene.duration),
            displacement=(position[rows] - np.array(deck.line))[:, bodies],
            velocity=velocity[rows, bodies],
            contact_force=force[rows],
            peak_force=peak_force,
            crossing_time=crossing,
            uncertainty=UNKNOWN,
            cost=Cost(
                wall=time.perf_counter() - wall,
                cpu=time.process_time() - cpu + report.cpu,
                steps=plan.steps,
                force_evaluations=plan.steps + 1,
            ),
            provenance=birth_certificate(self, scene, settings)
            | {
                "lammps": engine_certificate(self.engine, report, scene),
                "engine_wall": report.wall,
                "deck_hash": deck.content_hash,
                "atom_types": deck.types,
            },
        )


def dump_progress(path: Path, deck: Deck) -> Callable[[], None]:
    """A call that reports the share of the dump that is written."""
    whole = dump_size(deck)

    def watch() -> None:
        if path.exists():
            progress.report(path.stat().st_size / whole)

    return watch


def dump_size(deck: Deck) -> int:
    """Bytes that a run of the deck writes."""
    frame = 8 * len(DUMP_COLUMNS) * len(deck.line) + 200  # values and, roughly, a frame's header
    return frame * len(deck.schedule.dense_steps)


def engine_certificate(engine: Engine, report: EngineReport, scene: Scene) -> dict[str, Any]:
    """Provenance of a run: which LAMMPS, and how. JSON-able."""
    note = engine.note(scene.n_body)
    return {
        "version": report.version,
        "packages": list(report.packages),
        "build": list(report.build),
        "run_by": engine.label,
        "ranks": report.ranks,
    } | ({"note": note} if note else {})


def _columns(scene: Scene) -> list[int]:
    """Where each contact of the scene (chain, wall_left, wall_right) stands along the line of atoms."""
    links, left = len(scene.stiffness), scene.wall_left is not None
    order = [k + left for k in range(links)]
    order += [0] * left + [links + left] * (scene.wall_right is not None)
    return order
