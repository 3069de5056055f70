"""Variants of input scripts are checked; the lines of each answer, written into the script, give the accuracy."""

from __future__ import annotations

from pathlib import Path

import pytest

import dem_bridge as db
from dem_bridge.formats.readers import read_record
from dem_bridge.judging.check.answer import MOST_LINES_PRINTED, Check
from dem_bridge.judging.deck import deck_run, user_deck
from dem_bridge.judging.reference import file_errors
from tests.helpers.checked_decks import Variant, variants, written

pytestmark = pytest.mark.lammps

ACCURACY = 1e-3
#: a variant of each kind of answer, for the tests of every day
FEW = (
    "step 1/1.2 of the contact",
    "step 1/10 of the contact",
    "step 1/100 of the contact",
    "units micro, coarse",
    "hooke, fine",
    "damping tsuji 0.5, 1/200",
    "wall/gran classic undamped, coarse",
    "two stiffnesses, mixed",
    "include of step and run",
    "two time steps",
    "no run, coarse",
    "contacts missed",
    "bodies leave the box",
    "bodies leave the box, and the step is too coarse",
    "a body off the line, coarse",
    "a body off the line, lost by the step",
    "a table",
    "jkr",
    "an unknown pair style",
)
ALL = {variant.name: variant for variant in variants()}


def check(variant: Variant, folder: Path) -> Check:
    """Return the answer for a variant that is written into a folder."""
    folder.mkdir()
    return db.check(variant.write(folder), accuracy=ACCURACY, variables=variant.variables or None)


def error_of_velocities(path: Path, variables: dict[str, str] | None) -> float:
    """Return the largest error of a script, relative, by the readers and the reference alone."""
    scene = db.scene_from_deck(path, variables=variables)
    steps = user_deck(path, scene, variables).state.steps
    with deck_run(path, scene, variables=variables, time_limit=60.0, every=max(1, steps // 300)) as run:
        record = read_record(run.out, scene, dt=run.dt)
    part = file_errors(scene, [record])[0].quantities["velocity"]
    return part.value / part.scale


def assert_answered(variant: Variant, folder: Path) -> None:
    """Assert that the answer is right, and that its lines, where it has some, give a run within the accuracy."""
    answer = check(variant, folder / "one")
    text = repr(answer)
    assert (answer.outcome, len(list(answer.lines())) <= 8) == (variant.outcome, True), text
    assert len(text.splitlines()) <= MOST_LINES_PRINTED, text
    assert variant.law in ("", answer.law["outcome"]), text
    assert variant.said in " ".join(part for entry in answer.lines() for part in entry), text
    if answer.step["outcome"] == "FAIL" or "leaves the box" in answer.law["sentence"]:
        assert answer.advice, text
    if not answer.advice:
        return
    changed = Variant(
        name=variant.name,
        files=written(variant.files, answer.advice),
        outcome="",
        variables=variant.variables,
    )
    again = check(changed, folder / "two")
    assert (again.step["outcome"], again.advice) == ("PASS", []), repr(again)
    theirs = {**variant.files, **answer.corrected}
    for name, text in changed.files.items():  # a continued line leaves blank ones
        assert [line for line in text.splitlines() if line] == [line for line in theirs[name].splitlines() if line]
    if again.law["outcome"] == "PASS":
        assert again.outcome == "PASS", repr(again)
        assert error_of_velocities(folder / "two" / "in.chain", dict(variant.variables) or None) <= ACCURACY
    else:  # what cannot be read is not called right by other lines
        assert again.outcome == "UNDECIDED", repr(again)


@pytest.mark.parametrize("name", FEW)
def test_a_few_variants_are_answered(name: str, tmp_path: Path) -> None:
    assert_answered(ALL[name], tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in ALL if name not in FEW])
def test_all_variants_are_answered(name: str, tmp_path: Path) -> None:
    assert_answered(ALL[name], tmp_path)
