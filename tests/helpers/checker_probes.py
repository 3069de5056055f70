"""Ask the parts of a checker for bounds that are known otherwise; each probe fails if a bound is too small.

The checker is given as a module, so that the same probes can be put to one with a planted fault.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from flint import fmpq, fmpq_poly
from scipy.integrate import quad
from scipy.linalg import expm

from dem_bridge.proof.checker_file import Ball, Box, Extreme, Touch, exactly
from dem_bridge.proof.checker_guess import Bond, Chain, Piece
from tests.helpers import proof_scenes, proofs

Probe = Callable[[ModuleType, Path], None]
ZERO = fmpq(0)
GRID = [fmpq(i, 64) for i in range(65)]


def chain(*, gap: float = 0.0, twice: int = 3, stiffness: float = 4.0) -> Chain:
    """Return two bodies of 0.5 and 2 kg with one contact."""
    bond = Bond(0, 1, exactly(stiffness), exactly(gap), twice)
    return Chain((fmpq(1, 2), fmpq(2)), (ZERO, fmpq(1)), (bond,))


def piece(
    x: list[list[float]], v: list[list[float]], *, root: list[float] | None = None, touching: bool = False
) -> Piece:
    """Return a piece of 1/8 s, from touch in the square root of the time."""
    polys = [tuple(fmpq_poly(list(map(exactly, c))) for c in each) for each in (x, v)]
    roots = {} if root is None else {0: fmpq_poly(list(map(exactly, root)))}
    span = (ZERO, fmpq(1, 8)) if touching else (fmpq(1, 8), ZERO)
    return Piece(ZERO, *span, polys[0], polys[1], roots, frozenset({0} if touching else ()))


def box(chain: Chain, radius: tuple[float, float] = (0.0, 0.0), x: tuple[float, float] = (0.0, 0.0)) -> Box:
    """Return a box of two bodies at rest at time 0."""
    balls = [
        tuple(Ball(exactly(m), exactly(r)) for m in middles) for middles, r in zip((x, (0.0, 0.0)), radius, strict=True)
    ]
    return Box(ZERO, balls[0], balls[1], tuple(x[0] - x[1] > float(b.gap.p) / float(b.gap.q) for b in chain.bonds))


def bounds_hold(checker: ModuleType, folder: Path) -> None:
    rng = np.random.default_rng(36)
    for _ in range(60):
        poly = fmpq_poly([fmpq(int(c), 7) for c in rng.integers(-9, 10, 5)])
        values = [poly(q) for q in GRID]
        for halvings in (0, 3):
            low, high = checker.bounds(poly, halvings)
            assert exactly(low) < min(values)
            assert max(values) < exactly(high)
        assert exactly(checker.size(poly)) > max(map(abs, values))


def defects_hold(checker: ModuleType, _: Path) -> None:
    """Compare with integrals by quadrature; a bound may be 30 times as wide."""
    cases = [
        piece([[0.0, 0.1], [0.0]], [[1.0, 0.2], [0.0, 0.1]]),  # a contact that is neglected
        piece([[0.5, 0.1], [0.0]], [[0.8], [0.1]], root=[0.7, 0.08]),  # a root that is not exact
        piece([[0.0, 0.0, 0.2], [0.0]], [[1.6], [0.0]], root=[0.4, 0.02], touching=True),
        piece([[-0.5, 0.1], [0.0]], [[0.8], [0.1]]),  # an open contact
        piece(  # velocities that follow from the force of a power 3/2
            [[0.0, 0.0, 0.25], [0.0]],
            [[1.6, 0.0, 0.0, 0.0, 0.0, -1 / 20], [0.0, 0.0, 1 / 16, 0.0, 0.0, 1 / 80]],
            root=[0.5],
            touching=True,
        ),
        piece(  # velocities that follow from a root that is not exact
            [[0.0, 0.0, 0.25], [0.0]],
            [[1.6, 0.0, 0.0, 0.0, 0.0, -1 / 20, -1 / 48], [0.0, 0.0, 1 / 16, 0.0, 0.0, 1 / 80, 1 / 192]],
            root=[0.5, 0.25],
            touching=True,
        ),
    ]
    for twice in (2, 3, 5):
        for p in cases:
            c = chain(twice=twice)
            found = checker.measure(c, p)
            for i in range(2):
                for part, true in enumerate((_off_x(p, i), _off_v(c, p, i))):
                    assert true <= found.defects[part][i] <= 30.0 * true + 1e-12, (twice, i, part)


def _value(poly: fmpq_poly, q: float) -> float:
    return float(sum(float(c.p) / float(c.q) * q**o for o, c in enumerate(poly.coeffs())))


def _off_x(p: Piece, i: int) -> float:
    slope = fmpq_poly([p.linear, 2 * p.square])
    return float(quad(lambda q: abs(_value(p.x[i].derivative() - slope * p.v[i], q)), 0.0, 1.0)[0])


def _off_v(c: Chain, p: Piece, i: int) -> float:
    slope, bond, sign = fmpq_poly([p.linear, 2 * p.square]), c.bonds[0], (-1, 1)[i]
    beta, m, steady = (float(number.p) / float(number.q) for number in (bond.stiffness, c.mass[i], c.steady[i]))

    def off(q: float) -> float:
        force = beta * max(_value(p.x[0] - p.x[1], q), 0.0) ** (bond.twice / 2)
        return float(abs(_value(p.v[i].derivative(), q) - _value(slope, q) * (steady + sign * force) / m))

    return float(quad(off, 0.0, 1.0, limit=200)[0])


def roots_are_required(checker: ModuleType, _: Path) -> None:
    """Give pieces to which Lemma 1 does not apply."""
    for bad, sentence in (
        (piece([[0.1, -0.3], [0.0]], [[0.0], [0.0]], root=[0.3]), "overlap may be negative"),
        (piece([[0.5], [0.0]], [[0.0], [0.0]], root=[0.7, -1.4]), "root may be negative"),
        (piece([[0.1, 0.0, 0.2], [0.0]], [[0.0], [0.0]], root=[0.4], touching=True), "does not begin at its touch"),
        (replace(piece([[0.5], [0.0]], [[0.0], [0.0]], root=[0.7]), square=fmpq(1, 8)), "two variables"),
    ):
        with pytest.raises(checker.NotProved, match=sentence):
            checker.measure(chain(), bad)


def tube_holds(checker: ModuleType, _: Path) -> None:
    """Compare with the exponential of the matrix of Lemma 2, at the largest slope within the errors."""
    for twice, overlap, h in ((3, 0.25, 0.23), (2, 0.25, 0.15), (5, 0.5, 0.15), (3, 0.0, 0.23), (2, -1e-12, 0.15)):
        c = chain(twice=twice)
        tube = checker.Tube(c, box(c, (1e-9, 1e-9), (overlap, 0.0)))
        more = np.array([[1e-9, 0.0], [0.0, 1e-10]])
        start = (np.array([[1e-9, 1e-9], [1e-9, 1e-9]]) + more).ravel()
        after = tube.advanced(more, [(overlap, overlap)], h).errors
        # the overlap may be larger by the errors of both bodies, which do not shrink
        slope = 4.0 * twice / 2.0 * max(overlap + start[0] + start[1], 0.0) ** (twice / 2.0 - 1.0)
        rates = np.zeros((4, 4))
        rates[0, 2] = rates[1, 3] = 1.0
        rates[2, :2], rates[3, :2] = 2.0 * slope, slope / 2.0
        true = (expm(h * rates) @ start).reshape(2, 2)
        assert np.all(after >= true * (1.0 + 2e-12))  # a part of the margin for rounding is left
        assert np.all(after <= true * (1.001 if overlap > 0.0 or twice == 2 else 1.01) + 1e-20)
        around = tube.around(0)
        assert 2e-9 <= around[0] <= 2.1e-9
        assert 2e-9 <= around[1] <= 2.1e-9


def tube_ends(checker: ModuleType, _: Path) -> None:
    """Give steps that are too long for the errors to stay in the tube, or to be bounded."""
    c = chain(twice=2, stiffness=4.0)
    tube = checker.Tube(c, box(c, (1e-9, 1e-9), (0.25, 0.0)))
    for h, sentence in ((0.294, "leave the tube"), (5.0, "grow too fast")):
        with pytest.raises(checker.NotProved, match=sentence):
            tube.advanced(np.zeros((2, 2)), [(0.25, 0.25)], h)


def at(time: int, radius: int | fmpq = 1) -> Ball:
    return Ball(fmpq(time), fmpq(radius))


def touches_are_located(checker: ModuleType, _: Path) -> None:
    """Follow an overlap through a touch in three pieces, of which the second ends nearest to it."""
    sign = checker.Sign(7, -1)
    assert not list(sign.note(-1, -1, 0, 0.0, at(1)))
    assert not list(sign.note(0, 0, 1, 0.5, at(2, 3)))
    assert not list(sign.note(0, 0, 1, 0.25, at(3)))
    assert list(sign.note(0, 1, 1, 0.5, at(4, 2))) == [Touch(7, True, Ball(fmpq(3), fmpq(4)))]
    assert not list(sign.note(0, 1, 1, 0.5, at(5, 2)))  # it comes near and does not touch
    assert list(sign.note(0, -1, -1, 2.0, at(6))) == [Touch(7, False, Ball(fmpq(6), fmpq(1, 2)))]
    unknown = checker.Sign(7, 0)
    assert not list(unknown.note(0, 0, 0, 0.0, at(1)))
    assert not list(unknown.note(0, 1, 0, 0.0, at(2)))
    assert list(unknown.note(0, -1, -1, 1.0, at(3))) == [Touch(7, False, Ball(fmpq(3), fmpq(1)))]


def touches_are_not_guessed(checker: ModuleType, _: Path) -> None:
    """Give signs that do not determine the touches."""
    turns = [(0, 0, 1, 1.0, at(1)), (0, 0, -1, 1.0, at(2)), (-1, -1, 0, 0.0, at(3))]
    unsure = [(0, 0, 0, 0.0, at(1)), (0, 1, 1, 1.0, at(2))]
    backward = [(0, 1, -1, 1.0, at(1))]
    leaps = [(1, 1, 0, 0.0, at(1))]
    for notes, sentence in (
        (turns, "more than once"),
        (unsure, "more than once"),
        (backward, "wrong direction"),
        (leaps, "leaps over"),
    ):
        with pytest.raises(checker.NotProved, match=sentence):
            _follow(checker.Sign(7, -1), notes)


def _follow(sign: Any, notes: list[tuple[int, int, int, float, Ball]]) -> None:
    for note in notes:
        list(sign.note(*note))


def pieces_continue(checker: ModuleType, _: Path) -> None:
    """Give a piece that starts late, and one that starts elsewhere."""
    c = replace(chain(gap=1.0), steady=(ZERO, ZERO))
    start = box(c, (1e-9, 1e-9))
    walk = checker.Walk(c, start, replace(start, time=fmpq(1)), 1e-3)
    away = piece([[0.25], [0.0]], [[0.0], [0.5]])
    tube = walk.around(away, checker.measure(c, away))
    assert tube.errors[0][0] >= 0.25
    assert tube.errors[1][1] >= 0.5
    with pytest.raises(checker.NotProved, match="does not continue"):
        walk.take(replace(away, center=fmpq(1, 64)), checker.measure(c, away), walk.tube)


def numbers_are_rounded_up(checker: ModuleType, _: Path) -> None:
    for value in (fmpq(1, 3), fmpq(-1, 3), fmpq(2, 3), fmpq(0), fmpq(1, 10**400), fmpq(1, 7) * 2**90):
        assert exactly(checker.claims.above(value)) > value
    assert checker.claims.above(fmpq(10) ** 400) == math.inf
    for twice, power in ((0, 1.0), (1, 2.0), (2, 4.0), (3, 8.0)):
        assert checker.claims.half_power(4.0, twice) == power


def claimed_touches_are_compared(checker: ModuleType, _: Path) -> None:
    first, second = Touch(0, True, at(1)), Touch(1, True, at(4))
    wide = [Touch(0, True, at(1, 2)), Touch(1, True, at(4, 2))]
    checker.claims.check_touches([second, first], wide)
    for proved, claimed, sentence in (
        ([first, Touch(1, True, at(3))], wide, "may be before"),
        ([first, second], [first, Touch(1, True, at(4, fmpq(1, 2)))], "outside its ball"),
        ([first], wide, "lists 2 touches of 1"),
        ([first, second], wide[::-1], "not of 1"),
    ):
        with pytest.raises(checker.NotProved, match=sentence):
            checker.claims.check_touches(proved, claimed)


#: errors of overlap and closing velocity in the pieces of a hump
OFF = (1e-3, 0.1)


def hump(kind: int, drop: float = 0.0) -> Piece:
    """Return a piece of 1/8 s whose overlap is 1 - drop - (tau - 1/4)^2, tau going from 0 to 1 or, for kind -1, back.

    The variable is tau for kind 0, and its root for the others. The overlap is largest at 1/32 s or 3/32 s.
    """
    overlap, rate = [15 / 16 - drop, 0.5, -1.0], [4.0, -16.0]
    if kind == 0:
        return piece([overlap, [0.0]], [rate, [0.0]])
    x, v = ([c for each in series for c in (each, 0.0)] for series in (overlap, rate))
    if kind == 1:
        return replace(piece([x, [0.0]], [v, [0.0]]), linear=ZERO, square=fmpq(1, 8))
    back = piece([x, [0.0]], [[-c for c in v], [0.0]])
    return replace(back, center=fmpq(1, 8), linear=ZERO, square=fmpq(-1, 8))


def watch(checker: ModuleType, claim: Extreme, kind: int = 0, *, drop: float = 0.0, known: int = 1) -> None:
    """Put a claim to the checker for a hump of one contact."""
    p = hump(kind, drop)
    # fine bounds, but for the place of the maximum
    overlaps = [(-drop - 1e-9, 1.0 - drop + 1e-9)] if drop > 1.0 else [checker.bounds(p.x[0] - p.x[1])]
    checker.Watch(chain(), (claim,), (known,)).follow(p, overlaps, lambda _: OFF)


def ball_of(middle: float, radius: float) -> Ball:
    return Ball(exactly(middle), exactly(radius))


def largest_overlaps_are_enclosed(checker: ModuleType, _: Path) -> None:
    """Claim what the error allows, and a little less than it needs."""
    for kind, time in ((0, 1 / 32), (1, 1 / 32), (-1, 3 / 32)):
        at = exactly(time)
        watch(checker, Extreme(ball_of(1.0, 0.0011), at, None), kind)
        for claim, when, sentence in (
            (ball_of(1.0, 0.0009), at, "may not be reached"),
            (ball_of(1.0003, 0.0011), at, "may not be reached"),
            (ball_of(0.9997, 0.0011), at, "may be exceeded"),
            (ball_of(1.0, 0.0011), at - fmpq(1, 64), "may not be reached"),
            (ball_of(1.0, 0.0011), at + fmpq(1, 64), "may not be reached"),
            (ball_of(0.99, 0.02), at - fmpq(1, 64), "may be exceeded"),
            (ball_of(0.99, 0.02), at + fmpq(1, 64), "may be exceeded"),
            (ball_of(0.9, 0.05), fmpq(1), "may be exceeded"),
        )[: 8 if kind == 0 else 5]:
            with pytest.raises(checker.NotProved, match=sentence):
                watch(checker, Extreme(claim, when, None), kind)
    # an overlap that is below 0 counts as 0, up to its error
    watch(checker, Extreme(ball_of(0.0, 0.0), ZERO, None), drop=1.0011)
    for drop, claim in ((1.0009, ball_of(0.0, 0.0)), (1.5, ball_of(0.01, 0.001))):
        with pytest.raises(checker.NotProved, match="largest overlap"):
            watch(checker, Extreme(claim, fmpq(1, 32), None), drop=drop)


def crossing_times_are_enclosed(checker: ModuleType, _: Path) -> None:
    """Claim crossings for a rate with the slope 128/s^2 and the error 0.1: half a radius must exceed 1/1280 s."""

    def claimed(middle: float, radius: float) -> Extreme:
        return Extreme(None, ZERO, ball_of(middle, radius))

    for kind, time in ((0, 1 / 32), (1, 1 / 32), (-1, 3 / 32)):
        watch(checker, claimed(time, 0.0017), kind)
        for middle, radius, sentence in (
            (time, 0.0015, "or earlier"),
            (time + 0.0002, 0.0017, "or earlier"),
            (time - 0.0002, 0.0017, "may be after its ball"),
            (time + 0.02, 0.0017, "or earlier"),
            (1e30, 0.0, "may be near"),
        ):
            with pytest.raises(checker.NotProved, match=sentence):
                watch(checker, claimed(middle, radius), kind)
    with pytest.raises(checker.NotProved, match="before the contact closes"):
        watch(checker, claimed(1 / 32, 0.0017), drop=0.9995)
    # a contact counts from the time at which its overlap has a sign, and until then its rate may have any
    watch(checker, claimed(1.0, 0.1), drop=0.9, known=0)
    for drop, known in ((0.9, 1), (-1.0, 0)):
        with pytest.raises(checker.NotProved, match="may be near"):
            watch(checker, claimed(1.0, 0.1), drop=drop, known=known)
    # a rate that is below 0 up to 1/16 of the piece, too
    dip = replace(hump(0), v=(fmpq_poly([-1, 20, -64]), fmpq_poly([0])))
    with pytest.raises(checker.NotProved, match="may be near"):
        checker.Watch(chain(), (claimed(1 / 32, 0.0025),), (1,)).follow(dip, [(0.1, 1.0)], lambda _: OFF)
    # an open contact may move in any way
    watch(checker, claimed(1.0, 0.1), drop=1.5)
    # an overlap may shrink until the contact opens
    falling = replace(hump(0), v=(fmpq_poly([-4, -16]), fmpq_poly([0])))
    checker.Watch(chain(), (claimed(2.0, 0.1),), (1,)).follow(falling, [(0.5, 1.0)], lambda _: OFF)
    with pytest.raises(checker.NotProved, match="or earlier"):
        checker.Watch(chain(), (claimed(1 / 32, 0.0017),), (1,)).follow(falling, [(0.5, 1.0)], lambda _: OFF)


def truth_is_proved(checker: ModuleType, folder: Path) -> None:
    for file in (proof_scenes.pair(), proof_scenes.linear()):
        assert checker.check_proof(proofs.written(file, folder), jobs=1).proved


def refuses(change: Callable[[dict[str, Any]], None]) -> Probe:
    """Return a probe that a certificate is refused after a change."""

    def probe(checker: ModuleType, folder: Path) -> None:
        file = proof_scenes.linear()
        change(file)
        assert not checker.check_proof(proofs.written(proofs.sealed(file), folder), jobs=1).proved

    return probe


def near_a_touch_is_refused(checker: ModuleType, folder: Path) -> None:
    """Give a checkpoint at the very time of a touch: the sign of an overlap is not known there."""
    motion = proof_scenes.pair_motion()
    opens = proofs.dyadic_far(motion.touches[-1][0])
    times = [proofs.dyadic(1e-6), opens + Fraction(1, 2**200), proofs.dyadic(1.1e-4)]
    file = proofs.certificate(motion, times, proof_scenes.powers((34, 30), (31, 25), (28, 22)))
    assert not checker.check_proof(proofs.written(file, folder), jobs=1).proved
