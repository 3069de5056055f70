"""Starting LAMMPS in a child process and carrying its answer, its error or its death back.

A failed ``pair_coeff`` or a bad atom type can take a whole process down, and a run can hang: whatever happens to the
child is a result here, never the end of the caller.
"""

from __future__ import annotations

import json
import os
import resource
import select
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory, gettempdir
from typing import Any

from dem_bridge.errors import BackendUnavailable, RunBroken
from dem_bridge.lmp import log
from dem_bridge.lmp.engine import STYLES, Build, Engine, lacks, remedy

WORKER = Path(__file__).with_name("worker.py")
#: where Linux keeps what processes share
SHARED_MEMORY = Path("/dev/shm")
PARENT_DEATH_GUARD = Path(__file__).with_name("parent_death_guard.py")
_ANSWER = "answer.json"
_SILENT_STAGES = {
    "load": "loading the lammps module",
    "run": "running the deck",
    "done": "closing",
}
#: s, for an engine to say what it is
_PROBE = 60.0
#: bytes left on a disk that is full
_FULL = 1_000_000
_OWN_FOLDER = "set TMPDIR to a folder with more room"


@dataclass(frozen=True, kw_only=True)
class EngineReport:
    """What the engine said of itself. Times in s: of the deck alone, or of all of a binary's run."""

    version: int
    packages: tuple[str, ...]
    wall: float
    cpu: float
    """Of all ranks together."""
    build: tuple[str, ...] = ()
    """Compiler and MPI library."""
    ranks: int = 1
    loop: float = 0.0
    """Of the time steps alone."""
    memory: int = 0
    """Bytes: the most that one process had; 0: not known."""
    pair_style: str = ""
    """What the engine called its pair style, with the suffix that it took; '' where its log does not say."""
    potential_energy: Mapping[int, float] = field(default_factory=dict)
    """J, by step, where its log says it."""


@dataclass(frozen=True, kw_only=True)
class _Ended:
    """How a child ended; times in s, with all children that it waited for."""

    code: int
    wall: float
    cpu: float
    memory: int

    @property
    def how(self) -> str:
        return f"by {signal.Signals(-self.code).name}" if self.code < 0 else f"with exit code {self.code}"


def run_deck(
    folder: Path,
    input_file: str,
    *,
    time_limit: float,
    watch: Callable[[], None] | None = None,
    engine: Engine | None = None,
) -> EngineReport:
    """Run ``input_file`` in ``folder``. Raises BackendUnavailable or RunBroken, with LAMMPS' own words.

    ``watch`` is called a few times a second while the engine runs; ``engine``: None for this environment's module.
    """
    engine = engine or Engine()
    return (_by_binary if engine.lmp else _by_module)(engine, folder, input_file, time_limit, watch)


def require(engine: Engine, style: str) -> Build:
    """What an engine says of itself; BackendUnavailable, with the remedy, where there is none or it lacks a style.

    ``style`` is one of ``engine.STYLES``.
    """
    found = probe(engine)
    if not found.styles[style]:
        kind, name = style.split()
        package = f"; install one with the {STYLES[style]} package" if STYLES[style] else ""
        raise BackendUnavailable(f"LAMMPS {found.version} has no {kind}_style {name}{package}")
    engine.launcher()  # that there is one
    return found


@cache
def probe(engine: Engine) -> Build:
    """What an engine says of itself; BackendUnavailable, with the remedy, if there is none."""
    try:
        with workspace() as folder:
            return (_ask_binary if engine.lmp else _ask_module)(engine, folder)
    except RunBroken as error:
        raise BackendUnavailable(str(error)) from error


@contextmanager
def workspace(needs: int = 0) -> Iterator[Path]:
    """A folder for one run, gone afterwards; RunBroken where it cannot be made, hold ``needs`` bytes, or be written."""
    try:
        with TemporaryDirectory(prefix="dem-bridge-", ignore_cleanup_errors=True) as name:
            free = shutil.disk_usage(name).free
            if free < needs:
                raise RunBroken(
                    f"the run writes {needs / 1e6:.0f} MB and {gettempdir()} has {free / 1e6:.0f} MB free;"
                    f" {_OWN_FOLDER}, or ask for fewer samples"
                )
            try:
                yield Path(name)
            except RunBroken as error:
                # LAMMPS does not say that a write failed
                if shutil.disk_usage(name).free >= _FULL:
                    raise
                raise RunBroken(f"{error}; {_OWN_FOLDER}: {gettempdir()} is full", log=error.log) from error
    except OSError as error:
        raise RunBroken(
            f"the temporary folder cannot be written ({error.strerror}: {error.filename or gettempdir()});"
            f" {_OWN_FOLDER}"
        ) from error


