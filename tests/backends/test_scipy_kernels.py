"""The compiled right-hand side of scipy: against the equations as written, and what is skipped for its sake."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.integrate import DOP853

import dem_bridge as db
from dem_bridge.backends import scipy_integration
from dem_bridge.backends.base import Sampling
from dem_bridge.backends.scipy_damped import DampedIntegration
from dem_bridge.backends.scipy_integration import Integration, Step
from dem_bridge.backends.scipy_kernels import OPEN, PRESSING, wave_at, wave_table
from dem_bridge.backends.scipy_step import CompiledDop853
from dem_bridge.scene.drive import Drive
from dem_bridge.scene.scene import Scene, Wall
from tests.helpers.strategies import ANY, damped_scenes, examples, scenes

Floats = NDArray[np.float64]
EPS = float(np.finfo(float).eps)

CHAIN = Scene(
    name="chain",
    duration=3e-4,
    mass=(8e-3, 1e-2, 2e-2, 5e-3),
    stiffness=(4e9, 5e9, 6e9),
    velocity=(0.8, 0.0, 0.1, -0.3),
    gap=(1e-6, 0.0, -5e-7),
    wall_left=Wall(stiffness=3e9, gap=2e-6),
    wall_right=Wall(stiffness=2e9, gap=1e-5),
    samples=50,
)


def _as_written(scene: Scene, t: float, y: Floats) -> Floats:
    """Derivative of the state with all contacts pressing, in arrays, by the equations of the Scene."""
    c, n, k = scene.contacts, scene.n_body, scene.n_contact
    overlap, v = np.maximum(y[:k], 0.0), np.append(y[k:-1], 0.0)
    rate = v[c.left] - v[c.right]
    force = c.force(overlap, np.arange(k)) + c.damping * overlap**c.damping_power * rate
    inverse = np.append(1.0 / np.array(scene.mass), 0.0)
    a = np.append(scene.free_acceleration - scene.drag * v[:n], 0.0)
    a[0] += 0.0 if scene.drive is None else float(scene.drive.at(t)) * inverse[0]
    np.add.at(a, c.right, force * inverse[c.right])
    np.add.at(a, c.left, -force * inverse[c.left])
    return np.concatenate([rate, a[:n], y[k : k + 1]])


@examples(20)
@given(
    scene=st.one_of(
        scenes(bodies=(1, 5), exponents=ANY, walls=True, gravity=True, samples=1),
        damped_scenes(bodies=(2, 5), samples=1),
    ),
    seed=st.integers(0, 2**32 - 1),
    drag=st.sampled_from([0.0, 30.0]),
    driven=st.booleans(),
)
def test_the_derivative_is_that_of_the_equations(scene: Scene, seed: int, drag: float, driven: bool) -> None:
    drive = Drive(shape="sine", force=3.0, frequency=2e3) if driven else None
    scene, random = replace(scene, drag=drag, drive=drive), np.random.default_rng(seed)
    k, n = scene.n_contact, scene.n_body
    y = np.concatenate([1e-6 * random.normal(size=k), random.normal(size=n), [0.1]])
    kind = DampedIntegration if scene.damped else Integration
    compiled = kind(scene, Sampling(count=1), 1e-9).derivative(np.full(k, PRESSING))(2e-4, y)
    written = _as_written(scene, 2e-4, y)
    # forces of both neighbours, weight, drag and drive may cancel in an acceleration: a few ulp of the largest
    largest = np.max(np.abs(_as_written(scene, 2e-4, np.abs(y)))) + np.max(np.abs(written))
    assert compiled == pytest.approx(written, abs=64.0 * EPS * largest)


def test_an_open_contact_has_no_force_and_a_wall_gets_none() -> None:
    run = Integration(CHAIN, Sampling(count=1), 1e-9)
    y = np.concatenate([np.full(5, 1e-6), CHAIN.velocity, [7.0]])
    assert np.all(run.derivative(np.full(5, OPEN))(0.0, y)[5:-1] == 0.0)
    # the last entry is the rate of body 0's displacement, whatever presses on a wall
    assert run.derivative(np.full(5, PRESSING))(0.0, y)[-1] == 0.8


def test_one_component_of_the_dense_output_is_scipys_to_the_last_digit() -> None:
    run = Integration(CHAIN, Sampling(count=1), 1e-12)
    y = np.concatenate([-run.gap, CHAIN.velocity, [0.0]])
    solver = DOP853(run.derivative(run.state_at_start(y)), 0.0, y, CHAIN.duration, rtol=1e-12, atol=run.atol)
    for _ in range(5):
        solver.step()
    step, times = Step(solver, run.contacts), np.linspace(solver.t_old, solver.t, 9)
    for t in times.tolist():
        state = step.dense(t)
        assert [step.component(i)(t) for i in range(len(y))] == state.tolist()
        assert [step.closing_rate(contact)(t) for contact in range(5)] == run.closing_rates(state).tolist()


@pytest.mark.parametrize("overshoot", [1e-1, 1e-3, 1e-6])
def test_a_touch_between_both_ends_of_a_step_is_located(overshoot: float) -> None:
    # thrown against its weight to just beyond a wall: in free flight a step is far longer than that touch
    speed = math.sqrt(2.0 * 9.81 * 1e-4 * (1.0 + overshoot))
    wall = Wall(stiffness=1e9, gap=1e-4)
    scene = Scene(
        name="thrown", duration=1.9 * speed / 9.81, mass=(1e-2,), stiffness=(), velocity=(speed,), wall_right=wall,
        gravity=-9.81, samples=1,
    )  # fmt: skip
    run = db.solve(scene, backend="scipy", uncertainty=False)
    assert run.provenance["restarts"] == 2
    assert run.peak_force[0] > 0.0


def _after_steps(solver: DOP853, count: int) -> tuple[float, int, np.ndarray[Any, Any]]:
    with np.errstate(over="ignore"):
        for _ in range(count):
            solver.step()
    return solver.t, solver.nfev, solver.y


class Swapped(CompiledDop853):
    """A fault: the two estimates of the error in the place of each other."""

    E3, E5 = DOP853.E5, DOP853.E3


def test_compiled_steps_are_those_of_scipy() -> None:
    run = Integration(CHAIN, Sampling(count=1), 1e-12)
    y = np.concatenate([-run.gap, CHAIN.velocity, [0.0]])
    state = run.state_at_start(y)
    settings = {"rtol": 1e-9, "atol": 1e3 * run.atol}
    system = (state, run.contacts, run.bodies, CHAIN.drag, wave_table(None))
    arguments = (run.derivative(state), 0.0, y, CHAIN.duration)
    t, evaluations, scipys = _after_steps(DOP853(*arguments, **settings), 12)
    compiled, same, ours = _after_steps(CompiledDop853(system, *arguments, **settings), 12)
    assert compiled == pytest.approx(t, rel=1e-6)
    assert same == evaluations
    # a step that is a millionth longer, and a dozen steps of the last digit
    assert ours == pytest.approx(scipys, rel=1e-5, abs=1e-9 * float(np.max(np.abs(scipys))))
    assert _after_steps(Swapped(system, *arguments, **settings), 12)[0] != pytest.approx(t, rel=1e-2)


DRIVES = (
    Drive(shape="sine", force=0.5, frequency=3e3, phase=40.0, rise=2e-4),
    Drive(shape="chirp", force=0.5, frequency=3e3, last_frequency=2e4, sweep=1e-4, phase=-20.0),
)


@pytest.mark.parametrize("drive", DRIVES, ids=lambda drive: drive.shape)
@pytest.mark.parametrize("at", [0.0, 7e-5, 1.5e-4, 3e-4])
def test_the_drive_in_a_kernel_is_that_of_the_scene(drive: Drive, at: float) -> None:
    # a phase of some tens of radians has so many last digits
    assert wave_at(wave_table(drive)[0], at) == pytest.approx(float(drive.at(at)), rel=1e-13, abs=1e-14)


@pytest.mark.parametrize("drive", [None, *DRIVES], ids=["none", "sine", "chirp"])
def test_compiled_dense_output_is_that_of_scipy(drive: Drive | None) -> None:
    scene = replace(CHAIN, drive=drive)
    run = Integration(scene, Sampling(count=1), 1e-9)
    y = np.concatenate([-run.gap, scene.velocity, [0.0]])
    state = run.state_at_start(y)
    arguments, settings = (run.derivative(state), 0.0, y, scene.duration), {"rtol": 1e-6, "atol": run.atol}
    system = (state, run.contacts, run.bodies, scene.drag, wave_table(drive))
    solvers = (DOP853(*arguments, **settings), CompiledDop853(system, *arguments, **settings))
    for solver in solvers:
        solver.h_abs = 1e-6
        solver.step()
    scipys, ours = (solver.dense_output() for solver in solvers)
    times = np.linspace(0.0, solvers[0].t, 7)
    assert solvers[0].t == solvers[1].t
    scale = np.max(np.abs(scipys(times)), axis=1, keepdims=True) + 1e-300
    assert np.max(np.abs(ours(times) - scipys(times)) / scale) < 1e-12
    assert ours(float(times[3])) == pytest.approx(ours(times)[:, 3], rel=4.0 * EPS)


def test_a_dense_output_is_made_for_few_steps_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    class Counted(CompiledDop853):
        made = 0

        def dense_output(self) -> Any:
            Counted.made += 1
            return super().dense_output()

    monkeypatch.setattr(scipy_integration, "CompiledDop853", Counted)
    run = db.solve(CHAIN, backend="scipy", samples=5, uncertainty=False)
    # one for each sample and event, and for each maximum; 20 or so steps lie between two events
    assert Counted.made < 0.2 * run.cost.steps


def test_a_law_that_is_a_function_is_called_and_not_compiled() -> None:
    law = Mock(side_effect=lambda overlap: 4e9 * overlap**1.5)
    scene = replace(CHAIN, law=law, wall_left=None, wall_right=None)
    run = Integration(scene, Sampling(count=1), 1e-9)
    law.reset_mock()
    derivative = run.derivative(np.full(3, PRESSING))(0.0, np.array([1e-6, -1e-6, 2e-6, 0.0, 0.0, 0.0, 0.0, 0.0]))
    forces = 4e9 * np.array([0.0, 1e-6, 0.0, 2e-6, 0.0]) ** 1.5
    assert derivative[3:-1] == pytest.approx(-np.diff(forces) / np.array(scene.mass), rel=4.0 * EPS)
    law.assert_called_once()
