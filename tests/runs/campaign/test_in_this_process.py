"""What workers and campaigns do, called in this process: each part by itself, without waiting for another one."""

from __future__ import annotations

import multiprocessing
import os
import pickle
import signal
import socket
import sys
import threading
import time
from collections import deque
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from dem_bridge.errors import RunBroken, UsageError
from dem_bridge.foundation.progress import Interrupted
from dem_bridge.runs.campaign import (
    Away,
    Crashed,
    executors,
    fingerprint_of,
    here,
    map_in_threads,
    pool,
    run,
    run_cases,
    run_groups,
    tasks,
    workers_of,
)
from dem_bridge.runs.campaign.nodes import Node
from dem_bridge.runs.campaign.results import Result
from dem_bridge.runs.campaign.tasks import Outcome, Task, Work, packed, perform, perform_all, perform_task
from dem_bridge.runs.case import Case
from dem_bridge.runs.digits import fingerprint
from dem_bridge.runs.locks import locked
from dem_bridge.runs.store import Store
from tests.helpers.campaign_cases import SHORT, OnArrival, short_case

# what a worker does


@pytest.fixture
def signals() -> Iterator[None]:
    """Give back the handlers that a worker changes."""
    before = {each: signal.getsignal(each) for each in (signal.SIGINT, signal.SIGTERM)}
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, [])
    yield
    signal.pthread_sigmask(signal.SIG_SETMASK, mask)
    for each, handler in before.items():
        signal.signal(each, handler)


def test_a_worker_says_that_it_has_begun_and_then_sends_an_outcome_for_each_task(
    signals: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    guards = []
    monkeypatch.setattr(pool, "guard_parent_death", lambda: guards.append(True))
    ours, theirs = multiprocessing.Pipe()
    cases = [short_case(dt=dt) for dt in (1e-6, 5e-7, 2e-7)]
    chunks = [[packed(Task(name=str(nth), case=case)) for nth, case in part] for part in (
        list(enumerate(cases))[:2], list(enumerate(cases))[2:])]  # fmt: skip
    for chunk in chunks:
        ours.send(chunk)
    signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    # the campaign goes on to read, and sends no more
    duplicate = socket.socket(fileno=os.dup(ours.fileno()))
    duplicate.shutdown(socket.SHUT_WR)
    handlers: list[Any] = []

    def noted(task: Any) -> Outcome:
        handlers.append(signal.getsignal(signal.SIGTERM))
        return perform(task)

    monkeypatch.setattr(pool, "perform", noted)
    pool.serve_tasks(theirs)
    theirs.close()
    assert ours.recv() is None
    outcomes = [ours.recv() for _ in cases]
    duplicate.close()
    ours.close()
    steps = [outcome.trajectory.provenance["settings"]["dt"] for outcome in outcomes]
    assert steps == pytest.approx([1e-6, 5e-7, 2e-7], rel=1e-12, abs=0.0)
    assert guards == [True]
    assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, [])
    # without a task it ends at once, and within one it first ends what the task has started
    ends: list[Any] = []
    monkeypatch.setattr(pool, "stop_idle", lambda: ends.append("engines"))
    monkeypatch.setattr(os, "_exit", ends.append)
    signal.getsignal(signal.SIGTERM)(signal.SIGTERM, None)  # type: ignore[operator,misc]
    assert ends == ["engines", 143]
    with pytest.raises(SystemExit) as ended:
        handlers[-1](signal.SIGTERM, None)
    assert ended.value.code == 143
    assert signal.getsignal(signal.SIGTERM) is signal.SIG_IGN


def test_a_worker_ends_when_its_parent_has_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[Any] = []
    monkeypatch.setattr(multiprocessing, "parent_process", lambda: SimpleNamespace(join=lambda: calls.append("joined")))
    monkeypatch.setattr(os, "kill", lambda *words: calls.append(words))
    monkeypatch.setattr(os, "_exit", lambda code: calls.append(code))
    monkeypatch.setattr(time, "sleep", lambda seconds: calls.append(f"{seconds:g} s"))
    pool.guard_parent_death()
    assert calls == ["joined", (os.getpid(), signal.SIGTERM), "5 s", 1]


