"""The contents of a file of any code: some quantities of some bodies at the file's own times, in SI units.

Nothing is compared with the scene beyond the numbers of bodies and contacts: values that contradict the scene are
the subject of a later judgement.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import numpy as np

from dem_bridge.errors import UsageError
from dem_bridge.formats.readers.rounding import restored_times
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import Floats

#: quantities of a record, each with the field of a scene that counts its columns
QUANTITIES = {"velocity": "n_body", "displacement": "n_body", "contact_force": "n_contact"}


@dataclass(frozen=True, kw_only=True, eq=False)
class Record:
    """Hold the contents of a file in SI units: some quantities of some bodies at its own times."""

    name: str
    """The file as it was named."""
    time: Floats
    """Times, s, ``(n_t,)``, increasing; they need not begin at 0 and need not be even."""
    values: Mapping[str, Floats]
    """``velocity``, ``displacement`` and ``contact_force``, ``(n_t, n_columns)``; each only if the file has it."""
    columns: Mapping[str, tuple[int, ...]]
    """Body (contact) of each column; body 0 is the struck end."""
    rounding: Mapping[str, Floats]
    """Largest rounding error of each value, ``(n_t, n_columns)``, and of each ``time``, ``(n_t,)``."""
    dt: float | None = None
    """Time step of the run, s; None if it is unknown."""
    recognised: tuple[str, ...] = field(default=())
    """Sentences on what was assumed and why."""
    displacement_from_first: bool = False
    """True if displacements are positions minus those of the first sample."""
    stated: Mapping[str, Any] = field(default_factory=dict)
    """Fields of a scene that the file, or the deck that wrote it, states otherwise than the scene of the run."""

    def __post_init__(self) -> None:
        for name in ("values", "columns", "rounding", "stated"):
            object.__setattr__(self, name, MappingProxyType(dict(getattr(self, name))))
        for array in (self.time, *self.values.values(), *self.rounding.values()):
            array.setflags(write=False)


@dataclass(kw_only=True)
class Draft:
    """Hold what was read so far: values in SI units with their rounding errors, and sentences on assumptions."""

    name: str
    time: Floats
    time_rounding: Floats
    values: dict[str, Floats] = field(default_factory=dict)
    rounding: dict[str, Floats] = field(default_factory=dict)
    columns: dict[str, tuple[int, ...]] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    dt: float | None = None
    from_first: bool = False
    positions: Floats | None = None
    """Positions, ``(n_t, n_columns)``; None if the file has none."""
    headings: tuple[str, ...] = ()
    stated: dict[str, Any] = field(default_factory=dict)
    """Fields of a scene that the file states otherwise than the scene of the run."""
    lost: str = ""
    """A sentence on samples that are not used, because they have missing values."""

    def add(self, quantity: str, values: Floats, rounding: Floats, columns: Iterable[int]) -> None:
        """Add the values of a quantity, ``(n_t, n_columns)``, unless none of them is a number."""
        if not np.any(np.isfinite(values)):
            self.notes.append(f"{quantity} is unknown, because the file has no numbers in its columns")
            return
        self.values[quantity], self.rounding[quantity] = values, rounding
        self.columns[quantity] = tuple(columns)

    def add_positions(self, values: Floats, rounding: Floats, columns: Iterable[int]) -> None:
        """Add positions, ``(n_t, n_columns)``, as displacements from the first sample, unless there are displacements.

        Positions of a file that does not begin at 0 s are not used, because the start is unknown.
        """
        self.positions = values
        if "displacement" in self.values:
            return
        if self.time[0] != 0.0:
            self.notes.append(
                f"positions are not used, because the file begins at {self.time[0]:.6g} s and displacements are"
                " relative to the positions at 0 s"
            )
            return
        self.add("displacement", values - values[0], rounding + rounding[0], columns)
        self.from_first = True
        self.notes.append("displacements are relative to the first frame")

    def record(self, scene: Scene) -> Record:
        """Return the record, with restored times; raise UsageError for values that are not finite."""
        if not self.values:
            raise UsageError(
                "the file has no velocities, displacements, positions or contact forces that can be used"
                + f" in {', '.join(map(repr, self.headings[:20]))}" * bool(self.headings)
                + "; allowed: headings such as 'velocity 3 [m/s]'; name the columns (--columns)"
            )
        for quantity, values in self.values.items():
            self._check(quantity, values, scene)
        if len(wrong := np.flatnonzero(~np.isfinite(self.time))):
            raise UsageError(f"sample {wrong[0]} is at {self.time[wrong[0]]} s; allowed: finite, increasing times")
        if len(wrong := np.flatnonzero(np.diff(self.time) <= 0.0)):
            row = int(wrong[0])
            raise UsageError(
                f"sample {row + 1} is at {self.time[row + 1]:.9g} s and sample {row} at {self.time[row]:.9g} s;"
                " allowed: increasing times"
            )
        time, rounding, sentence = restored_times(self.time, self.time_rounding, scene.duration, scene.samples, self.dt)
        self.notes += [sentence] if sentence else []
        return Record(
            name=self.name,
            time=time,
            values=self.values,
            columns=self.columns,
            rounding=self.rounding | {"time": rounding},
            dt=self.dt,
            recognised=tuple(dict.fromkeys(self.notes)),
            displacement_from_first=self.from_first,
            stated=self.stated,
        )

    def _check(self, quantity: str, values: Floats, scene: Scene) -> None:
        """Raise UsageError unless the columns are of bodies (contacts) of the scene and all values are finite."""
        count, columns = getattr(scene, QUANTITIES[quantity]), self.columns[quantity]
        kind = "contact" if quantity == "contact_force" else "body"
        outside = [column for column in columns if not 0 <= column < count]
        if outside or len(set(columns)) != len(columns):
            said = f"{kind} {outside[0]}" if outside else f"{kind} {max(columns, key=columns.count)} twice"
            raise UsageError(
                f"the file has the {quantity} of {said}; the scene {scene.name} has {count}: allowed are 0 to"
                f" {count - 1}, each once. Is it this scene? Give that of this run, or the bodies (--bodies)"
            )
        if len(wrong := np.argwhere(~np.isfinite(values))):
            row, column = wrong[0].tolist()
            raise UsageError(
                f"the {quantity} of {kind} {columns[column]} at {self.time[row]:.9g} s is {values[row, column]};"
                " allowed: finite numbers; give a file that ends before the run failed"
            )
