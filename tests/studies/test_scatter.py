"""Scatter of the contact angles: seeded chains, and spreads that are those of numpy."""

from __future__ import annotations

import json
import math
import statistics
from dataclasses import replace

import numpy as np
import pytest

import dem_bridge as db
from dem_bridge.errors import RunBroken, UnsupportedScene, UsageError
from dem_bridge.runs.campaign import Result, run_cases
from dem_bridge.scene.scene import Scene
from dem_bridge.studies.scatter import (
    LEAST_ANGLE,
    ScatteredChains,
    cases_of,
    chains_of,
    figure,
    find_tolerances,
    scattered,
    solve_scattered,
    solve_seeded,
    study_of,
    study_scatter,
)

SCENE = db.load_scene("decelerating-40")
SPREAD, COUNT, SEED = 1.0, 4, 7


@pytest.fixture(scope="module")
def results() -> tuple[Result, ...]:
    return run_cases(cases_of(SCENE, spread=SPREAD, count=COUNT, seed=SEED))


@pytest.fixture(scope="module")
def found(results: tuple[Result, ...]) -> ScatteredChains:
    return chains_of(SCENE, results, spread=SPREAD, seed=SEED)


def _angles(scene: Scene) -> list[float]:
    assert scene.geometry is not None
    return [angle for angle in scene.geometry.angle if angle is not None]


def test_a_seed_is_a_chain() -> None:
    one, same = (scattered(SCENE, spread=1.0, seed=3) for _ in range(2))
    assert one == same
    assert one.content_hash == same.content_hash
    chains = [scattered(SCENE, spread=1.0, seed=seed).stiffness for seed in range(20)]
    assert len(set(chains)) == 20
    assert scattered(SCENE, spread=2.0, seed=3).stiffness != one.stiffness


def test_seeds_count_up_from_the_first() -> None:
    cases = cases_of(SCENE, spread=1.0, count=3, seed=5)
    assert [case.scene for case in cases] == [SCENE, *(scattered(SCENE, spread=1.0, seed=seed) for seed in (5, 6, 7))]
    assert {case.backend for case in cases} == {"reference"}
    assert len({case.scene.name for case in cases}) == 4


def test_angles_are_off_by_normal_deviates_of_the_spread() -> None:
    wanted = np.array(_angles(SCENE))
    inner = (wanted > 10.0) & (wanted < 80.0)  # others may be reflected
    away = np.concatenate(
        [np.array(_angles(scattered(SCENE, spread=2.0, seed=s)))[inner] - wanted[inner] for s in range(60)]
    )
    # standard errors: 2/sqrt(n) of the mean, 2/sqrt(2 n) of the deviation; four of them
    error = 2.0 / math.sqrt(len(away))
    assert abs(float(np.mean(away))) < 4.0 * error
    assert abs(statistics.stdev(away.tolist()) - 2.0) < 4.0 * error / math.sqrt(2.0)
    # normal: 68.3 % within one deviation
    share = float(np.mean(np.abs(away) < 2.0))
    assert abs(share - 0.683) < 4.0 * math.sqrt(0.683 * 0.317 / len(away))


@pytest.mark.parametrize("name", ["decelerating-40", "accelerating-40", "decelerating-40-exact"])
def test_a_spread_of_nothing_gives_the_chain_that_was_wanted(name: str) -> None:
    scene = db.load_scene(name)
    same = scattered(scene, spread=1e-12, seed=0)
    # angles have nine digits; at 2 degrees the stiffness goes about as their inverse
    np.testing.assert_allclose(same.stiffness, scene.stiffness, rtol=1e-8)
    assert same.stiffness[0] == scene.stiffness[0]
    far, near = (
        np.max(np.abs(np.array(scattered(scene, spread=s, seed=0).stiffness) / scene.stiffness - 1.0))
        for s in (1e-3, 1e-5)
    )
    assert 50.0 < far / near < 200.0


