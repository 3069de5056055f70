"""Numbers of an answer as words."""

from __future__ import annotations

import math


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
