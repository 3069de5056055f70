"""The adaptive method step by step beside a second writing of it, drives, bodies at rest, and motion between steps."""

from __future__ import annotations

import math
import subprocess
import sys
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.integrate import DOP853

import dem_bridge as db
from dem_bridge.judging import kernels
from dem_bridge.judging.model import Model, Motion, system_of
from dem_bridge.scene.drive import Drive
from dem_bridge.scene.scene import Adhesion, Damping, Scene, Wall
from dem_bridge.trajectory.trajectory import Floats
from tests.helpers.driven_chains import PISTONS, pushed
from tests.judging.test_kernels import CHAIN, acceleration, contact_forces, one_step

#: a line in which all but the first body rest for a while
LINE = Scene(name="line", duration=1e-4, mass=(1e-2,) * 9, stiffness=(4e9,) * 8, velocity=(0.8, *[0.0] * 8))
TIMES = np.array([0.0, 1e-9, 2e-6, 2.5e-5, 2.6e-5, 9e-5, 1e-4])


def second_writing(model: Model, times: Floats, tolerance: float, right_side: Any) -> tuple[Floats, list[float]]:
    """Return velocities at the times, and all steps, by the same control of steps over all bodies of the chain."""
    matrix, weights, errors = model._pair
    system, n, stages = model.system, len(model.system.mass), len(weights)
    y, t, size = np.concatenate([np.zeros(n), system.velocity]), 0.0, 1e-4 * model.scene.duration
    slope, out, steps = right_side(0.0, y), [], list[float]()
    for end in times:
        while t < end:
            left = end - t
            lands = size >= 0.999 * left
            h = left if lands else min(size, 0.5 * left)
            k = [slope]
            for stage in range(1, stages):
                change = sum(matrix[stage, j] * k[j] for j in range(stage))
                k.append(right_side(t + float(np.sum(matrix[stage, :stage])) * h, y + h * change))
            new = y + h * sum(weights[j] * k[j] for j in range(stages))
            k.append(right_side(t + h, new))
            third, fifth = (sum(row[j] * k[j][n:] for j in range(stages + 1)) for row in errors)
            total = fifth**2 + 0.01 * third**2
            ratio = max([h * f * f / math.sqrt(s) for f, s in zip(fifth, total, strict=True) if s > 0.0], default=0.0)
            ratio /= tolerance * model.speed
            steps.append(h)
            if ratio <= 1.0:
                t, y, slope = (end if lands else t + h), new, k[-1]
                grown = 6.0 if ratio < 1e-8 else min(6.0, 0.9 * ratio**-0.125)
                # a step that was cut to land on a time does not shorten the next one
                size = max(size, h * grown) if lands and h < 0.5 * size else h * grown
            else:
                size = h * max(0.1, 0.9 * ratio**-0.125)
        out.append(y[n:])
    return np.array(out), steps


PUSH = Drive(shape="sine", force=500.0, frequency=2e4, phase=30.0)
TABLE = Drive(shape="table", force=(0.0, 800.0, -300.0, 100.0), interval=4e-5)


@pytest.mark.parametrize("tolerance", [1e-2, 1e-4])
@pytest.mark.parametrize(
    "scene", [LINE, CHAIN, replace(CHAIN, drive=PUSH), replace(CHAIN, gravity=-9.8, drag=200.0)],
    ids=["line", "walls", "drive", "drag"],
)  # fmt: skip
def test_the_adaptive_method_takes_the_steps_of_its_second_writing(scene: Scene, tolerance: float) -> None:
    model, n = Model(scene), scene.n_body
    system = model.system

    def right_side(t: float, y: Floats) -> Floats:
        a = acceleration(y[:n], y[n:], system)
        if scene.drive is not None:
            a[0] += float(scene.drive.at([t])[0]) / system.mass[0]
        return np.concatenate([y[n:], a])

    expected, steps = second_writing(model, TIMES, tolerance, right_side)
    x, v, a, f, _ = kernels.adaptive.interpret(system, TIMES, model.speed, tolerance, *model._pair)
    # steps are so large that another choice of one of them changes velocities by more than round-off
    np.testing.assert_allclose(v, expected, rtol=1e-9, atol=1e-11)
    assert len(steps) > len(TIMES)
    for row, time in enumerate(TIMES):
        np.testing.assert_allclose(f[row], contact_forces(x[row], v[row], system), rtol=1e-12, atol=1e-9)
        np.testing.assert_allclose(a[row], right_side(time, np.concatenate([x[row], v[row]]))[n:], rtol=1e-9, atol=1e-6)


