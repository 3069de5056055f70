"""Page one: sentences that follow from what was found, whatever that is."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import replace

import pytest

import dem_bridge as db
from dem_bridge.observables.verdict import Outcome, Verdict
from dem_bridge.report.study import Claim
from dem_bridge.studies.paper.claims_numbers import numbers
from dem_bridge.studies.paper.claims_wave import waves
from dem_bridge.studies.paper.effects import OBSERVABLES, Effect
from dem_bridge.studies.paper.runs import MAIN, Runs
from dem_bridge.studies.paper.summary import FAILS_BY, FAILURES, NOT_VERIFIED, answer, failures
from dem_bridge.verification.assess import SceneStudy
from dem_bridge.verification.reference_choice import REFERENCE, SCIPY
from dem_bridge.verification.roles import POSITIONAL, assign_roles


def _verdict(scene: str, backend: str, reference: str, difference: float, **other: object) -> Verdict:
    parts = {"outcome": Outcome.PASS, "quantity": "velocity", "sentence": ""} | other
    return Verdict(scene=scene, backend=backend, reference=reference, difference=difference, **parts)  # type: ignore[arg-type]


def _study(scene: str, error: float, same: float, two: float, *more: Verdict) -> SceneStudy:
    verdicts = (
        _verdict(scene, "lammps-granular", REFERENCE, error),
        _verdict(scene, "lammps-granular", POSITIONAL, same),
        _verdict(scene, SCIPY, REFERENCE, two),
        _verdict(scene, "lammps-granular", REFERENCE, 0.9, quantity="peak_force"),
        _verdict(scene, "verlet", REFERENCE, 0.8),
        *more,
    )
    return SceneStudy(roles=assign_roles(db.load_scene(scene)), verdicts=verdicts)


STUDIES = [
    _study(MAIN[0], 1.1e-6, 2e-12, 3e-12),
    _study(MAIN[1], 1.5e-6, 1e-12, 4e-12),
    _study("stacked-40", 7e-3, 6e-5, 5e-11),
]


def _effect(id: str, kind: str, what: str, *changes: float) -> Effect:
    return Effect(id=id, kind=kind, what=what, scene=MAIN[0], changes=dict(zip(OBSERVABLES, changes, strict=True)))


EFFECTS = [
    _effect("lammps", "numerics", "LAMMPS", 1e-7, -2e-6, 0.0, math.nan),
    _effect("ode45", "numerics", "ode45", 1e-3, 1e-3, 1e-3, 1e-3),
    _effect("bca", "theory", "binary collisions", 0.02, 0.03, 0.5, -0.8),
    _effect("exact-stiffness", "model", "exact law", 0.03, -0.04, 0.0, 0.0),
    _effect("striker-mass", "parameter", "a lighter striker", 0.0, 0.0, -0.13, 0.1),
    _effect("dashpot", "supposed", "a dashpot", 0.99, 0.0, 0.0, 0.0),
]


def test_the_answer_is_five_sentences_each_with_a_number(claims: tuple[Claim, ...]) -> None:
    found = answer(claims, EFFECTS, STUDIES)
    assert len(found) == 5
    assert all(sentence.endswith(".") and "nan" not in sentence for sentence in found)
    codes, count, theory, failing, largest = found
    # of both main chains the larger; round-off against the twin in positions; both references everywhere
    for text in (
        "differ from the reference solution by at most 1.5e-06",
        "agrees with it to 2.0e-12",
        "agree to 4.0e-12 on these chains",
    ):
        assert text in codes
    assert "3 of the 3 scenes can be solved by both, which then agree to 5.0e-11" in codes
    kinds = Counter(one.kind for one in claims)
    assert kinds["holds"] == sum(one.outcome is Outcome.PASS for one in claims)
    assert count.startswith(f"Of {len(claims)} claims, {kinds['holds']} hold, {kinds['print']} are wrong in print")
    assert f"and {kinds['not run']} were not run" in count
    for text in (
        "slows down to 0.39",
        "speeds up to 2.35",
        "within 2.3 %",
        "of 0.71 m/s (simulated at cylinder 20: 0.39",
    ):
        assert text in theory
    failed = {one.id for one in claims if one.outcome is Outcome.FAIL}
    assert failed <= set(FAILURES)
    for id, text in FAILURES.items():
        assert (text in failing) == (id in failed), id
    assert {one.kind for one in claims if one.id in failed} <= set(FAILS_BY)
    # the gravest first, each claim once
    assert [claim.id for claim, _, _ in failures(claims)] == [id for id in FAILURES if id in failed]
    # all kinds but numerics; then what the paper itself says; then what it only suspects
    assert largest.startswith(
        "The largest term of the whole error budget is a dashpot, by 99 % (arrival at the last cylinder"
    )
    assert "Among the model terms and parameters the largest is a lighter striker, by -13 % (force at the" in largest
    assert "changes results by up to 4 %" in largest
    assert "with values assumed by us, the largest is a dashpot, by 99 %" in largest
    assert "the numerical error of LAMMPS is 0.0002 %" in largest


@pytest.mark.parametrize("outcome", [Outcome.FAIL, Outcome.BROKEN])
def test_codes_are_not_right_where_a_verdict_fails(outcome: Outcome, claims: tuple[Claim, ...]) -> None:
    wrong = _verdict("stacked-40", "lammps-granular", REFERENCE, 1e-2, quantity="crossing_time", outcome=outcome)
    studies = [*STUDIES[:2], _study("stacked-40", 1e-6, 1e-12, 1e-12, wrong)]
    codes = answer(claims, EFFECTS, studies)[0]
    assert codes.startswith("The codes are not verified: of 16 verdicts")
    assert f"{int(outcome is Outcome.FAIL)} are FAIL and {int(outcome is Outcome.BROKEN)} are BROKEN" in codes
    refused = replace(wrong, outcome=Outcome.NOT_RUN)
    assert answer(claims, EFFECTS, [*STUDIES, _study("accelerating-200", 0, 0, 0, refused)])[0].startswith(
        "LAMMPS integrates the equations of motion correctly"
    )


def test_without_lammps_nothing_is_said_of_it(claims: tuple[Claim, ...]) -> None:
    studies = [
        replace(one, verdicts=tuple(v for v in one.verdicts if v.backend != "lammps-granular")) for one in STUDIES
    ]
    codes = answer(claims, EFFECTS, studies)[0]
    assert codes.startswith("LAMMPS was not run on the paper's two chains; the two references agree to 5.0e-11")


def test_without_runs_the_answer_says_so() -> None:
    nothing = (*numbers(Runs.of([])), *waves(Runs.of([]), []))
    found = answer(nothing, [], [])
    assert found[2] == "The reference did not run on both chains of the paper."
    assert found[4] == "There is no error budget, because runs are missing."
    holding = [one for one in nothing if one.outcome is Outcome.PASS]
    assert answer(holding, [], [])[3] == "All claims hold that could be decided."


def test_the_validity_on_page_one_has_the_numbers_of_its_claims(claims: tuple[Claim, ...]) -> None:
    [text] = [item for item in NOT_VERIFIED if "contact law" in item]
    values = {value.name: value.value for claim in claims for value in claim.values}
    for way in ("two bodies", "in the chain"):
        assert f"{min(values[f'fewest crossings, {way}, {name}'] for name in MAIN):.1f}" in text
    assert f"In {values['ellipses beyond the cylinder, accelerating-40']:.0f} of 39 contacts of the accel" in text
    tension = max(values[f"largest tension over strength, {name}"] for name in MAIN)
    assert f"up to {tension:.1f} times the tensile strength" in text


def test_what_is_not_verified_is_said() -> None:
    assert any("experiment" in one for one in NOT_VERIFIED)
    assert all(one.endswith(".") for one in NOT_VERIFIED)
