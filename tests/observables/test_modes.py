"""Highest frequencies of a chain: known modes, and the bounds between which they must lie."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import dem_bridge as db
from dem_bridge.errors import UnsupportedScene
from dem_bridge.observables.modes import highest_frequencies, highest_mode, tangent_stiffness
from dem_bridge.physics.dispersion import dispersion
from dem_bridge.scene.scene import Scene, Wall
from dem_bridge.trajectory.trajectory import Cost, Trajectory
from tests.helpers.fake_runs import free_flight


def at_rest(scene: Scene, displacement: list[float]) -> Trajectory:
    """One moment of a scene, with these displacements (m)."""
    x = np.array([displacement])
    nothing = np.zeros((1, scene.n_contact))
    return Trajectory(
        time=np.zeros(1),
        displacement=x,
        velocity=np.zeros_like(x),
        contact_force=nothing,
        peak_force=nothing[0],
        crossing_time=nothing[0],
        cost=Cost(wall=0.0, cpu=0.0, steps=0, force_evaluations=0),
        provenance={},
    )


def test_between_walls_it_is_the_highest_mode_of_the_lattice() -> None:
    wall = Wall(stiffness=4e9)
    scene = Scene(name="held", duration=1.0, mass=(1e-2,) * 5, stiffness=(4e9,) * 4, velocity=(0.0,) * 5,
                  wall_left=wall, wall_right=wall, precompression=10.0)  # fmt: skip
    pair, mode = highest_frequencies(scene, at_rest(scene, [0.0] * 5))
    lattice = dispersion(mass=1e-2, stiffness=4e9, exponent=2.5, static_force=10.0)
    # both are sums of a few products: some last digits
    assert mode == pytest.approx(lattice.fixed_modes(5)[-1], rel=1e-12)
    # a wall is of infinite mass, so the fastest pair is within the chain
    assert pair == pytest.approx(math.sqrt(2.0 * lattice.tangent_stiffness / 1e-2), rel=1e-12)


@given(
    st.lists(st.tuples(st.floats(-3, 3), st.floats(-3, 3), st.floats(-2, 2)), min_size=1, max_size=8),
    st.booleans(),
    st.booleans(),
)
def test_a_mode_is_between_the_fastest_pair_and_sqrt_2_times_that(
    drawn: list[tuple[float, float, float]], left: bool, right: bool
) -> None:
    mass = (*(10.0**m for m, _, _ in drawn), 1.0)
    overlap = [10.0**d for _, _, d in drawn]
    wall = Wall(stiffness=1.0, gap=-0.5)
    scene = Scene(
        name="any", duration=1.0, mass=mass, stiffness=tuple(10.0**k for _, k, _ in drawn), velocity=(0.0,) * len(mass),
        gap=tuple(-d for d in overlap), wall_left=wall if left else None, wall_right=wall if right else None,
    )  # fmt: skip
    pair, mode = highest_frequencies(scene, at_rest(scene, [0.0] * len(mass)))
    assert pair * (1.0 - 1e-12) <= mode <= math.sqrt(2.0) * pair * (1.0 + 1e-12)
    # the same from the bodies' side: M^-1 K, which has the same eigenvalues beside zeros
    k, c = tangent_stiffness(scene, -scene.contacts.gap[None, :])[0], scene.contacts
    matrix = np.zeros((len(mass) + 1,) * 2)
    for one, i, j in zip(k, c.left, c.right, strict=True):
        matrix[[i, j, i, j], [i, j, j, i]] += np.array([one, one, -one, -one])
    root = np.sqrt(np.array(mass))
    whole = matrix[:-1, :-1] / root[:, None] / root[None, :]
    assert mode == pytest.approx(math.sqrt(np.linalg.eigvalsh(whole)[-1]), rel=1e-9)


def test_a_light_body_between_two_heavy_ones_has_almost_sqrt_2() -> None:
    scene = Scene(
        name="light", duration=1.0, mass=(1.0, 1e-6, 1.0), stiffness=(1.0, 1.0), velocity=(0.0,) * 3, gap=-1.0
    )
    pair, mode = highest_frequencies(scene, at_rest(scene, [0.0] * 3))
    # sqrt(2k/m) over sqrt(k/m) but for parts of the mass ratio
    assert mode / pair == pytest.approx(math.sqrt(2.0), rel=2e-6)


def test_a_law_of_its_own_has_the_slope_of_the_power_that_it_is() -> None:
    plain = db.load_scene("decelerating-40")
    overlap = np.array([[0.0, 1e-6, 1e-5]])
    scene = Scene(name="law", duration=1e-4, mass=(1e-2,) * 4, stiffness=(4e9,) * 3, velocity=(0.8, 0.0, 0.0, 0.0))
    law = Scene(name="law", duration=1e-4, mass=scene.mass, stiffness=scene.stiffness, velocity=scene.velocity,
                law=lambda d: 4e9 * d * np.sqrt(d))  # fmt: skip
    # a centred difference over 1e-4 of the overlap errs by a part of its square
    np.testing.assert_allclose(tangent_stiffness(law, overlap), tangent_stiffness(scene, overlap), rtol=1e-8)
    assert plain.law is None


def test_the_slope_of_a_law_is_a_centred_difference_over_a_ten_thousandth() -> None:
    cube = Scene(name="law", duration=1e-4, mass=(1.0,) * 3, stiffness=(1.0,) * 2, velocity=(1.0, 0.0, 0.0),
                 law=lambda d: d**3)  # fmt: skip
    # ((1 + s)^3 - (1 - s)^3)/(2 s) = 3 + s^2; round-off is 2e-16/s
    found = tangent_stiffness(cube, np.array([[0.5, -0.1], [2.0, 0.0]]))
    expected = (3.0 + 1e-8) * np.array([[0.25, 0.0], [4.0, 0.0]])
    np.testing.assert_allclose(found, expected, rtol=2e-10, atol=0.0)


def test_open_contacts_have_no_stiffness_and_springs_theirs() -> None:
    scene = Scene(name="any", duration=1.0, mass=(1.0,) * 4, stiffness=(3.0, 5.0, 7.0), exponent=(2.0, 3.0, 2.5),
                  velocity=(0.0,) * 4)  # fmt: skip
    overlap = np.array([[0.25, 0.25, 0.25], [0.0, 0.0, 0.0], [-1.0, -1.0, -1.0]])
    # (n - 1) beta overlap^(n - 2)
    assert tangent_stiffness(scene, overlap).tolist() == [[3.0, 2.5, 5.25], [0.0] * 3, [0.0] * 3]


def test_the_highest_mode_may_be_at_another_moment_than_the_fastest_pair() -> None:
    scene = Scene(name="two", duration=1.0, mass=(1.0,) * 3, stiffness=(1.0, 1.0), exponent=3.0, velocity=(0.0,) * 3)
    # stiffnesses 2 d: one contact of 0.5 N/m alone, then two of 0.4 N/m, whose highest mode has 3 k/m
    rows = [[0.25, 0.0, 1.0], [0.4, 0.2, 0.0], [0.0, 0.0, 0.0]]
    run = free_flight(samples=2, displacement=np.array(rows), velocity=np.zeros((3, 3)))
    assert highest_frequencies(scene, run) == pytest.approx((1.0, math.sqrt(1.2)), rel=1e-12)
    still = free_flight(samples=0, displacement=np.zeros((1, 3)), velocity=np.zeros((1, 3)))
    assert highest_frequencies(scene, still) == (0.0, 0.0)
    single = Scene(name="one", duration=1.0, mass=(2.0,), stiffness=(), velocity=(0.0,), exponent=2.0,
                   wall_right=Wall(stiffness=8.0, gap=-1.0, exponent=2.0))  # fmt: skip
    assert highest_frequencies(single, at_rest(single, [0.0])) == pytest.approx((2.0, 2.0), rel=1e-15)


def test_where_the_slope_is_infinite_at_touch_there_is_no_highest_frequency() -> None:
    scene = Scene(name="sharp", duration=1.0, mass=(1.0, 1.0), stiffness=(1.0,), velocity=(1.0, 0.0), exponent=1.5)
    with pytest.raises(UnsupportedScene, match=r"n = 1\.5.*allowed: n >= 2"):
        highest_frequencies(scene, at_rest(scene, [0.0, 0.0]))


def test_the_highest_mode_follows_from_displacements_alone() -> None:
    scene = db.Scene(name="pair", duration=1e-4, mass=(8e-3, 1e-2), stiffness=(4e9,), velocity=(0.8, 0.0))
    squared = 1.5 * 4e9 * math.sqrt(1e-5) * (1 / 8e-3 + 1 / 1e-2)
    pressed = np.array([[0.0, 0.0], [1e-5, 0.0], [0.0, 1e-5]])
    assert highest_mode(scene, pressed) == pytest.approx(math.sqrt(squared))
    run = db.solve(scene, backend="reference")
    assert highest_mode(scene, run.displacement) == highest_frequencies(scene, run)[1]
