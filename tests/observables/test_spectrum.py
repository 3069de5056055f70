"""Spectra: of Gaussian pulses, whose moments are known in closed form, and of the paper's chains."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dem_bridge.errors import UsageError
from dem_bridge.observables.front import local_stiffness
from dem_bridge.observables.spectrum import Spectrum, cascade, frequency_spectrum, wavenumber_spectrum
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import Trajectory
from tests.conftest import Solve
from tests.helpers.fake_runs import free_flight
from tests.helpers.strategies import examples
from tests.helpers.waves import long_chain, uniform_chain

BODIES = 41
#: of a pulse exp(-t^2 / (2 sigma^2)): the density goes as exp(-(2 pi sigma f)^2)
CENTROID, SECOND = 1.0 / (2.0 * math.pi**1.5), 1.0 / (8.0 * math.pi**2)
WIDTH = math.sqrt(SECOND - CENTROID**2)


def _gaussians(
    sigma: np.ndarray, arrival: np.ndarray, *, samples: int = 4000, duration: float = 1.0
) -> tuple[Scene, Trajectory]:
    """Body i has a Gaussian pulse of width ``sigma[i]`` at ``arrival[i]``, s."""
    bodies = len(sigma)
    scene = Scene(name="gauss", duration=duration, mass=(1.0,) * bodies, stiffness=(1.0,) * (bodies - 1),
                  velocity=(0.0,) * bodies)  # fmt: skip
    time = np.linspace(0.0, duration, samples + 1)
    v = np.exp(-0.5 * ((time[:, None] - arrival) / sigma) ** 2)
    run = free_flight(bodies=bodies, contacts=bodies - 1, samples=samples, duration=duration, velocity=v,
                      crossing_time=arrival[1:])  # fmt: skip
    return scene, run


def _even(**how: float) -> tuple[Scene, Trajectory]:
    """Pulses of 5 ms every 20 ms, the last bodies' after the record."""
    return _gaussians(np.full(BODIES, 5e-3), 0.1 + 0.02 * np.arange(BODIES), **how)  # type: ignore[arg-type]


def test_the_moments_of_a_gaussian_pulse_in_time() -> None:
    sigma = np.linspace(4e-3, 8e-3, BODIES)
    scene, run = _gaussians(sigma, 0.1 + 0.02 * np.arange(BODIES))
    spectrum = frequency_spectrum(scene, run, first=1, last=35)
    own = sigma[1:36]
    # the corner of |f| at 0 costs df^2/6 of 2 sigma sqrt(pi) (Euler-Maclaurin), with df = 1/0.9 s: 5e-4 for 8 ms
    assert spectrum.centroid == pytest.approx(CENTROID / own, rel=1e-3)
    assert spectrum.width == pytest.approx(WIDTH / own, rel=1e-3)
    assert spectrum.position.tolist() == list(range(1, 36))
    assert spectrum.time == pytest.approx(0.1 + 0.02 * np.arange(1, 36), rel=1e-12)


def test_the_sum_of_a_density_is_the_integral_of_the_square() -> None:
    scene, run = _even()
    spectrum = frequency_spectrum(scene, run)
    energy = np.sum(spectrum.density, axis=0) * spectrum.frequency[1]
    assert energy == pytest.approx(5e-3 * math.sqrt(math.pi), rel=1e-10)
    assert spectrum.parseval < 1e-14


@examples(30)
@given(samples=st.integers(40, 400), seed=st.integers(0, 99))
def test_parseval_holds_for_any_velocities(samples: int, seed: int) -> None:
    v = np.random.default_rng(seed).standard_normal((samples + 1, BODIES))
    scene, _ = _even()
    run = free_flight(bodies=BODIES, contacts=BODIES - 1, samples=samples, velocity=v,
                      crossing_time=np.linspace(0.1, 0.9, BODIES - 1))  # fmt: skip
    for spectrum in (frequency_spectrum(scene, run), wavenumber_spectrum(scene, run)):
        assert spectrum.parseval < 1e-13  # sums of 400 squares
        assert np.all(spectrum.density >= 0.0)


