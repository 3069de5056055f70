"""Run an ensemble: blocks of chains on all cores, and a sample of them by other codes."""

from __future__ import annotations

import math
import multiprocessing
import os
import tempfile
import weakref
from collections import deque
from collections.abc import Iterator, Mapping
from concurrent.futures import BrokenExecutor, Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from pathlib import Path
from shutil import rmtree
from typing import TYPE_CHECKING, Any

import numpy as np

from dem_bridge.backends.base import Resolution, Sampling
from dem_bridge.ensembles.draw import BLOCK, Variation
from dem_bridge.ensembles.result import Ensemble
from dem_bridge.ensembles.solve import OBSERVABLES, check_solvable, difference, solve_chains, steps_for
from dem_bridge.errors import DemBridgeError, RunBroken
from dem_bridge.foundation.leftovers import owned
from dem_bridge.foundation.numbers import check_number
from dem_bridge.observables.registry import observable_named
from dem_bridge.runs.campaign import Away, Progress, Result, for_workers, run_cases, workers_of
from dem_bridge.runs.case import Case
from dem_bridge.runs.store import Store
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.relative import own_scale
from dem_bridge.trajectory.trajectory import Floats

if TYPE_CHECKING:
    import pandas as pd

#: bytes from which on an array is a file
MOST_IN_MEMORY = 8 * 2**20
#: chains that the number of steps is chosen with
PILOT = 32
#: codes that repeat a sample of the chains
CHECKS = ("reference", "lammps-granular")
#: samples between which the largest velocity of a checked chain is read, to 1e-7 even in chains of very different
#: stiffnesses; forces and crossings need none
_SAMPLES_OF_CHECK = 2000


def run_ensemble(
    variation: Variation,
    n: int,
    *,
    accuracy: float = 1e-4,
    samples: int | None = None,
    checks: int = 4,
    executor: Executor | None = None,
    store: Store | None = None,
    progress: Progress | None = None,
) -> Ensemble:
    """Solve ``n`` chains of a variation; see :func:`dem_bridge.ensemble`."""
    scene = variation.scene
    n = check_number("n", n, "a whole number >= 1", whole=True, at_least=1)
    checks = check_number("checks", checks, "a whole number >= 0", whole=True, at_least=0)
    if samples is not None:
        samples = check_number("samples", samples, "a whole number >= 1", whole=True, at_least=1)
    check_number("accuracy", accuracy, "a number from 1e-9 to 0.1", at_least=1e-9, at_most=0.1)
    check_solvable(scene)
    steps = steps_for(scene, variation.block(0, PILOT), accuracy, samples)
    sizes = [min(BLOCK, n - first) for first in range(0, n, BLOCK)]
    with ExitStack() as stack:
        arrays = _arrays(scene, n, samples, stack)
        with pool_of(executor) as pool:
            for nth, part in _blocks(pool, variation, sizes, steps, samples):
                for name, rows in part.items():
                    _opened(arrays[name])[nth * BLOCK : nth * BLOCK + len(rows)] = rows
                if progress is not None:
                    done = min(n, (nth + 1) * BLOCK)
                    progress(done, n, f"{scene.name}: {n} chains")
        values = {name: _opened(array) for name, array in arrays.items()}
        chosen = np.sort(np.random.default_rng([variation.seed, 1]).choice(n, size=min(checks, n), replace=False))
        checked = _checked(variation, values, chosen.tolist(), store)
        ensemble = Ensemble(variation=variation, values=values, accuracy=accuracy, steps=steps, checked=checked)
        weakref.finalize(ensemble, stack.pop_all().close)
    return ensemble


def solve_block(variation: Variation, nth: int, count: int, steps: int, samples: int | None) -> dict[str, Floats]:
    """Return the observables of the first ``count`` chains of a block; what a worker of an executor does."""
    return solve_chains(variation.scene, variation.block(nth, count), steps, samples or 0)


@contextmanager
def pool_of(executor: Executor | None) -> Iterator[Executor]:
    """Provide an executor: the given one, or threads on all cores, because the kernel releases the interpreter."""
    if executor is not None:
        yield executor
        return
    pool = ThreadPoolExecutor(os.cpu_count())
    try:
        yield pool
    finally:
        pool.shutdown(cancel_futures=True)


