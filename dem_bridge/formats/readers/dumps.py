"""Read the frames of LAMMPS and LIGGGHTS dumps, of XYZ files and of ASE trajectories: what each atom has at a time.

Units are those of the file, and this module does not use a scene. Files written by dem_bridge have the extra columns
``displacement``, ``force_left`` and ``force_right``, which keep every digit of a trajectory. The comments of extended
XYZ files name columns and times; plain ones are read, too.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dem_bridge.errors import OF_DAMAGED_DATA, UsageError
from dem_bridge.formats.readers.rounding import check_texts, numbers, texts_of
from dem_bridge.trajectory.trajectory import Floats

#: extra columns of files written by dem_bridge; m, N, N
EXTRA_COLUMNS = ("displacement", "force_left", "force_right")


@dataclass(frozen=True, kw_only=True, eq=False)
class Frames:
    """Hold the contents of a file in the file's own units, with atoms in the order of their ids."""

    columns: Mapping[str, Floats]
    """``position``, ``velocity`` and ``force``, ``(n_t, n_atom, 3)``; ``radius``, ``mass`` and :data:`EXTRA_COLUMNS`,
    ``(n_t, n_atom)``; each only if the file has it."""
    ids: NDArray[np.int64]
    """Ids of the atoms, ``(n_atom,)``, ascending."""
    rounding: Mapping[str, Floats]
    """Largest rounding error of each value of the columns, and of each ``time``."""
    time: Floats | None = None
    """Times of the frames, ``(n_t,)``; None if the file has no times."""
    step: Floats | None = None
    """Step numbers of the frames, ``(n_t,)``; None if the file has none."""
    units: str | None = None
    """Unit style named in the file; None if the file names none."""
    dt: float | None = None
    """Time step that the file states, in its units; None if it states none."""
    numbered: bool = True
    """False if the file has no ids; the atoms are then in the order of the file or of their positions."""
    notes: tuple[str, ...] = field(default=())

    @property
    def position(self) -> Floats:
        """Positions, ``(n_t, n_atom, 3)``; raises UsageError if the file has none."""
        if "position" not in self.columns:
            raise UsageError("the file has no column x; allowed: x or xu, not the scaled xs; add it to the dump")
        return self.columns["position"]


class FrameCollector:
    """Collect frames; raise UsageError for a frame with other atoms or columns than the first."""

    def __init__(self) -> None:
        self.ids: NDArray[np.int64] | None = None
        self.rows: dict[str, list[NDArray[Any]]] = {}
        self.count = 0

    def add(self, ids: NDArray[np.int64], columns: Mapping[str, NDArray[Any]], label: str) -> None:
        """Add a frame of numbers or texts of numbers; ``label`` names it in messages."""
        if not len(ids):
            raise UsageError(f"{label} has no atoms; allowed: an atom for each body")
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

    def frames(self, *, time: Iterable[Any] = (), step: Iterable[float] = (), **fields: Any) -> Frames:
        """Return all frames, with times (numbers or texts) and steps, if there is one for each frame."""
        if self.ids is None:
            raise UsageError("the file has no frames; allowed: a file with at least one frame")
        for values in self.rows.values():
            check_texts(
                values[0].size * len(values), max(row.itemsize if row.dtype.kind == "S" else 0 for row in values)
            )
        read = {name: numbers(np.array(values)) for name, values in self.rows.items()}
        columns, rounding = ({name: part[k] for name, part in read.items()} for k in (0, 1))
        times, steps = list(time), list(step)
        if times and len(times) != self.count:
            raise UsageError(f"{len(times)} of {self.count} frames have a time; allowed: all frames or none")
        if times:
            fields["time"], rounding["time"] = numbers(np.array(times))
        if len(steps) == self.count:
            fields["step"] = np.array(steps, dtype=np.float64)
        return Frames(columns=columns, ids=self.ids, rounding=rounding, **fields)


def whole_numbers(words: Iterable[str | bytes]) -> NDArray[np.int64]:
    """Return ids as numbers; raise UsageError for an id that has more than 64 bits."""
    try:
        return np.array([int(word) for word in words], dtype=np.int64)
    except OverflowError as error:
        raise UsageError("the file has an id of more than 64 bits; allowed: whole numbers from 1") from error


GROUPS = {"position": ("x", "y", "z"), "velocity": ("vx", "vy", "vz"), "force": ("fx", "fy", "fz")}


