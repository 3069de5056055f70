"""Damped contacts and drag: against closed forms and second writings, and what must hold whatever the numbers."""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import dem_bridge as db
from dem_bridge.backends import scipy_damped
from dem_bridge.errors import RunBroken, UnsupportedScene
from dem_bridge.observables.conserved import energy, energy_parts, momentum
from dem_bridge.scene.scene import Damping, Scene, Wall
from tests.helpers.strategies import damped_scenes, examples, log_uniform

EPS = float(np.finfo(float).eps)

PAIR = Scene(
    name="pair", duration=2e-4, mass=(1e-2, 3e-2), stiffness=(4e9,), velocity=(1.0, 0.0), samples=50,
    damping=Damping(law="dashpot", coefficient=20.0),
)  # fmt: skip
#: reduced mass of the pair, kg
REDUCED = 1.0 / (1.0 / 1e-2 + 1.0 / 3e-2)


# drag


def test_a_body_in_drag_slows_down_exponentially() -> None:
    scene = Scene(name="dragged", duration=1e-2, mass=(2e-2,), stiffness=(), velocity=(0.7,), drag=300.0, samples=20)
    run = db.solve(scene, backend="scipy", uncertainty=False)
    # some ten steps at 3e-14
    assert run.velocity[:, 0] == pytest.approx(0.7 * np.exp(-300.0 * run.time), abs=0.7e-12)
    assert run.displacement[:, 0] == pytest.approx(-0.7 / 300.0 * np.expm1(-300.0 * run.time), abs=1e-12 * 0.7 / 300.0)


def test_a_falling_body_in_drag_reaches_its_final_speed() -> None:
    scene = Scene(
        name="falling", duration=0.2, mass=(2e-2,), stiffness=(), velocity=(0.0,), drag=30.0, gravity=9.81, samples=20
    )
    run = db.solve(scene, backend="scipy", uncertainty=False)
    assert run.velocity[:, 0] == pytest.approx(-9.81 / 30.0 * np.expm1(-30.0 * run.time), abs=1e-12)


def test_drag_takes_momentum_from_a_chain_as_from_one_body() -> None:
    scene = replace(PAIR, damping=None, drag=5e3)
    run = db.solve(scene, backend="scipy", uncertainty=False)
    # contact forces cancel in the sum, whatever they are
    assert momentum(scene, run) == pytest.approx(1e-2 * np.exp(-5e3 * run.time), rel=1e-12)


# two bodies, n = 2, dashpot: a damped oscillator until its force is 0


def _oscillator(stiffness: float, c: float) -> tuple[Callable[[float], float], Callable[[float], float], float, float]:
    """Force and closing rate over time, when the force ends and when the compression is largest; closing at 1 m/s."""
    g = c / (2.0 * REDUCED)
    w = cmath.sqrt(stiffness / REDUCED - g * g)

    def overlap(t: float) -> float:
        return float((math.exp(-g * t) * cmath.sin(w * t) / w).real)

    def rate(t: float) -> float:
        return float((math.exp(-g * t) * (cmath.cos(w * t) - g * cmath.sin(w * t) / w)).real)

    def force(t: float) -> float:
        return stiffness * overlap(t) + c * rate(t)

    period = 2.0 * math.pi / math.sqrt(stiffness / REDUCED)
    grid = np.linspace(1e-6 * period, 2.0 * period, 4000)

    def first_zero(f: Callable[[float], float]) -> float:
        j = int(np.flatnonzero([f(t) < 0.0 for t in grid])[0])
        return float(brentq(f, grid[j - 1], grid[j], xtol=1e-300, rtol=1e-15))

    return force, rate, first_zero(force), first_zero(rate)


