"""Contact laws as LAMMPS table files (``pair_style table``): text, for any exponent and any law of the overlap.

A file holds distance, energy and force of a pair from the deepest overlap (*reach*) to touch, which is the cutoff. Its
lines are clustered at touch, where ``F ~ overlap^(n-1)`` has no Taylor series; force and energy are those of the law at
the distances as written, to the last digit. :mod:`dem_bridge.lmp.interpolation` reproduces how LAMMPS evaluates a file.
Format: LAMMPS manual,
*pair_style table*.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from typing import Literal

import numpy as np

from dem_bridge.errors import UsageError
from dem_bridge.physics.contact_law import ContactLaw, Floats, clustered
from dem_bridge.version import FORM_DATE, __version__

#: LAMMPS' interpolation between the points of its internal table
Style = Literal["linear", "spline"]
#: lines of a file; they cause an error of 3e-11 at n = 2.5 and 1.5e-9 at n = 5, for any number of points
LINES = 250
#: points of LAMMPS' internal table, if memory allows; the relative error of the force is 8e-9 at n = 2.5
POINTS = 10_000
#: fewest points; below, the error exceeds 1e-6 at n = 2.5
FEWEST_POINTS = 500
#: number of cells next to touch by which the slope at touch is fitted
_CELLS = 24
#: first line of a file, of which LAMMPS reads DATE and UNITS
_HEADER = f"# DATE: {FORM_DATE} UNITS: si CONTRIBUTOR: dem_bridge {__version__}"
_EPS = float(np.finfo(float).eps)
#: Gauss rules for one interval
_RULES = [np.polynomial.legendre.leggauss(order) for order in (4, 5, 7)]


@dataclass(frozen=True, kw_only=True, eq=False)
class ContactTable:
    """A table file; its columns are read-only and exact at the distances as written."""

    keyword: str
    distance: Floats
    """Distances, m, ascending to touch, ``(lines,)``."""
    energy: Floats
    """Energies, J, ``(lines,)``."""
    force: Floats
    """Forces, N, ``(lines,)``."""
    slopes: tuple[float, float]
    """Derivative of the force by the distance at the first and the last line, N/m, for LAMMPS' splines."""

    @property
    def text(self) -> str:
        """The text of the file, with all digits of every number."""
        columns = zip(self.distance.tolist(), self.energy.tolist(), self.force.tolist(), strict=True)
        low, high = self.slopes
        body = "\n".join(f"{i} {r!r} {e!r} {f!r}" for i, (r, e, f) in enumerate(columns, start=1))
        return f"{_HEADER}\n\n{self.keyword}\nN {len(self.distance)} FPRIME {low!r} {high!r}\n\n{body}\n"


def contact_table(
    law: ContactLaw,
    *,
    keyword: str,
    diameter: float,
    reach: float,
    points: int = POINTS,
    lines: int = LINES,
) -> ContactTable:
    """Return the table of a law for two bodies of equal diameter, which is the cutoff.

    The slope at touch is chosen for LAMMPS' spline with ``points`` points: the best slope is not the exact one, but the
    one that fits the first cells best (7 times smaller errors at n = 2.5, 60 times at n = 2.05). With another number of
    points the table is valid, but less accurate.

    Parameters
    ----------
    law : ContactLaw
        The law.
    keyword : str
        Name of the section in the file.
    diameter : float
        Diameter of both bodies, m.
    reach : float
        Largest overlap, m.
    points : int
        N of ``pair_style table spline N``.
    lines : int
        Number of lines.

    Raises
    ------
    UsageError
        If a parameter or the law is invalid: a force that is not finite or pulls, force or energy that do not vanish at
        touch, or an energy whose derivative is not the force.
    """
    if not 0.0 < reach < diameter < math.inf:
        raise UsageError(f"table reach = {reach!r} m at diameter {diameter!r} m; allowed: 0 < reach < diameter")
    distance = np.unique(diameter - clustered(reach, law.kinks, lines - 1))
    if len(distance) < 8:
        raise UsageError(
            f"table reach = {reach!r} m has only {len(distance)} doubles at diameter {diameter!r} m;"
            " choose a smaller diameter"
        )
    distance[0] = _innermost(float(distance[0]), diameter, points)
    overlap = diameter - distance
    force, energy = _values(law, overlap)
    for column in (distance, energy, force):
        column.setflags(write=False)
    slopes = (_slope(distance[:5], force[:5]), _slope_at_touch(law, float(distance[0]), diameter, points))
    return ContactTable(keyword=keyword, distance=distance, energy=energy, force=force, slopes=slopes)


