"""Read XYZ files: extended ones, whose comments name columns and times, and plain ones."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dem_bridge.errors import UsageError
from dem_bridge.formats.readers.digits import texts_of
from dem_bridge.formats.readers.frames import EXTRA_COLUMNS, FrameCollector, Frames, whole_numbers

_PAIR = re.compile(r"(\w+)\s*=\s*(?:\"([^\"]*)\"|'([^']*)'|([^\s,]+))")
_STEP = re.compile(r"(?i)\b(?:time[ _]?step|step)\b\s*[:=]\s*(\d+)")
_DECIMAL = re.compile(r"(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
_ROW = re.compile(r"[-+0-9.eE\s,;]+")
#: names of columns in the property list, with the names here
_VECTORS = {
    "pos": "position", "positions": "position", "velo": "velocity", "vel": "velocity", "velocity": "velocity",
    "velocities": "velocity", "forces": "force", "force": "force", "momenta": "momenta",
}  # fmt: skip
_SCALARS = {"radius": "radius", "radii": "radius", "mass": "mass", "masses": "mass", "diameter": "diameter"}
_PLAIN = "species:S:1:pos:R:3"


def looks_like_xyz(text: str) -> bool:
    """Return True if a text begins as an XYZ file: a number of atoms, a comment, a line for each atom."""
    lines = text[:10000].splitlines()[:3]
    if len(lines) < 3 or not lines[0].strip().isdigit():
        return False
    return "Properties=" in lines[1] or (not _ROW.fullmatch(lines[1]) and len(lines[2].split()) >= 4)


def read_xyz(texts: Iterable[str]) -> Frames:
    """Read extended or plain XYZ files, one or several after each other."""
    collector, times, steps, fields = FrameCollector(), list[str](), list[float](), dict[str, Any]()
    label = "frame 0"
    for text in texts:
        lines = text.splitlines()
        at = 0
        while at < len(lines):
            if not lines[at].strip():
                at += 1
                continue
            label = f"frame {collector.count}"
            try:
                count = int(lines[at])
                pairs = {match[1]: match[2] or match[3] or match[4] or "" for match in _PAIR.finditer(lines[at + 1])}
                rows = [line.split() for line in lines[at + 2 : at + 2 + count]]
                ids, columns = _columns(rows, pairs.get("Properties"), count)
            except (ValueError, IndexError) as error:
                raise UsageError(f"{label} is incomplete or not in the format XYZ ({error}); write it again") from error
            collector.add(ids, columns, label)
            times += [pairs[name] for name in ("Time", "time", "t") if name in pairs][:1]
            steps += [float(match[1]) for match in [_STEP.search(lines[at + 1])] if match]
            fields |= {"units": pairs["units"]} if "units" in pairs else {}
            fields |= {"dt": float(pairs["dt"])} if _DECIMAL.fullmatch(pairs.get("dt", "")) else {}
            at += 2 + count
    if collector.count and not steps:
        steps = np.arange(float(collector.count)).tolist()
    time = texts_of(times) if times else ()
    return _with_velocities(collector.frames(time=time, step=steps, **fields))


def _columns(
    rows: list[list[str]], properties: str | None, count: int
) -> tuple[NDArray[np.int64], Mapping[str, NDArray[Any]]]:
    """Return the ids and the columns of one frame; without a property list, four columns or seven with velocities."""
    if len(rows) != count or not rows:
        raise ValueError(f"{len(rows)} of {count} atoms")
    if properties is None:
        properties = _PLAIN + ":velo:R:3" * (len(rows[0]) >= 7)
    words = properties.split(":")
    columns, at, ids = dict[str, NDArray[Any]](), 0, np.arange(count)
    for name, width in zip(words[0::3], map(int, words[2::3]), strict=True):
        part = texts_of([row[at : at + width] for row in rows])
        at += width
        if part.shape != (count, width):
            raise ValueError(f"{len(rows[0])} columns, the property list has more")
        if name in _VECTORS and width == 3:
            columns[_VECTORS[name]] = part
        elif (name in _SCALARS or name in EXTRA_COLUMNS) and width == 1:
            columns[_SCALARS.get(name, name)] = part[:, 0]
        elif name == "id":
            ids = whole_numbers(part[:, 0].tolist())
    return ids, columns


def _with_velocities(frames: Frames) -> Frames:
    """Return frames with momenta divided by masses as velocities, unless they have velocities."""
    columns, rounding = dict(frames.columns), dict(frames.rounding)
    momenta, error = columns.pop("momenta", None), rounding.pop("momenta", None)
    if momenta is None or error is None or "velocity" in columns or "mass" not in columns:
        return replace(frames, columns=columns, rounding=rounding)
    mass = columns["mass"][:, :, None]
    if not np.all(mass > 0.0):
        raise UsageError("the file has masses that are not above 0; allowed: positive masses, or velocities")
    columns["velocity"] = momenta / mass
    rounding["velocity"] = (error + np.abs(columns["velocity"]) * rounding["mass"][:, :, None]) / mass
    rounding["velocity"] += 0.5 * np.spacing(np.abs(columns["velocity"]))
    return replace(frames, columns=columns, rounding=rounding)
