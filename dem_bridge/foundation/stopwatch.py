"""Wall time and CPU time of a piece of work, apart from what other threads do meanwhile."""

from __future__ import annotations

import threading
import time

_kernels = threading.local()


def cpu_time() -> float:
    """Return the CPU time of this thread and of the kernels that it has run in threads of their own, s."""
    return time.thread_time() + getattr(_kernels, "seconds", 0.0)


def credit(seconds: float) -> None:
    """Count CPU time that a kernel took in another thread, s, as that of this thread."""
    _kernels.seconds = getattr(_kernels, "seconds", 0.0) + seconds


class Stopwatch:
    """Wall time and CPU time since the stopwatch was made, for the thread that made it.

    >>> watch = Stopwatch()
    >>> sum(range(100_000)) > 0, 0.0 < watch.cpu < 10.0 * watch.wall
    (True, True)
    """

    def __init__(self) -> None:
        self._wall, self._cpu = time.perf_counter(), cpu_time()

    @property
    def wall(self) -> float:
        """Wall time, s."""
        return time.perf_counter() - self._wall

    @property
    def cpu(self) -> float:
        """CPU time of this thread and of its kernels, s."""
        return cpu_time() - self._cpu
