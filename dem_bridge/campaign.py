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
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from types import ModuleType

from dem_bridge.backends.base import Backend, backend, unsupported_reason
from dem_bridge.errors import BackendUnavailable, RunBroken, UnsupportedScene, UsageError
from dem_bridge.progress import listening
from dem_bridge.runs.cache import load_run
from dem_bridge.runs.case import Case
from dem_bridge.runs.store import Store
from dem_bridge.scene import Scene
from dem_bridge.trajectory import UNKNOWN, Trajectory
from dem_bridge.uncertainty.estimate import solve

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


def run_case(case: Case, *, everything: bool = False, by: Backend | None = None) -> Result:
    """Run one case; an unsupported scene, a missing engine or a broken run is a result. ``everything``: wrong settings
    and crashes, too. ``by``: a backend in place of the one that the case names."""
    try:
        chosen = by or backend(case.backend, case.engine)
        reason = unsupported_reason(chosen, case.scene)
        if reason:
            return Result(case=case, failure=UnsupportedScene(reason))
        return Result(case=case, trajectory=solve(case, code=chosen if by else None))
    except (UnsupportedScene, BackendUnavailable, RunBroken) as error:
        return Result(case=case, failure=error)
    except UsageError as error:
        if not everything:
            raise
        return Result(case=case, failure=error)
    except Exception as error:
        if not everything:
            raise
        # as text: not every exception can travel from another process
        return Result(case=case, failure=Crashed(f"{type(error).__name__}: {error}", log=traceback.format_exc()))


def run_cases(
    cases: Sequence[Case],
    *,
    jobs: int | None = 1,
    progress: Progress | None = None,
    store: Store | None = None,
    everything: bool = False,
) -> tuple[Result, ...]:
    """Run all cases, ``jobs`` at a time; results in the order of the cases.

    ``jobs``: None for as many as there are cores, where what is to be run is worth the start of other processes.
    ``store``: where trajectories are looked for, and kept as they come. ``progress`` is called with (done, total,
    label), where done goes with the time that runs are expected to take. UsageError for a law that cannot go to the
    processes asked for; RunBroken where one of these dies. ``everything``: wrong settings and crashes
    (:class:`Crashed`) are results, too, and stop nothing.
    """
    if jobs is not None and jobs > 1:
        for scene in {id(case.scene): case.scene for case in cases}.values():
            if reason := _stays(scene):
                raise UsageError(
                    f"jobs = {jobs}: the law of {scene.name} cannot go to another process ({reason});"
                    " allowed: laws that are functions of a module, or jobs = 1"
                )
    # a case without a key is like no other
    same = [replace(case, uncertainty=False).key or str(number) for number, case in enumerate(cases)]
    found: dict[str, Result] = {}
    left: dict[str, Case] = {}
    # a run with its uncertainty is also that of the case without
    for one, case in sorted(zip(same, cases, strict=True), key=lambda item: not item[1].uncertainty):
        if one in found or one in left:
            continue
        run = load_run(case, store)
        if run is None:
            left[one] = case
        else:
            found[one] = Result(case=case, trajectory=run, key=case.key)
    keys = {one: case.key for one, case in left.items()}
    whole = sum(case.expected for case in left.values())

    def say(label: str, part: float = 0.0) -> None:
        if progress is not None:
            progress(
                len(cases) * (1.0 - (sum(case.expected for case in left.values()) - part) / whole), len(cases), label
            )

    def keep(one: str, result: Result) -> None:
        case, run = left.pop(one), result.trajectory
        # the key again, for an engine may have become another meanwhile
        if store is not None and (key := case.key) is not None and key == keys[one]:
            result = replace(result, key=key if run is not None else f"{key}: {result.failure}")
            if run is not None:
                store.save(key, run)
        found[one] = result
        say(case.label)

    _run_all(left.copy(), jobs, keep, say, partial(run_case, everything=everything))
    if progress is not None:
        progress(len(cases), len(cases), "")
    return tuple(_as_of(case, found[one]) for case, one in zip(cases, same, strict=True))


def run_groups(
    groups: Sequence[Sequence[Case]],
    *,
    jobs: int | None = 1,
    progress: Progress | None = None,
    store: Store | None = None,
) -> list[tuple[Result, ...]]:
    """As :func:`run_cases`, all groups together; the results of each group."""
    results = iter(run_cases([case for group in groups for case in group], jobs=jobs, progress=progress, store=store))
    return [tuple(next(results) for _ in group) for group in groups]


def _run_all(
    cases: dict[str, Case],
    jobs: int | None,
    keep: Callable[[str, Result], None],
    say: Callable[[str, float], None],
    run: Callable[[Case], Result],
) -> None:
    # the longest first: then all cores end at about the same time
    names = sorted(cases, key=lambda one: -cases[one].expected)
    away = {one: cases[one] for one in names if jobs is not None or not _stays(cases[one].scene, of_main=True)}
    workers = _workers(jobs, away.values())
    if workers > 1:
        _run_away(away, workers, keep, run)
    for one in names:
        if workers > 1 and one in away:
            continue
        label = cases[one].label
        say(label, 0.0)
        with listening(partial(_within, say, label, cases[one].expected)):
            result = run(cases[one])
        keep(one, result)


def _run_away(
    cases: dict[str, Case], workers: int, keep: Callable[[str, Result], None], run: Callable[[Case], Result]
) -> None:
    """In processes of their own."""
    others, ended = set(multiprocessing.active_children()), False
    # spawn: compiled code and engines do not survive a fork of a process with threads
    executor = ProcessPoolExecutor(
        max_workers=workers,
        mp_context=multiprocessing.get_context("spawn"),
        initializer=_begin,
    )
    try:
        with _bare_main(any(_stays(case.scene, of_main=True) for case in cases.values())):
            futures = {executor.submit(run, case): one for one, case in cases.items()}
        for future in as_completed(futures):
            keep(futures[future], future.result())
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
    """In each worker: Ctrl-C is for the program that asked, and the worker ends with that however it ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    assert parent is not None  # a worker has one

    def leave() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=leave, daemon=True).start()


@contextmanager
def _bare_main(needed: bool) -> Iterator[None]:
    """Unless it is needed, processes get nothing of the program that asks: one that runs as a whole when it is
    imported, without ``if __name__ == "__main__"``, would ask again in each."""
    main = sys.modules["__main__"]
    if not needed:
        sys.modules["__main__"] = ModuleType("__main__")
    try:
        yield
    finally:
        sys.modules["__main__"] = main


def _workers(jobs: int | None, cases: Iterable[Case]) -> int:
    """How many processes pay."""
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
