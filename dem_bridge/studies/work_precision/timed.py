"""Cost of repeated calls, in this process and in those that it starts: wall time and CPU time."""

from __future__ import annotations

import resource
import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar

Answer = TypeVar("Answer")

#: calls are repeated no more once all together took so long, s; each is made twice at least
ENOUGH = 1.0
LEAST = 2


@dataclass(frozen=True, kw_only=True)
class Timing:
    """Times of several calls, s: ``wall`` and ``cpu``, the latter with the children that ended within the call."""

    wall: tuple[float, ...]
    cpu: tuple[float, ...]

    def numbers(self) -> dict[str, Any]:
        """Return least and median times; the least is what the work takes, what is above it was done for others."""
        return {
            "wall_min": min(self.wall),
            "wall_median": statistics.median(self.wall),
            "cpu_min": min(self.cpu),
            "cpu_median": statistics.median(self.cpu),
            "repeats": len(self.wall),
        }


def timed(call: Callable[[], Answer], *, repeats: int) -> tuple[Answer, Timing]:
    """Return the last answer of ``call`` and what each call cost: up to ``repeats`` of them, fewer where they are long.

    One at a time, with nothing before: whoever wants it warm calls it once before. Raises what ``call`` raises.
    """
    wall: list[float] = []
    cpu: list[float] = []
    while len(wall) < min(LEAST, repeats) or (len(wall) < repeats and sum(wall) < ENOUGH):
        began, used = time.perf_counter(), _used()
        answer = call()
        wall.append(time.perf_counter() - began)
        cpu.append(_used() - used)
    return answer, Timing(wall=tuple(wall), cpu=tuple(cpu))


def _used() -> float:
    """Return the CPU time of this process, all threads, and of the children that it has waited for, s."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + children.ru_utime + children.ru_stime
