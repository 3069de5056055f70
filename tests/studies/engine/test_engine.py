"""The engine's defects are found, named and sized without a list of them; planted ones are, too."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import pytest

from dem_bridge.errors import UsageError
from dem_bridge.lmp.engine import Engine
from dem_bridge.lmp.known_defects import KnownDefect, defects_of
from dem_bridge.lmp.process import probe
from dem_bridge.observables.verdict import Outcome
from dem_bridge.physics.adhesion import jkr_impact
from dem_bridge.studies.engine import runs, study
from dem_bridge.studies.engine.impacts import HERTZ, Impact, Steps, catalogue, deck_of
from dem_bridge.studies.engine.motion import NOT_A_NUMBER, TOLERANCE, UNKNOWN, closed_form, exact, twins
from dem_bridge.studies.engine.study import ABSENT, RIGHT, UNDEFINED, WRONG, Row, rows_of, study_engine, study_of

PINNED = 20250722
#: converged restitution of damping tsuji in the pinned release, by what a deck writes
TSUJI = {0.1: 0.23501, 0.3: 0.43960, 0.5: 0.61608, 0.7: 0.77767, 0.9: 0.92836}
JKR = ("jkr-undamped-pair", "jkr-undamped-frozen", "jkr-undamped-wall", "jkr-velocity-wall")
NAMES = (
    *("hertz_material-tsuji-pair" + (f"-{e:g}" if e != 0.5 else "") for e in TSUJI),
    *JKR,
    "jkr-undamped-region",
    "classic-hooke_history-undamped-wall",
    "classic-hertz_history-undamped-region",
    "classic-hertz_history-mass_velocity-wall",
    "hooke-velocity-pair-clipped",
    "hertz-viscoelastic-frozen",
    "hertz_material-coeff_restitution-wall-clipped",
    "dmt-undamped-pair",
    "dmt-tsuji-wall",
    "hertz-none-pair",
)


@pytest.fixture(scope="module")
def few_steps() -> Iterator[None]:
    """A quarter of the steps; tolerances of LAMMPS beside the twin are the same."""
    with pytest.MonkeyPatch.context() as patch:
        for name, value in (("CONTACT_STEPS", 4000), ("STEPS", 4400), ("EVERY", 100)):
            patch.setattr(study, name, value)
        yield


def _impacts(*names: str) -> list[Impact]:
    by_name = {impact.name: impact for impact in catalogue()}
    return [by_name[name] for name in names]


def _rows(*names: str) -> dict[str, Row]:
    return dict(zip(names, rows_of(_impacts(*names), Engine(), PINNED), strict=True))


@pytest.fixture(scope="module")
def rows(few_steps: None) -> dict[str, Row]:
    """Impacts of the pinned release, judged without any list of defects."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(study, "defects_of", lambda version, deck: ())
        return _rows(*NAMES)


# theory: no LAMMPS


def test_closed_forms_integrals_and_the_twin_agree(few_steps: None) -> None:
    known = {impact.contact: impact for impact in catalogue() if study.defined(impact) and impact.damping != "none"}
    solutions = {contact: exact(contact) for contact in known}
    with_form = {contact: form for contact in known if np.isfinite(form := closed_form(contact))}
    assert len(with_form) > 60
    for contact, form in with_form.items():
        assert solutions[contact].restitution == pytest.approx(form, abs=1e-9), known[contact].name
    assert all(0.09 < solution.restitution <= 1.0 + 1e-9 for solution in solutions.values())
    steps = [study.steps_of(impact, solutions[contact]) for contact, impact in known.items()]
    for (contact, solution), run in zip(solutions.items(), twins(list(known), steps), strict=True):
        # first order: four times the error of the study
        assert run.restitution == pytest.approx(solution.restitution, abs=2e-4), known[contact].name


def test_the_catalogue_has_every_combination_once() -> None:
    names = [impact.name for impact in catalogue()]
    assert len(names) == len(set(names)) == 336
    assert set(NAMES) <= set(names)


# the pinned release


@pytest.mark.lammps
def test_three_defects_are_found_named_and_sized_without_a_list(rows: dict[str, Row]) -> None:
    for written, e in TSUJI.items():
        row = rows["hertz_material-tsuji-pair" + (f"-{written:g}" if written != 0.5 else "")]
        assert (row.state, row.cause) == (WRONG, "the damping lacks a factor sqrt(2)")
        assert row.restitution == pytest.approx(e, abs=2e-4)
    for name in JKR:
        assert (rows[name].state, rows[name].cause) == (WRONG, "the contact opens at its least force")
        # the force jumps where the contact opens: first order with 4000 steps
        c = rows[name].impact.contact
        if not c.damping:
            hit = jkr_impact(mass=c.mass, speed=c.speed, stiffness=c.stiffness, pull_off=c.pull_off, breaks_at="force")
            assert rows[name].restitution == pytest.approx(hit.restitution, abs=5e-4)
    region = rows["jkr-undamped-region"]
    assert (region.state, region.cause) == (WRONG, "the contact opens at overlap 0")
    for name in ("classic-hooke_history-undamped-wall", "classic-hertz_history-undamped-region"):
        assert (rows[name].state, rows[name].cause) == (WRONG, NOT_A_NUMBER)


@pytest.mark.lammps
def test_what_is_right_repeats_the_twin_and_what_is_not_there_has_the_engines_words(rows: dict[str, Row]) -> None:
    right = [row for row in rows.values() if row.state == RIGHT]
    assert [row.impact.name for row in right] == list(NAMES[-7:-2])
    assert all(row.difference < 0.2 * TOLERANCE for row in right)
    absent = {name: row.message for name, row in rows.items() if row.state == ABSENT}
    assert list(absent) == ["dmt-tsuji-wall", "hertz-none-pair"]
    assert "Cannot use tsuji model with a cohesive normal model, dmt" in absent["dmt-tsuji-wall"]
    assert "Must specify damping granular model" in absent["hertz-none-pair"]


