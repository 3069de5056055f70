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
from dem_bridge.scene.scene import ADHESION_LAWS, BY_RESTITUTION, DAMPING_LAWS, Adhesion, Damping, Scene, Wall

#: quantities of bodies and of contacts, and the columns that identify contacts, by heading
BODY = {"body": "body", "mass_kg": "mass", "velocity_m_per_s": "velocity"}
CONTACT = {
    "stiffness_N_per_m^(n-1)": "stiffness", "stiffness_SI": "stiffness", "exponent": "exponent", "gap_m": "gap",
    "damping_N_s_per_m": "dashpot", "damping_per_s": "mass_velocity", "damping_s": "kuwabara-kono",
    "restitution": "coeff_restitution", "restitution_tsuji": "tsuji",
    "damping_not_clipped_N_s_per_m": "dashpot, not clipped", "damping_not_clipped_per_s": "mass_velocity, not clipped",
    "damping_not_clipped_s": "kuwabara-kono, not clipped", "restitution_not_clipped": "coeff_restitution, not clipped",
    "restitution_tsuji_not_clipped": "tsuji, not clipped", "pull_off_dmt_N": "dmt", "pull_off_jkr_N": "jkr",
}  # fmt: skip
PLACE = {"contact": "contact", "where": "where"}
#: columns of exported tables that are not read, because they follow from other columns, a deck or a run
DERIVED = frozenset(
    (
        "mass_by_density_kg",
        "shape",
        "radius_m",
        "height_m",
        "material",
        "youngs_modulus_Pa",
        "poissons_ratio",
        "density_kg_per_m3",
        "atom_id",
        "atom_type",
        "angle_deg",
        "stiffness_paper_N_per_m1_5",
        "stiffness_exact_N_per_m1_5",
        "paper_over_exact",
        "lammps_model",
        "lammps_k_n_SI",
        "type_left",
        "type_right",
        "surrogate_radius_m",
        "peak_overlap_prescan_m",
        "peak_force_prescan_N",
        "peak_force_bca_N",
        "residence_bca_s",
        "peak_overlap_m",
        "peak_overlap_uncertainty_m",
        "peak_force_N",
        "peak_force_uncertainty_N",
        "semi_major_m",
        "semi_minor_m",
        "peak_pressure_Pa",
    )
)
#: laws of damping, of which a table may have one; one that is not clipped has another column
_LAWS = frozenset(quantity for quantity in CONTACT.values() if quantity.partition(",")[0] in DAMPING_LAWS)
#: laws of adhesion, of which a table may have one
_ADHESIONS = frozenset(ADHESION_LAWS)
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
    ``scene_fields`` are further fields of :class:`~dem_bridge.scene.scene.Scene`. Raises SceneError with file, line and
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
                allowed = "an empty cell, because no body follows the last one; give a wall by wall_right"
                raise bodies.error(len(bodies.rows) - 1, quantity, allowed)
    else:
        sheet = _sheet(contacts, contacts_file, {**PLACE, **CONTACT}, ("stiffness",))
        sheet.check_numbering("contact")
        links, walls = _places(sheet)
        if len(links) != len(bodies.rows) - 1:
            allowed = f"{len(bodies.rows) - 1} for the {len(bodies.rows)} bodies in {file}"
            raise _fault(f"the table has {len(links)} contacts of the chain", allowed, contacts_file)
    order = [*links, *walls.values()]
    columns: dict[str, Any] = {"mass": bodies.numbers("mass", every), "velocity": bodies.numbers("velocity", every)}
    columns["stiffness"] = sheet.numbers("stiffness", links)
    for quantity, default in (("exponent", 2.5), ("gap", 0.0)):
        columns[quantity] = sheet.numbers(quantity, links) if quantity in sheet.headings and links else default
    for side, row in walls.items():
        quantities = [quantity for quantity in ("stiffness", "exponent", "gap") if quantity in sheet.headings]
        columns[side] = Wall(**{quantity: sheet.number(row, quantity) for quantity in quantities})
    # walls that are arguments have no cells, and neither damping nor adhesion
    without = sum(scene_fields.get(side) is not None for side in _WALLS)
    for quantity in _LAWS & set(sheet.headings):
        law, _, unclipped = quantity.partition(", ")
        coefficient = (*sheet.numbers(quantity, order), *(float(law in BY_RESTITUTION),) * without)
        columns["damping"] = Damping(law=law, coefficient=coefficient, clip=False if unclipped else None)
    for law in set(ADHESION_LAWS) & set(sheet.headings):
        columns["adhesion"] = Adhesion(law=law, pull_off=(*sheet.numbers(law, order), *(0.0,) * without))
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
        raise _fault(f"the text is not CSV ({error})", "cells separated by commas", file, reader.line_num) from None
    allowed = ", ".join(quantities)
    if len(rows) < 2:
        raise _fault("the table has no headings or no rows", f"a row of headings from {allowed}, then rows", file)
    (line, names), *below = rows
    headings: dict[str, str] = {}
    if not set(names) & (set(quantities) | DERIVED):
        raise _fault("no heading between commas is known", allowed, file, line)
    for name in names:
        quantity = quantities.get(name)
        if quantity is None:
            if name not in DERIVED:
                raise _fault("is unknown", allowed, file, line, name)
            continue
        if quantity in headings or any(quantity in laws and laws & set(headings) for laws in (_LAWS, _ADHESIONS)):
            raise _fault("repeats the quantity of another column", "one of them", file, line, name)
        headings[quantity] = name
    for quantity in needed:
        if quantity not in headings:
            name = next(heading for heading, column in quantities.items() if column == quantity)
            raise _fault("is missing", f"a table with {', '.join([name, *names])}", file, line, name)
    for number, cells in below:
        if len(cells) != len(names):
            raise _fault(f"the row has {len(cells)} cells", f"{len(names)}, one per column", file, number)
    cells_of = [dict(zip(names, cells, strict=True)) for _, cells in below]
    by_quantity = tuple({quantity: cells[name] for quantity, name in headings.items()} for cells in cells_of)
    return _Sheet(file, headings, tuple(number for number, _ in below), by_quantity)


def _fault(problem: str, allowed: str, file: str, line: int | None = None, column: str | None = None) -> SceneError:
    """Return the error for a fault of a table, with its line and column where it has them."""
    where = file if line is None else f"{file}, line {line}"
    return SceneError("" if column is None else f"column {column!r}", problem=problem, allowed=allowed, where=where)


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
    sheet, row, quantity = contacts, None, error.key
    if match := re.fullmatch(
        r"(mass|velocity|stiffness|exponent|gap|damping\.coefficient|adhesion\.pull_off)\[(\d+)\]", error.key
    ):
        quantity, row = match[1], int(match[2])
        if quantity in ("mass", "velocity"):
            sheet = bodies
        else:
            row = [*links, *walls.values()][row]
        if quantity == "damping.coefficient":
            quantity = next(law for law in _LAWS if law in contacts.headings)
        elif quantity == "adhesion.pull_off":
            quantity = next(law for law in _ADHESIONS if law in contacts.headings)
    elif error.key.partition(".")[0] in walls:
        side, _, quantity = error.key.partition(".")
        row = walls[side]
    if row is None or quantity not in sheet.headings:
        return error.at(bodies.file, error.key)
    return error.at(f"{sheet.file}, line {sheet.lines[row]}", sheet.headings[quantity])