def zero_table(*, keyword: str, diameter: float, reach: float | None = None) -> ContactTable:
    """Return a table without force, for ``pair_coeff * *``, which must come first and covers the pairs without contact.

    Its innermost line is ``reach`` (m; None: 1/1024 of the diameter) below the diameter. LAMMPS stops if bodies that
    are not neighbours come closer.
    """
    distance = np.array([diameter - reach if reach is not None else diameter * (1.0 - 2.0**-10), diameter])
    none = np.zeros(2)
    return ContactTable(keyword=keyword, distance=distance, energy=none, force=none, slopes=(0.0, 0.0))


def points_for(tables: int, *, memory: float = 5e8) -> int:
    """Return the number of points of each internal table, so that all together take at most ``memory`` bytes.

    LAMMPS has one internal table per ``pair_coeff``, with five arrays of the points and five of the lines.

    Parameters
    ----------
    tables : int
        Number of tables.
    memory : float
        Memory for all tables, bytes.

    Raises
    ------
    UsageError
        If there are too few points for an accurate table.

    Examples
    --------
    >>> points_for(40), points_for(5000)
    (10000, 2250)
    """
    points = min(POINTS, int(memory / max(tables, 1) / 40.0) - LINES)
    if points < FEWEST_POINTS:
        raise UsageError(
            f"{tables} tables in {memory:g} bytes leave {max(points, 0)} points each; allowed: >= {FEWEST_POINTS};"
            " contacts of equal stiffness can share a table"
        )
    return points


def _innermost(distance: float, diameter: float, points: int) -> float:
    """Return the innermost distance, moved by a few ulps until LAMMPS finds a cell for every distance below the cutoff.

    LAMMPS multiplies by a rounded inverse of the spacing. At overlaps of an ulp, where a contact opens or closes, the
    result can be the number of the cell after the last, and LAMMPS stops with "Pair distance > table outer cutoff". The
    number rises with the distance, so it is sufficient to check the largest distance.
    """
    while not finds_all_cells(distance, diameter, points):
        distance = math.nextafter(distance, 0.0)
    return distance


def finds_all_cells(inner: float, cut: float, points: int) -> bool:
    """Return True if LAMMPS finds a cell for each distance from ``inner`` to just below ``cut``."""
    squared = inner * inner
    spacing = (cut * cut - squared) / (points - 1)
    return int((math.nextafter(cut * cut, 0.0) - squared) * (1.0 / spacing)) < points - 1


def _values(law: ContactLaw, overlap: Floats) -> tuple[Floats, Floats]:
    """Return force and energy at the overlaps, which descend to 0, or raise UsageError for an invalid law."""
    force, energy = (np.array(column(overlap), dtype=float) for column in (law.force, law.energy))
    for name, unit, column in (("force", "N", force), ("energy", "J", energy)):
        if column.shape != overlap.shape:
            raise UsageError(f"contact law: {name} has shape {column.shape} at overlaps of shape {overlap.shape}")
        wrong = ~np.isfinite(column) | (column < 0.0)
        if wrong.any():
            k = int(np.flatnonzero(wrong)[-1])
            raise UsageError(
                f"contact law: {name} = {float(column[k])!r} {unit} at overlap {float(overlap[k])!r} m;"
                " allowed: finite and >= 0"
            )
        if column[-1] != 0.0:
            raise UsageError(f"contact law: {name} = {float(column[-1])!r} {unit} at overlap 0; allowed: 0 {unit}")
    _check_energy(law, overlap, energy)
    return force, energy