@pytest.mark.parametrize("ratio", [0.1, 0.4, 0.6, 0.95, 1.5])
def test_two_bodies_with_a_dashpot_are_the_damped_oscillator_until_its_force_is_zero(ratio: float) -> None:
    stiffness = 1e6
    c = 2.0 * ratio * math.sqrt(stiffness * REDUCED)
    force, rate, end, turn = _oscillator(stiffness, c)
    # the overlap at the end of the force, c/stiffness times the rate, takes that time to open
    scene = replace(
        PAIR,
        exponent=2.0,
        stiffness=(stiffness,),
        damping=Damping(law="dashpot", coefficient=c),
        duration=end + 1.2 * c / stiffness,
    )
    run = db.solve(scene, backend="scipy")
    exact = np.array([rate(min(t, end)) for t in run.time])
    # forty steps at 3e-14
    assert run.velocity[:, 0] - run.velocity[:, 1] == pytest.approx(exact, abs=1e-12)
    assert np.max(np.abs(run.velocity[:, 0] - run.velocity[:, 1] - exact)) <= 2.0 * run.uncertainty["velocity"]
    assert run.contact_force[1:, 0] == pytest.approx([force(t) if t < end else 0.0 for t in run.time[1:]], abs=1e-9)
    assert np.all(run.contact_force >= 0.0)
    assert run.crossing_time[0] == pytest.approx(turn, rel=1e-12)
    # above a ratio of 1/2 the force falls from its jump at touch on
    grid = np.linspace(0.0, end, 100001)
    largest = max(force(t) for t in grid)
    assert (run.peak_force[0] == c) == (ratio > 0.5)
    assert run.peak_force[0] == pytest.approx(largest, rel=1e-9)  # (spacing/period)^2 of the grid
    # the force ends, and then the overlap does
    assert run.provenance["restarts"] == 2


def test_the_force_that_would_pull_is_not_there() -> None:
    # unclipped, the exit speed of this pair is another one: the whole half period instead of its pushing part
    stiffness, ratio = 1e6, 0.5
    c = 2.0 * ratio * math.sqrt(stiffness * REDUCED)
    _, rate, end, _ = _oscillator(stiffness, c)
    whole = math.exp(-ratio / math.sqrt(1.0 - ratio**2) * math.pi)
    clip = -rate(end)
    assert clip - whole > 0.1
    damping = Damping(law="dashpot", coefficient=c)
    scene = replace(PAIR, exponent=2.0, stiffness=(stiffness,), damping=damping, duration=1e-3)
    last = db.solve(scene, backend="scipy", uncertainty=False).velocity[-1]
    assert last[1] - last[0] == pytest.approx(clip, abs=1e-12)


@pytest.mark.parametrize("light", [1.0, 1e-15])
def test_a_clipped_force_is_noticed_beside_a_heavy_and_fast_body(light: float) -> None:
    # the energy of the third body, which is never met, allows forces 1e16 times larger than those of the pair
    stiffness, c = 1e6, math.sqrt(1e6 * REDUCED)
    pair = replace(
        PAIR, exponent=2.0, stiffness=(light * stiffness,), damping=Damping(law="dashpot", coefficient=light * c),
        mass=tuple(light * mass for mass in PAIR.mass), duration=1e-3,
    )  # fmt: skip
    away = replace(
        pair, mass=(*pair.mass, 1e20), stiffness=pair.stiffness * 2, exponent=pair.exponent * 2,
        velocity=(*pair.velocity, 1e5), gap=(0.0, 1.0), damping=Damping(law="dashpot", coefficient=light * c),
    )  # fmt: skip
    alone, beside = (db.solve(scene, backend="scipy", uncertainty=False) for scene in (pair, away))
    # forty steps whose absolute tolerance is 3e-18 of 1e5 m/s; velocities were wrong by up to 0.10 m/s
    assert beside.velocity[:, :2] == pytest.approx(alone.velocity, abs=1e-10)


# two bodies, Hertz, Kuwabara-Kono


