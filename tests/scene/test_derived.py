"""What is derived from a scene is derived once, by each function and object, and never taken for another scene's."""

from __future__ import annotations

import pickle
from dataclasses import replace

import numpy as np
import pytest

from dem_bridge.backends.scales import resting_acceleration
from dem_bridge.lmp.pair_coefficients import line_order
from dem_bridge.scene.derived import derived
from dem_bridge.scene.features import DRAG
from dem_bridge.scene.scene import Scene, Wall
from dem_bridge.scene.support import Support


def _pair() -> Scene:
    return Scene(name="pair", duration=1e-4, mass=(1e-2, 2e-2), stiffness=(4e9,), velocity=(0.8, 0.0))


def test_a_value_is_derived_once_for_each_scene_and_not_sent_to_other_processes() -> None:
    calls: list[str] = []

    @derived
    def heaviest(scene: Scene) -> float:
        calls.append(scene.name)
        return max(scene.mass)

    pair = _pair()
    assert [heaviest(pair), heaviest(pair)] == [2e-2, 2e-2]
    other = replace(pair, name="other", mass=(3e-2, 2e-2))
    assert heaviest(other) == 3e-2
    copy = pickle.loads(pickle.dumps(pair))
    assert heaviest(copy) == 2e-2
    assert calls == ["pair", "other", "pair"]
    assert copy == pair


def test_two_declarations_of_support_decide_on_one_scene_each_for_itself() -> None:
    scene = replace(_pair(), drag=1.0)
    assert Support({DRAG}).covers(scene)
    assert not Support(frozenset()).covers(scene)
    assert Support({DRAG}).unsupported_reason(scene) is None


def test_arrays_that_are_kept_cannot_be_changed() -> None:
    scene = replace(_pair(), gravity=9.81, wall_left=Wall(stiffness=4e9, gap=0.0))
    assert line_order(scene).tolist() == [1, 0]
    for values in (line_order(scene), resting_acceleration(scene)):
        with pytest.raises(ValueError, match="read-only"):
            values[0] = 7
    assert np.all(resting_acceleration(scene) == 0.0)
