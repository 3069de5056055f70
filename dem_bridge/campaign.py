"""Many cases on all cores: what is to be run in, trajectories or the reasons why not out, in the same order.

What the store has is not run, and what is the same is run once.
"""

from __future__ import annotations

import multiprocessing
import os
import pickle
import signal
import sys
import threading
import traceback
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from types import ModuleType

from dem_bridge.backends.base import Backend, Sampling, backend, unsupported_reason
from dem_bridge.errors import BackendUnavailable, RunBroken, UnsupportedScene, UsageError
from dem_bridge.progress import listening
from dem_bridge.runs.cache import RunCache, load_run
from dem_bridge.runs.case import Case
from dem_bridge.runs.store import Store
from dem_bridge.scene import Scene
from dem_bridge.trajectory import UNKNOWN, Trajectory
from dem_bridge.uncertainty.estimate import TWIN, parts_of, solve

#: s that a worker needs until it can begin: what takes less in all is run here
_START = 2.0


@dataclass(frozen=True, kw_only=True)
class Result:
    """A case with its trajectory, or with the reason why there is none."""

    case: Case
    trajectory: Trajectory | None = None
    failure: UnsupportedScene | BackendUnavailable | RunBroken | UsageError | None = None
    key: str | None = None
    """What decides the result: the key of the run in the store, and the failure; None: nothing that could be told."""


class Crashed(RunBroken):
    """A backend raised what none should: a fault of ours. ``log`` has the traceback."""


#: done, total, what is being done
Progress = Callable[[float, int, str], None]


def run_case(
    case: Case, *, everything: bool = False, by: Backend | None = None, cache: RunCache | None = None
) -> Result:
    """Run one case; an unsupported scene, a missing engine or a broken run is a result.

    ``everything``: wrong settings and crashes are results, too. ``by``: a backend in place of the one that the case
    names. ``cache``: where runs and families are looked for and kept.
    """
    try:
        chosen = by or backend(case.backend, case.engine)
        reason = unsupported_reason(chosen, case.scene)
        if reason:
            return Result(case=case, failure=UnsupportedScene(reason))
        return Result(case=case, trajectory=solve(case, cache, chosen if by else None))
    except (UnsupportedScene, BackendUnavailable, RunBroken) as error:
        return Result(case=case, failure=error)
    except Exception as error:
        if not everything:
            raise
        if isinstance(error, UsageError):
            return Result(case=case, failure=error)
        # as text: not every exception can travel from another process
        return Result(case=case, failure=Crashed(f"{type(error).__name__}: {error}", log=traceback.format_exc()))


