"""Contact laws as functions of overlap: powers, and any force with the energy that belongs to it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
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


#: what a person may give as a law: with its energy, or the force alone, smooth but for touch
Law = ContactLaw | Callable[[Floats], Floats]

#: an energy is that of the force up to this part of the largest: kinks that nobody told of cost the quadrature 1e-7
_ENERGY_FITS = 1e-6
#: a force may fall by so much of the largest: round-off of a plateau
_FALLS = 1e-12
#: doublings of an overlap after which a law counts as too weak: a factor 1e18
_DOUBLINGS = 60


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
    """The law of any force on overlaps up to ``reach`` (m); its energy by quadrature, good to 1e-13.

    ``force``: array function, N of m, smooth but for touch and the overlaps ``kinks``, where its slope jumps.
    Panels of 10 Gauss points are close together at touch and at kinks as the lines of a file are.

    >>> law = law_of(lambda d: 1e6 * d + 1e9 * d**1.5, reach=1e-5)
    >>> exact = 1e6 * 1e-5**2 / 2 + 1e9 * 1e-5**2.5 / 2.5
    >>> bool(abs(law.energy(np.array([1e-5]))[0] / exact - 1) < 1e-13)
    True
    """
    kinks = tuple(kinks)
    # halves besides: where an overlap is at least half of a panel's end, any power has all its digits
    edges = np.union1d(clustered(reach, kinks, 200), reach * 2.0 ** -np.arange(60.0))
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


def completed(law: Law, *, reach: float) -> ContactLaw:
    """The law with its energy, on arrays of any shape."""

    def shaped(function: Callable[[Floats], Floats], overlap: Floats) -> Floats:
        overlap = np.asarray(overlap, dtype=float)
        if overlap.ndim == 1:
            return np.asarray(function(overlap), dtype=float)
        return np.asarray(function(overlap.ravel()), dtype=float).reshape(overlap.shape)

    if isinstance(law, ContactLaw):
        return ContactLaw(force=partial(shaped, law.force), energy=partial(shaped, law.energy), kinks=law.kinks)
    return law_of(partial(shaped, law), reach=reach)


def stored(law: Law, overlap: float) -> float:
    """Energy of the law at an overlap (m), J."""
    return float(completed(law, reach=overlap).energy(np.array(overlap))) if overlap > 0.0 else 0.0


def reach_of(law: Law, energy: float, *, near: float) -> float:
    """Overlap (m) at which the law stores ``energy`` (J), or up to an eighth more. ``near`` (m): where to begin.

    It has few digits, so it does not depend on the last of a force. Raises ValueError, with a text that goes on from
    the law's name, where the law is none up to there, or never stores so much.

    >>> reach = reach_of(lambda overlap: 1e6 * overlap, 5e-5, near=1e-6)
    >>> bool(1e-5 <= reach <= 1.125e-5)
    True
    """
    high = 2.0 ** math.ceil(math.log2(near))
    most, least = high * 2.0**_DOUBLINGS, high * 2.0**-_DOUBLINGS
    with np.errstate(all="ignore"):
        if energy > 0.0:
            while high > least and not _stored_if_sound(law, 0.5 * high) < energy:
                high *= 0.5
            if high <= least:
                check_law(law, near)  # no law anywhere: shown where a person would look
            while high < most and _stored_if_sound(law, high) < energy:
                high *= 2.0
            if high == most:
                problem = f"stores {stored(law, high):.3g} J at an overlap of {high:.3g} m; {energy:.3g} J are at hand"
                raise ValueError(problem)
            low, halvings = 0.5 * high, 0
            # more than enough of them where there is no law behind some overlap
            while halvings < 4 or (halvings < 50 and math.isnan(_stored_if_sound(law, high))):
                middle, halvings = 0.5 * (low + high), halvings + 1
                low, high = (middle, high) if _stored_if_sound(law, middle) < energy else (low, middle)
        check_law(law, high)
    return high


def check_law(law: Law, reach: float) -> None:
    """Raises ValueError, with a text that goes on from the law's name, where it is none on overlaps up to ``reach``."""
    overlap = _some(reach)
    _look_at(law, overlap)
    if isinstance(law, ContactLaw):
        own = completed(law, reach=reach)
        told = own.energy(overlap)
        work = law_of(own.force, reach=reach, kinks=own.kinks).energy(overlap)
        wrong = ~(np.abs(told - work) <= _ENERGY_FITS * work[-1])
        if wrong.any():
            at = int(np.argmax(wrong))
            problem = f"has an energy of {told[at]:.9g} J at overlap {overlap[at]:.6g} m, where its force has done"
            raise ValueError(f"{problem} {work[at]:.9g} J of work")


def _some(reach: float) -> Floats:
    """Overlaps at which laws are looked at, from 0 to ``reach``."""
    return np.unique(np.concatenate([clustered(reach, (), 64), np.linspace(0.0, reach, 65)]))


def _look_at(law: Law, overlap: Floats) -> Floats:
    """The force at these overlaps, ascending from 0; ValueError where it is none of a contact."""
    force = law.force if isinstance(law, ContactLaw) else law
    try:
        found = np.asarray(force(overlap), dtype=float)
    except Exception as error:  # whatever a person's function may raise
        text = " ".join(str(error).split())
        raise ValueError(f"raises {type(error).__name__} on an array of overlaps: {text}") from error
    if found.shape != overlap.shape:
        raise ValueError(f"gives an array of shape {found.shape} for overlaps of shape {overlap.shape}")
    wrong = ~np.isfinite(found) | (found < 0.0)
    if wrong.any():
        at = int(np.argmax(wrong))
        raise ValueError(f"= {float(found[at])!r} N at overlap {float(overlap[at]):.6g} m")
    if found[0] != 0.0:
        raise ValueError(f"= {float(found[0])!r} N at overlap 0")
    falls = np.diff(found) < -_FALLS * np.max(found)
    if falls.any():
        at = int(np.argmax(falls))
        problem = f"falls from {found[at]:.6g} N at overlap {overlap[at]:.6g} m to {found[at + 1]:.6g} N at"
        raise ValueError(f"{problem} {overlap[at + 1]:.6g} m")
    return found


def _stored_if_sound(law: Law, reach: float) -> float:
    """Energy at ``reach``, J; nan where the law is none up to there."""
    try:
        _look_at(law, _some(reach))
    except ValueError:
        return math.nan
    return stored(law, reach)
