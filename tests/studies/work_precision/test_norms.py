"""Errors in several norms: the largest is that of every comparison, and what has no value is never small."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import dem_bridge as db
from dem_bridge.observables.differences import difference
from dem_bridge.observables.front import residence_time
from dem_bridge.observables.registry import OBSERVABLES
from dem_bridge.scene.file import load_scene
from dem_bridge.scene.scene import Scene
from dem_bridge.studies.work_precision.runs import NORMS, Norms, errors_of, readings_of, uncertainties_of
from dem_bridge.trajectory.trajectory import Trajectory

CHAIN = replace(load_scene("decelerating-40"), name="short", duration=3e-4)


@pytest.fixture(scope="module")
def truth() -> Trajectory:
    return db.solve(CHAIN, backend="reference")


@pytest.fixture(scope="module")
def run() -> Trajectory:
    return db.solve(CHAIN, backend="verlet", dt=6e-7, uncertainty=False)


def errors(run: Trajectory, reference: Trajectory, scene: Scene = CHAIN) -> Norms:
    return errors_of(scene, run, readings_of(scene, reference))


def test_the_largest_is_that_of_a_difference(run: Trajectory, truth: Trajectory) -> None:
    found, bars = errors(run, truth), uncertainties_of(readings_of(CHAIN, truth))
    for name in readings_of(CHAIN, truth):
        whole = difference(name, run, truth, CHAIN)
        assert found[name, "max"] == whole.value
        assert bars[name, "max"] == whole.reference_uncertainty


def test_residence_times_are_relative_to_each_bodys_own(run: Trajectory, truth: Trajectory) -> None:
    mine, true = residence_time(CHAIN, run)[1:-1], residence_time(CHAIN, truth)[1:-1]
    reached = np.isfinite(true)
    assert 0 < np.count_nonzero(reached) < len(true)  # the short run ends before the wave does
    relative = np.abs(mine - true)[reached] / np.abs(true)[reached]
    assert errors(run, truth)["residence_time", "max"] == np.max(relative)
    # bodies that are not reached do not make the mean smaller
    assert errors(run, truth)["residence_time", "mean"] == pytest.approx(np.mean(relative), rel=1e-12)


def test_an_observable_without_a_value_has_no_error(run: Trajectory, truth: Trajectory) -> None:
    names = {name for name, _ in errors(run, truth)}
    assert set(OBSERVABLES) - names == {"arrival_at_end"}
    bare = replace(CHAIN, name="bare", spacing=None, geometry=None)
    assert {name for name, _ in errors(run, truth, bare)} == names - {"wave_speed"}


def test_norms_are_ordered_and_of_one_scale(run: Trajectory, truth: Trajectory) -> None:
    found = errors(run, truth)
    assert {norm for _, norm in found} == set(NORMS)
    for name in readings_of(CHAIN, truth):
        # Jensen: mean <= rms <= max, and all are above zero for a run at a coarse step
        assert 0.0 < found[name, "mean"] < found[name, "rms"] < found[name, "max"]
    apart = np.abs(run.velocity - truth.velocity) / np.max(np.abs(truth.velocity))
    # the same sums in another order: numbers of one sign lose an ulp each at most
    assert found["velocity", "rms"] == pytest.approx(np.linalg.norm(apart) / np.sqrt(apart.size), rel=1e-12)
    assert found["velocity", "mean"] == pytest.approx(apart.sum() / apart.size, rel=1e-12)


def test_what_only_one_of_two_has_is_infinitely_far(run: Trajectory, truth: Trajectory) -> None:
    times = np.array(run.crossing_time)
    times[0] = np.nan
    found = errors(replace(run, crossing_time=times), truth)
    assert all(np.isinf(found["arrival", norm]) for norm in NORMS)
    assert all(np.isfinite(found["peak_force", norm]) for norm in NORMS)


def test_a_run_is_no_distance_from_itself(truth: Trajectory) -> None:
    assert set(errors(truth, truth).values()) == {0.0}


def test_a_scene_in_which_nothing_moves_has_no_errors() -> None:
    still = replace(CHAIN, name="still", velocity=(0.0,) * CHAIN.n_body)
    truth, run = (db.solve(still, backend=name, uncertainty=False, samples=2) for name in ("reference", "verlet"))
    assert set(errors(run, truth, still).values()) == {0.0}


def test_a_reference_without_bars_leaves_every_error_unknown(truth: Trajectory) -> None:
    bare = db.solve(CHAIN, backend="reference", uncertainty=False)
    assert all(np.isinf(bar) for bar in uncertainties_of(readings_of(CHAIN, bare)).values())
