"""Contact laws as LAMMPS table files (``pair_style table``): pure text, any exponent, any law of the overlap.

A file holds distance, energy and force of a pair from the deepest overlap (*reach*) to touch, which is the cutoff. Its
lines are close together at touch, where ``F ~ overlap^(n-1)`` has no Taylor series; force and energy are those of the
law at the distances as written, to the last digit. What LAMMPS makes of a file: :mod:`dem_bridge.lmp.interpolation`.
Format: LAMMPS manual, *pair_style table*.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from typing import Literal

import numpy as np

from dem_bridge.errors import UsageError
from dem_bridge.physics.contact import Floats
from dem_bridge.physics.law import ContactLaw, clustered
from dem_bridge.version import __version__

#: how LAMMPS interpolates between the points of its internal table
Style = Literal["linear", "spline"]
STYLES: tuple[Style, ...] = ("linear", "spline")
#: lines of a file: its own share of the error is 3e-11 at n = 2.5 and 1.5e-9 at n = 5, whatever the points
LINES = 250
#: points of LAMMPS' internal table where memory allows: relative error of force 8e-9 at n = 2.5
POINTS = 10_000
#: below this many points a table is worse than 1e-6 at n = 2.5
FEWEST_POINTS = 500
#: cells of the internal table next to touch that the slope at touch is fitted to
_CELLS = 24
_EPS = float(np.finfo(float).eps)
#: Gauss rules of a panel
_RULES = [np.polynomial.legendre.leggauss(order) for order in (4, 5, 7)]


@dataclass(frozen=True, kw_only=True, eq=False)
class ContactTable:
    """A table file; its columns are read-only and exact at the doubles as written."""

    keyword: str
    header: str
    distance: Floats
    """m, ascending to touch, ``(lines,)``."""
    energy: Floats
    """J, ``(lines,)``."""
    force: Floats
    """N, ``(lines,)``."""
    slopes: tuple[float, float]
    """Derivative of force by distance at the first and the last line, N/m, as LAMMPS' splines take it."""

    @property
    def text(self) -> str:
        """The file. Every number has all its digits."""
        rows = zip(
            range(1, len(self.distance) + 1),
            self.distance.tolist(),
            self.energy.tolist(),
            self.force.tolist(),
            strict=True,
        )
        low, high = self.slopes
        body = "\n".join(f"{i} {r!r} {e!r} {f!r}" for i, r, e, f in rows)
        return f"{self.header}\n\n{self.keyword}\nN {len(self.distance)} FPRIME {low!r} {high!r}\n\n{body}\n"


def contact_table(
    law: ContactLaw,
    *,
    keyword: str,
    diameter: float,
    reach: float,
    date: str,
    points: int = POINTS,
    lines: int = LINES,
) -> ContactTable:
    """The table of ``law`` for overlaps up to ``reach`` (m) of two bodies of ``diameter`` (m), which is the cutoff.

    ``date``: of the file's form, YYYY-MM-DD. ``points``: N of ``pair_style table spline N``, for which the slope at
    touch is chosen: there the least error of LAMMPS' spline is not that of the exact slope but of the one that fits
    its first cells best (7 times less at n = 2.5, 60 times at n = 2.05). With more or fewer points the table is sound
    too, but less good. Raises UsageError where the law is none: a force that is not finite or pulls, force or energy
    that do not vanish at touch, an energy whose derivative is not the force.
    """
    if not keyword or keyword.split() != [keyword] or keyword.startswith("#"):
        raise UsageError(f"table keyword {keyword!r}; allowed: one word that does not begin with #")
    if not 0.0 < reach < diameter < math.inf:
        raise UsageError(f"table reach = {reach!r} m at diameter {diameter!r} m; allowed: 0 < reach < diameter")
    if points < 2:
        raise UsageError(f"table points = {points}; allowed: >= 2")
    if lines < 8:
        raise UsageError(f"table lines = {lines}; allowed: >= 8")
    distance = np.unique(diameter - clustered(reach, law.kinks, lines - 1))
    if len(distance) < 8:
        raise UsageError(
            f"table reach = {reach!r} m has only {len(distance)} doubles at diameter {diameter!r} m; take a smaller one"
        )
    distance[0] = _innermost(float(distance[0]), diameter, points)
    overlap = diameter - distance
    force, energy = _values(law, overlap)
    columns = distance, energy, force
    for column in columns:
        column.setflags(write=False)
    return ContactTable(
        keyword=keyword,
        header=_header(date),
        distance=distance,
        energy=energy,
        force=force,
        slopes=(_slope(distance[:5], force[:5]), _slope_at_touch(law, float(distance[0]), diameter, points)),
    )


