"""Functions that are called in another process."""

from __future__ import annotations

import os
import sys
import threading


def about(*values: object) -> tuple[int, tuple[object, ...]]:
    """Return the process that this is called in, and the arguments."""
    return os.getpid(), values


def fail(words: str) -> None:
    raise ValueError(words)


def here_alone(owner: int) -> int:
    """Return the process that this is called in; an error in any but ``owner``."""
    if os.getpid() != owner:
        raise RuntimeError("not here")
    return os.getpid()


def talk() -> str:
    """Print something, and return a word."""
    print("what a library says", flush=True)
    return "word"


def sleep() -> None:
    threading.Event().wait(600.0)


def imported(name: str) -> bool:
    return name in sys.modules
