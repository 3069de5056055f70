"""Start, watch and end child processes, of which nothing remains."""

from __future__ import annotations

import os
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from dem_bridge.foundation.leftovers import SHARED_MEMORY

PARENT_DEATH_GUARD = Path(__file__).with_name("parent_death_guard.py")
#: interval between two checks of the child's state, s, and number of checks between two calls of the caller's function
_POLL, _CHECKS_PER_WATCH = 0.002, 100


@dataclass(frozen=True, kw_only=True)
class Ended:
    """The end of a child; times in s, including all its own children."""

    code: int
    wall: float
    cpu: float
    memory: int


def how_ended(code: int) -> str:
    """Return the description of an exit code, which is negative for a signal.

    >>> how_ended(-9)
    'by SIGKILL'
    """
    return f"by {signal.Signals(-code).name}" if code < 0 else f"with exit code {code}"


def now() -> float:
    """Return the time of the clock by which children are timed, s."""
    return time.perf_counter()


def run_program(command: Sequence[str], folder: Path, *, time_limit: float, stdout: Path, stderr: Path) -> Ended:
    """Run any program in a folder, with its output in two files; no process of it remains, whatever happens.

    Raises
    ------
    OSError
        If the program cannot be started.
    TimeoutError
        If it does not end within ``time_limit`` (s).
    """
    with stdout.open("wb") as out, stderr.open("wb") as err:
        began = now()
        guarded = [sys.executable, "-IS", str(PARENT_DEATH_GUARD), *command]
        child = subprocess.Popen(
            guarded, cwd=folder, stdin=subprocess.DEVNULL, stdout=out, stderr=err, start_new_session=True
        )
    try:
        return wait(child, began, time_limit, None)
    finally:
        with suppress(ProcessLookupError):  # also processes that it has left behind
            os.killpg(child.pid, signal.SIGKILL)
        if child.returncode is None:
            child.wait()
        sweep_shared_memory(child.pid)


def sweep_shared_memory(pid: int) -> None:
    """Remove the shared memory of an MPI library whose process was killed.

    MPICH keeps 1 MB for each, named after the process, until the machine is restarted.
    """
    for path in SHARED_MEMORY.glob(f"mpich_shm_{pid:x}_*"):
        with suppress(OSError):  # it belongs to another user
            path.unlink()


def wait(child: subprocess.Popen[bytes], began: float, time_limit: float, watch: Callable[[], None] | None) -> Ended:
    """Wait for the child and return its end, or raise TimeoutError."""
    end, checks = began + time_limit, 0
    # wait4 returns the resources that the child and its children used
    while not (ended := os.wait4(child.pid, os.WNOHANG))[0]:
        if now() >= end:
            raise TimeoutError
        checks += 1
        if watch is not None and checks % _CHECKS_PER_WATCH == 0:
            watch()
        time.sleep(_POLL)
    _, status, usage = ended
    child.returncode = os.waitstatus_to_exitcode(status)
    return Ended(
        code=child.returncode,
        wall=now() - began,
        cpu=usage.ru_utime + usage.ru_stime,
        # a child inherits its parent's peak at the fork, so that only a larger value is its own
        memory=1024 * usage.ru_maxrss if usage.ru_maxrss > resource.getrusage(resource.RUSAGE_SELF).ru_maxrss else 0,
    )
