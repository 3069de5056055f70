"""Each feature has a small scene on which it changes the motion clearly."""

from __future__ import annotations

import numpy as np
import pytest

from dem_bridge.backends.base import BACKENDS, supports_of
from dem_bridge.scene.features import (
    DASHPOT,
    DRAG,
    FEATURES,
    FIELDS,
    GRADED_EXPONENTS,
    JKR,
    NOT_CLIPPED,
    OTHER_EXPONENTS,
    Feature,
)
from dem_bridge.scene.support import Exponents, Support
from dem_bridge.testing import ExactPair, example, plain_scene
from dem_bridge.testing.checks import TOLERANCE
from dem_bridge.testing.examples import EXAMPLES
from tests.conftest import Solve

every_feature = pytest.mark.parametrize("feature", FEATURES, ids=lambda feature: feature.label)
FULL = supports_of("scipy")
#: features that a backend supports
SOLVED = [feature for feature in FEATURES if any(feature in supports_of(name).features for name in BACKENDS)]


def test_every_feature_has_an_example() -> None:
    assert set(EXAMPLES) == set(FEATURES)


def test_every_feature_but_jkr_adhesion_has_a_backend() -> None:
    assert [feature for feature in FEATURES if feature not in SOLVED] == [JKR]


@pytest.mark.parametrize("feature", SOLVED, ids=lambda feature: feature.label)
def test_a_feature_that_is_ignored_would_be_seen(feature: Feature, solved: Solve) -> None:
    scene = example(feature, FULL)
    assert scene is not None
    assert feature in scene.features
    code = next(name for name in ("scipy", *BACKENDS) if supports_of(name).covers(scene))
    run, plain = (solved(one, code, uncertainty=False) for one in (scene, plain_scene(3)))
    assert np.max(np.abs(run.velocity - plain.velocity)) > 5.0 * TOLERANCE * np.max(np.abs(run.velocity))


@every_feature
def test_an_example_has_no_feature_beside_its_own(feature: Feature) -> None:
    others = {GRADED_EXPONENTS: {OTHER_EXPONENTS}, NOT_CLIPPED: {DASHPOT}}.get(feature, set())
    scene = example(feature, Support({feature, *others}))
    assert scene is not None
    assert scene.features == {feature, *others}


@every_feature
def test_an_example_changes_a_field_of_its_feature(feature: Feature) -> None:
    scene, plain = example(feature, FULL), plain_scene(3)
    fields = [name.removeprefix("Scene.") for name in FIELDS if name.startswith("Scene.") and feature in FIELDS[name]]
    assert any(getattr(scene, field) != getattr(plain, field) for field in fields)


def test_exponents_of_examples_are_those_that_are_supported() -> None:
    hooke = Support({OTHER_EXPONENTS, GRADED_EXPONENTS}, exponents=Exponents(values=(2.0, 2.5)))
    steep = Support({OTHER_EXPONENTS}, exponents=Exponents(values=(3.0,)))
    for support, feature, exponents in (
        (hooke, OTHER_EXPONENTS, (2.0, 2.0)),
        (hooke, GRADED_EXPONENTS, (2.5, 2.0)),
        (steep, OTHER_EXPONENTS, (3.0, 3.0)),
        (steep, FEATURES[0], (3.0, 3.0)),
    ):
        scene = example(feature, support)
        assert scene is not None
        assert scene.exponent == exponents


def test_a_feature_that_the_conditions_exclude_has_no_example() -> None:
    pair = Support(set(), conditions=ExactPair.supports.conditions)
    assert example(GRADED_EXPONENTS, pair) is None
    assert example(DRAG, pair) == example(DRAG, Support({DRAG}, conditions=ExactPair.supports.conditions))
