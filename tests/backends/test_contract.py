"""What every backend of the catalogue promises beyond the public checks (tests/testing/test_checks.py)."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import dem_bridge as db
from dem_bridge.backends.base import (
    BACKENDS,
    Resolution,
    Sampling,
    backend,
    supports_of,
    unsupported_reason,
)
from dem_bridge.errors import UnsupportedScene, UsageError
from dem_bridge.scene.scene import Scene, Wall
from dem_bridge.trajectory.trajectory import Trajectory
from tests.conftest import Solve

EPS = float(np.finfo(float).eps)

#: what every backend can do, the binary collision approximation too: one pulse into a chain at rest
PULSE = Scene(
    name="pulse",
    duration=1.2e-4,
    mass=(8e-3, 1e-2, 2e-2, 5e-3),
    stiffness=(4e9, 5e9, 6e9),
    velocity=(0.8, 0.0, 0.0, 0.0),
    samples=24,
)
#: four times the pulse, with all that the equations of motion know: gaps, initial overlap, walls, weight
EVERYTHING = replace(
    PULSE,
    name="everything",
    duration=3e-4,
    gap=(1e-6, 0.0, -5e-7),
    velocity=(0.8, 0.0, 0.1, -0.3),
    wall_left=Wall(stiffness=3e9, gap=2e-6),
    wall_right=Wall(stiffness=2e9, gap=1e-5),
    gravity=9.81,
)
#: bodies at rest that touch
AT_REST = replace(PULSE, name="at_rest", velocity=(0.0, 0.0, 0.0, 0.0))
#: no contact at all
ALONE = Scene(name="alone", duration=1e-3, mass=(1e-2,), stiffness=(), velocity=(0.5,), gravity=9.81, samples=10)


def _with_engine(name: str) -> Any:
    return pytest.param(name, marks=pytest.mark.lammps) if name.startswith("lammps") else name


every_backend = pytest.mark.parametrize("name", [_with_engine(name) for name in BACKENDS])
#: backends that solve the equations of motion themselves
hertz = pytest.mark.parametrize("name", [_with_engine(n) for n in BACKENDS if backend(n).equations == "hertz"])


@pytest.mark.parametrize("name", BACKENDS)
def test_a_backend_says_who_it_is(name: str) -> None:
    found = backend(name)
    assert found.name == name
    assert found.equations in ("hertz", "binary collisions", "adiabatic solitary wave")
    assert found.order is None or found.order >= 1


@pytest.mark.parametrize("name", [name for name in BACKENDS if backend(name).equations != "hertz"])
@pytest.mark.parametrize("scene", [EVERYTHING, AT_REST, ALONE], ids=lambda scene: scene.name)
def test_an_unsupported_scene_is_refused_in_one_line(name: str, scene: Scene) -> None:
    reason = unsupported_reason(backend(name), scene)
    assert reason
    assert "\n" not in reason
    with pytest.raises(UnsupportedScene) as caught:
        db.solve(scene, backend=name)
    assert scene.name in str(caught.value)
    assert reason in str(caught.value)


def test_the_pulse_is_for_everyone_and_nobody_but_the_approximation_refuses_the_rest() -> None:
    assert [name for name in BACKENDS if not supports_of(name).covers(PULSE)] == []
    for scene in (EVERYTHING, AT_REST, ALONE):
        refused = {name for name in BACKENDS if not supports_of(name).covers(scene)}
        assert refused == {name for name in BACKENDS if backend(name).equations != "hertz"}


@every_backend
def test_the_pulse_goes_down_the_chain_in_the_order_of_the_contacts(name: str, solved: Solve) -> None:
    run = solved(PULSE, name, dt=1e-7)
    assert np.all(run.crossing_time > 0.0)
    assert np.all(np.diff(run.crossing_time) > 0.0)
    assert np.all(run.peak_force > 0.0)


@every_backend
def test_momentum_is_that_of_the_start(name: str, solved: Solve) -> None:
    momentum = solved(PULSE, name, dt=1e-7).velocity @ np.array(PULSE.mass)
    # each of the 1200 steps rounds momenta of at most this size; scipy's local tolerance is below that
    assert momentum == pytest.approx(8e-3 * 0.8, rel=1200 * EPS)


@every_backend
def test_bars_are_there_for_every_quantity_and_none_is_negative(name: str, solved: Solve) -> None:
    bars = solved(PULSE, name, dt=1e-7).uncertainty
    assert set(bars) == {"velocity", "displacement", "peak_force", "crossing_time"}
    assert all(np.all(np.asarray(bar) >= 0.0) for bar in bars.values())
    assert bars["peak_force"].shape == bars["crossing_time"].shape == (3,)


@every_backend
def test_without_bars_nothing_is_claimed_and_nothing_else_changes(name: str, solved: Solve) -> None:
    bare, full = solved(PULSE, name, dt=1e-7, uncertainty=False), solved(PULSE, name, dt=1e-7)
    assert all(np.all(np.isinf(bar)) for bar in bare.uncertainty.values())
    for quantity in ("velocity", "displacement", "peak_force", "crossing_time"):
        np.testing.assert_array_equal(getattr(bare, quantity), getattr(full, quantity))


@every_backend
def test_the_birth_certificate_says_what_was_run(name: str, solved: Solve) -> None:
    born = solved(PULSE, name, dt=1e-7).provenance
    assert (born["backend"], born["equations"]) == (name, backend(name).equations)
    assert (born["scene"], born["scene_hash"]) == ("pulse", PULSE.content_hash)
    assert born["settings"]["samples"] == 24
    assert set(born["versions"]) >= {"dem-bridge", "numpy", "scipy", "numba", "python"}


@every_backend
def test_what_a_run_cost_is_kept(name: str, solved: Solve) -> None:
    run = solved(PULSE, name, dt=1e-7, uncertainty=False)
    assert run.cost.wall > 0.0
    assert run.cost.cpu >= 0.0
    if backend(name).order is not None:
        assert run.cost.steps == math.ceil(PULSE.duration / 1e-7)
        assert run.cost.force_evaluations >= run.cost.steps
        assert run.provenance["settings"]["dt"] == pytest.approx(1e-7, rel=4.0 * EPS)


@every_backend
def test_asked_for_samples_replace_the_scenes(name: str, solved: Solve) -> None:
    few, many = (
        solved(PULSE, name, dt=1e-7, samples=6, uncertainty=False),
        solved(PULSE, name, dt=1e-7, uncertainty=False),
    )
    assert len(few.time) == 7
    np.testing.assert_array_equal(few.time, many.time[::4])
    # the same steps, or steps of an adaptive integrator that does not see the samples
    np.testing.assert_array_equal(few.velocity, many.velocity[::4])


@every_backend
def test_a_run_needs_no_default_to_be_named(name: str) -> None:
    found = backend(name)
    run = found.run(PULSE, Resolution(), Sampling(count=3))
    assert run.velocity.shape == (4, 4)


@hertz
def test_walls_stand_behind_the_contacts_of_the_chain_left_before_right(name: str, solved: Solve) -> None:
    run = solved(EVERYTHING, name, dt=1e-7)
    assert run.contact_force.shape == (25, 5)
    c = EVERYTHING.contacts
    x = np.column_stack([run.displacement, np.zeros(25)])
    overlap = np.maximum(x[:, c.left] - x[:, c.right] - c.gap, 0.0)
    # forces are those of the displacements: LAMMPS' come as sums of net forces (5 roundings), overlaps of 1e-5 m
    # from displacements of 1e-4 m lose a digit, the power 3/2 half as much again
    scale = float(np.max(run.contact_force))
    # a table errs by what it says itself, of the largest force of its contact
    table = run.provenance.get("table", {}).get("predicted_error", 0.0)
    assert table < 1e-8
    assert run.contact_force == pytest.approx(c.stiffness * overlap**1.5, abs=(1e4 * EPS + table) * scale)
    assert np.count_nonzero(run.contact_force[:, 3]) > 0, "the left wall is never hit"
    assert np.count_nonzero(run.contact_force[:, 4]) > 0, "the right wall is never hit"


@hertz
def test_forces_are_what_changes_the_momenta(name: str, solved: Solve) -> None:
    run = solved(EVERYTHING, name, dt=1e-7, samples=600, uncertainty=False)
    c, mass = EVERYTHING.contacts, np.array(EVERYTHING.mass)
    push = np.zeros((601, 5))
    for k in range(5):
        push[:, c.left[k]] -= run.contact_force[:, k]
        push[:, c.right[k]] += run.contact_force[:, k]
    impulse = np.cumsum((push[1:, :4] + push[:-1, :4]) * 0.5 * (run.time[1] - run.time[0]), axis=0)
    gained = (run.velocity[1:] - run.velocity[0]) * mass - mass * EVERYTHING.gravity * run.time[1:, None]
    # the trapezoidal rule at 600 samples, (omega h)^2 / 12 with omega h = 0.2, of the largest momentum
    assert impulse == pytest.approx(gained, abs=0.2**2 / 12.0 * 8e-3 * 0.8)


@hertz
def test_all_that_moves_agrees_with_the_others_within_the_bars(name: str, solved: Solve) -> None:
    run, reference = solved(EVERYTHING, name, dt=2e-8), solved(EVERYTHING, "scipy")
    for quantity in ("velocity", "displacement"):
        allowed = run.uncertainty[quantity] + reference.uncertainty[quantity]
        assert np.max(np.abs(getattr(run, quantity) - getattr(reference, quantity))) <= allowed
    for quantity in ("peak_force", "crossing_time"):
        error = np.abs(getattr(run, quantity) - getattr(reference, quantity))
        assert np.all(error <= run.uncertainty[quantity] + reference.uncertainty[quantity])


@hertz
def test_what_rests_stays_at_rest(name: str, solved: Solve) -> None:
    run = solved(AT_REST, name, dt=1e-7)
    assert not np.any(run.velocity)
    assert not np.any(run.displacement)
    assert not np.any(run.peak_force)
    assert np.all(np.isnan(run.crossing_time))
    assert run.uncertainty["velocity"] == 0.0


@hertz
def test_a_single_body_falls_freely(name: str, solved: Solve) -> None:
    run = solved(ALONE, name, dt=1e-6)
    assert (run.contact_force.shape, run.peak_force.shape) == ((11, 0), (0,))
    # constant acceleration is exact for all these integrators; 1000 steps each round by an ulp
    assert run.velocity[:, 0] == pytest.approx(0.5 + 9.81 * run.time, rel=1000 * EPS)
    assert run.displacement[:, 0] == pytest.approx(0.5 * run.time + 0.5 * 9.81 * run.time**2, rel=1000 * EPS)


@hertz
def test_the_bar_of_free_fall_holds(name: str, solved: Solve) -> None:
    run = solved(ALONE, name, dt=1e-6)
    error = float(np.max(np.abs(run.velocity[:, 0] - (0.5 + 9.81 * run.time))))
    # the closed form here is rounded too
    assert error <= run.uncertainty["velocity"] + 2.0 * math.ulp(float(run.velocity[-1, 0]))


@hertz
def test_two_contacts_that_close_at_once_are_no_obstacle(name: str, solved: Solve) -> None:
    mirror = Scene(
        name="mirror",
        duration=2e-4,
        mass=(1e-2, 2e-2, 2e-2, 1e-2),
        stiffness=(1e9, 2e9, 1e9),
        velocity=(0.5, 0.0, 0.0, -0.5),
        gap=(1e-5, 1e-5, 1e-5),
        samples=20,
    )
    run = solved(mirror, name, dt=1e-7)
    # the halves move alike up to the round-off of 2000 steps (LAMMPS keeps absolute positions: ulp(2e-4)/1e-5 a step)
    assert run.velocity == pytest.approx(-run.velocity[:, ::-1], abs=0.5 * 2000 * 20 * EPS)
    assert run.crossing_time[0] == pytest.approx(run.crossing_time[2], rel=1e-9)


def test_an_unknown_backend_is_refused_with_the_names_that_exist() -> None:
    with pytest.raises(UsageError, match=f"backend = 'lamps'; allowed: {', '.join(BACKENDS)}"):
        backend("lamps")


@pytest.mark.parametrize("key", ["dt", "rtol", "atol", "surrogate_radius", "time_limit"])
@pytest.mark.parametrize("value", [0.0, -1e-8, math.inf, math.nan, "1e-8"])
def test_a_resolution_refuses_what_is_no_positive_number(key: str, value: Any) -> None:
    with pytest.raises(UsageError, match=rf"{key} = .*; allowed: a number from"):
        Resolution(**{key: value})


def test_a_resolution_refuses_a_bool() -> None:
    with pytest.raises(UsageError, match="dt = True; allowed: a number from"):
        Resolution(dt=True)


@pytest.mark.parametrize("count", [0, -5, 2.0, True, "500"])
def test_a_sampling_refuses_what_is_no_count(count: Any) -> None:
    with pytest.raises(UsageError, match=r"samples = .*; allowed: a whole number from 1"):
        Sampling(count=count)


def test_a_trajectory_of_any_backend_is_one_type(solved: Solve) -> None:
    assert {type(solved(PULSE, name, dt=1e-7)) for name in ("verlet", "scipy", "bca")} == {Trajectory}


@pytest.mark.parametrize(
    ("given", "part"),
    [((1e-6, 2e-6), "increase from 0"), ((0.0, 2e-6, 2e-6), "increase from 0"), ((0.0, math.inf), "finite times"),
     ((0.0,), "samples = 0")],
)  # fmt: skip
def test_times_that_no_run_can_have_are_refused(given: tuple[float, ...], part: str) -> None:
    with pytest.raises(UsageError, match=part):
        Sampling(given=given)


@pytest.mark.parametrize("name", ["verlet", "blanes-moan", "ase"])
def test_a_fixed_step_refuses_given_times_which_it_would_miss(name: str) -> None:
    times = Sampling(given=(0.0, 0.3 * PULSE.duration, PULSE.duration))
    with pytest.raises(UsageError, match="a count of equal steps"):
        backend(name).run(PULSE, Resolution(dt=1e-7), times)


def test_given_times_end_with_the_scene() -> None:
    assert Sampling(given=(0.0, 1e-5, 3e-5)).times(3e-5).tolist() == [0.0, 1e-5, 3e-5]
    with pytest.raises(UsageError, match="the duration of the scene"):
        Sampling(given=(0.0, 1e-5)).times(3e-5)
