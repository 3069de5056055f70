"""Scenes from CSV: a row per body with its contact to the next, or a table of bodies and one of contacts.

The second form is what ``dem-bridge export --table bodies`` and ``--table contacts`` write. Headings have units. What
no table has (duration, weight, drag, precompression, walls of the first form) comes beside it. Pure: text in, Scene
out; every mistake is named by file, line and column.
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

#: heading -> quantity; of bodies
BODY = {"body": "body", "mass_kg": "mass", "velocity_m_per_s": "velocity"}
#: ... and of contacts
CONTACT = {
    "stiffness_N_per_m^(n-1)": "stiffness",
    "stiffness_SI": "stiffness",
    "exponent": "exponent",
    "gap_m": "gap",
    "damping_N_s_per_m": "dashpot",
    "damping_s": "kuwabara-kono",
}
#: where a table of contacts says which they are
PLACE = {"contact": "contact", "where": "where"}
#: columns of exported tables that follow from the others, from a deck or from a run
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
        *("peak_overlap_m", "peak_overlap_bar_m", "peak_force_N", "peak_force_bar_N", "semi_major_m", "semi_minor_m"),
        "peak_pressure_Pa",
    }
)
_WALLS = ("wall_left", "wall_right")
#: static overlaps in a table are those of a precompression within this part of themselves
_EQUILIBRIUM_WITHIN = 1e-12


@dataclass(frozen=True)
class _Sheet:
    """Cells by quantity, each with its line."""

    file: str
    headings: Mapping[str, str]
    """Quantity -> heading."""
    lines: tuple[int, ...]
    rows: tuple[Mapping[str, str], ...]
    """Quantity -> cell."""

    def error(self, row: int, quantity: str, allowed: str) -> SceneError:
        """What is wrong with a cell."""
        cell, where = self.rows[row][quantity], f"{self.file}, line {self.lines[row]}"
        problem = f"= {cell!r}" if cell else "is empty"
        return SceneError(self.headings[quantity], problem=problem, allowed=allowed, where=where)

    def number(self, row: int, quantity: str) -> float:
        try:
            return float(self.rows[row][quantity])
        except ValueError:
            raise self.error(row, quantity, "a number") from None

    def numbers(self, quantity: str, rows: Sequence[int]) -> list[float]:
        return [self.number(row, quantity) for row in rows]

    def counted(self, quantity: str) -> None:
        """The column, where there is one, says 0, 1, 2, ..."""
        for row in range(len(self.rows)) if quantity in self.headings else ():
            if self.rows[row][quantity] != f"{row}":
                raise self.error(row, quantity, f"{row}: rows in the order of the chain, counted from 0")


def scene_of_csv(
    text: str, *, file: str, contacts: str | None = None, contacts_file: str = "contacts", **parts: Any
) -> Scene:
    """The scene of a table of bodies; ``contacts``: a table of theirs, None where each row has that to the next.

    ``parts``: what else a Scene takes, by its own names. Raises SceneError in one line.
    """
    both = contacts is None
    bodies = _sheet(text, file, {**BODY, **(CONTACT if both else {})}, ("mass", "velocity", *(("stiffness",) * both)))
    every = range(len(bodies.rows))
    bodies.counted("body")
    if contacts is None:
        sheet, links, walls = bodies, list(every[:-1]), dict[str, int]()
        for quantity in set(CONTACT.values()) & set(bodies.headings):
            if bodies.rows[-1][quantity]:
                raise bodies.error(
                    len(bodies.rows) - 1, quantity, "an empty cell: the last body has no next one; a wall comes beside"
                )
    else:
        sheet = _sheet(contacts, contacts_file, {**PLACE, **CONTACT}, ("stiffness",))
        sheet.counted("contact")
        links, walls = _places(sheet)
        if len(links) != len(bodies.rows) - 1:
            problem = f"has {len(links)} contacts of the chain"
            raise SceneError(
                "", problem=problem, allowed=f"{len(bodies.rows) - 1}, for the bodies of {file}", where=contacts_file
            )
    order = [*links, *walls.values()]
    found: dict[str, Any] = {"mass": bodies.numbers("mass", every), "velocity": bodies.numbers("velocity", every)}
    found["stiffness"] = sheet.numbers("stiffness", links)
    for quantity, usual in (("exponent", 2.5), ("gap", 0.0)):
        found[quantity] = sheet.numbers(quantity, links) if quantity in sheet.headings and links else usual
    for side, row in walls.items():
        more = {quantity: sheet.number(row, quantity) for quantity in ("exponent", "gap") if quantity in sheet.headings}
        found[side] = Wall(stiffness=sheet.number(row, "stiffness"), **more)
    for law in ("dashpot", "kuwabara-kono"):
        if law in sheet.headings:
            known = tuple(sheet.numbers(law, order))
            beside = sum(parts.get(side) is not None for side in _WALLS)
            found["damping"] = Damping(law=law, coefficient=(*known, *(0.0,) * beside))
    twice = next((key for key in found if parts.get(key) is not None), None)
    if twice is not None:
        raise SceneError(twice, problem="is in the table and beside it", allowed="one of the two", where=file)
    try:
        return _made({**parts, **found})
    except SceneError as error:
        raise _located(error, bodies, sheet, links, walls) from None


def _made(parts: dict[str, Any]) -> Scene:
    """With precompression, tables have the static overlaps as gaps, which a Scene finds itself."""
    if not parts.get("precompression"):
        return Scene(**parts)
    still = {side: parts[side] for side in _WALLS if parts.get(side) is not None}
    loose = {side: Wall(stiffness=wall.stiffness, exponent=wall.exponent) for side, wall in still.items()}
    scene = Scene(**{**parts, **loose, "gap": 0.0})
    gap = np.array([*np.broadcast_to(parts["gap"], len(scene.stiffness)), *(wall.gap for wall in still.values())])
    if np.any(gap) and not np.allclose(gap, scene.contacts.gap, rtol=_EQUILIBRIUM_WITHIN, atol=0.0):
        return Scene(**parts)  # which says what is wrong with gaps
    return scene


def _sheet(text: str, file: str, known: Mapping[str, str], needed: Sequence[str]) -> _Sheet:
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
            "", problem=f"is no CSV ({error})", allowed="cells with commas between them", where=where
        ) from None
    allowed = ", ".join(known)
    if len(rows) < 2:
        raise SceneError("", problem="has no rows under headings", allowed=f"the columns {allowed}", where=file)
    (line, names), *below = rows
    at = f"{file}, line {line}"
    for name in names:
        if name not in known and name not in DERIVED:
            raise SceneError(f"column {name!r}", problem="is unknown", allowed=allowed, where=at)
    headings: dict[str, str] = {}
    for name in (name for name in names if name in known):
        if known[name] in headings or (
            known[name] in ("dashpot", "kuwabara-kono") and {*headings} & {"dashpot", "kuwabara-kono"}
        ):
            raise SceneError(
                f"column {name!r}", problem="says again what another says", allowed="one of them", where=at
            )
        headings[known[name]] = name
    for quantity in needed:
        if quantity not in headings:
            name = next(name for name, one in known.items() if one == quantity)
            raise SceneError(
                f"column {name!r}", problem="is missing", allowed=f"needed beside {', '.join(names)}", where=at
            )
    for number, cells in below:
        if len(cells) != len(names):
            where = f"{file}, line {number}"
            raise SceneError(
                "", problem=f"has {len(cells)} cells", allowed=f"{len(names)}, one per column", where=where
            )
    cells_of = [dict(zip(names, cells, strict=True)) for _, cells in below]
    return _Sheet(
        file,
        headings,
        tuple(number for number, _ in below),
        tuple({quantity: cells[name] for quantity, name in headings.items()} for cells in cells_of),
    )


def _places(sheet: _Sheet) -> tuple[list[int], dict[str, int]]:
    """Rows of the chain's contacts, and those of walls, which stand behind them."""
    links: list[int] = []
    walls: dict[str, int] = {}
    for row in range(len(sheet.rows)):
        where = sheet.rows[row]["where"] if "where" in sheet.headings else "chain"
        if where == "chain" and not walls:
            links.append(row)
        elif where in _WALLS and where not in walls and (where == "wall_left" or row == len(sheet.rows) - 1):
            walls[where] = row
        else:
            raise sheet.error(row, "where", "chain, then wall_left and wall_right, each once")
    return links, walls


def _located(
    error: SceneError, bodies: _Sheet, contacts: _Sheet, links: list[int], walls: dict[str, int]
) -> SceneError:
    """What a Scene says of its numbers, said of the cell."""
    found = re.fullmatch(r"(mass|velocity|stiffness|exponent|gap|damping\.coefficient)\[(\d+)\]", error.key)
    if found is not None:
        quantity, nth = found[1], int(found[2])
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
