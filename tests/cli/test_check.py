"""`dem-bridge check`: entries in lines of 80 columns, JSON, a page, exit codes, and its cost."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from tests.helpers.checked_decks import script
from tests.helpers.command_line import assert_one_line, run_here

pytestmark = pytest.mark.lammps


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("check")
    (folder / "in.coarse").write_text(script(per_contact=10.0))
    (folder / "in.fine").write_text(script())
    (folder / "no.csv").write_text("1,2\n")
    return folder


def entries(text: str) -> dict[str, str]:
    """Return the entries of an answer by their names: a line that begins with blanks continues the one before."""
    assert all(len(line) <= 80 for line in text.splitlines() if "  # line" not in line)
    joined = re.sub(r"\n {11}", " ", text).splitlines()
    return {line[:11].strip(): line[11:] for line in joined}


def test_a_coarse_step_is_answered_in_eight_entries_with_a_page(folder: Path) -> None:
    done = run_here("check", "in.coarse", "-o", "page", cwd=folder)
    assert done.returncode == 1
    said = entries(done.stdout)
    assert list(said) == ["FAIL", "write", "law", "step", "release", "plausible", "page"]
    assert said["FAIL"].startswith("The step is too coarse: at 3.5e-06 s velocities are wrong by 1.6 %")
    assert said["write"].split("  #")[0] == "timestep 7.022e-07"
    assert re.search(r"; \S+ s gives 0.1 %, \S+ s gives 1e-4 \(measured\), unstable above", said["step"])
    assert re.fullmatch(r"dem-bridge: check of in.coarse: 2 to 6 s of CPU time\n", done.stderr)
    page = (folder / "page" / "index.html").read_text()
    assert {path.name for path in (folder / "page").iterdir()} >= {"index.html", "check.json", "figures", "tables"}
    assert "timestep 7.022e-07" in page
    assert "run 300" in (folder / "page" / "corrected" / "in.coarse").read_text()
    assert not re.search(r'(src|href)="https?:', page)  # nothing is loaded from elsewhere
    body = re.sub(r"<(script|style)[\s\S]*?</\1>", "", page)
    for part in ("The step is too coarse", "law", "plausible", "no known defect"):  # without its script
        assert part in body
    data = json.loads((folder / "page" / "check.json").read_text())
    assert (data["schema"], data["outcome"], data["advice"][0][:18]) == (
        "dem-bridge/check/1",
        "FAIL",
        "timestep 7.022e-07",
    )
    # the script with the lines written is right
    again = run_here("check", "page/corrected/in.coarse", "--json", cwd=folder)
    assert (again.returncode, json.loads(again.stdout)["outcome"]) == (0, "PASS")


def test_json_and_exit_codes_are_those_of_the_contract(folder: Path) -> None:
    done = run_here("check", "in.fine", "--json", "--accuracy", "1e-5", cwd=folder)
    data = json.loads(done.stdout)
    assert (done.returncode, data["outcome"], data["step"]["accuracy"]) == (1, "FAIL", 1e-5)
    assert list(data) == ["outcome", "law", "step", "engine", "recorded", "ties", "plausibility", "advice", "notes"]
    assert run_here("check", "in.fine", cwd=folder).returncode == 0


def test_wrong_use_is_one_line(folder: Path) -> None:
    done = run_here("check", "no.csv", cwd=folder)
    assert done.returncode == 2
    assert_one_line(done, "neither a LAMMPS input script nor a scene file")
    judged = run_here("judge", "in.fine", cwd=folder)
    assert judged.returncode == 2
    assert_one_line(judged, "in.fine is a LAMMPS input script; write: dem-bridge check in.fine")


def test_verify_takes_an_input_script_and_a_step(folder: Path) -> None:
    words = ("in.coarse", "--accuracy", "1e-3", "-j", "1", "--force")
    coarse = run_here("verify", *words, "--dt", "3.5e-6", "-o", "coarse", cwd=folder)
    assert coarse.returncode == 1
    verdicts = json.loads((folder / "coarse" / "verdicts.json").read_text())["verdicts"]
    [velocity] = [
        v
        for v in verdicts
        if (v["quantity"], v["backend"], v["reference"]) == ("velocity", "lammps-granular", "reference")
    ]
    assert 5e-3 < velocity["difference"] < 0.017  # as the check finds it, at fewer samples
    assert run_here("verify", *words, "-o", "chosen", cwd=folder).returncode in (0, 4)
    paper = run_here("verify", "paper", "--dt", "1e-7", "-o", "paper", cwd=folder)
    assert paper.returncode == 2
    assert_one_line(paper, "dt = 1e-07 was given for 'paper'")


@pytest.mark.parametrize(
    ("old", "new", "why"),
    [
        (
            "pair_style granular",
            "pair_style table linear 1000",
            "`pair_style table linear 1000` reads forces from a file",
        ),
        ("hertz/material 2e+11 0 0.3", "jkr 2e+11 0 0.3 0.05", "has the normal model jkr, which is not supported"),
    ],
)
def test_a_law_that_is_not_read_is_named_with_its_line_and_is_not_called_wrong(
    old: str, new: str, why: str, folder: Path
) -> None:
    text = script().replace(old, new, 1)
    assert text != script()
    (folder / "in.unread").write_text(text)
    line = next(number for number, line in enumerate(text.splitlines(), 1) if new.strip() in line)
    done = run_here("check", "in.unread", "--json", cwd=folder)
    law = json.loads(done.stdout)["law"]
    [problem] = law["unsupported"]
    assert problem.startswith(f"line {line}: ")
    assert why in problem
    assert law["outcome"] != "FAIL"
    assert law["difference"] is None
