"""Highest frequencies of a chain: known modes, and the bounds between which they must lie.

Bands measured on motions made in the frequency domain, where nothing steps in time, beside the infinite chain's.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

import dem_bridge as db
from dem_bridge.errors import UnsupportedScene, UsageError
from dem_bridge.observables.modes import (
    Bands,
    band_edges,
    highest_frequencies,
    highest_mode,
    measured_bands,
    tangent_stiffness,
    unit_cell,
)
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


FORCE, BETA = 10.0, 4e9
LIGHT, HEAVY = 0.01, 0.025


def chain(masses: tuple[float, ...], cells: int = 12) -> Scene:
    count = cells * len(masses)
    return Scene(
        name="bar",
        duration=1e-3,
        mass=masses * cells,
        stiffness=(BETA,) * (count - 1),
        velocity=(0.0,) * count,
        precompression=FORCE,
    )


def shaken(scene: Scene, periods: float, per_period: int = 8) -> tuple[Scene, Trajectory]:
    """Linear motion under a force on body 0 of very many frequencies, from the chain's matrix at each of them."""
    _, cell = unit_cell(scene)
    top = cell.edges[-1] / (2.0 * math.pi)
    duration = periods / top
    count = round(periods * per_period)
    time = np.linspace(0.0, duration, count + 1)
    spring = cell.spring[0]
    matrix = spring * (2.0 * np.eye(scene.n_body) - np.eye(scene.n_body, k=1) - np.eye(scene.n_body, k=-1))
    matrix[0, 0] = matrix[-1, -1] = spring
    mass = np.diag(scene.mass)
    # closer than the record resolves, so that its spectrum is full; a little loss keeps resonances finite
    tones = np.arange(0.02 * top, 1.3 * top, 0.45 / duration)
    random = np.random.default_rng(1)
    velocity = np.zeros((count + 1, scene.n_body))
    push = np.zeros(scene.n_body)
    push[0] = 1e-3
    for tone in tones.tolist():
        w = 2.0 * math.pi * tone
        moved = np.linalg.solve(matrix - (w**2) * (1.0 + 1e-3j) * mass, push)
        turn = np.exp(1j * (w * time + random.uniform(0.0, 2.0 * math.pi)))
        velocity += np.outer(turn, 1j * w * moved).real
    return replace(scene, duration=duration), trajectory(scene, time, velocity)


def trajectory(scene: Scene, time: NDArray[np.float64], velocity: NDArray[np.float64]) -> Trajectory:
    return Trajectory(
        time=time,
        displacement=np.zeros_like(velocity),
        velocity=velocity,
        contact_force=np.zeros((len(time), scene.n_contact)),
        peak_force=np.zeros(scene.n_contact),
        crossing_time=np.full(scene.n_contact, np.nan),
        cost=Cost(wall=0.0, cpu=0.0, steps=0, force_evaluations=0),
        provenance={},
    )


