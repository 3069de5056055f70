"""The commands ``dem-bridge import csv`` and ``dem-bridge import deck``: scene files out of what is no scene file."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

import dem_bridge
from dem_bridge.cli.options import check_new
from dem_bridge.files import write_whole

if TYPE_CHECKING:
    from dem_bridge.scene import Scene, Wall

_FILE = click.Path(path_type=Path)


@click.group("import")
def import_group() -> None:
    """Turn a CSV or a LAMMPS input script into a scene file."""


def _written(command: Callable[..., None]) -> Callable[..., None]:
    """What both commands ask."""
    options = (
        click.option("-o", "output", type=_FILE, required=True, metavar="FILE", help="The scene file, .toml."),
        click.option("--force", is_flag=True, help="Replace FILE where it is there."),
        click.option("--name", metavar="NAME", help="Of the scene.  [default: by the name of the file]"),
        click.option("--description", metavar="TEXT", help="Of the scene, one line."),
    )
    for option in reversed(options):
        command = option(command)
    return command


def _variables(ctx: click.Context, param: click.Parameter, value: tuple[str, ...]) -> dict[str, str]:
    pairs = [one.partition("=") for one in value]
    if wrong := next((one for one, (_, sign, _) in zip(value, pairs, strict=True) if not sign), None):
        raise click.BadParameter(f"{wrong!r}; allowed: NAME=VALUE")
    return {name: given for name, _, given in pairs}


def _wall(ctx: click.Context, param: click.Parameter, value: str | None) -> Wall | None:
    if value is None:
        return None
    try:
        numbers = [float(one) for one in value.split(",")]
    except ValueError:
        numbers = []
    if not 1 <= len(numbers) <= 3:
        raise click.BadParameter(f"{value!r}; allowed: STIFFNESS[,GAP[,EXPONENT]]")
    return dem_bridge.Wall(**dict(zip(("stiffness", "gap", "exponent"), numbers, strict=False)))


@import_group.command("deck")
@click.argument("script", type=_FILE, metavar="SCRIPT")
@_written
@click.option("--duration", type=float, metavar="S", help="s.  [default: that of the script's runs]")
@click.option("--samples", type=int, metavar="N", help="In time.  [default: the frames of the first dump]")
@click.option("--reverse/--no-reverse", default=None, help="Body 0 at the highest coordinate, or at the lowest.")
@click.option(
    "--var", "variables", multiple=True, callback=_variables, metavar="NAME=VALUE", help="As LAMMPS takes it by -var."
)
def deck_command(script: Path, output: Path, force: bool, **given: Any) -> None:
    """Write the scene of SCRIPT, a LAMMPS input script in which each body is a sphere on one line."""
    from dem_bridge.api.scenes import deck_read

    check_new(output, force)
    found = deck_read(script, **given)
    _keep(found.scene, output, found.notes)


@import_group.command("csv")
@click.argument("bodies", type=_FILE, metavar="BODIES")
@_written
@click.option("--contacts", type=_FILE, metavar="CSV", help="Their contacts, where BODIES has none.")
@click.option("--duration", type=float, required=True, metavar="S", help="s.")
@click.option("--samples", type=int, metavar="N", help="In time.  [default: 500]")
@click.option("--gravity", type=float, metavar="G", help="m/s^2, positive towards the last body.")
@click.option("--drag", type=float, metavar="B", help="1/s: a force -B m v on each body.")
@click.option("--precompression", type=float, metavar="N", help="N: the chain starts pressed by it, in equilibrium.")
@click.option("--wall-left", callback=_wall, metavar="K[,GAP[,N]]", help="Stiffness, gap (m) and exponent n.")
@click.option("--wall-right", callback=_wall, metavar="K[,GAP[,N]]", help="... of the wall behind the last body.")
def csv_command(bodies: Path, output: Path, force: bool, **given: Any) -> None:
    """Write the scene of BODIES, a CSV with a row per body: mass_kg, velocity_m_per_s, and of its contact to the next
    stiffness_N_per_m^(n-1), exponent, gap_m; or of the tables that `dem-bridge export` writes."""
    check_new(output, force)
    scene = dem_bridge.scene_from_csv(bodies, **{key: value for key, value in given.items() if value is not None})
    _keep(scene, output, ())


def _keep(scene: Scene, output: Path, notes: Iterable[str]) -> None:
    """Write the file, and say what is in it."""
    from dem_bridge.scene_file.text import scene_toml

    write_whole(output.parent, {output.name: scene_toml(scene)})
    for note in notes:
        click.echo(f"read: {note}")
    for part, text in _told(scene):
        click.echo(f"{part:14} {text}")
    click.echo(f"written: {output}")
    click.echo(f"next: dem-bridge verify {output}")


def _told(scene: Scene) -> Iterable[tuple[str, str]]:
    c = scene.contacts
    moving = [k for k, v in enumerate(scene.velocity) if v]
    yield "scene", f"{scene.name}: {scene.n_body} bodies, {scene.n_contact} contacts"
    yield "masses", f"{min(scene.mass):.6g} to {max(scene.mass):.6g} kg"
    if scene.n_contact:
        powers = ", ".join(f"{n:g}" for n in sorted(set(c.exponent.tolist())))
        yield "stiffness", f"{c.stiffness.min():.6g} to {c.stiffness.max():.6g} N/m^(n-1), n = {powers}"
        yield "gaps", f"{c.gap.min():.6g} to {c.gap.max():.6g} m"
    start = ", ".join(f"body {k} at {scene.velocity[k]:.6g} m/s" for k in moving[:3])
    yield "start", f"{start or 'at rest'}{f' and {len(moving) - 3} more' if len(moving) > 3 else ''}"
    for side in ("wall_left", "wall_right"):
        if (wall := getattr(scene, side)) is not None:
            yield side.replace("_", " "), f"stiffness {wall.stiffness:.6g}, gap {wall.gap:.6g} m, n = {wall.exponent:g}"
    for part, value, unit in (
        ("gravity", scene.gravity, "m/s^2"),
        ("precompression", scene.precompression, "N"),
        ("drag", scene.drag, "1/s"),
    ):
        if value:
            yield part, f"{value:.6g} {unit}"
    if scene.damping is not None:
        yield "damping", scene.damping.law
    yield "duration", f"{scene.duration:.6g} s, {scene.samples} samples"
