"""The solitary wave: the printed digits, the fixed point by another quadrature, and waves launched into real chains."""

from __future__ import annotations

import math
import subprocess
import sys
from functools import lru_cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad

import dem_bridge as db
from dem_bridge.physics import solitary
from dem_bridge.physics.solitary import SolitaryWave, long_wave, solitary_wave, wave_shape
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import Trajectory
from tests.helpers.strategies import examples, log_uniform

EPS = float(np.finfo(float).eps)
EXPONENTS = [2.001, 2.1, 2.5, 3.0, 4.5, 12.0, 50.0]


@lru_cache
def _unit(n: float, size: float = 1.0) -> SolitaryWave:
    return solitary_wave(mass=1.0, stiffness=1.0, exponent=n, peak_velocity=size)


def test_the_printed_digits_of_the_hertzian_wave() -> None:
    m, beta, v = 0.01, 4e9, 0.3  # not at one, so that the powers are tested too
    wave = solitary_wave(mass=m, stiffness=beta, exponent=2.5, peak_velocity=v)
    printed = pytest.approx  # PHYSICS.md: 12 digits of c, 11 of P and E, each to half its last place
    assert wave.speed / ((beta / m) ** 0.4 * v**0.2) == printed(0.907470078412, abs=0.6e-12)
    assert wave.speed / (beta ** (1 / 3) * m**-0.5 * wave.peak_force ** (1 / 6)) == printed(0.905515776419, abs=0.6e-12)
    assert wave.kinetic_to_potential == printed(1.25, abs=1e-13)
    assert wave.momentum / (m * v) == printed(1.6699712493, abs=0.6e-10)
    assert wave.energy / (m * v**2) == printed(1.0693229458, abs=0.6e-10)
    assert wave.peak_velocity == printed(v, rel=4 * EPS)


def _mismatch(wave: SolitaryWave, x: float) -> float:
    """|m c^2 r - beta tent * r^(n-1)| / (m c^2 r_max) at x, for m = beta = 1, by adaptive Gauss-Kronrod quadrature."""

    def integrand(y: float) -> float:
        return (1.0 - abs(y)) * float(wave.force(x + y))

    edge = wave.shape.half_length
    breaks = sorted({0.0, *(p for p in (-x, wave.width - x, -wave.width - x) if abs(p) < 1.0)})  # kink, centre, flanks
    ends = [max(-1.0, -edge - x), *breaks, min(1.0, edge - x)]
    parts = [quad(integrand, *ends[i : i + 2], epsabs=1e-15, epsrel=1e-13, limit=200)[0] for i in range(len(ends) - 1)]
    return abs(float(wave.overlap(x)) - math.fsum(parts) / wave.speed**2) / wave.peak_overlap


@pytest.mark.parametrize("n", EXPONENTS)
def test_the_fixed_point_holds_under_adaptive_quadrature_off_the_grid(n: float) -> None:
    wave = _unit(n)
    assert wave.residual < 1e-13
    for x in wave.width * np.array([0.0, 0.137, 0.41, 0.83]):
        assert _mismatch(wave, float(x)) < 1e-13, x  # the quadrature's own round-off is most of it


def test_the_fixed_point_of_another_kernel_is_seen_by_the_quadrature(monkeypatch: pytest.MonkeyPatch) -> None:
    sound = np.sinc
    solitary.wave_shape.cache_clear()
    monkeypatch.setattr(np, "sinc", lambda x: sound(x) * np.exp(-1e-5 * x**2))
    try:
        wave = solitary_wave(mass=1.0, stiffness=1.0, exponent=2.5, peak_velocity=1.0)
    finally:
        solitary.wave_shape.cache_clear()
    assert wave.residual < 1e-13
    assert wave.kinetic_to_potential == pytest.approx(1.25, abs=1e-3)
    assert _mismatch(wave, 0.3) > 1e-7


