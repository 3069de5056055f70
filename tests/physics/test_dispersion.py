"""Small oscillations: eigenvalues of the dynamical matrix, differences of the force law, and a chain that rings."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import dem_bridge as db
from dem_bridge.physics.contact_law import force
from dem_bridge.physics.dispersion import Cell, Dispersion, dispersion
from dem_bridge.scene.scene import Scene, Wall
from tests.helpers.strategies import log_uniform

masses = log_uniform(1e-4, 1e2)
exponents = st.floats(1.2, 5.0)


def _chain(mass: float | tuple[float, float], n: float = 2.5, load: float = 10.0) -> Dispersion:
    return dispersion(mass=mass, stiffness=4e9, exponent=n, static_force=load)


@given(n=exponents, load=log_uniform(1e-2, 1e4))
def test_the_tangent_stiffness_is_the_slope_of_the_force(n: float, load: float) -> None:
    chain = _chain(0.01, n, load)
    d, h = chain.static_overlap, 1e-3 * chain.static_overlap
    assert float(force(d, 4e9, n)) == pytest.approx(load, rel=1e-13)
    f = [float(force(d + k * h, 4e9, n)) for k in (-2, -1, 1, 2)]
    slope = (f[0] - 8.0 * f[1] + 8.0 * f[2] - f[3]) / (12.0 * h)
    # order 4: h^4 f^(5)/30 <= 1e-12 * 24/30; round-off 1e-16/1e-3
    assert chain.tangent_stiffness == pytest.approx(slope, rel=2e-11)


def _bloch(chain: Dispersion, k: float) -> np.ndarray:
    """Frequencies of the unit cell's 2 x 2 dynamical matrix, phase 2 k per cell: a second writing."""
    spring, (m1, m2) = chain.tangent_stiffness, chain.masses
    hop = spring * (1.0 + np.exp(-2j * k)) / math.sqrt(m1 * m2)
    matrix = np.array([[2.0 * spring / m1, -hop], [-np.conj(hop), 2.0 * spring / m2]])
    return np.sqrt(np.abs(np.linalg.eigvalsh(matrix)))


@given(m1=masses, m2=masses, k=st.floats(1e-3, 0.5 * math.pi), same=st.booleans())
def test_both_branches_are_eigenvalues_of_the_cells_matrix(m1: float, m2: float, k: float, same: bool) -> None:
    chain = _chain((m1, m1 if same else m2))
    acoustic, optical = _bloch(chain, k)
    # eigenvalues are good to an ulp of the largest; the root of a small one loses by the ratio of their squares
    lost = 1e-14 * chain.cutoff**2
    assert chain.frequency(k) ** 2 == pytest.approx(acoustic**2, abs=lost)
    assert chain.frequency(k, optical=True) ** 2 == pytest.approx(optical**2, abs=lost)


@given(m=masses, k=st.floats(1e-4, math.pi))
def test_equal_masses_have_one_branch_unfolded(m: float, k: float) -> None:
    chain = _chain(m)
    assert chain.frequency(k) == pytest.approx(
        2.0 * math.sqrt(chain.tangent_stiffness / m) * math.sin(k / 2), rel=1e-14
    )
    if k < 0.5 * math.pi:
        assert chain.frequency(k, optical=True) == pytest.approx(chain.frequency(math.pi - k), rel=1e-12)
    assert chain.band_gap[0] == chain.band_gap[1] == pytest.approx(chain.frequency(0.5 * math.pi), rel=1e-14)
    assert chain.cutoff == pytest.approx(chain.frequency(math.pi), rel=1e-14)


def test_a_folded_zone_ends_at_half_of_the_whole_one() -> None:
    chain = _chain(0.01)
    # of a cell of two equal masses the optical branch is the other half of the acoustic one, and is given once
    assert chain.frequency(2.0) == pytest.approx(chain.frequency(math.pi - 2.0, optical=True), rel=1e-14)
    with pytest.raises(ValueError, match="allowed: 0 to pi/2"):
        chain.frequency(2.0, optical=True)
    with pytest.raises(ValueError, match="allowed: 0 to pi/2"):
        _chain((0.01, 0.02)).frequency(2.0)