def test_the_defect_of_parseval_is_that_of_the_worst_body(monkeypatch: pytest.MonkeyPatch) -> None:
    scene, run = _even()
    transform, factor = np.fft.rfft, np.ones(run.velocity.shape[1])
    factor[3] = 1.1
    monkeypatch.setattr(np.fft, "rfft", lambda v, axis: transform(v, axis=axis) * factor[: v.shape[1]])
    assert frequency_spectrum(scene, run).parseval == pytest.approx(0.21, rel=1e-9)


def test_a_line_is_where_its_frequency_is() -> None:
    scene, run = _even()
    tone = np.cos(2.0 * np.pi * 50.0 * run.time[:, None]) * np.ones(BODIES)
    spectrum = frequency_spectrum(scene, replace(run, velocity=tone, crossing_time=np.linspace(0.1, 1.0, BODIES - 1)))
    assert spectrum.frequency[np.argmax(spectrum.density, axis=0)] == pytest.approx(50.0, abs=0.5)
    wave = np.cos(2.0 * np.pi * 0.25 * np.arange(BODIES)) * np.ones((len(run.time), 1))
    spectrum = wavenumber_spectrum(scene, replace(run, velocity=wave))
    assert spectrum.centroid == pytest.approx(0.25, abs=1e-10)


def test_a_tone_of_whole_periods_has_one_line() -> None:
    # nothing leaks, because no window is applied
    scene, run = _even(samples=1000)
    tone = np.cos(2.0 * np.pi * 50.0 / 1.001 * run.time[:, None]) * np.ones(BODIES)
    spectrum = frequency_spectrum(scene, replace(run, velocity=tone, crossing_time=np.linspace(0.1, 1.0, BODIES - 1)))
    assert spectrum.density[48:53, 0] / spectrum.density[50, 0] == pytest.approx([0.0, 0.0, 1.0, 0.0, 0.0], abs=1e-12)


def test_the_moments_of_a_gaussian_pulse_along_the_chain() -> None:
    bodies, sigma = 201, 3.0
    scene, run = _gaussians(np.full(bodies, sigma * 0.004), 0.1 + 0.004 * np.arange(bodies), samples=1000)
    spectrum = wavenumber_spectrum(scene, run)
    # the corner of |f| at 0 costs df^2/12 on either side of it, 2/12 (2 pi sigma / 200)^2 of the moment: 1.5e-3
    assert spectrum.centroid == pytest.approx(CENTROID / sigma, rel=2e-3)
    # second moment minus the centroid squared: twice (CENTROID / WIDTH)^2 = 1.75 times the centroid's error
    assert spectrum.width == pytest.approx(WIDTH / sigma, rel=4e-3)
    total = np.sum(spectrum.density, axis=0) * spectrum.frequency[1]
    # the last position is 3.5 sigma from the end: erfc(3.5) / 2
    assert total == pytest.approx(sigma * math.sqrt(math.pi), rel=4e-7)
    assert spectrum.position == pytest.approx((spectrum.time - 0.1) / 0.004, abs=1e-9)


def test_the_striker_is_left_out_and_so_is_all_after_the_last_arrival() -> None:
    scene, run = _even(duration=1.5, samples=3000)
    loud = run.velocity.copy()
    loud[:, 0] = 1e3
    loud[run.time > 0.1 + 0.02 * 40] = 1e3
    noisy = replace(run, velocity=loud)
    for spectrum in (frequency_spectrum, wavenumber_spectrum):
        assert spectrum(scene, noisy).density.tolist() == spectrum(scene, run).density.tolist()


def test_a_run_that_ends_before_the_pulse_does_is_taken_to_its_end() -> None:
    scene, run = _even(duration=0.7, samples=1400)
    crossing = np.where(run.crossing_time > 0.6, np.nan, run.crossing_time)
    short = replace(run, crossing_time=crossing)
    assert len(frequency_spectrum(scene, short, last=20).frequency) == 701
    with pytest.raises(UsageError, match="never came to body 26"):
        frequency_spectrum(scene, short)
    assert wavenumber_spectrum(scene, short).position.max() <= 25.0


