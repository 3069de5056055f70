"""Driven chains: closed forms, orders, bars that hold, and who refuses them."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import dem_bridge as db
from dem_bridge.backends.base import BACKENDS, supports_of
from dem_bridge.backends.driven import driven_of, driving_force
from dem_bridge.backends.prescan import prescan_hertz
from dem_bridge.backends.scales import natural_scales
from dem_bridge.backends.scene_prescan import prescan_scene
from dem_bridge.errors import UnsupportedScene
from dem_bridge.observables.convergence import observed_order
from dem_bridge.scene.drive import Drive
from dem_bridge.scene.scene import Damping, Scene, Wall
from dem_bridge.trajectory.trajectory import QUANTITIES, Trajectory
from tests.conftest import Solve
from tests.helpers.driven_chains import CHIRP, DRIVES, PRESSED, SINE, TABLE, TOUCHING, driven, free_body, oscillator

EPS = float(np.finfo(float).eps)
SCENES = {f"{s.name}-{shape}": driven(s, shape) for s, shape in itertools.product((TOUCHING, PRESSED), DRIVES)}
each_scene = pytest.mark.parametrize("scene", SCENES.values(), ids=SCENES)


def _error(run: Trajectory, other: Trajectory, quantity: str = "velocity") -> float:
    return float(np.max(np.abs(getattr(run, quantity) - getattr(other, quantity))))


# the force in kernels


@pytest.mark.parametrize("drive", [*DRIVES.values(), replace(CHIRP, rise=1e-4), replace(SINE, rise=0.0)])
def test_kernels_have_the_force_of_the_drive(drive: Drive) -> None:
    scene, time = free_body(drive), np.linspace(0.0, 4e-4, 321)  # knots of the table among them
    found = [driving_force(t, driven_of(scene)) for t in time.tolist()]
    np.testing.assert_allclose(found, drive.at(time), rtol=0.0, atol=2.0 * EPS * drive.peak)


def test_kernels_stay_at_the_last_value_of_a_table_that_a_rounding_has_left() -> None:
    driven_by = driven_of(free_body(TABLE))
    end = 5 * 8e-5
    assert [driving_force(t, driven_by) for t in (end, math.nextafter(end, 1.0), 1.001 * end)] == [0.0] * 3


# closed forms


def _of_a_free_sine(drive: Drive, mass: float, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Displacement and velocity of a body that a sine without rise drives from rest."""
    assert isinstance(drive.force, float)
    assert drive.frequency is not None
    turn, phase = 2.0 * math.pi * drive.frequency, math.radians(drive.phase)
    speed = drive.force / (mass * turn)
    v = speed * (math.cos(phase) - np.cos(turn * t + phase))
    x = speed * (t * math.cos(phase) - (np.sin(turn * t + phase) - math.sin(phase)) / turn)
    return x, v


def test_a_free_body_driven_by_a_sine_has_the_motion_of_the_closed_form() -> None:
    scene = free_body(replace(SINE, rise=0.0))
    assert isinstance(scene.drive, Drive)
    run = db.solve(scene, backend="scipy")
    x, v = _of_a_free_sine(scene.drive, scene.mass[0], run.time)
    # some 30 steps at the tolerance of 3e-14 of the speed
    assert np.max(np.abs(run.velocity[:, 0] - v)) < 1e-12 * np.max(np.abs(v))
    assert np.max(np.abs(run.displacement[:, 0] - x)) < 1e-12 * np.max(np.abs(x))
    assert np.max(np.abs(run.velocity[:, 0] - v)) <= run.uncertainty["velocity"]


@pytest.mark.parametrize(("name", "order", "steps"), [("verlet", 2, (5e-7, 2.5e-7)), ("blanes-moan", 4, (8e-6, 4e-6))])
def test_a_free_body_is_followed_to_the_methods_order(name: str, order: int, steps: tuple[float, ...]) -> None:
    scene = free_body(replace(SINE, rise=0.0))
    assert isinstance(scene.drive, Drive)
    errors = []
    for dt in steps:
        run = db.solve(scene, backend=name, dt=dt)
        v = _of_a_free_sine(scene.drive, scene.mass[0], run.time)[1]
        errors.append(float(np.max(np.abs(run.velocity[:, 0] - v))))
        assert errors[-1] <= run.uncertainty["velocity"]
    assert math.log2(errors[0] / errors[1]) == pytest.approx(order, abs=0.1)


