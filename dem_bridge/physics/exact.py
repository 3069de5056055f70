"""Exact solutions that need no time stepping, with uniform signatures.

Every solution takes SI numbers by keyword, returns a frozen dataclass, and raises a ValueError of one line for
parameters outside its validity. Two bodies with ``F = beta overlap^(n-1)`` are a one-dimensional motion in a power-law
well, whose duration is a quotient of Gamma functions (Deresiewicz 1968, *Acta Mech.* 6, 110; for the residence time
Machado, Rosas & Lindenberg 2013, *Granul. Matter* 15, 735 = the paper's eq. 3.3).

===========================  =================================================================  =======================
solution                     system                                                             valid for
===========================  =================================================================  =======================
:func:`two_body_collision`   two free bodies, elastic                                           n > 1, any masses
:func:`wall_rebound`         a body on a rigid wall                                             n > 1
:func:`equal_mass_transfer`  two equal bodies                                                   n > 1
:func:`dashpot_collision`    two bodies or a wall, spring and dashpot, clipped or not           n = 2
:func:`viscoelastic_impact`  viscoelastic spheres, clipped or not: a series with its remainder  n = 5/2, e above 0.1
:func:`dmt_impact`           spheres with adhesion, DMT                                         n = 5/2
:func:`jkr_impact`           spheres with adhesion, JKR                                         n = 5/2
:func:`linear_drop`          a dropped sphere, spring and dashpot, gravity                      n = 2, under-damped
:func:`linear_stack`         spheres between two walls, springs and dashpots, gravity           n = 2, no contact opens
:func:`solitary_wave`        a uniform chain that just touches                                  2.00001 <= n <= 50
:func:`dispersion`           small oscillations of a precompressed chain                        n > 1, no contact opens
:func:`scaling`              any chain without gaps, under another speed, stiffness or mass     n > 1
===========================  =================================================================  =======================

Restitution alone is a plain number: :func:`linear_restitution`, :func:`restitution_of_alpha`,
:func:`restitution_obtained` and its inverse :func:`restitution_to_write`, with the damping factors
:func:`alpha_of_restitution` and :func:`alpha_of_tsuji`; :func:`bounce_heights` of a hard sphere and
:func:`pull_off_force` are, too.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from dem_bridge.physics.adhesion import AdhesiveImpact, dmt_impact, jkr_impact, pull_off_force
from dem_bridge.physics.damped_impact import (
    DashpotCollision,
    alpha_of_restitution,
    alpha_of_tsuji,
    bounce_heights,
    dashpot_collision,
    linear_restitution,
    restitution_obtained,
    restitution_of_alpha,
    restitution_to_write,
)
from dem_bridge.physics.dispersion import Dispersion, dispersion
from dem_bridge.physics.drop_and_stack import LinearDrop, LinearStack, linear_drop, linear_stack
from dem_bridge.physics.numbers import above
from dem_bridge.physics.solitary import SolitaryWave, solitary_wave
from dem_bridge.physics.viscoelastic import ViscoelasticImpact, viscoelastic_impact

__all__ = [
    "AdhesiveImpact",
    "DashpotCollision",
    "Dispersion",
    "LinearDrop",
    "LinearStack",
    "Scaling",
    "SolitaryWave",
    "TwoBodyCollision",
    "ViscoelasticImpact",
    "WallRebound",
    "alpha_of_restitution",
    "alpha_of_tsuji",
    "bounce_heights",
    "dashpot_collision",
    "dispersion",
    "dmt_impact",
    "equal_mass_transfer",
    "jkr_impact",
    "linear_drop",
    "linear_restitution",
    "linear_stack",
    "pull_off_force",
    "restitution_obtained",
    "restitution_of_alpha",
    "restitution_to_write",
    "scaling",
    "solitary_wave",
    "two_body_collision",
    "viscoelastic_impact",
    "wall_rebound",
]


@dataclass(frozen=True)
class TwoBodyCollision:
    """Elastic collision of two bodies that are free before and after it.

    :func:`two_body_collision` computes it.
    """

    peak_overlap: float
    """Largest overlap, m: (n mu v^2 / (2 beta))^(1/n)."""
    peak_force: float
    """Largest force, N."""
    half_time: float
    """Time from touch to the largest overlap, s: the paper's residence time T_i (eq. 3.3)."""
    contact_time: float
    """Time from touch to separation, s."""
    exit_velocity: tuple[float, float]
    """Velocities of body 1 and body 2 after separation, m/s."""


