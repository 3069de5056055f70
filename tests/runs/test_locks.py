"""Locks of runs: one process makes a run, and no lock of a dead, slow or misdated process keeps a run from others."""

from __future__ import annotations

import subprocess
import sys
import threading
from pathlib import Path

import pytest

from dem_bridge.foundation import leftovers
from dem_bridge.foundation.leftovers import LOCK, owned
from dem_bridge.runs.campaign import run_cases, tasks
from dem_bridge.runs.campaign.tasks import Task, Work, lock_of, perform_task
from dem_bridge.runs.locks import is_held, locked
from dem_bridge.runs.store import LIMIT, Store
from tests.helpers.campaign_cases import short_case
from tests.helpers.processes import touched

KEY = "k" * 64
DEAD = "from dem_bridge.foundation.leftovers import owned; print(owned('lock'))"


def _lock(folder: Path, owner: str, age: float = 0.0) -> Path:
    """Make the lock of another process."""
    path = folder / f"{KEY}{LOCK}"
    path.symlink_to(owner)
    touched(path, age)
    return path


def test_a_run_is_locked_by_one_and_free_when_that_one_ends(tmp_path: Path) -> None:
    with locked(tmp_path, KEY, 1.0) as first, locked(tmp_path, KEY, 1.0) as second:
        assert (first, second) == (True, False)
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(ValueError, match="a run that fails"), locked(tmp_path, KEY, 1.0):
        raise ValueError("a run that fails")
    with locked(tmp_path, KEY, 1.0) as again:
        assert again


@pytest.mark.parametrize("age", [-80.0, 80.0])
def test_a_lock_that_is_old_or_from_the_future_is_taken_over(age: float, tmp_path: Path) -> None:
    path = _lock(tmp_path, f"{owned('lock')}living", age)
    assert is_held(path, 3.0)
    with locked(tmp_path, KEY, 1.0) as free:
        assert free
        with locked(tmp_path, KEY, 1.0) as another:
            assert not another
    assert list(tmp_path.iterdir()) == []


def test_a_lock_ends_with_its_process_and_the_next_start_removes_it(tmp_path: Path) -> None:
    dead = subprocess.run([sys.executable, "-c", DEAD], capture_output=True, text=True, check=True).stdout.strip()
    _lock(tmp_path, dead)
    with locked(tmp_path, KEY, 1.0) as free:
        assert free
    _lock(tmp_path, dead)
    leftovers.sweep.cache_clear()
    Store(tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_a_slow_process_does_not_remove_the_lock_of_the_one_that_took_over(tmp_path: Path) -> None:
    with locked(tmp_path, KEY, 1.0):
        (tmp_path / f"{KEY}{LOCK}").unlink()
        path = _lock(tmp_path, "another")
    assert path.is_symlink()


def test_where_no_links_can_be_made_a_run_is_free(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with locked(tmp_path / "nowhere", KEY, 1.0) as free:
        assert free

    def refuse(path: Path, target: str) -> None:
        raise PermissionError(f"{path} -> {target}")

    monkeypatch.setattr(Path, "symlink_to", refuse)
    with locked(tmp_path, KEY, 1.0) as first, locked(tmp_path, KEY, 1.0) as second:
        assert first
        assert second


def _task(folder: Path) -> Task:
    case = short_case(backend="bca")
    return Task(name="case", case=case, key=case.key, folder=folder, limit=LIMIT)


def test_a_task_that_another_campaign_is_at_comes_last_and_is_not_made_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tasks, "PAUSE", 0.1)
    task, other = _task(tmp_path), Task(name="other", case=short_case(dt=1e-7))
    with lock_of(task):
        outcome = perform_task(task)
        assert outcome.locked
        work = Work([other], 1)
        assert list(work.done(task, outcome)) == []
        assert [chunk[0].name for chunk in work.pending] == ["other", "case"]
        [again] = work.pending[1]
        assert perform_task(again).locked  # it has waited a while
    assert perform_task(again).kept
    monkeypatch.setattr(tasks, "run_case", None)
    assert perform_task(task).kept


@pytest.mark.parametrize("jobs", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_a_campaign_waits_for_the_run_of_another_and_reads_it(jobs: int, tmp_path: Path) -> None:
    cases = [short_case(backend="bca"), short_case(backend="bca", dt=1e-7)]
    with lock_of(_task(tmp_path)):
        campaign = threading.Thread(target=run_cases, args=(cases,), kwargs={"jobs": jobs, "store": Store(tmp_path)})
        campaign.start()
        campaign.join(0.5)
        assert campaign.is_alive()
    campaign.join()
    assert sorted(path.stem for path in tmp_path.iterdir()) == sorted(str(case.key) for case in cases)


def test_without_locks_both_make_the_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # the fault that the tests above catch
    monkeypatch.setattr(Path, "symlink_to", lambda *_: None)  # a folder in which a name may be given twice
    with locked(tmp_path, KEY, 1.0) as first, locked(tmp_path, KEY, 1.0) as second:
        assert first
        assert second
