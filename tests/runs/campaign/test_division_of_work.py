"""Which case is run where, how often, and with what: each choice of a campaign by itself."""

from __future__ import annotations

import multiprocessing
import os
import pickle
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import BrokenExecutor, Executor, Future, ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from dem_bridge.backends.base import Availability, Resolution, Sampling
from dem_bridge.errors import RunBroken, UnsupportedScene
from dem_bridge.foundation.progress import Campaign, report, watching
from dem_bridge.lmp.engine import Engine
from dem_bridge.runs.cache import RunCache
from dem_bridge.runs.campaign import Crashed, executors, fingerprint_of, here, map_in_threads, pool, run, run_cases
from dem_bridge.runs.campaign.results import run_case
from dem_bridge.runs.campaign.tasks import Outcome, Task, Work, perform_task
from dem_bridge.runs.case import Case
from dem_bridge.runs.store import Store
from dem_bridge.scene.features import SEVERAL_MOVING
from dem_bridge.scene.scene import Scene
from dem_bridge.scene.support import Support
from dem_bridge.trajectory.trajectory import Trajectory
from tests.helpers.campaign_cases import SHORT, short_case
from tests.helpers.fake_runs import free_flight

# executors


class Failing(Executor):
    """Raise an error in each call, or when it is given one."""

    _max_workers = 1

    def __init__(self, error: Exception, *, submitted: bool = False) -> None:
        self.error, self.submitted, self.sizes = error, submitted, list[int]()

    def submit(self, function: Any, /, *arguments: Any, **keywords: Any) -> Future[Any]:
        if self.submitted:
            raise self.error
        self.sizes.append(len(arguments[0]))
        future: Future[Any] = Future()
        future.set_exception(self.error)
        return future


class KilledWorker(Exception):
    """Stand for the error of Dask, which has tried a task on several workers."""


