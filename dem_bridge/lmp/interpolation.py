"""LAMMPS' evaluation of a table file, ``pair_style table linear|spline N``, reproduced operation by operation.

LAMMPS fits a spline through the lines of the file over r (here: *file spline*), evaluates it at N points that are
uniform in r^2 between the innermost line and the cutoff (*internal table*), and interpolates f/r there in every step,
linearly or by a second cubic spline. Source: LAMMPS manual, *pair_style table*, and its pair_table.cpp (the releases
from 2011 to 2025 agree in the operations that are reproduced here); splines after Press et al., *Numerical Recipes*,
section 3.3.

Every operation is in LAMMPS' order, so that the result equals LAMMPS' to the last bit.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from dem_bridge.errors import UsageError
from dem_bridge.foundation.compiled import kernel
from dem_bridge.lmp.force_table import ContactTable, Style, finds_all_cells
from dem_bridge.lmp.table_cell import pair_force
from dem_bridge.physics.contact_law import ContactLaw, Floats


@kernel(nogil=False)
def _pair_forces(
    rsq: Floats, cut_squared: float, inner_squared: float, spacing: float, inverse_spacing: float, sixth: float,
    value: Floats, second: Floats,
) -> Floats:  # fmt: skip
    """Return force over distance of many pairs, N/m; 0 from the cutoff on."""
    out = np.zeros(len(rsq))
    for k in range(len(rsq)):
        if rsq[k] < cut_squared:
            out[k] = pair_force(rsq[k], inner_squared, spacing, inverse_spacing, sixth, value, second)
    return out


@kernel(nogil=False)
def _second_derivatives(x: Floats, y: Floats, first: float, last: float) -> Floats:
    """Return the second derivatives of the cubic spline through (x, y) with the slopes ``first`` and ``last``."""
    n = len(x)
    second = np.empty(n)
    u = np.empty(n)
    second[0] = -0.5
    u[0] = (3.0 / (x[1] - x[0])) * ((y[1] - y[0]) / (x[1] - x[0]) - first)
    for i in range(1, n - 1):
        sig = (x[i] - x[i - 1]) / (x[i + 1] - x[i - 1])
        p = sig * second[i - 1] + 2.0
        second[i] = (sig - 1.0) / p
        u[i] = (y[i + 1] - y[i]) / (x[i + 1] - x[i]) - (y[i] - y[i - 1]) / (x[i] - x[i - 1])
        u[i] = (6.0 * u[i] / (x[i + 1] - x[i - 1]) - sig * u[i - 1]) / p
    un = (3.0 / (x[n - 1] - x[n - 2])) * (last - (y[n - 1] - y[n - 2]) / (x[n - 1] - x[n - 2]))
    second[n - 1] = (un - 0.5 * u[n - 2]) / (0.5 * second[n - 2] + 1.0)
    for k in range(n - 2, -1, -1):
        second[k] = second[k] * second[k + 1] + u[k]
    return second


@kernel(nogil=False)
def _read_off(x: Floats, y: Floats, second: Floats, at: Floats) -> Floats:
    """Return the values of the spline at the ascending places ``at``."""
    out = np.empty(len(at))
    low = 0
    for k in range(len(at)):
        # LAMMPS finds the last x that is not above `at` by bisection; a linear search gives the same
        while low < len(x) - 2 and x[low + 1] <= at[k]:
            low += 1
        h = x[low + 1] - x[low]
        a = (x[low + 1] - at[k]) / h
        b = (at[k] - x[low]) / h
        out[k] = (
            a * y[low]
            + b * y[low + 1]
            + ((a * a * a - a) * second[low] + (b * b * b - b) * second[low + 1]) * (h * h) / 6.0
        )
    return out


@dataclass(frozen=True, kw_only=True)
class Interpolation:
    """LAMMPS' internal table of one pair of types, with read-only arrays."""

    inner_squared: float
    """Square of the smallest distance, m^2; LAMMPS stops at closer pairs."""
    cut_squared: float
    """Square of the cutoff, m^2, from which on there is no force."""
    spacing: float
    """Spacing of r^2, m^2."""
    value: Floats
    """f/r at ``inner_squared + i spacing``, N/m, ``(points,)``."""
    second: Floats
    """Second derivatives of f/r over r^2, ``(points,)``; empty for style linear."""

    @property
    def arguments(self) -> tuple[float, float, float, float, Floats, Floats]:
        """Arguments of :func:`~dem_bridge.lmp.table_cell.pair_force` after ``rsq``."""
        h = self.spacing
        return self.inner_squared, h, 1.0 / h, h * h / 6.0, self.value, self.second

    def force(self, distance: Floats) -> Floats:
        """Return the force of pairs at these distances (m) as LAMMPS computes it, N; 0 from the cutoff on.

        Raises
        ------
        ValueError
            If a pair is closer than the innermost line, where LAMMPS stops.
        """
        distance = np.asarray(distance, dtype=float)
        squared = distance * distance
        if np.any(squared < self.inner_squared):
            raise ValueError(
                f"distance = {float(distance.min())!r} m; allowed: >= {math.sqrt(self.inner_squared)!r} m, where the"
                " table begins"
            )
        return np.asarray(
            distance * _pair_forces(squared.ravel(), self.cut_squared, *self.arguments).reshape(squared.shape)
        )


