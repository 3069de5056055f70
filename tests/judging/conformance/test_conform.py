"""Grades of right, faulty, broken and stored codes."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import dem_bridge as db
from dem_bridge.errors import UsageError
from dem_bridge.judging.conformance.scenes import FEATURES, Probe, frozen_probes
from dem_bridge.judging.conformance.truth import truth_of
from tests.helpers.command_line import run_here
from tests.judging.conformance.planted_faults import OF_OUTPUT, PLANTED, code, leapfrog, own_step

TINY = Path(__file__).with_name("tiny_code.py")
ALL = tuple(FEATURES)


def failed(grade: db.Conformance) -> dict[str, str]:
    """Return the causes of the items that failed, by their names."""
    return {item.name: item.cause for item in grade.answers if item.outcome.value == "FAIL"}


def test_a_right_code_passes_every_item() -> None:
    grade = db.conform(code(), features=ALL, scenes=20, seed=11)
    assert {item.outcome.value for item in grade.answers} == {"PASS"}
    assert grade["score"] == {"passed": 21, "failed": 0, "undecided": 0, "not_run": 0, "broken": 0}
    assert grade.exit_code == 0
    assert len(grade.card().splitlines()) <= 24


@pytest.mark.slow
def test_a_right_code_passes_two_hundred_unseen_scenes() -> None:
    grade = db.conform(code(), features=ALL, scenes=200, seed=4)
    assert grade.answers[-1].sentence.startswith("200 of 200 scenes are right")


@pytest.mark.parametrize("probe", frozen_probes(), ids=lambda probe: probe.scene.name)
def test_another_method_computes_the_values_of_the_set(probe: Probe) -> None:
    run = db.solve(probe.scene, backend="scipy")
    truth = truth_of(probe)
    for name in ("velocity", "displacement"):
        # the uncertainty of scipy's run is 1e-11 and less of the largest value in these scenes
        allowed = truth.uncertainty[name] + float(np.max(run.uncertainty[name]))
        assert allowed < 2e-10 * truth.scale[name]
        assert np.abs(getattr(run, name) - truth.values[name]).max() <= allowed


#: faults that are planted at every commit; the others are in the slow tests
QUICK = (
    "exponent", "stiffness", "one wall", "no gaps", "mean", "last mass", "last contact", "no clip", "tsuji", "prepared",
)  # fmt: skip


def planted(fault: str, features: str | tuple[str, ...]) -> tuple[dict[str, str], dict[str, str]]:
    """Return the items that a planted fault fails, with their causes, as found and as they should be."""
    run, item, cause = PLANTED[fault]
    return failed(db.conform(run, features=features, scenes=2, seed=3)), {item: cause}


@pytest.mark.parametrize("fault", QUICK)
def test_a_fault_fails_its_item_alone(fault: str) -> None:
    found, expected = planted(fault, ALL)
    assert found == expected


@pytest.mark.slow
@pytest.mark.parametrize("fault", [fault for fault in PLANTED if fault not in QUICK])
def test_another_fault_fails_its_item_alone(fault: str) -> None:
    found, expected = planted(fault, ALL)
    assert found == expected


@pytest.mark.parametrize("fault", OF_OUTPUT)
def test_a_fault_of_what_is_written_fails_its_item_alone(fault: str) -> None:
    found, expected = planted(fault, "hertz,gaps")
    assert found == expected


def test_half_step_velocities_are_the_phase_and_not_the_order() -> None:
    grade = db.conform(leapfrog, scenes=0)
    assert failed(grade) == {"phase": "half-step-velocity"}
    (phase,) = (item for item in grade.answers if item.name == "phase")
    assert phase.numbers["late_steps_of_velocity"] == pytest.approx(0.5, abs=0.02)


def test_a_code_that_ignores_its_step_is_told() -> None:
    assert failed(db.conform(own_step, scenes=0)) == {"order": "step-ignored"}


@pytest.mark.parametrize(
    ("mode", "words"),
    [
        ("kill", "ended by SIGKILL"),
        ("hang", "did not end within the time limit"),
        ("mute", "wrote no file"),
        ("nan", "that can be used"),
        ("crash", "no walls today"),
        ("empty", ""),
        ("short", "the file has 7 samples"),
    ],
)
def test_a_run_that_fails_costs_its_item_only(mode: str, words: str, tmp_path: Path) -> None:
    command = [sys.executable, str(TINY), mode, "{scene}", "{dt}", "{out.csv}"]
    grade = db.conform(command, features="hertz,walls,gaps", scenes=0, time_limit=20.0)
    (walls,) = (item for item in grade.answers if item.name == "walls")
    assert walls.outcome.value == "BROKEN"
    assert words in walls.sentence
    assert {item.outcome.value for item in grade.answers if item.name != "walls"} == {"PASS", "NOT_RUN"}
    assert grade.exit_code == 3


@pytest.fixture(scope="module")
def stored(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of a grade of the tiny code by the command line."""
    folder = tmp_path_factory.mktemp("conform")
    shutil.copy(TINY, folder / "tiny.py")
    words = f"{sys.executable} tiny.py right {{scene}} {{dt}} {{out.csv}}"
    settings = ("--features", "hertz,walls", "--scenes", "0", "--junit", "items.xml", "-o", "grade")
    done = run_here("conform", "--command", words, *settings, cwd=folder)
    assert done.returncode == 0, done.stderr
    assert "PASS      walls" in done.stdout
    assert '<testcase classname="law" name="pair">' in (folder / "items.xml").read_text(encoding="utf-8")
    assert "tests=" in (folder / "grade" / "junit.xml").read_text(encoding="utf-8")
    assert "</svg>" in (folder / "grade" / "badge.svg").read_text(encoding="utf-8")
    return folder / "grade"


