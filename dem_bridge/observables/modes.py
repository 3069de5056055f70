"""Frequencies of a chain at each moment, with which the stability of a time step is compared.

At a moment each contact is a spring of its tangent stiffness ``k = dF/d(overlap)``. Alone between its two bodies it has
``omega^2 = k (1/m_i + 1/m_j)``. Together they have the modes of the matrix ``sqrt(k) B M^-1 B^T sqrt(k)`` over the
contacts (B: from bodies to overlaps), which has these squares on its diagonal: so the highest mode is never below the
fastest pair. Nor is it above sqrt(2) times that: give half of a body's mass to each of its two contacts and every
contact alone has at most twice its square (Irons & Treharne 1971, in *Proc. 3rd Conf. Matrix Methods in Structural
Mechanics*, 245; for bodies in contact O'Sullivan & Bray 2004, *Eng. Comput.* 21, 278). On a linear chain
velocity-Verlet is stable for dt < 2/omega of that mode.
"""

from __future__ import annotations

import math

import numpy as np

from dem_bridge.errors import UnsupportedScene
from dem_bridge.observables.interpolate import contact_motion
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import Floats, Trajectory

#: part of an overlap over which the slope of a law is taken
_SLOPE = 1e-4


def tangent_stiffness(scene: Scene, overlap: Floats) -> Floats:
    """Return ``dF/d(overlap)``, N/m, of each contact at overlaps ``(n_t, n_contact)``; 0 where it is open.

    Raises UnsupportedScene for n < 2, where it is infinite at touch.
    """
    c = scene.contacts
    if scene.law is not None:
        closed, every = np.maximum(overlap, 0.0), np.arange(scene.n_contact)
        rise = c.force(closed * (1.0 + _SLOPE), every) - c.force(closed * (1.0 - _SLOPE), every)
        return np.divide(rise, 2.0 * _SLOPE * closed, out=np.zeros_like(rise), where=closed > 0.0)
    if np.any(c.exponent < 2.0):
        raise UnsupportedScene(
            f"{scene.name} has contacts of exponent n = {float(np.min(c.exponent)):g}, whose tangent stiffness is"
            " infinite at touch: no highest frequency; allowed: n >= 2"
        )
    power = np.maximum(overlap, 0.0) ** (c.exponent - 2.0)
    return np.asarray(np.where(overlap > 0.0, (c.exponent - 1.0) * c.stiffness * power, 0.0))


def highest_frequencies(scene: Scene, trajectory: Trajectory) -> tuple[float, float]:
    """Return the highest angular frequencies (rad/s) of all samples: of one contact alone, and of a mode.

    Damping and drag are left out. Both are 0 if no bodies touch. Frequencies between samples may be higher.

    >>> import dem_bridge as db
    >>> scene = db.load_scene("decelerating-40")
    >>> pair, mode = highest_frequencies(scene, db.solve(scene, backend="reference", samples=5000))
    >>> f"{pair:.3g} rad/s, {mode / pair:.2f}"
    '1.86e+05 rad/s, 1.27'
    """
    return _highest(scene, contact_motion(scene, trajectory)[0])


def highest_mode(scene: Scene, displacement: Floats) -> float:
    """Return the highest angular frequency of a mode, rad/s, of samples of displacements, m, ``(n_t, n_body)``."""
    c, x = scene.contacts, np.pad(displacement, ((0, 0), (0, 1)))  # a wall is one more body at rest
    return _highest(scene, x[:, c.left] - x[:, c.right] - c.gap)[1]


def _highest(scene: Scene, overlap: Floats) -> tuple[float, float]:
    """Return what :func:`highest_frequencies` returns, by the overlaps of contacts, m, ``(n_t, n_contact)``."""
    from scipy.linalg import eigvalsh_tridiagonal

    c, mobility = scene.contacts, np.append(1.0 / np.array(scene.mass), 0.0)
    k = tangent_stiffness(scene, overlap)
    # along the line of bodies: the left wall's contact is the first
    links = len(scene.stiffness)
    first = [links] if scene.wall_left is not None else []
    line = np.array([*first, *range(links), *range(links + len(first), scene.n_contact)], dtype=np.int64)
    k, left, right = k[:, line], c.left[line], c.right[line]
    own_value = k * (mobility[left] + mobility[right])
    between = -np.sqrt(k[:, :-1] * k[:, 1:]) * mobility[right[:-1]]
    fastest = np.max(own_value, axis=1, initial=0.0)
    highest = 0.0
    for row in np.argsort(-fastest).tolist():
        if 2.0 * fastest[row] <= highest:
            break  # no mode of what is left can be higher
        top = len(line) - 1
        result = (
            eigvalsh_tridiagonal(own_value[row], between[row], select="i", select_range=(top, top))
            if top
            else own_value[row]
        )
        highest = max(highest, float(result[0]))
    return math.sqrt(float(np.max(fastest, initial=0.0))), math.sqrt(highest)
