"""The horizon study: small differences that grow, bars over time, long runs, and what is judged beyond."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import dem_bridge as db
from dem_bridge.backends.base import Resolution, Sampling
from dem_bridge.errors import UsageError
from dem_bridge.observables.verdict import Outcome
from dem_bridge.report.study import Study
from dem_bridge.runs.uncertainty.from_twins import twin_family
from dem_bridge.scene.scene import Scene
from dem_bridge.studies.horizon import runs as horizon_runs
from dem_bridge.studies.horizon import study as horizon
from dem_bridge.studies.horizon import verdicts as horizon_verdicts
from dem_bridge.studies.horizon.runs import (
    Found,
    LongRun,
    growth_of,
    horizon_of,
    long_run,
    perturbed,
    round_off_bar,
    step_bar,
)
from tests.bench.bench_horizon import between_walls
from tests.helpers.driven_chains import DRIVES, TOUCHING, driven

SMALL = between_walls(5, duration=0.012)


def test_a_nudge_is_seeded_and_leaves_what_is_0() -> None:
    one, same, other = (perturbed(SMALL, 1e-6, seed) for seed in (1, 1, 2))
    assert one.content_hash == same.content_hash != other.content_hash
    assert one.velocity[1:] == SMALL.velocity[1:]
    assert one.gap == SMALL.gap
    moved = np.array(one.mass) / np.array(SMALL.mass) - 1.0
    # normal deviates
    assert 0.0 < np.max(np.abs(moved)) < 6e-6
    assert one.wall_left != SMALL.wall_left
    assert len(set(moved.tolist())) == len(moved)


def test_growth_is_fitted_where_it_is_small_and_told_from_a_power() -> None:
    time = np.linspace(0.0, 1.0, 501)
    rng = np.random.default_rng(3)
    rates = 60.0 + 2.0 * rng.standard_normal(8)
    # saturated from 0.4 on: that part says nothing of the rate
    grown = np.array([np.minimum(1e-10 * np.exp(rate * time), 1.0) for rate in rates])
    found = growth_of(time, grown, 1e-10)
    assert found.exponential
    assert found.rate == pytest.approx(np.mean(rates), rel=1e-9)
    # of eight: Student's t of seven times their scatter
    assert found.bar == pytest.approx(2.3646 * np.std(rates, ddof=1) / math.sqrt(8.0), rel=1e-4)
    assert found.window[1] < 0.4
    square = growth_of(time, 1e-8 * np.array([[1.0], [2.0]]) * time**2, 1e-10)
    assert not square.exponential
    assert square.rate == pytest.approx(2.0, rel=1e-9)
    assert (found.kind, square.kind) == ("exponential", "power of time")
    bursts = np.where(time < 0.5, 1e-9, 1e-4) * (1.0 + time)
    assert growth_of(time, np.array([bursts, 2.0 * bursts]), 1e-10).kind == "neither"
    # nothing grows: nothing is fitted
    assert growth_of(time, np.zeros((2, len(time))), 1e-10).kind == "neither"


def test_only_a_closed_chain_has_a_lyapunov_exponent() -> None:
    """An exponential that fits the growth in an open chain for a while is no exponent: its bodies fly apart."""
    time = np.linspace(0.0, 1.0, 401)
    grown = np.array([[1e-9], [2e-9]]) * np.exp(3.0 * time)
    closed, open_chain = growth_of(time, grown, 1e-10), growth_of(time, grown, 1e-10, closed=False)
    assert (closed.kind, closed.rate) == ("exponential", pytest.approx(3.0))
    assert open_chain.kind == "power of time"
    assert open_chain.misfit == closed.misfit
    assert open_chain.misfit[0] < open_chain.misfit[1]


def test_a_bar_over_time_ends_as_that_of_the_whole_run() -> None:
    scene = db.load_scene("decelerating-40")
    twins = twin_family(scene, Resolution(dt=1e-7), Sampling(count=50))
    assert twins is not None
    whole = db.solve(scene, backend="verlet", dt=1e-7, samples=50)
    speed = float(np.max(np.abs(whole.velocity)))
    found = step_bar(twins, speed) + round_off_bar(twins.main.velocity, [twins.positional.velocity], twins.plan, speed)
    # the same sums in another order
    assert found[-1] == pytest.approx(whole.uncertainty["velocity"] / speed, rel=1e-12)
    assert np.all(np.diff(found) >= 0.0)


def test_a_horizon_is_where_a_bar_passes_and_a_bar_that_is_none_passes() -> None:
    time = np.arange(4.0)
    assert horizon_of(time, np.array([0.0, 0.005, 0.01, 0.02])) == 3.0
    assert math.isinf(horizon_of(time, np.zeros(4)))
    assert horizon_of(time, np.array([0.0, math.nan, 0.0, 0.0])) == 1.0


def test_parts_of_a_long_run_are_one_run_to_the_last_digit(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = replace(SMALL, gravity=9.81)
    whole = long_run(scene, 1e-7, 20_000, samples=200)
    monkeypatch.setattr(horizon_runs, "LONGEST_PART", 3_000)
    told: list[float] = []
    parts = long_run(scene, 1e-7, 20_000, samples=200, progress=lambda done, total, label: told.append(done / total))
    assert np.array_equal(parts.velocity, whole.velocity)
    np.testing.assert_array_equal(parts.time, whole.time)
    # positions are sums over all steps, overlaps are not
    np.testing.assert_allclose(parts.total, whole.total, rtol=0.0, atol=1e-10 * whole.scale)
    assert told == sorted(told)
    assert len(told) == 7


def test_a_long_run_that_is_stopped_leaves_what_was_run(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(horizon_runs, "LONGEST_PART", 1_000)

    def stop(done: float, total: int, label: str) -> None:
        if done >= 5_000:
            raise KeyboardInterrupt

    found = long_run(SMALL, 1e-7, 20_000, samples=2_000, progress=stop)
    assert not found.complete
    assert found.steps == 5_000
    assert len(found.time) == 501
    assert found.drift is not None


def test_energy_of_the_twin_walks_but_does_not_drift() -> None:
    found = long_run(SMALL, 2e-7, 400_000, samples=4_000)
    assert found.drift is not None
    total, bar = found.drift.total
    # here each touch adds or takes about 1e-8, and contacts close some thousand times
    assert abs(total) <= 2.0 * bar < 1e-4
    predicted, swing = found.swing
    assert swing == pytest.approx(predicted, rel=0.3)
    # planted: a code that loses a millionth of its energy in a millisecond
    losing = replace(found, conserved=found.conserved * (1.0 - 1e-3 * found.time))
    assert losing.drift is not None
    assert losing.drift.found
    assert losing.drift.total[0] == pytest.approx(-1e-3 * found.time[-1] * found.total[0] / found.scale, rel=0.1)


@pytest.mark.parametrize("shape", DRIVES)
def test_energy_less_work_of_a_driven_chain_does_not_drift(shape: str) -> None:
    scene = driven(TOUCHING, shape)
    found = long_run(scene, 1e-8, 40_000)
    assert found.drift is not None
    total, bar = found.drift.total
    # the kinks of a drive and the openings of contacts each leave about the swing
    assert abs(total) <= bar + 2.0 * found.swing[0] < 1e-6
    # planted: work that is not taken off
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(horizon_runs, "work", lambda *_: (0.0, 0.0))
        gaining = long_run(scene, 1e-8, 40_000)
    assert gaining.drift is not None
    assert abs(gaining.drift.total[0]) > 0.1
    assert abs(gaining.total[-1] - gaining.total[0]) > 1e4 * abs(found.total[-1] - found.total[0])


def test_a_nudge_moves_a_drive_as_a_whole() -> None:
    scene = driven(TOUCHING, "table")
    moved = perturbed(scene, 1e-3, 3)
    assert scene.drive is not None
    assert moved.drive is not None
    ratio = moved.drive.peak / scene.drive.peak
    assert 0.0 < abs(ratio - 1.0) < 5e-3
    assert moved.drive == scene.drive.times(ratio)
    assert perturbed(replace(scene, drive=None), 1e-3, 3).mass == moved.mass


@pytest.fixture(scope="module")
def made() -> tuple[Study, Found]:
    """The study of five bodies between walls, and what it judged. With LAMMPS."""
    kept: list[Found] = []

    def keep(found: Found) -> Any:
        kept.append(found)
        return horizon_verdicts.verdicts(found)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(horizon, "verdicts", keep)
        told: list[float] = []
        study = db.study(
            "horizon", SMALL, dt=1e-7, steps=200_000, perturbations=6, store=False,
            progress=lambda done, total, label: told.append(done / total),
        )  # fmt: skip
    assert told == sorted(told)
    assert 0.9 < told[-1] <= 1.0
    return study, kept[0]


def outcomes(verdicts: Any) -> dict[tuple[str, str], Outcome]:
    return {(one.backend, one.quantity): one.outcome for one in verdicts}


@pytest.mark.lammps
def test_between_walls_single_velocities_are_undecided_and_all_else_passes(made: tuple[Study, Found]) -> None:
    study, found = made
    assert study.exit_code == 4
    judged = outcomes(horizon_verdicts.verdicts(found))
    names = ("reference", "verlet", "lammps-granular")
    assert all(judged.pop((name, "velocity")) is Outcome.UNDECIDED for name in names)
    assert set(judged.values()) == {Outcome.PASS}, study.tables[3].rows
    assert ("verlet", "energy drift") in judged
    assert ("lammps-granular", "kurtosis of velocities") in judged
    assert found.growth.exponential
    assert any("the largest Lyapunov exponent is" in sentence for sentence in study.answer)
    reference, twin, lmp = found.trusts
    # a digit is worth the same time to all, and the reference has ten more
    assert twin.horizon < reference.horizon < found.scene.duration
    for one in (twin, lmp):
        assert one.error is not None
        # a bar that holds passes 1 % no later than the error
        assert one.horizon <= horizon_of(found.truth.time, one.error)
    assert 5.0 < twin.collisions < 1000.0
    assert {one.id for one in study.figures} == {"horizon", "horizon-energy", "horizon-distribution"}


@pytest.mark.lammps
def test_faults_beyond_the_horizon_are_caught(made: tuple[Study, Found]) -> None:
    """None shows in a single velocity any more: all of them are UNDECIDED anyway."""
    _, found = made
    _, _, lmp = found.trusts

    def judged(**changes: Any) -> dict[tuple[str, str], Outcome]:
        wrong = replace(lmp, run=replace(lmp.run, **changes))
        return outcomes([*horizon_verdicts.statistical(found, wrong), *horizon_verdicts.conserved(found, wrong)])

    # 10 % of the energy; the bar is 2 % for so few bodies and so short a time
    faster = judged(velocity=1.05 * lmp.run.velocity)
    assert faster["lammps-granular", "mean kinetic energy (J)"] is Outcome.FAIL
    # a loss of 1e-4 over the run
    fading = np.linspace(1.0, 1.0 - 5e-5, len(lmp.run.time))[:, None]
    assert judged(velocity=fading * lmp.run.velocity)["lammps-granular", "energy"] is Outcome.FAIL
    # bodies that press on each other and on walls nine tenths as deep as they should
    assert judged(displacement=0.9 * lmp.run.displacement)[
        "lammps-granular", "mean kinetic / stored energy"
    ] is Outcome.FAIL  # fmt: skip

    def drift(long: LongRun) -> dict[tuple[str, str], Outcome]:
        return outcomes(horizon_verdicts.drift(replace(found, long=long)))

    long = found.long
    lost = drift(replace(long, conserved=long.conserved - 0.05 * long.scale * long.time / long.time[-1]))
    assert lost["verlet", "energy drift"] is Outcome.FAIL
    hot = drift(replace(long, kinetic=1.2 * long.kinetic))
    assert hot["verlet", "mean kinetic / stored energy, long run"] is Outcome.FAIL


def test_the_virial_theorem_is_asked_only_where_it_holds() -> None:
    assert horizon_verdicts.virial(SMALL) == 1.25
    for other in (
        replace(SMALL, wall_left=None),
        replace(SMALL, gravity=9.81),
        replace(SMALL, drag=1.0),
        between_walls(5, gap=1e-6),
    ):
        assert horizon_verdicts.virial(other) is None


def test_where_nothing_parts_there_is_no_horizon_and_no_statistics() -> None:
    # two bodies and one impact
    pair = Scene(name="pair", duration=2e-4, mass=(1e-2,) * 2, stiffness=(4e9,), velocity=(0.8, 0.0), samples=50)
    study = db.study("horizon", pair, perturbations=2, dt=1e-7, steps=2000, store=False)
    assert study.exit_code == 0
    assert [row[1] for row in study.tables[0].rows[:2]] == [math.inf, math.inf]
    assert not any("kurtosis" in str(row[1]) for row in study.tables[3].rows)
    assert any("no horizon within" in sentence for sentence in study.answer)
    # between no walls
    assert not any("Lyapunov exponent is" in sentence for sentence in study.answer)
    assert "exponential" not in [row[0] for row in study.tables[1].rows]


@pytest.mark.parametrize(
    "wrong",
    [{"duration": -1.0}, {"duration": "1"}, {"steps": 0}, {"steps": 10**10}, {"perturbations": 1}, {"seed": -1}],
)
def test_settings_that_make_no_sense_are_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(UsageError, match=f"{next(iter(wrong))} = .*; allowed: a "):
        db.study("horizon", SMALL, store=False, **wrong)
