"""The linear contact with a dashpot, ``F = beta overlap + c overlap'``: n = 2, exact for every damping.

With the reduced mass mu, ``omega_0 = sqrt(beta/mu)`` and the damping ratio ``zeta = c / (2 sqrt(beta mu))``, the
overlap is that of a damped oscillator struck at rest. Two ends of a contact are in use, with different exit speeds
(Schwager & Poeschel 2007, *Granul. Matter* 9, 465):

* unclipped: the contact pulls until the overlap is zero again, ``e = exp(-pi zeta / sqrt(1 - zeta^2))``, and e = 0
  from critical damping on: the bodies stick;
* clipped: the net force never pulls (LAMMPS: ``limit_damping``). It ends where the spring no longer outweighs the
  dashpot; with ``zeta = cos(theta)`` this is at ``omega_0 t = 2 theta / sin(theta)``, twice the time to the largest
  overlap, and ``e = exp(-2 zeta theta / sin(theta))``, for all zeta when read as hyperbolic functions beyond 1.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from dem_bridge.physics.valid import above, number


@dataclass(frozen=True, kw_only=True)
class DashpotCollision:
    """Body 1 hits body 2 or a wall through a linear contact with a dashpot. Made by :func:`dashpot_collision`."""

    damping_ratio: float
    """zeta: below 1 under-damped, 1 critical, above 1 over-damped."""
    restitution: float
    """Speed of separation over speed of approach."""
    exit_velocity: tuple[float, float]
    """m/s: of body 1 and body 2; where they stick (restitution 0) that of their common centre of mass."""
    peak_overlap: float
    """m."""
    peak_force: float
    """N: the largest net force; at the first touch, c times the closing speed, from zeta = 1/2 on."""
    half_time: float
    """s: from touch to the largest overlap."""
    push_time: float
    """s: from touch until the net force falls through zero."""
    contact_time: float
    """s: from touch until the overlap is zero again; inf where the bodies stick."""


def dashpot_collision(
    *,
    masses: tuple[float, float],
    velocities: tuple[float, float],
    stiffness: float,
    damping: float,
    clipped: bool,
) -> DashpotCollision:
    """Head-on collision through a spring (N/m) and a dashpot (N s/m), exact for any ``damping`` >= 0.

    ``masses`` in kg, the second may be inf: a wall; ``velocities`` in m/s (body 1 must close in on body 2).
    ``clipped``: the net force is cut at zero, as by LAMMPS' ``limit_damping``. Valid for n = 2 only, bodies free
    otherwise. Raises ValueError for anything else.

    >>> case = dict(masses=(2.0, math.inf), velocities=(1.0, 0.0), stiffness=8.0, damping=2.0)
    >>> for clipped in (True, False):
    ...     hit = dashpot_collision(**case, clipped=clipped)
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
        raise ValueError(f"closing velocity = {closing!r} m/s; allowed: > 0, body 1 must catch up with body 2")
    reduced = m1 / (1.0 + m1 / m2)
    frequency = math.sqrt(beta / reduced)
    ratio = c / (2.0 * math.sqrt(beta * reduced))
    slowness = _angle_over_sine(ratio)
    end = math.exp(-2.0 * ratio * slowness)  # speed where the net force is zero, over that of approach
    push = 2.0 * slowness / frequency
    if clipped:
        restitution = end
        # from there the bodies fly apart at constant speed; the overlap left is 2 zeta e v / omega_0
        contact = push + 2.0 * ratio / frequency
    elif ratio < 1.0:
        sine = math.sqrt((1.0 - ratio) * (1.0 + ratio))
        restitution, contact = math.exp(-math.pi * ratio / sine), math.pi / (frequency * sine)
    else:
        restitution, contact = 0.0, math.inf
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


def _angle_over_sine(ratio: float) -> float:
    """theta / sin(theta) for cos(theta) = ratio; beyond 1 its continuation theta / sinh(theta), smooth through 1."""
    sine = math.sqrt(abs((1.0 - ratio) * (1.0 + ratio)))
    if sine == 0.0:
        return 1.0
    return (math.atan2(sine, ratio) if ratio < 1.0 else math.asinh(sine)) / sine


def _peak_force(ratio: float) -> float:
    """Largest net force over mu v omega_0: the extremum at phase 3 theta - pi where there is one, else at touch."""
    if ratio >= 0.5:
        return 2.0 * ratio
    theta = math.acos(ratio)
    return math.exp(-ratio / math.sin(theta) * (3.0 * theta - math.pi))
