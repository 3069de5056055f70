"""What the formulas may be asked: numbers checked in one line each, before anything is computed."""

from __future__ import annotations

import math


def number(name: str, value: object, unit: str = "") -> float:
    """``value`` as a finite float; ValueError, in one line, where it is none.

    >>> number("velocity", -3, "m/s")
    -3.0
    """
    if isinstance(value, bool) or not hasattr(value, "__float__") or not math.isfinite(float(value)):
        raise ValueError(f"{name} = {value!r}; allowed: a finite number{_of(unit)}")
    return float(value)


def above(limit: float, name: str, value: object, unit: str = "", *, infinite: str = "", why: str = "") -> float:
    """``value`` as a float > ``limit``; ``infinite`` says what inf stands for, where that is allowed.

    >>> above(0.0, "mass", 8.1e-3, "kg"), above(0.0, "mass", math.inf, "kg", infinite="a wall")
    (0.0081, inf)
    >>> above(0.0, "mass", -1.0, "kg")
    Traceback (most recent call last):
    ValueError: mass = -1.0; allowed: a finite number > 0 (kg)
    """
    if infinite and value == math.inf:
        return math.inf
    if isinstance(value, bool) or not hasattr(value, "__float__") or not limit < float(value) < math.inf:
        inf = f", or inf for {infinite}" if infinite else ""
        raise ValueError(
            f"{name} = {value!r}; allowed: a finite number > {limit:g}{_of(unit)}{inf}{'; ' * bool(why)}{why}"
        )
    return float(value)


def _of(unit: str) -> str:
    return f" ({unit})" if unit else ""