@examples(20)
@given(power=st.floats(0.05, 2.0), sign=st.sampled_from([-1.0, 1.0]))
def test_a_cascade_that_is_put_in_comes_out(power: float, sign: float) -> None:
    position = np.arange(20.0, 190.0)
    spectrum = _spectrum(position, 1e3 * (position / 20.0) ** (sign * power))
    found = cascade(spectrum)
    assert found.late / found.early == pytest.approx(found.ratio, rel=1e-12)
    assert found.slope.slope == pytest.approx(sign * power, rel=1e-10)
    ends = position <= 20.0 + 16.9, position >= 189.0 - 16.9
    mean = [np.mean(np.log(position[one])) for one in ends]
    assert found.ratio == pytest.approx(math.exp(sign * power * (mean[1] - mean[0])), rel=1e-12)
    assert (found.start, found.end) == (np.mean(position[ends[0]]), np.mean(position[ends[1]]))
    assert found.spread[0] <= found.ratio <= found.spread[1]


def _spectrum(position: np.ndarray, centroid: np.ndarray) -> Spectrum:
    one = np.ones((2, len(position)))
    return Spectrum(frequency=np.arange(2.0), density=one, position=position, time=position, centroid=centroid,
                    width=centroid, parseval=0.0)  # fmt: skip


def test_ends_have_all_positions_within_their_share_of_the_way() -> None:
    position, centroid = np.arange(1.0, 12.0), 2.0 ** np.array([0, 1, 5, 0, 0, 0, 0, 0, 7, 3, 4])
    found = cascade(_spectrum(position, centroid))
    # a tenth of the way from 1 to 11 is 1, a twentieth a half, a fifth 2
    assert (found.start, found.end) == (1.5, 10.5)
    assert (found.early, found.late) == pytest.approx((2.0**0.5, 2.0**3.5), rel=1e-14)
    assert found.ratio == pytest.approx(2.0**3, rel=1e-14)
    assert found.spread == pytest.approx((2.0 ** (14 / 3 - 2), 2.0**4), rel=1e-14)
    assert found.stderr == 0.0  # of two positions nothing is left


def test_the_error_of_a_ratio_is_the_scatter_about_lines_through_both_ends() -> None:
    # three positions at each end, off a line by (1, -2, 1)/100 and (2, -4, 2)/100 in the logarithm
    position = np.arange(21.0)
    logarithm = 0.1 * position
    logarithm[:3] += 0.01 * np.array([1.0, -2.0, 1.0])
    logarithm[-3:] += 0.02 * np.array([1.0, -2.0, 1.0])
    found = cascade(_spectrum(position + 1.0, np.exp(logarithm)))
    assert found.ratio == pytest.approx(math.exp(1.8), rel=1e-12)
    # sums of squares of 6e-4 and 24e-4, one degree of freedom, means of three
    assert found.stderr == pytest.approx(math.exp(1.8) * math.sqrt(6e-4 / 3.0 + 24e-4 / 3.0), rel=1e-9)


def test_four_positions_are_the_fewest() -> None:
    position = np.arange(1.0, 5.0)
    assert cascade(_spectrum(position, position)).slope.slope == pytest.approx(1.0, rel=1e-12)
    with pytest.raises(UsageError, match="a spectrum at 3 positions"):
        cascade(_spectrum(position[:3], position[:3]))


def test_the_error_of_a_ratio_is_that_of_repeated_noise() -> None:
    rng, position = np.random.default_rng(3), np.arange(0.0, 400.0)
    told = [cascade(_spectrum(position + 1.0, np.exp(0.1 * rng.standard_normal(400)))) for _ in range(200)]
    # a standard deviation from 200 is good to 5 %
    assert np.std([one.ratio for one in told]) == pytest.approx(np.mean([one.stderr for one in told]), rel=0.15)


def test_frequencies_of_the_long_chains_cascade_and_wavenumbers_do_not(solved: Solve) -> None:
    for direction, power in (("decelerating", 0.392), ("accelerating", 0.413)):
        scene = long_chain(direction)
        run = solved(scene, "reference", uncertainty=False)
        in_time, in_space = frequency_spectrum(scene, run), wavenumber_spectrum(scene, run)
        assert max(in_time.parseval, in_space.parseval) < 3e-15
        of_time, of_space = cascade(in_time), cascade(in_space)
        assert max(of_time.spread[0], 1.0 / of_time.spread[1]) > 1.2
        assert of_space.ratio == pytest.approx(1.0, abs=0.03)
        low, high = local_stiffness(scene, np.array([of_time.start, of_time.end]))
        assert of_time.ratio == pytest.approx((high / low) ** 0.4, rel=0.03)
        against = cascade(in_time, against=local_stiffness(scene, in_time.position)).slope
        assert against.slope == pytest.approx(power, abs=1e-3)


