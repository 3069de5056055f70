"""Recorded states of unit tests: judged by our code, by ``check`` and by ``judge``, and compared as by LAMMPS."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

import dem_bridge as db
from dem_bridge.errors import BlockedScript, UsageError
from dem_bridge.foundation.script_files import is_deck, is_unit_test_file
from dem_bridge.judging.deck import UserDeck, user_deck
from dem_bridge.judging.unit_test.driver import run_unit_test
from dem_bridge.judging.unit_test.recorded import judge_recorded
from dem_bridge.lmp.unit_test import UnitTest, read_unit_test
from dem_bridge.observables.verdict import Outcome

FILES = Path(__file__).parents[2] / "data" / "unit_tests"
NAMES = ("spins", "wall")


def _read(name: str) -> UnitTest:
    return read_unit_test((FILES / f"{name}.yaml").read_text(), f"{name}.yaml")


def _deck(test: UnitTest, folder: Path) -> UserDeck:
    script = folder / f"in.{test.name}"
    script.write_text(test.script)
    return user_deck(script)


@pytest.mark.parametrize("name", NAMES)
def test_recorded_states_are_those_of_our_code_at_the_step(name: str, tmp_path: Path) -> None:
    test = _read(name)
    answer = judge_recorded(test, _deck(test, tmp_path))
    assert answer.outcome is Outcome.PASS
    # LAMMPS and our code round differently; the positions of spheres of some mm have 17 digits of about 1e-18 m
    assert answer.difference < 1e-9


@pytest.mark.parametrize(
    ("old", "new"), [("e 0.7", "e 0.701"), ("modulus 5.0e10", "modulus 5.001e10"), ("vin 1.3", "vin 1.3001")]
)
def test_states_of_another_law_or_start_are_found(old: str, new: str, tmp_path: Path) -> None:
    text = (FILES / "spins.yaml").read_text()
    assert f"  {old}\n" in text
    test = read_unit_test(text.replace(f"  {old}\n", f"  {new}\n"), "spins.yaml")
    answer = judge_recorded(test, _deck(test, tmp_path))
    assert answer.outcome is Outcome.FAIL
    assert answer.difference > answer.allowed
    assert "round-off does not explain it" in answer.sentence


def test_a_run_begins_anew_with_each_segment_where_forces_depend_on_velocities(tmp_path: Path) -> None:
    test = _read("spins")  # its first segment ends within the contact
    joined = replace(
        test,
        segments=(3200, 1100),
        states={key: states[1:] for key, states in test.states.items()},
        analytic=None,
    )
    answer = judge_recorded(joined, _deck(joined, tmp_path))
    assert answer.difference > 1e-8  # a half-step velocity in place of that of the step: first order in the step


@pytest.mark.lammps
@pytest.mark.parametrize("name", NAMES)
def test_the_driver_compares_as_lammps_does(name: str) -> None:
    test = _read(name)
    run = run_unit_test(test)
    assert run.outcome is Outcome.PASS
    assert run.largest <= test.epsilon
    later = replace(test, post_commands=(*test.post_commands, "fix pull all addforce 1e-3 0 0"))
    wrong = run_unit_test(test, executed=later)
    assert wrong.outcome is Outcome.FAIL
    assert "are too far off, first with newton on, segment 0" in wrong.sentence


@pytest.mark.lammps
def test_a_formula_fails_by_itself() -> None:
    test = _read("spins")
    assert test.analytic is not None
    wrong = replace(test, variables={**test.variables, "en": "0.75"})
    run = run_unit_test(wrong)
    assert [failure.what for failure in run.failures] == ["collision_restitution: restitution"] * 2
    unknown = replace(test, analytic=replace(test.analytic, model="rolling_decay"))
    assert run_unit_test(unknown).left_out == "rolling_decay"


@pytest.mark.lammps
def test_check_judges_the_states_and_executes_the_test() -> None:
    answer = db.check(FILES / "wall.yaml")
    assert answer.outcome == "PASS"
    assert answer.recorded is not None
    assert answer.recorded["outcome"] == answer.recorded["test"]["outcome"] == "PASS"
    assert "recorded   right: " in answer.shown()
    pair = db.Scene(name="pair", duration=1e-4, mass=(8e-3, 1e-2), stiffness=(4e9,), velocity=(0.8, 0.0))
    assert db.check(pair, dt=1e-7).recorded is None


def test_judge_needs_no_scene_and_finds_the_error_of_the_step() -> None:
    judgement = db.judge(FILES / "spins.yaml")
    assert judgement.outcome == "PASS"
    assert judgement.cause == "none"
    assert judgement.step["dt"] == 2e-8
    assert 1e-5 < judgement.step["error"] < 1e-3  # of first order: 4e-3 of a contact time


def test_import_reads_a_test_and_names_what_it_cannot_read(tmp_path: Path) -> None:
    scene = db.scene_from_deck(FILES / "spins.yaml")
    assert (scene.name, scene.velocity, scene.duration) == ("spins", (1.3, -1.3), 8.6e-5)
    assert is_unit_test_file(FILES / "spins.yaml")
    assert not is_deck(FILES / "spins.yaml")
    text = (FILES / "spins.yaml").read_text()
    sliding = tmp_path / "sliding.yaml"
    sliding.write_text(text.replace("omega 0.0 0.0 -${spin}", "omega 0.0 0.0 ${spin}"))
    with pytest.raises(BlockedScript, match=r"sliding.yaml as a script, line \d+: .*slide on each other"):
        db.scene_from_deck(sliding)
    rolling = tmp_path / "rolling.yaml"
    rolling.write_text(text.replace("NULL 0.5 0.3", "NULL 0.5 0.3 rolling sds 1e3 1.0 0.1"))
    with pytest.raises(BlockedScript, match="whose law resists rolling or twisting"):
        db.scene_from_deck(rolling)
    with pytest.raises(UsageError, match="cannot be read as a chain"):
        db.judge(sliding, scene)


def test_a_written_test_is_judged_without_lammps(tmp_path: Path) -> None:
    pair = db.Scene(name="pair", duration=1e-4, mass=(8e-3, 1e-2), stiffness=(4e9,), velocity=(0.8, 0.0))
    file = db.write_lammps_test(pair, tmp_path / "dem02-pair.yaml", dt=1e-7)
    judgement = db.judge(file, pair)
    assert judgement.outcome == "PASS"
    assert judgement.error["velocity"]["value"] <= 1e-14  # the rows are those of the reference
