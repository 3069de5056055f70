"""Answers in words, JSON and exit codes, and the law of a script by runs that are made up."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import dem_bridge as db
from dem_bridge.errors import RunBroken, SceneError, UsageError
from dem_bridge.judging.check import checked
from dem_bridge.judging.check.answer import KEYS, MOST_LINES_TO_WRITE, Check
from dem_bridge.judging.check.edits import Edit
from dem_bridge.judging.check.laboratory import Laboratory
from dem_bridge.judging.check.lammps_run import LammpsRun
from dem_bridge.judging.check.law import EngineAnswer, LawAnswer, engine_of, law_of
from dem_bridge.judging.check.plausible import Plausibility
from dem_bridge.judging.check.step import StepAnswer, step_by_lammps, step_of
from dem_bridge.judging.check.subject import subject_of
from dem_bridge.lmp.known_defects import known_defects
from dem_bridge.observables.largest_step import LargestStep
from dem_bridge.observables.verdict import Outcome
from tests.helpers.checked_decks import BALLS, RADIUS, UNDAMPED, script

PASS, FAIL, UNDECIDED, BROKEN = Outcome.PASS, Outcome.FAIL, Outcome.UNDECIDED, Outcome.BROKEN


def answer(law: Outcome = PASS, step: Outcome = PASS, **changes: Any) -> Check:
    """Return an answer with these outcomes."""
    fields: dict[str, Any] = {
        "name": "in.x",
        "title": "in.x: 2 bodies, 1 contact",
        "accuracy": 1e-3,
        "law_answer": LawAnswer(outcome=law, sentence="hertz, no damping: words on the law.", difference=1e-12),
        "step_answer": StepAnswer(
            dt=1e-6,
            accuracy=1e-3,
            error=2e-3,
            uncertainty=1e-9,
            scale=0.5,
            steps={1e-3: LargestStep(dt=7e-7)},
            outcome=step,
        ),
        "engine_answer": EngineAnswer(version=20250722, defects=(), bite=None, of_release=7),
    }
    return Check(**fields | changes)


@pytest.mark.parametrize(
    ("law", "step", "outcome", "code", "words"),
    [
        (PASS, PASS, "PASS", 0, "Law and step are right: at 1e-06 s velocities are within 0.2 % of the largest"),
        (
            PASS,
            FAIL,
            "FAIL",
            1,
            "The step is too coarse: at 1e-06 s velocities are wrong by 0.2 % of the largest; all of",
        ),
        (FAIL, PASS, "FAIL", 1, "The law is wrong: words on the law."),
        (FAIL, FAIL, "FAIL", 1, "The law is wrong: words on the law. The step is too coarse"),
        (UNDECIDED, PASS, "UNDECIDED", 4, "The law was not checked"),
        (UNDECIDED, FAIL, "FAIL", 1, "The step is too coarse"),
        (BROKEN, BROKEN, "BROKEN", 3, "Hertz, no damping: words on the law."),
    ],
)
def test_the_outcome_is_the_worst_and_comes_first(
    law: Outcome, step: Outcome, outcome: str, code: int, words: str
) -> None:
    check = answer(law, step)
    name, text = next(iter(check.lines()))
    assert (check.outcome, check.exit_code, name) == (outcome, code, outcome)
    assert words in text
    assert len(list(check.lines("page/index.html"))) <= 8


def test_the_json_is_that_of_the_contract() -> None:
    check = answer(step=FAIL, edits=(Edit(file="in.x", line=3, new="timestep 5e-07"),))
    data = json.loads(json.dumps(check.as_json(), allow_nan=False))
    assert tuple(data) == KEYS
    step = data["step"]
    assert {"dt", "error", "scale", "uncertainty", "largest_for_accuracy", "outcome", "sentence"} <= set(step)
    assert step["error"] / step["scale"] == pytest.approx(2e-3)
    assert (step["largest_for_accuracy"], data["advice"]) == (7e-7, ["timestep 5e-07  # line 3 of in.x"])
    assert {"outcome", "sentence"} <= set(data["law"])
    assert data["engine"]["defects"] == []


def test_a_terminal_shows_as_many_lines_to_write_as_it_can_and_counts_the_others() -> None:
    def shown(count: int, **changes: Any) -> list[tuple[str, str]]:
        edits = tuple(Edit(file="in.x", line=n, new=f"run {n}") for n in range(1, count + 1))
        return list(answer(step=FAIL, edits=edits, **changes).lines())

    defect = EngineAnswer(version=20250722, defects=known_defects()[:1], bite=True, of_release=7)
    for count, changes, ending in (
        (MOST_LINES_TO_WRITE, {}, f"line {MOST_LINES_TO_WRITE} of in.x"),
        (
            MOST_LINES_TO_WRITE + 1,
            {},
            f"line {MOST_LINES_TO_WRITE + 1} of in.x",
        ),  # in place of a release without a defect
        (MOST_LINES_TO_WRITE + 2, {}, "(and 1 more line: --json)"),
        (MOST_LINES_TO_WRITE + 3, {"engine_answer": defect}, "(and 3 more lines: --json)"),
    ):
        lines = shown(count, **changes)
        assert [text for name, text in lines if name in ("write", "")][-1].endswith(ending)
        assert len(lines) <= 8
        assert any(name == "release" for name, _ in lines) == (count <= MOST_LINES_TO_WRITE or bool(changes))


def test_a_doubt_on_the_numbers_stands_in_the_first_line() -> None:
    fields: Any = {"value": 210.0, "usual": "1e3 to 1.3e12 Pa", "look": True}
    modulus = Plausibility(name="modulus", sentence="a Young's modulus of 210 Pa (are the units right?)", **fields)
    wall = Plausibility(name="wall", sentence="a wall is never touched", **fields)
    check = answer(plausible=(modulus, wall))
    assert (check.outcome, check.exit_code) == ("PASS", 0)
    assert "but look at the numbers: a Young's modulus of 210 Pa (are the units right?)." in check.headline
    assert "wall" not in check.headline


def test_the_step_of_a_law_that_is_not_checked_changes_velocities() -> None:
    said = answer(UNDECIDED, PASS).headline
    assert said.endswith("The step changes velocities by 0.2 % of the largest at 1e-06 s.")
    assert "wrong" not in said


# ---------------------------------------------------------------- laws by runs that are made up
def laboratory(folder: Path, text: str, change: Any = None, version: int = 20250722) -> Laboratory:
    """Return a laboratory in which LAMMPS is our code at the step, with the velocities changed by a function."""

    class Made(Laboratory):
        def lammps(self, factor: int = 1, *, dense: bool = False) -> LammpsRun:
            assert self.subject.deck.dt is not None
            velocity = self.twin(self.subject.deck.dt / factor)
            velocity = velocity if change is None else change(velocity, factor)
            bodies = tuple(range(velocity.shape[1]))
            return LammpsRun(
                factor=factor, time=self.times, velocity=velocity, bodies=bodies, version=version, dangerous=0
            )

    (folder / "in.chain").write_text(text)
    with subject_of(folder / "in.chain") as subject:
        return Made(subject=subject)


def test_a_law_is_right_where_lammps_is_our_code(tmp_path: Path) -> None:
    law = law_of(laboratory(tmp_path, script()))
    assert (law.outcome, law.difference) == (PASS, 0.0)
    assert law.sentence.startswith("hertz/material, no damping: LAMMPS and our code differ by 0 of the largest")


def test_a_difference_that_falls_with_the_step_is_no_wrong_law(tmp_path: Path) -> None:
    law = law_of(laboratory(tmp_path, script(), lambda velocity, factor: velocity + 1e-4 / factor))
    assert law.outcome is PASS
    assert "falls with the step, from 2e-4 to 5e-5" in law.sentence


def test_a_difference_that_stays_is_a_wrong_law_with_its_size(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        "dem_bridge.judging.check.law.cause_by_judge", lambda lab: ("stiffness-scale", "all are too stiff")
    )
    law = law_of(laboratory(tmp_path, script(), lambda velocity, factor: 1.01 * velocity))
    assert (law.outcome, law.cause) == (FAIL, "stiffness-scale")
    assert "LAMMPS is off by 1 % at any step; all are too stiff" in law.sentence


def test_an_old_release_mixes_otherwise_and_the_pair_is_written(tmp_path: Path) -> None:
    sizes = f"set atom 3*5 type 2\nset group all diameter {2 * RADIUS:g}\nset group all density 7800"
    pairs = f"pair_coeff 1 1 hertz 1e11 0 {UNDAMPED}\npair_coeff 2 2 hertz 1e10 0 {UNDAMPED}"
    text = script(sizes=sizes, coefficients=pairs)
    lab = laboratory(tmp_path, text, lambda velocity, factor: 1.01 * velocity, version=20210929)
    law = law_of(lab)
    assert law.cause == "mixing"
    [edit] = checked.edits_of_law(
        lab.subject, checked.Finding(law=law, step=StepAnswer(dt=1.0, accuracy=1.0), version=20210929)
    )
    assert edit.new.splitlines()[0] == pairs.splitlines()[1]
    assert edit.new.splitlines()[1].startswith("pair_coeff 1 2 hertz 31622776601.68")


def test_a_law_that_no_contact_tests_is_undecided(tmp_path: Path) -> None:
    far = "\n".join(f"create_atoms 1 single {2.5 * RADIUS * k:.15g} 0 0 units box" for k in range(5))
    law = law_of(laboratory(tmp_path, script(atoms=far)))
    assert (law.outcome, law.sentence) == (UNDECIDED, "no contact closes during the run, so no law acts.")


def test_the_step_is_judged_by_our_code_where_the_law_is_wrong(tmp_path: Path) -> None:
    lab = laboratory(tmp_path, script(per_contact=10.0), lambda velocity, factor: 2.0 * velocity)
    step = step_of(lab, 1e-3, law_is_right=False, lost=False)
    assert step.outcome is FAIL
    assert step.error == pytest.approx(0.016, rel=0.05)
    assert math.isnan(step.confirmed)


def test_lammps_alone_shows_its_step_by_halving_it(tmp_path: Path) -> None:
    lab = laboratory(tmp_path, script(per_contact=10.0))
    alone = step_by_lammps(lab, 1e-3)
    by_codes = step_of(lab, 1e-3, law_is_right=True, lost=False)
    assert alone.error == pytest.approx(by_codes.error, rel=0.3)
    assert alone.outcome is FAIL
    rough = laboratory(tmp_path, script(), lambda velocity, factor: velocity + 0.1 * (-1) ** (factor == 2))
    assert "no order is seen" in step_by_lammps(rough, 1e-3).sentence


def test_velocities_that_are_no_numbers_are_a_wrong_law(tmp_path: Path) -> None:
    law = law_of(laboratory(tmp_path, script(), lambda velocity, factor: np.full_like(velocity, np.nan)))
    assert law.outcome is FAIL
    assert "velocities are not numbers" in law.sentence


def test_bodies_that_are_lost_by_the_step_make_it_too_coarse(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    lab = laboratory(tmp_path, script(per_contact=1.2))
    made = lab.lammps

    def lost(factor: int = 1, *, dense: bool = False) -> LammpsRun:
        if factor < 4:
            raise RunBroken("LAMMPS: ERROR: Lost atoms: original 5 current 4")
        return made(factor)

    monkeypatch.setattr(lab, "lammps", lost)
    monkeypatch.setattr(lab, "confirmed_error", lambda factor: 5e-4)
    finding = checked.finding_of(lab, 1e-3)
    assert (finding.law.outcome, finding.step.outcome) == (PASS, FAIL)
    assert "LAMMPS loses bodies" in finding.step.sentence
    assert finding.step.factor > 20


@pytest.mark.parametrize("name", ["tsuji-prefactor", "undamped-classic-wall", "zero-restitution"])
def test_defects_that_a_line_avoids_are_mended_in_it(name: str) -> None:
    lines = {
        "tsuji-prefactor": "pair_coeff * * hertz/material 1e9 0.5 0.3 damping tsuji",
        "undamped-classic-wall": "fix w all wall/gran hooke/history 1e9 NULL 0 NULL 0 0 xplane 0 NULL",
        "zero-restitution": "pair_coeff * * hertz/material 1e9 0 0.3 damping coeff_restitution",
    }
    [defect] = [item for item in known_defects() if item.name == name]
    mended = defect.mended(lines[name])
    assert mended != lines[name]
    assert not defect.met_by(mended)
    assert defect.mended("run 10") == "run 10"


def test_a_defect_that_does_not_change_a_run_is_told_and_is_no_failure(tmp_path: Path) -> None:
    (tmp_path / "in.chain").write_text(script(coefficients="pair_coeff * * hertz/material 1e9 1 0.3 damping tsuji"))
    with subject_of(tmp_path / "in.chain") as subject:
        harmless, bitten = (engine_of(subject.deck, 20250722, law) for law in (PASS, FAIL))
    assert (harmless.outcome, bitten.outcome) == (PASS, FAIL)
    assert "does not suffer from in this run" in harmless.sentence
    defects: Any = harmless.as_json()["defects"]
    assert defects[0]["bites"] is False


# ---------------------------------------------------------------- files that cannot be checked
def test_what_is_neither_a_script_nor_a_scene_is_said(tmp_path: Path) -> None:
    (tmp_path / "data.csv").write_text("1,2\n")
    with pytest.raises(SceneError, match=r"neither a LAMMPS input script nor a scene file"):
        db.check(tmp_path / "data.csv")
    with pytest.raises(SceneError, match=r"did you mean"):
        db.check("decelerating-4O")
    (tmp_path / "in.chain").write_text(script())
    with pytest.raises(UsageError, match=r"has its own time step; leave out --dt 1e-07"):
        db.check(tmp_path / "in.chain", dt=1e-7)
    with pytest.raises(UsageError, match=r"variables were given, but decelerating-40 is a scene"):
        db.check("decelerating-40", variables={"a": "1"})
    with pytest.raises(UsageError, match=r"accuracy"):
        db.check("decelerating-40", accuracy=-1.0)


def test_the_deck_of_a_scene_is_checked_at_a_step(tmp_path: Path) -> None:
    scene = db.Scene(name="pair", duration=1e-4, mass=(8e-3, 1e-2), stiffness=(4e9,), velocity=(0.8, 0.0))
    with subject_of(scene, dt=1e-6) as subject:
        assert (subject.deck.dt, subject.of_scene) == (pytest.approx(1e-6), "pair")
        assert "timestep        ${dt}" in subject.finer(2)["in.pair"]
        assert subject.assumed == ""
    with subject_of(replace(scene, duration=3e-4)) as subject:  # 1/50 of the contact time
        assert subject.deck.dt == pytest.approx(1.2e-6, rel=0.5)
        assert subject.assumed == "1/50 of the shortest contact time"


@pytest.mark.lammps
def test_a_step_that_was_assumed_is_called_so_and_the_one_to_write_stands_beside_it() -> None:
    scene = db.Scene(name="pair", duration=1e-4, mass=(8e-3, 1e-2), stiffness=(4e9,), velocity=(0.8, 0.0))
    assumed = db.check(scene, accuracy=1e-4)
    words = assumed.headline
    assert words.startswith("The scene gives no step; ")
    assert "s, 1/50 of the shortest contact time, was assumed. The step is too coarse: at " in words
    [command] = assumed.advice
    line, _, relation = command.partition("  # ")
    step = float(line.split(" --dt ")[1].split()[0])
    parts = int(relation.removeprefix("1/").split()[0])
    assert step == pytest.approx(assumed.step["dt"] / parts, rel=1e-5)
    assert step <= assumed.step["largest_for_accuracy"]
    assert relation.endswith(" gives 1e-4")
    again = db.check(scene, accuracy=1e-4, dt=step)
    assert (again.outcome, "gives no step" in again.headline) == ("PASS", False)


def test_the_law_of_a_script_is_named_by_its_models(tmp_path: Path) -> None:
    from dem_bridge.judging.check.law import law_name
    from dem_bridge.judging.deck import user_deck

    for text, name in (
        (script(), "hertz/material, no damping"),
        (script(coefficients=f"pair_coeff * * {BALLS.replace(' 0 ', ' 5 ', 1)}"), "hertz/material, damping velocity"),
        (script(pair="pair_style gran/hooke 1e7 0 0 0 0 0", coefficients="pair_coeff * *"), "gran/hooke"),
        ("units si\nrun 1\n", "no pair_style"),
    ):
        (tmp_path / "in.x").write_text(text)
        assert law_name(user_deck(tmp_path / "in.x")) == name