def test_steps_are_limited_in_number_and_in_size(monkeypatch: pytest.MonkeyPatch) -> None:
    model = Model(LINE)
    calls: list[float] = []
    plain = kernels.accelerations

    def counted(t: float, *arguments: Any) -> None:
        calls.append(t)
        plain.py_func(t, *arguments)

    times = np.array([0.0, 1e-4, 2e-4])
    monkeypatch.setattr(kernels, "MOST_ADAPTIVE_STEPS", 3 - 2 * len(times))  # each time allows two more
    monkeypatch.setattr(kernels, "accelerations", counted)
    kernels.adaptive.interpret(model.system, times, model.speed, 1e-6, *model._pair)
    # the start, and twelve stages in each of three steps
    assert len(calls) == 1 + 3 * 12
    calls.clear()
    # a step is taken in spite of its error if it is 1e-13 of the end
    monkeypatch.setattr(kernels, "MOST_ADAPTIVE_STEPS", 2 - 2 * len(times))
    small = model.system._replace(first_step=0.9e-13 * 2e-4)
    kernels.adaptive.interpret(small, times, model.speed, 1e-300, *model._pair)
    assert calls[13] == pytest.approx(0.9e-13 * 2e-4)
    large = model.system._replace(first_step=1.5e-13 * 2e-4)
    calls.clear()
    kernels.adaptive.interpret(large, times, model.speed, 1e-300, *model._pair)
    assert calls[13] < 0.1 * calls[12]


def test_a_motion_that_needs_nothing_takes_steps_that_grow_six_times(monkeypatch: pytest.MonkeyPatch) -> None:
    apart = Scene(name="two", duration=1e-4, mass=(1e-2, 1e-2), stiffness=(4e9,), velocity=(0.8, 0.8), gap=(1.0,))
    model, calls = Model(apart), list[float]()
    plain = kernels.accelerations

    def counted(t: float, *arguments: Any) -> None:
        calls.append(t)
        plain.py_func(t, *arguments)

    monkeypatch.setattr(kernels, "accelerations", counted)
    x, v, *_ = kernels.adaptive.interpret(model.system, np.array([0.0, 1e-4]), 0.8, 1e-9, *model._pair)
    ends = calls[12::12]
    assert ends[:3] == pytest.approx([1e-8, 7e-8, 4.3e-7])
    assert (x[1].tolist(), v[1].tolist()) == (pytest.approx([0.8e-4] * 2), [0.8, 0.8])


# ---------------------------------------------------------------- forces at the edges
def test_forces_at_touch_are_none_and_adhesion_acts_within_contacts_alone() -> None:
    glued = replace(CHAIN, gap=(0.0, 0.0), wall_left=None, wall_right=None, adhesion=Adhesion(law="dmt", pull_off=5.0))
    damped = replace(glued, adhesion=None, damping=Damping(law="dashpot", coefficient=0.5, clip=True))
    for scene in (glued, damped):
        system = Model(scene).system
        for x, expected in ((np.zeros(3), 0.0), (np.array([1e-9, 0.0, 0.0]), None)):
            v, f = np.array([1.0, 0.0, 0.0]), np.zeros(4)
            kernels.forces.interpret(x, v, 3, system, f)
            right = contact_forces(x, v, system)
            np.testing.assert_allclose(f, right, rtol=1e-12, atol=1e-15)
            if expected is not None:
                assert f.tolist() == [0.0] * 4


