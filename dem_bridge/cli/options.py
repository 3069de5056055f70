"""Arguments and options that several commands share."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from dem_bridge.errors import UsageError
from dem_bridge.files import check_file


def scene_names(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[Any]:
    """Return the completions of a scene: names of shipped scenes, or files if no name matches."""
    from click.shell_completion import CompletionItem

    folder = Path(__file__).parents[1] / "scenes"
    names = sorted(file.stem for file in folder.glob("*.toml") if file.stem.startswith(incomplete))
    return [CompletionItem(name) for name in names] or [CompletionItem(incomplete, type="file")]


class ObservableChoice(click.Choice[str]):
    """The name of a registered observable; the registry is imported when a name is needed, not for ``--help``."""

    def __init__(self) -> None:
        self.case_sensitive = True

    @property
    def choices(self) -> tuple[str, ...]:  # type: ignore[override]
        """Names of all registered observables."""
        from dem_bridge.observables.registry import OBSERVABLES

        return tuple(OBSERVABLES)


scene_argument = click.argument("scene", shell_complete=scene_names)
step_option = click.option("--dt", type=float, metavar="S", help="Upper bound of the time step, s.")
accuracy_option = click.option(
    "--accuracy",
    type=float,
    metavar="A",
    help="Accuracy of velocities, relative to the largest velocity; the time step follows from it.",
)
samples_option = click.option(
    "--samples", type=int, metavar="N", help="Number of samples in time.  [default: that of the scene]"
)
jobs_option = click.option(
    "-j",
    "jobs",
    type=click.IntRange(min=1),
    metavar="N",
    help="Number of runs at the same time.  [default: the number of cores]",
)
json_option = click.option("--json", "as_json", is_flag=True, help="Print JSON.")
geometry_option = click.option(
    "--geometry",
    type=click.Choice(["surrogate", "physical"]),
    help="Radius of the bodies in the deck: a small power of two, which minimises round-off, or the scene's radius."
    "  [default: surrogate]",
)
types_option = click.option(
    "--types",
    type=click.Choice(["euler", "per-body"]),
    help="Atom types of the deck: as few as possible, or one per body.  [default: euler]",
)
recompute_option = click.option(
    "--no-cache", "recompute", is_flag=True, help="Recompute all runs, also those in the store."
)


def check_new(path: Path, force: bool) -> None:
    """Raise UsageError unless a file can be written at ``path`` and none exists there (or ``force`` is set)."""
    check_file(path)
    if path.exists() and not force:
        raise UsageError(f"{path}: the file exists; allowed: a new file, or --force to replace it")


def check_not_input(scene: str, *outputs: Path | None) -> None:
    """Raise UsageError if an output would replace the scene file that is read."""
    source = Path(scene)
    for output in outputs:
        if output is not None and source.is_file() and output.exists() and output.samefile(source):
            raise UsageError(f"{output}: the output would replace the scene file; name another file")


def engine_options(command: Callable[..., None]) -> Callable[..., None]:
    """Add the options that select a LAMMPS to a command."""
    options = (
        click.option(
            "--lmp", metavar="PATH", help="LAMMPS binary.  [default: $DEM_BRIDGE_LMP, or the Python module lammps]"
        ),
        click.option("--lmp-args", metavar="ARGS", help='Further arguments of LAMMPS, such as "-sf omp".'),
        click.option(
            "--python", metavar="PATH", help="Python interpreter of another environment whose module lammps is used."
        ),
        click.option("--ranks", type=int, metavar="R", help="Number of MPI processes of one run.  [default: 1]"),
    )
    for option in reversed(options):
        command = option(command)
    return command
