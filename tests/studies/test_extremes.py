"""The catalogue of extremes: what is expected of whom, and that the judge sees a backend that is wrong in silence."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

import dem_bridge as db
from dem_bridge.backends.base import BACKENDS, ENGINE_BACKENDS, Resolution, Sampling, backend, supports_of
from dem_bridge.backends.verlet import Verlet
from dem_bridge.cli import main
from dem_bridge.errors import BackendUnavailable, RunBroken, UnsupportedScene, UsageError
from dem_bridge.observables.verdict import Outcome
from dem_bridge.runs.campaign import Crashed, Result, run_cases
from dem_bridge.runs.case import Case
from dem_bridge.runs.uncertainty import fixed_step
from dem_bridge.runs.uncertainty.fixed_step import TwinFamily, fixed_step_uncertainty
from dem_bridge.scene.scene import Scene, Wall
from dem_bridge.studies.extremes import study as extremes_study
from dem_bridge.studies.extremes.catalogue import catalogue, chain, checked, expectation, kinds
from dem_bridge.studies.extremes.judge import Expected, Finding, Standard, Word, judge, outcome
from dem_bridge.studies.extremes.study import Row, answer, rows_of
from dem_bridge.studies.extremes.truths import apart, galilei, mirrored, two_bodies
from dem_bridge.trajectory.trajectory import UNKNOWN, Trajectory, Uncertainty
from tests.helpers.fake_runs import free_flight

ALL = catalogue()
#: what the issue of extremes names, by a part of the names of its entries
ASKED = (
    "speed-1e-9", "speed-1000", "angles-90-to-0.001", "mass-", "stiffness-1e8", "bodies-2", "bodies-100000", "graze",
    "gaps-1e-15", "gaps-of-metres", "pressed-1e-9", "pressed-1000", "at-rest", "galilei", "all-together",
    "time-reversal", "mirror", "cut-at-a-gap", "speed-32-times", "far-", "n-2.0001", "n-5",
    "table-ends-a-line-short", "below-the-limit", "above-the-limit",
)  # fmt: skip
#: refusals that a backend finds out in the run, or by its settings
IN_THE_RUN = ("far-1e12", "table-", "step-")
#: codes that need no engine
OWN = tuple(name for name in BACKENDS if name not in ENGINE_BACKENDS)


def rows(*names: str, backends: tuple[str, ...] = OWN) -> dict[tuple[str, str], Row]:
    return {(row.entry.name, row.backend): row for row in rows_of([ALL[name] for name in names], backends)}


@pytest.mark.parametrize("part", ASKED)
def test_all_that_was_asked_for_has_an_entry(part: str) -> None:
    assert any(part in name for name in ALL)


@pytest.mark.parametrize("name", ALL)
def test_every_backend_has_an_expectation_that_agrees_with_what_it_declares(name: str) -> None:
    entry = ALL[name]
    for judged in BACKENDS:
        expected, reason = expectation(entry, judged), supports_of(judged).unsupported_reason(entry.scene)
        if reason is not None:
            assert expected.fits(Word.REFUSED, reason), (judged, str(expected), reason)
        elif expected.word is Word.REFUSED:
            assert name.startswith(IN_THE_RUN), judged
        assert (expected.word is Word.MODEL) <= (backend(judged).equations != "hertz")


def test_a_backend_that_nobody_has_thought_of_must_be_right() -> None:
    class New(Verlet):
        name = "new"
        order: int | None = 4

    assert kinds(New()) == ("new", "fixed step", "hertz")
    assert all("new" not in entry.expected for entry in ALL.values())


def test_entries_that_cannot_be_meant_are_refused() -> None:
    one = ALL["bodies-2"]
    with pytest.raises(ValueError, match="two entries are called bodies-2"):
        checked([one, one])
    with pytest.raises(ValueError, match="'verlett' is no backend and no kind"):
        checked([replace(one, expected={"verlett": Expected(Word.RIGHT)})])


@pytest.mark.slow
def test_codes_of_ours_are_right_or_refuse_at_a_handful() -> None:
    some = ("pair-at-1e-9", "speed-32-times", "time-reversal", "at-rest", "front-barely-begun", "step-over-contacts")
    found = rows(*some)
    assert {key: row.finding.cell for key, row in found.items() if row.outcome is not Outcome.PASS} == {}
    assert found["pair-at-1e-9", "reference"].finding.standard == "the closed form of two bodies"
    assert found["time-reversal", "verlet"].finding.ratio > 0.1
    assert found["at-rest", "scipy"].finding.velocity_bar == 0.0


@pytest.mark.slow
@pytest.mark.lammps
def test_lammps_is_right_or_refuses_at_a_handful() -> None:
    found = rows("speed-32-times", "far-1e12", "table-ends-a-line-short", backends=ENGINE_BACKENDS)
    assert {key: row.finding.cell for key, row in found.items() if row.outcome is not Outcome.PASS} == {}
    assert found["table-ends-a-line-short", "lammps-table"].finding.word is Word.REFUSED
    assert found["table-ends-a-line-short", "lammps-granular"].finding.word is Word.RIGHT


def planted(change: Callable[[Trajectory], Trajectory]) -> Callable[[Any], Any]:
    """The twin, with what it answers changed."""

    class Planted(Verlet):
        def run(self, scene: Scene, resolution: Resolution, sampling: Sampling) -> Trajectory:
            return change(super().run(scene, resolution, sampling))

    return lambda engine: Planted()


def zeros(run: Trajectory) -> Trajectory:
    return replace(run, velocity=0.0 * run.velocity, displacement=0.0 * run.displacement)


def blind(run: Trajectory) -> Trajectory:
    return replace(run, crossing_time=np.full_like(run.crossing_time, math.nan))


def crash(run: Trajectory) -> Trajectory:
    raise ZeroDivisionError("division\nby zero")


def chatty(run: Trajectory) -> Trajectory:
    raise RunBroken("a long\nstory")


@pytest.mark.parametrize(
    ("fault", "word", "verdict"),
    [
        (zeros, Word.WRONG, Outcome.FAIL),
        (blind, Word.WRONG, Outcome.FAIL),
        (crash, Word.BROKEN, Outcome.BROKEN),
        (chatty, Word.REFUSED, Outcome.FAIL),
    ],
)
def test_a_backend_with_a_fault_is_found_out(fault: Any, word: Word, verdict: Outcome) -> None:
    entry = replace(ALL["speed-0.001"], instead={"verlet": planted(fault)})
    row = rows_of([entry], ["verlet"])[0]
    assert (row.finding.word, row.outcome) == (word, verdict), row.finding.reason


@pytest.mark.parametrize(("factor", "word"), [(0.1, Word.WRONG), (math.inf, Word.NO_BAR)])
def test_a_wrong_uncertainty_is_found_out(factor: float, word: Word, monkeypatch: pytest.MonkeyPatch) -> None:
    def planted_rule(family: TwinFamily, summed: float | None = None, *, drifts: bool = False) -> Uncertainty:
        right = fixed_step_uncertainty(family, summed, drifts=drifts)
        return replace(right, **{name: factor * value for name, value in right.items()})

    monkeypatch.setattr(fixed_step, "fixed_step_uncertainty", planted_rule)
    row = rows_of([ALL["speed-0.001"]], ["verlet"])[0]
    assert (row.finding.word, row.outcome) == (word, Outcome.FAIL), row.finding.reason


def test_what_must_be_the_same_to_the_last_bit_may_not_differ_by_one() -> None:
    def nudge(run: Trajectory) -> Trajectory:
        return replace(run, velocity=run.velocity * (1.0 + 2.0**-52))

    entry = replace(ALL["speed-32-times"], instead={"verlet": planted(nudge)})
    found = rows_of([entry], ["verlet"])[0].finding
    assert found.word is Word.WRONG
    assert found.standard == "its own run at 1/32 of the speed, scaled"


def _judged(**changes: Any) -> Word:
    run = free_flight(**changes)
    case = Case(scene=ALL["bodies-2"].scene, backend="verlet", resolution=Resolution(), sampling=Sampling(count=4))
    truth = Standard(says="truth", run=free_flight(uncertainty=replace(_BARS, velocity=0.01)))
    return judge(Result(case=case, trajectory=run), [truth], model=False).word


_BARS = Uncertainty(velocity=0.1, displacement=0.1, peak_force=0.1, crossing_time=0.01)


def test_both_bars_are_allowed_and_no_more() -> None:
    speed = free_flight().velocity
    assert _judged(uncertainty=_BARS, velocity=speed + 0.109) is Word.RIGHT
    assert _judged(uncertainty=_BARS, velocity=speed + 0.111) is Word.WRONG
    assert _judged(uncertainty=_BARS, velocity=speed * np.nan) is Word.WRONG
    # of contacts each its own, and an infinite bar says nothing of its own contact alone
    late = replace(_BARS, crossing_time=[math.inf, 0.01])
    assert _judged(uncertainty=late, crossing_time=[5.0, 0.2]) is Word.RIGHT
    assert _judged(uncertainty=late, crossing_time=[0.1, 0.3]) is Word.WRONG
    assert _judged(uncertainty=replace(_BARS, velocity=3.0)) is Word.NO_BAR


def test_without_a_truth_nothing_is_right() -> None:
    case = Case(scene=ALL["bodies-2"].scene, backend="verlet", resolution=Resolution(), sampling=Sampling(count=4))
    result = Result(case=case, trajectory=free_flight())
    vague = free_flight(uncertainty=UNKNOWN)
    for standard in (Standard(says="truth", run=None, reason="it broke"), Standard(says="truth", run=vague)):
        found = judge(result, [standard], model=False)
        assert found.word is Word.NO_TRUTH
        assert outcome(found, Expected(Word.RIGHT)) is Outcome.FAIL


@pytest.mark.parametrize(
    ("failure", "expected", "verdict"),
    [
        (UnsupportedScene("there are gaps"), Expected(Word.REFUSED, "gaps"), Outcome.PASS),
        (UnsupportedScene("there are gaps"), Expected(Word.REFUSED, "walls"), Outcome.FAIL),
        (UsageError("table_lines = 7"), Expected(Word.RIGHT), Outcome.FAIL),
        (BackendUnavailable("no engine"), Expected(Word.RIGHT), Outcome.NOT_RUN),
        (Crashed("KeyError: 3"), Expected(Word.REFUSED), Outcome.BROKEN),
    ],
)
def test_refusals_are_held_against_the_reason(failure: Any, expected: Expected, verdict: Outcome) -> None:
    case = Case(scene=ALL["bodies-2"].scene, backend="verlet", resolution=Resolution(), sampling=Sampling(count=4))
    assert outcome(judge(Result(case=case, failure=failure), [], model=False), expected) is verdict


WALLED = chain(
    "walled", bodies=4, stiffness=[4e9, 5e9, 6e9], velocity=(0.5, 0.0, 0.25, 0.0), gap=(0.0, 1e-6, 0.0),
    wall_left=Wall(stiffness=3e9, gap=2e-6), wall_right=Wall(stiffness=2e9, gap=1e-6), gravity=-50.0,
)  # fmt: skip
OPEN = replace(WALLED, wall_left=None, wall_right=None, gravity=0.0)


@pytest.mark.parametrize(
    "truth", [mirrored(WALLED), galilei(OPEN, 2.0), apart(replace(OPEN, gap=(0.0, 1e-2, 0.0)), 1)], ids=lambda t: t.says
)
def test_relations_hold_for_the_reference_whatever_the_chain(truth: Any) -> None:
    scene = {"mirror": WALLED, "common": OPEN}.get(
        next((word for word in ("mirror", "common") if word in truth.says), ""), replace(OPEN, gap=(0.0, 1e-2, 0.0))
    )
    made = truth.make([db.solve(one, backend="reference") for one in truth.scenes])
    case = Case(scene=scene, backend="reference", resolution=Resolution(), sampling=Sampling(count=scene.samples))
    run = db.solve(scene, backend="reference")
    found = judge(Result(case=case, trajectory=run), [Standard(says=truth.says, run=made)], model=False)
    assert found.word is Word.RIGHT, found
    # and a chain that is not quite the same is told from it
    other = db.solve(
        replace(scene, stiffness=(4e9, 5.0001e9, 6e9), mass=(0.010001, 0.01, 0.01, 0.01)), backend="reference"
    )
    off = judge(Result(case=case, trajectory=other), [Standard(says=truth.says, run=made)], model=False)
    assert off.word is Word.WRONG


def test_closed_forms_are_refused_where_they_are_none() -> None:
    with pytest.raises(ValueError, match="a sample falls between touch at 0 s and parting"):
        two_bodies(chain("pair", bodies=2, samples=50))


def test_a_study_is_asked_by_name_and_written(tmp_path: Path) -> None:
    done = CliRunner().invoke(main, ["study", "extremes", "--match", "at-rest", "-o", str(tmp_path), "--json"])
    assert done.exit_code == 0, done.output
    told = json.loads(done.stdout)
    assert told["answer"][0].startswith(
        "Every backend is right within its uncertainty or refuses the scene. 1 extremes were run with"
    )
    assert {row["extreme"] for row in told["tables"]["outcomes"]} == {"at-rest"}
    assert len(told["tables"]["findings"]) == len(BACKENDS)
    assert (tmp_path / "figures/error-over-bars.svg").read_bytes().startswith(b"<svg")


def test_what_is_slow_or_unknown_is_left_out() -> None:
    with pytest.raises(UsageError, match="match = 'nothing'; allowed: a part of one of: pair-at-1e-9"):
        db.study("extremes", match="nothing")
    with pytest.raises(UsageError, match="match = 'bodies-100000'"):
        db.study("extremes", match="bodies-100000", quick=True)
    assert {name for name, entry in ALL.items() if entry.slow} == {
        "mass-light-between",
        "stiffness-1e8",
        "bodies-100000",
    }


# made-up findings


def _theory(truth: Trajectory | None, **changes: Any) -> Finding:
    case = Case(scene=ALL["bodies-2"].scene, backend="bca", resolution=Resolution(), sampling=Sampling(count=4))
    standard = Standard(says="truth", run=truth)
    return judge(Result(case=case, trajectory=free_flight(**changes)), [standard], model=True)


def test_a_theory_is_measured_by_its_arrivals_or_else_by_its_forces() -> None:
    never = np.full(2, math.nan)
    late = _theory(free_flight(), crossing_time=np.array([0.11, 0.22]))
    # 0.01 s of 0.1 s, and 0.02 s of 0.2 s
    assert (late.word, late.quantity, late.error) == (Word.MODEL, "crossing_time", pytest.approx(0.1))
    weak = _theory(free_flight(crossing_time=never), peak_force=np.array([9.0, 18.0]))
    assert (weak.word, weak.quantity, weak.error) == (Word.MODEL, "peak_force", pytest.approx(0.1))
    nothing = _theory(free_flight(crossing_time=never, peak_force=never))
    assert (nothing.word, nothing.quantity) == (Word.MODEL, "")
    assert _theory(None).word is Word.MODEL
    broken = _theory(free_flight(), velocity=np.full((5, 3), math.inf))
    assert (broken.word, broken.reason) == (Word.WRONG, "velocities that are not finite")


def test_a_body_without_contacts_is_judged_by_its_motion_alone() -> None:
    alone: dict[str, Any] = {"bodies": 1, "contacts": 0, "peak_force": np.zeros(0), "crossing_time": np.zeros(0)}
    case = Case(scene=ALL["bodies-2"].scene, backend="verlet", resolution=Resolution(), sampling=Sampling(count=4))
    standard = Standard(says="truth", run=free_flight(**alone))
    for shift, word in ((0.0, Word.RIGHT), (0.5, Word.WRONG)):
        run = free_flight(**alone, velocity=np.full((5, 1), 1.0 + shift))
        assert judge(Result(case=case, trajectory=run), [standard], model=False).word is word


def test_what_is_left_out_or_refused_is_a_row_with_its_reason() -> None:
    entry = replace(
        ALL["speed-0.001"],
        dt=1e-6,
        left_out={"scipy": "it would take an hour"},
        settings={"verlet": {"table_lines": 7}},
    )
    late, refused = rows_of([entry], ["scipy", "verlet"])
    assert (late.finding.word, late.finding.reason, late.outcome) == (
        Word.NOT_RUN, "it would take an hour", Outcome.NOT_RUN,
    )  # fmt: skip
    assert refused.finding.word is Word.REFUSED
    assert refused.finding.reason.startswith("table_lines = 7; allowed: ")


def test_a_truth_that_breaks_is_no_truth(monkeypatch: pytest.MonkeyPatch) -> None:
    def truths_break(cases: Sequence[Case], **_: Any) -> tuple[Result, ...]:
        own, *others = cases
        return (run_cases([own])[0], *(Result(case=case, failure=RunBroken("it broke")) for case in others))

    monkeypatch.setattr(extremes_study, "run_cases", truths_break)
    [row] = rows_of([replace(ALL["speed-0.001"], dt=1e-6)], ["verlet"])
    assert (row.finding.word, row.outcome) == (Word.NO_TRUTH, Outcome.FAIL)
    assert row.finding.reason.endswith(": it broke")
    assert row.finding.standard in row.finding.reason


def test_the_answer_counts_and_names_what_is_not_right() -> None:
    def row(name: str, backend: str, **finding: Any) -> Row:
        entry = replace(ALL["bodies-2"], scene=replace(ALL["bodies-2"].scene, name=name))
        return Row(entry=entry, backend=backend, expected=Expected(Word.RIGHT), finding=Finding(**finding))

    right = row("a", "verlet", word=Word.RIGHT, ratio=0.25, quantity="velocity", unsaid="peak_force")
    vague = row("b", "scipy", word=Word.NO_BAR)
    wrong = [row(f"c{k}", "verlet", word=Word.WRONG, ratio=2.0) for k in range(10)]
    told = " ".join(answer([right, vague, *wrong]))
    assert told == (
        "10 of 12 results are outside their uncertainty (c0: verlet; c1: verlet; c2: verlet; c3: verlet; c4: verlet;"
        " c5: verlet; c6: verlet; c7: verlet; and 2 more). 12 extremes were run with 2 backends: 1 right within the"
        " uncertainty, 1 with an uncertainty of 100 % or more, 10 outside the uncertainty. The error of the right"
        " results relative to the sum of both uncertainties is 0.25 (median) and at most 0.25 (verlet on a, velocity)."
        " An uncertainty of 100 % or more is stated by: b: scipy. 1 of the right results have no uncertainty for one"
        " of the quantities or for some contacts; the table of all numbers lists them. 1 of 12 outcomes are as"
        " expected; not so: b: scipy; c0: verlet; c1: verlet; c2: verlet; c3: verlet; c4: verlet; c5: verlet; c6:"
        " verlet; and 3 more."
    )
