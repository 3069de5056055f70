"""Numbers as words, in one style for all lines that a person reads."""

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


def number(value: float | None) -> str:
    """Return a number with two digits, or three where it has no more.

    Examples
    --------
    >>> number(1.2512e-6), number(1.25e-6), number(5e-6), number(None)
    ('1.3e-06', '1.25e-06', '5e-06', 'unknown')
    """
    if value is None or not math.isfinite(value):
        return "unknown"
    short = float(f"{value:.2e}")
    return f"{short:g}" if math.isclose(short, value, rel_tol=1e-9) else f"{value:.2g}"


def release(version: int) -> str:
    """Return a version number of LAMMPS as its release.

    Examples
    --------
    >>> release(20250722), release(0)
    ('22 Jul 2025', 'unknown')
    """
    if not version:
        return "unknown"
    months = ["Jan", "Feb", "Mar", "Apr", "May", "Jun", "Jul", "Aug", "Sep", "Oct", "Nov", "Dec"]
    return f"{version % 100} {months[version // 100 % 100 - 1]} {version // 10000}"
