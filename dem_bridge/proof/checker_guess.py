"""Propose polynomial pieces of a motion to the checker. Nothing rests on this module: a bad proposal is refused.

Numbers are whole multiples of 2^-bits. Coefficients follow from recurrences of power series in a variable q in [0, 1];
the time is ``center + linear q + square q^2``. Between touches q is proportional to the time (``square = 0``). After a
contact closes, and before it opens, q^2 is proportional to the time from that touch (``linear = 0``): as a function of
q the motion is analytic there, and the series has its centre at the touch.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from operator import mul

from flint import fmpq, fmpq_poly, fmpz

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
Series = list[fmpz]


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
        return [(body, sign) for body, sign in ((self.left, -1), (self.right, 1)) if body is not None]


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


class _Force:
    """Coefficients of the power of an overlap, one after the other."""

    def __init__(self, twice: int, bits: int) -> None:
        self.twice, self.bits, self.odd = twice, bits, twice % 2 == 1
        self.d: Series = []
        self.g: Series = []
        self.root: Series = []
        self.products: list[Series] = [[] for _ in range(twice // 2 - (not self.odd))]

    def add(self, d: fmpz, touching: bool) -> fmpz:
        """Take the next coefficient of the overlap and return that of its power."""
        self.d.append(d)
        o = len(self.d) - 1 - (self.twice if touching else 0)
        if o < 0:
            return fmpz(0)
        self.g.append(self.d[o + 2] if touching else d)
        if self.odd:
            self._next_root()
        last = self.root if self.odd else self.g
        for product in self.products:
            product.append(sum(map(mul, self.g, last[o::-1]), fmpz(0)) >> self.bits)
            last = product
        return last[o]

    def _next_root(self) -> None:
        s, o = self.root, len(self.root)
        if o == 0:
            s.append((self.g[0] << self.bits).isqrt())
            return
        half = (o - 1) // 2
        known = 2 * sum(map(mul, s[1 : half + 1], s[o - 1 : o - 1 - half : -1]), fmpz(0))
        known += s[o // 2] ** 2 if o % 2 == 0 else 0
        s.append(((self.g[o] << self.bits) - known) // (2 * s[0]))

    def finish(self, touching: bool) -> Series:
        """Return the root with all coefficients that the overlap determines."""
        while self.odd and touching and len(self.g) + 2 < len(self.d):
            self.g.append(self.d[len(self.g) + 2])
            self._next_root()
        return self.root


class Proposer:
    """Propose pieces whose velocities have a defect of about ``tolerance`` (m/s, one per body, may be changed)."""

    def __init__(self, chain: Chain, bits: int, tolerance: Sequence[float], fastest: float) -> None:
        self.chain, self.bits, self.one, self.tolerance = chain, bits, fmpz(1) << bits, list(tolerance)
        digits = math.log2(max(2.0, fastest / min(tolerance)))
        self.order = 12 + int(0.28 * digits)
        self.reach = 2.0 ** (-digits / self.order)  # part of the radius of convergence that a piece covers
        self.stride, self.patience = math.inf, [4.0] * len(chain.bonds)
        self.ends = [bond.ends for bond in chain.bonds]
        self.gaps = [self.fixed(bond.gap) for bond in chain.bonds]
        self.steady = [self.fixed(force / mass) for force, mass in zip(chain.steady, chain.mass, strict=True)]
        self.rates = [
            [(body, self.fixed(sign * bond.stiffness / chain.mass[body])) for body, sign in bond.ends]
            for bond in chain.bonds
        ]
        self.softness = [sum(abs(self.number(rate)) for _, rate in rates) for rates in self.rates]

    def fixed(self, value: fmpq) -> fmpz:
        """Return the nearest multiple of 2^-bits, as a whole number."""
        return (2 * value.p * self.one + value.q) // (2 * value.q)

    def rounded(self, value: float) -> fmpz:
        """Return the multiple of 2^-bits below a float."""
        over, under = value.as_integer_ratio()
        return over * self.one // under

    def number(self, value: fmpz) -> float:
        """Return a multiple of 2^-bits as a float."""
        return int(value) / int(self.one)

    def pieces(self, x: Series, v: Series, time: fmpq, end: fmpq) -> Iterator[Piece]:
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
        zero = fmpz(0)
        series = self._series(x, v, *((zero, length) if touching else (length, zero)), felt | touching, touching)
        part = self._decay(series, self.number(length))
        for attempt in range(1, MOST_PROPOSALS):
            landed = self._landing(series[0], part, set(range(len(overlap))) - felt - touching, span)
            factor = self.rounded(part) if landed is None else landed
            scaled = (factor * factor >> self.bits if touching else factor) * length >> self.bits
            step = end - time if whole and factor == self.one else fmpq(scaled, self.one)
            if landed is None:
                grown = 1.5 * float(step) if part < 1.0 else 4.0 * float(step)
                self.stride = 0.5 * float(step) if touching else grown
            yield self._piece(time, step, series, factor, touching)
            part = SHORTER**attempt * self.number(factor)

    def _piece(
        self, time: fmpq, step: fmpq, series: tuple[list[Series], list[Series], dict[int, Series]], factor: fmpz,
        touching: set[int],
    ) -> Piece:  # fmt: skip
        """Return a part of a series as a piece; of roots of touching contacts q is divided out."""
        x, v = (tuple(self._polynomial(c, factor, self.one) for c in each) for each in series[:2])
        roots = {k: self._polynomial(c, factor, factor if k in touching else self.one) for k, c in series[2].items()}
        zero = fmpq(0)
        linear, square = (zero, step) if touching else (step, zero)
        return Piece(time, linear, square, x, v, roots, frozenset(touching))

    def _polynomial(self, coefficients: Series, factor: fmpz, weight: fmpz) -> fmpq_poly:
        """Return a series in q times ``factor``, all times ``weight``."""
        out = []
        for value in coefficients:
            out.append(value * weight >> self.bits)
            weight = weight * factor >> self.bits
        return fmpq_poly(out, self.one)

    def _difference(self, k: int, values: Sequence[fmpz], gap: fmpz | int = 0) -> fmpz:
        """Return the overlap or closing velocity of a contact."""
        return sum((-sign * values[body] for body, sign in self.ends[k]), fmpz(-gap))

    def _coefficient(self, k: int, x: Sequence[Series], o: int) -> fmpz:
        """Return a coefficient of the overlap of a contact."""
        total = fmpz(0) if o else -self.gaps[k]
        for body, sign in self.ends[k]:
            if o < len(x[body]):
                total -= sign * x[body][o]
        return total

    def _touch(self, x: Series, k: int, bond: Bond) -> None:
        """Move one body so that the overlap of a contact is 0."""
        if bond.right is None:
            x[bond.left or 0] = self.gaps[k]
        else:
            x[bond.right] = (fmpz(0) if bond.left is None else x[bond.left]) - self.gaps[k]

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

    def _decay(self, series: tuple[list[Series], list[Series], dict[int, Series]], span: float) -> float:
        """Return the part of a piece within which the last coefficients are below the tolerance."""
        tails = [(self.tolerance[body], v) for body, v in enumerate(series[1])]
        for k, root in series[2].items():
            if root:  # its error is that of a force, which acts for a time ``span``
                power = self.chain.bonds[k].twice - 1
                weight = 4.0 * self.softness[k] * self.number(root[0]) ** power * span
                tails.append((min(self.tolerance[body] for body, _ in self.ends[k]) / weight, root))
        part = 1.0
        for tolerance, tail in tails:
            for o in range(max(5, len(tail) - 4), len(tail)):
                if tail[o]:
                    part = min(part, (tolerance / (2.0 * abs(self.number(tail[o])))) ** (1 / o))
        return part

    def _landing(self, x: Sequence[Series], part: float, contacts: Iterable[int], span: float) -> fmpz | None:
        """Return the first q in (0, part] at which an open contact closes, if any."""
        found = []
        for k in contacts:
            length = max(len(x[body]) for body, _ in self.ends[k])
            d = [self._coefficient(k, x, o) for o in range(length)]
            if d[0] > 0 or not any(d[1:]):
                continue
            rough = [self.number(value) for value in d]
            if rough[0] + sum(value * part**o for o, value in enumerate(rough) if o and value > 0) <= 0.0:
                continue
            low = 0.0
            for high in (part * i / GRID for i in range(1, GRID + 1)):
                value = math.fsum(c * high**o for o, c in enumerate(rough))
                if value > 0.0:
                    if self._is_felt(k, max(value, -rough[0]), span) and low + rough[0] != 0.0:
                        found.append(self._root(d, low, high))
                    break
                low = high
        return min(found, default=None)

    def _root(self, d: Series, low: float, high: float) -> fmpz:
        """Return the root of a series between two values of q, by bisection and Newton's method."""

        def value(q: fmpz) -> tuple[fmpz, fmpz]:
            total, slope = fmpz(0), fmpz(0)
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
            change = (total << self.bits) // slope if slope else fmpz(0)
            q = min(max(q - change, a), b)
            if abs(change) <= 1:
                break
        return q

    def _opening(self, x: Series, v: Series, time: fmpq, left: float, felt: set[int], k: int) -> Iterator[Piece]:
        """Yield a piece that ends where a contact opens, if that is near."""
        d, u = self.number(self._difference(k, x, self.gaps[k])), self.number(self._difference(k, v))
        if u >= 0.0:
            return
        wait = d / -u
        if wait > self.patience[k] * self.reach**2 * self._turn(k, -u) or 2.0 * wait > left:
            return
        found = self._land(x, v, felt, k, wait)
        if found is not None:
            x, v, square = found
            self._touch(x, k, self.chain.bonds[k])
            closed = all(self._difference(other, x, self.gaps[other]) > 0 for other in felt - {k})
            series = self._series(x, v, fmpz(0), -square, felt, {k}) if closed else None
            if series is not None and self._decay(series, wait) == 1.0:
                span = fmpq(square, self.one)
                yield self._piece(time + span, -span, series, self.one, {k})
        self.patience[k] /= 2.0

    def _land(self, x: Series, v: Series, felt: set[int], k: int, wait: float) -> tuple[Series, Series, fmpz] | None:
        """Return the state at which a contact opens, and the time until then."""
        square = self.rounded(wait)
        for turn in range(MOST_LANDINGS):
            order = min(self.order, 12 << turn)  # the first corrections need few digits
            series = self._series(x, v, 2 * square, -square, felt, set(), order)
            at = [[sum(c, fmpz(0)) for c in each] for each in series[:2]]
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
        self, x0: Series, v0: Series, linear: fmpz, square: fmpz, felt: set[int], touching: set[int], order: int = 0
    ) -> tuple[list[Series], list[Series], dict[int, Series]]:
        """Return the coefficients of displacements, velocities and roots of overlaps."""
        x, v, bits = [[value] for value in x0], [[value] for value in v0], self.bits
        a = [[value] for value in self.steady]
        forces = {k: _Force(self.chain.bonds[k].twice, bits) for k in sorted(felt)}
        moved = sorted({body for k in felt for body, _ in self.ends[k]})
        for o in range((order or self.order) + 1):
            for k, force in forces.items():
                if value := force.add(self._coefficient(k, x, o), k in touching):
                    for body, rate in self.rates[k]:
                        a[body][o] += rate * value >> bits
            for body in moved if o > 3 else range(len(x)):
                for series, rates in ((x[body], v[body]), (v[body], a[body])):
                    change = linear * rates[o] if linear else fmpz(0)
                    if square and o:
                        change += 2 * square * rates[o - 1]
                    series.append((change >> bits) // (o + 1))
                a[body].append(fmpz(0))
        return x, v, {k: force.finish(k in touching) for k, force in forces.items()}
