"""Compare in-house fixed-step methods with velocity-Verlet written by hand in C (verlet.c): time for an accuracy.

``make bench`` runs this (half a minute; a C compiler). Codes take turns, so that a busy machine is busy for all of
them, and figures are CPU time: the least and the median of many. The C code is compiled as one would (-O3
-march=native), and once more with -fno-math-errno, without which gcc makes no vector of a square root; "one kick" is
its other form, with both half kicks between two drifts in one.
"""

from __future__ import annotations

import ctypes
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

import dem_bridge as db
from dem_bridge.backends import splitting
from dem_bridge.backends.base import Resolution, Sampling, backend
from dem_bridge.backends.blanes_moan import SRKN_6B
from dem_bridge.backends.twin import TWIN, VERLET
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.dense import Schedule

SOURCE = Path(__file__).with_name("verlet.c")
FLAGS = {"C": ("-O3", "-march=native"), "C, no errno": ("-O3", "-march=native", "-fno-math-errno")}
METHODS = {"verlet": VERLET, "blanes-moan": SRKN_6B}
#: a method has an accuracy from the first of 40 steps, evenly spaced in their logarithm down to a quarter, that have it
FINEST = 0.25
RUNG = FINEST ** (-1.0 / 39.0)
Floats = NDArray[np.float64]
#: seconds of CPU and the sampled velocities, m/s
Answer = tuple[float, Floats]
Key = TypeVar("Key")


@dataclass(frozen=True)
class Extent:
    """Say what is measured, and how often."""

    rounds: int
    bodies: tuple[int, ...]
    """Lengths of the chains of which a step is timed."""
    work: float
    """Bodies times steps of each of these runs."""
    accuracies: tuple[float, ...]
    scenes: tuple[Scene, ...]


def full_extent() -> Extent:
    scenes = tuple(replace(db.load_scene(name), samples=500) for name in ("decelerating-40", "accelerating-40"))
    return Extent(rounds=5, bodies=(40, 200, 2000), work=5e6, accuracies=(1e-4, 1e-6, 1e-8), scenes=scenes)


def tiny_extent() -> Extent:
    scene = replace(db.load_scene("decelerating-40"), duration=6e-5, samples=5)
    return Extent(rounds=1, bodies=(40,), work=2e4, accuracies=(1e-4,), scenes=(scene,))


def compiled(folder: Path) -> dict[str, ctypes.CDLL]:
    """Return the C code by how it was compiled; none where there is no compiler."""
    compiler = shutil.which("cc")
    libraries = {}
    for name, flags in FLAGS.items() if compiler else ():
        file = folder / f"{name.replace(', ', '-').replace(' ', '-')}.so"
        subprocess.run([str(compiler), *flags, "-shared", "-fPIC", "-o", file, SOURCE, "-lm"], check=True)
        library = libraries[name] = ctypes.CDLL(str(file))
        library.verlet.restype = library.merged.restype = ctypes.c_double
    return libraries


def in_c(library: ctypes.CDLL, scene: Scene, per_sample: int, *, merged: bool = False) -> Answer:
    """Run a free chain without weight in C."""
    n, samples = scene.n_body, scene.samples
    dt = scene.duration / samples / per_sample
    push, beta = 0.5 * dt / np.array(scene.mass), np.zeros(n + 1)
    v, x, overlap, force = np.array(scene.velocity), np.zeros(n), np.zeros(n + 1), np.zeros(n + 1)
    beta[1:n], overlap[1:n] = scene.contacts.stiffness, -scene.contacts.gap
    out = np.zeros((samples, n))

    def at(values: Floats) -> ctypes.c_void_p:
        return values.ctypes.data_as(ctypes.c_void_p)

    step = (ctypes.c_double(dt), ctypes.c_long(per_sample), samples)
    whole = 2.0 * push
    kicks = (at(push), at(whole)) if merged else (at(push),)
    run = library.merged if merged else library.verlet
    return run(n, *kicks, at(beta), *step, at(v), at(x), at(overlap), at(force), at(out)), out


def in_house(name: str, scene: Scene, per_sample: int) -> Answer:
    """Make a whole run of a backend without bars: prescan the scene, solve, read off peaks and crossings."""
    dt = scene.duration / scene.samples / per_sample
    began = time.process_time()
    run = backend(name).run(scene, Resolution(dt=dt), Sampling(count=scene.samples))
    return time.process_time() - began, run.velocity[1:]


def alone(method: splitting.Method, scene: Scene, per_sample: int) -> Answer:
    """Run an in-house method on given steps and read off nothing between the samples, as in C."""
    plan = Schedule(
        step=scene.duration / scene.samples / per_sample, per_sample=per_sample, subdivisions=1, samples=scene.samples
    )
    began = time.process_time()
    run, _ = splitting.solve(TWIN, method, scene, plan, full=False)
    return time.process_time() - began, run.velocity[1:]


def in_turn(codes: Mapping[Key, Callable[[], Answer]], rounds: int) -> dict[Key, Floats]:
    """Return CPU times, s, ``(rounds,)``, of codes that take turns, all warm."""
    for code in codes.values():
        code()
    times = [[code()[0] for code in codes.values()] for _ in range(rounds)]
    return dict(zip(codes, np.array(times).T, strict=True))