def test_a_force_that_damping_turns_to_nothing_is_nothing_and_small_ones_are_left() -> None:
    system = Model(replace(CHAIN, damping=Damping(law="dashpot", coefficient=0.5, clip=True))).system
    for rate, gap in ((-0.5, 1e-9), (1.0, 1e-9), (-1e-3, 1e-6)):
        x, v = np.array([gap, 0.0, -1.0]), np.array([rate, 0.0, 0.0])
        f = np.zeros(4)
        kernels.forces.interpret(x, v, 3, system, f)
        np.testing.assert_allclose(f, contact_forces(x, v, system), rtol=1e-12, atol=1e-15)
    # walls that are apart
    gaps = {"wall_left": Wall(stiffness=3e9, gap=2e-6), "wall_right": Wall(stiffness=5e9, gap=3e-6)}
    system, f = Model(replace(CHAIN, **gaps)).system, np.zeros(4)  # type: ignore[arg-type]
    x = np.array([-5e-6, 0.0, 7e-6])
    kernels.forces.interpret(x, np.zeros(3), 3, system, f)
    np.testing.assert_allclose(f, [3e9 * 3e-6**1.5, 0.0, 0.0, 5e9 * 4e-6**1.5], rtol=1e-9)
    # a pulling contact is as stiff as a pushing one, and open by less than a metre
    pulling = Model(replace(CHAIN, exponent=(2.5, 2.2), wall_left=None, wall_right=None)).system._replace(pulls=True)
    x, f = np.array([0.0, 1e-6, 0.5]), np.zeros(4)
    kernels.forces.interpret(x, np.zeros(3), 3, pulling, f)
    np.testing.assert_allclose(f, contact_forces(x, np.zeros(3), pulling), rtol=1e-12)


@pytest.mark.parametrize("count", [1, 2])
def test_only_the_contacts_of_bodies_that_are_worked_on_are_computed(count: int) -> None:
    for scene in (CHAIN, replace(CHAIN, damping=Damping(law="dashpot", coefficient=40.0))):
        system = Model(scene).system
        x, v, f, a = np.array([3e-6, 1e-6, 4e-6]), np.array([0.1, 0.2, 0.3]), np.full(4, 7.0), np.full(3, 7.0)
        kernels.accelerations.interpret(0.0, x, v, count, system, f, a)
        right = contact_forces(x, v, system)
        np.testing.assert_allclose(f[: count + 1], right[: count + 1], rtol=1e-12)
        assert f[count + 1 :].tolist() == [7.0] * (3 - count)
        np.testing.assert_allclose(a[:count], ((right[:-1] - right[1:]) / system.mass)[:count], rtol=1e-12)
        assert a[count:].tolist() == [7.0] * (3 - count)


@pytest.mark.parametrize("drive", [PUSH, TABLE])
@pytest.mark.parametrize("method", range(6))
def test_a_drive_acts_at_the_time_of_each_stage(drive: Drive, method: int) -> None:
    scene = replace(CHAIN, drive=drive)
    model, dt = Model(scene), 2e-6
    system = model.system
    time = [0.0]

    def driven(x: Floats, v: Floats, late: float) -> Floats:
        a = acceleration(x, v, system)
        a[0] += float(drive.at([max(time[0] + late, 0.0)])[0]) / system.mass[0]
        return a

    out: Any = kernels.fixed.interpret(system, np.array([0, 1, 7]), dt, method, model.speed)
    x, v = np.zeros(3), system.velocity.copy()
    a = driven(x, v, 0.0)
    for step in range(7):
        time[0] = step * dt
        if method == kernels.VERLET:
            half = v + 0.5 * dt * a
            x = x + dt * half
            a = driven(x, half, dt)
            v = half + 0.5 * dt * a
        elif method == kernels.DRIFT_FIRST:
            x = x + 0.5 * dt * v
            v = v + dt * driven(x, v, 0.5 * dt)
            x = x + 0.5 * dt * v
        elif method == kernels.KICK_EULER:
            v = v + dt * driven(x, v, 0.0)
            x = x + dt * v
        elif method == kernels.DRIFT_EULER:
            x = x + dt * v
            v = v + dt * driven(x, v, dt)
        elif method == kernels.EXPLICIT_EULER:
            x, v = x + dt * v, v + dt * driven(x, v, 0.0)
        else:
            k1 = np.array([v, driven(x, v, 0.0)])
            k2 = np.array([v + 0.5 * dt * k1[1], driven(x + 0.5 * dt * k1[0], v + 0.5 * dt * k1[1], 0.5 * dt)])
            k3 = np.array([v + 0.5 * dt * k2[1], driven(x + 0.5 * dt * k2[0], v + 0.5 * dt * k2[1], 0.5 * dt)])
            k4 = np.array([v + dt * k3[1], driven(x + dt * k3[0], v + dt * k3[1], dt)])
            x, v = np.array([x, v]) + dt / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        if step in (0, 6):
            row = 1 if step == 0 else 2
            np.testing.assert_allclose(out[0][row], x, rtol=1e-10, atol=1e-18)
            np.testing.assert_allclose(out[1][row], v, rtol=1e-10, atol=1e-13)
            if method != kernels.VERLET:
                np.testing.assert_allclose(out[2][row], driven(x, v, dt), rtol=1e-9, atol=1e-6)


