"""Write the paper's eq. 3.1 a second time, in decimal arithmetic of 60 digits, with the standard library alone.

As printed, with K and E from the arithmetic-geometric mean (Abramowitz & Stegun 17.6); what cancels near 2 and 90
degrees costs some of the 60 digits and none of the first 16.
"""

from __future__ import annotations

from decimal import Decimal, localcontext

DIGITS = 60


def mean_of_means(first: Decimal, other: Decimal) -> tuple[Decimal, list[Decimal]]:
    """Return the arithmetic-geometric mean and the differences c_1, c_2, ... of its iteration."""
    differences = []
    while abs(first - other) > Decimal(10) ** (5 - DIGITS):
        differences.append((first - other) / 2)
        first, other = (first + other) / 2, (first * other).sqrt()
    return first, differences


def pi() -> Decimal:
    """Return pi by Gauss, Brent and Salamin: 4 M^2 / (1 - sum 2^(j+1) c_j^2), M the mean of 1 and 1/sqrt(2)."""
    mean, differences = mean_of_means(Decimal(1), (1 / Decimal(2)).sqrt())
    lost = sum((2 ** (j + 1) * c**2 for j, c in enumerate(differences, start=1)), Decimal(0))
    return 4 * mean**2 / (1 - lost)


def cosine(x: Decimal) -> Decimal:
    """Return cos x by its power series."""
    total, term, n = Decimal(0), Decimal(1), 0
    while abs(term) > Decimal(10) ** (-DIGITS - 5):
        total += term
        n += 2
        term *= -x * x / (n * (n - 1))
    return total


def complete_elliptic(squared_modulus: Decimal) -> tuple[Decimal, Decimal]:
    """Return the complete elliptic integrals K and E of modulus e."""
    mean, differences = mean_of_means(Decimal(1), (1 - squared_modulus).sqrt())
    first = pi() / (2 * mean)
    lost = squared_modulus / 2 + sum(2 ** (j - 1) * c**2 for j, c in enumerate(differences, start=1))
    return first, first * (1 - lost)


def cylinder_stiffness(angle: float, *, radius: float, young: float, poisson: float) -> float:
    """Return eq. 3.1 as printed; ``angle`` in degrees, below 90."""
    with localcontext() as context:
        context.prec = DIGITS
        a = Decimal(angle) * pi() / 180
        cos = cosine(a)
        sin = (1 - cos**2).sqrt()
        ratio = ((1 + cos) / (1 - cos)) ** (Decimal(-2) / 3)  # b/a
        squared = 1 - ratio**2
        k, e = complete_elliptic(squared)
        braces = 4 / (pi() * squared) * ((e / ratio**2 - k) * (k - e)).sqrt()
        modulus = 2 * Decimal(young) / (3 * (1 - Decimal(poisson) ** 2))
        return float(modulus * (Decimal(radius) / sin).sqrt() * (2 * k / pi()) ** Decimal("-1.5") * braces.sqrt())
