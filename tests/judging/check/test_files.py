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


#: files that hold no command which LAMMPS executes on the motion: variables, an include, words to print
_PARTS = {
    "numbers.inc": "variable modulus equal 2e11\nvariable many file list.txt\n",
    "list.txt": "7\n8\n",
    "more.inc": "include said.inc\n",
    "said.inc": "# only this\nprint 'a chain'\n",
    "parts/step.inc": "timestep 2e-6\n",
}


def in_parts(folder: Path) -> Path:
    """Write a coarse script whose variables, words and step are in included files."""
    included = "include numbers.inc\ninclude more.inc"
    text = script(step="include parts/step.inc", more=included, run="variable n equal 150\nrun ${n}")
    for name, body in {**_PARTS, "in.chain": text.replace("hertz/material 2e+11", "hertz/material 2e11")}.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(body)
    return folder / "in.chain"


def test_files_that_hold_only_variables_or_includes_are_beside_the_run(tmp_path: Path) -> None:
    answer = db.check(in_parts(tmp_path))
    assert (answer.outcome, answer.law["outcome"]) == ("FAIL", "PASS"), answer


def test_the_corrected_script_has_the_files_without_a_changed_line(tmp_path: Path) -> None:
    answer = db.check(in_parts(tmp_path))
    answer.save(tmp_path / "page")
    corrected = tmp_path / "page" / "corrected"
    files = {path.relative_to(corrected).as_posix() for path in corrected.rglob("*") if path.is_file()}
    assert files == {"in.chain", *_PARTS}
    assert (corrected / "parts/step.inc").read_text() != _PARTS["parts/step.inc"]
    assert db.check(corrected / "in.chain").outcome == "PASS"
