"""Enclosures of one motion with other orders, bits, thresholds and step rules intersect, and those of the checker, too.

A fault in one of them, as a remainder that is too small, leaves enclosures without a common number: the radii are far
below the differences of the approximate motions that they enclose.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from fractions import Fraction
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

import dem_bridge as db

pytest.importorskip("flint", reason="needs python-flint, the extra proof")

from flint import arb, arb_poly, ctx, fmpq

from dem_bridge.proof.certificate import document_of
from dem_bridge.proof.checker import OF_BOX, Walk
from dem_bridge.proof.checker_file import Sample, exactly, read_certificate
from dem_bridge.proof.checker_guess import Piece
from dem_bridge.proof.flow import STEP_RULE, StepRule
from dem_bridge.proof.problem import measure_scale, problem_of
from dem_bridge.proof.producer import Record, prove_from
from tests.helpers import proofs
from tests.helpers.proof_scenes import random_chain

#: five scenes of 3 bodies: gaps, initial overlaps, walls, gravity, exponents 5/2 and 3
SCENES = [random_chain(seed, 3) for seed in range(5)]
#: midpoint and radius
Ball = tuple[Fraction, Fraction]
Enclosures = list[list[Ball]]


def settings() -> list[tuple[int, StepRule]]:
    """Return 20 pairs of bits and a rule; each value of a rule occurs with several of the others."""
    rng = np.random.default_rng(36)
    return [
        (
            int(rng.choice([250, 280, 310, 350])),
            StepRule(
                share=float(rng.choice([1e-6, 1e-5, 1e-4, 1e-3])),
                guard=int(rng.choice([24, 40, 80])),
                order=float(STEP_RULE.order * rng.choice([0.5, 0.75, 1.0, 1.5])),
                faint=float(rng.choice([1e-3, 1e-2, 0.1, 0.5])),
            ),
        )
        for _ in range(20)
    ]


def proved(scene: db.Scene, bits: int, rule: StepRule) -> Record:
    record = Record(bits=bits)
    prove_from(problem_of(scene), measure_scale(scene), record, 16, rule=rule)
    assert not record.reason
    return record


def enclosures(record: Record) -> Enclosures:
    """Return the balls of displacements and velocities at each sample time."""
    return [[*box.displacement, *box.velocity] for box in record.samples]


def of_the_checker(scene: db.Scene, record: Record, folder: Path) -> Enclosures:
    """Return the balls of the checker at each sample time, from its own pieces and errors."""
    path = proofs.written(document_of(scene, problem_of(scene), record), folder)
    file = read_certificate(path)
    found = [[(fraction(ball.middle), fraction(ball.radius)) for ball in (*file.boxes[0].x, *file.boxes[0].v)]]
    for box, target in pairwise(file.boxes):
        walk, waiting = Walk(file.chain, box, target, OF_BOX[0]), list(within(file.samples, box.time, target.time))
        for piece in walk.steps():
            while waiting and waiting[0].time <= walk.time:
                found.append(around(piece, waiting.pop(0).time, walk.tube.errors.ravel().tolist()))
    return found


def within(samples: Iterable[Sample], begin: fmpq, end: fmpq) -> Iterable[Sample]:
    return (sample for sample in samples if begin < sample.time <= end)


def around(piece: Piece, time: fmpq, errors: Sequence[float]) -> list[Ball]:
    """Return balls around a piece at a time."""
    with ctx.workprec(500):
        offset = time - piece.center
        q = arb(offset / piece.linear) if piece.linear else arb(offset / piece.square).sqrt()
        values = [arb_poly(poly)(q) for poly in (*piece.x, *piece.v)]
        return [
            (fraction(value.mid().fmpq()), fraction(value.rad().fmpq() + exactly(error)))
            for value, error in zip(values, errors, strict=True)
        ]


def fraction(value: fmpq) -> Fraction:
    return Fraction(int(value.p), int(value.q))


def apart(several: Sequence[Enclosures]) -> int:
    """Return how many numbers at all sample times have enclosures without a common value."""
    count = 0
    for boxes in zip(*several, strict=True):
        for balls in zip(*boxes, strict=True):
            low = max(middle - radius for middle, radius in balls)
            count += low > min(middle + radius for middle, radius in balls)
    return count


def check_independence(scene: db.Scene, chosen: Sequence[tuple[int, StepRule]], folder: Path) -> None:
    """Require all enclosures to intersect, and none with those of a motion that begins elsewhere by 1e-30 m/s."""
    several = [enclosures(proved(scene, bits, rule)) for bits, rule in chosen]
    plain = proved(scene, 280, STEP_RULE)
    several += [enclosures(plain), of_the_checker(scene, plain, folder)]
    assert apart(several) == 0
    widest = max(radius for boxes in several for balls in boxes for _, radius in balls)
    assert 0 < widest < Fraction(1, 10**16)
    moved = [[(middle + 2 * widest, radius) for middle, radius in balls] for balls in several[0]]
    assert apart([moved, several[-1]]) > 0


def test_enclosures_of_other_settings_and_of_the_checker_intersect(tmp_path: Path) -> None:
    check_independence(replace(SCENES[1], samples=12), settings()[:2], tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("scene", SCENES, ids=lambda scene: scene.name)
def test_enclosures_of_twenty_settings_and_of_the_checker_intersect(tmp_path: Path, scene: db.Scene) -> None:
    check_independence(scene, settings(), tmp_path)
