"""Extrapolated runs: far better than the finest of theirs, within their bars, and refused where the order is not."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import dem_bridge as db
from dem_bridge.backends.twin import solve_plan
from dem_bridge.errors import NotAsymptotic, UsageError
from dem_bridge.observables.convergence import richardson
from dem_bridge.runs.case import Case
from dem_bridge.runs.uncertainty import extrapolate
from dem_bridge.trajectory.dense import Schedule
from dem_bridge.trajectory.trajectory import QUANTITIES, Trajectory
from tests.helpers.fake_runs import free_flight
from tests.helpers.quadruple_truth import Truth


@pytest.mark.parametrize("dt", [1e-7, 2e-8])
def test_it_is_twenty_times_better_than_its_finest_run_and_within_its_bars(free_chain: Truth, dt: float) -> None:
    run = db.solve(free_chain.scene, backend="verlet", dt=dt, order="richardson")
    plain = db.solve(free_chain.scene, backend="verlet", dt=0.5 * dt, uncertainty=False)
    # 23 (decelerating, 1e-7 s) to 900 times were found
    assert free_chain.error(run, "velocity") < 0.05 * free_chain.error(plain, "velocity")
    for quantity in QUANTITIES:
        assert np.all(free_chain.error(run, quantity) <= run.uncertainty[quantity]), quantity
    assert run.uncertainty["velocity"] < free_chain.error(plain, "velocity")
    assert run.provenance["extrapolated_from"] == pytest.approx([2.0 * dt, dt, 0.5 * dt])
    assert run.cost.steps == sum(round(free_chain.scene.duration / step) for step in (2.0 * dt, dt, 0.5 * dt))


@pytest.mark.lammps
def test_lammps_is_extrapolated_like_its_twin(accelerating: Truth) -> None:
    scene = replace(accelerating.scene, duration=3e-4, samples=50)
    truth = db.solve(scene, backend="reference", uncertainty=False).velocity
    run = db.solve(scene, backend="lammps-granular", dt=1e-7, order="richardson")
    error = float(np.max(np.abs(run.velocity - truth)))
    assert error <= run.uncertainty["velocity"] < 1e-6


def test_it_is_refused_where_the_order_is_not_clean(decelerating: Truth) -> None:
    with pytest.raises(NotAsymptotic, match=r"observed order .* allowed: 2 \+- 0\.1; refine dt"):
        db.solve(decelerating.scene, backend="verlet", dt=2e-7, order="richardson")


def test_what_has_no_clean_order_is_that_of_the_finest_run(decelerating: Truth) -> None:
    run = db.solve(decelerating.scene, backend="verlet", dt=1e-7, order="richardson")
    assert run.provenance["not_extrapolated"] == ["crossing_time"]
    finest = db.solve(decelerating.scene, backend="verlet", dt=5e-8)
    np.testing.assert_array_equal(run.crossing_time, finest.crossing_time)
    np.testing.assert_array_equal(run.uncertainty["crossing_time"], finest.uncertainty["crossing_time"])


def test_without_bars_nothing_is_claimed(accelerating: Truth) -> None:
    scene = replace(accelerating.scene, duration=1e-4, samples=10)
    run = db.solve(scene, backend="verlet", dt=1e-7, order="richardson", uncertainty=False)
    assert all(np.all(np.isinf(run.uncertainty[quantity])) for quantity in QUANTITIES)
    assert np.all(run.contact_force >= 0.0)


def test_a_code_of_another_order_is_refused(accelerating: Truth, monkeypatch: pytest.MonkeyPatch) -> None:
    """A fault of first order in one run in three, as a stale force is, must not be extrapolated by second order."""

    def drifting(scene: db.Scene, plan: Schedule, *how: Any) -> Trajectory:
        run = solve_plan(scene, plan, *how)
        return replace(run, velocity=run.velocity * (1.0 + 1e3 * float(run.provenance["settings"]["dt"])))

    scene = replace(accelerating.scene, duration=3e-4, samples=50)
    monkeypatch.setattr("dem_bridge.backends.verlet.solve_plan", drifting)
    with pytest.raises(NotAsymptotic, match="no extrapolation"):
        db.solve(scene, backend="verlet", dt=5e-8, order="richardson")


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"backend": "verlet", "order": "aitken"}, r"order = 'aitken'; allowed: 'richardson'"),
        ({"backend": "scipy", "order": "richardson"}, r"'richardson' with scipy, which has no fixed step"),
    ],
)
def test_wrong_use_is_one_line(accelerating: Truth, settings: dict[str, Any], words: str) -> None:
    with pytest.raises(UsageError, match=words):
        db.solve(accelerating.scene, **settings)


def test_forces_are_extrapolated_by_the_weight_of_the_order_and_round_off_is_magnified() -> None:
    pair = db.Scene(name="pair", duration=5e-5, mass=(8e-3, 1e-2), stiffness=(4e9,), velocity=(0.8, 0.0), samples=5)
    run = db.solve(pair, backend="verlet", dt=1e-7, order="richardson")
    main, fine = (db.solve(pair, backend="verlet", dt=dt) for dt in (1e-7, 5e-8))
    expected = fine.contact_force + (fine.contact_force - main.contact_force) / 3.0
    np.testing.assert_allclose(run.contact_force, expected, rtol=1e-14)
    # weights of 4/3 and -1/3
    coarse = db.solve(pair, backend="verlet", dt=2e-7, uncertainty=False)
    floor = fine.uncertainty.parts["round_off"] * float(np.max(np.abs(fine.velocity)))
    rows = [each.velocity.ravel().tolist() for each in (coarse, main, fine)]
    plain = richardson(run.provenance["extrapolated_from"], rows, order=2, floor=floor).uncertainty
    assert run.uncertainty["velocity"] - plain == pytest.approx(5.0 / 3.0 * floor, rel=1e-3, abs=0.0)
    assert floor > 0.0


@pytest.mark.parametrize("clip", [True, False])
def test_an_extrapolated_force_is_clipped_where_the_contact_force_is(
    clip: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    def run(case: Case, code: object = None) -> Trajectory:
        """Return values with an error of second order; a force that falls faster than that."""
        dt = case.resolution.dt
        assert dt is not None
        error = 1.0 + dt**2
        flight = free_flight(
            contacts=2, contact_force=np.full((5, 2), {2.0: 4.0, 1.0: 1.0, 0.5: 0.1}[dt]),
            peak_force=error * np.ones(2), crossing_time=error * np.ones(2), provenance={"settings": {"dt": dt}},
        )  # fmt: skip
        return replace(
            flight,
            velocity=error * flight.velocity,
            displacement=error * flight.displacement,
            uncertainty=replace(flight.uncertainty, parts={"round_off": 0.0}),
        )

    damping = db.Damping(law="dashpot", coefficient=0.0, clip=clip)
    scene = db.Scene(
        name="three", duration=1.0, mass=(1.0,) * 3, stiffness=(1.0,) * 2, velocity=(1.0, 2.0, 3.0), damping=damping
    )
    monkeypatch.setattr(extrapolate, "solve", run)
    monkeypatch.setattr(Case, "solve", run)
    case = Case(scene=scene, backend="verlet", resolution=db.Resolution(dt=1.0), sampling=db.Sampling(count=4))
    found = extrapolate.extrapolate(case)
    assert found.velocity == pytest.approx(free_flight().velocity)
    # 0.1 - 0.9/3
    assert found.contact_force == pytest.approx(np.full((5, 2), 0.0 if clip else -0.2))
