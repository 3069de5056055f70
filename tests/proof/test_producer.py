"""Proofs contain what is known otherwise: exact collisions, linear contacts, conserved quantities, the reference."""

import math
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

import dem_bridge as db
from dem_bridge.errors import UnsupportedScene, UsageError
from dem_bridge.proof.flow import Box, Flow
from dem_bridge.proof.problem import measure_scale, problem_of
from dem_bridge.proof.producer import Record, choose_bits, prove_from

pytest.importorskip("flint")

from tests.helpers import proof_scenes

PAIR = db.Scene(name="pair", duration=2e-4, mass=(8.1e-3, 1e-2), stiffness=(3.98e9,), velocity=(0.8, 0.0), gap=1e-6)
THREE = db.Scene(
    name="three", duration=4e-4, mass=(8.1e-3, 1e-2, 9e-3), stiffness=(3.98e9, 7e9), velocity=(0.8, 0.0, 0.0),
    gap=(1e-6, 2e-6),
)  # fmt: skip


def _contains(ball: tuple[Fraction, Fraction], value: Fraction) -> bool:
    return abs(ball[0] - value) <= ball[1]


def _end(proof: db.Proof) -> tuple[list[tuple[Fraction, Fraction]], list[tuple[Fraction, Fraction]]]:
    last = proof.certificate["checkpoints"][-1]
    return tuple(
        [(Fraction(middle), Fraction(radius)) for middle, radius in last[key]] for key in ("displacement", "velocity")
    )  # type: ignore[return-value]


def test_a_collision_of_two_bodies_is_exact() -> None:
    proof = db.prove(PAIR)
    m, v = [Fraction(mass) for mass in PAIR.mass], Fraction(0.8)
    exact = (m[0] - m[1]) / (m[0] + m[1]) * v, 2 * m[0] / (m[0] + m[1]) * v
    assert proof.complete
    assert all(_contains(ball, value) for ball, value in zip(_end(proof)[1], exact, strict=True))
    assert max(radius for _, radius in _end(proof)[1]) < Fraction(1, 10**17)
    closes, opens = proof.touches
    assert (closes.closes, opens.closes) == (True, False)
    assert _contains(closes.time, Fraction(1e-6) / v)
    reduced = PAIR.mass[0] * PAIR.mass[1] / sum(PAIR.mass)
    depth = (1.25 * reduced * 0.8**2 / PAIR.stiffness[0]) ** 0.4
    # the constant of the contact time has 13 digits
    assert float(opens.time[0] - closes.time[0]) == pytest.approx(2.943275184325 * depth / 0.8, rel=1e-12)


def test_linear_contacts_last_half_a_period() -> None:
    scene = replace(PAIR, exponent=2.0, stiffness=(2e7,))
    closes, opens = db.prove(scene).touches
    half = math.pi * math.sqrt(scene.mass[0] * scene.mass[1] / sum(scene.mass) / scene.stiffness[0])
    assert float(opens.time[0] - closes.time[0]) == pytest.approx(half, rel=1e-14)


def test_a_chain_of_linear_contacts_contains_its_closed_form() -> None:
    # the closed form has 400 bits, and is within 1e-80 of the duration, far below the radii
    motion, proof = proof_scenes.linear_motion(), db.prove(proof_scenes.LINEAR)
    problem = problem_of(proof_scenes.LINEAR)
    record = Record(bits=proof.certificate["bits"])
    prove_from(problem, measure_scale(proof_scenes.LINEAR), record, 16)
    for i, box in enumerate(record.samples[1:], 1):
        state = motion.at(i * problem.duration / problem.count)
        balls = [*box.displacement, *box.velocity]
        assert all(_contains(ball, value) for ball, value in zip(balls, state, strict=True))
        assert max(radius for _, radius in balls) < Fraction(1, 10**20)
    touches = [(touch.contact, touch.closes) for touch in proof.touches]
    assert touches == [(contact, closes) for _, contact, closes in motion.touches]
    assert all(_contains(mine.time, time) for mine, (time, _, _) in zip(proof.touches, motion.touches, strict=True))


