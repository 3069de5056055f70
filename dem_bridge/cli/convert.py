"""The commands ``dem-bridge convert`` and ``dem-bridge compare`` for trajectory files."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

import dem_bridge

if TYPE_CHECKING:
    from dem_bridge.differences import Difference
    from dem_bridge.trajectory import Trajectory

#: repeated here so that --help does not import numpy; a test compares them with the package
WRITTEN = ("nc", "extxyz", "lammpstrj", "csv")
UNITS = ("si", "cgs", "micro", "nano", "metal", "real", "ase")
_FILE = click.Path(path_type=Path)


def _reading(command: Callable[..., None]) -> Callable[..., None]:
    """Add the options with the information that files of other programs do not contain."""
    options = (
        click.option("--scene", metavar="SCENE", help="Scene of the run; needed for every file that is not netCDF."),
        click.option(
            "--units",
            type=click.Choice(UNITS),
            help="Units, if the file does not state them.  [default: si; for .traj: ase]",
        ),
        click.option(
            "--dt",
            type=float,
            metavar="S",
            help="Time step, s, if the file has step numbers but no times (without step numbers: time between frames).",
        ),
    )
    for option in reversed(options):
        command = option(command)
    return command


def _read(path: Path, scene: str | None, units: str | None, dt: float | None) -> Trajectory:
    """Read a trajectory and print the assumptions on stderr."""
    settings: dict[str, Any] = {} if path.suffix.lower() == ".nc" else {"units": units, "dt": dt}
    run = dem_bridge.read_trajectory(path, scene, **settings)
    for sentence in run.provenance.get("assumed", ()):
        click.echo(f"dem-bridge: note: {path.name}: {sentence}", err=True)
    return run


@click.command("convert")
@click.argument("run", type=_FILE, metavar="RUN")
@click.option(
    "-o", "output", type=_FILE, required=True, metavar="FILE", help="File to write: .extxyz, .lammpstrj, .csv or .nc."
)
@_reading
@click.option("--format", type=click.Choice(WRITTEN), help="Format of FILE.  [default: by its ending]")
@click.option(
    "--spacing", type=float, metavar="M", help="Spacing of bodies in a scene without geometry, m.  [default: 0.01]"
)
@click.option(
    "--layout",
    type=click.Choice(["long", "wide"]),
    default="long",
    show_default=True,
    help="Layout of csv: a row per time and body, or a row per time.",
)
def convert_command(
    run: Path,
    output: Path,
    scene: str | None,
    units: str | None,
    dt: float | None,
    format: str | None,
    spacing: float | None,
    layout: str,
) -> None:
    """Convert the trajectory file RUN to another format.

    RUN is a .nc, .lammpstrj, .extxyz, .traj or .csv file.
    """
    trajectory = _read(run, scene, units, dt)
    dem_bridge.write_trajectory(trajectory, scene, output, format=format, spacing=spacing, layout=layout)
    click.echo(f"written: {output}")


@click.command("compare")
@click.argument("first", type=_FILE, metavar="A")
@click.argument("second", type=_FILE, metavar="B")
@_reading
@click.option(
    "--tolerance",
    type=float,
    metavar="R",
    help="Allowed difference of velocities, relative to the largest velocity of B; exit code 1 if it is larger.",
)
def compare_command(
    first: Path, second: Path, scene: str | None, units: str | None, dt: float | None, tolerance: float | None
) -> None:
    """Compare two trajectory files A and B.

    The output has the largest difference of each quantity, relative to B, and time and body of the first divergence.
    """
    runs = [_read(path, scene, units, dt) for path in (first, second)]
    comparison = dem_bridge.compare(*runs, tolerance=tolerance or 0.0)
    for entry in comparison.differences:
        click.echo(_sentence(entry))
    for note in (*comparison.unknown, *comparison.notes):
        click.echo(f"note: {note}")
    compared = any(entry.quantity == "velocity" for entry in comparison.differences)
    limit = f"differ by more than {tolerance:g} of the largest velocity" if tolerance else "differ"
    if not compared:
        click.echo("velocities are not compared")
    elif comparison.divergence is None:
        click.echo(f"velocities do not {limit} at any of {comparison.samples} samples")
    else:
        time, body = comparison.divergence
        click.echo(f"velocities first {limit} at {time:.9g} s, body {body}")
        if not tolerance:
            click.echo("give --tolerance to see when the difference matters")
    if tolerance is not None:
        sys.exit(1 if comparison.divergence is not None else 0 if compared else 4)


def _sentence(entry: Difference) -> str:
    """Return the sentence for one quantity: absolute and relative difference, with place and time."""
    noun = {"velocity": "velocities", "displacement": "displacements", "crossing_time": "crossing times"}.get(
        entry.quantity, f"{entry.quantity.replace('_', ' ')}s"
    )
    if not entry.value:
        return f"{noun} are equal"
    scale = entry.scale_name if entry.scale_name.startswith("each") else f"the {entry.scale_name}"
    time = f" at {entry.time:.9g} s" if entry.time == entry.time else ""
    return (
        f"{noun} differ by at most {entry.value * entry.scale:.3g} {entry.unit}, {entry.value:.3g} of"
        f" {scale} ({entry.scale:.6g} {entry.unit}); {entry.place}{time}"
    )