def test_nothing_cascades_in_a_uniform_chain(solved: Solve) -> None:
    scene = uniform_chain(200, samples=1000)
    run = solved(scene, "reference", uncertainty=False)
    for spectrum in (frequency_spectrum(scene, run), wavenumber_spectrum(scene, run)):
        assert cascade(spectrum).ratio == pytest.approx(1.0, abs=2e-3)


@pytest.mark.parametrize("samples", [7, 8])
def test_a_density_is_that_of_the_sum_over_samples(samples: int) -> None:
    # each frequency by its own sum, whether the number of samples is odd or even
    v = np.random.default_rng(9).standard_normal((samples, BODIES))
    scene, _ = _even()
    run = free_flight(bodies=BODIES, contacts=BODIES - 1, samples=samples - 1, duration=float(samples - 1), velocity=v,
                      crossing_time=np.full(BODIES - 1, float(samples - 1)))  # fmt: skip
    spectrum = frequency_spectrum(scene, run, first=3, last=5)
    assert spectrum.position.tolist() == [3.0, 4.0, 5.0]
    for j, frequency in enumerate(np.arange(samples // 2 + 1) / samples):
        one = abs(np.sum(v[:, 3:6] * np.exp(-2j * np.pi * frequency * np.arange(samples))[:, None], axis=0)) ** 2
        both = 1.0 if frequency in (0.0, 0.5) else 2.0
        assert spectrum.frequency[j] == pytest.approx(frequency, abs=1e-15)
        assert spectrum.density[j] == pytest.approx(both * one, rel=1e-11, abs=1e-13)


def test_bodies_are_two_or_more_between_1_and_the_last() -> None:
    scene, run = _even()
    run = replace(run, crossing_time=np.minimum(run.crossing_time, 0.99))
    assert frequency_spectrum(scene, run, first=1, last=2).position.tolist() == [1.0, 2.0]
    assert frequency_spectrum(scene, run, first=39, last=40).position.tolist() == [39.0, 40.0]
    for first, last, text in ((5, 5, "5..5"), (0, 2, "0..2"), (39, 41, "39..41"), (6, 5, "none")):
        with pytest.raises(UsageError, match=rf"^bodies {text}; allowed: two or more of 1\.\.40,"):
            frequency_spectrum(scene, run, first=first, last=last)


def test_samples_at_the_first_and_the_last_arrival_count() -> None:
    scene, run = _even(samples=1000)
    arrival = np.round(run.crossing_time, 3)  # samples are 1 ms apart
    times = wavenumber_spectrum(scene, replace(run, crossing_time=arrival), first=4, last=10).time
    assert (times[0], times[-1], len(times)) == (pytest.approx(0.18), pytest.approx(0.30), 121)


def test_what_has_no_spectrum_is_refused_with_the_reason() -> None:
    scene, run = _even()
    with pytest.raises(UsageError, match=r"bodies 0\.\.37; allowed: two or more of 1..40"):
        frequency_spectrum(scene, run, first=0)
    with pytest.raises(UsageError, match="no motion at all"):
        frequency_spectrum(scene, replace(run, velocity=np.zeros_like(run.velocity)))
    with pytest.raises(UsageError, match=r"never came to bodies 4\.\.37"):
        wavenumber_spectrum(scene, replace(run, crossing_time=np.full(BODIES - 1, np.nan)))
    with pytest.raises(UsageError, match="no sample falls"):
        wavenumber_spectrum(scene, replace(run, crossing_time=0.5 + 1e-7 * np.arange(1.0, BODIES)))
    with pytest.raises(UsageError, match="a spectrum at 3 positions"):
        cascade(frequency_spectrum(scene, run, first=4, last=6))
