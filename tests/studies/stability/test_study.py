"""The stability study: its families, its sentences and what it leaves behind when it is stopped."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dem_bridge.backends.lammps_motion import granular
from dem_bridge.backends.splitting import Motion
from dem_bridge.backends.twin import solve_motion
from dem_bridge.errors import UsageError
from dem_bridge.lmp.engine import Engine
from dem_bridge.observables.verdict import Outcome
from dem_bridge.report.study import Study
from dem_bridge.scene.contacts import Contacts
from dem_bridge.scene.file import load_scene
from dem_bridge.scene.scene import Scene
from dem_bridge.studies.stability import study as stability
from dem_bridge.studies.stability.points import chain, engine_on, measured, point_of, trap_of
from dem_bridge.studies.stability.study import study_stability
from dem_bridge.trajectory.dense import Schedule
from tests.helpers.counting_store import Counting
from tests.helpers.driven_chains import SINE
from tests.studies.stability.small import small_stability

SCENE = replace(chain("three", (1e-2,) * 3, (4e9,) * 2), samples=20)


@pytest.mark.slow
def test_without_an_engine_the_twin_answers_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    small_stability(monkeypatch, engine=False)
    seen: list[str] = []
    found = study_stability(SCENE, points=2, progress=lambda done, total, label: seen.append(label))
    assert any("no engine; install lammps" in note for note in found.notes)
    assert found.verdicts == ()
    assert "three" in seen
    limits, thresholds, trap = found.tables
    assert [row[0] for row in limits.rows] == ["contact angle (degrees)"] * 2 + ["three"]
    assert [row[0] for row in thresholds.rows] == [
        name for name in ("two-equal", "five-equal", "three") for _ in (0.1, 1.0)
    ]
    assert {row[0] for row in trap.rows} == {"verlet"}
    # the highest mode says where it breaks, to a fifth; the fastest contact alone says too much
    over_pair, over_mode = (np.array([row[at] for row in limits.rows], dtype=float) for at in (7, 8))
    assert np.all((over_mode > 0.8) & (over_mode < 1.2))
    assert np.all(over_pair < over_mode)
    # cylinders that are almost parallel are stiffer: their limit in parts of the Rayleigh time is lower
    rayleigh = [float(row[13]) for row in limits.rows[:2]]
    assert rayleigh[0] < 60.0 < 200.0 < rayleigh[1]


def test_what_was_finished_is_there_when_it_is_stopped(monkeypatch: pytest.MonkeyPatch) -> None:
    small_stability(monkeypatch, engine=False)

    def stop(done: float, total: int, label: str) -> None:
        if label == "three":
            raise KeyboardInterrupt

    found = study_stability(SCENE, points=2, progress=stop)
    assert isinstance(found, Study)
    assert found.interrupted
    assert len(found.tables[0].rows) == 2
    assert [one.id for one in found.figures] == ["stability-limits"]
    assert any("2 small scenes" in sentence for sentence in found.answer)


@pytest.mark.slow
@pytest.mark.lammps
def test_lammps_has_the_twins_limit_and_another_limit_is_a_failure(monkeypatch: pytest.MonkeyPatch) -> None:
    pair = measured(chain("pair", (1e-2,) * 2, (4e9,)))
    with granular(Engine()) as lammps:
        point = point_of(pair, allowed=1.0, engine=engine_on(pair, lammps))
    assert math.isfinite(point["engine"])
    assert stability.judge_agreement(point).outcome is Outcome.PASS

    # planted: an engine that steps by 3 % more than it is asked for
    def longer(scene: Scene, plan: Schedule, contacts: Contacts) -> Motion:
        return solve_motion(scene, replace(plan, step=1.03 * plan.step), contacts)

    wrong = point_of(pair, allowed=1.0, engine=longer)
    assert stability.judge_agreement(wrong).outcome is Outcome.FAIL


def test_conservation_does_not_show_what_is_wrong() -> None:
    whole = measured(load_scene("decelerating-40"))
    fine, coarse = (trap_of(whole, solve_motion, "verlet", dt) for dt in (2e-6, 8e-6))
    # measured by LAMMPS at these steps: 0.6 and 13 % at the end, and more on the way
    assert fine.last == pytest.approx(0.0064, rel=0.02)
    assert coarse.last == pytest.approx(0.134, rel=0.02)
    assert fine.velocity > 3.0 * fine.last
    # sums of equal and opposite kicks: a last digit for each of 1500 steps, at random
    assert max(coarse.momentum, fine.momentum) < 1e-14
    assert max(coarse.kinetic, fine.kinetic) < 1e-4

    def lossy(scene: Scene, plan: Schedule, contacts: Contacts) -> Motion:
        run = solve_motion(scene, plan, contacts)
        return run._replace(velocity=run.velocity * (1.0 - 1e-3 * run.time / run.time[-1])[:, None])

    # planted: a code that gives momentum away
    found = trap_of(whole, lossy, "verlet", 2e-6)
    assert found.momentum == pytest.approx(1e-3, rel=1e-6)
    assert found.kinetic == pytest.approx(2e-3, rel=0.1)


@pytest.mark.lammps
def test_a_second_call_computes_nothing_and_has_the_same_numbers(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    small_stability(monkeypatch, engine=True)
    store = Counting(tmp_path)
    first = study_stability(SCENE, points=2, store=store)
    parts = store.computed
    assert parts > 10
    assert any(verdict.backend == "lammps-granular" for verdict in first.verdicts)
    again = study_stability(SCENE, points=2, store=store)
    assert store.computed == parts
    assert repr([table.rows for table in again.tables]) == repr([table.rows for table in first.tables])  # nan: none
    assert (again.answer, again.verdicts, again.notes) == (first.answer, first.verdicts, first.notes)
    # planted: settings that change the numbers. Parts that do not depend on them stay
    other = study_stability(SCENE, points=2, gain=0.5, store=store)
    assert store.computed == parts + 4  # three points, and the trap below the limit of the last
    assert other.tables[0].rows != first.tables[0].rows
    study_stability(SCENE, points=2, engine=Engine(lmp_args=("-nonbuf",)), store=store)
    assert store.computed == parts + 4 + 5  # the same parts with LAMMPS, and whether it is there


@pytest.mark.parametrize(
    "wrong", [{"gain": 0.0}, {"gain": float("inf")}, {"gain": True}, {"points": 1}, {"points": 2.0}]
)
def test_settings_that_make_no_sense_are_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(UsageError, match=f"{next(iter(wrong))} = .*; allowed: a "):
        study_stability(SCENE, **wrong)


def test_a_driven_scene_is_refused_for_its_energy_grows_anyway() -> None:
    with pytest.raises(UsageError, match="three is driven, and energy that grows is no sign"):
        study_stability(replace(SCENE, drive=SINE))
