"""Read tables of text: CSV with any delimiter, and columns separated by blanks, with or without headings."""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

from numpy.typing import NDArray

from dem_bridge.errors import UsageError
from dem_bridge.formats.readers.headings import heading_of
from dem_bridge.formats.readers.rounding import texts_of
from dem_bridge.formats.units import VALUES

_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eEdD][+-]?\d+)?|[+-]?(?:nan|inf|infinity)", re.IGNORECASE)
#: the same in ASCII, or nothing
_PLAIN_NUMBER = r"(?:[+-]?(?:(?:[0-9]++\.?[0-9]*+|\.[0-9]++)(?:[eEdD][+-]?[0-9]++)?|(?i:nan|infinity|inf)))?"
_STEP = re.compile(
    r"(?i)\b(?:dt|time[ _]?step|delta_?t)\b\s*[\[(]?(?P<before>\w*)[\])]?\s*[=:]\s*(?P<number>[0-9.]+(?:e[+-]?\d+)?)"
    r"\s*[\[(]?(?P<behind>[a-zµμ]*)"
)
#: most values of a table
_MOST_VALUES = 2**25
#: number of lines before the numbers in which headings are searched
_MOST_COMMENTS = 50
_COMMENTS = ("#", "%", "//", "!")


@dataclass
class Entry:
    """Hold a column or an array of a file under its heading, in the file's own units."""

    heading: str
    values: NDArray[Any]
    """Numbers, or the texts of numbers (bytes; an empty text is a missing value)."""
    unit: str | None = None
    """Unit that the file states apart from the heading."""
    axis: int | None = None
    """Axis of a component of a vector: 0, 1 or 2."""


@dataclass
class Table:
    """Hold the columns or arrays of a file."""

    entries: list[Entry]
    notes: list[str] = field(default_factory=list)
    dt: float | None = None
    """Time step that the file states, s."""
    has_headings: bool = True
    """True if the file has headings."""
    lines: Sequence[int] = ()
    """Line of the file of each row of a text, from 1; empty for arrays."""


def read_text(text: str) -> Table:
    """Read a table of numbers with headings, or without (then they are the numbers of the columns, from 0)."""
    numbered = [(number, line) for number, line in enumerate(text.splitlines(), start=1) if line.strip()]
    lines = [line for _, line in numbered]
    rows_at = [k for k, line in enumerate(lines) if not line.lstrip().startswith(_COMMENTS)]
    plain = [lines[k] for k in rows_at]
    begin = next((k for k, line in enumerate(plain) if _delimiter_of_numbers(line) is not None), None)
    if begin is None:
        raise UsageError(
            f"the file is not a table, because none of its {len(lines)} lines is a row of numbers; allowed: a row of"
            " headings, then rows of numbers separated by commas, semicolons, tabs or blanks"
        )
    before = lines[: rows_at[begin]]
    comments = [line.strip() for line in before if line.lstrip().startswith(_COMMENTS)][-_MOST_COMMENTS:]
    delimiter = _delimiter_of_numbers(plain[begin]) or " "
    count = fewest = len(_split(plain[begin : begin + 1], delimiter)[0])
    if count * (len(plain) - begin) > _MOST_VALUES:
        raise UsageError(f"the table has more than {_MOST_VALUES} values; write fewer samples or use npz or netCDF")
    numbers = _columns_of_numbers(plain[begin:], delimiter, count)
    cells = numbers or _columns(plain[begin:], delimiter, count)
    while fewest > 1 and not any(cells[fewest - 1]):  # empty columns at the end may have no heading
        fewest -= 1
    headings, has_headings = _headings(plain[:begin][-_MOST_COMMENTS:], comments, (fewest, count), delimiter)
    table = Table([], has_headings=has_headings, lines=[numbered[k][0] for k in rows_at[begin:]])
    if not numbers and delimiter in ";\t" and any("," in column[0] for column in cells):
        cells = [[cell.replace(",", ".") for cell in column] for column in cells]
        table.notes.append("numbers have decimal commas")
    for heading, column in zip(headings, cells, strict=True):
        if not numbers:
            _check_numbers(column, heading)
        table.entries.append(Entry(heading, texts_of(column)))
    stated = [match for comment in comments if (match := _STEP.search(comment))]
    if stated:
        try:
            unit = stated[0]["before"] or stated[0]["behind"] or "s"
            table.dt = float(stated[0]["number"]) * VALUES["s"].get(unit, math.nan)
            if not math.isfinite(table.dt):
                raise ValueError(unit)
            table.notes.append(f"the time step is {table.dt:.9g} s, as a comment of the file states")
        except ValueError:
            table.dt = None
    return table


def _delimiter_of_numbers(line: str) -> str | None:
    """Return the delimiter of a line if all its cells are numbers (or empty), else None."""
    for delimiter in (";", "\t", ",", " "):
        if delimiter != " " and delimiter not in line:
            continue
        cells = [cell.strip().strip('"') for cell in (line.split() if delimiter == " " else line.split(delimiter))]
        if delimiter in ";\t":
            cells = [cell.replace(",", ".") for cell in cells]
        if any(cells) and all(not cell or _NUMBER.fullmatch(cell) for cell in cells):
            return delimiter
    return None


