"""A table as data: columns with a name for machines, a heading for people, a unit, and error bars where there are any.

A cell is a number, a text, or None for what is not known; why it is not is said once, in the notes.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from dem_bridge.errors import UsageError

if TYPE_CHECKING:
    import pandas as pd

SCHEMA = "dem-bridge/table/1"
Cell = float | int | str | None


@dataclass(frozen=True)
class Unit:
    """How a unit is written: for people, for LaTeX, and at the end of a column's name."""

    text: str
    tex: str
    """In macros of siunitx; where it has text of its own, as that stands."""
    suffix: str
    prefixed: bool = False
    """Whether it takes prefixes such as µ and G."""


#: by how they stand in code
UNITS: Mapping[str, Unit] = {
    "": Unit("", "", ""),
    "N": Unit("N", r"\newton", "N", prefixed=True),
    "m": Unit("m", r"\metre", "m", prefixed=True),
    "s": Unit("s", r"\second", "s", prefixed=True),
    "Pa": Unit("Pa", r"\pascal", "Pa", prefixed=True),
    "kg": Unit("kg", r"\kilogram", "kg"),
    "deg": Unit("°", r"\degree", "deg"),
    "1/deg": Unit("1/°", r"\per\degree", "per_deg"),
    "N s/m": Unit("N s/m", r"\newton\second\per\metre", "N_s_per_m"),
    "1/s": Unit("1/s", r"\per\second", "per_s"),
    "m/s": Unit("m/s", r"\metre\per\second", "m_per_s"),
    "kg m/s": Unit("kg m/s", r"\kilogram\metre\per\second", "kg_m_per_s"),
    "J": Unit("J", r"\joule", "J", prefixed=True),
    "kg/m^3": Unit("kg/m³", r"\kilogram\per\cubic\metre", "kg_per_m3"),
    "N/m^1.5": Unit("N/m^1.5", r"\newton\per\metre\tothe{1.5}", "N_per_m1_5"),
    # those of a number that depend on its row
    "N/m^(n-1)": Unit("N/m^(n-1)", r"$\mathrm{N}/\mathrm{m}^{n-1}$", "SI"),
    "N/m^2": Unit("N/m²", r"\newton\per\square\metre", "SI"),
    "N/m": Unit("N/m", r"\newton\per\metre", "SI"),
    "N/m^2 or N/m": Unit("N/m², of hooke N/m", r"\si{\newton\per\square\metre}, of hooke \si{\newton\per\metre}", "SI"),
}


@dataclass(frozen=True, kw_only=True)
class Column:
    """One quantity down the rows. Made by :func:`numbers`, :func:`counts` and :func:`texts`."""

    quantity: str
    """What it is, snake_case, without its unit."""
    heading: str
    """For people, without its unit."""
    values: tuple[Cell, ...]
    kind: Literal["number", "count", "text"]
    unit: str = ""
    """Of :data:`UNITS`."""
    digits: int = 5
    """Significant digits for people, where no error bar says more."""
    bars: tuple[Cell, ...] | None = None
    """Error bars of the values, where they have any."""
    bar_of: str | None = None
    """Of an error bar: the name of the column that it belongs to."""

    @property
    def name(self) -> str:
        """For machines: the quantity with its unit, "peak_force_N"."""
        suffix = UNITS[self.unit].suffix
        return f"{self.quantity}_{suffix}" if suffix else self.quantity


def numbers(
    quantity: str, heading: str, unit: str, values: Iterable[float | None] | NDArray[np.float64], *, digits: int = 5
) -> Column:
    """A column of numbers; what is None or not finite is not known.

    >>> numbers("peak_force", "peak force", "N", [1.0, float("nan")]).values
    (1.0, None)
    """
    known = tuple(None if one is None or not math.isfinite(one) else float(one) for one in values)
    return Column(quantity=quantity, heading=heading, unit=unit, values=known, kind="number", digits=digits)


def barred(
    quantity: str,
    heading: str,
    unit: str,
    values: Iterable[float | None] | NDArray[np.float64],
    bars: Iterable[float | None] | NDArray[np.float64],
) -> tuple[Column, Column]:
    """A column of numbers and that of their error bars, which is empty where nothing can be said."""
    column = numbers(quantity, heading, unit, values)
    known = numbers(f"{quantity}_bar", f"{heading}, bar", unit, bars, digits=2)
    # no number, no bar of it
    kept = tuple(None if one is None else bar for one, bar in zip(column.values, known.values, strict=True))
    return replace(column, bars=kept), replace(known, values=kept, bar_of=column.name)


def counts(quantity: str, heading: str, values: Iterable[int | None]) -> Column:
    """A column of whole numbers."""
    whole = tuple(None if one is None else int(one) for one in values)
    return Column(quantity=quantity, heading=heading, values=whole, kind="count")


def texts(quantity: str, heading: str, values: Iterable[str | None]) -> Column:
    """A column of words; an empty one is not known."""
    return Column(quantity=quantity, heading=heading, values=tuple(one or None for one in values), kind="text")


@dataclass(frozen=True, kw_only=True)
class Table:
    """Columns of equal length, and what is to be said of them."""

    id: str
    """What :func:`dem_bridge.exports` calls it: "contacts"."""
    title: str
    columns: tuple[Column, ...]
    notes: tuple[str, ...] = ()
    """Sentences: what is not known and why, which definitions are meant."""
    provenance: Mapping[str, Any] = field(default_factory=dict)
    include: str | None = None
    """The same as commands that LAMMPS reads by ``include``, where there are such."""

    def __post_init__(self) -> None:
        lengths = {len(column.values) for column in self.columns}
        names = [column.name for column in self.columns]
        if len(lengths) != 1 or len(set(names)) != len(names):
            raise ValueError(f"table {self.id}: columns of lengths {sorted(lengths)}, names {names}")

    @property
    def rows(self) -> list[tuple[Cell, ...]]:
        return list(zip(*(column.values for column in self.columns), strict=True))

    def only(self, names: Sequence[str]) -> Table:
        """The table with these columns, in this order; UsageError for a name that it has not."""
        known = {column.name: column for column in self.columns}
        for name in names:
            if name not in known:
                raise UsageError(f"column {name!r} of table {self.id!r} is unknown; allowed: {', '.join(known)}")
        if len(names) == 0 or len(set(names)) < len(names):
            raise UsageError(f"columns = {list(names)!r}; allowed: one or more names, each once")
        return replace(self, columns=tuple(known[name] for name in names), include=None)

    def to_pandas(self) -> pd.DataFrame:
        """A DataFrame; what else there is to say stands in its ``attrs``."""
        import pandas as pd

        kinds = {"number": "float64", "count": "Int64", "text": "string"}
        frame = pd.DataFrame({one.name: pd.array(one.values, dtype=kinds[one.kind]) for one in self.columns})
        frame.attrs = {key: value for key, value in self.as_json().items() if key != "rows"}
        return frame

    def as_json(self) -> dict[str, Any]:
        """JSON-able: schema, columns with their units, rows as mappings by the names of their columns."""
        named = [one.name for one in self.columns]
        return {
            "schema": SCHEMA,
            "table": self.id,
            "title": self.title,
            "columns": [
                {"name": one.name, "heading": one.heading, "unit": one.unit, "kind": one.kind, "bar_of": one.bar_of}
                for one in self.columns
            ],
            "rows": [dict(zip(named, row, strict=True)) for row in self.rows],
            "notes": list(self.notes),
            "provenance": json.loads(json.dumps(dict(self.provenance))),
        }
