"""A loaded engine forks for each deck: each runs as if it ran alone, its end is its own, and nothing remains."""

from __future__ import annotations

import multiprocessing
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import nullcontext
from pathlib import Path

import pytest

from dem_bridge.errors import BackendUnavailable, RunBroken
from dem_bridge.foundation.leftovers import SHARED_MEMORY
from dem_bridge.lmp import child, loaded
from dem_bridge.lmp.engine import Engine
from dem_bridge.lmp.process import load_engine, run_deck
from tests.helpers.processes import EventClock, all_end, happens, running

pytestmark = [
    pytest.mark.lammps,
    pytest.mark.skipif(not loaded.CAN_FORK, reason="each task has a process of its own here"),
]
#: a shell command of a deck that appends the processes of the deck and of the loaded engine to the file "pids"
PIDS = "shell 'echo $PPID $(ps -o ppid= -p $PPID) >> pids'"
#: and one that never ends, with its own process
HANGS = "shell 'echo $$ >> pids; exec sleep 600'"


@pytest.fixture(autouse=True)
def nothing_waits() -> Iterator[None]:
    """Begin and end without a process that waits for a deck."""
    loaded.stop_idle()
    yield
    loaded.stop_idle()


def _write(folder: Path, name: str, *lines: str) -> str:
    (folder / name).write_text("\n".join(lines) + "\n")
    return name


def _run(folder: Path, *lines: str, engine: Engine | None = None, time_limit: float = 60.0) -> list[int]:
    """Run a deck with these lines; return the processes of the deck and of the loaded engine that did it."""
    run_deck(folder, _write(folder, "in.a", *lines, PIDS), time_limit=time_limit, engine=engine)
    return _pids(folder)[-2:]


def _pids(folder: Path) -> list[int]:
    file = folder / "pids"
    return [int(word) for word in file.read_text().split()] if file.exists() else []


def test_decks_run_in_forks_of_one_process(tmp_path: Path) -> None:
    load_engine(Engine())
    (first, loader), (second, again) = _run(tmp_path), _run(tmp_path)
    assert loader == again
    assert len({first, second, loader, os.getpid()}) == 4
    assert running([first, second, loader]) == [loader]
    assert (tmp_path / "log.lammps").is_file()


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("nonsense", "LAMMPS: ERROR: Unknown command: nonsense"),
        ("shell 'kill -SEGV $PPID'", "LAMMPS ended by SIGSEGV while running the deck"),
        ("quit 3", "LAMMPS ended with exit code 3 while running the deck"),
    ],
    ids=["error", "crash", "quit"],
)
def test_a_failure_of_one_deck_leaves_the_next_alone(tmp_path: Path, line: str, words: str) -> None:
    before = _run(tmp_path, "print before")
    for _ in range(2):
        with pytest.raises(RunBroken, match=words):
            _run(tmp_path, line)
    after = _run(tmp_path, "print after file told screen no")
    assert (tmp_path / "told").read_text().strip() == "after"
    assert after[1] == before[1]


@pytest.mark.parametrize("end", ["print fine", "shell 'kill -9 $PPID'", HANGS], ids=["done", "killed", "stopped"])
def test_no_shared_memory_of_a_deck_is_left(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, end: str) -> None:
    load_engine(Engine())
    monkeypatch.setattr(child, "time", EventClock(lambda: len(_pids(tmp_path)) == 3))
    deck = _write(tmp_path, "in.a", PIDS, f"shell 'ls {SHARED_MEMORY} > files'", end)
    with nullcontext() if end.startswith("print") else pytest.raises(RunBroken):
        run_deck(tmp_path, deck, time_limit=0.1)
    prefix = f"mpich_shm_{_pids(tmp_path)[0]:x}_"
    assert prefix in (tmp_path / "files").read_text()
    assert not [*SHARED_MEMORY.glob(f"{prefix}*")]


def test_a_variable_of_one_deck_is_not_there_in_the_next(tmp_path: Path) -> None:
    for value in ("1", "2"):
        _run(tmp_path, f"variable x index {value}", "print ${x} file told screen no")
        assert (tmp_path / "told").read_text().strip() == value


