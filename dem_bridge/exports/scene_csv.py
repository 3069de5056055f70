"""Build scenes from CSV: one table with a row per body, or a table of bodies and a table of contacts.

In the single table, a row has the contact to the next body. The two tables are those of ``dem-bridge export --table
bodies`` and ``--table contacts``. Headings have units. Quantities that no table has (duration, gravity, drag,
precompression, the walls of a single table) are arguments. The module reads no files: text in, Scene out. Errors state
file, line and column.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from dem_bridge.errors import SceneError
from dem_bridge.scene import Damping, Scene, Wall

#: quantities of bodies by heading
BODY = {"body": "body", "mass_kg": "mass", "velocity_m_per_s": "velocity"}
#: quantities of contacts by heading
CONTACT = {
    "stiffness_N_per_m^(n-1)": "stiffness",
    "stiffness_SI": "stiffness",
    "exponent": "exponent",
    "gap_m": "gap",
    "damping_N_s_per_m": "dashpot",
    "damping_s": "kuwabara-kono",
}
#: columns that identify the contacts of a table
PLACE = {"contact": "contact", "where": "where"}
#: columns of exported tables that are not read, because they follow from other columns, a deck or a run
DERIVED = frozenset(
    {
        *("mass_by_density_kg", "shape", "radius_m", "height_m", "material", "youngs_modulus_Pa", "poissons_ratio"),
        *("density_kg_per_m3", "atom_id", "atom_type", "angle_deg", "stiffness_paper_N_per_m1_5"),
        *("stiffness_exact_N_per_m1_5", "paper_over_exact", "lammps_model", "lammps_k_n_SI", "type_left", "type_right"),
        *(
            "surrogate_radius_m",
            "peak_overlap_prescan_m",
            "peak_force_prescan_N",
            "peak_force_bca_N",
            "residence_bca_s",
        ),
        *("peak_overlap_m", "peak_overlap_uncertainty_m", "peak_force_N", "peak_force_uncertainty_N"),
        *("semi_major_m", "semi_minor_m", "peak_pressure_Pa"),
    }
)
_WALLS = ("wall_left", "wall_right")
#: largest relative difference between static overlaps in a table and those of the precompression (round-off of a sum)
_EQUILIBRIUM_WITHIN = 1e-12


@dataclass(frozen=True)
class _Sheet:
    """Hold the cells of a table by quantity, with the lines of the file."""

    file: str
    headings: Mapping[str, str]
    """Heading of each quantity."""
    lines: tuple[int, ...]
    """Line of each row in the file, counted from 1."""
    rows: tuple[Mapping[str, str], ...]
    """Cells by quantity, row by row."""

    def error(self, row: int, quantity: str, allowed: str) -> SceneError:
        """Return the error for a cell that is not allowed."""
        cell, where = self.rows[row][quantity], f"{self.file}, line {self.lines[row]}"
        problem = f"= {cell!r}" if cell else "is empty"
        return SceneError(self.headings[quantity], problem=problem, allowed=allowed, where=where)

    def number(self, row: int, quantity: str) -> float:
        """Return a cell as a number; raise SceneError if it is not one."""
        try:
            return float(self.rows[row][quantity])
        except ValueError:
            raise self.error(row, quantity, "a number") from None

    def numbers(self, quantity: str, rows: Sequence[int]) -> list[float]:
        """Return the numbers of a column in these rows."""
        return [self.number(row, quantity) for row in rows]

    def check_numbering(self, quantity: str) -> None:
        """Raise SceneError unless the column, if there is one, counts 0, 1, 2, ..."""
        for row in range(len(self.rows)) if quantity in self.headings else ():
            if self.rows[row][quantity] != f"{row}":
                raise self.error(row, quantity, f"{row} (rows are in the order of the chain, counted from 0)")


def scene_of_csv(
    text: str, *, file: str, contacts: str | None = None, contacts_file: str = "contacts", **scene_fields: Any
) -> Scene:
    """Return the scene of a table of bodies.

    ``contacts`` is the table of contacts; without it, each row of bodies has the contact to the next body.
    ``scene_fields`` are further fields of :class:`~dem_bridge.scene.Scene`. Raises SceneError with file, line and
    column.
    """
    single = contacts is None
    needed = ("mass", "velocity", "stiffness") if single else ("mass", "velocity")
    bodies = _sheet(text, file, {**BODY, **(CONTACT if single else {})}, needed)
    every = range(len(bodies.rows))
    bodies.check_numbering("body")
    if contacts is None:
        sheet, links, walls = bodies, list(every[:-1]), dict[str, int]()
        for quantity in set(CONTACT.values()) & set(bodies.headings):
            if bodies.rows[-1][quantity]:
                raise bodies.error(
                    len(bodies.rows) - 1,
                    quantity,
                    "an empty cell, because no body follows the last one; give a wall by wall_right",
                )
    else:
        sheet = _sheet(contacts, contacts_file, {**PLACE, **CONTACT}, ("stiffness",))
        sheet.check_numbering("contact")
        links, walls = _places(sheet)
        if len(links) != len(bodies.rows) - 1:
            problem = f"the table has {len(links)} contacts of the chain"
            allowed = f"{len(bodies.rows) - 1} for the {len(bodies.rows)} bodies in {file}"
            raise SceneError("", problem=problem, allowed=allowed, where=contacts_file)
    order = [*links, *walls.values()]
    columns: dict[str, Any] = {"mass": bodies.numbers("mass", every), "velocity": bodies.numbers("velocity", every)}
    columns["stiffness"] = sheet.numbers("stiffness", links)
    for quantity, default in (("exponent", 2.5), ("gap", 0.0)):
        columns[quantity] = sheet.numbers(quantity, links) if quantity in sheet.headings and links else default
    for side, row in walls.items():
        more = {quantity: sheet.number(row, quantity) for quantity in ("exponent", "gap") if quantity in sheet.headings}
        columns[side] = Wall(stiffness=sheet.number(row, "stiffness"), **more)
    for law in ("dashpot", "kuwabara-kono"):
        if law in sheet.headings:
            coefficients = tuple(sheet.numbers(law, order))
            # walls that are arguments have no cell for damping and are not damped
            undamped = sum(scene_fields.get(side) is not None for side in _WALLS)
            columns["damping"] = Damping(law=law, coefficient=(*coefficients, *(0.0,) * undamped))
    twice = next((key for key in columns if scene_fields.get(key) is not None), None)
    if twice is not None:
        raise SceneError(twice, problem="is both in the table and an argument", allowed="one of the two", where=file)
    try:
        return _build({**scene_fields, **columns})
    except SceneError as error:
        raise _located(error, bodies, sheet, links, walls) from None


def _build(fields: dict[str, Any]) -> Scene:
    """Return the scene; with a precompression, a table's gaps may be the static overlaps that Scene computes."""
    if not fields.get("precompression"):
        return Scene(**fields)
    walls = {side: fields[side] for side in _WALLS if fields.get(side) is not None}
    without_gaps = {side: Wall(stiffness=wall.stiffness, exponent=wall.exponent) for side, wall in walls.items()}
    scene = Scene(**{**fields, **without_gaps, "gap": 0.0})
    gap = np.array([*np.broadcast_to(fields["gap"], len(scene.stiffness)), *(wall.gap for wall in walls.values())])
    if np.any(gap) and not np.allclose(gap, scene.contacts.gap, rtol=_EQUILIBRIUM_WITHIN, atol=0.0):
        return Scene(**fields)  # raises the error about gaps with precompression
    return scene


