"""Chains in lanes against mechanics: normal modes, conserved quantities, similarity, and what tables say of them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.linalg import expm

from dem_bridge.ensembles.draw import Chains, Variation
from dem_bridge.ensembles.result import Ensemble
from dem_bridge.ensembles.solve import OBSERVABLES, solve_chains
from dem_bridge.scene.scene import Scene, Wall
from tests.helpers.strategies import examples

Floats = NDArray[np.float64]
EPS = float(np.finfo(float).eps)
#: springs that stay pressed, by 200 N at the start
SPRINGS = Scene(
    name="springs", duration=2e-3, mass=(0.01, 0.02, 0.015, 0.012), stiffness=(2e6, 1e6, 3e6), exponent=2.0,
    gap=(-1e-4, -2e-4, -2e-4 / 3.0), velocity=(0.2, 0.0, -0.1, 0.0), gravity=9.81,
    wall_left=Wall(stiffness=2e6, exponent=2.0, gap=-1e-4), wall_right=Wall(stiffness=1e6, exponent=2.0, gap=-2e-4),
)  # fmt: skip
SAMPLES = 20
#: five bodies in a row, two of which move
FREE = Scene(
    name="free", duration=2e-4, mass=(0.01, 0.02, 0.015, 0.01, 0.03), stiffness=(2e10, 1e10, 3e10, 2e10),
    velocity=(0.8, 0.0, 0.0, -0.1, 0.0),
)  # fmt: skip


def _chains(scene: Scene, count: int = 9, **vary: float) -> Chains:
    return Variation(scene=scene, vary=vary or {"mass": 0.1, "stiffness": 0.1}, seed=7).block(0, count)


def _by_modes(scene: Scene, chains: Chains, nth: int) -> Floats:
    """Return the velocities at samples of a chain of springs between two walls, from the matrix exponential."""
    mass, k, gap = chains.mass[nth], chains.stiffness[nth], chains.gap[nth]
    n = len(mass)
    # overlap of contact c: -gap + signs[c] @ x; walls are last
    signs = np.zeros((n + 1, n))
    for contact in range(n - 1):
        signs[contact, [contact, contact + 1]] = 1.0, -1.0
    signs[n - 1, 0], signs[n, n - 1] = -1.0, 1.0
    matrix = np.zeros((2 * n + 1, 2 * n + 1))
    matrix[:n, n : 2 * n] = np.eye(n)
    matrix[n : 2 * n, :n] = -(signs.T * k @ signs) / mass[:, None]
    matrix[n : 2 * n, -1] = (signs.T @ (k * gap)) / mass + scene.gravity
    states = [np.concatenate([np.zeros(n), chains.velocity[nth], [1.0]])]
    step = expm(matrix * scene.duration / SAMPLES)
    for _ in range(SAMPLES):
        states.append(step @ states[-1])
    overlaps = np.array(states)[:, :n] @ signs.T - gap
    assert np.min(overlaps) > 1e-5, "a spring opens, so that the chain is not linear"
    return np.array(states)[:, n : 2 * n]


def test_a_chain_of_springs_moves_in_its_normal_modes_with_the_order_of_the_method() -> None:
    chains = _chains(SPRINGS, mass=0.1, stiffness=0.1, velocity=0.1)
    errors = []
    for steps in (400, 800):
        velocity = solve_chains(SPRINGS, chains, steps, SAMPLES)["velocity"]
        exact = np.array([_by_modes(SPRINGS, chains, nth) for nth in range(len(chains))])
        errors.append(float(np.max(np.abs(velocity - exact)) / np.max(np.abs(exact))))
    assert errors[0] < 1e-5
    # order 4: a sixteenth, but for terms of higher order
    assert 14.0 < errors[0] / errors[1] < 18.0


@examples(20)
@given(
    seed=st.integers(0, 2**32 - 1),
    exponent=st.sampled_from([1.5, 2.0, 2.2, 2.5, 3.0]),
    bodies=st.integers(2, 7),
)
def test_momentum_is_conserved_to_round_off_and_energy_is_never_gained(seed: int, exponent: float, bodies: int) -> None:
    random = np.random.default_rng(seed)
    mass = random.uniform(0.005, 0.05, bodies)
    # at an overlap of 5 um every contact has about the force of the paper's chains
    stiffness = random.uniform(0.5, 2.0, bodies - 1) * 2e10 * 5e-6 ** (2.5 - exponent)
    scene = replace(
        FREE, mass=tuple(mass.tolist()), stiffness=tuple(stiffness.tolist()), exponent=exponent,
        gap=tuple(random.choice([0.0, 1e-6], bodies - 1).tolist()), velocity=tuple(random.normal(0.0, 0.5, bodies)),
    )  # fmt: skip
    steps = 3000
    chains = _chains(scene)
    velocity = solve_chains(scene, chains, steps, 10)["velocity"]
    carried = chains.mass[:, None, :] * velocity
    size = np.sum(np.abs(carried), axis=2).max()
    # each of the steps rounds off the kicks of six stages on both sides of a contact
    assert np.ptp(carried.sum(axis=2), axis=1) == pytest.approx(np.zeros(len(chains)), abs=12.0 * EPS * steps * size)
    energy = 0.5 * np.sum(carried * velocity, axis=2)
    # no contact is compressed at the start; order n at touch, from the slowest of these contacts
    assert np.all(energy <= energy[:, :1] * (1.0 + 1e-4))


def test_equal_bodies_exchange_their_velocities_whatever_their_law() -> None:
    for exponent, stiffness in ((2.0, 1e6), (2.5, 2e10), (3.0, 4e13)):
        scene = replace(
            FREE,
            mass=(0.02, 0.02),
            stiffness=(stiffness,),
            gap=0.0,
            exponent=exponent,
            velocity=(0.8, -0.3),
            duration=1e-3,
        )
        velocity = solve_chains(scene, _chains(scene, stiffness=0.1), 4000, 2)["velocity"]
        np.testing.assert_allclose(velocity[:, -1], np.tile([-0.3, 0.8], (9, 1)), rtol=0.0, atol=1e-7)


def _assert_similar(scene: Scene, chains: Chains, other: Scene, others: Chains, **factors: float) -> None:
    """Assert that two ensembles differ by these powers of two and by nothing else, to the last bit."""
    first, second = solve_chains(scene, chains, 600, 10), solve_chains(other, others, 600, 10)
    for name, values in first.items():
        kind = "time" if name in ("arrival_at_end", "crossing_time", "residence_time") else name.removeprefix("peak_")
        np.testing.assert_array_equal(second[name], values * factors[kind], err_msg=name)


def test_faster_chains_are_similar_to_the_last_bit() -> None:
    # n = 2.5: 32 times the speed, 16 times the overlap, 64 times the force in half the time
    chains = _chains(FREE)
    fast = replace(FREE, velocity=tuple(32.0 * v for v in FREE.velocity), duration=FREE.duration / 2.0)
    others = replace(chains, velocity=32.0 * chains.velocity)
    _assert_similar(FREE, chains, fast, others, time=0.5, force=64.0, velocity=32.0)


def test_heavier_and_stiffer_chains_are_similar_to_the_last_bit() -> None:
    # as much heavier as stiffer: the same motion; 4 times as stiff and 16 times as heavy: half the speed in double time
    chains = _chains(SPRINGS)
    for stiffer, heavier in ((8.0, 8.0), (4.0, 16.0)):
        slower = (heavier / stiffer) ** 0.5
        other = replace(
            SPRINGS, mass=tuple(heavier * m for m in SPRINGS.mass), duration=slower * SPRINGS.duration,
            stiffness=tuple(stiffer * k for k in SPRINGS.stiffness), gravity=SPRINGS.gravity / slower**2,
            velocity=tuple(v / slower for v in SPRINGS.velocity),
            wall_left=Wall(stiffness=stiffer * 2e6, exponent=2.0, gap=-1e-4),
            wall_right=Wall(stiffness=stiffer * 1e6, exponent=2.0, gap=-2e-4),
        )  # fmt: skip
        others = replace(
            chains, mass=heavier * chains.mass, stiffness=stiffer * chains.stiffness, velocity=chains.velocity / slower
        )
        _assert_similar(SPRINGS, chains, other, others, time=slower, force=stiffer, velocity=1.0 / slower)


def test_a_chain_does_not_depend_on_its_lane_or_on_its_neighbours() -> None:
    chains = _chains(FREE, count=11)
    together = solve_chains(FREE, chains, 500, 5)
    order = np.random.default_rng(0).permutation(11)
    mixed, alone = solve_chains(FREE, chains.rows(order), 500, 5), solve_chains(FREE, chains.rows(order[:1]), 500, 5)
    for name, values in together.items():
        np.testing.assert_array_equal(mixed[name], values[order], err_msg=name)
        np.testing.assert_array_equal(alone[name], values[order[:1]], err_msg=name)


# what tables and texts say


@pytest.fixture(scope="module")
def chains() -> Ensemble:
    variation = Variation(scene=FREE, vary={"mass": 0.1, "gap": 1e-7}, seed=5)
    values = solve_chains(FREE, variation.block(0, 40), 400, 3)
    names = ("chain", "code", "observable", "difference", "uncertainty", "failure")
    nothing: Any = pd.DataFrame({name: [] for name in names})
    return Ensemble(variation=variation, values=values, accuracy=1e-3, steps=400, checked=nothing)


def test_every_value_of_the_long_table_is_that_of_its_chain_and_place(chains: Ensemble) -> None:
    table = chains.long_table
    rows = list(zip(table["chain"], table["observable"], table["place"], table["value"], strict=True))
    assert len(rows) == sum(chains.values[name].size for name in OBSERVABLES)
    for chain, name, place, value in rows:
        values = chains.values[name]
        assert (values.ndim == 1) == (place == -1)
        expected = values[chain] if place == -1 else values[chain, place]
        assert value == expected or (np.isnan(value) and np.isnan(expected))


def test_frames_and_datasets_name_the_scene_the_seed_and_what_varies(chains: Ensemble) -> None:
    expected = {"scene": "free", "scene_hash": FREE.content_hash, "seed": 5, "vary_mass": 0.1, "vary_gap": 1e-7}
    units = {name: chains.to_xarray()[name].attrs["units"] for name in OBSERVABLES}
    assert units == {name: "s" for name in OBSERVABLES if "peak" not in name} | {
        "peak_velocity": "m/s", "peak_force": "N",
    }  # fmt: skip
    assert dict(chains.to_xarray().attrs) == expected
    for frame in (chains.table, chains.long_table):
        assert frame.attrs == expected | {"units": units}
    np.testing.assert_array_equal(chains.table["residence_time_1"], chains.values["residence_time"][:, 1])


def test_texts_have_the_median_between_the_5_and_95_percent_quantiles(chains: Ensemble) -> None:
    arrival = 1e6 * chains.values["arrival_at_end"]
    low, median, high = np.quantile(arrival, [0.05, 0.5, 0.95])
    shown = f"{median:.4g} µs ({low:.4g} µs to {high:.4g} µs)"
    assert shown in " ".join(str(chains).split())
    assert f"{median:.4g} µs" in chains._repr_html_()
