"""Turning points of a polynomial: against polynomials made from their roots."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.polynomial import Polynomial

from dem_bridge.backends.taylor_series import MOST_TURNS, root, turning_points

ORDER = 28
#: roots within a step of length 1; beyond it there are two at 1.5 +- i
ROOTS = {
    "one": [0.3],
    "two within a piece": [0.63, 0.70],
    "two in the first piece": [0.01, 0.11],
    "at 0, and one at once": [0.0, 4e-3],
    "at 0 twice, and two at once": [0.0, 0.0, 1e-5, 3e-3],
    "at 0, and none": [0.0],
    "none": [],
    "one in each of three pieces": [0.2, 0.5, 0.9],
}


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("name", ROOTS)
def test_every_turning_point_is_found_in_order(name: str, sign: float) -> None:
    inner = [root for root in ROOTS[name] if root > 0.0]
    polynomial = sign * Polynomial.fromroots([*inner, 1.5 + 1j, 1.5 - 1j])
    coefficients = np.zeros(ORDER + 1)
    found = np.real(polynomial.coef)
    zeros = len(ROOTS[name]) - len(inner)  # exactly 0, which a product need not be
    coefficients[zeros : zeros + len(found)] = found
    turns = np.empty(MOST_TURNS)
    count, falls = turning_points(coefficients, ORDER, 1.0, turns)
    assert turns[:count] == pytest.approx(inner, rel=1e-9)
    if inner:
        start = 0.5 * inner[0]
        assert falls == (start**zeros * np.real(polynomial(start)) > 0.0)


def test_a_sign_that_is_round_off_hides_no_turning_point() -> None:
    # exactly 0 at the start, then -1e-19 t + t^2 - t^3 / 0.01: up at 1e-19, down at 0.01
    coefficients = np.zeros(ORDER + 1)
    coefficients[1:4] = -1e-19, 1.0, -100.0
    turns = np.empty(MOST_TURNS)
    count, falls = turning_points(coefficients, ORDER, 1.0, turns)
    assert any(turn == pytest.approx(0.01) for turn in turns[(0 if falls else 1) : count : 2])


def test_a_root_that_round_off_hides_is_a_place_in_the_interval() -> None:
    # the ends differ by less than a denormal number, as velocities far ahead of the front of a precompressed chain do
    coefficients = np.zeros(ORDER + 1)
    coefficients[:2] = 5e-324, -1e-323
    assert 0.0 <= root(coefficients, ORDER, 0.0, 0.0, 0.2) <= 0.2
