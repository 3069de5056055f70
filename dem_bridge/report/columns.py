"""Columns of tables: a heading, and the unit in which the column shows numbers that are given in SI.

Columns are declared in Python. The unit has the factor, and its symbol stands in the heading, so that no wording of a
heading changes a number.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from numbers import Real
from typing import Any


@dataclass(frozen=True)
class Unit:
    """A unit that columns show."""

    symbol: str
    per_si: float = 1.0
    """How many of it make one of the unit of SI."""


PERCENT, RELATIVE = Unit("%", 100.0), Unit("relative")
SECOND, MILLISECOND, MICROSECOND = Unit("s"), Unit("ms", 1e3), Unit("µs", 1e6)
METRE, MILLIMETRE = Unit("m"), Unit("mm", 1e3)
DEGREE = Unit("degrees")
SPEED = Unit("m/s")
KILOHERTZ = Unit("kHz", 1e-3)
NEWTON, STIFFNESS, HERTZ_STIFFNESS = Unit("N"), Unit("N/m"), Unit("N/m^1.5")
GIGAPASCAL, MILLIJOULE, GRAM_SPEED = Unit("GPa", 1e-9), Unit("mJ", 1e3), Unit("g m/s", 1e3)


@dataclass(frozen=True)
class Column:
    """A column of a table.

    >>> speed = Column("velocity", PERCENT, of="of the largest")
    >>> speed.heading, speed.cell(0.25)
    ('velocity (% of the largest)', 25.0)
    """

    name: str
    unit: Unit | None = None
    of: str = ""
    """What a share is relative to, beside the unit."""
    at: str = ""
    """Where or when it is read, behind the unit."""

    @property
    def heading(self) -> str:
        """Return the name with the unit in brackets."""
        unit = "" if self.unit is None else f" ({' '.join(filter(None, (self.unit.symbol, self.of)))})"
        return f"{self.name}{unit}{self.at and f' {self.at}'}"

    def cell(self, value: Any) -> Any:
        """Return a value of SI in the unit of the column; what is no number stays."""
        factor = 1.0 if self.unit is None else self.unit.per_si
        return value if factor == 1.0 or not isinstance(value, Real) else factor * float(value)


#: columns in their order; or the attribute of the items from which each is read ("scene.name") -> column. What is no
#: Column is the name of one without unit
Columns = Sequence[object] | Mapping[str, object]


def table_cells(columns: Columns, rows: Iterable[Any]) -> tuple[tuple[str, ...], tuple[tuple[Any, ...], ...]]:
    """Return the headings of columns, and the cells of rows: items whose attributes are read, or tuples in SI.

    >>> table_cells({"real": "value", "imag": Column("part", PERCENT)}, [1.0 + 0.5j])
    (('value', 'part (%)'), ((1.0, 50.0),))
    """
    declared = columns.values() if isinstance(columns, Mapping) else columns
    shown = [column if isinstance(column, Column) else Column(str(column)) for column in declared]
    if isinstance(columns, Mapping):
        rows = ([_attribute(item, path) for path in columns] for item in rows)
    cells = (tuple(column.cell(value) for column, value in zip(shown, row, strict=True)) for row in rows)
    return tuple(column.heading for column in shown), tuple(cells)


def _attribute(item: Any, path: str) -> str | float:
    """Return an attribute of an attribute ... as a number or as a text (None: nan)."""
    for name in path.split("."):
        item = item.get(name) if isinstance(item, Mapping) else None if item is None else getattr(item, name)
    if item is None:
        return math.nan
    return float(item) if isinstance(item, Real) else str(item)
