"""A proved motion step by step: the state of a chain in balls at exact times."""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from dem_bridge.foundation.compiled import Bools, Floats, Ints
from dem_bridge.proof import balls as ball
from dem_bridge.proof.balls import Balls
from dem_bridge.proof.bounds import Coefficients, choose_step, find_signs, read_coefficients
from dem_bridge.proof.problem import Problem, Scale
from dem_bridge.proof.series import Chain, Space, evaluate_all, expand, place, survey
from dem_bridge.proof.turns import Ball, Course, Curve, follow_overlap

#: highest order of a series
MOST_ORDER = 224
#: a contact counts as closed only where the radius of its overlap is below this part of it
_CERTAIN = 2.0**-10


@dataclass(frozen=True, kw_only=True)
class Box:
    """Balls of all displacements (m) and velocities (m/s)."""

    displacement: tuple[Ball, ...]
    velocity: tuple[Ball, ...]


@dataclass(frozen=True, kw_only=True)
class Step:
    """What one step proved, beside the new state."""

    begin: Fraction
    end: Fraction
    side: Ints
    """Sign of each overlap, where it is the same throughout the step, else 0."""
    rate: Ints
    """Sign of the rate of each overlap, where it is the same throughout the step, else 0."""
    most: Floats
    """Upper bounds of the overlaps within the step, m."""


@dataclass(frozen=True, kw_only=True)
class StepRule:
    """How steps are chosen; a proof is right with any rule, and its radii depend on it."""

    share: float = 1e-4
    """What a step may add to the largest radius, relative to it: a run has some ten thousand steps."""
    guard: int = 40
    """Bits of rounding below the largest radius."""
    order: float = 0.5 * math.log(2.0)
    """Order of the series for each bit that is proved."""
    faint: float = 0.1
    """Largest force that is neglected, by its change of a velocity, relative to what a step may add to a radius."""


#: the rule of proofs
STEP_RULE = StepRule()


class Stopped(Exception):
    """A step that cannot be proved; the message is the reason."""


