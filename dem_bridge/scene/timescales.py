"""The times of a scene by which DEM users choose a time step: the Rayleigh time and the time of a Hertz collision.

Both follow from the scene alone. The third, 2/omega of the stiffest contact, requires the overlaps of a run: it is 2
divided by the ``frequency`` of a :class:`~dem_bridge.backends.prescan.Prescan`.
"""

from __future__ import annotations

import math

import numpy as np

from dem_bridge.physics.exact import two_body_collision
from dem_bridge.physics.rayleigh import rayleigh_time
from dem_bridge.scene.scene import Scene


def rayleigh_time_of(scene: Scene) -> float | None:
    """Return the smallest :func:`~dem_bridge.physics.rayleigh.rayleigh_time` of the scene's bodies, s.

    The result is None for a scene without ``geometry``, because masses and stiffnesses alone do not define this time. A
    cylinder is treated as a sphere of its radius.

    Examples
    --------
    >>> import dem_bridge as db
    >>> f"{1e6 * rayleigh_time_of(db.load_scene('decelerating-40')):.3f} us"
    '8.360 us'
    """
    if scene.geometry is None:
        return None
    return min(
        rayleigh_time(
            radius=body.radius,
            density=body.material.density,
            modulus=body.material.youngs_modulus / (2.0 * (1.0 + body.material.poissons_ratio)),
            poisson=body.material.poissons_ratio,
        )
        for body in scene.geometry.bodies
    )


def samples_of(scene: Scene, dt: float, steps: int = 1) -> int:
    """Return the number of samples, at most that of the scene, that are at least ``steps`` steps of ``dt`` (s) apart.

    Steps of backends fall on samples, so that samples closer than a step would shorten it.

    Examples
    --------
    >>> import dem_bridge as db
    >>> scene = db.load_scene("decelerating-40")  # 3 ms, 500 samples
    >>> samples_of(scene, 1e-6), samples_of(scene, 1e-5), samples_of(scene, 1e-5, steps=4)
    (500, 300, 75)
    """
    count = max(1, math.ceil(scene.duration / dt * (1.0 - 1e-9)))
    apart = max(steps, math.ceil(count / scene.samples))
    return max(1, count // apart)


def contact_time_of(scene: Scene) -> float | None:
    """Return the duration of the shortest two-body collision among the scene's contacts, s.

    As is usual in DEM codes, each contact is taken alone with its two bodies (a wall has infinite mass), which collide
    at the largest start velocity of the scene. The result is None if nothing moves or there are no contacts. A contact
    with a law of its own is represented by its ``stiffness`` and ``exponent``.

    Examples
    --------
    >>> import dem_bridge as db
    >>> f"{1e6 * contact_time_of(db.load_scene('decelerating-40')):.2f} us"
    '18.33 us'
    """
    speed = max(abs(v) for v in scene.velocity)
    if speed == 0.0 or scene.n_contact == 0:
        return None
    c, mass = scene.contacts, np.append(scene.mass, np.inf)
    pairs = zip(np.minimum(mass[c.left], mass[c.right]), np.maximum(mass[c.left], mass[c.right]), strict=True)
    return min(
        two_body_collision(masses=masses, velocities=(speed, 0.0), stiffness=beta, exponent=n).contact_time
        for masses, beta, n in zip(pairs, c.stiffness.tolist(), c.exponent.tolist(), strict=True)
    )
