"""The whole study on few scenes: what is run, in which order, and that it always ends in a report."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest
from click.testing import CliRunner

import dem_bridge as db
from dem_bridge.backends import lammps
from dem_bridge.backends.base import BACKENDS, Resolution
from dem_bridge.cli import main
from dem_bridge.errors import BackendUnavailable, UsageError
from dem_bridge.observables.differences import difference
from dem_bridge.observables.verdict import Outcome
from dem_bridge.report import svg
from dem_bridge.runs.campaign import tasks
from dem_bridge.runs.case import Case
from dem_bridge.runs.store import Store
from dem_bridge.scene.scene import Scene
from dem_bridge.studies.model_hierarchy.models import ModelHierarchy, model_hierarchy_of
from dem_bridge.studies.paper import study
from dem_bridge.studies.paper.runs import (
    GRADIENTS,
    LONG,
    MAIN,
    MATCHED,
    MISMATCHED,
    Runs,
    beside,
    mass_gradients,
    matched,
    quick,
    scenes_of_paper,
    variants,
    with_mass_gradient,
)
from dem_bridge.studies.paper.study import Extent, coverage_table, verify_paper
from dem_bridge.verification import verify
from dem_bridge.verification.reference_choice import REFERENCE
from dem_bridge.verification.roles import GRANULAR
from dem_bridge.verification.verification import Verification
from dem_bridge.verification.verify import ScenePlan, plan_scene
from tests.studies.paper.conftest import cheap_variants, few_gradients, truth_of, without

#: of both chains, with two scattered ones each
SMALL = Extent(scenes=MAIN, chains=2, hierarchy=False)


# what is run


def test_the_papers_own_chains_come_first_and_all_others_follow() -> None:
    names = [scene.name for scene in scenes_of_paper()]
    assert set(names[:2]) == set(MAIN)
    assert sorted(names) == sorted(db.shipped_scenes())
    assert [scene.name for scene in scenes_of_paper([LONG[0], MAIN[0]])] == [MAIN[0], LONG[0]]


def test_beside_what_is_judged_there_are_the_papers_method_and_another_integrator() -> None:
    cases = list(beside(db.load_scene(MAIN[0])))
    assert [case.backend for case in cases] == ["ase", "blanes-moan", "ode45", "adiabatic"]
    assert {case.sampling.count for case in cases} == {db.load_scene(MAIN[0]).samples}
    assert [case.backend for case in beside(db.load_scene("stacked-40"))] != [
        "ase",
        "blanes-moan",
        "ode45",
        "adiabatic",
    ]


def test_every_variant_and_every_gradient_is_run_on_both_chains() -> None:
    assert len({case.scene.name for case in variants()}) == len(variants()) == 2 * 14
    cases = mass_gradients()
    by = {
        name: {case.scene.name for case in cases if case.backend == name}
        for name in (REFERENCE, "ode45", "bca", "adiabatic", GRANULAR)
    }
    assert {name: len(found) for name, found in by.items()} == {
        REFERENCE: 34, "ode45": 34, "bca": 34, "adiabatic": 34, GRANULAR: 18,
    }  # fmt: skip
    assert pytest.approx(np.linspace(-0.02, 0.02, 17)) == GRADIENTS
    # ends and middle, and those that the claims name
    assert {f"{MAIN[0]}.gamma{gamma:g}" for gamma in (-0.02, -0.01, 0.0, 0.01, 0.02)} <= by[GRANULAR]


def test_matched_chains_have_the_striker_of_a_cylinder_the_stiffness_of_the_next_contact_or_both() -> None:
    scenes = {case.scene.name.split(".")[1]: case.scene for case in matched()}
    assert list(scenes) == [*MATCHED, MISMATCHED]
    soft = scenes.pop(MISMATCHED).stiffness
    dec, acc = (db.load_scene(name) for name in MAIN)
    assert soft[0] / soft[1] == pytest.approx(dec.stiffness[0] / dec.stiffness[1], rel=1e-10)
    assert soft[1:] == acc.stiffness[1:]
    equal = {
        key: (scene.mass[0] == scene.mass[1], scene.stiffness[0] == scene.stiffness[1]) for key, scene in scenes.items()
    }
    assert equal == {"matched": (True, True), "matched-mass": (True, False), "matched-stiffness": (False, True)}


def test_runs_are_the_first_of_their_kind_and_lammps_has_one_name(runs: Runs) -> None:
    first = runs.results[MAIN[0], REFERENCE]
    coarser = replace(first, trajectory=truth_of(runs, MAIN[1]))
    assert Runs.of([first, coarser]).truth(MAIN[0]) is first.trajectory
    assert Runs.of([coarser, first]).truth(MAIN[0]) is coarser.trajectory
    assert runs.run(MAIN[0], "lammps") is runs.results[MAIN[0], GRANULAR].trajectory
    assert runs.run(MAIN[0], "ase") is None
    assert [name for name, _ in runs.judges(MAIN[0])] == ["reference", "lammps", "ode45", "bca", "adiabatic"]
    assert list(runs.judges("no-such-scene")) == []
    assert runs.has(MAIN[0])
    assert not runs.has("no-such-scene")
    assert set(runs.by_backend(MAIN[0])) == {REFERENCE, GRANULAR, "ode45", "bca", "adiabatic"}


def test_where_the_reference_is_scipys_answer_scipy_has_a_run(runs: Runs) -> None:
    damped = f"{MAIN[1]}.dashpot"
    assert runs.run(damped, "scipy") is truth_of(runs, damped)
    assert runs.run(MAIN[0], "scipy") is None
    assert runs.run(f"{MAIN[1]}.base", "scipy") is None


# what is shown


def test_a_paper_has_its_tables_and_its_figures_in_order(paper: Verification) -> None:
    assert [table.id for table in paper.tables] == [
        "claims", "wrong", "budget", "split", "theories", "pulses", "fits", "coverage", "validity",
        f"contacts-{MAIN[0]}", f"contacts-{MAIN[1]}", "scatter", "verdicts", "observables",
    ]  # fmt: skip
    assert [one.id for one in paper.figures] == [
        "figure-2", "scale", "figure-3", "figure-4", "figure-4-spectra", "figure-5",
        *(f"scatter-{name}" for name in MAIN), "tornado", "validity",
    ]  # fmt: skip
    assert (len(paper.answer), len(paper.abstract), len(paper.headlines)) == (5, 6, 3)  # LAMMPS was not run
    assert len({one.id for one in paper.claims}) == len(paper.claims) >= 15


def test_the_budget_has_every_term_that_has_run(paper: Verification) -> None:
    rows = [(row[0], row[2]) for row in paper.tables[2].rows]
    # of the decelerating chain five variants are not run here, of the other two; "as-is" is no term
    assert sum(chain == MAIN[0] for _, chain in rows) == 1 + 4 + 12 - 5
    assert sum(chain == MAIN[1] for _, chain in rows) == 1 + 4 + 12 - 2
    assert len(set(rows)) == len(rows)
    assert not any(what == "the paper's chain" for what, _ in rows)


def test_coverage_is_the_difference_to_the_reference(runs: Runs) -> None:
    table = coverage_table(runs, MAIN)
    assert table.columns == ("scene", *(name for name in BACKENDS if name != REFERENCE))
    at = {name: i for i, name in enumerate(table.columns)}
    row = table.rows[0]
    for name in (GRANULAR, "bca", "ode45"):
        run, truth = runs.run(MAIN[0], name), truth_of(runs, MAIN[0])
        assert run is not None
        assert row[at[name]] == pytest.approx(np.max(np.abs(run.velocity - truth.velocity)) / 0.8, rel=1e-9)
        assert row[at[name]] == difference("velocity", run, truth).value
    assert row[at["ase"]] == ""
    assert coverage_table(without(runs, REFERENCE), MAIN).rows[0][1:] == ("",) * (len(BACKENDS) - 1)


def test_figures_of_scenes_that_have_not_run_are_left_out(runs: Runs) -> None:
    left = Runs.of(result for (name, _), result in runs.results.items() if name not in (LONG[0], "tapered-forward"))
    assert [one.id for one in study.figures_of(left, [])] == ["figure-2", "figure-3"]
    assert list(study.figures_of(Runs.of([]), [])) == []


# all of it


@pytest.fixture
def small(runs: Runs, store: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The command and the facade ask for all of it: here they get two scenes and the runs that are cheap or made."""

    def brief(*words: Any, full: bool, **more: Any) -> ScenePlan:
        # without the ladder of steps and scipy's bars, which are not asked about here
        return plan_scene(*words, full=False, **more)

    def without_ase(scene: Scene) -> list[Case]:
        return [case for case in beside(scene) if case.backend != "ase"]

    def undamped(*words: Any, **more: Any) -> ModelHierarchy:
        hierarchy = model_hierarchy_of(*words, **more)
        return replace(hierarchy, model_terms=tuple(one for one in hierarchy.model_terms if one.id != "damping"))

    monkeypatch.setenv("DEM_BRIDGE_STORE", str(store))
    monkeypatch.setattr(study, "model_hierarchy_of", undamped)
    monkeypatch.setattr(study, "Extent", partial(Extent, scenes=MAIN, chains=2))
    monkeypatch.setattr(study, "variants", cheap_variants)
    monkeypatch.setattr(study, "mass_gradients", lambda engine: few_gradients())
    monkeypatch.setattr(study, "plan_scene", brief)
    monkeypatch.setattr(study, "beside", without_ase)


