"""Measure how time and memory grow with bodies, samples, steps, chains and workers, and run near a limit of memory.

``python -m tests.bench.bench_scale full`` measures the sizes of docs/scale.md (some five minutes on a quiet machine),
``make bench`` fewer chains and shorter ones by the same formulas. Each measurement is a process of its own, so that its
peak of memory is its own.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Sequence
from typing import Any

import numpy as np

from dem_bridge.foundation.numbers import MOST_BODIES

#: address space that the largest run must fit in, bytes
LIMIT = 4e9
#: part of the predicted largest number of samples that is run within the limit
PART = 0.9
STEP = 1e-7
_BEGIN = """
import json, resource, sys, time
import dem_bridge as db
from dem_bridge.scene.scene import Scene
def peak(): return 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
def address_space():
    return 1024 * next(int(line.split()[1]) for line in open("/proc/self/status") if line.startswith("VmPeak"))
settings = json.loads(sys.argv[1])
"""
#: all bodies of the chain move, so that none is passed over as not yet reached
_BODIES = """
def chain(n, steps):
    speeds = tuple(0.8 * (i % 2 == 0) for i in range(n))
    return Scene(name="n", duration=1e-7 * steps, mass=(0.01,) * n, stiffness=(2e10,) * (n - 1), velocity=speeds)
def run(n, steps, samples):
    db.solve(chain(n, steps), backend="verlet", dt=1e-7, samples=samples, uncertainty=False)
run(3, 10, 1)
if settings.get("limit"):
    resource.setrlimit(resource.RLIMIT_AS, (int(settings["limit"]),) * 2)
wall, cpu = time.perf_counter(), time.process_time()
run(settings["n"], settings["steps"], settings["samples"])
"""
#: bodies with random speeds, which collide again and again; the time of a run that is almost none is subtracted
_COLLISIONS = """
from numpy.random import default_rng
def run(n, duration):
    speeds = tuple(default_rng(n).uniform(-0.5, 0.5, n))
    scene = Scene(name="n", duration=duration, mass=(0.01,) * n, stiffness=(2e10,) * (n - 1), velocity=speeds)
    db.solve(scene, backend=settings["backend"], uncertainty=False, **settings["more"])
if True:
    run(settings["n"], 1e-6)
    before = time.perf_counter()
    run(settings["n"], 1e-6)
    wall, cpu = time.perf_counter(), time.process_time()
    wall += wall - before
    run(settings["n"], settings["duration"])
"""
_CHAINS = """
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
def run(n, pool):
    db.ensemble("decelerating-40", vary={"angle": 0.5}, n=n, accuracy=settings["accuracy"], checks=0, executor=pool)
if __name__ == "__main__":
    run(16, None)
    wall, cpu = time.perf_counter(), time.process_time()
    if settings["workers"]:
        with ProcessPoolExecutor(settings["workers"], mp_context=get_context("spawn")) as pool:
            run(settings["n"], pool)
    else:
        run(settings["n"], None)
"""
_END = """
    print(json.dumps({"wall": time.perf_counter() - wall, "cpu": time.process_time() - cpu, "peak": peak(),
                      "space": address_space()}))