def _sheet(text: str, file: str, quantities: Mapping[str, str], needed: Sequence[str]) -> _Sheet:
    """Return the cells of a table; raise SceneError for unknown, repeated and missing columns."""
    reader = csv.reader(text.splitlines(), skipinitialspace=True, strict=True)
    rows: list[tuple[int, list[str]]] = []
    try:
        for row in reader:
            cells = [cell.strip() for cell in row]
            if any(cells) and not cells[0].startswith("#"):
                rows.append((reader.line_num, cells))
    except csv.Error as error:
        where = f"{file}, line {reader.line_num}"
        raise SceneError(
            "", problem=f"the text is not CSV ({error})", allowed="cells separated by commas", where=where
        ) from None
    allowed = ", ".join(quantities)
    if len(rows) < 2:
        raise SceneError(
            "",
            problem="the table has no headings or no rows",
            allowed=f"a row of headings from {allowed}, then rows",
            where=file,
        )
    (line, names), *below = rows
    at = f"{file}, line {line}"
    for name in names:
        if name not in quantities and name not in DERIVED:
            raise SceneError(f"column {name!r}", problem="is unknown", allowed=allowed, where=at)
    headings: dict[str, str] = {}
    for name in (name for name in names if name in quantities):
        if quantities[name] in headings or (
            quantities[name] in ("dashpot", "kuwabara-kono") and {*headings} & {"dashpot", "kuwabara-kono"}
        ):
            raise SceneError(
                f"column {name!r}", problem="repeats the quantity of another column", allowed="one of them", where=at
            )
        headings[quantities[name]] = name
    for quantity in needed:
        if quantity not in headings:
            name = next(heading for heading, column in quantities.items() if column == quantity)
            raise SceneError(
                f"column {name!r}", problem="is missing", allowed=f"a table with {', '.join([name, *names])}", where=at
            )
    for number, cells in below:
        if len(cells) != len(names):
            where = f"{file}, line {number}"
            raise SceneError(
                "", problem=f"the row has {len(cells)} cells", allowed=f"{len(names)}, one per column", where=where
            )
    cells_of = [dict(zip(names, cells, strict=True)) for _, cells in below]
    return _Sheet(
        file,
        headings,
        tuple(number for number, _ in below),
        tuple({quantity: cells[name] for quantity, name in headings.items()} for cells in cells_of),
    )


