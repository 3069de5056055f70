"""Digits in single precision: the table has the errors of the runs, and the modes are told apart."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from dem_bridge.backends import precision
from dem_bridge.backends.base import Resolution, Sampling, backend
from dem_bridge.errors import UnsupportedScene
from dem_bridge.scene.file import load_scene
from dem_bridge.scene.scene import Damping
from dem_bridge.studies.precision import REAL, SAMPLES, SURROGATE, Rounded, errors_of, study_precision

THREE = load_scene("sphere-cylinder-sphere")


def _errors(factor: int = 20, with_reference: bool = False) -> dict[str, Rounded]:
    return {row.kind: row for row in errors_of(THREE, factor, with_reference)}


def test_errors_grow_with_the_positions_and_with_what_is_single() -> None:
    rows = _errors()
    assert rows[REAL].radius == pytest.approx(9e-3)
    for row in rows.values():
        # a rounding once, or at random once a step: the scales of the predictions within the factor of the study, 40
        assert row.error["mixed"] < 40.0 * row.mixed
        assert row.error["single"] < 40.0 * row.single
        assert row.error["double"] < 1e-2 * row.error["force"] < 1e-2 * row.error["mixed"] < row.error["single"]
    assert rows[REAL].error["mixed"] > 30.0 * rows[SURROGATE].error["mixed"]


def test_errors_against_the_reference_are_those_of_the_step_in_double_precision() -> None:
    row = _errors(with_reference=True)[SURROGATE]
    run, exact = (
        backend(name).run(THREE, resolution, Sampling(count=SAMPLES)).velocity
        for name, resolution in (("verlet", Resolution(dt=row.dt)), ("reference", Resolution()))
    )
    error = np.max(np.abs(run - exact)) / np.max(np.abs(exact))
    # but for the round-off of positions, which is measured
    assert row.total["double"] == pytest.approx(error, abs=2.0 * row.error["double"])


def test_a_mode_that_is_double_by_mistake_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    faulty: Mapping[str, Any] = {**precision.PRECISIONS, "mixed": precision.PRECISIONS["force"]}
    monkeypatch.setattr(precision, "PRECISIONS", faulty)
    rows = _errors()
    assert rows[REAL].error["mixed"] < 2.0 * rows[SURROGATE].error["mixed"]


def test_the_study_states_the_digits_of_each_mode(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("dem_bridge.studies.precision.FACTORS", (20, 50))
    study = study_precision(THREE, jobs=1)
    rows = study.tables[0].as_json()
    assert [row["radius"] for row in rows] == [SURROGATE, REAL]
    for sentence, row in zip(study.answer, rows, strict=False):
        assert f"{row['mixed']:.1g} to {row['mixed']:.1g} ({math.floor(-math.log10(row['mixed']))} digits)" in sentence
    # steps are at most so many default ones, and fall on the samples
    for factor, row in zip((20, 50), study.tables[1].as_json()[::2], strict=True):
        assert 0.7 * factor < row["step (s)"] / rows[0]["step (s)"] <= factor * (1.0 + 1e-9)
    assert "on sphere-cylinder-sphere with the surrogate radius" in study.answer[3]


def test_a_scene_with_damping_is_refused() -> None:
    with pytest.raises(UnsupportedScene, match="dashpot damping"):
        study_precision(replace(THREE, damping=Damping(law="dashpot", coefficient=1.0)))
