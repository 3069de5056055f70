"""A table as text: every digit for machines; for people units in the headings and the digits that bars leave."""

from __future__ import annotations

import io
import json
import math
import re
from collections.abc import Callable, Mapping
from decimal import Decimal
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

from dem_bridge.errors import UsageError
from dem_bridge.exports.table import UNITS, Cell, Column, Table
from dem_bridge.version import __version__

#: significant digits for people, at most
MOST_DIGITS = 6
#: largest over smallest number of a column that is written without powers of ten in its cells
_SPREAD = 1e4
#: powers of ten with a name, and its macro in siunitx
_PREFIXES = {
    -12: ("p", r"\pico"), -9: ("n", r"\nano"), -6: ("µ", r"\micro"), -3: ("m", r"\milli"), 0: ("", ""),
    3: ("k", r"\kilo"), 6: ("M", r"\mega"), 9: ("G", r"\giga"), 12: ("T", r"\tera"),
}  # fmt: skip
_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_TEX = {
    **{sign: f"\\{sign}" for sign in "&%$#_{}"},
    "\\": r"\textbackslash{}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "<": r"\textless{}",
    ">": r"\textgreater{}",
    "|": r"\textbar{}",
}


def format_for(name: str | None, path: Path | None, table: str) -> str:
    """The format that is named, else that of the file's ending; UsageError where there is none, or none such."""
    if name is None:
        if path is None:
            raise UsageError(f"format = None and no file to tell it; allowed: {', '.join(FORMATS)}")
        if path.suffix not in SUFFIXES:
            raise UsageError(
                f"{path}: {path.suffix!r} tells no format; allowed: {', '.join(SUFFIXES)}, or name a format"
            )
        name = SUFFIXES[path.suffix]
    if name not in FORMATS:
        raise UsageError(f"format = {name!r}; allowed: {', '.join(FORMATS)}")
    if name == "lammps" and table != "pair-coeffs":
        raise UsageError(f"format = 'lammps' of table {table!r}; allowed: table 'pair-coeffs', or another format")
    return name


def written(table: Table, name: str) -> str | bytes:
    """The table in one of :data:`FORMATS`."""
    return FORMATS[name](table)


def as_csv(table: Table) -> str:
    """Names of columns, then numbers as Python writes them: they read back as the same; empty where unknown."""
    return str(table.to_pandas().to_csv(index=False, lineterminator="\n"))


