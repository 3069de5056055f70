"""The interpolation that LAMMPS makes in each step within a cell of its internal table.

The rest of a table is in :mod:`.interpolation`. This function has a module of its own, so that the twin, whose kernel
calls it, does not depend on the construction of tables.
"""

from __future__ import annotations

from dem_bridge.foundation.compiled import Floats, kernel


@kernel(nogil=False)
def pair_force(
    rsq: float, inner_squared: float, spacing: float, inverse_spacing: float, sixth: float, value: Floats,
    second: Floats,
) -> float:  # fmt: skip
    """Return force over distance, N/m, at the squared distance ``rsq`` (m^2), for use in kernels.

    The distance is between the inner line and the cutoff. ``second`` is empty for style linear. The caller checks the
    cutoff (no force from ``rsq >= cut_squared`` on) and ``rsq < inner_squared``, where LAMMPS stops. An unstable run,
    whose bodies pass through each other, may pass any distance; the result is then meaningless, but computed from the
    table's own memory.
    """
    place, last = (rsq - inner_squared) * inverse_spacing, len(value) - 2
    i = last if place >= last else int(place) if place > 0.0 else 0  # nan: 0
    b = (rsq - (inner_squared + i * spacing)) * inverse_spacing
    if len(second) == 0:
        return float(value[i] + b * (value[i + 1] - value[i]))
    a = 1.0 - b
    bend = ((a * a * a - a) * second[i] + (b * b * b - b) * second[i + 1]) * sixth
    return float(a * value[i] + b * value[i + 1] + bend)
