"""Drift of a long run: bars that hold for swings and for walks, and a swing that is known from the step."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import linregress

from dem_bridge.backends.twin import solve_plan
from dem_bridge.errors import UsageError
from dem_bridge.observables.conserved import energy, energy_parts
from dem_bridge.observables.drift import drift_of, swing_of
from dem_bridge.scene.scene import Scene, Wall
from dem_bridge.trajectory.dense import Schedule
from dem_bridge.trajectory.trajectory import Trajectory

Floats = NDArray[np.float64]
TIME = np.linspace(0.0, 2.0, 2001)
#: series without a drift, of about the same size
SERIES: dict[str, Callable[[np.random.Generator], Floats]] = {
    "noise": lambda rng: rng.standard_normal(len(TIME)),
    "walk": lambda rng: np.cumsum(rng.standard_normal(len(TIME))) / np.sqrt(len(TIME)),
    "swing": lambda rng: np.sin(50.0 * TIME + rng.uniform(0.0, 6.0)),
}


@pytest.mark.parametrize("kind", SERIES)
def test_bars_hold_for_swings_and_for_walks(kind: str) -> None:
    rng, slope = np.random.default_rng(6), 0.3
    found = [drift_of(TIME, slope * TIME + SERIES[kind](rng)) for _ in range(300)]
    inside = np.mean([abs(one.slope - slope) <= one.bar for one in found])
    # 95 %; of 300 such drawings, fewer than 91 % are inside once in a thousand
    assert inside >= 0.91


def test_a_bar_that_took_a_walk_for_noise_would_not_hold() -> None:
    """What a least-squares fit says of its own slope is many times too small on a walk."""
    rng = np.random.default_rng(7)
    found = [drift_of(TIME, SERIES["walk"](rng)) for _ in range(300)]
    assert np.mean([abs(one.slope) <= 2.1 * one.swing for one in found]) < 0.8
    assert np.mean([abs(one.slope) <= one.bar for one in found]) > 0.91


@pytest.mark.parametrize("kind", SERIES)
def test_a_drift_above_its_bar_is_found(kind: str) -> None:
    quiet = drift_of(TIME, SERIES[kind](np.random.default_rng(8)))
    for sign in (-1.0, 1.0):
        loud = drift_of(TIME, SERIES[kind](np.random.default_rng(8)) + sign * 3.0 * quiet.bar * TIME)
        assert loud.found
        # the fit is linear in the series
        assert loud.slope == pytest.approx(quiet.slope + sign * 3.0 * quiet.bar, rel=1e-9)
        assert loud.bar == pytest.approx(quiet.bar, rel=0.5)


def test_slope_and_standard_errors_are_those_of_a_line_through_the_means_of_twenty_blocks() -> None:
    # two samples a block; block means by hand, and a regression that shares nothing with the code
    time = 5.0 + 0.5 * np.arange(40.0)
    series = 3.0 + 0.2 * time + np.random.default_rng(11).standard_normal(40)
    found = drift_of(time, series)
    when, means = time.reshape(20, 2).mean(axis=1), series.reshape(20, 2).mean(axis=1)
    line = linregress(when, means)
    assert (found.slope, found.swing) == pytest.approx((line.slope, line.stderr), rel=1e-10)
    # a walk: 19 steps from block to block, of which a mean sees 2/3 of the variance, and a line 6/5
    steps = means[1:] - means[:-1]
    variance = np.sum((steps - np.mean(steps)) ** 2) / 18.0
    assert found.walk == pytest.approx(np.sqrt(6 / 5 * 3 / 2 * 19.0 * variance) / 19.0, rel=1e-10)
    # Student's t of 18 degrees of freedom leaves 2.5 % on each side
    assert found.bar == pytest.approx(2.10092204024 * max(found.walk, found.swing), rel=1e-10)
    assert found.duration == 19.5
    assert found.total == pytest.approx((19.5 * found.slope, 19.5 * found.bar), rel=1e-15)
    assert found.found == (abs(found.slope) > found.bar)
    assert not replace(found, slope=-found.bar).found
    assert replace(found, slope=-1.0001 * found.bar).found
    with pytest.raises(UsageError, match=r"^39 samples of a series; allowed: at least 40,"):
        drift_of(time[:39], series[:39])


def test_too_short_a_series_has_no_drift() -> None:
    with pytest.raises(UsageError, match="30 samples of a series; allowed: at least 40"):
        drift_of(TIME[:30], TIME[:30])


def held(exponent: float) -> Scene:
    wall = Wall(stiffness=1e6 if exponent == 2.0 else 4e9)
    return Scene(name="held", duration=0.02, mass=(1e-2,) * 4, stiffness=(wall.stiffness,) * 3, exponent=exponent,
                 velocity=(0.01, 0.0, 0.0, 0.0), wall_left=wall, wall_right=wall, precompression=10.0)  # fmt: skip


def run(scene: Scene, dt: float) -> Trajectory:
    count = round(scene.duration / dt)
    return solve_plan(scene, Schedule(step=dt, per_sample=1, subdivisions=1, samples=count))


@pytest.mark.parametrize("exponent", [2.0, 2.5])
def test_what_velocity_verlet_conserves_is_known_to_fourth_order(exponent: float) -> None:
    """No contact opens here, so that the law is smooth."""
    scene = held(exponent)
    found: dict[float, tuple[float, float, float]] = {}
    for dt in (4e-6, 2e-6):
        one = run(scene, dt)
        total = energy(scene, one)
        kept = total + swing_of(scene, one, dt)
        found[dt] = (
            float(np.ptp(total)),
            float(np.ptp(kept)),
            float(np.ptp(total - swing_of(scene, one, dt))),
        )
    (swing, left, wrong), (half_swing, half_left, _) = found.values()
    # second and fourth order; what is left is of two orders more, 3 % at these steps
    assert swing / half_swing == pytest.approx(4.0, rel=0.05)
    assert left / half_left == pytest.approx(16.0, rel=0.1)
    assert left < 0.05 * swing
    # planted: of the wrong sign it is twice the swing
    assert wrong == pytest.approx(2.0 * swing, rel=0.1)


def test_a_code_that_loses_energy_is_told_from_one_that_does_not() -> None:
    scene = held(2.5)
    drag = 0.02
    for one, lost in ((scene, 0.0), (replace(scene, drag=drag), drag)):
        motion = run(one, 4e-6)
        kinetic, _, _ = energy_parts(one, motion)
        kept = energy(one, motion) + swing_of(one, motion, 4e-6)
        found = drift_of(motion.time, kept)
        # the power of the drag is -b m v^2
        expected = -2.0 * lost * float(np.mean(kinetic))
        assert abs(found.slope - expected) <= 2.0 * found.bar + 0.05 * abs(expected)
        assert found.found == (lost > 0.0)
