"""What each backend costs on decelerating-40 (3 ms, dt = 1e-8 s, 500 samples), against the bare engine.

`make bench` runs this; the figures in brackets are ratios to the fastest of a group, medians, warm. Force
evaluations are kept beside the seconds, because seconds depend on the machine.
"""

from __future__ import annotations

from pathlib import Path

import pytest
from pytest_benchmark.fixture import BenchmarkFixture

import dem_bridge as db
from dem_bridge.lmp.process import run_deck

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
def test_scipy_reference(benchmark: BenchmarkFixture) -> None:
    run = benchmark.pedantic(
        db.solve, args=(SCENE,), kwargs={"backend": "scipy", "bars": False}, rounds=2, warmup_rounds=0
    )
    benchmark.extra_info["force_evaluations"] = run.cost.force_evaluations


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
