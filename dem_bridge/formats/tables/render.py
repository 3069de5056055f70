"""Write a table as text.

CSV, JSON and parquet keep every digit. Markdown and LaTeX have units in the headings and show the digits that are
significant within the uncertainty.
"""

from __future__ import annotations

import io
import json
import math
import re
from collections.abc import Callable, Mapping
from decimal import Decimal
from pathlib import Path
from string import Template
from types import MappingProxyType
from typing import NamedTuple

from dem_bridge.errors import UsageError
from dem_bridge.formats.tables.constants.c_header import as_c_header
from dem_bridge.formats.tables.table import Cell, Column, Table
from dem_bridge.formats.units import PREFIXES, unit_of, with_power
from dem_bridge.version import __version__

#: the one table of a format that not every table has
_ONLY = {"lammps": "pair-coeffs", "c": "constants"}
#: largest number of significant digits in Markdown and LaTeX
MOST_DIGITS = 6
#: largest ratio of two numbers in a column whose cells have no powers of ten of their own
_SPREAD = 1e4
_TEX = str.maketrans(
    {sign: rf"\{sign}" for sign in "&%$#_{}"}
    | {"\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}"}
    | {"<": r"\textless{}", ">": r"\textgreater{}", "|": r"\textbar{}"}
)


def format_for(name: str | None, path: Path | None, table: str) -> str:
    """Return the format ``name``, or without a name the format of the file's ending.

    Raises UsageError if there is neither a name nor a file, or the format is unknown or does not fit the table.
    """
    if name is None:
        if path is None:
            raise UsageError(f"neither a format nor a file was given; allowed formats: {', '.join(FORMATS)}")
        if path.suffix not in SUFFIXES:
            raise UsageError(
                f"{path}: no format has the file ending {path.suffix!r}; allowed: {', '.join(SUFFIXES)}, or give the"
                " format by name"
            )
        name = SUFFIXES[path.suffix]
    if name not in FORMATS:
        raise UsageError(f"format = {name!r} is unknown; allowed: {', '.join(FORMATS)}")
    if (only := _ONLY.get(name, table)) != table:
        raise UsageError(
            f"table {table!r} cannot be written in the format {name!r}; allowed: table {only!r}, or another format"
        )
    return name


def render(table: Table, name: str) -> str | bytes:
    """Return the table in the format ``name`` of :data:`FORMATS`."""
    return FORMATS[name](table)


def as_csv(table: Table) -> str:
    """Return the table as CSV with all digits of each number; an unknown cell is empty."""
    return str(table.to_pandas().to_csv(index=False, lineterminator="\n"))