@pytest.mark.slow
@pytest.mark.lammps
def test_verify_paper_prints_its_claims_and_writes_them(small: None, tmp_path: Path) -> None:
    words = ("verify", "paper", "--accuracy", "1e-4", "-j", "1", "-o", str(tmp_path / "report"))
    done = CliRunner().invoke(main, [*words, "--json", str(tmp_path / "v.json")])
    assert done.exit_code == 0, done.output
    told = json.loads((tmp_path / "v.json").read_text(), parse_constant=lambda word: pytest.fail(word))
    outcomes = {one["id"]: one["outcome"] for one in told["claims"]}
    assert (outcomes["decelerates"], outcomes["accelerates"], outcomes["weight"]) == ("PASS", "PASS", "FAIL")
    assert outcomes["solitary"] == outcomes["width-kept"] == "NOT_RUN"
    tables = CliRunner().invoke(main, [*words, "-v", "--json", str(tmp_path / "w.json")]).stdout
    for id in outcomes:
        assert re.search(rf"^(id )?{id}[ ;]", tables, re.MULTILINE)
    # of two scenes the terminal has a line each, the page the answer of the paper
    assert re.search(r"^decelerating-40: PASS: at \S+ s LAMMPS is within", done.stdout, re.MULTILINE)
    assert re.search(r"^verdicts: \d+ PASS", done.stdout, re.MULTILINE)
    [decelerates] = [one for one in told["claims"] if one["id"] == "decelerates"]
    by = {value["backend"]: value for value in decelerates["values"]}
    assert list(by) == ["reference", "lammps", "ode45", "bca", "adiabatic"]
    assert 0.0 < abs(by["lammps"]["value"] - by["reference"]["value"]) <= by["lammps"]["uncertainty"] < 1e-2
    page = (tmp_path / "report/index.html").read_text()
    assert decelerates["sentence"] in page
    assert "LAMMPS integrates the equations of motion correctly: on the paper&#39;s two chains" in page
    assert "What may be left out at 1 %" in page
    assert (tmp_path / "report/verdicts.json").read_text() == (tmp_path / "w.json").read_text()


