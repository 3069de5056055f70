"""Compiled kernels: they are recompiled when a source changes, and a running one can be interrupted."""

from __future__ import annotations

import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any


def forget_stale(package: Path = Path(__file__).parent) -> None:
    """Delete all cached kernels that are older than a source file with a kernel, so that they are compiled again.

    numba compares a cached kernel with its own source file only. The kernel has inlined functions from other files,
    which may have changed since, for example after ``git pull``; numba would go on using the old code.
    """
    indexes = list(package.glob("**/__pycache__/*.nbi"))
    sources = {index.parent.parent / f"{index.name.split('.')[0]}.py" for index in indexes}
    newest = max((source.stat().st_mtime for source in sources if source.exists()), default=0.0)
    for index in indexes:
        with suppress(OSError):  # another process deleted it, or the folder is read-only
            if index.stat().st_mtime < newest:
                index.unlink()


forget_stale()


def interruptible(kernel: Callable[..., Any], *arguments: Any) -> Any:
    """Return ``kernel(*arguments)`` for a kernel that releases the interpreter lock; Ctrl-C ends the wait at once.

    Compiled code does not check for signals, and a signal that arrives during it breaks the return of the result. The
    kernel therefore runs in a thread that can be abandoned, and signals reach the waiting main thread.
    """
    return started(kernel, *arguments)()


def started(work: Callable[..., Any], *arguments: Any) -> Callable[[], Any]:
    """Start ``work(*arguments)`` in a thread, and return a function that waits for its result.

    The function re-raises what ``work`` raised. The program does not wait for the thread when it ends.
    """
    result: list[Any] = []
    failure: list[BaseException] = []

    def run() -> None:
        try:
            result.append(work(*arguments))
        except BaseException as error:  # carried to the caller's thread
            failure.append(error)

    thread = threading.Thread(target=run, daemon=True)
    thread.start()

    def wait() -> Any:
        while thread.is_alive():
            thread.join(0.1)
        if failure:
            raise failure[0]
        return result[0]

    return wait