@pytest.mark.parametrize("ratio", [0.3, 1.0, 1.7])
def test_an_oscillator_has_the_closed_form_off_resonance_and_at_it(ratio: float) -> None:
    scene, own = oscillator(ratio, amplitude=0.4)
    run, t = db.solve(scene, backend="scipy"), np.linspace(0.0, scene.duration, 201)
    scale = 0.4 / (scene.mass[0] * own**2)
    if ratio == 1.0:
        x = 0.5 * scale * (np.sin(own * t) - own * t * np.cos(own * t))
    else:
        x = scale / (1.0 - ratio**2) * (np.sin(ratio * own * t) - ratio * np.sin(own * t))
    assert np.min(run.contact_force) > 0.0  # the spring never opens
    # six cycles at the tolerance of 3e-14, and of a static force of ten times the drive
    assert np.max(np.abs(run.displacement[:, 0] - x)) < 2e-12 * np.max(np.abs(x))
    twin = db.solve(scene, backend="verlet", dt=scene.duration / 20_000)
    # six cycles of (omega dt)^2 / 24 each turn of phase: 2 pi 6 (1.9e-3)^2 / 24
    assert np.max(np.abs(twin.displacement[:, 0] - x)) < 1e-5 * np.max(np.abs(x))


@pytest.mark.parametrize("name", ["scipy", "verlet", "blanes-moan"])
def test_straight_lines_of_a_table_are_integrated_piece_by_piece(name: str) -> None:
    """Velocity-Verlet's kicks are the trapezoidal rule, which is exact on straight lines whose ends are steps; so is
    that of the other method, whose forces between are symmetric."""
    scene = replace(free_body(TABLE), samples=10)
    assert isinstance(TABLE.force, tuple)
    run = db.solve(scene, backend=name, dt=None if name == "scipy" else 4e-6)
    speeds = np.cumsum([0.0, *(0.5 * (a + b) * 8e-5 for a, b in itertools.pairwise(TABLE.force))]) / scene.mass[0]
    # samples 0, 2, 4, ... are the knots; 100 steps of six kicks, each rounded
    assert np.max(np.abs(run.velocity[::2, 0] - speeds)) < 600.0 * EPS * np.max(np.abs(speeds))


def test_a_table_whose_knots_are_no_steps_is_still_of_second_order() -> None:
    scene = replace(free_body(replace(TABLE, interval=8.1e-5)), samples=1)
    assert isinstance(scene.drive, Drive)
    reference = db.solve(scene, backend="scipy", uncertainty=False).velocity[-1, 0]
    steps = [2e-6, 1e-6, 5e-7, 2.5e-7, 1.25e-7]
    errors = [abs(float(db.solve(scene, backend="verlet", dt=dt).velocity[-1, 0] - reference)) for dt in steps]
    # where knots fall within steps changes each error by up to a factor: dt^2 times a bend's (8e4 N/s) / 8 m each
    assert all(error < 4 * 5e4 / 8.0 / 2e-3 * dt**2 for error, dt in zip(errors, steps, strict=True))


# chains


@pytest.mark.parametrize("shape", DRIVES)
@pytest.mark.parametrize(("name", "order", "coarsest"), [("verlet", 2, 1e-6), ("blanes-moan", 4, 4e-6)])
def test_the_order_is_the_methods_own_on_a_smooth_chain(
    name: str, order: int, coarsest: float, shape: str, solved: Solve
) -> None:
    # knots and the ends of sweeps and rises fall on steps
    scene = driven(PRESSED, shape)
    reference = solved(scene, "scipy")
    steps = [coarsest / factor for factor in (1, 2, 4)]
    errors = [_error(db.solve(scene, backend=name, dt=dt, uncertainty=False), reference) for dt in steps]
    assert observed_order(steps, errors).order == pytest.approx(order, abs=0.05 * order)


@each_scene
@pytest.mark.parametrize("name", ["verlet", "blanes-moan"])
def test_bars_hold_on_driven_chains(name: str, scene: Scene, solved: Solve) -> None:
    truth = solved(scene, "scipy")
    for dt in (5e-7, 1e-7):
        run = db.solve(scene, backend=name, dt=dt)
        for quantity in QUANTITIES:
            away = np.nan_to_num(np.abs(getattr(run, quantity) - getattr(truth, quantity)))
            assert np.all(away <= run.uncertainty[quantity] + truth.uncertainty[quantity]), quantity
        assert run.uncertainty["velocity"] < 1e-2 * np.max(np.abs(truth.velocity))


@each_scene
def test_scipy_is_within_its_bars_of_a_looser_run(scene: Scene, solved: Solve) -> None:
    fine, loose = solved(scene, "scipy"), db.solve(scene, backend="scipy", rtol=1e-9)
    assert _error(fine, loose) <= fine.uncertainty["velocity"] + loose.uncertainty["velocity"]
    assert fine.uncertainty["velocity"] < 1e-9 * np.max(np.abs(fine.velocity))


