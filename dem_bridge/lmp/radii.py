"""Radii that encode the stiffness of each contact, for pair styles with one coefficient for all contacts.

``gran/hertz/history`` has F = Kn sqrt(R_eff) overlap^1.5 with 1/R_eff = 1/R_i + 1/R_(i+1). Contact i has its beta if
u_i + u_(i+1) = (Kn / beta_i)^2, where u = 1/R. The first radius determines all others, and only an interval of it makes
all of them positive; Kn scales them all. If stiffnesses are scattered at random, the interval is empty after a few
contacts.
"""

from __future__ import annotations

import math

import numpy as np

from dem_bridge.physics.contact import Floats

#: smallest ratio of a radius to the overlap of its contacts, so that bodies that are not neighbours never touch
MARGIN = 1.25
#: number of first radii that are tried within the interval
_TRIALS = 255


def encoded_radii(stiffness: Floats, overlap: Floats) -> tuple[Floats, float] | None:
    """Return radii (m) and Kn (N/m^2) that give each contact its stiffness, or None if there are none.

    Of all solutions the one with the shortest chain is returned, because round-off grows with positions.

    Parameters
    ----------
    stiffness : ndarray
        Stiffness beta of each contact, N/m^1.5, ``(n,)``.
    overlap : ndarray
        Largest overlap of each contact, m, ``(n,)``.

    Returns
    -------
    tuple or None
        Radii, ``(n + 1,)``, and Kn.

    Examples
    --------
    >>> radii, kn = encoded_radii(np.array([4e9, 4e9, 8e9]), np.full(3, 1e-6))
    >>> kn * np.sqrt(1.0 / (1.0 / radii[1:] + 1.0 / radii[:-1])) / [4e9, 4e9, 8e9]
    array([1., 1., 1.])
    >>> encoded_radii(np.array([4e9, 1e9, 4e9, 1e9, 9e9]), np.full(5, 1e-6)) is None
    True
    """
    if len(stiffness) == 0:
        return None
    target = (float(np.min(stiffness)) / stiffness) ** 2
    sign = np.where(np.arange(len(target) + 1) % 2 == 0, 1.0, -1.0)
    # u_i = sign_i (u_0 - shift_i): positive for even i above, for odd i below the shift
    shift = np.concatenate([[0.0], np.cumsum(sign[:-1] * target)])
    low, high = float(np.max(shift[::2])), float(np.min(shift[1::2]))
    if not low < high * (1.0 - 1e-9):
        return None
    deepest = np.maximum(np.append(overlap, 0.0), np.append(0.0, overlap))
    best, shortest = None, math.inf
    for part in np.arange(1, _TRIALS + 1) / (_TRIALS + 1):
        inverse = _inverse_radii(target, low + part * (high - low))
        if np.min(inverse) <= 0.0:
            continue
        # the largest scale of 1/R that keeps every radius above its lower bound
        needed = float(np.max(MARGIN * deepest * inverse)) or 2.0**-15
        length = needed * float(np.sum(1.0 / inverse))
        if length < shortest:
            best, shortest = (inverse, needed), length
    if best is None:
        return None
    inverse, needed = best
    least = needed / float(np.max(inverse))
    # the smallest radius is a power of two, so that equal radii give exact positions
    radii = 2.0 ** math.ceil(math.log2(least)) * (float(np.max(inverse)) / inverse)
    kn = float(stiffness[0]) * math.sqrt(1.0 / float(radii[0]) + 1.0 / float(radii[1]))
    return radii, kn


def _inverse_radii(target: Floats, first: float) -> Floats:
    """Return 1/R of each body, one after the other, so that each sum of two is exact to its last digit."""
    inverse = [first]
    for total in target.tolist():
        inverse.append(total - inverse[-1])
    return np.array(inverse)
