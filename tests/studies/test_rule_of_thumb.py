"""The rule of thumb judged: steps are what they are called, and errors those of the runs."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given

import dem_bridge as db
from dem_bridge.errors import BackendUnavailable, RunBroken
from dem_bridge.report.study import Study, Table
from dem_bridge.runs.campaign import Result, run_case
from dem_bridge.runs.case import Case
from dem_bridge.scene.file import load_scene
from dem_bridge.scene.scene import Scene, Wall
from dem_bridge.scene.timescales import rayleigh_time_of
from dem_bridge.studies.rule_of_thumb import (
    MOST_SAMPLES,
    SHARES,
    cases_of,
    errors_of,
    steps_at,
    study_rule_of_thumb,
    table,
)
from tests.helpers.strategies import log_uniform

CHAIN = replace(load_scene("decelerating-40"), name="short", duration=3e-4)
RAW = Scene(name="raw", duration=1e-4, mass=(8.1e-3, 1e-2), stiffness=(4e9,), velocity=(0.8, 0.0))


def _cells(shown: Table) -> dict[str, Any]:
    """Of the first row."""
    return dict(zip(shown.columns, shown.rows[0], strict=True))


@given(duration=log_uniform(1e-6, 1.0), rayleigh=log_uniform(1e-7, 1e-4))
def test_steps_are_at_most_the_share_and_fall_on_the_samples(duration: float, rayleigh: float) -> None:
    sampling, steps = steps_at(replace(RAW, duration=duration), rayleigh)
    assert sampling.count <= MOST_SAMPLES + 1
    for share, step in steps.items():
        per_sample = duration / sampling.count / step
        # whole up to a few roundings of numbers up to 8 per sample, or more where samples are few
        assert per_sample == pytest.approx(round(per_sample), rel=1e-12)
        assert step <= share * rayleigh * (1.0 + 1e-12)
        # rounding up adds less than one step to those at the longest share, and one row of samples to many
        assert step >= share * rayleigh / (1.0 + share_lost(duration, rayleigh))


def share_lost(duration: float, rayleigh: float) -> float:
    """One step of the coarsest run of all its steps; where samples are bounded, one more for each sample."""
    coarse = duration / (max(SHARES) * rayleigh)
    return 1.0 / coarse + 1.0 / MOST_SAMPLES + 1e-9 if coarse > MOST_SAMPLES else 1.0 / coarse + 1e-9


def test_errors_are_those_of_runs_at_these_steps() -> None:
    found = errors_of(CHAIN, [run_case(case) for case in cases_of(CHAIN)])
    rayleigh = rayleigh_time_of(CHAIN)
    assert rayleigh is not None
    sampling, steps = steps_at(CHAIN, rayleigh)
    for share in SHARES:
        run, truth = (
            db.solve(CHAIN, backend=name, dt=steps[share], samples=sampling.count, uncertainty=False)
            for name in ("verlet", "reference")
        )
        error = np.max(np.abs(run.velocity - truth.velocity)) / np.max(np.abs(truth.velocity))
        assert found.errors()[share] == pytest.approx(error, rel=1e-15)
        assert found.errors(column="dt")[share] == pytest.approx(steps[share], rel=1e-12)
        kinetic, exact = (float(np.sum(0.5 * np.array(CHAIN.mass) * one.velocity[-1] ** 2)) for one in (run, truth))
        assert found.errors("kinetic_energy_at_end")[share] == pytest.approx(abs(kinetic / exact - 1.0), rel=1e-9)
    errors = list(found.errors().values())
    assert errors == sorted(errors)
    # momentum is exact but for round-off: a hundred steps, forty bodies, an ulp each at most
    assert max(found.errors("momentum").values()) < 100 * 40 * np.finfo(float).eps


def test_nothing_is_said_of_momentum_where_a_wall_takes_it() -> None:
    walled = replace(CHAIN, wall_right=Wall(stiffness=CHAIN.stiffness[-1]))
    found = db.study("rule-of-thumb", walled, store=False)
    assert np.isnan(_cells(found.tables[0])["momentum at 20 %"])
    assert _cells(found.tables[0])["kinetic energy at 20 %"] > 0.0
    words = " ".join(found.answer)
    assert "momentum is conserved to" not in words
    assert "The momentum of this scene is not conserved." in words
    assert not any("momentum" in series.label for series in found.figures[0].panels[1].series)
    free = db.study("rule-of-thumb", CHAIN, store=False)
    assert "while the momentum is conserved to" in " ".join(free.answer)


def test_a_scene_without_bodies_says_why_its_row_is_empty() -> None:
    assert cases_of(RAW) == []
    found = study_rule_of_thumb(RAW)
    assert "No scene here has a Rayleigh time: raw: no Rayleigh time" in found.answer[0]
    cells = _cells(found.tables[0])
    assert np.isnan(cells["velocity at 20 % (%)"])
    assert np.isnan(cells["T_R (µs)"])
    assert (
        cells["missing because"] == "no Rayleigh time: the scene has masses and stiffnesses but no radii and materials"
    )
    # what does not need bodies is there: 2.943 d/v of the pair
    assert cells["collision (µs)"] == pytest.approx(55.7, rel=1e-2)


def test_a_run_that_breaks_leaves_its_cell_empty_and_its_reason_in_the_row() -> None:
    results = [run_case(case) for case in cases_of(CHAIN)]
    results[-1] = Result(case=results[-1].case, failure=RunBroken("verlet on short: velocities are not finite"))
    cells = _cells(table([errors_of(CHAIN, results)]))
    assert np.isnan(cells["velocity at 40 % (%)"])
    assert cells["velocity at 20 % (%)"] > 0.1
    assert cells["missing because"] == "verlet on short: velocities are not finite"


def _chain_study() -> Study:
    return db.study("rule-of-thumb", CHAIN, store=False)


@pytest.mark.lammps
def test_lammps_errs_as_its_twin_does_and_the_answer_says_so() -> None:
    found = _chain_study()
    rows = found.tables[1].rows
    assert [row[1] for row in rows] == [10.0, 20.0]
    for _, _, error, apart in rows:
        # the round-off of a small gauge, as measured elsewhere to 1e-9 at many more steps
        assert float(apart) < 1e-9 < 1e-2 * float(error)
    assert sum("LAMMPS on short" in sentence for sentence in found.answer) == 2
    assert found.figures[0].panels[1].series[0].style == "black line"


def test_without_lammps_the_twin_still_answers(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(case: Case, **settings: Any) -> Result:
        if case.backend.startswith("lammps"):
            return Result(case=case, failure=BackendUnavailable("no engine here"))
        return run_case(case, **settings)

    monkeypatch.setattr("dem_bridge.runs.campaign.tasks.run_case", missing)
    found = _chain_study()
    assert "the velocity error of velocity-Verlet on short is" in found.answer[0]
    assert not found.tables[1].rows
    assert found.tables[0].rows[0][-1] == "no engine here"
