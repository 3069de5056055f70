"""The largest overlap of each contact and the time of its first maximal compression, followed through the steps.

The crossing time of a contact is the first time at which its rate falls through zero while its overlap is above 0. It
is proved if every earlier step in which the contact may be closed has a rate of one sign. A contact whose overlap has
no proved sign at the start, because it touches with a gap of 0, is followed from the time at which it has one; the
list of touches counts from then, too.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from fractions import Fraction

from dem_bridge.foundation.compiled import Ints
from dem_bridge.proof.flow import Box, Step
from dem_bridge.proof.problem import Problem
from dem_bridge.proof.turns import Ball, Course

#: what an upper bound that may be too large is raised by, so that the same contact at rest is looked at once
_RAISED = Fraction(10**9 + 1, 10**9)


#: bits of a root
_BITS_OF_ROOT = 256


class Unknown(Enum):
    """Why a contact has no crossing time."""

    NONE = "none"
    """Its rate is proved not to fall through zero while it is closed."""
    UNPROVED = "unproved"


@dataclass(frozen=True, kw_only=True)
class Extreme:
    """What is proved of a contact up to some time: overlaps below 0 count as 0."""

    low: Fraction = Fraction(0)
    """A lower bound of the largest overlap, reached at the time ``at`` (s), m."""
    high: Fraction = Fraction(0)
    """An upper bound of the largest overlap, m."""
    at: Fraction = Fraction(0)
    crossing: Ball | Unknown = Unknown.NONE

    def reaches(self, overlap: Ball, at: Fraction) -> Extreme:
        """Return this with an overlap that the contact has at a time."""
        middle, radius = overlap
        grown = replace(self, high=max(self.high, middle + radius))
        return replace(grown, low=middle - radius, at=at) if middle - radius > self.low else grown


def overlap_in(problem: Problem, box: Box, k: int) -> Ball:
    """Return the overlap of a contact in a box."""
    balls = (*box.displacement, (Fraction(0), Fraction(0)))
    (left, a), (right, b) = balls[problem.left[k]], balls[problem.right[k]]
    return left - right - problem.gap[k], a + b


def look(problem: Problem, extremes: Sequence[Extreme], box: Box, time: Fraction) -> list[Extreme]:
    """Return the extremes with the overlaps in a box at a time."""
    return [each.reaches(overlap_in(problem, box, k), time) for k, each in enumerate(extremes)]


def force_at(problem: Problem, extreme: Extreme, k: int) -> Ball:
    """Return the largest force of a contact, N, between those at the bounds of its overlap.

    >>> from dem_bridge.scene.scene import Scene
    >>> from dem_bridge.proof.problem import problem_of
    >>> pair = Scene(name="pair", duration=1.0, mass=(1.0, 1.0), stiffness=(2.0,), velocity=(1.0, 0.0))
    >>> [float(part) for part in force_at(problem_of(pair), Extreme(low=Fraction(4), high=Fraction(4)), 0)]
    [16.0, 0.0]
    """
    powers = [max(bound, Fraction(0)) ** problem.doubled[k] for bound in (extreme.low, extreme.high)]
    low, high = (problem.stiffness[k] * bound for bound in (_root(powers[0])[0], _root(powers[1])[1]))
    return (low + high) / 2, (high - low) / 2


def _root(value: Fraction) -> tuple[Fraction, Fraction]:
    """Return bounds of the square root of a number that is not negative."""
    over, under = value.numerator << (2 * _BITS_OF_ROOT), value.denominator
    shift = max(under.bit_length() - value.numerator.bit_length(), 0)
    shift += shift % 2
    root = math.isqrt((over << shift) // under)
    unit = Fraction(1, 1 << (_BITS_OF_ROOT + shift // 2))
    return root * unit, (root if root * root * under == over << shift else root + 1) * unit


class Extremes:
    """The extremes of all contacts through the steps of a segment; ``side``: signs of the overlaps at its start."""

    def __init__(self, extremes: Sequence[Extreme], side: Ints) -> None:
        self.now = list(extremes)
        self._known = [sign != 0 for sign in side.tolist()]

    def follow(self, step: Step, course: Callable[[int], Course | None]) -> None:
        """Note a step; ``course`` returns the course of an overlap in it."""
        for k, (side, rate, most) in enumerate(
            zip(step.side.tolist(), step.rate.tolist(), step.most.tolist(), strict=True)
        ):
            if side >= 0:
                self.now[k] = self._followed(k, side, rate, Fraction(most), course)
            self._known[k] = self._known[k] or side != 0

    def _followed(
        self, k: int, side: int, rate: int, most: Fraction, course: Callable[[int], Course | None]
    ) -> Extreme:
        """Return the extreme of a contact that may be closed in a step."""
        now = self.now[k]
        counts = now.crossing is Unknown.NONE and (side > 0 or self._known[k])
        if rate != 0:
            faint = rate < 0 and not self._known[k]
            return replace(now, crossing=Unknown.UNPROVED) if counts and faint else now
        path = course(k) if side > 0 and (counts or most > now.high) else None
        if path is None:
            high = now.high if most <= now.high else most * _RAISED
            return replace(now, high=high, crossing=Unknown.UNPROVED if counts else now.crossing)
        if path.turn is not None:
            now = now.reaches(path.turn.overlap, path.turn.time[0])
            return replace(now, crossing=path.turn.time) if counts else now
        steady = path.first == path.last != 0 and (path.first > 0 or self._known[k])
        high = now.high if path.first == path.last != 0 else max(now.high, path.most)
        return replace(now, high=high, crossing=Unknown.UNPROVED if counts and not steady else now.crossing)
