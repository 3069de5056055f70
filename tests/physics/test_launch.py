"""The pulse that a striker makes: long runs of the reference, and what depends on the exponent alone."""

from __future__ import annotations

import numpy as np
import pytest

import dem_bridge as db
from dem_bridge.physics.launch import first_peak, launched
from dem_bridge.physics.solitary import solitary_wave
from dem_bridge.scene.scene import Scene


@pytest.mark.parametrize("n", [2.5, 3.0, 3.5])
def test_the_launch_is_that_of_a_long_run_of_the_reference(n: float) -> None:
    m0, m, beta0, beta, v = 0.012, 0.01, 3e9, 4e9, 0.8
    launch = launched(masses=(m0, m), stiffnesses=(beta0, beta), exponents=(n, n), velocity=v)
    unit = (m * v**2 / beta) ** (1.0 / n) / v
    scene = Scene(
        name="launch",
        duration=80.0 * unit,
        mass=(m0, *[m] * 80),
        stiffness=(beta0, *[beta] * 79),
        exponent=n,
        velocity=(v, *[0.0] * 80),
        samples=1,
    )
    run = db.solve(scene, backend="reference", uncertainty=False)
    exact = solitary_wave(mass=m, stiffness=beta, exponent=n, peak_force=float(run.peak_force[50]))
    # read off where it is formed to 1e-6, from a run of relative tolerance 1e-9
    assert launch.energy == pytest.approx(exact.energy, rel=1e-5)
    assert launch.share == pytest.approx(exact.energy / (0.5 * m0 * v**2), rel=1e-5)
    assert launch.start == pytest.approx(run.crossing_time[50] - 50.5 / exact.speed, abs=1e-4 / exact.speed)
    np.testing.assert_allclose(launch.force_ratio, (run.peak_force / run.peak_force[50])[: len(launch.late)], rtol=1e-5)
    expected = run.crossing_time - launch.start - (np.arange(79 + 1.0) + 0.5) / exact.speed
    np.testing.assert_allclose(launch.late, expected[: len(launch.late)], atol=1e-4 / exact.speed)


def test_the_launch_of_equal_bodies_depends_on_the_exponent_alone() -> None:
    shares = [
        launched(masses=(m, m), stiffnesses=(beta, beta), exponents=(2.5, 2.5), velocity=v).share
        for m, beta, v in ((1.0, 1.0, 1.0), (0.01, 4e9, 0.8), (1e3, 1e-2, 1e-3))
    ]
    assert shares == [shares[0]] * 3
    hard = launched(masses=(1.0, 1.0), stiffnesses=(1.0, 1.0), exponents=(50.0, 50.0), velocity=1.0)
    assert hard.share == pytest.approx(1.0, abs=1e-6)  # binary collisions; integrated to 1e-9


@pytest.mark.parametrize(("n", "first"), [(2.5, 16), (3.0, 12)])
def test_a_pulse_is_read_off_twenty_contacts_beyond_twice_its_half_length(n: float, first: int) -> None:
    launch = launched(masses=(1.0, 1.0), stiffnesses=(1.0, 1.0), exponents=(n, n), velocity=1.0)
    # half lengths of 2 + 4/sqrt(n - 2): twice them rounded up, twenty more, and contact 0
    assert len(launch.force_ratio) == len(launch.late) == first + 20 + 1
    assert (launch.force_ratio[-1], launch.late[-1]) == (1.0, 0.0)
    assert not launch.force_ratio.flags.writeable
    assert launch.energy == 0.5 * launch.share
    # the wave of that energy has that speed
    unit = solitary_wave(mass=1.0, stiffness=1.0, exponent=n, peak_velocity=1.0)
    assert launch.speed == pytest.approx(unit.speed * (launch.energy / unit.energy) ** (0.5 - 1.0 / n), rel=1e-12)


def test_a_launch_through_another_contact_is_the_same_at_all_scales() -> None:
    unit = launched(masses=(0.5, 1.0), stiffnesses=(2.0, 1.0), exponents=(2.0, 2.5), velocity=1.0)
    m, beta, v = 0.01, 4e9, 0.8
    length = (m * v**2 / beta) ** 0.4
    # the linear contact's force at this overlap is twice that of the others
    soft = 2.0 * beta * length**1.5 / length
    same = launched(masses=(0.5 * m, m), stiffnesses=(soft, beta), exponents=(2.0, 2.5), velocity=v)
    assert same.share == pytest.approx(unit.share, rel=1e-7)  # integrated to 1e-9
    assert same.energy == pytest.approx(same.share * 0.25 * m * v**2, rel=1e-14)
    assert same.speed == pytest.approx(unit.speed * v / length, rel=1e-7)
    assert same.start == pytest.approx(unit.start * length / v, rel=1e-6)
    np.testing.assert_allclose(same.late, unit.late * length / v, atol=1e-6 * length / v)
    scene = Scene(name="launch", duration=70.0, mass=(0.5, *[1.0] * 70), stiffness=(2.0, *[1.0] * 69),
                  exponent=(2.0, *[2.5] * 69), velocity=(1.0, *[0.0] * 70), samples=1)  # fmt: skip
    run = db.solve(scene, backend="scipy", uncertainty=False)
    exact = solitary_wave(mass=1.0, stiffness=1.0, exponent=2.5, peak_force=float(run.peak_force[50]))
    assert unit.share == pytest.approx(exact.energy / 0.25, rel=1e-5)
    assert unit.start == pytest.approx(run.crossing_time[50] - 50.5 / exact.speed, abs=1e-3 / exact.speed)


@pytest.mark.parametrize(("noise", "at"), [(0.9e-3, 0.63), (1.2e-3, 0.2)])
def test_a_first_peak_is_the_vertex_of_a_parabola_above_a_thousandth_of_the_largest(noise: float, at: float) -> None:
    time = np.linspace(0.0, 1.0, 101)
    overlap = np.maximum(2.0 - 50.0 * (time - 0.63) ** 2, 0.0) + np.where(time == 0.2, 2.0 * noise, 0.0)
    force, when = first_peak(time + 5.0, overlap, 3.0, 1.5)
    assert when == pytest.approx(5.0 + at, rel=1e-12)
    assert force == pytest.approx(3.0 * (2.0 if at == 0.63 else 2.0 * noise) ** 1.5, rel=1e-9)
    # between samples
    shifted = np.maximum(2.0 - 50.0 * (time - 0.6337) ** 2, 0.0)
    assert first_peak(time, shifted, 3.0, 1.5) == pytest.approx((3.0 * 2.0**1.5, 0.6337), rel=1e-12)
    # two equal samples are one peak, between them
    assert first_peak(np.arange(4.0), np.array([0.0, 1.0, 1.0, 0.0]), 1.0, 1.0)[1] == pytest.approx(1.5)


def test_a_launch_refuses_what_is_no_striker() -> None:
    for key, value in (
        ("masses", (0.0, 1.0)),
        ("stiffnesses", (1.0, -1.0)),
        ("exponents", (2.5, 2.0)),
        ("velocity", 0),
    ):
        arguments = {"masses": (1.0, 1.0), "stiffnesses": (1.0, 1.0), "exponents": (2.5, 2.5), "velocity": 1.0}
        with pytest.raises(ValueError, match="allowed"):
            launched(**(arguments | {key: value}))  # type: ignore[arg-type]
