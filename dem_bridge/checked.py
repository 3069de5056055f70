"""Checks of numbers from outside: real, finite, of the right sign and of a magnitude within double precision."""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dem_bridge.errors import SceneError

#: magnitudes between which products and powers of inputs stay within double precision
SMALLEST, LARGEST = 1e-40, 1e40


def checked_number(
    key: str, value: object, allowed: str, *, above: float | None = None, at_least: float | None = None
) -> float:
    """Return ``value`` as a float.

    Parameters
    ----------
    key : str
        Entry of the scene, for the error message.
    value : object
        The value to check.
    allowed : str
        Description of the allowed values, for the error message.
    above, at_least : float, optional
        Lower bound, exclusive or inclusive.

    Raises
    ------
    SceneError
        If the value is not a number in the allowed range.
    """
    if isinstance(value, bool) or not isinstance(value, int | float | np.integer | np.floating):
        raise SceneError(key, value=value, allowed=allowed)
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    too_small = (above is not None and not number > above) or (at_least is not None and not number >= at_least)
    if not math.isfinite(number) or too_small:
        raise SceneError(key, value=number, allowed=allowed)
    # speeds and gaps may be tiny, as they are ahead of a wave front; masses and stiffnesses may not
    if abs(number) > LARGEST or (above is not None and number < SMALLEST):
        raise SceneError(key, value=number, allowed=f"{allowed} of magnitude {SMALLEST:g} to {LARGEST:g}")
    return number


def checked_numbers(
    key: str,
    values: Sequence[float] | NDArray[np.float64] | float,
    allowed: str,
    *,
    count: int | None = None,
    per: str = "",
    positive: bool = False,
    above: float | None = None,
    at_least: float | None = None,
) -> tuple[float, ...]:
    """Return ``values`` as a tuple of floats; a single number stands for ``count`` equal ones.

    Parameters
    ----------
    key : str
        Entry of the scene, for the error message.
    values : sequence of float, array or float
        The values to check.
    allowed : str
        Description of the allowed values, for the error message.
    count : int, optional
        Number of values that is required.
    per : str
        Object that each value belongs to, for the error message.
    positive : bool
        True if each value must be > 0.
    above, at_least : float, optional
        Lower bound of each value, exclusive or inclusive.

    Raises
    ------
    SceneError
        If a value is outside its range or their number is wrong.
    """
    above = 0.0 if positive else above
    if isinstance(values, int | float | np.number):
        if count is None:
            raise SceneError(key, value=values, allowed=f"a list; each entry {allowed}")
        return (checked_number(key, values, allowed, above=above, at_least=at_least),) * count
    # an array can be masked only where numpy.ma is imported, which takes 0.04 s
    if "numpy.ma" in sys.modules and np.ma.is_masked(values):
        raise SceneError(key, problem="has masked entries", allowed=f"a list; each entry {allowed}")
    if not isinstance(values, Sequence) and hasattr(values, "__array__"):  # arrays and pandas Series
        values = np.asarray(values)
        if values.ndim != 1:
            raise SceneError(key, problem=f"has the shape {values.shape}", allowed=f"a list; each entry {allowed}")
    if isinstance(values, str) or not isinstance(values, Sequence | np.ndarray):
        raise SceneError(key, value=values, allowed=f"a list; each entry {allowed}")
    if count is not None and len(values) != count:
        raise SceneError(key, problem=f"has {len(values)} entries", allowed=f"{count}, one per {per}")
    limits = {"above": above, "at_least": at_least}
    return tuple(checked_number(f"{key}[{i}]", value, allowed, **limits) for i, value in enumerate(values))
