"""The limits of the planner: searches that give up, floors, budgets, and what is said where no run is made."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

import dem_bridge as db
from dem_bridge.backends.base import Sampling
from dem_bridge.errors import UsageError
from dem_bridge.runs.planning import backend_options as options
from dem_bridge.runs.planning import planner
from dem_bridge.runs.planning import trials as check
from dem_bridge.runs.planning.predict import tidy
from dem_bridge.runs.planning.trials import Candidate, Judge, Settled, Trial, confirm, settle
from dem_bridge.scene.scene import Scene
from tests.runs.planning.test_planner import FIVE, PAIR

#: a chain that all theories solve
FREE = replace(FIVE, name="five-free", gap=0.0, wall_right=None, duration=2e-4)
SCIPY = Candidate(name="scipy", runs="scipy", knob="rtol", order=1.0)


def test_a_search_gives_up_after_its_last_trial() -> None:
    # errors fall, but slower than any order: neither a floor nor the target is met
    settled = settle(lambda s: Trial(setting=s, error=s**0.2), 1.0, 1e-9, order=2.0, least=1e-300, most=1.0)
    assert (settled.best, len(settled.trials)) == (None, 16)


def test_a_confirmation_gives_up_after_its_last_trial() -> None:
    first = Settled(best=Trial(setting=1.0, error=math.inf), trials=())
    settled = confirm(lambda s: Trial(setting=s, error=math.inf), first, 1.0, order=2.0, least=0.0)
    assert (settled.best, len(settled.trials)) == (None, 400)


def test_the_finest_tolerance_has_no_finer_run_that_shows_its_error() -> None:
    judge = Judge(scene=PAIR, sampling=Sampling(count=10), observable="velocity", reference=None, progress=print)
    trial = judge.trial(SCIPY, 1e-20)
    assert (trial.setting, trial.error) == (check.LEAST_RTOL, math.inf)


@pytest.mark.parametrize(
    ("low", "high", "number"),
    [
        (2.5, math.inf, 2.5),
        (1.0, 1.0 + 2.0**-52, 1.0),
        (1.5, float(np.nextafter(1.5, 2.0)), 1.5),
        (99.0, 101.0, 100.0),
        (1.0, 3.0, 2.0),
        (0.8, 1.5, 1.0),
    ],
)
def test_a_tidy_number_of_an_unusual_range(low: float, high: float, number: float) -> None:
    assert tidy(low, high) == number


@pytest.mark.parametrize(("low", "high"), [(2.0, 1.0), (1.0, 1.0), (0.0, 1.0), (-1.0, 1.0)])
def test_a_range_without_numbers_above_zero_is_refused(low: float, high: float) -> None:
    with pytest.raises(UsageError, match=f"low = {low!r}, high = {high!r}; allowed: 0 < low < high"):
        tidy(low, high)


def test_reasons_of_plans_that_no_run_checks() -> None:
    reference = db.plan(FREE, 1e-6, "reference", predict_only=True)
    assert reference.reasons[0] == (
        "no run checked the prediction: in 95 % of the random scenes reference errs by no more"
    )
    assert (reference.resolution, reference.steps, reference.units) == ({}, None, {})
    theory = db.plan(FREE, 0.5, "bca", observable="arrival_at_end", predict_only=True)
    assert 0.0 < theory.predicted_error < 0.5
    with pytest.raises(UsageError, match="not expected to be reached by bca: the smallest predicted error is inf"):
        db.plan(FREE, 0.5, "bca", predict_only=True)


def test_a_law_and_a_body_alone_are_predicted() -> None:
    law = replace(FREE, name="law", law=lambda overlap: 4e9 * overlap**1.5)
    steps = db.plan(law, 1e-3, "verlet", predict_only=True)
    assert steps.resolution["dt"] * steps.units["2/omega"] > 0.0
    alone = Scene(name="alone", duration=1e-3, mass=(1.0,), stiffness=(), velocity=(1.0,))
    assert db.plan(alone, 1e-3, "verlet", predict_only=True).units == {"dt": alone.duration / alone.samples}


def test_a_theory_is_measured_against_the_reference_or_not_at_all() -> None:
    plan = db.plan(FREE, 0.5, "bca", observable="arrival_at_end")
    arrival = [float(np.nanmax(db.solve(FREE, backend=name).crossing_time)) for name in ("bca", "reference")]
    assert plan.found_error == pytest.approx(abs(arrival[0] / arrival[1] - 1.0), rel=1e-9)
    # at this accuracy the reference is too uncertain
    with pytest.raises(UsageError, match="bca: no reference is cheap enough to measure its error; ask for less"):
        db.plan(FREE, 1e-14, "bca", observable="arrival_at_end")


def test_tables_that_stay_too_coarse_are_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(planner, "TABLE_SHARE", 1e-12)
    monkeypatch.setattr(planner, "TABLE_POINTS", (None, 20_000))
    with pytest.raises(UsageError, match=r"lammps-table: tables of 20000 points have an interpolation error of \d"):
        db.plan(FREE, 1e-3, "lammps-table")


def test_a_budget_below_the_cost_of_a_backend_without_settings_buys_nothing() -> None:
    with pytest.raises(
        UsageError, match=r"s of CPU by reference, and the budget is 1e-09 s; it buys no meaningful run"
    ):
        db.plan(FREE, 1e-6, "reference", budget=1e-9)


@pytest.mark.parametrize(("accuracy", "error"), [(3e-5, "smallest measured"), (1e-5, "predicted")])
def test_the_finest_step_that_may_be_taken_is_said(
    accuracy: float, error: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    for module in (options, planner):
        monkeypatch.setattr(module, "MOST_STEPS", 400)
    with pytest.raises(UsageError, match=rf"verlet: the {error} error is 0\.00\d+,? with 4e\+02 steps; ask for less"):
        db.plan(FREE, accuracy, "verlet")


def test_progress_goes_from_the_reference_to_the_runs() -> None:
    calls: list[tuple[float, int, str]] = []
    db.plan(FREE, 1e-3, "verlet", progress=lambda *words: calls.append(words))
    parts, totals, labels = zip(*calls, strict=True)
    assert set(totals) == {1}
    assert list(parts) == sorted(parts)
    assert 0.0 <= parts[0] <= parts[-1] <= 1.0
    assert labels[0] == "reference by reference"
    assert any(label.startswith("verlet at dt = ") for label in labels)
