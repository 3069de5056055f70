"""A deck that is judged: samples of the dump that is added, words on differences, comparison with the twin."""

from __future__ import annotations

import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from dem_bridge.judging import deck, limits
from dem_bridge.scene import Scene

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


def test_a_file_is_compared_with_the_twin_at_equal_times_alone() -> None:
    twin = np.zeros((SCENE.samples + 1, 2))
    times = np.linspace(0.0, SCENE.duration, SCENE.samples + 1)
    for shift, difference in ((0.0, 0.25), (1e-7, math.nan)):  # s; a hundredth of a sample is another time
        part = SimpleNamespace(error=np.full((SCENE.samples, 1), 0.25), columns=(1,))
        file: Any = SimpleNamespace(quantities={"velocity": part}, record=SimpleNamespace(time=times[1:] + shift))
        assert limits._difference_from_twin(SCENE, file, twin) == pytest.approx(difference, nan_ok=True)


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


def test_limits_are_in_the_order_of_their_effects_then_unknown_ones_then_those_without() -> None:
    effects = [0.0, math.nan, 1e-3, 2.0]
    found = sorted((limits.Limit(what="", found="", effect=effect, advice="") for effect in effects), key=limits._place)
    assert [str(limit.effect) for limit in found] == ["2.0", "0.001", "nan", "0.0"]


@pytest.mark.parametrize(("difference", "left"), [(0.05, 0.03), (0.01, 0.0)])
def test_what_the_radius_explains_is_not_left_to_other_causes(
    monkeypatch: pytest.MonkeyPatch, difference: float, left: float
) -> None:
    velocities = {("reference", None): 1.0, ("verlet", None): 1.1, ("verlet", 1e-3): 1.12}
    monkeypatch.setattr(
        limits, "_velocity", lambda scene, backend, dt=None, radius=None: np.array([[velocities[backend, radius]]])
    )
    monkeypatch.setattr(limits, "_difference_from_twin", lambda scene, errors, twin: difference)
    run: Any = SimpleNamespace(dt=1e-7, deck=SimpleNamespace(radius=1e-3))
    found = {limit.what: limit.effect for limit in limits._of_numerics(SCENE, run, cast(Any, None))}
    assert found == pytest.approx({"time step": 0.1, "particle radius": 0.02, "neither time step nor radius": left})
