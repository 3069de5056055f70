"""A run that ends once its observables are final has the observables of one that goes on to the end."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import dem_bridge as db
from dem_bridge.ensembles import solve
from dem_bridge.ensembles.draw import Variation
from dem_bridge.ensembles.lanes import march
from dem_bridge.ensembles.settled import MARGIN, is_free, is_settled
from dem_bridge.ensembles.solve import OBSERVABLES, solve_chains
from dem_bridge.scene.scene import Scene, Wall
from tests.helpers.strategies import examples

#: a light body strikes a row of heavier ones that stand apart: bodies meet again and again, long after the first wave
FREE = Scene(
    name="free", duration=3e-3, mass=(0.01, 0.02, 0.015, 0.01, 0.03), stiffness=(2e10, 1e10, 3e10, 2e10),
    velocity=(0.8, 0.0, 0.0, -0.1, 0.0),
)  # fmt: skip


def _assert_final(scene: Scene, steps: int, count: int = 11) -> None:
    """Assert that runs that may end early have every bit of runs that may not, because they keep samples."""
    chains = Variation(scene=scene, vary={"mass": 0.1, "stiffness": 0.1}, seed=3).block(0, count)
    early, whole = solve_chains(scene, chains, steps), solve_chains(scene, chains, steps, 2)
    for name in OBSERVABLES:
        np.testing.assert_array_equal(early[name], whole[name], err_msg=name)


@examples(30)
@given(
    seed=st.integers(0, 2**32 - 1),
    exponent=st.sampled_from([2.0, 2.2, 2.5, 3.0]),
    bodies=st.integers(2, 9),
    apart=st.sampled_from([0.0, 1e-6, 1e-4]),
)
def test_the_observables_of_a_run_that_ends_early_are_final(
    seed: int, exponent: float, bodies: int, apart: float
) -> None:
    random = np.random.default_rng(seed)
    stiffness = random.uniform(0.5, 2.0, bodies - 1) * 2e10 * 5e-6 ** (2.5 - exponent)
    scene = replace(
        FREE, mass=tuple(10.0 ** random.uniform(-3.0, -1.0, bodies)), stiffness=tuple(stiffness), exponent=exponent,
        gap=tuple(random.uniform(0.0, apart, bodies - 1)), velocity=tuple(random.normal(0.0, 0.5, bodies)),
    )  # fmt: skip
    _assert_final(scene, 3000, count=8)


def test_the_observables_of_the_paper_are_final() -> None:
    scene = db.load_scene("decelerating-40")
    chains = Variation(scene=scene, vary={"angle": 0.5}).block(0, 24)
    early, whole = solve_chains(scene, chains, 2240), solve_chains(scene, chains, 2240, 2)
    for name in OBSERVABLES:
        np.testing.assert_array_equal(early[name], whole[name], err_msg=name)


@pytest.mark.parametrize(
    "more", [{"gravity": 9.81}, {"wall_right": Wall(stiffness=2e10, gap=1e-4, exponent=2.5)}, {"precompression": 5.0}]
)
def test_a_chain_that_is_not_free_is_solved_to_its_end(more: dict[str, Any]) -> None:
    _assert_final(replace(FREE, **more), 2000, count=8)


def test_a_run_ends_at_the_first_look_at_which_all_lanes_are_final(monkeypatch: pytest.MonkeyPatch) -> None:
    pair = replace(
        FREE, mass=(0.01, 0.03), stiffness=(2e10,), velocity=(0.8, 0.0), duration=1e-3, exponent=2.5, gap=0.0
    )
    chains = Variation(scene=pair, vary={"mass": 0.05}).block(0, 2)
    compiled = solve_chains(pair, chains, 320)
    looks, names = [], march.py_func.__globals__
    all_settled = names["all_settled"]

    def looking(*arguments: Any) -> bool:
        looks.append(all_settled.py_func(*arguments))
        return bool(looks[-1])

    monkeypatch.setitem(names, "all_settled", looking)
    monkeypatch.setattr(solve, "march", march.interpret)
    interpreted = solve_chains(pair, chains, 320)
    # the bodies touch for less than 50 us of the 1000, and a look is every sixteenth step, 50 us
    assert looks == [False, True]
    for name, values in compiled.items():
        np.testing.assert_allclose(interpreted[name], values, rtol=1e-9, atol=1e-15)


# the bound itself, for two bodies that move against each other and one that leaves


def _settled(**more: Any) -> bool:
    """Return the answer for bodies of 1 and 3 kg, at 1 and 0 m/s, and one of 1 kg that leaves at 2 m/s."""
    fields: dict[str, Any] = {
        "mass": [np.inf, 1.0, 3.0, 1.0, np.inf], "stiffness": [0.0, 2.0, 2.0, 0.0], "exponent": [2.0] * 4,
        "velocity": [0.0, 1.0, 0.0, 2.0, 0.0], "overlap": [0.0, -1.0, -1.0, 0.0],
        "crossing": [np.inf, 1.0, 1.0, np.inf], "peak": [0.0, 9.0, 9.0, 0.0], "damping": [0.0] * 4, "power": [0.0] * 4,
        "slowed": 1.0,
    }  # fmt: skip
    given = fields | more
    slowed = given.pop("slowed")
    return bool(is_settled(**{name: np.array(values) for name, values in given.items()}, slowed=slowed))


def test_the_bound_on_the_speed_of_what_stays_is_that_of_an_elastic_impact() -> None:
    # the second body cannot be faster than after an elastic impact, 0.5 m/s, but for the margin on the energy
    mean, fastest = 0.25, 0.25 * np.sqrt(MARGIN)
    for leaves, final in ((mean + 1.001 * fastest, True), (mean + 0.999 * fastest, False), (0.4, False)):
        assert _settled(velocity=[0.0, 1.0, 0.0, leaves, 0.0]) == final
    assert MARGIN > 1.0


def test_the_bound_on_the_force_is_that_of_all_the_energy_in_one_spring() -> None:
    # the energy of the relative motion is 3/8 J; half of 2 N/m times the overlap squared is at most that
    force = np.sqrt(2.0 * 2.0 * 0.375 * MARGIN)
    assert _settled(peak=[0.0, 1.001 * force, 0.0, 0.0])
    assert not _settled(peak=[0.0, 0.999 * force, 0.0, 0.0])
    # energy that is stored counts as that in motion does
    closed, velocity = [0.0, np.sqrt(0.375), -1.0, 0.0], [0.0, 0.25, 0.25, 2.0, 0.0]
    assert _settled(overlap=closed, velocity=velocity, peak=[0.0, 1.001 * force, 0.0, 0.0])
    assert not _settled(overlap=closed, velocity=velocity, peak=[0.0, 0.999 * force, 0.0, 0.0])


def test_damping_may_press_harder_and_drag_may_let_what_stays_catch_up() -> None:
    # all energy in one spring, and at once all of it in motion: 1 N s/m times the fastest rate
    force = np.sqrt(2.0 * 2.0 * 0.375 * MARGIN) + np.sqrt(2.0 * 0.375 * MARGIN * (1.0 + 1.0 / 3.0))
    damped: dict[str, Any] = {"damping": [0.0, 1.0, 0.0, 0.0]}
    assert _settled(peak=[0.0, 1.001 * force, 0.0, 0.0], **damped)
    assert not _settled(peak=[0.0, 0.999 * force, 0.0, 0.0], **damped)
    slowest = 0.25 * np.sqrt(MARGIN) / (2.0 - 0.25)
    assert _settled(slowed=1.001 * slowest)
    assert not _settled(slowed=0.999 * slowest)


def test_nothing_is_final_while_a_wave_goes_on() -> None:
    assert _settled()
    assert not _settled(crossing=[np.inf, np.inf, 1.0, np.inf])
    assert not _settled(crossing=[np.inf, 1.0, np.inf, np.inf])
    assert not _settled(overlap=[0.0, -1.0, 0.1, 0.0])


def test_a_first_body_that_comes_back_slowly_enough_is_not_waited_for() -> None:
    # all energy in the motion of the first body, whose contact has felt less than that energy could make it feel
    leaves = [0.0, -2.0, 0.3, 0.3, 2.0, 0.0]
    more = {
        "mass": [np.inf, 1.0, 1.0, 1.0, 1.0, np.inf],
        "exponent": [2.0] * 5,
        "damping": [0.0] * 5,
        "power": [0.0] * 5,
        "stiffness": [0.0, 2.0, 2.0, 2.0, 0.0],
    }
    more |= {"crossing": [np.inf, 1.0, 1.0, 1.0, np.inf], "overlap": [0.0, -1.0, -1.0, -1.0, 0.0]}
    felt: dict[str, Any] = {"peak": [0.0, 0.1, 0.1, 0.1, 0.0]}
    assert _settled(velocity=leaves, **more, **felt)
    # one that catches up with those that stay may press them harder than before
    assert not _settled(velocity=[0.0, 0.4, 0.3, 0.3, 2.0, 0.0], **more, **felt)


@pytest.mark.parametrize("place", [0, -1])
def test_a_wall_a_weight_and_a_load_leave_no_chain_free(place: int) -> None:
    weight, stiffness = np.zeros((4, 2)), np.zeros((3, 2))
    stiffness[1] = 2.0
    assert is_free(weight, stiffness)
    walled, loaded = stiffness.copy(), weight.copy()
    walled[place, 1] = loaded[1 if place == 0 else -2, 0] = 1.0
    assert not is_free(weight, walled)
    assert not is_free(loaded, stiffness)
