"""Read files that may be damaged or hostile, in a child process with limits of time and memory.

Libraries in C, such as HDF5, may crash or never end on a damaged file. The child is started once, serves for all files,
and is started again after it had to be stopped.
"""

from __future__ import annotations

import atexit
import json
import os
import pickle
import select
import signal
import subprocess
import sys
import threading
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

from dem_bridge.errors import UsageError

_CHILD = Path(__file__).with_name("isolated_child.py")
#: CPU time for a file, s, and for each MiB of it; the wall time may be longer by a factor on a machine with other work
CPU_SECONDS, CPU_PER_MIB, WALL_FACTOR = 5.0, 0.1, 8.0
#: memory of the child, bytes
MEMORY = 2**32


def start_script(script: Path, *words: str) -> subprocess.Popen[bytes]:
    """Start a script of the package with the path of modules of this process and ``words``; ask it by its pipes.

    Raises OSError if no process can be started.
    """
    return subprocess.Popen(
        [sys.executable, "-P", str(script), json.dumps(sys.path), *words],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        bufsize=0,
        start_new_session=True,  # Ctrl-C stops this process, which then stops the script
        env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
    )


class _Child:
    """A child process that calls one function at a time."""

    def __init__(self) -> None:
        self.process = start_script(_CHILD, str(MEMORY))
        self.owner = os.getpid()

    def ask(self, question: Any, seconds: float) -> tuple[bool, Any]:
        """Return the answer to a question; raise TimeoutError, or EOFError if the process ended."""
        assert self.process.stdin is not None
        self.process.stdin.write(json.dumps(question).encode() + b"\n")
        end = time.monotonic() + seconds
        size = int.from_bytes(self._take(8, end), "little")
        answer: tuple[bool, Any] = pickle.loads(self._take(size, end))
        return answer

    def _take(self, count: int, end: float) -> bytearray:
        """Return the next bytes."""
        assert self.process.stdout is not None
        out = bytearray()
        while len(out) < count:
            if not select.select([self.process.stdout], [], [], max(0.0, end - time.monotonic()))[0]:
                raise TimeoutError
            part = self.process.stdout.read(min(count - len(out), 1 << 20))
            if not part:
                raise EOFError
            out += part
        return out

    def stop(self) -> int:
        """End the process and return its exit code."""
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.process.kill()
        self.process.stdin.close()
        self.process.stdout.close()
        return self.process.wait()


_lock = threading.Lock()
_children: list[_Child] = []


def call_isolated(module: str, function: str, path: Path, **settings: Any) -> Any:
    """Return ``function(path, **settings)`` of a module, called in the child process.

    Parameters
    ----------
    module, function : str
        Name of the function; its result must be picklable.
    path : Path
        File that it reads; its size determines the limit of time.
    **settings
        JSON types.

    Raises
    ------
    UsageError
        If the function raises any exception, crashes, or exceeds a limit.
    """
    size = path.stat().st_size / 2**20
    seconds = CPU_SECONDS + CPU_PER_MIB * size
    with _lock:
        if _children and _children[0].owner != os.getpid():  # that of the process from which this one was forked
            _children.clear()
        if not _children:
            _children.append(_Child())
        child = _children[0]
        try:
            fine, answer = child.ask([module, function, str(path.absolute()), settings, seconds], WALL_FACTOR * seconds)
        except BaseException as error:
            _children.clear()
            with suppress(ProcessLookupError):
                code = child.stop()
            if not isinstance(error, TimeoutError | EOFError | OSError):
                raise
            late = isinstance(error, TimeoutError) or code == -signal.SIGPROF
            reason = f"took more than {seconds:.0f} s" if late else "crashed"
            raise UsageError(f"the file is damaged: reading it {reason} and was stopped; write it again") from None
    if not fine:
        raise UsageError(answer)
    return answer


@atexit.register
def _stop_children() -> None:
    """Stop the child of this process."""
    for child in _children:
        if child.owner == os.getpid():
            child.stop()
    _children.clear()
