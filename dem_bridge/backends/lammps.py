"""LAMMPS, the code under test: a deck is written, run in a child process and its dump read back.

What is read is LAMMPS' own: positions, velocities and net forces. Contact forces are the running sum of the net
forces along the chain, so a wrong coefficient in a deck shows in them.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dem_bridge import progress
from dem_bridge.backends.base import Availability, Resolution, Sampling
from dem_bridge.backends.steps import Dense, fixed_step_plan, radius_of, read_off
from dem_bridge.backends.survey import Survey, survey
from dem_bridge.backends.twin_bars import Twins, twins_of, with_bars
from dem_bridge.compiled import started
from dem_bridge.errors import BackendUnavailable, RunBroken, UnsupportedScene, UsageError
from dem_bridge.lmp.coefficients import line_order, refusal
from dem_bridge.lmp.deck import DUMP_COLUMNS, Deck, granular_deck
from dem_bridge.lmp.engine import Engine
from dem_bridge.lmp.output import read_binary_dump
from dem_bridge.lmp.process import EngineReport, require, run_deck, workspace
from dem_bridge.scene import Scene
from dem_bridge.trajectory import Trajectory


class LammpsGranular:
    """LAMMPS with ``pair_style granular`` and ``fix nve``. n = 5/2 and 2; any masses, gaps, walls, precompression,
    weight, damping, drag."""

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
        began = time.perf_counter(), time.process_time()
        look = survey(scene)
        deck = self.deck(scene, resolution, sampling, look)
        # the twins run beside the engine: they need nothing of it
        bars = started(self._twins, scene, deck, look) if resolution.bars else None
        result = self.run_deck(scene, deck, time_limit=resolution.time_limit, began=began)
        return result if bars is None else with_bars(result, bars())

    def run_deck(
        self, scene: Scene, deck: Deck, *, time_limit: float, began: tuple[float, float] | None = None
    ) -> Trajectory:
        """What LAMMPS makes of a deck of the scene, without bars; ``began``: wall and CPU time (s) at the start."""
        began = began or (time.perf_counter(), time.process_time())
        with workspace(dump_size(deck)) as folder:
            for file, text in deck.files.items():
                (folder / file).write_text(text, encoding="utf-8")
            # the dump grows evenly with the steps: its size tells how far the run is
            watch = dump_progress(folder / deck.dump_file, deck) if progress.wanted() else None
            report = run_deck(folder, deck.input_file, time_limit=time_limit, watch=watch, engine=self.engine)
            dumps = [
                read_binary_dump(folder / file, columns=len(DUMP_COLUMNS))
                for file in (deck.dump_file, *deck.more_dumps)
            ]
        steps, values = dumps[0] if len(dumps) == 1 else (np.concatenate(part) for part in zip(*dumps, strict=True))
        return self._trajectory(scene, deck, report, steps, values, began)

    def _twins(self, scene: Scene, deck: Deck, look: Survey) -> Twins | None:
        weights = float(np.sum(np.abs(deck.weight)))
        return twins_of(scene, deck.schedule, look, radius=deck.gauge_radius, summed=weights)

    def deck(self, scene: Scene, resolution: Resolution, sampling: Sampling, look: Survey | None = None) -> Deck:
        """The deck that :meth:`run` runs."""
        reason = self.refusal(scene)
        if reason:
            raise UnsupportedScene(f"{self.name} cannot do {scene.name}: {reason}")
        look = look or survey(scene)
        deepest = float(np.max(look.peak_overlap, initial=0.0))
        radius = radius_of(scene, resolution, look)
        if radius < deepest:
            raise UsageError(f"gauge_radius = {radius:g} m; allowed: more than the largest overlap, {deepest:.3g} m")
        plan = fixed_step_plan(scene, resolution, sampling, look)
        travel = look.highest - look.lowest
        return granular_deck(scene, radius=radius, schedule=plan, travel=travel, types=resolution.types)

    def _trajectory(
        self,
        scene: Scene,
        deck: Deck,
        report: EngineReport,
        steps: NDArray[np.int64],
        values: NDArray[np.float64],
        began: tuple[float, float],
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
        _check_gauge(values[:, :, DUMP_COLUMNS.index("x")], deck, steps)
        settings = {"dt": plan.step, "samples": plan.samples, "gauge_radius": deck.gauge_radius}
        run = read_off(
            self, scene, plan, _dense(scene, deck, steps, values), settings, began=began, evaluations=plan.steps + 1
        )
        engine = {
            "lammps": engine_certificate(self.engine, report, scene),
            "engine_wall": report.wall,
            "deck_hash": deck.content_hash,
            "atom_types": deck.types,
            "pair_style": report.pair_style,
        }
        # the engine's own share of the processor, and not only ours
        cost = replace(run.cost, cpu=run.cost.cpu + report.cpu)
        return replace(run, cost=cost, provenance={**run.provenance, **engine})


def _dense(scene: Scene, deck: Deck, steps: NDArray[np.int64], values: NDArray[np.float64]) -> Dense:
    """What LAMMPS dumped, in the order of the scene's contacts and bodies."""
    position, velocity, net = (values[:, :, DUMP_COLUMNS.index(name)] for name in ("x", "vx", "fx"))
    columns = np.argsort(line_order(scene))
    outer = deck.weight
    if scene.drag > 0.0:
        # forces are those of the half step's velocity, which is not dumped
        half = velocity - np.where(steps > 0, 0.5 * deck.schedule.step, 0.0)[:, None] * net * deck.mobility
        mass = np.divide(1.0, deck.mobility, out=np.zeros_like(deck.mobility), where=deck.mobility > 0.0)
        outer = deck.weight - scene.drag * mass * half
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


def _check_gauge(position: NDArray[np.float64], deck: Deck, steps: NDArray[np.int64]) -> None:
    """RunBroken where an overlap exceeds the gauge radius or bodies that are not neighbours touch."""
    beyond = deck.reach - np.diff(position, axis=1) - np.minimum(deck.radii[:-1], deck.radii[1:])
    if np.max(beyond, initial=-math.inf) > 0.0:
        place = int(np.argmax(np.max(beyond, axis=0)))
        radius = float(min(deck.radii[place : place + 2]))
        raise RunBroken(
            f"an overlap of {radius + float(np.max(beyond)):.6g} m exceeds the gauge radius {radius:.6g} m: bodies that"
            " are not neighbours may have touched; give a larger gauge_radius"
        )
    across = position[:, 2:] - position[:, :-2] - (deck.radii[2:] + deck.radii[:-2])
    if np.min(across, initial=math.inf) < 0.0:
        row, atom = np.unravel_index(np.argmin(across), across.shape)
        raise RunBroken(
            f"atoms {atom + 1} and {atom + 3}, which are not neighbours, overlap by {-float(across[row, atom]):.6g} m"
            f" at step {steps[row]}; give a gauge_radius above {deck.gauge_radius:.6g} m"
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
