"""Ensembles: chains that are drawn, solved in lanes, and agree with the reference, whoever solves them."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.special import ndtr
from scipy.stats import kstest

import dem_bridge as db
from dem_bridge.ensembles import run, solve
from dem_bridge.ensembles.draw import BLOCK, Variation
from dem_bridge.ensembles.lanes import march
from dem_bridge.ensembles.run import CHECKS
from dem_bridge.ensembles.solve import OBSERVABLES, difference, solve_chains, steps_for
from dem_bridge.errors import UnsupportedScene, UsageError
from dem_bridge.observables.registry import observable_named
from dem_bridge.physics.hertz import crossed_cylinders
from dem_bridge.scene.scene import Scene, Wall

#: five bodies with a wall at each end, gaps, an initial overlap and two bodies that move
FIVE = Scene(
    name="five",
    duration=2e-4,  # between two walls the motion becomes chaotic later
    mass=(0.01, 0.02, 0.015, 0.01, 0.03),
    stiffness=(2e10, 1e10, 3e10, 2e10),
    gap=(1e-6, 0.0, -2e-7, 3e-6),
    velocity=(0.8, 0.0, -0.1, 0.0, 0.0),
    wall_left=Wall(stiffness=2e10, gap=1e-5),
    wall_right=Wall(stiffness=1e10, gap=2e-6),
)
ANGLE = {"angle": 0.5}


def _worst(scene: Scene, variation: Variation, accuracy: float) -> float:
    """Largest relative difference of three chains from the reference, at the steps for the accuracy."""
    chains = variation.block(0, 8)
    values = solve_chains(scene, chains, steps_for(scene, chains, accuracy))
    off = [0.0]
    for nth in range(3):
        one = chains.scene(scene, nth)
        exact = db.solve(one, backend="reference", uncertainty=False, samples=2000)
        for name in OBSERVABLES:
            read = np.atleast_1d(observable_named(name).value(one, exact))
            off.append(float(difference(values[name][nth : nth + 1], read[None])[0]))
    return max(off)


@pytest.mark.parametrize(
    ("scene", "vary"),
    [
        (FIVE, {"mass": 0.1, "stiffness": 0.1, "velocity": 0.1, "gap": 1e-7}),
        (replace(FIVE, exponent=2.0, wall_left=None, wall_right=None, stiffness=(2e6, 1e6, 3e6, 2e6)), {"mass": 0.1}),
        (replace(FIVE, exponent=(2.2, 2.5, 3.0, 2.4), gravity=9.81), {"stiffness": 0.1}),
        (
            replace(FIVE, gap=0.0, wall_left=None, wall_right=Wall(stiffness=1e10), precompression=10.0, gravity=9.81),
            {"mass": 0.1, "stiffness": 0.1},
        ),
    ],
    ids=["walls-gaps", "hooke", "exponents-gravity", "precompressed-weight"],
)
def test_chains_have_the_accuracy_that_was_asked_for(scene: Scene, vary: dict[str, float]) -> None:
    # 2000 samples read the largest velocity of the reference to 1e-6
    assert _worst(scene, Variation(scene=scene, vary=vary), 1e-4) < 1e-4


def test_a_wrong_stiffness_is_noticed() -> None:
    scene = Scene(name="two", duration=2e-4, mass=(0.01, 0.02), stiffness=(2e10,), velocity=(0.8, 0.0))
    chains = Variation(scene=scene, vary={"mass": 0.1}).block(0, 8)
    right = solve_chains(scene, chains, 200)
    wrong = solve_chains(scene, replace(chains, stiffness=1.001 * chains.stiffness), 200)
    # a collision with a wall or a body scales as stiffness^(-2/5) in time and ^(2/5) in force: 4e-4 here
    assert 1e-4 < max(difference(right[name], wrong[name]).max() for name in ("crossing_time", "peak_force")) < 1e-3


def test_kept_velocities_are_those_of_the_reference() -> None:
    variation = Variation(scene=FIVE, vary={"velocity": 0.1})
    chains = variation.block(0, 4)
    steps = steps_for(FIVE, chains, 1e-4, 50)
    values = solve_chains(FIVE, chains, steps, 50)["velocity"]
    for nth in range(4):
        exact = db.solve(chains.scene(FIVE, nth), backend="reference", uncertainty=False, samples=50).velocity
        assert values[nth].shape == exact.shape
        assert np.max(np.abs(values[nth] - exact)) < 1e-4 * np.max(np.abs(exact))


def test_angles_are_normal_and_their_stiffness_is_hertz() -> None:
    scene = db.load_scene("decelerating-40")
    assert scene.geometry is not None
    variation = Variation(scene=scene, vary=ANGLE, seed=3)
    body, angle = scene.geometry.bodies[6], scene.geometry.angle[5]
    assert angle is not None
    turned = np.array([angle - 0.7, angle + 0.3, angle + 1e-9])
    geometry = scene.geometry

    def stiffness_at(degrees: float) -> float:
        return crossed_cylinders(angle=degrees, radius=body.radius, law=geometry.law, **body.material.elastic).stiffness

    exact = [stiffness_at(one) for one in (angle, *turned.tolist())]
    # a chance of one half leaves an angle as it is
    chances = np.full((3, len(variation.columns)), 0.5)
    chances[:, variation.columns.index(("angle", 5))] = ndtr((turned - angle) / ANGLE["angle"])
    stiffness = variation.chains(chances).stiffness
    assert stiffness[:, 5] / scene.stiffness[5] == pytest.approx(np.array(exact[1:]) / exact[0], rel=1e-10)
    assert np.delete(stiffness, 5, axis=1) == pytest.approx(np.tile(np.delete(scene.stiffness, 5), (3, 1)), rel=1e-10)
    drawn = variation.block(0).stiffness
    assert np.all(drawn[:, 0] == scene.stiffness[0]), "the striker's contact has no angle"
    # beyond 90 degrees an angle is reflected; far from there the quantiles are those of the normal distribution
    low = stiffness_at(angle + 0.5)
    share = np.mean(drawn[:, 5] / scene.stiffness[5] < low / exact[0])
    assert share == pytest.approx(0.1587, abs=4 * np.sqrt(0.16 * 0.84 / BLOCK)), "one standard deviation above"


@pytest.mark.parametrize("sampler", ["random", "sobol"])
def test_draws_are_normal_and_do_not_depend_on_the_number_of_chains(sampler: str) -> None:
    variation = Variation(scene=FIVE, vary={"mass": 0.1, "gap": 1e-7}, seed=1, sampler=sampler)
    block, first = variation.block(1), variation.block(1, 3)
    assert np.array_equal(block.mass[:3], first.mass)
    assert not np.array_equal(variation.block(0).mass, block.mass)
    deviate = (block.mass / np.array(FIVE.mass) - 1.0) / 0.1
    for body in range(5):
        assert kstest(deviate[:, body], "norm").pvalue > 1e-4
    assert np.all(block.gap >= np.append(FIVE.gap, [1e-5, 2e-6])), "gaps only open"
    assert np.array_equal(block.velocity, np.tile(FIVE.velocity, (BLOCK, 1)))


def test_results_do_not_depend_on_the_executor(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(run, "BLOCK", 8)  # several blocks of 8 chains
    alone = db.ensemble(FIVE, vary={"mass": 0.1}, n=20, checks=0)
    with ThreadPoolExecutor(3) as pool:
        pooled = db.ensemble(FIVE, vary={"mass": 0.1}, n=20, checks=0, executor=pool)
    assert alone.table.to_csv() == pooled.table.to_csv()
    assert len(alone) == 20


def test_the_first_chains_of_a_larger_ensemble_are_the_same() -> None:
    few, many = (db.ensemble(FIVE, vary={"mass": 0.1}, n=n, seed=4, checks=0).table for n in (3, 40))
    assert few.to_csv() == many[:3].to_csv()


def test_chains_without_scatter_are_the_scene() -> None:
    chains = db.ensemble(FIVE, vary={"mass": 0.0, "gap": 0.0}, n=2, checks=0)
    exact = db.solve(FIVE, backend="reference", uncertainty=False)
    assert chains.values["peak_force"] == pytest.approx(np.tile(exact.peak_force, (2, 1)), rel=1e-4)


@pytest.mark.lammps
def test_a_fault_of_the_kernel_is_named_by_the_check(monkeypatch: pytest.MonkeyPatch) -> None:
    def stiffer(mass: Any, velocity: Any, weight: Any, stiffness: Any, *more: Any) -> object:
        return march(mass, velocity, weight, 1.001 * stiffness, *more)

    monkeypatch.setattr(solve, "march", stiffer)
    chains = db.ensemble(FIVE, vary={"mass": 0.1}, n=3, checks=1)
    for code in CHECKS:
        assert f"the accuracy 0.0001 and the uncertainty of {code}" in chains.agreement


@pytest.mark.lammps
def test_an_ensemble_can_be_read_in_every_form(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(run, "MOST_IN_MEMORY", 100)  # arrays above are files
    chains = db.ensemble(FIVE, vary={"mass": 0.1}, n=12, samples=20, checks=1)
    table, long, data = chains.table, chains.long_table, chains.to_xarray()
    assert table.shape == (12, 1 + 6 + 5 + 5 + 6)
    assert len(long) == table.size
    assert [str(kind) for kind in long.dtypes] == ["int32", "category", "int32", "float64"]
    assert table.attrs["units"]["peak_force"] == long.attrs["units"]["peak_force"] == "N"
    assert (table.attrs["scene"], table.attrs["vary_mass"]) == ("five", 0.1)
    assert set(long["observable"]) == set(OBSERVABLES)
    assert data["velocity"].dims == ("chain", "sample", "body")
    assert data["peak_force"].attrs == {"units": "N"}
    assert chains.quantiles("peak_force", [0.0, 1.0])[1] == pytest.approx(table.filter(like="peak_force").max().values)
    assert isinstance(chains.values["velocity"], np.memmap)
    rows = chains.checked[chains.checked["code"] == "reference"]
    assert set(rows["observable"]) == set(OBSERVABLES)
    assert rows["difference"].max() < 1e-4
    assert rows["uncertainty"].max() < 1e-6
    assert "1 chains by reference differ by at most" in repr(chains)
    assert "disagree" not in chains.agreement


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"vary": {"colour": 1.0}}, "allowed: angle, mass, stiffness, velocity, gap"),
        ({"vary": {}}, "allowed: a mapping"),
        ({"vary": {"mass": 0.5}}, "at most 0.15"),
        ({"vary": {"gap": float("nan")}}, "a number >= 0"),
        ({"vary": {"mass": True}}, "a number >= 0|allowed: a mapping"),
        ({"vary": {"mass": -0.1}}, "a number >= 0"),
        ({"n": 0}, "n = 0; allowed: a whole number >= 1"),
        ({"seed": -1}, "seed = -1"),
        ({"accuracy": 0.0}, "accuracy = 0.0"),
        ({"sampler": "grid"}, "allowed: random, sobol"),
    ],
)
def test_wrong_settings_are_named(change: dict[str, object], message: str) -> None:
    settings: dict[str, object] = {"vary": {"mass": 0.1}, "n": 2, **change}
    with pytest.raises(UsageError, match=message.replace("[", r"\[")):
        db.ensemble(FIVE, **settings)  # type: ignore[arg-type]


def test_scenes_that_cannot_be_solved_in_lanes_are_refused() -> None:
    with pytest.raises(UnsupportedScene, match="has DMT adhesion"):
        db.ensemble(replace(FIVE, adhesion=db.Adhesion(law="dmt", pull_off=1.0)), vary={"mass": 0.1}, n=2)
    with pytest.raises(UnsupportedScene, match="no contact angles"):
        db.ensemble(FIVE, vary=ANGLE, n=2)
