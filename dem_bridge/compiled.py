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
    result: list[Any] = []
    failure: list[BaseException] = []

    def work() -> None:
        try:
            result.append(kernel(*arguments))
        except BaseException as error:  # carried to the caller's thread
            failure.append(error)

    thread = threading.Thread(target=work, daemon=True)
    thread.start()
    while thread.is_alive():
        thread.join(0.1)
    if failure:
        raise failure[0]
    return result[0]