def run_cases(
    cases: Sequence[Case],
    *,
    jobs: int | None = 1,
    progress: Progress | None = None,
    store: Store | None = None,
    everything: bool = False,
    cache: RunCache | None = None,
) -> tuple[Result, ...]:
    """Run all cases and return the results in the order of the cases; runs that they share are made once.

    Parameters
    ----------
    cases : sequence of Case
    jobs : int or None
        Number of runs at a time; None: as many as there are cores, where other processes are worth their start.
    progress : callable, optional
        Called with (done, total, label); done follows the time that runs are expected to take.
    store : Store, optional
        Where trajectories are looked for, and kept as they come.
    everything : bool
        Wrong settings and crashes (:class:`Crashed`) are results, too, and stop nothing.
    cache : RunCache, optional
        Runs and families that exist already, such as those of the choice of a step.

    Raises
    ------
    UsageError
        For a law that cannot go to another process, with ``jobs`` above 1.
    RunBroken
        If one of the processes dies.
    """
    if jobs is not None and jobs > 1:
        for scene in {id(case.scene): case.scene for case in cases}.values():
            if reason := _stays(scene):
                raise UsageError(
                    f"jobs = {jobs}: the law of {scene.name} cannot go to another process ({reason});"
                    " allowed: laws that are functions of a module, or jobs = 1"
                )
    cache = cache or RunCache(store)
    # a case without a name is like no other
    names = [_name(case) or str(number) for number, case in enumerate(cases)]
    results: dict[str, Result] = {}
    left: dict[str, Case] = {}
    # a run with its uncertainty is also that of the case without
    for name, case in sorted(zip(names, cases, strict=True), key=lambda item: not item[1].uncertainty):
        if name in results or name in left:
            continue
        run = load_run(case, store)
        if run is None:
            left[name] = case
        else:
            results[name] = Result(case=case, trajectory=run, key=case.key if case.uncertainty else name)
    parts = {name: parts_of(case, cache) if _name(case) else None for name, case in left.items()}
    todo = _to_run(left, parts)
    keys = {case: case.key for case in (*todo.values(), *left.values())}
    remaining = {name: case.expected for name, case in todo.items()}
    whole = sum(remaining.values())

    def say(label: str, part: float = 0.0) -> None:
        if progress is not None:
            progress(len(cases) * (1.0 - (sum(remaining.values()) - part) / whole), len(cases), label)

    def stored(result: Result) -> Result:
        # the key again, for an engine may have become another meanwhile
        if store is None or (key := result.case.key) is None or key != keys[result.case]:
            return result
        if result.trajectory is None:
            return replace(result, key=f"{key}: {result.failure}")
        store.save(key, result.trajectory)
        return replace(result, key=key)

    def keep(name: str, result: Result, others: RunCache) -> None:
        del remaining[name]
        cache.adopt(others)
        results[name] = stored(result)
        say(result.case.label)

    _run_all(todo, jobs, keep, say, partial(_run_alone, everything=everything))
    for name, case in left.items():
        if todo.get(name) == case:
            continue
        broken = [results[part] for part in map(_name, parts[name] or ()) if part in todo and results[part].failure]
        result = broken[0] if broken else run_case(case, everything=everything, cache=cache)
        results[name] = stored(replace(result, case=case))
    if progress is not None:
        progress(len(cases), len(cases), "")
    return tuple(_as_of(case, results[name]) for case, name in zip(cases, names, strict=True))


def _name(case: Case) -> str | None:
    """Return the name under which a case is the same with and without its uncertainty; None: it is like no other."""
    return replace(case, uncertainty=False).key


def _to_run(left: Mapping[str, Case], parts: Mapping[str, tuple[Case, ...] | None]) -> dict[str, Case]:
    """Return the cases to be solved, by name: those without parts, and the parts of the others."""
    todo: dict[str, Case] = {}
    for name, case in left.items():
        needed = parts[name]
        for part in (case,) if needed is None else needed:
            part_name = name if needed is None else str(_name(part))
            if part.uncertainty or part_name not in todo:
                todo[part_name] = part
    # twins without uncertainty may be runs of the family of another twin
    families = {_steps(case) for case in todo.values() if case.backend == TWIN and case.uncertainty}
    return {
        name: case
        for name, case in todo.items()
        if case.backend != TWIN or case.uncertainty or _steps(case) not in families
    }


def _steps(case: Case) -> tuple[Scene, float | None, Sampling]:
    return case.scene, case.resolution.dt, case.sampling


def _run_alone(case: Case, *, everything: bool) -> tuple[Result, RunCache]:
    """Run one case; return the result, and all runs and families that were made for it."""
    cache = RunCache()
    return run_case(case, everything=everything, cache=cache), cache


def run_groups(
    groups: Sequence[Sequence[Case]],
    *,
    jobs: int | None = 1,
    progress: Progress | None = None,
    store: Store | None = None,
    cache: RunCache | None = None,
) -> list[tuple[Result, ...]]:
    """Run all groups of cases together, see :func:`run_cases`; return the results of each group."""
    cases = [case for group in groups for case in group]
    results = iter(run_cases(cases, jobs=jobs, progress=progress, store=store, cache=cache))
    return [tuple(next(results) for _ in group) for group in groups]


