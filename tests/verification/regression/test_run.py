"""`dem-bridge regress` and `db.regress`: planted faults in files are found by name, and nothing is written unasked."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
from click.testing import CliRunner, Result

import dem_bridge as db
from dem_bridge.api.verification import engine_of, environment_of
from dem_bridge.cli import main
from dem_bridge.errors import BackendUnavailable, UsageError
from dem_bridge.verification.regression.compare import Change
from dem_bridge.verification.regression.run import Regression

CHAIN = """\
name = "small"
duration = 4.0e-4
[chain]
mass = [8.1e-3, 1.0e-2, 1.0e-2, 1.2e-2]
stiffness = [4.0e9, 5.0e9, 6.0e9]
velocity = [0.8, 0.0, 0.0, 0.0]
"""
Regress = Callable[..., Result]


@pytest.fixture
def home(tmp_path: Path) -> Path:
    """A folder with a scene and its baseline of the twin."""
    (tmp_path / "small.toml").write_text(CHAIN)
    made = db.regress(
        tmp_path / "small.toml", backends="verlet", baselines=tmp_path / "baselines", update=True, dt=1e-6
    )
    assert [one.change for one in made.comparisons] == [Change.NEW]
    return tmp_path


@pytest.fixture
def regress(home: Path) -> Regress:
    return lambda *words: CliRunner().invoke(main, ["regress", "--baselines", str(home / "baselines"), *words])


def _file(home: Path) -> Path:
    return home / "baselines" / "small.verlet.json"


def _edit(home: Path, change: Callable[[dict[str, Any]], object]) -> None:
    told = json.loads(_file(home).read_text())
    change(told)
    _file(home).write_text(json.dumps(told))


def _digit(value: float) -> float:
    """With another fourth digit."""
    text = repr(value)
    where = re.search(r"[1-9]", text)
    assert where is not None
    place = [k for k in range(where.start(), len(text)) if text[k].isdigit()][3]
    return float(text[:place] + str((int(text[place]) + 1) % 10) + text[place + 1 :])


def test_the_same_again(home: Path) -> None:
    [found] = db.regress(baselines=home / "baselines").comparisons
    assert (found.change, found.bitwise) == (Change.SAME, True)
    assert "still right" in found.sentence


@pytest.mark.parametrize(("body", "row"), [(0, 5), (3, 20), (1, 13)])
def test_one_digit_of_one_velocity_is_found_at_its_time_and_body(home: Path, body: int, row: int) -> None:
    def change(told: dict[str, Any]) -> None:
        column = told["bodies"][body]["velocity"]
        column[row] = _digit(column[row])

    before = json.loads(_file(home).read_text())
    _edit(home, change)
    found = db.regress(baselines=home / "baselines")
    [one] = found.comparisons
    [departure] = one.departures
    assert (one.change, found.exit_code) == (Change.CHANGED, 1)
    assert (departure.quantity, departure.body, departure.time) == ("velocity", body, before["time"][row])
    assert departure.after == before["bodies"][body]["velocity"][row]
    assert departure.count == 1
    assert any("was changed after the file was written" in note for note in one.notes)


@pytest.mark.parametrize("quantity", ["peak_force", "crossing_time"])
def test_one_digit_of_one_contact_is_found(home: Path, quantity: str) -> None:
    def change(told: dict[str, Any]) -> None:
        told["contacts"][2][quantity] = _digit(told["contacts"][2][quantity])

    _edit(home, change)
    [one] = db.regress(baselines=home / "baselines").comparisons
    [departure] = one.departures
    assert (one.change, departure.quantity, departure.body) == (Change.CHANGED, quantity, 2)


def test_a_reordered_and_a_truncated_file_are_refused_by_name(home: Path, regress: Regress) -> None:
    whole = _file(home).read_text()
    _edit(home, lambda told: told["bodies"].reverse())
    for text, words in (
        (_file(home).read_text(), "lines are in another order"),
        (whole[:-300], "the file is not JSON or is truncated"),
    ):
        _file(home).write_text(text)
        done = regress()
        assert done.exit_code == 2
        assert done.stdout == ""
        assert done.stderr.count("\n") == 1
        assert "small.verlet.json" in done.stderr
        assert words in done.stderr


def test_a_baseline_that_is_missing_is_new_and_not_written_unasked(home: Path, regress: Regress) -> None:
    _file(home).unlink()
    done = regress(str(home / "small.toml"), "--backend", "verlet", "--dt", "1e-6")
    assert done.exit_code == 0
    assert done.stdout.startswith("NEW ")
    assert not _file(home).exists()


def test_a_baseline_without_its_scene_is_gone(home: Path, regress: Regress) -> None:
    (home / "small.toml").unlink()
    done = regress()
    assert done.exit_code == 1
    assert done.stdout.startswith("GONE ")
    assert "the scene small no longer exists; restore it" in done.stdout
    assert _file(home).exists()


def test_a_changed_scene_is_changed_and_update_shows_and_writes_it(home: Path, regress: Regress) -> None:
    before = _file(home).read_text()
    (home / "small.toml").write_text(CHAIN.replace("5.0e9", "5.1e9"))
    assert regress().exit_code == 1
    assert _file(home).read_text() == before
    done = regress("--update")
    assert done.exit_code == 1
    assert "CHANGED" in done.stdout
    assert f"written: {_file(home)}" in done.stdout
    assert "note: scene" in done.stdout
    assert regress().exit_code == 0


def test_what_is_the_same_is_not_written_again(home: Path, regress: Regress) -> None:
    before = _file(home).read_text()
    assert "written" not in regress("--update").stdout
    assert _file(home).read_text() == before


def test_new_fixed_and_still_failing(home: Path, regress: Regress) -> None:
    whole, answer = _file(home).read_text(), home / "answer.json"

    def asked(*words: str) -> str:
        [one] = json.loads(answer.read_text())["comparisons"] if regress(*words, "--json", str(answer)) else []
        return str(one["since"])

    asked()
    _edit(home, lambda told: told["contacts"][0].update(peak_force=1.0))
    assert asked("--since", str(answer)) == "new"
    assert asked("--since", str(answer)) == "still failing"
    _file(home).write_text(whole)
    assert asked("--since", str(answer)) == "fixed"
    assert asked("--since", str(answer)) == ""


def test_junit_and_markdown_name_what_changed(home: Path, regress: Regress) -> None:
    _edit(home, lambda told: told["contacts"][1].update(peak_force=1.0))
    junit, summary = home / "junit.xml", home / "summary.md"
    assert regress("--junit", str(junit), "--markdown", str(summary)).exit_code == 1
    suite = ElementTree.parse(junit).getroot()
    assert suite.get("failures") == "1"
    failure = suite.find("testcase/failure")
    assert failure is not None
    assert "CHANGED: peak_force of contact 1" in str(failure.get("message"))
    text = summary.read_text()
    assert "### Regression: 1 CHANGED" in text
    assert "**CHANGED** small, `verlet`: peak_force of contact 1" in text
    table = [line for line in text.splitlines() if line.startswith("|")]
    assert len({line.count("|") for line in table}) == 1


def test_not_run_counts_only_where_it_was_asked_for_and_bisect_skips(home: Path, regress: Regress) -> None:
    # a binary that is no LAMMPS
    scene = str(home / "small.toml")
    words = (scene, "--lmp", "/bin/false", "--dt", "1e-6")
    named = regress(*words, "--backend", "lammps-granular")
    assert (named.exit_code, named.stdout[:7]) == (2, "NOT_RUN")
    assert regress(*words, "--backend", "lammps-granular", "--bisect").exit_code == 125
    unnamed = db.regress(scene, baselines=home / "none", lmp="/bin/false", dt=1e-6)
    assert unnamed.exit_code == 0
    changes = {one.backend: one.change for one in unnamed.comparisons}
    assert (changes["lammps-granular"], changes["verlet"]) == (Change.NOT_RUN, Change.NEW)


def test_bisect_says_bad_for_what_changed_and_skips_what_cannot_be_read(home: Path, regress: Regress) -> None:
    assert regress("--bisect").exit_code == 0
    _edit(home, lambda told: told["contacts"][0].update(peak_force=1.0))
    assert regress("--bisect").exit_code == 1
    _file(home).write_text("{")
    assert regress("--bisect").exit_code == 125


def test_exit_codes_in_the_order_in_which_they_win() -> None:
    from dem_bridge.verification.regression.compare import Comparison

    def code(*changes: Change) -> int:
        told = tuple(Comparison(scene="s", backend="verlet", change=one, sentence="") for one in changes)
        return Regression(comparisons=told, title="", texts={}).exit_code

    assert code(Change.SAME, Change.NEW, Change.NOT_RUN) == 0
    assert code(Change.SAME, Change.CHANGED) == 1
    assert code(Change.GONE) == 1
    assert code(Change.CHANGED, Change.BROKEN) == 3


def test_words_that_do_not_fit_are_refused(home: Path, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="the folder has no baselines"):
        db.regress(baselines=tmp_path / "none")
    with pytest.raises(UsageError, match="update and against"):
        db.regress(baselines=home / "baselines", update=True, against="/bin/false")
    with pytest.raises(UsageError, match="backend = 'nobody'"):
        db.regress(baselines=home / "baselines", backends="nobody")
    with pytest.raises(UsageError, match="schema = None"):
        db.regress(baselines=home / "baselines", since={})


def test_another_lammps_is_found_by_path_or_version(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DEM_BRIDGE_STORE", str(tmp_path))
    with pytest.raises(UsageError, match=r"--against 2024\.8\.29\.3\.0 --install"):
        engine_of("2024.8.29.3.0")
    python = environment_of("2024.8.29.3.0") / "bin" / "python"
    python.parent.mkdir(parents=True)
    python.symlink_to("/bin/true")
    assert engine_of("2024.8.29.3.0").python == python
    assert engine_of(python.parent.parent).python == python
    assert engine_of(python).python == python
    assert engine_of("/bin/false").lmp == Path("/bin/false")


@pytest.mark.lammps
def test_two_engines_on_the_same_decks(home: Path) -> None:
    found = db.regress(
        home / "small.toml",
        baselines=home / "none",
        backends="lammps-granular",
        against=sys.executable,
        dt=1e-6,
    )
    [one] = found.comparisons
    assert (one.change, one.bitwise) == (Change.SAME, True)
    assert "the same decks with LAMMPS 2" in found.title
    with pytest.raises(BackendUnavailable, match="/bin/false is not LAMMPS: with -help it ended"):
        db.regress(home / "small.toml", baselines=home / "none", against="/bin/false", dt=1e-6)


@pytest.mark.lammps
def test_a_lammps_with_another_stiffness_is_changed_and_wrong_where_the_contact_is(home: Path) -> None:
    binary = home / "lmp_faulty"
    own = Path(sys.executable).with_name("lmp")
    binary.write_text(
        '#!/bin/sh\nfor word; do case "$word" in in.*) sed -i "s/hertz 1536/hertz 1689/" "$word";; esac; done\n'
        f'exec "{own}" "$@"\n'
    )
    binary.chmod(0o755)
    found = db.regress(
        home / "small.toml",
        baselines=home / "none",
        backends="lammps-granular",
        against=sys.executable,
        lmp=binary,
        dt=1e-6,
    )
    [one] = found.comparisons
    assert (one.change, found.exit_code) == (Change.CHANGED, 1)
    assert "now wrong" in one.sentence
    assert {departure.quantity for departure in one.departures} == {"velocity", "peak_force", "crossing_time"}
    # body 2 is the first that contact 2 pushes against, one sample after the strike
    first = one.departures[0]
    assert (first.quantity, first.body, first.time) == ("velocity", 2, pytest.approx(2e-5))


def test_the_committed_baselines_are_whole() -> None:
    from dem_bridge.verification.regression.baseline import read_baseline

    files = sorted((Path(__file__).parents[3] / "reports" / "baselines").glob("*.json"))
    assert {read_baseline(file).scene for file in files} >= {"decelerating-40", "accelerating-40"}
    for file in files:
        found = read_baseline(file)
        assert found.edited == ()
        assert db.load_scene(found.scene).content_hash == found.provenance["scene_hash"]
        assert file.read_text(encoding="utf-8") == found.text()
