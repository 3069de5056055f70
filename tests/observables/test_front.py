"""The wave front by the crossing definition, against the truth and on made-up trajectories."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

import dem_bridge as db
from dem_bridge.errors import UsageError
from dem_bridge.observables.front import arrival_by_crossing, residence_by_crossing, wave_speed_by_crossing
from dem_bridge.scene import Scene, Wall
from tests.conftest import Solve
from tests.fakes import free_flight
from tests.truth import Truth

EPS = float(np.finfo(float).eps)

THREE = Scene(
    name="three", duration=1.0, mass=(1.0,) * 3, stiffness=(1.0, 1.0), velocity=(1.0, 0.0, 0.0), spacing=18e-3
)


def test_arrivals_are_the_crossings_of_the_chains_contacts_without_the_walls() -> None:
    scene = replace(THREE, wall_left=Wall(stiffness=1.0), wall_right=Wall(stiffness=1.0))
    run = free_flight(contacts=4, crossing_time=[0.1, 0.3, 0.7, 0.9])
    assert arrival_by_crossing(scene, run).tolist() == [0.1, 0.3]
    assert residence_by_crossing(scene, run) == pytest.approx([0.2], rel=4.0 * EPS)


def test_a_body_that_the_impulse_never_reaches_has_no_arrival_and_no_residence() -> None:
    run = free_flight(crossing_time=[0.1, math.nan])
    assert np.isnan(arrival_by_crossing(THREE, run)).tolist() == [False, True]
    assert np.isnan(residence_by_crossing(THREE, run)).tolist() == [True]


def test_an_arrival_is_a_copy_that_can_be_changed() -> None:
    run = free_flight()
    arrival_by_crossing(THREE, run)[0] = 5.0
    assert run.crossing_time[0] == 0.1


def test_the_speed_is_the_spacing_over_the_residence_time() -> None:
    run = free_flight(crossing_time=[1e-5, 3e-5])
    assert wave_speed_by_crossing(THREE, run) == pytest.approx([18e-3 / 2e-5], rel=8.0 * EPS)


def test_a_scene_without_spacing_has_no_speed_in_metres_and_the_message_says_what_to_add() -> None:
    with pytest.raises(UsageError, match=r"three has no spacing; .*\[chain\] spacing = "):
        wave_speed_by_crossing(replace(THREE, spacing=None), free_flight())


def test_two_bodies_have_an_arrival_but_no_residence() -> None:
    pair = Scene(name="pair", duration=1.0, mass=(1.0, 1.0), stiffness=(1.0,), velocity=(1.0, 0.0), spacing=1.0)
    run = free_flight(bodies=2, contacts=1)
    assert len(arrival_by_crossing(pair, run)) == 1
    assert len(residence_by_crossing(pair, run)) == len(wave_speed_by_crossing(pair, run)) == 0


def test_residence_times_of_the_papers_chains_are_those_of_the_truth(free_chain: Truth, solved: Solve) -> None:
    found = residence_by_crossing(free_chain.scene, solved(free_chain.scene, "scipy"))
    # differences of times that are good to 1e-10: of arrivals up to 0.6 ms, over residences of 10 us
    assert found == pytest.approx(free_chain.data["residence"], rel=1e-10 * 60)


def test_the_twin_finds_the_same_residence_times_within_its_bars(free_chain: Truth, solved: Solve) -> None:
    run = solved(free_chain.scene, "verlet", dt=1e-8)
    bars = run.uncertainty["crossing_time"]
    error = np.abs(residence_by_crossing(free_chain.scene, run) - free_chain.data["residence"])
    assert np.all(error <= bars[1:] + bars[:-1])


def test_the_wave_slows_down_and_speeds_up_as_the_scenes_are_named(solved: Solve) -> None:
    for name, sign in (("decelerating-40", -1.0), ("accelerating-40", 1.0)):
        scene = db.load_scene(name)
        speed = wave_speed_by_crossing(scene, solved(scene, "verlet", dt=1e-7, bars=False))
        # the paper's figure 3: monotone from the third cylinder on, to the one before the free end
        assert np.all(sign * np.diff(speed[2:-1]) > 0.0)
