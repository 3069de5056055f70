"""Sizes relative to a scale: of differences, errors and uncertainties, with one answer for a scale of zero."""

from __future__ import annotations

from typing import overload

import numpy as np
from numpy.typing import NDArray

#: no scale of a contact or body is smaller than this part of the largest in the chain
SMALLEST_SCALE = 1e-3


def own_scale(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the scale of each contact's or body's value: its magnitude, at least a thousandth of the largest.

    A contact or body with almost no force or motion is thus measured against the chain.

    >>> own_scale(np.array([-4.0, 1e-9, np.nan])).tolist()
    [4.0, 0.004, 0.004]
    """
    size = np.nan_to_num(np.abs(values))
    return np.asarray(np.maximum(size, SMALLEST_SCALE * float(np.max(size, initial=0.0))))


@overload
def relative_size(amount: float, scale: float) -> float: ...
@overload
def relative_size(amount: NDArray[np.float64], scale: NDArray[np.float64] | float) -> NDArray[np.float64]: ...
def relative_size(
    amount: NDArray[np.float64] | float, scale: NDArray[np.float64] | float
) -> NDArray[np.float64] | float:
    """Return amounts relative to a scale: 0 stays 0 and nan stays nan in any scale; without a scale the rest is inf.

    Where nothing moves, the scale is 0. An amount of 0 is agreement there as everywhere. Any other amount differs from
    what must be exactly 0: no tolerance permits it, so its relative size is inf. It is not 0, which would pass every
    check, and not nan, which is kept for values that do not exist and which checks leave out.

    Parameters
    ----------
    amount : float or array
        Differences, errors or uncertainties, with their sign, in the unit of the scale.
    scale : float or array
        Magnitude that the amounts are relative to, >= 0, of a shape that broadcasts with theirs. A scale that is nan
        is none.

    Returns
    -------
    float or array
        A float for two floats. An infinite amount remains infinite.

    Examples
    --------
    >>> relative_size(1e-6, 0.5), relative_size(0.0, 0.0), relative_size(1e-30, 0.0)
    (2e-06, 0.0, inf)
    >>> relative_size(np.array([-1.0, 0.0, np.nan, -np.inf]), np.array([0.0, 0.0, 2.0, np.inf])).tolist()
    [-inf, 0.0, nan, -inf]
    """
    size, of = np.asarray(amount, dtype=np.float64), np.asarray(scale, dtype=np.float64)
    with np.errstate(all="ignore"):
        ratio = size / of
        without = np.where(size == 0.0, 0.0, size * np.inf)
    ratio = np.where((of > 0.0) & np.isfinite(size), ratio, without)
    # an array without axes, as of an observable that is one number, remains one
    return ratio if isinstance(amount, np.ndarray) or isinstance(scale, np.ndarray) else float(ratio)
