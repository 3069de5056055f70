"""The table of constants to take home: exact numbers by which other codes can test themselves, without a scene.

Each number is computed here by the formulas of ``physics``. Beside it stands a second value, computed once by an
unrelated method that shares no formula with the first, from the file ``second_values.toml``. The tests compute the
second values again.
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from typing import Any

from dem_bridge.formats.tables.constants.constant import Constant
from dem_bridge.formats.tables.constants.damped import damped_constants
from dem_bridge.formats.tables.constants.elastic import elastic_constants
from dem_bridge.formats.tables.table import Table, tabulate
from dem_bridge.version import __version__

SECOND_VALUES = Path(__file__).with_name("second_values.toml")


@cache
def all_constants() -> tuple[Constant, ...]:
    """Return all constants, in the order of the table.

    Examples
    --------
    >>> by_name = {constant.name: constant.rounded for constant in all_constants()}
    >>> by_name["solitary_n2_5_speed_by_velocity"], by_name["collision_n2_5_time_by_overlap"]
    (0.90747007841219, 2.9432751843247)
    """
    return (*elastic_constants(), *damped_constants())


def second_values() -> dict[str, float]:
    """Return the values of the second computation by the name of the constant."""
    values: dict[str, float] = tomllib.loads(SECOND_VALUES.read_text(encoding="utf-8"))
    return values


NOTES = (
    "n is the exponent of the potential: the force of a contact is beta overlap^(n-1), so that Hertz' law has n = 2.5",
    "for n <= 2 there is no solitary wave: a linear chain disperses every pulse, and a softening one more so",
    "a value has 14 significant digits, of which `digits` are certain: both computations agree to them",
    "difference: value over second value, minus 1",
    "clipped: the net force of a contact is never negative (LAMMPS: limit_damping)",
)


def _difference(value: float, second: float) -> float:
    """Return the difference relative to the second value, to a digit; the absolute one beside 0."""
    return float(f"{(value - second) / (abs(second) or 1.0):.0e}")


def constants() -> Table:
    """Return the table of constants, each with digits, source, method and a second computation."""
    rows, second = all_constants(), second_values()
    values: dict[str, Iterable[Any]] = {
        "name": [row.name for row in rows],
        "group": [row.family.group for row in rows],
        "quantity": [row.quantity for row in rows],
        "parameters": [row.parameters for row in rows],
        "value": [row.rounded for row in rows],
        "unit": [row.unit for row in rows],
        "digits": [row.family.digits for row in rows],
        "second_value": [second[row.name] for row in rows],
        "difference": [_difference(row.rounded, second[row.name]) for row in rows],
        "source": [row.family.source for row in rows],
        "method": [row.family.method for row in rows],
        "second_method": [row.family.second_method for row in rows],
    }
    return tabulate(
        "constants",
        values,
        title="Exact constants of contacts, impacts and chains",
        notes=NOTES,
        provenance={"dem_bridge": __version__},
    )
