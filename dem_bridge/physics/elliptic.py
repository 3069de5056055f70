"""Complete elliptic integrals of a contact ellipse, by the arithmetic-geometric mean.

With e^2 = 1 - k^2 the integrals of Jahnke and Emde are ``b(k) = (E - k^2 K)/e^2`` and ``d(k) = (K - E)/e^2``, whose sum
is K. As written both cancel near the circle (e -> 0); the mean gives them without (Abramowitz & Stegun 1964, 17.6.3
and 17.6.4)::

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
