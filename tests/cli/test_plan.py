"""``dem-bridge plan`` and a run whose backend the planner chooses, as a program."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import dem_bridge as db
from tests.cli.test_group import _one_line, _run
from tests.helpers.fake_runs import CHAIN


def test_a_plan_says_what_to_run_and_why(tmp_path: Path) -> None:
    (tmp_path / "small.toml").write_text(CHAIN)
    done = _run("plan", "small.toml", "--accuracy", "1e-4", "--backend", "lammps-granular", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    rows = dict(
        line.split(maxsplit=1) for line in done.stdout.splitlines() if not line.startswith(("reason:", "command"))
    )
    assert rows["accuracy"] == "0.0001 of velocity on small"
    assert rows["backend"].startswith("lammps-granular, dt = ")
    assert "by the error model" in rows["predicted"]
    assert rows["measured"].startswith("error ")
    assert "force evaluations" in rows["steps"]
    (command,) = (line for line in done.stdout.splitlines() if line.startswith("command"))
    words = command.split("dem-bridge ")[1].split()
    assert words[:4] == ["run", "small.toml", "--backend", "lammps-granular"]
    assert any("the positional twin gives the same numbers" in line for line in done.stdout.splitlines())
    assert _run(*words, cwd=tmp_path).returncode == 0


def test_a_plan_as_json_is_what_python_answers(tmp_path: Path) -> None:
    (tmp_path / "small.toml").write_text(CHAIN)
    words = ("plan", "small.toml", "--accuracy", "1e-3", "--backend", "verlet", "--json")
    told = json.loads(_run(*words, cwd=tmp_path).stdout)
    found = db.plan(tmp_path / "small.toml", 1e-3, "verlet").as_json()
    # what is measured in seconds is another every time
    times = ("predicted_cost", "found_cost")
    assert {key: value for key, value in told.items() if key not in times} == {
        key: value for key, value in found.items() if key not in times
    }
    assert told["found_cost"] > 0.0
    guessed = json.loads(_run(*words, "--predict-only", cwd=tmp_path).stdout)
    assert (guessed["found_error"], guessed["found_cost"]) == (None, None)


def test_a_run_without_a_backend_takes_the_cheapest_and_says_so(tmp_path: Path) -> None:
    (tmp_path / "small.toml").write_text(CHAIN)
    done = _run("run", "small.toml", "--accuracy", "1e-5", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    first = done.stdout.splitlines()[0]
    assert first.startswith("cheapest backend")
    assert first.split()[2] in ("verlet", "blanes-moan", "reference", "scipy")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("plan", "small.toml"), "--accuracy"),
        (("plan", "small.toml", "--accuracy", "2"), "a number between 0 and 1"),
        (("plan", "small.toml", "--accuracy", "1e-15", "--backend", "reference"), "its uncertainty is"),
        (("plan", "small.toml", "--accuracy", "1e-6", "--budget", "1e-9"), "the budget is 1e-09 s"),
        (("plan", "small.toml", "--accuracy", "1e-3", "--backend", "ode45"), "ode45 cannot do small"),
        (("run", "small.toml"), "'--backend', or '--accuracy'"),
    ],
)
def test_what_cannot_be_planned_is_one_line_and_exit_code_2(words: tuple[str, ...], said: str, tmp_path: Path) -> None:
    (tmp_path / "small.toml").write_text(CHAIN)
    done = _run(*words, cwd=tmp_path)
    assert done.returncode == 2
    _one_line(done, said)
