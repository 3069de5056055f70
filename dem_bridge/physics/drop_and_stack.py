"""Spheres under gravity on linear springs with dashpots: motions that are linear in stages.

A dropped sphere falls, touches a plane and flies up again (MFiX DEM-01); a stack of spheres between two walls moves as
one linear system while no contact opens (MFiX DEM-03). In each stage the state ``z`` obeys ``z' = A z`` with a constant
1 as its last component, which carries gravity, so that ``z(t) = exp(A t) z(0)`` at every damping.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dem_bridge.physics.numbers import above, not_negative

Floats = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class LinearDrop:
    """Fall of a sphere on a plane through a spring and a dashpot, and its rebound.

    :func:`linear_drop` computes it.
    """

    touch_time: float
    """Time of the first touch, s."""
    touch_speed: float
    """Speed at the first touch, m/s."""
    peak_overlap: float
    """Largest overlap, m."""
    contact_time: float
    """Time from touch until the overlap is zero again, s; inf where the sphere stays on the plane."""
    exit_speed: float
    """Speed at the end of the contact, m/s; 0 where the sphere stays."""
    rebound_height: float
    """Height to which the lowest point of the sphere rises above the plane, m."""

    @property
    def restitution(self) -> float:
        """Speed at the end of the contact over that at the first touch."""
        return self.exit_speed / self.touch_speed


def linear_drop(*, mass: float, stiffness: float, damping: float, height: float, gravity: float) -> LinearDrop:
    """Return the fall of a sphere on a plane through a linear spring and a dashpot, which is not clipped.

    The hard sphere rises to ``e^2 h``. The soft one rises to another height, because gravity acts during the contact.

    Parameters
    ----------
    mass : float
        Mass, kg.
    stiffness : float
        Stiffness of the spring, N/m.
    damping : float
        Coefficient of the dashpot, N s/m, >= 0 and below the critical damping 2 sqrt(k m).
    height : float
        Height of the lowest point of the sphere at rest above the plane, m.
    gravity : float
        Acceleration of gravity, m/s^2.

    Raises
    ------
    ValueError
        If a parameter is outside its range.

    References
    ----------
    Garg et al. (2012), *Powder Technol.* 220, 122 (MFiX DEM-01).

    Examples
    --------
    >>> drop = linear_drop(mass=10.89, stiffness=1e5, damping=100.0, height=0.4, gravity=9.81)
    >>> f"e = {drop.restitution:.6f}, {drop.rebound_height:.6f} m, contact {1e3 * drop.contact_time:.6f} ms"
    'e = 0.853388, 0.291309 m, contact 33.649354 ms'
    """
    from scipy.optimize import brentq

    m, h, g = above(0.0, "mass", mass, "kg"), above(0.0, "height", height, "m"), above(0.0, "gravity", gravity, "m/s^2")
    k, c = above(0.0, "stiffness", stiffness, "N/m") / m, not_negative("damping", damping, "N s/m") / m
    if c * c >= 4.0 * k:
        raise ValueError(
            f"damping = {damping!r}; allowed: below the critical damping, {2.0 * m * math.sqrt(k):.6g} N s/m"
        )
    speed, damped, frequency = math.sqrt(2.0 * g * h), 0.5 * c, math.sqrt(k - 0.25 * c * c)
    swing = (g - damped * speed) / frequency

    def velocity(time: float) -> float:  # it swings about zero, whatever the weight
        phase = frequency * time
        return math.exp(-damped * time) * (speed * math.cos(phase) + swing * math.sin(phase))

    def overlap(time: float) -> float:
        phase = frequency * time
        bend = frequency * math.exp(-damped * time) * (swing * math.cos(phase) - speed * math.sin(phase))
        return (g - bend - damped * velocity(time)) / k

    half = math.pi / frequency  # between two extrema of the overlap
    top = float(brentq(velocity, 0.0, half, xtol=1e-16 * half, rtol=1e-15))
    contact, leaving = math.inf, 0.0
    if overlap(top + half) < 0.0:
        contact = float(brentq(overlap, top, top + half, xtol=1e-16 * half, rtol=1e-15))
        leaving = -velocity(contact)
    return LinearDrop(
        touch_time=speed / g,
        touch_speed=speed,
        peak_overlap=overlap(top),
        contact_time=contact,
        exit_speed=leaving,
        rebound_height=0.5 * leaving**2 / g,
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class LinearStack:
    """Motion of spheres between two walls, all in contact. :func:`linear_stack` computes it."""

    displacement: Floats
    """Displacements from the initial positions ``(n_t, n)``, m, positive towards the last wall."""
    velocity: Floats
    """Velocities ``(n_t, n)``, m/s."""
    overlap: Floats
    """Overlaps of all contacts ``(n_t, n + 1)``, m: first wall, pairs, last wall."""


def linear_stack(
    *,
    masses: Sequence[float],
    stiffness: Sequence[float],
    overlaps: Sequence[float],
    times: ArrayLike,
    damping: Sequence[float] | float = 0.0,
    velocities: Sequence[float] | float = 0.0,
    gravity: float = 0.0,
) -> LinearStack:
    """Return the motion of n spheres between two walls on linear springs with dashpots.

    Parameters
    ----------
    masses : sequence of float
        Masses of the n spheres, kg.
    stiffness, overlaps : sequence of float
        Stiffness (N/m) and initial overlap (m, >= 0) of the n + 1 contacts: first wall, pairs, last wall.
    times : array_like
        Times ``(n_t,)`` at which the motion is computed, s.
    damping : float or sequence of float
        Coefficients of the dashpots, N s/m.
    velocities : float or sequence of float
        Initial velocities, m/s.
    gravity : float
        Acceleration towards the last wall, m/s^2.

    Raises
    ------
    ValueError
        If numbers do not fit together, or a contact is open at one of the times: the motion is not linear then.

    References
    ----------
    Garg et al. (2012), *Powder Technol.* 220, 122 (MFiX DEM-03).

    Examples
    --------
    >>> stack = linear_stack(masses=(2.0,), stiffness=(3.0, 5.0), overlaps=(0.5, 0.1), times=[0.0, math.pi / 2.0])
    >>> stack.overlap.round(12).tolist()  # a half-period about the equilibrium
    [[0.5, 0.1], [0.25, 0.35]]
    """
    from scipy.linalg import expm

    m, k, start = (np.asarray(values, dtype=float) for values in (masses, stiffness, overlaps))
    n = len(m)
    if not (n > 0 and len(k) == len(start) == n + 1 and (m > 0.0).all() and (k > 0.0).all() and (start >= 0.0).all()):
        problem = f"{n} masses, {len(k)} stiffnesses and {len(start)} overlaps"
        raise ValueError(f"{problem}; allowed: n, n + 1 and n + 1 of them, masses and stiffnesses > 0, overlaps >= 0")
    # overlap_j = start_j + (difference @ displacement)_j; a force pushes on both of its bodies
    difference = np.eye(n + 1, n, -1) - np.eye(n + 1, n)
    push = -difference.T / m[:, None]
    rates = push @ (k[:, None] * difference), push @ (np.broadcast_to(damping, n + 1)[:, None] * difference)
    matrix = np.zeros((2 * n + 1, 2 * n + 1))
    matrix[:n, n : 2 * n] = np.eye(n)
    matrix[n : 2 * n] = np.column_stack([*rates, push @ (k * start) + gravity])
    state = np.concatenate([np.zeros(n), np.broadcast_to(np.asarray(velocities, dtype=float), n), [1.0]])
    states = expm(matrix * np.asarray(times, dtype=float)[:, None, None]) @ state
    overlap = start + states[:, :n] @ difference.T
    if (overlap < 0.0).any():
        time, contact = np.argwhere(overlap < 0.0)[0].tolist()
        raise ValueError(
            f"contact {contact} is open at {np.asarray(times)[time]:.6g} s; allowed: times up to its opening"
        )
    return LinearStack(displacement=states[:, :n], velocity=states[:, n : 2 * n], overlap=overlap)
