"""Chains that a piston moves: a wall in its own frame, orders, uncertainties, balances, and who refuses them."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import dem_bridge as db
from dem_bridge.backends.base import BACKENDS, supports_of
from dem_bridge.backends.driven import driven_of, piston_motion
from dem_bridge.errors import UnsupportedScene
from dem_bridge.observables.conserved import energy_parts, measure_energy_less_work, momentum
from dem_bridge.observables.ledger import energy_ledger
from dem_bridge.scene.piston import Piston
from dem_bridge.scene.scene import Damping, Scene, Wall
from dem_bridge.trajectory.trajectory import QUANTITIES, Trajectory
from tests.helpers.driven_chains import PISTONS, pushed

EPS = float(np.finfo(float).eps)
each = pytest.mark.parametrize("kind", PISTONS)
#: damped, pressed to a wall, or falling
PHYSICS: dict[str, dict[str, Any]] = {
    "plain": {},
    "damped": {"damping": Damping(law="kuwabara-kono", coefficient=1e-6), "gravity": 50.0, "drag": 100.0},
    "by restitution": {"damping": Damping(law="coeff_restitution", coefficient=0.5)},
    "walled": {"wall_right": Wall(stiffness=5e9, gap=1e-6), "gap": (2e-6, 0.0, 1e-6, 0.0, 0.0)},
}
each_physics = pytest.mark.parametrize("physics", PHYSICS)


def _error(run: Trajectory, other: Trajectory, quantity: str = "velocity") -> float:
    return float(np.max(np.abs(getattr(run, quantity) - getattr(other, quantity))))


@each
def test_kernels_have_the_motion_of_the_piston(kind: str) -> None:
    piston, moved = PISTONS[kind], driven_of(pushed(kind)).piston
    time = np.linspace(0.0, 2e-4, 321)
    way, velocity, acceleration = np.array([piston_motion(t, moved) for t in time.tolist()]).T
    np.testing.assert_allclose(way, piston.displacement(time), rtol=0.0, atol=8.0 * EPS * piston.peak * 2e-4)
    np.testing.assert_allclose(velocity, piston.at(time), rtol=0.0, atol=8.0 * EPS * piston.peak)
    inner = np.min(np.abs(time[:, None] - np.append(piston.breaks, 2e-4)), axis=1) > 1e-12
    np.testing.assert_allclose(acceleration[inner], piston.acceleration(time)[inner], rtol=1e-12, atol=1e-9)


def _as_wall(scene: Scene) -> Scene:
    """Return the bodies before a piston of constant velocity as they are in its frame: before a wall at rest."""
    speed = scene.velocity[0]
    bodies = {name: getattr(scene, name)[1:] for name in ("mass", "stiffness", "gap")}
    wall = Wall(stiffness=scene.stiffness[0], gap=scene.contacts.gap[0].item())
    velocity = tuple(v - speed for v in scene.velocity[1:])
    return replace(scene, drive=None, wall_left=wall, exponent=2.5, velocity=velocity, **bodies)


@pytest.mark.parametrize("gravity", [0.0, 50.0])
def test_a_constant_piston_is_a_wall_in_its_own_frame(gravity: float) -> None:
    scene = pushed("constant", gravity=gravity, gap=(1e-6, 0.0, 2e-6, 0.0, 0.0))
    run, wall = db.solve(scene, backend="scipy"), db.solve(_as_wall(scene), backend="reference")
    series = db.solve(scene, backend="reference")
    # Taylor series, which share nothing with scipy
    assert series.provenance.get("answered_by") is wall.provenance.get("answered_by") is None
    assert series.provenance["scene_hash"] == scene.content_hash
    speed, time = scene.velocity[0], run.time[:, None]
    # 200 steps at the tolerance of 3e-14 of the speed
    assert np.max(np.abs(run.velocity[:, 1:] - wall.velocity - speed)) < 1e-12 * 0.6
    assert np.max(np.abs(run.displacement[:, 1:] - wall.displacement - speed * time)) < 1e-12 * speed * run.time[-1]
    np.testing.assert_allclose(run.peak_force, np.roll(wall.peak_force, 1), rtol=1e-11)
    np.testing.assert_allclose(run.crossing_time, np.roll(wall.crossing_time, 1), rtol=0.0, atol=1e-12 * 1.8e-4)
    for quantity in QUANTITIES:
        difference = np.abs(getattr(run, quantity) - getattr(series, quantity))
        assert np.all(difference <= np.asarray(run.uncertainty[quantity]) + np.asarray(series.uncertainty[quantity]))


@pytest.mark.parametrize("backend", ["reference", "verlet", pytest.param("lammps-granular", marks=pytest.mark.lammps)])
def test_energy_is_the_momentum_times_the_velocity_of_a_constant_piston(backend: str) -> None:
    """A piston of velocity V does the work V times its impulse: bodies that it finds at rest have E(t) = V P(t)."""
    bodies, speed = 30, 0.3
    scene = Scene(
        name="shock",
        duration=5e-4,
        mass=(1e-2,) * (bodies + 1),
        stiffness=(4e9,) * bodies,
        velocity=(0.0,) * (bodies + 1),
        drive=Piston(shape="constant", velocity=speed),
        samples=200,
    )
    error = {"reference": 1e-12, "verlet": 1e-5, "lammps-granular": 1e-5}[backend]
    run = db.solve(scene, backend=backend, uncertainty=False, dt=None if backend == "reference" else 1e-7)
    kinetic, stored, _ = energy_parts(scene, run)
    own = scene.mass[0] * speed
    energy, impulse = kinetic + stored - 0.5 * own * speed, momentum(scene, run) - own
    # of the reference, a few hundred steps at the last digits; of the others (omega dt)^2 = (1e5 1e-7)^2 / 24 of it
    assert np.max(np.abs(energy - speed * impulse)) < error * np.max(energy)


@each
@each_physics
def test_twin_and_scipy_agree_within_their_uncertainties(kind: str, physics: str) -> None:
    scene = pushed(kind, **PHYSICS[physics])
    truth, twin = db.solve(scene, backend="scipy"), db.solve(scene, backend="verlet", dt=2e-7)
    for quantity in QUANTITIES:
        bar = np.asarray(truth.uncertainty[quantity]) + np.asarray(twin.uncertainty[quantity])
        difference = np.abs(getattr(truth, quantity) - getattr(twin, quantity))
        assert np.all((difference <= bar) | np.isnan(difference)), quantity
    piston = scene.piston
    assert piston is not None
    # it goes where it shall go, in both: some 200 steps at 3e-14 of the speed, and to the last digits
    way, velocity = piston.displacement(truth.time), piston.at(truth.time)
    assert np.max(np.abs(truth.displacement[:, 0] - way)) < 1e-12 * piston.peak * scene.duration
    assert np.max(np.abs(truth.velocity[:, 0] - velocity)) < 1e-12 * piston.peak
    np.testing.assert_allclose(twin.displacement[:, 0], way, rtol=0.0, atol=16.0 * EPS * piston.peak * scene.duration)
    np.testing.assert_allclose(twin.velocity[:, 0], velocity, rtol=0.0, atol=16.0 * EPS * piston.peak)


@pytest.mark.parametrize("kind", ["constant", "sine", "wiggle"])
@pytest.mark.parametrize(("name", "order", "steps"), [("verlet", 2, (4e-7, 2e-7)), ("blanes-moan", 4, (2e-6, 1e-6))])
def test_a_pressed_chain_is_followed_to_the_methods_order(
    kind: str, name: str, order: int, steps: tuple[float, ...]
) -> None:
    # no contact opens, so that all is smooth
    scene = pushed(kind, precompression=200.0, drive=PISTONS[kind].times(0.05), velocity=(0.0,) * 6)
    truth = db.solve(scene, backend="scipy", uncertainty=False)
    assert np.min(truth.contact_force) > 0.0
    errors = [_error(db.solve(scene, backend=name, dt=dt, uncertainty=False), truth) for dt in steps]
    assert math.log2(errors[0] / errors[1]) == pytest.approx(order, abs=0.25)


@each
@each_physics
def test_energy_and_momentum_are_the_work_and_impulse_of_the_piston(kind: str, physics: str) -> None:
    scene = pushed(kind, **PHYSICS[physics], samples=400)
    run = db.solve(scene, backend="scipy")
    ledger = energy_ledger(scene, run)
    # samples are 5e-7 s apart: between them the motion of body 1 is a polynomial of degree 11; where a force begins it
    # is not smooth, with damping less so
    assert np.max(np.abs(ledger.balance)) < (1e-4 if scene.damped else 1e-7) * np.max(np.abs(ledger.work))
    if not scene.dissipates:
        energy, uncertainty, scale = measure_energy_less_work(scene, run)
        assert np.max(np.abs(energy - energy[0])) <= 2.0 * np.max(uncertainty) < 1e-5 * scale
    if physics == "plain":
        assert scene.piston is not None
        own = scene.mass[0] * (scene.piston.at(run.time) - scene.velocity[0])
        impulse = momentum(scene, run) - momentum(scene, run)[0] - own
        force = run.contact_force[:, 0]
        # the trapezoidal rule over 400 samples of pulses of 50 samples
        summed = np.concatenate([[0.0], np.cumsum(0.5 * (force[1:] + force[:-1]) * run.time[1])])
        assert np.max(np.abs(impulse - summed)) < 1e-3 * np.max(np.abs(impulse))


def _solved(**changes: Any) -> Trajectory:
    """Return the run of a chain before a sine, with changes of its scene, by scipy."""
    return db.solve(pushed("sine", **changes), backend="scipy", uncertainty=False)


def test_the_mass_of_a_piston_acts_through_damping_alone() -> None:
    heavy: dict[str, Any] = {"mass": (5e-2, *pushed("sine").mass[1:])}
    changes: dict[str, Any]
    for changes in ({}, {"damping": Damping(law="dashpot", coefficient=20.0)}):
        light, other = (_solved(**changes, **more) for more in ({}, heavy))
        assert _error(light, other) < 1e-13 * 0.3
    damping: dict[str, Any] = {"damping": Damping(law="mass_velocity", coefficient=5e4)}
    light, other = (_solved(**damping, **more) for more in ({}, heavy))
    # m_eff of the first contact is 8.3 g in place of 3.3 g
    assert _error(light, other) > 1e-2 * 0.3


@pytest.mark.parametrize("ratio", [0.1, 1.0, 10.0])
def test_a_restitution_is_that_of_the_effective_mass_of_the_piston(ratio: float) -> None:
    """A damping ratio of the mass m_eff acts on the mass m: the ratio of the motion is lower by sqrt(m_eff / m)."""
    mass, speed, written = 1e-2, 0.8, 0.5
    scene = Scene(
        name="hit",
        duration=1.2e-4,
        mass=(ratio * mass, mass),
        stiffness=(4e9,),
        velocity=(0.0, 0.0),
        drive=Piston(shape="constant", velocity=speed),
        damping=Damping(law="coeff_restitution", coefficient=written, clip=False),
        samples=60,
    )
    damping = -math.log(written) / math.hypot(math.pi, math.log(written)) * math.sqrt(ratio / (1.0 + ratio))
    expected = math.exp(-math.pi * damping / math.sqrt(1.0 - damping**2))
    run = db.solve(scene, backend="scipy", uncertainty=False)
    assert run.contact_force[-1, 0] == 0.0
    assert run.velocity[-1, 1] / speed - 1.0 == pytest.approx(expected, rel=1e-11)


@pytest.mark.parametrize("name", BACKENDS)
def test_codes_solve_pistons_or_refuse_them_by_name(name: str) -> None:
    pistons = {feature for kind in PISTONS for feature in pushed(kind).features}
    supported = pistons & supports_of(name).features
    assert supported in (set(), pistons)
    for kind in PISTONS if not supported else ():
        with pytest.raises(UnsupportedScene, match="a piston of"):
            db.solve(pushed(kind), backend=name, uncertainty=False)


def test_ensembles_refuse_pistons_by_name() -> None:
    with pytest.raises(UnsupportedScene, match="a piston of constant velocity"):
        db.ensemble(pushed("constant"), vary={"mass": 0.01}, n=10)


@pytest.mark.lammps
@each
@each_physics
def test_lammps_moves_as_the_twin_does(kind: str, physics: str) -> None:
    scene = pushed(kind, **PHYSICS[physics])
    run, twin = (db.solve(scene, backend=name, dt=1e-7, uncertainty=False) for name in ("lammps-granular", "verlet"))
    far, fast = np.max(np.abs(twin.displacement)), np.max(np.abs(twin.velocity))
    # positions of a surrogate radius of some 1e-5 m; with damping that begins with an infinite slope touch decides
    assert _error(run, twin, "displacement") < 1e-12 * far
    assert _error(run, twin) < 1e-11 * fast
    assert _error(run, twin, "contact_force") < 1e-10 * np.max(twin.contact_force)