def as_json(table: Table) -> str:
    """Of schema :data:`~dem_bridge.exports.table.SCHEMA`; null where unknown."""
    return json.dumps(table.as_json(), indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def as_parquet(table: Table) -> bytes:
    """By pandas and pyarrow; units, notes and provenance in the ``attrs`` that pandas reads back."""
    file = io.BytesIO()
    try:
        table.to_pandas().to_parquet(file, engine="pyarrow", index=False)
    except ImportError as error:
        raise UsageError(
            "format = 'parquet' needs pyarrow, which is not installed; install dem-bridge[parquet], or take csv"
        ) from error
    return file.getvalue()


def as_include(table: Table) -> str:
    """Commands for LAMMPS."""
    if table.include is None:
        raise UsageError(f"table {table.id!r} is none that LAMMPS reads; allowed: 'pair-coeffs' with all its columns")
    return table.include


class _Shown(NamedTuple):
    """A column for people."""

    text: str
    """Heading in plain text."""
    tex: str
    cells: tuple[str | None, ...]
    words: bool


def shown(table: Table) -> tuple[_Shown, ...]:
    """Columns in which anything is known, rounded, each in a unit that suits its numbers."""
    known = [one for one in table.columns if not one.values or any(cell is not None for cell in one.values)]
    return tuple(_shown(one) for one in known)


def _shown(column: Column) -> _Shown:
    if column.kind != "number":
        cells = tuple(None if cell is None else str(cell) for cell in column.values)
        return _Shown(column.heading, _escaped(column.heading), cells, column.kind == "text")
    power, scientific = _scale(column)
    bars = column.bars or (None,) * len(column.values)
    rounded = [
        None if value is None else Decimal(f"{float(value):.{_digits(value, bar, column.digits) - 1}e}")
        for value, bar in zip(column.values, bars, strict=True)
    ]
    if all(one is None or one == Decimal(repr(value)) for one, value in zip(rounded, column.values, strict=True)):
        rounded = [None if one is None else one.normalize() for one in rounded]  # nothing was rounded
    cells = tuple(None if one is None else _number(one, power, scientific) for one in rounded)
    text, tex = _unit(column.unit, power)
    heading = column.heading
    return _Shown(
        f"{heading} ({text})" if text else heading,
        f"{_escaped(heading)} ({tex})" if tex else _escaped(heading),
        cells,
        words=False,
    )


def _scale(column: Column) -> tuple[int, bool]:
    """Power of ten that goes into the heading, and whether cells have their own."""
    sizes = [abs(float(cell)) for cell in column.values if cell is not None and float(cell) != 0.0]
    if not sizes:
        return 0, False
    smallest, middle, largest = min(sizes), sorted(sizes)[len(sizes) // 2], max(sizes)
    unit = UNITS[column.unit]
    # an angle stays one, and a ratio
    fixed = column.unit in ("", "deg", "1/deg")
    plain = 1e-3 <= largest < 1e6
    if largest / smallest > _SPREAD or (fixed and not plain):
        return 0, True
    if fixed or (plain and not unit.prefixed and column.unit != "kg"):
        return 0, False
    power = 3 * math.floor(math.log10(middle) / 3.0)  # so that alike columns have the same
    return (power, False) if power in _PREFIXES or not unit.prefixed else (0, True)


def _unit(unit: str, power: int) -> tuple[str, str]:
    """In plain text and in LaTeX, with a power of ten in front."""
    one = UNITS[unit]
    macros = not re.search(r"\$|\\si", one.tex)
    if power == 0:
        return one.text, f"\\si{{{one.tex}}}" if macros and one.tex else one.tex
    if unit == "kg" and power + 3 in _PREFIXES:
        sign, macro = _PREFIXES[power + 3]
        return f"{sign}g", f"\\si{{{macro}\\gram}}"
    if one.prefixed:
        sign, macro = _PREFIXES[power]
        return f"{sign}{one.text}", f"\\si{{{macro}{one.tex}}}"
    tex = f"\\si{{{one.tex}}}" if macros else one.tex
    return f"10{str(power).translate(_SUPERSCRIPT)} {one.text}".rstrip(), f"$10^{{{power}}}$ {tex}".rstrip()


def _digits(value: float | int | str, bar: Cell, otherwise: int) -> int:
    """Significant digits: down to the first of the error bar, where there is one, and :data:`MOST_DIGITS` at most.

    >>> _digits(123.456, 0.02, 5), _digits(123.456, 1e-9, 5), _digits(123.456, None, 5), _digits(1.0, 3.0, 5)
    (5, 6, 5, 1)
    """
    if not bar or not value:
        return otherwise
    of_bar = Decimal(f"{float(bar):.0e}").adjusted()
    return min(max(Decimal(repr(float(value))).adjusted() - of_bar + 1, 1), MOST_DIGITS)


def _number(value: Decimal, power: int, scientific: bool) -> str:
    """
    >>> _number(Decimal("7.2730e10"), 9, False), _number(Decimal("1.2e-13"), 0, True), _number(Decimal("0e4"), 0, False)
    ('72.730', '1.2e-13', '0')
    """
    if value == 0:
        return "0"
    if scientific:
        return f"{value.scaleb(-value.adjusted())}e{value.adjusted()}"
    return format(value.scaleb(-power), "f")


def as_markdown(table: Table) -> str:
    """A heading, a pipe table, the notes."""
    columns = shown(table)

    def line(cells: list[str]) -> str:
        return f"| {' | '.join(cells)} |"

    def cell(text: str | None) -> str:
        return "–" if text is None else re.sub(r"([\\|<>*_`])", r"\\\1", text)

    lines = [
        f"### {cell(table.title)}",
        "",
        line([cell(one.text) for one in columns]),
        line(["---" if one.words else "---:" for one in columns]),
        *(line([cell(text) for text in row]) for row in zip(*(one.cells for one in columns), strict=True)),
    ]
    if table.notes:
        lines += ["", *(f"* {cell(note)}" for note in table.notes)]
    return "\n".join(lines) + "\n"


def as_tex(table: Table) -> str:
    r"""A ``tabular`` with booktabs' rules and siunitx' S columns, for a ``table`` of one's own; notes as comments."""
    columns = shown(table)

    def cell(one: _Shown, text: str | None) -> str:
        if one.words:
            return "--" if text is None else _escaped(text)
        return "{--}" if text is None else text

    body = [
        " & ".join(cell(one, text) for one, text in zip(columns, row, strict=True)) + r" \\"
        for row in zip(*(one.cells for one in columns), strict=True)
    ]
    lines = [
        f"% {table.title}, written by dem_bridge {__version__}",
        r"% needs \usepackage{booktabs} and \usepackage{siunitx}",
        *(f"% {note}" for note in table.notes),
        r"\begin{tabular}{",
        *(f"  {_column_type(one)}" for one in columns),
        "}",
        r"\toprule",
        " & ".join(one.tex if one.words else f"{{{one.tex}}}" for one in columns) + r" \\",
        r"\midrule",
        *body,
        r"\bottomrule",
        r"\end{tabular}",
    ]
    return "\n".join(lines) + "\n"


def _column_type(column: _Shown) -> str:
    """``l`` for words; for numbers ``S`` with room for the longest whole, decimal and exponent parts."""
    if column.words:
        return "l"
    parts = [re.fullmatch(r"(-?\d+)\.?(\d*)(?:e(-?\d+))?", text) for text in column.cells if text is not None]
    found = [part.groups(default="") for part in parts if part is not None] or [("0", "", "")]
    whole, decimals, exponent = (max((one[nth].lstrip("-") for one in found), key=len) for nth in range(3))
    minus, below = ("-" * any(one[nth].startswith("-") for one in found) for nth in (0, 2))
    power = f"e{below}{len(exponent)}" if exponent else ""
    return f"S[table-format={minus}{len(whole)}.{len(decimals)}{power}]"


def _escaped(text: str) -> str:
    """Plain text for LaTeX.

    >>> print(_escaped("100 % of a_b & {c}"))
    100 \\% of a\\_b \\& \\{c\\}
    """
    return "".join(_TEX.get(sign, sign) for sign in text)


FORMATS: Mapping[str, Callable[[Table], str | bytes]] = MappingProxyType(
    {
        "csv": as_csv,
        "json": as_json,
        "md": as_markdown,
        "tex": as_tex,
        "parquet": as_parquet,
        "lammps": as_include,
    }
)
#: ending of a file -> format
SUFFIXES: Mapping[str, str] = MappingProxyType(
    {f".{name}": name for name in FORMATS} | {".markdown": "md", ".lmp": "lammps", ".inc": "lammps"}
)
