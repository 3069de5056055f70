"""The diagnosis' own kernels, uncompiled, beside a second writing of the equations of motion in plain numpy."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from dem_bridge.judging import kernels, plain_kernels
from dem_bridge.judging.kernels import System
from dem_bridge.judging.model import Model, MotionTooLong
from dem_bridge.scene.scene import Adhesion, Damping, Scene, Wall
from dem_bridge.trajectory.trajectory import Floats

CHAIN = Scene(
    name="three",
    duration=1e-4,
    mass=(8e-3, 1e-2, 1.2e-2),
    stiffness=(4e9, 6e9),
    velocity=(0.8, 0.0, -0.3),
    gap=(0.0, 2e-6),
    wall_left=Wall(stiffness=3e9),
    wall_right=Wall(stiffness=5e9),
)
SCENES = {
    "hertz": CHAIN,
    "gravity and drag": replace(CHAIN, gravity=-50.0, drag=300.0),
    "exponents": replace(CHAIN, exponent=(2.5, 2.2), wall_left=None, wall_right=None),
    "dashpot": replace(CHAIN, damping=Damping(law="dashpot", coefficient=40.0, clip=False)),
    "clipped": replace(CHAIN, damping=Damping(law="dashpot", coefficient=400.0, clip=True)),
    "kuwabara-kono": replace(CHAIN, damping=Damping(law="kuwabara-kono", coefficient=4e-6, clip=False)),
    "adhesion": replace(CHAIN, wall_left=None, wall_right=None, adhesion=Adhesion(law="dmt", pull_off=5.0)),
}


def contact_forces(x: Floats, v: Floats, s: System) -> Floats:
    """Return the forces of all contacts of the line; positions and velocities of walls are 0."""
    ends = np.concatenate([[0.0], x, [0.0]])
    overlap, rate = -np.diff(ends) - s.gap, -np.diff(np.concatenate([[0.0], v, [0.0]]))
    closed, depth = overlap > 0.0, np.abs(overlap)
    elastic = s.stiffness * depth ** (s.exponent - 1.0)
    total = elastic - s.pull_off + s.damping * rate * depth**s.damping_power
    total = np.where((s.damping > 0.0) & s.clipped, np.maximum(total, 0.0), total)
    return np.where(closed, total, -elastic if s.pulls else 0.0)


def acceleration(x: Floats, v: Floats, s: System) -> Floats:
    force = contact_forces(x, v, s)
    return np.asarray((force[:-1] - force[1:]) / s.mass + s.free - s.drag * v)


def scene_of(name: str) -> Scene:
    return SCENES[name]


@pytest.mark.parametrize("name", SCENES)
def test_forces_and_accelerations_are_those_of_the_equations(name: str) -> None:
    system, random = Model(scene_of(name)).system, np.random.default_rng(3)
    for pulls in (False, True):
        changed = system._replace(pulls=pulls)
        for _ in range(6):
            # some contacts are open, and damping sometimes exceeds the elastic force
            x, v = random.uniform(-6e-6, 6e-6, 3), random.uniform(-1.0, 1.0, 3)
            f, a = np.zeros(4), np.zeros(3)
            kernels.accelerations.interpret(0.0, x, v, 3, changed, f, a)
            # two orders of the same operations
            np.testing.assert_allclose(f, contact_forces(x, v, changed), rtol=1e-13, atol=1e-13)
            np.testing.assert_allclose(a, acceleration(x, v, changed), rtol=1e-12, atol=1e-9)


def one_step(method: int, x: Floats, v: Floats, a: Floats, dt: float, s: System) -> tuple[Floats, Floats, Floats]:
    """Return the state after a step; ``a`` is the acceleration of the last kick."""
    if method == kernels.VERLET:
        half = v + 0.5 * dt * a
        x = x + dt * half
        a = acceleration(x, half, s)
        return x, half + 0.5 * dt * a, a
    if method == kernels.DRIFT_FIRST:
        x = x + 0.5 * dt * v
        v = v + dt * acceleration(x, v, s)
        return x + 0.5 * dt * v, v, a
    if method == kernels.KICK_EULER:
        v = v + dt * acceleration(x, v, s)
        return x + dt * v, v, a
    if method == kernels.DRIFT_EULER:
        x = x + dt * v
        return x, v + dt * acceleration(x, v, s), a
    if method == kernels.EXPLICIT_EULER:
        return x + dt * v, v + dt * acceleration(x, v, s), a

    n = len(x)

    def slope(y: Floats) -> Floats:
        return np.concatenate([y[n:], acceleration(y[:n], y[n:], s)])

    y = np.concatenate([x, v])
    k1 = slope(y)
    k2 = slope(y + 0.5 * dt * k1)
    k3 = slope(y + 0.5 * dt * k2)
    k4 = slope(y + dt * k3)
    y = y + dt / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    return y[:n], y[n:], a


@pytest.mark.parametrize("name", ["hertz", "gravity and drag", "dashpot"])
@pytest.mark.parametrize("method", range(6))
def test_each_method_makes_the_steps_of_its_textbook(method: int, name: str) -> None:
    model, dt, rows = Model(scene_of(name)), 1e-6, np.array([0, 1, 2, 9, 40])
    out: Any = kernels.fixed.interpret(model.system, rows, dt, method, model.speed)
    x, v = np.zeros(3), model.system.velocity.copy()
    a, step = acceleration(x, v, model.system), 0
    for row, last in enumerate(rows):
        for _ in range(last - step):
            x, v, a = one_step(method, x, v, a, dt, model.system)
        step = last
        np.testing.assert_allclose(out[0][row], x, atol=1e-18, rtol=1e-10)
        np.testing.assert_allclose(out[1][row], v, atol=1e-13, rtol=1e-10)
        if method == kernels.VERLET:
            np.testing.assert_allclose(out[2][row], a, atol=1e-6, rtol=1e-9)
            # its forces are at the velocities of half a step before, but at the start
            early = v - 0.5 * dt * a if last else v
            np.testing.assert_allclose(out[3][row], contact_forces(x, early, model.system), atol=1e-9, rtol=1e-9)
        else:
            np.testing.assert_allclose(out[2][row], acceleration(x, v, model.system), atol=1e-6, rtol=1e-9)


@pytest.mark.parametrize("name", ["hertz", "gravity and drag"])
def test_the_adaptive_method_arrives_at_the_solution_of_another_code(name: str) -> None:
    scene = scene_of(name)
    model = Model(scene)
    times = np.array([0.0, 1e-6, 3e-5, 3.3e-5, 1e-4])
    calls = 0

    def right_side(_: float, y: Floats) -> Floats:
        nonlocal calls
        calls += 1
        return np.concatenate([y[3:], acceleration(y[:3], y[3:], model.system)])

    start = np.concatenate([np.zeros(3), model.system.velocity])
    truth = solve_ivp(right_side, (0.0, 1e-4), start, "DOP853", times, rtol=1e-11, atol=1e-15)
    x, v, a, f, _ = kernels.adaptive.interpret(model.system, times, model.speed, 1e-10, *model._pair)
    # 3,000 tolerances of the speed at most, for bodies collide often: 50 to 940 with seven versions of libm, whose
    # last digits choose other steps; and no error of a velocity lasts longer than the run
    velocity = 3000.0 * 1e-10 * model.speed
    np.testing.assert_allclose(v, truth.y[3:].T, rtol=0.0, atol=velocity)
    np.testing.assert_allclose(x, truth.y[:3].T, rtol=0.0, atol=velocity * times[-1])
    for row in range(len(times)):
        np.testing.assert_allclose(f[row], contact_forces(x[row], v[row], model.system), rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(a[row], acceleration(x[row], v[row], model.system), rtol=1e-9, atol=1e-6)


def test_bodies_ahead_of_a_front_rest_until_it_comes() -> None:
    scene = Scene(name="line", duration=1e-5, mass=(1e-2,) * 12, stiffness=(4e9,) * 11, velocity=(0.8, *[0.0] * 11))
    model = Model(scene)
    rest, moving = np.zeros(12), np.zeros(12)
    moving[3] = 0.1
    # a body that moves, and five ahead of it
    assert kernels.reached.interpret(moving, rest, 0, 0.8) == 9
    assert kernels.reached.interpret(rest, moving, 0, 0.8) == 9
    assert kernels.reached.interpret(rest, moving, 11, 0.8) == 11
    out: Any = kernels.fixed.interpret(model.system, np.array([5]), 1e-6, kernels.VERLET, model.speed)
    x, v, a = (
        np.zeros(12),
        model.system.velocity.copy(),
        acceleration(np.zeros(12), model.system.velocity, model.system),
    )
    for _ in range(5):
        x, v, a = one_step(kernels.VERLET, x, v, a, 1e-6, model.system)
    np.testing.assert_allclose(out[1][0], v, atol=1e-15)


def test_a_motion_without_numbers_ends_as_nan_and_not_in_an_endless_loop() -> None:
    model = Model(CHAIN)
    broken = model.system._replace(stiffness=np.full(4, np.inf))
    with np.errstate(all="ignore"):
        out: Any = kernels.adaptive.interpret(broken, np.array([0.0, 1e-4]), model.speed, 1e-10, *model._pair)
    assert np.all(out[0][0] == 0.0)
    assert np.all(np.isnan(out[1][1]))


@pytest.mark.parametrize("scene", [CHAIN, replace(CHAIN, exponent=(2.5, 2.2))], ids=["plain", "general"])
def test_a_motion_that_needs_too_many_steps_is_an_error_and_no_rest(
    scene: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    for module in (kernels, plain_kernels):
        monkeypatch.setattr(module, "adaptive", module.adaptive.interpret)
        monkeypatch.setattr(module, "MOST_ADAPTIVE_STEPS", 20)
    model, times = Model(scene), np.linspace(0.0, scene.duration, 5)
    with pytest.raises(
        MotionTooLong, match=r"of three takes more than 20 steps to 0.0001 s \(it was followed to .*e-0"
    ):
        model.exact(model.system, times)
    # a hypothesis that needs so many has no motion
    other = model.system.changed(stiffness=2.0 * model.system.stiffness)
    assert np.isnan(model.exact(other, times).velocity[-1]).all()
    # each of many times has steps of its own
    still = Model(replace(scene, velocity=(0.8, 0.8, 0.8), wall_left=None, wall_right=None))
    assert still.exact(still.system, np.linspace(0.0, 1e-6, 100)).velocity[-1].tolist() == [0.8, 0.8, 0.8]
