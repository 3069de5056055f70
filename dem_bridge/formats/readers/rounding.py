"""Estimate the rounding error of numbers from the digits with which they were written, and restore rounded times.

A file with the digits of ``%.6f`` rounds to a fixed place, one with those of ``%.6g`` to a number of significant
digits. Which of the two it is follows from all numbers of a quantity, because formats such as ``%g`` drop zeros at the
end of a number.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dem_bridge.errors import UsageError
from dem_bridge.trajectory.trajectory import Floats

#: a decimal number with this many significant digits distinguishes all doubles
_DOUBLE_DIGITS = 17
#: number of values that are examined for the number of their digits
_SAMPLES = 5000
#: most characters of a number, and of all numbers of an array if each has as many as the longest
_LONGEST, _MOST_CHARACTERS = 400, 2**31
#: fewest step numbers that show that times are exact, and their relative difference from the times
_COUNTED, _SAME_TIME = 3, 1e-12
#: fewest different values from which single precision is recognised
_FEWEST_SINGLES = 20


def texts_of(words: Sequence[Any]) -> NDArray[np.bytes_]:
    """Return words of numbers, or rows of words, as an array.

    Raise UsageError if a long word would make the array too large, or for signs beyond ASCII, such as Arabic digits.
    """
    rows = words if words and isinstance(words[0], list | tuple) else [words]
    check_texts(sum(map(len, rows)), max((max(map(len, row), default=0) for row in rows), default=0))
    try:
        return np.array(words, dtype=np.bytes_)
    except UnicodeEncodeError as error:
        raise UsageError("a number has signs beyond ASCII; allowed: the digits 0 to 9; correct the file") from error


def check_texts(count: int, longest: int) -> None:
    """Raise UsageError if numbers have too many characters; each takes the memory of the longest."""
    if longest > _LONGEST or count * longest > _MOST_CHARACTERS:
        raise UsageError(
            f"the file has {count} numbers of up to {longest} characters; allowed: up to {_LONGEST} characters, and"
            f" {_MOST_CHARACTERS >> 20} MiB if all are as long; write fewer digits"
        )


def numbers(values: NDArray[Any]) -> tuple[Floats, Floats]:
    """Return the numbers of an array of numbers or texts, and their largest rounding errors.

    A missing value (an empty text) is nan, and its rounding error, too. That of a written nan is 0.
    """
    if values.dtype.kind != "S":
        array = np.asarray(values, dtype=np.float64)
        return array, np.where(np.isfinite(array), rounding_of_values(values), 0.0)
    missing = values == b""
    texts = np.where(missing, b"nan", values) if np.any(missing) else values
    try:
        array = texts.astype(np.float64)
    except ValueError:  # the exponents of Fortran, 1.0D-03
        array = np.array([_number(text) for text in texts.ravel().tolist()]).reshape(texts.shape)
    rounding = np.where(np.isfinite(array), rounding_of_texts(texts, array), 0.0)
    return array, np.where(missing, math.nan, rounding)


def _number(text: bytes) -> float:
    """Return the number of a text, which may have an exponent of Fortran; raise UsageError if it is none."""
    try:
        return float(text.upper().replace(b"D", b"E"))
    except ValueError as error:
        raise UsageError(
            f"{text[:40].decode('latin-1')!r} is not a number; allowed: numbers; correct the file"
        ) from error


def rounding_of_texts(texts: NDArray[np.bytes_], values: Floats) -> Floats:
    """Return the largest rounding error of each number by the digits of its text."""
    flat, examined = np.ravel(texts), np.ravel(values)
    counted = np.flatnonzero(np.isfinite(examined) & (examined != 0.0))
    if len(counted) == 0:
        counted = np.arange(min(1, len(examined)))
    if len(counted) > _SAMPLES:
        counted = np.random.default_rng(0).choice(counted, _SAMPLES, replace=False)
    chars = np.ascontiguousarray(flat[counted]).view(np.uint8).reshape(len(counted), flat.dtype.itemsize)
    exponent = np.logical_or.accumulate(((chars | 32) == ord("e")) | ((chars | 32) == ord("d")), axis=1)
    digit = (chars >= ord("0")) & (chars <= ord("9")) & ~exponent
    significant = np.sum(digit & np.logical_or.accumulate(digit & (chars != ord("0")), axis=1), axis=1)
    decimals = np.sum(digit & np.logical_or.accumulate(chars == ord("."), axis=1), axis=1)
    return _rounding(significant, int(np.max(decimals, initial=0)), _DOUBLE_DIGITS, examined[counted], values)


def scaled(values: Floats, rounding: Floats, unit: float) -> tuple[Floats, Floats]:
    """Return numbers times a unit, and their rounding errors with that of the product."""
    if unit == 1.0:
        return values, rounding
    product = values * unit
    return product, rounding * unit + 0.5 * np.spacing(np.abs(product))


def rounding_of_values(values: NDArray[Any]) -> Floats:
    """Return the largest rounding error of each number of an array by its type and its digits."""
    if values.dtype == np.float32:
        return _half_spacing(values, np.float32)
    array = np.asarray(values, dtype=np.float64)
    flat = array[np.isfinite(array) & (array != 0.0)]
    if len(flat) > _SAMPLES:
        flat = np.random.default_rng(0).choice(flat, _SAMPLES)
    texts = [np.format_float_scientific(value, trim="-").partition("e")[0] for value in flat.tolist()]
    significant = np.array([len(text.replace(".", "").lstrip("-")) for text in texts], dtype=np.int64)
    # of the shortest texts of doubles, half have 16 digits
    return _rounding(significant, 0, _DOUBLE_DIGITS - 1, flat, array)


def rounding_error(values: ArrayLike, unit: float = 1.0) -> float | None:
    """Return the largest rounding error of numbers that were written with few digits; None if they have all digits.

    ``unit`` is the unit of the numbers. Of many numbers a random choice is examined.

    >>> [rounding_error(numbers) for numbers in ([0.018, 0.03600012], [0.1 / 3.0, 2.0 / 3.0], [1.25e-13, 3.25e4])]
    [5e-09, None, 50.0]
    """
    array = np.ravel(np.asarray(values, dtype=np.float64))
    array = array[np.isfinite(array)]
    if not np.any(array):
        return None
    rounding = rounding_of_values(array)
    return None if np.all(rounding <= _half_spacing(array, np.float64)) else float(np.max(rounding)) * unit


def _half_spacing(values: NDArray[Any], kind: type[np.floating[Any]]) -> Floats:
    """Return half the distance of neighbouring numbers of a type, and 0 for 0."""
    half = 0.5 * np.abs(np.spacing(np.asarray(values, dtype=kind)).astype(np.float64))
    return np.where(np.asarray(values) == 0.0, 0.0, half)


def _rounding(
    significant: NDArray[np.int64], decimals: int, all_digits: int, examined: Floats, values: Floats
) -> Floats:
    """Return the rounding error of ``values`` from the significant digits of the ``examined`` numbers among them.

    ``decimals`` is the number of decimals, which counts only if all numbers are 0; numbers with ``all_digits`` are
    rounded to doubles only.
    """
    least = _half_spacing(values, np.float64)
    counted = np.isfinite(examined) & (examined != 0.0)
    if not np.any(counted):
        return np.full(values.shape, 0.5 * 10.0**-decimals if decimals else 0.0)
    significant, examined = significant[counted], examined[counted]
    place = _magnitude(examined) - significant + 1
    most, last = int(np.max(significant)), int(np.min(place))
    of_place, of_digits = np.mean(place == last), np.mean(significant == most)
    fixed = of_place == 1.0 or (of_digits < 1.0 and of_place >= of_digits)
    if most >= all_digits and not fixed:
        rounding = least
    elif fixed:
        rounding = np.maximum(least, float(f"5e{last - 1}"))
    else:
        rounding = np.zeros(values.shape)
        nonzero = np.isfinite(values) & (values != 0.0)
        tens = _magnitude(values[nonzero]) - most
        table = {power: float(f"5e{power}") for power in np.unique(tens).tolist()}
        rounding[nonzero] = [table[power] for power in tens.tolist()]
        rounding = np.maximum(least, rounding)
    return np.maximum(rounding, _of_singles(examined, rounding, values))


def _of_singles(examined: Floats, rounding: Floats, values: Floats) -> Floats:
    """Return the rounding error of single precision if all numbers are single-precision numbers, else 0."""
    with np.errstate(over="ignore", under="ignore", invalid="ignore"):
        off = np.abs(values - values.astype(np.float32))
        half = _half_spacing(values, np.float32)
    finite = np.isfinite(values)
    fine = np.all(off[finite] <= rounding[finite]) and np.sum(rounding[finite] < 0.1 * half[finite]) >= _FEWEST_SINGLES
    return half if fine and len(np.unique(examined)) >= _FEWEST_SINGLES else np.zeros(values.shape)


def _magnitude(values: Floats) -> NDArray[np.int64]:
    """Return the power of ten of the first digit of numbers other than 0."""
    # increased a little, because the logarithm of a power of ten may be too small in its last digit
    return np.floor(np.log10(np.abs(values)) + 1e-14).astype(np.int64)


def restored_times(
    time: Floats, rounding: Floats, duration: float, samples: int, dt: float | None
) -> tuple[Floats, Floats, str | None]:
    """Return times with few digits as multiples of one interval, their rounding errors, and a sentence about it.

    Times are restored only if all are multiples of one interval within their rounding errors, counted from 0 or from
    the first time. An interval by which ``duration`` is divided into ``samples`` or another number of parts is tried
    first, then a multiple of the time step ``dt``, then the number with the fewest digits. Without a restored interval
    the times are returned as they are, with None.
    """
    count = len(time)
    if count < 3 or np.any(np.diff(time) <= 0.0) or np.max(rounding) <= 4.0 * np.spacing(time[-1]):
        return time, rounding, None
    mean = float(time[-1] - time[0]) / (count - 1)
    first = round(float(time[0]) / mean)
    starts = [(0.0, 0.0, first)] if first >= 0 else []
    starts += [(float(time[0]), float(rounding[0]), 0)] if time[0] != 0.0 else []  # a run that begins at 0 does so
    for start, slack_of_start, begin in starts:
        order = np.arange(begin, begin + count, dtype=np.float64)
        counted = order > 0
        slack = rounding[counted] + slack_of_start + 4.0 * np.spacing(time[counted])
        low = float(np.max((time[counted] - start - slack) / order[counted]))
        high = float(np.min((time[counted] - start + slack) / order[counted]))
        at_zero = begin > 0 or abs(time[0] - start) <= rounding[0]
        if 0.0 < low <= high and at_zero:
            interval, slack_of_interval = _interval(low, high, duration, samples, dt)
            restored = start + order * interval
            left = slack_of_start + slack_of_interval * order + 0.5 * np.spacing(restored)
            after = f" after {start:.9g} s" if start else ""
            said = f"times have few digits and are multiples of {interval:.9g} s{after}; they are restored to these"
            return restored, np.minimum(left, rounding + np.abs(restored - time)), said
    return time, rounding, None


def _interval(low: float, high: float, duration: float, samples: int, dt: float | None) -> tuple[float, float]:
    """Return the interval between two bounds that is the most probable, and its largest error."""
    middle = 0.5 * (low + high)
    parts = max(1, round(duration / middle))
    candidates = [duration / samples, duration / parts if (high - low) * parts < 0.2 * middle else math.nan]
    candidates += [dt * round(middle / dt) if dt and high - low < dt else math.nan]
    fitting = [each for each in candidates if low <= each <= high] or [_roundest(low, high)]
    if not math.isfinite(fitting[0]):
        return middle, 0.5 * (high - low)
    # several intervals fit where times have very few digits
    return fitting[0], max(abs(each - fitting[0]) for each in fitting)


def _roundest(low: float, high: float) -> float:
    """Return the number with the fewest digits between two numbers; nan unless it is clearly the only such number."""
    for digits in range(1, 10):
        candidate = float(f"{0.5 * (low + high):.{digits - 1}e}")
        if low <= candidate <= high:
            place = 10.0 ** (math.floor(math.log10(candidate)) - digits + 1)
            return candidate if high - low <= 0.1 * place else math.nan
    return math.nan


def counted_times(
    time: Floats, rounding: Floats, step: Floats | None, dt: float | None, notes: list[str]
) -> tuple[Floats, Floats]:
    """Return times that are whole numbers of time steps with the rounding error of that product.

    Times such as 1e-05 and 2e-05 have one digit because they are round, which their step numbers show.
    """
    if step is None or dt is None or step.shape != time.shape or len(np.unique(step)) < _COUNTED:
        return time, rounding
    exact = step * dt
    within = _SAME_TIME * np.abs(exact)
    if np.all(rounding <= within) or np.any(np.abs(time - exact) > within):
        return time, rounding
    notes.append(f"times are step numbers times the time step of {dt:.9g} s, although they have few digits")
    return exact, np.minimum(rounding, within)


def step_of(time: Floats, rounding: Floats, step: Floats | None, notes: list[str]) -> float | None:
    """Return the time step that follows from times and step numbers; None if the numbers may be those of frames."""
    if step is None or len(step) < 2 or np.any(np.diff(step) < 1.0) or np.all(np.diff(step) == 1.0):
        return None
    dt = float((time[-1] - time[0]) / (step[-1] - step[0]))
    if not dt > 0.0 or np.any(np.abs(time - dt * step) > 2.0 * rounding + 1e-9 * time[-1]):
        return None
    dt = float(f"{dt:.9g}")
    notes.append(f"the time step is {dt:.9g} s by the times and step numbers of the file")
    return dt
