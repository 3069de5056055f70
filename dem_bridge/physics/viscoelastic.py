"""The impact of viscoelastic spheres, ``F = beta d^(3/2) + gamma beta d^(1/2) d'`` (Kuwabara & Kono 1987).

With the effective mass m and the speed of approach v, the restitution depends on one number, the strength
``s = B v^(1/5)`` with ``B = gamma (beta/m)^(2/5)``. With ``d = u^2`` and ``dt = u dtau`` the motion in units of
``(m v^2/beta)^(2/5)`` and v is polynomial, ``u' = p/2`` and ``p' = -u^4 - s u^2 p``, so that ``e^(-1/5)`` is a smooth
function of s, or of ``sqrt(s)`` where the net force is clipped at zero (Schwager & Poeschel 2008, *Phys. Rev. E* 78,
051304). Its Chebyshev coefficients follow from solutions of this motion with 26 digits at 40 nodes. For small s ::

    e = 1 - C s + (3/5) C^2 s^2 - ...,   C = (4/5) (5/4)^(3/5) Gamma(3/5) Gamma(3/2)/Gamma(21/10) = 1.153448858

(Ramirez et al. 1999, *Phys. Rev. E* 60, 4465).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from dem_bridge.physics.numbers import above, not_negative

#: largest strength of the series: e = 0.0953, clipped 0.2116
LARGEST_STRENGTH = 2.0
#: Chebyshev coefficients of e^(-1/5) over 0 <= s <= 2, and of the clipped one over 0 <= sqrt(s) <= sqrt(2)
# fmt: off
_PULLING = (
    1.2734466188663125, 0.2951115504875832, 0.02636610621115376, 0.0049364959562563865, 0.0002641280867592186,
    1.652337899893251e-05, -1.407486383908612e-05, -2.35416764894625e-06, -5.797486006975541e-07,
    -1.83215276972584e-08, 2.2322678102746924e-09, 3.940890644776072e-09, 6.32506183983117e-10,
    1.429407799492943e-10, 4.46749510508267e-13, -1.6658108397236358e-12, -1.3379065643061682e-12,
    -2.0227245776292479e-13, -4.2522905059754035e-14, 1.2141205679292685e-15, 8.144839816481308e-16,
    4.92191886786462e-16, 6.919384644748508e-17,
)
_CLIPPED = (
    1.1458382849537476, 0.18728938492727948, 0.03640158092900972, -0.005363524773461839, -0.0001270293089346335,
    0.00018226151497493785, -1.5404864544273143e-05, -8.24194937001055e-06, 2.5812647639887428e-06,
    -3.134784335777271e-08, -1.4400380294080764e-07, 2.7505791668622994e-08, 4.310519959927812e-09,
    -2.6059585286709886e-09, 1.781022567843217e-10, 1.5232838119103482e-10, -4.21188767623569e-11,
    -3.018273859731443e-12, 3.721107839306917e-12, -5.084244016463993e-13, -1.804565176086951e-13,
    7.479375105215962e-14, -1.1533615945057222e-15, -5.54917803372492e-15, 1.214554629227887e-15,
    1.8616151192564803e-16,
)
# fmt: on


@dataclass(frozen=True, kw_only=True)
class ViscoelasticImpact:
    """Restitution of viscoelastic spheres by a series. :func:`viscoelastic_impact` computes it."""

    strength: float
    """B v^(1/5)."""
    restitution: float
    """Coefficient of restitution: speed of separation over speed of approach."""
    remainder: float
    """Bound of the error of ``restitution``: all omitted terms of the series, and round-off."""


def viscoelastic_impact(
    *, mass: float, speed: float, stiffness: float, viscosity: float, clip: bool, terms: int = 26
) -> ViscoelasticImpact:
    """Return the restitution of two viscoelastic spheres, or of a sphere on a plane, with a bound of its error.

    Parameters
    ----------
    mass : float
        Effective mass m, kg: 1/(1/m1 + 1/m2), or the mass of a sphere that hits a plane.
    speed : float
        Speed of approach, m/s.
    stiffness : float
        Stiffness beta, N/m^1.5.
    viscosity : float
        Relaxation time gamma, s, >= 0.
    clipped : bool
        True if the net force is clipped at zero, as by LAMMPS' ``limit_damping``; otherwise the contact pulls until the
        overlap is zero.
    terms : int
        Number of terms of the series, from 1; the series has 23 terms that matter, clipped 26.

    Raises
    ------
    ValueError
        If a parameter is outside its range, or the strength is above 2.

    Examples
    --------
    >>> for clipped in (True, False):
    ...     hit = viscoelastic_impact(mass=1.0, speed=1.0, stiffness=1.0, viscosity=0.05, clip=clipped)
    ...     print(f"{hit.restitution:.12f} +- {hit.remainder:.0e}")
    0.944396779178 +- 3e-15
    0.944259972343 +- 3e-15
    """
    m, v = above(0.0, "mass", mass, "kg"), above(0.0, "speed", speed, "m/s")
    ratio = above(0.0, "stiffness", stiffness, "N/m^1.5") / m
    if not 1 <= terms <= len(_CLIPPED):
        raise ValueError(f"terms = {terms!r}; allowed: a whole number from 1 to {len(_CLIPPED)}")
    strength = not_negative("viscosity", viscosity, "s") * ratio**0.4 * v**0.2
    if not strength <= LARGEST_STRENGTH:
        raise ValueError(
            f"strength gamma (beta/m)^(2/5) v^(1/5) = {strength:.6g}; allowed: at most {LARGEST_STRENGTH:g}"
        )
    share = strength / LARGEST_STRENGTH
    coefficients = _CLIPPED if clip else _PULLING
    root = np.polynomial.chebyshev.chebval(2.0 * (math.sqrt(share) if clip else share) - 1.0, coefficients[:terms])
    # |T_k| <= 1; e is the root to the power -5
    omitted = math.fsum(map(abs, coefficients[terms:])) + 3.0 * math.ulp(1.0)
    remainder = 5.0 * omitted / (float(root) - omitted) ** 6
    return ViscoelasticImpact(strength=strength, restitution=min(float(root) ** -5.0, 1.0), remainder=remainder)
