"""Bands measured on motions made in the frequency domain, where nothing steps in time, beside the infinite chain's."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

import dem_bridge as db
from dem_bridge.errors import UnsupportedScene, UsageError
from dem_bridge.observables.bands import Bands, band_edges, measured_bands, unit_cell
from dem_bridge.physics.dispersion import dispersion
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import Cost, Trajectory

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
