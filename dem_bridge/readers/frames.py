"""Read the frames of dumps, extended XYZ, ASE trajectories and CSV: positions, velocities and forces.

Units and the order of atoms are those of the file. This module does not use a scene; :mod:`.readers` turns frames into
trajectories and adds the name of the file to messages of errors. Files written by dem_bridge have the extra columns
``displacement``, ``force_left`` and ``force_right``, which keep every digit of a trajectory.
"""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dem_bridge.errors import UsageError
from dem_bridge.readers.headings import UNITS, allowed_units
from dem_bridge.trajectory import Floats

#: extra columns of files written by dem_bridge; m, N, N
EXTRA_COLUMNS = ("displacement", "force_left", "force_right")


@dataclass(frozen=True, kw_only=True, eq=False)
class Frames:
    """Hold the contents of a file in the file's own units, with atoms in the order of their ids."""

    position: Floats
    """Positions, ``(n_t, n_atom, 3)``."""
    columns: Mapping[str, Floats]
    """``velocity`` and ``force``, ``(n_t, n_atom, 3)``; ``radius``, ``mass`` and :data:`EXTRA_COLUMNS`,
    ``(n_t, n_atom)``; each only if the file has it."""
    ids: NDArray[np.int64]
    """Ids of the atoms, ``(n_atom,)``, ascending."""
    time: Floats | None = None
    """Times of the frames, ``(n_t,)``; None if the file has no times."""
    step: Floats | None = None
    """Step numbers of the frames, ``(n_t,)``; None if the file has none."""
    units: str | None = None
    """Unit style named in the file; None if the file names none."""


class _FrameCollector:
    """Collect frames; raise UsageError for a frame with other atoms or columns than the first."""

    def __init__(self) -> None:
        self.ids: NDArray[np.int64] | None = None
        self.rows: dict[str, list[Floats]] = {}
        self.count = 0

    def add(self, ids: NDArray[np.int64], columns: Mapping[str, Floats], label: str) -> None:
        """Add a frame; ``label`` names it in messages."""
        order = np.argsort(ids, kind="stable")
        ids = ids[order]
        if len(np.unique(ids)) != len(ids):
            twice = int(ids[:-1][np.diff(ids) == 0][0])
            raise UsageError(f"{label} has atom {twice} twice; allowed: each id once per frame")
        if self.ids is None:
            self.ids, self.rows = ids, {name: [] for name in columns}
        if not np.array_equal(ids, self.ids):
            lost, new = np.setdiff1d(self.ids, ids), np.setdiff1d(ids, self.ids)
            change = f"atom {lost[0]} is missing" if lost.size else f"atom {new[0]} is new"
            raise UsageError(
                f"{label} has {len(ids)} atoms, the first frame has {len(self.ids)}: {change}; allowed:"
                " the same atoms in every frame"
            )
        if set(columns) != set(self.rows):
            different = sorted(set(columns) ^ set(self.rows))
            raise UsageError(
                f"only one of {label} and the first frame has {', '.join(different)}; allowed: the same"
                " columns in every frame"
            )
        for name, values in columns.items():
            self.rows[name].append(values[order])
        self.count += 1

    def frames(self, **fields: Any) -> Frames:
        """Return all frames, with ``time``, ``step`` and ``units`` as given by ``fields``."""
        if self.ids is None:
            raise UsageError("the file has no frames; allowed: a file with at least one frame")
        arrays = {name: np.array(values, dtype=np.float64) for name, values in self.rows.items()}
        return Frames(position=arrays.pop("position"), columns=arrays, ids=self.ids, **fields)


_GROUPS = {"position": ("x", "y", "z"), "velocity": ("vx", "vy", "vz"), "force": ("fx", "fy", "fz")}


def _grouped(column: Mapping[str, Floats], count: int) -> dict[str, Floats]:
    """Return vectors of three components, with 0 for a component that the file does not have, and other columns."""
    grouped = {
        group: np.stack([column.get(name, np.zeros(count)) for name in names], axis=1)
        for group, names in _GROUPS.items()
        if any(name in column for name in names)
    }
    extra = {name: column.get(f"d_{name}", column.get(name)) for name in EXTRA_COLUMNS}
    grouped |= {name: column[name] for name in ("radius", "mass") if name in column}
    if "diameter" in column and "radius" not in column:
        grouped["radius"] = 0.5 * column["diameter"]
    return grouped | {name: values for name, values in extra.items() if values is not None}


#: items of a dump before its atoms, with the number of their lines
_ITEMS = {"UNITS": 1, "TIME": 1, "TIMESTEP": 1, "NUMBER OF ATOMS": 1, "BOX BOUNDS": 3}