@pytest.mark.lammps
def test_a_page_has_what_is_wrong_and_exits_with_1_unless_defects_are_accepted(rows: dict[str, Row]) -> None:
    unlisted = study_of(list(rows.values()), PINNED, known_defects="ok")
    assert unlisted.exit_code == 1
    listed = [replace(row, defects=defects_of(PINNED, row.run.deck), instead="x") for row in rows.values()]
    assert {row.names for row in listed if row.state == WRONG} == {
        "tsuji-prefactor", "jkr-breaks-early", "jkr-region-wall", "undamped-classic-wall",
    }  # fmt: skip
    assert [study_of(listed, PINNED, known_defects=word).exit_code for word in ("fail", "ok")] == [1, 0]
    shown = study_of(listed, PINNED)
    assert all(verdict.known_defect in verdict.sentence for verdict in shown.verdicts)
    assert "the damping lacks a factor sqrt(2)" in shown.answer[1]
    assert sum(verdict.outcome is Outcome.FAIL for verdict in shown.verdicts) == len(shown.tables[0].rows) == 4


@pytest.mark.lammps
def test_a_defect_that_has_gone_is_said_and_another_cause_has_no_name(rows: dict[str, Row]) -> None:
    planted = KnownDefect(
        name="gone", first=1, last=0, deck="x", cause="no cause", symptom="s", size="z", instead="i", upstream="u"
    )
    right, wrong = rows["hooke-velocity-pair-clipped"], rows["jkr-undamped-pair"]
    page = study_of([replace(row, defects=(planted,)) for row in (right, wrong)], PINNED, known_defects="ok")
    assert any(re.match("No impact shows the known defect gone", verdict.sentence) for verdict in page.verdicts)
    # the deck meets the listed defect, but what is wrong is something else
    assert page.exit_code == 1


# planted faults

#: cause -> impact, and what a deck has in place of the right words
FAULTS: dict[str, tuple[str, Callable[[Impact], tuple[str, str]]]] = {
    "the damping lacks a factor sqrt(2)": (
        "hertz-velocity-pair",
        lambda impact: (f"{impact.coefficient!r} tang", f"{impact.coefficient / np.sqrt(2.0)} tang"),
    ),
    "the damping has twice the effective mass": (
        "hooke-mass_velocity-pair",
        lambda impact: (f"{impact.coefficient!r} tang", f"{2.0 * impact.coefficient!r} tang"),
    ),
    "the damping has half the effective mass": ("hertz-mass_velocity-frozen", lambda impact: ("fix held", "# ")),
    "E* is twice as large, that of a rigid wall": (
        "hertz_material-coeff_restitution-wall",
        lambda impact: ("material 70000000000.0", "material 140000000000.0"),
    ),
    "E* is half as large": ("dmt-velocity-region", lambda impact: ("dmt 70000000000.0", "dmt 35000000000.0")),
    "the net force is not clipped": ("hertz-velocity-pair-clipped", lambda impact: (" limit_damping", "")),
    "the net force is clipped": (
        "hooke-viscoelastic-wall",
        lambda impact: ("damping viscoelastic", "damping viscoelastic limit_damping"),
    ),
    "the effective radius is twice as large": (
        "hertz-undamped-frozen",
        lambda impact: (f"hertz {HERTZ!r}", f"hertz {HERTZ * np.sqrt(2.0)}"),
    ),
    "the damping lacks a factor sqrt(2), and the net force is not clipped": (
        "hertz-viscoelastic-pair-clipped",
        lambda impact: (
            f"{impact.law_words}",
            impact.law_words.replace(f"{impact.coefficient!r}", f"{impact.coefficient / np.sqrt(2.0)}").replace(
                " limit_damping", ""
            ),
        ),
    ),
    UNKNOWN: ("hooke-undamped-pair", lambda impact: ("hooke 1000000.0", "hooke 1010000.0")),
}


@pytest.mark.lammps
def test_planted_faults_are_caught_under_their_names(few_steps: None, monkeypatch: pytest.MonkeyPatch) -> None:
    faults = {name: (cause, change) for cause, (name, change) in FAULTS.items()}

    def planted(impact: Impact, steps: Steps) -> str:
        old, new = faults[impact.name][1](impact)
        text = deck_of(impact, steps)
        assert old in text
        return text.replace(old, new)

    monkeypatch.setattr(runs, "deck_of", planted)
    found = {name: (row.state, row.cause) for name, row in _rows(*faults).items()}
    assert found == {name: (WRONG, cause) for name, (cause, _) in faults.items()}


def test_what_cannot_be_is_refused() -> None:
    with pytest.raises(UsageError, match="allowed: fail, ok"):
        study_engine(known_defects="maybe")
    with pytest.raises(UsageError, match="is in no name"):
        study_engine(match="friction")


@pytest.mark.lammps
@pytest.mark.slow
def test_every_impact_of_the_pinned_release_is_right_refused_or_a_known_defect() -> None:
    page = study_engine(known_defects="ok")
    states = [row[3] for row in next(table for table in page.tables if table.id == "impacts").rows]
    assert {state: states.count(state) for state in (RIGHT, WRONG, ABSENT, UNDEFINED)} == {
        RIGHT: 176, WRONG: 56, ABSENT: 104, UNDEFINED: 0,
    }  # fmt: skip
    assert page.exit_code == 0
    assert probe(Engine()).version == PINNED
