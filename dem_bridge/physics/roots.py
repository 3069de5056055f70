"""Find a root of a function by Brent's method, with the digits of scipy and without its import.

The import of ``scipy.optimize`` takes 0.2 s, which is longer than all else of reading a scene file.
"""

from __future__ import annotations

import math
from collections.abc import Callable

#: least relative tolerance, the default of scipy
LEAST_RELATIVE_TOLERANCE = 2.0**-50
#: iterations after which a search is given up
MOST_ITERATIONS = 100


def root_between(
    function: Callable[[float], float], low: float, high: float, *, xtol: float, rtol: float = LEAST_RELATIVE_TOLERANCE
) -> float:
    """Return a root of a continuous function between two arguments at which its signs differ.

    The method combines bisection with inverse interpolation; its operations and their order are those of
    ``scipy.optimize.brentq``, so that the roots are equal to the last bit.

    Parameters
    ----------
    function : callable
        Function of one number.
    low, high : float
        Arguments between which the function changes its sign.
    xtol, rtol : float
        Absolute and relative tolerance of the root.

    Raises
    ------
    ValueError
        If the function has one sign at both arguments, or if the method does not converge.

    References
    ----------
    Brent (1973), *Algorithms for Minimization Without Derivatives*, ch. 4.

    Examples
    --------
    >>> root_between(lambda x: x * x - 2.0, 0.0, 2.0, xtol=1e-15)
    1.414213562373095
    """
    before, now, behind = low, high, 0.0
    f_before, f_now, f_behind = float(function(low)), float(function(high)), 0.0
    step_before = step = 0.0
    if f_before == 0.0:
        return before
    if f_now == 0.0:
        return now
    if (f_before < 0.0) == (f_now < 0.0):
        raise ValueError(f"the function is {f_before:.6g} at {low:.6g} and {f_now:.6g} at {high:.6g}, of one sign")
    for _ in range(MOST_ITERATIONS):
        if f_before != 0.0 and f_now != 0.0 and (f_before < 0.0) != (f_now < 0.0):
            behind, f_behind = before, f_before
            step_before = step = now - before
        if abs(f_behind) < abs(f_now):
            before, now, behind = now, behind, now
            f_before, f_now, f_behind = f_now, f_behind, f_now
        least, half = (xtol + rtol * abs(now)) / 2.0, (behind - now) / 2.0
        if f_now == 0.0 or abs(half) < least:
            return now
        trial = math.inf
        if abs(step_before) > least and abs(f_now) < abs(f_before):
            trial = _interpolated((before, f_before), (now, f_now), (behind, f_behind))
        good = 2.0 * abs(trial) < min(abs(step_before), 3.0 * abs(half) - least)
        step_before, step = (step, trial) if good else (half, half)
        before, f_before = now, f_now
        now += step if abs(step) > least else math.copysign(least, half)
        f_now = float(function(now))
    raise ValueError(f"no root between {low:.6g} and {high:.6g} after {MOST_ITERATIONS} iterations, at {now:.6g}")


def _interpolated(before: tuple[float, float], now: tuple[float, float], behind: tuple[float, float]) -> float:
    """Return the step from ``now`` to the root by three points (argument, value); inf where it is not determined."""
    (x_before, f_before), (x, f), (x_behind, f_behind) = before, now, behind
    if x_before == x_behind:
        return -f * (x - x_before) / (f - f_before)
    slope, slope_behind = (f_before - f) / (x_before - x), (f_behind - f) / (x_behind - x)
    divisor = slope_behind * slope * (f_behind - f_before)
    return -f * (f_behind * slope_behind - f_before * slope) / divisor if divisor else math.inf
