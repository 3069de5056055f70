"""The cause of a fault in a small code is named from one file, at any step and interval; right files have none."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import dem_bridge as db
from dem_bridge.judging.judgement import Judgement
from dem_bridge.judging.search import Search
from dem_bridge.judging.sentences import text_of
from dem_bridge.judging.without_fits import _differs_widely
from tests.helpers.own_code import FAULTS, Chain, Output, chain, planted, run, write

#: steps in the duration of the chain, steps between rows, and length of the run over the duration
OUTPUTS = ((4000, 40, 1.0), (1000, 7, 1.0), (500, 1, 2.3), (12000, 100, 0.7))
CASES = [(cause, which) for cause, faults in FAULTS.items() for which in range(len(faults))]
#: cases of the quick test: one for each new cause, and a right file
QUICK = [("none", 0), ("start-velocity", 0), ("start-position", 0), ("sign", 1), ("wrong-scene", 0), ("clip", 0)]


def output_of(seed: int, number: int) -> Output:
    """Return how the code of a seed runs and writes."""
    steps, every, length = OUTPUTS[number]
    return Output(dt=float(f"{chain(seed).duration / steps:.2g}"), every=every, length=length)


def judged(folder: Path, cause: str, which: int, seed: int, output: Output) -> Judgement:
    """Return the judgement of a file with a fault."""
    path, scene = planted(folder, cause, which, seed, output, damped=cause == "clip")
    return db.judge(f"{path}@{output.dt!r}", scene)


def check(judgement: Judgement, cause: str, output: Output) -> None:
    """Assert that a cause is named and nothing else, in a short answer that speaks of the step."""
    assert judgement.cause == cause, judgement.evidence
    assert judgement.outcome == ("PASS" if cause == "none" else "FAIL")
    assert [fault["cause"] for fault in judgement.faults] == ([] if cause == "none" else [cause])
    assert judgement.step["dt"] == output.dt
    assert list(judgement.step["largest_for"]) == ["1e-2", "1e-3", "1e-4"]
    assert all(step > 0.0 for step in judgement.step["largest_for"].values())
    lines = str(judgement).splitlines()
    assert len(lines) <= 15
    assert max(map(len, lines)) <= 80
    assert lines[0].startswith("outcome")
    assert [line[:4] for line in lines if line[:1] != " "][1] == "next"


@pytest.mark.parametrize(("cause", "which"), QUICK)
def test_a_fault_of_a_small_code_is_named_from_one_file(cause: str, which: int, tmp_path: Path) -> None:
    output = output_of(1, 1)
    check(judged(tmp_path, cause, which, 1, output), cause, output)


@pytest.mark.slow
@pytest.mark.parametrize("number", range(len(OUTPUTS)))
@pytest.mark.parametrize(("cause", "which"), CASES)
@pytest.mark.parametrize("seed", [1, 3])
def test_every_fault_is_named_at_every_step_and_interval(
    seed: int, cause: str, which: int, number: int, tmp_path: Path
) -> None:
    output = output_of(seed, number)
    check(judged(tmp_path, cause, which, seed, output), cause, output)


@pytest.mark.parametrize("number", range(len(OUTPUTS)))
def test_a_right_file_has_no_cause_and_the_error_of_its_step(number: int, tmp_path: Path) -> None:
    output = output_of(3, number)
    judgement = judged(tmp_path, "none", 0, 3, output)
    check(judgement, "none", output)
    error = judgement.error["velocity"]
    assert judgement.step["error"] == pytest.approx(error["value"] / error["scale"], rel=1e-3)
    assert "divergence" not in text_of(judgement, every=True)
    assert "contact forces would show it" in judgement.needed


# ---------------------------------------------------------------- two faults at once
def factor(values: Any, place: int, size: float) -> Any:
    """Return values of which one has a factor."""
    values = values.copy()
    values[place] *= size
    return values


TWO: dict[tuple[str, str], Callable[[Chain, Output], tuple[Chain, Output]]] = {
    ("mass", "stiffness"): lambda c, o: (
        replace(c, mass=factor(c.mass, 2, 1.05), stiffness=factor(c.stiffness, 1, 1.1)),
        o,
    ),
    ("stiffness-scale", "gravity"): lambda c, o: (replace(c, stiffness=1.03 * c.stiffness, gravity=9.81), o),
    ("half-step-velocity", "stiffness"): lambda c, o: (
        replace(c, stiffness=factor(c.stiffness, 1, 1.1)),
        replace(o, half=True),
    ),
    ("start-velocity", "stiffness-scale"): lambda c, o: (
        replace(c, velocity=1.05 * c.velocity, stiffness=0.9 * c.stiffness),
        o,
    ),
}


@pytest.mark.parametrize("causes", TWO, ids=" and ".join)
def test_two_faults_at_once_are_told_as_such(causes: tuple[str, str], tmp_path: Path) -> None:
    right, output = chain(1), output_of(1, 0)
    wrong, how = TWO[causes](right, output)
    (tmp_path / "scene.toml").write_text(right.scene("mine"))
    path = write(tmp_path / "mine.csv", run(wrong, how))
    judgement = db.judge(f"{path}@{output.dt!r}", tmp_path / "scene.toml")
    assert {fault["cause"] for fault in judgement.faults} == set(causes)
    assert judgement.cause in causes
    assert judgement.evidence.startswith("Two faults at once: ")
    lines = str(judgement).splitlines()
    assert len(lines) <= 15
    assert max(map(len, lines)) <= 80


@pytest.mark.parametrize(("masses", "cause"), [(0.97, "stiffness-scale"), (1.03, "none")])
def test_faults_of_one_motion_say_which_files_would_tell(masses: float, cause: str, tmp_path: Path) -> None:
    right, output = chain(1), output_of(1, 0)
    wrong = replace(right, stiffness=1.03 * right.stiffness, mass=masses * right.mass)
    (tmp_path / "scene.toml").write_text(right.scene("mine"))
    path = write(tmp_path / "mine.csv", run(wrong, output))
    judgement = db.judge(f"{path}@{output.dt!r}", tmp_path / "scene.toml")
    assert judgement.cause == cause
    assert "contact forces" in judgement.needed
    if cause != "none":
        # one factor of stiffness over mass: 1.03 / 0.97, and the masses by its inverse
        assert "All stiffnesses are 1.06186 +-" in judgement.evidence
        assert any(text.startswith("or: all masses are 0.94174") for text in judgement.alternatives)
    with_forces = write(tmp_path / "forces.csv", run(wrong, output), forces=True)
    told = db.judge(f"{with_forces}@{output.dt!r}", tmp_path / "scene.toml")
    assert {fault["cause"] for fault in told.faults} == {"stiffness-scale", "mass"}
    assert np.all(["1.03" in told.evidence, f"{masses:g}" in told.evidence])


def test_a_file_of_another_shipped_scene_is_recognised(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr(Search, "fits")  # these are 500 motions, which no file of quite another chain needs
    run_of = db.solve("decelerating-40", backend="verlet", dt=2e-7, uncertainty=False)
    db.write_trajectory(run_of, db.load_scene("decelerating-40"), tmp_path / "run.csv", layout="wide")
    judgement = db.judge((tmp_path / "run.csv", 2e-7), "accelerating-40")
    assert (judgement.cause, judgement.outcome) == ("wrong-scene", "FAIL")
    assert "the scene decelerating-40" in judgement.evidence


@pytest.mark.parametrize(
    ("name", "widely"),
    [
        ("accelerating-40", True),
        ("stacked-40", False),
        ("decelerating-40-heavier", False),
        ("decelerating-40-gaps", False),
        ("decelerating-40-soft-exponent", False),
        ("decelerating-40-scattered", False),
    ],
)
def test_a_scene_that_a_hypothesis_may_explain_is_examined_by_fits(name: str, widely: bool) -> None:
    assert _differs_widely(db.load_scene("decelerating-40"), db.load_scene(name)) is widely
