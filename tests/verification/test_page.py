"""The page of a verification: its scope has ranges and counts, and its pictures are begun before they are shown."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import pytest

import dem_bridge as db
from dem_bridge.observables.verdict import Outcome, Verdict
from dem_bridge.report.study import Claim
from dem_bridge.verification import pictures
from dem_bridge.verification.assess import SceneStudy
from dem_bridge.verification.budget import Budget
from dem_bridge.verification.page import PARTS, scope, verification_files
from dem_bridge.verification.pictures import pictures_shown
from dem_bridge.verification.roles import assign_roles
from dem_bridge.verification.verification import verification_of

VERDICT = Verdict(
    scene="s", quantity="velocity", backend="a", reference="b", outcome=Outcome.PASS, sentence="", difference=0.0
)

PARTS_OF_ERROR = dict.fromkeys(("time step", "table", "round-off", "sampling", "reference"), 1e-12)
BUDGET = Budget(
    quantity="velocity", found=1e-6, parts=PARTS_OF_ERROR, unexplained=0.0, allowed=1e-12, scale_name="largest"
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


@pytest.mark.parametrize("paper", [False, True])
def test_all_pictures_of_the_page_are_begun_before_the_first_is_awaited(
    paper: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    scenes = [db.load_scene(name) for name in ("decelerating-40", "accelerating-40", "homogeneous-spheres")]
    refined = {"verlet": ([2e-8, 1e-8], [1e-5, 1e-6])}
    verdict = replace(VERDICT, backend="lammps-granular", reference="verlet")
    studies = [
        SceneStudy(roles=assign_roles(scene), verdicts=(verdict,), refinement=levels, budgets=budgets)
        for scene, levels, budgets in zip(scenes, (refined, refined, {}), ((BUDGET,), (), (BUDGET,)), strict=True)
    ]
    claim = Claim(id="C", where="", statement="", outcome=Outcome.PASS, sentence="", kind="holds")
    study = replace(verification_of(studies, accuracy=1e-5, wall=0.0), claims=(claim,) if paper else ())
    events: list[tuple[str, ...]] = []

    def begin(name: str, shown: Sequence[SceneStudy], store: object) -> Callable[[], str]:
        picture = (name, *(item.scene.name for item in shown))
        events.append(("begun", *picture))

        def wait() -> str:
            events.append(("awaited", *picture))
            return "<svg></svg>"

        return wait

    monkeypatch.setattr(pictures, "begin_picture", begin)
    verification_files(study)
    expected = [(name, *(item.scene.name for item in shown)) for name, shown in pictures_shown(study)]
    assert events[: len(expected)] == [("begun", *picture) for picture in expected]
    assert sorted(events[len(expected) :]) == sorted(("awaited", *picture) for picture in expected)
    # of the paper the scenes without levels have no figures of their own, and their maps are in its figures
    assert len(expected) == (1 + 1 if paper else 3 + 2 + 3 * 2)
