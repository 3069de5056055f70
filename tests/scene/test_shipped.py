"""The list of the shipped scenes, which is read from the texts of their files, has the numbers of the scenes."""

from __future__ import annotations

import re
import tomllib

import pytest

import dem_bridge as db
from dem_bridge.scene.file import parse_scene
from dem_bridge.scene.shipped import count_bodies, file_of_shipped, listed_scenes


def test_the_list_has_the_numbers_of_the_scenes() -> None:
    scenes = map(db.load_scene, db.shipped_scenes("all"))
    assert [(s.name, s.n_body, s.duration, s.description) for s in scenes] == [tuple(line) for line in listed_scenes()]


@pytest.mark.parametrize("changes", ["", "[chain.pattern.decorate]\nshape = 'sphere'\nradius = 1e-3\nevery = 3"])
def test_the_bodies_of_a_pattern_with_a_step_are_counted(changes: str) -> None:
    cell = "shape = 'sphere'\nradius = 9e-3"
    text = f"""
name = "p"
duration = 1e-3
[materials.m]
youngs_modulus = 72e9
poissons_ratio = 0.2
density = 2200.0
[chain.pattern]
repeat = 5
[[chain.pattern.cell]]
{cell}
[chain.pattern.step]
from = 2
[[chain.pattern.step.cell]]
{cell}
[[chain.pattern.step.cell]]
{cell}
{changes}
"""
    scene = parse_scene(text)
    assert scene.n_body == count_bodies(tomllib.loads(text)) == (10 if changes else 8)


def _text(name: str) -> str:
    file = file_of_shipped(name)
    assert file is not None
    return file.read_text(encoding="utf-8")


@pytest.mark.parametrize(
    "name", [n for n in db.shipped_scenes("benchmark") if "four elastic contact times" in _text(n)]
)
def test_a_duration_of_four_contact_times_is_that_of_a_file_without_it(name: str) -> None:
    text = re.sub(r"^duration = .*\n", "", _text(name), count=1, flags=re.MULTILINE)
    assert parse_scene(text) == db.load_scene(name)
