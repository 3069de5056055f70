"""Series that the checker proposes obey the equations of motion to the digits that they have."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

pytest.importorskip("flint", reason="needs python-flint, the extra proof")

from flint import fmpq, fmpq_poly

from dem_bridge.proof.checker_expand import digits, whole
from dem_bridge.proof.checker_guess import Bond, Chain, Proposer

ORDER, BITS = 24, 240
STEP = fmpq(1, 2**10)
#: coefficients lose a few digits of the 240 bits where a root of 2^-8 m divides; a fault would leave errors above 1e-12
ACCURACY = fmpq(1, 2 ** (BITS - 24))


@pytest.mark.parametrize("twice", [2, 3, 4, 5, 8])
@pytest.mark.parametrize(("linear", "square"), [(STEP, 0), (0, STEP), (0, -STEP), (2 * STEP, -STEP)])
def test_series_obey_the_equations_of_motion(twice: int, linear: fmpq, square: fmpq) -> None:
    touches, speed = linear == 0, -1 if square < 0 and linear == 0 else 1
    chain = Chain(
        (fmpq(1, 2), fmpq(3, 4), fmpq(1)),
        (fmpq(1), fmpq(-1, 4), fmpq(0)),
        tuple(Bond(i, i + 1, fmpq(5 - i), fmpq(-1, 64), twice) for i in (0, 1)),
    )
    proposer = Proposer(chain, BITS, [1e-40] * 3, 1.0)
    x, v = ([proposer.fixed(y) for y in part] for part in ([fmpq(0)] * 3, [fmpq(speed), fmpq(0), fmpq(1, 8)]))
    if touches:
        x[1:] = [x[0] - proposer.gaps[0]] * 2
    times = (proposer.fixed(fmpq(linear)), proposer.fixed(fmpq(square)))
    series = proposer._series(x, v, times, {0, 1}, {0} if touches else set(), ORDER)
    x_polys, v_polys = (
        [fmpq_poly(series.scaled(rows, proposer.one, proposer.one), proposer.one) for rows in part]
        for part in series.motion()
    )
    slope = fmpq_poly([linear, 2 * square])
    forces = [fmpq_poly([force]) for force in chain.steady]
    roots = {
        k: fmpq_poly(series.scaled(rows, proposer.one, proposer.one), proposer.one << unit)
        for k, rows, unit in series.roots()
    }
    for k, (left, right) in enumerate(pairwise(range(3))):
        overlap = x_polys[left] - x_polys[right] + fmpq(1, 64)
        start = overlap if not (touches and k == 0) else fmpq_poly(overlap.coeffs()[2:])
        force = chain.bonds[k].stiffness * start ** (twice // 2) * roots.get(k, fmpq_poly([1]))
        if k in roots:
            assert size((roots[k] * roots[k] - start).coeffs()[: ORDER - 3]) <= ACCURACY
        if start is not overlap:
            force *= fmpq_poly([0] * twice + [1])
        forces[left], forces[right] = forces[left] - force, forces[right] + force
    for mass, x_poly, v_poly, force in zip(chain.mass, x_polys, v_polys, forces, strict=True):
        assert size((x_poly.derivative() - slope * v_poly).coeffs()[: ORDER - 3]) <= ACCURACY
        assert size((mass * v_poly.derivative() - slope * force).coeffs()[: ORDER - 3]) <= ACCURACY


def size(coefficients: list[fmpq]) -> fmpq:
    """Return the largest magnitude of numbers."""
    return max(map(abs, coefficients), default=fmpq(0))


def test_numbers_of_digits_are_those_that_they_are_made_of() -> None:
    rng = np.random.default_rng(36)
    numbers = [0, 1, -1, 2**23, -(2**23), 2**190 - 1, -(2**190)]
    numbers += [int(value) << 70 for value in rng.integers(-(2**60), 2**60, 20)]
    assert [whole(row) for row in digits(numbers, 12)] == numbers
    assert all(row[-1] == np.count_nonzero(np.cumsum(np.abs(row[-2::-1]))) for row in digits(numbers, 12))
