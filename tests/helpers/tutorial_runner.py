"""Run a tutorial as a reader would: block by block, in one folder, with one Python.

A page is Markdown. ``python`` blocks share a namespace; the ``text`` block that follows one has what it prints (none:
it prints nothing). In ``console`` blocks a line after "$ " is a command, and what is below it is what it prints, errors
too. A ``toml`` block whose first line is "# NAME.toml" is that file. "..." stands for anything, on a line or over many.
"""

from __future__ import annotations

import contextlib
import doctest
import io
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

_SAME = doctest.OutputChecker()


@dataclass(frozen=True)
class Step:
    """Hold one thing that a reader does, and what it prints."""

    line: int
    kind: str
    text: str
    printed: str = ""


class Drift(AssertionError):
    """Say that the page shows one thing and the code prints another."""


def steps(page: str) -> Iterator[Step]:
    """Yield the steps of a page of Markdown, in their order."""
    blocks = [
        (page[: fence.start()].count("\n") + 2, fence[1], fence[2], fence.end())
        for fence in re.finditer(r"^```(\w+)\n(.*?)^```$", page, re.DOTALL | re.MULTILINE)
    ]
    for at, (line, kind, text, end) in enumerate(blocks):
        if kind == "console":
            if not text.startswith("$ "):
                raise Drift(f"line {line}: a console block begins with a command")
            for command in re.finditer(r"^\$ (.*)\n((?:(?!\$ ).*\n)*)", text, re.MULTILINE):
                yield Step(line + text[: command.start()].count("\n"), kind, command[1], command[2])
        elif kind == "python":
            follows = blocks[at + 1] if at + 1 < len(blocks) else None
            said = follows is not None and follows[1] == "text" and not page[end : page.index("```text", end)].strip()
            yield Step(line, kind, text, follows[2] if said and follows else "")
        elif kind == "toml":
            yield Step(line, kind, text)
        elif kind != "text":
            raise Drift(f"line {line}: a block of {kind!r}, which nobody runs")


def run(page: str, folder: Path) -> None:
    """Do all of a page in ``folder``, the current one; Drift at the first step that prints something else."""
    namespace: dict[str, Any] = {"__name__": "__main__"}
    for step in list(steps(page)):  # a page that cannot be read is not begun
        got = _done(step, namespace, folder)
        if not _SAME.check_output(step.printed, got, doctest.ELLIPSIS):
            raise Drift(f"line {step.line}: {step.text.strip()}\n--- the page says\n{step.printed}--- printed\n{got}")


def _done(step: Step, namespace: dict[str, Any], folder: Path) -> str:
    if step.kind == "toml":
        name = re.match(r"# (\S+\.toml)\n", step.text)
        if name is None:
            raise Drift(f"line {step.line}: a file without a name")
        (folder / name[1]).write_text(step.text, encoding="utf-8")
        return ""
    if step.kind == "console":
        # the commands of this very environment
        path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
        done = subprocess.run(
            ["bash", "-c", step.text],
            cwd=folder,
            env={**os.environ, "PATH": path},
            text=True,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
        )
        if done.returncode != 0:
            raise Drift(f"line {step.line}: {step.text}\nexit code {done.returncode}\n{done.stdout}")
        return done.stdout
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(compile(step.text, f"line {step.line}", "exec"), namespace)
    return printed.getvalue()