def two_body_collision(
    *, masses: tuple[float, float], velocities: tuple[float, float], stiffness: float, exponent: float
) -> TwoBodyCollision:
    """Return the elastic head-on collision of two free bodies, exact for any n > 1, masses and closing velocity.

    The paper's section 4c prints the peak compression with v; the dimensions require v^2, which is used here.

    Parameters
    ----------
    masses : tuple of float
        Masses of body 1 and 2, kg; the second may be inf, a wall.
    velocities : tuple of float
        Velocities of body 1 and 2, m/s; body 1 must approach body 2.
    stiffness : float
        Stiffness beta, N/m^(n-1).
    exponent : float
        Exponent n > 1.

    Raises
    ------
    ValueError
        If a parameter is outside its range.

    References
    ----------
    Deresiewicz (1968), *Acta Mech.* 6, 110; Chaunsali, Kim & Yang (2018), eq. 3.3.

    Examples
    --------
    >>> hit = two_body_collision(masses=(8.1e-3, 2200 * math.pi * 9e-3**2 * 18e-3), velocities=(0.8, 0.0),
    ...                          stiffness=3.98e9, exponent=2.5)
    >>> f"{hit.contact_time:.10e} s, {hit.peak_force:.8f} N, {hit.exit_velocity[0]:.8f} m/s"
    '5.5968164636e-05 s, 236.14749736 N, -0.08700998 m/s'
    """
    m1, m2 = above(0.0, "masses[0]", masses[0], "kg"), above(0.0, "masses[1]", masses[1], "kg", infinite="a wall")
    (v1, v2), n = velocities, above(1.0, "exponent", exponent)
    above(0.0, "stiffness", stiffness, "N/m^(n-1)")
    closing = v1 - v2
    if not 0.0 < closing < math.inf:
        raise ValueError(f"closing velocity = {closing!r} m/s; allowed: > 0, so that body 1 catches up with body 2")
    reduced = m1 / (1.0 + m1 / m2)
    overlap = (n * reduced * closing**2 / (2.0 * stiffness)) ** (1.0 / n)
    shape = math.sqrt(math.pi) * math.gamma(1.0 + 1.0 / n) / math.gamma(0.5 + 1.0 / n)
    half = shape * overlap / closing
    impulse = 2.0 * reduced * closing
    return TwoBodyCollision(
        peak_overlap=overlap,
        peak_force=stiffness * overlap ** (n - 1.0),
        half_time=half,
        contact_time=2.0 * half,
        exit_velocity=(v1 - impulse / m1, v2 + impulse / m2),
    )


@dataclass(frozen=True, kw_only=True)
class WallRebound:
    """Elastic impact of a body on a rigid wall.

    :func:`wall_rebound` computes it.
    """

    peak_overlap: float
    """Largest overlap, m: (n m v^2 / (2 beta))^(1/n)."""
    peak_force: float
    """Largest force, N."""
    half_time: float
    """Time from touch to the largest overlap, when the body is at rest, s."""
    contact_time: float
    """Time from touch to separation, s."""
    exit_velocity: float
    """Velocity after separation, m/s: minus the velocity of approach."""
    impulse: float
    """Impulse on the wall, 2 m v, N s."""