@pytest.mark.parametrize("method", range(6))
def test_bodies_at_rest_follow_in_every_method(method: int) -> None:
    model, dt = Model(LINE), 1e-6
    out: Any = kernels.fixed.interpret(model.system, np.array([2, 30]), dt, method, model.speed)
    x, v = np.zeros(9), model.system.velocity.copy()
    a = acceleration(x, v, model.system)
    for step in range(1, 31):
        x, v, a = one_step(method, x, v, a, dt, model.system)
        if step in (2, 30):
            np.testing.assert_allclose(out[1][0 if step == 2 else 1], v, rtol=1e-9, atol=1e-15)
            np.testing.assert_allclose(out[0][0 if step == 2 else 1], x, rtol=1e-9, atol=1e-20)


@pytest.mark.parametrize(
    ("v", "a", "count", "bodies"),
    [
        ({}, {}, 0, 5), ({0: 1.0}, {}, 0, 6), ({1: 1.0}, {}, 0, 7), ({}, {1: 1.0}, 0, 7), ({11: 1.0}, {}, 0, 12),
        ({}, {}, 8, 8), ({3: 1.0}, {}, 8, 9), ({4: 1.0}, {}, 9, 10), ({3: 1.0}, {}, 9, 9), ({3: -1.0}, {}, 0, 9),
        ({3: 2e-22}, {}, 0, 5), ({3: 3e-22}, {}, 0, 9), ({}, {3: 1e-300}, 0, 9),
    ],
)  # fmt: skip
def test_five_bodies_ahead_of_a_front_are_worked_on(
    v: dict[int, float], a: dict[int, float], count: int, bodies: int
) -> None:
    velocity, change = np.zeros(12), np.zeros(12)
    for values, array in ((v, velocity), (a, change)):
        for body, value in values.items():
            array[body] = value
    # a speed of 2 m/s: 2e-22 m/s is at rest
    assert kernels.reached.interpret(velocity, change, count, 2.0) == bodies


# ---------------------------------------------------------------- the numbers of a scene, and samples between steps
def test_the_numbers_of_a_scene_are_along_its_line() -> None:
    scene = replace(
        CHAIN, exponent=(2.5, 2.2), wall_left=None, wall_right=Wall(stiffness=5e9, exponent=2.3), gravity=3.0, drag=0.5,
        damping=Damping(law="dashpot", coefficient=7.0, clip=True),
    )  # fmt: skip
    system = system_of(scene)
    assert system.stiffness.tolist() == [0.0, 4e9, 6e9, 5e9]
    assert system.exponent.tolist() == [2.5, 2.5, 2.2, 2.3]
    assert system.gap.tolist() == [0.0, 0.0, 2e-6, 0.0]
    assert system.damping.tolist() == [0.0, 7.0, 7.0, 7.0]
    assert (system.damping_power.tolist(), system.pull_off.tolist()) == ([0.0] * 4, [0.0] * 4)
    assert (system.free.tolist(), system.drag, system.first_step) == ([3.0] * 3, 0.5, pytest.approx(1e-8))
    assert (system.clipped, system.pulls, system.damped) == (True, False, True)
    assert not system.hertz
    assert not system.adhesive
    assert system_of(replace(scene, exponent=(2.2, 2.5))).exponent[0] == 2.2
    plain = system_of(CHAIN)
    assert (plain.hertz, plain.damped, plain.adhesive, plain.clipped) == (True, False, False, CHAIN.contacts.clip)
    glue = Adhesion(law="dmt", pull_off=0.5)
    glued = system_of(replace(CHAIN, wall_left=None, wall_right=None, adhesion=glue))
    assert (glued.adhesive, glued.pull_off.tolist()) == (True, [0.0, 0.5, 0.5, 0.0])
    parted = system_of(replace(CHAIN, wall_left=None, wall_right=None))
    assert (parted.hertz, parted.exponent.tolist()) == (True, [2.5] * 4)
    assert plain.changed(damping=np.array([0.0, 0.0, 0.0, 0.5])).damped
    assert plain.changed(pull_off=np.array([0.0, 0.5, 0.0, 0.0])).adhesive
    assert not plain.changed(exponent=np.array([2.5, 2.5, 2.4, 2.5])).hertz
    model = Model(CHAIN)
    assert model.depth > 0.0
    still = Model(replace(CHAIN, velocity=(0.0, 0.0, 0.0)))
    assert (still.speed, still.depth) == (1.0, 0.0)
    slow = Model(replace(CHAIN, velocity=(0.25, 0.0, 0.0)))
    assert slow.speed == pytest.approx(0.25)