def _run_all(
    cases: dict[str, Case],
    jobs: int | None,
    keep: Callable[[str, Result, RunCache], None],
    say: Callable[[str, float], None],
    run: Callable[[Case], tuple[Result, RunCache]],
) -> None:
    # the longest first: then all cores end at about the same time
    names = sorted(cases, key=lambda name: -cases[name].expected)
    away = {name: cases[name] for name in names if jobs is not None or not _stays(cases[name].scene, of_main=True)}
    workers = _workers(jobs, away.values())
    if workers > 1:
        _run_away(away, workers, keep, run)
    for name in names:
        if workers > 1 and name in away:
            continue
        label = cases[name].label
        say(label, 0.0)
        with listening(partial(_within, say, label, cases[name].expected)):
            result, others = run(cases[name])
        keep(name, result, others)


def _run_away(
    cases: dict[str, Case],
    workers: int,
    keep: Callable[[str, Result, RunCache], None],
    run: Callable[[Case], tuple[Result, RunCache]],
) -> None:
    """Run cases in other processes."""
    others, ended = set(multiprocessing.active_children()), False
    # spawn: compiled code and engines do not survive a fork of a process with threads
    executor = ProcessPoolExecutor(
        max_workers=workers,
        mp_context=multiprocessing.get_context("spawn"),
        initializer=_begin,
    )
    try:
        with _bare_main(any(_stays(case.scene, of_main=True) for case in cases.values())):
            futures = {executor.submit(run, case): name for name, case in cases.items()}
        for future in as_completed(futures):
            keep(futures[future], *future.result())
        ended = True
    except BrokenProcessPool as error:
        raise RunBroken(
            f"one of {workers} processes died ({error}); where memory is short, or it cannot begin, take jobs = 1"
        ) from error
    finally:
        if not ended:
            for worker in set(multiprocessing.active_children()) - others:
                worker.terminate()
        executor.shutdown(wait=False, cancel_futures=True)


def _begin() -> None:
    """Leave Ctrl-C to the program that started this worker, and end the worker when that program ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    assert parent is not None  # a worker has one

    def leave() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=leave, daemon=True).start()


@contextmanager
def _bare_main(needed: bool) -> Iterator[None]:
    """Hide the main program from new processes, unless they need it.

    A program that runs as a whole when it is imported, without ``if __name__ == "__main__"``, would run again in each.
    """
    main = sys.modules["__main__"]
    if not needed:
        sys.modules["__main__"] = ModuleType("__main__")
    try:
        yield
    finally:
        sys.modules["__main__"] = main


def _workers(jobs: int | None, cases: Iterable[Case]) -> int:
    """Return how many processes run the cases: ``jobs`` where it is given, otherwise as many as save time."""
    cases = list(cases)
    if jobs is not None:
        return min(jobs, len(cases))
    ranks = max((case.engine.ranks for case in cases if case.engine is not None), default=1)
    cores = min(len(os.sched_getaffinity(0)) // ranks, len(cases))
    work = sum(case.expected for case in cases)
    return cores if cores > 1 and work - work / cores > _START else 1


def _stays(scene: Scene, *, of_main: bool = False) -> str:
    """Why a scene cannot go to another process, '' where it can; ``of_main``: nor what only the main program has."""
    if scene.law is None:
        return ""
    try:
        packed = pickle.dumps(scene.law)
    except (pickle.PicklingError, AttributeError, TypeError) as error:
        return str(error)
    return "it is of the main program" if of_main and b"__main__" in packed else ""


def _as_of(case: Case, result: Result) -> Result:
    """Return the result of another case that differs in the name of its scene or has an uncertainty in addition."""
    run, name = result.trajectory, case.scene.name
    if run is not None and result.case.scene.name != name:
        run = replace(run, provenance={**run.provenance, "scene": name})
    if run is not None and result.case.uncertainty and not case.uncertainty:
        run = replace(run, uncertainty=UNKNOWN)
        result = replace(result, key=result.key and case.key)
    return replace(result, case=case, trajectory=run)


def _within(say: Callable[[str, float], None], label: str, expected: float, part: float) -> None:
    say(label, part * expected)
