"""The Rayleigh time of a body, by which DEM users measure their time steps.

By custom a time step is 10 to 40 % of it (Thornton & Randall 1988; Li, Xu & Thornton 2005). It is half the
circumference of a sphere divided by the speed of Rayleigh's surface wave. It depends on the material alone, not on
contacts, impact speeds or the masses of neighbours. :mod:`dem_bridge.studies.rule_of_thumb` measures the error that
such a step makes on a chain.
"""

from __future__ import annotations

import math

from dem_bridge.physics.valid import above, poisson_ratio


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
