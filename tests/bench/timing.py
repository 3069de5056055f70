"""Measure how long work takes, for the benchmarks. No test asserts on these numbers: they are of one machine."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from typing import Any


def wall_seconds(work: Callable[[], Any], rounds: int) -> list[float]:
    """Return the wall time of each round, s; where there is more than one, after a round that warms up."""
    if rounds > 1:
        work()
    seconds = []
    for _ in range(rounds):
        began = time.perf_counter()
        work()
        seconds.append(time.perf_counter() - began)
    return seconds


def median_seconds(work: Callable[[], Any], rounds: int) -> float:
    """Return the median wall time, s; where there is more than one round, after one that warms up."""
    return statistics.median(wall_seconds(work, rounds))


def spread(seconds: list[float]) -> float:
    """Return the interquartile range, s; 0 for a single round."""
    if len(seconds) < 2:
        return 0.0
    low, _, high = statistics.quantiles(seconds, n=4, method="inclusive")
    return high - low
