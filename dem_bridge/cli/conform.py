"""The command ``dem-bridge conform``: a grade of any code on frozen and unseen scenes."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import click

import dem_bridge
from dem_bridge.cli import waiting
from dem_bridge.cli.options import AS_JSON, FOLDER, FORCE, JUNIT_FILE, TIME_LIMIT
from dem_bridge.cli.parameters import FILE, NOT_NEGATIVE, Option, check_new, make_command, print_json
from dem_bridge.errors import UsageError
from dem_bridge.foundation.files import write_whole


@make_command(
    "conform",
    Option(
        "command",
        "Code to grade, such as 'mycode {scene} {dt} {out.csv}'; the placeholders are those of judge.",
        metavar="WORDS",
    ),
    Option(
        "features",
        "What the code has: hertz, hooke, walls, gaps, gravity, precompression, several-moving, polydisperse, dashpot,"
        " mass_velocity, kuwabara-kono, tsuji, coeff_restitution.",
        metavar="A,B,...",
        default="hertz",
    ),
    Option("scenes", "Number of unseen scenes.", int, metavar="N", limits=NOT_NEGATIVE, default="10"),
    Option("seed", "Seed of the unseen scenes.", int, metavar="S", limits=NOT_NEGATIVE, default="0"),
    replace(TIME_LIMIT, help="Time limit of each run, s.", default="60"),
    Option("check", "Grade the stored files of an earlier grade again, without the code.", FILE, metavar="DIR"),
    replace(FOLDER, help="Write the files of the code, conformance.json, junit.xml and badge.svg into DIR."),
    replace(JUNIT_FILE, help="Further file for the items, JUnit XML."),
    replace(FORCE, help="Replace the file of --junit if it exists."),
    AS_JSON,
)
def conform(
    as_json: bool = False,
    folder: Path | None = None,
    junit_file: Path | None = None,
    force: bool = False,
    check: Path | None = None,
    **settings: Any,
) -> None:
    """Grade a code on twelve frozen scenes and on unseen ones: law, walls, damping, order, digits, and more.

    Each scene runs at three time steps. The answer has an item a question; a run that fails costs its scene only.

    The exit code is 0 if all items pass, 1 if one failed, 2 for wrong use or stored files that were changed, 3 if a run
    broke, and 4 if one is undecided.
    """
    if junit_file is not None:
        check_new(junit_file, force)
    if check is not None and (
        others := [name for name in ("command", "features", "scenes", "seed", "time_limit") if name in settings]
    ):
        raise UsageError(
            f"--check and --{others[0].replace('_', '-')} were given; --check takes the settings that were recorded"
        )
    if check is None and "command" not in settings:
        raise UsageError("no code was given; give --command 'mycode {scene} {dt} {out.csv}', or --check DIR")
    if check is not None and folder is not None:
        raise UsageError("--check and -o were given; --check writes no files but that of --junit")
    waiting.announce_compiling("taylor")
    with waiting.bar(label=f"the files in {check}" if check is not None else "the scenes") as progress:
        answer = dem_bridge.conform(check=check, folder=folder, progress=progress, **settings)
    if junit_file is not None:
        write_whole(junit_file.parent, {junit_file.name: answer.junit()})
    if as_json:
        print_json(answer.as_json())
    else:
        click.echo(answer.card())
    sys.exit(answer.exit_code)
