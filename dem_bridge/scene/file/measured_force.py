"""Reading of a measured force for a scene file: a CSV file of time (s) and force (N), equally spaced from 0."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dem_bridge.errors import SceneError
from dem_bridge.foundation.files import named_file, text_of_file

#: largest deviation of a time from equal spacing, in intervals; times are written with few digits
_DEVIATION = 1e-3
_FILE = "drive.file"
_ALLOWED = "rows of two numbers, time in s and force in N, after an optional line of headings"


def with_force_of_file(
    table: Mapping[str, Any], folder: Path, files_below: str | Path | None = None
) -> Mapping[str, Any]:
    """Return the table of a scene file with ``chain.drive.file`` (relative to ``folder``) replaced by its contents.

    A table without this key is returned unchanged. The file must be below ``files_below``, as in :func:`.load_scene`.

    Raises
    ------
    SceneError
        If the file cannot be read, or if the force is given in the scene file as well.
    """
    chain = table.get("chain")
    drive = chain.get("drive") if isinstance(chain, dict) else None
    if not isinstance(chain, dict) or not isinstance(drive, dict) or not isinstance(drive.get("file"), str):
        return table
    for key in ("force", "interval"):
        if key in drive:
            allowed = "one of the two, since the file contains it"
            raise SceneError(f"drive.{key}", problem="cannot be combined with file", allowed=allowed)
    if drive.get("shape") != "table":
        raise SceneError(
            _FILE, problem=f"cannot be combined with shape = {drive.get('shape')!r}", allowed="shape = 'table'"
        )
    name = drive["file"]
    try:
        force, interval = read_force(named_file(folder, name, files_below))
    except OSError as error:
        problem = f"= {name!r} cannot be read: {error.strerror}"
        raise SceneError(_FILE, problem=problem, allowed="a file below the folder of the scene file") from None
    values = {key: value for key, value in drive.items() if key != "file"} | {"force": force, "interval": interval}
    return {**table, "chain": {**chain, "drive": values}}


def read_force(path: Path) -> tuple[list[float], float]:
    """Return the forces (N) of a CSV file, and the interval (s) between them.

    Raises
    ------
    SceneError
        If the file cannot be read or its times are not equally spaced.
    """
    try:
        lines = csv.reader(text_of_file(path).splitlines())
        rows = [(line, row) for line, row in enumerate(lines, start=1) if any(map(str.strip, row))]
    except (OSError, csv.Error) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise SceneError(_FILE, problem=f"= {str(path)!r} cannot be read: {reason}", allowed=_ALLOWED) from error
    if rows and _numbers(rows[0][1]) is None:
        rows = rows[1:]
    readings = []
    for line, row in rows:
        numbers = _numbers(row)
        if numbers is None:
            problem = f"= {str(path)!r} has a row that is not two finite numbers (line {line})"
            raise SceneError(_FILE, problem=problem, allowed=_ALLOWED)
        readings.append(numbers)
    if len(readings) < 2:
        raise SceneError(_FILE, problem=f"= {str(path)!r} has {len(readings)} forces", allowed="at least 2")
    time, force = np.array(readings).T
    return force.tolist(), _interval(path, time, [line for line, _ in rows])


def _numbers(row: list[str]) -> tuple[float, float] | None:
    """Return the two finite numbers of a row, or None."""
    try:
        time, force = map(float, row)
    except ValueError:
        return None
    return (time, force) if np.isfinite(time) and np.isfinite(force) else None


def _interval(path: Path, time: NDArray[np.float64], lines: list[int]) -> float:
    """Return the interval between the times, s, or raise SceneError if they are not equally spaced from 0."""
    interval = float(time[-1]) / (len(time) - 1)
    deviation = np.abs(time - interval * np.arange(len(time)))
    if interval > 0.0 and np.all(deviation <= _DEVIATION * interval):
        return interval
    allowed = "times equally spaced from 0; resample the file"
    if abs(time[0]) > _DEVIATION * abs(interval):
        problem = f"= {str(path)!r} begins at {time[0]:.9g} s in line {lines[0]}"
        raise SceneError(_FILE, problem=problem, allowed=allowed)
    steps = np.diff(time)
    usual = float(np.median(steps))
    row = int(np.argmax(np.abs(steps - usual)))
    problem = (
        f"= {str(path)!r} has {time[row + 1]:.9g} s in line {lines[row + 1]}, {steps[row]:.6g} s after the line before;"
        f" the usual interval is {usual:.6g} s"
    )
    raise SceneError(_FILE, problem=problem, allowed=allowed)
