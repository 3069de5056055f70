"""`dem-bridge judge`: files in, text and JSON out, exit codes, and one line for wrong use."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import dem_bridge as db
from dem_bridge.judging.judgement import KEYS
from dem_bridge.scene.file.write import scene_toml
from tests.helpers.command_line import assert_one_line, run_here
from tests.helpers.judged_records import CHAIN, integrate


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a scene and files of it at three time steps, and with files that cannot be judged."""
    folder = tmp_path_factory.mktemp("judge")
    (folder / "five.toml").write_text(scene_toml(CHAIN), encoding="utf-8")
    heading = ",".join(["time_s", *(f"velocity_{k}_m_per_s" for k in range(5))])
    for dt in (1e-6, 5e-7, 2.5e-7):
        time, samples = integrate(CHAIN, dt, "verlet")
        rows = np.column_stack([time, samples["velocity"]])
        np.savetxt(folder / f"{dt:g}.csv", rows, fmt="%.17g", delimiter=",", header=heading, comments="")
    np.savetxt(folder / "single.csv", rows[5:6], fmt="%.17g", delimiter=",", header=heading, comments="")
    rows[7, 2] = np.nan
    np.savetxt(folder / "nan.csv", rows, fmt="%.17g", delimiter=",", header=heading, comments="")
    return folder


def test_three_files_are_judged_in_one_command(folder: Path) -> None:
    words = ("1e-06.csv@1e-6", "5e-07.csv@5e-7", "2.5e-07.csv@2.5e-7", "--scene", "five.toml")
    done = run_here("judge", *words, "--tolerance", "1e-3", "-o", "page", cwd=folder)
    assert done.returncode == 0, done.stderr
    printed = done.stdout.splitlines()
    assert len(printed) <= 16
    assert max(map(len, printed)) <= 80
    # the first word of a line is its name, unless it goes on from the one before
    text: dict[str, str] = {}
    name = ""
    for line in printed:
        name = line[:14].strip() or name
        text[name] = f"{text.get(name, '')} {line[14:]}".strip()
    assert list(text)[:2] == ["outcome", "next"]
    assert text["outcome"] == "PASS: all errors are within the tolerance, 0.1 % of the largest value."
    assert text["order"].startswith("velocity 2.0")
    assert text["written"] == "page/index.html"
    # what was assumed stands behind the answer, once for all files
    notes = [line for line in done.stderr.splitlines() if "note: " in line]
    assert len(notes) == len(set(notes))
    assert not any(name in line for line in notes for name in ("1e-06.csv:", "5e-07.csv:"))
    assert {"index.html", "verdicts.json", "tables", "figures"} <= {path.name for path in (folder / "page").iterdir()}


def test_json_has_the_keys_of_the_contract_and_the_exit_code_follows(folder: Path) -> None:
    done = run_here("judge", "1e-06.csv@1e-6", "--scene", "five.toml", "--tolerance", "1e-5", "--json", cwd=folder)
    data = json.loads(done.stdout)
    assert tuple(data) == KEYS
    assert (data["outcome"], done.returncode) == ("FAIL", 1)
    same = db.judge((folder / "1e-06.csv", 1e-6), CHAIN, tolerance=1e-5)
    assert data == json.loads(json.dumps(same.as_json()))
    assert 1e-5 < data["error"]["velocity"]["value"] / data["error"]["velocity"]["scale"] < 1e-2


@pytest.mark.parametrize(
    ("words", "part"),
    [
        (("1e-06.csv",), "no scene was given; give the scene of the files"),
        (("--scene", "five.toml"), "no FILE[@DT] was given; give files of a code, a LAMMPS deck, or --command"),
        (("missing.csv", "--scene", "five.toml"), "missing.csv: there is no such file"),
        (("1e-06.csv", "--scene", "missing.toml"), "missing.toml"),
        (("1e-06.csv@", "--scene", "five.toml"), "give FILE@DT with DT in s, such as 1e-06.csv@1e-7"),
        (("1e-06.csv@fast", "--scene", "five.toml"), "give FILE@DT"),
        (("1e-06.csv@-1e-7", "--scene", "five.toml"), "not a number above 0"),
        (("1e-06.csv@1e-6", "5e-07.csv@1e-6", "--scene", "five.toml"), "same time step, 1e-06 s"),
        (("1e-06.csv@1e-6", "5e-07.csv", "--scene", "five.toml"), "5e-07.csv has no time step"),
        (("1e-06.csv", "5e-07.csv", "--dt", "1e-6", "--scene", "five.toml"), "for 2 files"),
        (("1e-06.csv", "--scene", "five.toml", "--tolerance", "2"), "tolerance = 2.0"),
        (("1e-06.csv", "--scene", "five.toml", "--bodies", "a"), "whole numbers"),
        (("nan.csv", "--scene", "five.toml"), "the velocity of body 1 at 3.5e-05 s is nan"),
        (("single.csv", "--scene", "five.toml"), "single"),
        (("1e-06.csv", "--scene", "five.toml", "-o", "five.toml"), "five.toml"),
    ],
    ids=lambda value: "" if isinstance(value, str) else " ".join(value),
)
def test_wrong_use_is_one_line(folder: Path, words: tuple[str, ...], part: str) -> None:
    done = run_here("judge", *words, cwd=folder)
    assert done.returncode == 2
    assert_one_line(done, "dem-bridge: ", part)


def test_a_file_whose_name_has_an_at_is_that_file(folder: Path) -> None:
    (folder / "run@1.csv").write_bytes((folder / "1e-06.csv").read_bytes())
    done = run_here("judge", "run@1.csv", "--scene", "five.toml", "--tolerance", "0.1", cwd=folder)
    assert done.returncode == 0, done.stderr


#: runs a command by its words, and prints the modules that it imported and the number of collections of garbage
IMPORTS = """
import gc, os, sys
from dem_bridge.cli import command
before = gc.get_stats()[0]["collections"]
end = os._exit
def told(code):
    ours = [name for name in sys.modules if name.startswith("dem_bridge.")]
    print(*sorted(ours), gc.get_stats()[0]["collections"] - before, file=sys.stderr, flush=True)
    end(code)
os._exit = told
command()
"""


def test_a_file_is_judged_without_what_decks_and_commands_need(folder: Path) -> None:
    words = ("judge", "1e-06.csv@1e-6", "--scene", "five.toml")
    done = subprocess.run(
        [sys.executable, "-c", IMPORTS, *words], cwd=folder, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    *modules, collections = done.stderr.split()
    assert {"dem_bridge.judging.records", "dem_bridge.lmp.engine"} <= set(modules)
    others = ("lmp.reader", "lmp.process", "lmp.unit_test", "judging.deck", "judging.foreign", "judging.beside")
    assert not [name for name in modules if any(f"dem_bridge.{other}" in name for other in others)]
    assert not {"dem_bridge.observables.differences", "dem_bridge.physics.exact"} & {*modules}
    assert int(collections) < 3
