"""Contact laws that are functions, for compiled kernels: cubic splines over the square root of the overlap.

There ``F ~ overlap^(n-1)`` is a polynomial for n = 2, 2.5, 3, ... and smooth to order 2(n-1) at least for any other n,
and at touch nothing is lost. A law with kinks has a spline of its own from each kink on.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dem_bridge.foundation.compiled import kernel
from dem_bridge.scene.contacts import Contacts, Floats
from dem_bridge.scene.scene import Scene

#: cells of a law; half as many tell what that costs
CELLS = 16_384


class Curves(NamedTuple):
    """The laws of a scene, each up to the overlaps that the energy at hand can make; beyond, the force stays."""

    law: NDArray[np.int64]
    """Row below for each contact; empty: all are powers."""
    start: Floats
    """``(n_law, n_piece)``, m: overlap at which a piece begins, inf for one that is not there."""
    per_root: Floats
    """``(n_law, n_piece)``: cells per square root of the overlap beyond the start, m^(-1/2)."""
    coefficient: Floats
    """``(n_law, n_piece, n_cell, 4)``, N, highest power first."""


#: contacts are powers
POWERS = Curves(np.zeros(0, dtype=np.int64), np.zeros((0, 0)), np.zeros((0, 0)), np.zeros((0, 0, 0, 4)))


def curves_of(scene: Scene, cells: int = CELLS) -> Curves:
    """Return the laws of a scene that are functions, with so many ``cells`` each."""
    return POWERS if scene.law is None else _curves(scene.contacts, cells)


@lru_cache(maxsize=4)  # a run and the runs for its bars ask for the same
def _curves(c: Contacts, cells: int) -> Curves:
    from scipy.interpolate import CubicSpline  # brings half of scipy, and powers need none of it

    starts = [
        [0.0, *sorted({kink for kink in law.kinks if 0.0 < kink < reach})]
        for law, reach in zip(c.laws, c.reach.tolist(), strict=True)
    ]
    pieces = max(map(len, starts), default=1)
    each = max(cells // pieces, 8)
    start, per_root = np.full((len(starts), pieces), np.inf), np.zeros((len(starts), pieces))
    coefficient = np.zeros((len(starts), pieces, each, 4))
    grid = np.linspace(0.0, 1.0, each + 1)
    for row, (law, reach, begins) in enumerate(zip(c.laws, c.reach.tolist(), starts, strict=True)):
        for piece, (low, high) in enumerate(zip(begins, [*begins[1:], reach], strict=True)):
            overlap = np.minimum(low + (high - low) * grid**2, high)
            start[row, piece], per_root[row, piece] = low, each / np.sqrt(high - low)
            spline = CubicSpline(np.arange(each + 1.0), law.force(overlap))
            coefficient[row, piece] = spline.c.T
    # a copy that may be written to, as in POWERS, since numba compiles a kernel again for arrays that may not
    return Curves(c.law.copy(), start, per_root, coefficient)


@kernel(nogil=False)
def curve_force(contact: int, overlap: float, curves: Curves) -> float:
    """Force, N, of a contact at an overlap > 0; scalar, for kernels."""
    row = curves.law[contact]
    start = curves.start[row]
    piece = 0
    while piece + 1 < len(start) and overlap > start[piece + 1]:
        piece += 1
    coefficient = curves.coefficient[row, piece]
    place = np.sqrt(overlap - start[piece]) * curves.per_root[row, piece]
    if not place < len(coefficient):  # deeper than anything can get, or no number
        place = 1.0 * len(coefficient)
    cell = min(int(place), len(coefficient) - 1)
    b = place - cell
    c = coefficient[cell]
    return float(((c[0] * b + c[1]) * b + c[2]) * b + c[3])
