"""Radii that carry the stiffness, for pair styles that have one coefficient for all contacts.

``gran/hertz/history`` has F = Kn sqrt(R_eff) overlap^1.5 with 1/R_eff = 1/R_i + 1/R_(i+1). Contact i has its own beta
if u_i + u_(i+1) = (Kn / beta_i)^2, where u = 1/R: the first radius decides all others, and only a window of it leaves
all of them positive. Kn scales them all. Where stiffnesses are scattered at random the window closes after a few
contacts.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

#: radius over the largest overlap beside it, at least; then bodies that are not neighbours never touch
MARGIN = 1.25
#: first radii that are looked at, within their window
_TRIALS = 255


def encoded_radii(stiffness: Floats, overlap: Floats) -> tuple[Floats, float] | None:
    """Radii (m) of ``len(stiffness) + 1`` bodies in a row and Kn (N/m^2) such that contact i has the given beta
    (N/m^1.5); None where no radii do. ``overlap (n,)``: the largest of each contact, m. Of all that serve, those with
    the shortest chain, because round-off goes with positions.

    >>> radii, kn = encoded_radii(np.array([4e9, 4e9, 8e9]), np.full(3, 1e-6))
    >>> kn * np.sqrt(1.0 / (1.0 / radii[1:] + 1.0 / radii[:-1])) / [4e9, 4e9, 8e9]
    array([1., 1., 1.])
    >>> encoded_radii(np.array([4e9, 1e9, 4e9, 1e9, 9e9]), np.full(5, 1e-6)) is None
    True
    """
    if len(stiffness) == 0:
        return None
    wanted = (float(np.min(stiffness)) / stiffness) ** 2
    sign = np.where(np.arange(len(wanted) + 1) % 2 == 0, 1.0, -1.0)
    # u_i = sign_i (u_0 - shift_i): positive for even i above, for odd i below the shift
    shift = np.concatenate([[0.0], np.cumsum(sign[:-1] * wanted)])
    low, high = float(np.max(shift[::2])), float(np.min(shift[1::2]))
    if not low < high * (1.0 - 1e-9):
        return None
    deepest = np.maximum(np.append(overlap, 0.0), np.append(0.0, overlap))
    best, shortest = None, math.inf
    for part in np.arange(1, _TRIALS + 1) / (_TRIALS + 1):
        inverse = _inverse_radii(wanted, low + part * (high - low))
        if np.min(inverse) <= 0.0:
            continue
        # the largest scale of 1/R that leaves every radius above what it must exceed
        needed = float(np.max(MARGIN * deepest * inverse)) or 2.0**-15
        length = needed * float(np.sum(1.0 / inverse))
        if length < shortest:
            best, shortest = (inverse, needed), length
    if best is None:
        return None
    inverse, needed = best
    least = needed / float(np.max(inverse))
    # a power of two for the smallest: equal radii then make exact positions
    radii = 2.0 ** math.ceil(math.log2(least)) * (float(np.max(inverse)) / inverse)
    kn = float(stiffness[0]) * math.sqrt(1.0 / float(radii[0]) + 1.0 / float(radii[1]))
    return radii, kn


def _inverse_radii(wanted: Floats, first: float) -> Floats:
    """One after the other, so that each sum of two is right to its last digit however long the chain is."""
    found = [first]
    for one in wanted.tolist():
        found.append(one - found[-1])
    return np.array(found)