# time for a body and step


def chain(bodies: int, *, pressed: bool, work: float) -> Scene:
    """Return a chain in which all contacts are closed and all bodies move, or one that is struck at its left end."""
    rng = np.random.default_rng(7)
    at_rest = (0.8, *[0.0] * (bodies - 1))
    return Scene(
        name="chain",
        duration=1e-8 * max(1, round(work / bodies)),
        mass=(0.0100766,) * bodies,
        stiffness=tuple(np.linspace(7.27e10, 4.68e9, bodies - 1).tolist()),
        velocity=tuple(rng.uniform(-0.01, 0.01, bodies).tolist()) if pressed else at_rest,
        gap=-1e-5 if pressed else 0.0,
        samples=1,
    )


def per_step(libraries: Mapping[str, ctypes.CDLL], extent: Extent) -> Table:
    """Time velocity-Verlet for a body and a step, in one kernel and the other."""
    in_c_codes = [f"{name}{how}" for name in libraries for how in ("", ", one kick")]
    table = Table("bodies", "contacts", "in-house, ns", *(f"{name}, ns: ratio" for name in in_c_codes))
    table.title = "velocity-Verlet, CPU for a body and step: least (median): median ratio in-house / C of the turns"
    for bodies in extent.bodies:
        for what, pressed in (("all closed", True), ("one struck", False)):
            scene = chain(bodies, pressed=pressed, work=extent.work)
            steps = round(scene.duration / 1e-8)
            codes = {"in-house": partial(alone, VERLET, scene, steps)}
            for name, library in libraries.items():
                codes[name] = partial(in_c, library, scene, steps)
                codes[f"{name}, one kick"] = partial(in_c, library, scene, steps, merged=True)
            expected = codes["in-house"]()[1]
            difference = max(float(np.max(np.abs(code()[1] - expected))) for code in codes.values())
            assert difference < 1e-6, f"the codes solve different equations: {difference:.1g} m/s apart"
            times = in_turn(codes, extent.rounds)
            cells = [_both(1e9 / bodies / steps * times["in-house"])]
            for name in in_c_codes:
                ratio = np.median(times["in-house"] / times[name])
                cells.append(f"{_both(1e9 / bodies / steps * times[name])}: {ratio:.2f}")
            table.add_row(str(bodies), what, *cells)
    return table


def _both(times: Floats) -> str:
    return f"{np.min(times):.3g} ({np.median(times):.3g})"


# time for an accuracy


def cheapest(code: Callable[[int], Answer], truth: Floats, accuracy: float, start: int) -> int:
    """Return the least steps per sample from which on errors are at most ``accuracy`` times the largest velocity."""
    first, per_sample, size = start, start, float(np.max(np.abs(truth)))
    while FINEST * per_sample < first:
        error = float(np.max(np.abs(code(per_sample)[1] - truth))) / size
        per_sample = max(per_sample + 1, round(RUNG * per_sample))
        if not error <= accuracy:
            first = per_sample
    return first


def to_accuracy(libraries: Mapping[str, ctypes.CDLL], scene: Scene, extent: Extent) -> Table:
    """Time what an accuracy of the velocities costs each code, at the largest step that has it."""
    truth = db.solve(scene, backend="reference", uncertainty=False).velocity[1:]
    steps = dict.fromkeys(METHODS, 1)
    table = Table(
        "velocity to", "code", "dt, s", "forces", "CPU, ms: least (median)", *(f"over {c}" for c in libraries)
    )
    table.title = f"{scene.name}: whole runs, with all that is read off, and solving alone, as in C"
    for accuracy in extent.accuracies:
        for name, method in METHODS.items():
            steps[name] = cheapest(partial(alone, method, scene), truth, accuracy, steps[name])
        codes = {
            (code, "verlet"): partial(in_c, library, scene, steps["verlet"]) for code, library in libraries.items()
        }
        for name, method in METHODS.items():
            codes[name, name] = partial(in_house, name, scene, steps[name])
            codes[f"{name}, alone", name] = partial(alone, method, scene, steps[name])
        times = in_turn(codes, extent.rounds)
        for (code, name), spent in times.items():
            dt = scene.duration / scene.samples / steps[name]
            forces = len(METHODS[name].drifts) * steps[name] * scene.samples
            ratios = [f"{np.median(spent / times[other, 'verlet']):.2f}" for other in libraries]
            table.add_row(f"{accuracy:.0e}", code, f"{dt:.2g}", f"{forces:,}", _both(1e3 * spent), *ratios)
        table.add_section()
    return table


def main(*, tiny: bool = False) -> int:
    """Print one table of steps and one of accuracies for each scene."""
    extent = tiny_extent() if tiny else full_extent()
    with tempfile.TemporaryDirectory() as folder:
        libraries = compiled(Path(folder))
        if not libraries:
            print("no C compiler (cc): nothing to measure against; install gcc or clang")
            return 0
        console = Console(width=150)
        console.print(per_step(libraries, extent))
        for scene in extent.scenes:
            console.print(to_accuracy(libraries, scene, extent))
    return 0


if __name__ == "__main__":
    sys.exit(main())