@pytest.mark.parametrize("n", EXPONENTS)
def test_the_profile_obeys_newtons_law_and_the_compression_rate(n: float) -> None:
    # in a frame that moves with the wave: d overlap / d t = v_k - v_(k+1), m dv/dt = F_(k-1) - F_k; by differences
    wave, h = _unit(n), 2e-3 * _unit(n).width
    x = np.linspace(0.05, 1.3, 9) * wave.width

    def slope(f: object, at: np.ndarray) -> np.ndarray:  # central, of order 6
        assert callable(f)
        terms = ((1, 45.0), (2, -9.0), (3, 1.0))
        return np.asarray(sum(w * (f(at + k * h) - f(at - k * h)) for k, w in terms) / (60.0 * h))

    # as contact k goes from x to x + c dt, the body before it is half a grain ahead, the one behind half a grain back
    closing = wave.velocity(x + 0.5) - wave.velocity(x - 0.5)
    # order 6: (h/width)^6 = 6e-17; round-off of the difference: 1e-15 / 2e-3 of each scale over a width
    bound = 1e-11 * wave.peak_velocity + 30.0 * EPS * wave.speed * wave.peak_overlap / h
    bound += 10.0 * wave.uncertainty * wave.peak_velocity
    np.testing.assert_allclose(wave.speed * slope(wave.overlap, x), closing, rtol=0.0, atol=bound)
    pushed = wave.force(x + 0.5) - wave.force(x - 0.5)
    bound = 1e-10 * wave.peak_force + 30.0 * EPS * wave.speed * wave.peak_velocity / h
    np.testing.assert_allclose(wave.speed * slope(wave.velocity, x), pushed, rtol=0.0, atol=bound)


@pytest.mark.parametrize("n", EXPONENTS)
def test_sums_over_the_grains_are_constant_and_those_of_the_averages(n: float) -> None:
    wave = _unit(n)
    reach = math.ceil(wave.shape.half_length)
    for phase in (0.0, 0.21, 0.5):
        contacts = np.arange(-reach, reach + 1) + phase
        v, x = wave.velocity(contacts + 0.5), wave.overlap(contacts)
        energy = 0.5 * float(v @ v) + float(np.sum(x**n)) / n
        assert float(np.sum(v)) == pytest.approx(wave.momentum, rel=1e-12)
        assert energy == pytest.approx(wave.energy, rel=1e-12)  # up to 50 powers of ulps
        # bodies behind the wave have moved by the shift, bodies ahead not at all
        assert float(np.sum(x)) == pytest.approx(wave.shift, rel=1e-12)


@pytest.mark.parametrize("n", EXPONENTS)
def test_the_mean_energies_obey_the_virial_theorem(n: float) -> None:
    assert _unit(n).kinetic_to_potential == pytest.approx(n / 2.0, rel=1e-13 * max(n, 10.0))


@given(m=log_uniform(1e-6, 1e3), beta=log_uniform(1e3, 1e12), v=log_uniform(1e-9, 1e3), n=st.sampled_from(EXPONENTS))
def test_force_and_velocity_name_the_same_wave_for_any_units(m: float, beta: float, v: float, n: float) -> None:
    wave = solitary_wave(mass=m, stiffness=beta, exponent=n, peak_velocity=v)
    same = solitary_wave(mass=m, stiffness=beta, exponent=n, peak_force=wave.peak_force)
    lost = 50.0 * EPS * n  # roots and powers of numbers of up to 1e30
    assert same.peak_velocity == pytest.approx(v, rel=lost)
    assert same.speed == pytest.approx(wave.speed, rel=lost)
    assert wave.energy == pytest.approx(_unit(n).energy * m * v**2, rel=lost)
    assert wave.shift == pytest.approx(wave.momentum / (m * wave.speed), rel=lost)


@pytest.mark.parametrize("n", [2.00001, *EXPONENTS])
def test_the_force_is_half_at_half_the_width(n: float) -> None:
    wave = _unit(n)
    assert wave.uncertainty < 1e-10
    assert float(wave.force(0.5 * wave.width)) == pytest.approx(0.5 * wave.peak_force, rel=1e-13 * n)
    assert float(wave.force(0.0)) == pytest.approx(wave.peak_force, rel=1e-14 * n)
    assert float(wave.velocity(0.0)) == pytest.approx(wave.peak_velocity, rel=1e-14)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_round_off_does_not_refuse_a_wave_that_is_allowed(sign: float, monkeypatch: pytest.MonkeyPatch) -> None:
    # planted: last digits of the sines, as another libm may have them; signs that alternate leave most at the edge
    sound = np.sinc
    monkeypatch.setattr(np, "sinc", lambda x: sound(x) * (1.0 + sign * EPS * (-1.0) ** np.arange(len(x))))
    solitary.wave_shape.cache_clear()
    try:
        assert wave_shape(2.00001).uncertainty < 1e-10
    finally:
        solitary.wave_shape.cache_clear()


def test_near_two_the_wave_is_the_gaussian_of_the_log_kdv_equation() -> None:
    n = 2.0 + 1e-4
    wave = _unit(n)
    x = np.linspace(0.0, 1.5, 7) * wave.width
    # corrections are of order n - 2 (James & Pelinovsky 2014): a few times 1e-4
    np.testing.assert_allclose(
        wave.overlap(x) / wave.peak_overlap, np.exp(-3.0 * (n - 2.0) * x**2), rtol=0.0, atol=5e-4
    )


