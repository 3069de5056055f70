"""The times of a scene by which DEM users choose a time step: the Rayleigh time and the time of a Hertz collision.

Both follow from the scene alone. The third, 2/omega of the stiffest contact, requires the overlaps of a run: it is 2
divided by the ``frequency`` of a :class:`~dem_bridge.backends.prescan.Prescan`.

By custom a time step is 10 to 40 % of the Rayleigh time (Thornton & Randall 1988; Li, Xu & Thornton 2005). The Rayleigh
time is half the circumference of a sphere divided by the speed of Rayleigh's surface wave. It depends on the material
alone, not on contacts, impact speeds or the masses of neighbours. :mod:`dem_bridge.studies.rule_of_thumb` measures the
error that such a step makes on a chain.
"""

from __future__ import annotations

import math

import numpy as np

from dem_bridge.physics.exact import two_body_collision
from dem_bridge.physics.numbers import above, poisson_ratio
from dem_bridge.scene.scene import Scene


def rayleigh_time_of(scene: Scene) -> float | None:
    """Return the smallest :func:`~dem_bridge.scene.timescales.rayleigh_time` of the scene's bodies, s.

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

    As is usual in DEM codes, each contact is taken alone with its two bodies (a wall or a piston has infinite mass),
    which collide at the largest velocity that the scene gives. The result is None if nothing moves or there are no
    contacts. A contact with a law of its own is represented by its ``stiffness`` and ``exponent``.

    Examples
    --------
    >>> import dem_bridge as db
    >>> f"{1e6 * contact_time_of(db.load_scene('decelerating-40')):.2f} us"
    '18.33 us'
    """
    speed = max(*map(abs, scene.velocity), 0.0 if scene.piston is None else scene.piston.peak)
    if speed == 0.0 or scene.n_contact == 0:
        return None
    c, mass = scene.contacts, np.array([1.0 / mobility if mobility else math.inf for mobility in scene.mobility])
    pairs = zip(np.minimum(mass[c.left], mass[c.right]), np.maximum(mass[c.left], mass[c.right]), strict=True)
    return min(
        two_body_collision(masses=masses, velocities=(speed, 0.0), stiffness=beta, exponent=n).contact_time
        for masses, beta, n in zip(pairs, c.stiffness.tolist(), c.exponent.tolist(), strict=True)
    )


def rayleigh_time(*, radius: float, density: float, modulus: float, poisson: float) -> float:
    """Return the Rayleigh time ``pi R sqrt(rho/G) / (0.1631 nu + 0.8766)``, s.

    The denominator is a linear fit of the ratio of the Rayleigh speed to the shear wave speed, which is the root of
    Rayleigh's cubic (Lord Rayleigh 1885). The fit is within 0.3 % of the root from nu = 0 to 0.5, and within 4 % for
    negative nu.

    Parameters
    ----------
    radius : float
        Radius R of the sphere, m.
    density : float
        Density rho, kg/m^3.
    modulus : float
        Shear modulus ``G = Y / (2 (1 + nu))``, Pa.
    poisson : float
        Poisson's ratio nu.

    Raises
    ------
    ValueError
        If a parameter is outside the range that a material can have.

    References
    ----------
    Lord Rayleigh (1885), *Proc. Lond. Math. Soc.* 17, 4; Thornton & Randall (1988), in *Micromechanics of Granular
    Materials*, 133; Li, Xu & Thornton (2005), *Powder Technol.* 160, 219.

    Examples
    --------
    >>> quartz = dict(density=2200.0, modulus=72e9 / (2.0 * 1.17), poisson=0.17)
    >>> f"{1e6 * rayleigh_time(radius=9e-3, **quartz):.3f} us"
    '8.360 us'
    """
    radius = above(0.0, "radius", radius, "m")
    density = above(0.0, "density", density, "kg/m^3")
    modulus = above(0.0, "modulus", modulus, "Pa")
    poisson = poisson_ratio("poisson", poisson)
    return math.pi * radius * math.sqrt(density / modulus) / (0.1631 * poisson + 0.8766)
