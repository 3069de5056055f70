"""Checks of the numbers that are passed to formulas, made before anything is computed."""

from __future__ import annotations

import math


def number(name: str, value: object, unit: str = "") -> float:
    """Return ``value`` as a finite float.

    Parameters
    ----------
    name : str
        Name of the quantity in the error message.
    value : object
        The value to check.
    unit : str
        Unit in the error message.

    Raises
    ------
    ValueError
        If ``value`` is not a finite number.

    Examples
    --------
    >>> number("velocity", -3, "m/s")
    -3.0
    """
    if isinstance(value, bool) or not hasattr(value, "__float__") or not math.isfinite(float(value)):
        raise ValueError(f"{name} = {value!r}; allowed: a finite number{_of(unit)}")
    return float(value)


def above(limit: float, name: str, value: object, unit: str = "", *, infinite: str = "", why: str = "") -> float:
    """Return ``value`` as a float larger than ``limit``.

    Parameters
    ----------
    limit : float
        Lower bound; it is not allowed itself.
    name, unit : str
        Name and unit of the quantity in the error message.
    value : object
        The value to check.
    infinite : str
        Meaning of an infinite value, such as "a wall"; empty where infinity is not allowed.
    why : str
        Reason that is added to the error message.

    Raises
    ------
    ValueError
        If ``value`` is not a number in the allowed range.

    Examples
    --------
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


def not_negative(name: str, value: float, unit: str) -> float:
    """Return ``value`` as a finite float >= 0.

    Raises
    ------
    ValueError
        If ``value`` is not such a number; ``name`` and ``unit`` are for the message.
    """
    if number(name, value, unit) < 0.0:
        raise ValueError(f"{name} = {value!r}; allowed: a number >= 0 ({unit})")
    return float(value)


def poisson_ratio(name: str, value: float) -> float:
    """Return ``value`` as a float above -1 and up to 0.5.

    Raises
    ------
    ValueError
        If ``value`` is not such a number; ``name`` is for the message.
    """
    if not -1.0 < number(name, value) <= 0.5:
        raise ValueError(f"{name} = {value!r}; allowed: a number above -1 and up to 0.5")
    return float(value)


def _of(unit: str) -> str:
    """Return the unit in parentheses, or an empty string."""
    return f" ({unit})" if unit else ""
