"""Fuzzing of readers in a child process, which is started again after it died or did not answer."""

from __future__ import annotations

import json
import os
import select
import subprocess
import sys
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

from tests.fuzz.strategies import DRAWN
from tests.fuzz.targets import TARGETS

#: time without an answer that counts as a hang, and time for imports and the first run, s; long, for a busy machine
SILENCE, START = 60.0, 180.0
#: all readers, and those with files that hypothesis draws
NAMES = (*TARGETS, *DRAWN)
#: outcomes that are faults
FAULTS = ("traceback", "message", "hang", "died", "over memory", "outside")


@dataclass
class Figures:
    """Numbers of changed files of a target by outcome, and descriptions of the faults."""

    counts: dict[str, int] = field(default_factory=dict)
    faults: list[str] = field(default_factory=list)

    def add(self, number: int, outcome: str, text: str) -> None:
        """Count an outcome."""
        self.counts[outcome] = self.counts.get(outcome, 0) + 1
        if outcome in FAULTS:
            self.faults.append(f"{number} {outcome}: {text}")

    @property
    def inputs(self) -> int:
        """Number of changed files."""
        return sum(self.counts.values())


def fuzz(count: int, first: int = 0, names: Iterable[str] = NAMES) -> dict[str, Figures]:
    """Return the figures of ``count`` files for each reader, or a quarter as many of those that hypothesis draws.

    The same numbers give the same files.
    """
    figures = {name: Figures() for name in names}
    jobs = [(name, first, count if name not in DRAWN else -(-count // 4)) for name in figures]
    while jobs:
        name, number, ended = "", -1, "died"
        for line in _lines(jobs):
            if line is None:
                ended = "hang"
                break
            name, number, ended, text = line
            if ended in ("begun", "end"):
                ended = "died" if ended == "begun" else "end"
            else:
                figures[name].add(number, ended, text)
        if ended == "end":
            break
        if number < 0:
            raise RuntimeError(f"the child ended before it read a file: {jobs[0]}")
        if ended in ("died", "hang"):
            figures[name].add(number, ended, "")
        jobs = jobs[[job[0] for job in jobs].index(name) :]
        jobs[0] = (name, number + 1, sum(jobs[0][1:]) - number - 1)
        jobs = jobs if jobs[0][2] else jobs[1:]
    return figures


def _lines(jobs: list[tuple[str, int, int]]) -> Iterator[tuple[str, int, str, str] | None]:
    """Yield the lines of a child that does the jobs; None, and no further line, if it does not answer."""
    words = [sys.executable, "-m", "tests.fuzz.child", json.dumps(jobs)]
    environment = {**os.environ, "DEM_BRIDGE_STORE": "", "OPENBLAS_NUM_THREADS": "1"}
    child = subprocess.Popen(words, stdout=subprocess.PIPE, env=environment)
    try:
        assert child.stdout is not None
        rest = b""
        end = time.monotonic() + START
        while True:
            if not select.select([child.stdout], [], [], max(0.0, end - time.monotonic()))[0]:
                yield None
                return
            part = os.read(child.stdout.fileno(), 1 << 16)
            if not part:
                return
            *lines, rest = (rest + part).split(b"\n")
            yield from map(json.loads, lines)
            end = time.monotonic() + SILENCE
    finally:
        child.kill()
        child.wait()
        if child.stdout is not None:
            child.stdout.close()
