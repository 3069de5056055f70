"""The contact ellipse: its complete elliptic integrals, and the paper's approximation for crossed cylinders.

With the axis ratio k = b/a and e^2 = 1 - k^2 the integrals of Jahnke and Emde are ``b(k) = (E - k^2 K)/e^2`` and
``d(k) = (K - E)/e^2``, whose sum is K. As written both cancel near the circle (e -> 0); the arithmetic-geometric mean
gives them without (Abramowitz & Stegun 1964, 17.6.3 and 17.6.4)::

    a_0 = 1, g_0 = k        a_(n+1) = (a_n + g_n)/2, g_(n+1) = sqrt(a_n g_n), c_(n+1) = c_n^2/(4 a_(n+1)), c_0 = e
    K = pi/(2 a)            d/K = sum over n >= 0 of 2^(n-1) c_n^2/e^2

scipy has them (``elliprd``), but importing it takes 0.15 s, which is longer than all else of reading a scene file.
"""

from __future__ import annotations

import math

#: c_n^2/e^2 below which the mean has converged; it falls as the square of itself
_CONVERGED = 1e-17


def ellipse_integrals(axis_ratio: float) -> tuple[float, float]:
    """Return b(k) and d(k) for the axis ratio k > 0 of an ellipse, to a few units of the last digit.

    Examples
    --------
    >>> ellipse_integrals(1.0)  # the circle: pi/4 both
    (0.7853981633974483, 0.7853981633974483)
    """
    squared_e = (1.0 - axis_ratio) * (1.0 + axis_ratio)
    mean, geometric, term, weight, share = 1.0, axis_ratio, 1.0, 0.5, 0.5
    while abs(weight * term) > _CONVERGED:
        mean, geometric = 0.5 * (mean + geometric), math.sqrt(mean * geometric)
        term = squared_e * (0.25 * term / mean) ** 2
        weight *= 2.0
        share += weight * term
    integral_k = 0.5 * math.pi / mean
    return integral_k * (1.0 - share), integral_k * share


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
    With the axis ratio k = b/a, e^2 = 1 - k^2, and the integrals b(k), d(k) of :func:`ellipse_integrals` ::

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
