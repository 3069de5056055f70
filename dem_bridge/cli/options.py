"""Arguments and options that more than one command has."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from dem_bridge.errors import UsageError
from dem_bridge.files import check_file


def scene_names(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[Any]:
    """Tab completion: shipped scenes, then files."""
    from click.shell_completion import CompletionItem

    folder = Path(__file__).parents[1] / "scenes"
    names = sorted(file.stem for file in folder.glob("*.toml") if file.stem.startswith(incomplete))
    return [CompletionItem(name) for name in names] or [CompletionItem(incomplete, type="file")]


scene_argument = click.argument("scene", shell_complete=scene_names)
step_option = click.option("--dt", type=float, metavar="S", help="Largest time step, s.")
accuracy_option = click.option(
    "--accuracy", type=float, metavar="A", help="Wanted accuracy of velocities, relative; the step follows from it."
)

jobs_option = click.option(
    "-j", "jobs", type=click.IntRange(min=1), metavar="N", help="Runs at a time.  [default: as many as cores]"
)


def check_new(path: Path, force: bool) -> None:
    """Whether a file can be written at ``path``; UsageError if not, or where one is there already."""
    check_file(path)
    if path.exists() and not force:
        raise UsageError(f"{path}: is there already; allowed: a new file, or --force to replace it")


def not_the_input(scene: str, *outputs: Path | None) -> None:
    """UsageError where an output would take the place of the scene file that is read."""
    source = Path(scene)
    for output in outputs:
        if output is not None and source.is_file() and output.exists() and output.samefile(source):
            raise UsageError(f"{output}: is the scene file itself, which would be lost; name another file")


def engine_options(command: Callable[..., None]) -> Callable[..., None]:
    """The options that say which LAMMPS."""
    options = (
        click.option("--lmp", metavar="PATH", help="A LAMMPS binary (default: $DEM_BRIDGE_LMP, or the Python module)."),
        click.option("--lmp-args", metavar="ARGS", help='More arguments for LAMMPS, such as "-sf omp".'),
        click.option("--python", metavar="PATH", help="Another environment's Python, for its lammps module."),
        click.option("--ranks", type=int, metavar="R", help="Processes of MPI for one run.  [default: 1]"),
    )
    for option in reversed(options):
        command = option(command)
    return command
