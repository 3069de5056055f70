"""Signs of single precision in a file that has more digits than single precision has."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from dem_bridge.judging.fitting import Block, Data

Floats = NDArray[np.float64]

#: fewest values from which a grid is recognised
FEWEST = 20
#: part of a spacing of single precision that the digits of a file must resolve
RESOLVED = 0.25
#: powers of two that are tried as the spacing of positions, m
SPACINGS = tuple(2.0**-k for k in range(18, 44))


def on_single_grid(data: Data) -> bool:
    """Return whether velocities or displacements are numbers of single precision, which the file's digits resolve.

    A code that keeps positions has displacements that are multiples of the spacing of single precision at a position.
    """
    tests = [result for block in data.blocks for result in _tests(block)]
    return bool(tests) and any(tests)


def _tests(block: Block) -> Iterator[bool]:
    """Yield the results for values themselves and, of displacements, for differences of positions."""
    present = block.present & (block.values != 0.0)
    values = block.values[present]
    digits = np.maximum(block.rounding[present], 2.0**-52 * np.abs(values))
    spacing = np.spacing(np.abs(values).astype(np.float32)).astype(np.float64)
    resolved = digits < RESOLVED * 0.5 * spacing
    if np.count_nonzero(resolved) >= FEWEST:
        away = np.abs(values - values.astype(np.float32).astype(np.float64))
        yield bool(np.all(away[resolved] <= 1.1 * digits[resolved]))
    if block.quantity == 1:
        yield _positions(block)


def _positions(block: Block) -> bool:
    """Return whether the displacements of each body are multiples of a power of two much larger than their digits."""
    for column in range(block.values.shape[1]):
        values = block.values[block.present[:, column], column]
        digits = np.maximum(block.rounding[block.present[:, column], column], 2.0**-52 * np.abs(values))
        if np.count_nonzero(values) < FEWEST:
            continue
        grids = (q for q in SPACINGS if q > float(np.max(digits)) / RESOLVED and q < 0.01 * float(np.ptp(values)))
        if not any(np.all(np.abs(values - q * np.rint(values / q)) <= 1.1 * digits) for q in grids):
            return False
    return True