def test_stored_files_are_judged_again_on_an_older_processor(stored: Path) -> None:
    before = json.loads((stored / "conformance.json").read_text(encoding="utf-8"))
    # most of the setting "old" of .ci/machines.py, which knows the features that numpy has here
    old = {
        "NUMBA_CPU_NAME": "generic",
        "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA",
        "OPENBLAS_CORETYPE": "Prescott",
    }
    words = [sys.executable, "-m", "dem_bridge.cli", "conform", "--check", str(stored), "--json"]
    done = subprocess.run(words, capture_output=True, text=True, check=False, env=os.environ | old)
    assert done.returncode == 0, done.stderr
    after = json.loads(done.stdout)
    assert after["changed"] == []
    assert [item["outcome"] for item in after["items"]] == [item["outcome"] for item in before["items"]]


def _copy(stored: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(stored, tmp_path / "copy"))


def test_a_changed_digit_is_found_and_its_line_named(stored: Path, tmp_path: Path) -> None:
    copy = _copy(stored, tmp_path)
    file = copy / "files" / "pair" / "2" / "out.csv"
    lines = file.read_text(encoding="utf-8").splitlines(keepends=True)
    lines[7] = lines[7].replace("5", "6", 1)
    file.write_text("".join(lines), encoding="utf-8")
    with pytest.raises(UsageError, match=r"pair/2/out\.csv: .* changed after it was recorded: line 8 is another one"):
        db.conform(check=copy)
    file.unlink()
    with pytest.raises(UsageError, match=r"pair/2/out\.csv: the file is missing"):
        db.conform(check=copy)


def test_an_outcome_that_was_written_otherwise_is_listed(stored: Path, tmp_path: Path) -> None:
    copy = _copy(stored, tmp_path)
    record = copy / "conformance.json"
    text = record.read_text(encoding="utf-8").replace('"outcome": "PASS"', '"outcome": "FAIL"', 1)
    record.write_text(text, encoding="utf-8")
    grade = db.conform(check=copy)
    assert grade["changed"] == ["law (pair): recorded FAIL, found PASS"]
    assert grade.exit_code == 1


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"features": "hertz,wals"}, "'wals' is unknown; allowed: hertz, .*; did you mean 'walls'"),
        ({"features": "walls"}, "has no contact force; allowed: hertz or hooke"),
        ({"scenes": -1}, "scenes = -1; allowed: a whole number from 0"),
        ({"time_limit": 0.0}, "time_limit = 0.0; allowed: a number above 0"),
    ],
)
def test_wrong_use_is_told(settings: dict[str, Any], words: str) -> None:
    with pytest.raises(UsageError, match=words):
        db.conform(code(), **settings)


@pytest.mark.parametrize(
    ("before", "after", "words"),
    [
        ('"dem-bridge/conformance/1"', '"dem-bridge/conformance/2"', "has another schema; allowed: 'dem-bridge/conf"),
        ('"set": 1', '"set": 2', "has another set; allowed: 1"),
        ('"out": "files/pair/1', '"out": "files/../../pair/1', "allowed: a file below files"),
        ('"runs": [', '"runs": [7, ', "is damaged"),
        ('"score"', "score", "is not JSON"),
    ],
)
def test_a_damaged_record_is_refused(stored: Path, tmp_path: Path, before: str, after: str, words: str) -> None:
    copy = _copy(stored, tmp_path)
    record = copy / "conformance.json"
    text = record.read_text(encoding="utf-8")
    assert before in text
    record.write_text(text.replace(before, after, 1), encoding="utf-8")
    with pytest.raises(UsageError, match=words):
        db.conform(check=copy)


def test_a_folder_without_a_grade_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"conformance\.json: there is no such file"):
        db.conform(check=tmp_path)
    with pytest.raises(UsageError, match="no code was given"):
        db.conform()
