"""An observable that one file declares appears in verify, plan, work-precision, export and the page."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

import dem_bridge as db
from dem_bridge import observables
from dem_bridge.observables.registry import OBSERVABLES, declared_in
from dem_bridge.observables.verdict import Outcome
from dem_bridge.report.study import Table
from dem_bridge.verification.checks import accuracy
from dem_bridge.verification.roles import assign_roles
from tests.helpers.command_line import run_here
from tests.helpers.fake_runs import CHAIN
from tests.helpers.registered import registered

#: the mean velocity of three bodies with 6.48e-3 kg m/s, 0.8 m/s at the start of the first
START = 0.8 / 3.0


#: all that the new observable needs: one module beside those of the package
MODULE = '''
"""The mean of the velocities of all bodies."""

import numpy as np

from dem_bridge.observables.observable import LARGEST, Measured, measured

DECLARED = (
    measured(
        lambda scene, run: Measured(
            np.mean(run.velocity, axis=1), np.full(len(run.time), run.uncertainty["velocity"])
        ),
        name="mean_velocity",
        definition="Mean velocity of all bodies at each sample.",
        unit="m/s",
        axis=("time",),
        scale=LARGEST,
    ),
)
'''


@pytest.fixture(scope="module", autouse=True)
def mean_velocity(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    folder = tmp_path_factory.mktemp("observables")
    (folder / "mean_velocity.py").write_text(MODULE)
    (folder / "without.py").write_text("raise AssertionError('a module without observables is not imported')\n")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(observables, "__path__", [*observables.__path__, str(folder)])
        [declared] = declared_in(folder)
        with registered(declared):
            yield
    del sys.modules["dem_bridge.observables.mean_velocity"]
    assert "mean_velocity" not in OBSERVABLES


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "small.toml"
    path.write_text(CHAIN)
    return path


def _table(study: db.Study, id: str) -> Table:
    return next(table for table in study.tables if table.id == id)


@pytest.mark.lammps
def test_verify_judges_and_lists_it_in_text_json_table_and_page(file: Path, tmp_path: Path) -> None:
    done = run_here("verify", "small.toml", "--accuracy", "1e-4", "-j", "1", "-v", "-o", "report", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    # on narrow terminals the name of the observable goes on below
    line = re.search(r"^mean(?: velocity)? +([\d.]+) +m/s +(\S+) +(\S+) +(\S+)", done.stdout, re.MULTILINE)
    assert line is not None, done.stdout
    value, of_reference, difference, of_engine = map(float, line.groups())
    # the largest magnitude is reached within the collisions, and is at least that of the start
    assert START <= value < 0.8
    assert of_reference < 1e-12
    assert 0.0 < difference <= of_engine < 1e-3
    assert re.search(r"^mean velocity +lammps-granular - reference .* PASS", done.stdout, re.MULTILINE)
    record = json.loads((tmp_path / "report" / "verdicts.json").read_text(encoding="utf-8"))
    [row] = [row for row in record["observables"] if row["observable"] == "mean velocity"]
    assert row["LAMMPS - reference"] == pytest.approx(difference, rel=1e-3)
    assert row["uncertainty of twin"] == pytest.approx(row["uncertainty of LAMMPS"], rel=1e-6)
    [verdict] = [one for one in record["verdicts"] if one["quantity"] == "mean_velocity"]
    assert (verdict["outcome"], verdict["difference"]) == ("PASS", row["LAMMPS - reference"])
    text = (tmp_path / "report" / "index.html").read_text(encoding="utf-8")
    section = text.split('id="table-observables"')[1].split("</table>")[0]
    assert "mean velocity" in section
    assert "mean velocity" in text.split('id="verdicts"')[1]
    assert "mean velocity" in (tmp_path / "report/tables/observables.csv").read_text(encoding="utf-8")


def test_plan_finds_settings_for_it(file: Path, tmp_path: Path) -> None:
    words = ("plan", "small.toml", "--accuracy", "1e-4", "--backend", "verlet", "--observable", "mean_velocity")
    done = run_here(*words, "--json", cwd=tmp_path)
    plan = json.loads(done.stdout)
    assert plan["observable"] == "mean_velocity"
    assert 0.0 < plan["found_error"] <= 1e-4


def test_work_precision_measures_it(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pytest.importorskip("dem_bridge.studies.work_precision.curves"), "HALVINGS", 2)
    study = db.study("work-precision", file, backends=["verlet"], limit=60.0, repeats=1, store=False)
    table = next(table for table in study.tables if "mean_velocity" in table.columns)
    errors = [row[table.columns.index("mean_velocity")] for row in table.rows]
    assert any(isinstance(error, float) and 0.0 < error < 1.0 for error in errors)


def test_export_has_it(file: Path, tmp_path: Path) -> None:
    words = ("--table", "observables", "--backend", "verlet", "--dt", "1e-7", "--format", "json")
    done = run_here("export", "small.toml", *words, cwd=tmp_path)
    assert done.returncode == 0
    assert "mean velocity: largest magnitude at samples, 0." in done.stdout


def test_a_faulty_value_of_it_is_a_verdict_that_fails(file: Path) -> None:
    scene = db.load_scene(file)
    reference = db.solve(scene, backend="reference")
    run, roles = db.solve(scene, backend="verlet", dt=1e-7), assign_roles(scene)
    outcomes = {verdict.quantity: verdict.outcome for verdict in accuracy(roles, "engine", run, reference, 1e-4)}
    assert outcomes["mean_velocity"] is Outcome.PASS
    faulty = replace(run, velocity=run.velocity * 1.01)
    outcomes = {verdict.quantity: verdict.outcome for verdict in accuracy(roles, "engine", faulty, reference, 1e-4)}
    assert outcomes["mean_velocity"] is Outcome.FAIL
