"""Page one says what verdicts, claims and effects say, and its figures show their numbers."""

from __future__ import annotations

import math
import re
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

import dem_bridge as db
from dem_bridge.observables.differences import difference
from dem_bridge.observables.verdict import Outcome
from dem_bridge.report.drawing import draw_figure
from dem_bridge.report.study import Claim, FigureData, Points
from dem_bridge.studies.paper.opening import abstract, headlines, wrong_table
from dem_bridge.studies.paper.overview import all_scenes, scale_of_differences, tornado, validity_figure
from dem_bridge.studies.paper.runs import MAIN, Runs
from dem_bridge.studies.paper.validity import contacts_of
from dem_bridge.verification.assess import SceneStudy
from dem_bridge.verification.budget import Budget
from dem_bridge.verification.reference_choice import REFERENCE
from tests.helpers.legibility import assert_legible
from tests.studies.paper.conftest import truth_of
from tests.studies.paper.test_summary import EFFECTS, STUDIES, _effect, _study, _verdict


def _budget(found: float) -> Budget:
    parts = {"time step": 0.9 * found, "table": 0.0, "round-off": 2e-11, "sampling": 0.0, "reference": 1e-12}
    return Budget(
        quantity="velocity", found=found, parts=parts, unexplained=1e-13, allowed=1e-12, scale_name="largest |velocity|"
    )


MORE = [*EFFECTS, _effect("exponent-1um", "supposed", "a smaller exponent", 0.0, 0.0, -0.41, 0.0)]
BUDGETED = [replace(study, budgets=(_budget(1e-6 * nth),)) for nth, study in enumerate(STUDIES, start=1)]


def _abstract(claims: tuple[Claim, ...], studies: list[SceneStudy], runs: Runs) -> tuple[Points, ...]:
    return abstract(claims, MORE, studies, runs, 5e-6)


def check_abstract(parts: tuple[Points, ...], claims: tuple[Claim, ...], studies: list[SceneStudy], runs: Runs) -> None:
    """Assert that an abstract has parts whose numbers are those of the claims and verdicts."""
    assert [part.heading for part in parts[:3]] == ["Question", "Method", "Result"]
    assert all(len(part.points) == 3 for part in parts[:3])
    for point in (point for part in parts for point in part.points):
        assert re.search(r"[.?)]$", point)
        assert "nan" not in point
    question, method, result, _, criteria, not_verified = (" ".join(part.points) for part in parts)
    verdicts = Counter(verdict.outcome for study in studies for verdict in study.verdicts)
    kinds = Counter(claim.kind for claim in claims)
    assert f"{len(claims)} statements" in question
    assert method.startswith(f"{len(studies)} scenes by LAMMPS")
    assert "5e-06 of the largest on the paper" in method
    theory, missing = verdicts[Outcome.MODEL_DIFFERENCE], verdicts[Outcome.NOT_RUN]
    judged = verdicts.total() - theory - missing
    passing = f"Of {verdicts.total()} comparisons {judged} have a tolerance and {verdicts[Outcome.PASS]} pass"
    assert passing in result, "other verdicts"
    assert f"{theory} are with a theory" in result
    assert f"{missing} lack a method" in result
    assert f"Of {len(claims)} statements {kinds['holds']} hold" in result, "other claims"
    assert f"{kinds['undecided']} cannot be decided" in result
    sensitive = [n for n, claim in enumerate(claims, start=1) if claim.margin is not None and claim.margin.changes]
    assert [int(number) for number in re.findall(r"\d+", criteria.split("those of nos.")[1])] == sensitive
    ends = [[runs.run(name, by) for name in MAIN] for by in ("bca", REFERENCE)]
    away = [abs(bca.crossing_time[39] / truth.crossing_time[39] - 1.0) for bca, truth in zip(*ends, strict=True)]
    assert f"predicts arrivals within {100.0 * max(away):.2g} % at the last cylinder" in result
    inner = [bca.crossing_time[4:37] / truth.crossing_time[4:37] - 1.0 for bca, truth in zip(*ends, strict=True)]
    assert f"cylinder, {100.0 * np.abs(inner).max():.2g} % from cylinder 5 to 37 and 6.4 % from 3 to 38" in result
    assert "experiments" in not_verified