def zero_table(*, keyword: str, diameter: float, date: str, reach: float | None = None) -> ContactTable:
    """No force: for ``pair_coeff * *``, which must come first and covers the pairs that have no contact.

    Its innermost line is ``reach`` (m; None: 1/1024 of it) below the diameter: bodies that are no neighbours and meet
    stop LAMMPS there.
    """
    distance = np.array([diameter - reach if reach is not None else diameter * (1.0 - 2.0**-10), diameter])
    none = np.zeros(2)
    return ContactTable(
        keyword=keyword, header=_header(date), distance=distance, energy=none, force=none, slopes=(0.0, 0.0)
    )


def points_for(tables: int, *, memory: float = 5e8) -> int:
    """Points of each of ``tables`` internal tables (one a ``pair_coeff``) such that all take at most ``memory`` bytes.

    LAMMPS holds five arrays of the points and five of the lines for each. Raises UsageError where too few are left.

    >>> points_for(40), points_for(5000)
    (10000, 2250)
    """
    points = min(POINTS, int(memory / max(tables, 1) / 40.0) - LINES)
    if points < FEWEST_POINTS:
        raise UsageError(
            f"{tables} tables in {memory:g} bytes leave {max(points, 0)} points each; allowed: >= {FEWEST_POINTS};"
            " contacts of one stiffness can share a table"
        )
    return points


def _header(date: str) -> str:
    # LAMMPS reads DATE and UNITS
    return f"# DATE: {date} UNITS: si CONTRIBUTOR: dem_bridge {__version__}"


def _innermost(distance: float, diameter: float, points: int) -> float:
    """The innermost distance, moved by a few ulps until LAMMPS finds a cell for every distance below the cutoff.

    LAMMPS multiplies by a rounded inverse of the spacing. At overlaps of an ulp that can give the number of the
    cell after the last, and LAMMPS stops with "Pair distance > table outer cutoff"; a contact that just opens or
    closes gets there. What is found rises with the distance, so the largest one decides.
    """
    while not finds_all_cells(distance, diameter, points):
        distance = math.nextafter(distance, 0.0)
    return distance


def finds_all_cells(inner: float, cut: float, points: int) -> bool:
    """Whether LAMMPS finds a cell for each distance from ``inner`` to just below ``cut``."""
    squared = inner * inner
    spacing = (cut * cut - squared) / (points - 1)
    return int((math.nextafter(cut * cut, 0.0) - squared) * (1.0 / spacing)) < points - 1


def _values(law: ContactLaw, overlap: Floats) -> tuple[Floats, Floats]:
    """Force and energy at the overlaps, descending to 0; UsageError where they are not those of a contact."""
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
    """Between any two lines the energy must rise by the integral of the force.

    Tolerance: the integral's own error, of which the spread of three Gauss rules is a bound with a factor 8 (they
    differ where a law is not smooth), and round-off: 8 ulps of the two energies that are subtracted and 64 of the
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
            " law_of(force, ...) finds the energy, and needs the overlaps where the slope of the force jumps as kinks"
        )


def _slope(distance: Floats, force: Floats) -> float:
    """Derivative of the polynomial through the points at the first of them."""
    x = (distance - distance[0]) / (distance[-1] - distance[0])
    return float(np.linalg.solve(np.vander(x), force)[-2] / (distance[-1] - distance[0]))


@cache
def _cardinal(cells: int) -> tuple[Floats, Floats, Floats]:
    """Places in a grid of unit cells; spline there through (0 ... 1 ... 0) each, and with unit slope at the start."""
    from scipy.interpolate import CubicSpline  # brings half of scipy, and runs without tables need none of it

    place = np.concatenate([np.arange(1, 64) / 64.0, np.arange(64, 64 * min(cells // 2, 8) + 1, 4) / 64.0])
    grid = np.arange(cells + 1.0)
    through = CubicSpline(grid, np.eye(cells + 1), bc_type=((1, np.zeros(cells + 1)), "not-a-knot"))
    slope = CubicSpline(grid, np.zeros(cells + 1), bc_type=((1, 1.0), "not-a-knot"))
    return place, through(place), slope(place)


def _slope_at_touch(law: ContactLaw, inner: float, cut: float, points: int) -> float:
    """Derivative of force by distance at touch with which LAMMPS' spline comes nearest to the law in its last cells.

    The spline is linear in it: least squares of the error over the cells.
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
    # f/r by r^2, to f by r
    return float(by_squared * 2.0 * cut * cut)
