"""Touches in the last step before a sample, and crossings at the end of a run, beside two bodies in closed form."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

import dem_bridge as db
from dem_bridge.runs.uncertainty import moments
from dem_bridge.runs.uncertainty.from_replicas import REFERENCE, replica_uncertainty
from dem_bridge.scene.scene import Damping, Scene
from dem_bridge.trajectory.trajectory import Trajectory
from tests.helpers.awkward_scenes import awkward
from tests.helpers.fake_runs import free_flight
from tests.helpers.many_scenes import many
from tests.runs.uncertainty.measure_bars import try_backend

MASS, SPEED, DURATION, STIFFNESS = (0.5, 1.0), 1.0, 2e-5, 1e10 / 3.0
BOTH = 1.0 / MASS[0] + 1.0 / MASS[1]
FREQUENCY = math.sqrt(STIFFNESS * BOTH)


def touching(since: float, duration: float = DURATION, damping: float = 0.0) -> Scene:
    """Return two bodies, the first of which reaches the second ``since`` seconds before the end."""
    law = Damping(law="dashpot", coefficient=damping) if damping else None
    gap = SPEED * (duration - since)
    return Scene(name="touching", duration=duration, mass=MASS, velocity=(SPEED, 0.0), stiffness=(STIFFNESS,), gap=gap,
                 exponent=2.0, damping=law, samples=4)  # fmt: skip


def last_values(since: float, damping: float) -> tuple[float, float]:
    """Return the displacement of the second body (m) and the force (N) after a short touch, by series in its time."""
    overlap = [0.0, SPEED]
    for j in range(2, 12):
        slowed = damping * BOTH * (j - 1) * overlap[j - 1] + FREQUENCY**2 * overlap[j - 2]
        overlap.append(-slowed / (j * (j - 1)))
    displacement = -sum(overlap[j] * since**j for j in range(2, 12)) / (MASS[1] * BOTH)
    force = sum((STIFFNESS * overlap[j] * since + damping * j * overlap[j]) * since ** (j - 1) for j in range(1, 12))
    return displacement, force


def errors(run: Trajectory, since: float, damping: float) -> tuple[float, float]:
    """Return the error over the uncertainty of the last displacement of the second body and of the peak force."""
    displacement, force = last_values(since, damping)
    moved, pressed = abs(run.displacement[-1, 1] - displacement), abs(run.peak_force[0] - force)
    return moved / float(run.uncertainty.displacement), pressed / float(np.max(run.uncertainty.peak_force))


@pytest.mark.parametrize(
    ("backend", "step", "damping"), [("verlet", 1e-7, 0.0), ("verlet", 1e-7, 50.0), ("blanes-moan", 2e-7, 0.0)]
)
def test_a_touch_in_the_last_step_is_within_the_uncertainty(
    backend: str, step: float, damping: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    # awkward-100: all runs drift through their last step before they feel the contact, peaks were 184 uncertainties off
    for part in (0.03, 0.1, 0.2, 0.5, 0.9, 1.5):
        since = part * step
        run = db.solve(touching(since, damping=damping), backend=backend, dt=step)
        assert max(errors(run, since, damping)) <= 1.0, part
    monkeypatch.setattr(moments, "RECENT", 0.0)
    run = db.solve(touching(0.03 * step, damping=damping), backend=backend, dt=step)
    assert max(errors(run, 0.03 * step, damping)) > 2.0


@pytest.mark.parametrize("backend", ["scipy", "reference"])
def test_the_last_digits_of_a_late_touch_are_in_the_uncertainty_of_its_force(backend: str) -> None:
    # a contact of n = 1.5 closes 5e-8 s before the end at 7.6e-4 s: its force was 227 uncertainties off
    [trial] = try_backend(backend, [(scene, truth) for scene, truth in awkward() if scene.name == "awkward-100"])
    assert trial.ratio["peak_force"] <= 1.0


def test_a_force_at_the_end_is_as_uncertain_as_the_time_of_its_touch() -> None:
    run = db.solve(touching(5e-8, duration=8e-4), backend="scipy")
    # the stiffness times the way of 2e-15 of that time; the closing rate has fallen by 2e-5 of it since the touch
    assert float(np.max(run.uncertainty.peak_force)) >= 0.999 * STIFFNESS * SPEED * 2e-15 * 8e-4


@pytest.mark.parametrize("backend", ["ode45", "reference", "scipy"])
def test_a_crossing_that_may_be_after_the_end_is_unknown(backend: str) -> None:
    # awkward-352 and awkward-376: a crossing of 1.1151 +- 0.005 ms in a run of 1.1158 ms, where there is none
    until = 3e-4 + 0.5 * math.pi / FREQUENCY
    for share, known in ((-1e-9, backend != "ode45"), (1e-9, backend != "ode45"), (0.1, True)):
        duration = until * (1.0 + share)
        run = db.solve(replace(touching(duration - 3e-4, duration=duration)), backend=backend)
        [crossing] = np.broadcast_to(run.uncertainty.crossing_time, (1,)).tolist()
        assert math.isfinite(crossing) is known
        assert not known or bool(np.isfinite(run.crossing_time[0])) is (share > 0.0)


def test_a_contact_that_never_crosses_does_not_vouch_for_the_crossings_of_others() -> None:
    # the differences of its first contact were small by chance; half of the others never cross, and differ by nothing
    [trial] = try_backend("verlet", [pair for pair in many() if pair[0].name == "many-1171"])
    assert max(trial.ratio.values()) <= 1.0


def test_forces_below_the_last_digit_of_the_largest_do_not_widen_those_above() -> None:
    # many-521: ahead of the front forces of 1e-18 of the largest differ by a part of themselves
    peaks = np.array([10.0, 20.0, 1e-17, 1e-18, 1e-19])
    run = free_flight(bodies=6, contacts=5, peak_force=peaks)
    found = replica_uncertainty(run, [replace(run, peak_force=peaks * np.array([1, 1, 1.5, 1.5, 1.5]))], REFERENCE)
    assert np.max(found.peak_force) < 1e-13
    # but an error of half of the contacts, above the last digits, is as likely in the others
    found = replica_uncertainty(run, [replace(run, peak_force=peaks * np.array([1, 1 + 1e-9, 1, 1, 1]))], REFERENCE)
    assert found.peak_force[1] == pytest.approx(9.0 * 20e-9, rel=1e-3)
