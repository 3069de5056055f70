"""The two-body collision: identities between its parts, a quadrature, and the quadruple-precision truth."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad

from dem_bridge.physics.exact import TwoBodyCollision, two_body_collision
from tests.strategies import log_uniform, stiffness_for
from tests.truth import Truth

EPS = float(np.finfo(float).eps)

masses = log_uniform(1e-6, 1e3)
closing_speeds = log_uniform(1e-3, 1e2)
exponents = st.floats(1.5, 4.0)


def _collision(m1: float, m2: float, v: float, n: float, shift: float = 0.0) -> tuple[TwoBodyCollision, float]:
    stiffness = stiffness_for(n, 4e9)
    hit = two_body_collision(masses=(m1, m2), velocities=(v + shift, shift), stiffness=stiffness, exponent=n)
    return hit, stiffness


@given(m1=masses, m2=masses, v=closing_speeds, n=exponents)
def test_momentum_and_kinetic_energy_are_the_same_before_and_after(m1: float, m2: float, v: float, n: float) -> None:
    u1, u2 = _collision(m1, m2, v, n)[0].exit_velocity
    # each exit velocity is a difference of numbers of magnitude 2 v: a few ulps of those, weighed by its mass
    assert m1 * u1 + m2 * u2 == pytest.approx(m1 * v, abs=8.0 * EPS * (m1 + m2) * v)
    before, scale = 0.5 * m1 * v**2, 8.0 * EPS * 2.0 * (m1 + m2) * v**2
    assert 0.5 * m1 * u1**2 + 0.5 * m2 * u2**2 == pytest.approx(before, abs=scale)


@given(m1=masses, m2=masses, v=closing_speeds, n=exponents)
def test_the_bodies_part_as_fast_as_they_met(m1: float, m2: float, v: float, n: float) -> None:
    u1, u2 = _collision(m1, m2, v, n)[0].exit_velocity
    assert u2 - u1 == pytest.approx(v, abs=8.0 * EPS * v)


@given(m1=masses, m2=masses, v=closing_speeds, n=exponents)
def test_all_relative_kinetic_energy_is_stored_at_the_peak(m1: float, m2: float, v: float, n: float) -> None:
    hit, stiffness = _collision(m1, m2, v, n)
    stored = stiffness * hit.peak_overlap**n / n
    # a root and a power of it: the exponents (at most 4) magnify an ulp and the rounding of 1/n
    assert stored == pytest.approx(0.5 * m1 * m2 / (m1 + m2) * v**2, rel=100.0 * EPS)
    assert hit.peak_force == pytest.approx(n * stored / hit.peak_overlap, rel=100.0 * EPS)


@given(m1=masses, m2=masses, v=closing_speeds, n=exponents)
def test_contact_time_is_twice_the_quadrature_over_the_overlap(m1: float, m2: float, v: float, n: float) -> None:
    hit, _ = _collision(m1, m2, v, n)
    # dt = dx / sqrt(v^2 - 2 beta x^n / (n mu)); with x = d sin(q)^(2/n) this is
    # t = (2 d / (n v)) int_0^(pi/2) sin(q)^(2/n - 1) dq

    def regular(q: float) -> float:
        return (math.sin(q) / q) ** (2.0 / n - 1.0) if q > 0.0 else 1.0

    integral, _ = quad(regular, 0.0, math.pi / 2.0, weight="alg", wvar=(2.0 / n - 1.0, 0.0), epsabs=0.0, epsrel=1e-12)
    assert hit.half_time == pytest.approx(2.0 * hit.peak_overlap / (n * v) * integral, rel=1e-11)  # the quadrature's
    assert hit.contact_time == 2.0 * hit.half_time


@given(m1=masses, m2=masses, v=closing_speeds, n=exponents, shift=st.floats(-10.0, 10.0))
def test_a_moving_observer_sees_the_same_collision(m1: float, m2: float, v: float, n: float, shift: float) -> None:
    rest, moving = _collision(m1, m2, v, n)[0], _collision(m1, m2, v, n, shift)[0]
    lost = 8.0 * EPS * (v + abs(shift))  # rounding of v + shift
    assert moving.exit_velocity == pytest.approx([u + shift for u in rest.exit_velocity], abs=lost)
    assert moving.peak_force == pytest.approx(rest.peak_force, rel=4.0 * lost / v + 100.0 * EPS)


def test_the_printed_number_of_contact_times_per_overlap_and_speed() -> None:
    hit, _ = _collision(1.0, 1.0, 1.0, 2.5)
    assert hit.contact_time / hit.peak_overlap == pytest.approx(2.943275184325, abs=0.5e-12)  # 13 digits of PHYSICS.md


def test_a_linear_spring_takes_half_a_period() -> None:
    hit = two_body_collision(masses=(2.0, 3.0), velocities=(1.5, -0.5), stiffness=7.0, exponent=2.0)
    assert hit.contact_time == pytest.approx(math.pi * math.sqrt(1.2 / 7.0), rel=8.0 * EPS)


def test_a_wall_is_the_limit_of_a_heavy_second_body() -> None:
    hit = two_body_collision(masses=(1e-2, 1e18), velocities=(0.8, 0.0), stiffness=4e9, exponent=2.5)
    assert hit.exit_velocity == pytest.approx((-0.8, 0.0), abs=8.0 * EPS)


def test_the_collision_is_that_of_the_truth_file(two_bodies: Truth) -> None:
    data, scene = two_bodies.data, two_bodies.scene
    m1, m2 = scene.mass
    hit = two_body_collision(
        masses=(m1, m2), velocities=(two_bodies.v0, 0.0), stiffness=scene.stiffness[0], exponent=2.5
    )
    # the truth is rounded to doubles; a root, a power and two Gamma functions here
    assert hit.peak_force == pytest.approx(data["F_peak"][0], rel=20.0 * EPS)
    assert hit.half_time == pytest.approx(data["t_cross"][0], rel=20.0 * EPS)
    assert hit.contact_time == pytest.approx(data["t_open_first"][0], rel=20.0 * EPS)
    assert hit.exit_velocity == pytest.approx(data["v"][-1].tolist(), abs=8.0 * EPS * two_bodies.v0)


@pytest.mark.parametrize("velocities", [(0.0, 0.0), (0.5, 0.8), (math.nan, 0.0)])
def test_bodies_that_do_not_close_in_are_refused(velocities: tuple[float, float]) -> None:
    with pytest.raises(ValueError, match="closing velocity"):
        two_body_collision(masses=(1.0, 1.0), velocities=velocities, stiffness=1.0, exponent=2.5)
