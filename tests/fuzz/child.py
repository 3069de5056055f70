"""The child process of the fuzzing: ``python -m tests.fuzz.child JOBS``, two lines for each changed file.

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
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import dem_bridge as db
from dem_bridge.errors import MOST_CHARACTERS, BlockedScript, DemBridgeError
from tests.fuzz.mutate import changed
from tests.fuzz.targets import TARGETS, Target

#: memory of the process, bytes, and its growth by one file that counts as too much
MEMORY, GROWTH = 4 * 2**30, 2**29
_ALLOWED = (sys.prefix, sys.base_prefix, str(Path(db.__file__).parents[1]), "/proc/", "/sys/", "/usr/", "/dev/null")


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


def outcomes(name: str, first: int, count: int, watch: Watch) -> Iterator[tuple[str, int, str, str]]:
    """Yield target, number, outcome and description of each changed file."""
    target, folder = TARGETS[name], Path(watch.folder) / name.replace(" ", "-")
    folder.mkdir()
    sources = target.sources()
    target.prepare(folder)
    path = folder / target.name
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for number in range(first, first + count):
        path.write_bytes(target.finish(changed(f"{name} {number}", sources, structure=target.structure)))
        yield name, number, "begun", ""
        watch.outside.clear()
        watch.active = True
        word, text = outcome(target, path)
        watch.active = False
        now = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        if 1024 * (now - peak) > GROWTH:
            word, text = "over memory", f"{(now - peak) >> 10} MiB"
        if watch.outside:
            word, text = "outside", watch.outside[0]
        peak = now
        yield name, number, word, text


def main() -> None:
    """Print the outcomes of all jobs."""
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    warnings.simplefilter("error")
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        watch = Watch(Path(folder))
        for name, first, count in json.loads(sys.argv[1]):
            for line in outcomes(name, first, count, watch):
                print(json.dumps(line), flush=True)
    print(json.dumps(("", 0, "end", "")), flush=True)


if __name__ == "__main__":
    main()
