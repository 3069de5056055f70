"""Known defects are recognised in decks and releases, and named where a verdict fails for them."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from click.testing import CliRunner

import dem_bridge as db
from dem_bridge.cli import main
from dem_bridge.lmp.known_defects import KnownDefect, defects_of, known_defects
from dem_bridge.observables.verdict import Outcome, Verdict
from dem_bridge.report.study import Study
from dem_bridge.scene.file.write import scene_toml
from dem_bridge.verification.assess import named_failures

PINNED = 20250722
PAIR = db.Scene(name="pair", duration=1e-4, mass=(8e-3, 1e-2), stiffness=(4e9,), velocity=(0.8, 0.0))
#: lines of decks that meet a defect, and nearly the same lines that do not
DECKS = {
    "tsuji-prefactor": (
        "pair_coeff 1 1 hertz 1e9 0.5 tangential linear_nohistory 0 0 damping tsuji",
        "pair_coeff 1 1 hertz 1e9 0.5 damping velocity # not damping tsuji",
    ),
    "undamped-classic-wall": (
        "fix w all wall/gran hooke/history 1e6 NULL 0.0 NULL 0 0 xplane 0 NULL",
        "fix w all wall/gran hooke/history 1e6 NULL 0.5 NULL 0 0 xplane 0 NULL",
    ),
    "jkr-breaks-early": ("fix w all wall/gran granular &\n jkr 1e9 0 0.3 1 zplane 0 NULL", "group jkr type 1"),
    "jkr-region-wall": (
        "fix w all wall/gran/region granular jkr 1e9 0 0.3 1 region r",
        "fix w all wall/gran/region granular dmt 1e9 0 0.3 1 region r",
    ),
    "zero-restitution": (
        "pair_coeff * * hertz/material 7e10 0 0.33 tangential linear_nohistory 0 0 damping coeff_restitution",
        "pair_coeff * * hertz/material 7e10 0.5 0.33 tangential linear_nohistory 0 0 damping coeff_restitution",
    ),
    "restart-neighbour-cutoff": ("  read_restart a.restart", "read_restart a.restart\npair_style granular"),
    "grazing-wall-energy": (
        "fix w all wall/gran hooke/history 1e6 NULL 4 NULL 0.5 0 xplane 0 NULL",
        "fix w all wall/gran hooke/history 1e6 NULL 4 NULL 0 1 xplane 0 NULL",
    ),
}
#: the same for releases before the pinned one
OLD, OLD_DECKS = 20210929, {
    "wall-modulus": (
        "fix w all wall/gran/region granular hertz/material 1e9 0 0.3 tangential linear_nohistory 0 0 region r",
        "fix w all wall/gran/region granular hertz 1e9 0 tangential linear_nohistory 0 0 region r",
    ),
    "jkr-wall-nan": ("fix w all wall/gran granular jkr 1e9 0 0.3 1 xplane 0 NULL", "pair_coeff 1 1 dmt 1e9 0 0.3 1"),
}  # fmt: skip


def test_each_defect_is_recognised_in_a_deck_and_only_there() -> None:
    assert [defect.name for defect in known_defects()] == [*DECKS, *OLD_DECKS]
    for name, (meets, avoids) in OLD_DECKS.items():
        assert name in [defect.name for defect in defects_of(OLD, meets)]
        assert defects_of(OLD, avoids) == ()
        assert name not in [defect.name for defect in defects_of(PINNED, meets)]
    for name, (meets, avoids) in DECKS.items():
        assert [defect.name for defect in defects_of(PINNED, meets)] == [name]
        assert defects_of(PINNED, avoids) == ()
    assert not any(defect.met_by(text) for defect in known_defects() for text in _golden())


def _golden() -> list[str]:
    decks = sorted(Path(__file__).parents[2].glob("lammps_inputs/*/in.*"))
    assert len(decks) == 4
    return [deck.read_text(encoding="utf-8") for deck in decks]


def test_a_defect_has_a_range_of_releases() -> None:
    tsuji = known_defects()[0]
    assert [tsuji.affects(version) for version in (20200101, PINNED, 20260727, 20260801)] == [False, True, True, False]
    still = next(defect for defect in known_defects() if defect.last == 0)
    assert still.affects(20990101)


def _verdict(outcome: Outcome, backend: str = "lammps-granular") -> Verdict:
    return Verdict(
        scene="pair", quantity="velocity", backend=backend, reference="reference", outcome=outcome, sentence="velocity."
    )


def _named(names: list[str], *verdicts: Verdict) -> list[Verdict]:
    run: Any = SimpleNamespace(provenance={"lammps": {"known_defects": names}})
    return list(named_failures("pair", "lammps-granular", run, verdicts))


def test_a_failure_has_the_name_of_the_defect_and_counts_unless_defects_are_accepted() -> None:
    failed, other, again = _named(["tsuji-prefactor"], *map(_verdict, (Outcome.FAIL, Outcome.PASS, Outcome.FAIL)))
    assert again.sentence == "Known defect tsuji-prefactor: velocity."
    assert re.match(r"Known defect tsuji-prefactor: .*write damping coeff_restitution.*: velocity\.", failed.sentence)
    assert failed.as_json()["known_defect"] == "tsuji-prefactor"
    assert "known_defect" not in other.as_json()
    study = Study(id="verify", title="", answer=(), verdicts=(failed, other, again))
    assert [replace(study, known_defects=word).exit_code for word in ("fail", "ok")] == [1, 0]


def test_no_other_failure_is_explained_by_a_defect() -> None:
    for names, verdict in (([], _verdict(Outcome.FAIL)), (["tsuji-prefactor"], _verdict(Outcome.FAIL, "verlet"))):
        (first, *_) = _named(names, verdict)
        assert first == verdict
    study = Study(id="verify", title="", answer=(), verdicts=(first,))
    assert replace(study, known_defects="ok").exit_code == 1


def test_a_defect_that_does_not_show_is_said_too() -> None:
    *_, last = _named(["tsuji-prefactor"], _verdict(Outcome.PASS))
    assert (last.quantity, last.outcome) == ("known defect", Outcome.PASS)
    assert "shows the known defect tsuji-prefactor" in last.sentence


@pytest.mark.lammps
def test_a_run_names_the_defects_that_its_deck_meets(monkeypatch: pytest.MonkeyPatch) -> None:
    from dem_bridge.backends import lammps

    planted = KnownDefect(
        name="planted", first=1, last=0, deck="hertz", cause="", symptom="s", size="z", instead="i", upstream="u"
    )
    monkeypatch.setattr(lammps, "defects_of", lambda version, deck: (planted,) * planted.met_by(deck))
    run = db.solve(PAIR, backend="lammps-granular", dt=1e-6, uncertainty=False)
    assert run.provenance["lammps"]["known_defects"] == ["planted"]
    assert "known defect planted" in run.provenance["lammps"]["note"]


@pytest.mark.slow
@pytest.mark.lammps
def test_verify_of_a_scene_that_meets_a_defect_fails_with_its_name(tmp_path: Path) -> None:
    scene = replace(PAIR, duration=4e-5, damping=db.Damping(law="tsuji", coefficient=0.5), samples=10)
    (tmp_path / "pair.toml").write_text(scene_toml(scene), encoding="utf-8")
    codes = {}
    for word in ("fail", "ok"):
        words = ["verify", str(tmp_path / "pair.toml"), "--accuracy", "1e-3", "-o", str(tmp_path / "report")]
        done = CliRunner().invoke(main, [*words, "--known-defects", word])
        codes[word] = done.exit_code
        said = " ".join(done.stdout.split())
        assert "LAMMPS has a known defect, tsuji-prefactor: damping tsuji dissipates too little" in said
        assert "Write: damping coeff_restitution" in said
        assert "largest step" not in said  # no step mends a wrong law
        assert "unexplained" not in said
    assert codes == {"fail": 1, "ok": 0}