class Flow:
    """The motion of all starts in a box, advanced in steps of proved error.

    Parameters
    ----------
    problem : Problem
        The chain.
    time : Fraction
        Time of the box, s.
    box : Box
        Displacements and velocities.
    scale : Scale
        Speed and shortest time of the scene; they set accuracies, and no proof depends on them.
    bits : int
        Radii count as at least ``2^-bits`` of the largest velocity, for the choice of steps.
    rule : StepRule
        How steps are chosen.
    """

    def __init__(
        self, problem: Problem, time: Fraction, box: Box, *, scale: Scale, bits: int, rule: StepRule = STEP_RULE
    ) -> None:
        self.problem, self.time, self.scale, self.bits, self.rule = problem, time, scale, bits, rule
        self.steps = 0
        n, k = len(problem.mass), len(problem.left)
        self._n, stride = n, MOST_ORDER + 2
        levels = max(1, (max(problem.doubled, default=1) - 1) // 2)
        self._state, self._numbers, self._found = Balls(2 * n), Balls(2 * k + 2 * n), Balls(2 * n + 1)
        self._series = Balls((2 * n + (2 + levels) * k) * stride + n + 8)
        self._powers = Balls(stride)
        at, size = self._series.at, stride
        v, x, s, w = at(0), at(n * size), at(2 * n * size), at((2 * n + k) * size)
        powers, spare = at((2 * n + 2 * k) * size), at((2 * n + (2 + levels) * k) * size)
        self._space = Space(size, levels, v, x, s, w, powers, spare)
        inverse = [1 / mass for mass in problem.mass]
        for i, value in enumerate([*problem.stiffness, *problem.gap, *inverse, *problem.acceleration]):
            self._numbers[i] = value, Fraction(0)
        up = [math.nextafter(float(value), math.inf) for value in inverse]
        self._chain = Chain(
            left=np.array(problem.left, dtype=np.int64),
            right=np.array(problem.right, dtype=np.int64),
            doubled=np.array(problem.doubled, dtype=np.int64),
            stiffness=np.array([math.nextafter(float(value), math.inf) for value in problem.stiffness]),
            mobility=np.array([*up, 0.0]),
            stiffness_balls=self._numbers.at(0),
            gap_balls=self._numbers.at(k),
            mobility_balls=self._numbers.at(2 * k),
            acceleration_balls=self._numbers.at(2 * k + n),
        )
        for i, start in enumerate([*box.displacement, *box.velocity]):
            self._state[i] = start
        self._errors, self._overlaps = np.zeros(2 * n), np.zeros(k)
        self._unit = math.floor(math.log2(scale.time)) - 2
        self._closed = np.zeros(k, dtype=bool)
        self._survey()

    def _survey(self) -> None:
        """Read the bounds of overlaps, rates and radii of the present state, and choose precision and order."""
        chain = self._chain
        self._bounds = np.zeros((4, len(chain.left)))
        largest = survey(chain, self._space, self._state.address, 1 << 12, self._bounds)
        least = math.ldexp(self.scale.speed, -self.bits)
        self.radius = max(largest[1], least)
        self._limit = self.rule.share * np.array([max(largest[0], least * self.scale.time / 16.0), self.radius])
        #: bits of the largest velocity that are proved
        self.left = max(math.log2(self.scale.speed / self.radius), 1.0)
        self._precision = int(self.left) + self.rule.guard
        self._order = min(MOST_ORDER, max(16, int(self.rule.order * self.left + 8)))

    def _classify(self) -> None:
        """Decide which contacts count as closed, and the unit of time of the step."""
        chain, (low, high, slow, fast) = self._chain, self._bounds
        certain = (low > 0.0) & self._certain
        pace = np.maximum(np.abs(slow), np.abs(fast)) + 1e-290
        lightest = np.maximum(chain.mobility[chain.left], chain.mobility[chain.right])
        # while an overlap grows fivefold, or falls to 0, a force that is neglected must not matter
        spell = np.minimum(4.0 * np.maximum(high, 0.0) / pace, 4.0 * self.scale.time)
        push = chain.stiffness * (5.0 * np.maximum(high, 0.0)) ** (0.5 * chain.doubled) * lightest * spell
        self._closed = certain & ~(push < self.rule.faint * self._limit[1])
        if self._closed.any():
            scale = 4.0 * float(np.min((high / pace)[self._closed]))
            self._unit = min(self._unit, math.floor(math.log2(scale)) if scale < 1.0 else 0)

    def advance(self, until: Fraction) -> Step:
        """Advance by one step, at most to the later time ``until``; raise Stopped if none can be proved."""
        chain, space, n = self._chain, self._space, self._n
        self._unit = min(self._unit, math.ceil(math.log2(float(until - self.time))))
        self._classify()
        moved = np.zeros(n + 1, dtype=bool)
        moved[chain.left[self._closed]] = moved[chain.right[self._closed]] = True
        order, k = self._order, len(chain.left)
        place(space, n, self._state.address, self._precision)
        expand(chain, space, self._closed, moved, order, self._unit, self._precision)
        shapes = (
            (k, order + 1),
            (k, order + 1),
            (k, order + 1),
            (k, order + 1),
            (k, 2),
            (k, space.levels + 1, order),
            (n,),
        )
        c = Coefficients(*(np.zeros(shape) for shape in shapes))
        read_coefficients(chain, space, self._closed, order, c)
        unit = math.ldexp(1.0, self._unit)
        room = np.zeros(order + 1)
        share = choose_step(chain, c, self._closed, unit, order, self._limit, room, self._errors, self._overlaps)
        if share == 0.0:
            raise Stopped(self._reason())
        step = Fraction(share) * Fraction(2) ** self._unit
        end = min(self.time + step, until)
        signs = np.zeros((2, k), dtype=np.int64)
        find_signs(chain, c, self._closed, share, unit, self._errors, self._overlaps, signs)
        most = np.nextafter(self._overlaps + self._apart()[0], np.inf)
        made = Step(begin=self.time, end=end, side=signs[0], rate=signs[1], most=most)
        self._step = self.time, self._unit, order, self._precision
        self._evaluate(end, self._state)
        self.time, self.steps = end, self.steps + 1
        self._unit += 2 if share == 1.0 else max(math.ceil(math.log2(share)) + 1, -3) if share < 0.25 else 0
        self._survey()
        return made

    def _evaluate(self, time: Fraction, target: Balls) -> None:
        """Set ``target`` to displacements and velocities at a time within the last step."""
        begin, unit, order, precision = self._step
        ratio = (time - begin) / Fraction(2) ** unit
        self._found[2 * self._n] = ratio, Fraction(0)
        evaluate_all(
            target.address, self._space, self._n, self._powers.address, self._found.at(2 * self._n), order, precision
        )
        for i, error in enumerate(self._errors.tolist()):
            ball.widen(target.at(i), error, self._space.spare)

    def _apart(self) -> tuple[Floats, Floats]:
        """Return how far overlaps (m) and their rates (m/s) may differ from the polynomials of the last step."""
        both = np.column_stack([self._errors.reshape(2, self._n), np.zeros(2)])
        apart, faster = 1.001 * (both[:, self._chain.left] + both[:, self._chain.right]) + ball.FLOOR
        return apart, faster

    def course(self, k: int) -> Course | None:
        """Return the course of the overlap of a contact within the last step, if it can be proved."""
        begin, unit, order, precision = self._step
        length = self.time - begin
        ratio, stride = length / Fraction(2) ** unit, self._space.stride
        first = {"v": 0, "s": 2 * self._n * stride}

        def series(name: str, row: int) -> list[Ball]:
            balls = [self._series[first[name] + stride * row + o] for o in range(order + 1)]
            return [(middle * ratio**o, radius * ratio**o) for o, (middle, radius) in enumerate(balls)]

        zero = [(Fraction(0), Fraction(0))] * (order + 1)
        left, right = (zero if i == self._n else series("v", i) for i in (self._chain.left[k], self._chain.right[k]))
        apart, faster = (Fraction(float(error[k])) for error in self._apart())
        return follow_overlap(
            Curve(
                begin=begin,
                length=length,
                overlap=tuple(series("s", k)),
                rate=tuple((a - b, r + q) for (a, r), (b, q) in zip(left, right, strict=True)),
                apart=apart,
                faster=faster,
                bits=precision + self.rule.guard,
            )
        )

    def state(self, time: Fraction | None = None) -> Box:
        """Return displacements and velocities now, or at a time within the last step."""
        balls = self._state
        if time is not None and time != self.time:
            balls = self._found
            self._evaluate(time, balls)
        values = [balls[i] for i in range(2 * self._n)]
        return Box(displacement=tuple(values[: self._n]), velocity=tuple(values[self._n :]))

    @property
    def side(self) -> Ints:
        """Sign of each overlap now; 0 where the balls do not tell."""
        low, high = self._bounds[:2]
        return np.asarray((self._certain & (low > 0.0)).astype(np.int64) - (self._certain & (high < 0.0)))

    @property
    def _certain(self) -> Bools:
        """Contacts whose overlap is so much larger than all radii that its sign stays certain in what follows."""
        low, high = self._bounds[:2]
        width = np.maximum(high - low, self._limit[0] / self.rule.share)
        return np.asarray(width < _CERTAIN * np.minimum(abs(low), abs(high)))

    @property
    def distance(self) -> float:
        """Time until the next touch, or since the last, at the present rates; of contacts whose side is known, s."""
        known = self.side != 0
        pace = np.maximum(np.abs(self._bounds[2]), np.abs(self._bounds[3])) + 1e-290
        return float(np.min(np.min(np.abs(self._bounds[:2]), axis=0)[known] / pace[known], initial=math.inf))

    def _reason(self) -> str:
        """Return why no step can be proved."""
        low, high = self._bounds[:2]
        unsure = [k for k in range(len(low)) if not self._closed[k] and high[k] > 0.0]
        where = f" at contact {max(unsure, key=lambda k: high[k])}" if unsure else ""
        return f"the balls are too wide{where}: {self.left:.0f} of {self.bits} bits are left"