@pytest.mark.parametrize(
    ("gamma", "beta", "speed"), [(1e-6, 4e9, 1.0), (1e-5, 4e9, 1e-2), (1e-4, 4e9, 1.0), (1e-5, 1e8, 3.0)]
)
def test_kuwabara_konos_collision_is_that_of_a_second_writing(gamma: float, beta: float, speed: float) -> None:
    # with overlap = w^2 and dt = w dr all is smooth: one run of any integrator through the whole contact
    depth = (1.25 * REDUCED * speed**2 / beta) ** 0.4
    scales = np.array([math.sqrt(depth), speed, depth / speed])

    def slope(_: float, y: NDArray[np.float64]) -> list[float]:
        w, u, _t = y
        return [0.5 * u, -beta / REDUCED * w * w * (w * w + gamma * u), w]

    def pull(_: float, y: NDArray[np.float64]) -> float:
        return float((y[0] ** 2 + gamma * y[1]) / depth)

    pull.terminal, pull.direction = True, -1  # type: ignore[attr-defined]
    answer = solve_ivp(
        slope, (0.0, 1e3 * scales[0] / speed), [0.0, speed, 0.0], "DOP853", rtol=3e-14, atol=1e-18 * scales,
        events=[pull], dense_output=True,
    )  # fmt: skip
    _, exit_rate, end = answer.y_events[0][0]
    w, u, _ = answer.sol(np.linspace(0.0, answer.t_events[0][0], 20001))
    largest = float(np.max(beta * w * (w * w + gamma * u)))
    scene = replace(
        PAIR, stiffness=(beta,), velocity=(speed, 0.0), damping=Damping(law="kuwabara-kono", coefficient=gamma),
        duration=2.0 * end,
    )  # fmt: skip
    run = db.solve(scene, backend="scipy", uncertainty=False)
    assert run.velocity[-1, 0] - run.velocity[-1, 1] == pytest.approx(exit_rate, abs=1e-12 * speed)
    assert run.peak_force[0] == pytest.approx(largest, rel=1e-7)  # (1/20000)^2 of the grid, and some
    # the sample in the middle of the run lies at the end, to the last digit
    assert np.all(run.contact_force[run.time > 1.01 * end] == 0.0)
    inside = (run.time > 0.0) & (run.time < 0.99 * end)
    assert np.all(run.contact_force[inside] > 0.0)


# many bodies


def _straight(scene: Scene) -> NDArray[np.float64]:
    """Velocities at the samples by the equations as they are written in the Scene, straight through all contacts."""
    c, n = scene.contacts, scene.n_body
    assert scene.damping is not None
    dashpot, coefficient = scene.damping.law == "dashpot", np.array(scene.damping.coefficient)
    inverse = np.append(1.0 / np.array(scene.mass), 0.0)

    def slope(_: float, y: NDArray[np.float64]) -> NDArray[np.float64]:
        x, v = np.append(y[:n], 0.0), np.append(y[n:], 0.0)
        overlap, rate = x[c.left] - x[c.right] - c.gap, v[c.left] - v[c.right]
        s = np.maximum(overlap, 0.0)
        viscous = coefficient if dashpot else coefficient * c.stiffness * s ** (c.exponent - 2.0)
        force = np.where(overlap > 0.0, np.maximum(c.stiffness * s ** (c.exponent - 1.0) + viscous * rate, 0.0), 0.0)
        a = np.append(scene.free_acceleration - scene.drag * v[:n], 0.0)
        np.add.at(a, c.right, force * inverse[c.right])
        np.add.at(a, c.left, -force * inverse[c.left])
        return np.concatenate([v[:n], a[:n]])

    times = np.linspace(0.0, scene.duration, scene.samples + 1)
    start = np.concatenate([np.zeros(n), scene.velocity])
    answer = solve_ivp(
        slope, (0.0, scene.duration), start, "RK45", times, rtol=1e-9, atol=1e-14, max_step=scene.duration / 1e3
    )
    return np.asarray(answer.y[n:].T)


#: body 2 flies into the pair while its contact is slack, and presses it again
SLACK = replace(
    PAIR, mass=(1e-2, 1e-2, 1e-2), stiffness=(4e9, 4e9), exponent=2.5, velocity=(1.0, 0.0, -2.0), gap=(0.0, 1.4e-4),
    damping=Damping(law="dashpot", coefficient=300.0), samples=400, duration=1.5e-4,
)  # fmt: skip


