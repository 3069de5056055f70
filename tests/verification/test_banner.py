"""The banner of a page: the error, its cause and the step; verdicts that fail for one reason are one group."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType

import pytest

from dem_bridge.backends.base import Resolution, Sampling
from dem_bridge.observables.verdict import Outcome, Verdict
from dem_bridge.runs.campaign import Result
from dem_bridge.runs.case import Case
from dem_bridge.scene.scene import Scene
from dem_bridge.verification.assess import SceneStudy
from dem_bridge.verification.banner import banner_of, largest_step, reasons_not_run
from dem_bridge.verification.budget import Budget
from dem_bridge.verification.reference_choice import REFERENCE
from dem_bridge.verification.roles import TWIN, assign_roles
from tests.helpers.fake_runs import free_flight

SCENE = Scene(name="three", duration=1.5e-4, mass=(8e-3, 1e-2, 1e-2), stiffness=(4e9, 4e9), velocity=(0.8, 0.0, 0.0))
ENGINE = assign_roles(SCENE).engine
PARTS = MappingProxyType({"time step": 1e-6, "table": 0.0, "round-off": 1e-12, "sampling": 0.0, "reference": 1e-13})


def _verdict(quantity: str = "velocity", reference: str = REFERENCE, size: float = 1e-6, **fields: object) -> Verdict:
    known: dict[str, object] = {
        "scene": "three", "quantity": quantity, "backend": ENGINE, "reference": reference, "outcome": Outcome.PASS,
        "sentence": f"{quantity} differs.", "difference": size, "scale": 0.8, "tolerance": 5e-6,
        "meaning": "time step, implementation and round-off",
    }  # fmt: skip
    return Verdict(**known | fields)  # type: ignore[arg-type]


def _study(
    *verdicts: Verdict, parts: Mapping[str, float] = PARTS, unexplained: float = 1e-13, found: float = 1e-6
) -> SceneStudy:
    budget = Budget(
        quantity="velocity", found=found, parts=parts, unexplained=unexplained, allowed=1e-12, scale_name="largest"
    )
    case = Case(scene=SCENE, backend=ENGINE, resolution=Resolution(), sampling=Sampling(count=2))
    run = replace(free_flight(bodies=3, contacts=2), provenance={"settings": {"dt": 1e-8}})
    return SceneStudy(
        roles=assign_roles(SCENE),
        others=(Result(case=case, trajectory=run),),
        verdicts=verdicts,
        budgets=(budget,),
        # errors of order 2
        refinement={ENGINE: ([4e-8, 2e-8, 1e-8], [16e-6, 4e-6, 1e-6])},
    )


def test_a_pass_says_error_tolerance_cause_and_steps() -> None:
    banner = banner_of(_study(_verdict()), 5e-6)
    assert (banner.outcome, banner.groups) == (Outcome.PASS, ())
    error, cause, steps = banner.sentences
    assert error == "PASS: at 1e-08 s LAMMPS is within 1e-6 of the largest velocity, 0.8 m/s (5e-6 allowed)."
    assert cause == "Cause: the time step."
    assert steps == (
        "The largest step for an error of at most 1 % is 1.0e-6 s, 0.1 % is 3.1e-7 s, 1e-4 is 1.0e-7 s (above 4.0e-8 s,"
        " the coarsest that was run)."
    )


@pytest.mark.parametrize(
    ("accuracy", "dt", "source"),
    [
        (4e-6, 2e-8, "measured"),
        (8e-6, 2.8e-8, "between 2e-08 s and 4e-08 s, which were run"),
        (1e-6, 1e-8, "measured"),
        (2.5e-7, 5e-9, "below 1e-08 s, the finest that was run"),
    ],
)
def test_a_step_was_run_or_lies_between_those_that_were_or_follows_from_the_order(
    accuracy: float, dt: float, source: str
) -> None:
    step = largest_step(_study(_verdict()), accuracy)
    assert step is not None
    assert (step.dt, step.source("{:g} s".format)) == (dt, source)
    assert largest_step(_study(_verdict()), 1.0) is None  # too far from all runs


def test_a_step_of_a_scene_without_refinement_is_not_said() -> None:
    assert largest_step(replace(_study(_verdict()), refinement={}), 1e-3) is None


def test_eleven_verdicts_that_fail_for_the_time_step_are_one_group_with_the_line_to_write() -> None:
    late = [_verdict(f"quantity_{k}", size=1e-4 * (k + 1), outcome=Outcome.FAIL) for k in range(10)]
    failing = [_verdict(size=1e-4, outcome=Outcome.FAIL), *late]
    passing = [_verdict(reference=TWIN, meaning="implementation and round-off") for _ in range(5)]
    parts = {**PARTS, "time step": 1e-4}
    banner = banner_of(_study(*failing, *passing, parts=parts, found=1e-4), 5e-6)
    assert banner.sentences[0].startswith("FAIL: at 1e-08 s velocities of LAMMPS err by up to 1e-4 of the largest")
    [group] = banner.groups
    assert group.cause == "step"
    assert group.sentence.startswith("11 of 16 checks fail for one reason: the time step is too coarse (worst: quan")
    assert "0.1 %; 5e-6 allowed" in group.sentence
    assert group.write == "timestep 2.2e-8"
    assert group.verdicts == tuple(failing)


def test_failures_of_two_causes_are_two_groups_the_larger_first() -> None:
    step = _verdict("energy", "its own start", meaning="time step", outcome=Outcome.FAIL)
    faults = [
        _verdict(reference=TWIN, meaning="implementation and round-off", outcome=Outcome.FAIL),
        _verdict(size=1e-2, outcome=Outcome.FAIL),  # its budget leaves most of it unexplained
    ]
    banner = banner_of(_study(step, *faults, unexplained=1e-2, found=1e-2), 5e-6)
    assert [(group.cause, len(group.verdicts)) for group in banner.groups] == [("implementation", 2), ("step", 1)]
    assert banner.sentences[1].startswith("Cause: unexplained; LAMMPS differs")


def test_a_known_defect_is_named_with_the_words_to_write() -> None:
    failing = [_verdict(outcome=Outcome.FAIL, known_defect="tsuji-prefactor", size=k * 1e-2) for k in (1, 2)]
    [group] = banner_of(_study(*failing), 5e-6).groups
    assert "2 of 2 checks fail for one reason: LAMMPS has a known defect, tsuji-prefactor" in group.sentence
    assert group.write


def test_a_broken_run_and_what_cannot_be_decided_are_told_apart() -> None:
    broken = _verdict(outcome=Outcome.BROKEN, sentence="LAMMPS: Lost atoms.", difference=float("nan"), meaning="")
    doubtful = _verdict("energy", "its own start", meaning="round-off", outcome=Outcome.UNDECIDED)
    banner = banner_of(_study(broken, doubtful), 5e-6)
    assert banner.outcome is Outcome.BROKEN
    assert {group.cause: group.sentence for group in banner.groups}["broken"].endswith("(LAMMPS: Lost atoms).")
    assert any("1 of 2 checks are undecided" in group.sentence for group in banner.groups)


def test_every_reason_why_nothing_was_run_is_said_once() -> None:
    reason = _verdict(outcome=Outcome.NOT_RUN, sentence="no second solution.", backend="scipy", difference=float("nan"))
    banner = banner_of(_study(_verdict(), reason, replace(reason, quantity="order")), 5e-6)
    assert (len(banner.sentences), banner.not_run) == (3, ("Not run: no second solution.",))
    assert banner_of(_study(reason), 5e-6).sentences[0] == "NOT_RUN: no check could be made."


def test_a_backend_that_supports_none_of_several_scenes_has_one_sentence() -> None:
    names = ("one", "two", "three")
    bca = [
        _verdict(
            scene=name, backend="bca", reference="", outcome=Outcome.NOT_RUN, sentence=f"bca on {name}: it has {name}."
        )
        for name in names
    ]
    scipy = [
        _verdict(
            scene=name,
            backend="scipy",
            reference="",
            outcome=Outcome.NOT_RUN,
            sentence=f"reference on {name} is scipy.",
        )
        for name in names[:2]
    ]
    assert reasons_not_run([_study(bca[0], scipy[0]), _study(bca[1], scipy[1]), _study(bca[2])]) == (
        "Not run: bca on 3 scenes, because binary collisions describe a single pulse into a free chain of touching"
        " bodies at rest (-v prints what each scene has).",
        "Not run: reference on 2 scenes is scipy.",
    )
    assert reasons_not_run([_study(bca[0])]) == ("Not run: bca on one: it has one.",)
