"""Signs of single precision in a file that has more digits than single precision has."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dem_bridge.judging.fitting import Block, Data

Floats = NDArray[np.float64]

#: fewest different values of a body from which a grid is recognised
FEWEST_VALUES_OF_GRID = 20
#: part of a spacing of single precision that the digits of a file must resolve
LARGEST_ROUNDING_SHARE = 0.25
#: part of the values that are on a grid: those of the start may not have been rounded yet
LEAST_SHARE_ON_GRID = 0.95
#: powers of two that are tried as the spacing of positions, m
SPACINGS_TRIED_M = tuple(2.0**-k for k in range(18, 44))


def on_single_grid(data: Data) -> bool:
    """Return whether velocities or displacements are numbers of single precision, which the file's digits resolve.

    A code that keeps positions has displacements that are multiples of the spacing of single precision at a position,
    except those of a body that starts at the origin.
    """
    for block in data.blocks:
        columns = [_column(block, column) for column in range(block.values.shape[1])]
        moved = [(values, digits) for values, digits in columns if len(np.unique(values)) >= FEWEST_VALUES_OF_GRID]
        singles = [_are_singles(values, digits) for values, digits in moved]
        if singles and all(singles):
            return True
        if block.quantity == 1:
            grids = [_on_grid(values, digits) for values, digits in moved]
            if any(grids) and all(grid or single for grid, single in zip(grids, singles, strict=True)):
                return True
    return False


def _column(block: Block, column: int) -> tuple[Floats, Floats]:
    """Return the values of a body that are not 0, and their rounding errors by the digits of the file."""
    chosen = block.present[:, column] & (block.values[:, column] != 0.0)
    values = block.values[chosen, column]
    return values, np.maximum(block.rounding[chosen, column], 2.0**-52 * np.abs(values))


def _are_singles(values: Floats, digits: Floats) -> bool:
    """Return whether values are numbers of single precision: to all digits of a double, or to those of the file."""
    away = np.abs(values - values.astype(np.float32).astype(np.float64))
    half = 0.5 * np.spacing(np.abs(values).astype(np.float32)).astype(np.float64)
    exactly = away <= 2.0**-50 * np.abs(values)
    resolved = digits < LARGEST_ROUNDING_SHARE * half
    on_grid = exactly | (resolved & (away <= 1.1 * digits))
    return bool(np.mean(on_grid) > LEAST_SHARE_ON_GRID)


def _on_grid(values: Floats, digits: Floats) -> bool:
    """Return whether displacements are multiples of a power of two much larger than their digits."""
    least, most = float(np.max(digits)) / LARGEST_ROUNDING_SHARE, 0.01 * float(np.ptp(values))
    remainders = (np.abs(values - q * np.rint(values / q)) for q in SPACINGS_TRIED_M if least < q < most)
    return any(np.mean(remainder <= 1.1 * digits) > LEAST_SHARE_ON_GRID for remainder in remainders)
