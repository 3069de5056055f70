"""Impacts with damping and their restitution: through a dashpot, and with LAMMPS' laws of restitution.

**Spring and dashpot**, ``F = beta overlap + c overlap'``: n = 2, exact for every damping.
With the reduced mass mu, ``omega_0 = sqrt(beta/mu)`` and the damping ratio ``zeta = c / (2 sqrt(beta mu))``, the
overlap is that of a damped oscillator struck at rest. Two definitions of the end of a contact are in use; their exit
speeds differ (Schwager & Poeschel 2007, *Granul. Matter* 9, 465):

* unclipped: the contact pulls until the overlap is zero again, ``e = exp(-pi zeta / sqrt(1 - zeta^2))``. From critical
  damping on e = 0: the bodies stick.
* clipped: the net force never pulls (LAMMPS: ``limit_damping``). The contact ends when the dashpot force exceeds the
  spring force. With ``zeta = cos(theta)`` this is at ``omega_0 t = 2 theta / sin(theta)``, twice the time to the
  largest overlap, and ``e = exp(-2 zeta theta / sin(theta))``. Both hold for all zeta, with hyperbolic functions for
  zeta > 1.

**Laws of restitution**, ``F = beta d^(n-1) + alpha sqrt(m beta) d^((n-2)/2) d'``:
d is the overlap and m the effective mass, 1/(1/m1 + 1/m2) or the mass of a body that hits a wall. With
``y = d^(n/2)`` and ``ds = d^((n-2)/2) dt`` the motion is that of a damped linear oscillator of damping ratio
``alpha / sqrt(2 n)``, whatever n, speed, mass and stiffness are: the restitution e depends on alpha alone (Antypov &
Elliott 2011, *EPL* 94, 50004, for n = 5/2), and also where the net force is clipped at zero (Schwager & Poeschel 2007,
*Granul. Matter* 9, 465, for n = 2).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from dem_bridge.physics.numbers import above, not_negative, number


@dataclass(frozen=True, kw_only=True)
class DashpotCollision:
    """Collision of a body with another body or a wall through a spring and a dashpot.

    :func:`dashpot_collision` computes it.
    """

    damping_ratio: float
    """zeta: below 1 under-damped, 1 critical, above 1 over-damped."""
    restitution: float
    """Coefficient of restitution: speed of separation over speed of approach."""
    exit_velocity: tuple[float, float]
    """Velocities of body 1 and body 2 after the contact, m/s; those of their centre of mass where they stick."""
    peak_overlap: float
    """Largest overlap, m."""
    peak_force: float
    """Largest net force, N; for zeta >= 1/2 it is c times the closing speed, at first touch."""
    half_time: float
    """Time from touch to the largest overlap, s."""
    push_time: float
    """Time from touch until the net force falls through zero, s."""
    contact_time: float
    """Time from touch until the overlap is zero again, s; inf where the bodies stick."""


def dashpot_collision(
    *,
    masses: tuple[float, float],
    velocities: tuple[float, float],
    stiffness: float,
    damping: float,
    clip: bool,
) -> DashpotCollision:
    """Return the head-on collision of two bodies through a spring and a dashpot, exact for any ``damping`` >= 0.

    It is valid for n = 2 and bodies on which no other force acts.

    Parameters
    ----------
    masses : tuple of float
        Masses of body 1 and 2, kg; the second may be inf, a wall.
    velocities : tuple of float
        Velocities of body 1 and 2, m/s; body 1 must approach body 2.
    stiffness : float
        Stiffness beta of the spring, N/m.
    damping : float
        Coefficient c of the dashpot, N s/m.
    clipped : bool
        True if the net force is clipped at zero, as by LAMMPS' ``limit_damping``.

    Raises
    ------
    ValueError
        If a parameter is outside its range.

    Examples
    --------
    >>> case = dict(masses=(2.0, math.inf), velocities=(1.0, 0.0), stiffness=8.0, damping=2.0)
    >>> for clipped in (True, False):
    ...     hit = dashpot_collision(**case, clip=clipped)
    ...     print(f"e = {hit.restitution:.12f}, {hit.contact_time:.12f} s, {hit.peak_force:.12f} N")
    e = 0.506276552519, 1.611344425035 s, 3.242814992820 N
    e = 0.444344225088, 1.622311470389 s, 3.242814992820 N
    """
    m1, m2 = above(0.0, "masses[0]", masses[0], "kg"), above(0.0, "masses[1]", masses[1], "kg", infinite="a wall")
    v1, v2 = (number(f"velocities[{i}]", v, "m/s") for i, v in enumerate(velocities))
    beta, c = above(0.0, "stiffness", stiffness, "N/m"), number("damping", damping, "N s/m")
    if c < 0.0:
        raise ValueError(f"damping = {damping!r}; allowed: a finite number >= 0 (N s/m)")
    closing = v1 - v2
    if not closing > 0.0:
        raise ValueError(f"closing velocity = {closing!r} m/s; allowed: > 0, so that body 1 catches up with body 2")
    reduced = m1 / (1.0 + m1 / m2)
    frequency = math.sqrt(beta / reduced)
    ratio = c / (2.0 * math.sqrt(beta * reduced))
    end = linear_restitution(damping_ratio=ratio, clip=True)  # speed when the net force is zero, over that before
    push = 2.0 * _angle_over_sine(ratio) / frequency
    restitution = linear_restitution(damping_ratio=ratio, clip=clip)
    if clip:
        # then the bodies separate at constant speed; the remaining overlap is 2 zeta e v / omega_0
        contact = push + 2.0 * ratio / frequency
    else:
        contact = math.pi / (frequency * math.sqrt((1.0 - ratio) * (1.0 + ratio))) if ratio < 1.0 else math.inf
    impulse = reduced * (1.0 + restitution) * closing
    return DashpotCollision(
        damping_ratio=ratio,
        restitution=restitution,
        exit_velocity=(v1 - impulse / m1, v2 + impulse / m2),
        peak_overlap=closing / frequency * math.sqrt(end),
        peak_force=_peak_force(ratio) * reduced * closing * frequency,
        half_time=0.5 * push,
        push_time=push,
        contact_time=contact,
    )


def linear_restitution(*, damping_ratio: float, clip: bool) -> float:
    """Return the restitution of the impact on a linear spring with a dashpot.

    Parameters
    ----------
    damping_ratio : float
        zeta = b / w_0, >= 0, with ``b = c / 2m`` and ``w_0 = sqrt(k / m)``.
    clipped : bool
        True if the net force is clipped at zero; otherwise the contact pulls until the overlap is zero.

    Returns
    -------
    float
        Speed of separation over speed of approach; 0 where the bodies stick.

    Raises
    ------
    ValueError
        If ``damping_ratio`` is not a number >= 0.

    References
    ----------
    Schwager & Poeschel (2007), *Granul. Matter* 9, 465, whose three branches are one function here.

    Examples
    --------
    >>> for ratio in (0.2, 0.8, 1.0, 1.5):
    ...     pulling, clipped = (linear_restitution(damping_ratio=ratio, clip=clipped) for clipped in (False, True))
    ...     print(f"{ratio} {pulling:.6f} {clipped:.6f}")
    0.2 0.526621 0.571740
    0.8 0.015165 0.179783
    1.0 0.000000 0.135335
    1.5 0.000000 0.075588
    """
    ratio = not_negative("damping_ratio", damping_ratio, "b / w_0")
    if clip:
        return math.exp(-2.0 * ratio * _angle_over_sine(ratio))
    return math.exp(-math.pi * ratio / math.sqrt((1.0 - ratio) * (1.0 + ratio))) if ratio < 1.0 else 0.0


def _angle_over_sine(ratio: float) -> float:
    """Return theta / sin(theta) for cos(theta) = ratio, and its smooth continuation theta / sinh(theta) above 1."""
    sine = math.sqrt(abs((1.0 - ratio) * (1.0 + ratio)))
    if sine == 0.0:
        return 1.0
    return (math.atan2(sine, ratio) if ratio < 1.0 else math.asinh(sine)) / sine


def _peak_force(ratio: float) -> float:
    """Return the largest net force over mu v omega_0: at phase 3 theta - pi if an extremum exists, else at touch."""
    if ratio >= 0.5:
        return 2.0 * ratio
    theta = math.acos(ratio)
    return math.exp(-ratio / math.sin(theta) * (3.0 * theta - math.pi))


#: damping laws with a coefficient of restitution as their input
RestitutionLaw = Literal["coeff_restitution", "tsuji", "tsuji_without_sqrt2"]


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
    tsuji``, with the prefactor from August 2026 on.

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


def alpha_of_tsuji_without_sqrt2(e: float) -> float:
    """Return the factor alpha by which LAMMPS damped with ``tsuji`` until July 2026: sqrt(2) is missing.

    Parameters
    ----------
    e : float
        The coefficient that is written, 0 < e <= 1.

    Raises
    ------
    ValueError
        If e is outside this range.

    References
    ----------
    Marshall, J. S. 2009, *J. Comput. Phys.* 228, 1541, for the polynomial; lammps#5113 for the prefactor.

    Examples
    --------
    >>> round(alpha_of_tsuji_without_sqrt2(0.5), 5)
    0.34074
    """
    return alpha_of_tsuji(e) / math.sqrt(2.0)


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
    contact. With ``law="tsuji"`` the contact is Hertz's. "tsuji_without_sqrt2" is what LAMMPS does with ``damping
    tsuji`` until July 2026, and what codes do that copied it; no scene has it.

    Parameters
    ----------
    e : float
        Coefficient that is written, above 0 and up to 1.
    clipped : bool
        True if the net force is clipped at zero, as by LAMMPS' ``limit_damping``.
    law : str
        "coeff_restitution", "tsuji" or "tsuji_without_sqrt2".

    Raises
    ------
    ValueError
        If a parameter is outside its range.

    Examples
    --------
    >>> [round(restitution_obtained(e, clip=True), 5) for e in (0.1, 0.3, 0.5, 0.7, 0.9)]
    [0.25273, 0.39714, 0.55028, 0.7182, 0.90203]
    >>> round(restitution_obtained(0.5, clip=False, law="tsuji_without_sqrt2"), 5)
    0.61608
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
    functions: dict[str, Callable[[float], float]] = {
        "coeff_restitution": alpha_of_restitution,
        "tsuji": alpha_of_tsuji,
        "tsuji_without_sqrt2": alpha_of_tsuji_without_sqrt2,
    }
    if law not in functions:
        raise ValueError(f"law = {law!r}; allowed: {', '.join(map(repr, functions))}")
    return functions[law]
