"""How neighbours meet in LAMMPS: the lines that name pair styles and coefficients, and the table files they read."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from dem_bridge.lmp.coefficients import NOTHING, Laws
from dem_bridge.lmp.table import LINES, ContactTable, Style, contact_table, points_for, zero_table
from dem_bridge.version import FORM_DATE

#: range of a table over the largest overlap that a coarse run found
MARGIN = 1.1
#: range of a table of a contact that never touched in the coarse run, over the largest overlap of all
_UNTOUCHED = 0.01


@dataclass(frozen=True, kw_only=True)
class Pairing:
    """Text between the atoms and the integrator of a deck."""

    note: str
    """What the numbers mean, for people."""
    head: tuple[str, ...]
    """pair_style, and coefficients of the pairs that have no contact."""
    behind: tuple[tuple[str, ...], ...]
    """What stands behind ``pair_coeff I J``, one line or more for each law."""
    files: Mapping[str, str]


@dataclass(frozen=True, kw_only=True)
class TableSet:
    """The tables of a scene. Made by :func:`table_set`."""

    style: Style
    points: int
    """Of LAMMPS' internal tables."""
    tables: Mapping[int, ContactTable]
    """By law; damped laws that ``granular`` has itself are not here: only there a net force can be clipped."""


def granular(laws: Laws, radius: float) -> Pairing:
    """``pair_style granular``, for bodies of ``radius`` (m)."""
    return Pairing(
        note="stiffness K = beta / sqrt(R/2)",
        head=("pair_style      granular", f"pair_coeff      * * {NOTHING}"),
        behind=tuple((laws.coefficients(law, radius),) for law in range(len(laws.stiffness))),
        files=MappingProxyType({}),
    )


def table_set(
    laws: Laws,
    *,
    radius: float,
    peak_overlap: NDArray[np.float64],
    pairs: int,
    style: Style = "spline",
    lines: int | None = None,
    points: int | None = None,
) -> TableSet:
    """One table for each law, as long as its own largest overlap asks for.

    ``radius`` in m; ``peak_overlap`` (m) along the line of atoms; ``pairs``: how many ``pair_coeff`` there will be,
    which share the memory where ``points`` says nothing.
    """
    deepest = np.zeros(len(laws.stiffness))
    np.maximum.at(deepest, laws.where, peak_overlap)
    reach = np.maximum(MARGIN * deepest, _UNTOUCHED * (float(np.max(deepest, initial=0.0)) or radius))
    points = points or points_for(pairs + 1)
    tables = {}
    for law in range(len(laws.stiffness)):
        if laws.left_to_granular(law):
            continue
        tables[law] = contact_table(
            laws.law(law),
            keyword=f"LAW{law}",
            diameter=2.0 * radius,
            reach=float(reach[law]),
            date=FORM_DATE,
            points=points,
            lines=lines or LINES,
        )
    return TableSet(style=style, points=points, tables=MappingProxyType(tables))


def tabled(laws: Laws, radius: float, found: TableSet, name: str) -> Pairing:
    """``pair_style table``; with damping beside it, ``hybrid/overlay`` with ``granular``."""
    # contacts that are left to granular have no table, however deep they get
    reach = radius if laws.clipped else None
    none = zero_table(keyword="NONE", diameter=2.0 * radius, date=FORM_DATE, reach=reach)
    files = {f"{name}.none.table": none.text}
    files |= {f"{name}.{law}.table": table.text for law, table in found.tables.items()}
    style = f"table {found.style} {found.points}"

    def file(law: int | str, keyword: str) -> str:
        return f"{name}.{law}.table {keyword}"

    note = "forces from tables, exact at their lines"
    if not laws.clipped:
        return Pairing(
            note=note,
            head=(f"pair_style      {style}", f"pair_coeff      * * {file('none', 'NONE')}"),
            behind=tuple((file(law, table.keyword),) for law, table in found.tables.items()),
            files=MappingProxyType(files),
        )
    behind: list[tuple[str, ...]] = []
    for law in range(len(laws.stiffness)):
        table = found.tables.get(law)
        if table is None:
            behind.append((f"granular {laws.coefficients(law, radius)}",))
        elif laws.damping[law] > 0.0:
            behind.append((f"table {file(law, table.keyword)}", f"granular {laws.dashpot(law)}"))
        else:
            behind.append((f"table {file(law, table.keyword)}",))
    return Pairing(
        note=f"{note}; damping beside them, which may pull where granular has not the law itself",
        head=(
            f"pair_style      hybrid/overlay {style} granular",
            f"pair_coeff      * * table {file('none', 'NONE')}",
            f"pair_coeff      * * granular {NOTHING}",
        ),
        behind=tuple(behind),
        files=MappingProxyType(files),
    )
