"""Read measured values with their standard uncertainties from CSV files.

The long layout has a row per time and place (``time_s,body,velocity_m_per_s,uncertainty_m_per_s``), the wide layout a
row per time (``time_s,velocity_3_m_per_s,velocity_3_uncertainty_m_per_s,...``). Arrivals and peaks have no time
(``body,arrival_us,uncertainty_us``). Every value needs an uncertainty: without one, no difference
from it has a meaning.
"""

from __future__ import annotations

import csv
import hashlib
import math
import re
from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from dem_bridge.errors import UsageError
from dem_bridge.foundation.files import bytes_of_file, text_of_file
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import Floats


class Quantity(NamedTuple):
    """A quantity that can be measured: its SI unit, and the kind of its places."""

    unit: str
    axis: str
    sampled: bool
    """Whether it has values at times; the others have one value at each place."""


QUANTITIES: Mapping[str, Quantity] = {
    "velocity": Quantity("m/s", "body", True),
    "displacement": Quantity("m", "body", True),
    "contact_force": Quantity("N", "contact", True),
    "arrival": Quantity("s", "body", False),
    "peak_velocity": Quantity("m/s", "body", False),
    "peak_force": Quantity("N", "contact", False),
}
#: further names of quantities in headings
_ALIASES = {"v": "velocity", "force": "contact_force", "arrival_time": "arrival"}
#: value in SI of each unit
_UNITS = {
    "s": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9},
    "m": {"m": 1.0, "mm": 1e-3, "um": 1e-6, "µm": 1e-6, "nm": 1e-9},
    "m/s": {"m/s": 1.0, "m_per_s": 1.0, "cm/s": 1e-2, "cm_per_s": 1e-2, "mm/s": 1e-3, "mm_per_s": 1e-3},
    "N": {"N": 1.0, "kN": 1e3, "mN": 1e-3},
}
_SPELLINGS = sorted({*QUANTITIES, *_ALIASES}, key=len, reverse=True)
_WORDS = "standard_uncertainty|uncertainty|sigma|std|u"
_HEADING = re.compile(
    rf"(?:(?P<before>{_WORDS})[_ ](?:of[_ ])?)?(?P<name>time|t|{'|'.join(_SPELLINGS)})(?:[_ ]?(?P<nth>\d{{1,9}}))?"
    rf"(?:[_ ](?P<after>{_WORDS}))?(?:_(?P<plain>[A-Za-zµ_]+)|\s*[(\[](?P<unit>[^)\]]*)[)\]])?"
)
_PLAIN_UNITS = "|".join(unit for units in _UNITS.values() for unit in units if "/" not in unit)
_SHARED = re.compile(rf"(?:{_WORDS})(?:_(?P<plain>{_PLAIN_UNITS})|\s*[(\[](?P<unit>[^)\]]*)[)\]])?")
#: part of the duration by which a time may lie outside the scene, because it is rounded
_ROUNDED = 1e-9


@dataclass(frozen=True, kw_only=True, eq=False)
class Reading:
    """Values of one quantity at one place, with their standard uncertainties; all arrays are ``(n,)``, in SI."""

    quantity: str
    """Key of :data:`QUANTITIES`."""
    place: int
    """Body or contact."""
    time: Floats
    """Times, s; nan for a quantity without times."""
    value: Floats
    uncertainty: Floats

    @property
    def sampled(self) -> bool:
        """True if the values have times."""
        return QUANTITIES[self.quantity].sampled

    @property
    def label(self) -> str:
        """Quantity and place in words."""
        return f"{self.quantity.replace('_', ' ')} of {QUANTITIES[self.quantity].axis} {self.place}"


@dataclass(frozen=True)
class _Column:
    """Column of values, or of uncertainties, of a quantity; ``place`` None means that each row has its place."""

    quantity: str
    place: int | None
    uncertain: bool
    factor: float


