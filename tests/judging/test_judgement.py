"""Errors, first divergence, outcome and text of a judgement."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import dem_bridge as db
from dem_bridge.errors import UsageError
from dem_bridge.formats.readers import Record
from dem_bridge.judging.diagnosis import CAUSES, Diagnosis
from dem_bridge.judging.judgement import KEYS, Judgement
from dem_bridge.judging.records import judge_records
from dem_bridge.judging.reference import file_errors
from dem_bridge.judging.sentences import TEXTS, lines
from dem_bridge.scene.scene import Wall
from tests.helpers.judged_records import CHAIN, record
from tests.helpers.seams import Seam, plant

STEPS = (1e-6, 5e-7, 2.5e-7)


@pytest.fixture
def diagnosis(monkeypatch: pytest.MonkeyPatch) -> list[Diagnosis]:
    """Return a list whose only entry is the diagnosis of all judgements of a test."""
    answers = [Diagnosis(cause="none", evidence="The time step explains all.")]
    plant(monkeypatch, Seam.DIAGNOSE, lambda scene, records, floor: answers[0])
    return answers


@pytest.fixture
def convergent(diagnosis: list[Diagnosis]) -> Judgement:
    return judge_records(CHAIN, [record(dt=dt) for dt in STEPS], tolerance=1e-2)


def test_it_is_a_mapping_with_the_keys_of_the_contract(convergent: Judgement) -> None:
    assert list(convergent) == list(KEYS)
    assert list(KEYS) == [
        *("outcome", "error", "first_divergence", "order", "floor"),
        *("cause", "alternatives", "where", "evidence", "recognised"),
        *("step", "alternative_causes", "faults", "needed"),
    ]
    assert json.loads(json.dumps(convergent.as_json(), allow_nan=False)) == dict(convergent)
    assert all(convergent[key] == getattr(convergent, key) for key in KEYS)
    with pytest.raises(KeyError):
        convergent["scene"]
    assert set(convergent.error["velocity"]) == {"value", "scale", "uncertainty"}
    assert set(convergent.order["velocity"]) == {"value", "uncertainty"}


def test_a_step_longer_than_the_time_between_samples_is_noted(diagnosis: list[Diagnosis]) -> None:
    assert not any("longer" in text for text in judge_records(CHAIN, [record(dt=1e-6)]).recognised)
    doubtful = judge_records(CHAIN, [replace(record(dt=1e-6), dt=1e-3)])
    assert any("the step, 0.001 s, is longer than the sampling" in s for s in doubtful.recognised)


def test_the_finest_step_is_judged(convergent: Judgement) -> None:
    fine = judge_records(CHAIN, [record(dt=2.5e-7)])
    assert convergent.error == fine.error
    coarse = judge_records(CHAIN, [record(dt=1e-6)])
    assert 15.0 < coarse.error["velocity"]["value"] / fine.error["velocity"]["value"] < 17.0
    assert convergent.error["velocity"]["scale"] == pytest.approx(0.8)


def test_a_planted_error_is_measured_and_placed(diagnosis: list[Diagnosis]) -> None:
    exact = file_errors(CHAIN, [record()])[0]

    def plant(samples: dict[str, np.ndarray]) -> None:
        for name, part in exact.quantities.items():
            samples[name] -= part.error
        samples["displacement"][22, 3] += 3e-8
        samples["velocity"][25, 2] -= 2e-4

    judgement = judge_records(CHAIN, [record(change=plant)])
    assert judgement.error["velocity"]["value"] == pytest.approx(2e-4, rel=1e-6)
    assert judgement.error["displacement"]["value"] == pytest.approx(3e-8, rel=1e-6)
    assert judgement.first_divergence == {"time": pytest.approx(1.1e-4), "body": 3, "quantity": "displacement"}
    assert "body 2 at 125 µs" in str(judgement)


def test_a_divergence_of_a_contact_force_names_contact_and_body(diagnosis: list[Diagnosis]) -> None:
    exact = file_errors(CHAIN, [record()])[0]

    def plant(samples: dict[str, np.ndarray]) -> None:
        samples["contact_force"] -= exact.quantities["contact_force"].error
        samples["contact_force"][9, 2] += 1.0

    judgement = judge_records(CHAIN, [record(change=plant, quantities=("contact_force",))])
    first = {"time": pytest.approx(4.5e-5), "body": 2, "quantity": "contact_force", "contact": 2}
    assert judgement.first_divergence == first


@pytest.mark.parametrize(("tolerance", "outcome", "code"), [(1e-2, "PASS", 0), (1e-7, "FAIL", 1), (None, "PASS", 0)])
def test_the_tolerance_decides(diagnosis: list[Diagnosis], tolerance: float | None, outcome: str, code: int) -> None:
    judgement = judge_records(CHAIN, [record()], tolerance=tolerance)
    assert (judgement.outcome, judgement.exit_code) == (outcome, code)


def test_digits_that_straddle_the_tolerance_are_undecided(diagnosis: list[Diagnosis]) -> None:
    rough = record(dt=2.5e-7, rounding=0.01, quantities=("velocity",))
    judgement = judge_records(CHAIN, [rough], tolerance=5e-3)
    assert (judgement.outcome, judgement.exit_code) == ("UNDECIDED", 4)
    assert judgement.floor == pytest.approx(0.005 / 0.8, rel=1e-6)
    assert judgement.first_divergence is None
    assert "divergence" not in str(judgement)
    diagnosis[0] = Diagnosis(cause="mass", evidence="Never.")
    assert judge_records(CHAIN, [rough]).cause == "none"


@pytest.mark.parametrize(
    ("cause", "outcome", "code"), [("none", "PASS", 0), ("unknown", "UNDECIDED", 4), ("damping", "FAIL", 1)]
)
def test_without_a_tolerance_the_cause_decides(diagnosis: list[Diagnosis], cause: str, outcome: str, code: int) -> None:
    diagnosis[0] = Diagnosis(cause=cause, evidence="Because.", alternatives=("mass",), where="contact 1")
    judgement = judge_records(CHAIN, [record()])
    assert (judgement.outcome, judgement.exit_code) == (outcome, code)
    assert (judgement.cause, judgement.alternatives, judgement.where) == (cause, ["or: mass"], "contact 1")
    assert judgement.alternative_causes == ["mass"]
    words = dict(lines(judgement))
    assert (words["outcome"] if cause == "damping" else words["cause"]) == {
        "none": "Because.",
        "unknown": "unknown (contact 1). Because.",
        "damping": "FAIL: damping of contact 1. Because.",
    }[cause]
    # a cause does not change the outcome against a tolerance
    assert judge_records(CHAIN, [record()], tolerance=1e-2).outcome == "PASS"


def test_partial_data_are_judged_for_what_they_have(diagnosis: list[Diagnosis]) -> None:
    whole = record(quantities=("velocity",))
    rows, columns = np.array([2, 3, 11, 30]), (3, 1)
    part = replace(
        whole,
        time=whole.time[rows],
        values={"velocity": whole.values["velocity"][rows][:, columns]},
        columns={"velocity": columns},
        rounding={"velocity": np.zeros((4, 2)), "time": np.zeros(4)},
    )
    errors = file_errors(CHAIN, [whole])[0].quantities["velocity"].error[rows][:, columns]
    judgement = judge_records(CHAIN, [part])
    assert judgement.error["velocity"]["value"] == pytest.approx(np.max(np.abs(errors)), rel=1e-6)


def _subtract(samples: dict[str, np.ndarray], error: np.ndarray) -> None:
    samples["displacement"] -= error


def test_times_with_few_digits_explain_what_they_can(diagnosis: list[Diagnosis]) -> None:
    error = file_errors(CHAIN, [record()])[0].quantities["displacement"].error
    whole, shift = record(quantities=("displacement",), change=lambda samples: _subtract(samples, error)), 1e-8
    rounding = {"displacement": whole.rounding["displacement"], "time": np.full(len(whole.time), 2.0 * shift)}
    part = replace(whole, time=whole.time + shift * (whole.time > 0.0), rounding=rounding)
    blurred, sharp = (judge_records(CHAIN, [item]) for item in (part, whole))
    assert blurred.error["displacement"]["uncertainty"] == pytest.approx(0.8 * 2.0 * shift, rel=0.05)
    assert blurred.first_divergence is None
    assert sharp.first_divergence is None
    late = replace(part, rounding=rounding | {"time": 0.5 * rounding["time"]})
    assert (
        judge_records(CHAIN, [replace(late, time=part.time + shift * (whole.time > 0.0))]).first_divergence is not None
    )


def test_samples_before_the_start_are_left_out_and_the_reference_goes_on_after_the_end(
    diagnosis: list[Diagnosis],
) -> None:
    early = record(replace(CHAIN, duration=3e-4, samples=60))
    quantities = {name: np.vstack([part[:1], part]) for name, part in early.values.items()}
    rounding = {name: np.zeros(part.shape) for name, part in quantities.items()}
    time = np.concatenate([[-5e-6], early.time])
    with_past = replace(early, time=time, values=quantities, rounding=rounding | {"time": np.zeros(len(time))})
    judgement = judge_records(CHAIN, [with_past])
    assert judgement.error == judge_records(CHAIN, [early]).error
    assert judgement.recognised == [
        "verlet-1e-06: 1 samples before the start of the scene, 0 s, are not judged.",
        "The scene ends at 0.0002 s; the reference was continued to 0.0003 s.",
    ]


def _cut(rows: slice) -> Record:
    whole = record()
    return replace(
        whole,
        time=whole.time[rows],
        values={name: part[rows] for name, part in whole.values.items()},
        rounding={name: part[rows] for name, part in whole.rounding.items()},
    )


def _not_finite() -> Record:
    def plant(samples: dict[str, np.ndarray]) -> None:
        samples["velocity"][7, 2] = np.nan

    return record(change=plant)


@pytest.mark.parametrize(
    ("records", "part"),
    [
        ([], "no file was given"),
        ([_not_finite()], "1 values of velocity that are not finite or above 1e.100, the first at 3.5e-05 s, body 2"),
        ([_cut(slice(5, 6))], "has a single sample"),
        ([_cut(slice(0, 1))], "has no sample after 0 s"),
        ([record(), record(dt=5e-7, known=False)], "verlet-5e-07 has no time step, but another file has one"),
        ([record(quantities=())], "has no velocities, displacements or contact forces"),
    ],
    ids=["none", "nan", "single", "start", "step", "empty"],
)
def test_records_that_cannot_be_judged_are_refused_in_one_line(records: list[Record], part: str) -> None:
    with pytest.raises(UsageError, match=part) as refused:
        judge_records(CHAIN, records)
    assert "\n" not in str(refused.value)


def test_times_far_beyond_a_scene_that_stays_together_are_not_judged(diagnosis: list[Diagnosis]) -> None:
    walled, whole = replace(CHAIN, name="walled", wall_right=Wall(stiffness=4e9)), record()
    late = replace(whole, time=60.0 * whole.time)
    judgement = judge_records(walled, [late])
    assert judgement.recognised[0].endswith("27 samples after 0.004 s, 20 times the scene, are not judged.")
    with pytest.raises(UsageError, match=r"goes to 20 s.* allowed: samples up to 0\.004 s; give the unit of time"):
        judge_records(walled, [replace(whole, time=1e5 * whole.time)])
    assert judge_records(CHAIN, [replace(whole, time=1e5 * whole.time)]).error["velocity"]["value"] > 0.1


def test_of_a_large_file_some_samples_are_judged(diagnosis: list[Diagnosis], monkeypatch: pytest.MonkeyPatch) -> None:
    plant(monkeypatch, Seam.MOST_VALUES, 100)
    judgement = judge_records(CHAIN, [record()])
    assert judgement.recognised == ["verlet-1e-06: every third of 41 samples is judged."]
    assert len(judgement.files[0].record.time) == 14


@pytest.mark.parametrize("tolerance", [0.0, -1e-3, 1.0, float("nan"), True])
def test_a_tolerance_is_a_share(tolerance: float) -> None:
    with pytest.raises(UsageError, match="between 0 and 1"):
        judge_records(CHAIN, [record()], tolerance=tolerance)


def test_the_text_states_outcome_error_order_cause_and_advice(convergent: Judgement) -> None:
    text = dict(lines(convergent))
    assert text["outcome"] == "PASS: all errors are within the tolerance, 1 % of the largest value."
    assert " of the largest (0.8 m/s), body " in text["velocity"]
    assert "Second order" in text["order"]
    assert text["next"] == "Nothing is to be mended."
    beyond = "at most 5 µs for 1 %, 1.5 µs for 0.1 % (above 1 µs, the coarsest that was run)"
    largest = re.escape(f"{beyond}, 500 ns for 1e-4 (measured)")
    assert re.match(f"250 ns makes an error of .* of the largest velocity; {largest}", text["step"])


def test_errors_that_vanish_with_the_step_need_no_cause(diagnosis: list[Diagnosis]) -> None:
    diagnosis[0] = Diagnosis(cause="unknown", evidence="None fits.")
    judgement = judge_records(CHAIN, [record(dt=dt) for dt in STEPS])
    assert (judgement.outcome, judgement.cause) == ("PASS", "none")
    assert "at an order of 2.00 or more" in judgement.evidence
    # two files do not show it, nor do those of first order, nor a wrong stiffness, which remains
    assert judge_records(CHAIN, [record(dt=dt) for dt in STEPS[:2]]).cause == "unknown"
    assert judge_records(CHAIN, [record(dt=dt, method="leapfrog") for dt in STEPS]).cause == "unknown"
    wrong = replace(CHAIN, stiffness=(4e9, 5.001e9, 4.5e9, 6e9))
    assert judge_records(CHAIN, [record(wrong, dt=dt) for dt in STEPS]).cause == "unknown"


def test_half_steps_are_named_by_their_orders(diagnosis: list[Diagnosis]) -> None:
    judgement = judge_records(CHAIN, [record(dt=dt, method="leapfrog") for dt in STEPS], tolerance=1e-4)
    text = dict(lines(judgement))
    assert "velocities are stored half a time step away" in text["order"]
    # first order in velocity: the error of the finest step over the tolerance is the factor of the step
    assert "would reach the tolerance" in text["next"]


def test_every_cause_has_an_advice() -> None:
    assert set(TEXTS.data["advice"]) == {*CAUSES, "missed-wall"}


def test_the_page_has_the_answer_first_and_the_json_of_the_contract(convergent: Judgement, tmp_path: Path) -> None:
    convergent.save(tmp_path)
    page = (tmp_path / "index.html").read_text(encoding="utf-8")
    assert page.index("PASS: all errors") < page.index("<svg")
    assert "http" not in page.replace("http://www.w3.org", "")
    data = json.loads((tmp_path / "verdicts.json").read_text(encoding="utf-8"))
    assert {key: data[key] for key in KEYS} == convergent.as_json()
    assert data["schema"] == "dem-bridge/verdicts/1"
    assert [verdict["outcome"] for verdict in data["verdicts"]] == ["PASS"] * 3
    assert (tmp_path / "tables" / "errors.csv").is_file()


@pytest.mark.slow
def test_a_contact_is_named_where_a_small_difference_grows_in_many_collisions(tmp_path: Path) -> None:
    scene = db.load_scene("decelerating-40")
    stiffness = list(scene.stiffness)
    stiffness[17] *= 1.05
    wrong = replace(scene, stiffness=tuple(stiffness))
    run = db.solve(wrong, backend="verlet", dt=2e-8, uncertainty=False)
    db.write_trajectory(run, wrong, tmp_path / "wrong.csv", layout="wide")
    judgement = db.judge((tmp_path / "wrong.csv", 2e-8), scene)
    assert (judgement.cause, judgement.where, judgement.outcome) == ("stiffness", "contact 17", "FAIL")


def test_samples_where_the_reference_is_uncertain_are_not_called_right(tmp_path: Path) -> None:
    # four bodies between two walls: each collision multiplies a difference, after 15 durations by more than 1e13
    wall = Wall(stiffness=4e9, gap=2e-6)
    masses = (8e-3, 1.1e-2, 1.4e-2, 8e-3)
    box = db.Scene(
        name="box", duration=2e-3, mass=masses, stiffness=(4e9,) * 3, gap=(2e-6,) * 3, velocity=(0.8, 0.0, 0.0, 0.0),
        wall_left=wall, wall_right=wall, samples=40,
    )  # fmt: skip
    judgements = {}
    for multiple in (1, 15):
        scene = replace(box, duration=multiple * box.duration, samples=multiple * box.samples)
        run = db.solve(scene, backend="verlet", dt=1e-7, uncertainty=False)
        path = tmp_path / f"{multiple}.csv"
        db.write_trajectory(run, scene, path, layout="wide")
        judgements[multiple] = db.judge((path, 1e-7), box)
    assert (judgements[1].outcome, judgements[1].cause) == ("PASS", "none")
    assert (judgements[15].outcome, judgements[15].cause) == ("UNDECIDED", "unknown")
    assert "The reference is uncertain by" in judgements[15].evidence


@pytest.mark.parametrize(("rounding", "outcome"), [(0.014, "PASS"), (0.018, "UNDECIDED"), (1.0, "UNDECIDED")])
def test_digits_that_leave_a_percent_open_pass_nothing(rounding: float, outcome: str) -> None:
    judged = judge_records(CHAIN, [record(dt=1.25e-7, rounding=rounding, quantities=("velocity",))])
    assert judged.outcome == outcome
    if outcome == "UNDECIDED":
        words = dict(lines(judged))
        assert words["outcome"].startswith("UNDECIDED: digits and reference explain all values")
        assert "divergence" not in words
        assert re.search(r"The digits of the file leave [\d.]+ % of the largest value open", words["cause"])
        assert words["next"] == "A file with more digits (17) and with earlier samples shows smaller errors."
