"""A measured force for a scene file: CSV of time (s) and force (N), evenly spaced from 0."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dem_bridge.errors import SceneError

#: part of an interval by which times may be beside their places: they are written with few digits
_BESIDE = 1e-3
_FILE = "drive.file"
_ALLOWED = "rows of two numbers, time in s and force in N; a line of headings before them"


def with_force_of_file(table: Mapping[str, Any], folder: Path) -> Mapping[str, Any]:
    """The table of a scene file with ``chain.drive.file``, relative to ``folder``, replaced by what is in it.

    A table without stays as it is. Raises SceneError for a file that cannot be read, and for one beside a force.
    """
    chain = table.get("chain")
    drive = chain.get("drive") if isinstance(chain, dict) else None
    if not isinstance(chain, dict) or not isinstance(drive, dict) or not isinstance(drive.get("file"), str):
        return table
    for key in ("force", "interval"):
        if key in drive:
            raise SceneError(f"drive.{key}", problem="stands beside file", allowed="one of the two: the file has it")
    if drive.get("shape") != "table":
        raise SceneError(_FILE, problem=f"stands beside shape = {drive.get('shape')!r}", allowed="shape = 'table'")
    force, interval = read_force(folder / drive["file"])
    told = {key: value for key, value in drive.items() if key != "file"} | {"force": force, "interval": interval}
    return {**table, "chain": {**chain, "drive": told}}


def read_force(path: Path) -> tuple[list[float], float]:
    """Forces (N) of a CSV file, and the interval (s) between them; SceneError in one line for what is none."""
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            rows = [(line, row) for line, row in enumerate(csv.reader(file), start=1) if any(map(str.strip, row))]
    except (OSError, ValueError, csv.Error) as error:
        raise SceneError(_FILE, problem=f"= {str(path)!r} cannot be read: {error}", allowed=_ALLOWED) from error
    if rows and _numbers(rows[0][1]) is None:
        rows = rows[1:]
    found = []
    for line, row in rows:
        numbers = _numbers(row)
        if numbers is None:
            problem = f"= {str(path)!r} has {','.join(row)[:60]!r} in line {line}"
            raise SceneError(_FILE, problem=problem, allowed=_ALLOWED)
        found.append(numbers)
    if len(found) < 2:
        raise SceneError(_FILE, problem=f"= {str(path)!r} has {len(found)} forces", allowed="at least 2")
    time, force = np.array(found).T
    return force.tolist(), _interval(path, time, [line for line, _ in rows])


def _numbers(row: list[str]) -> tuple[float, float] | None:
    """None for what are not two finite numbers."""
    try:
        time, force = map(float, row)
    except ValueError:
        return None
    return (time, force) if np.isfinite(time) and np.isfinite(force) else None


def _interval(path: Path, time: NDArray[np.float64], lines: list[int]) -> float:
    interval = float(time[-1]) / (len(time) - 1)
    away = np.abs(time - interval * np.arange(len(time)))
    if interval > 0.0 and np.all(away <= _BESIDE * interval):
        return interval
    allowed = "times evenly spaced from 0; resample it"
    if abs(time[0]) > _BESIDE * abs(interval):
        problem = f"= {str(path)!r} begins at {time[0]:.9g} s in line {lines[0]}"
        raise SceneError(_FILE, problem=problem, allowed=allowed)
    steps = np.diff(time)
    usual = float(np.median(steps))
    row = int(np.argmax(np.abs(steps - usual)))
    problem = (
        f"= {str(path)!r} has {time[row + 1]:.9g} s in line {lines[row + 1]}, {steps[row]:.6g} s after the time before,"
        f" and others are {usual:.6g} s apart"
    )
    raise SceneError(_FILE, problem=problem, allowed=allowed)
