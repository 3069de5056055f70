"""The script with the lines to write runs where it is; a script in which nothing happens is not called right."""

from __future__ import annotations

from pathlib import Path

import pytest

import dem_bridge as db
from dem_bridge.judging.check.subject import subject_of
from tests.helpers.checked_decks import script, variants

pytestmark = pytest.mark.lammps


def test_the_corrected_script_has_the_files_that_it_reads(tmp_path: Path) -> None:
    [variant] = [variant for variant in variants() if variant.name == "read_data, coarse"]
    answer = db.check(variant.write(tmp_path))
    assert answer.outcome == "FAIL"
    answer.save(tmp_path / "page")
    corrected = tmp_path / "page" / "corrected"
    assert {path.name for path in corrected.iterdir()} == {"in.chain", "balls.data"}
    assert db.check(corrected / "in.chain").outcome == "PASS"


def test_a_script_without_fix_nve_is_not_called_right(tmp_path: Path) -> None:
    (tmp_path / "in.chain").write_text(script(fixes=""))
    answer = db.check(tmp_path / "in.chain")
    assert (answer.outcome, answer.step["outcome"]) == ("UNDECIDED", "UNDECIDED")
    assert "which no fix nve moves" in answer.headline
    assert "No velocity changes during the run, so no step is tested." in answer.headline


@pytest.mark.parametrize(("units", "unit"), [("si", "s"), ("cgs", "s"), ("lj", "tau"), ("metal", "ps"), ("real", "fs")])
def test_times_are_told_in_the_units_of_the_script(tmp_path: Path, units: str, unit: str) -> None:
    (tmp_path / "in.chain").write_text(script(units=f"units {units}"))
    with subject_of(tmp_path / "in.chain") as subject:
        assert subject.time_unit == unit
