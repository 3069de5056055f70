"""A deck that is judged: samples of the dump that is added, words on differences, comparison with the twin."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from dem_bridge.judging import deck
from dem_bridge.scene.scene import Scene

SCENE = Scene(name="p", duration=1e-3, mass=(1e-2, 1e-2), stiffness=(4e9,), velocity=(1.0, 0.0), samples=50)


@pytest.mark.parametrize(
    ("dt", "steps", "every"),
    [
        (1e-6, 7777, 20),  # 1 ms / 50 samples = 20 us, whatever the deck runs
        (1e-3, 7777, 1),  # a step longer than a sample: every step
        (None, 7777, 155),  # no step is known: 50 frames of what the deck runs
        (None, 10, 1),
    ],
)
def test_frames_of_the_added_dump_are_those_of_the_scene(dt: float | None, steps: int, every: int) -> None:
    stated: Any = SimpleNamespace(dt=dt, state=SimpleNamespace(steps=steps))
    assert deck._every(stated, SCENE) == every


@pytest.mark.parametrize(
    ("ours", "theirs", "words"),
    [
        ((0.0, 0.0), (0.0, 2.0), "2 at 1; the scene has 0"),  # one of them is all 0
        ((0.0, 2.0), (0.0, 0.0), "0 at 1; the scene has 2"),
        ((1.0, 1.0), (1.0, 1.0 + 1e-15), ""),  # the last digit
        ((0.0,), (0.0,), ""),
        ((1e-6,), (1.001e-6,), "1.001e-06; the scene has 1e-06"),  # small numbers, too, differ relative to their size
        ((1.0,), (1.0, 1.0), "2 numbers; the scene has 1"),
        (3.0, 4.0, "4; the scene has 3"),
    ],
)
def test_what_differs_between_a_deck_and_the_scene_is_said(ours: object, theirs: object, words: str) -> None:
    assert deck._difference(ours, theirs) == words


def test_a_deck_is_told_from_a_dump_and_from_binary_files(tmp_path: Path) -> None:
    script = "units si\natom_style sphere\npair_style granular\nrun 10\n"
    for text, is_deck in (
        (script, True),
        (f"ITEM: TIMESTEP\n{script}", False),
        (f"{script}\0", False),
        ("1,2\n", False),
    ):
        (tmp_path / "file").write_text(text)
        assert deck.is_deck(tmp_path / "file") is is_deck
