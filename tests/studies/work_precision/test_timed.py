"""Timings: how often a call is made, and whose time is counted."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator

import pytest

from dem_bridge.studies.work_precision.runs import ENOUGH, Timing, timed


@pytest.mark.parametrize(
    ("seconds", "repeats", "made"),
    [(0.0, 3, 3), (0.0, 1, 1), (10.0 * ENOUGH, 3, 2), (10.0 * ENOUGH, 1, 1), (0.3 * ENOUGH, 9, 4)],
)
def test_long_calls_are_made_twice_and_short_ones_as_often_as_asked(
    monkeypatch: pytest.MonkeyPatch, seconds: float, repeats: int, made: int
) -> None:
    def clock() -> Iterator[float]:
        while True:
            yield 0.0  # at the start of a call
            yield seconds  # and at its end

    ticks = clock()
    monkeypatch.setattr("dem_bridge.studies.work_precision.runs.time.perf_counter", lambda: next(ticks))
    calls: list[int] = []
    answer, timing = timed(lambda: calls.append(1) or len(calls), repeats=repeats)  # type: ignore[func-returns-value]
    assert answer == made == len(timing.wall) == len(timing.cpu)
    assert timing.wall == (seconds,) * made


def test_a_child_that_ended_counts_with_all_that_it_used() -> None:
    work = "import time; sum(range(300000)); print(time.process_time())"

    def call() -> float:
        done = subprocess.run([sys.executable, "-ISc", work], check=True, capture_output=True, text=True)
        return float(done.stdout)

    own, timing = timed(call, repeats=1)
    # what the child itself had counted before its end; the kernel may round either to its tick, 10 ms at most
    assert timing.cpu[0] >= own - 0.01
    assert own > 0.0


def test_least_and_median() -> None:
    timing = Timing(wall=(3.0, 1.0, 2.0), cpu=(0.5, 0.2, 0.9))
    expected = {"wall_min": 1.0, "wall_median": 2.0, "cpu_min": 0.2, "cpu_median": 0.5, "repeats": 3}
    assert timing.numbers() == expected


def test_what_a_call_raises_is_not_hidden() -> None:
    with pytest.raises(ZeroDivisionError):
        timed(lambda: 1 / 0, repeats=3)
