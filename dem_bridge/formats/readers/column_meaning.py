"""Find what each column or array of a file is, from what the user states and from the headings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dem_bridge.errors import UsageError
from dem_bridge.formats.readers.headings import DIMENSIONS, Heading, heading_of, scale_of
from dem_bridge.formats.readers.rounding import numbers
from dem_bridge.formats.readers.tables import Entry, Table
from dem_bridge.formats.units import STYLES
from dem_bridge.foundation.numbers import check_number
from dem_bridge.scene.scene import Scene

#: dimension of a unit style by SI unit
_STYLE_KEYS = {"s": "time", "m": "length", "m/s": "velocity", "N": "force", "kg": "mass"}


@dataclass(frozen=True)
class Choices:
    """Hold what the user states about a file; None where it is to be recognised."""

    dt: float | None = None
    columns: Mapping[str, str] | Sequence[str] | None = None
    units: Mapping[str, str] | str | None = None
    bodies: Sequence[int] | None = None
    axis: str | None = None

    def __post_init__(self) -> None:
        if self.dt is not None:
            check_number("dt", self.dt, "a number above 0 (s)", above=0.0)
        if self.axis is not None and self.axis not in ("x", "y", "z"):
            raise UsageError(f"axis = {self.axis!r}; allowed: x, y or z")
        if isinstance(self.units, str) and self.units not in STYLES:
            raise UsageError(f"units = {self.units!r} is unknown; allowed: {', '.join(STYLES)}")
        for quantity, unit in self.units.items() if isinstance(self.units, Mapping) else ():
            if quantity not in DIMENSIONS:
                raise UsageError(f"units of {quantity!r}; allowed: {', '.join(DIMENSIONS)}")
            scale_of(quantity, unit)

    def states(self, quantity: str) -> bool:
        """Return True if the user states the unit of a quantity by itself."""
        return isinstance(self.units, Mapping) and quantity in self.units

    def scale(self, quantity: str, unit: str | None) -> float:
        """Return the SI value of a quantity's unit; a unit that the user states replaces that of the file."""
        if isinstance(self.units, Mapping) and self.states(quantity):
            return scale_of(quantity, self.units[quantity])
        if isinstance(self.units, str) and unit is None and quantity in DIMENSIONS:
            return float(getattr(STYLES[self.units], _STYLE_KEYS[DIMENSIONS[quantity]]))
        return scale_of(quantity, unit)


def meanings_of(table: Table, scene: Scene, choices: Choices, notes: list[str]) -> list[tuple[Heading, Entry]]:
    """Return the entries of a table that are used, with their meaning, along one axis; ``notes`` get what was found."""
    assigned = _forces(_of_axis(_assigned(table, scene, choices, notes), choices, notes), scene, notes)
    _check_cells(table, assigned)
    return assigned


def _check_cells(table: Table, assigned: list[tuple[Heading, Entry]]) -> None:
    """Raise UsageError for an empty cell of a used column of a text, unless all of its cells are empty."""
    for heading, entry in assigned:
        if "force" in heading.quantity:  # which exports leave empty where it is unknown
            continue
        empty = entry.values == b"" if entry.values.dtype.kind == "S" else np.zeros(0, dtype=bool)
        if len(rows := np.flatnonzero(empty)) and not np.all(empty):
            row = int(rows[0])
            place = f"line {table.lines[row]}, " if row < len(table.lines) else ""
            number = next(k for k, other in enumerate(table.entries, start=1) if other is entry)
            others = f", as {len(rows) - 1} more in this column are" if len(rows) > 1 else ""
            raise UsageError(
                f"{place}column {number} ({entry.heading!r}): the cell is empty{others}; allowed:"
                " finite numbers; write a number or leave out the row"
            )