def test_a_deck_that_hangs_is_stopped_with_all_that_it_started(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    load_engine(Engine())
    monkeypatch.setattr(child, "time", EventClock(lambda: len(_pids(tmp_path)) == 3))
    deck = _write(tmp_path, "in.hangs", PIDS, HANGS)
    with pytest.raises(RunBroken, match=r"did not finish within the time limit of 0\.1 s"):
        run_deck(tmp_path, deck, time_limit=0.1)
    assert all_end(_pids(tmp_path))
    monkeypatch.undo()
    _run(tmp_path)


@pytest.mark.parametrize("way_out", [signal.SIGKILL, signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("hangs", [True, False], ids=["running", "waiting"])
def test_nothing_remains_of_a_caller_that_ends(tmp_path: Path, way_out: signal.Signals, hangs: bool) -> None:
    deck = _write(tmp_path, "in.a", PIDS, *([HANGS] if hangs else []))
    code = (
        "from pathlib import Path\nfrom dem_bridge.lmp.process import run_deck\nimport time\n"
        f"run_deck(Path({str(tmp_path)!r}), {deck!r}, time_limit=600.0)\nprint('waits', flush=True)\ntime.sleep(600)"
    )
    caller = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
    assert caller.stdout is not None
    try:
        if hangs:
            assert happens(lambda: len(_pids(tmp_path)) == 3)
        else:
            assert caller.stdout.readline() == b"waits\n"
        deck_process, loader, *_ = _pids(tmp_path)
        assert loader in running([deck_process, loader])
    finally:
        caller.send_signal(way_out)
        caller.wait()
        caller.stdout.close()
    assert all_end(_pids(tmp_path))
    assert not [*SHARED_MEMORY.glob(f"mpich_shm_{deck_process:x}_*")]


def test_a_deck_ends_with_the_loaded_engine(tmp_path: Path) -> None:
    def killed() -> None:
        if len(pids := _pids(tmp_path)) == 3:
            os.kill(pids[1], signal.SIGKILL)

    deck = _write(tmp_path, "in.hangs", PIDS, HANGS)
    with pytest.raises(RunBroken, match="by SIGKILL while running the deck"):
        run_deck(tmp_path, deck, time_limit=600.0, watch=killed)
    *deck_and_loader, sleeper = _pids(tmp_path)
    assert all_end(deck_and_loader)
    os.kill(sleeper, signal.SIGKILL)
    _run(tmp_path)


def test_a_loaded_engine_that_has_died_is_replaced(tmp_path: Path) -> None:
    _, loader = _run(tmp_path)
    os.kill(loader, signal.SIGKILL)
    os.waitid(os.P_PID, loader, os.WEXITED | os.WNOWAIT)
    assert _run(tmp_path)[1] != loader


def test_each_engine_and_environment_has_its_own_process(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    tell = "shell 'echo $FIRST $OMP_WAIT_POLICY > told'"
    told: list[str] = []
    loaders: list[int] = []
    other = Engine(python=Path(sys.executable))
    for first, wait, engine in (("a", "active", None), ("b", "passive", None), ("b", "passive", other)):
        monkeypatch.setenv("FIRST", first)
        monkeypatch.setenv("OMP_WAIT_POLICY", wait)
        loaders.append(_run(tmp_path, tell, engine=engine)[1])
        told.append((tmp_path / "told").read_text().strip())
    assert told == ["a active", "b passive", "b passive"]
    assert loaders[0] != loaders[1]
    monkeypatch.setenv("FIRST", "a")
    monkeypatch.setenv("OMP_WAIT_POLICY", "active")
    # as a run does not depend on it, it may have the process of the first
    monkeypatch.setenv("DEM_BRIDGE_STORE", str(tmp_path))
    assert _run(tmp_path)[1] == loaders[0]


def test_arguments_of_an_engine_reach_its_decks(tmp_path: Path) -> None:
    for value in ("1", "2"):
        _run(tmp_path, "print ${x} file told screen no", engine=Engine(lmp_args=("-var", "x", value)))
        assert (tmp_path / "told").read_text().strip() == value


def test_few_processes_wait(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    loaders = []
    for value in range(6):
        monkeypatch.setenv("FIRST", str(value))
        loaders.append(_run(tmp_path)[1])
    assert all_end(loaders[:2])
    assert running(loaders) == loaders[2:]


@pytest.mark.parametrize(
    ("code", "words"),
    [
        ("raise ImportError('no library')", "the lammps module does not load: no library"),
        ("import os, signal; os.kill(os.getpid(), signal.SIGSEGV)", "by SIGSEGV while loading the lammps module"),
        ("import os; print('a word', flush=True); os._exit(7)", "with exit code 7 while loading .*: a word"),
    ],
    ids=["error", "crash", "exit"],
)
def test_an_engine_that_does_not_load_says_so_each_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, code: str, words: str
) -> None:
    (tmp_path / "lammps.py").write_text(code)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    load_engine(Engine())
    for _ in range(2):
        with pytest.raises((BackendUnavailable, RunBroken), match=words):
            _run(tmp_path)
    (tmp_path / "lammps.py").unlink()
    _run(tmp_path)


@pytest.mark.parametrize("method", ["fork", "spawn"])
def test_a_process_of_multiprocessing_has_its_own_and_ends_it(tmp_path: Path, method: str) -> None:
    _, ours = _run(tmp_path)
    with ProcessPoolExecutor(1, multiprocessing.get_context(method)) as pool:
        pool.submit(_run, tmp_path).result()
    theirs = _pids(tmp_path)[-1]
    assert theirs != ours
    assert running([ours, theirs]) == [ours]
    assert _run(tmp_path)[1] == ours
