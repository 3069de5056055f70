"""The processes of a campaign: what one gives, all give; one that dies or hangs costs no other case."""

from __future__ import annotations

import multiprocessing
import os
import re
import signal
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from dem_bridge.errors import RunBroken
from dem_bridge.lmp.loaded import CAN_FORK
from dem_bridge.runs.campaign import Crashed, Result, pool, run_cases
from dem_bridge.runs.campaign.tasks import Task, Work
from dem_bridge.runs.store import Store
from tests.helpers.campaign_cases import die, die_once, hang, mixed_cases, short_case, text_of, with_action
from tests.helpers.processes import PATIENCE, children_of, running


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("campaign")


@pytest.fixture(scope="module")
def results(folder: Path) -> tuple[Result, ...]:
    """Return the results of two processes: the mixed cases, and three that die once, die always and hang."""
    hanging = with_action(hang)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Task, "patience", property(lambda task: 0.5 if task.case == hanging else 3600.0))
        others = [with_action(die_once, folder / "died"), with_action(die), hanging]
        return run_cases([*mixed_cases(), *others], jobs=2, store=Store(folder / "store"), everything=True)


def test_two_processes_give_what_one_gives_to_the_last_bit(results: Sequence[Result], tmp_path: Path) -> None:
    here = run_cases(mixed_cases(), jobs=1, store=Store(tmp_path), everything=True)
    assert text_of(results[: len(here)]) == text_of(here)
    assert sum(result.trajectory is not None for result in here) == len(here) - 1


def test_all_is_stored_and_nothing_else_is_left(results: Sequence[Result], folder: Path, tmp_path: Path) -> None:
    run_cases(mixed_cases(), jobs=1, store=Store(tmp_path), everything=True)
    assert sorted(file.name for file in (folder / "store").iterdir()) == sorted(
        file.name for file in tmp_path.iterdir()
    )
    assert multiprocessing.active_children() == []


def test_a_case_whose_process_dies_once_is_repeated(results: Sequence[Result]) -> None:
    assert results[-3].failure is None
    assert results[-3].trajectory is not None


def test_a_case_whose_process_dies_twice_is_broken_with_what_is_known(results: Sequence[Result]) -> None:
    failure = results[-2].failure
    assert isinstance(failure, Crashed)
    assert str(failure) == "three: verlet at dt = 1e-06 s: its process died twice"
    assert re.fullmatch(r"process \d+ ended with exit code 9\nprocess \d+ ended with exit code 9", failure.log)


def test_a_case_that_hangs_is_ended_and_not_repeated(results: Sequence[Result]) -> None:
    failure = results[-1].failure
    assert isinstance(failure, Crashed)
    assert str(failure) == "three: verlet at dt = 1e-06 s: it did not end within 0.5 s"
    # a process that does not get the processor in time to end by itself is killed
    how = r"(with exit code 143|by SIGKILL)"
    assert re.fullmatch(rf"process \d+ ended {how} after 0.5 s, in which it had no result", failure.log), failure.log


# what is done again


def _tasks(count: int) -> list[Task]:
    return [Task(name=str(nth), case=short_case(dt=1e-6 / (nth + 1))) for nth in range(count)]


def test_a_lost_task_is_done_once_more_alone_and_then_broken() -> None:
    work, tasks = Work([], 1), _tasks(2)
    assert list(work.lost(tasks, "the first end")) == []
    assert sorted(len(chunk) for chunk in work.pending) == [1, 1]
    work.pending.clear()
    [(task, outcome)] = work.lost(tasks[:1], "the second end")
    assert task == tasks[0]
    assert isinstance(outcome.failure, Crashed)
    assert outcome.failure.log == "the first end\nthe second end"
    assert not work.pending


@pytest.mark.parametrize(("count", "workers", "most"), [(1, 2, 1), (400, 2, 20), (8, 2, 1), (80, 2, 10)])
def test_short_cases_travel_in_chunks_of_a_second_of_which_each_worker_has_several(
    count: int, workers: int, most: int
) -> None:
    # each is expected to take 0.05 s
    tasks = _tasks(count)
    chunks = list(Work(tasks, workers).pending)
    assert [task for chunk in chunks for task in chunk] == tasks
    assert max(map(len, chunks)) in (most - 1, most)


def test_a_long_case_travels_alone() -> None:
    long = Task(name="long", case=short_case(dt=1e-13))
    assert long.case.expected > 1.0
    chunks = Work([long, *_tasks(40)], 2).pending
    assert chunks[0] == [long]


def test_the_patience_is_the_time_limit_of_the_case_and_a_margin() -> None:
    [task] = _tasks(1)
    assert task.patience == pytest.approx(3600.0 + 100.0 * task.case.expected + 60.0)
    limited = Task(name="limited", case=short_case(time_limit=5.0))
    assert limited.patience == pytest.approx(5.0 + 100.0 * limited.case.expected + 60.0)


def test_processes_that_cannot_begin_are_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pool, "serve_tasks", die)
    with pytest.raises(RunBroken, match=r"3 processes died before they could begin .* take jobs = 1") as caught:
        run_cases([short_case(), short_case(dt=1e-7)], jobs=2)
    assert "\n" not in str(caught.value)
    assert multiprocessing.active_children() == []


@pytest.mark.slow
def test_without_a_second_try_a_case_is_lost(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # the fault that the tests above catch
    monkeypatch.setattr(Work, "lost", _given_up)
    cases = [with_action(die_once, tmp_path / "died"), short_case()]
    assert run_cases(cases, jobs=2)[0].trajectory is None


def _given_up(work: Work, tasks: Sequence[Task], how: str, *, again: bool = True) -> Any:
    work._deaths = {task.name: how for task in tasks}
    return _LOST(work, tasks, how, again=again)


_LOST = Work.lost


@pytest.mark.lammps
@pytest.mark.skipif(not CAN_FORK, reason="each run of LAMMPS has a process of its own here")
def test_a_process_ends_with_the_engine_that_it_has_loaded() -> None:
    task = Task(name="a", case=short_case(backend="lammps-granular"))
    process = pool.WorkerProcess(False)
    for tasks in ([], [task]):
        if tasks:
            process.assign(tasks)
        assert process.connection.poll(PATIENCE)
        assert process.has_outcome()
        assert len([*process.outcomes(Work([], 1))]) == len(tasks)
    [pid] = [child.pid for child in multiprocessing.active_children() if child.pid is not None]
    [engine] = children_of(pid)
    # it does not see that its input closes
    os.kill(engine, signal.SIGSTOP)
    process.stop()
    assert running([pid, engine]) == []
