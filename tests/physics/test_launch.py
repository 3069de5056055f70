"""The pulse that a striker makes: long runs of the reference, and what depends on the exponent alone."""

from __future__ import annotations

import numpy as np
import pytest

import dem_bridge as db
from dem_bridge.physics.launch import launched
from dem_bridge.physics.solitary import solitary_wave
from dem_bridge.scene import Scene


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
