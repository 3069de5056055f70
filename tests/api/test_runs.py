"""The public facade: names, settings, accuracy, and decks that appear whole or not at all."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import dem_bridge as db
from dem_bridge.backends.base import BACKENDS, Resolution
from dem_bridge.errors import BackendUnavailable, SceneError, UnsupportedScene, UsageError
from dem_bridge.scene.scene import Scene, Wall
from tests.conftest import Solve

PAIR = Scene(name="pair", duration=1e-4, mass=(8.1e-3, 1e-2), stiffness=(4e9,), velocity=(0.8, 0.0), samples=10)

PAIR_FILE = """\
name = "pair"
duration = 1e-4
[chain]
mass = [8.1e-3, 1e-2]
stiffness = [4e9]
velocity = [0.8, 0.0]
[sampling]
count = 10
"""


def test_every_public_name_is_there_and_all_is_sorted() -> None:
    assert db.__all__ == sorted(db.__all__)
    for name in db.__all__:
        assert getattr(db, name) is not None
    assert set(db.__all__) <= set(dir(db))


def test_a_name_that_does_not_exist_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="module 'dem_bridge' has no attribute 'slove'"):
        _ = db.slove  # type: ignore[attr-defined]


def test_importing_the_package_imports_no_numpy() -> None:
    code = "import sys, dem_bridge; print(*{'numpy', 'scipy', 'numba', 'pydantic', 'xarray'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == []


def test_a_scene_may_be_given_as_itself_a_name_or_a_path(tmp_path: Path, solved: Solve) -> None:
    file = tmp_path / "pair.toml"
    file.write_text(PAIR_FILE)
    for source in (file, str(file)):
        run = db.solve(source, backend="verlet", dt=1e-7, uncertainty=False)
        np.testing.assert_array_equal(run.velocity, solved(PAIR, "verlet", dt=1e-7, uncertainty=False).velocity)
    assert db.solve("accelerating-40", backend="bca").velocity.shape == (501, 41)


def test_every_setting_that_is_advertised_is_taken() -> None:
    settings: dict[str, Any] = {
        "dt": 1e-7,
        "rtol": 1e-10,
        "atol": 1e-12,
        "surrogate_radius": 1e-3,
        "geometry": "surrogate",
        "types": "per-body",
        "table_style": "linear",
        "table_lines": 100,
        "table_points": 5000,
        "tables": True,
        "time_limit": 60.0,
    }
    assert set(settings) == {field.name for field in fields(Resolution)}
    run = db.solve(PAIR, backend="verlet", samples=5, uncertainty=False, **settings)
    assert run.velocity.shape == (6, 2)


@pytest.mark.parametrize(
    ("key", "value", "allowed"),
    [
        ("geometry", "9mm", "'surrogate' or 'physical'"),
        ("geometry", None, "'surrogate' or 'physical'"),
        ("types", "all", "'euler' or 'per-body'"),
        ("types", 9, "'euler' or 'per-body'"),
        ("table_style", "lookup", "'spline' or 'linear'"),
        ("table_lines", 7, "a whole number from 8 to 1000000"),
        ("table_lines", 250.0, "a whole number from 8"),
        ("table_points", 1, "a whole number from 2 to 100000000"),
        ("table_points", True, "a whole number from 2"),
        ("table_points", "10000", "a whole number from 2"),
        ("tables", 1, "False or True"),
        ("tables", "yes", "False or True"),
        ("uncertainty", 0, "True or False"),
        ("geometry", ["physical"], "'surrogate' or 'physical'"),
    ],
)
def test_a_wrong_value_of_a_setting_is_one_line_with_what_is_allowed(key: str, value: Any, allowed: str) -> None:
    for backend in ("verlet", "lammps-table"):
        with pytest.raises(UsageError) as caught:
            db.solve(PAIR, backend=backend, **{key: value})
        assert str(caught.value).startswith(f"{key} = {value!r}; allowed: {allowed}")
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "how", [{"table_lines": 8}, {"table_points": 2}, {"table_points": 3}, {"table_style": "linear"}]
)
def test_the_least_that_a_table_may_have_still_makes_a_deck(how: dict[str, Any], tmp_path: Path) -> None:
    assert db.write_deck(PAIR, tmp_path, style="table", dt=1e-6, **how)
    run = db.solve(PAIR, backend="verlet", dt=1e-6, tables=True, **how)
    # coarse tables are wrong, and the bar knows it
    truth = db.solve(PAIR, backend="scipy", uncertainty=False)
    assert np.max(np.abs(run.velocity - truth.velocity)) <= run.uncertainty["velocity"]


def test_an_unknown_setting_is_refused_with_those_that_exist() -> None:
    with pytest.raises(
        UsageError, match=r"setting 'timestep' is unknown; allowed: backend, dt, accuracy, .*rtol, .*ranks"
    ):
        db.solve(PAIR, backend="verlet", timestep=1e-7)


def test_an_unknown_backend_is_refused_with_those_that_exist() -> None:
    with pytest.raises(UsageError, match=f"backend = 'lammps'; allowed: {', '.join(BACKENDS)}"):
        db.solve(PAIR, backend="lammps")


def test_an_unknown_scene_is_refused() -> None:
    with pytest.raises(SceneError, match="no such scene"):
        db.solve("slowing-40", backend="verlet")


def test_dt_and_accuracy_together_are_refused() -> None:
    with pytest.raises(UsageError, match="dt and accuracy are both given"):
        db.solve(PAIR, backend="verlet", dt=1e-7, accuracy=1e-6)


@pytest.mark.parametrize("accuracy", [0.0, 1.0, -1e-6, float("nan"), "1e-6", True])
def test_an_accuracy_that_is_none_is_refused(accuracy: Any) -> None:
    with pytest.raises(UsageError, match=r"accuracy = .*; allowed: a number between 0 and 1"):
        db.solve(PAIR, backend="verlet", accuracy=accuracy)


@pytest.mark.parametrize("accuracy", [1e-3, 1e-5, 1e-7])
def test_an_accuracy_asked_for_is_kept(accuracy: float, solved: Solve) -> None:
    run, reference = db.solve(PAIR, backend="verlet", accuracy=accuracy), solved(PAIR, "scipy")
    scale = float(np.max(np.abs(reference.velocity)))
    assert np.max(np.abs(run.velocity - reference.velocity)) <= accuracy * scale


@pytest.mark.parametrize("accuracy", [1e-3, 1e-5, 1e-7])
def test_an_accuracy_is_not_bought_at_any_price(accuracy: float) -> None:
    run = db.solve(PAIR, backend="verlet", accuracy=accuracy)
    # the next step of the 1-2-5 series is at most 2.5 times longer, and second order makes that 6 in the bar
    assert run.uncertainty["velocity"] >= accuracy * 0.8 / (2.0 * 2.5**2)


def test_an_accuracy_beyond_what_can_be_run_is_refused_with_advice() -> None:
    with pytest.raises(UsageError, match=r"accuracy = 1e-15 cannot be reached: .*ask for less"):
        db.solve(PAIR, backend="verlet", accuracy=1e-15)


@pytest.mark.lammps
def test_lammps_keeps_an_accuracy_asked_for(solved: Solve) -> None:
    run, reference = db.solve(PAIR, backend="lammps-granular", accuracy=1e-5), solved(PAIR, "scipy")
    assert np.max(np.abs(run.velocity - reference.velocity)) <= 1e-5 * np.max(np.abs(reference.velocity))


def test_a_refused_scene_raises_before_anything_runs() -> None:
    with pytest.raises(UnsupportedScene, match="bca cannot do pair"):
        db.solve(replace(PAIR, gravity=9.81), backend="bca")


def test_what_is_available_is_said_for_every_backend() -> None:
    found = db.available()
    assert set(found) == set(BACKENDS)
    assert all(found[name].available for name in ("verlet", "scipy", "bca"))


def test_a_missing_engine_is_said_when_it_is_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    from dem_bridge.backends import lammps

    def missing(*_: object, **__: object) -> None:
        raise BackendUnavailable("the lammps module does not load; install it with: pip install lammps mpich")

    monkeypatch.setattr(lammps, "run_deck", missing)
    with pytest.raises(BackendUnavailable, match="pip install"):
        db.solve(PAIR, backend="lammps-granular")


# decks


def test_a_deck_is_written_into_a_new_folder_and_its_files_are_named(tmp_path: Path) -> None:
    folder = tmp_path / "new" / "folder"
    files = db.write_deck(PAIR, folder)
    assert files == (folder / "in.pair", folder / "data.pair")
    assert {file.name for file in folder.iterdir()} == {"in.pair", "data.pair"}


def test_a_deck_written_again_replaces_the_older_one(tmp_path: Path) -> None:
    db.write_deck(PAIR, tmp_path)
    db.write_deck(replace(PAIR, stiffness=(5e9,)), str(tmp_path))
    assert "beta = 5000000000.0" in (tmp_path / "in.pair").read_text()
    assert {file.name for file in tmp_path.iterdir()} == {"in.pair", "data.pair"}


def test_steps_samples_and_radius_of_a_deck_can_be_set(tmp_path: Path) -> None:
    deck, _ = db.write_deck(PAIR, tmp_path, dt=1e-6, samples=4, surrogate_radius=2.0**-12)
    text = deck.read_text()
    assert "variable dt          index 1e-06" in text
    assert "variable steps       index 100\n" in text
    assert f"surrogate radius R = {2.0**-12!r} m" in text


def test_the_step_of_a_deck_may_follow_from_an_accuracy(tmp_path: Path) -> None:
    coarse, _ = db.write_deck(PAIR, tmp_path / "coarse", accuracy=1e-3)
    fine, _ = db.write_deck(PAIR, tmp_path / "fine", accuracy=1e-7)
    steps = [int(file.read_text().split("steps       index ")[1].split()[0]) for file in (coarse, fine)]
    assert steps[1] > 10 * steps[0]


def test_an_unknown_style_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="style = 'lepton'; allowed: granular"):
        db.write_deck(PAIR, tmp_path, style="lepton")
    assert list(tmp_path.iterdir()) == []


def test_a_scene_that_the_style_cannot_express_writes_nothing(tmp_path: Path) -> None:
    walled = replace(PAIR, wall_left=Wall(stiffness=1e9, exponent=3.0))
    with pytest.raises(UnsupportedScene, match="exponent"):
        db.write_deck(walled, tmp_path / "new")
    assert not (tmp_path / "new").exists()


def test_a_full_disk_leaves_nothing_behind(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(self: Path, data: bytes) -> int:
        self.touch()
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(UsageError, match="No space left on device"):
        db.write_deck(PAIR, tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_all_files_of_a_deck_appear_or_none(tmp_path: Path) -> None:
    (tmp_path / "data.pair").mkdir()  # a folder is in the way of the second file
    with pytest.raises(UsageError, match=r"data\.pair: is not a regular file"):
        db.write_deck(PAIR, tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {"data.pair"}


def test_a_file_in_the_place_of_the_folder_is_refused_in_one_line(tmp_path: Path) -> None:
    (tmp_path / "taken").write_text("")
    with pytest.raises(UsageError, match="taken"):
        db.write_deck(PAIR, tmp_path / "taken")


def test_verify_asks_for_one_scene_or_more() -> None:
    with pytest.raises(UsageError, match=r"scenes = \[\]; allowed: one or more scenes, or 'paper'"):
        db.verify([])
