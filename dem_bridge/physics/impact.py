"""Normal impact with the force ``F = beta d^(n-1) + alpha sqrt(m beta) d^((n-2)/2) d'``, and its restitution.

d is the overlap and m the effective mass, 1/(1/m1 + 1/m2) or the mass of a body that hits a wall. With
``y = d^(n/2)`` and ``ds = d^((n-2)/2) dt`` the motion is that of a damped linear oscillator of damping ratio
``alpha / sqrt(2 n)``, whatever n, speed, mass and stiffness are: the restitution e depends on alpha alone (Antypov &
Elliott 2011, *EPL* 94, 50004, for n = 5/2).
"""

from __future__ import annotations

import math

from dem_bridge.physics.valid import above


def restitution(value: float) -> float:
    """Return ``value`` as a coefficient of restitution, a float above 0 and up to 1.

    Raises
    ------
    ValueError
        If ``value`` is not such a number.
    """
    if above(0.0, "restitution", value) > 1.0:
        raise ValueError(f"restitution = {value!r}; allowed: a number above 0 and up to 1")
    return float(value)


def alpha_of_restitution(e: float, exponent: float = 2.5) -> float:
    """Return the factor alpha of the damping force with which a contact that is not clipped has the restitution ``e``.

    ``alpha = -sqrt(2 n) ln e / sqrt(pi^2 + (ln e)^2)``, the exact inverse of ``e = exp(-pi alpha / sqrt(2 n -
    alpha^2))``; ``sqrt(2 n)`` is sqrt(5) for Hertz and 2 for a linear spring. LAMMPS: ``damping coeff_restitution``.

    Parameters
    ----------
    e : float
        Coefficient of restitution, above 0 and up to 1.
    exponent : float
        Exponent n of the contact, above 1.

    Returns
    -------
    float
        alpha, without unit.

    Raises
    ------
    ValueError
        If a parameter is outside its range.

    References
    ----------
    Antypov, D. & Elliott, J. A. 2011, *EPL* 94, 50004, eq. 16.

    Examples
    --------
    >>> round(alpha_of_restitution(0.5), 12), round(alpha_of_restitution(0.5, exponent=2.0), 12)
    (0.481769257765, 0.430907523932)
    """
    log = math.log(restitution(e))
    # 0.0 - x, so that e = 1 does not give -0.0
    return 0.0 - math.sqrt(2.0 * above(1.0, "exponent", exponent)) * log / math.hypot(math.pi, log)


def alpha_of_tsuji(e: float) -> float:
    """Return the factor alpha of the damping force by Marshall's polynomial of the restitution ``e``.

    The polynomial is a fit to the curve of Tsuji et al. for Hertz. Its prefactor is sqrt(2) for the effective mass of
    a pair. A contact with n = 5/2 that is not clipped has the restitution e to 1.1e-3 for e >= 0.1. LAMMPS: ``damping
    tsuji``, with the prefactor from 2026 on.

    Parameters
    ----------
    e : float
        Coefficient of restitution, above 0 and up to 1.

    Returns
    -------
    float
        alpha, without unit.

    Raises
    ------
    ValueError
        If ``e`` is outside its range.

    References
    ----------
    Tsuji, Y., Tanaka, T. & Ishida, T. 1992, *Powder Technol.* 71, 239, fig. 3. Marshall, J. S. 2009, *J. Comput.
    Phys.* 228, 1541, eq. 53.

    Examples
    --------
    >>> round(alpha_of_tsuji(0.5), 12)
    0.481880013126
    """
    alpha = 0.0
    for coefficient in (4.8218, -18.022, 27.467, -22.348, 11.087, -4.2783, 1.2728):
        alpha = alpha * restitution(e) + coefficient
    return math.sqrt(2.0) * alpha
