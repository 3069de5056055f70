"""One constant of the table, and what the constants of a group have in common."""

from __future__ import annotations

from dataclasses import dataclass

#: significant digits of the values: one more than the digits of the most certain of them
_ROUNDED = 14


@dataclass(frozen=True)
class Family:
    """Hold what the constants of one group have in common."""

    group: str
    digits: int
    """Significant digits that are certain: the test demands that both computations agree to them."""
    source: str
    method: str
    second_method: str


@dataclass(frozen=True)
class Constant:
    """One constant of the table."""

    name: str
    """Name for programs: letters, digits and underscores."""
    quantity: str
    parameters: str
    value: float
    unit: str
    family: Family

    @property
    def rounded(self) -> float:
        """Return the value with the digits that do not depend on the machine."""
        return float(f"{self.value:.{_ROUNDED - 1}e}")


def label(number: float) -> str:
    """Return a number as a part of a name.

    >>> label(2.25), label(10.0)
    ('2_25', '10')
    """
    return f"{number:g}".replace(".", "_")
