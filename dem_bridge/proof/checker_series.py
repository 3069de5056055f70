"""Compiled power series of a motion, for the proposals of the checker: nothing rests on them.

A number is a row of whole digits, the least first: digit i counts ``2^(24 (i - places))``, and lies between -2^23 and
2^23. The last entry of a row is the number of digits up to the last one that is not 0.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dem_bridge.foundation.compiled import Bools, Floats, Ints, kernel

#: bits of a digit, half of what it counts to, digits above the point, and digits of sums below the last place
BITS, HALF, ABOVE, BELOW = 24, 1 << 23, 6, 2
Digits = NDArray[np.int32]
Bytes = NDArray[np.uint8]


class Equations(NamedTuple):
    """Equations of motion in a variable q, whose time is ``linear q + square q^2`` plus a constant.

    Overlaps of contact k count in units of ``2^(-24 shift[k])``. Body ``n_body`` is the wall.
    """

    left: Ints
    right: Ints
    twice: Ints
    """Twice the power of the force."""
    touching: Bools
    """Contacts with an overlap of 0 at q = 0: their root is that of overlap/q^2."""
    shift: Ints
    rate: Digits
    """Acceleration of both bodies by a force, ``(n_contact, 2, row)``."""
    gap: Digits
    root: Digits
    """Root of the first coefficient of the overlap."""
    inverse: Digits
    """One over twice this root."""
    steady: Digits
    """Constant acceleration of each body."""
    linear: Digits
    """``linear / (o + 1)``, the factor of the integral of order ``o``."""
    square: Digits
    """``2 square / (o + 1)``."""
    moved: Bools
    """Bodies at a contact."""


class Series(NamedTuple):
    """Coefficients: of displacements, velocities, accelerations ``(n_body + 1, order + 1, row)``, and of contacts.

    ``parts (n_felt, level, order + 1, row)`` holds the overlap, its root if the power is no whole number, and their
    products, of which the last is the force. ``digits (n_felt, level, 2, digit, order + 1)`` holds the same digits in
    the order of the coefficients and backwards, and ``last (n_felt, level, digit)`` the last coefficient with a digit
    that is not 0.
    """

    x: Digits
    v: Digits
    a: Digits
    parts: Digits
    digits: Digits
    last: Ints


@kernel()
def settle(total: Ints, row: Digits) -> None:
    """Set a number to a sum of products of digits, and the sum to 0."""
    count, carry, used = len(row) - 1, 0, 0
    for i in range(count + BELOW):
        value = total[i] + carry
        carry = (value + HALF) >> BITS
        if i >= BELOW:
            digit = value - (carry << BITS)
            row[i - BELOW] = digit
            if digit != 0:
                used = i - BELOW + 1
    row[count] = used
    total[:] = 0


@kernel()
def add(total: Ints, row: Digits, sign: int, shift: int) -> None:
    """Add a number, ``sign`` times and ``shift`` digits higher, to a sum."""
    for i in range(row[len(row) - 1]):
        total[i + shift + BELOW] += sign * row[i]


@kernel()
def add_product(total: Ints, a: Digits, b: Digits) -> None:
    """Add the product of two numbers to a sum."""
    skip, last = len(a) - 1 - ABOVE - BELOW, b[len(b) - 1]
    for i in range(a[len(a) - 1]):
        digit, first = np.int64(a[i]), max(0, skip - i)
        source, target = b[first:last], total[i + first - skip :]
        for j in range(len(source)):
            target[j] += digit * np.int64(source[j])


@kernel()
def rounded(row: Digits) -> float:
    """Return a number as a double."""
    value, count = 0.0, len(row) - 1
    for i in range(row[count]):
        value += row[i] * 2.0 ** (BITS * (i - count + ABOVE))
    return value


@kernel()
def _levels(twice: int) -> int:
    """Return the number of parts of a contact, of which the last is the force."""
    return twice // 2 + (2 if twice % 2 == 1 else 0)


@kernel()
def _add_products(total: Ints, s: Series, i: int, level: int, other: int, o: int, begin: int, end: int) -> None:
    """Add the products of coefficients ``t`` and ``o - t`` of two parts of a contact to a sum, t from begin to end."""
    a, b, a_last, b_last = s.digits[i, level, 0], s.digits[i, other, 1], s.last[i, level], s.last[i, other]
    count, order = len(a), a.shape[1] - 1
    skip = count - ABOVE - BELOW
    for m in range(count):
        last = min(end, a_last[m])
        for n in range(max(0, skip - m), count):
            first = max(begin, o - b_last[n])
            if first <= last:
                x, y = a[m, first : last + 1], b[n, order - o + first : order - o + last + 1]
                value = np.int64(0)
                for t in range(len(x)):
                    value += np.int64(x[t]) * np.int64(y[t])
                total[m + n - skip] += value


@kernel()
def _keep(total: Ints, s: Series, i: int, level: int, o: int) -> None:
    """Set a coefficient of a part of a contact to a sum, and the sum to 0."""
    row, order = s.parts[i, level, o], s.parts.shape[2] - 1
    settle(total, row)
    for m in range(row[len(row) - 1]):
        s.digits[i, level, 0, m, o] = s.digits[i, level, 1, m, order - o] = row[m]
        s.last[i, level, m] = o


@kernel()
def _extend_contact(e: Equations, s: Series, i: int, k: int, o: int, total: Ints, spare: Digits) -> None:
    """Set the coefficients of order ``o`` of the root of an overlap and of the products, from those of the overlap."""
    odd, parts = e.twice[k] % 2, s.parts[i]
    if odd == 1 and o == 0:
        add(total, e.root[k], 1, 0)
        _keep(total, s, i, 1, o)
    elif odd == 1:
        _add_products(total, s, i, 1, 1, o, 1, (o - 1) // 2)
        for t in range(len(total)):
            total[t] *= 2
        if o % 2 == 0:
            add_product(total, parts[1, o // 2], parts[1, o // 2])
        settle(total, spare)
        add(total, parts[0, o], 1, 0)
        add(total, spare, -1, 0)
        settle(total, spare)
        add_product(total, spare, e.inverse[k])
        _keep(total, s, i, 1, o)
    for level in range(1 + odd, _levels(e.twice[k])):
        _add_products(total, s, i, 0, level - 1, o, 0, o)
        _keep(total, s, i, level, o)


@kernel()
def set_overlap(e: Equations, s: Series, k: int, o: int, total: Ints, row: Digits) -> None:
    """Set a number to the coefficient of order ``o`` of the overlap of a contact, in its unit."""
    add(total, s.x[e.left[k], o], 1, e.shift[k])
    add(total, s.x[e.right[k], o], -1, e.shift[k])
    if o == 0:
        add(total, e.gap[k], -1, e.shift[k])
    settle(total, row)


@kernel()
def expand(e: Equations, s: Series, felt: Ints, sums: Ints) -> None:
    """Set all coefficients from the first of displacements and velocities; ``felt``: contacts that have a force."""
    bodies, order = len(e.steady), s.x.shape[1] - 1
    sums[:] = 0
    total, spare = sums[bodies + 1], np.zeros_like(e.linear[0])
    for o in range(order + 1):
        for i, k in enumerate(felt):
            at = o - 2 if e.touching[k] else o
            if at >= 0:
                set_overlap(e, s, k, o, total, spare)
                add(total, spare, 1, 0)
                _keep(total, s, i, 0, at)
                _extend_contact(e, s, i, k, at, total, spare)
            at = o - e.twice[k] if e.touching[k] else o
            if at >= 0:
                force = s.parts[i, _levels(e.twice[k]) - 1, at]
                add_product(sums[e.left[k]], force, e.rate[k, 0])
                add_product(sums[e.right[k]], force, e.rate[k, 1])
        if o == order:
            break
        for body in range(bodies):
            if o == 0:
                add(sums[body], e.steady[body], 1, 0)
            elif o > 3 and not e.moved[body]:
                continue
            settle(sums[body], s.a[body, o])
            for target, rates in ((s.v[body], s.a[body]), (s.x[body], s.v[body])):
                add_product(total, rates[o], e.linear[o])
                if o > 0:
                    add_product(total, rates[o - 1], e.square[o])
                settle(total, target[o + 1])
        sums[bodies] = 0


@kernel()
def read_overlaps(e: Equations, s: Series, contacts: Ints, total: Ints, overlaps: Floats) -> None:
    """Write the coefficients of overlaps (m) as doubles, ``(len(contacts), order + 1)``."""
    row = np.zeros_like(e.linear[0])
    for i, k in enumerate(contacts):
        for o in range(s.x.shape[1]):
            set_overlap(e, s, k, o, total, row)
            overlaps[i, o] = rounded(row) * 2.0 ** (-BITS * e.shift[k])


@kernel()
def add_up(series: Digits, total: Ints, rows: Digits) -> None:
    """Set numbers to the values of series at q = 1."""
    for i in range(len(rows)):
        for o in range(series.shape[1]):
            add(total, series[i, o], 1, 0)
        settle(total, rows[i])


@kernel()
def shorten(series: Digits, factor: Digits, weight: Digits, total: Ints, target: Bytes) -> None:
    """Write series in q times a factor, all times a weight, as whole numbers of bytes, the least first."""
    spare, row = weight.copy(), np.zeros_like(weight)
    for o in range(len(series)):
        add_product(total, series[o], spare)
        settle(total, row)
        carry = 0
        for i in range(len(row) - 1):
            value = row[i] + carry
            carry = value >> BITS
            for part in range(3):
                target[o, 3 * i + part] = (value >> (8 * part)) & 255
        add_product(total, spare, factor)
        settle(total, spare)


@kernel()
def place(numbers: Bytes, rows: Digits) -> None:
    """Set numbers to whole numbers of bytes with a sign, the least first."""
    count = rows.shape[1] - 1
    total = np.zeros(count + BELOW, dtype=np.int64)
    for i in range(len(rows)):
        for j in range(count):
            digit = np.int64(0)
            for part in range(3):
                digit |= np.int64(numbers[i, 3 * j + part]) << (8 * part)
            total[j + BELOW] = digit
        settle(total, rows[i])