@pytest.mark.slow
@pytest.mark.lammps
def test_a_second_report_judges_and_draws_nothing(small: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    words = ("verify", "paper", "--accuracy", "1e-4", "-j", "1", "-o")
    assert CliRunner().invoke(main, [*words, str(tmp_path / "first")]).exit_code == 0
    for module, name in (
        (tasks, "run_case"), (study, "read_paper"), (verify, "assess_scene"), (svg, "svg_of"),
    ):  # fmt: skip
        monkeypatch.setattr(module, name, Mock(side_effect=AssertionError(f"{name} is called again")))
    done = CliRunner().invoke(main, [*words, str(tmp_path / "second")])
    assert done.exit_code == 0, done.output
    first, second = (json.loads((tmp_path / name / "verdicts.json").read_text()) for name in ("first", "second"))
    for part in ("verdicts", "claims", "budgets"):
        assert second[part] == first[part]
    pages = [(tmp_path / name / "index.html").read_text() for name in ("first", "second")]
    shown = [re.findall(r"<svg .*?</svg>", page, re.DOTALL) for page in pages]
    assert shown[1] == shown[0]
    assert len(shown[0]) >= 2
    for name in ("tables", "figures"):
        files = sorted((tmp_path / "first" / name).iterdir())
        assert files
        for file in files:
            assert (tmp_path / "second" / name / file.name).read_bytes() == file.read_bytes()


@pytest.mark.slow
def test_without_lammps_the_claims_are_read_from_the_reference(small: None, monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(*_: object, **__: object) -> None:
        raise BackendUnavailable("the lammps module does not load; install it with: pip install lammps mpich")

    monkeypatch.setattr(lammps, "run_deck", missing)
    told: list[str] = []
    # another accuracy than LAMMPS has runs of in the store
    found = verify_paper(
        accuracy=1e-3, jobs=1, progress=lambda done, total, label: told.append(label), store=Store.opened()
    )
    claims = {one.id: one for one in found.claims}
    assert claims["decelerates"].outcome is claims["amplitude"].outcome is Outcome.PASS
    assert {value.backend for value in claims["decelerates"].values} == {"reference", "ode45", "bca", "adiabatic"}
    of_lammps = [v for v in found.verdicts if v.backend == GRANULAR]
    assert {v.outcome for v in of_lammps} == {Outcome.NOT_RUN}
    assert all("pip install lammps" in v.sentence for v in of_lammps)
    [table] = [one for one in found.tables if one.id == "left-out"]
    may = {(row[0].split(" (")[0].split(":")[0], row[1]): row[-1] for row in table.rows if isinstance(row[0], str)}
    assert may["gravity", MAIN[0]] == may["gravity", MAIN[1]] == "no"
    assert may["the base behind the last body", MAIN[0]] == may["the base behind the last body", MAIN[1]] == "yes"
    # stiffness law, gravity, base and the striker's stiffness; its mass is that of crystalline quartz and no doubt
    assert len(may) == len(table.rows) == 2 * 4
    assert found.answer[0].startswith("LAMMPS was not run on the paper's two chains")
    assert (told[0], told[-1]) == ("choosing time steps", "reading claims")
    assert sorted(one.scene.name for one in found.studies) == sorted(MAIN)
    judged = next(one for one in found.tables if one.id == "rule-of-thumb")
    column = judged.columns.index("velocity at 20 % (%)")
    # what was found elsewhere on these two chains: 3 to 4 % of v0
    assert all(2.9 < float(row[column]) < 3.8 for row in judged.rows)
    assert sorted(str(row[0]) for row in judged.rows) == sorted(MAIN)


def test_a_scene_without_a_time_step_is_a_verdict_and_claims_are_left(monkeypatch: pytest.MonkeyPatch) -> None:
    def hopeless(*_: object, **__: object) -> Resolution:
        raise UsageError("accuracy = 1e-14 is out of reach; ask for less")

    for name in ("variants", "mass_gradients", "matched"):
        monkeypatch.setattr(study, name, lambda *_: [])
    monkeypatch.setattr("dem_bridge.verification.verify.main_resolution", hopeless)
    found = verify_paper(accuracy=1e-14, jobs=1, extent=SMALL)
    assert {v.outcome for v in found.verdicts} == {Outcome.UNDECIDED}
    assert all("ask for less" in v.sentence for v in found.verdicts)
    outcomes = {one.id: one.outcome for one in found.claims}
    assert outcomes["weight"] is Outcome.FAIL
    assert outcomes["decelerates"] is outcomes["mass-gradient-by-bca"] is Outcome.NOT_RUN
    assert outcomes["scatter"] is Outcome.UNDECIDED


@pytest.mark.parametrize("jobs", [0, -1, 1.5, True, "2"])
def test_jobs_that_are_none_are_refused_in_one_line(jobs: object) -> None:
    with pytest.raises(UsageError, match=r"^jobs = .*; allowed: a whole number( >= 1)?, or None( for all cores)?$"):
        db.verify("paper", jobs=jobs, store=False)  # type: ignore[arg-type]


def test_an_accuracy_that_is_none_is_refused() -> None:
    with pytest.raises(UsageError, match=r"accuracy = 2\.0; allowed"):
        verify_paper(accuracy=2.0, extent=SMALL)


@pytest.mark.parametrize("scenes", [["paper", MAIN[0]], [MAIN[0], "paper"]])
def test_the_paper_is_asked_for_alone(scenes: Sequence[str]) -> None:
    with pytest.raises(UsageError, match="'paper' stands for all shipped scenes"):
        db.verify(scenes, store=False)


def test_quick_runs_have_no_bars_and_one_sample() -> None:
    [case] = quick([with_mass_gradient(db.load_scene(MAIN[0]), 0.0)])
    assert (case.resolution, case.uncertainty) == (Resolution(dt=1e-7), False)
    assert (case.backend, case.sampling.count) == (REFERENCE, 1)
