"""Error bars hold on every tenth of the 300 random scenes with a stored truth; tests/bench/bench_bars.py has all."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import dem_bridge as db
from dem_bridge.trajectory.trajectory import QUANTITIES
from tests.bench.bench_bars import trials
from tests.helpers.random_scenes import COUNT, random_scene, random_truth

SEEDS = range(0, COUNT, 10)


def test_the_bars_of_the_reference_hold_in_all() -> None:
    runs = list(trials("reference", SEEDS))
    assert len(runs) == len(SEEDS)
    assert {trial.seed: trial.outside for trial in runs if max(trial.outside.values()) > 1.0} == {}
    assert all(all(trial.finite.values()) for trial in runs)


#: LAMMPS' error bars are computed from runs of the twin, so three scenes show whether they are handed on; a run of
#: LAMMPS takes 0.4 s of CPU, and the 30 of them are in `make test-all`
LAMMPS_SEEDS = SEEDS[::10]


@pytest.mark.parametrize(
    ("backend", "seeds", "fractions"),
    [
        pytest.param("verlet", SEEDS, (1 / 50,), id="verlet"),
        pytest.param("verlet", SEEDS, (1 / 25, 1 / 50, 1 / 100), marks=pytest.mark.slow, id="verlet, three steps"),
        pytest.param("lammps-granular", LAMMPS_SEEDS, (1 / 50,), marks=pytest.mark.lammps, id="lammps"),
        pytest.param(
            "lammps-granular", SEEDS, (1 / 50,), marks=[pytest.mark.lammps, pytest.mark.slow], id="lammps, all"
        ),
    ],
)
def test_the_bars_of_fixed_steps_hold(backend: str, seeds: range, fractions: tuple[float, ...]) -> None:
    runs = list(trials(backend, seeds, fractions))
    for quantity in QUANTITIES:
        # of 100 runs one may be outside; 30 scenes at one step allow none
        outside = [trial.seed for trial in runs if trial.outside[quantity] > 1.0]
        assert len(outside) <= len(runs) // 90, (quantity, outside)
        # of three scenes one that may touch at its end widens the median
        assert np.nanmedian([trial.wide[quantity] for trial in runs]) <= (5.0 if len(runs) > 3 else 10.0), quantity
        # the closing rate of one contact in scene 220 comes so near to zero that its first maximum is undecided
        assert np.mean([trial.finite[quantity] for trial in runs]) >= 0.96, quantity


@pytest.mark.parametrize("quantity", QUANTITIES)
def test_a_bar_that_is_too_narrow_is_noticed(quantity: str) -> None:
    scene, truth = random_scene(0), random_truth(0)
    run = db.solve(scene, backend="verlet", dt=scene.duration / 1e4, uncertainty=False)
    error = truth.error(run, quantity)
    too_narrow: Any = 0.9 * error if error.size > 1 else 0.9 * error[0]
    narrow = replace(run, uncertainty=replace(run.uncertainty, **{quantity: too_narrow}))
    assert truth.outside(narrow, quantity) == pytest.approx(1.0 / 0.9)
