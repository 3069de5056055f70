"""Recognise the headings of columns and the names of arrays: quantity, body, unit and axis.

A heading has a name (``v``, ``velocity``, ``vx``), and may have an index
(``v_3``, ``v[3]``, ``body 3 velocity``) and a unit (``v_3_m_per_s``, ``velocity 3 [mm/s]``, ``t/ms``).
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from dem_bridge.formats.units import VALUES, value_of

#: names of each quantity; and what stands before the letter of an axis
NAMES: Mapping[str, tuple[str, ...]] = {
    "time": ("time", "times", "t", "sim_time", "simtime", "simulation_time"),
    "step": ("step", "steps", "timestep", "time_step", "iter", "iteration", "i"),
    "body": (
        "body", "bodies", "body_id", "bead", "grain", "sphere", "ball", "particle", "particle_id", "atom", "atom_id",
        "id", "ids", "node", "contact", "contacts",
    ),
    "velocity": ("velocity", "velocities", "vel", "v"),
    "displacement": ("displacement", "displacements", "disp", "displ", "u"),
    "position": (
        "position", "positions", "pos", "coordinate", "coordinates", "coord", "coords", "x", "y", "z", "xu", "yu",
        "zu",
    ),
    "contact_force": ("contact_force", "contact_forces", "force_contact", "normal_force", "fn", "fc"),
    "force_left": ("force_left",),
    "force_right": ("force_right",),
    "force": ("force", "forces", "net_force", "f"),
    "mass": ("mass", "masses", "m"),
    "radius": ("radius", "radii", "r"),
    "diameter": ("diameter", "diameters", "d"),
}  # fmt: skip
_STEMS: Mapping[str, tuple[str, ...]] = {
    "velocity": ("velocity_", "vel_", "vel", "v_", "v", "u_dot_"),
    "displacement": ("displacement_", "disp_", "displ_", "u_", "u"),
    "position": ("position_", "pos_", "coord_"),
    "force": ("force_", "f_", "f"),
}  # fmt: skip
#: SI unit of each quantity
DIMENSIONS: Mapping[str, str] = {
    "time": "s", "velocity": "m/s", "displacement": "m", "position": "m", "contact_force": "N", "force_left": "N",
    "force_right": "N", "force": "N", "mass": "kg", "radius": "m", "diameter": "m",
}  # fmt: skip


def _names() -> Iterator[tuple[str, tuple[str, int | None]]]:
    """Yield the names of quantities, each with the quantity and the axis (0, 1, 2 or None)."""
    for quantity, names in NAMES.items():
        for name in names:
            letter = name[0] if quantity == "position" and name.rstrip("u") in ("x", "y", "z") else ""
            yield name, (quantity, "xyz".index(letter) if letter else None)
    for quantity, stems in _STEMS.items():
        for stem in stems:
            yield from ((f"{stem}{axis}", (quantity, k)) for k, axis in enumerate("xyz"))


#: quantity and axis by the name without separators
_NAMES: Mapping[str, tuple[str, int | None]] = {name.replace("_", ""): meaning for name, meaning in _names()}
_OF_NAMES = "|".join(
    re.escape(name).replace("_", r"[_\s.-]?") for name in sorted(dict(_names()), key=lambda name: (-len(name), name))
)
_GAP = r"[\s_.:-]*"
_BODY = r"(?i:body|bead|particle|atom|grain|sphere|ball|node|mass|contact|p|b)s?"
_INDEX = r"(?:[\[(#]\s*(?P<{0}>\d+)\s*[\])]?|(?P<{0}_>\d+))"
_UNIT = r"(?:\s*_?[\[(]\s*(?P<bracket>[^\])\d]*(?:[^\])\d][^\])]*)?)\s*[\])]|[\s_./:-]+(?P<plain>[^\s_\d].*?))?"
_HEADING = re.compile(
    rf"(?:{_BODY}{_GAP}{_INDEX.format('before')}{_GAP})?(?P<name>(?i:{_OF_NAMES}))"
    rf"(?:{_GAP}(?:(?:of{_GAP})?{_BODY}{_GAP})?{_INDEX.format('after')})?{_UNIT}(?:{_GAP}{_INDEX.format('last')})?"
)


#: most characters of a heading
_LONGEST = 80


@dataclass(frozen=True)
class Heading:
    """Hold the meaning of a heading."""

    quantity: str
    index: int | None
    """Index in the heading as it is written; None if there is none."""
    unit: str | None
    """Unit in the heading; None if there is none."""
    axis: int | None
    """Axis in the heading: 0, 1 or 2; None if there is none."""

    @property
    def scale(self) -> float:
        """Return the SI value of the unit; a heading without a unit is in SI units."""
        return scale_of(self.quantity, self.unit)


def scale_of(quantity: str, unit: str | None) -> float:
    """Return the SI value of a unit of a quantity, 1 for None; raise UsageError for an unknown unit."""
    return 1.0 if unit is None or quantity not in DIMENSIONS else value_of(unit, quantity, DIMENSIONS[quantity])


def heading_of(text: str) -> Heading | None:
    """Return the meaning of a heading, or None if its name is unknown; raise UsageError for an unknown unit.

    >>> heading_of("velocity_3_mm_per_s")
    Heading(quantity='velocity', index=3, unit='mm_per_s', axis=None)
    >>> heading_of("vx[7]"), heading_of("t / ms").scale, heading_of("energy")
    (Heading(quantity='velocity', index=7, unit=None, axis=0), 0.001, None)
    """
    text = text.strip().strip("\"'#").strip()
    return _meaning(text) or (_meaning(text[2:]) if re.match("[vcf]_", text) else None)  # v_vx3: a variable of LAMMPS


def _meaning(text: str) -> Heading | None:
    """Return the meaning of a heading without quotes."""
    match = _HEADING.fullmatch(text) if len(text) <= _LONGEST else None
    if match is None:
        return None
    quantity, axis = _NAMES.get(re.sub(r"[_\s.-]", "", match["name"].lower()), ("", None))
    if not quantity:  # a letter such as the long s, which counts as an s in the pattern alone
        return None
    index = next((match[key] for key in ("before", "before_", "after", "after_", "last", "last_") if match[key]), None)
    unit = match["bracket"] or match["plain"]
    of_contact = re.match("contact", text, re.IGNORECASE) and (index is not None or unit)
    if of_contact and quantity in ("force", "body"):
        quantity = "contact_force"
    if match["plain"] and match["plain"].strip("()") not in VALUES.get(DIMENSIONS.get(quantity, ""), ()):
        return None
    heading = Heading(quantity, None if index is None else int(index), (unit or "").strip() or None, axis)
    _ = heading.scale
    return heading
