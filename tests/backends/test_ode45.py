"""ode45: the step sequence of a second writing, the errors of the paper's method, and bars that were measured."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import RK45

import dem_bridge as db
from dem_bridge.backends import dormand_prince, ode45
from dem_bridge.backends.dormand_prince import ERROR, EXTENSION, STAGES
from dem_bridge.errors import RunBroken
from dem_bridge.observables.convergence import observed_order
from dem_bridge.observables.front import residence_time
from dem_bridge.scene.scene import Scene, Wall
from dem_bridge.trajectory.trajectory import Trajectory
from tests.conftest import Solve
from tests.helpers import matlab_ode45
from tests.helpers.quadruple_truth import Truth

EPS = float(np.finfo(float).eps)
Floats = NDArray[np.float64]

#: linear springs (n = 2) that stay pressed between walls: a smooth ODE
SMOOTH = Scene(
    name="smooth",
    duration=2e-3,
    mass=(1e-2, 2e-2, 1.5e-2),
    stiffness=(2e6, 1e6),
    exponent=2.0,
    gap=(-1e-3, -1e-3),
    velocity=(0.8, -0.3, 0.0),
    wall_left=Wall(stiffness=1e6, gap=-2e-3),
    wall_right=Wall(stiffness=1e6, gap=-1e-3),
    samples=40,
)
#: contacts close, turn and open; a gap, a wall, weight
SHORT = Scene(
    name="short",
    duration=2e-4,
    mass=(8e-3, 1e-2, 2e-2, 5e-3),
    stiffness=(4e9, 5e9, 6e9),
    gap=(0.0, 1e-6, -5e-7),
    velocity=(0.8, 0.0, 0.0, -0.1),
    wall_right=Wall(stiffness=2e9, gap=1e-5),
    gravity=9.81,
    samples=40,
)
#: a long flight, then a stiff contact: long steps that fail by far, and fail again
FLIGHT = replace(SHORT, name="flight", duration=5e-3, gap=(1e-3, 0.0, 0.0), wall_right=None, gravity=0.0)


def _second_writing(scene: Scene, reltol: float, abstol: float) -> matlab_ode45.Solution:
    n, mass = scene.n_body, np.array(scene.mass)
    walls = (scene.wall_left, scene.wall_right)

    def odefun(_: float, y: Floats) -> Floats:
        x, net = y[:n], mass * scene.gravity
        for k, (beta, gap, power) in enumerate(
            zip(scene.stiffness, scene.contacts.gap, scene.contacts.exponent, strict=False)
        ):
            push = beta * max(x[k] - x[k + 1] - gap, 0.0) ** (power - 1.0)
            net[k] -= push
            net[k + 1] += push
        for wall, overlap, body, sign in zip(walls, (-x[0], x[-1]), (0, -1), (1.0, -1.0), strict=True):
            if wall is not None and wall.exponent is not None:
                net[body] += sign * wall.stiffness * max(overlap - wall.gap, 0.0) ** (wall.exponent - 1.0)
        return np.concatenate([y[n:], net / mass])

    start = np.concatenate([np.zeros(n), scene.velocity])
    times = np.linspace(0.0, scene.duration, scene.samples + 1)
    return matlab_ode45.ode45(odefun, times, start, reltol=reltol, abstol=abstol)


@pytest.mark.parametrize(("rtol", "atol"), [(1e-3, 1e-6), (1e-3, 1e-9), (1e-5, 1e-8)])
@pytest.mark.parametrize("scene", [SMOOTH, SHORT], ids=lambda scene: scene.name)
def test_steps_and_values_are_those_of_a_second_writing(scene: Scene, rtol: float, atol: float) -> None:
    run = db.solve(scene, backend="ode45", rtol=rtol, atol=atol, uncertainty=False)
    other = _second_writing(scene, rtol, atol)
    assert (run.cost.steps, run.provenance["failed_steps"]) == (other.accepted, other.failed)
    assert run.cost.force_evaluations == other.evaluations == 6 * (other.accepted + other.failed) + 1
    # step sizes follow error estimates, differences of stages that lose up to 5 of 16 digits, and across a kink the
    # estimate follows the step: at 1e-7 the short scene's displacements agree to 3e-11 only
    speed, way = np.max(np.abs(run.velocity)), np.max(np.abs(run.displacement))
    assert np.max(np.abs(run.displacement - other.y[:, : scene.n_body])) < 1e-12 * way
    assert np.max(np.abs(run.velocity - other.y[:, scene.n_body :])) < 1e-12 * speed


def test_steps_that_fail_by_far_and_fail_again_are_those_of_a_second_writing() -> None:
    run = db.solve(FLIGHT, backend="ode45", uncertainty=False)
    other = _second_writing(FLIGHT, 1e-3, 1e-6)
    assert min(other.cut, other.halved) >= 3
    assert (run.cost.steps, run.provenance["failed_steps"]) == (other.accepted, other.failed)
    # where a step ends in a contact that closed within it decides its error: each such step multiplies what differs,
    # from 4e-16 to 8e-11 m/s here
    assert run.velocity == pytest.approx(other.y[:, FLIGHT.n_body :], abs=1e-8 * 0.8)


def test_the_scenes_compared_show_all_that_the_control_does() -> None:
    assert np.all(db.solve(SMOOTH, backend="reference", uncertainty=False).contact_force > 0.0)
    assert db.solve(SHORT, backend="ode45", rtol=1e-5, atol=1e-8, uncertainty=False).provenance["failed_steps"] > 2


def test_the_tableau_is_scipys() -> None:
    np.testing.assert_array_equal(STAGES[:5, :5], RK45.A[1:])
    np.testing.assert_array_equal(STAGES[5], RK45.B)
    np.testing.assert_array_equal(ERROR, -RK45.E)


@pytest.mark.parametrize("s", [0.0, 0.1, 0.5, 0.9, 1.0])
def test_the_continuous_extension_is_of_fourth_order(s: float) -> None:
    weight = EXTENSION @ np.array([s, s**2, s**3, s**4])
    a = np.zeros((7, 7))
    a[1:, :6] = STAGES
    c = a.sum(axis=1)
    # all order conditions up to 4 (Hairer, Nørsett & Wanner, II.6)
    for sum_, order, density in (
        (weight.sum(), 1, 1),
        (weight @ c, 2, 2),
        (weight @ c**2, 3, 3),
        (weight @ a @ c, 3, 6),
        (weight @ c**3, 4, 4),
        (weight @ (c * (a @ c)), 4, 8),
        (weight @ a @ c**2, 4, 12),
        (weight @ a @ a @ c, 4, 24),
    ):
        assert sum_ == pytest.approx(s**order / density, abs=50 * EPS)
    if s == 1.0:
        assert weight == pytest.approx([*RK45.B, 0.0], abs=50 * EPS)


def test_the_error_of_the_papers_method_is_that_of_the_paper(decelerating: Truth, accelerating: Truth) -> None:
    runs = {
        t.scene.name: (t, db.solve(t.scene, backend="ode45", uncertainty=False)) for t in (decelerating, accelerating)
    }
    errors = [float(t.error(run, "velocity")) / t.v0 for t, run in runs.values()]
    # 3.6e-3 and 1.6e-3 of v0
    assert errors == pytest.approx([3.6e-3, 1.6e-3], rel=0.1)
    for truth, run in runs.values():
        residence = residence_time(truth.scene, run)[1:-1]
        relative = np.abs(residence / np.diff(truth.data["t_cross"]) - 1.0)
        # 2.3e-3 for the first cylinder behind the soft striker's contact, 2.9e-4 and less for all others
        assert np.max(relative) < 3e-3
        assert np.sort(relative)[-2] < 5e-4


def test_tightened_tolerances_converge_to_the_truth(free_chain: Truth) -> None:
    tolerances = [1e-4, 1e-6, 1e-8, 1e-10]
    runs = [db.solve(free_chain.scene, backend="ode45", rtol=r, atol=1e-3 * r, uncertainty=False) for r in tolerances]
    for quantity in ("displacement", "velocity", "peak_force", "crossing_time"):
        fit = observed_order(tolerances, [float(np.max(free_chain.error(run, quantity))) for run in runs])
        # the error goes as the tolerance, up to what steps across openings and closings cost: 0.7 to 1.0 were found
        assert 0.65 < fit.order < 1.15, quantity
    assert float(free_chain.error(runs[-1], "velocity")) < 1e-7 * free_chain.v0
    # a method of order 5 takes tolerance^(-1/5) steps; with failures at kinks up to ^(-1/4)
    effort = observed_order(tolerances, [float(run.cost.force_evaluations) for run in runs])
    assert -0.27 < effort.order < -0.18


def test_peaks_and_crossings_have_the_accuracy_of_the_run_and_not_of_its_samples(accelerating: Truth) -> None:
    run = db.solve(accelerating.scene, backend="ode45", rtol=1e-9, atol=1e-12, samples=3, uncertainty=False)
    for quantity, truth in (("peak_force", "F_peak"), ("crossing_time", "t_cross")):
        assert np.all(accelerating.error(run, quantity) < 1e-7 * accelerating.data[truth]), quantity


def test_the_stages_motion_ahead_of_a_front_is_no_collision(decelerating: Truth) -> None:
    truth = decelerating.data["t_cross"]
    run = db.solve(decelerating.scene, backend="ode45", uncertainty=False)
    assert np.max(np.abs(run.crossing_time - truth) / truth) < 1e-3


def test_falls_of_a_quartic_are_all_found() -> None:
    roots = [0.2, 0.45, 0.6, 0.9]
    c = np.asarray(np.polynomial.polynomial.polyfromroots(roots), dtype=np.float64)
    at_one = float(np.sum(c))
    falls, count = dormand_prince.find_falls(c, at_one)  # + to 0.2, - to 0.45, + to 0.6, - to 0.9, +
    assert falls[:count] == pytest.approx([0.2, 0.6], abs=1e-14)
    falls, count = dormand_prince.find_falls(-c, -at_one)
    assert falls[:count] == pytest.approx([0.45, 0.9], abs=1e-13)
    line = np.array([1.0, -1.0, 0.0, 0.0, 0.0])
    # the value at the end is the next step's first: 0 there is a fall here, 1e-30 is none
    assert dormand_prince.find_falls(line, 0.0)[1] == 1
    assert dormand_prince.find_falls(line, 1e-30)[1] == 0


def _random_scene(seed: int) -> Scene:
    """2 to 30 bodies, up to four decades of mass and stiffness, 1e-9 to 1e3 m/s, gaps, walls, weight."""
    draw = np.random.default_rng(seed)
    n, decades = int(draw.integers(2, 31 if draw.random() < 0.2 else 13)), draw.uniform(0.0, 4.0)
    exponent = 2.5 if draw.random() < 0.7 else float(draw.choice([2.0, 3.0, 3.5]))
    speed = 10.0 ** (draw.uniform(-9.0, 3.0) if draw.random() < 0.4 else draw.uniform(-1.0, 1.0))
    depth = (2.5 * 0.5e-2 * speed**2 / 1e10) ** 0.4
    hertz = 1e10 * depth ** (2.5 - exponent)

    def wall() -> Wall | None:
        stiffness = float(hertz * 10.0 ** draw.uniform(-1.0, 1.0))
        return Wall(stiffness=stiffness, gap=depth, exponent=exponent) if draw.random() < 0.25 else None

    def spread(count: int) -> Floats:
        return np.asarray(10.0 ** draw.uniform(-decades / 2.0, decades / 2.0, count))

    several = draw.random() < 0.4
    velocity = speed * draw.uniform(-1.0, 1.0, n) if several else speed * np.eye(n)[0]
    return Scene(
        name=f"random-{seed}",
        duration=float(3.0 * depth / speed * draw.uniform(1.5, 3.0) * n**0.8),
        mass=tuple(1e-2 * spread(n)),
        stiffness=tuple(hertz * spread(n - 1)),
        exponent=exponent,
        gap=tuple(depth * draw.choice([0.0, 0.0, 0.3, 2.0, -0.1], n - 1)),
        velocity=tuple(velocity),
        wall_left=wall(),
        wall_right=wall(),
        gravity=float(draw.choice([0.0, 0.0, -0.003 * speed**2 / depth])),
        samples=50,
    )


def _outside(run: Trajectory, reference: Trajectory, quantity: str) -> bool:
    """Whether the error is beyond the bar, and the reference sure of it."""
    one, other = getattr(run, quantity), getattr(reference, quantity)
    error = np.where(np.isnan(one) & np.isnan(other), 0.0, np.abs(one - other))
    error = np.where(np.isnan(error), math.inf, error)
    if quantity in ("velocity", "displacement"):
        error = np.max(error)
    return bool(np.any(error > run.uncertainty[quantity] + reference.uncertainty[quantity]))


@pytest.mark.slow
@pytest.mark.parametrize(("rtol", "atol"), [(1e-3, 1e-6), (1e-7, 1e-10)])
def test_bars_hold_on_random_scenes(rtol: float, atol: float, solved: Solve) -> None:
    found: dict[str, list[str]] = {}
    for seed in range(30):
        scene = _random_scene(seed)
        run, reference = db.solve(scene, backend="ode45", rtol=rtol, atol=atol), solved(scene, "reference")
        for quantity in run.uncertainty:
            if _outside(run, reference, quantity):
                found.setdefault(quantity, []).append(scene.name)
    # of 200 such scenes 99 % are inside in each quantity
    assert found == {}


def test_tolerances_that_see_nothing_of_a_slow_scene_have_bars_that_say_so(solved: Solve) -> None:
    slow = replace(SHORT, velocity=(1e-8, 0.0, 0.0, 0.0), gap=0.0, gravity=0.0, wall_right=None, duration=8e-3)
    run, reference = db.solve(slow, backend="ode45"), solved(slow, "reference")
    error = float(np.max(np.abs(run.velocity - reference.velocity)))
    assert error > 0.02 * 1e-8, "1e-6 m resolves overlaps of 1e-11 m?"
    assert error <= run.uncertainty["velocity"]
    missing = np.isnan(run.crossing_time) & ~np.isnan(reference.crossing_time)
    assert np.all(np.isinf(run.uncertainty["crossing_time"][missing]))


def _worst(run: Trajectory, reference: Trajectory, quantity: str) -> float:
    """Error over both bars."""
    error = np.max(np.abs(getattr(run, quantity) - getattr(reference, quantity)))
    return float(error / np.max(run.uncertainty[quantity] + reference.uncertainty[quantity]))


@pytest.mark.parametrize("share", [1e-6, 1e-3])
def test_a_graze_that_no_stage_falls_into_is_in_the_bar(share: float, solved: Solve) -> None:
    # a ball thrown up at a ceiling next to where it turns: two flights that no tolerance cuts short
    up, g = 0.75, -9.81
    ball = Scene(
        name=f"ball-{share:g}", duration=1.5 * up / -g, mass=(1e-2,), stiffness=(), velocity=(up,), gravity=g,
        wall_right=Wall(stiffness=4.7e9, gap=(1.0 - share) * up**2 / (-2.0 * g)), samples=20,
    )  # fmt: skip
    run, reference = db.solve(ball, backend="ode45"), solved(ball, "reference")
    assert run.cost.steps < 40
    for quantity in ("velocity", "displacement"):
        assert _worst(run, reference, quantity) <= 1.0, quantity


def test_two_runs_whose_steps_no_tolerance_decides_do_not_err_alike(solved: Solve) -> None:
    # a tenth of a contact time
    brief = Scene(
        name="brief", duration=5.5e-6, mass=(1e-2,) * 4, stiffness=(4.7e9,) * 3, velocity=(0.75, 0.0, 0.0, 0.0),
        samples=20,
    )  # fmt: skip
    run, reference = db.solve(brief, backend="ode45"), solved(brief, "reference")
    assert run.cost.steps <= 11
    for quantity in ("velocity", "displacement"):
        assert _worst(run, reference, quantity) <= 1.0, quantity


@pytest.mark.parametrize("force", [1e-6, 50.0])
def test_in_a_pressed_chain_the_stages_motion_ahead_of_a_front_is_no_collision(force: float, solved: Solve) -> None:
    pressed = Scene(
        name=f"pressed-{force:g}", duration=2.5e-4, mass=(1e-2,) * 10, stiffness=(4.7e9,) * 9,
        velocity=(0.75, *[0.0] * 9), precompression=force, samples=20,
    )  # fmt: skip
    run, reference = db.solve(pressed, backend="ode45"), solved(pressed, "reference")
    assert not _outside(run, reference, "crossing_time")
    known = np.isfinite(run.crossing_time) & np.isfinite(reference.crossing_time)
    assert np.count_nonzero(known) >= 8
    assert run.crossing_time[known] == pytest.approx(reference.crossing_time[known], rel=1e-2)


def test_the_bars_are_no_excuse(free_chain: Truth) -> None:
    run = db.solve(free_chain.scene, backend="ode45")
    for quantity in ("velocity", "displacement"):
        # the difference to a hundredth of the tolerances is the error up to a tenth, and it is taken twice
        assert run.uncertainty[quantity] < 2.5 * free_chain.error(run, quantity)


def test_where_only_one_run_sees_a_crossing_nothing_is_said_of_it(monkeypatch: pytest.MonkeyPatch) -> None:
    honest = ode45.Ode45.solve_once
    runs: list[Trajectory] = []

    def blind(self: Any, *rest: Any) -> Trajectory:
        run = honest(self, *rest)
        runs.append(run)
        return replace(run, crossing_time=np.array([math.nan, *run.crossing_time[1:]])) if len(runs) == 2 else run

    monkeypatch.setattr(ode45.Ode45, "solve_once", blind)
    bars = db.solve(SHORT, backend="ode45").uncertainty["crossing_time"]
    assert math.isinf(bars[0])
    assert np.isfinite(bars[1])


def test_the_tolerances_are_in_the_provenance_and_matlabs_by_default() -> None:
    assert db.solve(SHORT, backend="ode45", uncertainty=False).provenance["settings"] == {
        "rtol": 1e-3,
        "atol": 1e-6,
        "samples": 40,
    }
    run = db.solve(SHORT, backend="ode45", rtol=1e-8, uncertainty=False)
    assert (run.provenance["settings"]["rtol"], run.provenance["settings"]["atol"]) == (1e-8, 1e-6)


def test_a_tolerance_that_no_step_meets_is_a_broken_run() -> None:
    # n near 1: the force of 1e29 N is all but there at touch
    cliff = Scene(
        name="cliff",
        duration=1e-3,
        mass=(1e-2, 1e-2),
        stiffness=(1e30,),
        exponent=1.0001,
        gap=1e-4,
        velocity=(1.0, 0.0),
    )
    with pytest.raises(RunBroken, match=r"ode45 on cliff: at t = 0\.0001 s no step meets rtol = 0\.001; give a larger"):
        db.solve(cliff, backend="ode45")


def test_a_run_without_end_is_a_broken_run(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ode45, "MOST_STEPS", 10)
    with pytest.raises(
        RunBroken, match=r"ode45 on short: 9 steps reached t = .* of 0.0002 s; give a larger rtol or atol"
    ):
        db.solve(SHORT, backend="ode45", rtol=1e-9)
