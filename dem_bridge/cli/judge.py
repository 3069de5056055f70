"""The command ``dem-bridge judge`` for files of any code."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import click

import dem_bridge
from dem_bridge.cli.options import print_json, with_options
from dem_bridge.errors import UsageError
from dem_bridge.foundation.files import check_report_folder


@with_options("judge")
def judge(
    files: tuple[str, ...], scene: str, as_json: bool = False, folder: Path | None = None, **settings: Any
) -> None:
    """Judge FILES of any code against the reference solution of their scene.

    Each FILE holds samples of one run: FILE, or FILE@DT with the time step of the run in s. Several files with
    different time steps give the order of convergence; the one with the finest step decides the outcome. A FILE that is
    a LAMMPS input script is run as it is. With --command a code is run in place of reading files.

    The exit code is 0 for PASS, 1 for FAIL, 3 for a run that failed and 4 for UNDECIDED.
    """
    if folder is not None:
        check_report_folder(folder)
    if isinstance(units := settings.get("units"), list):
        settings["units"] = ",".join(units)
    if not files and "command" not in settings:
        raise UsageError("no FILE[@DT] was given; give files of a code, a LAMMPS deck, or --command")
    if len(steps := settings.get("dt", ())) == 1 and "command" not in settings:
        settings["dt"] = steps[0]
    if "variables" in settings:
        settings["variables"] = dict(settings["variables"])
    judgement = dem_bridge.judge(list(files), scene, **settings)
    if folder is not None:
        judgement.save(folder)
    if as_json:
        print_json(judgement.as_json())
    else:
        for sentence in judgement.recognised:
            click.echo(f"dem-bridge: note: {sentence}", err=True)
        click.echo(str(judgement))
        if folder is not None:
            click.echo(f"{'written':13} {folder / 'index.html'}")
    sys.exit(judgement.exit_code)