def interpolated(table: ContactTable, *, style: Style, points: int) -> Interpolation:
    """Return LAMMPS' internal table of a table file for ``pair_style table STYLE POINTS``.

    The cutoff is the last line of the file.

    Raises
    ------
    UsageError
        If the table was made for another number of points.
    """
    r, f = table.distance, table.force
    if not finds_all_cells(float(r[0]), float(r[-1]), points):
        raise UsageError(
            f"table {table.keyword} with {points} points: LAMMPS would stop just below the cutoff;"
            f" make the table for points={points}"
        )
    first, last = table.slopes
    second_of_file = _second_derivatives(r, f, first, last)
    inner_squared, cut = float(r[0] * r[0]), float(r[-1])
    spacing = (cut * cut - inner_squared) / (points - 1)
    squared = inner_squared + np.arange(points, dtype=np.float64) * spacing
    distance: Floats = np.sqrt(squared)
    internal = _read_off(r, f, second_of_file, distance)
    second = np.empty(0)
    inner = math.sqrt(inner_squared)
    low = (first / inner - float(internal[0]) / inner_squared) / (2.0 * inner)
    high = (last / cut - float(internal[-1]) / (cut * cut)) / (2.0 * cut)
    internal = internal / distance
    if style == "spline":
        second = _second_derivatives(squared, internal, low, high)
    for array in (internal, second):
        array.setflags(write=False)
    return Interpolation(
        inner_squared=inner_squared,
        cut_squared=cut * cut,
        spacing=spacing,
        value=internal,
        second=second,
    )


def interpolation_error(law: ContactLaw, interpolation: Interpolation, *, reach: float) -> float:
    """Return the largest error of LAMMPS' table force over overlaps in (0, reach], relative to the force at reach/1.1.

    The innermost tenth is a reserve for overlaps that exceed the prescan. The error is evaluated at 16 places in each
    of the 64 cells next to touch and of those near a kink, and at 4 places in all others; it is smooth within a cell.
    """
    inner_squared, cut = interpolation.inner_squared, math.sqrt(interpolation.cut_squared)
    points = len(interpolation.value)

    def distances(cells: Floats, places: int) -> Floats:
        """Return the distances of ``places`` in each cell, counted from touch."""
        at = (cells[:, None] + np.arange(1, places + 1) / places).ravel()
        squared = interpolation.cut_squared - at * interpolation.spacing
        return np.sqrt(squared[squared >= inner_squared])

    kink_cells = [(interpolation.cut_squared - (cut - kink) ** 2) // interpolation.spacing for kink in law.kinks]
    fine = [np.arange(64.0), *(np.arange(max(cell - 8.0, 0.0), cell + 9.0) for cell in kink_cells)]
    distance = np.concatenate([distances(np.concatenate(fine), 16), distances(np.arange(64.0, points - 1.0), 4)])
    overlap = cut - distance
    closed = overlap > 0.0
    error = abs(interpolation.force(distance[closed]) - law.force(overlap[closed]))
    return float(error.max() / law.force(np.array(reach / 1.1)))