def _split(lines: Sequence[str], delimiter: str) -> list[list[str]]:
    """Return the cells of lines."""
    if delimiter == " ":
        return [line.split() for line in lines]
    try:
        return [
            [cell.strip() for cell in row] for row in csv.reader(io.StringIO("\n".join(lines)), delimiter=delimiter)
        ]
    except csv.Error as error:
        raise UsageError(f"the file is not a table ({error}); write it again") from error


def _headings(heads: list[str], comments: list[str], counts: tuple[int, int], delimiter: str) -> tuple[list[str], bool]:
    """Return the headings of the columns and True, or the numbers of the columns and False.

    Of the lines that have as many cells, the one with the most known headings counts, else the last that is no comment.
    A line of units adds them to the headings. ``counts`` are the fewest headings and the number of columns.
    """
    count = counts[1]
    rows = [row for line in heads for row in _cells(line, counts, delimiter)]
    said = [row for line in comments for row in _cells(line, counts, delimiter)]
    units = next((row for row in (*rows, *said) if all(_is_unit(cell) for cell in row)), None)
    best = max((*rows, *said), key=_known_headings, default=None)
    if best is None or (best not in rows and _known_headings(best) == 0) or best is units:
        if heads and not rows:
            raise UsageError(
                f"the rows have {count} values, which is not the number of headings in {heads[-1][:60]!r}; allowed: one"
                " heading for each value; give the headings (--columns)"
            )
        return [str(nth) for nth in range(count)], False
    if units is not None:
        best = [f"{cell} [{unit.strip('[]() ')}]" for cell, unit in zip(best, units, strict=True)]
    return best, True


def _cells(line: str, counts: tuple[int, int], delimiter: str) -> Iterator[list[str]]:
    """Yield the ways in which a line of words has as many cells as there are columns, or the fewest of ``counts``."""
    fewest, count = counts
    text = line.lstrip("#%/! ").strip()
    choices: list[list[str]] = []
    with suppress(UsageError):  # a comment may be longer than a cell can be
        for mark in dict.fromkeys((delimiter, ",", "\t", ";")):
            choices += _split([text], mark) if mark != " " else []
    choices += [
        text.split(),
        re.findall(r"[^\s\[(]+(?:\s*(?:\[[^\]\[]*\]|\([^)(]*\)))*", text),
        re.split(r"\s{2,}", text),
    ]
    for cells in choices:
        if fewest <= len(cells) < count or not any(cells[count:]):
            cells = [*cells, *[""] * (count - len(cells))][:count] if len(cells) >= fewest else cells
        if len(cells) == count and not all(_NUMBER.fullmatch(cell) for cell in cells):
            yield [cell.strip().strip('"') for cell in cells]


def _known_headings(cells: Sequence[str]) -> int:
    """Return the number of cells that are known headings."""
    count = 0
    for cell in cells:
        try:
            count += heading_of(cell) is not None
        except UsageError:  # a known name with an unknown unit
            count += 1
    return count


def _is_unit(cell: str) -> bool:
    """Return True for a unit in brackets, or one that is longer than a letter, which might be a name."""
    bare = cell.strip("[]() ")
    return any(bare in units for units in VALUES.values()) and (bare != cell or len(bare) > 1 or bare == "s")


def _columns(lines: Sequence[str], delimiter: str, count: int) -> list[Sequence[Any]]:
    """Return the cells of each of ``count`` columns; raise UsageError for a row that has more or fewer."""
    rows = _split(lines, delimiter)
    for nth, row in enumerate(rows):
        if len(row) != count:
            raise UsageError(
                f"row {nth + 1} of the numbers has {len(row)} values, the first row has {count}; allowed: the same"
                " number in every row; write the file again if it is cut off"
            )
    return list(zip(*rows, strict=True))


def _columns_of_numbers(lines: Sequence[str], delimiter: str, count: int) -> list[Sequence[Any]] | None:
    """Return the cells of each column of a table of plain numbers; None for a table that has anything else.

    One search in each row is several times faster than one in each cell.
    """
    row = re.compile(rf"(?:{_PLAIN_NUMBER}{delimiter}){{{count - 1}}}{_PLAIN_NUMBER}")
    if delimiter == " " or not all(map(row.fullmatch, lines)):
        return None
    cells = delimiter.join(lines).encode("ascii").split(delimiter.encode())
    return [cells[column::count] for column in range(count)]


def _check_numbers(cells: Sequence[str], heading: str) -> None:
    """Raise UsageError for a text of a column that is not a number."""
    wrong = next((k for k, cell in enumerate(cells) if cell and not _NUMBER.fullmatch(cell)), None)
    if wrong is not None:
        raise UsageError(
            f"column {heading[:60]!r} has no number in row {wrong + 1}; allowed: numbers; correct the file"
        )