def as_json(table: Table) -> str:
    """Return the table as JSON of its schema (``table.SCHEMA``); an unknown cell is null."""
    return json.dumps(table.as_json(), indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def as_yaml(table: Table) -> str:
    """Return the table as YAML with the keys of its JSON and a line for each row, the same to YAML 1.1 and 1.2."""
    lines = []
    for key, value in table.as_json().items():
        if isinstance(value, list):
            lines += [f"{key}:", *(f"- {_flow(entry)}" for entry in value)]
        else:
            lines.append(f"{key}: {_flow(value)}")
    return "\n".join(lines) + "\n"


def _flow(value: object) -> str:
    """Return a JSON value as YAML in one line.

    A number has a point also before an exponent: YAML 1.1 takes 1e-08 for a text.

    >>> print(_flow({"name": "a: b", "value": 1e-08, "rest": [None, 2]}))
    {"name": "a: b", "value": 1.0e-08, "rest": [null, 2]}
    """
    if isinstance(value, Mapping):
        return f"{{{', '.join(f'{_flow(key)}: {_flow(part)}' for key, part in value.items())}}}"
    if isinstance(value, list):
        return f"[{', '.join(map(_flow, value))}]"
    text = json.dumps(value, ensure_ascii=False, allow_nan=False)
    return text.replace("e", ".0e") if isinstance(value, float) and "." not in text else text


def as_parquet(table: Table) -> bytes:
    """Return the table as parquet; units, notes and provenance are in the ``attrs`` that pandas reads back."""
    file = io.BytesIO()
    try:
        table.to_pandas().to_parquet(file, engine="pyarrow", index=False)
    except ImportError as error:
        raise UsageError(
            "format = 'parquet' needs pyarrow, which is not installed; install dem-bridge[parquet], or use format csv"
        ) from error
    return file.getvalue()


def as_include(table: Table) -> str:
    """Return the table as commands that LAMMPS reads by ``include``."""
    if table.include is None:
        raise UsageError(
            f"LAMMPS cannot read table {table.id!r} with these columns; allowed: 'pair-coeffs' with all its columns"
        )
    return table.include


class _Rounded(NamedTuple):
    """Hold a column as Markdown and LaTeX show it."""

    text: str
    """Heading in plain text."""
    tex: str
    """Heading in LaTeX."""
    cells: tuple[str | None, ...]
    words: bool
    """True for text, False for numbers."""


def rounded_columns(table: Table) -> tuple[_Rounded, ...]:
    """Return the columns that are not empty, rounded, each in a unit that suits its numbers."""
    filled = [
        column for column in table.columns if not column.values or any(cell is not None for cell in column.values)
    ]
    return tuple(_rounded(column) for column in filled)


def _rounded(column: Column) -> _Rounded:
    """Return the column with rounded numbers and its unit in the heading."""
    if column.kind != "number":
        cells = tuple(None if cell is None else str(cell) for cell in column.values)
        return _Rounded(column.heading, _escaped(column.heading), cells, column.kind == "text")
    power, scientific = _scale(column)
    uncertainties = column.uncertainties or (None,) * len(column.values)
    rounded = [
        None if value is None else Decimal(f"{float(value):.{_digits(value, uncertainty, column.digits) - 1}e}")
        for value, uncertainty in zip(column.values, uncertainties, strict=True)
    ]
    exact = [None if value is None else Decimal(repr(value)) for value in column.values]
    if rounded == exact:
        rounded = [None if number is None else number.normalize() for number in rounded]
    cells = tuple(None if number is None else _number(number, power, scientific) for number in rounded)
    text, tex = with_power(column.unit, power)
    heading = column.heading
    return _Rounded(
        f"{heading} ({text})" if text else heading,
        f"{_escaped(heading)} ({tex})" if tex else _escaped(heading),
        cells,
        words=False,
    )


def _scale(column: Column) -> tuple[int, bool]:
    """Return the power of ten in the heading, and True if cells have powers of their own."""
    sizes = [abs(float(cell)) for cell in column.values if cell is not None and float(cell) != 0.0]
    if not sizes:
        return 0, False
    smallest, middle, largest = min(sizes), sorted(sizes)[len(sizes) // 2], max(sizes)
    unit = unit_of(column.unit)
    # angles and ratios get no prefix
    fixed = column.unit in ("", "deg", "1/deg")
    plain = 1e-3 <= largest < 1e6
    if largest / smallest > _SPREAD or (fixed and not plain):
        return 0, True
    if fixed or (plain and not unit.prefixed and column.unit != "kg"):
        return 0, False
    power = 3 * math.floor(math.log10(middle) / 3.0)  # by the median, so that similar columns have the same unit
    return (power, False) if power in PREFIXES or not unit.prefixed else (0, True)


def _digits(value: float | int | str, uncertainty: Cell, default: int) -> int:
    """Return the number of significant digits, at most :data:`MOST_DIGITS`.

    The last digit is at the first digit of the uncertainty; without an uncertainty there are ``default`` digits.

    >>> _digits(123.456, 0.02, 5), _digits(123.456, 1e-9, 5), _digits(123.456, None, 5), _digits(1.0, 3.0, 5)
    (5, 6, 5, 1)
    """
    if not uncertainty or not value:
        return default
    first_uncertain = Decimal(f"{float(uncertainty):.0e}").adjusted()
    return min(max(Decimal(repr(float(value))).adjusted() - first_uncertain + 1, 1), MOST_DIGITS)


def _number(value: Decimal, power: int, scientific: bool) -> str:
    """Return the number as text, divided by 10**power, or with an exponent of its own.

    >>> _number(Decimal("7.2730e10"), 9, False), _number(Decimal("1.2e-13"), 0, True), _number(Decimal("0e4"), 0, False)
    ('72.730', '1.2e-13', '0')
    """
    if value == 0:
        return "0"
    if scientific:
        return f"{value.scaleb(-value.adjusted())}e{value.adjusted()}"
    return format(value.scaleb(-power), "f")


def as_markdown(table: Table) -> str:
    """Return the table as Markdown: a heading, a pipe table and the notes."""
    columns = rounded_columns(table)

    def line(cells: list[str]) -> str:
        return f"| {' | '.join(cells)} |"

    def cell(text: str | None) -> str:
        return "–" if text is None else re.sub(r"([\\|<>*_`])", r"\\\1", text)

    lines = [
        f"### {cell(table.title)}",
        "",
        line([cell(column.text) for column in columns]),
        line(["---" if column.words else "---:" for column in columns]),
        *(line([cell(text) for text in row]) for row in zip(*(column.cells for column in columns), strict=True)),
    ]
    if table.notes:
        lines += ["", *(f"* {cell(note)}" for note in table.notes)]
    return "\n".join(lines) + "\n"


def as_tex(table: Table) -> str:
    """Return the table as a LaTeX ``tabular`` for the packages booktabs and siunitx, with its notes as comments."""
    columns = rounded_columns(table)

    cells = [
        [("--" if text is None else _escaped(text)) if column.words else text or "{--}" for text in column.cells]
        for column in columns
    ]
    template = Path(__file__).with_name("table.tex.template").read_text(encoding="utf-8")
    return Template(template).substitute(
        title=table.title,
        version=__version__,
        notes="".join(f"% {note}\n" for note in table.notes),
        types="\n".join(f"  {_column_type(column)}" for column in columns),
        headings=" & ".join(column.tex if column.words else f"{{{column.tex}}}" for column in columns),
        rows="".join(" & ".join(row) + " \\\\\n" for row in zip(*cells, strict=True)),
    )


def _column_type(column: _Rounded) -> str:
    """Return the LaTeX column type: ``l`` for text, ``S`` with the widths of the longest number for numbers."""
    if column.words:
        return "l"
    parts = [re.fullmatch(r"(-?\d+)\.?(\d*)(?:e(-?\d+))?", text) for text in column.cells if text is not None]
    numbers = [part.groups(default="") for part in parts if part is not None] or [("0", "", "")]
    whole, decimals, exponent = (max((number[nth].lstrip("-") for number in numbers), key=len) for nth in range(3))
    minus, negative_exponent = ("-" * any(number[nth].startswith("-") for number in numbers) for nth in (0, 2))
    power = f"e{negative_exponent}{len(exponent)}" if exponent else ""
    return f"S[table-format={minus}{len(whole)}.{len(decimals)}{power}]"


def _escaped(text: str) -> str:
    r"""Return plain text with the special characters of LaTeX escaped.

    >>> print(_escaped("100 % of a_b & {c}"))
    100 \% of a\_b \& \{c\}
    """
    return text.translate(_TEX)


FORMATS: Mapping[str, Callable[[Table], str | bytes]] = MappingProxyType(
    {
        "csv": as_csv,
        "json": as_json,
        "yaml": as_yaml,
        "md": as_markdown,
        "tex": as_tex,
        "parquet": as_parquet,
        "lammps": as_include,
        "c": as_c_header,
    }
)
#: format of each file ending
SUFFIXES: Mapping[str, str] = MappingProxyType(
    {f".{name}": name for name in FORMATS}
    | {".markdown": "md", ".lmp": "lammps", ".inc": "lammps", ".yml": "yaml", ".h": "c"}
)
