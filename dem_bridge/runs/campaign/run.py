"""Many cases on all cores: what is to be run in, trajectories or the reasons why not out, in the same order.

What the store has is not run, and what is the same is run once.
"""

from __future__ import annotations

import os
import pickle
import random
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import closing
from dataclasses import replace
from typing import Any

from dem_bridge.errors import RunBroken, UsageError
from dem_bridge.foundation.leftovers import sweep_temporary
from dem_bridge.foundation.progress import Campaign, Interrupted, campaign
from dem_bridge.runs.cache import RunCache
from dem_bridge.runs.campaign.executors import Jobs, fingerprint_of, run_by_executor
from dem_bridge.runs.campaign.here import can_run_beside, run_here
from dem_bridge.runs.campaign.nodes import Graph, Groups, Node, Run
from dem_bridge.runs.campaign.pool import run_in_processes
from dem_bridge.runs.campaign.results import Progress, Result, run_case
from dem_bridge.runs.campaign.tasks import Outcome, Task, key_where_made
from dem_bridge.runs.case import Case
from dem_bridge.runs.digits import fingerprint, made_at
from dem_bridge.runs.store import Store
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import UNKNOWN

Groupings = Sequence[Sequence[Case]]
#: called with the number of a group and its results
Ended = Callable[[int, tuple[Result, ...]], None]
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
    [results] = _run([cases], jobs, progress, store, everything=everything, cache=cache)
    return results


def run_groups(
    groups: Groupings,
    *,
    jobs: Jobs = 1,
    progress: Progress | None = None,
    store: Store | None = None,
    cache: RunCache | None = None,
    ended: Ended | None = None,
) -> list[tuple[Result, ...]]:
    """Run all groups of cases together, see :func:`run_cases`; return the results of each group.

    ``ended`` is called with the number of a group and its results as soon as all of them are there. With it the cases
    of a group are begun together.
    """
    return _run(groups, jobs, progress, store, cache=cache, ended=ended)


def _run(
    groups: Groupings,
    jobs: Jobs,
    progress: Progress | None,
    store: Store | None,
    *,
    everything: bool = False,
    cache: RunCache | None = None,
    ended: Ended | None = None,
) -> list[tuple[Result, ...]]:
    """Run all cases of all groups, and return the results of each group."""
    if isinstance(jobs, int) and jobs > 1:
        for scene in {id(case.scene): case.scene for group in groups for case in group}.values():
            if reason := reason_to_stay(scene):
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
        return _Execution(groups, store, cache, everything=everything, ended=ended).run(jobs, progress)


class _Execution:
    """Groups of cases, and the results of their nodes as they come.

    Keys are those of the place where runs are planned to be made.
    """

    def __init__(
        self, groups: Groupings, store: Store | None, cache: RunCache, *, everything: bool, ended: Ended | None
    ) -> None:
        self.cases, self.store, self.everything, self.ended = groups, store, everything, ended
        self.graph = Graph((case for group in groups for case in group), cache)
        self.groups = Groups([len(group) for group in groups], self.graph)
        self.keeper = _Keeper(store, cache)
        stored = self.graph.stored
        self.results = {node.name: Result(case=node.case, trajectory=node.run, key=node.key) for node in stored}

    def tasks(self) -> list[Task]:
        """Return the tasks, the longest first; if ``ended``, those of a group one after another."""
        shared, longest = self.graph.shared, self.groups.longest() if self.ended is not None else {}

        def order(node: Node) -> tuple[float, ...]:
            seconds, number = longest.get(node.name, (0.0, 0))
            return -seconds, number, *order_of_node(node)

        return [
            replace(_task(node, self.store, everything=self.everything), shared=node.name in shared)
            for node in sorted(self.graph.tasks, key=order)
        ]

    def run(self, jobs: Jobs, progress: Progress | None) -> list[tuple[Result, ...]]:
        """Run the tasks, put together what needs them, and return the results of each group."""
        tasks, total = self.tasks(), len(set(self.graph.names))  # equal cases are run once
        remaining = {task.name: task.case.expected for task in tasks}
        whole = sum(remaining.values())

        def say(label: str, part: float = 0.0) -> None:
            if progress is not None:
                progress(total * (1.0 - (sum(remaining.values()) - part) / whole), total, label)

        with (
            campaign(len(tasks) + len(self.results), len(self.results)) as state,
            closing(_outcomes(tasks, jobs, say, state)) as outcomes,
        ):
            self.finish()
            for task, outcome in outcomes:
                del remaining[task.name]
                if outcome.error is not None:
                    raise outcome.error
                self.results[task.name] = self.keeper.take(task, outcome)
                self.finish(task.name)
                say(task.case.label)
                state.update(done=1, failures=isinstance(outcome.failure, RunBroken))
        if remaining:  # only where a stop is requested
            after = "they are not kept" if not self.keeper.keeps else "they are kept, and a second call goes on"
            raise Interrupted(f"interrupted after {state.done} of {state.total} runs; {after}")
        if progress is not None:
            progress(total, total, "")
        return [self.of_group(number) for number in range(len(self.cases))]

    def finish(self, *made: str) -> None:
        """Put together what can be now that further tasks are made, and hand over each group that is complete."""
        complete = [*made] if made else [*self.results]
        for node in self.graph.put_together(made):
            self.results[node.name] = self.keeper.put_together(node, self.results, everything=self.everything)
            complete.append(node.name)
        if self.ended is not None:
            for number in self.groups.completed(complete):
                self.ended(number, self.of_group(number))

    def of_group(self, number: int) -> tuple[Result, ...]:
        """Return the results of a group that is complete."""
        pairs = zip(self.cases[number], self.groups.names[number], strict=True)
        return tuple(_as_of(case, self.results[name]) for case, name in pairs)