def grouped(column: Mapping[str, NDArray[Any]], count: int) -> dict[str, NDArray[Any]]:
    """Return vectors of three components, with 0 for a component that the file does not have, and other columns."""
    zero = np.zeros(count) if all(values.dtype.kind != "S" for values in column.values()) else np.full(count, b"0")
    groups = {
        group: np.stack([column.get(name, zero) for name in names], axis=1)
        for group, names in GROUPS.items()
        if any(name in column for name in names)
    }
    extra = {name: column.get(f"d_{name}", column.get(name)) for name in EXTRA_COLUMNS}
    groups |= {name: column[name] for name in ("radius", "diameter", "mass") if name in column}
    return groups | {name: values for name, values in extra.items() if values is not None}


#: items of a dump before its atoms, with the number of their lines
_ITEMS = {"UNITS": 1, "TIME": 1, "TIMESTEP": 1, "NUMBER OF ATOMS": 1, "BOX BOUNDS": 3, "LABEL": 1}


def read_dump(texts: Iterable[str], renamed: Mapping[str, str] | None = None) -> Frames:
    """Read LAMMPS or LIGGGHTS text dumps (``dump custom``), one or several after each other.

    Units and times are read if the dump has them (``dump_modify units yes time yes``). ``renamed`` maps names of
    columns to names such as ``vx``.
    """
    collector, times, steps = FrameCollector(), list[str](), list[float]()
    label = "frame 0"
    units = None
    for text in texts:
        lines = iter([line for line in text.splitlines() if line.strip()])
        items: dict[str, list[str]] = {}
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
                names = [(renamed or {}).get(column, column) for column in name.split()[1:]]
                if not steps or step != steps[-1]:  # a run that continues repeats its first frame
                    collector.add(*_dump_columns(names, rows, label), label)
                    steps.append(step)
                    times += [line.strip() for line in items.get("TIME", ())]
                units = items["UNITS"][0].strip() if "UNITS" in items else units
                items = {}
        except UsageError:
            raise
        except (StopIteration, KeyError, ValueError) as error:
            raise UsageError(
                f"{label} or the next frame is incomplete or not in the format of a dump; write the file again"
            ) from error
    time = texts_of(times) if len(times) == len(steps) else ()
    return collector.frames(time=time, step=steps, units=units)


def _dump_columns(
    names: list[str], rows: list[list[str]], label: str
) -> tuple[NDArray[np.int64], dict[str, NDArray[Any]]]:
    """Return the ids and the columns of one frame of a dump."""
    if "id" not in names:
        raise UsageError(f"{label} has no column id, so the order of the bodies is unknown; dump at least id, x and vx")
    if any(len(row) != len(names) for row in rows):
        raise ValueError(label)
    # unwrapped coordinates xu count as x
    names = [re.sub(r"^([xyz])u$", r"\1", name) for name in names]
    extra = (*EXTRA_COLUMNS, *(f"d_{name}" for name in EXTRA_COLUMNS))
    needed = {"diameter", "radius", "mass", *extra, *sum(GROUPS.values(), ())}
    column = {name: texts_of([row[k] for row in rows]) for k, name in enumerate(names) if name in needed}
    ids = whole_numbers([row[names.index("id")] for row in rows])
    return ids, grouped(column, len(rows))


def read_ase(path: Path) -> Frames:
    """Read an ASE trajectory by ASE.

    Velocities are momenta divided by masses. Times are ``Time`` or ``time`` in the info of each frame, and the unit
    style is ``units`` there.
    """
    from ase.io import iread

    collector, times, label = FrameCollector(), list[float](), "frame 0"
    units: str | None = None
    frames = iread(path, index=":", format="traj")
    while True:
        label = f"frame {collector.count}"
        try:
            atoms = next(frames)
            info = atoms.info
            columns = {name: np.asarray(values) for name, values in _ase_columns(atoms)}
            times += [float(info[name]) for name in ("Time", "time") if name in info][:1]
        except StopIteration:
            break
        except (OSError, *OF_DAMAGED_DATA) as error:  # of ASE, and of conversions of what it returns
            reason = " ".join(str(error).split())[:120]
            raise UsageError(f"ASE cannot read {label} ({reason}); write the file again") from error
        units = info.get("units", units)
        collector.add(np.arange(len(columns["position"])), columns, label)
    return collector.frames(time=times, step=np.arange(float(collector.count)).tolist(), units=units)


def _ase_columns(atoms: Any) -> Iterator[tuple[str, Floats]]:
    """Yield the name and the values of each column of an ``ase.Atoms``; a trajectory keeps no arrays beyond these."""
    yield "position", atoms.positions
    if atoms.has("momenta"):
        yield "velocity", atoms.get_velocities()
    if atoms.calc is not None and "forces" in atoms.calc.results:
        yield "force", atoms.calc.results["forces"]
    if atoms.has("masses"):
        yield "mass", atoms.get_masses()


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