def test_the_abstract_has_three_points_each_with_the_numbers_of_the_verdicts(
    claims: tuple[Claim, ...], runs: Runs
) -> None:
    parts = _abstract(claims, BUDGETED, runs)
    check_abstract(parts, claims, BUDGETED, runs)
    _, _, result, effects, *_ = (" ".join(part.points) for part in parts)
    assert "differ from the reference by at most 2.0e-06" in result  # of the two main chains the larger
    assert "slows down to 0.39" in result
    assert "in its place) matters most: up to 4 % (speed at the middle), for the speed at single" in effects
    assert "from 5 on and 33 % at cylinder 1" in effects
    assert "the printed 8.1 g) by 13 %, an exponent falling to 2.2 by up to 41 %" in effects


def test_an_abstract_of_other_numbers_is_caught(claims: tuple[Claim, ...], runs: Runs) -> None:
    wrong = _verdict("stacked-40", "lammps-granular", REFERENCE, 1e-2, quantity="crossing_time", outcome=Outcome.FAIL)
    studies = [*BUDGETED[:2], _study("stacked-40", 1e-6, 1e-12, 1e-12, wrong)]
    check_abstract(_abstract(claims, studies, runs), claims, studies, runs)
    with pytest.raises(AssertionError, match="other verdicts"):
        check_abstract(_abstract(claims, BUDGETED, runs), claims, studies, runs)
    held = tuple(replace(claim, outcome=Outcome.PASS, kind="holds") for claim in claims)
    with pytest.raises(AssertionError, match="other claims"):
        check_abstract(_abstract(held, BUDGETED, runs), claims, BUDGETED, runs)


def test_what_is_missing_is_left_out_of_the_abstract() -> None:
    points = [point for part in abstract((), [], [], Runs.of([]), 5e-6) for point in part.points]
    assert not any("nan" in point or "{" in point for point in points)
    assert headlines((), [], Runs.of([])) == ()


def test_the_large_numbers_are_those_of_budgets_arrivals_and_claims(claims: tuple[Claim, ...], runs: Runs) -> None:
    error, wave, arrival, statements = headlines(claims, BUDGETED, runs)
    assert wave.number == "0.39 and 2.35"
    assert "slows down in the decelerating chain and speeds up" in wave.sentence
    undone = [replace(claim, outcome=Outcome.FAIL) if claim.id == "accelerates" else claim for claim in claims]
    assert "slows down" not in " ".join(item.sentence for item in headlines(undone, BUDGETED, runs))
    assert error.number == "2.0e-06"
    assert "Cause: the time step. Half the step has a quarter" in error.sentence
    ends = [[runs.run(name, by) for name in MAIN] for by in ("bca", REFERENCE)]
    away = [abs(bca.crossing_time[39] / truth.crossing_time[39] - 1.0) for bca, truth in zip(*ends, strict=True)]
    assert arrival.number == f"{100.0 * max(away):.2g} %"
    assert "peak velocity is 84 % too high" in arrival.sentence
    kinds = Counter(claim.kind for claim in claims)
    assert statements.number == f"{kinds['holds']} of {len(claims)}"
    assert f"{kinds['undecided']} cannot be decided" in statements.sentence
    # a part that makes less than nine tenths of an error is not called its cause
    mixed = [replace(study, budgets=(replace(study.budgets[0], found=2e-6),)) for study in BUDGETED]
    assert "several parts" in headlines(claims, mixed, runs)[0].sentence


def test_the_table_of_what_is_wrong_has_every_statement_that_fails(claims: tuple[Claim, ...], runs: Runs) -> None:
    table = wrong_table(claims)
    wrong = {n: c for n, c in enumerate(claims, start=1) if c.outcome in (Outcome.FAIL, Outcome.MODEL_DIFFERENCE)}
    assert sorted(row[0] for row in table.rows) == sorted(wrong)
    assert all(row[2] == wrong[int(row[0])].short for row in table.rows)
    longest = [max(contact.over_half_height for contact in of[1:]) for _, of in contacts_of(runs, MAIN)]
    assert any(f"over half-height: {longest[0]:.2f} and {longest[1]:.2f}" in str(row[2]) for row in table.rows)


