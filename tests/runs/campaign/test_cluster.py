"""A Dask cluster: a real scheduler and two workers in processes of their own, of which one is killed in the middle."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import dem_bridge as db
from dem_bridge.errors import UsageError
from dem_bridge.runs.campaign import cluster as cluster_module
from dem_bridge.runs.campaign import identity, run_cases
from dem_bridge.runs.campaign.cluster import connected
from dem_bridge.runs.campaign.executors import workers_of
from dem_bridge.runs.store import Store
from tests.helpers.campaign_cases import SHORT, mixed_cases, text_of
from tests.helpers.command_line import run_here
from tests.helpers.dask_cluster import Cluster, dask_cluster
from tests.helpers.processes import happens


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cluster]:
    with dask_cluster(tmp_path_factory.mktemp("dask"), workers=2) as both:
        yield both


@pytest.fixture(scope="module")
def executor(cluster: Cluster) -> Iterator[Executor]:
    with connected(str(cluster.file)) as connection:
        assert happens(lambda: workers_of(connection) == 2)
        yield connection


def test_a_killed_worker_costs_nothing_and_all_digits_are_those_of_one_process(
    cluster: Cluster, executor: Executor, tmp_path: Path
) -> None:
    cases = mixed_cases(20)
    expected = run_cases(cases, store=Store(tmp_path / "here"), everything=True)
    killed: list[float] = []

    def kill_one(done: float, total: int, label: str) -> None:
        if done > total / 4 and not killed:
            cluster.workers[0].kill()
            killed.append(done)

    store = Store(tmp_path / "there")
    results = run_cases(cases, jobs=executor, store=store, progress=kill_one, everything=True)
    assert cluster.workers[0].wait() != 0
    assert killed[0] < len(cases)
    assert text_of(results) == text_of(expected)
    assert store.trouble == ""
    assert _names(tmp_path / "there") == _names(tmp_path / "here")


def _names(folder: Path) -> list[str]:
    return sorted(file.name for file in folder.iterdir())


@pytest.mark.slow
@pytest.mark.lammps
def test_tables_of_a_verification_are_equal_byte_for_byte_whoever_makes_the_runs(executor: Executor) -> None:
    scene = replace(SHORT, samples=50, spacing=18e-3)
    engines: tuple[dict[str, Any], ...] = (
        {"jobs": 1},
        {"jobs": 2},
        {"executor": ThreadPoolExecutor(2)},
        {"executor": executor},
    )
    verifications = [db.verify(scene, accuracy=1e-3, store=False, **engine) for engine in engines]
    assert [verdict.quantity for verdict in verifications[0].verdicts]
    texts = [
        [verification.table().to_csv(), *(table.as_csv() for table in verification.tables)]
        for verification in verifications
    ]
    assert texts == [texts[0]] * len(engines)


@pytest.mark.slow
@pytest.mark.studies
def test_tables_of_a_study_are_equal_byte_for_byte(executor: Executor) -> None:
    # by the worker that is left
    where: tuple[dict[str, Any], ...] = ({"jobs": 1}, {"executor": executor})
    here, there = (db.study("scatter", "decelerating-40", count=2, store=False, **settings) for settings in where)
    assert [table.as_csv() for table in there.tables] == [table.as_csv() for table in here.tables]


@pytest.mark.studies
def test_the_command_line_takes_a_scheduler_file(cluster: Cluster, tmp_path: Path) -> None:
    words = ("study", "scatter", "decelerating-40", "--count", "2", "--no-cache", "--json")
    done = run_here(*words, "--cluster", str(cluster.file), cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert '"scatter"' in done.stdout
    both = run_here(*words, "--cluster", str(cluster.file), "-j", "2", cwd=tmp_path)
    assert both.returncode == 2
    assert "were both given; allowed: one of them" in both.stderr


@pytest.mark.parametrize(
    ("name", "value", "allowed"),
    [
        ("__version__", "9.9", r"9\.9 with code \w{12}"),
        ("_code", lambda: "0123456789ab", r"0\.\S+ with code 0123456789ab"),
    ],
    ids=["version", "code"],
)
def test_a_worker_with_another_version_or_other_code_is_refused(
    name: str, value: Any, allowed: str, cluster: Cluster, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(identity, name, value)
    with (
        pytest.raises(
            UsageError, match=rf"the worker tcp://\S+ has dem_bridge 0\.\S+ with code \w{{12}}; allowed: {allowed}"
        ),
        connected(str(cluster.file)),
    ):
        pass


@pytest.mark.slow
def test_a_scheduler_without_workers_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cluster_module, "FIRST_WORKER_TIME", 0.1)
    with (
        dask_cluster(tmp_path, workers=0) as alone,
        pytest.raises(UsageError, match=r"the scheduler has no worker after 0\.1 s; start some with"),
        connected(str(alone.file)),
    ):
        pass


def test_without_the_extra_or_a_scheduler_the_message_says_what_to_do(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cluster_module, "ANSWER_TIME", 0.5)
    reasons = {"tcp://127.0.0.1:1": "no scheduler answers"}
    reasons |= dict.fromkeys(("nowhere", "none.json", str(tmp_path)), "there is no such file")
    for address, reason in reasons.items():
        with pytest.raises(UsageError, match=f"{reason}.* allowed: the address") as caught:
            connected(address).__enter__()
        assert "\n" not in str(caught.value)
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(UsageError, match=r'pip install "dem-bridge\[cluster\]"'):
        connected("tcp://127.0.0.1:1").__enter__()
