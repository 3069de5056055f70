"""Executors of others: the results are those of one process, and Ctrl-C is heard whatever is waited for."""

from __future__ import annotations

import multiprocessing
import os
import pickle
import signal
import threading
from collections.abc import Iterator, Sequence
from concurrent.futures import BrokenExecutor, Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import pytest

import dem_bridge as db
from dem_bridge.ensembles.draw import BLOCK
from dem_bridge.ensembles.result import Ensemble
from dem_bridge.errors import RunBroken, UsageError
from dem_bridge.runs.campaign import Crashed, Result, executors, map_in_threads, pool, run_cases, tasks
from dem_bridge.runs.campaign.tasks import Task
from dem_bridge.runs.store import Store
from tests.helpers.campaign_cases import SHORT, die_once, mixed_cases, short_case, text_of, wait_for, with_action
from tests.helpers.processes import happens, stays_asleep


class Backwards(Executor):
    """Do the last first, and nothing before all are there."""

    def __init__(self) -> None:
        self.calls: list[tuple[Future[Any], Any]] = []

    def submit(self, function: Any, /, *arguments: Any, **keywords: Any) -> Future[Any]:
        future: Future[Any] = Future()
        self.calls.append((future, lambda: function(*arguments, **keywords)))
        threading.Timer(0.05, self._work).start()
        return future

    def _work(self) -> None:
        future, call = self.calls.pop()
        future.set_result(call())


class Lost(Executor):
    """Lose the first call of every task, and all of those of one kind."""

    _max_workers = 2

    def __init__(self, always: str = "") -> None:
        self.calls, self.always = 0, always
        self.arguments: set[Any] = set()

    def submit(self, function: Any, /, *arguments: Any, **keywords: Any) -> Future[Any]:
        future: Future[Any] = Future()
        self.calls += 1
        self.arguments.add(arguments[1])
        # by their tasks: a word of three letters may be part of a hash in their bytes, too
        if self.calls == 1 or (
            self.always and self.always in {pickle.loads(packed).case.backend for packed in arguments[0]}
        ):
            future.set_exception(RuntimeError("the worker is gone"))
        else:
            future.set_result(function(*arguments, **keywords))
        return future


class Silent(Executor):
    """Never answer."""

    def submit(self, function: Any, /, *arguments: Any, **keywords: Any) -> Future[Any]:
        return Future()


class Dropping(Executor):
    """Cancel what it has."""

    def submit(self, function: Any, /, *arguments: Any, **keywords: Any) -> Future[Any]:
        future: Future[Any] = Future()
        future.cancel()
        future.set_running_or_notify_cancel()
        return future


class Closed(Executor):
    """Take nothing."""

    def submit(self, function: Any, /, *arguments: Any, **keywords: Any) -> Future[Any]:
        raise RuntimeError("it is shut down")


@pytest.fixture(scope="module")
def expected() -> str:
    return _text(run_cases(mixed_cases(), everything=True))


def _text(results: Sequence[Result]) -> str:
    """Without a store there are no keys."""
    return text_of([replace(result, key=None) for result in results])


@pytest.mark.parametrize("executor", [ThreadPoolExecutor(4), Backwards(), Lost()], ids=lambda kind: type(kind).__name__)
def test_results_are_those_of_one_process(executor: Executor, expected: str) -> None:
    assert _text(run_cases(mixed_cases(), jobs=executor, everything=True)) == expected