@given(m1=masses, m2=masses)
def test_the_edges_of_the_branches_are_the_cutoff_and_the_gap(m1: float, m2: float) -> None:
    chain = _chain((m1, m2))
    if m1 == m2:
        return
    edge = 0.5 * math.pi
    # pi/2 is no double: cos is 6e-17 there, which masses equal to less than that would see
    assert chain.frequency(edge) == pytest.approx(chain.band_gap[0], rel=1e-14)
    assert chain.frequency(edge, optical=True) == pytest.approx(chain.band_gap[1], rel=1e-14)
    assert chain.frequency(0.0, optical=True) == pytest.approx(chain.cutoff, rel=1e-14)
    assert chain.frequency(0.0) == 0.0


@given(m1=masses, m2=masses, k=st.floats(0.05, 1.4), same=st.booleans())
def test_the_group_velocity_is_the_slope_of_the_branch(m1: float, m2: float, k: float, same: bool) -> None:
    chain, h = _chain((m1, m1 if same else m2)), 1e-3
    w = [chain.frequency(k + j * h) for j in (-2, -1, 1, 2)]
    slope = (w[0] - 8.0 * w[1] + 8.0 * w[2] - w[3]) / (12.0 * h)
    # order 4: h^4 = 1e-12 times the fifth derivative, large near the edge for nearly equal masses; away from it < 1e4
    assert chain.group_velocity(k) == pytest.approx(slope, abs=2e-8 * chain.sound_speed)


@given(m1=masses, m2=masses)
def test_long_waves_travel_at_the_sound_speed(m1: float, m2: float) -> None:
    chain = _chain((m1, m2))
    assert chain.group_velocity(0.0) == chain.sound_speed
    # corrections are of order k^2
    assert chain.frequency(1e-5) / 1e-5 == pytest.approx(chain.sound_speed, rel=1e-9)
    assert chain.group_velocity(1e-5) == pytest.approx(chain.sound_speed, rel=1e-9)


@pytest.mark.parametrize("count", [1, 2, 7, 40])
def test_modes_between_walls_are_eigenvalues_of_the_chains_matrix(count: int) -> None:
    chain = _chain(0.03, n=3.0)
    matrix = 2.0 * np.eye(count) - np.eye(count, k=1) - np.eye(count, k=-1)
    omega = np.sqrt(np.linalg.eigvalsh(matrix) * chain.tangent_stiffness / 0.03)
    # an ulp of the largest eigenvalue, seen by the smallest
    assert chain.fixed_modes(count) == pytest.approx(omega.tolist(), rel=1e-15 * (count + 1) ** 2 * 4)


def test_a_pressed_chain_rings_in_its_mode() -> None:
    count, mode, load, m, beta = 5, 2, 10.0, 0.01, 4e9
    chain = _chain(m, load=load)
    omega = chain.fixed_modes(count)[mode - 1]
    shape = np.sin(mode * math.pi / (count + 1) * np.arange(1, count + 1))
    size = 1e-5 * chain.static_overlap
    pressed = Wall(stiffness=beta, gap=-chain.static_overlap)
    scene = Scene(
        name="ringing", duration=2.0 * math.pi / omega, mass=(m,) * count, stiffness=(beta,) * (count - 1),
        gap=-chain.static_overlap, wall_left=pressed, wall_right=pressed,
        velocity=tuple((size * omega * shape).tolist()), samples=64,
    )  # fmt: skip
    run = db.solve(scene, backend="scipy", uncertainty=False)
    expected = size * np.sin(omega * run.time)[:, None] * shape
    # what is left out is second order in size / delta0 = 1e-5; the integrator's own error is 1e-11 of delta0
    assert np.max(np.abs(run.displacement - expected)) < 3e-5 * size


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ({"mass": 0.0}, r"^mass = 0.0; allowed: a finite number > 0 \(kg\)"),
        ({"mass": (1.0, 2.0, 3.0)}, r"^mass = \(1.0, 2.0, 3.0\); allowed: one number > 0 \(kg\), or two"),
        ({"stiffness": -1.0}, r"^stiffness = -1.0; allowed"),
        ({"exponent": 1.0}, r"^exponent = 1.0; allowed: a finite number > 1"),
        ({"static_force": 0.0}, r"^static_force = 0.0; allowed: .*; a chain without static force"),
    ],
)
def test_what_is_outside_is_refused_in_one_line(wrong: dict[str, object], says: str) -> None:
    good: dict[str, object] = {"mass": 1.0, "stiffness": 1.0, "exponent": 2.5, "static_force": 1.0}
    with pytest.raises(ValueError, match=says):
        dispersion(**(good | wrong))  # type: ignore[arg-type]