def read_measurement(files: Iterable[Path], scene: Scene) -> tuple[Reading, ...]:
    """Return the measured values of CSV files, one Reading for each quantity and place, with increasing times.

    Raises
    ------
    UsageError
        If a file is missing or not such a table, if a value has no uncertainty or one that is not positive, or if a
        time, body or contact lies outside the scene. The message names file and line.
    """
    rows: defaultdict[tuple[str, int], list[tuple[float, float, float]]] = defaultdict(list)
    for file in files:
        try:
            _read(file, scene, rows)
        except UsageError as error:
            raise UsageError(f"{file}: {error}") from None
    order = list(QUANTITIES)
    readings = []
    for quantity, place in sorted(rows, key=lambda key: (order.index(key[0]), key[1])):
        time, value, uncertainty = np.array(sorted(rows[quantity, place])).T
        readings.append(Reading(quantity=quantity, place=place, time=time, value=value, uncertainty=uncertainty))
    return tuple(readings)


def checksum(file: Path) -> str:
    """Return the sha256 of a file."""
    return hashlib.sha256(bytes_of_file(file)).hexdigest()


def _read(file: Path, scene: Scene, rows: Mapping[tuple[str, int], list[tuple[float, float, float]]]) -> None:
    """Add the values of a file to ``rows``: time, value and uncertainty by quantity and place."""
    lines = _lines(file)
    headings = [heading.strip() for heading in lines[0][1]]
    columns = _columns(headings)
    places: dict[str, int] = {axis: headings.index(axis) for axis in ("body", "contact") if axis in headings}
    times = [nth for nth, column in columns.items() if column.quantity == "time"]
    for line, cells in lines[1:]:
        if len(cells) != len(headings):
            raise UsageError(f"line {line} has {len(cells)} cells; allowed: {len(headings)}, one for each heading")
        numbers = [_number(cell, heading, line) for cell, heading in zip(cells, headings, strict=True)]
        time = numbers[times[0]] * columns[times[0]].factor if times else math.nan
        for nth, column in columns.items():
            if column.uncertain or column.quantity == "time" or math.isnan(numbers[nth]):
                continue
            what = QUANTITIES[column.quantity]
            if what.sampled:
                _check_time(time, scene, line)
            nominal = float(column.place) if column.place is not None else numbers[places[what.axis]]
            place = _place(nominal, what.axis, scene, line)
            other = _uncertainty_of(nth, columns, headings)
            uncertainty = numbers[other] * columns[other].factor
            if not 0.0 < uncertainty < math.inf:
                raise UsageError(
                    f"line {line}: {headings[other]} = {cells[other].strip() or 'empty'}; allowed: a number > 0, the"
                    " standard uncertainty of the value"
                )
            reading = (time if what.sampled else math.nan, numbers[nth] * column.factor, uncertainty)
            rows[column.quantity, place].append(reading)


def _lines(file: Path) -> list[tuple[int, list[str]]]:
    """Return the rows of a table with their line numbers, without empty lines and comments; the first has headings."""
    try:
        text = text_of_file(file)
    except OSError as error:
        raise UsageError(f"the file of [measurement] cannot be read ({error.strerror}); allowed: a CSV file") from None
    lines = [(nth, line) for nth, line in enumerate(text.splitlines(), start=1) if line.strip() and line[0] != "#"]
    if len(lines) < 2:
        raise UsageError("the file has no values; allowed: a line of headings, then lines of numbers")
    delimiter = max(",;\t", key=lines[0][1].count)
    if delimiter not in lines[0][1]:
        return [(nth, line.split()) for nth, line in lines]
    try:
        return [(nth, next(csv.reader([line], delimiter=delimiter))) for nth, line in lines]
    except csv.Error as error:
        raise UsageError(f"the file is not CSV ({error}); write it again") from None


