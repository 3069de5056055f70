"""Judgements that are put together by hand: their sentences, tables, figures, verdicts and outcomes, in full."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from dem_bridge.errors import UsageError
from dem_bridge.formats.readers import Record
from dem_bridge.judging import sentences
from dem_bridge.judging.diagnosis import Diagnosis
from dem_bridge.judging.judgement import Addition, Judgement
from dem_bridge.judging.order import Convergence, Order
from dem_bridge.judging.records import every_nth, judge_records
from dem_bridge.judging.reference import FileErrors, QuantityErrors
from dem_bridge.scene.drive import Drive
from dem_bridge.scene.scene import Adhesion, Scene, Wall
from tests.helpers.judged_records import CHAIN, record
from tests.helpers.seams import Seam, plant

NAN = math.nan


def part(
    error: Any,
    *,
    name: str = "velocity",
    scale: float = 2.0,
    explained: float = 1e-9,
    columns: tuple[int, ...] = (3, 1),
    reference: float = 1e-10,
) -> QuantityErrors:
    values = np.array(error, dtype=float)
    return QuantityErrors(
        quantity=name, scale=scale, error=values, explained=np.full(values.shape, explained), columns=columns,
        reference_uncertainty=reference,
    )  # fmt: skip


ERROR = [[0.0, 0.0], [2e-4, -5e-4], [1e-4, 4e-4]]


def file_of(*parts: QuantityErrors, name: str = "run.csv", dt: float | None = 1e-6, end: float = 2e-4) -> FileErrors:
    rows = len(parts[0].error)
    fake: Any = SimpleNamespace(name=name, dt=dt, time=np.linspace(0.0, end, rows), recognised=(f"Assumed in {name}.",))
    return FileErrors(record=fake, quantities={each.quantity: each for each in parts})


def judgement_of(*files: FileErrors, cause: str = "none", tolerance: float | None = None, **fields: Any) -> Judgement:
    chosen = files or (file_of(part(ERROR)),)
    diagnosis = fields.pop("diagnosis", Diagnosis(cause=cause, evidence="Because."))
    return Judgement(
        scene=CHAIN, files=chosen, convergence=fields.pop("convergence", ()), diagnosis=diagnosis, tolerance=tolerance,
        **fields,
    )  # fmt: skip


def falling(
    name: str = "velocity", value: float = 2.0, uncertainty: float = 0.001, *, flat: float = NAN
) -> Convergence:
    order = Order(value=value, uncertainty=uncertainty, steps=(4e-6, 2e-6, 1e-6))
    return Convergence(
        quantity=name, dt=(1e-6, 2e-6, 4e-6), errors=(1e-4, 4e-4, 1.6e-3), explained=(0.0,) * 3, order=order, flat=flat
    )


# ---------------------------------------------------------------- sentences
def test_the_lines_of_one_file_are_these() -> None:
    assert dict(sentences.lines(judgement_of())) == {
        "outcome": "PASS: time step and digits explain all errors.",
        "next": "Nothing is to be mended.",
        "step": "1 µs resolves no contact",
        "velocity": "5.0e-04 m/s, 2.5e-4 of the largest (2 m/s), body 1 at 100 µs",
        "cause": "Because.",
        "unseen": "One factor on all masses and stiffnesses changes no velocity; contact forces would show it.",
        "floor": "5e-10 of the largest velocity: smaller errors cannot be seen in this file",
    }
    still = part(0.0 * np.array(ERROR), scale=0.0, name="contact_force", columns=(1, 0))
    lines = dict(sentences.lines(judgement_of(file_of(still), cause="unknown")))
    assert lines["contact force"] == "0.0e+00 N +- 1e-09 N; the reference is 0 at all times"
    assert "divergence" not in lines
    assert lines["outcome"].startswith("UNDECIDED: digits and reference explain all values, and leave too much open")
    assert lines["next"] == "A file with more digits (17) and with earlier samples shows smaller errors."
    lines = dict(sentences.lines(judgement_of(cause="unknown")))
    assert lines["outcome"].startswith("UNDECIDED: the errors are larger than time step and digits explain")
    # one file without a cause: a second one helps
    assert lines["next"].endswith("tells errors of the integrator from others.")
    force = part([[0.0, 0.0], [0.0, 3.0]], name="contact_force", columns=(2, 1))
    added = judgement_of(file_of(force), cause="unknown", addition=Addition(lines=(("cost", "much"),)))
    lines = dict(sentences.lines(added))
    assert lines["divergence"].startswith("contact force of contact 1 at 200 µs (")
    assert list(lines)[-1] == "cost"


def test_the_lines_of_two_files_name_the_judged_one_and_the_order() -> None:
    files = file_of(part(ERROR), name="fine.csv"), file_of(part(ERROR), name="coarse.csv", dt=2e-6)
    diagnosis = Diagnosis(cause="mass", evidence="Heavy.", where="body 2", alternatives=("modulus", "stiffness"))
    lines = dict(sentences.lines(judgement_of(*files, diagnosis=diagnosis)))
    assert lines["velocity"].endswith("body 1 at 100 µs")
    assert lines["order"].startswith("Fewer than two files have errors above the floor")
    assert lines["alternatives"] == "or: modulus; or: stiffness"
    assert lines["outcome"] == "FAIL: mass of body 2. Heavy."
    assert "cause" not in lines
    failing, within = (
        dict(sentences.lines(judgement_of(*files, diagnosis=diagnosis, tolerance=limit))) for limit in (1e-4, 1e-2)
    )
    assert failing["outcome"].endswith("exceeds the tolerance of 1e-4. Cause: mass of body 2. Heavy.")
    assert within["cause"] == "mass (body 2). Heavy."
    unknown = dict(sentences.lines(judgement_of(*files, cause="unknown")))
    assert "second file" not in unknown["next"]
    both = (falling(), falling("displacement", 1.98, 0.03))
    lines = dict(sentences.lines(judgement_of(*files, convergence=both)))
    assert lines["order"] == (
        "velocity 2.00 +- 0.005, displacement 1.98 +- 0.03 (dt = 4 µs to 1 µs)."
        " Second order, as expected of velocity-Verlet and leapfrog."
    )
    undated = judgement_of(file_of(part(ERROR), dt=None), file_of(part(0.0 * np.array(ERROR)), name="b", dt=None))
    assert dict(sentences.lines(undated))["velocity"].endswith("body 1 at 100 µs; run.csv")


def test_times_have_four_digits() -> None:
    lines = dict(sentences.lines(judgement_of(file_of(part(ERROR), end=2.46913e-4), cause="unknown")))
    assert lines["velocity"].endswith(", body 1 at 123.5 µs")
    assert lines["divergence"].startswith("velocity of body 1 at 123.5 µs (")


@pytest.mark.parametrize(
    ("names", "text"), [("a", "a"), ("ab", "a and b"), ("abc", "a and 2 more files"), ("abcd", "a and 3 more files")]
)
def test_many_files_are_counted(names: str, text: str) -> None:
    files = [file_of(part(ERROR), name=name, dt=1e-6 * (k + 1)) for k, name in enumerate(names)]
    study: Any = judgement_of(*files).study
    assert study.title == f"Judgement of {text} for the scene five"


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.99e-3, "9.9e-04"), (1e-3, "0.001"), (1.5e-3, "0.0015"), (99.4, "99"), (99.5, "1.0e+02"), (150.0, "1.5e+02")],
)
def test_numbers_of_ordinary_size_have_no_power_of_ten(value: float, text: str) -> None:
    lines = dict(sentences.lines(judgement_of(file_of(part([[0.0, 0.0], [0.0, value]])))))
    assert lines["velocity"].startswith(f"{text} m/s, ")


def test_a_tolerance_is_compared_in_a_sentence() -> None:
    files = file_of(part(ERROR), part([[0.0, 0.0], [3e-4, 0.0]], name="displacement", scale=1.0, explained=1e-4))
    for tolerance, text in (
        (1e-3, "PASS: all errors are within the tolerance, 0.1 % of the largest value."),
        (1e-4, "FAIL: the error of displacement, 3e-4 of the largest, exceeds the tolerance of 1e-4."),
        (2.4e-4, "FAIL: the error of velocity, 2.5e-4 of the largest, exceeds the tolerance of 2.4e-4."),
        (2.6e-4, "UNDECIDED: the uncertainty of the error of displacement, 1e-4 of the largest, does not allow a"
         " decision about the tolerance of 2.6e-4."),
    ):  # fmt: skip
        assert dict(sentences.lines(judgement_of(files, tolerance=tolerance)))["outcome"] == text
    # in another unit of time nothing passes
    assert judgement_of(files, tolerance=1e-3, time_unit=1e-3).outcome == "FAIL"
    assert judgement_of(files, time_unit=1e-3).outcomes == {}


@pytest.mark.parametrize(
    ("velocity", "displacement", "uncertainty", "meaning"),
    [
        (1.14, 1.86, 0.0, "half_step"),
        (1.16, 1.84, 0.0, "other"),
        (1.16, 1.84, 0.2, "half_step"),
        (1.0, 1.0, 0.0, "first"),
        (0.1, -0.1, 0.0, "constant"),
        (2.1, 1.9, 0.0, "second"),
        (2.3, 2.2, 0.0, "high"),
        (2.3, 1.9, 0.0, "other"),
        (2.3, 2.0, 0.0, "other"),
        (-0.2, -0.3, 0.0, "growing"),
        (-0.2, 0.0, 0.0, "other"),
        (1.0, 0.0, 0.0, "other"),
        (0.75, 1.75, 0.25, "half_step"),
        (0.5, 0.5, 0.5, "constant"),
    ],
)
def test_a_meaning_of_orders_needs_all_of_them(
    velocity: float, displacement: float, uncertainty: float, meaning: str
) -> None:
    values = {"velocity": velocity, "displacement": displacement}
    both = tuple(falling(name, value, uncertainty) for name, value in values.items())
    files = file_of(part(ERROR)), file_of(part(ERROR), dt=2e-6)
    assert dict(sentences.lines(judgement_of(*files, convergence=both)))["order"].endswith(
        f". {sentences.TEXTS(meaning)}"
    )


def test_displacements_alone_have_an_order_of_their_own() -> None:
    # without velocities nothing tells a method of second order from one with velocities of half steps
    files = [file_of(part(ERROR, name="displacement"), dt=dt) for dt in (1e-6, 2e-6)]
    lines = dict(sentences.lines(judgement_of(*files, convergence=(falling("displacement"),))))
    assert lines["order"].endswith(f". {sentences.TEXTS('second')}")


def test_a_floor_is_that_of_digits_or_of_errors_that_stay() -> None:
    flat = judgement_of(convergence=(falling("displacement", flat=9.0), falling(flat=4e-6)))
    assert flat.floor == pytest.approx(2e-6)
    assert dict(sentences.lines(flat))["floor"].startswith(
        "2e-6 of the largest velocity: below it the errors do not fall"
    )
    for convergence in ((falling(flat=1e-10),), (falling(flat=1e-9),), (falling(),)):
        low = judgement_of(convergence=convergence)
        assert low.floor == pytest.approx(5e-10)
        assert dict(sentences.lines(low))["floor"].startswith(
            "5e-10 of the largest velocity: smaller errors cannot be seen"
        )
    still = judgement_of(file_of(part(ERROR, scale=0.0)))
    assert still.floor is None
    assert dict(sentences.lines(still))["floor"].startswith("unknown of the largest velocity: smaller")


def test_a_step_that_would_reach_the_tolerance_follows_from_the_order() -> None:
    def advice(
        *parts: Convergence, tolerance: float | None = 1e-5, cause: str = "none", dt: float | None = 1e-6
    ) -> str:
        other = part([[0.0, 0.0], [1.6e-3, 0.0]], name="displacement")
        file = file_of(part(ERROR), other, dt=dt)
        return dict(sentences.lines(judgement_of(file, convergence=parts, tolerance=tolerance, cause=cause)))["next"]

    # the errors are 25 and 80 times the tolerance
    reduce = "Reduce the time step, which causes the errors."
    assert advice(falling()) == f"{reduce} At the observed order a time step of 200 ns would reach the tolerance."
    both = advice(falling(value=1.0), falling("displacement"))
    assert both.endswith("a time step of 40 ns would reach the tolerance.")
    assert advice(falling(value=2.0), falling("displacement", 1.1)).endswith(
        "a time step of 19 ns would reach the tolerance."
    )
    assert advice(falling(value=0.5)) == advice(falling(), dt=None) == reduce
    assert "a time step of 4.7 ns" in advice(falling(value=0.6))
    assert advice() == reduce
    # what is within the tolerance is not made smaller
    step = advice(falling(value=2.0), falling("displacement", 2.0), tolerance=5e-4)
    assert step.endswith("a time step of 790 ns would reach the tolerance.")
    within = file_of(part([[0.0], [1e-5]], columns=(0,)), part(ERROR, name="displacement"), dt=1e-6)
    lines = dict(sentences.lines(judgement_of(within, convergence=(falling(),), tolerance=1e-4)))
    assert lines["next"].endswith("a time step of 1 µs would reach the tolerance.")
    nothing = "Nothing is to be mended."
    assert advice(falling(), tolerance=0.5) == advice(falling(), tolerance=None) == nothing
    assert advice(tolerance=1e-5, cause="gravity") == "Compare gravity and its sign with the scene."


# ---------------------------------------------------------------- tables, verdicts and figures
def test_tables_and_verdicts_have_the_numbers_of_the_files() -> None:
    fine = file_of(part(ERROR), name="fine.csv")
    both = part(ERROR), part(ERROR, name="displacement")
    files = file_of(*both, name="fine.csv"), file_of(*both, name="coarse.csv", dt=None)
    judgement = judgement_of(*files, convergence=(falling(), replace(falling("displacement"), order=None)))
    errors, orders, _ = judgement.study.tables
    first, _, second, _ = errors.rows
    assert len(errors.columns) == len(first)
    assert first == (
        *("fine.csv", 1e-6, "velocity", 5e-4, pytest.approx(1e-9, rel=1e-6), 2.0, "m/s", 2.5e-4, "body 1", 1e-4),
    )
    assert (second[0], math.isnan(float(second[1]))) == ("coarse.csv", True)
    assert orders.rows == (("velocity", 2.0, 0.001, 4e-6, 1e-6),)
    (verdict,) = judgement_of(fine, tolerance=1e-4, cause="mass").study.verdicts
    assert verdict.as_json() == {
        "scene": "five", "quantity": "velocity", "backend": "file", "reference": "reference", "outcome": "FAIL",
        "sentence": "The velocities of fine.csv differ from the reference by 5.0e-04 m/s, 2.5e-4 of the largest, +-"
        " 1e-09 m/s.",
        "difference": 2.5e-4, "scale": 2.0, "unit": "m/s", "scale_name": "largest magnitude of the reference",
        "uncertainty": pytest.approx(5e-10, rel=1e-6), "reference_uncertainty": 5e-11, "tolerance": 1e-4,
        "first_divergence": (1e-4, 1), "meaning": "mass",
    }  # fmt: skip
    (verdict,) = judgement_of(file_of(part(0.0 * np.array(ERROR))), cause="unknown").study.verdicts
    assert (verdict.first_divergence, verdict.outcome, math.isnan(verdict.tolerance)) == (None, "UNDECIDED", True)


def test_a_page_has_its_tables_and_what_was_added() -> None:
    table = judgement_of().study.tables[0]
    added = Addition(tables=(replace(table, id="added"),), notes=("Added.",))
    study: Any = judgement_of(convergence=(falling(),), addition=added, assumed=("Also.",)).study
    assert [each.id for each in study.tables] == ["errors", "orders", "recognised", "added"]
    assert study.tables[2].rows == (("run.csv: Assumed in run.csv.",), ("Also.",))
    assert (study.title, study.id) == ("Judgement of run.csv for the scene five", "judge")
    assert study.answer[0].startswith("PASS: time step and digits")
    assert study.answer[1] == "Nothing is to be mended."
    assert sum("Because." in sentence for sentence in study.answer) == 1  # the cause is said once
    assert study.answer[3].startswith("Velocity: 5.0e-04 m/s")
    assert study.notes[-1] == "Added."
    assert "(Taylor series)" in study.notes[0]
    assert (study.record_name, study.exit_code) == ("verdicts.json", 0)
    document = study.as_json()
    assert (document["schema"], document["claims"], document["cause"]) == ("dem-bridge/verdicts/1", [], "none")
    assert document["provenance"]["files"] == ["run.csv"]
    assert len(document["verdicts"]) == 1
    plain = judgement_of()
    assert [each.id for each in plain.study.tables] == ["errors", "recognised"]
    bare: Any = SimpleNamespace(**vars(plain.files[0].record) | {"recognised": ()})
    nothing = judgement_of(replace(plain.files[0], record=bare))
    assert [each.id for each in nothing.study.tables] == ["errors"]


def test_the_figure_shows_the_error_against_time_and_body() -> None:
    figure = judgement_of().study.figures[0]
    assert [panel.title for panel in figure.panels] == ["Error in run.csv", "Largest error against time"]
    data: Any = figure.panels[0].map
    # columns in the order of the bodies, times in microseconds
    assert (data.x.tolist(), data.y.tolist()) == ([1.0, 3.0], pytest.approx([0.0, 100.0, 200.0]))
    assert data.values.tolist() == [[0.0, 0.0], [-5e-4, 2e-4], [4e-4, 1e-4]]
    assert (data.label, data.diverging) == ("error of velocity (m/s)", True)
    assert (figure.panels[0].x_label, figure.panels[0].y_label) == ("body", "time (µs)")
    line, guide = figure.panels[1].series
    assert (line.label, line.style, line.x.tolist()) == (
        "run.csv (dt = 1 µs)",
        "line/0/0",
        pytest.approx([100.0, 200.0]),
    )
    assert line.y.tolist() == [2.5e-4, 2e-4]
    assert (guide.label, guide.style) == ("explained by digits", "guide")
    assert guide.y.tolist() == [5e-10] * 3
    assert "against time and body. Right" in figure.caption
    assert "over all bodies against time, relative to the largest velocity; dashed" in figure.caption
    assert figure.caption.endswith("explain.")
    force = part([[0.0], [1.0]], columns=(2,), name="contact_force", scale=0.0)
    (single,) = judgement_of(file_of(force, end=2e-3)).study.figures
    (panel,) = single.panels
    assert panel.x_label == "time (ms)"
    assert (panel.series[0].x.tolist(), panel.series[0].y.tolist()) == ([2.0], [1.0])
    assert panel.series[1].y.tolist() == [1e-9, 1e-9]
    assert "all contacts against time" in single.caption
    assert judgement_of(file_of(part(ERROR), end=1e-3)).study.figures[0].panels[1].x_label == "time (µs)"
    # nothing is explained: there is no line on logarithmic axes
    exact = judgement_of(file_of(part(ERROR, explained=0.0))).study.figures[0]
    assert [series.label for series in exact.panels[1].series] == ["run.csv (dt = 1 µs)"]


def test_a_long_map_is_thinned_and_five_files_have_lines() -> None:
    for rows, every in ((300, 1), (301, 2), (600, 2), (601, 3)):
        figure = judgement_of(file_of(part(np.ones((rows, 2))))).study.figures[0]
        data: Any = figure.panels[0].map
        assert len(data.y) == len(data.values) == -(-rows // every)
        assert len(figure.panels[1].series[0].x) == rows
        text = f" ({every_nth(every)} sample is drawn)"
        assert (text in figure.caption) is (every > 1)
        assert ("is drawn" in figure.caption) is (every > 1)
    files = [file_of(part(ERROR), name=f"f{k}", dt=1e-6 * (k + 1)) for k in range(6)]
    files[1] = file_of(part(ERROR, name="displacement"), name="f1", dt=2e-6)
    lines = judgement_of(*files).study.figures[0].panels[1].series
    assert [(line.label[:2], line.style) for line in lines[:-1]] == [
        (f"f{k}", f"line/{n}/{n}") for n, k in enumerate((0, 2, 3, 4, 5))
    ]


def test_errors_are_drawn_against_the_step_with_the_observed_order() -> None:
    forces = Convergence(
        quantity="displacement", dt=(1e-6, 2e-6), errors=(0.0, 5e-3), explained=(0.0, 0.0), order=None, flat=NAN
    )
    parts = part(ERROR), part(ERROR, name="displacement", scale=0.0)
    figure = judgement_of(file_of(*parts), convergence=(falling(value=1.5), forces)).study.figures[0]
    assert figure.caption.endswith(" Last: root mean square error of each quantity against the time step.")
    first, guide, second = figure.panels[2].series
    assert (first.label, first.style, first.x.tolist()) == ("velocity", "mark-1", [1e-6, 2e-6, 4e-6])
    assert first.y.tolist() == pytest.approx([5e-5, 2e-4, 8e-4])
    assert (guide.label, guide.x.tolist()) == ("observed order", [4e-6, 1e-6])
    assert guide.y.tolist() == pytest.approx([8e-4, 1e-4])
    assert (second.style, second.x.tolist(), second.y.tolist()) == ("mark-2", [2e-6], [5e-3])
    # one error is no line
    assert len(judgement_of(file_of(*parts), convergence=(forces,)).study.figures[0].panels) == 2


# ---------------------------------------------------------------- errors and outcomes
def test_the_worst_error_has_a_place_and_an_uncertainty() -> None:
    errors = replace(part(ERROR), explained=np.array([[1e-3, 0.0], [0.0, 2e-4], [0.0, 5e-4]]))
    assert (errors.value, errors.worst, errors.place, errors.unit, errors.floor) == (
        5e-4,
        (1, 1),
        "body 1",
        "m/s",
        1e-3,
    )
    # another error may be 1e-3, and the largest one no less than 3e-4
    assert errors.uncertainty == pytest.approx(5e-4)
    assert replace(errors, explained=np.full((3, 2), 4e-4)).uncertainty == pytest.approx(4e-4)
    assert (errors.relative(1.0), replace(errors, scale=0.0).relative(1.0)) == (0.5, math.inf)
    assert part([[0.0, 1.0]], name="contact_force").place == "contact 1"


def test_the_first_divergence_is_the_earliest_and_there_the_largest() -> None:
    late = part([[0.0, 0.0], [0.0, 0.0], [9.0, 9.0]], name="displacement")
    assert file_of(late, part(ERROR)).first_divergence(CHAIN) == {"time": 1e-4, "body": 1, "quantity": "velocity"}
    assert file_of(part(ERROR), late).first_divergence(CHAIN) == {"time": 1e-4, "body": 1, "quantity": "velocity"}
    # at one time the larger one relative to its scale; 1 replaces a scale of 0
    for scale, quantity in ((0.9, "displacement"), (1.1, "velocity"), (0.0, "velocity")):
        other = part([[0.0, 0.0], [2.4e-4, 0.0], [0.0, 0.0]], name="displacement", scale=scale)
        first = file_of(part(ERROR), other).first_divergence(CHAIN)
        assert first is not None
        assert first["quantity"] == quantity
        assert first["body"] == (3 if quantity == "displacement" else 1)
    assert file_of(part(ERROR, explained=5e-4)).first_divergence(CHAIN) is None
    walled = replace(CHAIN, wall_left=Wall(stiffness=1e9), wall_right=Wall(stiffness=1e9))
    for column, body in ((2, 2), (3, 3), (4, 0), (5, 4)):
        force = part([[0.0], [1.0]], name="contact_force", columns=(column,))
        expected = {"time": 2e-4, "body": body, "quantity": "contact_force", "contact": column}
        assert file_of(force).first_divergence(walled) == expected


def test_the_finest_file_is_judged_or_all_without_a_step() -> None:
    small, large = part(ERROR), part(2.0 * np.array(ERROR))
    fine, coarse = file_of(small, name="fine"), file_of(large, name="coarse", dt=2e-6)
    assert judgement_of(coarse, fine).judged == (fine,)
    unknown = file_of(large, part(ERROR, name="displacement"), name="unknown", dt=None)
    assert judgement_of(unknown, fine).judged == (fine,)
    both = judgement_of(file_of(small, dt=None), unknown)
    assert len(both.judged) == 2
    assert [*both.worst] == ["velocity", "displacement"]
    assert both.worst["velocity"][0] is unknown
    assert both.error["velocity"]["value"] == 1e-3
    early = file_of(part([[0.0, 1.0]] * 3), dt=None)
    first = judgement_of(file_of(small, dt=None), early).first_divergence
    assert first is not None
    assert first["time"] == 0.0
    assert judgement_of(file_of(part(0.0 * np.array(ERROR)))).first_divergence is None
    orders = judgement_of(convergence=(falling(), replace(falling("displacement"), order=None))).order
    assert orders == {"velocity": {"value": 2.0, "uncertainty": 0.001}}
    assert judgement_of().as_json()["error"]["velocity"]["scale"] == 2.0
    infinite = judgement_of(file_of(part(ERROR, explained=math.inf, scale=0.0)))
    with np.errstate(all="ignore"):
        assert infinite.as_json()["error"]["velocity"]["uncertainty"] is None
    assert len(judgement_of()) == 14


# ---------------------------------------------------------------- from records to a judgement
def plain(time: Any, *, dt: float | None = None, digits: float = 0.0, columns: int = 1) -> Record:
    times = np.array(time, dtype=float)
    values = np.tile(np.arange(float(len(times)))[:, None], columns)
    return Record(
        name="f", time=times, values={"velocity": values}, columns={"velocity": tuple(range(columns))}, dt=dt,
        rounding={"time": np.full(len(times), digits), "velocity": 0.0 * values},
    )  # fmt: skip


def errors_of(scene: Any, records: Any) -> tuple[FileErrors, ...]:
    """Return errors of files without a reference."""
    return tuple(
        FileErrors(record=each, quantities={"velocity": part(np.ones((len(each.time), 2)))}) for each in records
    )


@pytest.fixture
def diagnosis(monkeypatch: pytest.MonkeyPatch) -> list[Diagnosis]:
    """Return a list whose only entry is the answer of all fits; errors are those of :func:`errors_of`."""
    answers = [Diagnosis(cause="mass", evidence="Heavy.")]
    plant(monkeypatch, Seam.FILE_ERRORS, errors_of)
    plant(monkeypatch, Seam.DIAGNOSE, lambda scene, records, floor: answers[0])
    return answers


def usable(file: Record, scene: Scene = CHAIN) -> tuple[Record, list[str]]:
    """Return the samples of a file that are judged, and what is said of the others."""
    judgement = judge_records(scene, [file])
    return judgement.files[0].record, [text for text in judgement.assumed if not text.startswith("The scene ends at")]


def test_a_reference_that_is_uncertain_by_a_percent_hides_errors(
    monkeypatch: pytest.MonkeyPatch, diagnosis: list[Diagnosis]
) -> None:
    none = diagnosis[0] = Diagnosis(cause="none", evidence="Fine.")

    def diagnosed(*files: FileErrors) -> Diagnosis:
        plant(monkeypatch, Seam.FILE_ERRORS, lambda scene, records: files)
        return judge_records(CHAIN, [plain([0.0, 1e-6])]).diagnosis

    for share, uncertain in ((0.009, False), (0.01, False), (0.015, True)):
        answer = diagnosed(file_of(part(ERROR, reference=2.0 * share)))
        assert (answer is not none) is uncertain
        if uncertain:
            assert answer.evidence == (
                "The reference is uncertain by 1.5 % of the largest velocity at these times, so that errors of the file"
                " cannot be seen; give earlier samples."
            )
            assert answer.cause == "unknown"
    force = file_of(part(ERROR, name="contact_force", reference=1.0))
    assert diagnosed(force) is none
    # a percent that digits leave open of every quantity hides errors, too; a quantity without a scale does not count
    for share, uncertain in ((0.009, False), (0.01, False), (0.015, True)):
        rough = part(10.0 * np.array(ERROR), explained=2.0 * share)
        for parts, hidden in (
            ([rough], uncertain),
            ([rough, part(ERROR, name="displacement", scale=0.0)], uncertain),
            ([rough, part(ERROR, name="displacement")], False),
        ):
            answer = diagnosed(file_of(*parts))
            assert (answer.cause == "unknown") is hidden
            if hidden:
                assert answer.evidence == (
                    "The digits of the file leave 1.5 % of the largest value open, so that errors cannot be seen; write"
                    " more digits."
                )
    assert diagnosed(file_of(part(ERROR, scale=0.0))) is none
    # what is explained is not fitted
    explained, diagnosis[0] = file_of(part(0.0 * np.array(ERROR)), dt=None), Diagnosis(cause="mass", evidence="Never.")
    assert diagnosed(explained) == Diagnosis(cause="none", evidence="Digits and reference explain all values.")
    assert diagnosed(explained, force) is diagnosis[0]


def test_errors_that_vanish_with_the_step_are_those_of_the_step(
    monkeypatch: pytest.MonkeyPatch, diagnosis: list[Diagnosis]
) -> None:
    def diagnosed(*convergence: Convergence) -> Diagnosis:
        plant(monkeypatch, Seam.CONVERGENCE, lambda files: convergence)
        return judge_records(CHAIN, [plain([0.0, 1e-6])]).diagnosis

    for cause in ("unknown", "mass"):
        answer = diagnosis[0] = Diagnosis(cause=cause, evidence="?")
        assert diagnosed() is answer
        both = diagnosed(falling(value=2.2), falling("displacement", 2.1))
        assert both.cause == ("none" if cause == "unknown" else cause)
        if cause == "unknown":
            assert "fall with the time step at an order of 2.10 or more, as those of an" in both.evidence
        # all quantities must vanish
        assert diagnosed(falling(), falling("displacement", 1.0)) is answer


D = CHAIN.duration


@pytest.mark.parametrize(
    ("time", "digits", "kept", "note"),
    [
        ([-2e-6, -1e-6, 0.0, 1e-6], 0.0, [2, 3], "f: 2 samples before the start of the scene, 0 s, are not judged."),
        (
            [-2e-6, -1e-6, 0.0, 1e-6],
            1e-6,
            [1, 2, 3],
            "f: 1 samples before the start of the scene, 0 s, are not judged.",
        ),
        ([0.0, 1e-6], 0.0, [0, 1], ""),
        ([1e-6, 2e-6], 0.0, [0, 1], ""),
    ],
)
@pytest.mark.usefixtures("diagnosis")
def test_samples_before_the_start_are_not_judged(time: list[float], digits: float, kept: list[int], note: str) -> None:
    judged, notes = usable(plain(time, digits=digits))
    assert (judged.values["velocity"][:, 0].tolist(), notes) == (kept, [note] if note else [])
    assert len(judged.rounding["velocity"]) == len(kept) == len(judged.time)


@pytest.mark.parametrize(
    "changes",
    [
        {"wall_left": Wall(stiffness=1e9)},
        {"wall_right": Wall(stiffness=1e9)},
        {"drive": Drive(shape="sine", force=0.5, frequency=1000.0)},
        {"adhesion": Adhesion(law="dmt", pull_off=0.1), "gap": (1e-6,) * 4},
        {"precompression": 0.5},
    ],
)
@pytest.mark.usefixtures("diagnosis")
def test_samples_after_twenty_durations_of_a_scene_that_stays_together_are_not_judged(changes: dict[str, Any]) -> None:
    together, late = replace(CHAIN, **changes), plain([0.0, D, 20.0 * D, 20.1 * D, 21.0 * D])
    judged, notes = usable(late, together)
    assert judged.values["velocity"][:, 0].tolist() == [0.0, 1.0, 2.0]
    assert notes == ["f: 2 samples after 0.004 s, 20 times the scene, are not judged."]
    assert len(usable(plain([0.0, D, 21.0 * D]), together)[0].time) == 2
    with pytest.raises(UsageError) as refused:
        judge_records(together, [plain([0.0, 21.0 * D, 99.0 * D])])
    assert str(refused.value) == (
        "f goes to 0.0198 s, and the scene to 0.0002 s; allowed: samples up to 0.004 s; give the unit of time (--units"
        " time=ms), or a scene of this duration"
    )
    # a chain that parts is followed
    assert len(usable(late)[0].time) == 5


@pytest.mark.parametrize(
    ("dt", "noted"), [(1.02e-6, True), (1.005e-6, False), (0.5e-6, False), (None, False), (1e-3, True)]
)
@pytest.mark.usefixtures("diagnosis")
def test_a_step_longer_than_the_largest_interval_is_noted(dt: float | None, noted: bool) -> None:
    _, notes = usable(plain([0.0, 1e-7, 1.1e-6, 1.2e-6], dt=dt))
    assert bool(notes) is noted
    if noted:
        assert notes == [f"f: the step, {dt:.6g} s, is longer than the sampling, 1e-06 s."]


@pytest.mark.parametrize(("most", "every"), [(20, 1), (19, 2), (10, 2), (9, 3)])
@pytest.mark.usefixtures("diagnosis")
def test_large_files_are_thinned(monkeypatch: pytest.MonkeyPatch, most: int, every: int) -> None:
    plant(monkeypatch, Seam.MOST_VALUES, most)
    judged, notes = usable(plain(1e-6 * np.arange(10.0), columns=2))
    assert judged.values["velocity"][:, 0].tolist() == list(range(0, 10, every))
    assert notes == ([f"f: {every_nth(every)} of 10 samples is judged."] if every > 1 else [])


@pytest.mark.usefixtures("diagnosis")
def test_values_that_are_no_motion_are_refused() -> None:
    file = plain([0.0, 1e-6, 2e-6], columns=3)
    for value, wrong in ((np.nan, True), (-np.inf, True), (1e100, True), (0.9e100, False), (-1.5e100, True)):
        values = file.values["velocity"].copy()
        values[1, 2] = values[2, 0] = value
        bad = replace(file, values={"velocity": values}, columns={"velocity": (4, 2, 0)})
        if not wrong:
            usable(bad)
            continue
        with pytest.raises(UsageError) as refused:
            usable(bad)
        assert str(refused.value) == (
            "f has 2 values of velocity that are not finite or above 1e+100, the first at 1e-06 s, body 0; remove these"
            " samples, or run the code again with a smaller time step"
        )
    forces = replace(plain([0.0, 1e-6]), values={"contact_force": np.full((2, 1), np.nan)},
                     columns={"contact_force": (3,)}, rounding={"time": np.zeros(2)})  # fmt: skip
    with pytest.raises(UsageError, match=r"2 values of contact force .*, contact 3;"):
        usable(forces)
    nothing = replace(plain([0.0, 1e-6]), values={}, columns={})
    for unusable, problem in (
        *((plain(time), text) for time, text in (([0.0], "no sample after 0 s"), ([1e-6], "has a single sample"))),
        *((empty, "no velocities, displacements or contact forces") for empty in (plain([]), nothing)),
    ):
        with pytest.raises(UsageError, match=problem):
            usable(unusable)
    # a quantity without columns beside another one
    file = plain([1e-6, 2e-6])
    more = {**file.values, "displacement": np.zeros((2, 0))}
    assert usable(replace(file, values=more))[1] == []


@pytest.mark.parametrize(
    ("end", "unit"),
    [
        (19.9, 1.0), (20.0, 1.0), (299.0, 1.0), (301.0, 1e-3), (2999.0, 1e-3), (3001.0, 1.0), (0.5e6, 1e-6),
        (1e9, 1e-9), (math.inf, 1.0), (4e9, 1.0),
    ],
)  # fmt: skip
def test_units_of_time_are_those_in_which_the_scene_ends_with_the_file(
    diagnosis: list[Diagnosis], end: float, unit: float
) -> None:
    diagnosis[0] = Diagnosis(cause="none", evidence="")
    judgement = judge_records(CHAIN, [plain([0.0, end * D], digits=0.5 * D), plain([0.0, 0.5 * D])])
    assert judgement.time_unit == unit
    # in another unit of time a record has its digits, too
    judged = judgement.files[0].record
    assert (judged.time[-1], judged.rounding["time"][0]) == pytest.approx((unit * end * D, unit * 0.5 * D))


@pytest.mark.parametrize("cause", ["none", "units", "mass"])
def test_files_in_another_unit_of_time_are_judged_in_it(diagnosis: list[Diagnosis], cause: str) -> None:
    diagnosis[0] = Diagnosis(cause=cause, evidence="Units differ.")
    file = replace(record(), time=1e3 * record().time)
    judgement = judge_records(CHAIN, [file])
    if cause == "mass":
        assert (judgement.cause, judgement.time_unit) == ("mass", 1.0)
        assert judgement.recognised == ["The scene ends at 0.0002 s; the reference was continued to 0.2 s."]
        return
    assert (judgement.cause, judgement.time_unit, judgement.outcome) == ("units", 1e-3, "FAIL")
    assert judgement.alternative_causes == (["time-scale"] if cause == "none" else [])
    assert judgement.alternatives == (["or: all times are to be multiplied by 0.001 (time-scale)"] * (cause == "none"))
    rest = "time step and digits explain the difference." if cause == "none" else "Units differ."
    assert judgement.evidence == f"The times are in ms (1000 times SI). With times in s: {rest}"
    assert judgement.recognised == ["The errors are those of the files with times in a unit of 0.001 s."]


@pytest.mark.usefixtures("diagnosis")
def test_a_scene_that_ends_with_the_file_to_a_rounding_is_not_continued() -> None:
    file = record()
    for stretch, notes in ((1.0 + 0.9e-9, 0), (1.0 + 1.5e-9, 1), (1.0 - 1e-3, 0)):
        time = file.time.copy()
        time[-1] *= stretch
        assert len(judge_records(CHAIN, [replace(file, time=time)]).recognised) == notes


@pytest.mark.parametrize(
    ("tolerance", "allowed"), [(0.99, True), (1e-9, True), (1.0, False), (0.0, False), (1.5, False)]
)
def test_a_tolerance_is_between_none_and_all(tolerance: float, allowed: bool) -> None:
    with pytest.raises(UsageError, match="no file was given" if allowed else "tolerance = "):
        judge_records(CHAIN, [], tolerance=tolerance)


@pytest.mark.usefixtures("diagnosis")
def test_some_files_without_a_step_beside_others_are_refused() -> None:
    time = [0.0, 1e-6, 2e-6]
    judge_records(CHAIN, [plain(time), plain(time)])
    judge_records(CHAIN, [plain(time, dt=1e-6), plain(time, dt=2e-6)])
    with pytest.raises(UsageError, match=r"^g has no time step, but another file has one; .*: g@DT$"):
        judge_records(CHAIN, [plain(time, dt=1e-6), replace(plain(time), name="g")])
