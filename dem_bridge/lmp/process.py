"""Running LAMMPS in a child process, and returning its result, its error or its crash to the caller.

A failed ``pair_coeff`` or an invalid atom type can terminate a whole process, and a run can hang. Here every end of the
child is a result or an exception, and never the end of the caller.
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory, gettempdir
from typing import IO, Any

from dem_bridge.errors import BackendUnavailable, RunBroken
from dem_bridge.foundation.leftovers import owned, sweep_temporary
from dem_bridge.lmp import loaded, log
from dem_bridge.lmp.child import PARENT_DEATH_GUARD, Ended, how_ended, now, sweep_shared_memory, wait
from dem_bridge.lmp.engine import STYLES, Build, Engine, lacks, remedy

WORKER = Path(__file__).with_name("worker.py")
#: files of a task: the reply of the worker, LAMMPS' log, and what the child writes to the screen
_ANSWER, _LOG, _SCREEN = "answer.json", "log.lammps", "stderr.txt"
_SILENT_STAGES = {"load": "loading the lammps module", "run": "running the deck", "done": "closing"}
#: time limit for an engine to report its version, s
_PROBE = 60.0
#: a disk with less free space than this counts as full, bytes
FULL_DISK = 1_000_000
_OWN_FOLDER = "set TMPDIR to a folder with more room"


@dataclass(frozen=True, kw_only=True)
class EngineReport:
    """Result of a run of the engine. Times are of the deck alone, or of the whole process of a binary."""

    version: int
    packages: tuple[str, ...]
    wall: float
    """Wall time, s."""
    cpu: float
    """CPU time of all ranks together, s."""
    build: tuple[str, ...] = ()
    """Compiler and MPI library."""
    ranks: int = 1
    loop: float = 0.0
    """Wall time of the time steps alone, s."""
    memory: int = 0
    """Peak memory of one process, bytes; 0 if unknown."""
    pair_style: str = ""
    """Name of the pair style with the suffix that LAMMPS chose; '' if the log does not contain it."""
    energies: Mapping[int, tuple[float, float]] = field(default_factory=dict)
    """Potential and kinetic energy by step, J, as far as the log contains them."""


def run_deck(
    folder: Path,
    input_file: str,
    *,
    time_limit: float,
    watch: Callable[[], None] | None = None,
    engine: Engine | None = None,
) -> EngineReport:
    """Run ``input_file`` in ``folder``.

    Parameters
    ----------
    folder : Path
        Folder of the run.
    input_file : str
        Name of the deck.
    time_limit : float
        Time limit, s.
    watch : callable, optional
        Function that is called a few times per second during the run.
    engine : Engine, optional
        The LAMMPS to run; None means this environment's module.

    Raises
    ------
    BackendUnavailable
        If the engine cannot be started or lacks a style.
    RunBroken
        If the run fails; the message contains LAMMPS' error.
    """
    engine = engine or Engine()
    task = _Task(engine=engine, folder=folder, time_limit=time_limit, watch=watch, launched=True)
    return (task.run_by_binary if task.engine.lmp else task.run_by_module)(input_file)


def load_engine(engine: Engine) -> None:
    """Begin to load an engine before :func:`run_deck`; a binary and several ranks start with their deck."""
    task = _Task(engine=engine, folder=Path(), launched=True)
    if task.forks:
        loaded.begin_to_load(*task.server())


@contextmanager
def deck_worker(engine: Engine, folder: Path, channel: int) -> Iterator[IO[bytes]]:
    """Yield the stdin of a process that runs the decks of ``folder`` whose names are its lines, within the context.

    For each it writes LAMMPS' error, '' for none, as a line of JSON to the descriptor ``channel``; an error ends it.
    """
    task = _Task(engine=engine, folder=folder)
    command = [*task.script(), _ANSWER, "decks", str(channel), *engine.lmp_args]
    with task.process(command, stdin=subprocess.PIPE, pass_fds=(channel,)) as worker:
        assert worker.stdin is not None
        yield worker.stdin


def require(engine: Engine, style: str) -> Build:
    """Return what an engine reports about itself.

    Parameters
    ----------
    engine : Engine
        The LAMMPS to ask.
    style : str
        One of ``engine.STYLES``, which it must have.

    Raises
    ------
    BackendUnavailable
        If there is no engine or it lacks the style; the message contains the remedy.
    """
    lammps = probe(engine)
    if not lammps.styles[style]:
        kind, name = style.split()
        package = f"; install one with the {STYLES[style]} package" if STYLES[style] else ""
        raise BackendUnavailable(f"LAMMPS {lammps.version} has no {kind}_style {name}{package}")
    engine.launcher()  # raises if there is none
    return lammps


@cache
def probe(engine: Engine) -> Build:
    """Return what an engine reports about itself, or raise BackendUnavailable with the remedy."""
    try:
        with workspace() as folder:
            task = _Task(engine=engine, folder=folder)
            return (task.ask_binary if engine.lmp else task.ask_module)()
    except RunBroken as error:
        raise BackendUnavailable(str(error)) from error


@contextmanager
def workspace() -> Iterator[Path]:
    """Yield a temporary folder for one run, which is deleted afterwards.

    Raises
    ------
    RunBroken
        If the folder cannot be created or written.
    """
    sweep_temporary()
    try:
        with TemporaryDirectory(prefix=owned("dem-bridge"), ignore_cleanup_errors=True) as name:
            try:
                yield Path(name)
            except RunBroken as error:
                # LAMMPS does not report a failed write
                if shutil.disk_usage(name).free >= FULL_DISK:
                    raise
                raise RunBroken(f"{error}; {_OWN_FOLDER}: {gettempdir()} is full", log=error.log) from error
    except OSError as error:
        raise RunBroken(
            f"the temporary folder cannot be written ({error.strerror}: {error.filename or gettempdir()});"
            f" {_OWN_FOLDER}"
        ) from error


def check_room(folder: Path, needs: int) -> None:
    """Raise RunBroken unless the disk of a folder has room for ``needs`` bytes."""
    free = shutil.disk_usage(folder).free
    if free < needs:
        raise RunBroken(
            f"the run writes {needs / 1e6:.0f} MB and {gettempdir()} has {free / 1e6:.0f} MB free;"
            f" {_OWN_FOLDER}, or ask for fewer samples"
        )


@dataclass(frozen=True, kw_only=True)
class _Task:
    """A run of an engine, or a question to it, in a child process that works in a folder."""

    engine: Engine
    folder: Path
    time_limit: float = _PROBE
    watch: Callable[[], None] | None = None
    launched: bool = False
    """True for a run on the engine's ranks."""

    @property
    def forks(self) -> bool:
        """Return True if a process that has loaded the engine does the task in a fork."""
        return loaded.CAN_FORK and self.engine.lmp is None and not (self.launched and self.engine.ranks > 1)

    def run_by_module(self, input_file: str) -> EngineReport:
        """Run the deck by the ``lammps`` module in a worker process."""
        reply = self._worker("run", input_file, *self.engine.lmp_args)
        others = [_answer(path) for path in self.folder.glob(f"{_ANSWER}.*") if path.suffix != ".part"]
        return self._report(
            int(reply.get("ranks", 1)),
            version=reply["version"],
            packages=tuple(reply["packages"]),
            build=tuple(reply.get("lines", ())),
            wall=reply["wall"],
            cpu=reply["cpu"] + sum(float(other.get("cpu", 0.0)) for other in others),
            memory=max(int(rank_reply.get("memory", 0)) for rank_reply in (reply, *others)),
        )

    def run_by_binary(self, input_file: str) -> EngineReport:
        """Run the deck by a binary."""
        build = probe(self.engine)
        words = [*self.engine.lmp_args, "-in", input_file, "-log", _LOG, "-screen", "none"]
        ended = self._child([str(self.engine.lmp), *words])
        text = self._read(_LOG)
        if ended.code != 0:
            # before LAMMPS opens its log, it writes errors to the screen
            error = log.error(text) or log.error(self._read(_SCREEN))
            raise self._failure(error) if error else self._death(ended.code, "running the deck")
        return self._report(
            log.ranks(text) or self.engine.ranks,
            version=log.version(text) or build.version,
            packages=build.packages,
            build=build.lines,
            wall=ended.wall,
            cpu=ended.cpu,
            memory=ended.memory,
        )

    def _report(self, ranks: int, **values: Any) -> EngineReport:
        """Return the report of a run on so many ranks, or raise BackendUnavailable if there should have been more."""
        if self.engine.ranks > 1 and ranks != self.engine.ranks:
            raise BackendUnavailable(
                f"ranks = {self.engine.ranks}, but LAMMPS ran {self.engine.ranks} times on {ranks}:"
                f" {self.engine.launcher()[0]} does not belong to the MPI library that LAMMPS was built with; put the"
                " right mpiexec next to it or first on PATH"
            )
        text = self._read(_LOG)
        of_steps: dict[str, Any] = {"loop": log.loop_time(text), "energies": log.energies(text)}
        return EngineReport(ranks=self.engine.ranks, pair_style=log.pair_style(text), **of_steps, **values)

    def ask_module(self) -> Build:
        """Return what the ``lammps`` module reports about itself."""
        reply = self._worker("ask", *STYLES)
        packages, lines = tuple(reply["packages"]), tuple(reply.get("lines", ()))
        about = {"styles": reply["styles"], "libmpi": reply.get("libmpi", "")}
        return Build(version=reply["version"], packages=packages, lines=lines, **about)

    def ask_binary(self) -> Build:
        """Return what a binary reports about itself."""
        ended = self._child([str(self.engine.lmp), "-help"])
        text = self._read(_SCREEN)
        build = log.build(text)
        if build is None:
            words = f": {text.strip().splitlines()[-1].strip()}" if text.strip() else ""
            advice = f"; {remedy(text)}" if "MPI" in text or "libmpi" in text else ""
            problem = f"{self.engine.lmp} is not LAMMPS: with -help it ended {how_ended(ended.code)}"
            raise BackendUnavailable(f"{problem}{words}{advice}")
        return build

    def _worker(self, *words: str) -> dict[str, Any]:
        """Run a task in the worker process and return its reply."""
        code = self._fork(*words) if self.forks else self._child([*self.script(), _ANSWER, *words]).code
        # the reply counts before the exit code, because an engine may crash after its reply
        reply = _answer(self.folder / _ANSWER)
        if reply["stage"] == "done" and (code == 0 or self.engine.ranks == 1):
            return reply
        ranks = [reply, *(_answer(path) for path in sorted(self.folder.glob(f"{_ANSWER}.*")))]
        error = next((str(rank_reply["error"]) for rank_reply in ranks if rank_reply["error"]), "")
        if not error:
            raise self._death(code, _SILENT_STAGES[reply["stage"]])
        # LAMMPS reports invalid arguments on the screen only
        screen_error = log.error(self._read(_SCREEN).replace("LAMMPS Exception: ", ""))
        if reply["stage"] == "load" and not screen_error:
            text = " ".join(error.split())
            whose = f"the lammps module of {self.engine.python}" if self.engine.python else "the lammps module"
            raise BackendUnavailable(f"{whose} does not load: {text}; {remedy(text)}")
        raise self._failure(screen_error if reply["stage"] == "load" else error)

    def script(self) -> list[str]:
        """Return the command of the worker without its task."""
        return [str(self.engine.python or sys.executable), str(WORKER)]

    def server(self) -> tuple[list[str], dict[str, str]]:
        """Return the command and the environment of a process that loads the engine and forks for each task."""
        return [*self.script(), "serve"], self.engine.environment()

    def _fork(self, *words: str) -> int:
        """Do a task in a fork of a loaded engine and return its exit code; no process of it remains."""
        (self.folder / _ANSWER).unlink(missing_ok=True)
        with self._stopped_in_time(), loaded.loaded_engine(*self.server()) as parent:
            limit, watch = self.time_limit, self.watch
            return parent.run([_ANSWER, *words], self.folder, _SCREEN, time_limit=limit, watch=watch)

    def _child(self, command: Sequence[str]) -> Ended:
        """Run a command; no process of it remains, whatever happens."""
        began = now()
        with self._stopped_in_time(), self.process(command) as child:
            return wait(child, began, self.time_limit, self.watch)

    @contextmanager
    def _stopped_in_time(self) -> Iterator[None]:
        """Raise RunBroken if the context ends with the time limit."""
        try:
            yield
        except TimeoutError:
            problem = f"LAMMPS did not finish within the time limit of {self.time_limit:g} s and was stopped"
            raise RunBroken(problem, log=self._last_lines()) from None

    @contextmanager
    def process(
        self, command: Sequence[str], stdin: int = subprocess.DEVNULL, pass_fds: tuple[int, ...] = ()
    ) -> Iterator[subprocess.Popen[bytes]]:
        """Yield the process of a command; no process of it remains after the context, whatever happens."""
        launcher = self.engine.launcher() if self.launched else []
        if launcher or self.engine.lmp:  # the worker ends with its parent by itself
            launcher = [sys.executable, "-IS", str(PARENT_DEATH_GUARD), *launcher]
        with (self.folder / _SCREEN).open("wb") as sink:
            try:
                child = subprocess.Popen(
                    [*launcher, *command],
                    bufsize=0,
                    cwd=self.folder,
                    stdin=stdin,
                    stdout=sink,
                    stderr=sink,
                    env=self.engine.environment(),
                    pass_fds=pass_fds,
                    start_new_session=True,  # so that a hanging engine can be killed with all its children
                )
            except OSError as error:
                raise BackendUnavailable(f"{command[0]} cannot be started: {error.strerror}") from error
        try:
            yield child
        finally:
            if child.stdin is not None:
                child.stdin.close()
            if child.returncode is None:
                # ranks are in other sessions: they end with MPI's launcher
                os.killpg(child.pid, signal.SIGKILL)
                child.wait()
            sweep_shared_memory(child.pid)

    def _failure(self, error: str) -> BackendUnavailable | RunBroken:
        """Return the exception for an error of LAMMPS."""
        text = "LAMMPS: " + " ".join(error.split())
        return BackendUnavailable(text) if lacks(text) else RunBroken(text, log=self._last_lines())

    def _death(self, code: int, stage: str) -> RunBroken:
        """Return the exception for a child that ended without an error message."""
        lines = [line.strip() for line in self._read(_SCREEN).split("\n") if line.strip(" =\t")]
        # the last lines of MPI's launcher contain no information
        lines = [line for line in lines if "EXIT STRING" in line] or lines
        words = f": {lines[-1]}" if lines else ""
        return RunBroken(f"LAMMPS ended {how_ended(code)} while {stage}{words}", log=self._last_lines())

    def _read(self, name: str) -> str:
        """Return the text of a file; '' if there is none."""
        path = self.folder / name
        return path.read_text(errors="replace") if path.is_file() else ""

    def _last_lines(self) -> str:
        """Return the last 20 lines of LAMMPS' log."""
        return "\n".join(self._read(_LOG).splitlines()[-20:])


def _answer(path: Path) -> dict[str, Any]:
    """Return the reply that the worker wrote, or that of a worker which has not started."""
    try:
        reply: dict[str, Any] = json.loads(path.read_text())
    except (FileNotFoundError, json.JSONDecodeError):
        return {"stage": "load", "error": ""}
    return reply
