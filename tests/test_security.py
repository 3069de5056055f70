"""What SECURITY.md promises of files from strangers: they are read as data, and nothing in them is executed."""

from __future__ import annotations

import os
import pickle
from pathlib import Path

import numpy as np
import pytest

import dem_bridge as db
from dem_bridge.errors import DemBridgeError, SceneError
from dem_bridge.scene.file import parse_scene
from tests.helpers.command_line import run_here
from tests.helpers.fake_runs import CHAIN


class Harm:
    """An object that makes a folder when it is unpickled."""

    def __init__(self, mark: Path) -> None:
        self.mark = mark

    def __reduce__(self) -> tuple[object, tuple[str]]:
        return os.mkdir, (str(self.mark),)


def test_the_harm_is_done_where_a_pickle_is_loaded(tmp_path: Path) -> None:
    pickle.loads(pickle.dumps(Harm(tmp_path / "mark")))
    assert (tmp_path / "mark").exists()


@pytest.mark.parametrize("ending", ["npz", "npy", "nc", "traj", "csv", "dump", "xyz", "vtk"])
def test_no_reader_loads_a_pickle(tmp_path: Path, ending: str) -> None:
    file, mark = tmp_path / f"run.{ending}", tmp_path / "mark"
    if ending == "npz":
        np.savez(file, t=np.array([Harm(mark)], dtype=object), v=np.array([Harm(mark)], dtype=object))
    elif ending == "npy":
        np.save(file, np.array([Harm(mark)], dtype=object))
    else:
        file.write_bytes(pickle.dumps(Harm(mark)))
    scene = parse_scene(CHAIN)
    for read in (
        db.load_trajectory,
        lambda path: db.read_trajectory(path, scene),
        lambda path: db.judge([path], scene),
    ):
        with pytest.raises(DemBridgeError) as refused:
            read(file)
        assert "\n" not in str(refused.value)
    assert not mark.exists()


@pytest.mark.parametrize(
    "line",
    ["shell mkdir {mark}", "python f here \"import os; os.mkdir('{mark}')\"", "include {mark}", "jump {mark}"],
)
def test_an_input_script_that_is_imported_is_not_executed(tmp_path: Path, line: str) -> None:
    mark = tmp_path / "mark"
    script = tmp_path / "in.chain"
    script.write_text(f"units si\natom_style sphere\n{line.format(mark=mark)}\nrun 10\n")
    done = run_here("import", "deck", str(script), "-o", str(tmp_path / "out.toml"), cwd=tmp_path)
    assert (done.returncode, mark.exists(), (tmp_path / "out.toml").exists()) == (2, False, False)


@pytest.mark.parametrize("name", ["../../evil", "/etc/evil", "a\\nshell mkdir b", "$(x)", "-o"])
def test_a_name_of_a_scene_is_no_path_and_no_command(name: str) -> None:
    with pytest.raises(SceneError, match="name = "):
        parse_scene(CHAIN.replace('"small"', f'"{name}"'))


def _commands(source: str, folder: Path) -> list[str]:
    db.write_deck(parse_scene(source), folder, dt=1e-8)
    lines = (folder / "in.small").read_text(encoding="utf-8").splitlines()
    return [line for line in lines if line and not line.startswith("#")]


@pytest.mark.parametrize("text", ["& ", "${x} $(1/0) &", "# shell mkdir b"])
def test_a_description_adds_no_command_to_a_deck(tmp_path: Path, text: str) -> None:
    described = CHAIN.replace("duration", f'description = "{text}"\nduration', 1)
    assert _commands(described, tmp_path / "b") == _commands(CHAIN, tmp_path / "a")


@pytest.mark.parametrize("text", ["x\\nshell mkdir b", '\\"\\"\\"\\n', "\\u2028shell mkdir b", "\\r"])
def test_a_description_of_several_lines_is_refused(text: str) -> None:
    with pytest.raises(SceneError, match="description"):
        parse_scene(CHAIN.replace("duration", f'description = "{text}"\nduration', 1))


def test_the_command_of_a_code_is_run_without_a_shell(tmp_path: Path) -> None:
    (tmp_path / "small.toml").write_text(CHAIN)
    words = (
        "judge",
        "--scene",
        "small.toml",
        "--dt",
        "1e-7",
        "--command",
        f"false {{out.csv}} ; mkdir {tmp_path}/mark",
    )
    done = run_here(*words, cwd=tmp_path)
    assert done.returncode != 0
    assert not (tmp_path / "mark").exists()
