"""Many cases on all cores: what is to be run in, trajectories or the reasons why not out, in the same order.

What the store has is not run, and what is the same is run once.
"""

from __future__ import annotations

import os
import pickle
import random
from collections import deque
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import closing
from dataclasses import replace
from functools import partial

from dem_bridge.backends.base import Sampling
from dem_bridge.errors import RunBroken, UsageError
from dem_bridge.foundation.leftovers import sweep_temporary
from dem_bridge.foundation.progress import Campaign, Interrupted, campaign, listening, stop_requested
from dem_bridge.runs.cache import RunCache
from dem_bridge.runs.campaign.executors import Jobs, fingerprint_of, run_by_executor
from dem_bridge.runs.campaign.pool import run_in_processes
from dem_bridge.runs.campaign.results import Progress, Result, run_case
from dem_bridge.runs.campaign.tasks import Outcome, Task, claim_of, is_stored, key_where_made, perform_task, with_run
from dem_bridge.runs.case import Case
from dem_bridge.runs.digits import fingerprint, made_at
from dem_bridge.runs.store import Store
from dem_bridge.runs.uncertainty.estimate import TWIN, parts_of
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import UNKNOWN

#: s that a worker needs until it can begin: what takes less in all is run here
_START = 2.0


def jobs_of(jobs: int | None, executor: Executor | None) -> Jobs:
    """Return where cases are run, from the two arguments that say so; UsageError if both are given."""
    if executor is None:
        return jobs
    if jobs is not None:
        raise UsageError(f"jobs = {jobs!r} and executor = {executor!r} were both given; allowed: one of them")
    if not isinstance(executor, Executor):
        raise UsageError(f"executor = {executor!r}; allowed: a concurrent.futures.Executor, or None")
    return executor


def run_cases(
    cases: Sequence[Case],
    *,
    jobs: Jobs = 1,
    progress: Progress | None = None,
    store: Store | None = None,
    everything: bool = False,
    cache: RunCache | None = None,
) -> tuple[Result, ...]:
    """Run all cases and return the results in the order of the cases; runs that they share are made once.

    Parameters
    ----------
    cases : sequence of Case
    jobs : int, Executor or None
        Number of runs at a time; None: as many as there are cores, where other processes are worth their start. An
        executor (``concurrent.futures``) runs the cases where it wants; the results do not depend on it.
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
        If no process can begin, or the executor takes no more cases. A case whose process dies twice is no error, but
        a broken result (:class:`Crashed`).
    """
    if isinstance(jobs, int) and jobs > 1:
        for scene in {id(case.scene): case.scene for case in cases}.values():
            if reason := _stays(scene):
                raise UsageError(
                    f"jobs = {jobs}: the law of {scene.name} cannot go to another process ({reason});"
                    " allowed: laws that are functions of a module, or jobs = 1"
                )
    sweep_temporary()
    place = fingerprint_of(jobs) if isinstance(jobs, Executor) and store is not None else ""
    with made_at(place):
        cache = cache or RunCache(store)
        cache.store = cache.store or store
        cache.missing.clear()  # an earlier campaign, or another one, may have stored them meanwhile
        return _run_planned(cases, jobs, progress, store, everything, cache)


def _run_planned(
    cases: Sequence[Case],
    jobs: Jobs,
    progress: Progress | None,
    store: Store | None,
    everything: bool,
    cache: RunCache,
) -> tuple[Result, ...]:
    """Run all cases; keys are those of the place where runs are planned to be made."""
    # a case without a name is like no other
    name_of = partial(_name, cache)
    names = [name_of(case) or str(number) for number, case in enumerate(cases)]
    results: dict[str, Result] = {}
    left: dict[str, Case] = {}
    # a run with its uncertainty is also that of the case without
    for name, case in sorted(zip(names, cases, strict=True), key=lambda item: not item[1].uncertainty):
        if name in results or name in left:
            continue
        run = cache.load_stored(case)
        if run is None:
            left[name] = case
        else:
            results[name] = Result(case=case, trajectory=run, key=cache.key(case))
    parts = {name: parts_of(case, cache) if name_of(case) else None for name, case in left.items()}
    todo = _to_run(left, parts, name_of)
    remaining = {name: case.expected for name, case in todo.items()}
    whole = sum(remaining.values())

    def say(label: str, part: float = 0.0) -> None:
        if progress is not None:
            progress(len(cases) * (1.0 - (sum(remaining.values()) - part) / whole), len(cases), label)

    def stored(result: Result, made: str | None, digits: str) -> Result:
        """Store a result under ``made``, its key where it was made, unless the engine is or has become another."""
        if store is None or made is None:
            return result
        key = cache.key(result.case)
        if key != made:  # it was made at another place than planned, or the engine has become another
            if result.case.key != key:
                return result
            with made_at(digits):
                key = result.case.key
            if key != made:
                return result
        if result.trajectory is None:
            return replace(result, key=f"{key}: {result.failure}")
        store.save(key, result.trajectory)
        return replace(result, key=key)

    shared = _shared(todo, left, parts, name_of)
    tasks = [
        Task(
            name=name,
            case=case,
            everything=everything,
            key=None if store is None else cache.key(case),
            folder=None if store is None else store.folder,
            limit=0 if store is None else store.limit,
            shared=name in shared,
            recompute=store is not None and store.recompute,
        )
        for name, case in sorted(todo.items(), key=_turn)
    ]
    with (
        campaign(len(tasks) + len(results), len(results)) as state,
        closing(_outcomes(tasks, jobs, say, state)) as outcomes,
    ):
        for task, outcome in outcomes:
            del remaining[task.name]
            if outcome.error is not None:
                raise outcome.error
            result = Result(case=task.case, trajectory=outcome.trajectory, failure=outcome.failure)
            if outcome.cache is not None:
                cache.adopt(outcome.cache)
                if outcome.kept and result.trajectory is not None:
                    cache.keep(task.case, replace(result.trajectory, uncertainty=UNKNOWN))
            if store is not None:
                store.trouble = store.trouble or outcome.trouble
            results[task.name] = (
                replace(result, key=task.key) if outcome.kept else stored(result, outcome.key, outcome.digits)
            )
            say(task.case.label)
            state.update(done=1, failures=isinstance(result.failure, RunBroken))
    if remaining:  # only where a stop is requested
        after = "they are not kept" if store is None or store.trouble else "they are kept, and a second call goes on"
        raise Interrupted(f"interrupted after {state.done} of {state.total} runs; {after}")
    for name, case in left.items():
        if todo.get(name) == case:
            continue
        failed = [results[part] for part in map(name_of, parts[name] or ()) if part in todo and results[part].failure]
        result = failed[0] if failed else run_case(case, everything=everything, cache=cache)
        # it is made of runs of the place that was planned, and stored if this is that place
        made = None if store is None else key_where_made(case, cache.key(case))
        results[name] = stored(replace(result, case=case), made, fingerprint() if store is not None else "")
    if progress is not None:
        progress(len(cases), len(cases), "")
    return tuple(_as_of(case, results[name], cache) for case, name in zip(cases, names, strict=True))


