"""Tables as data: columns with a name, a heading, a unit and, where there are any, uncertainties.

A cell is a number, a text, or None for an unknown value. The notes of the table state the reason for unknown values.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

from dem_bridge.errors import UsageError
from dem_bridge.formats.units import unit_of
from dem_bridge.foundation.wording import summary

if TYPE_CHECKING:
    import pandas as pd

Kind = Literal["number", "count", "text"]


class Form(NamedTuple):
    """Hold how a column is shown; one that is ``optional`` is left out without values."""

    heading: str
    unit: str = ""
    kind: Kind = "number"
    digits: int = 5
    optional: bool = False
    uncertain: bool = False
    """Whether a column with its uncertainty follows."""

    def with_details(self, details: Mapping[str, str]) -> Form:
        """Return the form with the ``heading`` and ``unit`` that depend on the scene or the settings."""
        if unknown := set(details) - {"heading", "unit"}:
            raise KeyError(f"details of a column = {sorted(unknown)}; allowed: heading, unit")
        return self._replace(heading=details.get("heading", self.heading), unit=details.get("unit", self.unit))


COLUMNS: Mapping[str, Mapping[str, Form]] = {
    "contacts": {
        "contact": Form("contact", kind="count"),
        "where": Form("where", kind="text"),
        "angle": Form("angle", "deg"),
        "stiffness_paper": Form("stiffness by eq. 3.1", "N/m^1.5"),
        "stiffness_exact": Form("stiffness by Hertz' exact law", "N/m^1.5"),
        "paper_over_exact": Form("eq. 3.1 over exact"),
        "stiffness": Form("stiffness of the scene", "N/m^(n-1)"),
        "exponent": Form("n"),
        "gap": Form("gap", "m"),
        "damping": Form("damping coefficient", optional=True),
        "damping_not_clipped": Form("damping coefficient, not clipped", optional=True),
        "restitution": Form("coefficient of restitution", optional=True),
        "restitution_not_clipped": Form("coefficient of restitution, not clipped", optional=True),
        "restitution_tsuji": Form("coefficient of restitution (Tsuji)", optional=True),
        "restitution_tsuji_not_clipped": Form("coefficient of restitution (Tsuji), not clipped", optional=True),
        "pull_off_dmt": Form("pull-off force (DMT)", "N", optional=True),
        "pull_off_jkr": Form("pull-off force (JKR)", "N", optional=True),
        "lammps_model": Form("LAMMPS model", kind="text"),
        "lammps_k_n": Form("LAMMPS k_n", digits=6),
        "type_left": Form("atom type left", kind="count"),
        "type_right": Form("atom type right", kind="count"),
        "surrogate_radius": Form("surrogate radius", "m"),
        "peak_overlap_prescan": Form("peak overlap, prescan", "m", digits=3),
        "peak_force_prescan": Form("peak force, prescan", "N", digits=3),
        "peak_force_bca": Form("peak force, BCA", "N"),
        "residence_bca": Form("residence time, BCA", "s"),
        "peak_overlap": Form("peak overlap", "m", uncertain=True),
        "peak_force": Form("peak force", "N", uncertain=True),
        "semi_major": Form("semi-major axis of the contact ellipse", "m"),
        "semi_minor": Form("semi-minor axis of the contact ellipse", "m"),
        "peak_pressure": Form("peak contact pressure", "Pa"),
    },
    "bodies": {
        "body": Form("body", kind="count"),
        "mass": Form("mass", "kg"),
        "mass_by_density": Form("density times volume", "kg"),
        "shape": Form("shape", kind="text"),
        "radius": Form("radius", "m"),
        "height": Form("height", "m"),
        "material": Form("material", kind="text"),
        "youngs_modulus": Form("Young's modulus", "Pa"),
        "poissons_ratio": Form("Poisson's ratio"),
        "density": Form("density", "kg/m^3"),
        "velocity": Form("initial velocity", "m/s"),
        "atom_id": Form("atom id", kind="count"),
        "atom_type": Form("atom type", kind="count"),
    },
    "pair-coeffs": {
        "type_1": Form("atom type I", kind="count"),
        "type_2": Form("atom type J", kind="count"),
        "contact": Form("first contact", kind="count"),
        "contacts": Form("number of contacts", kind="count"),
        "stiffness": Form("stiffness", "N/m^(n-1)"),
        "exponent": Form("n"),
        "lammps_model": Form("LAMMPS model", kind="text"),
        "lammps_k_n": Form("LAMMPS k_n", digits=6),
        "lammps_damping": Form("LAMMPS damping coefficient", digits=6),
        "coefficients": Form("arguments of pair_coeff I J", kind="text"),
    },
    "angles": {
        "contact": Form("contact", kind="count"),
        "stiffness": Form("stiffness", "N/m^(n-1)"),
        "angle": Form("angle", "deg"),
        "tolerance": Form("angle tolerance", "deg", digits=3),
        "stiffness_slope": Form("d ln(stiffness)/d(angle)", "1/deg", digits=4),
    },
    "stiffness-curve": {
        "angle": Form("angle", "deg"),
        "stiffness_paper": Form("stiffness by eq. 3.1", "N/m^1.5"),
        "stiffness_exact": Form("stiffness by Hertz' exact law", "N/m^1.5"),
        "paper_over_exact": Form("eq. 3.1 over exact"),
        "slope_paper": Form("d ln(stiffness)/d(angle), eq. 3.1", "1/deg"),
        "slope_exact": Form("d ln(stiffness)/d(angle), exact", "1/deg"),
    },
    "constants": {
        "name": Form("name", kind="text"),
        "group": Form("group", kind="text"),
        "quantity": Form("quantity", kind="text"),
        "parameters": Form("parameters", kind="text"),
        "value": Form("value", digits=12),
        "unit": Form("unit", kind="text"),
        "digits": Form("certain digits", kind="count"),
        "second_value": Form("second value", digits=12),
        "difference": Form("relative difference", digits=1),
        "source": Form("source", kind="text"),
        "method": Form("method", kind="text"),
        "second_method": Form("second method", kind="text"),
    },
}


SCHEMA = "dem-bridge/table/1"
#: what a JSON document says of a column
_COLUMN_KEYS = ("name", "heading", "unit", "kind", "uncertainty_of")
Cell = float | int | str | None


@dataclass(frozen=True, kw_only=True)
class Column:
    """Hold one quantity for all rows; :func:`column` returns an instance."""

    quantity: str
    """Name of the quantity in snake_case, without its unit."""
    heading: str
    """Heading in plain words, without the unit."""
    values: tuple[Cell, ...]
    kind: Kind
    unit: str = ""
    """Of :data:`~dem_bridge.formats.units.UNITS`, or as it stands."""
    digits: int = 5
    """Significant digits in Markdown and LaTeX where the uncertainty is unknown."""
    uncertainties: tuple[Cell, ...] | None = None
    """Uncertainties of the values, if there are any."""
    uncertainty_of: str | None = None
    """Name of the column whose uncertainties these are, if the column holds uncertainties."""

    @property
    def name(self) -> str:
        """Return the name for programs: the quantity with its unit, such as "peak_force_N"."""
        suffix = unit_of(self.unit).suffix
        return f"{self.quantity}_{suffix}" if suffix else self.quantity


#: cell of a value that is not None, by kind of column
_CELLS: Mapping[str, Callable[[Any], Cell]] = {
    "number": lambda value: float(value) if math.isfinite(value) else None,
    "count": int,
    "text": lambda value: value or None,
}


def column(
    quantity: str, heading: str, values: Iterable[Any], *, unit: str = "", kind: Kind = "number", digits: int = 5
) -> Column:
    """Return a column; None, a number that is not finite and an empty text are unknown.

    >>> column("peak_force", "peak force", [1.0, float("nan")], unit="N").values
    (1.0, None)
    """
    cells = tuple(None if value is None else _CELLS[kind](value) for value in values)
    return Column(quantity=quantity, heading=heading, unit=unit, values=cells, kind=kind, digits=digits)


def with_uncertainty(
    quantity: str, heading: str, unit: str, values: Iterable[Any], uncertainties: Iterable[Any]
) -> tuple[Column, Column]:
    """Return a column of numbers and the column of their uncertainties; unknown uncertainties are empty cells."""
    numbers = column(quantity, heading, values, unit=unit)
    # an unknown value has no uncertainty
    cells = [None if cell is None else part for cell, part in zip(numbers.values, uncertainties, strict=True)]
    uncertainty = column(f"{quantity}_uncertainty", f"{heading}, uncertainty", cells, unit=unit, digits=2)
    return replace(numbers, uncertainties=uncertainty.values), replace(uncertainty, uncertainty_of=numbers.name)


@dataclass(frozen=True, kw_only=True)
class Table:
    """Hold columns of equal length with a title, notes and provenance.

    Attributes
    ----------
    id : str
        Name of the table, such as "contacts".
    title : str
        Title in plain words.
    columns : tuple of Column
        Columns of equal length with distinct names.
    notes : tuple of str
        Sentences that state definitions and the reasons for unknown values.
    provenance : mapping
        Scene, hash, backend, settings and versions.
    include : str or None
        The table as commands that LAMMPS reads by ``include``, if there are such commands.
    """

    id: str
    title: str
    columns: tuple[Column, ...]
    notes: tuple[str, ...] = ()
    provenance: Mapping[str, Any] = field(default_factory=dict)
    include: str | None = None

    def __post_init__(self) -> None:
        lengths = {len(column.values) for column in self.columns}
        names = [column.name for column in self.columns]
        if len(lengths) != 1 or len(set(names)) != len(names):
            raise ValueError(f"table {self.id}: columns of lengths {sorted(lengths)}, names {names}")

    def __str__(self) -> str:
        """Return the title, the columns and the number of rows."""
        columns = ", ".join(column.name for column in self.columns)
        return summary([f"columns: {columns}"], [f"{len(self.rows)} rows; db.export writes them"], title=self.title)

    __repr__ = __str__

    @property
    def rows(self) -> list[tuple[Cell, ...]]:
        """Return the cells row by row."""
        return list(zip(*(column.values for column in self.columns), strict=True))

    def only(self, names: Sequence[str]) -> Table:
        """Return the table with the columns ``names``, in this order; raise UsageError for an unknown name."""
        columns = {column.name: column for column in self.columns}
        for name in names:
            if name not in columns:
                raise UsageError(f"table {self.id!r} has no column {name!r}; allowed: {', '.join(columns)}")
        if len(names) == 0 or len(set(names)) < len(names):
            raise UsageError(f"columns = {list(names)!r}; allowed: one or more names, each once")
        return replace(self, columns=tuple(columns[name] for name in names), include=None)

    def to_pandas(self) -> pd.DataFrame:
        """Return a DataFrame; units, notes and provenance are in its ``attrs``."""
        import pandas as pd

        kinds = {"number": "float64", "count": "Int64", "text": "string"}
        frame = pd.DataFrame(
            {column.name: pd.array(column.values, dtype=kinds[column.kind]) for column in self.columns}
        )
        frame.attrs = {key: value for key, value in self.as_json().items() if key != "rows"}
        return frame

    def as_json(self) -> dict[str, Any]:
        """Return the table as a JSON document: schema, columns with units, rows as mappings by column name."""
        names = [column.name for column in self.columns]
        return {
            "schema": SCHEMA,
            "table": self.id,
            "title": self.title,
            "columns": [{key: getattr(column, key) for key in _COLUMN_KEYS} for column in self.columns],
            "rows": [dict(zip(names, row, strict=True)) for row in self.rows],
            "notes": list(self.notes),
            "provenance": json.loads(json.dumps(dict(self.provenance))),
        }


def tabulate(
    id: str,
    values: Mapping[str, Iterable[Any]],
    *,
    details: Mapping[str, Mapping[str, str]] | None = None,
    **fields: Any,
) -> Table:
    """Return the table ``id`` of :data:`~.table.COLUMNS`, whose columns have the ``values`` of their quantities.

    The first quantity has a value in every row. Quantities without values, and rows behind the last value of a
    quantity, are unknown; an optional column without values is left out. ``details`` has the headings and units that
    depend on the scene or the settings. ``fields`` are further fields of :class:`Table`.
    """
    cells = {quantity: list(column) for quantity, column in values.items()}
    rows, columns = len(next(iter(cells.values()))), list[Column]()
    for quantity, form in COLUMNS[id].items():
        if form.optional and quantity not in cells:
            continue
        form = form.with_details((details or {}).get(quantity, {}))
        heading, unit, names = form.heading, form.unit, (quantity, f"{quantity}_uncertainty")
        parts = [cells.get(name, []) + [None] * (rows - len(cells.get(name, []))) for name in names]
        if form.uncertain:
            columns += with_uncertainty(quantity, heading, unit, *parts)
        else:
            columns.append(column(quantity, heading, parts[0], unit=unit, kind=form.kind, digits=form.digits))
    return Table(id=id, columns=tuple(columns), **fields)
