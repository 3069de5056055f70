"""The restitution of a run: what contacts have where they open, not what bodies have at the end."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import dem_bridge as db
from dem_bridge.errors import UsageError
from dem_bridge.physics.drop_and_stack import linear_drop
from dem_bridge.physics.exact import linear_restitution
from dem_bridge.scene.scene import Adhesion, Damping, Scene, Wall
from dem_bridge.trajectory.restitution import impact_facts, restitution
from dem_bridge.trajectory.trajectory import load_trajectory

STIFFNESS, MASS, GRAVITY, HEIGHT = 1e4, 1.0, 9.81, 0.05
DASHPOT = 20.0
#: a sphere that falls on a wall, bounces, and falls again
DROP = Scene(
    name="drop", duration=0.3, mass=(MASS,), velocity=(0.0,), stiffness=(), exponent=(), gravity=GRAVITY, samples=300,
    wall_right=Wall(stiffness=STIFFNESS, exponent=2.0, gap=HEIGHT),
    damping=Damping(law="dashpot", coefficient=DASHPOT, clip=False),
)  # fmt: skip
HIT = replace(DROP, name="hit", velocity=(1.0,), gravity=0.0, wall_right=Wall(stiffness=STIFFNESS, exponent=2.0))
#: that of the drop by its closed form in stages
EXACT = linear_drop(mass=MASS, stiffness=STIFFNESS, damping=DASHPOT, height=HEIGHT, gravity=GRAVITY)
FALLEN = EXACT.exit_speed / math.sqrt(2.0 * GRAVITY * HEIGHT)


@pytest.mark.parametrize("samples", [15, 300, 3000])
def test_the_speed_is_that_of_the_opening_with_gravity_and_any_samples(samples: int) -> None:
    run = db.solve(DROP, backend="scipy", samples=samples, uncertainty=False)
    assert isinstance(run.restitution, float)
    # the integration is exact to 1e-12 of the largest velocity
    assert run.restitution == pytest.approx(FALLEN, abs=1e-11)
    # the planted faults: the speed at the end, and the restitution without gravity
    assert abs(abs(run.velocity[-1, 0]) / math.sqrt(2.0 * GRAVITY * HEIGHT) - FALLEN) > 0.01
    assert (
        abs(linear_restitution(damping_ratio=0.5 * DASHPOT / math.sqrt(STIFFNESS * MASS), clip=False) - FALLEN) > 1e-3
    )


def test_a_saved_run_has_the_same_restitution_and_so_has_the_mirrored_scene(tmp_path: Path) -> None:
    run = db.solve(DROP, backend="scipy", uncertainty=False)
    run.save(tmp_path / "drop.nc")
    assert load_trajectory(tmp_path / "drop.nc").restitution == run.restitution
    mirrored = replace(DROP, wall_left=DROP.wall_right, wall_right=None, gravity=-GRAVITY)
    assert db.solve(mirrored, backend="scipy", uncertainty=False).restitution == pytest.approx(FALLEN, abs=1e-11)


def test_fixed_steps_have_it_to_their_uncertainty() -> None:
    run = db.solve(DROP, backend="verlet", dt=2e-5)
    bar = 2.0 * run.uncertainty["velocity"] / math.sqrt(2.0 * GRAVITY * HEIGHT)
    assert 1e-6 < abs(run.restitution - FALLEN) <= bar < 0.05


@pytest.mark.parametrize("clip", [True, False])
@pytest.mark.parametrize("ratio", [0.3, 0.9, 1.0, 2.0])
def test_overdamped_contacts_rebound_only_if_they_are_clipped(ratio: float, clip: bool) -> None:
    damping = Damping(law="dashpot", coefficient=2.0 * ratio * math.sqrt(STIFFNESS * MASS), clip=clip)
    for gravity in (0.0, 1e-9):
        run = db.solve(replace(HIT, damping=damping, gravity=gravity), backend="scipy", uncertainty=False)
        if ratio < 1.0 or clip:
            exact = linear_restitution(damping_ratio=ratio, clip=clip)
            # a weight of 1e-9 of the force changes it by far less
            assert run.restitution == pytest.approx(exact, abs=1e-9)
        else:
            assert math.isnan(run.restitution)


def test_nothing_rebounds_from_what_sticks_or_is_never_met() -> None:
    pair = Scene(name="pair", duration=2e-4, mass=(1e-2, 1e-2), velocity=(0.1, -0.1), stiffness=(2e9,))
    sticks = replace(
        pair, damping=Damping(law="dashpot", coefficient=100.0), adhesion=Adhesion(law="dmt", pull_off=50.0)
    )
    apart = replace(pair, gap=1e-3, velocity=(-0.1, 0.1))
    ends_in_contact = replace(pair, duration=3e-5)
    overlaps = replace(pair, gap=-1e-6)
    for scene in (sticks, apart, ends_in_contact, overlaps):
        assert math.isnan(db.solve(scene, backend="scipy", uncertainty=False).restitution)
    assert db.solve(pair, backend="scipy", uncertainty=False).restitution == pytest.approx(1.0, abs=1e-12)


def test_drag_is_part_of_the_flight() -> None:
    pair = Scene(
        name="pair", duration=4e-4, mass=(1e-2, 1e-2), velocity=(1.0, -1.0), gap=1e-4, stiffness=(2e9,), drag=500.0
    )
    few, many = (db.solve(pair, backend="scipy", samples=count, uncertainty=False).restitution for count in (7, 1000))
    # drag also acts during the contact
    assert 0.9 < few < 0.999
    assert few == pytest.approx(many, abs=1e-12)


def test_a_run_without_a_restitution_says_so_in_one_line() -> None:
    chain = Scene(name="chain", duration=1e-4, mass=(1e-2,) * 3, velocity=(1.0, 0.0, 0.0), stiffness=(2e9,) * 2)
    driven = replace(HIT, drive=db.Drive(shape="sine", force=1.0, frequency=10.0))
    assert impact_facts(driven) is None
    for scene, said in (
        (chain, "a run with 3 bodies and 2 contacts is not defined; allowed: two bodies, or one body and one wall"),
        (driven, "the restitution of this run is unknown: the scene has a drive"),
        (replace(DROP, samples=1), "none is in the first flight after the impact at 0.1"),
    ):
        run = db.solve(scene, backend="verlet", dt=1e-5, uncertainty=False)
        with pytest.raises(UsageError) as caught:
            _ = run.restitution
        assert said in str(caught.value)
        assert "\n" not in str(caught.value)


FACTS = {"gap": 0.0, "bodies": (0, 1), "acceleration": 0.0, "drag": 0.0, "clipped_spring": None}


@pytest.mark.parametrize(
    ("left", "right", "value"),
    [
        # bodies that part at half of the speed of approach, that stay together, and that never approached
        ([1.0, 0.0], [0.0, 0.5], 0.5),
        ([1.0, 0.5], [0.0, 0.5], math.nan),
        ([0.0, 0.0], [1.0, 1.5], math.nan),
    ],
)
def test_without_approach_or_separation_there_is_no_restitution(
    left: list[float], right: list[float], value: float
) -> None:
    time = np.array([0.0, 1.0])
    velocity = np.array([left, right]).T
    displacement = np.array([[0.0, 0.0], [0.0, 0.25]])
    found = restitution(time, displacement, velocity, 0.5, FACTS)
    assert found == pytest.approx(value, nan_ok=True)
