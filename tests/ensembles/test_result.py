"""What an ensemble says of its values and of the chains that other codes solved, from made-up numbers."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
import pytest

from dem_bridge.ensembles.draw import Variation
from dem_bridge.ensembles.result import Ensemble
from dem_bridge.ensembles.run import run_ensemble
from dem_bridge.errors import UsageError
from tests.helpers.three_bodies import THREE

VALUES = np.array([[0.0, np.nan, 3.0], [1.0, np.nan, 5.0], [2.0, np.nan, np.nan]])


def _ensemble(*rows: tuple[int, str, str, float, float, str]) -> Ensemble:
    columns = ["chain", "code", "observable", "difference", "uncertainty", "failure"]
    variation: Any = None
    checked = pd.DataFrame(rows, columns=columns)
    return Ensemble(variation=variation, values={"peak_force": VALUES}, accuracy=1e-3, steps=1, checked=checked)


def test_quantiles_leave_out_chains_without_a_value() -> None:
    found = _ensemble().quantiles("peak_force", (0.5, 1.0))
    np.testing.assert_array_equal(found, [[1.0, np.nan, 4.0], [2.0, np.nan, 5.0]])


@pytest.mark.parametrize(
    ("observable", "q", "message"),
    [
        ("speed", (0.5,), r"observable = 'speed'; allowed: peak_force"),
        ("peak_force", (0.5, 1.5), r"q = \(0\.5, 1\.5\); allowed: numbers from 0 to 1"),
        ("peak_force", (float("nan"),), r"q = \(nan,\); allowed: numbers from 0 to 1"),
    ],
)
def test_quantiles_of_nothing_are_refused(observable: str, q: tuple[float, ...], message: str) -> None:
    with pytest.raises(UsageError, match=message):
        _ensemble().quantiles(observable, q)


def test_the_agreement_counts_chains_that_failed_agree_and_differ() -> None:
    assert _ensemble().agreement == "no chain was checked by another code"
    lost = (0, "lammps-granular", "peak_force", np.nan, np.nan, "it broke")
    assert _ensemble(lost).agreement == "lammps-granular has no run of 1 chains"
    good = (1, "lammps-granular", "peak_force", 1e-4, 1e-5, "")
    assert _ensemble(lost, good).agreement == (
        "lammps-granular has no run of 1 chains; 1 chains by lammps-granular differ by at most 1.0e-04"
    )
    bad = (2, "lammps-granular", "arrival_at_end", 2e-3, 5e-4, "")
    assert _ensemble(good, bad).agreement == (
        "2 chains by lammps-granular differ by at most 2.0e-03; 1 of these chains disagree: arrival_at_end differ by"
        " more than the accuracy 0.001 and the uncertainty of lammps-granular"
    )


def test_progress_counts_chains() -> None:
    calls: list[tuple[float, int, str]] = []
    variation = Variation(scene=THREE, vary={"mass": 0.01}, seed=0, sampler="sobol")
    run_ensemble(variation, 3, checks=0, progress=lambda *words: calls.append(words))
    assert calls
    assert calls[-1][:2] == (3, 3)
