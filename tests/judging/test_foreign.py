"""Runs of foreign codes: the command, its files, its failures, and what remains of it."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

from dem_bridge.errors import RunBroken, UsageError
from dem_bridge.judging.foreign import Command, default_steps, foreign_runs
from dem_bridge.scene.file import parse_scene
from dem_bridge.scene.file.write import scene_json
from tests.helpers.foreign import FAKE, PAIR


def test_a_code_runs_at_every_time_step_in_a_folder_that_is_removed(tmp_path: Path) -> None:
    code = tmp_path / "fake.py"
    code.write_text(FAKE)
    command = Command.of(f"{sys.executable} -S {code} {{scene}} {{dt}} {{out.csv}}")
    assert command.name == "fake.py"
    with foreign_runs(command, PAIR, (1e-7, 2e-7)) as runs:
        assert [run.dt for run in runs] == [2e-7, 1e-7]
        assert all(run.wall > 0.0 and run.cpu > 0.0 for run in runs)
        lines = [run.out.read_text().splitlines() for run in runs]
        assert [len(text) for text in lines] == [PAIR.samples + 2] * 2
    assert not any(run.out.parent.parent.exists() for run in runs)


def test_a_scene_survives_as_json_and_toml() -> None:
    word = "cat {scene.toml} {scene.json} {dt} > {out} 2>&1; cp {scene.toml} {out}"
    with foreign_runs(Command.of(["sh", "-c", word]), PAIR, (1e-7,)) as (run,):
        assert parse_scene(run.out.read_text()) == PAIR
    assert json.loads(scene_json(PAIR))["chain"]["mass"] == list(PAIR.mass)


def test_a_deck_is_written_for_the_time_step() -> None:
    with foreign_runs(Command.of("cp {deck} {out} --suffix={dt}"), PAIR, (1e-7,)) as (run,):
        assert "variable dt          index 1e-07" in run.out.read_text()


@pytest.mark.parametrize(
    ("words", "name"),
    [
        ("mkdir {out}", "out"),
        ("touch {out}.npz", "out.npz"),
        ("touch {out}.1.vtk {out}.2.vtk", "out*"),
    ],
)
def test_an_output_may_have_another_ending_or_be_several_files(words: str, name: str) -> None:
    with foreign_runs(Command.of(["sh", "-c", f"{words}; : {{dt}}"]), PAIR, (1e-7,)) as (run,):
        assert run.out.name == name
        assert run.out.exists() or [*run.out.parent.glob(run.out.name)]


def test_no_shell_reads_the_command(tmp_path: Path) -> None:
    code = tmp_path / "a b;touch broken.py"
    code.write_text("import sys; open(sys.argv[1], 'w').write(repr(sys.argv[3:]))")
    command = Command.of([sys.executable, "-S", str(code), "{out}", "{dt}", "$HOME", "; rm x", "{not a name}"])
    with foreign_runs(command, PAIR, (1e-7,)) as (run,):
        assert run.out.read_text() == repr(["$HOME", "; rm x", "{not a name}"])


@pytest.mark.parametrize(
    ("code", "problem"),
    [
        ("import sys; print('noise'); sys.exit('no contact law')", "exit code 1: no contact law"),
        ("print('all is well')", r"wrote no file \{out\}.*its last line was: all is well"),
        ("import os; os.kill(os.getpid(), 9)", "by SIGKILL without a message"),
        ("import time; time.sleep(1e6)", "did not end within the time limit of 0.5 s"),
    ],
)
def test_a_failed_run_is_told_with_its_last_line(code: str, problem: str) -> None:
    with (
        pytest.raises(RunBroken, match=problem) as caught,
        foreign_runs(Command.of([sys.executable, "-S", "-c", code, "{dt}", "{out}"]), PAIR, (1e-7,), time_limit=0.5),
    ):
        pass
    assert caught.value.exit_code == 3


@pytest.mark.parametrize(
    ("command", "problem"),
    [
        ("cat 'x {dt} {out}", "close its quotes"),
        ("cat {scene} {out}", r"has no \{dt\}"),
        ("cat {scene} {dt}", r"has no \{out\}"),
        ("cat {out.csv} {out.npz} {dt}", "2 names"),
        ("cat {scenes} {dt} {out}", r"placeholder \{scenes\} is unknown"),
        ("no-such-code {dt} {out}", "no program 'no-such-code'"),
    ],
)
def test_a_command_that_cannot_work_is_refused_before_it_runs(command: str, problem: str) -> None:
    with pytest.raises(UsageError, match=problem):
        Command.of(command)


@pytest.mark.parametrize("steps", [(), (0.0,), (1e-7, 1e-7), (float("nan"),)])
def test_time_steps_are_checked(steps: tuple[float, ...]) -> None:
    with pytest.raises(UsageError, match="dt = "), foreign_runs(Command.of("cat {dt} {out}"), PAIR, steps):
        pass


def test_default_steps_divide_the_sampling_interval() -> None:
    steps = default_steps(PAIR)
    per_sample = [PAIR.duration / PAIR.samples / dt for dt in steps]
    assert per_sample == pytest.approx([round(n) for n in per_sample], rel=1e-12)
    assert len(steps) == 4
