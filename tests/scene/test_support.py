"""A declaration of support refuses whatever it does not list, by name and in one line."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from dem_bridge.backends.base import BACKENDS, backend, supports_of, unsupported_reason
from dem_bridge.scene.features import DRAG, FEATURES, GAPS, GRAVITY, OTHER_EXPONENTS, WALLS, Feature
from dem_bridge.scene.scene import Scene, Wall
from dem_bridge.scene.support import Condition, Exponents, Support
from tests.scene.test_features import PLAIN

SLOW = Condition(
    "body 0 is slower than 0.5 m/s",
    lambda scene: None if scene.velocity[0] < 0.5 else f"body 0 starts with {scene.velocity[0]:g} m/s",
)


@pytest.mark.parametrize(
    ("support", "changes", "reason"),
    [
        (Support(set()), {}, None),
        (Support(set()), {"drag": 1.0}, "the scene has drag; supported: no features beyond a struck chain of contacts"),
        (Support({GAPS, WALLS}), {"gap": 1e-6}, None),
        (Support({GAPS, WALLS}), {"gap": 1e-6, "drag": 1.0}, "the scene has drag; supported: walls and gaps"),
        (
            Support({GAPS}, scope="nothing is lost", instead="ase"),
            {"gravity": 1.0, "drag": 1.0, "wall_left": Wall(stiffness=1.0)},
            "the scene has walls, gravity and drag; nothing is lost; supported: gaps",
        ),
        (Support(set()), {"exponent": (2.5, 2.4)}, "the scene has exponents that differ between contacts;"
         " contact 1 has exponent n = 2.4; supported: no features beyond a struck chain of contacts;"
         " allowed exponents: 2.5"),
        (Support({OTHER_EXPONENTS}), {"exponent": 9.0}, None),
        (
            Support({OTHER_EXPONENTS}, exponents=Exponents(values=(2.0, 2.5, 3.0))),
            {"exponent": 2.4},
            "contact 0 has exponent n = 2.4; allowed exponents: 2, 2.5 and 3",
        ),
        (Support({OTHER_EXPONENTS}, exponents=Exponents(least=2.1, most=5.0)), {"exponent": 2.1}, None),
        (
            Support({OTHER_EXPONENTS}, exponents=Exponents(least=2.1, most=5.0)),
            {"exponent": 5.1},
            "contact 0 has exponent n = 5.1; allowed exponents: 2.1 to 5",
        ),
        (
            Support({DRAG}, conditions=(SLOW,)),
            {},
            "body 0 starts with 0.8 m/s; required: body 0 is slower than 0.5 m/s",
        ),
        (Support({DRAG}, conditions=(SLOW,)), {"velocity": (0.1, 0.0, 0.0), "drag": 1.0}, None),
    ],
)  # fmt: skip
def test_the_reason_names_what_was_found_and_what_is_supported(
    support: Support, changes: dict[str, Any], reason: str | None
) -> None:
    scene = replace(PLAIN, **changes)
    assert support.unsupported_reason(scene) == reason
    assert support.covers(scene) == (reason is None)


def test_a_feature_that_is_new_is_refused_by_every_backend(monkeypatch: pytest.MonkeyPatch) -> None:
    magnet = Feature("a magnet", "A constant force acts on each body.", lambda scene: scene.name == "magnetic")
    for module in ("scene", "support"):
        monkeypatch.setattr(f"dem_bridge.scene.{module}.FEATURES", (*FEATURES, magnet))
    scene = replace(PLAIN, name="magnetic")
    for name in BACKENDS:
        assert not supports_of(name).covers(scene)
        reason = unsupported_reason(backend(name), scene)
        assert reason is not None
        assert reason.startswith("the scene has a magnet; ")
        assert reason.endswith("; no backend supports this scene")


@pytest.mark.parametrize("name", BACKENDS)
def test_the_backend_that_is_recommended_supports_the_scene(name: str) -> None:
    """Each feature that is missing, alone and with an exponent that few backends have."""
    for scene in (PLAIN, replace(PLAIN, exponent=1.5), replace(PLAIN, exponent=2.4)):
        for changes in ({"drag": 1.0}, {"law": lambda overlap: 4e9 * overlap**1.5}, {"gravity": 1.0}, {"gap": 1e-6}):
            other: Scene = replace(scene, **changes)
            reason = unsupported_reason(backend(name), other)
            assert (reason is None) == supports_of(name).covers(other)
            if reason is not None:
                assert "\n" not in reason
                recommended = reason.rpartition("use backend = ")[2].strip("'")
                assert supports_of(recommended).covers(other)


def test_gravity_alone_is_what_a_theory_refuses() -> None:
    assert supports_of("bca").unsupported_reason(replace(PLAIN, gravity=9.81)) == (
        "the scene has gravity; binary collisions describe a single pulse into a free chain of touching bodies at rest;"
        " supported: exponents other than 5/2 and exponents that differ between contacts"
    )
    assert GRAVITY not in supports_of("bca").features


def test_every_feature_but_jkr_adhesion_is_supported_by_a_backend() -> None:
    # a scene may state JKR adhesion, and every backend refuses it by name
    supported = {feature for name in BACKENDS for feature in supports_of(name).features}
    assert [feature.label for feature in FEATURES if feature not in supported] == ["JKR adhesion"]