@pytest.mark.parametrize(
    ("cases", "error", "sizes"),
    [
        # alone once more; Dask has done so
        (1, MemoryError("no room"), [1, 1]),
        (1, KilledWorker("a"), [1]),
        # of a chunk any case may be the one
        (2, KilledWorker("a"), [2, 1, 1]),
        (3, KilledWorker("a"), [3, 1, 1, 1]),
    ],
)
def test_a_case_is_tried_once_more_unless_dask_has_tried_it_alone(
    cases: int, error: Exception, sizes: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("dem_bridge.runs.campaign.tasks.CHUNKS_EACH", 1e-3)  # all in one
    executor = Failing(error)
    results = run_cases([short_case(dt=1e-6 / k) for k in range(1, cases + 1)], jobs=executor)
    assert executor.sizes == sizes
    assert all(isinstance(result.failure, Crashed) for result in results)


def test_processes_of_our_own_replace_a_pool_that_breaks(monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[Any] = []

    def in_processes(
        tasks: Sequence[Task], workers: int, state: Campaign, *, main: bool
    ) -> Iterator[tuple[Task, Outcome]]:
        calls.append((len(tasks), workers, main))
        for task in tasks:
            yield task, perform_task(task)

    monkeypatch.setattr(executors, "run_in_processes", in_processes)
    cases = [short_case(), short_case(dt=5e-7)]
    results = run_cases(cases, jobs=Failing(BrokenExecutor("a process died"), submitted=True))
    assert calls == [(2, 1, False)]  # what the main program has alone never went there
    assert [result.case for result in results] == cases
    assert all(result.trajectory is not None for result in results)


class Blind(Executor):
    """Call functions here, except that which looks for a file; note the folders of the tasks."""

    def __init__(self, answer: bool | Exception) -> None:
        self.answer, self.folders = answer, set[Path | None]()

    def submit(self, function: Any, /, *arguments: Any, **keywords: Any) -> Future[Any]:
        future: Future[Any] = Future()
        if function is not os.path.exists:
            self.folders |= {pickle.loads(packed).folder for packed in arguments[0]} if arguments else set()
            future.set_result(function(*arguments, **keywords))
        elif isinstance(self.answer, Exception):
            future.set_exception(self.answer)
        else:
            future.set_result(self.answer)
        return future


@pytest.mark.parametrize(("answer", "shared"), [(True, True), (False, False), (RuntimeError("no files"), False)])
def test_tasks_have_the_folder_of_the_store_where_workers_see_it(
    answer: bool | Exception, shared: bool, tmp_path: Path
) -> None:
    executor = Blind(answer)
    [result] = run_cases([short_case()], jobs=executor, store=Store(tmp_path))
    assert executor.folders == {tmp_path if shared else None}
    assert result.trajectory is not None
    assert result.key == short_case().key


@pytest.mark.parametrize(("jobs", "threads"), [(3, 3), (None, 5)])
def test_threads_are_as_many_as_asked_for_or_as_cores(
    jobs: int | None, threads: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    numbers: list[int] = []

    def pool_of(number: int) -> ThreadPoolExecutor:
        numbers.append(number)
        return ThreadPoolExecutor(number)

    monkeypatch.setattr(executors, "ThreadPoolExecutor", pool_of)
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(range(5)))
    assert map_in_threads(str, [1, 2], jobs) == ["1", "2"]
    assert numbers == [threads]


def test_a_worker_has_a_minute_to_say_its_digits() -> None:
    waits: list[float] = []

    def result(timeout: float) -> str:
        waits.append(timeout)
        return "digits"

    executor: Any = SimpleNamespace(submit=lambda function: SimpleNamespace(result=result))
    assert fingerprint_of(executor) == "digits"
    assert waits == [60.0]


# processes of our own


class Dead:
    """A process that has ended by itself, in order."""

    pid, exitcode = 78, 0

    def __init__(self, **_: Any) -> None:
        pass

    def start(self) -> None:
        pass

    terminate = kill = start

    def join(self, seconds: float | None = None) -> None:
        pass


def test_a_process_that_ended_in_order_is_said_to_have(monkeypatch: pytest.MonkeyPatch) -> None:
    context = SimpleNamespace(Pipe=multiprocessing.Pipe, Process=Dead)
    monkeypatch.setattr(multiprocessing, "get_context", lambda kind: context)
    process = pool.WorkerProcess(False)
    process.replaced(False).stop()
    assert process.end == "process 78 ended with exit code 0"


class Scripted:
    """A process of a script: whether it is started, and for each task an outcome, a death or silence."""

    def __init__(self, main: bool, script: dict[str, str]) -> None:
        self.script, self.main, self.tasks = script, main, list[Task]()
        self.started, self.end, self.overdue = True, "", None
        self.given: list[list[str]] = []
        self.connection = self

    @property
    def is_idle(self) -> bool:
        return not self.tasks

    def assign(self, tasks: Sequence[Task]) -> None:
        self.tasks.extend(tasks)
        self.given.append([task.name for task in tasks])

    def has_outcome(self) -> bool:
        return self.script.get(self.tasks[0].name) != "dies"

    def outcomes(self, work: Work) -> Iterator[tuple[Task, Outcome]]:
        yield from work.done(self.tasks.pop(0), Outcome())

    def replaced(self, main: bool) -> Scripted:
        self.end = "it died"
        return Scripted(main, self.script)

    def terminate(self) -> None:
        pass

    stop = terminate


@pytest.fixture
def processes(monkeypatch: pytest.MonkeyPatch) -> list[Scripted]:
    made: list[Scripted] = []

    def make(main: bool) -> Scripted:
        made.append(Scripted(main, {"b": "dies"}))
        return made[-1]

    monkeypatch.setattr(pool, "WorkerProcess", make)
    monkeypatch.setattr(pool, "wait", lambda connections, timeout: [each for each in connections if each.tasks])
    return made


def test_the_tasks_after_one_that_kills_its_process_are_not_lost(
    processes: list[Scripted], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("dem_bridge.runs.campaign.tasks.CHUNKS_EACH", 1e-3)  # all in one
    tasks = [Task(name=name, case=short_case()) for name in "abcd"]
    state, running = Campaign(total=4, done=0), []
    with watching(lambda state: running.append(state.running)):
        outcomes = list(pool.run_in_processes(tasks, 1, state, main=True))
    names = [task.name for task, _ in outcomes]
    # those that wait behind it come first, and it once more at the end of its trials
    assert sorted(names) == list("abcd")
    broken = {task.name: outcome.failure for task, outcome in outcomes if outcome.failure}
    assert list(broken) == ["b"]
    assert str(broken["b"]).endswith("its process died twice")
    assert len(processes) == 1
    assert processes[0].main
    assert running[0] == (tasks[0].case.label,)


def test_three_processes_in_a_row_that_cannot_begin_are_enough(
    processes: list[Scripted], monkeypatch: pytest.MonkeyPatch
) -> None:
    # two that die at their start; one that begins, does the first case and dies at the second; three that die
    answers = iter([False, False, True, True, False, False, False, False])

    def outcomes(process: Scripted, work: Work) -> Iterator[tuple[Task, Outcome]]:
        if process.started:
            yield from work.done(process.tasks.pop(0), Outcome())
        process.started = True

    def replaced(process: Scripted, main: bool) -> Scripted:
        process.end, after = "it died", Scripted(main, {})
        after.started = False
        return after

    monkeypatch.setattr(pool, "WorkerProcess", lambda main: replaced(Scripted(main, {}), main))
    monkeypatch.setattr(pool, "wait", lambda connections, timeout: connections)
    monkeypatch.setattr(Scripted, "is_idle", property(lambda process: process.started and not process.tasks))
    monkeypatch.setattr(Scripted, "replaced", replaced)
    monkeypatch.setattr(Scripted, "outcomes", outcomes)
    monkeypatch.setattr(Scripted, "has_outcome", lambda process: next(answers))
    tasks = [Task(name=name, case=short_case()) for name in "ab"]
    found = pool.run_in_processes(tasks, 1, Campaign(total=2, done=0), main=False)
    task, _ = next(found)
    assert task.name == "a"
    with pytest.raises(RunBroken, match=r"^3 processes died before they could begin \(it died\)"):
        next(found)


# cases


class Own:
    """A backend that raises an error, or returns a run."""

    name, equations = "own", "hertz"
    order: int | None = None
    supports = Support({SEVERAL_MOVING})

    def availability(self) -> Availability:
        return Availability(True)

    def __init__(self, error: Exception | None = None) -> None:
        self.error = error

    def run(self, scene: Scene, resolution: Resolution, sampling: Sampling) -> Trajectory:
        if self.error is not None:
            raise self.error
        return free_flight(provenance={"backend": "own"})


def test_a_case_is_run_by_a_backend_in_place_of_that_which_it_names() -> None:
    found, named = run_case(short_case(), by=Own()).trajectory, run_case(short_case()).trajectory
    assert found is not None
    assert named is not None
    assert [run.provenance["backend"] for run in (found, named)] == ["own", "verlet"]
    # an error that no backend should raise is a result if everything is
    with pytest.raises(KeyError):
        run_case(short_case(), by=Own(KeyError("a")))
    assert isinstance(run_case(short_case(), by=Own(KeyError("a")), everything=True).failure, Crashed)


# campaigns


def test_progress_follows_the_part_of_a_run_that_is_done(monkeypatch: pytest.MonkeyPatch) -> None:
    def half(task: Task) -> Outcome:
        report(0.5)
        return Outcome(failure=RunBroken("half"))

    monkeypatch.setattr(here, "perform_task", half)
    done: list[float] = []
    run_cases([short_case(), short_case(dt=9.9e-7)], progress=lambda part, *_: done.append(part))
    assert done == pytest.approx([0.0, 0.5, 1.0, 1.0, 1.5, 2.0, 2.0], rel=0.05)


def test_a_failure_is_that_of_all_cases_of_its_kind() -> None:
    cases = [short_case(replace(SHORT, name=name, gravity=9.81), backend="bca") for name in ("one", "other")]
    results = run_cases(cases)
    assert [result.case.scene.name for result in results] == ["one", "other"]
    assert all(isinstance(result.failure, UnsupportedScene) for result in results)


def _tasks_here(cases: Sequence[Case], monkeypatch: pytest.MonkeyPatch, **settings: Any) -> dict[str, list[bool]]:
    """Return whether runs are shared, by backend and step."""
    shared: dict[str, list[bool]] = {}

    def watched(task: Task) -> Outcome:
        step = task.case.resolution.dt
        shared.setdefault(f"{task.case.backend} {step or task.case.resolution.rtol:g}", []).append(task.shared)
        return perform_task(task)

    monkeypatch.setattr(here, "perform_task", watched)
    run_cases(cases, **settings)
    return shared


def test_runs_and_families_that_other_cases_need_travel_with_their_results(monkeypatch: pytest.MonkeyPatch) -> None:
    cases = [
        short_case(uncertainty=True),
        short_case(backend="ase", uncertainty=True),
        short_case(dt=5e-7),
        short_case(dt=2e-7, uncertainty=True),
        short_case(backend="bca"),
        short_case(backend="blanes-moan"),
        # a run of the family of the third: solved with it, and no task
        short_case(dt=2e-7, surrogate_radius=0.25),
    ]
    assert _tasks_here(cases, monkeypatch) == {
        "verlet 1e-06": [True],
        "ase 1e-06": [True],
        "verlet 5e-07": [False],
        "verlet 2e-07": [True],
        "bca 1e-06": [False],
        "blanes-moan 1e-06": [False],
    }


def test_a_run_that_others_need_is_in_their_cache_although_it_is_stored(tmp_path: Path) -> None:
    cases = [short_case(uncertainty=True), short_case(backend="ase", uncertainty=True)]
    for store in (Store(tmp_path), None):
        cache = RunCache()
        run_cases(cases, jobs=ThreadPoolExecutor(1), store=store, cache=cache)
        assert {replace(case, uncertainty=False) for case in cases} <= cache.runs.keys()


def law_of_main(overlap: Any) -> Any:
    return 4e9 * overlap**1.5


@pytest.fixture
def of_main(monkeypatch: pytest.MonkeyPatch) -> Scene:
    """Return a scene whose law is a function of the main program."""
    monkeypatch.setattr(sys.modules["__main__"], "law_of_main", law_of_main, raising=False)
    monkeypatch.setattr(law_of_main, "__module__", "__main__")
    return replace(SHORT, name="of-main", law=law_of_main)


def test_a_law_of_the_main_program_is_run_here_in_place_of_by_an_executor(of_main: Scene) -> None:
    executor = Failing(RuntimeError("it takes nothing"), submitted=True)
    assert run_cases([short_case(of_main)], jobs=executor)[0].trajectory is not None
    with pytest.raises(RunBroken, match="takes no more cases"):
        run_cases([short_case()], jobs=executor)


def test_processes_have_the_main_program_where_a_law_is_its_own(
    of_main: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    needed: list[bool] = []

    def in_processes(tasks: Sequence[Task], workers: int, state: Campaign, *, main: bool) -> Any:
        needed.append(main)
        return ((task, perform_task(task)) for task in tasks)

    monkeypatch.setattr(run, "run_in_processes", in_processes)
    for cases in ([short_case(), short_case(dt=5e-7)], [short_case(of_main), short_case()]):
        assert len(run_cases(cases, jobs=2)) == 2
    assert needed == [False, True]


def test_cores_are_divided_by_the_most_ranks_of_an_engine(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(range(8)))
    engines = (None, Engine(ranks=1), Engine(ranks=4))
    cases: Any = [SimpleNamespace(engine=engine, expected=50.0) for engine in engines]
    assert run.count_workers(None, cases) == 2
    assert run.count_workers(None, cases[:2] * 5) == 8
