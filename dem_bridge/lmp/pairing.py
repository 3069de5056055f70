"""The lines of a deck that name pair styles and coefficients, and the table files that they read."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from dem_bridge.lmp.coefficients import NOTHING, Laws
from dem_bridge.lmp.table import LINES, ContactTable, Style, contact_table, points_for, zero_table

#: range of a table relative to the largest overlap of the prescan
MARGIN = 1.1
#: range of a table of a contact that never closed in the prescan, relative to the largest overlap of all contacts
_UNTOUCHED = 0.01


@dataclass(frozen=True, kw_only=True)
class Pairing:
    """The pair commands of a deck."""

    note: str
    """Meaning of the coefficients, as a comment for readers."""
    head: tuple[str, ...]
    """``pair_style``, and the coefficients of the pairs without contact."""
    behind: tuple[tuple[str, ...], ...]
    """Arguments of ``pair_coeff I J``, one line or more for each law."""
    files: Mapping[str, str]


@dataclass(frozen=True, kw_only=True)
class TableSet:
    """The tables of a scene.

    :func:`table_set` computes it.
    """

    style: Style
    points: int
    """Number of points of LAMMPS' internal tables."""
    tables: Mapping[int, ContactTable]
    """Table of each law, except damped laws that ``granular`` has, because only ``granular`` can clip the net force."""


def granular(laws: Laws, radius: float) -> Pairing:
    """Return the pair commands of ``pair_style granular`` for bodies of ``radius`` (m)."""
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
    """Return one table for each law, whose range follows from the largest overlap of its contacts.

    Parameters
    ----------
    laws : Laws
        The laws of the scene.
    radius : float
        Radius of the bodies, m.
    peak_overlap : ndarray
        Largest overlap of each contact along the line of atoms, m.
    pairs : int
        Number of ``pair_coeff`` lines, which share the memory unless ``points`` is given.
    style : {"linear", "spline"}
        LAMMPS' interpolation.
    lines, points : int, optional
        Lines of each file, and points of LAMMPS' internal tables.
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
            points=points,
            lines=lines or LINES,
        )
    return TableSet(style=style, points=points, tables=MappingProxyType(tables))


def tabled(laws: Laws, radius: float, table_set: TableSet, name: str) -> Pairing:
    """Return the pair commands of ``pair_style table``; with damping, ``hybrid/overlay`` with ``granular``."""
    # contacts that are left to granular have no table, so their overlap has no bound
    reach = radius if laws.damped else None
    none = zero_table(keyword="NONE", diameter=2.0 * radius, reach=reach)
    files = {f"{name}.none.table": none.text}
    files |= {f"{name}.{law}.table": table.text for law, table in table_set.tables.items()}
    style = f"table {table_set.style} {table_set.points}"

    kind, overlay = ("table ", "hybrid/overlay ") if laws.damped else ("", "")
    behind = []
    for law in range(len(laws.stiffness)):
        table = table_set.tables.get(law)
        if table is None:
            behind.append((f"granular {laws.coefficients(law, radius)}",))
            continue
        dashpot = (f"granular {laws.dashpot(law)}",) if laws.eta[law] > 0.0 else ()
        behind.append((f"{kind}{name}.{law}.table {table.keyword}", *dashpot))
    pulls = "; damping is added and can make a contact tensile where granular lacks its law" if laws.clip else ""
    head = (
        f"pair_style      {overlay}{style}{' granular' * laws.damped}",
        f"pair_coeff      * * {kind}{name}.none.table NONE",
        *([f"pair_coeff      * * granular {NOTHING}"] if laws.damped else []),
    )
    note = f"forces from tables, exact at their lines{pulls}"
    return Pairing(note=note, head=head, behind=tuple(behind), files=MappingProxyType(files))
