"""Draws: every seed has chains of its own, blocks fill the space, and each number varies as its key says."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import combinations
from statistics import NormalDist

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.special import ndtr
from scipy.stats import halfnorm, kstest

import dem_bridge as db
from dem_bridge.ensembles.draw import BLOCK, LEAST_ANGLE, SAMPLERS, Variation
from dem_bridge.ensembles.run import run_ensemble
from dem_bridge.ensembles.sensitivity import sobol_indices
from dem_bridge.errors import UnsupportedScene, UsageError
from dem_bridge.observables.registry import OBSERVABLES as REGISTRY
from dem_bridge.physics.hertz import crossed_cylinders
from dem_bridge.scene.geometry import Geometry
from dem_bridge.scene.scene import Scene, Wall

#: a wall at each end, and bodies that move and that rest
SCENE = Scene(
    name="row",
    duration=1e-4,
    mass=(0.01, 0.02, 0.015),
    stiffness=(2e10, 1e10),
    gap=(1e-6, 0.0),
    velocity=(0.8, 0.0, -0.1),
    wall_left=Wall(stiffness=2e10, gap=1e-5),
    wall_right=Wall(stiffness=1e10, gap=2e-6),
)
TWO = Scene(name="two", duration=1e-4, mass=(0.01, 0.02), stiffness=(2e10,), velocity=(0.8, 0.0))


def _deviates(seed: int, sampler: str, nth: int = 0) -> NDArray[np.float64]:
    """Return the normal numbers by which a block's masses differ from those of the scene."""
    block = Variation(scene=SCENE, vary={"mass": 0.1}, seed=seed, sampler=sampler).block(nth)
    return np.asarray((block.mass / np.array(SCENE.mass) - 1.0) / 0.1)


@pytest.mark.parametrize("sampler", SAMPLERS)
def test_each_seed_and_each_block_has_chains_of_its_own(sampler: str) -> None:
    assert np.array_equal(_deviates(3, sampler), _deviates(3, sampler))
    draws = [_deviates(seed, sampler, nth).ravel() for seed in range(3) for nth in range(2)]
    for one, other in combinations(draws, 2):
        # of 1536 normal numbers some differ by more than a standard deviation
        assert np.max(np.abs(one - other)) > 1.0
        if sampler == "random":  # correlations of independent draws are 0 within 1/sqrt(1536)
            assert abs(np.corrcoef(one, other)[0, 1]) < 5.0 / np.sqrt(len(one))


def test_blocks_of_the_sobol_sequence_together_fill_every_interval_once() -> None:
    # the first 2^m points of a scrambled Sobol' sequence have one in each of 2^m intervals, in every dimension
    blocks = np.concatenate([_deviates(5, "sobol", nth) for nth in range(4)])
    # points are multiples of 2^-30: a millionth of an interval keeps one at the edge of its interval in it
    places = np.floor(ndtr(blocks) * len(blocks) + 1e-6)
    for column in np.sort(places, axis=0).T:
        assert np.array_equal(column, np.arange(4 * BLOCK))


def test_each_key_varies_its_numbers_and_no_others() -> None:
    intended = Variation(scene=SCENE, vary={"mass": 0.0}).block(0, 1)
    # stiffnesses and gaps of walls last; a body at rest has no velocity that could vary
    assert intended.stiffness.tolist() == [[2e10, 1e10, 2e10, 1e10]]
    assert intended.gap.tolist() == [[1e-6, 0.0, 1e-5, 2e-6]]
    counts = {"mass": 3, "stiffness": 4, "velocity": 2, "gap": 4}
    for key, count in counts.items():
        sigma = 3e-7 if key == "gap" else 0.05
        variation = Variation(scene=SCENE, vary={key: sigma}, seed=2)
        assert [kind for kind, _ in variation.columns] == [key] * count
        block = variation.block(0)
        assert len(block) == BLOCK
        for name in counts:
            off = getattr(block, name) - getattr(intended, name)
            assert np.sum(np.any(off != 0.0, axis=0)) == (count if name == key else 0)
            if name == key:
                moved = off[:, np.any(off != 0.0, axis=0)]
                still = getattr(intended, name)[0][np.any(off != 0.0, axis=0)]
                scaled = (moved / sigma if key == "gap" else moved / still / sigma).T
                law = halfnorm.cdf if key == "gap" else "norm"
                assert min(kstest(column, law).pvalue for column in scaled) > 1e-4


