"""Judgements of runs that are made for them: a foreign code beside ours, and somebody's deck with its limits."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

import dem_bridge as db
from dem_bridge.errors import UsageError
from dem_bridge.scene_file.text import scene_toml
from tests.helpers.command_line import Done, assert_one_line, run_here
from tests.helpers.foreign import FAKE, PAIR


@pytest.fixture
def fake(tmp_path: Path) -> str:
    (tmp_path / "fake.py").write_text(FAKE)
    return f"{sys.executable} -S {tmp_path / 'fake.py'} {{scene}} {{dt}} {{out}}"


def test_a_velocity_verlet_code_is_of_second_order_and_equals_our_twin(fake: str) -> None:
    judgement = db.judge(scene=PAIR, command=fake, dt=(4e-7, 2e-7, 1e-7), tolerance=1e-3)
    assert judgement.outcome == "PASS"
    for quantity in ("velocity", "displacement"):
        assert judgement.order[quantity]["value"] == pytest.approx(2.0, abs=0.02)
    table = next(table for table in judgement.study.tables if table.id == "work-precision")
    codes = {row[0] for row in table.rows}
    assert {"fake.py", "our twin"} <= codes
    errors = {(row[0], row[1]): float(row[2]) for row in table.rows}
    for dt in (4e-7, 2e-7, 1e-7):  # the same algorithm: they differ by round-off
        assert errors["fake.py", dt] == pytest.approx(errors["our twin", dt], rel=1e-6)
    assert all(float(row[4]) > 0.0 for row in table.rows)
    assert [figure.id for figure in judgement.study.figures] == ["errors", "work-precision"]


def test_velocities_of_the_half_step_are_of_first_order(fake: str) -> None:
    judgement = db.judge(scene=PAIR, command=f"{fake} half", dt=(4e-7, 2e-7, 1e-7))
    assert judgement.order["velocity"]["value"] == pytest.approx(1.0, abs=0.02)
    assert judgement.order["displacement"]["value"] == pytest.approx(2.0, abs=0.02)


def test_a_soft_code_does_not_converge(fake: str) -> None:
    judgement = db.judge(scene=PAIR, command=f"{fake} soft", dt=(2e-7, 1e-7), tolerance=1e-3)
    assert judgement.outcome == "FAIL"
    assert abs(judgement.order["velocity"]["value"]) < 0.1


def test_the_command_line_judges_a_command_and_names_its_failure(fake: str, tmp_path: Path) -> None:
    (tmp_path / "pair.toml").write_text(scene_toml(PAIR))

    def judge(command: str, *words: str) -> Done:
        return run_here("judge", "--scene", "pair.toml", "--command", command, *words, cwd=tmp_path)

    done = judge(fake, "--dt", "2e-7,1e-7", "--tolerance", "1e-2")
    assert done.returncode == 0
    assert "fake.py at dt = 100 ns: error" in done.stdout
    failed = judge("sh -c 'echo no licence >&2; exit 7' {dt} {out}")
    assert failed.returncode == 3
    assert_one_line(failed, "ended with exit code 7: no licence")
    unread = judge("sh -c 'echo nothing > {out}' {dt}", "--dt", "1e-7")
    assert unread.returncode == 2
    assert_one_line(unread, "output of sh at dt = 1e-07 s")
    assert run_here("judge", "--scene", "pair.toml", cwd=tmp_path).returncode == 2


def test_files_and_command_exclude_each_other(fake: str) -> None:
    with pytest.raises(UsageError, match="one or the other"):
        db.judge("run.csv", PAIR, command=fake)
    with pytest.raises(UsageError, match="no scene"):
        db.judge(command=fake)