def test_a_hard_exponent_hands_on_all_momentum_to_one_body() -> None:
    # n -> infinity: binary collisions. Sum of v = m v_max and of energies = m v_max^2 / 2, with one body moving
    assert _unit(50.0).momentum == pytest.approx(1.0, abs=1e-8)
    assert _unit(50.0).energy == pytest.approx(0.5, abs=1e-8)


def test_nesterenkos_long_wave_speed_is_off_by_the_known_percent() -> None:
    # c = (2/(p+1))^(1/2) A^((p-1)/2) for overlaps A (Nesterenko 2001, eq. 1.47 in grains): 1.2 % off for the chain
    wave = _unit(2.5)
    nesterenko = math.sqrt(2.0 / 2.5) * wave.peak_overlap**0.25
    assert nesterenko / wave.speed - 1.0 == pytest.approx(-0.0123, abs=5e-4)


def _launched(n: float, *, bodies: int, start: float, duration_grains: float) -> tuple[Trajectory, SolitaryWave]:
    m, beta = 0.01, 4e9 * 1e-5 ** (2.5 - n)
    wave = solitary_wave(mass=m, stiffness=beta, exponent=n, peak_velocity=0.5)
    contact = np.arange(bodies - 1.0)
    scene = Scene(
        name="launched",
        duration=duration_grains / wave.speed,
        mass=(m,) * bodies,
        stiffness=(beta,) * (bodies - 1),
        exponent=n,
        gap=tuple((-wave.overlap(start - contact)).tolist()),
        velocity=tuple(wave.velocity(start - np.arange(bodies) + 0.5).tolist()),
        samples=40,
    )
    return db.solve(scene, backend="reference", uncertainty=False), wave


@pytest.mark.parametrize(("n", "bodies"), [(2.5, 50), (3.0, 45), (2.2, 60)])
def test_a_wave_launched_into_a_chain_keeps_its_shape_and_speed(n: float, bodies: int) -> None:
    start, way = 0.5 * bodies - 10.0, 20.0
    run, wave = _launched(n, bodies=bodies, start=start, duration_grains=way)
    centre = start + wave.speed * run.time[:, None]
    v = wave.velocity(centre - np.arange(bodies) + 0.5)
    force = wave.force(centre - np.arange(bodies - 1.0))
    # the profile is good to 1e-15 and the reference to 1e-13 of the scales; 20 grains of way magnify both a little
    assert np.max(np.abs(run.velocity - v)) < 1e-11 * wave.peak_velocity
    assert np.max(np.abs(run.contact_force - force)) < 1e-11 * wave.peak_force
    passed = slice(int(start) + 2, int(start + way) - 2)
    assert run.peak_force[passed] == pytest.approx(wave.peak_force, rel=1e-11)
    contact = np.arange(bodies - 1.0)[passed]
    assert run.crossing_time[passed] == pytest.approx((contact - start) / wave.speed, abs=1e-11 * run.time[-1])
    assert run.displacement[-1].max() == pytest.approx(wave.shift, rel=1e-11)  # of a body the whole wave has passed


@examples(5)
@given(n=st.floats(2.15, 3.5))
def test_a_launched_wave_of_any_exponent_travels_at_its_speed(n: float) -> None:
    run, wave = _launched(n, bodies=40, start=16.0, duration_grains=8.0)
    times = run.crossing_time[18:23]
    # scipy stands in for exponents without series: 1e-8 of the scales is its promise there
    assert np.diff(times) * wave.speed == pytest.approx(1.0, abs=1e-8)
    assert run.peak_force[18:23] == pytest.approx(wave.peak_force, rel=1e-8)


def test_a_struck_chain_forms_the_wave_by_itself() -> None:
    bodies, m, beta = 120, 0.01, 4e9
    scene = Scene(
        name="struck", duration=6e-3, mass=(m,) * bodies, stiffness=(beta,) * (bodies - 1),
        velocity=(0.5, *[0.0] * (bodies - 1)), samples=2000,
    )  # fmt: skip
    run = db.solve(scene, backend="reference", uncertainty=False)
    far = slice(90, 110)
    wave = solitary_wave(mass=m, stiffness=beta, exponent=2.5, peak_force=float(run.peak_force[100]))
    speed = 1.0 / np.diff(run.crossing_time[far])
    # a hundred grains away the smaller waves of the same impact have fallen behind: the reference's 1e-13 are left, of
    # times that are a hundred times what is subtracted from them
    assert run.peak_force[far] == pytest.approx(wave.peak_force, rel=1e-12)
    assert speed == pytest.approx(wave.speed, rel=1e-11)
    # samples miss a maximum by at most half their spacing, a curvature's worth: (c dt / 2)^2 v'' / (2 v), v''/v < 5
    missed = 0.5 * 5.0 * (0.5 * wave.speed * run.time[1]) ** 2
    fastest = run.velocity[:, far].max(axis=0) / wave.peak_velocity
    assert np.all((fastest < 1.0 + 1e-11) & (fastest > 1.0 - missed))
    # within the leading wave: nearly all energy of the striker, and more than its momentum (the striker bounces back)
    assert 0.99 < wave.energy / (0.5 * m * 0.5**2) < 1.0 < wave.momentum / (m * 0.5)


