"""Force and energy of one contact, and the stiffness of two crossed cylinders after the paper.

The force law is ``F = beta [overlap]_+^(n-1)`` with energy ``beta [overlap]_+^n / n``; n = 5/2 for Hertz
(Johnson 1985, *Contact Mechanics*, eq. 4.23). ``beta`` is the paper's contact stiffness coefficient.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dem_bridge.physics.elliptic import ellipse_integrals

Floats = NDArray[np.float64]


def force(overlap: ArrayLike, stiffness: ArrayLike, exponent: ArrayLike) -> Floats:
    """Return the contact force ``beta [overlap]_+^(n-1)``, N.

    Parameters
    ----------
    overlap : array_like
        Overlap, m; negative where the contact is open. The shapes of all three broadcast.
    stiffness : array_like
        Stiffness beta, N/m^(n-1).
    exponent : array_like
        Exponent n of the energy.

    References
    ----------
    Chaunsali, Kim & Yang (2018), section 3.

    Examples
    --------
    >>> round(float(force(4e-6, 1e9, 2.5)), 12), float(force(-1.0, 1e9, 2.5))
    (8.0, 0.0)
    """
    closed = np.maximum(np.asarray(overlap, dtype=float), 0.0)
    return np.asarray(stiffness * closed ** (np.asarray(exponent, dtype=float) - 1.0))


def energy(overlap: ArrayLike, stiffness: ArrayLike, exponent: ArrayLike) -> Floats:
    """Return the energy stored in a contact, ``beta [overlap]_+^n / n``, J.

    The parameters are those of :func:`force`.

    Examples
    --------
    >>> float(energy(4e-6, 1e9, 2.5))
    1.28e-05
    """
    closed = np.maximum(np.asarray(overlap, dtype=float), 0.0)
    return np.asarray(stiffness * closed ** np.asarray(exponent, dtype=float) / exponent)


def check_angle(angle: float) -> None:
    """Raise ValueError unless ``angle`` (degrees) is a possible angle between the axes of crossed cylinders."""
    if not 0.0 < angle <= 90.0:
        raise ValueError(f"contact angle = {angle!r} degrees; allowed: 0 < angle <= 90")


def axis_ratio_paper(angle: float) -> float:
    """Return the axis ratio b/a of the contact ellipse of two equal cylinders, in the paper's approximation.

    The paper gives ``b/a = [(1 + cos a)/(1 - cos a)]^(-2/3)``. The code uses the equivalent ``tan(a/2)^(4/3)``, in
    which no digits cancel at small angles.

    Parameters
    ----------
    angle : float
        Angle between the axes, degrees, 0 < angle <= 90.

    Raises
    ------
    ValueError
        If the angle is outside this range.

    References
    ----------
    Chaunsali, Kim & Yang (2018), below eq. 3.1.

    Examples
    --------
    >>> axis_ratio_paper(90.0), round(axis_ratio_paper(2.0), 7)
    (1.0, 0.0045279)
    """
    check_angle(angle)
    # in floating point tan(pi/4) differs from 1 by an ulp
    return 1.0 if angle == 90.0 else math.tan(math.radians(angle) / 2.0) ** (4.0 / 3.0)


def cylinder_stiffness_paper(angle: float, *, radius: float, young: float, poisson: float) -> float:
    """Return the stiffness beta of two equal cylinders crossed at ``angle``, N/m^1.5, by the paper's eq. 3.1.

    As printed the formula is 0/0 at 90 degrees (eccentricity e -> 0) and loses digits by cancellation near both ends.
    With the axis ratio k = b/a, e^2 = 1 - k^2, and the integrals b(k), d(k) of :mod:`.elliptic` ::

        K = b + d     K - E = e^2 d     (a/b)^2 E - K = e^2 b/k^2

    Every e then cancels exactly, and no digits are lost at 90 degrees.

    Parameters
    ----------
    angle : float
        Angle between the axes, degrees, 0 < angle <= 90.
    radius : float
        Radius of both cylinders, m.
    young : float
        Young's modulus, Pa.
    poisson : float
        Poisson's ratio.

    Raises
    ------
    ValueError
        If the angle is outside its range.

    References
    ----------
    Chaunsali, Kim & Yang (2018), eq. 3.1.

    Examples
    --------
    >>> quartz = dict(radius=9e-3, young=72e9, poisson=0.17)
    >>> f"{cylinder_stiffness_paper(2.0, **quartz):.12g}", f"{cylinder_stiffness_paper(90.0, **quartz):.13g}"
    ('72729932838.4', '4689197642.511')
    """
    ratio = axis_ratio_paper(angle)
    integral_b, integral_d = ellipse_integrals(ratio)
    bracket = 4.0 / (math.pi * ratio) * math.sqrt(integral_b * integral_d)
    modulus = 2.0 * young / (3.0 * (1.0 - poisson**2))
    geometry = math.sqrt(radius / math.sin(math.radians(angle)))
    return float(modulus * geometry * (2.0 * (integral_b + integral_d) / math.pi) ** -1.5 * math.sqrt(bracket))
