"""The budget of a run: its parts add up, and what no part explains is a finding."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import dem_bridge as db
from dem_bridge.observables.differences import Readings
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import QUANTITIES, Trajectory
from dem_bridge.verification.budget import Budget, budgets

#: a light body between heavy ones, hit from both sides: it re-collides some times
SCENE = Scene(
    name="rattler",
    duration=4e-4,
    mass=(8.1e-3, 2e-3, 1e-2, 1e-2),
    stiffness=(4e9, 3e10, 5e9),
    velocity=(0.8, 0.0, 0.0, -0.2),
    samples=40,
)
DT, RADIUS = 5e-8, 2.0**-10


@pytest.fixture(scope="module")
def runs() -> dict[str, Trajectory]:
    return {
        "twin": db.solve(SCENE, backend="verlet", dt=DT),
        "positional": db.solve(SCENE, backend="verlet", dt=DT, surrogate_radius=RADIUS),
        "truth": db.solve(SCENE, backend="reference"),
    }


def _budgets(engine: Trajectory, runs: dict[str, Trajectory]) -> dict[str, Budget]:
    return {
        budget.quantity: budget
        for budget in budgets(Readings(None), engine, runs["twin"], runs["positional"], runs["truth"])
    }


@pytest.mark.lammps
def test_the_parts_explain_what_lammps_differs_by(runs: dict[str, Trajectory]) -> None:
    engine = db.solve(SCENE, backend="lammps-granular", dt=DT, surrogate_radius=RADIUS, uncertainty=False)
    results = _budgets(engine, runs)
    assert set(results) == set(QUANTITIES)
    for quantity, budget in results.items():
        assert not budget.is_finding, quantity
        # triangle inequality: no error is larger than the sum of its parts and the rest
        assert budget.found <= budget.total + budget.unexplained
        assert budget.parts["time step"] > 10.0 * budget.parts["round-off"] > 0.0
        assert budget.parts["table"] == 0.0


@pytest.mark.parametrize("quantity", ["velocity", "displacement", "peak_force", "crossing_time"])
def test_a_difference_that_no_part_explains_is_a_finding(runs: dict[str, Trajectory], quantity: str) -> None:
    honest = runs["positional"]
    # a tenth of the time step's error: too small to be seen against the reference
    share = 0.1 * _budgets(honest, runs)[quantity].parts["time step"]
    value = getattr(honest, quantity)
    wrong = replace(honest, **{quantity: value + share * np.nanmax(np.abs(value))})
    results = _budgets(wrong, runs)
    assert [name for name, budget in results.items() if budget.is_finding] == [quantity]
    assert not any(budget.is_finding for budget in _budgets(honest, runs).values())


def test_what_is_not_finite_is_a_finding_and_json_all_the_same(runs: dict[str, Trajectory]) -> None:
    crossing = runs["positional"].crossing_time.copy()
    crossing[1] = np.nan
    budget = _budgets(replace(runs["positional"], crossing_time=crossing), runs)["crossing_time"]
    assert budget.is_finding
    assert budget.as_json()["unexplained"] is None
    assert set(budget.as_json()["parts"]) == {"time step", "table", "round-off", "sampling", "reference"}
