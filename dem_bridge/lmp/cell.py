"""What LAMMPS does in every step with a cell of its internal table; the rest of a table is :mod:`.interpolation`.

Apart from it, so that the twin, whose kernel calls this, knows nothing of how tables are made.
"""

from __future__ import annotations

from numba import njit


@njit(cache=True)  # type: ignore[misc,unused-ignore]
def pair_force(rsq, inner_squared, spacing, inverse_spacing, sixth, value, second):  # type: ignore[no-untyped-def]
    """Force over distance, N/m, at squared distance ``rsq`` (m^2) between inner and cutoff; scalar, for kernels.

    ``second`` is empty for style linear. The caller looks at the cutoff (no force from ``rsq >= cut_squared`` on) and
    at ``rsq < inner_squared``, where LAMMPS stops. A run beyond stability, whose bodies pass through each other, may
    ask for any distance: it gets an answer of no meaning, from the table's own memory.
    """
    place, last = (rsq - inner_squared) * inverse_spacing, len(value) - 2
    i = last if place >= last else int(place) if place > 0.0 else 0  # nan: 0
    b = (rsq - (inner_squared + i * spacing)) * inverse_spacing
    if len(second) == 0:
        return value[i] + b * (value[i + 1] - value[i])
    a = 1.0 - b
    return a * value[i] + b * value[i + 1] + ((a * a * a - a) * second[i] + (b * b * b - b) * second[i + 1]) * sixth
