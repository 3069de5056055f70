"""Running compiled kernels so that a person can still interrupt them."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any


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