@pytest.mark.parametrize(("mass", "k", "limit"), [(1.0, 3.2, "0 to pi$"), ((1.0, 2.0), 1.6, "pi/2"), (1.0, -0.1, "pi")])
def test_wave_numbers_beyond_the_zone_are_refused(mass: float | tuple[float, float], k: float, limit: str) -> None:
    chain = dispersion(mass=mass, stiffness=1.0, exponent=2.5, static_force=1.0)
    for asked in (chain.frequency, chain.group_velocity):
        with pytest.raises(ValueError, match=rf"wave_number = .* rad per grain; allowed: .*{limit}"):
            asked(k)


def test_modes_need_bodies_of_one_kind() -> None:
    with pytest.raises(ValueError, match="allowed: equal masses"):
        _chain((1.0, 2.0)).fixed_modes(3)
    with pytest.raises(ValueError, match="count = 0; allowed: a whole number >= 1"):
        _chain(1.0).fixed_modes(0)


@given(m1=masses, m2=masses, k=st.floats(0.0, math.pi))
def test_a_cell_of_two_has_the_branches_of_two_masses(m1: float, m2: float, k: float) -> None:
    chain = _chain((m1, m2))
    cell = Cell(mass=(m1, m2), spring=(chain.tangent_stiffness,) * 2)
    low, high = cell.frequencies(k)
    # k per cell is two contacts; eigenvalues are good to an ulp of the largest, which the root of a small one sees
    if m1 != m2:
        assert low**2 == pytest.approx(chain.frequency(0.5 * k) ** 2, abs=1e-14 * chain.cutoff**2)
        assert high**2 == pytest.approx(chain.frequency(0.5 * k, optical=True) ** 2, rel=1e-13)


@given(
    cell=st.lists(st.tuples(masses, st.floats(1e5, 1e7)), min_size=1, max_size=5),
    k=st.floats(0.05, math.pi - 0.05),
)
def test_frequencies_of_a_cell_have_the_trace_of_its_transfer_matrix(cell: list[tuple[float, float]], k: float) -> None:
    mass, spring = zip(*cell, strict=True)
    found = Cell(mass=mass, spring=spring)
    for omega in found.frequencies(k):
        product = np.eye(2)
        for m, stiffness in cell:
            # (displacement, force) behind the body and its spring from those before it
            product = np.array([[1.0 - omega**2 * m / stiffness, 1.0 / stiffness], [-(omega**2) * m, 1.0]]) @ product
        size = float(np.max(np.abs(product)))
        # omega^2 is good to an ulp of the largest of them, the trace is a polynomial of it
        largest = max(found.frequencies(k)) ** 2
        slope = sum(m / stiffness for m, stiffness in cell) * largest * max(1.0, size)
        assert np.trace(product) == pytest.approx(2.0 * math.cos(k), abs=1e-12 * (1.0 + slope) ** len(cell))


def test_bands_that_meet_have_no_edge_there() -> None:
    one, two = Cell(mass=(0.01,), spring=(1e6,)), Cell(mass=(0.01, 0.01), spring=(1e6, 1e6))
    assert two.edges == pytest.approx(one.edges, rel=1e-12)


@pytest.mark.parametrize(
    ("mass", "spring", "words"),
    [
        ((), (), "one spring per mass"),
        ((0.01,), (1e6, 1e6), "one spring per mass"),
        ((0.0,), (1e6,), "mass"),
        ((0.01,), (-1.0,), "spring"),
    ],
)
def test_what_is_no_cell_is_refused(mass: tuple[float, ...], spring: tuple[float, ...], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        Cell(mass=mass, spring=spring)


@pytest.mark.parametrize(("ratio", "gaps"), [(1.0, 0), (1.0 + 1e-4, 1), (1.0 + 1e-7, 1)])
def test_a_narrow_gap_has_two_edges_and_bands_that_meet_none(ratio: float, gaps: int) -> None:
    spring = 8e6
    edges = Cell(mass=(0.01, 0.01 * ratio), spring=(spring, spring)).edges
    assert len(edges) == 1 + 2 * gaps
    if gaps:
        assert edges[:2] == pytest.approx([math.sqrt(2 * spring / (0.01 * ratio)), math.sqrt(2 * spring / 0.01)])
        # the gap itself is resolved
        assert edges[1] / edges[0] - 1.0 == pytest.approx(0.5 * (ratio - 1.0), rel=1e-3)
