"""A scene written as text is the same scene when it is read again: to the last digit, and in every part."""

from __future__ import annotations

from dataclasses import fields, replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dem_bridge.errors import UnsupportedScene
from dem_bridge.scene.drive import Drive
from dem_bridge.scene.file import load_scene, parse_scene, shipped_scenes
from dem_bridge.scene.file.write import scene_toml
from dem_bridge.scene.scene import Adhesion, Damping, Scene, Wall
from tests.helpers.random_scenes import DRAWS, drawn
from tests.helpers.strategies import ANY, HALVES, damped_scenes, examples, scenes

WHOLE = Scene(
    name="whole",
    description='"quoted" \\ back, Grüße, € 5 #not a comment',
    duration=1.0000000000000002e-3,
    mass=(1e-3, 0.1, 1e16),
    stiffness=(1e8, 3.0000000000000004e9),
    velocity=(0.8, -0.0, -1e-9),
    exponent=(2.5, 2.1),
    wall_left=Wall(stiffness=1e9, exponent=2.25),
    wall_right=Wall(stiffness=3e9),
    gravity=-9.81,
    precompression=10.0,
    damping=Damping(law="dashpot", coefficient=(0.0, 1.0, 2.0, 0.3)),
    drag=0.5,
    drive=Drive(shape="chirp", force=0.1, frequency=1e3, last_frequency=3e3, sweep=1.1e-3, phase=-30.0, rise=1e-4),
    samples=7,
    spacing=0.018,
)


def _same(scene: Scene) -> None:
    again = parse_scene(scene_toml(scene))
    assert again == scene
    assert again.content_hash == scene.content_hash


def test_every_part_of_a_scene_is_written() -> None:
    """A part added to Scene later, and forgotten in the text, is at its default here."""
    default = Scene(name="bare", duration=1.0, mass=(1.0,), stiffness=(), velocity=(0.0,))
    parts = [f.name for f in fields(Scene) if f.init and f.compare and f.name not in ("law", "gap", "adhesion")]
    assert [name for name in parts if getattr(WHOLE, name) == getattr(default, name)] == []
    _same(WHOLE)
    apart = replace(WHOLE, precompression=0.0, gap=(1e-6, -2e-7))
    _same(apart)
    # adhesion is refused beside precompression and a clip
    assert WHOLE.damping is not None
    free = replace(WHOLE.damping, clip=False)
    _same(replace(apart, damping=free, adhesion=Adhesion(law="dmt", pull_off=(0.1, 0.0, 0.0, 0.0))))
    _same(default)


@pytest.mark.parametrize("name", shipped_scenes())
def test_shipped_scenes_survive_their_text(name: str) -> None:
    _same(load_scene(name))


@examples(60)
@given(st.one_of(scenes(exponents=ANY, walls=True, gravity=True), damped_scenes(exponents=HALVES)))
def test_any_scene_survives_its_text(scene: Scene) -> None:
    _same(scene)


@pytest.mark.parametrize("draw", DRAWS[:40])
def test_scenes_with_decades_between_their_bodies_survive_their_text(draw: int) -> None:
    _same(drawn(draw))


def test_a_law_that_is_a_function_is_no_text() -> None:
    scene = Scene(
        name="own", duration=1e-4, mass=(1e-2, 1e-2), stiffness=(4e9,), velocity=(1.0, 0.0), law=lambda d: 4e9 * d**1.5
    )
    with pytest.raises(UnsupportedScene, match="own has a contact whose law is a function"):
        scene_toml(scene)
