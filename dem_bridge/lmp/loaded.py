"""Processes that have loaded an engine and do each task in a fork: a short deck takes 15 ms of CPU there, alone 100 ms.

They stay for further tasks and end with this process, however it ends.
"""

from __future__ import annotations

import atexit
import json
import os
import resource
import select
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path

from dem_bridge.errors import BackendUnavailable
from dem_bridge.lmp.child import now

#: True where a process that has loaded libraries can be forked
CAN_FORK = sys.platform == "linux"
#: processes without a task that stay, each for another engine or another environment
_MOST_IDLE = 4
#: s between two calls of the caller's function, and s for which a process may end its task and itself
_WATCH, _GRACE = 0.2, 5.0
#: variables that change from run to run and that no library reads
_NOT_READ = ("DEM_BRIDGE_", "PYTEST_")
#: an MPI library that looks for no network and no caches of the processor starts in half the time; one rank needs none
_ONE_RANK = {"UCX_TLS": "self", "HWLOC_COMPONENTS": "no_os,stop"}
_LIMITS = tuple(getattr(resource, name) for name in dir(resource) if name.startswith("RLIMIT_"))


class LoadedEngine:
    """A process that has loaded an engine, or is about to, and does one task at a time."""

    def __init__(self, command: Sequence[str], environment: Mapping[str, str]) -> None:
        self.begun_as = _begun_as(command, environment)
        self.owner = os.getpid()
        self._screen = os.fdopen(os.memfd_create("screen"), "r+b")
        """What it prints while it loads."""
        try:
            self.process = subprocess.Popen(
                command, bufsize=0, cwd="/", stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self._screen,
                env={**_ONE_RANK, **environment}, start_new_session=True,
            )  # fmt: skip
        except OSError as error:
            self._screen.close()
            raise BackendUnavailable(f"{command[0]} cannot be started: {error.strerror}") from error

    @property
    def is_ready(self) -> bool:
        """Return True if it can do a task."""
        return self.process.poll() is None

    def run(
        self, words: Sequence[str], folder: Path, screen: str, *, time_limit: float, watch: Callable[[], None] | None
    ) -> int:
        """Do a task in a folder and return its exit code, or that of this process if it ended.

        Parameters
        ----------
        words : sequence of str
            The task, as ``worker.py`` describes it.
        folder : Path
            Folder of the task.
        screen : str
            Name of a file for what the engine prints.
        time_limit : float
            Time limit, s.
        watch : callable, optional
            Function that is called a few times per second.

        Raises
        ------
        TimeoutError
            After the time limit; the task still runs then, until :meth:`stop`.
        """
        stdin, stdout, end = self.process.stdin, self.process.stdout, now() + time_limit
        assert stdin is not None
        assert stdout is not None
        with suppress(BrokenPipeError):  # its end is seen below
            stdin.write(json.dumps([str(folder.absolute()), screen, *words]).encode() + b"\n")
        while not select.select([stdout], [], [], min(_WATCH, time_limit))[0]:
            if now() >= end:
                raise TimeoutError
            if watch is not None:
                watch()
        if line := stdout.readline():
            return int(line)
        code = self.process.wait()
        self._screen.seek(0)
        with (folder / screen).open("ab") as sink:
            sink.write(self._screen.read())
        return code

    def stop(self, grace: float = _GRACE) -> None:
        """End the process with its task and all that the task has started; without a task it needs no ``grace``, s."""
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.process.stdin.close()
        try:
            self.process.wait(grace)
        except subprocess.TimeoutExpired:
            os.killpg(self.process.pid, signal.SIGKILL)
            self.process.wait()
        self.process.stdout.close()
        self._screen.close()


_lock = threading.Lock()
_idle: list[LoadedEngine] = []


def begin_to_load(command: Sequence[str], environment: Mapping[str, str]) -> None:
    """Start a process for the next task of an engine, unless one waits for it; parameters as :func:`loaded_engine`."""
    _stay(_take(command, environment))


@contextmanager
def loaded_engine(command: Sequence[str], environment: Mapping[str, str]) -> Iterator[LoadedEngine]:
    """Yield a process that has loaded an engine; it stays for further tasks, but not after an exception.

    Parameters
    ----------
    command : sequence of str
        Command that starts ``worker.py serve``.
    environment : mapping
        Environment variables of the engine.

    Raises
    ------
    BackendUnavailable
        If the process cannot be started.
    """
    loaded = _take(command, environment)
    try:
        yield loaded
    except BaseException:
        loaded.stop()
        raise
    _stay(loaded)


def _take(command: Sequence[str], environment: Mapping[str, str]) -> LoadedEngine:
    """Return a process that waits and was begun in the same way, or another."""
    environment = {name: value for name, value in environment.items() if not name.startswith(_NOT_READ)}
    begun_as = _begun_as(command, environment)
    with _lock:
        # a fork of this process may not use them
        _idle[:] = [loaded for loaded in _idle if loaded.owner == os.getpid()]
        for loaded in reversed(_idle):
            if loaded.begun_as == begun_as and loaded.is_ready:
                _idle.remove(loaded)
                return loaded
    return LoadedEngine(command, environment)


def _stay(loaded: LoadedEngine) -> None:
    """Keep a process for further tasks, and stop the one that has waited longest if there are too many."""
    if not loaded.is_ready:
        loaded.stop()
        return
    _stop_at_exit(os.getpid())
    with _lock:
        _idle.append(loaded)
        surplus = _idle[:-_MOST_IDLE]
        del _idle[:-_MOST_IDLE]
    for another in surplus:
        another.stop(0.0)


@cache
def _stop_at_exit(_: int) -> None:
    """Stop the processes of this process when it ends."""
    if multiprocessing := sys.modules.get("multiprocessing.util"):  # its processes may end without atexit
        multiprocessing.Finalize(None, stop_idle, exitpriority=10)
    else:
        atexit.register(stop_idle)


def stop_idle() -> None:
    """Stop the processes of this process that wait for a task."""
    with _lock:
        waiting = [loaded for loaded in _idle if loaded.owner == os.getpid()]
        _idle.clear()
    for loaded in waiting:
        loaded.stop(0.0)


def _begun_as(command: Sequence[str], environment: Mapping[str, str]) -> tuple[object, ...]:
    """Return the command and all that a process takes over from this one."""
    limits = [resource.getrlimit(limit) for limit in _LIMITS]
    return tuple(command), tuple(sorted(environment.items())), tuple(limits), frozenset(os.sched_getaffinity(0))
