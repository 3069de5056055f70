"""Units of columns: the units that are understood in a file, with their SI values, and how units are written.

The data are in ``units.json``.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dem_bridge.errors import UsageError

_DATA: Mapping[str, Any] = json.loads(Path(__file__).with_name("units.json").read_text(encoding="utf-8"))


@dataclass(frozen=True)
class UnitStyle:
    """Hold the SI values of the units of a unit style: m, s, m/s, N, kg."""

    length: float
    time: float
    velocity: float
    force: float
    mass: float


#: the unit styles of LAMMPS (manual, command units), and "ase": Å, eV, u and the unit of time that follows; CODATA 2018
STYLES: Mapping[str, UnitStyle] = {style: UnitStyle(**values) for style, values in _DATA["unit_styles"].items()}


def _velocities() -> dict[str, float]:
    """Return the SI values of units of velocity: each unit of length over each unit of time, in many spellings."""
    spellings = ("{}/{}", "{}_per_{}", "{} per {}", "{}_{}", "{} {}-1", "{} {}^-1", "{}*{}^-1", "{}.{}-1", "{}{}-1")
    lengths, times = _DATA["values"]["m"].items(), _DATA["values"]["s"].items()
    rates = {spelling.format(m, s): a / b for spelling in spellings for m, a in lengths for s, b in times}
    return rates | {"m/s": 1.0, "mps": 1.0}


#: units that are read with their SI values, by the SI unit
VALUES: Mapping[str, Mapping[str, float]] = _DATA["values"] | {"m/s": _velocities()}


def value_of(unit: str, quantity: str, si_unit: str) -> float:
    """Return the SI value of a unit of a quantity that has a SI unit; raise UsageError for an unknown unit.

    >>> value_of("mm/s", "velocity", "m/s")
    0.001
    """
    text = unit.strip().strip("()").replace("**", "^")
    if text not in VALUES[si_unit]:
        usual = ("m/s", "mm/s", "cm/s", "um/s") if si_unit == "m/s" else tuple(VALUES[si_unit])
        raise UsageError(f"the unit {unit!r} of {quantity} is unknown; allowed: {', '.join(usual)}")
    return VALUES[si_unit][text]


@dataclass(frozen=True)
class Unit:
    """Hold the spellings of a unit in plain text, in LaTeX and at the end of a column's name."""

    text: str
    tex: str
    """Macros of siunitx, or LaTeX text with commands of its own."""
    suffix: str
    prefixed: bool = False
    """True if the unit takes SI prefixes such as µ and G."""


#: units that are written by their names in the code; some depend on the row of the table
UNITS: Mapping[str, Unit] = {name: Unit(**{"text": name, **entry}) for name, entry in _DATA["spellings"].items()}
#: powers of ten, their SI prefix and its macro in siunitx
PREFIXES: Mapping[int, tuple[str, str]] = {
    int(power): (sign, macro) for power, (sign, macro) in _DATA["prefixes"].items()
}
_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def unit_of(text: str) -> Unit:
    """Return how a unit is written; one that is not in :data:`UNITS` is written as it stands.

    >>> unit_of("kg/m").suffix
    'kg_per_m'
    """
    suffix = re.sub(r"\W+", "_", text.replace("/", " per ")).strip("_")
    return UNITS.get(text, Unit(text, rf"\text{{{text}}}", suffix))


def with_power(unit: str, power: int) -> tuple[str, str]:
    """Return the unit in plain text and in LaTeX, with a power of ten in front."""
    style = unit_of(unit)
    macros = not re.search(r"\$|\\si", style.tex)
    if power == 0:
        return style.text, f"\\si{{{style.tex}}}" if macros and style.tex else style.tex
    if unit == "kg" and power + 3 in PREFIXES:
        sign, macro = PREFIXES[power + 3]
        return f"{sign}g", f"\\si{{{macro}\\gram}}"
    if style.prefixed:
        sign, macro = PREFIXES[power]
        return f"{sign}{style.text}", f"\\si{{{macro}{style.tex}}}"
    tex = f"\\si{{{style.tex}}}" if macros else style.tex
    return f"10{str(power).translate(_SUPERSCRIPT)} {style.text}".rstrip(), f"$10^{{{power}}}$ {tex}".rstrip()
