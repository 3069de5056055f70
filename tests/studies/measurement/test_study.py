"""The study of a measurement: from a scene file with [measurement] to outcome, page and JSON."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

import dem_bridge as db
from dem_bridge.cli import main
from dem_bridge.errors import UsageError
from dem_bridge.observables.verdict import Outcome
from dem_bridge.studies.measurement.study import study_measurement
from tests.helpers.synthetic import SCENE, motion, table

TIMES = np.linspace(2e-6, 2.4e-4, 100)
TABLE = """
[measurement]
file = "laser.csv"
source = "figure 3 of a paper"
kind = "digitised"
[measurement.parameters]
stiffness = 0.002
"""


def _scene(folder: Path, stiffness: float, seed: int = 1) -> Path:
    velocity, _ = motion(TIMES, stiffness=stiffness)
    (folder / "laser.csv").write_text(table(TIMES, velocity, 0.003, seed))
    (folder / "row.toml").write_text(SCENE + TABLE)
    return folder / "row.toml"


def test_a_bias_is_a_difference_of_the_model_and_is_fitted(tmp_path: Path) -> None:
    found = db.study("measurement", _scene(tmp_path, 1.02), samples=20)
    assert {verdict.quantity: verdict.outcome for verdict in found.verdicts} == dict.fromkeys(
        ("velocity", "parameters"), Outcome.MODEL_DIFFERENCE
    )
    assert found.exit_code == 0
    (row,) = next(item for item in found.tables if item.id == "fit").as_json()
    assert row["low"] < 0.02 < row["high"]
    assert re.search(r"stiffness is [12]\.\d\d % \+- 0\.\d\d % above the scene's value", found.answer[2])
    assert "With the fitted values the scene explains the measurement" in found.answer[3]


def test_a_right_model_passes_and_a_digitised_figure_is_not_called_data(tmp_path: Path) -> None:
    scene = _scene(tmp_path, 1.0)
    done = CliRunner().invoke(
        main, ["study", "measurement", str(scene), "--samples", "20", "-o", str(tmp_path / "out"), "--json"]
    )
    assert done.exit_code == 0, done.output
    record = json.loads(done.stdout)
    assert [verdict["outcome"] for verdict in record["verdicts"]] == ["PASS", "PASS"]
    assert record["provenance"]["kind"] == "digitised"
    page = (tmp_path / "out" / "index.html").read_text(encoding="utf-8")
    assert "Source of the digitised figure: figure 3 of a paper." in page
    lines = (tmp_path / "out" / "differences.csv").read_text().splitlines()
    assert len(lines) == 1 + 2 * len(TIMES)
    for name in ("overlay", "differences"):
        assert (tmp_path / "out" / "figures" / f"measurement-{name}.svg").is_file()


def test_uncertainties_as_large_as_the_quantity_decide_nothing(tmp_path: Path) -> None:
    velocity, _ = motion(TIMES)
    (tmp_path / "noisy.csv").write_text(table(TIMES, velocity, 0.6, 2))
    scene = db.load_scene(_scene(tmp_path, 1.0))
    found = study_measurement(scene, files=[str(tmp_path / "noisy.csv")], samples=10)
    assert [verdict.outcome for verdict in found.verdicts] == [Outcome.UNDECIDED]
    assert found.exit_code == 4


def test_forces_and_a_coarse_run_of_another_code_are_compared(tmp_path: Path) -> None:
    _, force = motion(TIMES)
    rows = [f"{t:.9e},1,{f:.9g},2" for t, f in zip(TIMES, force[:, 1], strict=True)]
    (tmp_path / "force.csv").write_text("\n".join(["time_s,contact,force_N,uncertainty_N", *rows]))
    scene = db.load_scene(_scene(tmp_path, 1.0))
    found = study_measurement(scene, files=[str(tmp_path / "force.csv")], backend="verlet", dt=2e-7)
    row = next(item for item in found.tables if item.id == "series").as_json()[0]
    assert row["series"] == "contact force of contact 1"
    # the error of this step is seen in u_num, and covers the difference: there is no noise
    assert 0.0 < row["E"] < row["u_num"] < 2.0


def test_a_value_that_the_scene_never_has_is_refused(tmp_path: Path) -> None:
    scene = db.load_scene(_scene(tmp_path, 1.0))
    (tmp_path / "arrival.csv").write_text("body,arrival_us,uncertainty_us\n3,90,5\n")
    settings: dict[str, Any] = {"files": [str(tmp_path / "arrival.csv")], "samples": 10}
    (row,) = db.study("measurement", scene, **settings).tables[-1].as_json()
    assert row["series"] == "arrival of body 3"
    short = replace(scene, duration=3e-5)
    with pytest.raises(UsageError, match="arrival of body 3 is measured, but reference has no value of it on row"):
        db.study("measurement", short, **settings)


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"files": ["none.csv"]}, "none.csv: the file of [measurement] cannot be read (No such file or directory)"),
        (
            {"files": []},
            "row has no file of measured values; allowed: the path of a scene file (a loaded Scene does not hold it)",
        ),
        ({"coverage": 0.0}, "coverage = 0.0; allowed: a number > 0, up to 10"),
        ({"samples": 2}, "samples = 2; allowed: a whole number from 10"),
        ({"files": ["a.csv"], "parameters": ["stiffness"]}, "parameter = 'stiffness'; allowed: NAME=UNCERTAINTY"),
    ],
)
def test_what_cannot_be_compared_is_said_in_one_line(tmp_path: Path, settings: dict[str, Any], said: str) -> None:
    scene = db.load_scene(_scene(tmp_path, 1.0))
    with pytest.raises(UsageError) as error:
        db.study("measurement", scene, **settings)
    assert said in str(error.value)
    assert "\n" not in str(error.value)
