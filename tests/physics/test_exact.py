"""Two bodies, walls, equal masses, scaling: identities, quadrature, direct integration, quadruple-precision truth."""

from __future__ import annotations

import inspect
import math
import typing

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad, solve_ivp

import dem_bridge as db
from dem_bridge.physics import exact
from dem_bridge.physics.exact import (
    TwoBodyCollision,
    equal_mass_transfer,
    scaling,
    two_body_collision,
    wall_rebound,
)
from dem_bridge.scene.scene import Scene, Wall
from tests.helpers.quadruple_truth import Truth
from tests.helpers.strategies import log_uniform, stiffness_for

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


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ({"masses": (0.0, 1.0)}, r"^masses\[0\] = 0.0; allowed: a finite number > 0 \(kg\)$"),
        ({"masses": (math.inf, 1.0)}, r"^masses\[0\] = inf; allowed: a finite number > 0"),
        ({"masses": (1.0, math.nan)}, r"^masses\[1\] = nan; allowed: a finite number > 0 \(kg\), or inf for a wall$"),
        ({"stiffness": -4e9}, r"^stiffness = -4000000000.0; allowed: a finite number > 0"),
        ({"exponent": 1.0}, r"^exponent = 1.0; allowed: a finite number > 1$"),
        ({"velocities": (math.inf, 0.0)}, r"^closing velocity = inf m/s; allowed: > 0"),
    ],
)
def test_what_is_outside_the_formula_is_refused_in_one_line(wrong: dict[str, object], says: str) -> None:
    good: dict[str, object] = {"masses": (1.0, 1.0), "velocities": (1.0, 0.0), "stiffness": 1.0, "exponent": 2.5}
    with pytest.raises(ValueError, match=says):
        two_body_collision(**(good | wrong))  # type: ignore[arg-type]


@pytest.mark.parametrize("n", [1.6, 2.0, 2.5, 3.7])
def test_a_rebound_is_that_of_direct_integration(n: float) -> None:
    m, v, beta = 0.02, 0.7, stiffness_for(n, 4e9)
    bounce = wall_rebound(mass=m, velocity=v, stiffness=beta, exponent=n)
    # in units of the overlap L = (m v^2/beta)^(1/n) and the time L/v: x'' = -x_+^(n-1)
    length = (m * v**2 / beta) ** (1.0 / n)

    def touch(t: float, y: np.ndarray) -> float:
        return float(y[0]) if t > 0.1 else 1.0

    def turn(_: float, y: np.ndarray) -> float:
        return float(y[1])

    touch.terminal = True  # type: ignore[attr-defined]
    run = solve_ivp(
        lambda _, y: [y[1], -(max(y[0], 0.0) ** (n - 1.0))], (0.0, 10.0), [0.0, 1.0],
        method="DOP853", rtol=1e-12, atol=1e-14, events=(touch, turn),
    )  # fmt: skip
    # the force is not smooth at touch: the integrator keeps some 1e-8 there for n < 2, where its slope is infinite
    bound = 1e-7 if n < 2.0 else 1e-9
    assert bounce.contact_time == pytest.approx(run.t_events[0][0] * length / v, rel=bound)
    assert bounce.half_time == pytest.approx(run.t_events[1][0] * length / v, rel=bound)
    assert bounce.peak_overlap == pytest.approx(run.y_events[1][0][0] * length, rel=bound)
    assert bounce.exit_velocity == pytest.approx(run.y_events[0][0][1] * v, rel=bound)
    assert bounce.peak_force == pytest.approx(beta * (run.y_events[1][0][0] * length) ** (n - 1.0), rel=n * bound)


@given(m=masses, v=closing_speeds, n=exponents)
def test_the_wall_takes_what_the_force_gives(m: float, v: float, n: float) -> None:
    bounce = wall_rebound(mass=m, velocity=v, stiffness=stiffness_for(n, 4e9), exponent=n)
    assert (bounce.exit_velocity, bounce.impulse) == (-v, 2.0 * m * v)
    # the mean force is the impulse over the contact time; the shape of the peak lies between a triangle and a box
    assert 0.5 * bounce.peak_force * 0.5 < bounce.impulse / bounce.contact_time < bounce.peak_force


def test_a_rebound_is_that_of_a_simulated_body_on_a_wall() -> None:
    scene = Scene(
        name="bounce", duration=1e-4, mass=(0.01,), stiffness=(), velocity=(0.8,), wall_right=Wall(stiffness=4e9)
    )
    run = db.solve(scene, backend="reference", uncertainty=False)
    bounce = wall_rebound(mass=0.01, velocity=0.8, stiffness=4e9, exponent=2.5)
    assert run.peak_force[0] == pytest.approx(bounce.peak_force, rel=1e-13)
    assert run.crossing_time[0] == pytest.approx(bounce.half_time, rel=1e-13)
    assert run.velocity[-1, 0] == pytest.approx(bounce.exit_velocity, rel=1e-13)