def _blocks(
    pool: Executor, variation: Variation, sizes: list[int], steps: int, samples: int | None
) -> Iterator[tuple[int, dict[str, Floats]]]:
    """Yield the blocks as they are solved; only a few are submitted at a time, so that memory is constant.

    A block whose worker is lost is solved once more, alone; a pool of processes that is broken is replaced.

    Raises
    ------
    RunBroken
        If a block is lost twice.
    """
    pending, lost, solve = deque(range(len(sizes))), set[int](), for_workers(solve_block)
    with ExitStack() as stack:

        def submit(nth: int) -> Future[dict[str, Floats]]:
            return pool.submit(solve, variation, nth, sizes[nth], steps, samples)

        away = Away[int, dict[str, Floats]](submit)
        stack.callback(away.cancel)
        while pending or away.items:
            try:
                away.fill(pending, 1 if lost else 2 * workers_of(pool))
            except BrokenExecutor:
                workers, spawn = workers_of(pool), multiprocessing.get_context("spawn")
                pool = stack.enter_context(ProcessPoolExecutor(workers, mp_context=spawn))
            for nth, future in away.ended():
                try:
                    part = future.result()
                except DemBridgeError:
                    raise
                except Exception as error:
                    if nth in lost:
                        chains = f"chains {nth * BLOCK} to {nth * BLOCK + sizes[nth] - 1} of {variation.scene.name}"
                        problem = " ".join(f"{type(error).__name__}: {error}".split())
                        raise RunBroken(f"{chains} could not be solved by two workers ({problem})") from error
                    lost.add(nth)
                    pending.appendleft(nth)
                    continue
                lost.discard(nth)
                yield nth, part


def _arrays(scene: Scene, n: int, samples: int | None, stack: ExitStack) -> dict[str, Floats | Path]:
    """Return an array for each observable; large ones are files in a temporary folder that the stack deletes."""
    lengths = {"": (), "body": (scene.n_body,), "contact": (scene.n_contact,)}
    shapes: dict[str, tuple[int, ...]] = {name: (n, *lengths[axis]) for name, axis in OBSERVABLES.items()}
    if samples is not None:
        shapes["velocity"] = (n, samples + 1, scene.n_body)
    arrays: dict[str, Floats | Path] = {}
    folder: Path | None = None
    for name, shape in shapes.items():
        if 8 * math.prod(shape) < MOST_IN_MEMORY:
            arrays[name] = np.empty(shape)
            continue
        if folder is None:
            folder = Path(tempfile.mkdtemp(prefix=owned("dem-bridge-ensemble")))
            stack.callback(rmtree, folder, ignore_errors=True)
        path = arrays[name] = folder / f"{name}.npy"
        np.lib.format.open_memmap(path, mode="w+", dtype=float, shape=shape)
    return arrays


def _opened(array: Floats | Path) -> Floats:
    """Return an array, mapped from its file if it is one: pages of a map that is closed take no memory."""
    return np.asanyarray(np.load(array, mmap_mode="r+")) if isinstance(array, Path) else array


def _checked(
    variation: Variation, arrays: Mapping[str, Floats], chosen: list[int], store: Store | None
) -> pd.DataFrame:
    """Return the differences of a sample of the chains from other codes."""
    import pandas as pd

    sampling = Sampling(count=_SAMPLES_OF_CHECK)
    scenes = {nth: variation.block(nth // BLOCK).scene(variation.scene, nth % BLOCK) for nth in chosen}
    places = [(code, nth) for code in CHECKS for nth in chosen]
    cases = [Case(scene=scenes[nth], backend=code, resolution=Resolution(), sampling=sampling) for code, nth in places]
    results = run_cases(cases, jobs=1, store=store, everything=True)
    rows = [row for place, result in zip(places, results, strict=True) for row in _rows(*place, result, arrays)]
    return pd.DataFrame(rows, columns=["chain", "code", "observable", "difference", "uncertainty", "failure"])


def _rows(code: str, nth: int, result: Result, arrays: Mapping[str, Floats]) -> Iterator[tuple[Any, ...]]:
    """Yield a row of the check for each observable of a chain."""
    for name in OBSERVABLES:
        if result.trajectory is None:
            yield nth, code, name, math.nan, math.nan, str(result.failure)
            continue
        observable, scene = observable_named(name), result.case.scene
        values = np.atleast_1d(observable.value(scene, result.trajectory))
        bars = np.atleast_1d(observable.uncertainty(scene, result.trajectory)) / own_scale(values)
        off = difference(np.atleast_1d(arrays[name][nth])[None], values[None])[0]
        yield nth, code, name, float(off), float(np.nanmax(bars, initial=0.0)), ""