@pytest.mark.parametrize("n", [2.0, 1.5, math.nan, math.inf, "5/2", True])
def test_exponents_without_a_wave_are_refused(n: object) -> None:
    with pytest.raises(ValueError, match=r"exponent = .*; allowed: .* > 2; at n = 2 the chain is linear"):
        solitary_wave(mass=1.0, stiffness=1.0, exponent=n, peak_velocity=1.0)  # type: ignore[arg-type]


@pytest.mark.parametrize(("n", "why"), [(2.0 + 1e-8, "ill-conditioned"), (500.0, "too sharp for 1024 points")])
def test_exponents_whose_wave_does_not_converge_are_refused_with_the_reason(n: float, why: str) -> None:
    with pytest.raises(ValueError, match=rf"exponent = {n!r}: no converged solitary wave, .*{why}.*; allowed: 2.00001"):
        solitary_wave(mass=1.0, stiffness=1.0, exponent=n, peak_velocity=1.0)


@pytest.mark.parametrize("size", [{}, {"peak_velocity": 1.0, "peak_force": 1.0}])
def test_the_size_is_given_once(size: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=r"peak_velocity, peak_force: .* given; allowed: exactly one"):
        solitary_wave(mass=1.0, stiffness=1.0, exponent=2.5, **size)


@pytest.mark.parametrize("name", ["mass", "stiffness", "peak_velocity"])
def test_other_numbers_must_be_positive(name: str) -> None:
    with pytest.raises(ValueError, match=rf"^{name} = -1.0; allowed: a finite number > 0"):
        solitary_wave(**({"mass": 1.0, "stiffness": 1.0, "exponent": 2.5, "peak_velocity": 1.0} | {name: -1.0}))


@pytest.mark.parametrize("n", [2.5, 12.0])
def test_a_shape_is_a_series_of_a_power_of_two_on_its_domain(n: float) -> None:
    shape = wave_shape(n)
    points = len(shape.overlap) - 1
    assert points >= 64
    assert points & (points - 1) == 0
    assert shape.half_length == pytest.approx(2.0 + 4.0 / math.sqrt(n - 2.0), rel=1e-15)
    x = np.array([0.0, 0.3, 1.7, 0.999 * shape.half_length, shape.half_length, 2.0 * shape.half_length, -0.3])
    expected = [sum(a * math.cos(math.pi * j * z / shape.half_length) for j, a in enumerate(shape.overlap)) for z in x]
    expected[4] = expected[5] = 0.0  # beyond the domain
    assert shape.series(shape.overlap, x) == pytest.approx(expected, abs=1e-14)
    assert shape.peaks == pytest.approx((sum(shape.overlap), sum(shape.velocity)), rel=1e-14)


def test_a_shape_is_solved_once_and_cannot_be_changed() -> None:
    assert wave_shape(2.5) is wave_shape(2.5)
    with pytest.raises(ValueError, match="read-only"):
        wave_shape(2.5).overlap[0] = 0.0


def test_importing_the_formulas_loads_no_scipy() -> None:
    """Matrices and series need numpy, which every scene loads anyway; scipy costs ten times as long."""
    code = "import sys; import dem_bridge.physics.exact; sys.exit('scipy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_the_long_wave_theory_comes_to_the_chain_as_the_wave_becomes_long() -> None:
    # its errors are of the square of a grain over the width, n - 2: a tenth of n - 2 has a tenth of the error or less
    def errors(n: float) -> np.ndarray:
        theory, wave = long_wave(n), _unit(n)
        by_force = wave.speed / wave.peak_force ** (0.5 * (n - 2.0) / (n - 1.0))
        pairs = (theory.speed_by_velocity, wave.speed), (theory.speed_by_force, by_force), (theory.width, wave.width)
        return np.abs([approximate / exact - 1.0 for approximate, exact in pairs])

    assert np.all(errors(2.01) < 0.15 * errors(2.1))
    assert errors(2.001).max() < 2e-4
    with pytest.raises(
        ValueError, match=r"^exponent = 2\.0; allowed: a finite number > 2; at n = 2 the chain is linear"
    ):
        long_wave(2.0)
