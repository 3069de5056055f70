"""Uncertainties hold on collisions whose closed form is known, where all runs of one kind may err alike."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import dem_bridge as db
from dem_bridge.backends import ode45
from dem_bridge.runs.uncertainty import from_own_steps as own_steps
from dem_bridge.runs.uncertainty import from_twins as twins
from dem_bridge.runs.uncertainty import readings
from dem_bridge.runs.uncertainty.from_replicas import ReplicaRule, looser_rule, replica_uncertainty
from dem_bridge.trajectory.trajectory import Trajectory
from tests.helpers.exact_collision import Collision, collision
from tests.helpers.fake_runs import free_flight

#: backend, collision, settings (``dt`` as a multiple of the time from touch to the peak), and a quantity that was
#: outside, by the factor beside it. The peaks of 0 +- 0 lie between steps, and displacements of 0 bars are those of
#: runs that all pass over the contact
COLLISIONS: dict[str, tuple[str, dict[str, Any], dict[str, Any], str]] = {
    "the replica errs as the run does, n = 1.5 (2.8)": ("ode45", {
        "mass": (0.0012, 2.56e-05), "velocity": (0.003468, 0.0), "stiffness": 4.392e9, "exponent": 1.5, "gap": 1.256,
        "rest": 4.997,
    }, {"samples": 2, "rtol": 0.00267}, "velocity"),
    "the replica errs as the run does, n = 2 (4.1)": ("ode45", {
        "mass": (0.02264, 0.001129), "velocity": (64.39, 32.06), "stiffness": 6546000.0, "exponent": 2.0, "gap": 0.0,
        "rest": 11.1,
    }, {"samples": 10}, "displacement"),
    "the replica errs as the run does, n = 1.1 (46)": ("ode45", {
        "mass": (0.4094, 1.595), "velocity": (32.1, 14.03), "stiffness": 1652000.0, "exponent": 1.1, "gap": 0.0,
        "rest": 0.5256,
    }, {"samples": 1, "atol": 4.83e-08}, "velocity"),
    "the replica errs as the run does, n = 2.0000017 (1.1)": ("ode45", {
        "mass": (0.01493, 0.0008774), "velocity": (0.0005587, 0.0), "stiffness": 8.34e9, "exponent": 2.0000017,
        "gap": 0.0, "rest": 0.3026,
    }, {"samples": 10}, "velocity"),
    "a peak of 0 +- 0, n = 4.4": ("blanes-moan", {
        "mass": (0.02107, 1.196), "velocity": (0.3305, -0.0432), "stiffness": 15570.0, "exponent": 4.38, "gap": 0.0,
        "rest": 5.825,
    }, {"samples": 1, "dt": 49.1}, "peak_force"),
    "a peak of 0 +- 0, n = 5.5": ("blanes-moan", {
        "mass": (0.002844, 0.0202), "velocity": (-0.03001, -0.139), "stiffness": 2.005e10, "exponent": 5.53,
        "gap": 0.0, "rest": 27.97,
    }, {"samples": 2, "dt": 11.5}, "peak_force"),
    "no crossing, with a finite bar": ("blanes-moan", {
        "mass": (0.02719, 0.0009877), "velocity": (0.4276, 0.0), "stiffness": 159100.0, "exponent": 50.0,
        "gap": 3.483, "rest": 1.946,
    }, {"samples": 3, "dt": 49.9}, "crossing_time"),
    "no step sees the contact": ("verlet", {
        "mass": (0.0416, 0.3669), "velocity": (0.01353, 0.0), "stiffness": 2499000.0, "exponent": 20.0, "gap": 10.02,
        "rest": 0.2049,
    }, {"samples": 1, "dt": 18.6}, "displacement"),
    "no crossing of a stiff contact": ("verlet", {
        "mass": (0.002317, 2.531e-05), "velocity": (0.04298, -0.00226), "stiffness": 17420000.0, "exponent": 50.0,
        "gap": 0.5534, "rest": 11.52,
    }, {"samples": 2, "dt": 91.0}, "crossing_time"),
    "a force beyond all scales, and beyond doubles between steps (2.5)": ("verlet", {
        "mass": (0.0044, 0.001786), "velocity": (0.5229, 0.0), "stiffness": 1046.0, "exponent": 50.0, "gap": 4.471,
        "rest": 30.85,
    }, {"samples": 3, "dt": 3.14}, "peak_force"),
    "three coarse steps err alike, n = 1.1 (1.7)": ("verlet", {
        "mass": (0.2467, 0.01862), "velocity": (9.183, -18.7), "stiffness": 8776.0, "exponent": 1.1, "gap": 0.1093,
        "rest": 0.3383,
    }, {"samples": 1, "dt": 0.0364}, "velocity"),
    "three coarse steps err alike, n = 2 (1.1)": ("verlet", {
        "mass": (0.246, 0.003541), "velocity": (35.15, 19.98), "stiffness": 151.5, "exponent": 2.0, "gap": 1.47,
        "rest": 0.7446,
    }, {"samples": 3, "dt": 0.115}, "peak_force"),
    "a digit of the overlap is 49 of the force": ("scipy", {
        "mass": (0.01899, 0.1431), "velocity": (0.001451, -0.01384), "stiffness": 1.161e8, "exponent": 50.0,
        "gap": 0.0, "rest": 19.87,
    }, {"samples": 1}, "peak_force"),
}  # fmt: skip


def _outside(name: str) -> tuple[set[str], Collision, Trajectory]:
    """Return the quantities that are outside of what a backend states, the collision, and the run."""
    backend, parts, settings, _ = COLLISIONS[name]
    pair = collision(**parts)
    assert pair is not None
    if "dt" in settings:
        closing = parts["velocity"][0] - parts["velocity"][1]
        touch = float(np.ravel(pair.scene.gap)[0]) / closing
        settings = {**settings, "dt": settings["dt"] * (pair.crossing_time - touch)}
    run = db.solve(pair.scene, backend=backend, **settings)
    outside = set(pair.outside(run))
    if np.isnan(run.crossing_time[0]) and np.isinf(run.uncertainty["crossing_time"][0]):
        outside -= {"crossing_time"}  # it says that it has none
    return outside, pair, run


@pytest.mark.parametrize("name", COLLISIONS)
def test_the_uncertainty_holds_on_a_collision(name: str) -> None:
    outside, pair, run = _outside(name)
    assert outside == set()
    # and is not so wide that it says nothing of a run that resolves the contact
    if COLLISIONS[name][2].get("dt", 0.0) < 1.0:
        error = np.max(np.abs(run.velocity[-1] - np.array(pair.velocity)))
        assert run.uncertainty["velocity"] <= 30.0 * error + 1e-9 * np.max(np.abs(pair.velocity))


#: what is planted -> the backends whose uncertainties it spoils
FAULTS: dict[str, tuple[tuple[Any, str, Any], ...]] = {
    "ode45": ((ode45, "TIGHTER", (1e-2,)), (ode45, "REPLICA_SHARES", (0.02,))),
    "blanes-moan": ((own_steps, "finer_ratio", lambda ratio, *steps: ratio),),
    "verlet": ((twins, "finer_ratio", lambda ratio, *steps: ratio),),
}


@pytest.mark.parametrize("name", [name for name, (backend, *_) in COLLISIONS.items() if backend in FAULTS])
def test_without_its_rule_the_truth_is_outside(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    backend, _, _, quantity = COLLISIONS[name]
    for module, constant, planted in FAULTS[backend]:
        monkeypatch.setattr(module, constant, planted)
    assert quantity in _outside(name)[0]


def test_all_runs_may_err_by_the_same_digits_of_an_overlap() -> None:
    _, pair, run = _outside("a digit of the overlap is 49 of the force")
    # no difference shows the planted error: 12 of the 16 units in the last place of the overlap that a run may lose
    alike = replace(run, peak_force=np.array([pair.peak_force * (1.0 + 49.0 * 12.0 * 2.0**-52)]))
    for rule, inside in ((looser_rule(pair.scene), True), (ReplicaRule(samples=3.0, contacts=3.0), False)):
        stated = replica_uncertainty(alike, [alike, alike], rule)
        assert ("peak_force" not in pair.outside(replace(alike, uncertainty=stated))) is inside


def test_with_n_below_2_a_finer_step_resolves_a_contact(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(readings, "SINGULAR", 1.0)
    assert "velocity" in _outside("three coarse steps err alike, n = 1.1 (1.7)")[0]


def test_peaks_follow_velocities_and_forces_the_digits_of_their_overlap() -> None:
    run = free_flight()
    faster = replace(run, velocity=run.velocity * (1.0 + 1e-3))
    plain = ReplicaRule(samples=3.0, contacts=3.0)
    least = replica_uncertainty(run, [faster], plain)["peak_force"]
    np.testing.assert_array_equal(least, 16.0 * 2.0**-52 * 20.0)
    followed = replica_uncertainty(run, [faster], replace(plain, peaks_follow_velocities=True))["peak_force"]
    np.testing.assert_allclose(followed, 3.0 * 1e-3 * run.peak_force, rtol=1e-9)
    conditioned = replica_uncertainty(run, [faster], replace(plain, force_condition=np.array([1.0, 49.0])))
    np.testing.assert_array_equal(conditioned["peak_force"], least * np.array([1.0, 49.0]))
    # of the two runs of ode45 the farther one counts
    [alone, both] = [replica_uncertainty(run, others, plain)["velocity"] for others in ([run], [run, faster])]
    assert both == pytest.approx(9e-3, rel=1e-6)
    assert alone == 16.0 * 2.0**-52 * 3.0
