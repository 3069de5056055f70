"""The commands ``dem-bridge convert`` and ``dem-bridge compare``: trajectories between programs, and side by side."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

import dem_bridge

if TYPE_CHECKING:
    from dem_bridge.trajectory import Trajectory

#: named again here so that --help needs no numpy; a test holds them together
WRITTEN = ("nc", "extxyz", "lammpstrj", "csv")
UNITS = ("si", "cgs", "micro", "nano", "metal", "real", "ase")
_FILE = click.Path(path_type=Path)


def _reading(command: Callable[..., None]) -> Callable[..., None]:
    """The options that say what a file of others does not."""
    options = (
        click.option("--scene", metavar="SCENE", help="What was run; needed for files that are no netCDF."),
        click.option(
            "--units", type=click.Choice(UNITS), help="Of a file that does not say.  [default: si; .traj: ase]"
        ),
        click.option("--dt", type=float, metavar="S", help="Of a time step (or frame) in a file without times, s."),
    )
    for option in reversed(options):
        command = option(command)
    return command


def _read(path: Path, scene: str | None, units: str | None, dt: float | None) -> Trajectory:
    told: dict[str, Any] = {} if path.suffix.lower() == ".nc" else {"units": units, "dt": dt}
    run = dem_bridge.read_trajectory(path, scene, **told)
    for sentence in run.provenance.get("assumed", ()):
        click.echo(f"dem-bridge: note: {path.name}: {sentence}", err=True)
    return run


@click.command("convert")
@click.argument("run", type=_FILE, metavar="RUN")
@click.option("-o", "output", type=_FILE, required=True, metavar="FILE", help=".extxyz, .lammpstrj, .csv or .nc.")
@_reading
@click.option("--format", type=click.Choice(WRITTEN), help="Of FILE.  [default: by its ending]")
@click.option("--spacing", type=float, metavar="M", help="Of bodies without a geometry, m.  [default: 0.01]")
@click.option("--layout", type=click.Choice(["long", "wide"]), default="long", show_default=True, help="Of csv.")
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
    """Write the trajectory RUN (.nc, or another program's .lammpstrj, .extxyz, .traj, .csv) in another format."""
    found = _read(run, scene, units, dt)
    dem_bridge.write_trajectory(found, scene, output, format=format, spacing=spacing, layout=layout)
    click.echo(f"written: {output}")


@click.command("compare")
@click.argument("first", type=_FILE, metavar="A")
@click.argument("second", type=_FILE, metavar="B")
@_reading
@click.option(
    "--tolerance", type=float, metavar="R", help="Exit code 1 where velocities differ by more of the largest."
)
def compare_command(
    first: Path, second: Path, scene: str | None, units: str | None, dt: float | None, tolerance: float | None
) -> None:
    """Say how far the trajectories A and B are apart, quantity by quantity, relative to B, and where they part."""
    runs = [_read(path, scene, units, dt) for path in (first, second)]
    found = dem_bridge.compare(*runs, tolerance=tolerance or 0.0)
    for one in found.differences:
        place = f"{'body' if one.quantity in ('velocity', 'displacement') else 'contact'} {one.body}"
        at = f", {one.time:.9g} s" if one.time == one.time else ""
        where = f"  {place}{at}" if one.value else ""
        click.echo(f"{one.quantity:14} {one.value:9.3g} of {one.scale:.6g} {one.unit} ({one.scale_name}){where}")
    for sentence in (*found.unknown, *found.notes):
        click.echo(f"note: {sentence}")
    beyond = f"by more than {tolerance:g} of the largest" if tolerance else "at all"
    if not any(one.quantity == "velocity" for one in found.differences):
        click.echo("velocities are not compared")
    elif found.divergence is None:
        click.echo(f"velocities do not differ {beyond} at {found.samples} samples")
    else:
        time, body = found.divergence
        click.echo(f"velocities first differ {beyond} at {time:.9g} s, body {body}")
    if tolerance is not None:
        known = any(one.quantity == "velocity" for one in found.differences)
        sys.exit(1 if found.divergence is not None else 0 if known else 4)
