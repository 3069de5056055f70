"""Restitution of impacts: codes agree with closed forms, and a wrong law, mass or clip is found under its name."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import pytest

import dem_bridge as db
from dem_bridge.errors import UsageError
from dem_bridge.observables.verdict import Outcome
from dem_bridge.physics.damped_impact import alpha_of_restitution, restitution_obtained
from dem_bridge.report.study import Study
from dem_bridge.runs import campaign
from dem_bridge.scene.scene import Scene
from dem_bridge.studies import restitution as module
from dem_bridge.studies.restitution import study_restitution
from dem_bridge.studies.restitution_impacts import (
    LAWS,
    USUAL,
    VARIED,
    bounce_cases,
    bounces_of,
    usual_impact,
    varied_impacts,
)


def rows(study: Study, table: str = "impacts") -> list[dict[str, Any]]:
    """Return the rows of a table by the names of its columns."""
    found = next(item for item in study.tables if item.id == table)
    return [dict(zip(found.columns, row, strict=True)) for row in found.rows]


@pytest.mark.parametrize("law", LAWS)
def test_the_usual_impact_has_its_restitution_by_direct_integration(law: str) -> None:
    for clip in (False, True):
        impact = usual_impact(law, clip)
        run = db.solve(impact.scene, backend="scipy", samples=2, uncertainty=False)
        assert (run.velocity[-1, 1] - run.velocity[-1, 0]) / impact.speed == pytest.approx(
            impact.theory()[0], abs=1e-11
        )
    # tsuji is a fit
    assert usual_impact(law, False).theory()[0] == pytest.approx(USUAL, abs=1e-4 if law == "tsuji" else 1e-13)


def test_all_laws_but_restitution_depend_on_the_impact() -> None:
    for law in LAWS:
        spread = {name: [impact.theory()[0] for impact in varied_impacts(law, name)] for name in VARIED}
        constant = {name for name, values in spread.items() if max(values) - min(values) < 1e-12}
        expected = {"dashpot": {"speed"}, "mass_velocity": {"speed"}, "kuwabara-kono": set()}
        assert constant == expected.get(law, set(VARIED)), law


def test_the_twin_has_the_restitution_of_the_closed_form() -> None:
    laws = ["coeff_restitution", "kuwabara-kono"]
    study = study_restitution(laws=laws, backends=["verlet"])
    names = {f"{law}, {clip}" for law in laws for clip in ("clipped", "not clipped")} | {"mfix-dem-02"}
    assert {(item.scene, item.outcome) for item in study.verdicts} == {(name, Outcome.PASS) for name in names}
    for row in rows(study):
        # a thousand steps in a contact time: less than a thousandth of the speed of approach
        assert abs(row["difference"]) <= row["uncertainty"] < 1.1e-3
    walls = [row for row in rows(study) if row["mass ratio"] == math.inf]
    assert len(walls) == 2
    assert "0.5 gives 0.5503" in study.answer[0]
    assert "the coefficient to write is 0.4363" in study.answer[0]
    assert study.answer[1].startswith("In 4 of 4 combinations")
    # three stiffnesses and three bounces each; softness falls as 1/sqrt(k), and errors of the twin are smaller
    heights = rows(study, "bounces")
    first = [row["soft - hard (%)"] for row in heights if row["bounce"] == 1]
    assert len(heights) == 9
    assert [first[0] / first[1], first[1] / first[2]] == pytest.approx([math.sqrt(10.0)] * 2, rel=0.05)
    assert all(abs(row["code - soft (m)"]) < 0.01 * row["soft sphere (m)"] for row in heights)
    for row in rows(study, "write"):
        assert restitution_obtained(row["coeff_restitution, clipped"], clip=True) == pytest.approx(
            row["wanted"], abs=1e-13
        )
    [figure] = study.figures
    assert len(figure.panels) == 5


def clipped_damping(scene: Scene) -> Scene:
    assert scene.damping is not None
    return replace(scene, damping=replace(scene.damping, clip=True))


def mass_for_effective_mass(scene: Scene) -> Scene:
    assert scene.damping is not None
    assert not isinstance(scene.damping.coefficient, float)
    alpha = alpha_of_restitution(scene.damping.coefficient[0]) * math.sqrt(2.0)
    ratio = alpha / math.sqrt(5.0)
    e = math.exp(-math.pi * ratio / math.sqrt(1.0 - ratio**2)) if ratio < 1.0 else 1e-6
    return replace(scene, damping=replace(scene.damping, coefficient=e))


def stiffness_of_a_pair_at_a_wall(scene: Scene) -> Scene:
    if scene.wall_right is None:
        return scene
    return replace(scene, wall_right=replace(scene.wall_right, stiffness=scene.wall_right.stiffness / math.sqrt(2.0)))


@pytest.mark.parametrize(
    ("law", "fault", "failing"),
    [
        ("coeff_restitution", clipped_damping, {"coeff_restitution, not clipped"}),
        (
            "coeff_restitution",
            mass_for_effective_mass,
            {"coeff_restitution, not clipped", "coeff_restitution, clipped"},
        ),
        ("mass_velocity", stiffness_of_a_pair_at_a_wall, {"mass_velocity, clipped"}),
    ],
)
def test_a_code_with_another_law_fails_under_its_name(
    law: str, fault: Any, failing: set[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The planted faults: forces are clipped, have the mass for the effective mass, or a wall has another contact."""
    honest = campaign.run_cases

    def wrong(cases: Any, **settings: Any) -> Any:
        return honest([replace(case, scene=fault(case.scene)) for case in cases], **settings)

    monkeypatch.setattr(module, "run_cases", wrong)
    study = study_restitution(laws=[law], backends=["verlet"])
    assert {item.scene for item in study.verdicts if item.outcome is Outcome.FAIL} - {"mfix-dem-02"} == failing
    assert study.exit_code == 1
    assert any(sentence.startswith("verlet departs from the law") for sentence in study.answer)


