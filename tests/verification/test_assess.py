"""The verdicts of a scene follow from runs in their roles: numbers by hand on runs that nothing integrates."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from dem_bridge.backends.base import Resolution, Sampling
from dem_bridge.errors import BackendUnavailable, RunBroken
from dem_bridge.observables.verdict import Outcome, Verdict
from dem_bridge.runs.campaign import Result
from dem_bridge.runs.case import Case
from dem_bridge.scene.scene import Damping
from dem_bridge.trajectory.trajectory import QUANTITIES, Trajectory
from dem_bridge.verification import checks
from dem_bridge.verification.assess import SceneStudy, assess_scene
from dem_bridge.verification.reference_choice import REFERENCE
from dem_bridge.verification.roles import POSITIONAL, THEORY, TWIN, Runs, assign_roles
from tests.helpers.export_chains import PAIR
from tests.helpers.fake_runs import NO_COST, NO_ERROR, free_flight

ROLES = assign_roles(PAIR)
BACKENDS = {"reference": REFERENCE, "theory": THEORY, "twin": TWIN, "engine": ROLES.engine, "positional_twin": TWIN}
#: bodies fly at 1 and 2 m/s, so that errors are relative to 2 m/s
PARTS = {"round_off": 1e-12, "last_digit": 1e-16}
STEP = {"backend": "fake", "settings": {"dt": 1e-6, "surrogate_radius": 2.0**-10}}
EXACT = replace(NO_ERROR, parts=PARTS, sampling=dict.fromkeys(QUANTITIES, 0.0))
RIGHT = free_flight(bodies=2, contacts=1, uncertainty=EXACT, provenance=STEP)


def faster(by: float, dt: float = 1e-6) -> Trajectory:
    """Return a run at a step whose largest velocity is larger by a part of it."""
    settings = {"dt": dt, "surrogate_radius": 2.0**-10}
    return replace(RIGHT, velocity=RIGHT.velocity * (1.0 + by), provenance={"backend": "fake", "settings": settings})


def assess(accuracy: float = 1e-3, levels: tuple[Trajectory, ...] = (), **runs: Any) -> SceneStudy:
    """Judge runs, or failures, in their roles; a role that is not given has neither."""

    def result(backend: str, item: Any) -> Result:
        case = Case(scene=PAIR, backend=backend, resolution=Resolution(), sampling=Sampling(count=PAIR.samples))
        failed = isinstance(item, Exception)
        return Result(case=case, trajectory=None if failed else item, failure=item if failed else None)

    chosen: dict[str, Any] = {role: result(backend, runs.get(role)) for role, backend in BACKENDS.items()}
    of_twin = tuple(result(TWIN, run) for run in levels)
    return assess_scene(ROLES, Runs(**chosen, twin_refinements=of_twin), accuracy)


def of(study: SceneStudy, backend: str, reference: str, quantity: str = "velocity") -> Verdict:
    """Return the only verdict on a quantity of a backend against another run."""
    [verdict] = [
        item for item in study.verdicts
        if (item.backend, item.reference, item.quantity) == (backend, reference, quantity)
    ]  # fmt: skip
    return verdict


# ---------------------------------------------------------------- roles without a run
def test_without_a_reference_no_accuracy_is_judged() -> None:
    study = assess(engine=RIGHT, twin=RIGHT, positional_twin=RIGHT)
    assert {verdict.reference for verdict in study.verdicts} == {TWIN, "its own start"}
    assert (study.observables, study.refinement, study.budgets) == ((), {}, ())


def test_without_a_twin_lammps_has_nothing_beside_it_and_without_a_positional_one_no_budget() -> None:
    assert assess().verdicts == ()
    assert {verdict.reference for verdict in assess(engine=RIGHT).verdicts} == {"its own start"}
    study = assess(engine=RIGHT, twin=RIGHT, reference=RIGHT)
    assert (of(study, ROLES.engine, TWIN).outcome, of(study, ROLES.engine, TWIN).difference) == (Outcome.PASS, 0.0)
    assert study.budgets == ()
    assert not any(verdict.reference == POSITIONAL for verdict in study.verdicts)


def test_a_failure_is_a_verdict_of_its_role_alone() -> None:
    study = assess(reference=RIGHT, twin=RIGHT, engine=RunBroken("lost atoms"), theory=BackendUnavailable("no theory"))
    broken, absent = of(study, ROLES.engine, REFERENCE), of(study, THEORY, REFERENCE)
    assert (broken.outcome, absent.outcome) == (Outcome.BROKEN, Outcome.NOT_RUN)
    assert broken.sentence == f"{ROLES.engine} on pair: lost atoms."
    assert of(study, TWIN, REFERENCE).outcome is Outcome.PASS
    assert len(study.verdicts) == 4  # and that there is no second reference


# ---------------------------------------------------------------- sizes of differences
@pytest.mark.parametrize(
    ("accuracy", "outcome"), [(1e-3, Outcome.PASS), (1.01e-4, Outcome.PASS), (0.99e-4, Outcome.FAIL)]
)
def test_errors_of_velocity_are_relative_to_the_largest_of_the_reference(accuracy: float, outcome: Outcome) -> None:
    study = assess(accuracy, reference=RIGHT, twin=faster(1e-4), engine=faster(1e-4), positional_twin=faster(1e-4))
    for backend in (TWIN, ROLES.engine):
        verdict = of(study, backend, REFERENCE)
        assert (verdict.outcome, verdict.tolerance, verdict.scale) == (outcome, accuracy, 2.0)
        assert verdict.difference == pytest.approx(1e-4, rel=1e-9)
    # the same error in both is none of the implementation
    assert of(study, ROLES.engine, TWIN).outcome is Outcome.PASS


@pytest.mark.parametrize(("left", "outcome"), [(5.9e-10, Outcome.PASS), (6.1e-10, Outcome.FAIL)])
def test_lammps_may_differ_from_the_positional_twin_by_twice_its_round_off(left: float, outcome: Outcome) -> None:
    # the time step 1e-4, round-off 3e-10, and what is left of LAMMPS
    twin, positional, engine = faster(1e-4), faster(1e-4 + 3e-10), faster(1e-4 + 3e-10 + left)
    study = assess(reference=RIGHT, twin=twin, positional_twin=positional, engine=engine)
    verdict, budget = of(study, ROLES.engine, POSITIONAL), study.budgets[0]
    assert verdict.outcome is outcome
    assert budget.is_finding is (outcome is Outcome.FAIL)
    assert (budget.found, budget.unexplained) == pytest.approx((1e-4 + 3e-10 + left, left), rel=1e-5)
    parts = {"time step": 1e-4, "table": 0.0, "round-off": 3e-10, "sampling": 0.0, "reference": 0.0}
    assert budget.parts == pytest.approx(parts, rel=1e-5)
    assert (verdict.difference, verdict.tolerance) == pytest.approx((left, 6e-10), rel=1e-5)


@pytest.mark.parametrize(("off", "outcome"), [(0.9e-12, Outcome.PASS), (1.1e-12, Outcome.FAIL)])
def test_lammps_may_differ_from_its_twin_by_the_predicted_round_off(off: float, outcome: Outcome) -> None:
    verdict = of(assess(reference=RIGHT, twin=RIGHT, engine=faster(off)), ROLES.engine, TWIN)
    assert (verdict.outcome, verdict.tolerance) == (outcome, 1e-12)
    assert verdict.difference == pytest.approx(off, rel=1e-3)


def test_a_theory_is_a_model_difference_of_any_size() -> None:
    for by in (0.0, 0.25):
        verdict = of(assess(reference=RIGHT, theory=faster(by)), THEORY, REFERENCE)
        assert (verdict.outcome, verdict.difference) == (Outcome.MODEL_DIFFERENCE, pytest.approx(by))
    assert f"by up to {25:.3g} % of" in verdict.sentence


# ---------------------------------------------------------------- order of convergence
STEPS = [1e-5, 5e-6, 2.5e-6, 1.25e-6]


@pytest.mark.parametrize(
    ("power", "outcome"), [(2.0, Outcome.PASS), (2.04, Outcome.PASS), (1.9, Outcome.FAIL), (1.0, Outcome.FAIL)]
)
def test_errors_that_grow_by_a_power_of_the_step_have_this_order(power: float, outcome: Outcome) -> None:
    levels = tuple(faster(1e-3 * (dt / 1e-5) ** power, dt) for dt in STEPS)
    # the error of the main run, which is given first, is no part of the fit
    study = assess(reference=RIGHT, twin=faster(1e-4), levels=levels)
    steps, errors = study.refinement[TWIN]
    assert steps == [*STEPS, 1e-6]
    assert errors == pytest.approx([*(1e-3 * (dt / 1e-5) ** power for dt in STEPS), 1e-4], rel=1e-9)
    verdict = of(study, TWIN, "exact 2", "order")
    assert (verdict.outcome, verdict.difference) == (outcome, pytest.approx(abs(power - 2.0), abs=1e-6))
    assert f"fall as dt^{power:.3f} over dt = 1e-05 .. 1.25e-06 s" in verdict.sentence


def order_of(errors: list[float], steps: list[float], **changes: Any) -> Verdict:
    """Return the verdict on the order of errors at some steps; the main run, at half the last step, errs by 1."""
    uncertainty = changes.pop("uncertainty", 0.0)
    reference = replace(RIGHT, uncertainty=replace(NO_ERROR, velocity=uncertainty))
    return checks.order(
        assign_roles(replace(PAIR, **changes)), TWIN, ([*steps, 0.5 * steps[-1]], [*errors, 1.0]), reference
    )


def test_errors_of_round_off_have_no_order() -> None:
    errors = [(dt / 1e-5) ** 2 for dt in STEPS]
    # ten times an uncertainty of 0.004 m/s is 0.02 of 2 m/s: two of four errors are larger
    two = order_of(errors, STEPS, uncertainty=0.02)
    assert (two.outcome, "2 of 4 errors are above round-off" in two.sentence) == (Outcome.NOT_RUN, True)
    assert order_of(errors, STEPS, uncertainty=0.01).outcome is Outcome.PASS


def test_levels_of_one_step_and_errors_that_scatter_decide_no_order() -> None:
    same = order_of([1e-3, 1e-3, 1e-3], [1e-6, 1e-6, 1e-6])
    assert (same.outcome, "all levels have the same step" in same.sentence) == (Outcome.NOT_RUN, True)
    scattered = order_of([1e-3, 4e-4, 4e-5, 2.5e-5], STEPS)
    assert (scattered.outcome, "there is no asymptotic range" in scattered.sentence) == (Outcome.NOT_RUN, True)


def test_with_forces_that_depend_on_velocities_the_order_is_one() -> None:
    damping = Damping(law="dashpot", coefficient=1.0)
    for power, outcome in ((1.0, Outcome.PASS), (1.09, Outcome.PASS), (0.8, Outcome.FAIL)):
        verdict = order_of([(dt / 1e-5) ** power for dt in STEPS], STEPS, damping=damping)
        assert (verdict.outcome, verdict.reference) == (outcome, "exact 1")
    # errors of second order beside those of the first make no verdict
    steep = order_of([(dt / 1e-5) ** 1.5 for dt in STEPS], STEPS, damping=damping)
    assert (steep.outcome, "little is damped" in steep.sentence) == (Outcome.NOT_RUN, True)


# ---------------------------------------------------------------- what is conserved
def drifts(run: Trajectory, tolerance: float) -> dict[str, Verdict]:
    return {verdict.quantity: verdict for verdict in checks.conserved(ROLES, run, tolerance)}


@pytest.mark.parametrize(("share", "outcome"), [(0.9, Outcome.PASS), (1.1, Outcome.FAIL)])
def test_momentum_may_drift_by_a_digit_in_each_step(share: float, outcome: Outcome) -> None:
    # 8.1 g at 1 m/s and 10 g at 2 m/s; relative to all mass at the largest velocity
    steps, digit, momentum, scale = 1000, float(np.finfo(float).eps), 8.1e-3 + 2e-2, 1.81e-2 * 2.0
    velocity = np.array(RIGHT.velocity)
    velocity[-1] *= 1.0 + share * steps * digit * scale / momentum
    verdict = drifts(replace(RIGHT, velocity=velocity, cost=replace(NO_COST, steps=steps)), 1e-3)["momentum"]
    assert (verdict.outcome, verdict.tolerance) == (outcome, steps * digit)
    assert verdict.scale == pytest.approx(scale)
    assert verdict.difference == pytest.approx(share * steps * digit, rel=1e-2)


@pytest.mark.parametrize(("tolerance", "outcome"), [(2.1e-3, Outcome.PASS), (1.9e-3, Outcome.FAIL)])
def test_energy_may_drift_by_the_tolerance(tolerance: float, outcome: Outcome) -> None:
    # a thousandth more speed is two thousandths more energy, at the end the largest: 8.1 g and 10 g fly freely
    velocity = np.array(RIGHT.velocity)
    velocity[-1] *= 1.001
    verdict = drifts(replace(RIGHT, velocity=velocity), tolerance)["energy"]
    assert (verdict.outcome, verdict.scale) == (outcome, pytest.approx(0.5 * (8.1e-3 + 4e-2) * 1.001**2))
    assert verdict.difference == pytest.approx(1.0 - 1.001**-2, rel=1e-6)


def test_two_references_must_agree_within_the_sum_of_their_uncertainties() -> None:
    first, second = (replace(RIGHT, uncertainty=replace(NO_ERROR, velocity=2.0 * bar)) for bar in (3e-10, 1e-10))
    for off, outcome in ((3.9e-10, Outcome.PASS), (4.1e-10, Outcome.FAIL)):
        verdict = checks.two_methods(ROLES, replace(second, velocity=RIGHT.velocity * (1.0 + off)), first)
        assert (verdict.outcome, verdict.tolerance) == (outcome, pytest.approx(4e-10, rel=1e-6))
    none = checks.two_methods(ROLES, None, first)
    assert (none.outcome, "no second solution" in none.sentence) == (Outcome.NOT_RUN, True)
    assert not math.isnan(none.difference)
