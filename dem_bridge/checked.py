"""Numbers that come from outside, checked: real, finite, of the right sign and a magnitude to be reckoned with."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dem_bridge.errors import SceneError

#: magnitudes between which products and powers of inputs stay within double precision
SMALLEST, LARGEST = 1e-40, 1e40


def checked_number(
    key: str, value: object, allowed: str, *, above: float | None = None, at_least: float | None = None
) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float | np.integer | np.floating):
        raise SceneError(key, found=value, allowed=allowed)
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    too_small = (above is not None and not number > above) or (at_least is not None and not number >= at_least)
    if not math.isfinite(number) or too_small:
        raise SceneError(key, found=number, allowed=allowed)
    # speeds and gaps may be next to nothing, as ahead of a wave front; masses and stiffnesses may not
    if abs(number) > LARGEST or (above is not None and number < SMALLEST):
        raise SceneError(key, found=number, allowed=f"{allowed} of magnitude {SMALLEST:g} to {LARGEST:g}")
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
    """Checked floats; a single number stands for ``count`` equal ones."""
    above = 0.0 if positive else above
    if isinstance(values, int | float | np.number):
        if count is None:
            raise SceneError(key, found=values, allowed=f"a list; each entry {allowed}")
        return (checked_number(key, values, allowed, above=above, at_least=at_least),) * count
    if np.ma.is_masked(values):
        raise SceneError(key, problem="has masked entries", allowed=f"a list; each entry {allowed}")
    if not isinstance(values, Sequence) and hasattr(values, "__array__"):  # a Series of pandas, too
        values = np.asarray(values)
        if values.ndim != 1:
            raise SceneError(key, problem=f"has the shape {values.shape}", allowed=f"a list; each entry {allowed}")
    if isinstance(values, str) or not isinstance(values, Sequence | np.ndarray):
        raise SceneError(key, found=values, allowed=f"a list; each entry {allowed}")
    if count is not None and len(values) != count:
        raise SceneError(key, problem=f"has {len(values)} entries", allowed=f"{count}, one per {per}")
    limits = {"above": above, "at_least": at_least}
    return tuple(checked_number(f"{key}[{i}]", value, allowed, **limits) for i, value in enumerate(values))
