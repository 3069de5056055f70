"""The planted files are what they are said to be: right files agree with the reference, faults have their effect."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import dem_bridge as db
from tests.helpers.planted.chains import FAMILIES, Chain, contact_time, spheres
from tests.helpers.planted.faults import LISTED, ONLY, Setting, plant
from tests.helpers.planted.motion import _compiled, accelerations, advance, dop853, exact

SMALL = 6


def _chain(family: str, bodies: int = SMALL, seed: int = 3) -> Chain:
    return FAMILIES[family](np.random.default_rng(seed), bodies)


def _setting(chain: Chain, **changes: object) -> Setting:
    return replace(Setting(interval=chain.duration / 100, rows=101), **changes)  # type: ignore[arg-type]


@pytest.mark.parametrize("family", [name for name in FAMILIES if name not in ("damped", "springs")])
def test_the_exact_motion_is_that_of_the_reference_on_the_scene_file(family: str, tmp_path: Path) -> None:
    chain = _chain(family)
    path = tmp_path / "scene.toml"
    path.write_text(chain.scene)
    scene = db.load_scene(path)
    # the formulas of stiffness, statics and mass are written twice; the scene's have 12 digits
    assert np.allclose(scene.contacts.stiffness, chain.stiffness, rtol=2e-12, atol=0.0)
    assert np.allclose(scene.contacts.gap, chain.gap, rtol=1e-10, atol=1e-20)
    x, v = exact(chain, chain.duration / chain.samples, chain.samples + 1)
    run = db.solve(scene, backend="reference", uncertainty=False)
    # Runge-Kutta at 60,000 steps errs by 4e-10 of the largest velocity at most, because of the kinks at touch
    assert np.max(np.abs(v - run.velocity)) < 2e-9 * np.max(np.abs(run.velocity))
    assert np.max(np.abs(x - run.displacement)) < 2e-9 * np.max(np.abs(run.displacement))


@pytest.mark.parametrize("family", ["damped", "springs"])
def test_the_exact_motion_of_damped_and_other_contacts_is_that_of_scipy(family: str, tmp_path: Path) -> None:
    chain = _chain(family, bodies=4)
    path = tmp_path / "scene.toml"
    path.write_text(chain.scene)
    scene = db.load_scene(path)
    assert np.allclose(scene.contacts.damping, chain.damping, rtol=2e-12, atol=0.0)
    x, v = exact(chain, chain.duration / chain.samples, chain.samples + 1)
    run = db.solve(scene, backend="scipy", uncertainty=False)
    # DOP853 straight through the contacts is good to some 1e-9 where the force jumps
    assert np.max(np.abs(v - run.velocity)) < 2e-8 * np.max(np.abs(run.velocity))
    assert np.max(np.abs(x - run.displacement)) < 2e-8 * np.max(np.abs(run.displacement))


def test_two_spheres_rebound_by_the_closed_form() -> None:
    chain = spheres(np.random.default_rng(1), 2)
    speed = chain.velocity[0]
    time = contact_time(chain.mass[0], chain.stiffness[0], speed)
    _, v = exact(chain, 1.001 * time, 2)
    # equal masses exchange their velocities
    assert np.allclose(v[-1], [0.0, speed], atol=1e-9 * speed)
    _, v = exact(chain, 0.5 * time, 2)
    # at the largest overlap both move alike
    assert v[-1, 0] - v[-1, 1] == pytest.approx(0.0, abs=1e-9 * speed)


def test_both_writings_of_the_equations_agree() -> None:
    for family in FAMILIES:
        chain = replace(_chain(family), drag=3.0)
        rng = np.random.default_rng(0)
        x, v = 1e-6 * rng.standard_normal(chain.n_body), rng.standard_normal(chain.n_body)
        for other in (chain, replace(chain, clipped=False), replace(chain, tension=True, clipped=False)):
            expected = accelerations(other, x, v)
            # sums of two forces in another order
            assert np.allclose(_compiled(other)(x, v), expected, rtol=1e-13, atol=1e-13 * np.max(np.abs(expected)))


@pytest.mark.parametrize(
    ("method", "velocity", "displacement"),
    # the displacements of symplectic Euler are those of velocity Verlet if nothing is accelerated at the start
    [("verlet", 2, 2), ("position-verlet", 2, 2), ("kick-drift", 1, 2), ("drift-kick", 1, 2), ("euler", 1, 1)],
)
def test_each_integrator_has_its_order(method: str, velocity: int, displacement: int) -> None:
    chain = _chain("graded")
    right = exact(chain, chain.duration / 50, 51)
    errors = []
    for stride in (50, 100):
        run = advance(chain, method, chain.duration / 50 / stride, stride, 51)
        errors.append([float(np.max(np.abs(a - b))) for a, b in zip(run, right, strict=False)])
    orders = np.log2(np.array(errors[0]) / errors[1])
    # the limit is reached within a tenth at these steps
    assert orders == pytest.approx([displacement, velocity], abs=0.15)


def test_half_step_velocities_are_of_first_order_beside_displacements_of_second() -> None:
    chain = _chain("graded")
    x, v = exact(chain, chain.duration / 50, 51)
    errors = []
    for stride in (50, 100):
        positions, _, earlier = advance(chain, "verlet", chain.duration / 50 / stride, stride, 51)
        errors.append([float(np.max(np.abs(positions - x))), float(np.max(np.abs(earlier - v)))])
    assert np.log2(np.array(errors[0]) / errors[1]) == pytest.approx([2.0, 1.0], abs=0.15)


def test_symplectic_euler_and_half_step_velocities_are_one_file_without_acceleration_at_the_start() -> None:
    chain = _chain("gaps")
    dt = chain.duration / 2000
    _, _, earlier = advance(chain, "verlet", dt, 20, 101)
    _, euler, _ = advance(chain, "kick-drift", dt, 20, 101)
    assert np.max(np.abs(euler - earlier)) < 1e-13 * chain.velocity[0]
    falling = _chain("falling")
    dt = falling.duration / 2000
    _, _, earlier = advance(falling, "verlet", dt, 20, 101)
    _, euler, _ = advance(falling, "kick-drift", dt, 20, 101)
    assert np.max(np.abs(euler - earlier)[:-1]) > 0.4 * dt * falling.gravity


def test_a_scaled_time_and_a_scaled_stiffness_have_the_same_velocities() -> None:
    chain, factor, interval = _chain("graded"), 1.3, 1e-6
    _, stiff = exact(chain.with_stiffness(factor), interval, 101)
    _, scaled = exact(chain, interval * factor**0.4, 101)
    # the error of the exact motion
    assert np.max(np.abs(stiff - scaled)) < 2e-9 * chain.velocity[0]


def test_dop853_is_right_to_a_few_1e_7() -> None:
    chain = _chain("tapered")
    time = np.linspace(0.0, chain.duration, 101)
    x, v = exact(chain, chain.duration / 100, 101)
    by_scipy = dop853(chain, time)
    # 5e-8 of the largest velocity is what it reaches straight through contacts
    assert np.max(np.abs(by_scipy[1] - v)) < 1e-6 * chain.velocity[0]
    assert np.max(np.abs(by_scipy[0] - x)) < 1e-6 * np.max(np.abs(x))


def test_a_right_file_differs_from_the_exact_motion_by_its_floor() -> None:
    chain = _chain("graded", bodies=4)
    for integrator in ("verlet", "rk4"):
        setting = _setting(chain, integrator=integrator, digits=17)
        planted = plant(chain, "none", setting, 0.0, np.random.default_rng(0))
        x, v = exact(chain, setting.interval, setting.rows, steps=120_000)
        for name, values in (("displacement", x), ("velocity", v)):
            # the floor is the error of the integrator, to the error of the exact motion
            assert np.max(np.abs(planted.run.values[name] - values)) <= 1.01 * planted.floor[name] + 1e-12
        assert planted.effect == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("fault", LISTED)
def test_each_fault_changes_the_file_by_more_than_its_floor(fault: str) -> None:
    family = ONLY.get(fault, ("graded",))[0]
    # up to ten bodies are in the order of their numbers as strings
    chain = _chain(family, 12 if fault == "swapped" else SMALL)
    setting = _setting(chain, stride=200, rows=51, digits=9)
    planted = plant(chain, fault, setting, 0.3, np.random.default_rng(2))
    # a clip shows little where contacts are damped lightly
    assert planted.effect > (50.0 if fault != "clip" else 0.0), planted.parameters
    assert planted.truth
    assert "unknown" not in planted.truth
