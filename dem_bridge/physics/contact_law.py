"""Contact laws as functions of the overlap: the power law, and any force with its energy.

The power law is ``F = beta [overlap]_+^(n-1)`` with energy ``beta [overlap]_+^n / n``; n = 5/2 for Hertz
(Johnson 1985, *Contact Mechanics*, eq. 4.23). ``beta`` is the paper's contact stiffness coefficient.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dem_bridge.physics.numbers import above, number

Floats = NDArray[np.float64]


def force(overlap: ArrayLike, stiffness: ArrayLike, exponent: ArrayLike) -> Floats:
    """Return the contact force ``beta [overlap]_+^(n-1)``, N.

    Parameters
    ----------
    overlap : array_like
        Overlap, m; negative where the contact is open. The shapes of all three broadcast.
    stiffness : array_like
        Stiffness beta, N/m^(n-1).
    exponent : array_like
        Exponent n of the energy.

    References
    ----------
    Chaunsali, Kim & Yang (2018), section 3.

    Examples
    --------
    >>> round(float(force(4e-6, 1e9, 2.5)), 12), float(force(-1.0, 1e9, 2.5))
    (8.0, 0.0)
    """
    closed = np.maximum(np.asarray(overlap, dtype=float), 0.0)
    return np.asarray(stiffness * closed ** (np.asarray(exponent, dtype=float) - 1.0))


def energy(overlap: ArrayLike, stiffness: ArrayLike, exponent: ArrayLike) -> Floats:
    """Return the energy stored in a contact, ``beta [overlap]_+^n / n``, J.

    The parameters are those of :func:`force`.

    Examples
    --------
    >>> float(energy(4e-6, 1e9, 2.5))
    1.28e-05
    """
    closed = np.maximum(np.asarray(overlap, dtype=float), 0.0)
    return np.asarray(stiffness * closed ** np.asarray(exponent, dtype=float) / exponent)


@dataclass(frozen=True)
class ContactLaw:
    """Force (N) and stored energy (J) of a contact as functions of its overlap (m, >= 0), both 0 at touch.

    Both functions take and return arrays.
    """

    force: Callable[[Floats], Floats]
    energy: Callable[[Floats], Floats]
    kinks: tuple[float, ...] = ()
    """Overlaps (m) at which the slope of the force jumps."""


#: a contact law of a scene: with its energy, or the force alone, which is smooth except at touch
Law = ContactLaw | Callable[[Floats], Floats]

#: allowed difference between energy and work of the force, relative to the largest energy: kinks that the law does not
#: list cost the quadrature 1e-7
_ENERGY_FITS = 1e-6
#: allowed decrease of the force, relative to the largest force: round-off of a plateau
_FALLS = 1e-12
#: doublings of an overlap after which a law counts as too weak: a factor of 1e18
_DOUBLINGS = 60


def power_law(stiffness: float, exponent: float) -> ContactLaw:
    """Return the law ``F = beta overlap^(n-1)`` with energy ``beta overlap^n / n``.

    Parameters
    ----------
    stiffness : float
        Stiffness beta, N/m^(n-1).
    exponent : float
        Exponent n >= 2.

    Raises
    ------
    ValueError
        If a parameter is outside its range.

    Examples
    --------
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
    """Return the law of a force on overlaps up to ``reach``, with its energy by quadrature (relative error 1e-13).

    The quadrature uses panels of 10 Gauss points, which are clustered at touch and at kinks as the lines of a table
    file are.

    Parameters
    ----------
    force : callable
        Array function of the overlap (m) that returns the force (N); smooth except at touch and at ``kinks``.
    reach : float
        Largest overlap, m.
    kinks : iterable of float
        Overlaps at which the slope of the force jumps, m.

    Raises
    ------
    ValueError
        An argument is not as above, or ``force`` does not return a finite number for each overlap.

    Examples
    --------
    >>> law = law_of(lambda d: 1e6 * d + 1e9 * d**1.5, reach=1e-5)
    >>> exact = 1e6 * 1e-5**2 / 2 + 1e9 * 1e-5**2.5 / 2.5
    >>> bool(abs(law.energy(np.array([1e-5]))[0] / exact - 1) < 1e-13)
    True
    """
    reach, kinks = above(0.0, "reach", reach, "m"), tuple(number("kinks", kink, "m") for kink in kinks)
    if not callable(force):
        raise ValueError(f"force = {force!r}; allowed: an array function of the overlap (m)")
    overlaps = reach * np.array([[0.25, 0.5], [0.75, 1.0]])
    forces = np.asarray(force(overlaps))
    if forces.shape != overlaps.shape or forces.dtype.kind not in "fiu" or not np.isfinite(forces).all():
        returned = f"an array of shape {forces.shape} and type {forces.dtype}"
        raise ValueError(
            f"force(overlaps of shape (2, 2)) is {returned}; allowed: finite numbers (N), one for each overlap"
        )
    # powers of 1/2 in addition: where an overlap is at least half of a panel's end, any power has full precision
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
    """Return overlaps from 0 to ``reach``, ascending, clustered at touch and on both sides of the kinks.

    Distances grow as the square of the number of steps from there. With at most ``intervals`` intervals, a cubic spline
    through ``F ~ overlap^(n-1)`` then has its largest error far from touch for all n >= 2.
    """
    inner = sorted({kink for kink in kinks if 0.0 < kink < reach})
    ends = [0.0, *inner, reach]
    steps = max(intervals // (len(ends) - 1), 2)
    u = np.arange(steps + 1) / steps
    rising, falling = u**3, (1.0 - u) ** 3
    eased = rising / (rising + falling)
    parts = [low + (high - low) * (rising if high == reach else eased)[:-1] for low, high in pairwise(ends)]
    return np.concatenate([*parts, [reach]])


def completed(law: Law, *, reach: float) -> ContactLaw:
    """Return the law with its energy, for arrays of any shape."""

    def shaped(function: Callable[[Floats], Floats], overlap: Floats) -> Floats:
        overlap = np.asarray(overlap, dtype=float)
        if overlap.ndim == 1:
            return np.asarray(function(overlap), dtype=float)
        return np.asarray(function(overlap.ravel()), dtype=float).reshape(overlap.shape)

    if isinstance(law, ContactLaw):
        return ContactLaw(force=partial(shaped, law.force), energy=partial(shaped, law.energy), kinks=law.kinks)
    return law_of(partial(shaped, law), reach=reach)


def stored(law: Law, overlap: float) -> float:
    """Return the energy of the law at an overlap (m), J."""
    return float(completed(law, reach=overlap).energy(np.array(overlap))) if overlap > 0.0 else 0.0


def reach_of(law: Law, energy: float, *, near: float) -> float:
    """Return an overlap (m) at which the law stores ``energy`` (J), or up to an eighth more.

    The result has few digits, so that it does not depend on the last digits of a force.

    Parameters
    ----------
    law : ContactLaw or callable
        The law.
    energy : float
        Energy, J.
    near : float
        Overlap at which the search begins, m.

    Raises
    ------
    ValueError
        If the law is invalid up to the result, or never stores that energy. The message continues the law's name.

    Examples
    --------
    >>> reach = reach_of(lambda overlap: 1e6 * overlap, 5e-5, near=1e-6)
    >>> bool(1e-5 <= reach <= 1.125e-5)
    True
    """
    high = 2.0 ** math.ceil(math.log2(near))
    most, least = high * 2.0**_DOUBLINGS, high * 2.0**-_DOUBLINGS
    with np.errstate(all="ignore"):
        if energy > 0.0:
            while high > least and not _stored_if_valid(law, 0.5 * high) < energy:
                high *= 0.5
            if high <= least:
                check_law(law, near)  # the law is invalid everywhere: report this near the starting overlap
            while high < most and _stored_if_valid(law, high) < energy:
                high *= 2.0
            if high == most:
                problem = f"stores {stored(law, high):.3g} J at an overlap of {high:.3g} m, less than the energy"
                raise ValueError(f"{problem} of the scene, {energy:.3g} J")
            low, halvings = 0.5 * high, 0
            # up to 50 halvings where the law is invalid beyond some overlap
            while halvings < 4 or (halvings < 50 and math.isnan(_stored_if_valid(law, high))):
                middle, halvings = 0.5 * (low + high), halvings + 1
                low, high = (middle, high) if _stored_if_valid(law, middle) < energy else (low, middle)
        check_law(law, high)
    return high


def check_law(law: Law, reach: float) -> None:
    """Raise ValueError if the law is invalid on overlaps up to ``reach``; the message continues the law's name."""
    overlap = _probes(reach)
    _checked_force(law, overlap)
    if isinstance(law, ContactLaw):
        complete = completed(law, reach=reach)
        energy = complete.energy(overlap)
        work = law_of(complete.force, reach=reach, kinks=complete.kinks).energy(overlap)
        wrong = ~(np.abs(energy - work) <= _ENERGY_FITS * work[-1])
        if wrong.any():
            at = int(np.argmax(wrong))
            problem = f"has an energy of {energy[at]:.9g} J at overlap {overlap[at]:.6g} m, where its force has done"
            raise ValueError(f"{problem} {work[at]:.9g} J of work")


def _probes(reach: float) -> Floats:
    """Return the overlaps at which laws are checked, from 0 to ``reach``."""
    return np.unique(np.concatenate([clustered(reach, (), 64), np.linspace(0.0, reach, 65)]))


def _checked_force(law: Law, overlap: Floats) -> Floats:
    """Return the force at these ascending overlaps, or raise ValueError if it cannot be the force of a contact."""
    force = law.force if isinstance(law, ContactLaw) else law
    try:
        values = np.asarray(force(overlap), dtype=float)
    except Exception as error:  # a user's function may raise any exception
        text = " ".join(str(error).split())
        raise ValueError(f"raises {type(error).__name__} on an array of overlaps: {text}") from error
    if values.shape != overlap.shape:
        raise ValueError(f"returns an array of shape {values.shape} for overlaps of shape {overlap.shape}")
    wrong = ~np.isfinite(values) | (values < 0.0)
    if wrong.any():
        at = int(np.argmax(wrong))
        raise ValueError(f"= {float(values[at])!r} N at overlap {float(overlap[at]):.6g} m")
    if values[0] != 0.0:
        raise ValueError(f"= {float(values[0])!r} N at overlap 0")
    falls = np.diff(values) < -_FALLS * np.max(values)
    if falls.any():
        at = int(np.argmax(falls))
        problem = f"falls from {values[at]:.6g} N at overlap {overlap[at]:.6g} m to {values[at + 1]:.6g} N at"
        raise ValueError(f"{problem} {overlap[at + 1]:.6g} m")
    return values


def _stored_if_valid(law: Law, reach: float) -> float:
    """Return the energy at ``reach``, J; nan if the law is invalid up to there."""
    try:
        _checked_force(law, _probes(reach))
    except ValueError:
        return math.nan
    return stored(law, reach)
