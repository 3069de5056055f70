"""Measure how long work takes, for the benchmarks. No test asserts on these numbers: they are of one machine."""

from __future__ import annotations

import json
import os
import resource
import statistics
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

#: the variable that names the file to which :func:`record` adds lines; not set: nothing is kept
RECORD = "DEM_BRIDGE_BENCH_RECORD"
#: CPU time after which no further round of one piece of work begins, s
LIMIT = 3.0


def cpu_seconds() -> float:
    """Return the CPU time of this process and of its children that have ended, s."""
    usage = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(part.ru_utime + part.ru_stime for part in usage)


def record(name: str, seconds: list[float]) -> None:
    """Keep the CPU seconds of each round of one piece of work for the history of :mod:`tests.bench.history`."""
    if path := os.environ.get(RECORD):
        with Path(path).open("a", encoding="utf-8") as file:
            file.write(json.dumps({"name": name, "seconds": seconds}) + "\n")


def wall_seconds(work: Callable[[], Any], rounds: int, name: str = "") -> list[float]:
    """Return the wall time of each round, s; where there is more than one, after a round that warms up.

    No further round begins after :data:`LIMIT`, so that long work is measured less often than short work. With a
    ``name`` the CPU time of each round is recorded under it.
    """
    if rounds > 1:
        work()
    seconds: list[float] = []
    of_cpu: list[float] = []
    while not seconds or (len(seconds) < rounds and sum(of_cpu) < LIMIT):
        began, cpu = time.perf_counter(), cpu_seconds()
        work()
        seconds.append(time.perf_counter() - began)
        of_cpu.append(cpu_seconds() - cpu)
    if name:
        record(name, of_cpu)
    return seconds


def median_seconds(work: Callable[[], Any], rounds: int, name: str = "") -> float:
    """Return the median wall time, s; see :func:`wall_seconds`."""
    return statistics.median(wall_seconds(work, rounds, name))


def spread(seconds: list[float]) -> float:
    """Return the interquartile range, s; 0 for a single round."""
    if len(seconds) < 2:
        return 0.0
    low, _, high = statistics.quantiles(seconds, n=4, method="inclusive")
    return high - low