def _by_module(
    engine: Engine, folder: Path, input_file: str, time_limit: float, watch: Callable[[], None] | None
) -> EngineReport:
    said = _worker(engine, folder, ["run", input_file, *engine.lmp_args], time_limit, watch)
    others = [_answer(path) for path in folder.glob(f"{_ANSWER}.*") if path.suffix != ".part"]
    _check_ranks(engine, int(said.get("ranks", 1)))
    return EngineReport(
        version=said["version"],
        packages=tuple(said["packages"]),
        wall=said["wall"],
        cpu=said["cpu"] + sum(float(other.get("cpu", 0.0)) for other in others),
        build=tuple(said.get("lines", ())),
        ranks=engine.ranks,
        memory=max(int(one.get("memory", 0)) for one in (said, *others)),
        **_of_the_steps(_read(folder / "log.lammps")),
    )


def _by_binary(
    engine: Engine, folder: Path, input_file: str, time_limit: float, watch: Callable[[], None] | None
) -> EngineReport:
    found = probe(engine)
    words = [*engine.lmp_args, "-in", input_file, "-log", "log.lammps", "-screen", "none"]
    ended = _child(engine, [str(engine.lmp), *words], folder, time_limit, watch)
    text = _read(folder / "log.lammps")
    if ended.code != 0:
        # before it has opened its log it speaks to the screen
        error = log.error(text) or log.error(_read(folder / "stderr.txt"))
        raise _failure(error, folder) if error else _death(ended, "running the deck", folder)
    _check_ranks(engine, log.ranks(text) or engine.ranks)
    return EngineReport(
        version=log.version(text) or found.version,
        packages=found.packages,
        wall=ended.wall,
        cpu=ended.cpu,
        build=found.lines,
        ranks=engine.ranks,
        memory=ended.memory,
        **_of_the_steps(text),
    )


def _of_the_steps(text: str) -> dict[str, Any]:
    """Fields of an EngineReport from a log."""
    return {
        "loop": log.loop_time(text),
        "pair_style": log.pair_style(text),
        "potential_energy": log.potential_energy(text),
    }


def _ask_module(engine: Engine, folder: Path) -> Build:
    said = _worker(engine, folder, ["ask", *STYLES], _PROBE, launched=False)
    return Build(
        version=said["version"],
        packages=tuple(said["packages"]),
        lines=tuple(said.get("lines", ())),
        styles=said["styles"],
        libmpi=said.get("libmpi", ""),
    )


def _ask_binary(engine: Engine, folder: Path) -> Build:
    ended = _child(engine, [str(engine.lmp), "-help"], folder, _PROBE, launched=False)
    text = _read(folder / "stderr.txt")
    found = log.build(text)
    if found is None:
        words = f": {text.strip().splitlines()[-1].strip()}" if text.strip() else ""
        advice = f"; {remedy(text)}" if "MPI" in text or "libmpi" in text else ""
        raise BackendUnavailable(
            f"{engine.lmp} does not answer to -help as LAMMPS does: it ended {ended.how}{words}{advice}"
        )
    return found


def _worker(
    engine: Engine,
    folder: Path,
    words: Sequence[str],
    time_limit: float,
    watch: Callable[[], None] | None = None,
    *,
    launched: bool = True,
) -> dict[str, Any]:
    command = [str(engine.python or sys.executable), str(WORKER), _ANSWER, *words]
    ended = _child(engine, command, folder, time_limit, watch, launched=launched)
    # the answer first, the exit code second: an engine may crash after it has answered
    said = _answer(folder / _ANSWER)
    if said["stage"] == "done" and (ended.code == 0 or engine.ranks == 1):
        return said
    ranks = [said, *(_answer(path) for path in sorted(folder.glob(f"{_ANSWER}.*")))]
    error = next((str(one["error"]) for one in ranks if one["error"]), "")
    if not error:
        raise _death(ended, _SILENT_STAGES[said["stage"]], folder)
    # arguments that LAMMPS refuses are named on its screen alone
    own = log.error(_read(folder / "stderr.txt").replace("LAMMPS Exception: ", ""))
    if said["stage"] == "load" and not own:
        text = " ".join(error.split())
        whose = f"the lammps module of {engine.python}" if engine.python else "the lammps module"
        raise BackendUnavailable(f"{whose} does not load: {text}; {remedy(text)}")
    raise _failure(own if said["stage"] == "load" else error, folder)


