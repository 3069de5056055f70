"""Files of other versions: those of the schema before are read, and newer ones refused with what to do."""

from __future__ import annotations

import hashlib
import importlib
import json
import re
from pathlib import Path

import numpy as np
import pytest

import dem_bridge as db
from dem_bridge.errors import SceneError, UsageError
from dem_bridge.runs import inspect
from dem_bridge.runs.store import SUFFIX, Store
from dem_bridge.scene.file import parse_scene
from dem_bridge.verification.regression.baseline import read_baseline
from dem_bridge.verification.regression.run import with_since
from tests.helpers.fake_runs import CHAIN, free_flight

ROOT = Path(__file__).parent.parent
PAGE = (ROOT / "docs" / "versions.md").read_text(encoding="utf-8")
UPDATE = "a newer dem_bridge wrote it: update"


def test_a_trajectory_of_the_schema_before_is_read() -> None:
    # written by the last commit with schema 1; these are the numbers that it printed
    run = db.load_trajectory(ROOT / "tests" / "data" / "trajectory-1.nc")
    assert run.uncertainty["velocity"] == 4.790531352059231e-06
    assert run.uncertainty["displacement"] == 1.0609179714670894e-10
    assert run.uncertainty["peak_force"] == pytest.approx([0.00161107], rel=1e-5)
    assert run.uncertainty["crossing_time"] == pytest.approx([1.80893869e-10], rel=1e-8)
    assert (dict(run.uncertainty.parts), run.uncertainty.cost.steps) == ({}, 0)
    assert run.velocity[0] == pytest.approx([0.8, 0.0], abs=0.0)
    # 8.1 g at 0.8 m/s
    assert run.velocity @ [8.1e-3, 10.1e-3] == pytest.approx(np.full(11, 6.48e-3), rel=1e-12)


def test_a_scene_file_may_name_its_schema_and_a_newer_one_is_refused() -> None:
    assert parse_scene(f'schema = "dem-bridge/scene/1"\n{CHAIN}') == parse_scene(CHAIN)
    with pytest.raises(SceneError) as refused:
        parse_scene(f'schema = "dem-bridge/scene/2"\n{CHAIN}', where="small.toml")
    allowed = "'dem-bridge/scene/1'"
    assert str(refused.value) == f"small.toml: schema = 'dem-bridge/scene/2'; allowed: {allowed}; {UPDATE}"
    with pytest.raises(SceneError, match=r"schema = 3; allowed: 'dem-bridge/scene/1'$"):
        parse_scene(f"schema = 3\n{CHAIN}")


def test_a_newer_baseline_and_a_newer_regression_are_refused(tmp_path: Path) -> None:
    source = next((ROOT / "reports" / "baselines").glob("*.json"))
    newer = tmp_path / source.name
    newer.write_text(source.read_text(encoding="utf-8").replace("baseline/1", "baseline/3", 1), encoding="utf-8")
    with pytest.raises(UsageError, match=rf"schema = 'dem-bridge/baseline/3'; .*; {UPDATE}"):
        read_baseline(newer)
    with pytest.raises(UsageError, match=rf"before.json: schema = 'dem-bridge/regression/2'; .*; {UPDATE}"):
        with_since(None, {"schema": "dem-bridge/regression/2"}, "before.json")  # type: ignore[arg-type]


def test_entries_of_another_version_of_the_store_are_listed_and_left_alone(tmp_path: Path) -> None:
    store = Store(tmp_path)
    key = "0" * 64
    content = json.dumps({"schema": "dem-bridge/store/2", "key": key, "arrays": []}).encode() + b"\n"
    file = tmp_path / f"{key}{SUFFIX}"
    file.write_bytes(hashlib.sha256(content).hexdigest().encode() + b"\n" + content)
    assert [entry.key for entry in inspect.entries(store)] == [key]
    assert inspect.check(store) == (1, [])
    assert file.exists()
    # but one that was changed is damaged, whatever its version
    file.write_bytes(file.read_bytes() + b"x")
    assert len(inspect.check(store)[1]) == 1


@pytest.mark.studies
def test_the_page_lists_every_schema_with_its_number() -> None:
    found = set()
    for file in sorted((ROOT / "dem_bridge").rglob("*.py")):
        for schema in re.findall(r'^SCHEMA = "(dem-bridge/[\w/-]+)"', file.read_text(encoding="utf-8"), re.MULTILINE):
            module = ".".join(file.relative_to(ROOT).with_suffix("").parts)
            assert schema == importlib.import_module(module).SCHEMA
            found.add(schema)
    assert len(found) >= 8
    listed = set(re.findall(r"`(dem-bridge/[\w-]+/\d+)` \|", PAGE))
    assert listed == found
    assert free_flight().to_xarray().attrs["schema"] in found
