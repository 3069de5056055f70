"""Contact laws as functions of overlap: powers, and any force with the energy that belongs to it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from dem_bridge.physics.contact import Floats


@dataclass(frozen=True)
class ContactLaw:
    """Force (N) and stored energy (J) of a contact as array functions of its overlap (m, >= 0); both 0 at touch."""

    force: Callable[[Floats], Floats]
    energy: Callable[[Floats], Floats]
    kinks: tuple[float, ...] = ()
    """Overlaps (m) at which the slope of the force jumps."""


def power_law(stiffness: float, exponent: float) -> ContactLaw:
    """``F = beta overlap^(n-1)`` with energy ``beta overlap^n / n``; ``stiffness`` beta in N/m^(n-1), n >= 2.

    Raises ValueError for other values.

    >>> law = power_law(1e9, 2.5)
    >>> float(law.force(np.array(4e-6)).round(12)), float(law.energy(np.array(4e-6)).round(18))
    (8.0, 1.28e-05)
    """
    if not (math.isfinite(stiffness) and stiffness > 0.0):
        raise ValueError(f"stiffness = {stiffness!r}; allowed: a number > 0 (N/m^(n-1))")
    if not (math.isfinite(exponent) and exponent >= 2.0):
        raise ValueError(f"exponent n = {exponent!r}; allowed: n >= 2, so that the force has a slope at touch")
    return ContactLaw(
        force=lambda overlap: np.asarray(stiffness * overlap ** (exponent - 1.0)),
        energy=lambda overlap: np.asarray(stiffness * overlap**exponent / exponent),
    )


def law_of(force: Callable[[Floats], Floats], *, reach: float, kinks: Iterable[float] = ()) -> ContactLaw:
    """The law of any force on overlaps up to ``reach`` (m); its energy by quadrature, good to 1e-13 of the largest.

    ``force``: array function, N of m, smooth but for touch and the overlaps ``kinks``, where its slope jumps.
    Panels of 10 Gauss points are close together at touch and at kinks as the lines of a file are.

    >>> law = law_of(lambda d: 1e6 * d + 1e9 * d**1.5, reach=1e-5)
    >>> exact = 1e6 * 1e-5**2 / 2 + 1e9 * 1e-5**2.5 / 2.5
    >>> bool(abs(law.energy(np.array([1e-5]))[0] / exact - 1) < 1e-13)
    True
    """
    kinks = tuple(kinks)
    edges = clustered(reach, kinks, 200)
    node, weight = np.polynomial.legendre.leggauss(10)

    def between(low: Floats, high: Floats) -> Floats:
        half = 0.5 * (high - low)[..., None]
        return np.asarray((force(low[..., None] + half * (1.0 + node)) * half) @ weight)

    whole = np.concatenate([[0.0], np.cumsum(between(edges[:-1], edges[1:]))])

    def energy(overlap: Floats) -> Floats:
        overlap = np.asarray(overlap, dtype=float)
        panel = np.clip(np.searchsorted(edges, overlap, side="right") - 1, 0, len(edges) - 2)
        return np.asarray(whole[panel] + between(edges[panel], overlap))

    return ContactLaw(force=force, energy=energy, kinks=kinks)


def clustered(reach: float, kinks: Iterable[float], intervals: int) -> Floats:
    """Overlaps from 0 to ``reach``, ascending, close together at touch and on both sides of the kinks.

    Distances grow as the square of the number of steps from there: with that many ``intervals`` at most, a cubic
    spline through ``F ~ overlap^(n-1)`` has its largest error far from touch for all n >= 2.
    """
    inner = sorted({kink for kink in kinks if 0.0 < kink < reach})
    ends = [0.0, *inner, reach]
    share = max(intervals // (len(ends) - 1), 2)
    u = np.arange(share + 1) / share
    one, other = u**3, (1.0 - u) ** 3
    both = one / (one + other)
    parts = [low + (high - low) * (one if high == reach else both)[:-1] for low, high in pairwise(ends)]
    return np.concatenate([*parts, [reach]])