def test_heights_by_scipy_are_those_of_the_soft_sphere_and_not_of_the_hard_one() -> None:
    [soft, *_] = campaign.run_cases(bounce_cases(["scipy"], None)[:1])
    for bounce in bounces_of(soft.case.scene, soft):
        assert bounce.outcome is Outcome.PASS
        assert abs(bounce.error) < 1e-12
        # the planted fault: the hard sphere in the place of the soft one
        assert replace(bounce, soft=bounce.hard).outcome is Outcome.FAIL


@pytest.mark.slow
@pytest.mark.lammps
def test_the_defect_of_tsuji_in_lammps_is_found_and_named() -> None:
    study = study_restitution(laws=["tsuji"], backends=["lammps-granular"])
    named = [item.known_defect for item in study.verdicts]
    if study.exit_code == 0:  # a release that has mended it
        assert not any(named)
        return
    assert named == ["tsuji-prefactor"] * 2
    values = [row["restitution"] for row in rows(study) if row["law"] == "tsuji, not clipped"]
    # the numbers of the defect; the time step explains 2e-4
    assert values == pytest.approx([0.23501, 0.43960, 0.61608, 0.77767, 0.92836], abs=2e-4)
    accepting = study_restitution(laws=["tsuji"], backends=["lammps-granular"], known_defects="ok")
    assert accepting.exit_code == 0


@pytest.mark.parametrize(
    ("settings", "says"),
    [
        ({"laws": ["hooke"]}, r"laws = \['hooke'\]; allowed: some of dashpot, mass_velocity"),
        ({"known_defects": "maybe"}, r"known_defects = \['maybe'\]; allowed: some of fail, ok"),
        ({"laws": []}, r"laws = \[\]; allowed"),
        ({"backends": ["matlab"]}, r"backends = \['matlab'\]; allowed: some of lammps-granular"),
    ],
)
def test_a_law_or_a_code_that_does_not_exist_is_refused(settings: Any, says: str) -> None:
    with pytest.raises(UsageError, match=says):
        study_restitution(**settings)


def test_a_code_that_has_not_the_law_is_not_run() -> None:
    study = study_restitution(laws=["kuwabara-kono"], backends=["ase"])
    assert {item.outcome for item in study.verdicts} == {Outcome.NOT_RUN}
    assert all(item.sentence.startswith("ase did not run: ") for item in study.verdicts)
    assert study.exit_code == 0
    assert study.answer[1] == "No code was run, so that these are closed forms alone."
