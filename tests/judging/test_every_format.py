"""A file is judged alike in every format."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import dem_bridge as db
from dem_bridge.errors import RunBroken
from tests.helpers.planted.chains import FAMILIES
from tests.helpers.planted.faults import Planted, Run, Setting, plant
from tests.helpers.planted.files import WRITERS, rounded, write_csv, write_vtk


@pytest.fixture(scope="module")
def planted() -> Planted:
    chain = FAMILIES["graded"](np.random.default_rng(3), 6)
    setting = Setting(interval=chain.duration / 40, rows=41, digits=10)
    return plant(chain, "half-step-velocity", setting, 0.0, np.random.default_rng(0))


@pytest.fixture(scope="module")
def scene(planted: Planted, tmp_path_factory: pytest.TempPathFactory) -> db.Scene:
    path = tmp_path_factory.mktemp("scene") / "scene.toml"
    path.write_text(planted.chain.scene)
    return db.load_scene(path)


def _judged(path: Path, planted: Planted, scene: db.Scene) -> dict[str, object]:
    return dict(db.judge(f"{path}@{planted.setting.dt!r}", scene))


@pytest.fixture(scope="module")
def by_csv(planted: Planted, scene: db.Scene, tmp_path_factory: pytest.TempPathFactory) -> dict[str, object]:
    path = tmp_path_factory.mktemp("csv") / "run.csv"
    write_csv(path, planted.run, range(planted.chain.n_body), planted.setting.digits)
    return _judged(path, planted, scene)


@pytest.mark.parametrize("ending", [*(ending for ending in WRITERS if ending != "csv"), "pvd"])
def test_the_answer_is_that_to_the_csv_file(
    ending: str, planted: Planted, scene: db.Scene, by_csv: dict[str, object], tmp_path: Path
) -> None:
    digits, bodies = planted.setting.digits, range(planted.chain.n_body)
    # formats with positions have all digits of them
    values = {name: rounded(data, digits) for name, data in planted.run.values.items()}
    run = Run(time=planted.run.time, values=values)
    if ending == "pvd":
        path = write_vtk(tmp_path, run, bodies, digits)
    else:
        path = tmp_path / f"run.{ending}"
        WRITERS[ending](path, run, bodies, digits)
    answer = _judged(path, planted, scene)
    for key in ("outcome", "cause", "alternatives", "where"):
        assert answer[key] == by_csv[key], key
    for name, error in answer["error"].items():  # type: ignore[attr-defined]
        expected = by_csv["error"][name]["value"]  # type: ignore[index]
        # positions of 18 mm spacing are rounded at 1e-17 m, displacements of 1e-5 m at 10 digits
        assert error["value"] == pytest.approx(expected, rel=1e-6, abs=1e-16)


@pytest.mark.parametrize("ending", ["csv", "txt", "npz", "nc", "lammpstrj", "pvd"])
def test_the_bodies_that_a_file_states_are_taken(
    ending: str, planted: Planted, scene: db.Scene, tmp_path: Path
) -> None:
    bodies = [1, 4]
    run = Run(time=planted.run.time, values={name: data[:, bodies] for name, data in planted.run.values.items()})
    if ending == "pvd":
        path = write_vtk(tmp_path, run, bodies, 12)
    else:
        path = tmp_path / f"run.{ending}"
        WRITERS[ending](path, run, bodies, 12)
    right = replace(planted.setting, digits=12)
    answer = dict(db.judge(f"{path}@{right.dt!r}", scene))
    # half a step times the largest acceleration; the velocity of another body differs by 0.1 m/s and more
    assert answer["error"]["velocity"]["value"] < 0.03


@pytest.mark.lammps
@pytest.mark.parametrize(
    "change", [("run             ${steps}", "run 0"), ("run             ${steps}", "quit\nrun 100")]
)
def test_a_deck_that_runs_no_step_is_broken(change: tuple[str, str], tmp_path: Path) -> None:
    scene = db.Scene(name="pair", duration=1e-4, mass=(8e-3, 1e-2), stiffness=(4e9,), velocity=(0.8, 0.0), samples=10)
    db.write_deck(scene, tmp_path, dt=1e-6)
    deck = tmp_path / "in.pair"
    text = deck.read_text()
    assert change[0] in text
    deck.write_text(text.replace(*change))
    with pytest.raises(
        RunBroken, match=r"ended without an error, but it ran no step|ended with exit code 0 while running"
    ):
        db.judge([deck], scene)
