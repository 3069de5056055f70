"""Propose polynomial pieces of a motion to the checker. Nothing rests on this module: a bad proposal is refused.

Numbers are whole multiples of 2^-bits. Coefficients follow from recurrences of power series in a variable q in [0, 1];
the time is ``center + linear q + square q^2``. Between touches q is proportional to the time (``square = 0``). After a
contact closes, and before it opens, q^2 is proportional to the time from that touch (``linear = 0``): as a function of
q the motion is analytic there, and the series has its centre at the touch.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from flint import fmpq, fmpq_poly

from dem_bridge.foundation.compiled import Floats
from dem_bridge.proof.checker_expand import Expander, Expansion
from dem_bridge.proof.checker_series import BITS, rounded

#: most corrections of the time at which a contact opens; each leaves less than the error to the power 3/2
MOST_LANDINGS = 20
#: most proposals from one state; the n-th is as long as the one before times this to the power n
MOST_PROPOSALS, SHORTER = 24, 0.6
#: first length of a piece relative to the period of a contact, and to the time in which a touching contact turns
OF_PERIOD, OF_TURN = 0.3, 0.5
#: overlaps at a touch are set to 0 if they are at most so many multiples of 2^-bits
NEAR_TOUCH = 2**14
#: points at which an open contact is searched for a touch
GRID = 12
Numbers = list[int]


@dataclass(frozen=True)
class Bond:
    """A contact: bodies on its left and right (None for a wall), stiffness, gap, and twice the power of its force."""

    left: int | None
    right: int | None
    stiffness: fmpq
    gap: fmpq
    twice: int

    @property
    def ends(self) -> list[tuple[int, int]]:
        """Bodies with the sign of the force on them; the sign of the overlap is the opposite one."""
        return [(body, sign) for body, sign in _sides(self) if body is not None]


def _sides(bond: Bond) -> tuple[tuple[int | None, int], ...]:
    """Return the bodies of a contact or None with the signs of the forces."""
    return (bond.left, -1), (bond.right, 1)


@dataclass(frozen=True)
class Chain:
    """Masses (kg), constant forces (N) and contacts, as exact rational numbers."""

    mass: tuple[fmpq, ...]
    steady: tuple[fmpq, ...]
    bonds: tuple[Bond, ...]


@dataclass(frozen=True)
class Piece:
    """Polynomials in q: displacements, velocities, and for each closed contact the square root of its overlap.

    For contacts in ``touching`` it is the root of overlap/q^2, and for all others overlaps count as not positive.
    """

    center: fmpq
    linear: fmpq
    square: fmpq
    x: tuple[fmpq_poly, ...]
    v: tuple[fmpq_poly, ...]
    roots: dict[int, fmpq_poly]
    touching: frozenset[int]


class Proposer:
    """Propose pieces whose velocities have a defect of about ``tolerance`` (m/s, one per body, may be changed)."""

    def __init__(self, chain: Chain, bits: int, tolerance: Sequence[float], fastest: float) -> None:
        places = -(-bits // BITS)
        self.chain, self.bits, self.one, self.tolerance = chain, BITS * places, 1 << BITS * places, list(tolerance)
        digits = math.log2(max(2.0, fastest / min(tolerance)))
        self.order = 12 + int(0.35 * digits)
        self.reach = 2.0 ** (-digits / self.order)  # part of the radius of convergence that a piece covers
        self.stride, self.patience = math.inf, [1.0] * len(chain.bonds)
        self.ends = [bond.ends for bond in chain.bonds]
        self.gaps = [self.fixed(bond.gap) for bond in chain.bonds]
        wall, steady = len(chain.mass), [self.fixed(f / m) for f, m in zip(chain.steady, chain.mass, strict=True)]
        rates = [
            [0 if i is None else self.fixed(sign * bond.stiffness / chain.mass[i]) for i, sign in _sides(bond)]
            for bond in chain.bonds
        ]
        self.softness = [sum(abs(self.number(rate)) for rate in pair) for pair in rates]
        ends = [[wall if i is None else i for i, _ in _sides(bond)] for bond in chain.bonds]
        powers = [bond.twice for bond in chain.bonds]
        self.expander = Expander(ends, powers, rates, self.gaps, steady, places)

    def fixed(self, value: fmpq) -> int:
        """Return the nearest multiple of 2^-bits, as a whole number."""
        return int((2 * value.p * self.one + value.q) // (2 * value.q))

    def rounded(self, value: float) -> int:
        """Return the multiple of 2^-bits below a float."""
        over, under = value.as_integer_ratio()
        return over * self.one // under

    def number(self, value: int) -> float:
        """Return a multiple of 2^-bits as a float."""
        return value / self.one

    def pieces(self, x: Numbers, v: Numbers, time: fmpq, end: fmpq) -> Iterator[Piece]:
        """Yield pieces that start at this time and state, each shorter than the one before, until one is accepted."""
        left, x = float(end - time), list(x)
        stride = min(left, self.stride)
        for k, bond in enumerate(self.chain.bonds):  # a contact on which the last piece has landed
            if abs(self._difference(k, x, self.gaps[k])) <= NEAR_TOUCH and self._difference(k, v) > 0:
                self._touch(x, k, bond)
        overlap = [self.number(self._difference(k, x, gap)) for k, gap in enumerate(self.gaps)]
        closing = [self.number(self._difference(k, v)) for k in range(len(overlap))]
        touching = {k for k, d in enumerate(overlap) if d == 0 and self._is_felt(k, closing[k] * stride, stride)}
        span = min([stride, *(OF_PERIOD * self._period(k, d) for k, d in enumerate(overlap) if d > 0)])
        felt = {k for k, d in enumerate(overlap) if d > 0 and self._is_felt(k, d, span)}
        if touching:
            span = min([left, *(OF_TURN * self._turn(k, closing[k]) for k in touching)])
        else:
            for k in sorted(felt, key=lambda k: overlap[k] / max(-closing[k], 1e-300)):
                yield from self._opening(x, v, time, left, felt, k)
        whole = span >= left
        length = self.fixed(end - time) if whole else self.rounded(span)
        series = self._series(x, v, (0, length) if touching else (length, 0), felt | touching, touching)
        part = self._decay(series, self.number(length))
        others = [k for k, d in enumerate(overlap) if d <= 0.0 and k not in touching]
        rough = dict(zip(others, series.overlaps(others), strict=True))
        for attempt in range(1, MOST_PROPOSALS):
            landed = self._landing(series, rough, part, span)
            factor = self.rounded(part) if landed is None else landed
            scaled = (factor * factor >> self.bits if touching else factor) * length >> self.bits
            step = end - time if whole and factor == self.one else fmpq(scaled, self.one)
            if landed is None:
                grown = 1.5 * float(step) if part < 1.0 else 4.0 * float(step)
                self.stride = 0.5 * float(step) if touching else grown
            yield self._piece(time, step, series, factor, touching)
            part = SHORTER**attempt * self.number(factor)

    def _piece(self, time: fmpq, step: fmpq, series: Expansion, factor: int, touching: set[int]) -> Piece:
        """Return a part of a series as a piece; of roots of touching contacts q is divided out."""
        parts = [[series.scaled(rows, factor, self.one) for rows in part] for part in series.motion()]
        x, v = (tuple(fmpq_poly(numbers, self.one) for numbers in part) for part in parts)
        roots = {k: fmpq_poly([0]) for k in series.felt}
        for k, root, unit in series.roots():
            numbers = series.scaled(root, factor, factor if k in touching else self.one)
            roots[k] = fmpq_poly([number >> unit for number in numbers], self.one)
        times = (fmpq(0), step) if touching else (step, fmpq(0))
        return Piece(time, *times, x, v, roots, frozenset(touching))

    def _difference(self, k: int, values: Sequence[int], gap: int = 0) -> int:
        """Return the overlap or closing velocity of a contact."""
        return sum(-sign * values[body] for body, sign in self.ends[k]) - gap

    def _touch(self, x: Numbers, k: int, bond: Bond) -> None:
        """Move one body so that the overlap of a contact is 0."""
        if bond.right is None:
            x[bond.left or 0] = self.gaps[k]
        else:
            x[bond.right] = (0 if bond.left is None else x[bond.left]) - self.gaps[k]

    def _is_felt(self, k: int, overlap: float, span: float) -> bool:
        """Return True if the force at an overlap changes a velocity by more than its tolerance."""
        if overlap <= 0.0:
            return False
        change = self.softness[k] * overlap ** (self.chain.bonds[k].twice / 2) * span
        return bool(change > min(self.tolerance[body] for body, _ in self.ends[k]))

    def _period(self, k: int, overlap: float) -> float:
        """Return the time scale of small motions of a contact at an overlap."""
        power = self.chain.bonds[k].twice / 2
        return float((self.softness[k] * power * overlap ** (power - 1)) ** -0.5)

    def _turn(self, k: int, speed: float) -> float:
        """Return about the time from touch in which the force of a contact changes its closing velocity."""
        power = self.chain.bonds[k].twice / 2
        return float(((power + 1) * (power + 2) / (self.softness[k] * speed ** (power - 1))) ** (1 / (power + 1)))

    def _decay(self, series: Expansion, span: float) -> float:
        """Return the part of a piece within which the last coefficients are below the tolerance."""
        tails = [
            (tolerance, series.s.v[body], 0) for body, tolerance in enumerate(self.tolerance) if series.e.moved[body]
        ]
        for k, root, unit in series.roots():  # its error is that of a force, which acts for a time ``span``
            power = self.chain.bonds[k].twice - 1
            weight = 4.0 * self.softness[k] * math.ldexp(rounded(root[0]), -unit) ** power * span
            tails.append((min(self.tolerance[body] for body, _ in self.ends[k]) / weight, root, unit))
        part = 1.0
        for tolerance, tail, unit in tails:
            for o in range(max(5, len(tail) - 4), len(tail)):
                if last := math.ldexp(abs(rounded(tail[o])), -unit):
                    part = min(part, (tolerance / (2.0 * last)) ** (1 / o))
        return part

    def _landing(self, series: Expansion, rough: dict[int, Floats], part: float, span: float) -> int | None:
        """Return the first q in (0, part] at which an open contact closes, if any; ``rough``: their overlaps."""
        found, powers = [], part ** np.arange(len(series.s.x[0]))
        for k, d in rough.items():
            if d[0] + (np.maximum(d, 0.0) @ powers) <= 0.0:
                continue
            low = 0.0
            for high in (part * i / GRID for i in range(1, GRID + 1)):
                value = float(d @ high ** np.arange(len(d)))
                if value > 0.0:
                    if self._is_felt(k, max(value, -d[0]), span) and low + d[0] != 0.0:
                        found.append(self._root(series.exact_overlap(k), low, high))
                    break
                low = high
        return min(found, default=None)

    def _root(self, d: Numbers, low: float, high: float) -> int:
        """Return the root of a series between two values of q, by bisection and Newton's method."""

        def value(q: int) -> tuple[int, int]:
            total, slope = 0, 0
            for c in reversed(d):
                slope = (slope * q >> self.bits) + total
                total = (total * q >> self.bits) + c
            return total, slope

        a, b = self.rounded(low), self.rounded(high)
        for _ in range(12):
            middle = (a + b) // 2
            a, b = (a, middle) if value(middle)[0] > 0 else (middle, b)
        q = (a + b) // 2
        for _ in range(30):
            total, slope = value(q)
            change = (total << self.bits) // slope if slope else 0
            q = min(max(q - change, a), b)
            if abs(change) <= 1:
                break
        return q

    def _opening(self, x: Numbers, v: Numbers, time: fmpq, left: float, felt: set[int], k: int) -> Iterator[Piece]:
        """Yield a piece that ends where a contact opens, if that is near."""
        d, u = self.number(self._difference(k, x, self.gaps[k])), self.number(self._difference(k, v))
        if u >= 0.0:
            return
        wait, near, part = d / -u, self.reach**2 * self._turn(k, -u), 1.0
        if wait > self.patience[k] * near or 2.0 * wait > left:
            return
        found = self._land(x, v, felt, k, wait)
        if found is not None:
            x, v, square = found
            self._touch(x, k, self.chain.bonds[k])
            closed = all(self._difference(other, x, self.gaps[other]) > 0 for other in felt - {k})
            series = self._series(x, v, (0, -square), felt, {k}) if closed else None
            if series is not None and (part := self._decay(series, wait)) == 1.0:
                span = fmpq(square, self.one)
                yield self._piece(time + span, -span, series, self.one, {k})
        self.patience[k] = min(0.5, part**2) * wait / near

    def _land(self, x: Numbers, v: Numbers, felt: set[int], k: int, wait: float) -> tuple[Numbers, Numbers, int] | None:
        """Return the state at which a contact opens, and the time until then."""
        square = self.rounded(wait)
        for turn in range(MOST_LANDINGS):
            order = min(self.order, int(12 * 1.5**turn))  # each correction has half as many digits more
            at = self._series(x, v, (2 * square, -square), felt, set(), order).at_end()
            d, u = self._difference(k, at[0], self.gaps[k]), self._difference(k, at[1])
            if u >= 0:
                return None
            if abs(d) <= NEAR_TOUCH // 4 and order == self.order:
                return at[0], at[1], square
            square -= (d << self.bits) // u
            if not 0 < self.number(square) < 2.0 * wait:
                return None
        return None

    def _series(
        self, x: Numbers, v: Numbers, times: tuple[int, int], felt: set[int], touching: set[int], order: int = 0
    ) -> Expansion:
        """Return the series of displacements, velocities and roots of overlaps."""
        firsts = {k: self._difference(k, x, self.gaps[k]) for k in felt - touching}
        firsts |= {k: self._difference(k, v) * times[1] >> self.bits for k in touching}
        return self.expander.expand(x, v, times, firsts, touching, order or self.order)
