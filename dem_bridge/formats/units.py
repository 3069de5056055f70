"""Units of columns: the units that are understood in a file, with their SI values, and how units are written."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

from dem_bridge.errors import UsageError

#: units of a quantity with their SI values, by the SI unit, in all spellings
_SPELLINGS: Mapping[str, Mapping[str, float]] = {
    "s": {
        "s": 1.0, "sec": 1.0, "second": 1.0, "seconds": 1.0, "ms": 0.001, "msec": 0.001, "millisecond": 0.001,
        "milliseconds": 0.001, "us": 1e-06, "µs": 1e-06, "μs": 1e-06, "usec": 1e-06, "microsecond": 1e-06,
        "microseconds": 1e-06, "ns": 1e-09, "nanosecond": 1e-09, "nanoseconds": 1e-09, "ps": 1e-12,
        "picosecond": 1e-12, "picoseconds": 1e-12, "fs": 1e-15, "femtosecond": 1e-15, "femtoseconds": 1e-15,
        "min": 60.0,
    },
    "m": {
        "m": 1.0, "meter": 1.0, "meters": 1.0, "metre": 1.0, "metres": 1.0, "cm": 0.01, "mm": 0.001,
        "millimeter": 0.001, "millimetre": 0.001, "um": 1e-06, "µm": 1e-06, "μm": 1e-06, "micron": 1e-06,
        "microns": 1e-06, "micrometer": 1e-06, "micrometre": 1e-06, "nm": 1e-09, "nanometer": 1e-09,
        "nanometre": 1e-09, "pm": 1e-12, "angstrom": 1e-10, "Angstrom": 1e-10, "Å": 1e-10, "km": 1000.0,
    },
    "N": {
        "N": 1.0, "newton": 1.0, "newtons": 1.0, "Newton": 1.0, "kN": 1000.0, "MN": 1000000.0, "mN": 0.001,
        "uN": 1e-06, "µN": 1e-06, "nN": 1e-09, "dyn": 1e-05, "dyne": 1e-05,
    },
    "kg": {"kg": 1.0, "g": 0.001, "mg": 1e-06, "u": 1.6605390666e-27, "amu": 1.6605390666e-27},
}  # fmt: skip


@dataclass(frozen=True)
class UnitStyle:
    """Hold the SI values of the units of a unit style: m, s, m/s, N, kg."""

    length: float
    time: float
    velocity: float
    force: float
    mass: float


#: the unit styles of LAMMPS (manual, command units), and "ase": Å, eV, u and the unit of time that follows; CODATA 2018
STYLES: Mapping[str, UnitStyle] = {
    "si": UnitStyle(length=1.0, time=1.0, velocity=1.0, force=1.0, mass=1.0),
    "cgs": UnitStyle(length=0.01, time=1.0, velocity=0.01, force=1e-05, mass=0.001),
    "micro": UnitStyle(length=1e-06, time=1e-06, velocity=1.0, force=1e-09, mass=1e-15),
    "nano": UnitStyle(length=1e-09, time=1e-09, velocity=1.0, force=1e-12, mass=1e-21),
    "metal": UnitStyle(length=1e-10, time=1e-12, velocity=100.0, force=1.6021766339999998e-09, mass=1.6605390666e-27),
    "real": UnitStyle(length=1e-10, time=1e-15, velocity=100000.0, force=6.947695457055374e-11, mass=1.6605390666e-27),
    "ase": UnitStyle(
        length=1e-10,
        time=1.0180505710759415e-14,
        velocity=9822.694750253277,
        force=1.6021766339999998e-09,
        mass=1.6605390666e-27,
    ),
}


def _velocities() -> dict[str, float]:
    """Return the SI values of units of velocity: each unit of length over each unit of time, in many spellings."""
    spellings = ("{}/{}", "{}_per_{}", "{} per {}", "{}_{}", "{} {}-1", "{} {}^-1", "{}*{}^-1", "{}.{}-1", "{}{}-1")
    lengths, times = _SPELLINGS["m"].items(), _SPELLINGS["s"].items()
    rates = {spelling.format(m, s): a / b for spelling in spellings for m, a in lengths for s, b in times}
    return rates | {"m/s": 1.0, "mps": 1.0}


#: units that are read with their SI values, by the SI unit
VALUES: Mapping[str, Mapping[str, float]] = {**_SPELLINGS, "m/s": _velocities()}


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
UNITS: Mapping[str, Unit] = {
    "": Unit("", "", ""),
    "N": Unit("N", "\\newton", "N", prefixed=True),
    "m": Unit("m", "\\metre", "m", prefixed=True),
    "s": Unit("s", "\\second", "s", prefixed=True),
    "Pa": Unit("Pa", "\\pascal", "Pa", prefixed=True),
    "kg": Unit("kg", "\\kilogram", "kg"),
    "deg": Unit("°", "\\degree", "deg"),
    "1/deg": Unit("1/°", "\\per\\degree", "per_deg"),
    "N s/m": Unit("N s/m", "\\newton\\second\\per\\metre", "N_s_per_m"),
    "1/s": Unit("1/s", "\\per\\second", "per_s"),
    "m/s": Unit("m/s", "\\metre\\per\\second", "m_per_s"),
    "kg m/s": Unit("kg m/s", "\\kilogram\\metre\\per\\second", "kg_m_per_s"),
    "J": Unit("J", "\\joule", "J", prefixed=True),
    "kg/m^3": Unit("kg/m³", "\\kilogram\\per\\cubic\\metre", "kg_per_m3"),
    "N/m^1.5": Unit("N/m^1.5", "\\newton\\per\\metre\\tothe{1.5}", "N_per_m1_5"),
    "N/m^(n-1)": Unit("N/m^(n-1)", "$\\mathrm{N}/\\mathrm{m}^{n-1}$", "SI"),
    "N/m^2": Unit("N/m²", "\\newton\\per\\square\\metre", "SI"),
    "N/m": Unit("N/m", "\\newton\\per\\metre", "SI"),
    "N/m^2 or N/m": Unit(
        "N/m², of hooke N/m", "\\si{\\newton\\per\\square\\metre}, of hooke \\si{\\newton\\per\\metre}", "SI"
    ),
}
#: powers of ten, their SI prefix and its macro in siunitx
PREFIXES: Mapping[int, tuple[str, str]] = {
    -12: ("p", "\\pico"),
    -9: ("n", "\\nano"),
    -6: ("µ", "\\micro"),
    -3: ("m", "\\milli"),
    0: ("", ""),
    3: ("k", "\\kilo"),
    6: ("M", "\\mega"),
    9: ("G", "\\giga"),
    12: ("T", "\\tera"),
}  # fmt: skip
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