def _assigned(table: Table, scene: Scene, choices: Choices, notes: list[str]) -> list[tuple[Heading, Entry]]:
    """Return the entries whose headings have a meaning, with it."""
    columns = choices.columns
    if not table.has_headings and columns is None:
        columns = _unnamed(table, scene, notes)
    if columns is not None and not isinstance(columns, Mapping):
        if len(columns) != len(table.entries):
            raise UsageError(
                f"{len(columns)} headings were given in columns, the file has {len(table.entries)} columns; give one"
                " for each column, in their order"
            )
        columns = {entry.heading: text for entry, text in zip(table.entries, columns, strict=True)}
    columns = columns or {}
    if unknown := [key for key in columns if key not in {entry.heading for entry in table.entries}]:
        raise UsageError(
            f"columns has {unknown[0]!r}, which the file does not have; it has"
            f" {', '.join(repr(entry.heading) for entry in table.entries[:20])}"
        )
    assigned, unused = [], []
    for entry in table.entries:
        text = columns.get(entry.heading, entry.heading)
        heading = heading_of(text)
        if heading is None and entry.heading in columns:
            raise UsageError(
                f"columns names {entry.heading!r} as {text!r}, which is unknown; allowed: time, step, body, velocity,"
                " displacement, position or contact_force, with a body and a unit, such as 'velocity 3 [mm/s]'"
            )
        if heading is None:
            unused.append(entry.heading)
            continue
        if entry.axis is not None:
            heading = replace(heading, axis=entry.axis)
        assigned.append((heading, entry))
        unit = heading.unit or entry.unit
        stated = isinstance(choices.units, str) or choices.states(heading.quantity)
        if unit is None and heading.quantity in DIMENSIONS and not stated:
            notes.append(f"{heading.quantity} has no unit in the file and is read in {DIMENSIONS[heading.quantity]}")
        if choices.columns is not None and entry.heading in columns:
            notes.append(f"column {entry.heading!r} is {text!r}, as stated")
    if unused:
        notes.append(
            f"columns that are not used: {', '.join(map(repr, unused[:12]))}{', ...' if len(unused) > 12 else ''}"
        )
    return assigned


def _unnamed(table: Table, scene: Scene, notes: list[str]) -> list[str]:
    """Return headings of a file without headings: its first row must show the scene's start; else raise UsageError."""
    count, n = len(table.entries), scene.n_body
    first = np.array([numbers(entry.values[:1])[0][0] for entry in table.entries])
    start = np.array(scene.velocity)
    near = 1e-3 * float(np.max(np.abs(start), initial=0.0))
    velocities = [f"velocity {k}" for k in range(n)]
    choices = {n + 1: ["time", *velocities], 2 * n + 1: ["time", *(f"displacement {k}" for k in range(n)), *velocities]}
    starts = count in choices and near and first[0] == 0.0 and np.all(np.abs(first[-n:] - start) <= near)
    if starts and (count == n + 1 or not np.any(first[1 : n + 1])):
        what = "velocities" if count == n + 1 else "displacements, then velocities"
        notes.append(f"the file has no headings; its first row shows that its columns are the time and {what}")
        return choices[count]
    raise UsageError(
        f"the file has {count} columns without headings; give their meaning in their order (--columns), such as"
        " 'time,velocity 0,velocity 1'"
    )


def _of_axis(assigned: list[tuple[Heading, Entry]], choices: Choices, notes: list[str]) -> list[tuple[Heading, Entry]]:
    """Return the entries along one axis: the stated one, or that of the largest motion."""
    axes = {heading.axis for heading, _ in assigned if heading.axis is not None}
    if choices.axis is not None:
        axis = "xyz".index(choices.axis)
    elif len(axes) > 1:
        motion = dict.fromkeys(axes, 0.0)
        for quantity in ("velocity", "displacement", "position"):
            for heading, entry in assigned:
                if heading.quantity == quantity and heading.axis is not None:
                    values = numbers(entry.values)[0]
                    span = np.max(np.abs(values)) if quantity != "position" else np.max(np.ptp(values, axis=0))
                    motion[heading.axis] = max(motion[heading.axis], float(span))
            if any(motion.values()):
                break
        axis = max(motion, key=lambda key: motion[key])
        notes.append(f"the chain lies along {'xyz'[axis]}, which has the largest motion")
    else:
        return assigned
    return [(heading, entry) for heading, entry in assigned if heading.axis in (None, axis)]


def _forces(assigned: list[tuple[Heading, Entry]], scene: Scene, notes: list[str]) -> list[tuple[Heading, Entry]]:
    """Return the entries with forces as contact forces if their columns are the contacts; else without forces."""
    forces = [(heading, entry) for heading, entry in assigned if heading.quantity == "force"]
    if not forces:
        return assigned
    others = [(heading, entry) for heading, entry in assigned if heading.quantity != "force"]
    by_contact = any(h.quantity == "body" and e.heading.lower().startswith("contact") for h, e in others)
    indices = sorted(heading.index for heading, _ in forces if heading.index is not None)
    count = scene.n_contact
    widths = [entry.values.shape[1] for _, entry in forces if entry.values.ndim == 2]
    as_many = indices in ([*range(count)], [*range(1, count + 1)]) or widths == [count]
    if by_contact or (as_many and count != scene.n_body):
        notes.append("forces are those of the contacts, because the file has one for each contact")
        return others + [(replace(heading, quantity="contact_force"), entry) for heading, entry in forces]
    notes.append("forces are not used, because they may be net forces; headings such as contact_force_3 are used")
    return others
