"""Chains in equilibrium: forces balance on every body, and overlaps carry them to the last digit."""

from __future__ import annotations

import math
from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dem_bridge.physics.statics import static_forces, static_overlap
from tests.helpers.strategies import log_uniform

EPS = 2.0**-52

masses_of = st.lists(log_uniform(1e-4, 1e2), min_size=1, max_size=6)


@given(masses=masses_of, force=log_uniform(1e-6, 1e4), gravity=st.sampled_from([9.81, -3.7, 500.0]))
def test_forces_on_every_body_balance_its_weight_where_a_wall_bears_it(
    masses: list[float], force: float, gravity: float
) -> None:
    bears = {"wall_left": gravity < 0.0, "wall_right": gravity > 0.0}
    forces = static_forces(masses, force=force, gravity=gravity, **bears)
    assert len(forces) == len(masses) + 1
    for i, mass in enumerate(masses):
        # each sum is rounded once
        assert forces[i] - forces[i + 1] + mass * gravity == pytest.approx(0.0, abs=2.0 * EPS * max(forces))
    # the end that bears nothing has the force itself
    assert (forces[0] if gravity > 0.0 else forces[-1]) == force


@pytest.mark.parametrize(("gravity", "left", "right"), [(0.0, True, True), (9.81, True, False), (-9.81, False, True)])
def test_where_no_wall_bears_the_weight_the_force_is_the_same_everywhere(
    gravity: float, left: bool, right: bool
) -> None:
    forces = static_forces((1.0, 2.0, 3.0), force=5.0, gravity=gravity, wall_left=left, wall_right=right)
    assert forces == (5.0,) * 4


@given(force=log_uniform(1e-9, 1e6), stiffness=log_uniform(1e3, 1e12))
def test_a_hertzian_overlap_is_the_double_nearest_to_the_root(force: float, stiffness: float) -> None:
    # exact: (F/beta)^2 = delta^3 in fractions; half an ulp to either side must straddle it
    overlap = static_overlap(force, stiffness, 2.5)
    wanted = (Fraction(force) / Fraction(stiffness)) ** 2
    below, above = (Fraction(math.nextafter(overlap, way)) + Fraction(overlap) for way in (0.0, math.inf))
    assert (below / 2) ** 3 <= wanted <= (above / 2) ** 3


@given(force=log_uniform(1e-9, 1e6), exponent=st.floats(1.5, 4.0))
def test_the_overlap_of_any_law_carries_the_force(force: float, exponent: float) -> None:
    overlap = static_overlap(force, 1e9, exponent)
    # a rounding of the overlap is (n - 1) times one of the force
    assert 1e9 * math.pow(overlap, exponent - 1.0) == pytest.approx(force, rel=4.0 * exponent * EPS)


def test_a_linear_contact_gives_way_in_proportion() -> None:
    assert static_overlap(12.0, 3e6, 2.0) == 4e-6


def test_what_no_double_holds_is_0_or_infinity() -> None:
    assert static_overlap(1e30, 1e-30, 1.0001) == math.inf
    assert static_overlap(1e-30, 1e30, 1.0001) == 0.0
