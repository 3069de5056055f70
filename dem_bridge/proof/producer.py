"""Prove the motion of a scene: enclosures at the sample times, and all touches in their order.

The proof goes from checkpoint to checkpoint. At each, the box is widened and the motion of all starts in the wider box
is proved anew, so that a checker with less room than this program can prove that each box goes into the next.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from fractions import Fraction

from dem_bridge.errors import UsageError
from dem_bridge.foundation import progress
from dem_bridge.foundation.compiled import Ints
from dem_bridge.proof.extremes import Extreme, Extremes, look, overlap_in
from dem_bridge.proof.flow import STEP_RULE, Box, Flow, Step, StepRule, Stopped
from dem_bridge.proof.problem import Problem, Scale
from dem_bridge.proof.turns import Ball

#: number of checkpoints, and what their boxes are widened by: room for the checker
CHECKPOINTS, WIDER = 30, 64
#: no radius of a box is below this part of the largest of its kind
_EVEN = Fraction(1, 1000)
#: checkpoints lie at multiples of this part of the shortest time
_GRID = 2.0**-20
#: a checkpoint is at least this part of the shortest time from every touch; 1/4 of it where there is none such
_QUIET = 0.02
#: bits beside those that radii lose and the digits that are wanted; bits beyond which doubles cannot bound them
_SPARE, MOST_BITS = 24, 850


@dataclass(frozen=True, kw_only=True)
class Touch:
    """A contact that closes or opens, with the ball of the time, s."""

    contact: int
    closes: bool
    time: Ball


@dataclass(frozen=True, kw_only=True)
class Checkpoint:
    """A box at an exact time; ``closed``: contacts whose overlap is proved to be above 0."""

    time: Fraction
    box: Box
    closed: tuple[bool, ...]


@dataclass(kw_only=True)
class Record:
    """What is proved so far, up to the last checkpoint."""

    bits: int
    checkpoints: list[Checkpoint] = field(default_factory=list)
    touches: list[Touch] = field(default_factory=list)
    samples: list[Box] = field(default_factory=list)
    extremes: list[Extreme] = field(default_factory=list)
    """Largest overlap and first maximal compression of each contact."""
    reason: str = ""
    """Why the proof ends before the scene does."""


class _Sides:
    """The side of each contact through the steps, and the touches that follow."""

    def __init__(self, side: Ints, time: Fraction) -> None:
        self._side, self._since = side.tolist(), [time] * len(side)
        self._rates: list[set[int]] = [set() for _ in self._side]
        self.touches: list[Touch] = []

    def follow(self, step: Step, now: Ints) -> None:
        """Note a step and the sides ``now``; raise Stopped where it cannot be told whether a contact touched."""
        for k, (side, rate) in enumerate(zip(step.side.tolist(), step.rate.tolist(), strict=True)):
            before = self._side[k]
            if before == 0 and now[k] == 0:
                continue
            if side == 0:
                self._rates[k].add(rate)
                continue
            if before != 0 and (self._rates[k] or side != before):
                if len(self._rates[k]) != 1 or 0 in self._rates[k]:
                    raise Stopped(f"contact {k} comes so near to a touch that it cannot be told whether it touches")
                if side != before:
                    self.touches.append(_touch(k, side > 0, self._since[k], step.begin))
            self._side[k], self._since[k] = side, step.end
            self._rates[k].clear()

    def known(self, flow: Flow) -> bool:
        """Return True if the side of each contact is known now that was known before."""
        return all(now != 0 or before == 0 for now, before in zip(flow.side.tolist(), self._side, strict=True))


def _touch(contact: int, closes: bool, first: Fraction, last: Fraction) -> Touch:
    """Return a touch between two times, widened for the checker."""
    return Touch(contact=contact, closes=closes, time=((first + last) / 2, (last - first) / 2 * WIDER))


def choose_bits(problem: Problem, scale: Scale, digits: int) -> int:
    """Return the bits that a proof to ``digits`` digits of the largest velocity needs."""
    wanted = digits * math.log2(10.0) + scale.growth + CHECKPOINTS * math.log2(WIDER) + _SPARE
    if wanted > MOST_BITS:
        raise UsageError(
            f"{digits} digits at the end of this scene need {wanted:.0f} bits, because radii grow by {scale.growth:.0f}"
            f" bits; allowed: at most {MOST_BITS} bits; prove a shorter duration or fewer digits"
        )
    return max(96, math.ceil(wanted))


def widened(box: Box) -> Box:
    """Return a box that contains another with room for the checker, of numbers with few digits."""
    parts = []
    for balls in (box.displacement, box.velocity):
        floor = _EVEN * max(radius for _, radius in balls)
        parts.append(tuple(_short(middle, WIDER * max(radius, floor)) for middle, radius in balls))
    return Box(displacement=parts[0], velocity=parts[1])


def _short(middle: Fraction, radius: Fraction) -> Ball:
    """Return a ball around another with three digits of the radius, and as many of the middle as it deserves."""
    if radius == 0:
        return middle, radius
    unit = Fraction(10) ** (math.floor(math.log10(radius)) - 3)
    rounded = round(middle / unit) * unit
    return rounded, (math.ceil((radius + abs(rounded - middle)) / unit)) * unit


def prove_from(
    problem: Problem,
    scale: Scale,
    record: Record,
    digits: int,
    keep: Callable[[Record], None] = lambda record: None,
    rule: StepRule = STEP_RULE,
) -> None:
    """Continue a proof from its last checkpoint to the end of the scene, or until it cannot go on.

    Parameters
    ----------
    problem, scale : Problem, Scale
        The scene.
    record : Record
        What is proved; it grows.
    digits : int
        Wanted digits of the largest velocity. With fewer left the proof ends.
    keep : callable
        Called with the record at each checkpoint.
    rule : StepRule
        How steps are chosen.
    """
    if not record.checkpoints:
        start = Box(displacement=((Fraction(0), Fraction(0)),) * len(problem.mass),
                    velocity=tuple((v, Fraction(0)) for v in problem.velocity))  # fmt: skip
        record.checkpoints.append(_checkpoint(problem, Fraction(0), start))
        record.samples.append(start)
        record.extremes = look(problem, [Extreme()] * len(problem.left), start, Fraction(0))
    try:
        while (last := record.checkpoints[-1]).time < problem.duration:
            flow = Flow(problem, last.time, last.box, scale=scale, bits=record.bits, rule=rule)
            _prove_segment(flow, record, digits)
            keep(record)
    except Stopped as reason:
        record.reason = str(reason)


def _prove_segment(flow: Flow, record: Record, digits: int) -> None:
    """Prove the motion up to the next checkpoint."""
    problem, sides, extremes = flow.problem, _Sides(flow.side, flow.time), Extremes(record.extremes, flow.side)
    samples: list[Box] = []
    interval = problem.duration / CHECKPOINTS
    soonest = (flow.time // interval + 1) * interval
    grid = Fraction(2.0 ** math.floor(math.log2(_GRID * flow.scale.time)))
    until = problem.duration
    while True:
        step = flow.advance(until)
        sides.follow(step, flow.side)
        extremes.follow(step, flow.course)
        while (time := (len(record.samples) + len(samples)) * problem.duration / problem.count) <= step.end:
            if len(record.samples) + len(samples) > problem.count:
                break
            samples.append(flow.state(time))
        progress.report(float(flow.time / problem.duration))
        if flow.left < digits * math.log2(10.0):
            raise Stopped(f"{flow.left / math.log2(10.0):.0f} digits are left of the {digits} that are wanted")
        if flow.time == until:
            break
        if (
            until == problem.duration
            and soonest <= flow.time
            and sides.known(flow)
            and _is_quiet(flow, soonest, interval)
        ):
            until = min(problem.duration, (flow.time // grid + 1) * grid)
    record.checkpoints.append(_checkpoint(problem, flow.time, widened(flow.state())))
    record.touches += sorted(sides.touches, key=lambda touch: touch.time[0])
    record.samples += samples
    record.extremes = look(problem, extremes.now, flow.state(), flow.time)


def _is_quiet(flow: Flow, soonest: Fraction, interval: Fraction) -> bool:
    """Return True if no contact is near a touch; less distance counts as the next checkpoint is overdue."""
    overdue = flow.time > soonest + interval / 2
    return flow.distance > _QUIET * flow.scale.time * (0.25 if overdue else 1.0)


def _checkpoint(problem: Problem, time: Fraction, box: Box) -> Checkpoint:
    overlaps = (overlap_in(problem, box, k) for k in range(len(problem.left)))
    return Checkpoint(time=time, box=box, closed=tuple(middle > radius for middle, radius in overlaps))
