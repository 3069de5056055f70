"""Exact solutions that need no time stepping.

A collision of two bodies through ``F = beta overlap^(n-1)`` is one-dimensional motion in a power-law well; its
duration is a quotient of Gamma functions (Deresiewicz 1968, *Acta Mech.* 6, 110; for the residence time
Machado, Rosas & Lindenberg 2013, *Granul. Matter* 15, 735 = the paper's eq. 3.3).
"""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class TwoBodyCollision:
    """Body 1 hits body 2; both free before and after. Made by :func:`two_body_collision`."""

    peak_overlap: float
    """m: (n mu v^2 / (2 beta))^(1/n)."""
    peak_force: float
    """N."""
    half_time: float
    """s: from touch to the largest overlap; the paper's residence time T_i (eq. 3.3)."""
    contact_time: float
    """s: from touch to separation."""
    exit_velocity: tuple[float, float]
    """m/s: of body 1 and body 2 after separation."""


def two_body_collision(
    *, masses: tuple[float, float], velocities: tuple[float, float], stiffness: float, exponent: float
) -> TwoBodyCollision:
    """Elastic head-on collision of two free bodies, exact for any n > 1, masses and closing velocities.

    ``masses`` in kg, ``velocities`` in m/s (body 1 must close in on body 2), ``stiffness`` in N/m^(n-1).
    Raises ValueError where the bodies do not approach each other. Where the paper's section 4c prints the peak
    compression with v instead of v^2, the dimensions ask for v^2.

    >>> hit = two_body_collision(masses=(8.1e-3, 2200 * math.pi * 9e-3**2 * 18e-3), velocities=(0.8, 0.0),
    ...                          stiffness=3.98e9, exponent=2.5)
    >>> f"{hit.contact_time:.10e} s, {hit.peak_force:.8f} N, {hit.exit_velocity[0]:.8f} m/s"
    '5.5968164636e-05 s, 236.14749736 N, -0.08700998 m/s'
    """
    (m1, m2), (v1, v2), n = masses, velocities, exponent
    closing = v1 - v2
    if not closing > 0.0:
        raise ValueError(f"closing velocity = {closing!r} m/s; allowed: > 0, body 1 must catch up with body 2")
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
