"""A second call of a study takes everything from the store, and another setting does not."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from dem_bridge.lmp.engine import Engine
from dem_bridge.observables.verdict import Outcome, Verdict
from dem_bridge.report.study import Study
from dem_bridge.scene.file import load_scene, parse_scene
from dem_bridge.scene.file.load import Measurement
from dem_bridge.scene.scene import Scene, Wall
from dem_bridge.studies.energy import study_energy
from dem_bridge.studies.engine.study import study_engine
from dem_bridge.studies.extremes.study import study_extremes
from dem_bridge.studies.horizon.study import study_horizon
from dem_bridge.studies.measurement.study import study_measurement
from dem_bridge.studies.order.study import study_order
from dem_bridge.studies.precision import study_precision
from dem_bridge.studies.recalled import Unfinished, recall_study
from dem_bridge.studies.restitution import study_restitution
from dem_bridge.studies.rule_of_thumb import study_rule_of_thumb
from dem_bridge.studies.scatter import study_scatter
from dem_bridge.studies.sensitivity import study_sensitivity
from dem_bridge.studies.styles import study_styles
from dem_bridge.studies.work_precision.study import study_work_precision
from tests.helpers.counting_store import Counting
from tests.helpers.export_chains import CROSSED_FILE

PAIR = Scene(name="pair", duration=1e-4, mass=(1e-2, 1e-2), stiffness=(4e9,), velocity=(0.8, 0.0), samples=50)
CROSSED = parse_scene(CROSSED_FILE)
WALLED = Scene(
    name="walled", duration=1e-3, mass=(1e-2, 1e-2), stiffness=(4e9,), velocity=(0.8, 0.0), samples=50,
    wall_left=Wall(stiffness=4e9), wall_right=Wall(stiffness=4e9),
)  # fmt: skip
HEAVY = Scene(name="pair", duration=1e-4, mass=(1e-2, 2e-2), stiffness=(4e9,), velocity=(0.8, 0.0), samples=50)
#: a call, the same with another setting, and the parts of it that must be computed again
Calls = tuple[Callable[..., Study], Callable[..., Study], int]
STUDIES: dict[str, Calls] = {
    # the runs of reference and condition numbers are counted, too
    "order": (partial(study_order, PAIR), partial(study_order, HEAVY), 3),
    "energy": (partial(study_energy, contacts=1000), partial(study_energy, contacts=2000), 8),
    "precision": (partial(study_precision, PAIR), partial(study_precision, HEAVY), 8),
    # whole studies are kept, with times that no second call would measure again
    "scatter": (partial(study_scatter, CROSSED, count=2), partial(study_scatter, CROSSED, count=3), 1),
    "sensitivity": (
        partial(study_sensitivity, CROSSED, base=16), partial(study_sensitivity, CROSSED, base=16, seed=1), 1,
    ),
    "work-precision": (
        partial(study_work_precision, PAIR, backends=["verlet"], limit=0.01, repeats=1),
        partial(study_work_precision, PAIR, backends=["blanes-moan"], limit=0.01, repeats=1), 1,
    ),
}  # fmt: skip


def _shown(study: Study) -> str:
    figures = [figure.as_csv() for figure in study.figures]
    files = {name: content() for name, content in study.files.items() if not name.endswith(".nc")}
    return repr((study.answer, [table.rows for table in study.tables], study.verdicts, study.notes, figures, files))


def check(calls: Calls, folder: Path) -> None:
    """Check that a second call computes nothing, has the same numbers, and that another setting misses the store."""
    call, other, parts = calls
    store = Counting(folder)
    first = call(store=store)
    computed = store.computed
    assert computed >= parts
    assert _shown(call(store=store)) == _shown(first)
    assert store.computed == computed
    assert _shown(other(store=store)) != _shown(first)
    assert store.computed >= computed + parts


@pytest.mark.parametrize("name", STUDIES)
def test_a_second_call_computes_nothing_and_another_setting_misses(name: str, tmp_path: Path) -> None:
    check(STUDIES[name], tmp_path)


@pytest.mark.lammps
def test_a_second_call_of_the_engine_runs_no_impact(tmp_path: Path) -> None:
    one, another = (partial(study_engine, match=f"hertz-{damping}-pair") for damping in ("velocity", "tsuji"))
    check((one, another, 1), tmp_path)
    # planted: another way to start LAMMPS
    store = Counting(tmp_path)
    one(store=store, engine=Engine(lmp_args=("-nonbuf",)))
    assert store.computed == 1


@pytest.mark.lammps
@pytest.mark.parametrize(
    "study",
    [
        partial(study_horizon, WALLED, perturbations=2),
        pytest.param(partial(study_styles, PAIR), marks=pytest.mark.slow),
    ],
)
def test_a_second_call_with_lammps_runs_nothing(study: Callable[..., Study], tmp_path: Path) -> None:
    check((partial(study, dt=1e-7), partial(study, dt=2e-7), 1), tmp_path)


@pytest.mark.lammps
@pytest.mark.parametrize(
    "calls",
    [
        (partial(study_restitution, laws=["dashpot"], backends=["verlet"]),
         partial(study_restitution, laws=["tsuji"], backends=["verlet"]), 1),
        (partial(study_rule_of_thumb, load_scene("sphere-cylinder-sphere")),
         partial(study_rule_of_thumb, load_scene("tapered-forward")), 1),
        (partial(study_extremes, match="table-8-lines"), partial(study_extremes, match="table-2-points"), 1),
    ],
    ids=["restitution", "rule-of-thumb", "extremes"],
)  # fmt: skip
def test_a_second_call_with_the_default_engine_computes_nothing(calls: Calls, tmp_path: Path) -> None:
    check(calls, tmp_path)


def test_a_second_call_of_a_measurement_reads_the_files_again(tmp_path: Path) -> None:
    file = tmp_path / "laser.csv"
    head = "time_s,body,velocity_m_per_s,velocity_uncertainty_m_per_s"
    file.write_text(f"{head}\n5e-5,1,0.4,0.01\n1e-4,1,0.8,0.01\n", encoding="utf-8")
    store = Counting(tmp_path / "store")
    measured = Measurement(files=(file,), parameters={"stiffness": 0.02}, fit=())
    call = partial(study_measurement, PAIR, measurement=measured, samples=10, store=store)
    first = call()
    computed = store.computed
    assert _shown(call()) == _shown(first)
    assert store.computed == computed > 0
    file.write_text(file.read_text(encoding="utf-8").replace("0.4,", "0.5,"), encoding="utf-8")
    assert _shown(call()) != _shown(first)
    assert store.computed > computed


BROKEN = Verdict(scene="s", quantity="q", backend="b", reference="r", outcome=Outcome.BROKEN, sentence="")


@pytest.mark.parametrize("change", [{"interrupted": True}, {"verdicts": (BROKEN,)}])
def test_a_study_that_did_not_end_well_is_made_again(change: dict[str, Any], tmp_path: Path) -> None:
    store = Counting(tmp_path)
    study = Study(id="s", title="", answer=("One.",), **change)
    made: list[int] = []

    def make() -> Study:
        made.append(1)
        return study

    assert [recall_study("s", store, make, PAIR) is study for _ in range(2)] == [True, True]
    assert (len(made), store.computed) == (2, 0)


def test_a_study_can_say_itself_that_it_did_not_end_well(tmp_path: Path) -> None:
    store = Counting(tmp_path)
    study = Study(id="s", title="", answer=("One.",))

    def make() -> Study:
        raise Unfinished(study)

    assert [recall_study("s", kept, make, [PAIR, HEAVY]) is study for kept in (store, store, None)] == [True] * 3
    assert store.computed == 0