@given(m=masses, v=closing_speeds, shift=st.floats(-10.0, 10.0), n=exponents)
def test_equal_bodies_exchange_their_velocities_and_all_else_is_a_collision(
    m: float, v: float, shift: float, n: float
) -> None:
    beta, velocities = stiffness_for(n, 4e9), (shift + v, shift)
    if not velocities[0] > velocities[1]:
        return
    hit = equal_mass_transfer(mass=m, velocities=velocities, stiffness=beta, exponent=n)
    other = two_body_collision(masses=(m, m), velocities=velocities, stiffness=beta, exponent=n)
    assert hit.exit_velocity == velocities[::-1]
    assert other.exit_velocity == pytest.approx(hit.exit_velocity, abs=8.0 * EPS * (v + abs(shift)))
    assert (hit.contact_time, hit.peak_force) == (other.contact_time, other.peak_force)


factors = log_uniform(1e-3, 1e3)


@given(n=exponents, s=factors, b=factors, m=factors, masses=st.tuples(masses, masses))
def test_scaling_is_that_of_the_collision(n: float, s: float, b: float, m: float, masses: tuple[float, float]) -> None:
    m1, m2 = masses
    beta = stiffness_for(n, 4e9)
    one = two_body_collision(masses=(m1, m2), velocities=(0.7, -0.2), stiffness=beta, exponent=n)
    two = two_body_collision(masses=(m * m1, m * m2), velocities=(0.7 * s, -0.2 * s), stiffness=b * beta, exponent=n)
    by = scaling(exponent=n, velocity=s, stiffness=b, mass=m)
    lost = 200.0 * EPS  # roots and powers of numbers of up to 1e15
    assert two.contact_time == pytest.approx(by.time * one.contact_time, rel=lost)
    assert two.peak_overlap == pytest.approx(by.displacement * one.peak_overlap, rel=lost)
    assert two.peak_force == pytest.approx(by.force * one.peak_force, rel=lost)
    assert two.exit_velocity == pytest.approx([by.velocity * u for u in one.exit_velocity], abs=1e-14 * s)
    # identities of dimensions
    assert by.energy == pytest.approx(by.force * by.displacement, rel=lost)
    assert by.momentum == pytest.approx(by.force * by.time, rel=lost)
    assert by.acceleration == pytest.approx(by.velocity / by.time, rel=lost)
    assert by.damping == pytest.approx(by.force / by.velocity, rel=lost)


@pytest.mark.parametrize("n", [2.5, 2.0, 3.2])
def test_a_whole_chain_with_gaps_and_gravity_scales(n: float) -> None:
    by = scaling(exponent=n, velocity=3.0, stiffness=0.2, mass=7.0)
    beta = [stiffness_for(n, b) for b in (4e9, 7e9, 2e9)]
    one = Scene(
        name="one", duration=2e-4, mass=(0.01, 0.02, 0.005, 0.01), stiffness=tuple(beta), exponent=n,
        velocity=(0.8, 0.0, 0.0, -0.1), gap=(0.0, 1e-6, -2e-7), gravity=50.0, samples=50,
    )  # fmt: skip
    two = Scene(
        name="two", duration=one.duration * by.time, mass=tuple(7.0 * m for m in one.mass),
        stiffness=tuple(0.2 * b for b in beta), exponent=n, velocity=tuple(3.0 * v for v in one.velocity),
        gap=tuple(g * by.displacement for g in (0.0, 1e-6, -2e-7)), gravity=50.0 * by.acceleration, samples=50,
    )  # fmt: skip
    first, second = (db.solve(scene, backend="scipy", uncertainty=False) for scene in (one, two))
    # scipy is good to 1e-11 on scenes like this
    assert np.max(np.abs(second.velocity / by.velocity - first.velocity)) < 1e-9 * 0.8
    assert second.peak_force / by.force == pytest.approx(first.peak_force, rel=1e-9)
    assert np.max(np.abs(second.displacement / by.displacement - first.displacement)) < 1e-9 * 1e-4


@pytest.mark.parametrize("name", ["velocity", "stiffness", "mass"])
def test_factors_must_be_positive(name: str) -> None:
    with pytest.raises(ValueError, match=rf"^{name} = 0.0; allowed: a finite number > 0"):
        scaling(exponent=2.5, **{name: 0.0})


#: functions of few numbers without a motion, whose answer is a number
NUMBERS = {
    "alpha_of_restitution", "alpha_of_tsuji", "bounce_heights", "linear_restitution", "pull_off_force",
    "restitution_obtained", "restitution_of_alpha", "restitution_to_write",
}  # fmt: skip


def test_every_solution_takes_keywords_and_answers_with_a_frozen_dataclass() -> None:
    solutions = {name: thing for name in exact.__all__ if inspect.isfunction(thing := getattr(exact, name))}
    assert len(solutions) == 12 + len(NUMBERS)
    for name, solution in solutions.items():
        assert ">>>" in (solution.__doc__ or ""), name
        assert f":func:`{name}`" in (exact.__doc__ or ""), name
        answer = typing.get_type_hints(solution, include_extras=True)["return"]
        if name in NUMBERS:
            assert answer in (float, tuple[float, ...]), name
            continue
        parameters = inspect.signature(solution).parameters.values()
        assert {p.kind for p in parameters} == {inspect.Parameter.KEYWORD_ONLY}, name
        assert vars(exact)[answer.__name__].__dataclass_params__.frozen, name