def read_dump(path: Path) -> Frames:
    """Read a LAMMPS text dump (``dump custom``) with the columns ``id`` and ``x`` or ``xu``.

    Units and times are read if the dump has them (``dump_modify units yes time yes``).
    """
    collector, times, steps = _FrameCollector(), [], []
    lines, label = _lines(path), "frame 0"
    items: dict[str, list[str]] = {}
    units = None
    try:
        for line in lines:
            if not line.startswith("ITEM:"):
                raise UsageError(f"{label} has the line {line[:40]!r} where a line 'ITEM: ...' is expected")
            name = " ".join(line.split()[1:])
            item = next((item for item in _ITEMS if name == item or name.startswith(f"{item} ")), None)
            if item is not None:
                items[item] = [next(lines) for _ in range(_ITEMS[item])]
                continue
            if not name.startswith("ATOMS"):
                raise UsageError(f"{label} has the unknown item {name!r}; allowed: the items of a dump custom")
            step, count = float(items["TIMESTEP"][0]), int(items["NUMBER OF ATOMS"][0])
            label = f"frame {collector.count} (step {step:g})"
            rows = [next(lines).split() for _ in range(count)]
            collector.add(*_dump_columns(name.split()[1:], rows, label), label)
            steps.append(step)
            times += [float(text) for text in items.get("TIME", ())]
            units = items["UNITS"][0].strip() if "UNITS" in items else units
            items = {}
    except UsageError:
        raise
    except (StopIteration, KeyError, ValueError) as error:
        raise UsageError(
            f"{label} or the next frame is incomplete or not in the format of a dump; write the file again"
        ) from error
    time = np.array(times) if times and len(times) == len(steps) else None
    return collector.frames(time=time, step=np.array(steps), units=units)


def _dump_columns(names: list[str], rows: list[list[str]], label: str) -> tuple[NDArray[np.int64], dict[str, Floats]]:
    """Return the ids and the columns of one frame of a dump."""
    if "id" not in names:
        raise UsageError(f"{label} has no column id, so the order of the bodies is unknown; dump at least id, x and vx")
    if any(len(row) != len(names) for row in rows):
        raise ValueError(label)
    # unwrapped coordinates xu count as x
    names = [re.sub(r"^([xyz])u$", r"\1", name) for name in names]
    if "x" not in names:
        raise UsageError(f"{label} has no column x; allowed: x or xu, not the scaled xs")
    extra = (*EXTRA_COLUMNS, *(f"d_{name}" for name in EXTRA_COLUMNS))
    needed = {"diameter", "radius", "mass", *extra, *sum(_GROUPS.values(), ())}
    column = {name: np.array([float(row[k]) for row in rows]) for k, name in enumerate(names) if name in needed}
    ids = np.array([int(row[names.index("id")]) for row in rows], dtype=np.int64)
    return ids, _grouped(column, len(rows))


def _lines(path: Path) -> Iterator[str]:
    """Yield the lines of a text file that are not blank."""
    try:
        with path.open(encoding="utf-8") as file:
            yield from (line for line in file if line.strip())
    except UnicodeDecodeError as error:
        raise UsageError(
            "the file is not text; convert a binary dump with LAMMPS' binary2txt, or dump to a file that does"
            " not end in .bin"
        ) from error


def read_ase(path: Path, kind: str) -> Frames:
    """Read extended XYZ ("extxyz") or an ASE trajectory ("traj") by ASE.

    Velocities are the array ``velo`` or ``velocities``, else momenta divided by masses. Times are ``Time`` or ``time``
    in the info of each frame, and the unit style is ``units`` there.
    """
    from ase.io import iread

    collector, times, label = _FrameCollector(), list[float](), "frame 0"
    units: str | None = None
    try:
        for nth, atoms in enumerate(iread(path, index=":", format=kind)):
            label = f"frame {nth}"
            units = atoms.info.get("units", units)
            times += [float(atoms.info[name]) for name in ("Time", "time") if name in atoms.info][:1]
            ids = np.asarray(atoms.arrays.get("id", np.arange(len(atoms))), dtype=np.int64)
            collector.add(ids, dict(_ase_columns(atoms)), label)
    except UsageError:
        raise
    except Exception as error:  # the readers of ASE raise exceptions of many types
        raise UsageError(f"ASE cannot read {label} or the next frame ({error})") from error
    if times and len(times) != collector.count:
        raise UsageError(f"{len(times)} of {collector.count} frames have a time; allowed: all frames or none")
    time = np.array(times) if times else None
    return collector.frames(time=time, step=np.arange(float(collector.count)), units=units)


def _ase_columns(atoms: Any) -> Iterator[tuple[str, Floats]]:
    """Yield the name and the values of each column of an ``ase.Atoms``."""
    yield "position", atoms.positions
    velocity = next((atoms.arrays[name] for name in ("velo", "velocities") if name in atoms.arrays), None)
    if velocity is None and atoms.has("momenta"):
        velocity = atoms.get_velocities()
    if velocity is not None:
        yield "velocity", velocity
    results = {} if atoms.calc is None else atoms.calc.results
    force = results.get("forces", atoms.arrays.get("forces", atoms.arrays.get("force")))
    if force is not None:
        yield "force", force
    if atoms.has("masses"):
        yield "mass", atoms.get_masses()
    for name in ("radius", "mass", *EXTRA_COLUMNS):
        if name in atoms.arrays:
            yield name, atoms.arrays[name]


