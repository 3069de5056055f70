"""Errors in several norms: the largest is that of every comparison, and what has no value is never small."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import dem_bridge as db
from dem_bridge.differences import difference
from dem_bridge.observables.front import residence_by_crossing
from dem_bridge.scene_file import load_scene
from dem_bridge.studies.work_precision.norms import NORMS, OBSERVABLES, bars_of, errors_of
from dem_bridge.trajectory import Trajectory

CHAIN = replace(load_scene("decelerating-40"), name="short", duration=3e-4)


@pytest.fixture(scope="module")
def truth() -> Trajectory:
    return db.solve(CHAIN, backend="reference")


@pytest.fixture(scope="module")
def run() -> Trajectory:
    return db.solve(CHAIN, backend="verlet", dt=6e-7, bars=False)


def test_the_largest_is_that_of_compare() -> None:
    whole = load_scene("decelerating-40")  # until the wave has come to the end, so that all contacts have a time
    truth = db.solve(whole, backend="reference")
    run = db.solve(whole, backend="verlet", dt=6e-7, bars=False)
    errors, bars = errors_of(whole, run, truth), bars_of(whole, truth)
    for quantity in ("velocity", "displacement", "peak_force", "crossing_time"):
        found = difference(quantity, run, truth)
        name = "arrival_time" if quantity == "crossing_time" else quantity
        assert errors[name, "max"] == found.value
        assert bars[name, "max"] == found.reference_uncertainty


def test_residence_times_are_relative_to_each_bodys_own(run: Trajectory, truth: Trajectory) -> None:
    mine, true = residence_by_crossing(CHAIN, run), residence_by_crossing(CHAIN, truth)
    reached = np.isfinite(true)
    assert 0 < np.count_nonzero(reached) < len(true)  # the short run ends before the wave does
    expected = np.max(np.abs(mine - true)[reached] / np.abs(true)[reached])
    assert errors_of(CHAIN, run, truth)["residence_time", "max"] == expected


def test_norms_are_ordered_and_of_one_scale(run: Trajectory, truth: Trajectory) -> None:
    errors = errors_of(CHAIN, run, truth)
    assert set(errors) == {(name, norm) for name in OBSERVABLES for norm in NORMS}
    for name in OBSERVABLES:
        # Jensen: mean <= rms <= max, and all are above zero for a run at a coarse step
        assert 0.0 < errors[name, "mean"] < errors[name, "rms"] < errors[name, "max"]
    apart = np.abs(run.velocity - truth.velocity) / np.max(np.abs(truth.velocity))
    # the same sums in another order: numbers of one sign lose an ulp each at most
    assert errors["velocity", "rms"] == pytest.approx(np.linalg.norm(apart) / np.sqrt(apart.size), rel=1e-12)
    assert errors["velocity", "mean"] == pytest.approx(apart.sum() / apart.size, rel=1e-12)


def test_what_only_one_of_two_has_is_infinitely_far(run: Trajectory, truth: Trajectory) -> None:
    times = np.array(run.crossing_time)
    times[0] = np.nan
    errors = errors_of(CHAIN, replace(run, crossing_time=times), truth)
    assert all(np.isinf(errors["arrival_time", norm]) for norm in NORMS)
    assert all(np.isfinite(errors["peak_force", norm]) for norm in NORMS)


def test_a_run_is_no_distance_from_itself(truth: Trajectory) -> None:
    assert set(errors_of(CHAIN, truth, truth).values()) == {0.0}


def test_a_scene_in_which_nothing_moves_has_no_errors() -> None:
    still = replace(CHAIN, name="still", velocity=(0.0,) * CHAIN.n_body)
    truth, run = (db.solve(still, backend=name, bars=False, samples=2) for name in ("reference", "verlet"))
    assert set(errors_of(still, run, truth).values()) == {0.0}


def test_a_reference_without_bars_leaves_every_error_unknown(truth: Trajectory) -> None:
    bare = db.solve(CHAIN, backend="reference", bars=False)
    assert all(np.isinf(bar) for bar in bars_of(CHAIN, bare).values())
