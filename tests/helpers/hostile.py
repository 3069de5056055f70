"""Functions that crash, never end or need too much memory, to be called in a child process."""

from __future__ import annotations

import os
import signal
from pathlib import Path


def crash(_path: Path) -> None:
    """Kill the process."""
    os.kill(os.getpid(), signal.SIGSEGV)


def endless(_path: Path) -> None:
    """Use the processor for ever."""
    while True:
        pass


def asleep(_path: Path) -> None:
    """Wait for a signal that does not come."""
    signal.pause()


def greedy(_path: Path) -> None:
    """Allocate a terabyte."""
    bytearray(2**40)