def _check_energy(law: ContactLaw, overlap: Floats, energy: Floats) -> None:
    """Raise UsageError unless the energy rises by the integral of the force between any two lines.

    The tolerance has two terms: the error of the integral, for which 8 times the spread of three Gauss rules is a bound
    (they differ where a law is not smooth); and round-off, 8 ulps of the two energies that are subtracted and 64 of the
    integral (the force at a rounded node, times n <= 5, summed).
    """
    low, width = overlap[1:, None], (overlap[:-1] - overlap[1:])[:, None]
    nodes = np.concatenate([0.5 * (1.0 + node) for node, _ in _RULES])
    values = np.asarray(law.force(low + width * nodes)) * width
    parts = np.split(values, np.cumsum([4, 5]), axis=1)
    rough, better, best = (part @ (0.5 * weight) for part, (_, weight) in zip(parts, _RULES, strict=True))
    rise = energy[:-1] - energy[1:]
    spread = np.maximum(abs(best - rough), abs(best - better))
    allowed = 8.0 * spread + _EPS * (8.0 * (energy[:-1] + energy[1:]) + 64.0 * abs(best))
    excess = abs(rise - best) - allowed
    k = int(np.argmax(np.where(np.isnan(excess), np.inf, excess)))
    if not excess[k] <= 0.0:
        raise UsageError(
            f"contact law: from overlap {float(overlap[k + 1])!r} m to {float(overlap[k])!r} m the energy rises by"
            f" {float(rise[k])!r} J and the force does {float(best[k])!r} J of work; allowed: force = -d energy/dr;"
            " use law_of(force, ..., kinks=...) to compute the energy, with the overlaps at which the slope jumps"
        )


def _slope(distance: Floats, force: Floats) -> float:
    """Return the derivative at the first point of the polynomial through all points."""
    x = (distance - distance[0]) / (distance[-1] - distance[0])
    return float(np.linalg.solve(np.vander(x), force)[-2] / (distance[-1] - distance[0]))


@cache
def _cardinal(cells: int) -> tuple[Floats, Floats, Floats]:
    """Return places in a grid of unit cells, the cardinal splines there, and the spline with unit start slope."""
    from scipy.interpolate import CubicSpline  # slow to import, and only tables need it

    place = np.concatenate([np.arange(1, 64) / 64.0, np.arange(64, 64 * min(cells // 2, 8) + 1, 4) / 64.0])
    grid = np.arange(cells + 1.0)
    through = CubicSpline(grid, np.eye(cells + 1), bc_type=((1, np.zeros(cells + 1)), "not-a-knot"))
    slope = CubicSpline(grid, np.zeros(cells + 1), bc_type=((1, 1.0), "not-a-knot"))
    return place, through(place), slope(place)


def _slope_at_touch(law: ContactLaw, inner: float, cut: float, points: int) -> float:
    """Return the derivative of the force at touch with which LAMMPS' spline fits the law best near touch.

    The spline depends linearly on it, so it follows from least squares.
    """
    cells = min(_CELLS, points - 1)
    if cells < 4:
        return 0.0
    spacing = (cut * cut - inner * inner) / (points - 1)
    place, through, slope = _cardinal(cells)

    def over_distance(at: Floats) -> Floats:
        distance = np.sqrt(cut * cut - at * spacing)
        return np.asarray(law.force(cut - distance) / distance)

    error = through @ over_distance(np.arange(cells + 1.0)) - over_distance(place)
    by_squared = (error @ slope) / (slope @ slope) / spacing
    # from the derivative of f/r by r^2 to that of f by r
    return float(by_squared * 2.0 * cut * cut)