def _turn(item: tuple[str, Case]) -> tuple[float, float]:
    """Return by what cases are ordered: the longest first, so that all cores end at about the same time.

    Those that take about as long are in random order, so that two campaigns over one store do not run the same.
    """
    return -float(f"{item[1].expected:.1g}"), random.random()


def _name(cache: RunCache, case: Case) -> str | None:
    """Return the name under which a case is the same with and without its uncertainty; None: it is like no other."""
    return cache.key(replace(case, uncertainty=False))


def _to_run(
    left: Mapping[str, Case],
    parts: Mapping[str, tuple[Case, ...] | None],
    name_of: Callable[[Case], str | None],
) -> dict[str, Case]:
    """Return the cases to be solved, by name: those without parts, and the parts of the others."""
    todo: dict[str, Case] = {}
    for name, case in left.items():
        needed = parts[name]
        for part in (case,) if needed is None else needed:
            part_name = name if needed is None else str(name_of(part))
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


def _shared(
    todo: Mapping[str, Case],
    left: Mapping[str, Case],
    parts: Mapping[str, tuple[Case, ...] | None],
    name_of: Callable[[Case], str | None],
) -> set[str]:
    """Return the names of cases whose runs or families other cases need."""
    needed = [part for of_case in parts.values() for part in of_case or ()]
    # a twin that is solved with its family for another twin is no task
    twins = {_steps(case) for case in (*needed, *left.values()) if case.backend == TWIN and name_of(case) not in todo}
    shared = {str(name_of(part)) for part in needed}
    return shared | {name for name, case in todo.items() if case.backend == TWIN and _steps(case) in twins}


def run_groups(
    groups: Sequence[Sequence[Case]],
    *,
    jobs: Jobs = 1,
    progress: Progress | None = None,
    store: Store | None = None,
    cache: RunCache | None = None,
) -> list[tuple[Result, ...]]:
    """Run all groups of cases together, see :func:`run_cases`; return the results of each group."""
    cases = [case for group in groups for case in group]
    results = iter(run_cases(cases, jobs=jobs, progress=progress, store=store, cache=cache))
    return [tuple(next(results) for _ in group) for group in groups]


def _outcomes(
    tasks: Sequence[Task], jobs: Jobs, say: Callable[[str, float], None], state: Campaign
) -> Generator[tuple[Task, Outcome], None, None]:
    """Yield each task with its outcome: first those that go elsewhere, as they come, then those that stay here.

    When a stop is requested, those that have begun are ended, and no other begins.
    """
    away = [task for task in tasks if isinstance(jobs, int) or not _stays(task.case.scene, of_main=True)]
    if isinstance(jobs, Executor):
        yield from run_by_executor(away, jobs, state)
    elif (workers := _workers(jobs, [task.case for task in away])) > 1:
        main = any(_stays(task.case.scene, of_main=True) for task in away)
        yield from run_in_processes(away, workers, state, main=main)
    else:
        away = []
    gone = {task.name for task in away}
    here = deque(task for task in tasks if task.name not in gone)
    while here and not stop_requested():
        task = here.popleft()
        label = task.case.label
        say(label, 0.0)
        state.update(running=(label,))
        with claim_of(task) as free:
            if not free:  # another campaign is at it
                here.append(replace(task, waits=True))
                continue
            with listening(partial(_within, say, label, task.case.expected)):
                stored = with_run(task, Outcome(kept=True)) if is_stored(task) else None
                outcome = stored or perform_task(replace(task, folder=None, here=True))
            yield task, outcome  # it is stored before the claim ends


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


def _as_of(case: Case, result: Result, cache: RunCache) -> Result:
    """Return the result of another case that differs in the name of its scene or has an uncertainty in addition."""
    run, name = result.trajectory, case.scene.name
    if run is not None and result.case.scene.name != name:
        run = replace(run, provenance={**run.provenance, "scene": name})
    if run is not None and result.case.uncertainty and not case.uncertainty:
        run = replace(run, uncertainty=UNKNOWN)
        result = replace(result, key=result.key and cache.key(case))
    return replace(result, case=case, trajectory=run)


def _within(say: Callable[[str, float], None], label: str, expected: float, part: float) -> None:
    say(label, part * expected)
