"""Expand the motion of a chain in power series, for the proposals of the checker: nothing rests on them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from dem_bridge.foundation.compiled import Floats, Ints
from dem_bridge.proof.checker_series import (
    ABOVE,
    BITS,
    Digits,
    Equations,
    Series,
    add_up,
    expand,
    place,
    read_overlaps,
    set_overlap,
    shorten,
)


class Expansion(NamedTuple):
    """Power series of a motion and what they are made of."""

    e: Equations
    s: Series
    total: Ints
    felt: tuple[int, ...]

    def overlaps(self, contacts: list[int]) -> Floats:
        """Return the coefficients of overlaps as doubles, m, ``(len(contacts), order + 1)``."""
        out = np.zeros((len(contacts), self.s.x.shape[1]))
        read_overlaps(self.e, self.s, np.array(contacts, dtype=np.int64), self.total, out)
        return out

    def exact_overlap(self, k: int) -> list[int]:
        """Return the coefficients of the overlap of a contact without a force, as multiples of the last place."""
        row, out = np.zeros_like(self.e.gap[k]), []
        for o in range(self.s.x.shape[1]):
            set_overlap(self.e, self.s, k, o, self.total, row)
            out.append(whole(row))
        return out

    def motion(self) -> tuple[list[Digits], list[Digits]]:
        """Return the coefficients of the displacement and of the velocity of each body that are not all 0."""
        few = [None if moved else 5 for moved in self.e.moved[:-1]]
        x, v = ([part[body, :count] for body, count in enumerate(few)] for part in (self.s.x, self.s.v))
        return x, v

    def roots(self) -> Iterator[tuple[int, Digits, int]]:
        """Yield contacts that have a root, its coefficients, and the bits of the unit in which it counts."""
        for i, k in enumerate(self.felt):
            if self.e.twice[k] % 2:
                count = self.s.x.shape[1] - 2 * int(self.e.touching[k])
                yield k, self.s.parts[i, 1, :count], int(self.e.shift[k]) * BITS // 2

    def at_end(self) -> list[list[int]]:
        """Return displacements and velocities at q = 1."""
        out = []
        for series in (self.s.x, self.s.v):
            rows = np.zeros_like(self.e.steady)
            add_up(series, self.total, rows)
            out.append([whole(row) for row in rows])
        return out

    def scaled(self, series: Digits, factor: int, weight: int) -> list[int]:
        """Return a series in q times ``factor``, all times ``weight``."""
        factor_row, weight_row = digits([factor, weight], series.shape[1])
        target = np.zeros((len(series), 3 * (series.shape[1] - 1)), dtype=np.uint8)
        shorten(series, factor_row, weight_row, self.total, target)
        text, width = target.tobytes(), target.shape[1]
        return [int.from_bytes(text[i : i + width], "little", signed=True) for i in range(0, len(text), width)]


def digits(numbers: Sequence[int], length: int) -> Digits:
    """Return multiples of the last place as rows of a length."""
    width = 3 * (length - 1)
    text = b"".join(number.to_bytes(width, "little", signed=True) for number in numbers)
    rows = np.zeros((len(numbers), length), dtype=np.int32)
    place(np.frombuffer(text, dtype=np.uint8).reshape(len(numbers), width), rows)
    return rows


def whole(row: Digits) -> int:
    """Return a number as a multiple of its last place."""
    return sum(int(digit) << BITS * i for i, digit in enumerate(row[:-1]))


class Expander:
    """Make series of the motion of a chain from numbers that are multiples of 2^(-24 places).

    ``ends``: bodies of each contact, with ``len(steady)`` for a wall. ``rates``: accelerations of both by a force.
    """

    def __init__(
        self, ends: list[list[int]], twice: list[int], rates: list[list[int]], gaps: list[int],
        steady: list[int], places: int,
    ) -> None:  # fmt: skip
        self.places, self.length, self.ends, self.twice, self.rates = places, places + ABOVE + 1, ends, twice, rates
        self.left, self.right = (np.array([pair[i] for pair in ends], dtype=np.int64) for i in (0, 1))
        self.gap, self.steady = digits(gaps, self.length), digits(steady, self.length)
        self.total = np.zeros((len(steady) + 2, 2 * self.length + 2), dtype=np.int64)

    def expand(
        self, x: Sequence[int], v: Sequence[int], times: tuple[int, int], firsts: dict[int, int], touching: set[int],
        order: int,
    ) -> Expansion:  # fmt: skip
        """Return the series of a motion.

        Parameters
        ----------
        x, v : sequence of int
            Displacements and velocities at q = 0.
        times : tuple of int
            ``linear`` and ``square``.
        firsts : dict
            For each contact with a force, its overlap at q = 0, or overlap/q^2 if it is in ``touching``.
        touching : set of int
            Contacts that touch at q = 0.
        order : int
            Order of the series.
        """
        n, k, bits = len(x), len(self.ends), BITS * self.places
        shift, numbers = np.zeros(k, dtype=np.int64), np.zeros((k, 4, self.length), dtype=np.int32)
        for contact, first in firsts.items():
            shift[contact] = unit = max(0, self.places - -(-first.bit_length() // BITS))
            root = math.isqrt(first << (BITS * unit + bits))
            rates = (rate >> unit * self.twice[contact] * BITS // 2 for rate in self.rates[contact])
            numbers[contact] = digits([*rates, root, (1 << (2 * bits - 1)) // max(root, 1)], self.length)
        felt = tuple(sorted(firsts))
        moved = np.zeros(n + 1, dtype=bool)
        moved[[body for contact in felt for body in self.ends[contact]]] = True
        linear, square = (digits([t // o for o in range(1, order + 1)], self.length) for t in (times[0], 2 * times[1]))
        e = Equations(
            self.left, self.right, np.array(self.twice, dtype=np.int64), np.isin(np.arange(k), list(touching)), shift,
            numbers[:, :2], self.gap, numbers[:, 2], numbers[:, 3], self.steady, linear, square, moved,
        )  # fmt: skip
        parts, count = (len(felt), max((t // 2 + 2 for t in self.twice), default=1)), order + 1
        shapes = 3 * [(n + 1, count, self.length)] + [(*parts, count, self.length), (*parts, 2, self.length - 1, count)]
        x_rows, v_rows, a_rows, rows, backwards = (np.zeros(shape, dtype=np.int32) for shape in shapes)
        s = Series(x_rows, v_rows, a_rows, rows, backwards, np.full((*parts, self.length - 1), -1, dtype=np.int64))
        s.x[:n, 0], s.v[:n, 0] = digits(x, self.length), digits(v, self.length)
        expand(e, s, np.array(felt, dtype=np.int64), self.total)
        return Expansion(e, s, self.total[-1], felt)