#: units in CSV headings with their SI values, by the SI unit of the quantity
_UNITS = UNITS
#: names in CSV headings: the name of the column here and the SI unit of its quantity
_NAMES = {
    "time": ("time", "s"),
    "t": ("time", "s"),
    "x": ("x", "m"),
    "position": ("x", "m"),
    "displacement": ("displacement", "m"),
    "u": ("displacement", "m"),
    "velocity": ("velocity", "m/s"),
    "v": ("velocity", "m/s"),
    "vx": ("velocity", "m/s"),
    "force_left": ("force_left", "N"),
    "force_right": ("force_right", "N"),
    "contact_force": ("contact_force", "N"),
}
_HEADING = re.compile(
    rf"(?P<name>{'|'.join(sorted(_NAMES, key=len, reverse=True))})(?:[_ ]?(?P<nth>\d+))?"
    r"(?:_(?P<plain>[A-Za-zµ_]+)|\s*[(\[](?P<unit>[^)\]]+)[)\]])"
)


def read_csv(path: Path) -> tuple[Floats, dict[str, Floats]]:
    """Read a CSV file in the long or the wide layout, with a unit in every heading.

    The long layout has a row per time and body (``time_s,body,displacement_m,velocity_m_per_s``), the wide layout a
    row per time (``time_s,displacement_0_m,...,velocity_0_m_per_s,...``). A heading is ``velocity_m_per_s`` or
    ``velocity (mm/s)``.

    Returns
    -------
    time : ndarray
        Times, ``(n_t,)``, s.
    columns : dict
        ``x``, ``displacement``, ``velocity``, ``force_left``, ``contact_force``, ... in SI units, ``(n_t, n)`` each.
    """
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            rows = [row for row in csv.reader(file) if row and not row[0].startswith("#")]
        # float() rounds correctly; the readers of numpy and pandas may be off by an ulp
        table = np.array([[float(cell) if cell.strip() else math.nan for cell in row] for row in rows[1:]])
    except (ValueError, csv.Error) as error:
        raise UsageError(
            f"the file is not a CSV table ({error}); allowed: a row of headings, then rows of numbers"
        ) from error
    if table.ndim != 2 or table.shape[1] != len(rows[0]):
        raise UsageError("the file is not a CSV table; allowed: a row of headings, then rows with a number per heading")
    quantities: dict[tuple[str, int | None], Floats] = {}
    body = None
    for heading, values in zip(rows[0], table.T, strict=True):
        if heading.strip() == "body":
            body = values
            continue
        name, nth, scale = _heading(heading)
        quantities[name, nth] = values * scale
    time = quantities.pop(("time", None), None)
    if time is None or len(time) == 0:
        raise UsageError("the file has no times; add a column time_s and at least one row")
    if body is not None:
        return _long(time, body, {name: values for (name, nth), values in quantities.items() if nth is None})
    columns: dict[str, Floats] = {}
    for name in {name for name, _ in quantities}:
        indices = sorted(nth for column, nth in quantities if column == name and nth is not None)
        if indices != list(range(len(indices))) or not indices:
            raise UsageError(
                f"the columns of {name} have the indices {indices}; allowed: 0, 1, 2, ..., or a column body"
            )
        columns[name] = np.stack([quantities[name, nth] for nth in indices], axis=1)
    return time, columns


def _heading(heading: str) -> tuple[str, int | None, float]:
    """Return the column's name, the index in it (None without one) and the SI value of its unit."""
    match = _HEADING.fullmatch(heading.strip())
    if match is None:
        if (bare := re.sub(r"[_ ]?\d+$", "", heading.strip())) in _NAMES:
            si_unit = _NAMES[bare][1]
            raise UsageError(f"column {heading.strip()!r} has no unit; write '{heading.strip()} ({si_unit})'")
        raise UsageError(
            f"column {heading!r} is unknown; allowed: body, and {', '.join(_NAMES)} with a unit, such as"
            " velocity_m_per_s, velocity_0_m_per_s or velocity (mm/s)"
        )
    unit = match["plain"] or match["unit"].strip()
    name, si_unit = _NAMES[match["name"]]
    if unit not in _UNITS[si_unit]:
        allowed = allowed_units(si_unit)
        raise UsageError(f"column {heading!r} has the unknown unit {unit!r}; allowed: {allowed}")
    return name, None if match["nth"] is None else int(match["nth"]), _UNITS[si_unit][unit]


def _long(time: Floats, body: Floats, columns: dict[str, Floats]) -> tuple[Floats, dict[str, Floats]]:
    """Return the contents of a CSV file in the long layout."""
    starts = np.flatnonzero(np.diff(time, prepend=-math.inf) != 0.0)
    collector, times = _FrameCollector(), []
    for begin, end in zip(starts, [*starts[1:], len(time)], strict=True):
        part = slice(int(begin), int(end))
        rows = {name: values[part] for name, values in columns.items()}
        collector.add(body[part].astype(np.int64), rows, f"time {time[begin]:g} s")
        times.append(time[begin])
    return np.array(times), {name: np.array(rows) for name, rows in collector.rows.items()}
