"""The coarse look: good to a few per cent, over in few steps, and never endless."""

from __future__ import annotations

import math
import sys
from dataclasses import replace
from unittest.mock import Mock

import numpy as np
import pytest
from hypothesis import given

import dem_bridge as db
from dem_bridge.backends import prescan
from dem_bridge.backends.base import Resolution, Sampling
from dem_bridge.backends.prescan import prescan_hertz
from dem_bridge.backends.surrogate_radius import radius_after
from dem_bridge.errors import RunBroken
from dem_bridge.physics.exact import two_body_collision
from dem_bridge.runs.uncertainty.step_choice import step_for_accuracy
from dem_bridge.scene.scene import Damping, Scene, Wall
from tests.conftest import Solve
from tests.helpers.quadruple_truth import Truth
from tests.helpers.strategies import examples, scenes

PAIR = Scene(name="pair", duration=2e-4, mass=(8.1e-3, 1e-2), stiffness=(4e9,), velocity=(0.8, 0.0), samples=10)

#: with steps of a tenth of 1/omega velocity-Verlet errs by (omega dt)^2 / 12 = 1e-3; ten times that for what adds up
COARSE = 1e-2


@pytest.mark.parametrize("exponent", [1.6, 2.0, 2.5, 3.2])
def test_one_collision_is_as_deep_and_as_fast_as_the_exact_one(exponent: float) -> None:
    scene = replace(PAIR, exponent=exponent, stiffness=(4e9 * 1e-5 ** (2.5 - exponent),))
    prescan = prescan_hertz(scene)
    hit = two_body_collision(
        masses=(8.1e-3, 1e-2), velocities=(0.8, 0.0), stiffness=scene.stiffness[0], exponent=exponent
    )
    assert prescan.peak_overlap[0] == pytest.approx(hit.peak_overlap, rel=COARSE)
    mobility = 1.0 / 8.1e-3 + 1.0 / 1e-2
    tangent = (exponent - 1.0) * scene.stiffness[0] * hit.peak_overlap ** (exponent - 2.0)
    assert prescan.frequency == pytest.approx(math.sqrt(tangent * mobility), rel=COARSE)
    assert prescan.max_acceleration == pytest.approx(hit.peak_force / 8.1e-3, rel=COARSE)


