"""Order: the error of a touch, the order of a chain, errors at tolerances, and condition numbers; each with a fault."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import dem_bridge as db
from dem_bridge.backends import blanes_moan
from dem_bridge.backends.base import Sampling
from dem_bridge.backends.splitting import Method
from dem_bridge.errors import UsageError
from dem_bridge.observables.verdict import Outcome
from dem_bridge.report.study import Study
from dem_bridge.scene.file import load_scene
from dem_bridge.scene.scene import Scene, Wall
from dem_bridge.studies.order import conditioning, study, touch
from dem_bridge.studies.order import study as order_study
from dem_bridge.trajectory.trajectory import Trajectory

CHAIN = Scene(
    name="four",
    duration=2e-4,
    mass=(8e-3, 1e-2, 1e-2, 1e-2),
    stiffness=(4e9, 3e10, 1e10),
    velocity=(0.8, 0.0, 0.0, 0.0),
    samples=40,
)
WALLED = replace(CHAIN, name="walled", wall_right=Wall(stiffness=2e10))
GRID = ("linear_grid", 2.0, 0.0)
#: verdicts that a fault in the method changes: those of order 4
ORDER_4 = {"linear_grid", "closed"}

Solve = Callable[[Scene, str, float, int], Trajectory]


def _verdicts() -> dict[str, Outcome]:
    return {pair[0]: touch.order_verdict(touch.pair_errors(*pair)).outcome for pair in touch.PAIRS}


def test_two_bodies_have_the_order_of_their_touch() -> None:
    assert set(_verdicts().values()) == {Outcome.PASS}
    pair = touch.pair_errors("hertz_grid", 2.5, 0.0)
    # with the predicted error subtracted the next one is left: that of the displacement, a step smaller
    assert pair.left == pytest.approx(3.5, abs=0.1)
    assert pair.measured == pytest.approx(pair.coefficient, rel=1e-3)


def test_a_method_that_lost_its_order_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    kicks = blanes_moan.SRKN_6B.kicks.copy()
    kicks[[1, 3, 5]] += (1e-3, -2e-3, 1e-3)  # consistent and symmetric still, and of order 2
    monkeypatch.setattr(blanes_moan, "SRKN_6B", Method(blanes_moan.SRKN_6B.drifts, kicks))
    verdicts = _verdicts()
    assert {name for name, outcome in verdicts.items() if outcome is Outcome.FAIL} >= ORDER_4


def test_a_touch_in_another_place_of_the_step_has_another_coefficient(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(touch, "PHASES", np.arange(6) / 6.0)
    assert touch.coefficient_verdict(2.5, *touch.coefficients(2.5)).outcome is Outcome.PASS
    solve: Solve = touch.solve_with_step

    def late(scene: Scene, backend: str, step: float, samples: int) -> Trajectory:
        """Solve with the touch a twentieth of a step late, in the method alone."""
        later = replace(scene, gap=float(scene.contacts.gap[0]) + 0.05 * step) if backend == touch.METHOD else scene
        return solve(later, backend, step, samples)

    monkeypatch.setattr(touch, "solve_with_step", late)
    assert touch.coefficient_verdict(2.5, *touch.coefficients(2.5)).outcome is Outcome.FAIL


def test_a_chain_has_order_two_and_a_half_and_four_where_nothing_opens(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(touch, "CHAIN_STEPS", 25)
    monkeypatch.setattr(touch, "EXPONENTS", (2.5,))
    verlet, chain, pressed = touch.chain_errors(CHAIN)
    assert (verlet.touches, pressed.touches) == (chain.touches, 0)
    assert chain.touches > 2
    assert verlet.order == pytest.approx(2.0, abs=0.05)
    # chance moves the order over two decades of steps, not to 2 or 3
    assert chain.order == pytest.approx(2.5, abs=0.25)
    assert chain.windows[0] <= chain.order <= chain.windows[1]
    assert pressed.order == pytest.approx(4.0, abs=0.1)


def test_relatives_have_the_same_forces_and_another_exponent() -> None:
    factor = np.array([1.0, 2.0, 3.0, 4.0])
    changed = touch.with_stiffness(WALLED, factor, 3.0)
    np.testing.assert_allclose(changed.contacts.stiffness, WALLED.contacts.stiffness * factor, rtol=1e-15)
    np.testing.assert_array_equal(changed.contacts.exponent, 3.0)
    assert changed.duration == WALLED.duration


def test_errors_at_tolerances_are_those_of_the_backends(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(study, "TOLERANCES", (1e-5, 1e-9))
    exact = db.solve(WALLED, backend="reference", uncertainty=False).velocity
    rows = {
        (row.name, row.tolerance): row for row in study.tolerance_rows(WALLED, Sampling(count=WALLED.samples), exact)
    }
    assert {name for name, _ in rows} == set(study.INTEGRATORS)
    for name, backend, atol in (("located", "scipy", None), ("ode45", "ode45", 1e-12)):
        run = db.solve(WALLED, backend=backend, rtol=1e-9, atol=atol, uncertainty=False)
        error = np.max(np.abs(run.velocity - exact)) / np.max(np.abs(exact))
        assert (rows[name, 1e-9].error, rows[name, 1e-9].evaluations) == (error, run.cost.force_evaluations)
    for name in study.INTEGRATORS:
        # a global error is some hundred local ones at most on so short a run
        assert rows[name, 1e-9].error < 1e-6 < 1e3 * rows[name, 1e-5].error
        assert rows[name, 1e-9].evaluations > rows[name, 1e-5].evaluations


def _failing(scene: Scene) -> set[str]:
    numbers = conditioning.conditions(scene)
    names = dict.fromkeys(number.observable for number in numbers)
    verdicts = {name: conditioning.verdict(scene, [n for n in numbers if n.observable == name]) for name in names}
    assert set(verdicts) == {*conditioning.FRONT, *conditioning.TRACES}
    return {name for name, one in verdicts.items() if one.outcome is not Outcome.PASS}


@pytest.mark.parametrize("scene", [CHAIN, WALLED], ids=lambda scene: scene.name)
def test_condition_numbers_are_those_of_the_scaling_laws(scene: Scene) -> None:
    assert _failing(scene) == set()
    exact = {(n.observable, n.parameter): n.exact for n in conditioning.conditions(scene)}
    powers = {"arrival": (-0.2, -0.4, 0.4), "front_speed": (0.2, 0.4, -0.4), "first_peak_force": (1.2, 0.4, 0.6)}
    for name, expected in powers.items():
        assert [exact[name, parameter] for parameter in conditioning.PARAMETERS] == pytest.approx(expected, rel=1e-14)


def test_a_parameter_that_changes_in_all_contacts_but_one_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    def all_but_the_last(scene: Scene, factor: Any, exponent: float | None = None) -> Scene:
        return touch.with_stiffness(scene, np.append(factor[:-1], 1.0), exponent)

    monkeypatch.setattr(conditioning, "with_stiffness", all_but_the_last)
    assert _failing(CHAIN) >= {"arrival", "first_peak_force", "velocity", "displacement"}


def test_a_wrong_derivative_of_a_trace_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    rate = conditioning.trace_rate
    monkeypatch.setattr(conditioning, "trace_rate", lambda scene, run, name: (1.0 + 1e-5) * rate(scene, run, name))
    assert _failing(CHAIN) == {"velocity", "displacement"}


def _small(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, value in {"PHASES": np.arange(2) / 2.0, "CHAIN_STEPS": 9, "RELATIVE_STEPS": 7}.items():
        monkeypatch.setattr(touch, name, value)
    monkeypatch.setattr(study, "TOLERANCES", (1e-6, order_study.STATED))


def test_the_study_answers_and_says_where_scaling_laws_end(monkeypatch: pytest.MonkeyPatch) -> None:
    _small(monkeypatch)
    result: Study = db.study("order", replace(CHAIN, name="heavy", gravity=9.81), store=False)
    assert result.exit_code == 0
    assert {verdict.quantity for verdict in result.verdicts} == {
        "order of convergence",
        "coefficient of the touch error",
    }
    assert "heavy has no exact condition numbers: the scene has gravity" in result.answer[-1]
    assert [figure.id for figure in result.figures] == ["order-touch", "order-chain", "order-tolerance"]
    assert not next(table for table in result.tables if table.id == "conditioning").rows


@pytest.mark.parametrize(
    ("scene", "message"),
    [
        (replace(CHAIN, drag=1.0), "study order of four: the scene has drag"),
        (replace(CHAIN, velocity=(0.0,) * 4), "study order of four: nothing moves; allowed: a scene with an impact"),
    ],
)
def test_scenes_without_an_answer_are_refused(scene: Scene, message: str) -> None:
    with pytest.raises(UsageError, match=message):
        db.study("order", scene)


def test_the_series_at_its_default_accuracy_is_the_reference() -> None:
    scene = load_scene("dimer-1-1")
    velocity, _ = study.INTEGRATORS["taylor"](scene, Sampling(count=10), 1e-16)
    run = db.solve(scene, backend="reference", samples=10, uncertainty=False)
    np.testing.assert_array_equal(velocity, run.velocity)