def test_momentum_and_energy_are_inside() -> None:
    proof = db.prove(THREE)
    _, v = _end(proof)
    mass = [Fraction(m) for m in THREE.mass]
    start = Fraction(0.8)
    momentum = sum((m * ball[0] for m, ball in zip(mass, v, strict=True)), Fraction(0))
    assert abs(momentum - mass[0] * start) <= sum(m * ball[1] for m, ball in zip(mass, v, strict=True))
    # all contacts are open at the end, so that the energy is kinetic; the radius of a square is 2 |v| r + r^2
    energy = sum(m * ball[0] ** 2 for m, ball in zip(mass, v, strict=True))
    width = sum(m * (2 * abs(ball[0]) + ball[1]) * ball[1] for m, ball in zip(mass, v, strict=True))
    assert abs(energy - mass[0] * start**2) <= width < Fraction(1, 10**15)
    assert [(touch.contact, touch.closes) for touch in proof.touches[:2]] == [(0, True), (1, True)]


def test_the_reversed_motion_contains_the_start() -> None:
    problem, scale = problem_of(THREE), measure_scale(THREE)
    zero = Fraction(0)
    start = Box(displacement=((zero, zero),) * 3, velocity=tuple((v, zero) for v in problem.velocity))
    there = Flow(problem, zero, start, scale=scale, bits=200)
    while there.time < problem.duration:
        there.advance(problem.duration)
    end = there.state()
    turned = Box(displacement=end.displacement, velocity=tuple((-v, radius) for v, radius in end.velocity))
    back = Flow(problem, zero, turned, scale=scale, bits=180)
    while back.time < problem.duration:
        back.advance(problem.duration)
    found = back.state()
    assert all(_contains(ball, zero) for ball in found.displacement)
    assert all(_contains(ball, -v) for ball, v in zip(found.velocity, problem.velocity, strict=True))
    assert max(radius for _, radius in found.velocity) < Fraction(1, 10**40)


@pytest.mark.parametrize("seed", range(4))
def test_the_reference_lies_inside_at_its_own_accuracy(seed: int) -> None:
    scene = proof_scenes.random_chain(seed, 3 + seed % 2)
    proof, run = db.prove(scene), db.solve(scene, backend="reference")
    assert proof.complete
    for name in ("velocity", "displacement"):
        error = np.abs(getattr(run, name) - getattr(proof, name)) - getattr(proof, f"{name}_radius")
        assert error.max() <= run.uncertainty[name]
    established = np.isfinite(proof.crossing_time_radius)
    assert established.sum() >= established.size - 1  # an overlap may have a minimum before its first maximum
    assert (np.isnan(run.crossing_time) == np.isnan(proof.crossing_time))[established].all()
    for name in ("peak_force", "crossing_time"):
        values, radii = getattr(proof, name), getattr(proof, f"{name}_radius")
        error, known = np.abs(getattr(run, name) - values) - radii, np.isfinite(values)
        assert (error <= run.uncertainty[name])[known].all()


@pytest.mark.parametrize("seed", range(2))
def test_a_method_that_locates_touches_lies_inside_at_its_own_accuracy(seed: int) -> None:
    scene = replace(proof_scenes.random_chain(seed, 3 + seed), samples=20)
    proof, run = db.prove(scene), db.solve(scene, backend="scipy")
    for name in ("velocity", "displacement"):
        error = np.abs(getattr(run, name) - getattr(proof, name)) - getattr(proof, f"{name}_radius")
        assert 0.0 < error.max() <= run.uncertainty[name]


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4, 104))
def test_the_reference_lies_inside_for_many_chains(seed: int) -> None:
    test_the_reference_lies_inside_at_its_own_accuracy(seed)


def test_too_few_bits_stop_the_proof_with_a_reason() -> None:
    problem, scale = problem_of(THREE), measure_scale(THREE)
    record = Record(bits=100)
    prove_from(problem, scale, record, 16)
    assert "digits are left of the 16 that are wanted" in record.reason
    assert record.checkpoints[-1].time < problem.duration


def test_scenes_and_digits_that_cannot_be_proved_are_refused_by_name() -> None:
    damped = replace(PAIR, drag=1.0)
    with pytest.raises(UnsupportedScene, match="pair cannot be proved: the scene has drag"):
        db.prove(damped)
    with pytest.raises(UnsupportedScene, match=r"exponent n = 2\.4"):
        db.prove(replace(PAIR, exponent=2.4))
    with pytest.raises(UsageError, match="digits = 0; allowed: a whole number from 1 to 60"):
        db.prove(PAIR, 0)
    problem, scale = problem_of(THREE), measure_scale(THREE)
    with pytest.raises(UsageError, match="allowed: at most 850 bits"):
        choose_bits(problem, replace(scale, growth=900.0), 16)
