"""Engines run beside other cases: what is begun when, what holds a lock how long, and what is left where it ends."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import pytest

from dem_bridge.backends.base import ENGINE_BACKENDS
from dem_bridge.foundation import progress
from dem_bridge.foundation.progress import Campaign, Interrupted
from dem_bridge.lmp.engine import Engine
from dem_bridge.runs.campaign import here
from dem_bridge.runs.campaign.here import can_run_beside, run_here
from dem_bridge.runs.campaign.tasks import Outcome, Task
from dem_bridge.runs.case import Case
from dem_bridge.runs.locks import is_held, locked
from tests.helpers.campaign_cases import short_case

#: s within which a thread does what it is to do
PATIENCE = 20.0
ENGINE, OTHER = "lammps-granular", "verlet"


def _case(backend: str, nth: int = 1) -> Case:
    return short_case(dt=1e-6 / nth, backend=backend)


def _tasks(*backends: str) -> list[Task]:
    return [Task(name=f"{nth} {name}", case=_case(name, nth)) for nth, name in enumerate(backends, start=1)]


def _made(
    tasks: Sequence[Task], *, beside: bool = True, state: Campaign | None = None
) -> Iterator[tuple[Task, Outcome]]:
    return run_here(tasks, lambda label, part: None, state or Campaign(total=9, done=0), beside=beside)


def _perform(monkeypatch: pytest.MonkeyPatch, perform: Callable[[Task], Outcome]) -> None:
    monkeypatch.setattr(here, "perform_task", perform)


@pytest.mark.parametrize("backend", ENGINE_BACKENDS)
def test_an_engine_runs_while_another_case_is_solved(backend: str, monkeypatch: pytest.MonkeyPatch) -> None:
    meet = threading.Barrier(2)

    def perform(task: Task) -> Outcome:
        meet.wait(PATIENCE)  # both are at it, or this fails
        is_main = threading.current_thread() is threading.main_thread()
        return Outcome(digits="main" if is_main else "beside")

    _perform(monkeypatch, perform)
    state = Campaign(total=2, done=0)
    seen: set[tuple[str, ...]] = set()
    with progress.watching(lambda state: seen.add(state.running)):
        made = {task.case.backend: outcome.digits for task, outcome in _made(_tasks(OTHER, backend), state=state)}
    assert made == {OTHER: "main", backend: "beside"}
    assert any(labels[0].startswith("three: verlet") for labels in seen if labels)


def test_two_engines_run_at_a_time_where_nothing_else_is_left(monkeypatch: pytest.MonkeyPatch) -> None:
    meet = threading.Barrier(2)

    def perform(task: Task) -> Outcome:
        if task.case.backend == ENGINE:
            meet.wait(PATIENCE)
        return Outcome()

    _perform(monkeypatch, perform)
    tasks = _tasks(OTHER, ENGINE, ENGINE, ENGINE, ENGINE)
    assert sorted(task.name for task, _ in _made(tasks)) == sorted(task.name for task in tasks)


def test_the_shortest_of_the_other_cases_are_solved_first_beside_engines(monkeypatch: pytest.MonkeyPatch) -> None:
    order: list[str] = []

    def perform(task: Task) -> Outcome:
        if task.case.backend != ENGINE:
            order.append(task.name)
        return Outcome()

    _perform(monkeypatch, perform)
    list(_made(_tasks(OTHER, ENGINE, OTHER, OTHER)))
    assert order == ["4 verlet", "3 verlet", "1 verlet"]


@pytest.mark.parametrize(
    ("beside", "backends"),
    [(False, (ENGINE, OTHER)), (True, (ENGINE,)), (True, (OTHER, OTHER))],
    ids=["not asked for", "alone", "no engine"],
)
def test_no_thread_is_started_where_nothing_runs_beside(
    beside: bool, backends: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    threads: set[threading.Thread] = set()

    def perform(task: Task) -> Outcome:
        threads.add(threading.current_thread())
        return Outcome()

    _perform(monkeypatch, perform)
    tasks = _tasks(*backends)
    assert [task for task, _ in _made(tasks, beside=beside)] == tasks
    assert threads == {threading.main_thread()}


def test_an_error_of_the_thread_stops_the_campaign(monkeypatch: pytest.MonkeyPatch) -> None:
    begun = threading.Event()

    def perform(task: Task) -> Outcome:
        if task.case.backend == ENGINE:
            begun.set()
            raise OSError("the disk is gone")
        assert begun.wait(PATIENCE)
        return Outcome()

    _perform(monkeypatch, perform)
    with pytest.raises(OSError, match="the disk is gone"):
        list(_made(_tasks(OTHER, ENGINE)))


def test_a_campaign_that_ends_early_ends_the_run_that_has_begun(monkeypatch: pytest.MonkeyPatch) -> None:
    begun, ended = threading.Event(), threading.Event()

    def perform(task: Task) -> Outcome:
        if task.case.backend != ENGINE:
            assert begun.wait(PATIENCE)
            return Outcome()
        begun.set()
        try:
            for _ in range(int(100 * PATIENCE)):
                progress.report(0.5)  # as an engine does while it is waited for
                ended.wait(0.01)
        except Interrupted:
            ended.set()
            raise
        return Outcome()

    _perform(monkeypatch, perform)
    threads = threading.active_count()
    made = _made(_tasks(OTHER, ENGINE, ENGINE))
    task, _ = next(made)
    assert task.case.backend == OTHER
    made.close()  # type: ignore[attr-defined]
    assert ended.is_set()
    assert threading.active_count() == threads


def test_after_a_stop_what_has_begun_is_finished_and_nothing_else_begins(monkeypatch: pytest.MonkeyPatch) -> None:
    asked, begun = threading.Event(), threading.Event()

    def perform(task: Task) -> Outcome:
        if task.case.backend == ENGINE:
            begun.set()
            assert asked.wait(PATIENCE)
            threading.Event().wait(0.05)
        else:
            assert begun.wait(PATIENCE)
            asked.set()
        return Outcome()

    monkeypatch.setattr(here, "stop_requested", asked.is_set)
    _perform(monkeypatch, perform)
    made = [task.name for task, _ in _made(_tasks(OTHER, ENGINE, ENGINE, OTHER))]
    assert sorted(made) == ["2 lammps-granular", "4 verlet"]


def test_the_lock_on_a_run_lasts_until_it_is_taken(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    held: dict[str, bool] = {}
    _perform(monkeypatch, lambda task: Outcome())
    tasks = [replace(task, key=f"key{n}", folder=tmp_path, limit=10**9) for n, task in enumerate(_tasks(OTHER, ENGINE))]
    for task, _ in _made(tasks):
        held[task.name] = is_held(tmp_path / f"{task.key}.lock", 1.0)
    assert held == {"1 verlet": True, "2 lammps-granular": True}
    assert not list(tmp_path.iterdir())


def test_a_run_that_another_campaign_is_at_comes_last(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    _perform(monkeypatch, lambda task: Outcome())
    monkeypatch.setattr("dem_bridge.runs.campaign.tasks.PAUSE", 0.01)
    tasks = [
        replace(task, key=f"key{n}", folder=tmp_path, limit=10**9)
        for n, task in enumerate(_tasks(ENGINE, ENGINE, OTHER))
    ]
    order = []
    with locked(tmp_path, "key0", 1.0):
        made = _made(tasks)
        order += [next(made)[0].name, next(made)[0].name]
    order += [task.name for task, _ in made]
    assert order[2] == "1 lammps-granular"
    assert sorted(order[:2]) == ["2 lammps-granular", "3 verlet"]


def test_engines_run_beside_others_where_the_number_of_runs_is_free_and_there_are_cores(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    cases = [_case(OTHER), _case(ENGINE)]
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0, 1})
    assert can_run_beside(None, cases)
    assert not can_run_beside(1, cases)
    assert not can_run_beside(None, [*cases, replace(_case(ENGINE), engine=Engine(ranks=2))])
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0})
    assert not can_run_beside(None, cases)
