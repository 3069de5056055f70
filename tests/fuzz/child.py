"""The child process of the fuzzing: ``python -m tests.fuzz.child JOBS``, two lines for each file.

``JOBS`` is a list in JSON of target, first number and count. A line is a list in JSON: target, number, outcome and
description; the outcome is "begun" and then "refused", "accepted", "traceback", "message", "over memory" or "outside",
in the last line "end". Warnings count as exceptions.
"""

from __future__ import annotations

import json
import os
import resource
import sys
import tempfile
import traceback
import warnings
from contextlib import suppress
from pathlib import Path
from typing import Any

import hypothesis
from hypothesis.configuration import set_hypothesis_home_dir

import dem_bridge as db
from dem_bridge.api import scenes
from dem_bridge.errors import MOST_CHARACTERS, BlockedScript, DemBridgeError
from dem_bridge.formats.readers import read
from dem_bridge.foundation import isolated
from dem_bridge.lmp.reader import script
from dem_bridge.verification.regression import baseline
from tests.fuzz.mutate import changed
from tests.fuzz.planted import FAULTY
from tests.fuzz.strategies import DRAWN
from tests.fuzz.targets import TARGETS, Target

#: memory of the process, bytes, and its growth by one file that counts as too much
MEMORY, GROWTH = 4 * 2**30, 2**29
_ALLOWED = (sys.prefix, sys.base_prefix, str(Path(db.__file__).parents[1]), "/proc/", "/sys/", "/usr/", "/dev/null")


def open_guards() -> None:
    """Let through the exceptions that guards around whole readers turn into refusals, so that they count as faults.

    The bounds of the work for a deck and of the time for a netCDF file are lowered, because many changed decks have a
    loop that does not end, and in HDF5, too, some changed files cause one.
    """
    modules: tuple[Any, ...] = (baseline, scenes, read)
    for module in modules:
        assert module.OF_DAMAGED_DATA
        module.OF_DAMAGED_DATA = ()
    script.MOST_WORK //= 20
    isolated.CPU_SECONDS /= 10.0


class Watch:
    """Note the files that are opened outside of a folder."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.outside = str(folder.resolve()), list[str]()
        self.active = False
        sys.addaudithook(self._hear)

    def _hear(self, event: str, words: tuple[Any, ...]) -> None:
        if (
            self.active
            and event in ("open", "os.remove", "os.rename", "os.mkdir")
            and isinstance(words[0], str | bytes)
        ):
            path = os.path.realpath(os.fsdecode(words[0]))
            if not path.startswith((self.folder, *_ALLOWED)):
                self.outside.append(path)


def outcome(target: Target, path: Path) -> tuple[str, str]:
    """Return the outcome of reading a file."""
    refusals: tuple[type[Exception], ...] = (DemBridgeError, *target.refusals)
    try:
        target.read(path)
    except refusals as error:
        text = str(error)
        lines = text.splitlines() if isinstance(error, BlockedScript) else [text]
        fine = all(line.isprintable() and 0 < len(line) <= MOST_CHARACTERS for line in lines)
        return ("refused", "") if fine else ("message", repr(text[:300]))
    except MemoryError:
        return "over memory", traceback.format_exc(limit=-3)
    except Exception as error:
        return "traceback", f"{type(error).__name__}: {error} {traceback.format_exc(limit=-4)[-900:]}"
    return "accepted", ""


class Reading:
    """Read files with a target in a folder, and note their outcomes."""

    def __init__(self, name: str, watch: Watch) -> None:
        drawn = DRAWN.get(name)
        self.strategy = drawn[1] if drawn else None
        self.target = {**TARGETS, **FAULTY}[drawn[0] if drawn else name]
        self.name, self.watch = name, watch
        folder = Path(watch.folder) / name.replace(" ", "-")
        folder.mkdir(exist_ok=True)
        self.sources = self.target.sources()
        self.target.prepare(folder)
        self.path = folder / self.target.name
        self.peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss

    def of(self, data: bytes) -> tuple[str, str]:
        """Return the outcome of a file with such content."""
        self.path.write_bytes(self.target.finish(data))
        self.watch.outside.clear()
        self.watch.active = True
        word, text = outcome(self.target, self.path)
        self.watch.active = False
        now = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        if 1024 * (now - self.peak) > GROWTH:
            word, text = "over memory", f"{(now - self.peak) >> 10} MiB"
        if self.watch.outside:
            word, text = "outside", self.watch.outside[0]
        self.peak = now
        return word, text

    def changed(self, first: int, count: int) -> None:
        """Read files that are changed at random."""
        for number in range(first, first + count):
            data = changed(f"{self.name} {number}", self.sources, structure=self.target.structure)
            say(self.name, number, "begun")
            say(self.name, number, *self.of(data))

    def drawn(self, first: int, count: int) -> None:
        """Read files that hypothesis draws; of those with a fault, the shrunk one is described."""
        assert self.strategy is not None
        number, last = first, ("", "")

        @hypothesis.seed(first)
        @hypothesis.settings(
            max_examples=count,
            deadline=None,
            database=None,
            phases=(hypothesis.Phase.generate, hypothesis.Phase.shrink),
            suppress_health_check=tuple(hypothesis.HealthCheck),
            report_multiple_bugs=False,
        )
        @hypothesis.given(self.strategy(self.sources))
        def read(data: bytes) -> None:
            nonlocal number, last
            if not last[0]:
                say(self.name, number, "begun")
            word, text = self.of(data)
            if word not in ("refused", "accepted"):
                last = word, f"{data[:2000]!r} {text}"
                raise AssertionError(word)
            if not last[0]:
                say(self.name, number, word, text)
                number += 1

        with suppress(AssertionError):
            read()
        if last[0]:
            say(self.name, number, *last)


def say(name: str, number: int, word: str, text: str = "") -> None:
    """Print a line for the parent."""
    print(json.dumps((name, number, word, text)), flush=True)


def main() -> None:
    """Print the outcomes of all jobs."""
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    warnings.simplefilter("error")
    open_guards()
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        set_hypothesis_home_dir(folder)
        watch = Watch(Path(folder))
        for name, first, count in json.loads(sys.argv[1]):
            reading = Reading(name, watch)
            (reading.drawn if name in DRAWN else reading.changed)(first, count)
    say("", 0, "end")


if __name__ == "__main__":
    main()
