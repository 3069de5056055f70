"""The command of a study prints its answer and its tables, and refuses bad settings in one line."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.helpers.command_line import assert_one_line, run_here
from tests.helpers.export_chains import CROSSED_FILE


def test_a_study_prints_its_answer_and_its_tables_and_says_where_it_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("DEM_BRIDGE_STORE", str(tmp_path / "store"))
    (tmp_path / "crossed.toml").write_text(CROSSED_FILE)
    words = ("study", "scatter", "crossed.toml", "--count", "3", "--spread", "0.5", "--seed", "4", "-j", "1")
    done = run_here(*words, "-v", "-o", "found", cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    written = json.loads((tmp_path / "found/scatter.json").read_text())
    shown = " ".join(done.stdout.split())
    for sentence in written["answer"]:
        assert f"* {sentence}" in shown
    [row] = written["tables"]["scatter"]
    assert (row["chain"], row["chains"], row["angle (degrees)"]) == ("crossed_4", 3, 0.5)
    assert f"{row['arrival at the end: mean shift (%)']:.4g} {row['its deviation (%)']:.4g}" in shown
    assert done.stdout.splitlines()[-1] == "written: found/index.html, with its tables, figures and scatter.json"
    again = run_here(*words, "--json", cwd=tmp_path)
    assert (again.returncode, again.stderr, json.loads(again.stdout)) == (0, "", written)


@pytest.mark.parametrize(
    ("words", "parts"),
    [
        (("tapered-forward",), ("tapered-forward has no contact angles", "allowed: a scene in physical form")),
        (("decelerating-40", "--spread", "0"), ("spread = 0.0", "allowed: a number of degrees > 0")),
        (("decelerating-40", "--spread", "-1"), ("spread = -1.0",)),
        (("decelerating-40", "--spread", "nan"), ("spread = nan",)),
        (("decelerating-40", "--count", "1"), ("count = 1", "from 2 to 100000")),
        (("decelerating-40", "--seed", "-1"), ("seed = -1", "allowed: a whole number >= 0")),
        (("nowhere.toml",), ("nowhere.toml",)),
    ],
)
def test_a_scatter_that_cannot_be_is_one_line_and_exit_code_2(
    words: tuple[str, ...], parts: tuple[str, ...], tmp_path: Path
) -> None:
    done = run_here("study", "scatter", *words, cwd=tmp_path)
    assert done.returncode == 2
    assert_one_line(done, *parts)
    assert list(tmp_path.iterdir()) == []
