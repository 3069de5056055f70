"""Where the overlap of a contact stops growing within a step: proved from the polynomials of the step.

The variable is y in [0, 1] over the step. The true overlap differs from its polynomial by at most ``apart``, and the
true closing rate from its own by at most ``faster``. Where the polynomial of the rate falls, from above ``faster`` to
below ``-faster``, the true rate passes zero only between these two times, and the overlap is largest there.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from flint import arb, arb_poly

#: midpoint and radius
Ball = tuple[Fraction, Fraction]
#: halvings of a step in which the rate or its slope has a sign, bisections before Newton's method, and its steps
_HALVINGS, _BISECTIONS, _NEWTON = 7, 12, 12
#: doublings of the distance from a zero to two times at which the rate has a sign
_DOUBLINGS = 60


@dataclass(frozen=True, kw_only=True)
class Curve:
    """Overlap (m) and closing rate (m/s) of a contact within a step, as polynomials in y, and their errors."""

    begin: Fraction
    length: Fraction
    overlap: tuple[Ball, ...]
    rate: tuple[Ball, ...]
    apart: Fraction
    faster: Fraction
    bits: int


@dataclass(frozen=True, kw_only=True)
class Turn:
    """The largest overlap of a contact within a step, and the only time at which its rate falls through zero."""

    time: Ball
    overlap: Ball


@dataclass(frozen=True, kw_only=True)
class Course:
    """How an overlap goes within a step: the signs of its rate at first and at last, and its turn.

    Both signs are 0 where they are not proved. If they differ without a turn, the overlap has a minimum.
    """

    first: int
    last: int
    turn: Turn | None
    most: Fraction
    """An upper bound of the overlap within the step, m."""


def follow_overlap(curve: Curve) -> Course | None:
    """Return the course of an overlap within a step; None if not even its parts are found."""
    from flint import ctx  # an extra

    with ctx.workprec(curve.bits):
        return _course(curve)


def _course(curve: Curve) -> Course | None:
    """Return the course from parts in which the rate has a sign, or its polynomial is monotone.

    In these the overlap is at most the larger of its values at both ends, and what the error of the rate adds, but for
    one whose rate falls through zero.
    """
    rate, overlap, error = _polynomial(curve.rate), _polynomial(curve.overlap), _number(curve.faster)
    signs: list[int] = []
    turns: list[Turn | None] = []
    most = _upper(overlap(_number(Fraction(0))))
    for begin, end, proved in _parts(rate, rate.derivative(), error, Fraction(0), Fraction(1), _HALVINGS):
        if not proved:
            return None
        before, after = (_sign(rate(_number(y)), error) for y in (begin, end))
        most = max(most, _upper(overlap(_number(end))))
        if before > 0 > after:
            turns.append(_turn(curve, rate, begin, end))
        signs += [sign for sign in (before, after) if not signs or sign != signs[-1]]
    most += curve.apart + 2 * curve.faster * curve.length
    if not turns:
        first, last = (signs[0], signs[-1]) if 0 not in signs and len(signs) <= 2 else (0, 0)
        return Course(first=first, last=last, turn=None, most=most)
    if (turn := turns[0]) is None or signs != [1, -1]:
        return None
    return Course(first=1, last=-1, turn=turn, most=max(most, sum(turn.overlap, Fraction(0))))


def _parts(
    rate: arb_poly, slope: arb_poly, error: arb, begin: Fraction, end: Fraction, halvings: int
) -> Iterator[tuple[Fraction, Fraction, bool]]:
    """Yield parts of a step, and whether the rate keeps its sign or its polynomial is monotone in them."""
    if _keeps_sign(rate, error, begin, end) or _keeps_sign(slope, 0 * error, begin, end):
        yield begin, end, True
    elif halvings == 0:
        yield begin, end, False
    else:
        middle = (begin + end) / 2
        yield from _parts(rate, slope, error, begin, middle, halvings - 1)
        yield from _parts(rate, slope, error, middle, end, halvings - 1)


def _turn(curve: Curve, rate: arb_poly, begin: Fraction, end: Fraction) -> Turn | None:
    """Return the turn in a part in which the polynomial of the rate falls from above its error to below."""
    y, error = _zero(rate, begin, end), _number(curve.faster)
    at, slope = rate(_number(y)), rate.derivative()(_number(y))
    if not slope < 0:
        return None
    near = _upper(abs(at) + error) / _upper(abs(slope)) * 2
    for _ in range(_DOUBLINGS):
        first, last = max(y - near, begin), min(y + near, end)
        rises, falls = rate(_number(first)), rate(_number(last))
        if _sign(rises, error) > 0 > _sign(falls, error):
            break
        near *= 2
    else:
        return None
    # between these times the overlap changes by at most the largest rate times the distance
    change = _upper(abs(rises) + abs(falls) + error) * (last - first) * curve.length
    middle, radius = _ball(_polynomial(curve.overlap)(_number(y)))
    time = curve.begin + y * curve.length
    return Turn(time=(time, near * curve.length), overlap=(middle, radius + change + curve.apart))


def _zero(rate: arb_poly, begin: Fraction, end: Fraction) -> Fraction:
    """Return about where a polynomial that falls between two points passes zero."""
    low, high = begin, end
    for _ in range(_BISECTIONS):
        middle = (low + high) / 2
        low, high = (middle, high) if rate(_number(middle)).mid() > 0 else (low, middle)
    y, slope = _number((low + high) / 2), rate.derivative()
    for _ in range(_NEWTON):
        y = (y - rate(y) / slope(y)).mid()
    zero = _ball(y)[0]
    return zero if low <= zero <= high else (low + high) / 2


def _keeps_sign(poly: arb_poly, error: arb, begin: Fraction, end: Fraction) -> bool:
    """Return True if a polynomial exceeds an error in magnitude, with one sign, between two points."""
    from flint import arb_poly  # an extra

    first, *rest = poly(arb_poly([_number((begin + end) / 2), _number((end - begin) / 2)])).coeffs() or [0 * error]
    return bool(abs(first) > sum(map(abs, rest), error))


def _sign(value: arb, error: arb) -> int:
    """Return the sign of all numbers within an error of a ball, or 0."""
    return int(value > error) - int(value < -error)


def _polynomial(balls: tuple[Ball, ...]) -> arb_poly:
    from flint import arb_poly  # an extra

    return arb_poly([_number(*ball) for ball in balls])


def _number(middle: Fraction, radius: Fraction = Fraction(0)) -> arb:
    """Return a ball that contains all numbers within a radius of a fraction."""
    from flint import arb, fmpq  # an extra

    return arb(*(fmpq(value.numerator, value.denominator) for value in (middle, radius)))


def _ball(value: arb) -> Ball:
    """Return midpoint and radius of a ball, exactly."""
    parts = (value.mid().fmpq(), value.rad().fmpq())
    middle, radius = (Fraction(int(part.p), int(part.q)) for part in parts)
    return middle, radius


def _upper(value: arb) -> Fraction:
    """Return an upper bound of a ball."""
    return sum(_ball(value), Fraction(0))
