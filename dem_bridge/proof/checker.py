r"""Check a proved trajectory: prove that the flow of a scene takes each box of a file into the next.

**Theorem.** If :func:`check_proof` says "proved", the solution of

    x_i' = v_i,    m_i v_i' = c_i -+ beta_k max(d_k, 0)^(p_k) of its contacts k,    d_k = x_left - x_right - gap_k

that starts at the exact numbers of the scene lies, at each checkpoint and each sample time, in the balls of the file;
every touch of the file happens within its ball of times, in this order, and no contact closes or opens otherwise; the
largest overlaps and the times of first maximal compression are in their balls (:mod:`.checker_extremes`).
(A contact with gap 0 may begin at d = 0; its touches count from a time at which d is proved to have a sign, before the
first checkpoint at which it has one.)
Walls have x = 0. The power p_k is 1, 3/2, 2, ... 4.

Nothing but the claims is taken from the file. Pieces of an approximate motion X(t), V(t) come from
:mod:`~dem_bridge.proof.checker_guess`, whose results need not be right: polynomials with rational coefficients in a
variable q in [0, 1], with ``t = center + linear q + square q^2``. They are measured here in exact arithmetic.

**Lemma 1 (defect).** On [0, 1] a polynomial is at most the sum of the magnitudes of its coefficients. Let g be the
overlap D of X or, in a contact ``touching`` at q = 0, D/q^2, and s a polynomial with s >= s0 > 0. If g >= 0, then
``|sqrt(g) - s| = |g - s^2|/(sqrt(g) + s) <= |g - s^2|/s0``. So ``beta D^p`` differs from the polynomial
``beta g^[p] s``, times ``q^(2p)`` if touching, by at most ``beta sup(g)^[p] |g - s^2|/s0``; [p] is p without the half,
and where p is whole there is no s and no error. A contact without such a polynomial is neglected: its force is a
function of time between 0 and ``beta sup(max(D, 0))^p``. The defects of a piece are bounds of the integrals of
``|X' - V|`` and ``|V' - force(X)/m|`` over it. They may vary with time in any way.

**Lemma 2 (tube).** Let a, b bound |x - X| and |v - V| at the start of a piece of duration h, plus its defects. In the
tube ``|d - D| <= w`` the force of a contact has a slope of at most ``k = beta p max(sup D + w, 0)^(p-1)``, since it is
differentiable, at a touch as well, or for p = 1 made of two lines. Hence, as long as the solution is in the tube,
``|x - X| <= a + int |v - V|`` and ``m |v - V| <= m b + int sum of k (|x - X| of both ends)``. The right-hand sides
increase with the differences, so that these are at most the solution ``exp(tM)(a, b)`` of the equations, which is at
most R if ``R >= (a, b) + h M R``; the solution stays in the tube if R is inside. At the end, the differences are at
most the series of the exponential up to order j - 1 plus ``(hM)^j R/j!``. X and x are compared at equal times, so that
touches need nothing else.

**Lemma 3 (touch).** If d has one sign at the start of an interval and the other at its end, and its rate keeps the sign
and exceeds u > 0 in magnitude, d passes 0 exactly once. If it is at most z at some time of the interval, the touch is
within z/u of this time.

Floats hold bounds of errors only: sums of products of non-negative numbers, whose rounding is covered by ``INFLATION``.
What is assumed: the rational arithmetic of FLINT, its balls where samples are evaluated, Python, and this text.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from copy import copy
from dataclasses import dataclass, field
from itertools import pairwise
from multiprocessing import get_context
from pathlib import Path
from typing import NamedTuple

import numpy as np
from flint import arb, arb_poly, ctx, fmpq, fmpq_poly, fmpz
from numpy.typing import NDArray

from dem_bridge.proof import checker_file as claims
from dem_bridge.proof.checker_extremes import HALVINGS, Watch, bounds, difference
from dem_bridge.proof.checker_file import Ball, Box, Extreme, NotProved, Sample, Touch, above, exactly, require, shown
from dem_bridge.proof.checker_guess import Bond, Chain, Piece, Proposer
from dem_bridge.scene.scene import Scene

Floats = NDArray[np.float64]
#: errors are multiplied by this after each piece: it covers fewer than 1e4 roundings of 1.2e-16 each, in factors and
#: sums that are not negative; SMALLEST is added for products below the range of floats
INFLATION, SMALLEST = 1.0 + 1e-11, 1e-290
#: order of the series of the exponential of a tube, and most steps to its bound R
TAYLOR, MOST_PICARD = 8, 60
#: defects of a piece are accepted up to this part of the errors, and up to these parts of the radius of the next box:
#: the second and third are tried where the ones before have left the box (neither decides whether a proof is right)
OF_ERROR, OF_BOX = 2.0**-13, (2.0**-24, 2.0**-60, 2.0**-100)
#: bits of the polynomials beyond the defects, most bits, and most pieces between two checkpoints
GUARD_BITS, MOST_BITS, MOST_PIECES = 48, 2500, 20_000


def size(poly: fmpq_poly) -> float:
    """Return a bound of the magnitude of a polynomial on [0, 1]."""
    return above(fmpq(sum(map(abs, poly.numer().coeffs()), fmpz(0)), poly.denom()))


class Measured(NamedTuple):
    """Defects of displacements and velocities over a piece (Lemma 1), and bounds of its overlaps."""

    defects: Floats
    overlaps: list[tuple[float, float]]


def measure(chain: Chain, piece: Piece) -> Measured:
    """Return the defects of a piece; raise NotProved if a root has the wrong sign."""
    require(piece.linear == 0 or piece.square == 0, "a piece has two variables")
    slope, span = fmpq_poly([piece.linear, 2 * piece.square]), above(abs(piece.linear + piece.square))
    forces, error = [fmpq_poly([c]) for c in chain.steady], np.zeros(len(chain.mass))
    overlaps = []
    for k, bond in enumerate(chain.bonds):
        overlap = difference(bond, piece.x) - bond.gap
        overlaps.append(bounds(overlap))
        if k in piece.roots:
            law, unsure = force_of(bond, overlap, piece.roots[k], k in piece.touching)
        else:
            law, unsure = fmpq_poly([0]), above(bond.stiffness) * claims.half_power(overlaps[-1][1], bond.twice)
        for body, sign in bond.ends:
            forces[body] += sign * law
            error[body] += span * unsure
    mass = np.array([-above(-m) for m in chain.mass])
    off_x = [size(x.derivative() - slope * v) for x, v in zip(piece.x, piece.v, strict=True)]
    off_v = [size(m * v.derivative() - slope * f) for m, v, f in zip(chain.mass, piece.v, forces, strict=True)]
    return Measured(np.array([off_x, (np.array(off_v) + error) / mass]), overlaps)


def force_of(bond: Bond, overlap: fmpq_poly, root: fmpq_poly, touching: bool) -> tuple[fmpq_poly, float]:
    """Return the polynomial of a force and a bound of its error (Lemma 1)."""
    g, law = overlap, fmpq_poly([bond.stiffness])
    if touching:
        require(overlap[0] == 0 and overlap[1] == 0, "a piece does not begin at its touch")
        g, law = fmpq_poly(overlap.coeffs()[2:]), law * fmpq_poly([0] * bond.twice + [1])
    require(bounds(g)[0] >= 0.0, "an overlap may be negative")
    law *= g ** (bond.twice // 2)
    if bond.twice % 2 == 0:
        return law, 0.0
    least = bounds(root)[0]
    require(least > 0.0, "a root may be negative")
    unsure = claims.half_power(bounds(g)[1], bond.twice - 1) * size(root * root - g) / least
    return law * root, above(bond.stiffness) * unsure


class Tube:
    """Bounds ``errors`` of the distances of displacements and velocities from the approximate motion (Lemma 2)."""

    def __init__(self, chain: Chain, box: Box) -> None:
        wall, ends = len(chain.mass), [(bond.left, bond.right) for bond in chain.bonds]
        self.errors = claims.radii(box)
        self.left, self.right = (
            np.array([wall if pair[i] is None else pair[i] for pair in ends], dtype=np.int64) for i in (0, 1)
        )
        self.mobility = np.array([1.0 / -above(-m) for m in chain.mass])
        self.laws = [(above(bond.stiffness), bond.twice) for bond in chain.bonds]

    def around(self, k: int) -> tuple[float, float]:
        """Return the errors of the overlap and of the closing velocity of a contact."""
        far = np.hstack([self.errors, np.zeros((2, 1))])
        errors = (far[:, self.left[k]] + far[:, self.right[k]]) * INFLATION
        return float(errors[0]), float(errors[1])

    def advanced(self, more: Floats, overlaps: list[tuple[float, float]], h: float) -> Tube:
        """Return the tube after a time h with overlaps in these bounds, if ``more`` is added to it at the start."""
        start = self.errors + more
        wide = 4.0 * float(np.max(start[0] + h * start[1])) + SMALLEST
        highest = [(*law, most + wide) for law, (_, most) in zip(self.laws, overlaps, strict=True)]
        slopes = np.array([(d > 0.0) * b * p / 2 * claims.half_power(d, p - 2) for b, p, d in highest])

        def rates(errors: Floats) -> Floats:
            """Return h M errors."""
            far, force = np.append(errors[0], 0.0), np.zeros(len(errors[0]) + 1)
            pull = slopes * (far[self.left] + far[self.right])
            np.add.at(force, self.left, pull)
            np.add.at(force, self.right, pull)
            return np.array([h * errors[1], h * self.mobility * force[:-1]])

        bound = start
        for _ in range(MOST_PICARD):
            more = (start + rates(bound)) * INFLATION
            if np.all(more <= bound):
                break
            bound = 1.01 * np.maximum(bound, more) + SMALLEST
        else:
            raise NotProved("the errors grow too fast for the length of a piece")
        require(2.0 * float(bound[0].max()) <= wide, "the errors leave the tube")
        term = total = start
        for order in range(1, TAYLOR):
            term, bound = rates(term) / order, rates(bound) / order
            total = total + term
        tube = copy(self)
        tube.errors = (total + rates(bound) / TAYLOR) * INFLATION + SMALLEST
        return tube


@dataclass
class Sign:
    """The proved sign of an overlap (0: not yet), and what is known since it was last proved (Lemma 3)."""

    contact: int
    sign: int
    slope: int | None = None
    speed: float = math.inf
    near: list[Ball] = field(default_factory=list)

    def note(self, always: int, last: int, slope: int, speed: float, end: Ball) -> Iterator[Touch]:
        """Take the sign over a piece and at its end, and the sign and least size of its rate; yield the touch proved.

        ``end`` is the time of the end of the piece, with a bound of the overlap then.
        """
        if always == 0:
            self.slope = slope if self.slope in (None, slope) else 0
            self.speed = min(self.speed, speed)
            self.near.append(end)
        if (now := always or last) == 0:
            return
        if self.sign and self.near:
            near = f"contact {self.contact} near t = {shown(end.middle)} s"
            require(self.slope != 0, f"{near} may touch more than once")
            if now != self.sign:
                require(self.slope == now, f"{near} passes a touch in the wrong direction")
                best = min(self.near, key=lambda ball: ball.radius)
                yield Touch(self.contact, now > 0, Ball(best.middle, best.radius / exactly(self.speed)))
        require(now == self.sign or self.sign == 0 or bool(self.near), f"contact {self.contact} leaps over a touch")
        self.sign, self.slope, self.speed, self.near = now, None, math.inf, []


class Walk:
    """Follow the flow from one box, piece by piece, into the next."""

    def __init__(self, chain: Chain, box: Box, target: Box, of_box: float) -> None:
        self.chain, self.box, self.target, self.time = chain, box, target, box.time
        self.state = [[ball.middle for ball in balls] for balls in (box.x, box.v)]
        self.tube, self.touches, self.pieces = Tube(chain, box), list[Touch](), 0
        self.known, self.overlaps = claims.signs_in(chain, box), list[tuple[float, float]]()
        self.signs = [Sign(k, sign) for k, sign in enumerate(self.known)]
        self.floor = of_box * claims.radii(target)
        least, fastest = float(self.allowed().min()), max(1.0, *(above(abs(v)) for v in self.state[1]))
        require(0.0 < least < math.inf, "a ball of a checkpoint has no radius, or none that is a float")
        gaps = max(int(bond.gap.q).bit_length() for bond in chain.bonds) if chain.bonds else 0
        bits = max(gaps, GUARD_BITS - math.floor(math.log2(least)))
        require(bits <= MOST_BITS, f"the balls are so small that a proof needs more than {MOST_BITS} bits")
        self.proposer = Proposer(chain, bits, (self.allowed()[1] / 4.0).tolist(), fastest)

    def allowed(self) -> Floats:
        """Return the defects that a piece may have."""
        return np.maximum(self.floor, OF_ERROR * self.tube.errors)

    def steps(self) -> Iterator[Piece]:
        """Yield the pieces up to the time of the target, after each has been accounted for."""
        while self.time < self.target.time:
            self.pieces += 1
            require(self.pieces <= MOST_PIECES, f"a proof needs more than {MOST_PIECES} pieces between two checkpoints")
            allowed = self.allowed()
            self.proposer.tolerance = (allowed[1] / 4.0).tolist()
            x, v = ([self.proposer.fixed(value) for value in each] for each in self.state)
            for piece in self.proposer.pieces(x, v, self.time, self.target.time):
                try:
                    measured = measure(self.chain, piece)
                    good = bool(np.all(measured.defects <= allowed))
                    tube = self.around(piece, measured) if good else self.tube
                except NotProved:
                    good = False
                if good:
                    break
            else:
                raise NotProved(f"no piece is exact enough after t = {shown(self.time)} s")
            self.take(piece, measured, tube)
            self.overlaps = measured.overlaps
            yield piece

    def around(self, piece: Piece, measured: Measured) -> Tube:
        """Return the tube around a piece at its end, where it is widest."""
        first, both = fmpq(piece.square < 0), zip((piece.x, piece.v), self.state, strict=True)
        jumps = [[above(abs(p(first) - y)) for p, y in zip(polys, state, strict=True)] for polys, state in both]
        h = above(abs(piece.linear + piece.square))
        return self.tube.advanced(measured.defects + np.array(jumps), measured.overlaps, h)

    def take(self, piece: Piece, measured: Measured, tube: Tube) -> None:
        """Advance time, state, tube and signs by a piece."""
        first, last = (0, 1) if piece.square >= 0 else (1, 0)
        starts, ends = piece.center + first * piece.square, piece.center + last * piece.square + piece.linear
        require(self.time == starts < ends <= self.target.time, "a piece does not continue the one before")
        self.tube, self.time = tube, ends
        self.state = [[poly(fmpq(last)) for poly in polys] for polys in (piece.x, piece.v)]
        for k, bond in enumerate(self.chain.bonds):
            sign, refined = self.signs[k], HALVINGS if self.signs[k].sign else 0
            off, off_rate = self.tube.around(k)
            low, high = measured.overlaps[k]
            if refined and low <= off and high >= -off:
                low, high = measured.overlaps[k] = bounds(difference(bond, piece.x) - bond.gap, refined)
            always, slope, speed = sign_of(low - off, high + off), 0, 0.0
            if always == 0:
                low, high = bounds(difference(bond, piece.v), refined)
                slope, speed = sign_of(low - off_rate, high + off_rate), max(low - off_rate, -high - off_rate)
            at_end = sum((-way * self.state[0][body] for body, way in bond.ends), -bond.gap)
            last = int(at_end > exactly(off)) - int(at_end < -exactly(off))
            self.touches += sign.note(always, last, slope, speed, Ball(ends, abs(at_end) + exactly(off)))

    def arrive(self) -> None:
        """Prove that the flow is in the target, where the signs of all overlaps are known that were known before."""
        balls_of = ((self.target.x, "displacement"), (self.target.v, "velocity"))
        for (balls, name), state, errors in zip(balls_of, self.state, self.tube.errors.tolist(), strict=True):
            for body, (ball, value, error) in enumerate(zip(balls, state, errors, strict=True)):
                off, where = abs(value - ball.middle), f"its ball at t = {shown(self.time)} s"
                if off > ball.radius + exactly(error):
                    raise claims.Disproved(f"the {name} of body {body} is outside {where}")
                require(off + exactly(error) <= ball.radius, f"the {name} of body {body} may leave {where}")
        for k, sign in enumerate(claims.signs_in(self.chain, self.target)):
            faint = sign == self.known[k] == 0 and all(touch.contact != k for touch in self.touches)
            require(faint or sign == self.signs[k].sign, f"contact {k} is too near a touch at t = {shown(self.time)} s")


def sign_of(low: float, high: float) -> int:
    """Return the sign of all numbers between two bounds, or 0."""
    return int(low > 0.0) - int(high < 0.0)


def check_sample(sample: Sample, piece: Piece, tube: Tube, bits: int) -> None:
    """Prove that the flow is in the balls of a sample within a piece; the tube is that of its end."""
    with ctx.workprec(bits):
        offset = sample.time - piece.center
        q = arb(offset / piece.linear) if piece.linear else arb(offset / piece.square).sqrt()
        both = ((sample.x, piece.x), (sample.v, piece.v))
        for (balls, polys), errors in zip(both, tube.errors.tolist(), strict=True):
            for ball, poly, error in zip(balls, polys, errors, strict=True):
                inside = abs(arb_poly(poly)(q) - arb(ball.middle)) + arb(error) <= arb(ball.radius)
                require(bool(inside), f"the sample at t = {shown(sample.time)} s may be outside its ball")


def check_segment(
    chain: Chain, box: Box, target: Box, samples: tuple[Sample, ...], extremes: tuple[Extreme, ...]
) -> tuple[list[Touch], int]:
    """Prove that the flow takes one box into the next and through the samples between; return touches and pieces."""
    reason = NotProved("")
    for of_box in OF_BOX:
        try:
            walk, waiting = Walk(chain, box, target, of_box), list(samples)
            watch = Watch(chain, extremes, walk.known)
            for piece in walk.steps():
                watch.follow(piece, walk.overlaps, walk.tube.around)
                while waiting and waiting[0].time <= walk.time:
                    check_sample(waiting.pop(0), piece, walk.tube, walk.proposer.bits)
            walk.arrive()
            return walk.touches, walk.pieces
        except claims.Disproved:
            raise
        except NotProved as error:
            reason = error
    raise reason


def check_proof(path: str | Path, scene: Scene | None = None, jobs: int = 2) -> claims.Check:
    """Prove the claims of a file, or return the first reason why they are not established.

    Parameters
    ----------
    path : str or Path
        Certificate, a JSON file; OSError if it cannot be read.
    scene : Scene, optional
        Scene that the file must be about.
    jobs : int
        Number of processes; the segments between checkpoints are independent of each other.
    """
    try:
        file = claims.read_certificate(path)
        if scene is not None:
            claims.check_scene(file, scene)
        claims.check_start(file)
        tasks = [
            (file.chain, box, target, tuple(s for s in file.samples if box.time < s.time <= target.time), file.extremes)
            for box, target in pairwise(file.boxes)
        ]
        results = list(_run(tasks, jobs))
        claims.check_touches([touch for touches, _ in results for touch in touches], file.touches)
    except NotProved as error:
        return claims.Check(False, f"not proved: {error}")
    except ArithmeticError as error:
        return claims.Check(False, f"not proved: numbers are out of the range of floats ({error})")
    pieces = sum(count for _, count in results)
    counts = f"{len(tasks)} segments, {len(file.touches)} touches and {len(file.samples)} samples"
    return claims.Check(True, f"proved: {counts} of {file.name}, in {pieces} pieces", len(tasks), pieces)


def _run(
    tasks: list[tuple[Chain, Box, Box, tuple[Sample, ...], tuple[Extreme, ...]]], jobs: int
) -> Iterator[tuple[list[Touch], int]]:
    """Check segments, several at a time."""
    if jobs <= 1 or len(tasks) <= 1:
        yield from (check_segment(*task) for task in tasks)
        return
    count, context = min(jobs, len(tasks)), get_context("spawn")
    with ProcessPoolExecutor(count, context, initializer=claims.end_with, initargs=(os.getpid(),)) as pool:
        try:
            yield from pool.map(check_segment, *zip(*tasks, strict=True))
        finally:
            pool.shutdown(wait=True, cancel_futures=True)