def wall_rebound(*, mass: float, velocity: float, stiffness: float, exponent: float) -> WallRebound:
    """Return the elastic impact on a rigid wall: the collision with a body of infinite mass, mu = m, without gravity.

    Parameters
    ----------
    mass : float
        Mass of the body, kg.
    velocity : float
        Velocity towards the wall, m/s.
    stiffness : float
        Stiffness beta, N/m^(n-1).
    exponent : float
        Exponent n > 1.

    Raises
    ------
    ValueError
        If a parameter is not > 0, or n <= 1.

    References
    ----------
    Deresiewicz (1968), *Acta Mech.* 6, 110.

    Examples
    --------
    >>> bounce = wall_rebound(mass=2.0, velocity=3.0, stiffness=8.0, exponent=2.0)  # a linear spring: half a period
    >>> f"{bounce.contact_time / math.pi:.12f} s, {bounce.peak_overlap:.12f} m", bounce.exit_velocity
    ('0.500000000000 s, 1.500000000000 m', -3.0)
    """
    v = above(0.0, "velocity", velocity, "m/s, towards the wall")
    m = above(0.0, "mass", mass, "kg")
    hit = two_body_collision(masses=(m, math.inf), velocities=(v, 0.0), stiffness=stiffness, exponent=exponent)
    return WallRebound(**{**vars(hit), "exit_velocity": -v}, impulse=2.0 * m * v)


def equal_mass_transfer(
    *, mass: float, velocities: tuple[float, float], stiffness: float, exponent: float
) -> TwoBodyCollision:
    """Return the elastic collision of two equal bodies, which exchange their velocities.

    Times, overlap and force are those of :func:`two_body_collision` with mu = m/2. The exit velocities are exchanged
    rather than computed, so they have no round-off. The binary collision approximation rests on this solution: a body
    at rest takes all momentum. In a chain the next contact closes before the collision is over, and the transfer is not
    complete. Parameters and errors are those of :func:`two_body_collision`, with one ``mass``.

    Examples
    --------
    >>> equal_mass_transfer(mass=0.1, velocities=(0.7, 0.0), stiffness=4e9, exponent=2.5).exit_velocity
    (0.0, 0.7)
    """
    hit = two_body_collision(masses=(mass, mass), velocities=velocities, stiffness=stiffness, exponent=exponent)
    return replace(hit, exit_velocity=(velocities[1], velocities[0]))


@dataclass(frozen=True, kw_only=True)
class Scaling:
    """Factors by which the quantities of a chain's motion change.

    :func:`scaling` computes them.
    """

    time: float
    displacement: float
    velocity: float
    acceleration: float
    """Factor of accelerations. For similar motions gravity must change by it too."""
    force: float
    momentum: float
    energy: float
    damping: float
    """Factor of a dashpot's coefficient (force over velocity), which must change by it for similar motions."""


def scaling(*, exponent: float, velocity: float = 1.0, stiffness: float = 1.0, mass: float = 1.0) -> Scaling:
    """Return the factors of all quantities when all velocities, stiffnesses and masses change by the stated factors.

    A chain of bodies that just touch has no length or time scale of its own, so its motions are similar::

        displacement = (mass velocity^2 / stiffness)^(1/n)       time = displacement / velocity

    If only the velocity changes, by s, then times change by s^(2/n - 1), displacements by s^(2/n) and forces by s^(2 -
    2/n), with the exponents -1/5, 4/5 and 6/5 for n = 5/2. The result is exact if one exponent n > 1 holds in the whole
    chain and gaps and initial overlaps are zero or change by the factor of displacement.

    Parameters
    ----------
    exponent : float
        Exponent n > 1 of all contacts.
    velocity, stiffness, mass : float
        Factors, each > 0.

    Raises
    ------
    ValueError
        If a parameter is outside its range.

    References
    ----------
    Nesterenko (1983), *J. Appl. Mech. Tech. Phys.* 24, 733; Sen et al. (2008), *Phys. Rep.* 462, 21.

    Examples
    --------
    >>> faster = scaling(exponent=2.5, velocity=32.0)
    >>> [round(math.log2(f) / 5, 12) for f in (faster.time, faster.displacement, faster.force, faster.energy)]
    [-0.2, 0.8, 1.2, 2.0]
    """
    n = above(1.0, "exponent", exponent)
    s, b, m = above(0.0, "velocity", velocity), above(0.0, "stiffness", stiffness), above(0.0, "mass", mass)
    displacement = (m * s**2 / b) ** (1.0 / n)
    time = displacement / s
    force = m * s**2 / displacement
    return Scaling(
        time=time,
        displacement=displacement,
        velocity=s,
        acceleration=force / m,
        force=force,
        momentum=m * s,
        energy=m * s**2,
        damping=force / s,
    )
