"""The command ``dem-bridge check``: is this input script right, and what to write."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import click

import dem_bridge
from dem_bridge.cli import terminal
from dem_bridge.cli.options import print_json, with_options
from dem_bridge.foundation.files import check_report_folder


@with_options("check")
def check(file: str, as_json: bool = False, folder: Path | None = None, **settings: Any) -> None:
    """Check FILE, a LAMMPS input script or a scene.

    Is the law right, is the time step right, and what to write. The answer has at most eight lines.

    The exit code is 0 if all is right, 1 if something is wrong, 2 if FILE cannot be read, 3 if LAMMPS stopped with an
    error, and 4 if it is undecided.
    """
    if folder is not None:
        check_report_folder(folder)
    if "variables" in settings:
        settings["variables"] = dict(settings["variables"])
    with terminal.bar() as progress:
        answer = dem_bridge.check(file, progress=progress, announce=lambda cost: _announce(file, cost), **settings)
    if folder is not None:
        answer.save(folder)
    if as_json:
        print_json(answer.as_json())
    else:
        for name, text in answer.lines(str(folder / "index.html") if folder is not None else ""):
            click.echo(f"{name:10} {text}")
    sys.exit(answer.exit_code)


def _announce(file: str, cost: float | None) -> None:
    """Print on stderr how long a check takes."""
    takes = "a few runs of LAMMPS" if cost is None else f"about {max(1.0, cost):.0f} s"
    click.echo(f"dem-bridge: check of {file}: {takes}", err=True)