def test_runs_go_through_the_store_where_there_is_one(
    expected: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    travelled: list[Any] = []
    honest = tasks.perform_all

    def watched(*arguments: Any) -> Any:
        outcomes = honest(*arguments)
        travelled.extend(outcomes)
        return outcomes

    monkeypatch.setattr(executors, "perform_all", watched)
    results = run_cases(mixed_cases(), jobs=ThreadPoolExecutor(2), store=Store(tmp_path), everything=True)
    assert _text(results) == expected
    assert len(travelled) > 10
    assert all(outcome.trajectory is None for outcome in travelled)
    assert sum(outcome.kept for outcome in travelled) == len(travelled) - 1  # one is refused
    # each is there under the key of its case
    assert [result.key for result in results if result.trajectory] == [
        result.case.key for result in results if result.trajectory
    ]


@pytest.mark.parametrize("seen", [False, True])
def test_a_store_that_workers_do_not_share_costs_nothing(
    seen: bool, expected: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # one that seems to be shared, and one of whose runs none arrives
    monkeypatch.setattr(executors, "shares_folder", lambda *_: seen)
    if seen:
        monkeypatch.setattr(
            "dem_bridge.runs.campaign.tasks.with_run", lambda task, outcome: None if outcome.kept else outcome
        )
    store = Store(tmp_path)
    assert _text(run_cases(mixed_cases(), jobs=ThreadPoolExecutor(2), store=store, everything=True)) == expected
    assert None not in [result.key for result in run_cases(mixed_cases(), store=Store(tmp_path), everything=True)]


def test_a_case_that_is_lost_twice_is_broken_and_the_others_are_not() -> None:
    executor = Lost(always="bca")
    results = run_cases([short_case(), short_case(backend="bca")], jobs=executor)
    assert results[0].trajectory is not None
    failure = results[1].failure
    assert isinstance(failure, Crashed)
    assert failure.log == "\n".join(["RuntimeError: the worker is gone"] * 2)
    # Dask takes a call with the same arguments for the same, and would give its result again
    assert len(executor.arguments) == executor.calls


def test_what_nobody_answers_is_broken_after_its_time(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Task, "patience", 0.1)
    [result] = run_cases([short_case()], jobs=Silent())
    assert str(result.failure) == "three: verlet at dt = 1e-06 s: nothing came back within 0.1 s"


def test_all_cases_that_are_away_are_waited_for_as_long_as_the_slowest_may_take(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    cases = [short_case(dt=1e-6), short_case(dt=3e-6), short_case(dt=2e-6)]
    monkeypatch.setattr(Task, "patience", property(lambda task: 1e5 * task.case.resolution.dt))
    results = run_cases(cases, jobs=Silent())
    assert {str(result.failure).rsplit(": ", 1)[1] for result in results} == {"nothing came back within 0.3 s"}


def test_a_case_may_take_its_time_limit_and_a_hundred_times_what_is_expected() -> None:
    case = short_case(dt=1e-6)
    assert Task(name="", case=case).patience == pytest.approx(case.resolution.time_limit + 100.0 * case.expected + 60.0)


def test_an_executor_that_takes_nothing_or_drops_all_is_one_line() -> None:
    with pytest.raises(RunBroken, match=r"the executor takes no more cases \(RuntimeError: it is shut down\)"):
        run_cases([short_case()], jobs=Closed())
    # as that of a Dask scheduler that is gone
    with pytest.raises(RunBroken, match="the executor dropped the cases that it had"):
        run_cases([short_case()], jobs=Dropping())


def _ensemble(executor: Executor | None = None) -> Ensemble:
    """Return two blocks of chains."""
    return db.ensemble(SHORT, {"mass": 0.1}, n=BLOCK + 8, checks=0, executor=executor)


def test_blocks_of_an_ensemble_whose_worker_is_lost_are_solved_once_more() -> None:
    assert _ensemble().table.equals(_ensemble(Lost()).table)


@pytest.mark.slow
def test_an_ensemble_replaces_a_pool_of_processes_that_breaks() -> None:
    with ProcessPoolExecutor(2, mp_context=multiprocessing.get_context("spawn")) as executor:
        with suppress(BrokenExecutor):
            executor.submit(os._exit, 9).result()
        assert _ensemble(executor).table.equals(_ensemble().table)
    assert multiprocessing.active_children() == []


class Defective(Executor):
    """Solve nothing but the first block."""

    def __init__(self, workers: int = 2) -> None:
        self._max_workers = workers
        self.most, self.tries = 0, list[int]()
        self._away: list[Future[Any]] = []

    def submit(self, function: Any, /, *arguments: Any, **keywords: Any) -> Future[Any]:
        future: Future[Any] = Future()
        self._away = [other for other in self._away if not other.done()] + [future]
        self.most = max(self.most, len(self._away))
        self.tries.append(arguments[1])
        threading.Timer(0.01, self._answer, (future, function, arguments)).start()
        return future

    def _answer(self, future: Future[Any], function: Any, arguments: Any) -> None:
        if arguments[1] == 1:
            future.set_exception(MemoryError("no room"))
        else:
            future.set_result(function(*arguments))


def test_a_block_that_is_lost_twice_is_an_error_that_names_it_and_few_are_away() -> None:
    executor = Defective()
    with pytest.raises(RunBroken, match=r"^chains 512 to 1023 of three .* two workers \(MemoryError: no room\)$"):
        db.ensemble(SHORT, {"mass": 0.1}, n=8 * BLOCK, checks=0, executor=executor)
    assert executor.tries.count(1) == 2
    # two for each worker
    assert executor.most <= 4 < 8


def test_an_executor_has_only_so_many_chunks_at_a_time(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(executors, "MOST_AWAY", 3)
    executor = Defective(workers=40)  # a chunk for each case
    results = run_cases([short_case(backend="bca", dt=1e-6 / k) for k in range(1, 9)], jobs=executor)
    assert None not in [result.trajectory for result in results]
    assert executor.most <= 3


@pytest.mark.slow
def test_a_pool_of_processes_that_breaks_is_replaced(expected: str, tmp_path: Path) -> None:
    with ProcessPoolExecutor(2, mp_context=multiprocessing.get_context("spawn")) as executor:
        cases = [*mixed_cases(), with_action(die_once, tmp_path / "died")]
        *results, last = run_cases(cases, jobs=executor, everything=True)
    assert _text(results) == expected
    assert last.trajectory is not None
    assert multiprocessing.active_children() == []


@pytest.mark.parametrize(
    "function", [db.verify, db.regress, pytest.param(partial(db.study, "scatter"), marks=pytest.mark.studies)]
)
def test_jobs_and_executor_exclude_each_other(function: Any) -> None:
    with pytest.raises(UsageError, match=r"jobs = 2 and executor = .* were both given; allowed: one of them"):
        function("decelerating-40", jobs=2, executor=Silent())
    with pytest.raises(UsageError, match=r"executor = 3; allowed: a concurrent\.futures\.Executor, or None"):
        function("decelerating-40", executor=3)


# Ctrl-C


@contextmanager
def _interrupted_asleep(
    monkeypatch: pytest.MonkeyPatch, module: Any, started: Path, release: Path | None = None
) -> Iterator[None]:
    """Send Ctrl-C when a case has started and the main thread sleeps, and do not let it wake this thread.

    The signal arrives in another thread. One that comes just before the sleep is lost in the same way: nothing
    interrupts the system call. ``release``: what is made a second after the signal.
    """
    honest, sleeps = module.wait, threading.Event()
    main = threading.get_native_id()

    def wait(*arguments: Any, **keywords: Any) -> Any:
        signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
        sleeps.set()
        return honest(*arguments, **keywords)

    def interrupt() -> None:
        assert happens(started.exists)
        assert sleeps.wait()
        assert happens(lambda: stays_asleep(main))
        os.kill(os.getpid(), signal.SIGINT)
        if release is not None:
            threading.Timer(1.0, release.touch).start()

    handler = signal.signal(signal.SIGINT, signal.default_int_handler)
    before = signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGINT])
    monkeypatch.setattr(module, "wait", wait)
    threading.Thread(target=interrupt, daemon=True).start()
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
        signal.signal(signal.SIGINT, handler)


@pytest.mark.parametrize("kind", ["processes", "executor", "threads"])
def test_ctrl_c_that_comes_just_before_the_sleep_is_heard(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    started, release = tmp_path / "started", tmp_path / "release"
    cases = [with_action(wait_for, started, release), short_case()]
    work = {
        "processes": lambda: run_cases(cases, jobs=2),
        "executor": lambda: run_cases(cases, jobs=ThreadPoolExecutor(2)),
        "threads": lambda: map_in_threads(lambda case: wait_for(started, release), cases, 2),
    }
    module = pool if kind == "processes" else executors
    with _interrupted_asleep(monkeypatch, module, started), pytest.raises(KeyboardInterrupt):
        work[kind]()
    # it is raised while the case still runs: nobody has released it
    assert not release.exists()
    release.touch()
    assert multiprocessing.active_children() == []


@pytest.mark.slow
def test_without_slices_ctrl_c_is_heard_when_the_case_has_ended(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # the fault that the test above catches
    started, release = tmp_path / "started", tmp_path / "release"
    monkeypatch.setattr(executors, "SLICE", None)
    with _interrupted_asleep(monkeypatch, executors, started, release), pytest.raises(KeyboardInterrupt):
        run_cases([with_action(wait_for, started, release)], jobs=ThreadPoolExecutor(1))
    assert release.exists()