@pytest.mark.parametrize("law", ["dashpot", "kuwabara-kono"])
def test_a_slack_contact_is_pressed_again(law: str) -> None:
    scene = SLACK if law == "dashpot" else replace(SLACK, damping=Damping(law=law, coefficient=1e-4))
    run = db.solve(scene, backend="scipy", uncertainty=False)
    overlap = run.displacement[:, 0] - run.displacement[:, 1]
    pressed, slack = run.contact_force[:, 0] > 0.0, (run.contact_force[:, 0] == 0.0) & (overlap > 0.0)
    first = int(np.flatnonzero(slack)[0])
    assert np.any(pressed[:first])
    assert np.any(pressed[first:])
    # a local tolerance of 1e-9 where forces are not smooth: measured 3e-8 and 1.3e-7
    assert run.velocity == pytest.approx(_straight(scene), abs=5e-7)


@pytest.mark.parametrize(("law", "pressed"), [("dashpot", False), ("kuwabara-kono", True)])
def test_a_chain_with_everything_is_that_of_the_equations_as_written(law: str, pressed: bool) -> None:
    coefficient = (10.0, 0.0, 100.0, 30.0, 5.0) if law == "dashpot" else (1e-5, 0.0, 1e-4, 3e-6, 1e-5)
    scene = Scene(
        name="everything", duration=3e-4, mass=(8e-3, 1e-2, 2e-2, 5e-3), stiffness=(4e9, 5e9, 6e9),
        velocity=(0.8, 0.0, 0.1, -0.3), gravity=500.0, drag=100.0, samples=24,
        damping=Damping(law=law, coefficient=coefficient),
        precompression=5.0 if pressed else 0.0, gap=0.0 if pressed else (1e-6, 0.0, -5e-7),
        wall_left=Wall(stiffness=3e9, gap=0.0 if pressed else 2e-6),
        wall_right=Wall(stiffness=2e9, gap=0.0 if pressed else 1e-5),
    )  # fmt: skip
    run = db.solve(scene, backend="scipy", uncertainty=False)
    # a local tolerance of 1e-9 where forces are not smooth: measured up to 2e-7
    assert run.velocity == pytest.approx(_straight(scene), abs=1e-6)


@examples(6)
@given(scene=damped_scenes(bodies=(2, 5), samples=40))
def test_energy_only_falls_forces_only_push_and_momentum_stays_on_random_scenes(scene: Scene) -> None:
    run = db.solve(scene, backend="scipy", uncertainty=False)
    assert np.all(run.contact_force >= 0.0)
    assert np.all(run.peak_force >= run.contact_force.max(axis=0))
    total = energy(scene, run)
    scale = float(np.max(sum(np.abs(part) for part in energy_parts(scene, run))))
    # overlaps of 1e-5 m from displacements of 1e-4 m lose a digit, the run some 1e-12
    assert float(np.max(np.diff(total))) <= 1e-10 * scale
    if scene.wall_left is scene.wall_right is None and scene.gravity == scene.drag == 0.0:
        size = float(np.max(np.abs(run.velocity)) * np.sum(scene.mass))
        start = float(np.dot(scene.mass, scene.velocity))
        assert momentum(scene, run) == pytest.approx(np.full(41, start), abs=1e4 * EPS * size)


@examples(5)
@given(
    masses=st.tuples(log_uniform(1e-3, 1e-1), log_uniform(1e-3, 1e-1)),
    law=st.sampled_from(["dashpot", "kuwabara-kono"]),
    strength=log_uniform(1e-3, 1.0),
)
def test_two_bodies_part_more_slowly_than_they_met_and_keep_their_momentum(
    masses: tuple[float, float], law: str, strength: float
) -> None:
    coefficient = 300.0 * strength if law == "dashpot" else 1e-4 * strength
    scene = replace(PAIR, mass=masses, damping=Damping(law=law, coefficient=coefficient), duration=2e-3)
    run = db.solve(scene, backend="scipy", uncertainty=False)
    assert 0.0 < run.velocity[-1, 1] - run.velocity[-1, 0] < 1.0
    assert momentum(scene, run) == pytest.approx(np.full(51, masses[0]), rel=1e4 * EPS)


