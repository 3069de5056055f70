"""An uncertainty of 100 % and more as a tolerance: a verdict is UNDECIDED, however near or far the values are."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import pytest

from dem_bridge.observables import verdict
from dem_bridge.observables.verdict import Outcome, judge
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import UNKNOWN, Trajectory
from dem_bridge.verification import checks
from dem_bridge.verification.reference_choice import SCIPY_UNCERTAINTY
from dem_bridge.verification.regression import compare
from dem_bridge.verification.roles import assign_roles
from dem_bridge.verification.tolerances import TABLE_FACTOR
from tests.helpers.fake_runs import free_flight, uncertain

SCENE = Scene(name="three", duration=1.0, mass=(2.0, 4.0, 8.0), stiffness=(100.0, 100.0), velocity=(1.0, 2.0, 3.0))
ROLES = assign_roles(SCENE)
RIGHT = free_flight()
#: off by 30 %
WRONG = free_flight(velocity=1.3 * RIGHT.velocity, peak_force=1.3 * RIGHT.peak_force, crossing_time=[0.1, 0.2])
LARGEST = 3.0


def _with_parts(run: Trajectory, share: float) -> Trajectory:
    return replace(run, uncertainty=uncertain(parts={"round_off": share, "last_digit": 0.0}))


def _peak_force(run: Trajectory, share: float) -> Trajectory:
    return replace(run, uncertainty=uncertain(peak_force=share * RIGHT.peak_force))


def _tables(share: float) -> Trajectory:
    table = {"measured_error": 0.3, "predicted_error": share / TABLE_FACTOR["error"], "round_off": 0.0}
    return replace(WRONG, provenance={"table": table})


#: verdicts whose tolerance is an uncertainty, by its size relative to the value
CHECKS: dict[str, Callable[[float], Outcome]] = {
    "implementation": lambda share: checks.implementation(ROLES, _with_parts(WRONG, share), RIGHT).outcome,
    "explained": lambda share: (
        checks.explained(ROLES, "velocity", _with_parts(WRONG, 0.0), RIGHT, allowed=share).outcome
    ),
    "two methods": lambda share: (
        checks.two_methods(ROLES, replace(WRONG, uncertainty=uncertain(velocity=share * LARGEST)), RIGHT).outcome
    ),
    "table": lambda share: checks.table(ROLES, _tables(share))[0].outcome,
    "accuracy": lambda share: next(
        item.outcome
        for item in checks.accuracy(ROLES, "lammps-granular", _peak_force(WRONG, share), RIGHT, 1e-6)
        if item.quantity == "peak_force"
    ),
    "regression": lambda share: Outcome(compare.assess(_peak_force(WRONG, share), RIGHT, 1e-6)["peak_force"].outcome),
}


@pytest.mark.parametrize("name", CHECKS)
def test_an_uncertainty_below_the_value_decides(name: str) -> None:
    assert [CHECKS[name](share) for share in (0.2, 0.9)] == [Outcome.FAIL, Outcome.PASS]


@pytest.mark.parametrize("share", [1.0, 5.0, 1e9, math.inf, math.nan])
@pytest.mark.parametrize("name", CHECKS)
def test_an_uncertainty_of_the_whole_value_decides_nothing(name: str, share: float) -> None:
    assert CHECKS[name](share) is Outcome.UNDECIDED


@pytest.mark.parametrize("name", CHECKS)
def test_without_the_rule_any_value_would_pass(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    # the fault that the test above catches
    for module in (checks, compare, verdict):
        monkeypatch.setattr(module, "judge_relative", judge)
    assert CHECKS[name](5.0) is Outcome.PASS


def test_a_second_reference_without_an_estimate_has_the_uncertainty_of_scipy() -> None:
    near = free_flight(velocity=RIGHT.velocity * (1.0 + 0.5 * SCIPY_UNCERTAINTY), uncertainty=UNKNOWN)
    assert checks.two_methods(ROLES, near, RIGHT, estimated=False).outcome is Outcome.PASS
    assert checks.two_methods(ROLES, WRONG, RIGHT, estimated=False).outcome is Outcome.FAIL
    assert checks.two_methods(ROLES, near, RIGHT).outcome is Outcome.UNDECIDED


def test_the_sentence_states_that_the_uncertainty_is_too_large() -> None:
    sentence = checks.explained(ROLES, "velocity", _with_parts(WRONG, 0.0), RIGHT, allowed=2.5).sentence
    assert "nothing follows from it, because the tolerance is an uncertainty of 100 % or more: 2.5e+00." in sentence
