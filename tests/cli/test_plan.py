"""``dem-bridge plan`` and a run whose backend the planner chooses."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

import dem_bridge as db
from tests.helpers.command_line import assert_one_line, run_here
from tests.helpers.fake_runs import CHAIN


def test_a_plan_says_what_to_run_and_why(tmp_path: Path) -> None:
    (tmp_path / "small.toml").write_text(CHAIN)
    done = run_here("plan", "small.toml", "--accuracy", "1e-4", "--backend", "lammps-granular", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    rows = dict(
        line.split(maxsplit=1)
        for line in done.stdout.splitlines()
        if not line.startswith((" ", "reason:", "command")) and "reasons" not in line
    )
    assert rows["accuracy"] == "0.0001 of velocity on small"
    assert rows["backend"].startswith("lammps-granular, dt = ")
    assert "by the error model: the median" in rows["predicted"]
    assert rows["measured"].startswith("error ")
    assert "force evaluations" in rows["steps"]
    (command,) = (line for line in done.stdout.splitlines() if line.startswith("command"))
    words = command.split("dem-bridge ")[1].split()
    assert words[:4] == ["run", "small.toml", "--backend", "lammps-granular"]
    assert re.search(r"^reasons for these settings: \d+ lines", done.stdout, re.MULTILINE)
    # the command is last, and reasons are printed where they are asked for
    assert done.stdout.splitlines()[-1] == command
    assert max(len(line) for line in done.stdout.splitlines() if line != command) <= 80
    reasoned = run_here("plan", "small.toml", "--accuracy", "1e-4", "--backend", "lammps-granular", "-v", cwd=tmp_path)
    assert "the positional twin gives the same numbers" in " ".join(reasoned.stdout.split())
    assert run_here(*words, cwd=tmp_path).returncode == 0


def test_a_plan_as_json_is_what_python_answers(tmp_path: Path) -> None:
    (tmp_path / "small.toml").write_text(CHAIN)
    words = ("plan", "small.toml", "--accuracy", "1e-3", "--backend", "verlet", "--json")
    printed = json.loads(run_here(*words, cwd=tmp_path).stdout)
    plan = db.plan(tmp_path / "small.toml", 1e-3, "verlet").as_json()
    # what is measured in seconds is another every time
    times = ("predicted_cost", "found_cost")
    assert {key: value for key, value in printed.items() if key not in times} == {
        key: value for key, value in plan.items() if key not in times
    }
    assert printed["found_cost"] > 0.0
    prediction = json.loads(run_here(*words, "--predict-only", cwd=tmp_path).stdout)
    assert (prediction["found_error"], prediction["found_cost"]) == (None, None)


def test_a_run_without_a_backend_takes_the_cheapest_and_says_so(tmp_path: Path) -> None:
    (tmp_path / "small.toml").write_text(CHAIN)
    done = run_here("run", "small.toml", "--accuracy", "1e-5", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    first = done.stdout.splitlines()[0]
    assert first.startswith("cheapest backend")
    assert first.split()[2] in ("verlet", "blanes-moan", "reference", "scipy")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("plan", "small.toml"), "--accuracy"),
        (("plan", "small.toml", "--accuracy", "2"), "a number between 0 and 1"),
        (
            ("plan", "small.toml", "--accuracy", "1e-15", "--backend", "reference"),
            "cannot be reached: double precision",
        ),
        (("plan", "small.toml", "--accuracy", "1e-6", "--budget", "1e-9"), "the budget is 1e-09 s"),
        (("plan", "small.toml", "--accuracy", "1e-3", "--backend", "bca"), "bca: its error is 0.47"),
        (("run", "small.toml"), "'--backend', or '--accuracy'"),
    ],
)
def test_what_cannot_be_planned_is_one_line_and_exit_code_2(words: tuple[str, ...], said: str, tmp_path: Path) -> None:
    (tmp_path / "small.toml").write_text(CHAIN)
    done = run_here(*words, cwd=tmp_path)
    assert done.returncode == 2
    assert_one_line(done, said)
