"""Measure what each backend costs on decelerating-40 (3 ms, dt = 1e-8 s, 500 samples), against the bare engine.

``make bench`` runs this. Times are medians of warm rounds with their interquartile range; long work has fewer rounds.
Force evaluations are listed, too, because seconds depend on the machine.
"""

from __future__ import annotations

import statistics
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

import dem_bridge as db
from dem_bridge.lmp.process import run_deck
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import Trajectory
from tests.bench.timing import spread, wall_seconds


@dataclass(frozen=True)
class Extent:
    """Say what is measured, and how often."""

    scene: Scene
    dt: float
    """Of the fixed-step backends, s."""
    rounds: int
    """At most."""
    fronts: tuple[int, ...]
    """Lengths, in cylinders, of chains through which the reference follows a front."""


@dataclass(frozen=True)
class Row:
    """Hold the times of one piece of work."""

    group: str
    work: str
    seconds: list[float]
    remark: str = ""


def full_extent() -> Extent:
    return Extent(db.load_scene("decelerating-40"), dt=1e-8, rounds=25, fronts=(1_000, 10_000, 100_000))


def tiny_extent() -> Extent:
    scene = replace(db.load_scene("decelerating-40"), duration=3e-5, samples=5)
    return Extent(scene, dt=1e-7, rounds=1, fronts=(20,))


def bare_engine(extent: Extent) -> Iterator[Row]:
    """Measure the deck without its dump: what a hand-written script costs at least."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        db.write_deck(extent.scene, folder, dt=extent.dt)
        deck = folder / f"in.{extent.scene.name}"
        lines = deck.read_text().splitlines()
        deck.write_text("\n".join(line for line in lines if not line.startswith("dump")) + "\n")
        work = partial(run_deck, folder, deck.name, time_limit=600.0)
        yield Row(extent.scene.name, "bare LAMMPS in a child", wall_seconds(work, extent.rounds, "bare LAMMPS"))


def timed_run(work: Callable[[], Trajectory], rounds: int, name: str) -> tuple[Trajectory, list[float]]:
    """Return the last run, and the wall time of each round, s."""
    runs: list[Trajectory] = []
    seconds = wall_seconds(lambda: runs.append(work()), rounds, name)
    return runs[-1], seconds


def solves(extent: Extent) -> Iterator[Row]:
    """Measure runs of fixed step with and without uncertainty, and adaptive ones without."""
    settings: list[tuple[str, dict[str, Any]]] = [
        (name, {"dt": extent.dt, "uncertainty": estimated})
        for name in ("lammps-granular", "verlet")
        for estimated in (False, True)
    ]
    settings += [(name, {"uncertainty": False}) for name in ("reference", "scipy", "ode45")]
    for name, chosen in settings:
        work = partial(db.solve, extent.scene, backend=name, **chosen)
        how = "with" if chosen["uncertainty"] else "without"
        label = f"{name}, {how} uncertainty"
        run, seconds = timed_run(work, extent.rounds, label)
        yield Row(extent.scene.name, label, seconds, f"{run.cost.force_evaluations:,} forces")


def decelerating(cylinders: int) -> Scene:
    """Return the decelerating chain of any length, struck by one of its own, until the front has passed it."""
    stiffness = np.linspace(7.27e10, 4.68e9, cylinders - 1)
    mass, speed = 0.0100766, 0.8
    # binary collisions: each contact is crossed in half its contact time, and momentum is handed on whole
    half = 0.5 * 2.943275184325 * (1.25 * 0.5 * mass * speed**2 / stiffness) ** 0.4 / speed
    return Scene(
        name="front",
        duration=1.05 * float(np.sum(half)),
        mass=(mass,) * cylinders,
        stiffness=tuple(stiffness.tolist()),
        velocity=(speed, *[0.0] * (cylinders - 1)),
        samples=10,
    )


def fronts(extent: Extent) -> Iterator[Row]:
    """Measure the reference that follows a front through a long chain."""
    for cylinders in extent.fronts:
        work = partial(db.solve, decelerating(cylinders), backend="reference", uncertainty=False)
        rounds = 1 if cylinders > 10_000 else extent.rounds  # warm by the shorter ones
        run, seconds = timed_run(work, rounds, f"reference, a front through {cylinders:,}")
        reached = int(np.sum(np.isfinite(run.crossing_time)))
        remark = f"{1e3 * statistics.median(seconds) / reached:.4f} ms for a cylinder"
        yield Row("reference on a front", f"{cylinders:,} cylinders", seconds, remark)


def command_line(extent: Extent) -> Iterator[Row]:
    """Measure ``dem-bridge --help``."""
    words = [sys.executable, "-m", "dem_bridge.cli", "--help"]
    work = partial(subprocess.run, words, check=True, capture_output=True)
    yield Row("command line", "dem-bridge --help", wall_seconds(work, extent.rounds, "dem-bridge --help"))


PARTS: tuple[Callable[[Extent], Iterator[Row]], ...] = (bare_engine, solves, fronts, command_line)


def main(*, tiny: bool = False) -> int:
    """Print one table."""
    extent = tiny_extent() if tiny else full_extent()
    table = Table("group", "work", "median, s", "interquartile range, s", "rounds", "")
    for part in PARTS:
        for row in part(extent):
            median = f"{statistics.median(row.seconds):.4g}"
            table.add_row(row.group, row.work, median, f"{spread(row.seconds):.2g}", str(len(row.seconds)), row.remark)
    Console(width=130).print(table)
    return 0


if __name__ == "__main__":
    sys.exit(main())
