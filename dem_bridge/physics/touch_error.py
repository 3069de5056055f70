"""Error that a method with a fixed step makes where a contact opens or closes.

Near a touch at time t* the overlap is ``u (t - t*)``, and the force ``beta (u (t - t*))^p`` with p = n - 1 has no
bounded derivative of an order above p. A method with kicks of weights b at nodes c of each step h sums this force; the
Euler-Maclaurin formula for a branch point (Navot 1961) gives the error of the sum::

    impulse of the method - exact impulse = beta u^p h^(p+1) C(theta)        C = sum_i b_i zeta(-p, <c_i - theta>)

with theta the place of the touch within its step, zeta Hurwitz' function and <x> the value in (0, 1] that differs from
x by a whole number. So the velocity error is of order p + 1 = n in h, however high the order of the method is.

The work of that impulse is a jump of the energy that a symplectic method conserves elsewhere: ``-beta (u h)^n
C(theta)`` where the contact closes, and the opposite where it opens, with theta counted backwards from the end of the
step.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dem_bridge.physics.numbers import above

#: terms that are summed, and Bernoulli numbers B_2, B_4, ... of the rest, whose next term is below 1e-15
_TERMS, _BERNOULLI = 12, (1 / 6, -1 / 30, 1 / 42, -1 / 30, 5 / 66, -691 / 2730)
#: terms of a Fourier series of a mean square, whose rest is 1e-9 of it for n = 5/2
_WAVES = 200


def hurwitz_zeta(power: float, start: ArrayLike) -> NDArray[np.float64]:
    """Return Hurwitz' zeta function zeta(-power, start), the regularised sum of ``(start + k)^power`` over k >= 0.

    scipy has it for negative powers only.

    Parameters
    ----------
    power : float
        Power p > 0.
    start : array_like
        Values a >= 0.

    Examples
    --------
    >>> f"{hurwitz_zeta(1.5, 1.0):.13f}", abs(float(hurwitz_zeta(1.0, 0.0)) + 1 / 12) < 1e-14
    ('-0.0254852018898', True)
    """
    p, a = above(0.0, "power", power), np.asarray(start, dtype=np.float64)
    x = a + _TERMS
    total = np.sum((a[..., None] + np.arange(_TERMS)) ** p, axis=-1) - x ** (p + 1.0) / (p + 1.0) + 0.5 * x**p
    rising = -p  # of the derivative of an odd order: -p (1 - p) (2 - p) ...
    for half, bernoulli in enumerate(_BERNOULLI):
        odd = 2 * half + 1
        total += bernoulli / math.factorial(odd + 1) * rising * x ** (p - odd)
        rising *= (odd - p) * (odd + 1 - p)
    return np.asarray(total)


def touch_coefficient(drifts: ArrayLike, kicks: ArrayLike, *, exponent: float, phase: float) -> float:
    """Return the coefficient C of the impulse error of a splitting method at an opening or closing.

    Its mean over all phases is zero. At phase 0, with the touch on the step grid, it vanishes for whole exponents
    below the order of the method, because the force then has all one-sided derivatives. It does not for Hertz' law.

    Parameters
    ----------
    drifts, kicks : array_like
        Parts of the step by which bodies drift, and by which they are kicked before, between and after.
    exponent : float
        Exponent n > 1 of the contact; the force grows with overlap^(n-1).
    phase : float
        Place theta of the touch within its step, from 0 to 1.

    References
    ----------
    Navot (1961), *J. Math. and Phys.* 40, 271; Gear & Østerby (1984), *ACM Trans. Math. Softw.* 10, 23.

    Examples
    --------
    Velocity-Verlet, for Hertz' law and for a linear spring:

    >>> [f"{touch_coefficient([1.0], [0.5, 0.5], exponent=n, phase=0.0):.5f}" for n in (2.5, 2.0)]
    ['-0.02549', '-0.08333']
    """
    return float(touch_coefficients(drifts, kicks, exponent=exponent, phase=phase))


def touch_coefficients(
    drifts: ArrayLike, kicks: ArrayLike, *, exponent: float, phase: ArrayLike
) -> NDArray[np.float64]:
    """Return :func:`touch_coefficient` at each of many phases.

    Examples
    --------
    >>> touch_coefficients([1.0], [0.5, 0.5], exponent=2.5, phase=[0.0, 0.5]).round(5)
    array([-0.02549,  0.01647])
    """
    nodes = np.concatenate([[0.0], np.cumsum(drifts)])
    start = np.mod(nodes - np.asarray(phase, dtype=np.float64)[..., None], 1.0)
    # the force is continuous: the node at the touch counts the same from both sides
    return np.asarray(hurwitz_zeta(above(1.0, "exponent", exponent) - 1.0, start) @ np.asarray(kicks))


def touch_rms(drifts: ArrayLike, kicks: ArrayLike, *, exponent: float = 2.5) -> float:
    """Return the root mean square of :func:`touch_coefficient` over all phases.

    Hurwitz' Fourier series gives ``2 Gamma(n)^2 / (2 pi)^(2n) sum_k |sum_i b_i exp(2 pi i k c_i)|^2 / k^(2n)`` for the
    mean square. For velocity-Verlet the sum is the zeta function of 2n.

    Examples
    --------
    >>> f"{touch_rms([1.0], [0.5, 0.5]):.6f}"  # sqrt(2 zeta(5)) Gamma(5/2) / (2 pi)^(5/2)
    '0.019345'
    """
    nodes, waves = np.concatenate([[0.0], np.cumsum(drifts)]), np.arange(1.0, _WAVES + 1.0)
    weights = np.abs(np.exp(2j * np.pi * waves[:, None] * nodes) @ np.asarray(kicks)) ** 2
    square = 2.0 * math.gamma(exponent) ** 2 / (2.0 * np.pi) ** (2.0 * exponent)
    return math.sqrt(square * float(np.sum(weights / waves ** (2.0 * exponent))))
