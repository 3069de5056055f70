"""The pulse: of an exact solitary wave, whose every number is known, and of the paper's chains."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import dem_bridge as db
from dem_bridge.errors import UsageError
from dem_bridge.observables.conserved import energy, momentum
from dem_bridge.observables.pulse import (
    front_window,
    leading_pulse,
    place_of_edge,
    pulse_shapes,
    pulse_width_by_force,
    rear_of_pulse,
    reflected,
    secondary_fronts,
    speed_ratio,
)
from dem_bridge.scene.scene import Scene, Wall
from tests.conftest import Solve
from tests.helpers.fake_runs import NO_ERROR, free_flight, uncertain
from tests.helpers.strategies import examples, log_uniform
from tests.helpers.waves import long_chain, travelling_wave, uniform_chain

#: contacts whose pulse is whole, of travelling_wave's 40 bodies
INNER = slice(6, 33)


@examples(15)
@given(
    m=log_uniform(1e-4, 1.0), beta=log_uniform(1e6, 1e12), v=log_uniform(1e-3, 10.0), n=st.floats(2.2, 3.5),
    per_residence=st.floats(8.0, 16.0),
)  # fmt: skip
def test_a_solitary_wave_of_any_size_has_its_width_energy_and_momentum(
    m: float, beta: float, v: float, n: float, per_residence: float
) -> None:
    scene, run, wave = travelling_wave(mass=m, stiffness=beta, peak_velocity=v, exponent=n, per_residence=per_residence)
    found = pulse_width_by_force(scene, run)
    # sampled 8 times per residence: 1e-12 for n = 5/2, more where the wave is shorter
    assert found.width[INNER] == pytest.approx(wave.width, rel=1e-8)
    assert (found.fall - found.rise)[INNER] == pytest.approx(wave.width / wave.speed, rel=1e-8)
    assert 0.5 * (found.fall + found.rise)[INNER] == pytest.approx(run.crossing_time[INNER], rel=1e-8)
    pulse = leading_pulse(scene, run)
    assert pulse.energy[INNER] == pytest.approx(wave.energy, rel=1e-8)
    assert pulse.momentum[INNER] == pytest.approx(wave.momentum, rel=1e-8)
    assert pulse.energy_share[INNER] == pytest.approx(1.0, rel=1e-8)
    assert pulse.momentum_share[INNER] == pytest.approx(1.0, rel=1e-8)
    behind = reflected(scene, run)
    assert behind.energy[INNER] == pytest.approx(0.0, abs=1e-8 * wave.energy)
    assert behind.backward_momentum[INNER] == pytest.approx(0.0, abs=1e-8 * wave.momentum)


def test_the_kinetic_energy_of_a_wave_is_that_of_its_bodies_at_the_time() -> None:
    scene, run, wave = travelling_wave()
    bodies = np.arange(-20.0, 20.0) + 0.5  # as a contact has its peak
    expected = 0.5 * 0.01 * float(np.sum(wave.velocity(bodies) ** 2))
    assert leading_pulse(scene, run).kinetic[INNER] == pytest.approx(expected, rel=1e-12)
    # its mean over a passage is n/(n + 2) of the energy; at this moment, when contacts hold most, it is less
    assert 0.95 * 5.0 / 9.0 < expected / wave.energy < 5.0 / 9.0


@pytest.mark.parametrize(("per_residence", "bound"), [(2.0, 3e-5), (4.0, 1e-8)])
def test_the_width_is_as_good_as_its_samples(per_residence: float, bound: float) -> None:
    scene, run, wave = travelling_wave(per_residence=per_residence + 0.137)
    error = np.abs(pulse_width_by_force(scene, run).width[INNER] / wave.width - 1.0)
    assert bound * 1e-4 < np.max(error) < bound


def test_beyond_the_ends_there_is_no_width() -> None:
    scene, run, _ = travelling_wave()
    width = pulse_width_by_force(scene, run).width
    assert np.isnan(width).tolist() == [True] + [False] * 37 + [True]


def test_a_pulse_that_never_came_has_neither_width_nor_energy() -> None:
    scene, run, _ = travelling_wave()
    crossing = run.crossing_time.copy()
    crossing[30:] = np.nan
    short = replace(run, crossing_time=crossing)
    found, pulse = pulse_width_by_force(scene, short), leading_pulse(scene, short)
    assert np.isfinite(found.width[5:29]).all()
    assert np.isnan(found.rise[30:]).all()
    assert np.isnan(pulse.energy[30:]).all()
    assert pulse.rear[30:].tolist() == [-1] * 9
    assert np.isfinite(pulse.energy[5:30]).all()


def test_the_contact_with_the_least_force_is_behind_the_pulse() -> None:
    scene = Scene(name="pressed", duration=1.0, mass=(1.0,) * 5, stiffness=(2.5,) * 4, velocity=(0.0,) * 5)
    overlap = np.array([4.0, 1.0, 5.0, 7.0])
    place = np.concatenate([np.cumsum(overlap[::-1])[::-1], [0.0]])
    speed = np.array([-3.0, 2.0, -1.0, 2.0, 3.0])
    run = free_flight(bodies=5, contacts=4, samples=10, displacement=place + np.zeros((11, 1)), peak_force=np.ones(4),
                      velocity=np.zeros((11, 5)), crossing_time=[0.2, 0.4, 0.6, 0.8])  # fmt: skip
    pulse, behind = leading_pulse(scene, run), reflected(scene, run)
    # seen from contact 1 what is behind it rises; from 2 and 3 on it is least in contact 1, whose energy stays behind
    assert pulse.rear.tolist() == [0, 0, 2, 2]
    assert pulse.energy[2:] == pytest.approx(5.0**2.5 + 7.0**2.5, rel=1e-12)
    assert behind.energy[2:] == pytest.approx(4.0**2.5 + 1.0, rel=1e-12)
    assert pulse.energy[:2] == pytest.approx(float(np.sum(overlap**2.5)), rel=1e-12)
    # a moment at which all move: momenta go with the bodies
    moving = replace(run, displacement=place + speed * (run.time[:, None] - 0.6), velocity=speed + np.zeros((11, 1)),
                     contact_force=np.zeros((11, 4)))  # fmt: skip
    pulse, behind = leading_pulse(scene, moving), reflected(scene, moving)
    assert (pulse.momentum[2], behind.momentum[2]) == pytest.approx((4.0, -1.0), rel=1e-12)
    assert (pulse.kinetic[2], behind.backward_energy[2]) == pytest.approx((7.0, 4.5), rel=1e-12)
    assert (pulse.momentum_share[2], behind.backward_momentum[2]) == pytest.approx((4.0 / 3.0, -3.0), rel=1e-12)


@pytest.mark.parametrize(
    ("force", "rear"),
    [
        ([9.0], 0),
        ([0.0, 1.0, 2.0, 3.0], 1),
        ([5.0, 0.0, 1.0, 9.0], 2),
        ([2.0, 1.0, 3.0, 4.0], 2),
        ([3.0, 2.0, 1.0, 4.0], 3),
        # it does not rise behind these
        ([1.0, 2.0, 3.0], 0),
        ([1.0, 1.0, 3.0], 0),
        ([0.0, 1.0], 1),
        ([1.0, 0.0, 5.0], 2),
    ],
)
def test_a_pulse_begins_behind_the_first_least_force(force: list[float], rear: int) -> None:
    assert rear_of_pulse(np.array(force), len(force) - 1) == rear


def test_the_place_of_an_edge_is_on_a_spline_through_four_contacts_or_more() -> None:
    nan = math.nan
    when = np.array([1.0, 1.5, 2.0, 5.0, 5.5, 6.5, 8.0, nan])
    # contacts 1 to 4 are passed one after the other, and 5 to 7 anew: three are too few
    found = place_of_edge(np.array([nan, 1.0, 2.0, 3.0, 5.0, 4.0, 4.5, 5.0]), when)
    assert found[[0, 2, 3]] == pytest.approx([1.0, 2.0, 4.0], rel=1e-14)
    assert 1.0 < found[1] < 2.0
    assert np.isnan(found[4:]).all()
    again = place_of_edge(np.array([0.5, 1.0, 2.0, 3.0, 5.0, 6.0, 7.0, 9.0]), when[:7])
    assert again[[0, 2, 3]] == pytest.approx([1.0, 2.0, 4.0], rel=1e-14)
    assert 6.0 < again[6] < 7.0


def test_a_contact_that_was_never_below_half_its_force_has_no_edge_there() -> None:
    # n = 2, so that forces are overlaps: all contacts are at half their peak at the sample before it, or at the start
    time, bodies = np.linspace(0.0, 1.0, 41), 6
    scene = Scene(name="pressed", duration=1.0, mass=(1.0,) * bodies, stiffness=(1.0,) * (bodies - 1), exponent=2.0,
                  velocity=(0.0,) * bodies)  # fmt: skip
    top = 0.2 + 0.15 * np.arange(bodies - 1)
    overlap = np.maximum(1.0 - ((time[:, None] - top) / 0.3) ** 2, 0.0)
    closing = np.where(overlap > 0.0, -2.0 * (time[:, None] - top) / 0.09, 0.0)

    def moved(per_contact: np.ndarray) -> np.ndarray:
        return np.hstack([np.cumsum(per_contact[:, ::-1], axis=1)[:, ::-1], 0.0 * per_contact[:, :1]])

    run = free_flight(bodies=bodies, contacts=bodies - 1, samples=40, displacement=moved(overlap),
                      velocity=moved(closing), crossing_time=top)  # fmt: skip
    found = pulse_width_by_force(scene, run)
    # half of the peak is sqrt(0.045) s before and behind it; that of contact 0 is before the start
    half = math.sqrt(0.045)
    assert np.isnan(found.rise).tolist() == [True, False, False, False, False]
    assert found.rise[1:] == pytest.approx((top - half)[1:], abs=1e-9)
    assert found.fall[:4] == pytest.approx((top + half)[:4], abs=1e-9)
    assert np.isnan(found.fall).tolist() == [False, False, False, False, True]
    # contacts are passed every 0.15 s
    assert found.by_duration[1:4] == pytest.approx(2.0 * half / 0.15, rel=1e-8)
    assert np.isnan(found.by_duration[[0, 4]]).all()


def _rebound() -> tuple[Scene, float]:
    """Body 0 hits a heavier one and runs back: what runs back is known."""
    scene = Scene(name="rebound", duration=3e-4, mass=(0.01, 0.03, 0.001), stiffness=(4e9, 4e7),
                  velocity=(0.8, 0.0, 0.0), samples=1000)  # fmt: skip
    return scene, 0.8 * (0.01 - 0.03) / (0.01 + 0.03)


def test_what_runs_back_is_the_striker_where_a_heavier_body_is_struck(solved: Solve) -> None:
    scene, exit_velocity = _rebound()
    run = solved(scene, "reference", uncertainty=False)
    behind, pulse = reflected(scene, run), leading_pulse(scene, run)
    # contact 1 is so soft and body 2 so light that they take 2 % of the collision
    assert behind.striker_velocity[1] == pytest.approx(exit_velocity, rel=0.03)
    assert behind.backward_momentum[1] == pytest.approx(0.01 * behind.striker_velocity[1], rel=1e-12)
    assert behind.backward_energy[1] == pytest.approx(0.005 * behind.striker_velocity[1] ** 2, rel=1e-12)
    assert pulse.rear.tolist() == [0, 1]
    assert pulse.momentum[1] + behind.momentum[1] == pytest.approx(0.01 * 0.8, rel=1e-11)
    assert pulse.momentum_share[1] == pytest.approx(pulse.momentum[1] / 0.008, rel=1e-11)


def test_pulse_and_what_is_behind_it_are_all_there_is(solved: Solve) -> None:
    for name in ("decelerating-40", "accelerating-40"):
        scene = db.load_scene(name)
        run = solved(scene, "reference", samples=2000, uncertainty=False)
        pulse, behind = leading_pulse(scene, run), reflected(scene, run)
        # 7 samples per residence time where it is shortest; 3e-7 found, next to a contact that opens between samples
        assert pulse.energy + behind.energy == pytest.approx(energy(scene, run)[0], rel=1e-6)
        # hermite polynomials are linear: what is conserved at samples is conserved between them
        assert pulse.momentum + behind.momentum == pytest.approx(momentum(scene, run)[0], rel=1e-13)
        assert np.all(behind.backward_momentum <= 0.0)
        assert np.all(behind.backward_momentum <= behind.momentum + 1e-12)
        assert np.all(np.diff(pulse.rear[10:]) >= 0)  # before, two pulses may still be one


def test_a_wall_behind_the_striker_is_behind_the_pulse() -> None:
    scene, run, wave = travelling_wave()
    walled = replace(scene, wall_left=Wall(stiffness=4e9, gap=-4e-5))
    column = np.zeros((len(run.time), 1))
    # body 0 has moved away from the wall by less than its overlap: some is left
    assert run.displacement[-1, 0] < 4e-5
    run = replace(run, contact_force=np.hstack([run.contact_force, column]), peak_force=np.append(run.peak_force, 0.0),
                  crossing_time=np.append(run.crossing_time, np.nan),
                  uncertainty=NO_ERROR)  # fmt: skip
    assert leading_pulse(walled, run).energy[INNER] == pytest.approx(wave.energy, rel=1e-11)
    stored = 4e9 * (4e-5 - run.displacement[-1, 0]) ** 2.5 / 2.5
    assert reflected(walled, run).energy[INNER] == pytest.approx(stored, rel=1e-6)


def test_the_paper_chains_keep_kinetic_energy_and_width_of_the_front(solved: Solve) -> None:
    # section 4b: graded stiffness alone preserves the spatial width and the kinetic energy of the wave front
    for direction, drift in (("decelerating", 0.05), ("accelerating", 0.05)):
        scene = long_chain(direction)
        run = solved(scene, "reference", uncertainty=False)
        kinetic, width = leading_pulse(scene, run).kinetic[20:190], pulse_width_by_force(scene, run).width[20:190]
        assert np.ptp(kinetic) < 0.005 * np.mean(kinetic)
        assert np.ptp(width) < drift * np.mean(width)


def test_a_struck_uniform_chain_has_the_width_and_energy_of_its_wave(solved: Solve) -> None:
    from dem_bridge.physics.solitary import solitary_wave

    scene = uniform_chain()
    run = solved(scene, "reference")
    wave = solitary_wave(mass=scene.mass[0], stiffness=2e10, exponent=2.5, peak_force=float(run.peak_force[60]))
    pulse = leading_pulse(scene, run)
    far = slice(50, 90)
    assert pulse.energy[far] == pytest.approx(wave.energy, rel=1e-9)
    assert pulse.momentum[far] == pytest.approx(wave.momentum, rel=1e-9)
    # the spline through the edges feels the start of the chain still
    assert pulse_width_by_force(scene, run).width[far] == pytest.approx(wave.width, rel=1e-6)


def test_further_pulses_are_counted_with_lag_and_amplitude() -> None:
    scene = Scene(name="pulses", duration=1.0, mass=(1.0,) * 3, stiffness=(1.0,) * 2, velocity=(0.0,) * 3)
    time = np.linspace(0.0, 1.0, 2001)

    def bump(at: float, height: float) -> np.ndarray:
        return np.asarray(height * np.exp(-0.5 * ((time - at) / 0.01) ** 2))

    body = bump(0.2, 1.0) + bump(0.4, 0.5) + bump(0.6, 0.03) + bump(0.8, 0.2) - bump(0.7, 0.4)
    run = free_flight(samples=2000, velocity=np.stack([0 * body, body, 0 * body], axis=1), crossing_time=[0.15, 0.25])
    found = secondary_fronts(scene, run, 1)
    assert found.count == 2
    assert found.first == pytest.approx(1.0, abs=1e-6)
    assert found.lag == pytest.approx([0.2, 0.6], abs=1e-3)
    assert found.amplitude == pytest.approx([0.5, 0.2], abs=2e-3)
    assert secondary_fronts(scene, run, 1, share=0.02).count == 3
    assert secondary_fronts(scene, run, 1, share=0.3).count == 1
    assert secondary_fronts(scene, run, 1, until=0.5).count == 1


def test_a_window_of_five_contacts_has_the_energy_of_a_solitary_wave() -> None:
    scene, run, wave = travelling_wave()
    window = front_window(scene, run)
    # five contacts have all of the wave but 1e-6; seven have it to round-off of its superexponential tails
    assert window.energy[INNER] == pytest.approx(wave.energy, rel=2e-6)
    assert front_window(scene, run, reach=4).energy[INNER] == pytest.approx(wave.energy, rel=1e-9)
    outside = [True] * 2 + [False] * 35 + [True] * 2
    assert np.isnan(window.energy).tolist() == np.isnan(window.kinetic).tolist() == outside
    # of three contacts and four bodies, by hand
    near = front_window(scene, run, reach=1)
    bodies, contacts = np.arange(-1.5, 2.0), np.arange(-1.0, 2.0)
    moving = 0.5 * 0.01 * float(np.sum(wave.velocity(bodies) ** 2))
    assert near.kinetic[10] == pytest.approx(moving, rel=1e-9)
    held = 4e9 / 2.5 * float(np.sum(wave.overlap(contacts) ** 2.5))
    assert near.energy[10] == pytest.approx(moving + held, rel=1e-9)
    # the energy is kinetic to 5/9 on average, and the part at the peak of a contact is the same for all contacts
    assert np.ptp(window.kinetic[INNER]) < 1e-8 * wave.energy
    assert np.all(window.kinetic[INNER] < window.energy[INNER])


def test_a_window_leaves_out_what_lags_behind() -> None:
    scene, run, wave = travelling_wave()
    tail = np.array(run.velocity)
    tail[:, 0] += 3.0 * wave.peak_velocity  # a body far behind
    window = front_window(scene, replace(run, velocity=tail))
    assert window.energy[INNER] == pytest.approx(front_window(scene, run).energy[INNER], rel=1e-12)


def test_shapes_of_pulses_are_those_of_the_wave(solved: Solve) -> None:
    scene, run, wave = travelling_wave()
    shapes = pulse_shapes(scene, run, 20)
    assert shapes.velocity == pytest.approx([wave.peak_velocity], rel=1e-7)
    # a wave of the same shape, 32 times as high, lasts half as long
    fast, quick, high = travelling_wave(peak_velocity=32.0 * wave.peak_velocity)
    scaled = pulse_shapes(fast, quick, 20)
    assert scaled.velocity == pytest.approx([high.peak_velocity], rel=1e-7)
    assert scaled.duration == pytest.approx(0.5 * shapes.duration, rel=1e-6)


def test_ripples_on_a_pulse_are_no_pulses_of_their_own() -> None:
    scene = Scene(name="ripples", duration=1.0, mass=(1.0,) * 3, stiffness=(1.0,) * 2, velocity=(0.0,) * 3)
    time = np.linspace(0.0, 1.0, 2001)
    body = np.exp(-0.5 * ((time - 0.2) / 0.02) ** 2) + 0.4 * np.exp(-0.5 * ((time - 0.6) / 0.1) ** 2)
    body += 0.01 * np.sin(400.0 * time)
    run = free_flight(samples=2000, velocity=np.stack([0 * body, body, 0 * body], axis=1), crossing_time=[0.15, 0.25])
    assert secondary_fronts(scene, run, 1).count == 1


def test_further_pulses_are_after_the_handing_on_and_up_to_a_time() -> None:
    scene = Scene(name="pulses", duration=1.0, mass=(1.0,) * 3, stiffness=(1.0,) * 2, velocity=(0.0,) * 3)
    body = np.zeros(21)
    body[[4, 8, 12, 16]] = 1.0, 0.5, 0.05, 0.04  # single samples at 0.2, 0.4, 0.6 and 0.8 s
    still = 0.0 * body
    run = free_flight(samples=20, velocity=np.stack([still, body, body], axis=1), crossing_time=[0.15, 0.25],
                      contact_force=np.full((21, 2), math.nan))  # fmt: skip
    # a maximum of just the share counts
    assert secondary_fronts(scene, run, 1, share=0.05).lag == pytest.approx([0.2, 0.4], rel=1e-12)
    assert secondary_fronts(scene, run, 1, share=math.nextafter(0.05, 1.0)).count == 1
    assert secondary_fronts(scene, run, 1, share=0.04).count == 3
    at = float(run.time[8])
    assert secondary_fronts(scene, run, 1, until=at).count == 1
    assert secondary_fronts(scene, run, 1, until=math.nextafter(at, 0.0)).count == 0
    late = replace(run, crossing_time=np.array([0.15, at]))
    assert secondary_fronts(scene, late, 1).lag == pytest.approx([0.4], rel=1e-12)
    # the last body has handed nothing on before the end
    assert secondary_fronts(scene, run, 2).count == 0
    for number, share, text in (
        (-1, 0.05, "body -1; allowed: 0 to 2"),
        (3, 0.05, "body 3; allowed"),
        (1, 0.0, "share = 0.0"),
    ):
        with pytest.raises(UsageError, match=text):
            secondary_fronts(scene, run, number, share=share)


def test_shapes_of_pulses_by_hand() -> None:
    # parabolas of 1 and 0.25 m/s that last 0.2 and 0.1 s, which polynomials through samples have where they are whole
    time = np.linspace(0.0, 1.0, 201)
    scene = Scene(name="pulses", duration=1.0, mass=(1.0,) * 3, stiffness=(1.0,) * 2, velocity=(0.0,) * 3)
    velocity, slope = np.zeros(201), np.zeros(201)
    for middle, height, half in ((0.3, 1.0, 0.1), (0.7, 0.25, 0.05), (0.95, 0.5, 0.1)):
        inside = np.abs(time - middle) <= half
        velocity += np.where(inside, height * (1.0 - ((time - middle) / half) ** 2), 0.0)
        slope += np.where(inside, -2.0 * height * (time - middle) / half**2, 0.0)
    force = np.stack([10.0 + slope, 10.0 + 0.0 * slope], axis=1)
    run = free_flight(samples=200, velocity=np.stack([velocity] * 3, axis=1), contact_force=force,
                      crossing_time=[0.2, 0.45])  # fmt: skip
    shapes = pulse_shapes(scene, run, 1)
    assert shapes.velocity == pytest.approx([1.0, 0.25, 0.5], rel=1e-9)
    # a parabola is above half its height for sqrt(1/2) of its length; the last one is cut off
    assert shapes.duration[:2] == pytest.approx([0.2 * math.sqrt(0.5), 0.1 * math.sqrt(0.5)], abs=2e-7)
    assert math.isnan(shapes.duration[2])
    assert pulse_shapes(scene, run, 1, share=0.2).velocity == pytest.approx([1.0, 0.25], rel=1e-9)


@pytest.mark.parametrize("off", [0.3, 0.5, 0.7])
def test_the_height_of_a_pulse_is_that_between_the_times_at_which_it_is_evaluated(off: float) -> None:
    # a parabola of 0.0125 s, whose top is a part of 1/30000 s behind such a time
    time, half = np.linspace(0.0, 1.0, 2001), 0.0125
    middle = 0.3 + off / 30_000.0
    inside = np.abs(time - middle) <= half
    velocity = np.where(inside, 1.0 - ((time - middle) / half) ** 2, 0.0)
    slope = np.where(inside, -2.0 * (time - middle) / half**2, 0.0)
    scene = Scene(name="pulse", duration=1.0, mass=(1.0,) * 3, stiffness=(1.0,) * 2, velocity=(0.0,) * 3)
    run = free_flight(samples=2000, velocity=np.stack([velocity] * 3, axis=1),
                      contact_force=np.stack([10.0 + slope, 10.0 + 0.0 * slope], axis=1),
                      crossing_time=[0.2, 0.45])  # fmt: skip
    # the largest of these values is too low by (off/30000/half)^2: up to 1.8e-6
    assert pulse_shapes(scene, run, 1).velocity == pytest.approx([1.0], rel=1e-9)


def test_only_the_decelerating_chain_of_the_paper_has_further_fronts(solved: Solve) -> None:
    # section 4a, for the mismatch of the first two contacts
    for name, counts in (("decelerating-40", [1, 2, 2, 2, 1]), ("accelerating-40", [0] * 5)):
        scene = db.load_scene(name)
        run = solved(scene, "reference", samples=2000, uncertainty=False)
        assert [secondary_fronts(scene, run, body).count for body in (5, 10, 20, 30, 38)] == counts


def test_the_speed_ratio_is_that_of_two_stated_bodies() -> None:
    scene, run, _ = travelling_wave(uncertainty=uncertain(crossing_time=1e-9))
    residence = np.geomspace(1e-5, 4e-5, 38)
    graded = replace(run, crossing_time=np.concatenate([[0.0], np.cumsum(residence)]))
    found = speed_ratio(scene, graded)
    assert (found.first, found.last) == (3, 37)
    assert found.speed_in == pytest.approx(18e-3 / residence[2], rel=1e-12)
    assert found.ratio == pytest.approx(residence[2] / residence[36], rel=1e-12)
    assert found.uncertainty / found.ratio == pytest.approx(2e-9 / residence[2] + 2e-9 / residence[36], rel=1e-9)
    whole = speed_ratio(replace(scene, spacing=None), graded, first=1, last=38)
    assert whole.ratio == pytest.approx(0.25, rel=1e-10)
    assert whole.speed_in == pytest.approx(1e5, rel=1e-12)


def test_the_papers_chains_slow_down_and_speed_up(solved: Solve) -> None:
    for name, ratio in (("decelerating-40", 0.3945), ("accelerating-40", 2.3527)):
        scene = db.load_scene(name)
        found = speed_ratio(scene, solved(scene, "reference", samples=2000, uncertainty=False))
        assert found.ratio == pytest.approx(ratio, abs=5e-5)


def test_what_has_no_pulse_is_refused_with_the_reason(solved: Solve) -> None:
    scene, run, _ = travelling_wave()
    for function in (pulse_width_by_force, leading_pulse, reflected):
        with pytest.raises(UsageError, match="wave has gravity"):
            function(replace(scene, gravity=9.81), run)
        with pytest.raises(UsageError, match="wave has precompression"):
            function(replace(scene, precompression=1.0), run)
        slow = db.load_scene("decelerating-40")
        with pytest.raises(UsageError, match="'bca' gives no contact forces"):
            function(slow, solved(slow, "bca"))
    with pytest.raises(UsageError, match="body 40; allowed: 0 to 39"):
        secondary_fronts(scene, run, 40)
    with pytest.raises(UsageError, match=r"share = 1\.0"):
        secondary_fronts(scene, run, 5, share=1.0)
    never = replace(run, crossing_time=np.full(39, math.nan))
    with pytest.raises(UsageError, match="never came to body 5"):
        secondary_fronts(scene, never, 5)
    with pytest.raises(UsageError, match="did not pass bodies 3 and 37"):
        speed_ratio(scene, never)
    with pytest.raises(UsageError, match="body 39 has no residence time; allowed: 1 to 38"):
        speed_ratio(scene, run, last=39)
