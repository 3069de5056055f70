"""Normal impact with the force ``F = beta d^(n-1) + alpha sqrt(m beta) d^((n-2)/2) d'``, and its restitution.

d is the overlap and m the effective mass, 1/(1/m1 + 1/m2) or the mass of a body that hits a wall. With
``y = d^(n/2)`` and ``ds = d^((n-2)/2) dt`` the motion is that of a damped linear oscillator of damping ratio
``alpha / sqrt(2 n)``, whatever n, speed, mass and stiffness are: the restitution e depends on alpha alone (Antypov &
Elliott 2011, *EPL* 94, 50004, for n = 5/2), and also where the net force is clipped at zero (Schwager & Poeschel 2007,
*Granul. Matter* 9, 465, for n = 2).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Literal, get_args

from dem_bridge.physics.dashpot import linear_restitution
from dem_bridge.physics.valid import above, not_negative

#: damping laws with a coefficient of restitution as their input
RestitutionLaw = Literal["coeff_restitution", "tsuji"]


def restitution(value: float) -> float:
    """Return ``value`` as a coefficient of restitution, a float above 0 and up to 1.

    Raises
    ------
    ValueError
        If ``value`` is not such a number.
    """
    if above(0.0, "restitution", value) > 1.0:
        raise ValueError(f"restitution = {value!r}; allowed: a number above 0 and up to 1")
    return float(value)


def alpha_of_restitution(e: float, exponent: float = 2.5) -> float:
    """Return the factor alpha of the damping force with which a contact that is not clipped has the restitution ``e``.

    ``alpha = -sqrt(2 n) ln e / sqrt(pi^2 + (ln e)^2)``, the exact inverse of ``e = exp(-pi alpha / sqrt(2 n -
    alpha^2))``; ``sqrt(2 n)`` is sqrt(5) for Hertz and 2 for a linear spring. LAMMPS: ``damping coeff_restitution``.

    Parameters
    ----------
    e : float
        Coefficient of restitution, above 0 and up to 1.
    exponent : float
        Exponent n of the contact, above 1.

    Returns
    -------
    float
        alpha, without unit.

    Raises
    ------
    ValueError
        If a parameter is outside its range.

    References
    ----------
    Antypov, D. & Elliott, J. A. 2011, *EPL* 94, 50004, eq. 16.

    Examples
    --------
    >>> round(alpha_of_restitution(0.5), 12), round(alpha_of_restitution(0.5, exponent=2.0), 12)
    (0.481769257765, 0.430907523932)
    """
    log = math.log(restitution(e))
    # 0.0 - x, so that e = 1 does not give -0.0
    return 0.0 - math.sqrt(2.0 * above(1.0, "exponent", exponent)) * log / math.hypot(math.pi, log)


def alpha_of_tsuji(e: float) -> float:
    """Return the factor alpha of the damping force by Marshall's polynomial of the restitution ``e``.

    The polynomial is a fit to the curve of Tsuji et al. for Hertz. Its prefactor is sqrt(2) for the effective mass of
    a pair. A contact with n = 5/2 that is not clipped has the restitution e to 1.1e-3 for e >= 0.1. LAMMPS: ``damping
    tsuji``, with the prefactor from 2026 on.

    Parameters
    ----------
    e : float
        Coefficient of restitution, above 0 and up to 1.

    Returns
    -------
    float
        alpha, without unit.

    Raises
    ------
    ValueError
        If ``e`` is outside its range.

    References
    ----------
    Tsuji, Y., Tanaka, T. & Ishida, T. 1992, *Powder Technol.* 71, 239, fig. 3. Marshall, J. S. 2009, *J. Comput.
    Phys.* 228, 1541, eq. 53.

    Examples
    --------
    >>> round(alpha_of_tsuji(0.5), 12)
    0.481880013126
    """
    alpha = 0.0
    for coefficient in (4.8218, -18.022, 27.467, -22.348, 11.087, -4.2783, 1.2728):
        alpha = alpha * restitution(e) + coefficient
    return math.sqrt(2.0) * alpha


def restitution_of_alpha(alpha: float, *, clip: bool, exponent: float = 2.5) -> float:
    """Return the restitution of an impact with the damping factor ``alpha``, at any speed, mass and stiffness.

    Parameters
    ----------
    alpha : float
        Factor of the damping force, >= 0.
    clipped : bool
        True if the net force is clipped at zero, as by LAMMPS' ``limit_damping``.
    exponent : float
        Exponent n of the contact, above 1.

    Returns
    -------
    float
        Speed of separation over speed of approach; 0 where the bodies stick.

    Raises
    ------
    ValueError
        If a parameter is outside its range.

    References
    ----------
    Antypov, D. & Elliott, J. A. 2011, *EPL* 94, 50004; Schwager, T. & Poeschel, T. 2007, *Granul. Matter* 9, 465.

    Examples
    --------
    >>> [round(restitution_of_alpha(alpha, clip=clipped), 5) for alpha in (0.2, 1.0) for clipped in (False, True)]
    [0.75418, 0.76641, 0.20788, 0.3305]
    """
    ratio = not_negative("alpha", alpha, "no unit") / math.sqrt(2.0 * above(1.0, "exponent", exponent))
    return linear_restitution(damping_ratio=ratio, clip=clip)


def restitution_obtained(e: float, *, clip: bool, law: RestitutionLaw = "coeff_restitution") -> float:
    """Return the restitution of an impact for the coefficient ``e`` that a user writes.

    With ``law="coeff_restitution"`` it is e itself, or a larger value if forces are clipped, for every exponent of the
    contact. With ``law="tsuji"`` the contact is Hertz's.

    Parameters
    ----------
    e : float
        Coefficient that is written, above 0 and up to 1.
    clipped : bool
        True if the net force is clipped at zero, as by LAMMPS' ``limit_damping``.
    law : str
        "coeff_restitution" or "tsuji".

    Raises
    ------
    ValueError
        If a parameter is outside its range.

    Examples
    --------
    >>> [round(restitution_obtained(e, clip=True), 5) for e in (0.1, 0.3, 0.5, 0.7, 0.9)]
    [0.25273, 0.39714, 0.55028, 0.7182, 0.90203]
    """
    return restitution_of_alpha(_alpha_function(law)(e), clip=clip)


def restitution_to_write(target: float, *, clip: bool, law: RestitutionLaw = "coeff_restitution") -> float:
    """Return the coefficient that a user has to write to obtain the restitution ``target``.

    It is the inverse of :func:`restitution_obtained`. With clipped forces no coefficient gives less than exp(-2).

    Parameters
    ----------
    target : float
        Restitution of the impact, above 0 and up to 1.
    clipped, law : bool, str
        As for :func:`restitution_obtained`.

    Raises
    ------
    ValueError
        If a parameter is outside its range, or no coefficient gives this restitution.

    Examples
    --------
    >>> [round(restitution_to_write(e, clip=True), 5) for e in (0.2, 0.5, 0.9)]
    [0.03446, 0.43629, 0.89789]
    """
    from scipy.optimize import brentq

    alpha, target = _alpha_function(law), restitution(target)
    # the smallest positive number: its logarithm is finite
    least, most = (restitution_of_alpha(alpha(e), clip=clip) for e in (5e-324, 1.0))
    if not least <= target <= most:
        kind = f"the {'clipped ' * clip}law {law!r}"
        raise ValueError(f"restitution = {target!r}; allowed: {least:.4g} to {most:.4g}, which {kind} can give")
    return float(brentq(lambda e: restitution_of_alpha(alpha(e), clip=clip) - target, 5e-324, 1.0, xtol=1e-15))


def bounce_heights(*, height: float, restitution: float, bounces: int) -> tuple[float, ...]:
    """Return the heights of a dropped hard sphere after each of its bounces on a plane, ``e^(2 j) h``.

    Parameters
    ----------
    height : float
        Height of the drop, m, from the lowest point of the sphere to the plane.
    restitution : float
        Coefficient of restitution e.
    bounces : int
        Number of bounces, from 1.

    Raises
    ------
    ValueError
        If a parameter is outside its range.

    Examples
    --------
    >>> bounce_heights(height=0.5, restitution=0.5, bounces=3)
    (0.125, 0.03125, 0.0078125)
    """
    above(0.0, "height", height, "m"), above(0.0, "restitution", restitution), above(0.0, "bounces", bounces)
    return tuple(height * restitution ** (2 * bounce) for bounce in range(1, bounces + 1))


def _alpha_function(law: str) -> Callable[[float], float]:
    """Return the function that computes alpha from the coefficient that is written."""
    if law not in get_args(RestitutionLaw):
        raise ValueError(f"law = {law!r}; allowed: {', '.join(map(repr, get_args(RestitutionLaw)))}")
    return alpha_of_tsuji if law == "tsuji" else alpha_of_restitution
