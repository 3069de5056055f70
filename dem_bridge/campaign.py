"""Many cases on an executor: what is to be run in, trajectories or the reasons why not out, in the same order."""

from __future__ import annotations

import multiprocessing
import pickle
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from functools import partial

from dem_bridge import progress
from dem_bridge.backends.base import Resolution, Sampling, backend
from dem_bridge.errors import BackendUnavailable, RunBroken, UnsupportedScene, UsageError
from dem_bridge.lmp.engine import Engine
from dem_bridge.scene import Scene
from dem_bridge.trajectory import Trajectory


@dataclass(frozen=True, kw_only=True)
class Case:
    """One run to be made."""

    scene: Scene
    backend: str
    resolution: Resolution
    sampling: Sampling
    engine: Engine | None = None
    """Which LAMMPS, for a backend that runs it; None: the default."""

    @property
    def label(self) -> str:
        dt = self.resolution.dt
        return f"{self.scene.name}: {self.backend}" + (f" at dt = {dt:.3g} s" if dt else "")


@dataclass(frozen=True, kw_only=True)
class Result:
    """A case with its trajectory, or with the one of the three reasons why there is none."""

    case: Case
    trajectory: Trajectory | None = None
    failure: UnsupportedScene | BackendUnavailable | RunBroken | None = None


#: done, total, what is being done
Progress = Callable[[float, int, str], None]


def run_case(case: Case) -> Result:
    """Run one case; a refusal, a missing engine or a broken run is a result."""
    chosen = backend(case.backend, case.engine)
    reason = chosen.refusal(case.scene)
    if reason:
        return Result(case=case, failure=UnsupportedScene(reason))
    try:
        return Result(case=case, trajectory=chosen.run(case.scene, case.resolution, case.sampling))
    except (UnsupportedScene, BackendUnavailable, RunBroken) as error:
        return Result(case=case, failure=error)


def run_cases(cases: Sequence[Case], *, jobs: int = 1, tell: Progress | None = None) -> tuple[Result, ...]:
    """Run all cases, ``jobs`` at a time; results in the order of the cases."""

    def say(done: float, label: str) -> None:
        if tell is not None:
            tell(done, len(cases), label)

    results: list[Result] = []
    if jobs <= 1:
        for done, case in enumerate(cases):
            label = case.label
            say(done, label)
            with progress.listening(partial(_within, say, done, label)):
                results.append(run_case(case))
        say(len(cases), "")
        return tuple(results)
    for scene in {id(case.scene): case.scene for case in cases}.values():
        try:
            pickle.dumps(scene.law)
        except (pickle.PicklingError, AttributeError, TypeError) as error:
            raise UsageError(
                f"jobs = {jobs}: the law of {scene.name} cannot go to another process ({error});"
                " allowed: laws that are functions of a module, or jobs = 1"
            ) from None
    # spawn: compiled code and engines do not survive a fork of a process with threads
    context = multiprocessing.get_context("spawn")
    executor = ProcessPoolExecutor(max_workers=jobs, mp_context=context)
    try:
        futures = [executor.submit(run_case, case) for case in cases]
        for done, future in enumerate(as_completed(futures), start=1):
            say(done, future.result().case.label)
        return tuple(future.result() for future in futures)
    except KeyboardInterrupt:
        for worker in multiprocessing.active_children():
            worker.terminate()
        raise
    finally:
        executor.shutdown(wait=False, cancel_futures=True)


def _within(say: Callable[[float, str], None], done: int, label: str, part: float) -> None:
    say(done + part, label)