def test_without_coefficients_damping_is_not_there_to_the_last_bit() -> None:
    idle, plain = (
        db.solve(replace(PAIR, damping=damping), backend="scipy")
        for damping in (Damping(law="dashpot", coefficient=0.0), None)
    )
    assert idle.velocity.tobytes() == plain.velocity.tobytes()


def test_an_elastic_contact_among_damped_ones_is_integrated_as_ever() -> None:
    # the same pair beside a damped one that it never meets
    both = replace(
        PAIR, mass=PAIR.mass * 2, stiffness=(4e9, 1.0, 4e9), exponent=2.5,
        velocity=(1.0, 0.0, 2.0, 1.0), gap=(0.0, 1.0, 0.0),
        damping=Damping(law="kuwabara-kono", coefficient=(0.0, 0.0, 1e-4)),
    )  # fmt: skip
    run = db.solve(both, backend="scipy", uncertainty=False)
    plain = db.solve(replace(PAIR, damping=None), backend="scipy", uncertainty=False)
    assert run.velocity[:, :2] == pytest.approx(plain.velocity, abs=1e-12)
    assert run.peak_force[0] == pytest.approx(plain.peak_force[0], rel=1e-12)
    assert run.crossing_time[0] == pytest.approx(plain.crossing_time[0], rel=1e-12)


def test_bodies_at_rest_in_touch_stay_there_and_fall_off_a_wall_without_sticking() -> None:
    rest = replace(PAIR, velocity=(0.0, 0.0))
    assert not np.any(db.solve(rest, backend="scipy", uncertainty=False).velocity)
    off = replace(rest, damping=Damping(law="dashpot", coefficient=20.0), wall_right=Wall(stiffness=4e9), gravity=-9.81)
    run = db.solve(off, backend="scipy", uncertainty=False)
    assert run.velocity == pytest.approx(np.tile(-9.81 * run.time[:, None], 2), abs=1e-14)
    # 1e-13 of a collision at the speed of that fall
    assert np.all(run.peak_force < 1e-10)


def test_a_contact_that_chatters_is_a_broken_run(monkeypatch: pytest.MonkeyPatch) -> None:
    def stuck(self: scipy_damped.DampedIntegration, *_: object) -> NDArray[np.float64]:
        return np.full((len(scipy_damped.PROBES), self.k), -2.0)

    monkeypatch.setattr(scipy_damped.DampedIntegration, "margins", stuck)
    with pytest.raises(RunBroken, match=r"contact 0 chatters at t = 0 s, with 1\d events .*; take backend='verlet'"):
        db.solve(PAIR, backend="scipy")


# who answers, who refuses


@pytest.mark.parametrize("changes", [{}, {"damping": None, "drag": 1.0}], ids=["damping", "drag"])
def test_the_reference_answers_through_scipy_and_says_so(changes: dict[str, float]) -> None:
    scene = replace(PAIR, **changes)  # type: ignore[arg-type]
    run, other = (
        db.solve(scene, backend="reference", uncertainty=False),
        db.solve(scene, backend="scipy", uncertainty=False),
    )
    assert (run.provenance["backend"], run.provenance["answered_by"]) == ("reference", "scipy")
    assert run.velocity.tobytes() == other.velocity.tobytes()


@pytest.mark.parametrize("name", ["bca", "ode45", "ase"])
@pytest.mark.parametrize("changes", [{}, {"damping": None, "drag": 1.0}], ids=["damping", "drag"])
def test_who_cannot_refuses_with_the_reason(name: str, changes: dict[str, float]) -> None:
    with pytest.raises(UnsupportedScene, match=r"cannot do pair: .*(damping|drag)"):
        db.solve(replace(PAIR, **changes), backend=name)  # type: ignore[arg-type]


def test_the_binary_collisions_refuse_precompression_by_name() -> None:
    with pytest.raises(UnsupportedScene, match="the scene has precompression;"):
        db.solve(replace(PAIR, damping=None, precompression=1.0), backend="bca")