def _places(sheet: _Sheet) -> tuple[list[int], dict[str, int]]:
    """Return the rows of the chain's contacts and the rows of the walls, which follow them."""
    links: list[int] = []
    walls: dict[str, int] = {}
    for row in range(len(sheet.rows)):
        where = sheet.rows[row]["where"] if "where" in sheet.headings else "chain"
        if where == "chain" and not walls:
            links.append(row)
        elif where in _WALLS and where not in walls and (where == "wall_left" or row == len(sheet.rows) - 1):
            walls[where] = row
        else:
            raise sheet.error(row, "where", "rows with chain, then wall_left and wall_right at most once each")
    return links, walls


def _located(
    error: SceneError, bodies: _Sheet, contacts: _Sheet, links: list[int], walls: dict[str, int]
) -> SceneError:
    """Return an error of Scene with the file, line and column of the cell that caused it."""
    match = re.fullmatch(r"(mass|velocity|stiffness|exponent|gap|damping\.coefficient)\[(\d+)\]", error.key)
    if match is not None:
        quantity, nth = match[1], int(match[2])
        sheet = bodies if quantity in ("mass", "velocity") else contacts
        if quantity == "damping.coefficient":
            quantity = next(law for law in ("dashpot", "kuwabara-kono") if law in contacts.headings)
        row = nth if sheet is bodies and quantity in ("mass", "velocity") else [*links, *walls.values()][nth]
        if quantity in sheet.headings:
            return error.at(f"{sheet.file}, line {sheet.lines[row]}", sheet.headings[quantity])
    side, _, quantity = error.key.partition(".")
    if side in walls and quantity in contacts.headings:
        return error.at(f"{contacts.file}, line {contacts.lines[walls[side]]}", contacts.headings[quantity])
    return error.at(bodies.file, error.key)
