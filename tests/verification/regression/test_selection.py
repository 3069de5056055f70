"""The runs that a regression selects, without any of them being made."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

import dem_bridge as db
from dem_bridge.errors import UsageError
from dem_bridge.lmp.engine import Engine
from dem_bridge.scene.file.write import scene_toml
from dem_bridge.verification.regression import run
from dem_bridge.verification.regression.compare import Change
from dem_bridge.verification.regression.run import Selection, compare_engines
from tests.helpers.three_bodies import THREE

BASELINES = Path(__file__).parents[3] / "reports" / "baselines"


def test_a_scene_of_the_user_has_no_source_and_a_shipped_one_its_name(tmp_path: Path) -> None:
    shipped, file = db.load_scene("decelerating-40"), tmp_path / "scenes" / "three.toml"
    file.parent.mkdir()
    file.write_text(scene_toml(replace(THREE, name="of-a-file")))
    selection = Selection(scenes=(shipped, THREE, file, "accelerating-40"), backends=("bca",), folder=tmp_path / "new")
    tasks, gone = selection.tasks()
    # a file is found from the baselines
    assert [(task.case.scene.name, task.source) for task in tasks] == [
        ("decelerating-40", "decelerating-40"), (THREE.name, ""), ("of-a-file", "../scenes/three.toml"),
        ("accelerating-40", "accelerating-40"),
    ]  # fmt: skip
    assert gone == []


def test_a_backend_with_a_baseline_is_selected_once() -> None:
    tasks, gone = Selection(scenes=("decelerating-40",), backends=("lammps-granular",), folder=BASELINES).tasks()
    assert [(task.case.scene.name, task.case.backend) for task in tasks] == [("decelerating-40", "lammps-granular")]
    assert tasks[0].baseline is not None
    assert gone == []


def test_baselines_of_a_backend_that_no_longer_exists_are_gone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(run, "BACKENDS", ())
    tasks, gone = Selection(folder=BASELINES).tasks()
    assert tasks == []
    assert len(gone) == len(list(BASELINES.glob("*.json"))) > 0
    assert {item.change for item in gone} == {Change.GONE}
    assert all(f"the backend {item.backend} no longer exists; restore it" in item.sentence for item in gone)


def test_engines_are_compared_on_baselines_of_lammps(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="the folder has no baselines of LAMMPS; name the scenes on which to compare"):
        compare_engines(Selection(folder=tmp_path), Engine())
