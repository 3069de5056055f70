"""The command ``dem-bridge check``: is this input script right, and what to write."""

from __future__ import annotations

import os
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import click

import dem_bridge
from dem_bridge.cli import waiting
from dem_bridge.cli.options import ACCURACY, AS_JSON, DT, FOLDER, LAMMPS, TIME_LIMIT, VARIABLES
from dem_bridge.cli.parameters import Argument, make_command, print_json
from dem_bridge.foundation.files import check_future_report_folder
from dem_bridge.scene.shipped import file_of_shipped, missing_scene

#: range of the cost that is said beforehand, relative to the expected one: a step that is too coarse costs more runs
_RANGE_OF_COST = (0.7, 2.0)


@make_command(
    "check",
    Argument("file", "FILE"),
    replace(ACCURACY, help="Permissible error of velocities, relative to the largest velocity.", default="1e-3"),
    replace(
        DT,
        help="Time step of the deck of a scene, s; an input script has its own.",
        default="1/50 of the shortest contact time",
    ),
    VARIABLES,
    *LAMMPS,
    TIME_LIMIT,
    replace(FOLDER, help="Write the page (index.html), check.json and the script with the lines to write into DIR."),
    AS_JSON,
)
def check(file: str, as_json: bool = False, folder: Path | None = None, **settings: Any) -> None:
    """Check FILE, a LAMMPS input script, a unit test of LAMMPS or a scene.

    Is the law right, is the time step right, and what to write. The answer has at most eight entries.

    The exit code is 0 if all is right, 1 if something is wrong, 2 if FILE cannot be read, 3 if LAMMPS stopped with an
    error, and 4 if it is undecided.
    """
    if folder is not None:
        check_future_report_folder(folder)
    if "variables" in settings:
        settings["variables"] = dict(settings["variables"])
    if file_of_shipped(file) is None and not os.path.lexists(file):
        raise missing_scene(file)  # before anything is imported that reads and runs scripts
    with waiting.bar(label=f"check of {file}") as progress:
        answer = dem_bridge.check(file, progress=progress, announce=lambda cost: _announce(file, cost), **settings)
    if folder is not None:
        answer.save(folder)
    if as_json:
        print_json(answer.as_json())
    else:
        click.echo(answer.shown(str(folder / "index.html") if folder is not None else ""))
    sys.exit(answer.exit_code)


def _announce(file: str, cost: float | None) -> None:
    """Print on stderr what a check costs."""
    waiting.announce_compiling("taylor")
    takes = "a few runs of LAMMPS"
    if cost is not None:
        low, high = (max(1.0, factor * cost) for factor in _RANGE_OF_COST)
        takes = f"{low:.0f} to {high:.0f} s of CPU time"
    click.echo(f"dem-bridge: check of {file}: {takes}", err=True)
