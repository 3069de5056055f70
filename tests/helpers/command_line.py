"""Run ``dem-bridge`` for tests: as a program, or in this process, which saves the second that a start takes."""

from __future__ import annotations

import contextlib
import re
import subprocess
import sys
from pathlib import Path

import click
from click.testing import CliRunner

from dem_bridge.cli import main

PROGRAM = str(Path(sys.executable).with_name("dem-bridge"))
Done = subprocess.CompletedProcess[str]
#: the line that a command in a log prints each 30 s, which a busy machine may reach
_STATE_LINE = re.compile(r"^dem-bridge: \d+ min \d\d s.*\n", re.MULTILINE)


def run_program(*words: str, cwd: Path) -> Done:
    """Start the program as a shell does; the lines that say how long it runs are left out."""
    done = subprocess.run([PROGRAM, *words], capture_output=True, text=True, cwd=cwd, timeout=300)
    return Done(done.args, done.returncode, done.stdout, _STATE_LINE.sub("", done.stderr))


def run_here(*words: str, cwd: Path) -> Done:
    """Run the command in this process; an exception that the program would end with is raised.

    The lines that say how long it runs are left out.
    """
    with contextlib.chdir(cwd):
        done = CliRunner().invoke(main, words, prog_name="dem-bridge")
    if done.exception is not None and not isinstance(done.exception, SystemExit):
        raise done.exception
    return Done(words, done.exit_code, done.stdout, _STATE_LINE.sub("", done.stderr))


def assert_one_line(done: Done, *parts: str) -> None:
    """Assert that a command failed in one line on stderr that has all of the parts, with nothing on stdout."""
    assert done.stdout == ""
    assert "Traceback" not in done.stderr
    assert done.stderr.count("\n") == 1, done.stderr
    for part in parts:
        assert part in done.stderr


def choices(command: str, name: str) -> tuple[str, ...]:
    """Return the allowed values of an option."""
    [option] = [parameter for parameter in main.commands[command].params if parameter.name == name]
    assert isinstance(option.type, click.Choice)
    return tuple(option.type.choices)
