"""DEM's own measure of a time step: the Rayleigh time of a body.

Time steps of granular codes are named as a share of it, 10 to 40 % by custom (Thornton & Randall 1988; Li, Xu &
Thornton 2005). It is the way half around a sphere over the speed of Rayleigh's surface wave: a property of the
material, which knows nothing of contacts, impact speeds or masses of neighbours. What such a share is worth on a chain
is what :mod:`dem_bridge.studies.rule_of_thumb` measures.
"""

from __future__ import annotations

import math

from dem_bridge.physics.hertz import poisson_ratio
from dem_bridge.physics.valid import above


def rayleigh_time(*, radius: float, density: float, modulus: float, poisson: float) -> float:
    """``pi R sqrt(rho/G) / (0.1631 nu + 0.8766)``, s; ``radius`` in m, ``density`` in kg/m^3, ``modulus`` G in Pa.

    G is the shear modulus, ``Y / (2 (1 + nu))``. The denominator is a line through the ratio of Rayleigh's to the shear
    wave's speed, the root of his cubic (Lord Rayleigh 1885, *Proc. Lond. Math. Soc.* 17, 4): within 0.3 % of it from
    nu = 0 to 0.5, 4 % for any below. Thornton & Randall (1988), in *Micromechanics of Granular Materials*, 133; Li, Xu
    & Thornton (2005), *Powder Technol.* 160, 219. ValueError for what no body has.

    >>> quartz = dict(density=2200.0, modulus=72e9 / (2.0 * 1.17), poisson=0.17)
    >>> f"{1e6 * rayleigh_time(radius=9e-3, **quartz):.3f} us"
    '8.360 us'
    """
    radius = above(0.0, "radius", radius, "m")
    density = above(0.0, "density", density, "kg/m^3")
    modulus = above(0.0, "modulus", modulus, "Pa")
    poisson = poisson_ratio("poisson", poisson)
    return math.pi * radius * math.sqrt(density / modulus) / (0.1631 * poisson + 0.8766)