def test_nothing_but_angles_and_their_stiffness_changes() -> None:
    one = scattered(SCENE, spread=3.0, seed=1)
    assert replace(one, name=SCENE.name, stiffness=SCENE.stiffness) == SCENE
    assert one.stiffness[0] == SCENE.stiffness[0]
    assert sum(a != b for a, b in zip(one.stiffness, SCENE.stiffness, strict=True)) == 39


def test_cylinders_of_two_sizes_and_materials_have_each_their_own_stiffness() -> None:
    steel = db.Material(youngs_modulus=193e9, poissons_ratio=0.3, density=8000.0)
    soft = db.Material(youngs_modulus=1.46e9, poissons_ratio=0.46, density=2200.0)
    rods = [
        db.Body(shape="cylinder", radius=radius, height=2e-2, material=one)
        for radius, one in ((5e-3, steel), (9e-3, soft), (5e-3, soft))
    ]
    chain = db.chain(name="rods", duration=1e-3, bodies=rods, velocity=0.5, angles=(30.0, 60.0))
    off = scattered(chain, spread=2.0, seed=1)
    assert off == replace(
        db.chain(name="rods", duration=1e-3, bodies=rods, velocity=0.5, angles=_angles(off)), name=off.name
    )
    assert off.stiffness != chain.stiffness


def test_no_contact_is_a_line() -> None:
    least = [min(_angles(scattered(SCENE, spread=45.0, seed=seed))) for seed in range(40)]
    assert min(least) >= LEAST_ANGLE
    assert LEAST_ANGLE in least
    assert max(max(_angles(scattered(SCENE, spread=45.0, seed=seed))) for seed in range(40)) <= 90.0


def test_spreads_are_those_of_numpy(found: ScatteredChains, results: tuple[Result, ...]) -> None:
    wanted, *chains = (result.trajectory for result in results)
    assert wanted is not None
    arrival = [run.crossing_time[39] / wanted.crossing_time[39] for run in chains if run is not None]
    mean, deviation = found.arrival_shift
    assert mean == pytest.approx(sum(arrival) / COUNT - 1.0, abs=1e-12)
    assert deviation == pytest.approx(statistics.pstdev(arrival), rel=1e-9)
    times = [np.diff(run.crossing_time[:40]) / np.diff(wanted.crossing_time[:40]) for run in chains if run is not None]
    force = [run.peak_force / wanted.peak_force for run in chains if run is not None]
    assert found.residence_spread == pytest.approx([statistics.pstdev(one) for one in np.transpose(times).tolist()])
    assert found.force_spread == pytest.approx([statistics.pstdev(one) for one in np.transpose(force).tolist()])
    shapes = [found.ratios(name).shape for name in ("arrival_at_end", "residence_time", "peak_force")]
    assert shapes == [(4, 1), (4, 41), (4, 40)]


def _rods(**changes: object) -> Scene:
    """Three crossed cylinders; with a drive the reference solves each chain."""
    steel = db.Material(youngs_modulus=193e9, poissons_ratio=0.3, density=8000.0)
    rods = [db.Body(shape="cylinder", radius=5e-3, height=1e-2, material=steel)] * 3
    return replace(db.chain(name="rods", duration=2e-4, bodies=rods, velocity=0.5, angles=(30.0, 60.0)), **changes)  # type: ignore[arg-type]


def test_an_ensemble_and_the_reference_have_the_same_intended_chain_and_spread() -> None:
    chains = solve_scattered(_rods(), spread=1.0, count=256)
    intended, *_ = run_cases(cases_of(_rods(), spread=1.0, count=2))
    assert intended.trajectory is not None
    assert chains.intended["peak_force"] == pytest.approx(intended.trajectory.peak_force, rel=1e-4)
    assert chains.intended["arrival_at_end"] == pytest.approx(intended.trajectory.crossing_time[1], rel=1e-4)
    single = chains_of(_rods(), run_cases(cases_of(_rods(), spread=1.0, count=40)), spread=1.0)
    # the standard error of a deviation is 1/sqrt(2 n) of it: 11 % for 40 chains; three of them
    assert single.arrival_shift[1] == pytest.approx(chains.arrival_shift[1], rel=0.35)
    assert single.force_spread == pytest.approx(chains.force_spread, rel=0.35)


