"""The JSON Schema of scene files accepts what is shipped and written, and refuses what the reader refuses."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path
from typing import Any

import pytest

import dem_bridge as db
from dem_bridge.cli.scene_files import FORMS, template
from dem_bridge.errors import SceneError
from dem_bridge.scene.file import parse_scene
from dem_bridge.scene.file.editor_schema import SCHEMA_FILE, scene_schema
from dem_bridge.scene.file.write import scene_toml
from tests.helpers.command_line import assert_one_line, run_here

jsonschema = pytest.importorskip("jsonschema")

SCENES = Path(db.__file__).parent / "scenes"
SHIPPED = sorted(SCENES.rglob("*.toml"))
SCHEMA = scene_schema()


def errors(text: str) -> list[Any]:
    return list(jsonschema.Draft202012Validator(SCHEMA).iter_errors(tomllib.loads(text)))


def test_the_schema_is_one_and_has_one_alternative_for_each_form() -> None:
    jsonschema.Draft202012Validator.check_schema(SCHEMA)
    assert len(SCHEMA["anyOf"]) == len(FORMS) == 5
    # every key and every table has a name that is defined
    assert {form["$ref"].rpartition("/")[2] for form in SCHEMA["anyOf"]} < set(SCHEMA["$defs"])


@pytest.mark.parametrize("file", SHIPPED, ids=lambda file: file.stem)
def test_shipped_scenes_are_valid(file: Path) -> None:
    assert errors(file.read_text(encoding="utf-8")) == []


def test_there_are_shipped_scenes_of_several_forms() -> None:
    assert len(SHIPPED) == len(db.shipped_scenes("all"))


@pytest.mark.parametrize("form", FORMS)
def test_templates_are_valid_and_name_the_schema_where_editors_look(form: str) -> None:
    text = template(form, "own")
    assert text.splitlines()[0] == f"#:schema ./{SCHEMA_FILE}"
    assert errors(text) == []


def test_a_scene_that_is_written_is_valid_and_may_name_its_schema() -> None:
    text = scene_toml(db.load_scene("decelerating-40"))
    assert errors(text) == []
    assert errors(f'schema = "dem-bridge/scene/1"\n{text}') == []
    assert errors(f'schema = "dem-bridge/scene/2"\n{text}') != []


RAW = template("raw", "own")
WRONG = {
    "an unknown key": RAW.replace("velocity =", "velocities ="),
    "an unknown table": RAW + "\n[friction]\ncoefficient = 0.1\n",
    "a missing key": RAW.replace("\nduration", "\n# duration"),
    "a text for a number": RAW.replace("duration = 2.0e-4", 'duration = "2.0e-4"'),
    "a number for a list": RAW.replace("velocity = [0.8, 0.0, 0.0, 0.0, 0.0]", "velocity = 0.8"),
    "a negative mass": RAW.replace("mass = [8.1e-3", "mass = [-8.1e-3"),
    "a negative duration": RAW.replace("duration = 2.0e-4", "duration = -2.0e-4"),
    "a law that is none": RAW + '\n[chain.damping]\nlaw = "velocity"\ncoefficient = 1.0\n',
    "a share of a sample": RAW.replace("\ncount = ", "\ncount = 0.5 # "),
    "two forms at once": RAW.replace("[chain]", "[material]\nyoungs_modulus = 1e9\n[chain]", 1),
    "a truth for a wall": template("impact", "own").replace("wall = false", "wall = 1"),
    "an angle beyond 90 degrees": template("cylinders", "own").replace("last_angle = ", "last_angle = 10"),
}


@pytest.mark.parametrize("what", WRONG)
def test_what_the_reader_refuses_by_its_keys_and_types_the_schema_refuses(what: str) -> None:
    text = WRONG[what]
    with pytest.raises(SceneError, match="; allowed: "):
        parse_scene(text)
    assert errors(text) != []


def test_numbers_of_entries_are_left_to_the_reader() -> None:
    text = RAW.replace("mass = [8.1e-3, ", "mass = [")
    assert errors(text) == []
    with pytest.raises(SceneError, match="entries"):
        parse_scene(text)


def test_the_command_prints_the_schema_or_writes_it(tmp_path: Path) -> None:
    done = run_here("schema", cwd=tmp_path)
    assert (done.returncode, json.loads(done.stdout)) == (0, SCHEMA)
    assert run_here("schema", "-o", "a.json", cwd=tmp_path).returncode == 0
    assert json.loads((tmp_path / "a.json").read_text(encoding="utf-8")) == SCHEMA
    again = run_here("schema", "-o", "a.json", cwd=tmp_path)
    assert again.returncode == 2
    assert_one_line(again, "the file exists", "--force")
