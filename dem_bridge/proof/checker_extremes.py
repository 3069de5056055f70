"""Bound polynomials on [0, 1], and prove the largest overlaps and first maximal compressions that a file claims.

**Lemma 4 (largest overlap).** A polynomial D with ``D' >= -a`` on [0, q] and ``D' <= b`` on [q, 1] is at most
``D(q) + max(a q, b (1 - q), 0)`` on [0, 1]. So the largest overlap is at most ``M + r`` if the bounds of all pieces,
with the error of the tube, are; and at least ``M - r`` if the overlap is that at the time that the file names.

**Lemma 5 (crossing).** Let the rate of an overlap be nowhere 0 in the pieces in which the contact may be closed, up to
a time t1 at which the overlap and the rate are above 0, and let the rate be below 0 at t2 > t1. Then the first time at
which the rate falls through zero while the contact is closed lies between t1 and t2.

As for touches, a contact with gap 0 counts from the time at which its overlap is proved to have a sign.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

from flint import fmpq, fmpq_poly, fmpz

from dem_bridge.proof.checker_file import Ball, Extreme, above, exactly, require, shown
from dem_bridge.proof.checker_guess import Bond, Chain, Piece

#: halvings of a piece in which the sign of an overlap or of its rate is looked for
HALVINGS = 6
#: bits of the place in a piece that belongs to a time
_BITS = 128


def limits(poly: fmpq_poly, halvings: int = 0) -> tuple[fmpq, fmpq]:
    """Return bounds of a polynomial on [0, 1]: its values at the ends if it is monotone, else coarse ones of its parts.

    >>> limits(fmpq_poly([3, -2, 1]))
    (2, 3)
    """
    zero = fmpz(0)
    first, *rest = poly.numer().coeffs() or [zero]
    steeper = sum((k * c for k, c in enumerate(rest[1:], 2) if c > 0), zero)
    flatter = sum((k * c for k, c in enumerate(rest[1:], 2) if c < 0), zero)
    ends = (first, first + sum(rest, zero))
    if not rest or rest[0] + flatter >= 0 or rest[0] + steeper <= 0:
        least, most = min(ends), max(ends)
    elif halvings > 0:
        halves = [limits(within(poly, fmpq(part, 2), fmpq(part + 1, 2)), halvings - 1) for part in (0, 1)]
        return min(low for low, _ in halves), max(high for _, high in halves)
    else:
        least, most = first + sum((c for c in rest if c < 0), zero), first + sum((c for c in rest if c > 0), zero)
    return fmpq(least, poly.denom()), fmpq(most, poly.denom())


def bounds(poly: fmpq_poly, halvings: int = 0) -> tuple[float, float]:
    """Return bounds of a polynomial on [0, 1] as floats.

    >>> import math
    >>> bounds(fmpq_poly([3, -2, 1])) == (math.nextafter(2.0, 0.0), math.nextafter(3.0, 4.0))
    True
    """
    low, high = limits(poly, halvings)
    return -above(-low), above(high)


def within(poly: fmpq_poly, begin: fmpq, end: fmpq) -> fmpq_poly:
    """Return a polynomial between two points, with a variable in [0, 1]."""
    return poly(fmpq_poly([begin, end - begin]))


def difference(bond: Bond, polys: tuple[fmpq_poly, ...]) -> fmpq_poly:
    """Return left minus right of a contact: its overlap but for the gap, or its closing velocity."""
    return sum((polys[body] * -sign for body, sign in bond.ends), fmpq_poly([0]))


def place_of(piece: Piece, time: fmpq) -> tuple[fmpq, fmpq]:
    """Return a place in a piece that belongs about to a time, and the exact time that belongs to the place."""
    ratio = (time - piece.center) / (piece.linear + piece.square)
    scaled = (ratio.p << (2 * _BITS)) // ratio.q if ratio > 0 else fmpz(0)
    q = min(fmpq(scaled >> _BITS if piece.square == 0 else scaled.isqrt(), fmpz(1) << _BITS), fmpq(1))
    return q, piece.center + piece.linear * q + piece.square * q * q


class Passage(NamedTuple):
    """A contact in a piece: its overlap and closing velocity, and their errors."""

    contact: int
    piece: Piece
    overlap: fmpq_poly
    rate: fmpq_poly
    off: fmpq
    off_rate: fmpq

    def contains(self, time: fmpq) -> bool:
        """Return True if a time is in the piece, but not at its begin."""
        return self.begins < time <= self.begins + abs(self.piece.linear + self.piece.square)

    @property
    def begins(self) -> fmpq:
        """Time at which the piece begins."""
        return self.piece.center + min(self.piece.square, fmpq(0))


class Watch:
    """Prove what a file claims of largest overlaps and crossing times, in the pieces of a segment."""

    def __init__(self, chain: Chain, extremes: Sequence[Extreme], known: Sequence[int]) -> None:
        self.chain, self.extremes, self.known = chain, extremes, [sign != 0 for sign in known]

    def follow(
        self, piece: Piece, overlaps: Sequence[tuple[float, float]], around: Callable[[int], tuple[float, float]]
    ) -> None:
        """Prove what is claimed of a piece, from bounds of its overlaps and the errors ``around`` each contact."""
        for k, (bond, claim) in enumerate(zip(self.chain.bonds, self.extremes, strict=True)):
            low, high = map(exactly, overlaps[k])
            off, off_rate = map(exactly, around(k))
            side = int(low > off) - int(high < -off)
            counts = side > 0 or (side == 0 and self.known[k])
            self.known[k] = self.known[k] or side != 0
            if claim.crossing is None and claim.overlap is None:
                continue
            x, v = difference(bond, piece.x) - bond.gap, difference(bond, piece.v)
            passage = Passage(k, piece, x, v, off, off_rate)
            if claim.overlap is not None and (high + off > 0 or passage.contains(claim.at)):
                _check_peak(passage, high, claim.overlap, claim.at)
            if claim.crossing is not None:
                _check_crossing(passage, claim.crossing, counts=counts)


def _check_peak(passage: Passage, high: fmpq, claim: Ball, at: fmpq) -> None:
    """Prove that an overlap is at most the largest one in a piece, and that it reaches this at its time (Lemma 4)."""
    overlap, off = passage.overlap, passage.off
    least, most = claim.middle - claim.radius, claim.middle + claim.radius
    name = f"the largest overlap of contact {passage.contact}"
    if passage.contains(at):
        q, slope = place_of(passage.piece, at)[0], overlap.derivative()
        value = overlap(q)
        require(least <= 0 or value - off >= least, f"{name} may not be reached at t = {shown(at)} s")
        if high + off > most:
            before, after = within(slope, fmpq(0), q), within(slope, q, fmpq(1))
            rises = -limits(before, HALVINGS)[0] * q, limits(after, HALVINGS)[1] * (1 - q)
            high = value + max(*rises, fmpq(0))
    elif high + off > most:
        high = limits(overlap, HALVINGS)[1]
    require(high + off <= max(most, fmpq(0)), f"{name} may be exceeded after t = {shown(passage.begins)} s")


def _check_crossing(passage: Passage, claim: Ball, *, counts: bool) -> None:
    """Prove that a rate is nowhere 0 in a piece up to the crossing, and that it falls through zero there (Lemma 5)."""
    piece, rate, off_rate = passage.piece, passage.rate, passage.off_rate
    first, last = claim.middle - claim.radius / 2, claim.middle + claim.radius / 2
    name, part = f"the crossing time of contact {passage.contact}", (fmpq(0), fmpq(1))
    if passage.contains(first):
        q, time = place_of(piece, first)
        grows = passage.overlap(q) > passage.off and rate(q) > off_rate
        require(time >= claim.middle - claim.radius and grows, f"{name} may be before the contact closes, or earlier")
        part, counts = ((fmpq(0), q) if piece.square >= 0 else (q, fmpq(1))), True
    if passage.begins < first and counts:
        low, high = limits(rate)
        if not (low > off_rate or high < -off_rate):
            low, high = limits(within(rate, *part), HALVINGS)
            require(low > off_rate or high < -off_rate, f"{name} may be near t = {shown(passage.begins)} s")
    if passage.contains(last):
        q, time = place_of(piece, last)
        require(time <= claim.middle + claim.radius and rate(q) < -off_rate, f"{name} may be after its ball")
