"""SAME and CHANGED: one wrong digit is found where it is, and right and wrong are told apart from same and changed."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from dem_bridge.runs.digits import made_at
from dem_bridge.trajectory.trajectory import Trajectory
from dem_bridge.verification.regression.baseline import Accuracy, Baseline, baseline_of_text
from dem_bridge.verification.regression.compare import Change, compare, worst_outcome
from tests.verification.regression.test_baseline import PROVENANCE, small


def as_run(baseline: Baseline, **changes: Any) -> Trajectory:
    """The run that a baseline is of, with the provenance of a run."""
    run = replace(baseline.run, **changes)
    told = {"scene_hash": baseline.provenance["scene_hash"], "versions": baseline.provenance["versions"]}
    return replace(run, provenance={**told, "machine": baseline.provenance["machine"], "backend": "reference"})


def test_the_same_is_the_same_bit_for_bit() -> None:
    found = compare(small(), as_run(small()))
    assert (found.change, found.bitwise, found.departures) == (Change.SAME, True, ())
    # nothing judged it now: it is as right as it was
    assert (
        found.sentence
        == "bit for bit; still right: the velocity error against reference is 0.0001 (was 0.0001), tolerance 0.001."
    )


@pytest.mark.parametrize(("row", "body"), [(1, 0), (2, 2), (4, 1)])
def test_a_changed_velocity_is_found_at_its_time_and_body(row: int, body: int) -> None:
    velocity = small().run.velocity.copy()
    velocity[row, body] += 1e-9
    velocity[4, 2] += 1e-6  # later and more: not the first
    [found] = compare(small(), as_run(small(), velocity=velocity)).departures
    assert found.quantity == "velocity"
    assert (found.time, found.body) == (small().run.time[row], body if row < 4 else 2)
    assert found.largest_difference == pytest.approx(1e-6 / np.max(np.abs(small().run.velocity)), rel=1e-3)


@pytest.mark.parametrize(
    ("fingerprint", "text"),
    [
        (None, "; the baseline does not state the last digits of its machine, so the difference may be that of"
         " machines"),
        ("1" * 40, ""),
        ("2" * 40, "; the baseline is of a machine with other last digits (fingerprint 22222222, here 11111111), so the"
         " difference may be that of the machines"),
    ],
)  # fmt: skip
def test_a_difference_from_another_machine_is_said_to_be_one(fingerprint: str | None, text: str) -> None:
    provenance = {**PROVENANCE, **({} if fingerprint is None else {"digits": fingerprint})}
    baseline = replace(small(), provenance=provenance)
    assert baseline_of_text(baseline.text()).provenance == provenance
    with made_at("1" * 40):
        [same, changed] = [
            compare(baseline, as_run(baseline, velocity=factor * baseline.run.velocity)) for factor in (1.0, 1.0 + 1e-9)
        ]
    assert (same.change, changed.change) == (Change.SAME, Change.CHANGED)
    assert "machine" not in same.sentence
    assert changed.sentence == f"{changed.departures[0].sentence}{text}."
    assert ("last digits 22222222 -> 11111111" in same.notes) is (fingerprint == "2" * 40)


def test_what_differs_by_less_than_same_within_is_the_same_but_not_bit_for_bit() -> None:
    velocity = small().run.velocity * (1.0 + 4e-13)
    found = compare(small(), as_run(small(), velocity=velocity))
    assert (found.change, found.bitwise) == (Change.SAME, False)
    assert 0.0 < found.differences["velocity"] < 1e-12


def test_a_crossing_that_is_lost_and_one_that_is_new_are_changes() -> None:
    for crossing in ([math.nan, math.nan], [1.25e-3, 2e-3]):
        found = compare(small(), as_run(small(), crossing_time=np.array(crossing)))
        [departure] = found.departures
        assert departure.quantity == "crossing_time"
        assert departure.largest_difference == math.inf


def test_the_first_in_time_comes_first() -> None:
    velocity, force = small().run.velocity.copy(), small().run.peak_force.copy()
    velocity[3, 1] *= 1.0 + 1e-6  # at 2.25 ms
    force[0] *= 1.0 + 1e-6  # that contact is at its deepest at 1.25 ms
    found = compare(small(), as_run(small(), velocity=velocity, peak_force=force))
    assert [(one.quantity, one.body) for one in found.departures] == [("peak_force", 0), ("velocity", 1)]
    assert found.departures[0].time == 1.25e-3


def test_a_value_that_is_not_a_number_has_changed() -> None:
    velocity = small().run.velocity.copy()
    velocity[2, 1] = math.nan
    [found] = compare(small(), as_run(small(), velocity=velocity)).departures
    assert (found.time, found.body) == (small().run.time[2], 1)


def test_a_huge_value_is_not_its_own_excuse() -> None:
    velocity = small().run.velocity.copy()
    velocity[1, 1] += 1e20
    velocity[3, 0] += 1e-6
    assert compare(small(), as_run(small(), velocity=velocity)).departures[0].count == 2
    # of peak forces a contact's scale is at least a thousandth of the largest, which then hides the other contact
    force = small().run.peak_force * np.array([1e12, 1.0 + 1e-6])
    [found] = compare(small(), as_run(small(), peak_force=force)).departures
    assert (found.count, found.largest_difference) == (2, pytest.approx(1e12))


def test_what_failed_is_worse_than_what_is_undecided_in_any_order() -> None:
    accuracy = Accuracy(error=0.1, uncertainty=0.0, tolerance=1e-3, outcome="PASS", by="reference")
    for outcomes in itertools.permutations(("PASS", "FAIL", "UNDECIDED")):
        some = {str(i): replace(accuracy, outcome=outcome) for i, outcome in enumerate(outcomes)}
        # the documented exit codes: 1, a check failed, goes before 4, undecided
        assert worst_outcome(some) == "FAIL"
        without = {name: item for name, item in some.items() if item.outcome != "FAIL"}
        assert worst_outcome(without) == "UNDECIDED"


@pytest.mark.parametrize(
    ("was", "is_", "words"),
    [(0.0, 1e-4, "still right"), (0.0, 1.0, "now wrong"), (1.0, 1e-4, "now right"), (1.0, 2.0, "still wrong")],
)
def test_changed_and_right_are_two_answers(was: float, is_: float, words: str) -> None:
    truth = as_run(small(uncertainty={**small().run.uncertainty, "peak_force": 0.0}))
    size = float(np.max(np.abs(truth.velocity)))
    known = {**small().run.uncertainty, "peak_force": 0.0}
    before = small(velocity=small().run.velocity + was * size, uncertainty=known)
    found = compare(before, as_run(small(), velocity=small().run.velocity + is_ * size), reference=truth)
    assert found.change is Change.CHANGED
    assert words in found.sentence
    assert found.after["velocity"].error == pytest.approx(is_, rel=1e-6)
    assert found.before["velocity"].error == pytest.approx(was, abs=1e-12)


def test_peaks_and_crossings_may_err_by_the_bars_of_the_baseline_and_velocities_may_not() -> None:
    truth = as_run(small(uncertainty={"velocity": 0.0, "peak_force": 0.0, "crossing_time": 0.0}))
    wide = small(uncertainty={"velocity": 10.0, "peak_force": 10.0, "crossing_time": 0.0})
    for name, outcome in (("peak_force", "PASS"), ("velocity", "FAIL")):
        off = {name: getattr(small().run, name) * 1.1}
        assert compare(wide, as_run(small(), **off), reference=truth).after[name].outcome == outcome


def test_an_unknown_uncertainty_of_a_baseline_leaves_its_accuracy_undecided() -> None:
    truth = as_run(small(uncertainty={"velocity": 0.0, "peak_force": 0.0, "crossing_time": 0.0}))
    unknown = small(uncertainty={"velocity": 0.0, "peak_force": math.inf, "crossing_time": 0.0})
    after = compare(unknown, as_run(small(), peak_force=small().run.peak_force * 1.1), reference=truth).after
    assert (after["peak_force"].outcome, after["velocity"].outcome) == ("UNDECIDED", "PASS")


def test_another_scene_or_shape_has_changed_whatever_its_values() -> None:
    run = as_run(small())
    moved = replace(run, provenance={**run.provenance, "scene_hash": "6" * 64})
    assert compare(small(), moved).change is Change.CHANGED
    longer = small(time=2.0 * small().run.time)
    assert compare(longer, run).change is Change.CHANGED
