"""`dem-bridge export`: what goes where, what is refused, and that words here are those of the package."""

from __future__ import annotations

import importlib.util
import io
import json
from collections.abc import Callable
from pathlib import Path

import pandas as pd
import pytest
from click.testing import CliRunner, Result

import dem_bridge as db
from dem_bridge.cli import main
from dem_bridge.foundation.files import write_whole
from tests.helpers.command_line import choices
from tests.helpers.fake_runs import CHAIN

Export = Callable[..., Result]


@pytest.fixture
def export(tmp_path: Path) -> Export:
    """Run ``dem-bridge export`` on a small scene."""
    scene = tmp_path / "small.toml"
    scene.write_text(CHAIN)
    return lambda *words: CliRunner().invoke(main, ["export", str(scene), *words])


def _one_line(done: Result, *parts: str) -> None:
    assert done.exit_code == 2
    assert done.stdout == ""
    assert done.stderr.count("\n") == 1, done.stderr
    for part in parts:
        assert part in done.stderr


def test_the_words_of_the_command_are_those_of_the_package() -> None:
    from dem_bridge.formats.tables import catalogue as tables
    from dem_bridge.formats.tables import render as formats

    assert tuple(tables.TABLES) == choices("export", "table")
    assert tuple(formats.FORMATS) == choices("export", "format")


def test_csv_goes_to_stdout_and_notes_beside_it(export: Export) -> None:
    done = export("--table", "contacts")
    assert done.exit_code == 0
    frame = pd.read_csv(io.StringIO(done.stdout))
    assert len(frame) == 2
    assert frame["peak_force_N"].notna().all()
    assert done.stderr.startswith("dem-bridge: note: the scene has no geometry")
    assert all(line.startswith("dem-bridge: note: ") for line in done.stderr.splitlines())


def test_the_file_tells_the_format_and_notes_stand_in_it(export: Export, tmp_path: Path) -> None:
    file = tmp_path / "bodies.json"
    done = export("--table", "bodies", "-o", str(file))
    assert (done.stdout, done.stderr, done.exit_code) == (f"written: {file}\n", "", 0)
    assert json.loads(file.read_text())["provenance"]["scene"] == "small"


def test_settings_reach_the_table(export: Export) -> None:
    cylinders = ("--radius", "9e-3", "--youngs-modulus", "72e9", "--poissons-ratio", "0.17")
    done = export(
        "--table", "stiffness-curve", "--angles", "2,90", *cylinders, "--columns", "angle_deg,slope_exact_per_deg"
    )
    assert done.stdout.splitlines()[0] == "angle_deg,slope_exact_per_deg"
    assert [line.split(",")[0] for line in done.stdout.splitlines()[1:]] == ["2.0", "90.0"]
    done = export("--table", "angles", "--law", "paper", "--within", "0.02", *cylinders, "--format", "md")
    assert "angle tolerance for 2 % of stiffness (°)" in done.stdout
    assert "by the paper law" in done.stdout
    done = export(
        "--table", "contacts", "--no-run", "--types", "per-body", "--columns", "type_right", "--format", "csv"
    )
    assert done.stdout.split() == ["type_right", "2", "3"]
    done = export("--table", "observables", "--backend", "verlet", "--dt", "1e-7", "--format", "json")
    assert json.loads(done.stdout)["provenance"]["settings"]["dt"] == pytest.approx(1e-7, rel=1e-12)


def test_the_same_as_in_python(export: Export, tmp_path: Path) -> None:
    done = export("--table", "pair-coeffs", "--format", "lammps")
    assert done.stdout == db.export(tmp_path / "small.toml", table="pair-coeffs", format="lammps")


def test_what_cannot_be_is_one_line_and_no_file(export: Export, tmp_path: Path) -> None:
    before = set(tmp_path.iterdir())
    _one_line(
        export("--table", "bodies", "--format", "parquet"),
        "parquet is a binary format and cannot be printed; name a file",
    )
    _one_line(export("--table", "bodies", "--format", "lammps"), "allowed: table 'pair-coeffs'")
    _one_line(export("--table", "bodies", "-o", str(tmp_path / "a.doc")), "no format has the file ending '.doc'")
    _one_line(export("--table", "bodies", "--columns", "mass"), "table 'bodies' has no column 'mass'")
    _one_line(export("--table", "angles"), "has no two crossed cylinders")
    _one_line(export("--table", "bodies", "--dt", "1e-7"), "table 'bodies' without a run has no setting 'dt'")
    _one_line(export("--table", "stiffness-curve", "--angles", "2,x"), "allowed: numbers separated by commas")
    _one_line(export("--table", "observables", "--backend", "verlet", "--accuracy", "0"), "accuracy = 0")
    assert set(tmp_path.iterdir()) == before


def test_a_file_that_cannot_be_finished_leaves_what_was_there(
    export: Export, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "bodies.csv"
    file.write_text("what was there")

    def full(self: Path, *words: object, **settings: object) -> int:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", full)
    _one_line(export("--table", "bodies", "-o", str(file), "--force"), "No space left on device")
    monkeypatch.undo()
    assert file.read_text() == "what was there"
    assert {one.name for one in tmp_path.iterdir()} == {"bodies.csv", "small.toml"}
    write_whole(tmp_path, {"bodies.csv": "again"})  # nothing is locked


@pytest.mark.skipif(importlib.util.find_spec("pyarrow") is None, reason="no pyarrow")
def test_parquet_goes_to_a_file(export: Export, tmp_path: Path) -> None:
    file = tmp_path / "bodies.parquet"
    assert export("--table", "bodies", "-o", str(file)).exit_code == 0
    assert pd.read_parquet(file)["mass_kg"].tolist() == [8.1e-3, 1e-2, 1e-2]


def test_a_unit_test_of_lammps_is_written_in_place_of_a_table(export: Export, tmp_path: Path) -> None:
    file = tmp_path / "dem01-small.yaml"
    done = export("--lammps-test", str(file), "--dt", "1e-6")
    assert done.exit_code == 0, done.output
    assert file.read_text().startswith("---\nlammps_version: the reference solution of dem_bridge ")
    assert db.scene_from_deck(file).mass == db.load_scene(tmp_path / "small.toml").mass
    _one_line(export("--lammps-test", str(file)), "exists")
    _one_line(export("--lammps-test", str(file), "--table", "contacts"), "--lammps-test was given with --table")
    _one_line(export(), "neither --table nor --lammps-test was given")
    done = CliRunner().invoke(main, ["export", "--lammps-test", str(file)])
    _one_line(done, "without a scene")
