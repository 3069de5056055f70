"""Relative errors as words, in one style for all lines that a person reads."""

from __future__ import annotations

import math


def share(value: float) -> str:
    """Return a relative number with two digits: in per cent from a thousandth on, as a power of ten below.

    Examples
    --------
    >>> share(0.0159), share(1e-3), share(5e-4), share(4.13e-5), share(0.0), share(7.0), share(float("nan"))
    ('1.6 %', '0.1 %', '5e-4', '4.1e-5', '0', 'more than 100 %', 'unknown')
    """
    if value > 1.0:
        return "more than 100 %"
    if not math.isfinite(value):
        return "unknown"
    if abs(value) >= 9.95e-4:
        return f"{float(f'{100.0 * value:.2g}'):g} %"
    digits, power = f"{value:.1e}".split("e")
    return f"{float(digits):g}e{int(power)}" if value else "0"
