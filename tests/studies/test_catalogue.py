"""Studies by name: what is asked of them, and the files that every one gets."""

from __future__ import annotations

import inspect
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

import dem_bridge as db
from dem_bridge.cli import main, terminal
from dem_bridge.cli.studies import study as group
from dem_bridge.errors import UsageError
from dem_bridge.studies import catalogue
from dem_bridge.studies.study import FigureData, Panel, Series, Study, Table
from dem_bridge.verification.verdict import Outcome


def small(*, outcome: Outcome = Outcome.PASS, interrupted: bool = False) -> Study:
    """A study with a part of each kind."""
    line = Series(label="twin", style="reference", x=np.array([1.0, 2.0]), y=np.array([0.5, 0.25]))
    panel = Panel(title="(a) one", x_label="dt (s)", y_label="error", series=(line,))
    return Study(
        id="small",
        title="A small study",
        answer=("It <is> so.",),
        tables=(Table(id="numbers", title="Numbers", caption="", columns=("who", "x"), rows=(("[a]", float("nan")),)),),
        figures=(FigureData(id="picture", title="Picture", caption="", panels=(panel,)),),
        outcomes=(outcome,),
        interrupted=interrupted,
    )


def of_scene(scene: Any, *, engine: Any, jobs: Any, progress: Any, store: Any, strength: float = 1.0) -> Study:
    return small(outcome=Outcome.FAIL if strength > 1.0 else Outcome.PASS)


def of_none(*, engine: Any, jobs: Any, progress: Any, store: Any) -> Study:
    return small(interrupted=True)


@pytest.fixture
def made_up(monkeypatch: pytest.MonkeyPatch) -> None:
    named = {"of-scene": (__name__, "of_scene"), "of-none": (__name__, "of_none")}
    monkeypatch.setattr(catalogue, "STUDIES", named)


def test_every_study_has_the_common_settings_a_command_and_says_what_it_does() -> None:
    for name in catalogue.STUDIES:
        found = catalogue.study_named(name)
        settings = set(inspect.signature(found).parameters)
        assert set(catalogue.COMMON) - {"scene"} <= settings, name
        assert found.__doc__
        assert name in group.commands


@pytest.mark.usefixtures("made_up")
@pytest.mark.parametrize(
    ("words", "settings", "said"),
    [
        (("nothing",), {}, "study = 'nothing'; allowed: of-scene, of-none"),
        (("of-scene",), {}, "is of a scene, and none is named"),
        (("of-none", "decelerating-40"), {}, "has scenes of its own, and 'decelerating-40' is named"),
        (("of-scene", "decelerating-40"), {"strengths": 2.0}, "setting 'strengths' of study 'of-scene' is unknown"),
    ],
)
def test_what_cannot_be_asked_is_said_in_one_line(words: Any, settings: Any, said: str) -> None:
    with pytest.raises(UsageError, match=said):
        db.study(*words, **settings)


@pytest.mark.usefixtures("made_up")
def test_a_study_is_written_as_page_json_tables_and_figures(tmp_path: Path) -> None:
    found = db.study("of-scene", "decelerating-40", folder=tmp_path, strength=2.0)
    assert found.exit_code == 1
    names = {"index.html", "small.json", "numbers.csv", "picture.csv", "picture.png"}
    assert {file.name for file in tmp_path.iterdir()} == names
    record = json.loads((tmp_path / "small.json").read_text())
    assert record["tables"]["numbers"] == [{"who": "[a]", "x": None}]
    page = (tmp_path / "index.html").read_text()
    assert "It &lt;is&gt; so." in page
    assert 'src="picture.png"' in page
    assert "Interrupted" not in page
    assert (tmp_path / "picture.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.usefixtures("made_up")
def test_what_was_interrupted_is_written_and_says_so(tmp_path: Path) -> None:
    assert db.study("of-none", folder=tmp_path).interrupted
    assert "Interrupted" in (tmp_path / "index.html").read_text()


def test_the_terminal_knows_all_outcomes(capsys: pytest.CaptureFixture[str]) -> None:
    assert set(terminal._OUTCOMES) == {outcome.value for outcome in Outcome}
    terminal.print_study(small())
    shown = capsys.readouterr().out
    assert "* It <is> so." in shown
    assert "[a]" in shown


def test_help_lists_every_study() -> None:
    shown = CliRunner().invoke(main, ["study", "--help"]).output
    assert all(name in shown for name in (*catalogue.STUDIES, "scatter", "styles"))
