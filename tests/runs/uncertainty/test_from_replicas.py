"""The least uncertainty of adaptive runs: further runs that agree to the last bit may all have lost the last digits."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dem_bridge.runs.uncertainty.from_replicas import (
    ODE45,
    REFERENCE,
    force_condition,
    looser_rule,
    moved_by_a_digit,
    replica_uncertainty,
    rule_of,
)
from dem_bridge.scene.scene import Damping, Scene, Wall
from tests.helpers.fake_runs import free_flight

#: the steps of a small chain
STEPS = 1000
PAIR = Scene(name="pair", duration=1e-3, mass=(1.0, 1.0), stiffness=(1e9,), velocity=(1.0, 0.0), gap=0.5)


def test_what_a_thousand_roundings_lose_is_covered_where_all_runs_agree() -> None:
    lost = []
    for seed in range(20):
        increments = np.random.default_rng([16, seed]).uniform(0.5, 1.5, STEPS).tolist()
        total, exact = 0.0, Fraction(0)
        for increment in increments:
            total += increment
            exact += Fraction(increment)
        run = free_flight(bodies=1, contacts=0, displacement=np.full((5, 1), total))
        # every other run adds the same numbers in the same order
        bar = replica_uncertainty(run, [run, run], REFERENCE)["displacement"]
        error = abs(float(Fraction(total) - exact))
        assert error <= bar
        lost.append(error / (2.0**-52 * total))
    # what they lose is more than a unit in the last place, and the bar is not much more than that
    assert 1.0 < max(lost) < 16.0


#: factors that the measured coverage of random scenes supports: samples, contacts
FACTORS = {"reference": (REFERENCE, 9.0, 9.0), "ode45": (ODE45, 2.0, 8.0), "looser": (looser_rule(PAIR), 3.0, 3.0)}


@pytest.mark.parametrize("name", FACTORS)
def test_an_uncertainty_is_the_largest_difference_times_its_factor(name: str) -> None:
    rule, samples, contacts = FACTORS[name]
    peak, crossing = np.array([100.0, 50.0, 40.0]), np.array([0.1, 0.3, 0.2])
    run = free_flight(bodies=4, contacts=3, peak_force=peak, crossing_time=crossing)
    near = replace(run, velocity=run.velocity + 1e-5, displacement=run.displacement - 1e-6)
    far = replace(
        near, velocity=run.velocity - 1e-3, displacement=run.displacement + 1e-4,
        peak_force=peak + np.array([0.3, 0.0, 0.2]), crossing_time=crossing + np.array([0.0, 1e-3, 2e-3]),
    )  # fmt: skip
    found = replica_uncertainty(run, [far, near], rule)
    speed, way = np.max(np.abs(run.velocity)), np.max(np.abs(run.displacement))
    length = 0.5 * run.cost.steps * 2.0**-52 * rule.rounded_length
    assert found["velocity"] == pytest.approx(samples * 1e-3 + 16 * 2.0**-52 * speed, rel=1e-12)
    assert found["displacement"] == pytest.approx(samples * 1e-4 + 16 * 2.0**-52 * way + length, rel=1e-9)
    # the second contact agrees by chance: it has the median of the relative differences (0.003, 0, 0.005)
    forces = contacts * np.array([0.3, 0.003 * 50.0, 0.2])
    if rule.peaks_follow_velocities:
        forces = np.maximum(forces, found["velocity"] / speed * peak)
    assert found["peak_force"] == pytest.approx(forces, rel=1e-9)
    # the second contact crosses last, and inherits the error of the third
    assert found["crossing_time"] == pytest.approx(contacts * np.array([0.0, 2e-3, 2e-3]), rel=1e-9, abs=1e-14)
    assert found["crossing_time"][0] == 16 * 2.0**-52 * run.time[-1]


def test_tolerances_of_the_largest_speed_are_the_least_of_velocities_and_with_the_duration_of_displacements() -> None:
    run = replace(free_flight(duration=2.0), provenance={"settings": {"rtol": 1e-6}})
    rule = replace(REFERENCE, tolerances=32.0)
    # 32e-6 of 3 m/s
    for moved, velocity in ((0.0, 96e-6), (1e-5, 96e-6), (1e-3, 9e-3)):
        found = replica_uncertainty(run, [replace(run, velocity=run.velocity + moved)], rule)
        assert found["velocity"] == pytest.approx(velocity, rel=1e-6)
        assert found["displacement"] == pytest.approx(2.0 * 96e-6, rel=1e-6)
        assert found["crossing_time"] == pytest.approx(2.0 * 32e-6, rel=1e-6)
    far = replica_uncertainty(run, [replace(run, displacement=run.displacement + 1e-3)], rule)
    assert far["displacement"] == pytest.approx(9e-3, rel=1e-6)


def test_displacements_beyond_a_gap_lose_its_last_digit_at_every_step() -> None:
    run = free_flight(bodies=2, contacts=1)
    run = replace(run, cost=replace(run.cost, steps=1000))
    rule = looser_rule(replace(PAIR, gap=(3.0,)))
    least = replica_uncertainty(run, [run], looser_rule(PAIR))["displacement"]
    # 1000 steps of half a unit in the last place of 3 m instead of 0.5 m
    expected = least + 0.5 * 1000 * 2.0**-52 * 2.5
    assert replica_uncertainty(run, [run], rule)["displacement"] == pytest.approx(expected, rel=1e-12, abs=0.0)


@pytest.mark.parametrize(
    ("law", "exponent", "clip", "tolerances"),
    [
        ("kuwabara-kono", 2.65, False, 32.0),
        ("kuwabara-kono", 2.65, True, 0.0),
        ("kuwabara-kono", 3.5, False, 0.0),
        ("dashpot", 2.65, False, 32.0),
        ("dashpot", 2.65, True, 0.0),
    ],
)
def test_a_damping_force_with_a_singular_end_makes_velocities_uncertain(
    law: str, exponent: float, clip: bool, tolerances: float
) -> None:
    # many-998: runs at three tolerances agreed to 1e-13 of the largest speed, and all were off by 7e-13; many-5309,
    # whose force jumps: displacements were off by 5 tolerances, and by 4.8 times the differences
    damping = Damping(law=law, coefficient=1e-6, clip=clip)
    rule = looser_rule(replace(PAIR, exponent=exponent, damping=damping))
    assert (rule.tolerances, rule.peaks_follow_velocities) == (tolerances, tolerances > 0.0)
    run = replace(free_flight(bodies=2, contacts=1), provenance={"settings": {"rtol": 3e-14}})
    speed = np.max(np.abs(run.velocity))
    uncertainty = replica_uncertainty(run, [run], rule)
    assert uncertainty["velocity"] == pytest.approx(max(tolerances * 3e-14, 16 * 2.0**-52) * speed, rel=1e-2, abs=0.0)
    assert uncertainty["displacement"] >= (1.0 - 1e-12) * tolerances * 3e-14 * speed * run.time[-1]


@pytest.mark.parametrize(
    ("velocity", "precompression", "unresolved"),
    [(14.0, 1e-9, [False, True, True]), (14.0, 0.0, [False] * 3), (0.0, 1e-9, [False] * 3), (14.0, 1e3, [False] * 3)],
)
def test_a_crossing_that_the_digits_of_a_common_velocity_may_make_has_no_finite_uncertainty(
    velocity: float, precompression: float, unresolved: list[bool]
) -> None:
    # many-768: contacts with forces of 1e-9 N crossed at 0.12 s instead of 53 s; the first two bodies meet at 1 m/s
    chain = Scene(
        name="chain", duration=1.0, mass=(1.0,) * 4, stiffness=(1e2,) * 3, wall_left=Wall(stiffness=1e2),
        velocity=(velocity + 1.0, *(velocity,) * 3), precompression=precompression,
    )  # fmt: skip
    rule = looser_rule(chain)
    assert rule.unresolved[:3].tolist() == rule_of("reference", chain).unresolved[:3].tolist() == unresolved
    run = free_flight(bodies=4, contacts=4)
    uncertainty = replica_uncertainty(run, [run], replace(rule, tolerances=0.0))
    assert np.isinf(uncertainty["crossing_time"])[:3].tolist() == unresolved


def test_a_peak_force_of_ode45_is_no_less_uncertain_than_its_velocities() -> None:
    run = free_flight(bodies=2, contacts=2)
    found = replica_uncertainty(run, [replace(run, velocity=run.velocity + 0.1)], ODE45)
    # 0.2 m/s of 2 m/s
    assert found["peak_force"] == pytest.approx(0.1 * run.peak_force, rel=1e-9)
    assert np.max(replica_uncertainty(run, [replace(run, velocity=run.velocity + 0.1)], REFERENCE)["peak_force"]) < 1e-9


@pytest.mark.parametrize(("share", "known"), [(0.0999, True), (0.1001, False)])
def test_a_crossing_that_is_uncertain_by_a_tenth_of_the_run_is_unknown(share: float, known: bool) -> None:
    run = free_flight(duration=2.0)
    other = replace(run, crossing_time=run.crossing_time + np.array([0.0, 2.0 * share / 9.0]))
    found = replica_uncertainty(run, [other], REFERENCE)["crossing_time"]
    assert found[1] == (pytest.approx(2.0 * share, rel=1e-9) if known else np.inf)
    assert np.isfinite(found[0])


@pytest.mark.parametrize(("share", "known"), [(0.99, True), (1.01, False)])
def test_a_crossing_that_is_uncertain_by_itself_is_unknown(share: float, known: bool) -> None:
    # many-946: turns of ode45 ahead of the front at 112, 6 and 1 ns, in a contact that turns at 54.7 us
    run = replace(free_flight(duration=2.0), crossing_time=np.array([0.5, 1e-6]))
    other = replace(run, crossing_time=run.crossing_time + np.array([0.0, share * 1e-6 / 8.0]))
    found = replica_uncertainty(run, [other], ODE45)["crossing_time"]
    assert np.isfinite(found).tolist() == [True, known]


def test_a_force_is_as_uncertain_as_its_overlap_times_the_power() -> None:
    scene = Scene(name="four", duration=1e-3, mass=(1.0,) * 4, stiffness=(1e9,) * 3, velocity=(1.0, 0.0, 0.0, 0.0),
                  exponent=(2.5, 50.0, 1.5))  # fmt: skip
    assert force_condition(scene).tolist() == [1.5, 49.0, 1.0]
    assert force_condition(replace(scene, exponent=2.5, law=lambda overlap: 1e6 * overlap)).tolist() == [1.0] * 3
    run = free_flight(bodies=4, contacts=3, peak_force=np.array([10.0, 30.0, 20.0]))
    for rule in (
        looser_rule(scene),
        rule_of("reference", scene),
        rule_of("ode45", replace(scene, velocity=(0.0,) * 4)),
    ):
        still = replica_uncertainty(
            replace(run, velocity=0.0 * run.velocity), [replace(run, velocity=0.0 * run.velocity)], rule
        )
        assert still["peak_force"] == pytest.approx(
            16 * 2.0**-52 * 30.0 * np.array([1.5, 49.0, 1.0]), rel=1e-12, abs=0.0
        )


def test_in_a_precompressed_chain_forces_are_no_less_uncertain_than_velocities() -> None:
    pressed = replace(PAIR, gap=0.0, precompression=1e-9)
    assert [looser_rule(scene).peaks_follow_velocities for scene in (PAIR, pressed)] == [False, True]
    assert looser_rule(replace(PAIR, gap=(-0.25,))).rounded_length == 0.25


@given(st.lists(st.floats(-1e40, 1e40).filter(lambda v: v == 0.0 or abs(v) >= 1e-40), min_size=2, max_size=2))
def test_every_speed_but_zero_moves_by_a_digit_or_two_and_stays_in_range(velocity: list[float]) -> None:
    moved = moved_by_a_digit(replace(PAIR, velocity=tuple(velocity))).velocity
    for old, new in zip(velocity, moved, strict=True):
        assert (new == old) is (old == 0.0)
        assert abs(new - old) <= 2.0 * np.spacing(abs(old))
        assert old == 0.0 or 1e-40 <= abs(new) <= 1e40
    assert (moved[0] == moved[1]) is (velocity[0] == velocity[1])
