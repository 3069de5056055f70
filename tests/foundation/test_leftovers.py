"""What a killed process leaves behind is removed by the next one, and what a living process uses stays."""

from __future__ import annotations

import mmap
import os
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest

from dem_bridge.foundation import leftovers
from dem_bridge.foundation.files import write_whole
from dem_bridge.foundation.leftovers import is_left_behind, owned, remove_unmapped, started
from dem_bridge.lmp.process import workspace
from dem_bridge.runs.campaign import run_cases
from dem_bridge.runs.store import Store

OWNER = "from dem_bridge.foundation.leftovers import owned; print(owned('part'))"


@pytest.fixture(scope="module")
def dead() -> str:
    """The beginning of a name that belongs to a process that has ended."""
    return subprocess.run([sys.executable, "-c", OWNER], capture_output=True, text=True, check=True).stdout.strip()


@pytest.fixture(autouse=True)
def _next_process() -> None:
    leftovers.sweep.cache_clear()
    leftovers.sweep_temporary.cache_clear()


def test_a_name_is_left_behind_when_its_process_is_dead(dead: str) -> None:
    assert is_left_behind(f"{dead}x")
    assert not is_left_behind(f"{owned('part')}x")
    assert not is_left_behind("part-x")
    machine = dead.split("-")[1]
    assert not is_left_behind(dead.replace(machine, "0" * 8))  # of another machine: its processes cannot be seen
    # another process has the same id since
    mine = owned("part").split("-")
    assert is_left_behind("-".join([*mine[:3], f"{started(os.getpid()) - 1:x}", "x"]))


def test_the_store_a_report_a_run_and_a_campaign_remove_what_dead_processes_left(
    dead: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(leftovers, "gettempdir", lambda: str(tmp_path))
    of_temporary: Sequence[Callable[[], object]] = (lambda: workspace().__enter__(), lambda: run_cases([]))
    for begin in (lambda: Store(tmp_path), lambda: write_whole(tmp_path, {}), *of_temporary):
        leftovers.sweep.cache_clear()
        leftovers.sweep_temporary.cache_clear()
        (tmp_path / f"{dead}folder").mkdir()
        (tmp_path / f"{dead}folder" / "log.lammps").write_text("")
        (tmp_path / f"{dead}file.part").write_text("")
        living = tmp_path / f"{owned('part')}.part"
        living.write_text("")
        begin()
        assert [path for path in tmp_path.iterdir() if dead in path.name] == []
        assert living.exists()


def test_shared_memory_goes_when_no_process_maps_it(tmp_path: Path) -> None:
    unused, mapped, young = (tmp_path / f"mpich_shm_{name}_0" for name in ("a", "b", "c"))
    for path in (unused, mapped, young):
        path.write_bytes(b"0" * 100)
    for path in (unused, mapped):
        os.utime(path, (1.0, 1.0))
    with mapped.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ):
        remove_unmapped(tmp_path, "mpich_shm_*")
        assert sorted(tmp_path.iterdir()) == [mapped, young]
    remove_unmapped(tmp_path, "mpich_shm_*")
    assert list(tmp_path.iterdir()) == [young]


def test_a_sweep_that_takes_every_process_for_dead_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    # the fault that the tests above catch
    name = f"{owned('part')}x"
    monkeypatch.setattr(leftovers, "started", lambda pid: 0)
    assert is_left_behind(name)
