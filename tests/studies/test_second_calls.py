"""A second call of a study takes everything from the store, and another setting does not."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest

from dem_bridge.lmp.engine import Engine
from dem_bridge.report.study import Study
from dem_bridge.scene.scene import Scene
from dem_bridge.studies.energy import study_energy
from dem_bridge.studies.engine.study import study_engine
from dem_bridge.studies.order.study import study_order
from dem_bridge.studies.precision import study_precision
from tests.helpers.counting_store import Counting

PAIR = Scene(name="pair", duration=1e-4, mass=(1e-2, 1e-2), stiffness=(4e9,), velocity=(0.8, 0.0), samples=50)
HEAVY = Scene(name="pair", duration=1e-4, mass=(1e-2, 2e-2), stiffness=(4e9,), velocity=(0.8, 0.0), samples=50)
#: a call, the same with another setting, and the parts of it that must be computed again
Calls = tuple[Callable[..., Study], Callable[..., Study], int]
STUDIES: dict[str, Calls] = {
    # the runs of reference and condition numbers are counted, too
    "order": (partial(study_order, PAIR), partial(study_order, HEAVY), 3),
    "energy": (partial(study_energy, contacts=1000), partial(study_energy, contacts=2000), 8),
    "precision": (partial(study_precision, PAIR), partial(study_precision, HEAVY), 8),
}


def _shown(study: Study) -> str:
    return repr((study.answer, [table.rows for table in study.tables], study.verdicts, study.notes))


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
