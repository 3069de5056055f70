"""The collision through a spring and a dashpot, ``F = beta overlap + c overlap'``: n = 2, exact for every damping.

With the reduced mass mu, ``omega_0 = sqrt(beta/mu)`` and the damping ratio ``zeta = c / (2 sqrt(beta mu))``, the
overlap is that of a damped oscillator struck at rest. Two definitions of the end of a contact are in use; their exit
speeds differ (Schwager & Poeschel 2007, *Granul. Matter* 9, 465):

* unclipped: the contact pulls until the overlap is zero again, ``e = exp(-pi zeta / sqrt(1 - zeta^2))``. From critical
  damping on e = 0: the bodies stick.
* clipped: the net force never pulls (LAMMPS: ``limit_damping``). The contact ends when the dashpot force exceeds the
  spring force. With ``zeta = cos(theta)`` this is at ``omega_0 t = 2 theta / sin(theta)``, twice the time to the
  largest overlap, and ``e = exp(-2 zeta theta / sin(theta))``. Both hold for all zeta, with hyperbolic functions for
  zeta > 1.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from dem_bridge.physics.valid import above, not_negative, number


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
