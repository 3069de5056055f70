"""Contact laws: force and energy of one contact, and the stiffness of two crossed cylinders.

The force law is ``F = beta [overlap]_+^(n-1)`` with energy ``beta [overlap]_+^n / n``; n = 5/2 for Hertz
(Johnson 1985, *Contact Mechanics*, eq. 4.23). ``beta`` is the paper's contact stiffness coefficient.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]


def force(overlap: ArrayLike, stiffness: ArrayLike, exponent: ArrayLike) -> Floats:
    """Contact force, N: ``beta [overlap]_+^(n-1)``.

    ``overlap`` in m (negative = open), ``stiffness`` in N/m^(n-1), ``exponent`` n; shapes broadcast.
    Source: Chaunsali, Kim & Yang (2018), section 3.

    >>> round(float(force(4e-6, 1e9, 2.5)), 12), float(force(-1.0, 1e9, 2.5))
    (8.0, 0.0)
    """
    closed = np.maximum(np.asarray(overlap, dtype=float), 0.0)
    return np.asarray(stiffness * closed ** (np.asarray(exponent, dtype=float) - 1.0))


def energy(overlap: ArrayLike, stiffness: ArrayLike, exponent: ArrayLike) -> Floats:
    """Energy stored in a contact, J: ``beta [overlap]_+^n / n``; shapes broadcast.

    >>> float(energy(4e-6, 1e9, 2.5))
    1.28e-05
    """
    closed = np.maximum(np.asarray(overlap, dtype=float), 0.0)
    return np.asarray(stiffness * closed ** np.asarray(exponent, dtype=float) / exponent)


def check_angle(angle: float) -> None:
    """Raises ValueError where ``angle`` (degrees) is none between the axes of crossed cylinders."""
    if not 0.0 < angle <= 90.0:
        raise ValueError(f"contact angle = {angle!r} degrees; allowed: 0 < angle <= 90")


def axis_ratio_paper(angle: float) -> float:
    """Axis ratio b/a of the contact ellipse of two equal cylinders, in the paper's approximation.

    ``angle`` between the axes in degrees, 0 < angle <= 90. Below its eq. 3.1 the paper gives
    ``b/a = [(1 + cos a)/(1 - cos a)]^(-2/3)``; written here as ``tan(a/2)^(4/3)``, which is the same and does
    not cancel at small angles.

    >>> axis_ratio_paper(90.0), round(axis_ratio_paper(2.0), 7)
    (1.0, 0.0045279)
    """
    check_angle(angle)
    # at 90 degrees tan(pi/4) is 1 only up to an ulp
    return 1.0 if angle == 90.0 else math.tan(math.radians(angle) / 2.0) ** (4.0 / 3.0)


def cylinder_stiffness_paper(angle: float, *, radius: float, young: float, poisson: float) -> float:
    """Stiffness beta of two equal cylinders crossed at ``angle``, N/m^1.5: the paper's eq. 3.1.

    ``angle`` in degrees (0 < angle <= 90), ``radius`` in m, ``young`` in Pa.

    As printed the formula is 0/0 at 90 degrees (eccentricity e -> 0) and cancels near both ends. With the
    axis ratio k = b/a, e^2 = 1 - k^2, the differences of complete elliptic integrals are Carlson's symmetric
    integrals (Carlson 1979, *Numer. Math.* 33, eq. 4.6; DLMF 19.25.1)::

        K = R_F(0, k^2, 1)     K - E = e^2 R_D(0, k^2, 1)/3     (a/b)^2 E - K = e^2 R_D(0, 1, k^2)/3

    so that every e cancels exactly and nothing is lost at either end.

    >>> quartz = dict(radius=9e-3, young=72e9, poisson=0.17)
    >>> f"{cylinder_stiffness_paper(2.0, **quartz):.12g}", f"{cylinder_stiffness_paper(90.0, **quartz):.13g}"
    ('72729932838.4', '4689197642.511')
    """
    from scipy.special import elliprd, elliprf  # a fifth of a second, which scenes with stiffnesses do not need

    ratio = axis_ratio_paper(angle)
    squared = ratio * ratio
    integral_k = elliprf(0.0, squared, 1.0)
    bracket = 4.0 / (3.0 * math.pi) * math.sqrt(elliprd(0.0, squared, 1.0) * elliprd(0.0, 1.0, squared))
    modulus = 2.0 * young / (3.0 * (1.0 - poisson**2))
    geometry = math.sqrt(radius / math.sin(math.radians(angle)))
    return float(modulus * geometry * (2.0 * integral_k / math.pi) ** -1.5 * math.sqrt(bracket))
