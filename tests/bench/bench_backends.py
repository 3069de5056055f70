"""What each backend costs on decelerating-40 (3 ms, dt = 1e-8 s, 500 samples), against the bare engine.

`make bench` runs this; the figures in brackets are ratios to the fastest of a group, medians, warm. Force
evaluations are kept beside the seconds, because seconds depend on the machine.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pytest_benchmark.fixture import BenchmarkFixture

import dem_bridge as db
from dem_bridge.lmp.process import run_deck
from dem_bridge.scene import Scene

SCENE, STEP = "decelerating-40", 1e-8


@pytest.fixture(scope="module")
def bare_deck(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The deck without its dump: what a hand-written script does at least."""
    folder = tmp_path_factory.mktemp("bare")
    db.write_deck(SCENE, folder, dt=STEP)
    deck = folder / f"in.{SCENE}"
    lines = deck.read_text().splitlines()
    deck.write_text("\n".join(line for line in lines if not line.startswith("dump")) + "\n")
    return folder


@pytest.mark.benchmark(group=f"{SCENE}, 3e5 steps")
def test_bare_lammps_in_a_child(benchmark: BenchmarkFixture, bare_deck: Path) -> None:
    benchmark.pedantic(
        run_deck, args=(bare_deck, f"in.{SCENE}"), kwargs={"time_limit": 600.0}, rounds=5, warmup_rounds=1
    )


@pytest.mark.benchmark(group=f"{SCENE}, 3e5 steps")
@pytest.mark.parametrize("bars", [False, True], ids=["no bars", "bars"])
@pytest.mark.parametrize("backend", ["lammps-granular", "verlet"])
def test_fixed_step(benchmark: BenchmarkFixture, backend: str, bars: bool) -> None:
    run = benchmark.pedantic(
        db.solve,
        args=(SCENE,),
        kwargs={"backend": backend, "dt": STEP, "bars": bars},
        rounds=5,
        warmup_rounds=1,
    )
    benchmark.extra_info["force_evaluations"] = run.cost.force_evaluations


@pytest.mark.benchmark(group=f"{SCENE}, 3e5 steps")
@pytest.mark.parametrize(("backend", "rounds"), [("reference", 10), ("scipy", 2), ("ode45", 10)])
def test_adaptive(benchmark: BenchmarkFixture, backend: str, rounds: int) -> None:
    run = benchmark.pedantic(
        db.solve, args=(SCENE,), kwargs={"backend": backend, "bars": False}, rounds=rounds, warmup_rounds=1
    )
    benchmark.extra_info["force_evaluations"] = run.cost.force_evaluations


def decelerating(cylinders: int) -> Scene:
    """The decelerating chain of any length, struck by one of its own, until the front has passed it."""
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


@pytest.mark.benchmark(group="reference following a front, per chain")
@pytest.mark.parametrize(("cylinders", "rounds"), [(1_000, 3), (10_000, 1), (100_000, 1)])
def test_front(benchmark: BenchmarkFixture, cylinders: int, rounds: int) -> None:
    run = benchmark.pedantic(
        db.solve, args=(decelerating(cylinders),), kwargs={"backend": "reference", "bars": False}, rounds=rounds
    )
    reached = int(np.sum(np.isfinite(run.crossing_time)))
    assert benchmark.stats is not None
    benchmark.extra_info["ms_per_cylinder"] = round(1e3 * benchmark.stats.stats.median / reached, 4)


@pytest.mark.benchmark(group="command line")
def test_help(benchmark: BenchmarkFixture) -> None:
    import subprocess
    import sys

    benchmark.pedantic(
        subprocess.run,
        args=([str(Path(sys.executable).with_name("dem-bridge")), "--help"],),
        kwargs={"check": True, "capture_output": True},
        rounds=10,
        warmup_rounds=1,
    )
