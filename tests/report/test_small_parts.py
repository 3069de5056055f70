"""Small multiples, axes without positive values, tables of a regression and a replay: what is shown of them."""

from __future__ import annotations

import json
import re
import subprocess
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure as Canvas

from dem_bridge.report import svg
from dem_bridge.report.drawing import draw_figure
from dem_bridge.report.drawing_styles import scale_together
from dem_bridge.report.page import csv_texts
from dem_bridge.report.study import FigureData, Map, Panel, Series, Study, Table
from dem_bridge.verification import replay
from dem_bridge.verification.regression.compare import Change
from dem_bridge.verification.regression.shown import lines, tally


def _panel(*series: Series, **settings: Any) -> Panel:
    return Panel(title="(a) a title", x_label="x", y_label="y", series=series, **settings)


def _line(*y: float) -> Series:
    return Series(label="twin", style="reference", x=np.arange(float(len(y))), y=np.array(y))


def test_small_multiples_have_no_axes_and_no_files() -> None:
    values = Map(label="v (m/s)", x=np.array([0.0, 1.0]), y=np.array([0.0, 1.0]), values=np.eye(2))
    data = FigureData(id="small", title="", caption="", columns=2, small=True, panels=(
        _panel(_line(1.0, 2.0)), _panel(map=values), _panel(_line(3.0, 2.0), _line(1.0, 1.0))))  # fmt: skip
    figure = draw_figure(data)
    assert [len(ax.lines) for ax in figure.axes] == [1, 0, 2]
    assert [len(ax.get_xticks()) + len(ax.get_yticks()) for ax in figure.axes] == [0, 0, 0]
    assert csv_texts(data) == {}


@pytest.mark.parametrize(
    ("panel", "low", "high"),
    [
        (_panel(_line(-1.0, -2.0), log_y=True), 0.0, 1.0),  # no positive value: the axis stays as it was
        (_panel(_line(0.0, 0.0)), -1.0, 1.0),
    ],
)
def test_an_axis_without_an_extent_has_one(panel: Panel, low: float, high: float) -> None:
    ax = Canvas().add_subplot()
    scale_together([ax], [panel])
    bottom, top = ax.get_ylim()
    assert bottom == pytest.approx(low, abs=0.13)
    assert top == pytest.approx(high, abs=0.13)


def test_two_parts_of_a_study_with_one_name_are_refused() -> None:
    table = Table(id="numbers", title="", caption="", columns=("x",), rows=())
    study = Study(id="twice", title="", answer=(), tables=(table, table), figures=())
    with pytest.raises(ValueError, match=r"study twice: two parts have the file name tables/numbers\.csv; allowed: di"):
        study.page_files()


def test_an_empty_regression_is_a_line() -> None:
    empty: Any = SimpleNamespace(comparisons=())
    assert lines(empty) == [tally(empty)] == ["nothing was compared"]
    assert Change.SAME.value == "SAME"


def _bundle(folder: Path) -> Path:
    """Return a bundle whose report has no verdicts."""
    record = {"schema": "dem-bridge/verdicts/1", "verdicts": [], "claims": [], "provenance": {"runs": []}}
    (folder / "report").mkdir()
    (folder / "report" / "verdicts.json").write_text(json.dumps(record))
    (folder / "bundle.json").write_text(json.dumps({"verify": ["pair"], "not_replayed": [], "files": {}}))
    return folder


@pytest.mark.parametrize("written", [True, False])
def test_a_replay_reads_what_the_program_wrote(
    written: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def run(words: list[str], *, cwd: Path, **_: Any) -> Any:
        assert words[1:] == ["-m", "dem_bridge.cli", "verify", "pair", "-j", "1", "-o", "again"]
        if written:
            (cwd / "again").mkdir()
            (cwd / "again" / "verdicts.json").write_text((cwd / "report" / "verdicts.json").read_text())
        return SimpleNamespace(returncode=3)

    monkeypatch.setattr(subprocess, "run", run)
    monkeypatch.setattr(replay, "altered", lambda here: ["source/a.py"])
    code = replay.repeat(_bundle(tmp_path), ["-j", "1"])
    shown = capsys.readouterr()
    if written:
        assert code == 1
        assert shown.out.split("\n")[1] == "CHANGED       source/a.py differs from the file of the bundle"
        assert "0 SAME, 1 CHANGED, 0 NOT REPLAYED. New report: again/index.html" in shown.out
    else:
        assert (code, shown.out) == (2, "")
        assert shown.err == "replay: dem-bridge verify ended with exit code 3 and wrote no verdicts\n"


def test_markers_of_two_styles_keep_their_own_and_those_of_one_share_it() -> None:
    pattern, group = r"(?s)<g( id=.a.)>\n(.*)</g>", '<g id="a">\n<use style="fill: {}"/>\n<use style="fill: {}"/>\n</g>'
    mixed = group.format("red", "blue")
    assert re.sub(pattern, svg._of_group, mixed) == mixed
    shared = re.sub(pattern, svg._of_group, group.format("red", "red"))
    assert shared == '<g id="a" style="fill: red">\n<use/>\n<use/>\n</g>'
