"""The times of a scene that DEM users set a time step beside: Rayleigh's and that of a Hertz collision.

Both are known before any run. The third, 2/omega of the stiffest contact, needs the overlaps of one: it is twice one
over the ``frequency`` of a :class:`~dem_bridge.backends.prescan.Prescan`.
"""

from __future__ import annotations

import numpy as np

from dem_bridge.physics.exact import two_body_collision
from dem_bridge.physics.rayleigh import rayleigh_time
from dem_bridge.scene import Scene


def rayleigh_time_of(scene: Scene) -> float | None:
    """The least :func:`~dem_bridge.physics.rayleigh.rayleigh_time` of the scene's bodies, s.

    None where the scene does not say what its bodies are (``geometry``): masses and stiffnesses alone have no such
    time. A cylinder counts by its radius, as a sphere does.

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


def contact_time_of(scene: Scene) -> float | None:
    """The shortest two-body collision among the scene's contacts, s, at its largest start velocity.

    As DEM codes set it: each contact alone between its own two bodies (a wall is of infinite mass), touched at the
    fastest speed that the scene starts with. None where nothing moves or touches. A contact with a law of its own
    counts by the power near it.

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
        two_body_collision(masses=both, velocities=(speed, 0.0), stiffness=beta, exponent=n).contact_time
        for both, beta, n in zip(pairs, c.stiffness.tolist(), c.exponent.tolist(), strict=True)
    )