def test_scipy_begins_anew_where_a_table_bends(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = replace(free_body(replace(TABLE, interval=8.1e-5)), samples=1)
    sound = db.solve(scene, backend="scipy", uncertainty=False)
    exact = np.interp(scene.duration, 8.1e-5 * np.arange(6), np.array(TABLE.force))
    pairs = [*itertools.pairwise([*TABLE.force[:5], exact])]  # type: ignore[index]
    widths = [8.1e-5] * 4 + [scene.duration - 4 * 8.1e-5]
    speed = math.fsum(0.5 * (a + b) * w for (a, b), w in zip(pairs, widths, strict=True)) / scene.mass[0]
    assert float(sound.velocity[-1, 0]) == pytest.approx(speed, rel=1e-13)
    # planted: a drive that does not say where it bends
    monkeypatch.setattr(Drive, "breaks", np.zeros(0))
    rough = db.solve(replace(scene, drive=replace(TABLE, interval=8.1e-5)), backend="scipy", uncertainty=False)
    # it finds each bend by steps that fail
    assert rough.cost.force_evaluations > 3 * sound.cost.force_evaluations


@pytest.mark.parametrize("shape", DRIVES)
def test_damped_driven_chains_are_solved_by_both(shape: str) -> None:
    scene = replace(
        driven(TOUCHING, shape),
        damping=Damping(law="dashpot", coefficient=2.0),
        drag=50.0,
        wall_right=Wall(stiffness=4e9),
    )
    truth, twin = db.solve(scene, backend="scipy"), db.solve(scene, backend="verlet", dt=1e-7)
    assert _error(twin, truth) <= twin.uncertainty["velocity"] + truth.uncertainty["velocity"]
    assert twin.uncertainty["velocity"] < 1e-2 * np.max(np.abs(truth.velocity))


@pytest.mark.slow
def test_trial_steps_that_overflow_are_no_matter() -> None:
    # 3e-4 s long, from a force that hardly changes, into a contact of n = 5: 1e5 times too deep
    scene = Scene(
        name="hard",
        duration=1e-3,
        mass=(5e-3, 5e-3),
        stiffness=(1e22,),
        velocity=(0.0, 0.0),
        exponent=5.0,
        wall_right=Wall(stiffness=1e22),
        drive=Drive(shape="sine", force=5e4, frequency=10.0, phase=169.0),
        samples=10,
    )
    run, other = (db.solve(scene, backend=name) for name in ("scipy", "blanes-moan"))
    bar = run.uncertainty["velocity"] + other.uncertainty["velocity"]
    assert float(np.max(np.abs(run.velocity - other.velocity))) <= bar < 1e-6


def test_a_chain_with_a_law_of_its_own_is_driven_and_its_law_deep_enough() -> None:
    scene = replace(driven(TOUCHING, "sine"), law=lambda overlap: 4e9 * overlap**1.5)
    same = replace(scene, law=None, stiffness=4e9 * np.ones(3))  # type: ignore[arg-type]
    truth = db.solve(same, backend="scipy")
    for name in ("scipy", "verlet"):
        run = db.solve(scene, backend=name, uncertainty=False, dt=None if name == "scipy" else 1e-7)
        speed = np.max(np.abs(truth.velocity))
        # the law is the same; the twin errs by its step, see the bars
        assert _error(run, truth) < (1e-10 if name == "scipy" else 1e-5) * speed
        assert np.all(scene.contacts.reach > np.max(run.peak_force) / 4e9 ** (2 / 3))


def test_two_runs_from_the_same_drive_are_the_same_bits_and_a_silent_drive_is_none() -> None:
    silent = replace(
        TOUCHING, drive=Drive(shape="table", force=(0.0, 0.0), interval=1.0), velocity=(0.5, 0.0, 0.0, 0.0)
    )
    for name in ("verlet", "blanes-moan", "scipy"):
        one, again, other = (
            db.solve(scene, backend=name, uncertainty=False) for scene in (silent, silent, replace(silent, drive=None))
        )
        np.testing.assert_array_equal(one.velocity, again.velocity)
        # a driven scene takes scipy's own steps, one without a drive compiled ones, whose sums are in another order:
        # some 1e3 steps of 12 stages, each a few 1e-16 away
        away = 1e-11 * np.max(np.abs(other.velocity)) if name == "scipy" else 0.0
        np.testing.assert_allclose(one.velocity, other.velocity, rtol=0.0, atol=away)


def test_the_reference_answers_through_scipy() -> None:
    run = db.solve(TOUCHING, backend="reference", uncertainty=False)
    assert run.provenance["answered_by"] == "scipy"
    np.testing.assert_array_equal(run.velocity, db.solve(TOUCHING, backend="scipy", uncertainty=False).velocity)


def test_those_that_cannot_say_so_and_what_to_take() -> None:
    assert {name for name in BACKENDS if not supports_of(name).covers(TOUCHING)} == {"ase", "ode45", "bca", "adiabatic"}
    for name in ("ase", "ode45"):
        with pytest.raises(UnsupportedScene, match=r"the scene has a \w+ drive; supported: .*; use backend = 'scipy'"):
            db.solve(TOUCHING, backend=name)
    for name in ("bca", "adiabatic"):
        with pytest.raises(UnsupportedScene, match=r"the scene has a \w+ drive; "):
            db.solve(replace(TOUCHING, velocity=(1.0, 0.0, 0.0, 0.0)), backend=name)


# scales and the coarse run


def test_a_driven_chain_at_rest_has_a_scale() -> None:
    scene = free_body(replace(SINE, rise=0.0, phase=0.0))
    speed, _ = natural_scales(scene)
    moved = float(np.max(np.abs(db.solve(scene, backend="scipy", uncertainty=False).velocity)))
    assert moved == pytest.approx(2.0 * speed, rel=0.01)
    assert natural_scales(replace(scene, drive=None))[0] == 0.0


@each_scene
def test_the_coarse_run_finds_overlaps_and_the_rate_of_the_drive(scene: Scene) -> None:
    prescan, run = prescan_hertz(scene), db.solve(scene, backend="verlet", dt=1e-7, uncertainty=False)
    deepest = np.max(run.peak_force / scene.contacts.stiffness) ** (2.0 / 3.0)
    assert np.max(prescan.peak_overlap) == pytest.approx(deepest, rel=0.02)
    assert scene.drive is not None
    assert prescan.frequency >= scene.drive.rate


def test_a_drive_faster_than_any_contact_decides_the_step() -> None:
    soft: dict[str, Any] = {"stiffness": (1e3,) * 3, "drive": Drive(shape="sine", force=1e-3, frequency=1e6)}
    scene = replace(TOUCHING, **soft)
    assert prescan_hertz(scene).frequency == pytest.approx(2e6 * math.pi)
    law = replace(scene, law=lambda overlap: 1e3 * overlap**1.5)
    assert prescan_scene(law).frequency == pytest.approx(2e6 * math.pi)


# LAMMPS


@pytest.mark.lammps
@each_scene
def test_lammps_is_the_twin_in_positions_to_round_off(scene: Scene, solved: Solve) -> None:
    run = db.solve(scene, backend="lammps-granular", dt=1e-7)
    radius = run.provenance["settings"]["surrogate_radius"]
    twin = db.solve(scene, backend="verlet", dt=1e-7, surrogate_radius=radius, uncertainty=False)
    # 4000 steps, each of which rounds velocities of a few last digits; positions are the same numbers
    speed = float(np.max(np.abs(twin.velocity)))
    assert _error(run, twin) < 5e-12 * speed
    assert _error(run, db.solve(scene, backend="verlet", dt=1e-7, uncertainty=False)) <= (
        run.uncertainty.parts["round_off"] * speed
    )
    truth = solved(scene, "scipy")
    for quantity in QUANTITIES:
        away = np.nan_to_num(np.abs(getattr(run, quantity) - getattr(truth, quantity)))
        assert np.all(away <= run.uncertainty[quantity] + truth.uncertainty[quantity]), quantity


@pytest.mark.lammps
@pytest.mark.parametrize("name", ["touching-table", "pressed-chirp"])
def test_lammps_with_tables_is_driven_too(name: str, solved: Solve) -> None:
    scene = SCENES[name]
    run, truth = db.solve(scene, backend="lammps-table", dt=1e-7), solved(scene, "scipy")
    for quantity in QUANTITIES:
        away = np.nan_to_num(np.abs(getattr(run, quantity) - getattr(truth, quantity)))
        assert np.all(away <= run.uncertainty[quantity] + truth.uncertainty[quantity]), quantity
    table = run.provenance["table"]
    assert table["measured_error"] <= 1.1 * table["predicted_error"] + table["round_off"]


@pytest.mark.lammps
def test_walls_drag_and_damping_stand_beside_a_drive_in_lammps() -> None:
    scene = replace(
        driven(TOUCHING, "chirp"), wall_left=Wall(stiffness=3e9), wall_right=Wall(stiffness=4e9), gravity=5.0, drag=30,
        damping=Damping(law="dashpot", coefficient=1.0),
    )  # fmt: skip
    run = db.solve(scene, backend="lammps-granular", dt=1e-7)
    twin = db.solve(scene, backend="verlet", dt=1e-7, uncertainty=False)
    assert _error(run, twin) <= run.uncertainty.parts["round_off"] * np.max(np.abs(twin.velocity))
    assert _error(run, twin, "contact_force") < 1e-9 * np.max(twin.contact_force)
