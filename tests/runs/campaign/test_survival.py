"""A campaign that is killed, has no room, or is not alone: what a restart finds, makes again, and leaves behind."""

from __future__ import annotations

import os
import random
import signal
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

from dem_bridge.runs import inspect
from dem_bridge.runs.store import Store
from tests.helpers.survival import Survival, moments

#: numbers of cases
SMALL, LARGE = 12, pytest.param(200, marks=pytest.mark.slow)


@pytest.fixture
def survival(tmp_path: Path, request: pytest.FixtureRequest) -> Iterator[Survival]:
    """Campaigns with as many cases as the test says."""
    campaigns = Survival(tmp_path, cases=request.param)
    yield campaigns
    for pid in campaigns.processes():  # of a test that fails
        with suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)


def _complete(survival: Survival) -> dict[str, object]:
    """Let a last campaign end, and check what is there then."""
    end = survival.finish(survival.begin())
    assert (end["runs"], end["trouble"]) == (survival.cases, "")
    assert inspect.check(Store(survival.store)) == (survival.cases, [])
    assert survival.all_ended()
    assert survival.left() == []
    return end


def _undisturbed(survival: Survival) -> object:
    """Return the digest of the same campaign over another store."""
    return _complete(Survival(survival.folder / "undisturbed", survival.cases))["digest"]


@pytest.mark.parametrize("survival", [SMALL, LARGE], indirect=True)
def test_a_campaign_that_is_killed_again_and_again_ends_complete(survival: Survival) -> None:
    kills = 2 if survival.cases == SMALL else 10
    for nth, ended in enumerate(moments(19, kills, survival.cases - 2 * survival.jobs)):
        survival.begin_and_kill(ended=ended, whole=nth % 2 == 0)
    end = _complete(survival)
    # none is lost, and none is made twice but those that ran when their campaign was killed
    assert survival.cases <= survival.counted("begin") <= survival.cases + kills * survival.jobs
    if survival.cases != SMALL:
        assert end["digest"] == _undisturbed(survival)


@pytest.mark.slow
@pytest.mark.lammps
@pytest.mark.parametrize("survival", [SMALL], indirect=True)
def test_a_campaign_of_lammps_that_is_killed_again_and_again_ends_complete(survival: Survival) -> None:
    # runs on one rank and on two in turn: a kill comes while an engine loads, runs or is read
    survival.kind, kills, draw = "lammps", 10, random.Random(21)
    for nth, ended in enumerate(moments(21, kills, survival.cases - 2 * survival.jobs)):
        survival.begin_and_kill(ended=ended, whole=nth % 2 == 0, later=draw.random())
        assert survival.all_ended()  # engines and launchers of MPI, too
    _complete(survival)
    assert survival.cases <= survival.counted("begin") <= survival.cases + kills * survival.jobs


@pytest.mark.slow
@pytest.mark.parametrize("survival", [40], indirect=True)
def test_two_campaigns_over_one_store_share_the_work(survival: Survival) -> None:
    programs = [survival.begin() for _ in range(2)]
    ends = [survival.finish(program) for program in programs]
    assert ends[0]["digest"] == ends[1]["digest"] == _undisturbed(survival)
    assert survival.counted("begin") == survival.cases
    assert _complete(survival)["stored"] == survival.cases


@pytest.mark.slow
@pytest.mark.parametrize("survival", [200], indirect=True)
def test_a_campaign_that_is_killed_beside_another_harms_it_not(survival: Survival) -> None:
    # a campaign that begins no more than half of the runs waits for nobody and for nothing but the kill
    kills = moments(20, 4, survival.cases // 2)
    other = survival.begin()  # a run of the other cannot begin either while one waits to be killed
    for ended in kills:
        survival.begin_and_kill(ended=ended, whole=True)
    survival.halt()
    end = survival.finish(other)
    assert (end["runs"], end["trouble"]) == (survival.cases, "")
    assert survival.counted("begin") <= survival.cases + len(kills) * survival.jobs
    assert _complete(survival)["digest"] == end["digest"] == _undisturbed(survival)


@contextmanager
def _small_disk(folder: Path, size: str) -> Iterator[None]:
    """Make a folder a file system of its own with little room."""
    folder.mkdir()
    if subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", str(folder)], check=False).returncode:
        pytest.skip("mounting a small file system needs the rights of root")
    try:
        yield
    finally:
        subprocess.run(["umount", str(folder)], check=True)


@pytest.mark.slow
@pytest.mark.parametrize("survival", [SMALL], indirect=True)
def test_two_campaigns_that_see_the_store_by_two_mounts_share_the_work(survival: Survival) -> None:
    # as two machines see a folder of a network file system
    store, elsewhere = survival.store, survival.folder / "elsewhere"
    with _small_disk(store, "10m"):
        elsewhere.mkdir()
        subprocess.run(["mount", "--bind", str(store), str(elsewhere)], check=True)
        try:
            programs = [survival.begin()]
            survival.store = elsewhere
            programs.append(survival.begin())
            survival.store = store
            ends = [survival.finish(program) for program in programs]
        finally:
            subprocess.run(["umount", str(elsewhere)], check=True)
        assert ends[0]["digest"] == ends[1]["digest"]
        assert survival.counted("begin") == survival.cases
        assert _complete(survival)["stored"] == survival.cases


@pytest.mark.slow
@pytest.mark.parametrize("survival", [40], indirect=True)
def test_a_campaign_on_a_full_disk_ends_without_storing_and_goes_on_when_there_is_room(survival: Survival) -> None:
    with _small_disk(survival.store, "100k"):
        end = survival.finish(survival.begin())
        assert end["runs"] == survival.cases  # all results are there, in spite of it
        trouble = str(end["trouble"])
        assert trouble.startswith("store: nothing is stored: ")
        assert "No space left" in trouble
        assert "\n" not in trouble
        kept, damaged = inspect.check(Store(survival.store))
        assert 0 < kept < survival.cases
        assert (damaged, survival.left()) == ([], [])
        subprocess.run(["mount", "-o", "remount,size=10m", str(survival.store)], check=True)
        assert _complete(survival)["digest"] == end["digest"]
        assert survival.counted("begin") == 2 * survival.cases - kept


@pytest.mark.slow
@pytest.mark.parametrize("survival", [SMALL], indirect=True)
def test_a_store_that_loses_entries_is_seen(survival: Survival) -> None:
    # the fault that the tests above catch
    survival.begin_and_kill(ended=6, whole=True)
    for entry in survival.store.iterdir():
        entry.unlink()
    survival.finish(survival.begin())
    assert survival.counted("begin") > survival.cases + survival.jobs
