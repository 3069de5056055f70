"""Drives in scene files: keys, measured forces, and every mistake in one line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dem_bridge.errors import SceneError
from dem_bridge.scene.drive import Drive
from dem_bridge.scene.file import load_scene, parse_scene
from dem_bridge.scene.file.measured_force import read_force
from dem_bridge.scene.file.write import scene_toml
from tests.helpers.driven_chains import DRIVES, TOUCHING, driven
from tests.scene.file.test_load import PHYSICAL, RAW

SINE = '[chain.drive]\nshape = "sine"\nforce = 2.0\nfrequency = 4e3\nphase = 30.0\nrise = 2e-4\n'
CHIRP = '[chain.drive]\nshape = "chirp"\nforce = 2\nfrequency = 1e3\nlast_frequency = 8e3\n'
TABLE = '[chain.drive]\nshape = "table"\nforce = [0, 1.5, -0.5]\ninterval = 5e-4\n'
FILE = '[chain.drive]\nshape = "table"\nfile = "force.csv"\n'


def _driven(text: str, drive: str) -> str:
    """The scene file with a drive."""
    return f"{text}{drive}"


def test_each_shape_stands_in_a_file() -> None:
    assert parse_scene(_driven(RAW, SINE)).drive == Drive(
        shape="sine", force=2.0, frequency=4000.0, phase=30.0, rise=2e-4
    )
    assert parse_scene(_driven(RAW, TABLE)).drive == Drive(shape="table", force=(0.0, 1.5, -0.5), interval=5e-4)
    assert parse_scene(RAW).drive is None


def test_a_physical_file_may_be_driven_too() -> None:
    assert parse_scene(_driven(PHYSICAL, SINE)).drive == parse_scene(_driven(RAW, SINE)).drive


def test_a_chirp_sweeps_for_the_duration_unless_it_is_told_for_how_long() -> None:
    whole, half = parse_scene(_driven(RAW, CHIRP)), parse_scene(_driven(RAW, CHIRP + "sweep = 5e-4\n"))
    assert isinstance(whole.drive, Drive)
    assert isinstance(half.drive, Drive)
    assert (whole.drive.sweep, half.drive.sweep) == (whole.duration, 5e-4)


@pytest.mark.parametrize("shape", DRIVES)
def test_a_drive_survives_its_text(shape: str) -> None:
    scene = driven(TOUCHING, shape)
    again = parse_scene(scene_toml(scene))
    assert again == scene
    assert again.content_hash == scene.content_hash


# measured forces


def _csv(folder: Path, text: str) -> Path:
    (folder / "force.csv").write_text(text, encoding="utf-8")
    (folder / "scene.toml").write_text(_driven(RAW, FILE), encoding="utf-8")
    return folder / "scene.toml"


@pytest.mark.parametrize(
    "text",
    [
        "0,0\n5e-4,1.5\n1e-3,-0.5\n",
        "time [s],force [N]\r\n0.0, 0.0\r\n0.0005, 1.5\r\n0.001, -0.5\r\n",
        "\ufefft,F\n\n0,0\n5e-4,1.5\n\n1e-3,-0.5",
    ],
    ids=["numbers alone", "headings", "a mark and blank lines"],
)
def test_a_measured_force_is_read_beside_its_scene(text: str, tmp_path: Path) -> None:
    scene = load_scene(_csv(tmp_path, text))
    assert scene.drive == Drive(shape="table", force=(0.0, 1.5, -0.5), interval=5e-4)
    # the text of the scene has the values themselves
    assert parse_scene(scene_toml(scene)) == scene


def test_times_with_few_digits_are_even(tmp_path: Path) -> None:
    time = np.arange(1001) / 3e5
    path = tmp_path / "force.csv"
    path.write_text("".join(f"{t:.9f},{f:.3f}\n" for t, f in zip(time, np.sin(time * 1e4), strict=True)))
    force, interval = read_force(path)
    assert (len(force), interval) == (1001, pytest.approx(1.0 / 3e5, rel=1e-6))


WRONG_ROWS = {
    "a time is missing": (
        "0,0\n1e-4,1\n3e-4,1\n4e-4,1\n5e-4,1\n",
        "0.0003 s in line 3, 0.0002 s after the line before",
    ),
    "a time goes back": ("0,0\n1e-4,1\n0.5e-4,1\n2e-4,1\n3e-4,1\n", "5e-05 s in line 3"),
    "it begins late": ("t,F\n1e-4,0\n2e-4,1\n3e-4,1\n", "begins at 0.0001 s in line 2"),
    "all at once": ("0,0\n0,1\n0,2\n", "0 s in line 2, 0 s after"),
    "a word within": ("0,0\n1e-4,zebra\n2e-4,1\n", "not two finite numbers (line 2); allowed: rows of two numbers"),
    "a third column": ("0,0,1\n1e-4,1,1\n", "a row that is not two finite numbers (line 2)"),
    "no number": ("0,0\n1e-4,nan\n", "a row that is not two finite numbers (line 2)"),
    "one force": ("t,F\n0,0\n", "has 1 forces; allowed: at least 2"),
    "nothing": ("", "has 0 forces"),
    "too short for the scene": ("0,0\n1e-4,1\n2e-4,1\n", "chain.drive.force ends at 0.0002 s"),
}


@pytest.mark.parametrize(("text", "said"), WRONG_ROWS.values(), ids=WRONG_ROWS)
def test_a_wrong_row_is_named_in_one_line(text: str, said: str, tmp_path: Path) -> None:
    path = _csv(tmp_path, text)
    with pytest.raises(SceneError) as caught:
        load_scene(path)
    message = str(caught.value)
    assert said in message
    assert message.startswith(f"{path}: chain.drive.")
    assert "\n" not in message
    assert "zebra" not in message, "a message quotes no content of a file of another kind"
    if "s in line" in said:
        assert "equally spaced from 0; resample the file" in message


def test_a_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    (tmp_path / "scene.toml").write_text(_driven(RAW, FILE))
    with pytest.raises(SceneError, match=r"chain\.drive\.file = '.*force\.csv' cannot be read: "):
        load_scene(tmp_path / "scene.toml")


def test_a_file_without_folder_stands_in_the_current_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    _csv(tmp_path, "0,0\n1e-3,1\n")
    monkeypatch.chdir(tmp_path)
    assert parse_scene(_driven(RAW, FILE)) == parse_scene(_driven(RAW, FILE), folder=tmp_path)


WRONG_KEYS = {
    "an unknown shape": (
        SINE.replace("sine", "saw"),
        "chain.drive.shape = 'saw'; allowed: 'constant', 'sine', 'chirp' or 'table'",
    ),
    "an unknown key": (
        SINE + "amplitude = 2.0\n",
        "chain.drive.amplitude is an unknown key; allowed: shape, force, velocity, file",
    ),
    "no shape": (SINE.replace('shape = "sine"\n', ""), "chain.drive.shape is missing"),
    "no force": (SINE.replace("force = 2.0\n", ""), "chain.drive.force is missing; allowed: a number (N)"),
    "no values": (TABLE.replace("force = [0, 1.5, -0.5]\n", ""), "or a file"),
    "a text for a number": (SINE.replace("4e3", '"4e3"'), "chain.drive.frequency = '4e3'; allowed: a number"),
    "a key of another shape": (SINE + "sweep = 1e-3\n", "chain.drive.sweep does not apply to shape = 'sine'"),
    "no interval": (TABLE.replace("interval = 5e-4\n", ""), "chain.drive.interval is missing"),
    "a table too short": (TABLE.replace("5e-4", "4e-4"), "chain.drive.force ends at 0.0008 s"),
    "a file beside a force": (FILE + "force = [0.0, 1.0]\n", "chain.drive.force cannot be combined with file"),
    "a file beside an interval": (FILE + "interval = 1e-3\n", "chain.drive.interval cannot be combined with file"),
    "a file for a sine": (FILE.replace("table", "sine"), "chain.drive.file cannot be combined with shape = 'sine'"),
    "a file that is a number": (FILE.replace('"force.csv"', "1"), "chain.drive.file = 1; allowed: a string"),
    "no table": ("[chain.drive]\n", "chain.drive.shape is missing"),
}


@pytest.mark.parametrize(("drive", "said"), WRONG_KEYS.values(), ids=WRONG_KEYS)
def test_a_mistake_in_a_drive_is_named_in_one_line(drive: str, said: str) -> None:
    with pytest.raises(SceneError) as caught:
        parse_scene(_driven(RAW, drive), where="bad.toml")
    assert said in str(caught.value)
    assert str(caught.value).startswith("bad.toml: ")
    assert "\n" not in str(caught.value)