@pytest.mark.parametrize("masses", [(LIGHT,), (LIGHT, HEAVY), (HEAVY, LIGHT), (LIGHT, LIGHT, HEAVY)])
def test_edges_are_those_of_the_infinite_chain_within_the_resolution(masses: tuple[float, ...]) -> None:
    scene, run = shaken(chain(masses, cells=24 // len(masses)), periods=200.0)
    _, cell = unit_cell(scene)
    theory = [edge / (2.0 * math.pi) for edge in cell.edges]
    found = measured_bands(scene, run, lowest=0.5 * theory[0], highest=1.2 * theory[-1])
    assert len(found.edges) == len(theory) == 2 * len(masses) - 1
    assert found.resolution == pytest.approx(0.005 * theory[-1], rel=0.01)
    for here, there in zip(found.edges, theory, strict=True):
        assert abs(here - there) <= found.resolution


def test_the_phase_is_that_of_the_dispersion_relation() -> None:
    scene, run = shaken(chain((LIGHT,), cells=24), periods=200.0)
    theory = dispersion(mass=LIGHT, stiffness=BETA, exponent=2.5, static_force=FORCE)
    found = measured_bands(scene, run, highest=theory.cutoff / (2.0 * math.pi))
    inside = (found.frequency > 0.1 * found.frequency[-1]) & (found.frequency < 0.95 * found.frequency[-1])
    expected = 2.0 * np.arcsin(2.0 * math.pi * found.frequency[inside] / theory.cutoff)
    # d k / d omega is largest at the upper end, 2 / sqrt(1 - 0.95^2) over the cutoff; a Hann window mixes what is
    # within 2/T, twice the resolution
    assert np.max(np.abs(found.phase[inside] - expected)) < 2.0 / math.sqrt(1.0 - 0.95**2) * 0.01


def test_a_wrong_mass_in_the_chain_moves_the_edge() -> None:
    """The planted fault: what is judged is the run, not the scene's own numbers."""
    _, run = shaken(chain((1.05 * LIGHT,), cells=24), periods=200.0)
    scene = chain((LIGHT,), cells=24)
    expected = unit_cell(scene)[1].edges[0] / (2.0 * math.pi)
    [edge] = measured_bands(scene, run, highest=1.2 * expected).edges
    # 2.5 % lower, and half a per cent is what is resolved
    assert edge < 0.98 * expected


def test_a_strikers_own_contact_is_no_part_of_the_cell() -> None:
    plain = chain((LIGHT, HEAVY))
    struck = replace(
        plain,
        mass=(0.5, *plain.mass),
        stiffness=(1e9, *plain.stiffness),
        velocity=(0.0, *plain.velocity),
        exponent=2.5,
        gap=0.0,
    )
    first, cell = unit_cell(struck)
    assert first == 1
    assert cell == unit_cell(plain)[1]


@pytest.mark.parametrize(
    ("scene", "words"),
    [
        (replace(chain((LIGHT,)), precompression=0.0), "not precompressed"),
        (replace(chain((LIGHT,)), mass=tuple(0.01 + 0.001 * i for i in range(12))), "no unit cell"),
        # each contact bears the weight of all before it: no two are alike
        (replace(chain((LIGHT,)), gravity=9.81, wall_right=db.Wall(stiffness=BETA)), "no unit cell"),
    ],
)
def test_chains_without_bands_are_refused(scene: Scene, words: str) -> None:
    with pytest.raises(UnsupportedScene, match=words):
        unit_cell(scene)


def test_the_phase_is_the_arc_cosine_of_half_the_trace_and_nan_outside_of_the_band() -> None:
    trace = np.array([-2.5, -2.0, -1.0, 0.0, 1.0, 2.0, 2.5])
    bands = Bands(frequency=trace, trace=trace, transmission=trace, edges=(), resolution=1.0)
    expected = np.pi * np.array([np.nan, 1.0, 2.0 / 3.0, 0.5, 1.0 / 3.0, 0.0, np.nan])
    np.testing.assert_allclose(bands.phase, expected, rtol=4e-16, atol=4e-16)


@pytest.mark.parametrize(
    ("trace", "edges"),
    [
        ([1.0, 3.0, 1.0, -1.0, -5.0], (10.5, 11.5, 13.25)),
        ([-3.0, -1.0, 3.0], (10.5, 11.75)),
        ([3.0, 5.0, 2.5], ()),
        # one sample is on the edge: it is passed once
        ([1.0, 2.0, 3.0], (11.0,)),
        ([-3.0, -2.0, -1.0], (11.0,)),
    ],
)
def test_edges_are_where_straight_lines_between_frequencies_pass_2_or_minus_2(
    trace: list[float], edges: tuple[float, ...]
) -> None:
    assert band_edges(np.arange(10.0, 10.0 + len(trace)), np.array(trace)) == pytest.approx(edges, rel=1e-15)


@pytest.mark.parametrize(("striker", "masses"), [(False, (LIGHT,)), (True, (LIGHT, HEAVY))])
def test_motions_of_one_phase_per_body_have_its_trace_at_every_frequency(
    striker: bool, masses: tuple[float, ...]
) -> None:
    scene, random, phase, h = chain(masses, cells=8), np.random.default_rng(2), 0.7, 2.0**-10
    if striker:
        scene = replace(scene, mass=(0.5, *scene.mass), stiffness=(1e9, *scene.stiffness),
                        velocity=(0.0, *scene.velocity), exponent=2.5, gap=0.0)  # fmt: skip
    place = np.cos(phase * np.arange(scene.n_body) + 0.3)
    velocity = random.standard_normal((1024, 1)) * place
    velocity[:, 0] *= 10.0
    if not striker:
        velocity[:, 0] = velocity[:, -1] / place[-1] * place[0]
    run = trajectory(replace(scene, duration=1023 * h), h * np.arange(1024.0), velocity)
    found = measured_bands(scene, run)
    # from 20 periods in the record to three samples a period, both included
    assert found.frequency.tolist() == list(range(20, 342))
    # V[j-p] + V[j+p] = 2 cos(p phase) V[j]
    assert found.trace == pytest.approx(2.0 * math.cos(len(masses) * phase), rel=1e-12)
    own = 10.0 if striker else 1.0
    assert found.transmission == pytest.approx(abs(place[-1] / place[0]) / own, rel=1e-12)
    assert found.edges == ()
    assert found.resolution == 1.0
    low, high = 30.0, 34.0
    assert measured_bands(scene, run, lowest=low, highest=high).frequency[[0, -1]].tolist() == [low, high]
    with pytest.raises(UsageError, match=r"^4 frequencies from 30 to 33 Hz; allowed: 5 or more; take a longer run$"):
        measured_bands(scene, run, lowest=low, highest=33.0)
    assert len(measured_bands(scene, run, lowest=0.0).frequency) == len(found.frequency)
    assert len(measured_bands(scene, run, highest=1.0 / (3.0 * h)).frequency) == len(found.frequency)
    for lowest, highest in ((low, low), (None, math.nextafter(1.0 / (3.0 * h), math.inf))):
        with pytest.raises(UsageError, match="three samples a period"):
            measured_bands(scene, run, lowest=lowest, highest=highest)


@pytest.mark.parametrize(("off", "repeats"), [(0.9e-9, True), (1.1e-9, False), (-0.9e-9, True), (-1.1e-9, False)])
def test_masses_are_alike_within_a_billionth(off: float, repeats: bool) -> None:
    scene = chain((LIGHT,))
    scene = replace(scene, mass=(*scene.mass[:5], LIGHT * (1.0 + off), *scene.mass[6:]))
    if repeats:
        assert unit_cell(scene)[1].bodies == 1
    else:
        with pytest.raises(UnsupportedScene, match="no unit cell that repeats 4 times"):
            unit_cell(scene)


def test_four_cells_are_the_fewest() -> None:
    assert unit_cell(chain((LIGHT, HEAVY), cells=4))[1].bodies == 2
    with pytest.raises(UnsupportedScene, match="no unit cell that repeats 4 times"):
        unit_cell(chain((LIGHT, HEAVY), cells=3))


def test_records_that_resolve_nothing_are_refused() -> None:
    scene, run = shaken(chain((LIGHT,)), periods=50.0)
    with pytest.raises(UsageError, match="three samples a period"):
        measured_bands(scene, run, highest=1e9)
    still = trajectory(scene, run.time, np.zeros_like(run.velocity))
    with pytest.raises(UsageError, match="nothing moves"):
        measured_bands(scene, still)
