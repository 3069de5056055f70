"""The scope of a verification states the ranges of its scenes and the counts of its verdicts."""

from __future__ import annotations

from dataclasses import replace

import pytest

import dem_bridge as db
from dem_bridge.observables.verdict import Outcome, Verdict
from dem_bridge.verification.assess import SceneStudy
from dem_bridge.verification.page import PARTS, scope
from dem_bridge.verification.roles import assign_roles
from dem_bridge.verification.verification import verification_of

VERDICT = Verdict(
    scene="s", quantity="velocity", backend="a", reference="b", outcome=Outcome.PASS, sentence="", difference=0.0
)


@pytest.mark.parametrize("outcome", [Outcome.PASS, Outcome.FAIL])
def test_the_scope_has_the_ranges_of_the_scenes_and_the_counts_of_the_verdicts(outcome: Outcome) -> None:
    scenes = [db.load_scene(name) for name in ("decelerating-40", "stacked-40", "homogeneous-spheres")]
    verdicts = (VERDICT, replace(VERDICT, outcome=outcome))
    studies = [SceneStudy(roles=assign_roles(scene), verdicts=verdicts) for scene in scenes]
    parts = dict(scope(verification_of(studies, accuracy=1e-5, wall=0.0)))
    assert len(parts) == len(PARTS)
    assert "Scenes: 3. Bodies: 41 to 101." in parts["Domain tested"]
    assert "gravity, precompression, walls" in parts["Domain tested"]
    assert "Exponent n: 2.5." in parts["Domain tested"]
    assert "1e-05 of the largest velocity" in parts["Tolerances fixed beforehand"]
    assert f"6, of which {6 if outcome is Outcome.PASS else 3} are PASS" in parts["Code verification"]
    assert "Error budgets: 0," in parts["Solution verification"]


def test_without_scenes_there_is_no_scope() -> None:
    assert scope(verification_of((), accuracy=1e-5, wall=0.0)) == ()
