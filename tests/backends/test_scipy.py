"""The scipy reference: against quadruple-precision truth and exact collisions, and its bars."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

import dem_bridge as db
from dem_bridge.backends import scipy_dop853, scipy_integration
from dem_bridge.backends.scipy_step import CompiledDop853
from dem_bridge.errors import RunBroken, UsageError
from dem_bridge.observables.conserved import energy, momentum
from dem_bridge.physics.exact import two_body_collision
from dem_bridge.scene.file import load_scene
from dem_bridge.scene.scene import Damping, Scene, Wall
from tests.conftest import Solve
from tests.helpers.quadruple_truth import Truth
from tests.helpers.strategies import ANY, examples, log_uniform, scenes, stiffness_for

EPS = float(np.finfo(float).eps)
#: 877 events: 7 s of CPU
WALLED = pytest.param("walled", marks=pytest.mark.slow)


def test_velocities_are_those_of_the_truth(free_chain: Truth, solved: Solve) -> None:
    # restarted at every event DOP853 reaches 1e-12; straight through the contacts it has 1e-8 (PHYSICS.md)
    assert free_chain.error(solved(free_chain.scene, "scipy"), "velocity") < 1e-10 * free_chain.v0


@pytest.mark.slow
def test_velocities_are_those_of_the_truth_on_the_ill_conditioned_wall(walled: Truth, solved: Solve) -> None:
    # relative condition 1e4: 3e-14, the local tolerance, in 12,000 steps
    assert walled.error(solved(walled.scene, "scipy"), "velocity") < 3e-9 * walled.v0


def test_peaks_and_crossings_are_those_of_the_truth(free_chain: Truth, solved: Solve) -> None:
    run = solved(free_chain.scene, "scipy")
    for quantity, truth in (("peak_force", "F_peak"), ("crossing_time", "t_cross")):
        assert np.all(free_chain.error(run, quantity) < 1e-10 * free_chain.data[truth])


def test_displacements_are_those_of_the_truth(free_chain: Truth, solved: Solve) -> None:
    largest = float(np.max(np.abs(free_chain.data["x"])))
    assert free_chain.error(solved(free_chain.scene, "scipy"), "displacement") < 1e-11 * largest


@pytest.mark.parametrize(
    ("chain", "events"),
    [
        ("decelerating", 527),
        ("accelerating", 42),
        pytest.param("walled", 877, marks=pytest.mark.slow),
        ("two_bodies", 1),
    ],
)
def test_it_restarts_once_for_every_event_of_the_truth(
    chain: str, events: int, solved: Solve, request: pytest.FixtureRequest
) -> None:
    truth: Truth = request.getfixturevalue(chain)
    assert solved(truth.scene, "scipy").provenance["restarts"] == len(truth.data["events"]) == events


@pytest.mark.parametrize("chain", ["decelerating", "accelerating", WALLED, "two_bodies"])
def test_the_bars_of_the_samples_hold(chain: str, solved: Solve, request: pytest.FixtureRequest) -> None:
    truth: Truth = request.getfixturevalue(chain)
    run = solved(truth.scene, "scipy")
    for quantity in ("velocity", "displacement"):
        assert truth.error(run, quantity) <= run.uncertainty[quantity]


@pytest.mark.parametrize("chain", ["decelerating", "accelerating", WALLED, "two_bodies"])
def test_the_bars_of_peaks_and_crossings_hold(chain: str, solved: Solve, request: pytest.FixtureRequest) -> None:
    truth: Truth = request.getfixturevalue(chain)
    run = solved(truth.scene, "scipy")
    for quantity in ("peak_force", "crossing_time"):
        # the truth is rounded to doubles: half an ulp of each value
        rounding = 0.5 * EPS * getattr(run, quantity)
        assert np.all(truth.error(run, quantity) <= run.uncertainty[quantity] + rounding), quantity


@pytest.mark.parametrize("chain", ["decelerating", "accelerating", WALLED])
def test_the_velocity_bar_is_no_excuse(chain: str, solved: Solve, request: pytest.FixtureRequest) -> None:
    truth: Truth = request.getfixturevalue(chain)
    run = solved(truth.scene, "scipy")
    # a run at twenty times the tolerance errs about twenty times as much, where round-off rules a few times more, and
    # the difference is taken three times: 20 x 3 x 3. Measured: 102 on the decelerating chain
    assert run.uncertainty["velocity"] <= 180.0 * truth.error(run, "velocity")


@examples(12)
@given(
    masses=st.tuples(log_uniform(1e-4, 1e-1), log_uniform(1e-4, 1e-1)),
    speed=log_uniform(1e-2, 1e1),
    drift=st.floats(-1.0, 1.0).map(lambda x: round(x, 9)),
    exponent=st.floats(1.5, 4.0),
    hertz=log_uniform(1e7, 1e11),
    gap=st.sampled_from([0.0, 1e-6, 1e-4]),
)
def test_a_collision_is_the_exact_one_for_any_masses_exponents_and_speeds(
    masses: tuple[float, float], speed: float, drift: float, exponent: float, hertz: float, gap: float
) -> None:
    velocities = (speed + drift, drift)
    stiffness = stiffness_for(exponent, hertz)
    hit = two_body_collision(masses=masses, velocities=velocities, stiffness=stiffness, exponent=exponent)
    touch = gap / (velocities[0] - velocities[1])
    scene = Scene(
        name="collision",
        duration=touch + 1.2 * hit.contact_time,
        mass=masses,
        stiffness=(stiffness,),
        exponent=exponent,
        gap=gap,
        velocity=velocities,
        samples=5,
    )
    run = db.solve(scene, backend="scipy", uncertainty=False)
    # a hundred steps at a local tolerance of 3e-14; the exponent multiplies relative errors of the overlap
    allowed = 1e-11 * max(abs(velocities[0]), abs(velocities[1]), speed)
    assert run.velocity[-1] == pytest.approx(hit.exit_velocity, abs=allowed)
    assert run.peak_force[0] == pytest.approx(hit.peak_force, rel=1e-11 * (1.0 + abs(drift) / speed))
    assert run.crossing_time[0] == pytest.approx(touch + hit.half_time, rel=1e-11 * (1.0 + abs(drift) / speed))
    assert run.provenance["restarts"] == (2 if gap > 0.0 else 1)


@examples(12)
@given(scene=scenes(bodies=(1, 5), exponents=ANY, walls=True, gravity=True, samples=10))
def test_energy_and_without_outer_forces_momentum_are_conserved_on_random_scenes(scene: Scene) -> None:
    run = db.solve(scene, backend="scipy", uncertainty=False)
    found, mass = energy(scene, run), np.array(scene.mass)
    # kinetic and stored energy, and the work of weight, are what round-off and tolerance scale with
    scale = float(np.max(np.abs(found))) + 0.5 * float(np.max(run.velocity**2 @ mass))
    scale += abs(scene.gravity) * float(np.max(np.abs(run.displacement) @ mass))
    # a thousand steps at 3e-14, and 10 for displacements of 1e-4 m against overlaps of 1e-5 m
    assert found == pytest.approx(np.full(11, found[0]), abs=1e-9 * scale)
    if scene.wall_left is scene.wall_right is None and scene.gravity == 0.0:
        # linear invariants are kept by every Runge-Kutta method: round-off of 1e4 steps alone
        size = float(np.max(np.abs(run.velocity)) * np.sum(mass))
        start = float(np.dot(mass, scene.velocity))
        assert momentum(scene, run) == pytest.approx(np.full(11, start), abs=1e4 * EPS * size)


@examples(5)
@given(scene=scenes(bodies=(2, 4), samples=10))
def test_a_motion_without_scale_is_repeated_at_another_speed(scene: Scene) -> None:
    # the same powers of two as in the twin's test, here up to the tolerance
    assume(max(abs(v) for v in scene.velocity) > 1e-2)
    fast = replace(
        scene,
        velocity=tuple(32.0 * v for v in scene.velocity),
        gap=tuple(16.0 * gap for gap in scene.contacts.gap.tolist()),
        duration=0.5 * scene.duration,
    )
    one, other = (db.solve(s, backend="scipy") for s in (scene, fast))
    allowed = one.uncertainty["velocity"] + other.uncertainty["velocity"] / 32.0
    assert other.velocity / 32.0 == pytest.approx(one.velocity, abs=2.0 * allowed + 1e-13)


def test_a_finer_tolerance_errs_less(two_bodies: Truth) -> None:
    errors = [
        float(two_bodies.error(db.solve(two_bodies.scene, backend="scipy", rtol=rtol, uncertainty=False), "velocity"))
        for rtol in (1e-6, 1e-9, 1e-12)
    ]
    assert errors[0] > 10.0 * errors[1] > 100.0 * errors[2]


def test_a_tolerance_too_loose_for_a_reference_is_refused(two_bodies: Truth) -> None:
    with pytest.raises(UsageError, match=r"rtol = 0.001 is too loose for scipy; allowed: up to 0.0001"):
        db.solve(two_bodies.scene, backend="scipy", rtol=1e-3)
    assert db.solve(two_bodies.scene, backend="scipy", rtol=1e-4, uncertainty=False).cost.steps > 0


def test_the_tolerance_is_in_the_provenance(two_bodies: Truth, solved: Solve) -> None:
    assert solved(two_bodies.scene, "scipy").provenance["settings"]["rtol"] == scipy_dop853.DEFAULT_RTOL
    run = db.solve(two_bodies.scene, backend="scipy", rtol=1e-8, uncertainty=False)
    assert run.provenance["settings"]["rtol"] == 1e-8


def test_samples_do_not_change_the_motion(accelerating: Truth, solved: Solve) -> None:
    few, many = solved(accelerating.scene, "scipy", samples=5, uncertainty=False), solved(accelerating.scene, "scipy")
    np.testing.assert_array_equal(few.velocity, many.velocity[::100])
    np.testing.assert_array_equal(few.crossing_time, many.crossing_time)
    np.testing.assert_array_equal(few.peak_force, many.peak_force)


def test_a_chain_pressed_between_walls_and_let_go_keeps_its_mirror_symmetry() -> None:
    scene = Scene(
        name="pressed",
        duration=2e-4,
        mass=(1e-2, 2e-2, 1e-2),
        stiffness=(2e9, 2e9),
        gap=-2e-6,
        velocity=(0.0, 0.0, 0.0),
        wall_left=Wall(stiffness=1e9, gap=1e-6),
        wall_right=Wall(stiffness=1e9, gap=1e-6),
        samples=20,
    )
    run = db.solve(scene, backend="scipy", uncertainty=False)
    speed = float(np.max(np.abs(run.velocity)))
    assert run.velocity == pytest.approx(-run.velocity[:, ::-1], abs=1e-11 * speed)
    assert run.velocity[:, 1] == pytest.approx(np.zeros(21), abs=1e-11 * speed)
    # at rest and pressed at the start, it has no maximal compression before it has flown to the walls and back
    assert run.peak_force[:2] == pytest.approx([2e9 * 2e-6**1.5] * 2, rel=4.0 * EPS)
    assert run.crossing_time[2] == pytest.approx(run.crossing_time[3], rel=1e-11)


def test_an_integrator_that_gives_up_is_a_broken_run(monkeypatch: pytest.MonkeyPatch, two_bodies: Truth) -> None:
    class GivesUp(CompiledDop853):
        def step(self) -> str:
            self.status = "failed"
            return "Required step size is less than spacing between numbers."

    monkeypatch.setattr(scipy_integration, "CompiledDop853", GivesUp)
    with pytest.raises(RunBroken, match=r"scipy on e_two_body: DOP853 stopped at t = 0 s: Required step size"):
        db.solve(two_bodies.scene, backend="scipy")


def test_a_body_bouncing_in_its_weight_returns_in_the_time_of_its_fall() -> None:
    # onto a wall stiff enough that the contact is short; exact: all bounces are alike
    scene = Scene(
        name="bounce",
        duration=2e-2,
        mass=(1e-2,),
        stiffness=(),
        velocity=(0.0,),
        wall_right=Wall(stiffness=1e12, gap=1e-4),
        gravity=9.81,
        samples=200,
    )
    run = db.solve(scene, backend="scipy", uncertainty=False)
    closed = run.provenance["restarts"] / 2
    fall = math.sqrt(2.0 * 1e-4 / 9.81)
    assert closed == pytest.approx(scene.duration / (2.0 * fall), abs=1.0)
    assert float(np.min(run.displacement)) == pytest.approx(0.0, abs=1e-10 * 1e-4 * closed)


def test_far_behind_a_gap_displacements_are_known_to_what_the_gap_leaves() -> None:
    near = Scene(
        name="near", duration=3e-4, mass=(1e-2,) * 4, stiffness=(4.7e9,) * 3, gap=(1e3, 0.0, 0.0),
        velocity=(0.0, 0.75, 0.0, 0.0), samples=10,
    )  # fmt: skip
    for gap in (1e3, 1e12):
        scene = replace(near, gap=(gap, 0.0, 0.0))
        run, truth = db.solve(scene, backend="scipy"), db.solve(scene, backend="reference")
        error = float(np.max(np.abs(run.displacement - truth.displacement)))
        assert error <= run.uncertainty["displacement"] + truth.uncertainty["displacement"]
        assert np.max(np.abs(run.velocity - truth.velocity)) < 1e-11
        # 1e12 m are known to 1e-4 m, however near a run comes by luck
        assert run.uncertainty["displacement"] >= np.spacing(gap)


def test_the_first_moment_of_a_contact_is_found_however_early_it_is() -> None:
    """The damping of the heavy body ends contacts at times that a hundred steps of a search for roots do not reach."""
    scene = Scene(
        name="early", duration=4.89006, exponent=4.23899, samples=4,
        mass=(0.58803, 410479.0, 0.464517, 0.488005, 0.451615, 0.449526),
        stiffness=(3.55254e13, 1.14683e13, 4.03391e10, 1.53409e10, 1.91026e10),
        velocity=(-1.13189e-4, 1.71343e-4, -2.23998e-4, 2.76665e-4, -2.69621e-4, 2.72552e-4),
        gap=(0.0, 3.54569e-6, 1.89225e-6, 0.0, 3.23819e-4),
        wall_left=Wall(stiffness=8.22204e12, exponent=4.23899), wall_right=Wall(stiffness=3.70931e10, exponent=4.23899),
        damping=Damping(
            law="kuwabara-kono",
            coefficient=(2.11058e-3, 0.0306204, 5.95837e-3, 0.0622484, 0.101065, 0.130227, 9.47127e-4),
        ),
    )  # fmt: skip
    run = db.solve(scene, backend="scipy", uncertainty=False)
    looser = db.solve(scene, backend="scipy", uncertainty=False, rtol=1e-12)
    largest = np.max(np.abs(run.velocity))
    assert np.max(np.abs(run.velocity - looser.velocity)) < 1e-9 * largest


def test_a_first_step_sees_a_contact_that_begins_beside_a_stiffer_one(monkeypatch: pytest.MonkeyPatch) -> None:
    masses, speeds = (0.06, 8e-3, 3e-3), (3.6e-4, 5.8e-4, -3.9e-4)
    beside = Scene(name="beside", duration=14e-3, mass=masses, stiffness=(1.2e5, 7e8), velocity=speeds, samples=4)
    truth = db.solve(beside, backend="reference", uncertainty=False)
    assert "answered_by" not in truth.provenance

    def error() -> float:
        return abs(float(db.solve(beside, backend="scipy", uncertainty=False).peak_force[0] / truth.peak_force[0]) - 1)

    # some tens of steps err by a part of the tolerance each
    assert error() < 20 * scipy_dop853.DEFAULT_RTOL
    # planted: the step that scipy itself chooses, by an estimate that the stiff contact makes too small
    monkeypatch.setattr(scipy_integration, "MISSED", 1e9)
    assert error() > 40 * scipy_dop853.DEFAULT_RTOL


def test_motions_ahead_of_a_front_limit_no_step() -> None:
    # contacts there close at 1e-16 to 1e-258 m/s; steps for them took no time, and the run ended as one that chatters
    scene = load_scene("decelerating-40-kuwabara-kono")
    assert db.solve(scene, backend="scipy", uncertainty=False).cost.steps < 3000