def order_of_node(node: Node) -> tuple[float, float]:
    """Return the key by which tasks are ordered: the longest first, so that all cores end at about the same time.

    Those that take about as long are in random order, so that two campaigns over one store do not run the same.
    """
    return -float(f"{node.case.expected:.1g}"), random.random()


def _task(node: Node, store: Store | None, *, everything: bool) -> Task:
    """Return a node as the task of a worker."""
    where: dict[str, Any] = {}
    if store is not None:
        where = {"key": node.key, "folder": store.folder, "limit": store.limit, "recompute": store.recompute}
    return Task(name=node.name, case=node.case, everything=everything, **where)


class _Keeper:
    """What becomes of the outcomes of a campaign: results, which a store keeps."""

    def __init__(self, store: Store | None, cache: RunCache) -> None:
        self.store, self.cache = store, cache

    @property
    def keeps(self) -> bool:
        """Return True if there is a store that runs can be written to."""
        return self.store is not None and not self.store.trouble

    def take(self, task: Task, outcome: Outcome) -> Result:
        """Return the result of a task; what other nodes need of it is in the cache then."""
        result = Result(case=task.case, trajectory=outcome.trajectory, failure=outcome.failure)
        if outcome.cache is not None:
            self.cache.adopt(outcome.cache)
            if outcome.kept and result.trajectory is not None:
                self.cache.keep(task.case, replace(result.trajectory, uncertainty=UNKNOWN))
        if self.store is not None:
            self.store.trouble = self.store.trouble or outcome.trouble
        return replace(result, key=task.key) if outcome.kept else self._stored(result, outcome.key, outcome.digits)

    def put_together(self, node: Node, results: Mapping[str, Result], *, everything: bool) -> Result:
        """Return the result of a node that needs others, of whose results the first failure is its own."""
        needed = [results[need] for need in node.needs]
        if isinstance(node, Run) and node.estimate:
            of_both = results[node.estimate]
            run = None if of_both.trajectory is None else replace(of_both.trajectory, uncertainty=UNKNOWN)
            # the entry of the estimate is that of the run, too
            key = of_both.key if run is None else of_both.key and node.key
            return Result(case=node.case, trajectory=run, failure=of_both.failure, key=key)
        failed = [result for result in needed if result.failure]
        result = failed[0] if failed else run_case(node.case, everything=everything, cache=self.cache)
        # it is made of runs of the place that was planned, and stored if this is that place
        made = None if self.store is None else key_where_made(node.case, node.key)
        digits = fingerprint() if self.store is not None else ""
        return self._stored(replace(result, case=node.case), made, digits)

    def _stored(self, result: Result, made: str | None, digits: str) -> Result:
        """Store a result under ``made``, its key where it was made, unless the engine is or has become another."""
        if self.store is None or made is None:
            return result
        key = self.cache.key(result.case)
        if key != made:  # it was made at another place than planned, or the engine has become another
            if result.case.key != key:
                return result
            with made_at(digits):
                key = result.case.key
            if key != made:
                return result
        if result.trajectory is None:
            return replace(result, key=f"{key}: {result.failure}")
        self.store.save(key, result.trajectory)
        return replace(result, key=key)


def _outcomes(
    tasks: Sequence[Task], jobs: Jobs, say: Callable[[str, float], None], state: Campaign
) -> Generator[tuple[Task, Outcome], None, None]:
    """Yield each task with its outcome: first those that go elsewhere, as they come, then those that stay here.

    When a stop is requested, those that have begun are ended, and no other begins.
    """
    away = [task for task in tasks if isinstance(jobs, int) or not reason_to_stay(task.case.scene, of_main=True)]
    if isinstance(jobs, Executor):
        yield from run_by_executor(away, jobs, state)
    elif (workers := count_workers(jobs, [task.case for task in away])) > 1:
        main = any(reason_to_stay(task.case.scene, of_main=True) for task in away)
        yield from run_in_processes(away, workers, state, main=main)
    else:
        away = []
    gone = {task.name for task in away}
    here = [task for task in tasks if task.name not in gone]
    beside = not away and not isinstance(jobs, Executor) and can_run_beside(jobs, [task.case for task in here])
    yield from run_here(here, say, state, beside=beside)


def count_workers(jobs: int | None, cases: Iterable[Case]) -> int:
    """Return how many processes run the cases: ``jobs`` where it is given, otherwise as many as save time."""
    cases = list(cases)
    if jobs is not None:
        return min(jobs, len(cases))
    ranks = max((case.engine.ranks for case in cases if case.engine is not None), default=1)
    cores = min(len(os.sched_getaffinity(0)) // ranks, len(cases))
    work = sum(case.expected for case in cases)
    return cores if cores > 1 and work - work / cores > _START else 1


def reason_to_stay(scene: Scene, *, of_main: bool = False) -> str:
    """Return why a scene cannot go to another process, '' where it can.

    ``of_main``: laws that only the main program has stay, too.
    """
    if scene.law is None:
        return ""
    try:
        packed = pickle.dumps(scene.law)
    except (pickle.PicklingError, AttributeError, TypeError) as error:
        return str(error)
    return "it is of the main program" if of_main and b"__main__" in packed else ""


def _as_of(case: Case, result: Result) -> Result:
    """Return the result of another case that differs in the name of its scene."""
    run, name = result.trajectory, case.scene.name
    if run is not None and result.case.scene.name != name:
        run = replace(run, provenance={**run.provenance, "scene": name})
    return replace(result, case=case, trajectory=run)