def test_the_scene_of_a_chain_has_the_numbers_of_its_row() -> None:
    chains = Variation(scene=SCENE, vary={"mass": 0.1, "stiffness": 0.1, "gap": 1e-6, "velocity": 0.1}).block(0, 5)
    scene = chains.rows(np.array([4, 1])).scene(SCENE, 1)
    assert scene.mass == tuple(chains.mass[1])
    assert scene.velocity == tuple(chains.velocity[1])
    left, right = scene.wall_left, scene.wall_right
    assert left is not None
    assert right is not None
    assert (*scene.stiffness, left.stiffness, right.stiffness) == tuple(chains.stiffness[1])
    assert [*np.atleast_1d(scene.gap).tolist(), left.gap, right.gap] == chains.gap[1].tolist()
    assert scene.name == "row.chain-1"
    assert scene.duration == SCENE.duration


def test_angles_are_reflected_at_both_ends_of_their_range() -> None:
    scene = db.load_scene("decelerating-40")
    geometry = scene.geometry
    assert geometry is not None
    angle, contact = max((angle, k) for k, angle in enumerate(geometry.angle) if angle is not None)
    body = geometry.bodies[contact]
    variation = Variation(scene=scene, vary={"angle": 45.0}, seed=1)
    # a uniform number of 0.5 is no change; others are quantiles of the angle's deviation
    column = variation.columns.index(("angle", contact))
    uniform = np.full((9, len(variation.columns)), 0.5)
    uniform[:, column] = np.linspace(0.01, 0.99, 9)
    ratio = variation.chains(uniform).stiffness[:, contact] / scene.stiffness[contact]

    def at(degrees: float) -> float:
        return crossed_cylinders(angle=degrees, radius=body.radius, law=geometry.law, **body.material.elastic).stiffness

    for found, part in zip(ratio, uniform[:, column], strict=True):
        turned = (angle + NormalDist(0.0, 45.0).inv_cdf(part)) % 180.0
        assert found == pytest.approx(at(max(min(turned, 180.0 - turned), LEAST_ANGLE)) / at(angle), rel=1e-9)


def test_the_largest_spread_and_seed_0_are_allowed() -> None:
    Variation(scene=SCENE, vary={"mass": 0.15, "gap": 0.0}, seed=0)
    with pytest.raises(UsageError, match=r"vary\['mass'\] = 0\.1501; allowed: a number >= 0 and at most 0\.15"):
        Variation(scene=SCENE, vary={"mass": 0.1501})
    with pytest.raises(UsageError, match=r"seed = True; allowed: a whole number >= 0"):
        Variation(scene=SCENE, vary={"mass": 0.1}, seed=True)
    with pytest.raises(UsageError, match=r"vary\['gap'\] = inf; allowed: a number >= 0 \(standard deviation"):
        Variation(scene=SCENE, vary={"gap": np.inf})


@pytest.mark.parametrize(("key", "most"), [("angle", 45.0), ("mass", 0.15), ("stiffness", 0.15), ("velocity", 0.15)])
def test_each_spread_has_a_largest_number(key: str, most: float) -> None:
    scene = db.load_scene("decelerating-40")
    assert Variation(scene=scene, vary={key: most}).vary[key] == most
    with pytest.raises(
        UsageError, match=rf"vary\['{key}'\] = {1.01 * most:g}\d*; allowed: a number >= 0 and at most {most:g} "
    ):
        Variation(scene=scene, vary={key: 1.01 * most})
    for wrong in (True, "a", None):
        with pytest.raises(UsageError, match=rf"vary\['{key}'\] = {wrong!r}; allowed: a number >= 0 and at most"):
            Variation(scene=scene, vary={key: wrong})  # type: ignore[dict-item]


def test_without_a_seed_it_is_0_and_angles_are_those_of_cylinders() -> None:
    without, with_seed = Variation(scene=SCENE, vary={"mass": 0.1}), Variation(scene=SCENE, vary={"mass": 0.1}, seed=0)
    np.testing.assert_array_equal(without.block(0, 1).mass, with_seed.block(0, 1).mass)
    scene = db.load_scene("decelerating-40")
    geometry = scene.geometry
    assert geometry is not None
    spheres = replace(scene, geometry=Geometry(bodies=geometry.bodies[:1] * scene.n_body))
    for round_bodies in (SCENE, spheres):
        with pytest.raises(UnsupportedScene, match="has no contact angles that could vary"):
            Variation(scene=round_bodies, vary={"angle": 1.0})
    # a contact of a sphere has no angle, and the others do
    some = Variation(scene=scene, vary={"angle": 1.0}).columns
    assert some == tuple(("angle", k) for k, angle in enumerate(geometry.angle) if angle is not None)
    assert 0 < len(some) < len(geometry.angle)


