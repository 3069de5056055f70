"""Compiled kernels: never older than their sources, and run so that a person can still interrupt them."""

from __future__ import annotations

import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any


def forget_stale(package: Path = Path(__file__).parent) -> None:
    """Forget all kept kernels that are older than any file with a kernel in it: they are compiled anew.

    numba compares a kept kernel with its own file alone. What it calls from another file, and has inlined, may have
    changed since, as after ``git pull``: it would go on with the old one.
    """
    indexes = list(package.glob("**/__pycache__/*.nbi"))
    sources = {index.parent.parent / f"{index.name.split('.')[0]}.py" for index in indexes}
    newest = max((source.stat().st_mtime for source in sources if source.exists()), default=0.0)
    for index in indexes:
        with suppress(OSError):  # another process was here, or the folder may only be read
            if index.stat().st_mtime < newest:
                index.unlink()


forget_stale()


def interruptible(kernel: Callable[..., Any], *arguments: Any) -> Any:
    """``kernel(*arguments)``, for a kernel that releases the interpreter's lock; Ctrl-C ends the wait at once.

    Compiled code does not look at signals, and one that arrives within it breaks the hand-over of the result: so the
    kernel runs in a thread that may be left behind, and signals find the main thread waiting.
    """
    return started(kernel, *arguments)()


def started(work: Callable[..., Any], *arguments: Any) -> Callable[[], Any]:
    """Begin ``work(*arguments)`` in a thread; the answer waits for its result, or raises what it raised.

    Nobody waits for it at the end of the program.
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
