"""Why a run of LAMMPS loses bodies, or cannot be read as a chain, is said with body, face, time and line."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

import dem_bridge as db
from dem_bridge.judging.check import lammps_run
from dem_bridge.judging.check.answer import Check
from tests.helpers.checked_decks import RADIUS, script

pytestmark = pytest.mark.lammps

SMALL = f"region box block {-2 * RADIUS:g} {12 * RADIUS:g} -0.02 0.02 -0.02 0.02 units box\ncreate_box 2 box"
HALVED = "\n".join(f"create_atoms 1 single {RADIUS * k:.15g} 0 0 units box" for k in range(5))
CLOSE = "\n".join(f"create_atoms 1 single {1.998 * RADIUS * k:.15g} 0 0 units box" for k in range(5))


def check(folder: Path, **parts: Any) -> Check:
    (folder / "in.chain").write_text(script(**parts))
    return db.check(folder / "in.chain")


def test_a_body_that_leaves_although_lost_ones_are_ignored_is_named_with_face_and_time(tmp_path: Path) -> None:
    answer = check(
        tmp_path,
        boundary="boundary f f f",
        box=SMALL,
        more="thermo_modify lost ignore",
        length=1500.0,
        per_contact=50.0,
    )
    assert (answer.outcome, answer.exit_code) == ("BROKEN", 3)
    said = answer.law["sentence"]
    assert said.startswith("atom 5 leaves the box through its face xhi = 0.06 between the times 0.0")
    assert "LAMMPS stopped" not in said
    assert answer.advice == ["boundary m m m  # line 4 of in.chain"]


def test_bodies_that_overlap_by_a_radius_are_named_and_another_box_is_no_advice(tmp_path: Path) -> None:
    answer = check(tmp_path, boundary="boundary f f f", atoms=HALVED, length=60.0)
    assert "begin with an overlap of 100 % of the smaller radius" in answer.law["sentence"]
    assert answer.plausibility[0]["name"] == "start"
    assert answer.advice == []


def test_a_minimization_is_named_by_its_line_and_another_box_is_no_advice(tmp_path: Path) -> None:
    answer = check(tmp_path, boundary="boundary f f f", atoms=CLOSE, run="minimize 0 1e-3 10 100\nrun 1000")
    assert "`minimize 0 1e-3 10 100` is not supported" in answer.headline
    assert answer.advice == []


def test_a_run_whose_forces_cannot_be_read_was_made_and_its_step_is_judged(tmp_path: Path) -> None:
    answer = check(tmp_path, fixes="fix first first nve\nfix move all nve", per_contact=40.0)
    assert answer.law["outcome"] == "UNDECIDED"
    assert "`fix move all nve` integrates atoms that another fix integrates" in answer.headline
    assert answer.step["outcome"] == "FAIL"
    assert len(answer.advice) == 2


def test_a_run_that_is_too_long_for_the_time_limit_ends_and_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def too_long(*arguments: Any) -> float:
        raise AssertionError("our code would take minutes before LAMMPS begins")

    monkeypatch.setattr(lammps_run, "_share_of_time", too_long)
    (tmp_path / "in.chain").write_text(script(run="run 2000000000", boundary="boundary m m m"))
    answer = db.check(tmp_path / "in.chain", time_limit=3.0)
    assert answer.outcome == "BROKEN"
    assert "time limit of 3 s" in answer.law["sentence"]
    assert "of 2000000000 steps neither law nor step is checked" in answer.law["sentence"]


def test_only_the_coarse_step_of_two_is_to_be_written(tmp_path: Path) -> None:
    answer = check(tmp_path, step="timestep 2e-6\nrun 100\ntimestep 2e-7", run="run 600")
    assert answer.step["outcome"] == "FAIL"
    assert {line.split()[0] for line in answer.advice} == {"timestep", "run"}
    assert len(answer.advice) == 2
    assert answer.step["confirmed"] <= 1e-3