@pytest.mark.parametrize("name", ["decelerating-40", "accelerating-40"])
def test_seeded_chains_that_are_solved_together_are_those_of_the_reference(name: str) -> None:
    scene = db.load_scene(name)
    together = solve_seeded(scene, spread=SPREAD, count=COUNT, seed=SEED)
    cases = cases_of(scene, spread=SPREAD, count=COUNT, seed=SEED)
    single = chains_of(scene, run_cases(cases, jobs=1), spread=SPREAD, seed=SEED)
    for observable in ("arrival_at_end", "residence_time", "peak_force"):
        # the accuracy of 1e-6 is that of each run, and these are ratios of two
        np.testing.assert_allclose(together.ratios(observable), single.ratios(observable), rtol=2e-6)


def test_chains_with_a_drive_cannot_be_solved_together() -> None:
    driven = _rods(drive=db.Drive(shape="sine", force=0.01, frequency=1e4))
    with pytest.raises(UnsupportedScene, match="rods"):
        solve_seeded(driven, spread=1.0, count=2)


def test_a_tolerance_that_was_found_is_confirmed_by_other_chains() -> None:
    chains = solve_scattered(_rods(), spread=1.0, count=128)
    assert list(chains.measures()) == ["arrival at the last body"]
    small, large = find_tolerances(chains, (0.01, 0.9), 128)
    assert 0.02 < small.spread < 8.0
    # on the safe side by 1.645 standard errors of a part: 14 % for 128 chains
    assert 0.75 * small.effect < small.confirmed <= small.effect
    # independent draws: 512 chains hit a part of 0.9 to 0.013; the tolerance has a margin of three times that
    drawn = db.ensemble(_rods(), vary={"angle": small.spread}, n=512, seed=9, checks=0).values["arrival_at_end"]
    assert np.mean(np.abs(drawn / chains.intended["arrival_at_end"] - 1.0) <= small.effect) >= 0.9
    # a spread twice as large does not keep the tolerance
    wide = solve_scattered(_rods(), spread=2.0 * small.spread, count=128, seed=1).measures()["arrival at the last body"]
    assert np.quantile(np.abs(wide - 1.0), 0.9) > 1.5 * small.effect
    assert math.isnan(large.spread)
    assert math.isnan(large.confirmed)


def test_the_study_of_an_ensemble_has_maps_tolerances_and_distributions() -> None:
    study = study_scatter(_rods(), spread=1.0, count=64)
    assert [table.id for table in study.tables] == ["scatter", "along-the-chain", "tolerances"]
    width = study.figures[2].panels[1].map
    assert width is not None
    assert width.values.shape == (121, 3)
    assert np.all(width.values >= 0.0)
    assert np.all(width.values[0] == 0.0), "all chains start alike"
    assert "other chains with that spread nine of ten lie within" in " ".join(study.answer)
    one_by_one = study_scatter(_rods(drive=db.Drive(shape="sine", force=0.01, frequency=1e4)), spread=1.0, count=3)
    assert [table.id for table in one_by_one.tables] == ["scatter", "along-the-chain"]


def test_the_speed_ratio_is_that_of_residence_times(found: ScatteredChains) -> None:
    time = found.ratios("residence_time")
    assert found.measures()["V_out/V_in"] == pytest.approx(time[:, 3] / time[:, 38])
    assert "Does scatter explain the experiment?" in " ".join(study_of(found).answer)


def test_the_tables_of_the_study_are_those_of_the_chains(found: ScatteredChains) -> None:
    study = study_of(found)
    told = json.loads(json.dumps(study.as_json(), allow_nan=False))
    assert told["provenance"] == {
        "scene": SCENE.name, "scene_hash": SCENE.content_hash, "spread": SPREAD, "seed": SEED
    }  # fmt: skip
    [row] = study.tables[0].rows
    assert row == pytest.approx((
        SCENE.name, SPREAD, COUNT, *(100 * part for part in found.arrival_shift),
        100 * float(np.median(found.residence_spread)), 100 * max(found.residence_spread),
        100 * float(np.median(found.force_spread)),
    ))  # fmt: skip
    body, time, force = zip(*study.tables[1].rows, strict=True)
    assert body == tuple(range(40))
    assert math.isnan(float(time[0]))
    assert time[1:] == pytest.approx(100 * found.residence_spread)
    assert force == pytest.approx(100 * found.force_spread[:40])
    for number in (100 * found.arrival_shift[0], 100 * max(found.residence_spread), 100 * max(found.force_spread)):
        assert f"{number:.2f} %" in " ".join(study.answer)


