"""Wait for processes and files by events, so that no test depends on how busy the machine is.

The limits here are no criteria: a wait ends at once when the event comes, and the limit only keeps a test that is about
to fail from waiting for ever.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterable
from pathlib import Path

#: s, far above what any of these events takes on a busy machine
PATIENCE = 300.0


def happens(event: Callable[[], bool], within: float = PATIENCE) -> bool:
    """Return whether ``event()`` becomes true, as soon as it does."""
    end = time.monotonic() + within
    while not event():
        if time.monotonic() >= end:
            return False
        time.sleep(0.02)
    return True


def pause(seconds: float) -> None:
    """Wait so long, so that a process is met at a random moment."""
    time.sleep(seconds)


def touched(path: Path, age: float) -> None:
    """Give a file or a link the date of ``age`` s ago."""
    date = time.time() - age
    os.utime(path, (date, date), follow_symlinks=False)


def running(pids: Iterable[int]) -> list[int]:
    """Return those of ``pids`` that have not ended."""
    return [pid for pid in pids if _runs(pid)]


def all_end(pids: Iterable[int], within: float = PATIENCE) -> bool:
    """Return whether all processes end: one that was killed takes a moment."""
    waited_for = list(pids)
    return happens(lambda: not running(waited_for), within)


def children_of(pid: int) -> list[int]:
    """Return the processes that the main thread of a process has started."""
    return [int(child) for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


def _runs(pid: int) -> bool:
    """Return whether a process runs; one that has ended and waits for its parent to ask for its exit code does not."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except (FileNotFoundError, ProcessLookupError):
        return False


def stays_asleep(thread: int) -> bool:
    """Return whether a thread of this process sleeps five times in a row, as one that waits does."""
    path = Path(f"/proc/self/task/{thread}/stat")
    for _ in range(5):
        time.sleep(0.01)
        if path.read_text().rpartition(")")[2].split()[0] != "S":
            return False
    return True


class EventClock:
    """Take the place of the module ``time`` in ``lmp.child``: any time limit is over when ``event()`` is true.

    The clock stands still until then, so a run is stopped after what the test waits for and not after some seconds,
    within which a busy machine may not have come that far.
    """

    sleep = staticmethod(time.sleep)

    def __init__(self, event: Callable[[], bool]) -> None:
        self._event = event

    def perf_counter(self) -> float:
        return 1e9 if self._event() else 0.0