def test_angles_below_a_twentieth_of_a_degree_are_taken_for_it() -> None:
    scene = db.load_scene("decelerating-40")
    geometry = scene.geometry
    assert geometry is not None
    angle, contact = min((angle, k) for k, angle in enumerate(geometry.angle) if angle is not None)
    body = geometry.bodies[contact]
    variation = Variation(scene=scene, vary={"angle": 45.0})
    column = variation.columns.index(("angle", contact))
    uniform = np.full((2, len(variation.columns)), 0.5)
    uniform[:, column] = [NormalDist(0.0, 45.0).cdf(turned - angle) for turned in (0.03, 0.07)]
    ratio = variation.chains(uniform).stiffness[:, contact] / scene.stiffness[contact]
    stiffness = [
        crossed_cylinders(angle=degrees, radius=body.radius, law=geometry.law, **body.material.elastic).stiffness
        for degrees in (0.05, 0.07, angle)
    ]
    np.testing.assert_allclose(ratio, np.array(stiffness[:2]) / stiffness[2], rtol=1e-9)


def test_chains_of_every_block_are_those_that_other_codes_check() -> None:
    ensemble = run_ensemble(Variation(scene=TWO, vary={"mass": 0.1}, seed=3), 3 * BLOCK, checks=4)
    rows = ensemble.checked[ensemble.checked["code"] == "reference"]
    assert rows["chain"].max() >= BLOCK
    assert rows["chain"].nunique() == 4
    # a chain of another block is some 0.1 off
    assert rows["difference"].max() < ensemble.accuracy


def test_the_uncertainty_of_a_check_is_the_largest_of_all_places() -> None:
    scene = replace(SCENE, wall_left=None, wall_right=None, velocity=(0.8, 0.0, 0.0), gap=0.0)
    variation = Variation(scene=scene, vary={"mass": 0.05}, seed=1)
    ensemble = run_ensemble(variation, 3, checks=3)
    rows = ensemble.checked.set_index(["code", "chain", "observable"])["uncertainty"]
    for nth in range(3):
        chain = variation.block(0, 3).scene(scene, nth)
        run = db.solve(chain, backend="reference", samples=2000)
        for name in ("peak_force", "residence_time"):
            value, uncertainty = (part(chain, run) for part in (REGISTRY[name].value, REGISTRY[name].uncertainty))
            expected = float(np.nanmax(uncertainty / value))
            assert rows["reference", nth, name] == pytest.approx(expected, rel=1e-9, abs=0.0)
            # that of the first place is another, or none
            first = float((uncertainty / value)[0])
            assert math.isnan(first) or first < 0.8 * expected


def test_the_indices_of_another_seed_are_of_other_chains() -> None:
    def means(seed: int) -> NDArray[np.float64]:
        variation = Variation(scene=TWO, vary={"mass": 0.1, "stiffness": 0.1}, seed=seed)
        return sobol_indices(variation, lambda values: values["peak_force"].T, base=16).mean

    assert np.array_equal(means(1), means(1))
    # means of 32 chains whose forces vary by some 5 %: were the seed without effect, they would be equal
    values = [float(means(seed)[0]) for seed in range(1, 5)]
    assert np.ptp(values) > 1e-4 * np.mean(values)


def test_a_quantile_of_a_normal_number_is_that_many_deviations() -> None:
    variation = Variation(scene=SCENE, vary={"mass": 0.1, "stiffness": 0.05, "velocity": 0.02, "gap": 1e-6})
    # one standard deviation below, none, and two above
    chains = variation.chains(np.repeat(ndtr([[-1.0], [0.0], [2.0]]), len(variation.columns), axis=1))
    for nth, deviations in enumerate((-1.0, 0.0, 2.0)):
        np.testing.assert_allclose(chains.mass[nth], np.array(SCENE.mass) * (1.0 + 0.1 * deviations), rtol=1e-12)
        stiffness = np.array([2e10, 1e10, 2e10, 1e10])
        np.testing.assert_allclose(chains.stiffness[nth], stiffness * (1.0 + 0.05 * deviations), rtol=1e-12)
        np.testing.assert_allclose(
            chains.velocity[nth], np.array(SCENE.velocity) * (1.0 + 0.02 * deviations), rtol=1e-12
        )
        # what is added to a gap only opens it
        gap = np.array([1e-6, 0.0, 1e-5, 2e-6]) + 1e-6 * abs(deviations)
        np.testing.assert_allclose(chains.gap[nth], gap, rtol=1e-12, atol=1e-21)
    # numbers at the ends are those of the largest and the least number, not infinite
    ends = variation.chains(np.array([[0.0], [1.0]]) * np.ones(len(variation.columns)))
    assert np.all(np.isfinite(ends.gap))