class Cubic(Model):
    """Motion after steps is a polynomial of the time, and steps are recorded."""

    def __init__(self) -> None:
        self.steps: list[int] = []

    def stepped(self, system: Any, steps: Any, dt: float, method: int = kernels.VERLET) -> Motion:
        self.steps, self.method = steps.tolist(), method
        t = dt * steps[:, None].astype(float)
        x = 2.0 + 3.0 * t - 5.0 * t**2 + 7.0 * t**3
        v = 3.0 - 10.0 * t + 21.0 * t**2
        return Motion(x, v, -10.0 + 42.0 * t, 4.0 * t)


def test_between_steps_are_polynomials_of_third_degree_and_lines() -> None:
    model, nothing = Cubic(), SimpleNamespace()
    system: Any = nothing
    motion = model.stepped_at(system, np.array([0.0, 0.25, 1.1, 3.5]), 0.5, kernels.RK4)
    t = np.array([0.0, 0.25, 1.1, 3.5])
    np.testing.assert_allclose(motion.displacement[:, 0], 2.0 + 3.0 * t - 5.0 * t**2 + 7.0 * t**3, rtol=1e-12)
    np.testing.assert_allclose(motion.velocity[:, 0], 3.0 - 10.0 * t + 21.0 * t**2, rtol=1e-12)
    np.testing.assert_allclose(motion.acceleration[:, 0], -10.0 + 42.0 * t, rtol=1e-12)
    np.testing.assert_allclose(motion.force[:, 0], 4.0 * t, rtol=1e-12, atol=1e-15)
    assert (model.steps, model.method) == ([0, 1, 2, 3, 7, 8], kernels.RK4)
    # times to a hundred-thousandth of a step, or to the digits of many steps, are at steps
    for time, steps in (
        (0.5 + 0.9e-5, [0, 1]),
        (0.5 - 0.4e-5, [0, 1]),
        (0.5 + 1.5e-5, [0, 1, 2]),
        (0.5 - 0.75e-5, [0, 1]),
        (5e4 + 4e-5, [0, 100_000]),
        (5e4 + 9e-5, [0, 1, 100_000, 100_001]),
    ):
        model.stepped_at(system, np.array([0.0, time]), 0.5)
        assert model.steps == steps
    assert model.method == kernels.VERLET


def test_the_table_of_dop853_is_that_of_scipy_without_scipy_integrate() -> None:
    nodes, weights, errors = Model(CHAIN)._pair
    assert np.array_equal(nodes, DOP853.A)
    assert np.array_equal(weights, DOP853.B)
    assert np.array_equal(errors, [DOP853.E3, DOP853.E5])
    code = (
        "import sys, dem_bridge as db; from dem_bridge.judging import beside, model;"
        "model.Model(db.load_scene('decelerating-40'));"
        "print(*{'scipy.integrate', 'scipy.optimize', 'scipy.linalg', 'matplotlib', 'jinja2'} & set(sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == []


@pytest.mark.parametrize("kind", PISTONS)
def test_a_piston_moves_as_prescribed_in_the_motion_of_the_diagnosis(kind: str) -> None:
    scene = pushed(kind, damping=Damping(law="coeff_restitution", coefficient=0.7))
    model, fast = Model(scene), 0.4
    truth, twin = (
        db.solve(scene, backend=name, dt=dt, uncertainty=False) for name, dt in (("scipy", None), ("verlet", 1e-7))
    )
    exact = model.exact(model.system, truth.time)
    # ten times the tolerance of a step, and the bends of a table, which the method does not know
    assert np.max(np.abs(exact.velocity - truth.velocity)) < 1e-7 * fast
    assert np.max(np.abs(exact.displacement[:, 0] - truth.displacement[:, 0])) < 1e-15 * fast
    steps = np.rint(truth.time / 1e-7).astype(np.int64)
    stepped = model.stepped(model.system, steps, 1e-7)
    assert np.max(np.abs(stepped.velocity - twin.velocity)) < 1e-10 * fast
