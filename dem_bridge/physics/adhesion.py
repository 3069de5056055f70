"""Impacts with adhesion on Hertz contacts: DMT, and JKR with the two ends of contact that are in use.

Both laws are fixed by the stiffness ``beta = (4/3) E* sqrt(R)`` and the pull-off force P, which give the length ``L =
(P/beta)^(2/3)`` and the energy P L:

* DMT: ``F = beta d^(3/2) - P`` at overlaps d > 0. No energy is lost.
* JKR, with s^2 proportional to the radius of contact::

      d/L = s^4 - (4/3) s        F/P = s^6 - 2 s^3        U/(P L) = (2/5) s^10 - (4/3) s^7 + (2/3) s^4

  Bodies meet at d = 0, where the contact jumps to ``s = (4/3)^(1/3)`` with the force -8/9 P. When they separate, the
  contact holds on to an overlap below 0 and loses the energy W that this pulls out. Under controlled displacement it
  breaks where dd/ds = 0, at ``s = 3^(-1/3)`` and the force -5/9 P (Johnson 1985, *Contact Mechanics*, section 5.5);
  LAMMPS breaks it at the least force -P, at s = 1.

Bodies stick below the speed ``sqrt(2 W/m)``; above it ``e = sqrt(1 - 2 W/(m v^2))``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, get_args

from dem_bridge.physics.numbers import above, not_negative

#: where a JKR contact breaks: at the least overlap (textbook), or at the least force (LAMMPS)
Break = Literal["overlap", "force"]
AdhesionLaw = Literal["dmt", "jkr"]
_TOUCH = math.cbrt(4.0 / 3.0)
_BREAK = {"overlap": math.cbrt(1.0 / 3.0), "force": 1.0}


@dataclass(frozen=True, kw_only=True)
class AdhesiveImpact:
    """Impact of two spheres, or of a sphere and a plane, with adhesion and without damping.

    :func:`dmt_impact` and :func:`jkr_impact` compute it.
    """

    peak_overlap: float
    """Largest overlap, m."""
    peak_force: float
    """Largest force, N."""
    break_overlap: float
    """Overlap at which the contact breaks, m; below 0 for JKR."""
    loss: float
    """Energy W that is lost where the contact breaks, J."""
    sticking_speed: float
    """Speed of approach up to which the bodies stick, m/s."""
    restitution: float
    """Coefficient of restitution; 0 where the bodies stick."""


def pull_off_force(law: AdhesionLaw, *, radius: float, surface_energy: float) -> float:
    """Return the force P that separates two spheres, or a sphere and a plane, N.

    ``4 pi gamma R`` for "dmt" and ``3 pi gamma R`` for "jkr", with the surface energy gamma of LAMMPS, half of the work
    of adhesion.

    Parameters
    ----------
    law : str
        "dmt" or "jkr".
    radius : float
        Reduced radius R, m: 1/(1/R1 + 1/R2), or the radius of a sphere on a plane.
    surface_energy : float
        Surface energy gamma, J/m^2.

    Raises
    ------
    ValueError
        If a parameter is outside its range.

    References
    ----------
    Johnson, Kendall & Roberts (1971), *Proc. R. Soc. A* 324, 301; Derjaguin, Muller & Toporov (1975), *J. Colloid
    Interface Sci.* 53, 314.

    Examples
    --------
    >>> [round(pull_off_force(law, radius=1e-3, surface_energy=0.05) * 1e6, 3) for law in ("dmt", "jkr")]
    [628.319, 471.239]
    """
    if law not in get_args(AdhesionLaw):
        raise ValueError(f"adhesion law = {law!r}; allowed: {', '.join(map(repr, get_args(AdhesionLaw)))}")
    factor = {"dmt": 4.0, "jkr": 3.0}[law] * math.pi
    return factor * above(0.0, "surface_energy", surface_energy, "J/m^2") * above(0.0, "radius", radius, "m")


def dmt_impact(*, mass: float, speed: float, stiffness: float, pull_off: float) -> AdhesiveImpact:
    """Return the impact under DMT's law, which conserves energy: e = 1.

    Parameters
    ----------
    mass : float
        Effective mass m, kg: 1/(1/m1 + 1/m2), or the mass of a sphere that hits a plane.
    speed : float
        Speed of approach, m/s.
    stiffness : float
        Stiffness beta, N/m^1.5.
    pull_off : float
        Pull-off force P, N, >= 0.

    Raises
    ------
    ValueError
        If a parameter is outside its range.

    References
    ----------
    Derjaguin, Muller & Toporov (1975), *J. Colloid Interface Sci.* 53, 314.

    Examples
    --------
    >>> hit = dmt_impact(mass=0.4, speed=2.0, stiffness=1.0, pull_off=0.4)
    >>> f"{hit.peak_overlap:.9f} m, {hit.peak_force:.9f} N, e = {hit.restitution}"
    '1.684881731 m, 1.787026937 N, e = 1.0'
    """
    from scipy.optimize import brentq

    energy, beta = _kinetic_energy(mass, speed), above(0.0, "stiffness", stiffness, "N/m^1.5")
    force = not_negative("pull_off", pull_off, "N")

    def stored(root: float) -> float:
        return 0.4 * beta * root**5 - force * root**2 - energy

    # the roots without P and without kinetic energy: their sum is above the root
    hertz, zero = (2.5 * energy / beta) ** 0.2, math.cbrt(2.5 * force / beta)
    overlap = (
        float(brentq(stored, hertz * (1.0 - 1e-12), (hertz + zero) * (1.0 + 1e-12), xtol=1e-16 * hertz, rtol=1e-15))
        ** 2
    )
    peak = beta * overlap**1.5 - force
    return AdhesiveImpact(
        peak_overlap=overlap, peak_force=peak, break_overlap=0.0, loss=0.0, sticking_speed=0.0, restitution=1.0
    )


def jkr_impact(*, mass: float, speed: float, stiffness: float, pull_off: float, breaks_at: Break) -> AdhesiveImpact:
    """Return the impact under the law of Johnson, Kendall & Roberts.

    Parameters
    ----------
    mass, speed, stiffness : float
        As for :func:`dmt_impact`.
    pull_off : float
        Pull-off force P, N.
    breaks_at : str
        "overlap": at the least overlap, as in textbooks (controlled displacement). "force": at the least force, as in
        LAMMPS.

    Raises
    ------
    ValueError
        If a parameter is outside its range.

    References
    ----------
    Johnson, Kendall & Roberts (1971), *Proc. R. Soc. A* 324, 301; Johnson (1985), *Contact Mechanics*, section 5.5.

    Examples
    --------
    >>> for breaks_at in ("overlap", "force"):
    ...     hit = jkr_impact(mass=0.4, speed=2.0, stiffness=1.0, pull_off=1.0, breaks_at=breaks_at)
    ...     print(f"W = {hit.loss:.9f} J, e = {hit.restitution:.9f}, breaks at {hit.break_overlap:.9f} m")
    W = 0.648641402 J, e = 0.434969249, breaks at -0.693361274 m
    W = 0.320342622 J, e = 0.774320168, breaks at -0.333333333 m
    """
    if breaks_at not in _BREAK:
        raise ValueError(f"breaks_at = {breaks_at!r}; allowed: {', '.join(map(repr, _BREAK))}")
    from scipy.optimize import brentq

    energy, beta = _kinetic_energy(mass, speed), above(0.0, "stiffness", stiffness, "N/m^1.5")
    force = above(0.0, "pull_off", pull_off, "N")
    length = (force / beta) ** (2.0 / 3.0)
    unit = force * length
    loss, total = unit * (jkr_energy(_BREAK[breaks_at]) - jkr_energy(_TOUCH)), energy / unit + jkr_energy(_TOUCH)
    # the energy exceeds (2/5) s^10 - (4/3) s^7, and s^10/15 from s^3 = 4 on
    most = max(4.0 ** (1.0 / 3.0), (15.0 * max(total, 0.0)) ** 0.1)
    state = float(brentq(lambda s: jkr_energy(s) - total, math.cbrt(2.0), most * 1.01, xtol=1e-16, rtol=1e-15))
    return AdhesiveImpact(
        peak_overlap=length * (state**4 - 4.0 / 3.0 * state),
        peak_force=force * (state**6 - 2.0 * state**3),
        break_overlap=length * (_BREAK[breaks_at] ** 4 - 4.0 / 3.0 * _BREAK[breaks_at]),
        loss=loss,
        sticking_speed=math.sqrt(2.0 * loss / mass),
        restitution=math.sqrt(max(1.0 - loss / energy, 0.0)),
    )


def jkr_energy(s: float) -> float:
    """Return the energy of the JKR contact over P L, relative to a contact of radius 0.

    ``s`` is the square root of the radius of the contact, in units in which the overlap is ``L (s^4 - 4/3 s)`` and the
    force ``P (s^6 - 2 s^3)``.

    >>> round(jkr_energy(2.0 ** (1.0 / 3.0)), 12)  # without force: -(2/5) 2^(4/3)
    -1.007936839916
    """
    return 0.4 * s**10 - 4.0 / 3.0 * s**7 + 2.0 / 3.0 * s**4


def _kinetic_energy(mass: float, speed: float) -> float:
    """Return the energy of the relative motion, J."""
    return 0.5 * above(0.0, "mass", mass, "kg") * above(0.0, "speed", speed, "m/s") ** 2