def _columns(headings: list[str]) -> dict[int, _Column]:
    """Return the columns of a table by number; raise UsageError unless each value has a place and an uncertainty."""
    columns = {}
    if not any(heading in ("body", "contact") or _HEADING.fullmatch(heading) for heading in headings):
        raise UsageError("the file has no known heading; allowed: time, body, contact and quantities with their units")
    for nth, heading in enumerate(headings):
        if heading in ("body", "contact") or _SHARED.fullmatch(heading):
            continue
        match = _HEADING.fullmatch(heading)
        if match is None:
            raise UsageError(
                f"column {heading!r} is unknown; allowed: time, body, contact, {', '.join(QUANTITIES)} with a unit,"
                " such as velocity_m_per_s, and their uncertainties, such as velocity_uncertainty_m_per_s"
            )
        name = "time" if match["name"] == "t" else _ALIASES.get(match["name"], match["name"])
        si = "s" if name == "time" else QUANTITIES[name].unit
        place = None if match["nth"] is None else int(match["nth"])
        uncertain = bool(match["before"] or match["after"])
        columns[nth] = _Column(name, place, uncertain, _factor(heading, match["plain"] or match["unit"], si))
    kinds = {column.quantity for column in columns.values()} - {"time"}
    if not kinds:
        raise UsageError(f"the file has no measured quantity; allowed: {', '.join(QUANTITIES)}, with a unit")
    for nth, heading in enumerate(headings):
        if match := _SHARED.fullmatch(heading):
            if len(kinds) > 1:
                raise UsageError(
                    f"column {heading!r} does not say of which quantity; the file has {', '.join(sorted(kinds))}; write"
                    f" {sorted(kinds)[0]}_uncertainty with its unit"
                )
            kind = next(iter(kinds))
            columns[nth] = _Column(kind, None, True, _factor(heading, match["plain"] or match["unit"], _unit(kind)))
    for nth, column in columns.items():
        if column.quantity == "time" or column.uncertain:
            continue
        what = QUANTITIES[column.quantity]
        if what.sampled and "time" not in {other.quantity for other in columns.values()}:
            raise UsageError(f"column {headings[nth]!r} needs times; add a column time_s")
        if column.place is None and what.axis not in headings:
            raise UsageError(
                f"column {headings[nth]!r} does not say of which {what.axis}; add a column {what.axis}, or its number"
                f" to the heading, such as {column.quantity}_0"
            )
        _uncertainty_of(nth, columns, headings)
    return columns


def _unit(quantity: str) -> str:
    return QUANTITIES[quantity].unit


def _factor(heading: str, unit: str | None, si: str) -> float:
    """Return the value of the unit of a heading in SI."""
    written = si.replace("/", "_per_")
    if not unit:
        raise UsageError(f"column {heading!r} has no unit; write {heading}_{written}")
    if unit.strip() not in _UNITS[si]:
        raise UsageError(f"column {heading!r} has the unknown unit {unit!r}; allowed: {', '.join(_UNITS[si])}")
    return _UNITS[si][unit.strip()]


def _uncertainty_of(nth: int, columns: Mapping[int, _Column], headings: list[str]) -> int:
    """Return the column of the uncertainties of a column of values: its own, or the one of all places."""
    column = columns[nth]
    others = {
        other.place: number
        for number, other in columns.items()
        if other.uncertain and other.quantity == column.quantity and other.place in (column.place, None)
    }
    if not others:
        unit = _unit(column.quantity).replace("/", "_per_")
        raise UsageError(
            f"column {headings[nth]!r} has no uncertainty, and a value without one is no measurement; add a column"
            f" uncertainty_{unit} with the standard uncertainty (one standard deviation) of each value"
        )
    return others.get(column.place, others.get(None, -1))


def _number(cell: str, heading: str, line: int) -> float:
    """Return the number of a cell; nan if it is empty."""
    if not cell.strip():
        return math.nan
    try:
        number = float(cell)
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise UsageError(f"line {line}: {heading} = {cell.strip()!r}; allowed: a finite number, or nothing")
    return number


def _check_time(time: float, scene: Scene, line: int) -> None:
    slack = _ROUNDED * scene.duration
    if not -slack <= time <= scene.duration + slack:
        raise UsageError(
            f"line {line}: time = {time:.9g} s; allowed: 0 to {scene.duration:.9g} s, the duration of {scene.name};"
            " leave such lines out, or give the scene a longer duration"
        )


def _place(number: float, axis: str, scene: Scene, line: int) -> int:
    count = scene.n_body if axis == "body" else scene.n_contact
    if not (number == number and number == int(number) and 0 <= number < count):
        raise UsageError(
            f"line {line}: {axis} = {number:.9g}; allowed: a whole number from 0 to {count - 1} (0 is the struck end)"
        )
    return int(number)