@pytest.mark.parametrize(
    "scene",
    [
        *map(db.load_scene, ("decelerating-40", "decelerating-40-drag", "decelerating-40-graded-exponent",
                             "decelerating-40-gaps", "decelerating-40-on-base")),
        replace(PAIR, damping=Damping(law="dashpot", coefficient=2.0)),
        replace(PAIR, damping=Damping(law="kuwabara-kono", coefficient=2e-6)),
    ],
    ids=lambda scene: scene.name,
)  # fmt: skip
def test_an_interpreted_prescan_is_that_of_the_kernel_bit_by_bit(scene: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    compiled = prescan_hertz(scene)
    monkeypatch.setattr(prescan, "interpretable", lambda _: True)
    with monkeypatch.context() as patch:
        patch.setattr(prescan, "interruptible", lambda *_: pytest.fail("the kernel was called"))
        interpreted = prescan_hertz(scene)
    assert interpreted.peak_overlap.tobytes() == compiled.peak_overlap.tobytes()
    assert replace(interpreted, peak_overlap=compiled.peak_overlap) == compiled
    # the kernel takes over where the interpreter takes too long, and where it does not go on with inf
    monkeypatch.setattr(prescan, "MOST_INTERPRETED", 10 * scene.n_contact)
    assert prescan_hertz(scene).steps == compiled.steps > 10
    monkeypatch.setattr(prescan._run, "interpret", Mock(side_effect=OverflowError))
    assert prescan_hertz(scene).steps == compiled.steps


def test_a_prescan_is_interpreted_only_where_that_is_faster_than_loading_the_compiler(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(sys.modules, "numba", Mock())
    assert not prescan.interpretable(PAIR)
    monkeypatch.delitem(sys.modules, "numba")
    assert prescan.interpretable(db.load_scene("decelerating-40"))
    others = ("decelerating-200", "decelerating-40-dashpot", "driven-monomer")
    assert not any(map(prescan.interpretable, map(db.load_scene, others)))


def test_overlaps_on_the_papers_chains_are_those_of_the_truth(free_chain: Truth) -> None:
    prescan = prescan_hertz(free_chain.scene)
    depth = (free_chain.data["F_peak"] / free_chain.data["beta"]) ** (2.0 / 3.0)
    assert prescan.peak_overlap == pytest.approx(depth, rel=2.0 * COARSE)
    assert prescan.highest == pytest.approx(float(np.max(free_chain.data["x"])), rel=COARSE)
    assert prescan.steps < 1e5


@examples(20)
@given(scene=scenes(bodies=(1, 6), walls=True, gravity=True))
def test_overlaps_of_random_scenes_are_those_of_a_fine_run(scene: Scene) -> None:
    from dem_bridge.backends.base import Resolution, Sampling
    from dem_bridge.backends.verlet import Verlet

    prescan = prescan_hertz(scene)
    fine = Verlet().run(scene, Resolution(), Sampling(count=10))
    depth = (fine.peak_force / scene.contacts.stiffness) ** (2.0 / 3.0)
    # a re-collision may turn out a few times softer or harder in a coarse run; what a deck needs is the deepest
    deepest = float(np.max(depth, initial=0.0))
    assert float(np.max(prescan.peak_overlap, initial=0.0)) == pytest.approx(deepest, rel=0.1, abs=1e-12)


def test_the_surrogate_radius_follows_from_the_deepest_overlap() -> None:
    prescan = prescan_hertz(PAIR)
    assert 1.25 * prescan.peak_overlap[0] < radius_after(prescan) <= 2.5 * prescan.peak_overlap[0]


def test_a_scene_without_contact_has_no_frequency_and_takes_one_step() -> None:
    prescan = prescan_hertz(replace(PAIR, velocity=(0.0, 0.8)))
    assert (prescan.frequency, prescan.steps, prescan.peak_overlap.tolist()) == (0.0, 1, [0.0])
    assert (prescan.lowest, prescan.highest) == (0.0, pytest.approx(0.8 * 2e-4, rel=1e-12))


def test_free_fall_onto_a_wall_is_not_stepped_over() -> None:
    # one body, gravity only: it hits after sqrt(2 h / g) = 0.45 ms
    scene = Scene(
        name="fall",
        duration=1e-3,
        mass=(1e-2,),
        stiffness=(),
        velocity=(0.0,),
        wall_right=Wall(stiffness=1e9, gap=1e-6),
        gravity=9.81,
        samples=10,
    )
    depth = 0.0
    for _ in range(100):  # all the weight's work is stored: m g (gap + depth) = beta depth^n / n
        depth = (2.5 * 1e-2 * 9.81 * (1e-6 + depth) / 1e9) ** 0.4
    assert prescan_hertz(scene).peak_overlap[0] == pytest.approx(depth, rel=COARSE)


def test_an_initial_overlap_counts_as_an_overlap() -> None:
    prescan = prescan_hertz(replace(PAIR, velocity=(0.0, 0.0), gap=-3e-6))
    assert prescan.peak_overlap.tolist() == [3e-6]
    assert prescan.frequency > 0.0


def test_a_left_wall_and_a_motion_backwards_are_seen(solved: Solve) -> None:
    scene = replace(PAIR, velocity=(-0.5, 0.0), wall_left=Wall(stiffness=1e9, gap=1e-5))
    prescan = prescan_hertz(scene)
    exact = solved(scene, "scipy", uncertainty=False)
    assert prescan.peak_overlap[1] == pytest.approx(float((exact.peak_force[1] / 1e9) ** (2.0 / 3.0)), rel=COARSE)
    assert prescan.lowest == pytest.approx(-1e-5 - prescan.peak_overlap[1], rel=COARSE)


def test_a_look_that_would_take_too_long_is_refused_with_the_reason() -> None:
    with pytest.raises(RunBroken, match=r"the coarse run of pair needs more than 20 steps.*shorten the duration"):
        prescan_hertz(PAIR, max_steps=20)


def test_what_is_stopped_faster_than_it_swings_sets_the_steps() -> None:
    # 1/s: of drag, of a dashpot c (1/m + 1/M), of Kuwabara-Kono damping gamma beta sqrt(overlap) (1/m + 1/M)
    mobility = 1.0 / PAIR.mass[0] + 1.0 / PAIR.mass[1]
    plain = prescan_hertz(PAIR)
    assert prescan_hertz(replace(PAIR, drag=1e9)).frequency == 1e9
    # slowed on its way by 1e-3 of its time, at most so much less deep
    assert prescan_hertz(replace(PAIR, drag=1e-3 * plain.frequency)).frequency == pytest.approx(
        plain.frequency, rel=1e-3
    )
    stiff = replace(PAIR, damping=Damping(law="dashpot", coefficient=1e6))
    assert prescan_hertz(stiff).frequency == pytest.approx(1e6 * mobility)
    viscous = replace(PAIR, damping=Damping(law="kuwabara-kono", coefficient=1e-2))
    prescan = prescan_hertz(viscous)
    rate = 1e-2 * PAIR.stiffness[0] * float(np.sqrt(prescan.peak_overlap[0])) * mobility
    assert prescan.frequency == pytest.approx(rate)
    # a contact that never closes stops nothing
    assert prescan_hertz(replace(stiff, gap=1.0)).frequency == prescan_hertz(replace(PAIR, gap=1.0)).frequency


def test_a_contact_is_deeper_for_dashpots_behind_it(solved: Solve) -> None:
    # they stiffen what it pushes: tables and radii must have room for that
    chain = Scene(
        name="four", duration=4e-4, mass=(8e-3,) + (1e-2,) * 3, stiffness=(4e9,) * 3, velocity=(0.8, 0.0, 0.0, 0.0)
    )
    damped = replace(chain, name="behind", damping=Damping(law="dashpot", coefficient=(0.0, 300.0, 300.0)))
    free, prescan = prescan_hertz(chain), prescan_hertz(damped)
    assert prescan.peak_overlap[0] > 1.02 * free.peak_overlap[0]
    exact = solved(damped, "scipy", uncertainty=False)
    assert prescan.peak_overlap[0] == pytest.approx(float((exact.peak_force[0] / 4e9) ** (2.0 / 3.0)), rel=COARSE)


@pytest.mark.parametrize(
    "scene",
    [
        Scene(name="alone", duration=1e-2, mass=(1e-2,), stiffness=(), velocity=(1.0,), drag=1e4, samples=10),
        replace(PAIR, drag=1e7),
        replace(PAIR, damping=Damping(law="dashpot", coefficient=1e5)),
    ],
    ids=["a body in drag", "a pair in drag", "a pair with a dashpot"],
)
def test_a_step_that_nobody_named_is_stable_where_much_is_damped(scene: Scene, solved: Solve) -> None:
    # steps that followed the springs alone gave 1e30 m/s in the first, no number in the second, 1 m/s too much in
    # the third. Of first order, DEFAULT_PHASE = 2.5e-3 of the shortest time: an error of that order
    run, exact = solved(scene, "verlet", uncertainty=False), solved(scene, "scipy", uncertainty=False)
    assert np.max(np.abs(run.velocity - exact.velocity)) < 2.5e-3 * max(scene.velocity)
    wanted = step_for_accuracy(scene, 1e-3, Resolution(), Sampling(count=scene.samples))
    coarse = solved(scene, "verlet", dt=wanted.dt)
    assert np.max(np.abs(coarse.velocity - exact.velocity)) < 1e-3 * max(scene.velocity)
