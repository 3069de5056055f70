"""The wave front by the crossing definition, against the truth and on made-up trajectories."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import KroghInterpolator

import dem_bridge as db
from dem_bridge.ensembles.draw import Variation
from dem_bridge.errors import UsageError
from dem_bridge.observables.fits import speed_power_law
from dem_bridge.observables.front import (
    arrival,
    arrival_uncertainty,
    difference_of_fewer,
    front_speed,
    front_speed_uncertainty,
    local_speed_constant,
    local_stiffness,
    peak_velocity_of_front,
    residence_time,
    residence_time_uncertainty,
)
from dem_bridge.observables.registry import OBSERVABLES
from dem_bridge.scene.scene import Scene, Wall
from dem_bridge.trajectory.trajectory import Trajectory
from tests.conftest import Solve
from tests.helpers.fake_runs import free_flight, uncertain
from tests.helpers.quadruple_truth import Truth
from tests.helpers.strategies import examples, log_uniform
from tests.helpers.waves import travelling_wave, uniform_chain

EPS = float(np.finfo(float).eps)
#: mass, stiffness, exponent, gap, duration and samples of chains with a maximum between samples: by the difference at
#: the peak alone the uncertainty was too small by the factor in brackets
UNRESOLVED: dict[str, tuple[Any, ...]] = {
    "a contact opens and closes between samples (4e4)": (
        (0.001085, 0.001502, 0.001363), (9.007e10, 3.927e9), 2.0, (1.413e-8, 0.0), 3.159e-4, 480
    ),
    "the same at shorter intervals (3e3)": (
        (0.001085, 0.001502, 0.001363), (9.007e10, 3.927e9), 2.0, (1.413e-8, 0.0), 3.159e-4, 960
    ),
    "two polynomials cross at the peak (77)": (
        (0.004876, 0.00868, 0.00472, 0.001073, 0.003813, 0.002552, 0.004767),
        (8.337e9, 4.767e10, 1.21e9, 7.905e9, 4.066e10, 3.738e9), 2.0,
        (4.686e-7, 0.0, 0.0, 0.0, 2.217e-6, 6.163e-6), 5.015e-4, 960,
    ),
}  # fmt: skip
wave_speed = OBSERVABLES["wave_speed"].value

THREE = Scene(
    name="three", duration=1.0, mass=(1.0,) * 3, stiffness=(1.0, 1.0), velocity=(1.0, 0.0, 0.0), spacing=18e-3
)


def test_arrivals_are_the_crossings_of_the_chains_contacts_without_the_walls() -> None:
    scene = replace(THREE, wall_left=Wall(stiffness=1.0), wall_right=Wall(stiffness=1.0))
    run = free_flight(contacts=4, crossing_time=[0.1, 0.3, 0.7, 0.9])
    assert arrival(scene, run)[1:].tolist() == [0.1, 0.3]
    assert residence_time(scene, run)[1:-1] == pytest.approx([0.2], rel=4.0 * EPS)


def test_a_body_that_the_impulse_never_reaches_has_no_arrival_and_no_residence() -> None:
    run = free_flight(crossing_time=[0.1, math.nan])
    assert np.isnan(arrival(THREE, run)[1:]).tolist() == [False, True]
    assert np.isnan(residence_time(THREE, run)[1:-1]).tolist() == [True]


def test_an_arrival_is_a_copy_that_can_be_changed() -> None:
    run = free_flight()
    arrival(THREE, run)[1] = 5.0
    assert run.crossing_time[0] == 0.1


def test_the_speed_is_the_spacing_over_the_residence_time() -> None:
    run = free_flight(crossing_time=[1e-5, 3e-5])
    assert wave_speed(THREE, run)[1:-1] == pytest.approx([18e-3 / 2e-5], rel=8.0 * EPS)


def test_a_scene_without_spacing_has_no_speed_in_metres_and_the_message_says_what_to_add() -> None:
    assert np.all(np.isnan(wave_speed(replace(THREE, spacing=None), free_flight())))
    scene = replace(db.load_scene("decelerating-40"), spacing=None)
    with pytest.raises(UsageError, match=r"decelerating-40 has no spacing; .*\[chain\] spacing = "):
        speed_power_law(scene, free_flight(bodies=41, contacts=40))


def test_two_bodies_have_an_arrival_but_no_residence() -> None:
    pair = Scene(name="pair", duration=1.0, mass=(1.0, 1.0), stiffness=(1.0,), velocity=(1.0, 0.0), spacing=1.0)
    run = free_flight(bodies=2, contacts=1)
    assert len(arrival(pair, run)[1:]) == 1
    assert len(residence_time(pair, run)[1:-1]) == len(wave_speed(pair, run)[1:-1]) == 0


def test_residence_times_of_the_papers_chains_are_those_of_the_truth(free_chain: Truth, solved: Solve) -> None:
    found = residence_time(free_chain.scene, solved(free_chain.scene, "reference"))[1:-1]
    # differences of times that are good to 1e-10: of arrivals up to 0.6 ms, over residences of 10 us
    assert found == pytest.approx(free_chain.data["residence"], rel=1e-10 * 60)


def test_the_twin_finds_the_same_residence_times_within_its_bars(free_chain: Truth, solved: Solve) -> None:
    run = solved(free_chain.scene, "verlet", dt=1e-8)
    uncertainties = run.uncertainty["crossing_time"]
    error = np.abs(residence_time(free_chain.scene, run)[1:-1] - free_chain.data["residence"])
    assert np.all(error <= uncertainties[1:] + uncertainties[:-1])


def test_the_wave_slows_down_and_speeds_up_as_the_scenes_are_named(solved: Solve) -> None:
    for name, sign in (("decelerating-40", -1.0), ("accelerating-40", 1.0)):
        scene = db.load_scene(name)
        speed = wave_speed(scene, solved(scene, "verlet", dt=1e-7, uncertainty=False))[1:-1]
        # the paper's figure 3: monotone from the third cylinder on, to the one before the free end
        assert np.all(sign * np.diff(speed[2:-1]) > 0.0)


def test_the_bar_of_a_residence_is_that_of_both_crossings() -> None:
    run = free_flight(uncertainty=uncertain(crossing_time=[1e-3, 5e-3]))
    assert residence_time_uncertainty(THREE, run)[1:-1] == pytest.approx([6e-3], rel=4 * EPS)
    assert arrival_uncertainty(THREE, run)[1:].tolist() == [1e-3, 5e-3]


@pytest.mark.parametrize(("each", "largest"), [(1e-6, 5e4 / 9.0), (1e-5, math.inf)])
def test_the_uncertainty_of_a_speed_is_its_largest_change_within_that_of_the_residence_time(
    each: float, largest: float
) -> None:
    # 20 us less 2 us are 18 us, and 1/18 is larger than 1/20 by a ninth of it; less 20 us nothing is left
    run = free_flight(crossing_time=[1e-5, 3e-5], uncertainty=uncertain(crossing_time=[each, each]))
    assert front_speed_uncertainty(THREE, run)[1:-1] == pytest.approx([largest], rel=1e-12)


def test_the_speed_in_bodies_needs_no_spacing() -> None:
    run = free_flight(crossing_time=[1e-5, 3e-5])
    assert front_speed(replace(THREE, spacing=None), run)[1:-1] == pytest.approx([5e4], rel=8.0 * EPS)


@pytest.mark.parametrize(("per_residence", "bound"), [(2.0, 2e-5), (4.0, 5e-9), (8.0, 2e-12)])
def test_the_peak_velocity_of_a_wave_is_found_between_samples_within_what_is_said(
    per_residence: float, bound: float
) -> None:
    scene, run, wave = travelling_wave(per_residence=per_residence + 0.137)  # peaks at all places between samples
    peak = peak_velocity_of_front(scene, run)
    inner = slice(1, -1)
    error = np.abs(peak.velocity[inner] - wave.peak_velocity)
    assert np.max(error) < bound * wave.peak_velocity
    assert np.all(error <= peak.sampling[inner] + 4e-13 * wave.peak_velocity)
    # halfway between the peaks of both contacts; a maximum is flat, so its place has the root of the error
    halfway = 0.5 * (run.crossing_time[1:] + run.crossing_time[:-1])
    assert peak.time[inner] == pytest.approx(halfway, abs=math.sqrt(bound) / wave.speed)
    largest_sample = np.max(run.velocity, axis=0)[inner]
    assert np.all(error <= np.abs(largest_sample - wave.peak_velocity) + 4e-13 * wave.peak_velocity)


def test_the_bar_of_a_peak_velocity_is_that_of_the_run_and_of_the_samples() -> None:
    scene, run, _ = travelling_wave(uncertainty=uncertain(velocity=1e-3))
    peak = peak_velocity_of_front(scene, run)
    assert np.all(peak.uncertainty == peak.sampling + 1e-3)


def test_peak_velocities_are_computed_once_for_a_run_and_again_for_a_changed_run_or_scene() -> None:
    scene, run, _ = travelling_wave(per_residence=2.137)
    peak = peak_velocity_of_front(scene, run)
    assert peak_velocity_of_front(replace(scene), run) is peak
    faster = peak_velocity_of_front(scene, replace(run, velocity=2.0 * run.velocity))
    assert faster.velocity[1] > 1.9 * peak.velocity[1]
    heavier = peak_velocity_of_front(replace(scene, mass=tuple(2.0 * mass for mass in scene.mass)), run)
    assert not np.array_equal(heavier.velocity, peak.velocity)
    assert not peak.velocity.flags.writeable


def test_the_striker_is_fastest_at_the_start_and_the_last_body_when_it_flies_off(solved: Solve) -> None:
    scene = db.load_scene("accelerating-40")
    run = solved(scene, "reference", samples=2000, uncertainty=False)
    peak = peak_velocity_of_front(scene, run)
    assert (peak.velocity[0], peak.time[0]) == (0.8, 0.0)
    assert peak.velocity[-1] == run.velocity[-1, -1]


def test_only_the_leading_pulse_counts(solved: Solve) -> None:
    # the striker of this chain is hit by what comes back; body 1 is faster in the second pulse than it is in the first
    scene = replace(THREE, spacing=None)
    velocity = np.array([[1.0, 0.0, 0.0], [0.2, 0.5, 0.0], [0.1, 0.1, 0.4], [0.0, 0.9, 0.3], [0.0, 0.9, 0.3]])
    run = free_flight(velocity=velocity, crossing_time=[0.2, 0.4])
    assert peak_velocity_of_front(scene, run).velocity.tolist() == [1.0, 0.5, 0.4]


def test_a_velocity_that_is_gained_after_the_crossing_does_not_count() -> None:
    # body 14 is fastest 0.3 us after it hands the impulse on, within the same interval of 1.5 us
    chain = db.load_scene("accelerating-40")
    one = Variation(scene=chain, vary={"angle": 5.0}).block(0, 156).scene(chain, 155)
    coarse, fine = (db.solve(one, backend="reference", samples=n, uncertainty=False) for n in (2000, 30_000))
    peak = peak_velocity_of_front(one, coarse)
    assert peak.time[14] == coarse.crossing_time[14]
    # counted, the later maximum is larger by 1.5e-4
    assert peak.velocity[14] == pytest.approx(peak_velocity_of_front(one, fine).velocity[14], rel=1e-9)


#: m/s^2: how fast the acceleration of the body below falls, per s
BEND = 3.0


def _bent(top: float, *, handed: float = 0.9, fastest: float = 2.0) -> Trajectory:
    """Body 1 of three has the velocity ``fastest - BEND (t - top)^2 / 2`` and hands the impulse on at a time."""
    time = np.linspace(0.0, 1.0, 21)
    velocity = np.stack([0.5 + 0.0 * time, fastest - 0.5 * BEND * (time - top) ** 2, 0.1 + 0.0 * time], axis=1)
    behind = 10.0 + 0.0 * time
    force = np.stack([behind - BEND * (time - top), behind], axis=1)  # bodies of 1 kg
    return free_flight(
        samples=20, velocity=velocity, contact_force=force, crossing_time=[0.05, handed],
        uncertainty=uncertain(velocity=0.01, crossing_time=[1e-3, 2e-3]),
    )  # fmt: skip


@pytest.mark.parametrize("top", [0.42, 0.44, 0.46, 0.48])
def test_a_maximum_is_uncertain_by_the_time_in_which_a_parabola_falls_by_twice_the_uncertainty(top: float) -> None:
    peak = peak_velocity_of_front(THREE, _bent(top))
    assert (peak.velocity[1], peak.time[1]) == pytest.approx((2.0, top), rel=1e-12)
    assert peak.sampling[1] == pytest.approx(0.0, abs=1e-13)
    # v - BEND t^2 / 2 falls by 2 * 0.01 m/s
    assert peak.time_uncertainty[1] == pytest.approx(math.sqrt(4.0 * 0.01 / BEND), rel=1e-9)
    # bodies 0 and 2 have no maximum
    assert np.isinf(peak.time_uncertainty[[0, 2]]).all()


def test_a_body_that_is_still_accelerated_when_it_hands_on_is_fastest_then() -> None:
    peak = peak_velocity_of_front(THREE, _bent(0.8, handed=0.33))
    assert (peak.velocity[1], peak.time[1]) == pytest.approx((2.0 - 0.5 * BEND * 0.47**2, 0.33), rel=1e-12)
    # it gains 3 * 0.47 m/s^2 times the uncertainty of the crossing
    assert peak.sampling[1] == pytest.approx(BEND * 0.47 * 2e-3, rel=1e-9)
    assert peak.time_uncertainty[1] == 2e-3


def test_a_maximum_at_the_crossing_itself_is_a_maximum() -> None:
    at = float(peak_velocity_of_front(THREE, _bent(0.43)).time[1])
    peak = peak_velocity_of_front(THREE, _bent(0.43, handed=at))
    assert peak.time[1] == at
    assert peak.time_uncertainty[1] == pytest.approx(math.sqrt(4.0 * 0.01 / BEND), rel=1e-9)


def test_a_body_that_never_moves_forward_has_no_peak() -> None:
    for run in (_bent(0.43, fastest=-1e-3), free_flight(velocity=np.ones((5, 3)) * [1.0, 0.0, 2.0])):
        peak = peak_velocity_of_front(THREE, run)
        assert np.isnan(peak.velocity).tolist() == np.isnan(peak.time).tolist() == [False, True, False]


def _differences(v: np.ndarray, a: np.ndarray, when: float) -> tuple[np.ndarray, np.ndarray]:
    """Second writing, by divided differences: differences of six from four samples, and of four from two."""
    h = 1.0 / (len(v) - 1)
    around = np.clip(when + np.linspace(-h, h, 9), 0.0, 1.0)
    values = []
    for nodes in (6, 4, 2):
        of_nodes = []
        for t in around:
            first = int(np.clip(math.floor(t / h) - nodes // 2 + 1, 0, len(v) - nodes))
            rows = np.repeat(np.arange(first, first + nodes), 2)
            given = np.where(np.arange(2 * nodes) % 2, a[rows], v[rows])
            of_nodes.append(float(KroghInterpolator(rows * h, given)(t)))
        values.append(np.array(of_nodes))
    six, four, two = values
    return six - four, four - two


@pytest.mark.parametrize("when", [0.02, 0.47, 0.99])
@pytest.mark.parametrize("ratio", [0.028, 0.032, 1.0])
def test_polynomials_that_do_not_converge_count_with_both_differences_twice(when: float, ratio: float) -> None:
    time, rng = np.linspace(0.0, 1.0, 17), np.random.default_rng(4)
    rough_v, rough_a = rng.standard_normal(17), 16.0 * rng.standard_normal(17)
    smooth_v, smooth_a = time**4, 4.0 * time**3  # four samples have it, two do not
    (six_less_four, rough), (_, smooth) = _differences(rough_v, rough_a, when), _differences(smooth_v, smooth_a, when)
    fine = float(np.max(np.abs(six_less_four)))
    low, high = 1e-9, 1e9
    for _ in range(100):  # so much of the smooth one that fine / coarse is the ratio
        share = math.sqrt(low * high)
        coarse = float(np.max(np.abs(rough + share * smooth)))
        low, high = (share, high) if fine > ratio * coarse else (low, share)
    run = free_flight(bodies=1, contacts=0, samples=16)
    found = difference_of_fewer(
        run, (rough_v + share * smooth_v)[:, None], (rough_a + share * smooth_a)[:, None], np.array([when])
    )
    expected = fine if ratio < 0.03 else 2.0 * (fine + coarse)
    assert found[0] == pytest.approx(expected, rel=1e-6)


def test_a_body_that_the_pulse_never_reaches_has_no_peak() -> None:
    peak = peak_velocity_of_front(THREE, free_flight(crossing_time=[0.1, math.nan]))
    assert np.isnan(peak.velocity).tolist() == [False, False, True]
    assert np.isnan(peak.time).tolist() == [False, False, True]


def test_binary_collisions_have_the_largest_sample_and_an_unknown_error(solved: Solve) -> None:
    scene = db.load_scene("decelerating-40")
    peak = peak_velocity_of_front(scene, solved(scene, "bca"))
    v1 = 2.0 * 0.8 / (1.0 + scene.mass[1] / scene.mass[0])
    assert peak.velocity[1:] == pytest.approx(v1, rel=100 * EPS)
    assert np.all(np.isnan(peak.sampling))


def test_the_local_stiffness_is_the_geometric_mean_and_straight_in_logarithms() -> None:
    scene = Scene(name="four", duration=1.0, mass=(1.0,) * 4, stiffness=(1.0, 4.0, 64.0), velocity=(1.0, 0.0, 0.0, 0.0))
    assert local_stiffness(scene, np.array([1.0, 1.5, 2.0])) == pytest.approx([2.0, math.sqrt(32.0), 16.0], rel=8 * EPS)


@examples(15)
@given(m=log_uniform(1e-4, 1.0), beta=log_uniform(1e6, 1e12), v=log_uniform(1e-3, 10.0), n=st.floats(2.2, 3.5))
def test_a_solitary_wave_of_any_size_has_the_constant_of_solitary_waves(
    m: float, beta: float, v: float, n: float
) -> None:
    scene, run, wave = travelling_wave(bodies=12, mass=m, stiffness=beta, peak_velocity=v, exponent=n)
    found = local_speed_constant(scene, run)
    assert found.solitary == pytest.approx(wave.speed / ((beta / m) ** (1 / n) * v ** ((n - 2) / n)), rel=1e-13)
    assert found.by_force == pytest.approx(found.solitary, rel=1e-13)
    # the sampled peak is good to 2e-12 for n = 5/2, where the wave is 5 bodies long; for larger n it is shorter
    assert found.by_velocity == pytest.approx(found.solitary, rel=1e-8)
    assert np.all(np.abs(found.by_velocity - found.solitary) <= found.by_velocity_uncertainty + 1e-12)


def test_bars_reach_the_constant_by_the_powers_that_they_have_in_it() -> None:
    crossing, force = np.linspace(1.0, 2.0, 39) * 1e-10, np.linspace(1.0, 2.0, 39) * 1e-3
    uncertainties = uncertain(velocity=1e-4, peak_force=force, crossing_time=crossing)
    scene, run, wave = travelling_wave(uncertainty=uncertainties)
    found = local_speed_constant(scene, run)
    of_speed = (crossing[1:] + crossing[:-1]) * wave.speed
    by_force = of_speed + 0.5 * (force[1:] + force[:-1]) / wave.peak_force / 6.0
    assert found.by_force_uncertainty == pytest.approx(by_force * found.solitary, rel=1e-9)
    # the uncertainty of the samples, 1e-9 of the peak, comes on top
    assert found.by_velocity_uncertainty == pytest.approx((of_speed + 0.2 * 1e-4 / 0.5) * found.solitary, rel=1e-4)


def test_a_struck_uniform_chain_comes_to_the_constant_by_body_forty(solved: Solve) -> None:
    scene = uniform_chain()
    found = local_speed_constant(scene, solved(scene, "reference"))
    assert found.solitary == pytest.approx(0.907470078412, abs=0.6e-12)
    far = (found.body >= 40) & (found.body <= 96)  # the last two with a residence time feel the free end
    # what is asked; 4e-12 at body 40, 2e-13 from there on
    assert np.all(np.abs(found.by_force[far] / found.solitary - 1.0) < 1e-9)
    assert np.all(np.abs(found.by_velocity[far] / found.solitary - 1.0) < 1e-9)
    assert np.all(np.abs(found.by_force - found.solitary)[far] < found.by_force_uncertainty[far] + 4e-12)
    # and not before: each body is 0.56 times nearer than the one before
    near = found.body < 30
    departure = np.log(np.abs(found.by_force[near & (found.body >= 10)] / found.solitary - 1.0))
    assert np.exp(np.diff(departure)) == pytest.approx(0.56, abs=0.01)
    assert np.all(np.abs(found.by_force[near] / found.solitary - 1.0) > 1e-9)


@pytest.mark.lammps
def test_lammps_has_the_constant_of_solitary_waves_within_its_bars(solved: Solve) -> None:
    scene = uniform_chain()
    found = local_speed_constant(scene, solved(scene, "lammps-granular", dt=2e-8))
    far = (found.body >= 40) & (found.body <= 96)
    assert np.all(np.abs(found.by_force - found.solitary)[far] <= found.by_force_uncertainty[far])
    assert np.all(np.abs(found.by_velocity - found.solitary)[far] <= found.by_velocity_uncertainty[far])


def test_binary_collisions_give_another_constant(solved: Solve) -> None:
    found = local_speed_constant(uniform_chain(), solved(uniform_chain(), "bca"))
    # T_i is half the contact time, 2.943275184325 d/v, with d^(5/2) = (5/4) (m/2) v^2 / beta
    expected = 1.0 / (1.4716375921625 * (5.0 / 8.0) ** 0.4)
    assert found.by_velocity[5:90] == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(
    ("change", "what"),
    [({"exponent": (2.5, 3.0)}, r"exponents \[2.5, 3.0\]"), ({"exponent": 2.0}, r"exponents \[2.0\]"),
     ({"law": lambda x: x**1.5}, "laws of their own")],
)  # fmt: skip
def test_chains_that_carry_no_solitary_wave_are_refused(change: dict[str, object], what: str) -> None:
    with pytest.raises(
        UsageError, match=rf"three has contacts with {what}; a solitary wave needs one exponent above 2"
    ):
        local_speed_constant(replace(THREE, **change), free_flight())  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("mass", "stiffness", "exponent", "gap", "duration", "samples"), UNRESOLVED.values(), ids=UNRESOLVED
)
def test_the_peak_between_few_samples_is_within_its_uncertainty(
    mass: tuple[float, ...],
    stiffness: tuple[float, ...],
    exponent: float,
    gap: tuple[float, ...],
    duration: float,
    samples: int,
) -> None:
    scene = Scene(
        name="few-samples", duration=duration, mass=mass, stiffness=stiffness, exponent=exponent, gap=gap,
        velocity=(1.0, *[0.0] * len(stiffness)),
    )  # fmt: skip
    run, fine = (db.solve(scene, backend="reference", samples=n) for n in (samples, 9600))
    few, truth = peak_velocity_of_front(scene, run), peak_velocity_of_front(scene, fine)
    assert np.all(np.abs(few.velocity - truth.velocity) <= few.sampling + truth.sampling + 1e-13)
    assert np.all(np.isfinite(few.sampling))
