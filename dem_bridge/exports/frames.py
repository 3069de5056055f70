"""Frames as files have them: positions along the chain's line, velocities, forces, in whatever units and order.

Nothing here knows a scene; :mod:`.readers` makes trajectories of frames. Columns that a file of ours has beside those
of other programs (``displacement``, ``force_left``, ``force_right``) keep every digit of a trajectory.
"""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dem_bridge.errors import UsageError

Floats = NDArray[np.float64]

#: what our own files have beside the columns of others; m, N, N
OWN = ("displacement", "force_left", "force_right")


@dataclass(frozen=True, kw_only=True, eq=False)
class Frames:
    """What a file has, atoms in the order of their ids; None: it has none. Lengths etc. in the file's own units."""

    position: Floats
    """``(n_t, n_atom, 3)``."""
    columns: Mapping[str, Floats]
    """``velocity``, ``force`` ``(n_t, n_atom, 3)``; ``radius``, ``mass`` and those of :data:`OWN` ``(n_t, n_atom)``."""
    ids: NDArray[np.int64]
    time: Floats | None = None
    step: Floats | None = None
    """The file's own counter of time steps."""
    units: str | None = None


class _Stack:
    """Frames gathered one by one; refuses one that has other atoms or columns than the first."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.ids: NDArray[np.int64] | None = None
        self.rows: dict[str, list[Floats]] = {}
        self.count = 0

    def add(self, ids: NDArray[np.int64], columns: Mapping[str, Floats], label: str) -> None:
        order = np.argsort(ids, kind="stable")
        ids = ids[order]
        if len(np.unique(ids)) != len(ids):
            twice = int(ids[:-1][np.diff(ids) == 0][0])
            raise UsageError(f"{self.path}: {label} has atom {twice} twice; allowed: each id once a frame")
        if self.ids is None:
            self.ids, self.rows = ids, {name: [] for name in columns}
        if not np.array_equal(ids, self.ids):
            lost, new = (sorted(set(one.tolist()) - set(other.tolist())) for one, other in
                         ((self.ids, ids), (ids, self.ids)))  # fmt: skip
            what = f"atom {lost[0]} is lost" if lost else f"atom {new[0]} is new"
            raise UsageError(
                f"{self.path}: {label} has {len(ids)} atoms and the first frame {len(self.ids)}: {what}; allowed: the"
                " same atoms in every frame"
            )
        if set(columns) != set(self.rows):
            other = sorted(set(columns) ^ set(self.rows))
            raise UsageError(f"{self.path}: {label} and the first frame do not both have {', '.join(other)}")
        for name, values in columns.items():
            self.rows[name].append(values[order])
        self.count += 1

    def frames(self, **known: Any) -> Frames:
        if self.ids is None:
            raise UsageError(f"{self.path}: has no frame; allowed: a file with at least one")
        arrays = {name: np.array(values, dtype=np.float64) for name, values in self.rows.items()}
        return Frames(position=arrays.pop("position"), columns=arrays, ids=self.ids, **known)


_GROUPS = {"position": ("x", "y", "z"), "velocity": ("vx", "vy", "vz"), "force": ("fx", "fy", "fz")}


def _grouped(column: Mapping[str, Floats], count: int) -> dict[str, Floats]:
    """Three components of what has any; those that are not in the file are 0."""
    found = {
        group: np.stack([column.get(name, np.zeros(count)) for name in names], axis=1)
        for group, names in _GROUPS.items()
        if any(name in column for name in names)
    }
    own = {name: column.get(f"d_{name}", column.get(name)) for name in OWN}
    found |= {name: column[name] for name in ("radius", "mass") if name in column}
    if "diameter" in column and "radius" not in column:
        found["radius"] = 0.5 * column["diameter"]
    return found | {name: values for name, values in own.items() if values is not None}


def read_dump(path: Path) -> Frames:
    """A text ``dump custom`` of LAMMPS with ``id`` and ``x`` (or ``xu``); ``units yes`` and ``time yes`` are used."""
    stack, times, steps = _Stack(path), [], []
    units = None
    lines = _lines(path)
    label = "frame 0"
    item: dict[str, list[str]] = {}
    try:
        for line in lines:
            if not line.startswith("ITEM:"):
                raise UsageError(f"{path}: {label} goes on where an ITEM should begin: {line[:40]!r}")
            words = line.split()[1:]
            name = " ".join(words)
            if name == "UNITS":
                units = next(lines).strip()
            elif name in ("TIME", "TIMESTEP", "NUMBER OF ATOMS"):
                item[name] = [next(lines)]
            elif words[:2] == ["BOX", "BOUNDS"]:
                item["BOX"] = [next(lines) for _ in range(3)]
            elif words[:1] == ["ATOMS"]:
                step, count = float(item["TIMESTEP"][0]), int(item["NUMBER OF ATOMS"][0])
                label = f"frame {stack.count} (step {step:g})"
                rows = [next(lines).split() for _ in range(count)]
                ids, columns = _dump_columns(path, words[1:], rows, label)
                stack.add(ids, columns, label)
                steps.append(step)
                if "TIME" in item:
                    times.append(float(item["TIME"][0]))
                item = {}
            else:
                raise UsageError(f"{path}: {label} has the item {name!r}; allowed: those of a text dump custom")
    except (StopIteration, KeyError, ValueError) as error:
        if isinstance(error, UsageError):
            raise
        raise UsageError(f"{path}: {label}, or the one after it, is cut or has another form; write it again") from error
    time = np.array(times) if times and len(times) == len(steps) else None
    return stack.frames(time=time, step=np.array(steps), units=units)


def _dump_columns(
    path: Path, names: list[str], rows: list[list[str]], label: str
) -> tuple[NDArray[np.int64], dict[str, Floats]]:
    if "id" not in names:
        raise UsageError(f"{path}: {label} has no column id: who is who is not known; dump id x vx")
    if any(len(row) != len(names) for row in rows):
        raise ValueError(label)
    # of the unwrapped coordinates, if that is what there is
    names = [re.sub(r"^([xyz])u$", r"\1", name) for name in names]
    if "x" not in names:
        raise UsageError(f"{path}: {label} has no positions in units of length; allowed: x or xu, not scaled (xs)")
    wanted = {"diameter", "radius", "mass", *OWN, *(f"d_{name}" for name in OWN), *sum(_GROUPS.values(), ())}
    column = {name: np.array([float(row[k]) for row in rows]) for k, name in enumerate(names) if name in wanted}
    ids = np.array([int(row[names.index("id")]) for row in rows], dtype=np.int64)
    return ids, _grouped(column, len(rows))


def _lines(path: Path) -> Iterator[str]:
    try:
        with path.open(encoding="utf-8") as file:
            yield from (line for line in file if line.strip())
    except UnicodeDecodeError as error:
        raise UsageError(
            f"{path}: is no text; a binary dump is made one by LAMMPS' binary2txt, or dump to another ending than .bin"
        ) from error


def read_ase(path: Path, kind: str) -> Frames:
    """What ASE reads: extended XYZ ("extxyz") or its own trajectories ("traj").

    Velocities are the array ``velo`` or ``velocities``, else momenta over masses; times ``Time`` or ``time`` of each
    frame's info; units ``units``.
    """
    from ase.io import iread

    stack, times = _Stack(path), []
    units: str | None = None
    label = "frame 0"
    try:
        for nth, atoms in enumerate(iread(path, index=":", format=kind)):
            label = f"frame {nth}"
            info = atoms.info
            units = info.get("units", units)
            time = next((float(info[name]) for name in ("Time", "time") if name in info), None)
            if time is not None:
                times.append(time)
            ids = np.asarray(atoms.arrays.get("id", np.arange(len(atoms))), dtype=np.int64)
            stack.add(ids, dict(_ase_columns(atoms)), label)
    except UsageError:
        raise
    except Exception as error:  # ASE raises whatever its readers meet
        raise UsageError(f"{path}: {label}, or the one after it, is none that ASE reads ({error})") from error
    if times and len(times) != stack.count:
        raise UsageError(f"{path}: {len(times)} of {stack.count} frames have a time; allowed: all or none")
    return stack.frames(
        time=np.array(times) if times else None,
        step=np.arange(float(stack.count)),
        units=units,
    )


def _ase_columns(atoms: Any) -> Iterator[tuple[str, Floats]]:
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
    for name in ("radius", "mass", *OWN):
        if name in atoms.arrays:
            yield name, atoms.arrays[name]


#: SI value of the units that a heading may have
_UNITS = {
    "s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9, "m": 1.0, "mm": 1e-3, "um": 1e-6, "µm": 1e-6, "nm": 1e-9,
    "m/s": 1.0, "mm/s": 1e-3, "m_per_s": 1.0, "mm_per_s": 1e-3, "N": 1.0, "kN": 1e3, "mN": 1e-3,
}  # fmt: skip
#: names in headings -> ours, with the unit that it is one of
_NAMES = {
    "time": ("time", "s"), "t": ("time", "s"), "x": ("x", "m"), "position": ("x", "m"),
    "displacement": ("displacement", "m"), "u": ("displacement", "m"), "velocity": ("velocity", "m/s"),
    "v": ("velocity", "m/s"), "vx": ("velocity", "m/s"), "force_left": ("force_left", "N"),
    "force_right": ("force_right", "N"), "contact_force": ("contact_force", "N"),
}  # fmt: skip
_OF = {
    "s": {"s", "ms", "us", "µs", "ns"}, "m": {"m", "mm", "um", "µm", "nm"},
    "m/s": {"m/s", "mm/s", "m_per_s", "mm_per_s"}, "N": {"N", "kN", "mN"},
}  # fmt: skip
_HEADING = re.compile(
    rf"(?P<name>{'|'.join(sorted(_NAMES, key=len, reverse=True))})(?:[_ ]?(?P<nth>\d+))?"
    r"(?:_(?P<plain>[A-Za-zµ_]+)|\s*[(\[](?P<unit>[^)\]]+)[)\]])"
)


@dataclass(frozen=True, kw_only=True, eq=False)
class Sheet:
    """A CSV in SI: its times, and ``(n_t, n)`` for each of x, displacement, velocity, force_left, contact_force, ..."""

    time: Floats
    columns: Mapping[str, Floats]


def read_csv(path: Path) -> Sheet:
    """Long (a row per time and body: ``time_s,body,displacement_m,velocity_m_per_s``) or wide (a row per time:
    ``time_s,displacement_0_m,...,velocity_0_m_per_s,...``) with a unit in every heading, ``velocity_m_per_s`` or
    ``velocity (mm/s)``."""
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            rows = [row for row in csv.reader(file) if row and not row[0].startswith("#")]
        # Python's own float: every digit counts
        table = np.array([[float(cell) if cell.strip() else math.nan for cell in row] for row in rows[1:]])
    except (ValueError, csv.Error) as error:
        raise UsageError(f"{path}: no CSV of numbers with headings ({error})") from error
    if table.ndim != 2 or table.shape[1] != len(rows[0]):
        raise UsageError(f"{path}: no CSV with headings and rows of as many numbers")
    found: dict[tuple[str, int | None], Floats] = {}
    body = None
    for heading, values in zip(rows[0], table.T, strict=True):
        if heading.strip() == "body":
            body = values
            continue
        name, nth, scale = _heading(path, heading)
        found[name, nth] = values if scale == 1.0 else values * scale
    time = found.pop(("time", None), None)
    if time is None or len(time) == 0:
        raise UsageError(f"{path}: has no times; allowed: a column time_s, and rows")
    if body is not None:
        return _long(path, time, body, {name: values for (name, nth), values in found.items() if nth is None})
    columns: dict[str, Floats] = {}
    for name in {name for name, _ in found}:
        places = sorted(nth for one, nth in found if one == name and nth is not None)
        if places != list(range(len(places))) or not places:
            raise UsageError(
                f"{path}: columns of {name} have the numbers {places}; allowed: 0, 1, 2, ... or a column body"
            )
        columns[name] = np.stack([found[name, nth] for nth in places], axis=1)
    return Sheet(time=time, columns=columns)


def _heading(path: Path, heading: str) -> tuple[str, int | None, float]:
    found = _HEADING.fullmatch(heading.strip())
    known = f"{', '.join(_NAMES)} with a unit, such as velocity_m_per_s, velocity_0_m_per_s or velocity (mm/s)"
    if found is None or found["name"] not in _NAMES:
        raise UsageError(f"{path}: column {heading!r}; allowed: body, {known}")
    unit = found["plain"] or found["unit"].strip()
    name, of = _NAMES[found["name"]]
    if unit not in _OF[of]:
        raise UsageError(f"{path}: column {heading!r} is in {unit!r}; allowed: {', '.join(sorted(_OF[of]))}")
    return name, None if found["nth"] is None else int(found["nth"]), _UNITS[unit]


def _long(path: Path, time: Floats, body: Floats, columns: dict[str, Floats]) -> Sheet:
    starts = np.flatnonzero(np.diff(time, prepend=-math.inf) != 0.0)
    stack, times = _Stack(path), []
    for begin, end in zip(starts, [*starts[1:], len(time)], strict=True):
        part = slice(int(begin), int(end))
        rows = {"position" if name == "x" else name: values[part] for name, values in columns.items()}
        stack.add(body[part].astype(np.int64), rows, f"time {time[begin]:g} s")
        times.append(time[begin])
    arrays = {"x" if name == "position" else name: np.array(rows) for name, rows in stack.rows.items()}
    return Sheet(time=np.array(times), columns=arrays)


def short_of_digits(values: Iterable[float]) -> float | None:
    """What numbers that were written with few digits may be off by; None where they have all digits.

    Found from the numbers alone: the fewest significant digits that give every one of them, at the size of the largest.

    >>> [short_of_digits(one) for one in ([0.018, 0.03600012], [0.1 / 3.0, 2.0 / 3.0], [1.25e-13, 3.25e4])]
    [5e-09, None, 50.0]
    """
    known = [value for value in values if math.isfinite(value) and value != 0.0]
    if not known:
        return None
    largest = math.floor(math.log10(max(map(abs, known))))
    for digits in range(1, 16):
        if all(float(f"{value:.{digits - 1}e}") == value for value in known):
            return float(f"5e{largest - digits}")
    return None