@pytest.mark.parametrize("needed", [True, False])
def test_the_main_program_is_hidden_unless_it_is_needed(needed: bool) -> None:
    main = sys.modules["__main__"]
    with pool.hide_main(needed):
        assert (sys.modules["__main__"] is main) is needed
        assert sys.modules["__main__"].__name__ == "__main__"
    assert sys.modules["__main__"] is main


class Fake:
    """A process that does nothing; ``codes``: its exit code, from each look at it on."""

    pid = 77

    def __init__(self, **_: Any) -> None:
        self.calls: list[Any] = []
        self.exitcode: int | None = None
        self.obeys = True

    def start(self) -> None:
        self.calls.append("start")

    def terminate(self) -> None:
        self.calls.append("terminate")
        self.exitcode = 143 if self.obeys else None

    def kill(self) -> None:
        self.calls.append("kill")
        self.exitcode = -9

    def join(self, seconds: float | None = None) -> None:
        self.calls.append(seconds)


@pytest.fixture
def process(monkeypatch: pytest.MonkeyPatch) -> Any:
    context = SimpleNamespace(Pipe=multiprocessing.Pipe, Process=Fake)
    monkeypatch.setattr(multiprocessing, "get_context", lambda kind: context)
    return pool.WorkerProcess(True)


def test_a_process_is_idle_between_its_tasks_and_late_after_their_patience(
    process: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    now = [100.0]
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    monkeypatch.setattr(Task, "patience", property(lambda task: 5.0 if task.name == "a" else 9.0))
    assert process._process.calls == ["start"]
    assert (process.is_idle, process.overdue) == (False, None)
    process._outcome = None
    assert list(process.outcomes(Work([], 1))) == []
    assert process.is_idle
    chunk = [Task(name=name, case=short_case()) for name in "ab"]
    process.assign(chunk)
    assert (process.is_idle, list(process.tasks)) == (False, chunk)
    assert process.overdue is None
    now[0] = 104.9
    assert process.overdue is None
    now[0] = 105.0
    assert process.overdue == 5.0
    # an outcome of the first is the beginning of the second
    process._outcome = Outcome()
    [(task, _)] = process.outcomes(Work([], 1))
    assert task.name == "a"
    now[0] = 113.9
    assert process.overdue is None
    now[0] = 114.0
    assert process.overdue == 9.0
    process.stop()


@pytest.mark.parametrize(
    ("obeys", "calls", "end"),
    [
        (True, ["terminate", 5.0], "process 77 ended with exit code 143"),
        (False, ["terminate", 5.0, "kill", None], "process 77 ended by SIGKILL"),
    ],
)
def test_a_process_is_ended_in_order(
    obeys: bool, calls: list[Any], end: str, process: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Task, "patience", 1e9)
    process._process.obeys = obeys
    process.assign([Task(name="a", case=short_case())])
    other = process.replaced(True)
    assert process._process.calls[1:] == calls
    assert process.end == end
    assert process.connection.closed
    assert not other.tasks
    other.stop()
    late = pool.WorkerProcess(False)
    monkeypatch.setattr(Task, "patience", 0.0)
    late.assign([Task(name="a", case=short_case())])
    late.replaced(True).stop()
    assert late.end == "process 77 ended with exit code 143 after 0 s, in which it had no result"
    assert not late.has_outcome()


# executors


class Kept(Executor):
    """Keep all futures, and begin none."""

    def __init__(self) -> None:
        self.futures: list[Future[Any]] = []

    def submit(self, function: Any, /, *arguments: Any, **keywords: Any) -> Future[Any]:
        self.futures.append(Future())
        return self.futures[-1]


def test_calls_are_away_up_to_their_number_and_end_in_any_order() -> None:
    futures: dict[str, Future[int]] = {}

    def submit(item: str) -> Future[int]:
        futures[item] = Future()
        return futures[item]

    away, pending = Away[str, int](submit), deque("abcd")
    away.fill(pending, 3)
    assert (list(away.items.values()), list(pending)) == (["a", "b", "c"], ["d"])
    away.fill(pending, 3)
    assert list(pending) == ["d"]
    assert list(away.ended()) == []
    futures["b"].set_result(2)
    assert [(item, future.result()) for item, future in away.ended()] == [("b", 2)]
    away.fill(pending, 3)
    assert (list(away.items.values()), list(pending)) == (["a", "c", "d"], [])
    futures["c"].set_running_or_notify_cancel()
    away.cancel()
    assert list(away.items.values()) == ["c"]  # it has begun
    assert futures["a"].cancelled()


@pytest.mark.parametrize(
    ("executor", "workers"),
    [
        (SimpleNamespace(_client=SimpleNamespace(nthreads=lambda: {"a": 2, "b": 3})), 5),
        (SimpleNamespace(_client=SimpleNamespace(nthreads=dict)), 16),
        (SimpleNamespace(_max_workers=7), 7),
        (SimpleNamespace(_max_workers=None), 16),
        (SimpleNamespace(), 16),
    ],
)
def test_the_number_of_workers_is_that_of_the_executor_or_a_guess(executor: Any, workers: int) -> None:
    assert workers_of(executor) == workers


def test_the_digits_of_workers_are_those_of_most_of_them() -> None:
    def dask(*answers: str) -> Any:
        run = lambda function: dict(enumerate(answers)) if function is fingerprint else {}  # noqa: E731
        return SimpleNamespace(_client=SimpleNamespace(run=run))

    assert fingerprint_of(dask("a", "b", "b")) == "b"
    assert fingerprint_of(dask()) == ""
    assert fingerprint_of(SimpleNamespace()) == ""  # type: ignore[arg-type]
    with ThreadPoolExecutor(1) as threads:
        assert fingerprint_of(threads) == fingerprint() != ""


def test_threads_give_values_in_order_and_the_first_error() -> None:
    assert map_in_threads(lambda item: item * 2, range(9), 3) == [2 * item for item in range(9)]
    assert map_in_threads(lambda item: item, [], None) == []
    began: list[int] = []

    never = threading.Event()

    def fail(item: int) -> int:
        began.append(item)
        if item == 1:
            raise KeyError(item)
        never.wait(0.02)  # the others do not end at once
        return item

    with pytest.raises(KeyError):
        map_in_threads(fail, range(60), 1)
    last = len(began)
    never.wait(0.1)
    assert len(began) <= last + 1 < 60  # those that have not begun never do
    assert not Task(name="", case=short_case()).everything


# tasks


def _task(folder: Path | None = None, case: Case | None = None, **more: Any) -> Task:
    case = case or short_case()
    fields: dict[str, Any] = {"name": "a", "case": case, "key": case.key, "folder": folder, "limit": 10**9}
    return Task(**fields | more)


def test_a_run_is_kept_in_the_store_or_travels(tmp_path: Path) -> None:
    case = short_case()
    travels = perform_task(_task())
    assert travels.trajectory is not None
    assert (travels.kept, travels.key, travels.digits, travels.cache) == (False, case.key, fingerprint(), None)
    without = perform_task(_task(key=None))
    assert (without.key, without.digits) == (None, "")
    kept = perform_task(_task(tmp_path))
    assert (kept.kept, kept.trajectory, kept.trouble) == (True, None, "")
    assert case.key is not None
    stored = Store(tmp_path).load(case.key, case.scene)
    assert stored is not None
    np.testing.assert_array_equal(stored.velocity, travels.trajectory.velocity)
    assert perform_task(_task(tmp_path)).kept
    # what others need, and what is to be made again, is made although the store has it
    shared = perform_task(_task(tmp_path, shared=True))
    assert shared.kept
    assert shared.cache is not None
    assert replace(case, uncertainty=False) not in shared.cache.runs
    assert perform_task(_task(shared=True)).cache is not None
    others: list[dict[str, Any]] = [{}, {"shared": True}, {"recompute": True}]
    assert [tasks.is_stored(_task(tmp_path, **more)) for more in others] == [
        True, False, False,
    ]  # fmt: skip
    assert not tasks.is_stored(_task(tmp_path, key=None))
    assert not tasks.is_stored(_task(None))
    assert not tasks.is_stored(_task(tmp_path, short_case(dt=3e-7)))


def test_a_store_that_takes_nothing_is_said_and_the_run_travels(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    outcome = perform_task(_task(tmp_path / "file" / "store", recompute=True))
    assert outcome.trajectory is not None
    assert outcome.trouble.startswith("store: nothing is stored: ")
    assert (outcome.kept, outcome.digits) == (False, fingerprint())


def test_a_run_that_another_campaign_makes_is_left_to_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    task, waited = _task(tmp_path), list[float]()
    assert task.key is not None
    monkeypatch.setattr(tasks, "wait_for_release", lambda *_, at_most: waited.append(at_most))
    with locked(tmp_path, task.key, 1.0) as free:
        assert free
        assert perform_task(task) == Outcome(locked=True)
        assert waited == []
        assert perform_task(replace(task, waits=True)).locked
        assert waited == [1.0]
        # a lock does not hold up what has to be made here
        for other in (replace(task, shared=True), replace(task, recompute=True)):
            assert not perform_task(other).locked
    work = Work([], 1)
    work.pending.append([_task(name="b")])
    assert list(work.done(task, Outcome(locked=True))) == []
    assert [[each.name for each in chunk] for chunk in work.pending] == [["b"], ["a"]]
    assert work.pending[1][0].waits
    # a run that is not there is made again at once, and travels
    lost = replace(task, key="f" * 64)
    assert list(work.done(lost, Outcome(kept=True))) == []
    assert work.pending[0] == [replace(lost, folder=None)]
    [(done, outcome)] = work.done(task, Outcome(kept=True))
    assert done == task
    assert outcome.trajectory is not None
    assert "stored" not in outcome.trajectory.provenance
    assert (outcome.kept, work.pending[0]) == (True, [replace(lost, folder=None)])


class _Stubborn(Exception):
    def __reduce__(self) -> Any:
        raise TypeError("it stays")


def test_errors_travel_as_they_are_or_in_words(monkeypatch: pytest.MonkeyPatch) -> None:
    for error in (UsageError("too fine"), _Stubborn("no way")):

        def fail(*_: Any, error: Exception = error, **__: Any) -> None:
            raise error

        monkeypatch.setattr(tasks, "run_case", fail)
        found = perform_task(_task()).error
        if isinstance(error, UsageError):
            assert found is error
        else:
            assert isinstance(found, Crashed)
            assert str(found) == "_Stubborn: no way"
            assert "Traceback" in found.log


def test_chunks_are_done_in_their_order() -> None:
    cases = [short_case(dt=dt) for dt in (1e-6, 5e-7)]
    outcomes = perform_all([packed(Task(name="", case=case)) for case in cases], "1")
    assert [outcome.trajectory.provenance["settings"]["dt"] for outcome in outcomes if outcome.trajectory] == [
        1e-6,
        5e-7,
    ]
    assert pickle.loads(packed(_task())).code != ""


@pytest.mark.parametrize(
    ("seconds", "workers", "expected"),
    [
        # at most a second together, and at most a quarter of a worker's part
        ([0.5, 0.5, 0.5], 1, [[0], [1], [2]]),
        ([0.1] * 8, 1, [[0, 1], [2, 3], [4, 5], [6, 7]]),
        ([0.1] * 8, 2, [[0], [1], [2], [3], [4], [5], [6], [7]]),
        ([50.0, 0.3, 0.3, 0.3, 0.3, 50.0, 0.1], 1, [[0], [1, 2], [3, 4], [5], [6]]),
        ([0.25] * 40, 1, [list(range(k, k + 4)) for k in range(0, 40, 4)]),
    ],
)
def test_chunks_have_up_to_a_second_and_a_quarter_of_the_work_of_a_worker(
    seconds: Sequence[float], workers: int, expected: list[list[int]], monkeypatch: pytest.MonkeyPatch
) -> None:
    times = {1e-6 / (nth + 1): value for nth, value in enumerate(seconds)}
    monkeypatch.setattr(Case, "expected", property(lambda case: times[case.resolution.dt]))
    every = [_task(name=str(nth), case=short_case(dt=dt)) for nth, dt in enumerate(times)]
    found = [[int(task.name) for task in chunk] for chunk in Work(every, workers).pending]
    assert [nth for chunk in found for nth in chunk] == list(range(len(seconds)))
    if (seconds, workers) != ([0.1] * 8, 1):  # sums of tenths are no tenths
        assert found == expected


def test_a_task_that_is_lost_for_good_says_how() -> None:
    work = Work([], 1)
    [(_, outcome)] = work.lost([_task()], "it is gone", again=False)
    assert isinstance(outcome.failure, Crashed)
    assert (str(outcome.failure).endswith("its process died twice"), outcome.failure.log) == (True, "it is gone")


# campaigns


def test_results_of_groups_are_those_of_their_cases() -> None:
    cases = [short_case(dt=1e-6 / k) for k in range(1, 5)]
    groups = run_groups([cases[:1], [], cases[1:]])
    assert [[result.case for result in group] for group in groups] == [cases[:1], [], cases[1:]]


def test_a_group_is_handed_over_before_the_runs_of_the_next_begin() -> None:
    shared, short, long = short_case(dt=1e-6), short_case(dt=8e-7), short_case(dt=1e-8)
    events: list[object] = []

    def ended(number: int, results: tuple[Result, ...]) -> None:
        events.append((number, [result.case for result in results]))

    cases = [[shared, short], [long], [], [long]]
    groups = run_groups(cases, progress=lambda *at: events.append(at[2]), ended=ended)
    handed = [event for event in events if isinstance(event, tuple)]
    assert sorted(handed) == [(n, [result.case for result in group]) for n, group in enumerate(groups)]
    # the group with the longest run is the first; short and shared may be in either order
    begun = min(events.index(shared.label), events.index(short.label))
    assert max(events.index((1, [long])), events.index((3, [long]))) < begun < events.index((0, [shared, short]))


@pytest.mark.parametrize("stored", [False, True])
def test_a_stop_ends_a_campaign_and_says_what_is_kept(
    stored: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = iter([False, True, True, True])
    monkeypatch.setattr(here, "stop_requested", lambda: next(asked))
    kept = "they are kept, and a second call goes on" if stored else "they are not kept"
    with pytest.raises(Interrupted, match=f"^interrupted after 1 of 2 runs; {kept}$"):
        run_cases([short_case(), short_case(dt=5e-7)], store=Store(tmp_path) if stored else None)


def test_a_failure_is_decided_by_its_key_and_its_words(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    heavy = short_case(replace(SHORT, gravity=9.81), backend="bca")
    [result] = run_cases([heavy], store=Store(tmp_path))
    assert result.key == f"{heavy.key}: {result.failure}"
    assert run_cases([heavy])[0].key is None


def test_a_law_that_stays_here_is_refused_for_several_processes_alone() -> None:
    scene = replace(SHORT, law=lambda overlap: 4e9 * overlap**1.5)
    with pytest.raises(UsageError, match="jobs = 2: the law of three cannot go to another process"):
        run_cases([short_case(scene)], jobs=2)
    assert run_cases([short_case(scene)], jobs=1)[0].trajectory is not None
    assert run_cases([short_case(scene)], jobs=Kept())[0].trajectory is not None  # it is run here
    assert run.reason_to_stay(SHORT) == run.reason_to_stay(replace(SHORT, law=OnArrival(print)), of_main=True) == ""


def test_the_longest_begins_and_those_of_about_a_time_have_no_order(monkeypatch: pytest.MonkeyPatch) -> None:
    times = (26.0, 34.0, 2.0)
    long, less, short = (Node(name="", key=None, case=cast(Case, SimpleNamespace(expected=each))) for each in times)
    assert [run.order_of_node(node)[0] for node in (long, less, short)] == [-30.0, -30.0, -2.0]
    assert len({run.order_of_node(short)[1] for _ in range(4)}) > 1


def test_processes_are_worth_their_start_from_two_seconds_on(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0, 1})
    for expected, workers in ((1.99, 1), (2.01, 2)):
        cases: Any = [SimpleNamespace(engine=None, expected=expected)] * 2
        assert run.count_workers(None, cases) == workers


def test_an_executor_that_takes_nothing_leaves_what_is_stored(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(executors, "ANSWER_TIME", 0.01)  # nobody answers
    [kept] = run_cases([short_case()], store=Store(tmp_path))
    [again] = run_cases([short_case()], store=Store(tmp_path), jobs=Kept())
    assert again.key == kept.key
    with pytest.raises(RunBroken, match="the executor takes no more cases"):
        run_cases([short_case()], jobs=Closed())


class Closed(Executor):
    """Take nothing."""

    def submit(self, function: Any, /, *arguments: Any, **keywords: Any) -> Future[Any]:
        raise RuntimeError("it is shut down")