def _child(
    engine: Engine,
    command: Sequence[str],
    folder: Path,
    time_limit: float,
    watch: Callable[[], None] | None = None,
    *,
    launched: bool = True,
) -> _Ended:
    """Run a command, on the engine's ranks if ``launched``; whatever happens, nothing of it is left."""
    launcher = engine.launcher() if launched else []
    if launcher or engine.lmp:  # the worker looks after itself
        launcher = [sys.executable, "-IS", str(PARENT_DEATH_GUARD), *launcher]
    began = time.perf_counter()
    with (folder / "stderr.txt").open("wb") as sink:
        try:
            child = subprocess.Popen(
                [*launcher, *command],
                cwd=folder,
                stdin=subprocess.DEVNULL,
                stdout=sink,
                stderr=sink,
                env=engine.environment(),
                start_new_session=True,  # so that a hanging engine goes with all it has started
            )
        except OSError as error:
            raise BackendUnavailable(f"{command[0]} cannot be started: {error.strerror}") from error
        try:
            return _wait(child, began, time_limit, watch)
        except subprocess.TimeoutExpired:
            raise RunBroken(
                f"LAMMPS did not finish within the time limit of {time_limit:g} s and was stopped",
                log=_last_lines(folder),
            ) from None
        finally:
            if child.returncode is None:
                # ranks have sessions of their own: they end with MPI's launcher
                os.killpg(child.pid, signal.SIGKILL)
                child.wait()
            _sweep(child.pid)


def _sweep(pid: int) -> None:
    """Remove the shared memory of an MPI whose process ended without its farewell: MPICH keeps 1 MB for each, named
    after the process, until the machine is started anew."""
    for path in SHARED_MEMORY.glob(f"mpich_shm_{pid:x}_*"):
        with suppress(OSError):  # another user's
            path.unlink()


def _wait(child: subprocess.Popen[bytes], began: float, time_limit: float, watch: Callable[[], None] | None) -> _Ended:
    """How the child ended; TimeoutExpired beyond the limit."""
    end = began + time_limit
    with _ending(child) as ended_within:
        while True:
            left = end - time.perf_counter()
            if ended_within(left if watch is None else min(left, 0.2)):
                break
            if time.perf_counter() >= end:
                raise subprocess.TimeoutExpired(child.args, time_limit)
            if watch is not None:
                watch()
    # wait4 and not wait, for what the child and its children have used
    _, status, used = os.wait4(child.pid, 0)
    child.returncode = os.waitstatus_to_exitcode(status)
    return _Ended(
        code=child.returncode,
        wall=time.perf_counter() - began,
        cpu=used.ru_utime + used.ru_stime,
        # a child takes over what its parent had at the fork: below that nothing is known of it
        memory=1024 * used.ru_maxrss if used.ru_maxrss > resource.getrusage(resource.RUSAGE_SELF).ru_maxrss else 0,
    )


@contextmanager
def _ending(child: subprocess.Popen[bytes]) -> Iterator[Callable[[float], bool]]:
    """A wait of so many seconds for the child's end, that reaps nothing and wakes at once."""
    try:
        handle = os.pidfd_open(child.pid)
    except OSError:  # an old kernel, or one that forbids it: look again and again
        handle = -1

    def within(seconds: float) -> bool:
        if handle >= 0:
            poll = select.poll()
            poll.register(handle, select.POLLIN)
            return bool(poll.poll(max(0.0, 1e3 * min(seconds, 1e6))))
        end = time.perf_counter() + seconds
        while os.waitid(os.P_PID, child.pid, os.WEXITED | os.WNOHANG | os.WNOWAIT) is None:
            if time.perf_counter() >= end:
                return False
            time.sleep(0.005)
        return True

    try:
        yield within
    finally:
        if handle >= 0:
            os.close(handle)


def _check_ranks(engine: Engine, found: int) -> None:
    if engine.ranks > 1 and found != engine.ranks:
        raise BackendUnavailable(
            f"ranks = {engine.ranks}, but LAMMPS ran {engine.ranks} times on {found}: {engine.launcher()[0]} is not"
            " of the MPI that it was built with; put the right mpiexec beside it or first on PATH"
        )


def _failure(error: str, folder: Path) -> BackendUnavailable | RunBroken:
    """What LAMMPS' own words mean."""
    text = "LAMMPS: " + " ".join(error.split())
    return BackendUnavailable(text) if lacks(text) else RunBroken(text, log=_last_lines(folder))


def _death(ended: _Ended, doing: str, folder: Path) -> RunBroken:
    said = [line.strip() for line in _read(folder / "stderr.txt").split("\n") if line.strip(" =\t")]
    # MPI's launcher ends with a farewell that says nothing
    said = [line for line in said if "EXIT STRING" in line] or said
    words = f": {said[-1]}" if said else ""
    return RunBroken(f"LAMMPS ended {ended.how} while {doing}{words}", log=_last_lines(folder))


def _answer(path: Path) -> dict[str, Any]:
    try:
        said: dict[str, Any] = json.loads(path.read_text())
    except (FileNotFoundError, json.JSONDecodeError):
        return {"stage": "load", "error": ""}
    return said


def _read(path: Path) -> str:
    return path.read_text(errors="replace") if path.is_file() else ""


def _last_lines(folder: Path) -> str:
    return "\n".join(_read(folder / "log.lammps").splitlines()[-20:])
