"""Make columns of tables, one function for each kind."""

from __future__ import annotations

from collections.abc import Iterable

from dem_bridge.formats.tables.table import Column, column


def numbers(quantity: str, heading: str, unit: str, values: Iterable[float | None]) -> Column:
    return column(quantity, heading, values, unit=unit)


def counts(quantity: str, heading: str, values: Iterable[int | None]) -> Column:
    return column(quantity, heading, values, kind="count")


def texts(quantity: str, heading: str, values: Iterable[str | None]) -> Column:
    return column(quantity, heading, values, kind="text")