def test_the_figure_has_the_middle_and_both_ends_of_the_set(found: ScatteredChains) -> None:
    shown = figure(found)
    times, force = shown.panels
    assert shown.id == "scatter-decelerating-40"
    assert (times.series[0].x.tolist(), force.series[0].x.tolist()) == (
        list(range(1, 40)),
        list(range(40)),
    )
    for panel, ratio in (
        (times, found.ratios("residence_time")[:, 1:-1]),
        (force, found.ratios("peak_force")),
    ):
        band, median = panel.series
        assert band.bar is not None
        below, middle, above = band.y - band.bar, median.y, band.y + band.bar
        assert np.all(below <= middle)
        assert np.all(middle <= above)
        np.testing.assert_allclose(middle, np.median(ratio, axis=0))
        assert np.all(np.min(ratio, axis=0) <= below)
        assert np.all(above <= np.max(ratio, axis=0))


def test_chains_that_broke_do_not_count(results: tuple[Result, ...]) -> None:
    broken = [*results[:2], replace(results[2], trajectory=None, failure=RunBroken("it broke")), *results[3:]]
    found = chains_of(SCENE, broken, spread=SPREAD, seed=SEED)
    assert found.count == COUNT - 1
    without_wanted = [replace(results[0], trajectory=None, failure=RunBroken("it broke")), *results[1:]]
    with pytest.raises(UnsupportedScene, match=r"decelerating-40: the reference has no run \(it broke\)"):
        chains_of(SCENE, without_wanted, spread=SPREAD)


def test_a_wave_that_does_not_arrive_is_refused_in_one_line() -> None:
    short = replace(SCENE, name="short", duration=2e-4)
    with pytest.raises(UnsupportedScene, match=r"^short: the wave does not reach .* allowed: a longer duration$"):
        study_scatter(short, count=2)


@pytest.mark.parametrize("spread", [0.0, -1.0, 45.1, math.nan, math.inf, True, "1", None])
def test_a_spread_that_is_none_is_refused_in_one_line(spread: object) -> None:
    with pytest.raises(UsageError, match=r"^spread = .*; allowed: a number of degrees > 0, up to 45$"):
        cases_of(SCENE, spread=spread, count=2)  # type: ignore[arg-type]


@pytest.mark.parametrize("count", [1, 0, -2, 100_001, 2.0, True, "2", None])
def test_a_count_that_is_none_is_refused_in_one_line(count: object) -> None:
    with pytest.raises(UsageError, match=r"^count = .*; allowed: a whole number of chains from 2 to 100000$"):
        cases_of(SCENE, spread=1.0, count=count)  # type: ignore[arg-type]


@pytest.mark.parametrize("seed", [-1, 0.5, "a", True, None])
def test_a_seed_that_is_none_is_refused_in_one_line(seed: object) -> None:
    with pytest.raises(UsageError, match=r"^seed = .*; allowed: a whole number >= 0$"):
        cases_of(SCENE, spread=1.0, count=2, seed=seed)  # type: ignore[arg-type]


@pytest.mark.parametrize("name", ["tapered-forward", "homogeneous-spheres"])
def test_a_scene_without_angles_is_refused_in_one_line(name: str) -> None:
    with pytest.raises(UnsupportedScene, match=rf"^{name} has no contact angles that could scatter; allowed: .*"):
        study_scatter(db.load_scene(name), count=2)
    with pytest.raises(UnsupportedScene, match="no contact angles"):
        scattered(replace(SCENE, geometry=None), spread=1.0, seed=0)