"""
#: least duration of a chain whose methods are compared, s: about one contact
_CONTACT = 5e-5


def _measured(program: str, **settings: Any) -> dict[str, float]:
    """Return wall time (s), CPU time (s), largest resident memory and address space (bytes) of a process."""
    if program is _BODIES:
        program += "if True:\n"
    text = _BEGIN + program + _END.lstrip("\n")
    done = subprocess.run(
        [sys.executable, "-c", text, json.dumps(settings)], capture_output=True, text=True, check=False, timeout=1800
    )
    if done.returncode:
        raise RuntimeError(done.stderr[-2000:])
    return dict(json.loads(done.stdout.splitlines()[-1]))


def _of_bodies(sizes: Sequence[int]) -> None:
    """Print the fits of memory and time of one run, and run near the limit."""
    rows = [(n, steps, samples) for n in sizes for steps, samples in ((100, 10), (100, 50), (400, 10))]
    runs = [_measured(_BODIES, n=n, steps=steps, samples=samples) for n, steps, samples in rows]
    n, steps, samples = np.array(rows, dtype=float).T
    for name in ("peak", "space"):
        values = np.array([run[name] for run in runs])
        base, body, sample = np.linalg.lstsq(np.stack([n**0, n, n * samples], 1), values, rcond=None)[0]
        off = np.max(np.abs(base + n * (body + sample * samples) - values) / values)
        print(
            f"one run, {name}: {base / 1e6:.0f} MB + bodies ({body:.0f} + {sample:.1f} samples) bytes, off <= {off:.1%}"
        )
    cpu = np.array([run["cpu"] for run in runs])
    per_body, per_step = np.linalg.lstsq(np.stack([n, n * steps], 1), cpu, rcond=None)[0]
    print(f"one run, CPU: bodies ({1e6 * per_body:.1f} us + {1e9 * per_step:.2f} ns a step)")
    bodies = MOST_BODIES if len(sizes) > 2 else sizes[0]
    most = int(((LIMIT - base) / MOST_BODIES - body) / sample)
    samples_near = int(PART * most)
    run = _measured(_BODIES, n=bodies, steps=samples_near, samples=samples_near, limit=LIMIT)
    share = run["space"] / (base + bodies * (body + sample * samples_near))
    print(f"{LIMIT / 1e9:g} GB of addresses hold {most} samples of {MOST_BODIES} bodies; {bodies} bodies with")
    print(
        f"  {samples_near} ran in {run['space'] / 1e9:.2f} GB, {share:.2f} of the prediction, {run['cpu']:.0f} s of CPU"
    )


def _of_methods(sizes: Sequence[int]) -> None:
    """Print the powers of the number of bodies and of the duration by which the time of other methods grows."""
    print(f"bodies with random speeds, {_CONTACT:g} and {4 * _CONTACT:g} s:")
    for backend, part, more in (("reference", 4, {}), ("scipy", 1, {}), ("lammps-granular", 10, {"dt": 1e-8})):
        rows = [(part * n, times * _CONTACT) for n in sizes for times in (1, 4)]
        runs = [_measured(_COLLISIONS, backend=backend, n=n, duration=t, more=more)["wall"] for n, t in rows]
        n, duration = np.array(rows).T
        terms = np.stack([n**0, np.log(n), np.log(duration)], 1)
        _, of_bodies, of_duration = np.linalg.lstsq(terms, np.log(np.maximum(runs, 1e-3)), rcond=None)[0]
        largest = f"{runs[-1]:.2f} s for {part * max(sizes)} bodies"
        print(f"  {backend}: bodies^{of_bodies:.2f} duration^{of_duration:.2f}, {largest}")


def _of_chains(counts: Sequence[int], accuracy: float) -> None:
    """Print CPU time and memory of ensembles, and the throughput of processes beside its model."""
    runs = [_measured(_CHAINS, n=n, workers=0, accuracy=accuracy) for n in counts]
    for count, run in zip(counts, runs, strict=True):
        print(f"{count} chains to {accuracy:g}: {run['cpu']:.1f} s of CPU, peak {run['peak'] / 1e6:.0f} MB")
    print(f"  peak of {counts[-1]} over that of {counts[0]} chains: {runs[-1]['peak'] / runs[0]['peak']:.3f}")
    each = (runs[-1]["cpu"] - runs[0]["cpu"]) / (counts[-1] - counts[0])
    start, count = _measured(_CHAINS, n=16, workers=1, accuracy=accuracy)["wall"], 4 * counts[0]
    for workers in (1, 2):
        wall = _measured(_CHAINS, n=count, workers=workers, accuracy=accuracy)["wall"]
        model = start + each * count / workers
        print(
            f"{count} chains on {workers} processes: {start:.1f} s + chains x {1e3 * each:.3f} ms / {workers} ="
            f" {model:.1f} s predicted, {wall:.1f} s measured, ratio {wall / model:.2f}"
        )


def main(*, tiny: bool = False, full: bool = False) -> int:
    """Print all measurements; ``tiny`` takes small sizes, ``full`` those of docs/scale.md."""
    _of_bodies((1000, 2000) if tiny else (50_000, 100_000, 400_000))
    _of_methods((4, 8) if tiny else (40, 160, 320, 640) if full else (40, 160, 320))
    _of_chains((16, 32) if tiny else (10_000, 100_000) if full else (2_000, 20_000), 0.05 if tiny else 0.01)
    return 0


if __name__ == "__main__":
    sys.exit(main(full="full" in sys.argv[1:]))