def test_every_difference_stands_on_one_scale_with_its_value(runs: Runs) -> None:
    [panel] = scale_of_differences(BUDGETED, MORE, runs, 5e-6).panels
    slow, fast, tolerance = panel.series
    at = {panel.rows[int(y)]: x for x, y in zip(slow.x, slow.y, strict=True)}
    run = runs.run(MAIN[0], "ode45")
    assert run is not None
    assert at["ode45 (defaults)"] == difference("velocity", run, truth_of(runs, MAIN[0])).value
    assert at["LAMMPS, time step"] == pytest.approx(0.9e-6)
    assert at["striker of fused quartz: force"] == pytest.approx(0.1)
    assert at["n falls to 2.2: force"] == pytest.approx(0.41)
    assert at["BCA: force"] == 0.8
    assert at["BCA: velocity"] == pytest.approx(0.84, abs=0.01)
    assert not any("striker" in panel.rows[int(y)] for y in fast.y)  # the effects are those of one chain
    assert set(tolerance.x) == {5e-6}
    # the tolerance is beside the rows of LAMMPS alone; each group of rows has a heading, which has no value
    between = [name for place, name in enumerate(panel.rows) if tolerance.y[0] < place < tolerance.y[1]]
    assert between == ["LAMMPS, round-off", "LAMMPS, time step"]
    headings = [name for name in panel.rows if name.endswith(":")]
    assert headings == ["Errors of velocities:", "Effects of the model:"]
    assert not {*headings} & {panel.rows[int(y)] for line in (slow, fast) for y in line.y}


def test_the_tornado_has_the_largest_term_on_top_with_its_sign() -> None:
    figure = tornado(EFFECTS)
    assert figure is not None
    arrival, force, _ = figure.panels
    assert arrival.rows == (
        "dashpot, 1 N s/m (supposed)",
        "striker of fused quartz (supposed)",
        "exact Hertz law, not eq. 3.1 (model)",
    )
    assert [line.x.tolist() for line in arrival.series] == [[99.0, 0.0, 3.0], []]
    assert force.series[0].x.tolist() == [0.0, -13.0, 0.0]
    assert tornado([]) is None
    bars = [bar.get_width() for bar in draw_figure(figure).axes[0].patches]  # type: ignore[attr-defined]
    assert bars == [99.0, 0.0, 3.0]


def test_ratios_are_above_one_exactly_where_an_assumption_is_violated(runs: Runs) -> None:
    figure = validity_figure(runs)
    assert figure is not None
    for panel, (_, contacts) in zip(figure.panels, contacts_of(runs, MAIN), strict=True):
        angled = [contact for contact in contacts if math.isfinite(contact.angle)]
        for nth, line in enumerate(panel.series[:5]):
            assert (line.y > 1.0).sum() == sum(not contact.judged[nth].holds for contact in angled)
        assert np.all(np.diff(panel.series[0].x) >= 0.0)
    assert "edge tension is 5.8 times its limit, and at 90 degrees up to 4.1 times" in figure.caption
    assert validity_figure(Runs.of([])) is None


def test_all_scenes_are_small_multiples_and_lines_for_few_bodies(runs: Runs) -> None:
    pair = db.load_scene("decelerating-40")
    figure = all_scenes(runs, [pair.name, "tapered-forward", "no-such-scene"])
    assert figure is not None
    assert [panel.title for panel in figure.panels] == [
        "decelerating-40 (41)",
        f"tapered-forward ({runs.scenes['tapered-forward'].n_body})",
    ]
    assert all(panel.map is not None and max(panel.map.values.shape) <= 160 for panel in figure.panels)
    assert all_scenes(runs, []) is None


@pytest.mark.parametrize("draw", [tornado, validity_figure])
def test_no_text_of_these_figures_covers_another(draw: object, runs: Runs) -> None:
    figure = tornado(EFFECTS) if draw is tornado else validity_figure(runs)
    assert isinstance(figure, FigureData)
    assert assert_legible(draw_figure(figure)) > 10


def test_rows_of_the_paper_name_the_chain_of_each_number_and_stand_by_kind(claims: tuple[Claim, ...]) -> None:
    kinds = [str(row[3]) for row in wrong_table(claims).rows]
    order = ("wrong in print", "theory off", "beyond our limit")
    assert kinds == sorted(kinds, key=lambda kind: order.index(kind))
    short = {claim.id: claim.short for claim in claims}
    assert short["arrival-by-bca"].endswith("(ours: 5 %); from cylinder 3 to 38 up to 6.4 %, which is beyond it")
    assert "decelerating-40 7.2 (two bodies), 12.2 (in the chain)" in short["lumped-mass"]
