"""The commands ``dem-bridge import csv`` and ``dem-bridge import deck``, which write scene files."""

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
    """Convert CSV tables or a LAMMPS input script to a scene file."""


def _output_options(command: Callable[..., None]) -> Callable[..., None]:
    """Add the options of both commands."""
    options = (
        click.option("-o", "output", type=_FILE, required=True, metavar="FILE", help="Scene file to write, .toml."),
        click.option("--force", is_flag=True, help="Replace FILE if it exists."),
        click.option("--name", metavar="NAME", help="Name of the scene.  [default: the name of the file that is read]"),
        click.option("--description", metavar="TEXT", help="Description of the scene in one line."),
    )
    for option in reversed(options):
        command = option(command)
    return command


def _variables(ctx: click.Context, param: click.Parameter, value: tuple[str, ...]) -> dict[str, str]:
    """Return the variables of options NAME=VALUE."""
    pairs = [word.partition("=") for word in value]
    if wrong := next((word for word, (_, sign, _) in zip(value, pairs, strict=True) if not sign), None):
        raise click.BadParameter(f"{wrong!r}; allowed: NAME=VALUE")
    return {name: text for name, _, text in pairs}


def _wall(ctx: click.Context, param: click.Parameter, value: str | None) -> Wall | None:
    """Return the wall of an option STIFFNESS[,GAP[,EXPONENT]]."""
    if value is None:
        return None
    try:
        numbers = [float(word) for word in value.split(",")]
    except ValueError:
        numbers = []
    if not 1 <= len(numbers) <= 3:
        raise click.BadParameter(f"{value!r}; allowed: STIFFNESS[,GAP[,EXPONENT]]")
    return dem_bridge.Wall(**dict(zip(("stiffness", "gap", "exponent"), numbers, strict=False)))


@import_group.command("deck")
@click.argument("script", type=_FILE, metavar="SCRIPT")
@_output_options
@click.option("--duration", type=float, metavar="S", help="Duration, s.  [default: that of the script's runs]")
@click.option(
    "--samples", type=int, metavar="N", help="Number of samples in time.  [default: the frames of the first dump]"
)
@click.option(
    "--reverse/--no-reverse",
    default=None,
    help="Place body 0 at the highest or at the lowest coordinate.  [default: the end that moves, else the lowest]",
)
@click.option(
    "--var",
    "variables",
    multiple=True,
    callback=_variables,
    metavar="NAME=VALUE",
    help="Value of a variable, as LAMMPS accepts it by -var; can be repeated.",
)
def deck_command(script: Path, output: Path, force: bool, **settings: Any) -> None:
    """Convert SCRIPT, a LAMMPS input script in which every body is a sphere on one line."""
    from dem_bridge.api.scenes import deck_read

    check_new(output, force)
    deck = deck_read(script, **settings)
    _write_scene(deck.scene, output, deck.notes)


@import_group.command("csv")
@click.argument("bodies", type=_FILE, metavar="BODIES")
@_output_options
@click.option("--contacts", type=_FILE, metavar="CSV", help="CSV table of the contacts, if BODIES has none.")
@click.option("--duration", type=float, required=True, metavar="S", help="Duration, s.")
@click.option("--samples", type=int, metavar="N", help="Number of samples in time.  [default: 500]")
@click.option(
    "--gravity", type=float, metavar="G", help="Gravity, m/s^2, positive towards the last body.  [default: 0]"
)
@click.option("--drag", type=float, metavar="B", help="Drag, 1/s: a force -B m v acts on each body.  [default: 0]")
@click.option(
    "--precompression",
    type=float,
    metavar="N",
    help="Static force on the ends, N; the chain starts in equilibrium with it.  [default: 0]",
)
@click.option(
    "--wall-left",
    callback=_wall,
    metavar="K[,GAP[,N]]",
    help="Wall before body 0: stiffness (N/m^(n-1)), gap (m) and exponent n.",
)
@click.option(
    "--wall-right",
    callback=_wall,
    metavar="K[,GAP[,N]]",
    help="Wall behind the last body: stiffness (N/m^(n-1)), gap (m) and exponent n.",
)
def csv_command(bodies: Path, output: Path, force: bool, **settings: Any) -> None:
    """Convert BODIES, a CSV table with a row per body.

    The columns are mass_kg and velocity_m_per_s, and for the contact to the next body stiffness_N_per_m^(n-1), exponent
    and gap_m. The tables bodies and contacts of `dem-bridge export` can be read too.
    """
    check_new(output, force)
    scene = dem_bridge.scene_from_csv(bodies, **{key: value for key, value in settings.items() if value is not None})
    _write_scene(scene, output, ())


def _write_scene(scene: Scene, output: Path, notes: Iterable[str]) -> None:
    """Write the scene file and print a summary of the scene."""
    from dem_bridge.scene_file.text import scene_toml

    write_whole(output.parent, {output.name: scene_toml(scene)})
    for note in notes:
        click.echo(f"read: {note}")
    for part, text in _summary(scene):
        click.echo(f"{part:14} {text}")
    click.echo(f"written: {output}")
    click.echo(f"next: dem-bridge verify {output}")


def _summary(scene: Scene) -> Iterable[tuple[str, str]]:
    """Yield the lines of a summary of the scene as pairs of name and text."""
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
