"""The public function of studies: scenes by name or path, the folder of a page, and the store."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import dem_bridge as db
from dem_bridge.errors import UnsupportedScene, UsageError
from tests.helpers.export_chains import CROSSED_FILE


def test_a_study_takes_a_scene_a_name_or_a_path_and_writes_into_the_folder(tmp_path: Path) -> None:
    settings: dict[str, Any] = {"spread": 1.0, "count": 2, "seed": 3, "store": False}
    (tmp_path / "crossed.toml").write_text(CROSSED_FILE)
    scene = db.load_scene(tmp_path / "crossed.toml")
    one = db.study("scatter", tmp_path / "crossed.toml", folder=tmp_path / "found", **settings)
    same = db.study("scatter", scene, **settings)
    with pytest.raises(UnsupportedScene, match="tapered-forward has no contact angles"):
        db.study("scatter", "tapered-forward", **settings)
    assert one.as_json()["tables"] == same.as_json()["tables"]
    other = db.study("scatter", scene, **{**settings, "seed": 5})
    assert other.as_json()["tables"] != same.as_json()["tables"]
    for name in ("index.html", "scatter.json", "tables/scatter.csv"):
        assert (tmp_path / "found" / name).is_file()


def test_a_folder_that_cannot_be_written_is_refused_before_a_study_runs(tmp_path: Path) -> None:
    (tmp_path / "taken").write_text("")
    with pytest.raises(UsageError, match="taken"):
        db.study("scatter", "decelerating-40", count=100_000, folder=tmp_path / "taken", store=False)


def test_the_runs_of_a_study_are_kept_in_the_store(tmp_path: Path) -> None:
    told: list[str] = []
    settings: dict[str, Any] = {"count": 2, "store": tmp_path, "jobs": 1}
    steel = db.Material(youngs_modulus=193e9, poissons_ratio=0.3, density=8000.0)
    rods = [db.Body(shape="cylinder", radius=5e-3, height=1e-2, material=steel)] * 3
    chain = replace(db.chain(name="rods", duration=2e-4, bodies=rods, velocity=0.5, angles=(30.0, 60.0)), drag=1.0)
    first = db.study("scatter", chain, **settings)
    again = db.study("scatter", chain, progress=lambda done, total, label: told.append(label), **settings)
    assert told == []  # nothing was run
    assert again.as_json() == first.as_json()
