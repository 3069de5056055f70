"""A difference, an uncertainty and a tolerance give one outcome of a closed set, with one sentence."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from itertools import permutations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dem_bridge.observables.differences import Difference
from dem_bridge.observables.verdict import Outcome, Verdict, exit_code, judge, judge_relative, numerical_verdict

relative = st.floats(0.0, 1e3)


@given(difference=relative, bar=relative, tolerance=relative)
def test_a_pass_is_within_and_a_fail_is_beyond_whatever_the_bar_allows(
    difference: float, bar: float, tolerance: float
) -> None:
    outcome = judge(difference, bar, tolerance)
    assert outcome in (Outcome.PASS, Outcome.FAIL, Outcome.UNDECIDED)
    assert (outcome is Outcome.PASS) == (difference + bar <= tolerance)
    assert (outcome is Outcome.FAIL) == (difference - bar > tolerance)


@given(difference=relative, tolerance=relative)
def test_without_a_bar_everything_is_decided(difference: float, tolerance: float) -> None:
    assert judge(difference, 0.0, tolerance) is not Outcome.UNDECIDED


@pytest.mark.parametrize(
    ("difference", "bar"),
    [(math.nan, 0.0), (0.0, math.nan), (0.0, math.inf), (math.inf, math.inf), (math.nan, math.nan)],
)
def test_what_cannot_be_known_is_undecided(difference: float, bar: float) -> None:
    assert judge(difference, bar, 1e-6) is Outcome.UNDECIDED


def test_an_infinite_difference_with_a_bar_fails() -> None:
    assert judge(math.inf, 1e-3, 1e-6) is Outcome.FAIL


def test_the_set_of_outcomes_is_closed() -> None:
    assert [outcome.value for outcome in Outcome] == [
        "PASS", "FAIL", "UNDECIDED", "MODEL_DIFFERENCE", "NOT_RUN", "BROKEN",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("outcomes", "code"),
    [
        ([], 0),
        ([Outcome.PASS], 0),
        ([Outcome.PASS, Outcome.NOT_RUN, Outcome.MODEL_DIFFERENCE], 0),
        ([Outcome.PASS, Outcome.UNDECIDED], 4),
        ([Outcome.FAIL, Outcome.UNDECIDED, Outcome.PASS], 1),
        ([Outcome.FAIL, Outcome.BROKEN, Outcome.UNDECIDED], 3),
    ],
)
def test_the_exit_code_is_that_of_the_worst_outcome_in_any_order(outcomes: list[Outcome], code: int) -> None:
    for order in permutations(outcomes):
        assert exit_code(order) == code


def _difference(value: float, reference_uncertainty: float, **changes: object) -> Difference:
    parts: dict[str, object] = {
        "quantity": "velocity",
        "value": value,
        "scale": 0.8,
        "unit": "m/s",
        "scale_name": "largest |velocity| of the reference",
        "uncertainty": 3e-6,
        "reference_uncertainty": reference_uncertainty,
        "axis": "body",
        "body": 7,
        "time": 1.5e-3,
    }
    return Difference(**(parts | changes))  # type: ignore[arg-type]


def _verdict(difference: Difference, tolerance: float = 1e-6) -> Verdict:
    return numerical_verdict(
        difference,
        scene="chain",
        backend="lammps-granular",
        reference="scipy",
        tolerance=tolerance,
        meaning="time step",
    )


@pytest.mark.parametrize(
    ("value", "bar", "outcome", "relation"),
    [
        (1e-7, 1e-9, Outcome.PASS, "is within"),
        (1e-5, 1e-9, Outcome.FAIL, "exceeds"),
        (1e-5, 1e-4, Outcome.UNDECIDED, "cannot be told from"),
    ],
)
def test_the_sentence_says_everything_that_decided(value: float, bar: float, outcome: Outcome, relation: str) -> None:
    verdict = _verdict(_difference(value, bar))
    assert verdict.outcome is outcome
    sentence = verdict.sentence
    for part in ("velocity", "lammps-granular", "scipy", f"{value:.2e}", f"{bar:.1e}", "1.0e-06", relation):
        assert part in sentence
    assert "body 7 at t = 1.5 ms" in sentence
    assert "\n" not in sentence


@pytest.mark.parametrize(("tolerance", "decides"), [(math.nextafter(1.0, 0.0), True), (1.0, False), (2.0, False)])
def test_a_tolerance_of_all_and_more_decides_nothing_and_says_so(tolerance: float, decides: bool) -> None:
    verdict = _verdict(_difference(1e-7, 1e-9), tolerance)
    assert verdict.outcome is (Outcome.PASS if decides else Outcome.UNDECIDED)
    assert ("because the tolerance is an uncertainty of 100 % or more" in verdict.sentence) is not decides


def test_the_bar_that_counts_is_the_references() -> None:
    # the run's own bar of 3e-6 is above the tolerance; what it differs by is known all the same
    assert _verdict(_difference(1e-7, 1e-9)).outcome is Outcome.PASS


def test_a_quantity_without_a_time_is_placed_by_its_contact() -> None:
    sentence = _verdict(_difference(1e-7, 0.0, quantity="peak_force", axis="contact", time=math.nan)).sentence
    assert "contact 7" in sentence
    assert " ms" not in sentence


def test_a_verdict_keeps_both_bars_scale_and_tolerance() -> None:
    verdict = _verdict(_difference(1e-7, 2e-9))
    assert (verdict.difference, verdict.uncertainty, verdict.reference_uncertainty) == (1e-7, 3e-6, 2e-9)
    assert (verdict.scale, verdict.unit, verdict.tolerance, verdict.meaning) == (0.8, "m/s", 1e-6, "time step")


def test_a_verdict_is_plain_json_and_what_is_not_finite_becomes_null() -> None:
    verdict = Verdict(
        scene="chain",
        quantity="velocity",
        backend="lammps-granular",
        reference="scipy",
        outcome=Outcome.NOT_RUN,
        sentence="LAMMPS is missing.",
        uncertainty=math.inf,
        first_divergence=(1e-3, 5),
    )
    assert "known_defect" not in verdict.as_json()
    named = replace(verdict, known_defect="a defect").as_json()
    assert named == verdict.as_json() | {"known_defect": "a defect"}
    read = json.loads(json.dumps(verdict.as_json(), allow_nan=False))
    assert read["outcome"] == "NOT_RUN"
    assert read["difference"] is read["uncertainty"] is read["tolerance"] is None
    assert read["first_divergence"] == [1e-3, 5]
    # the keys of the interface contract in DESIGN.md
    assert set(read) >= {
        "scene", "quantity", "backend", "reference", "difference", "scale", "uncertainty",
        "reference_uncertainty", "tolerance", "outcome", "sentence",
    }  # fmt: skip


@given(st.floats(0.0, 10.0), st.floats(0.0, 10.0), st.floats(0.0, 10.0))
def test_a_relative_tolerance_of_all_and_more_decides_nothing(difference: float, bar: float, tolerance: float) -> None:
    wanted = judge(difference, bar, tolerance) if tolerance < 1.0 else Outcome.UNDECIDED
    assert judge_relative(difference, bar, tolerance) is wanted
