"""The commands ``new``, ``import csv`` and ``import deck``, which write scene files, and ``schema`` of these files."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterable
from dataclasses import replace
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

import dem_bridge
from dem_bridge.cli import options
from dem_bridge.cli.parameters import (
    FILE,
    FINITE,
    NOT_NEGATIVE,
    Argument,
    Option,
    check_new,
    json_text,
    make_command,
    wall,
)
from dem_bridge.errors import UsageError
from dem_bridge.foundation.files import text_of_file, write_whole

if TYPE_CHECKING:
    from dem_bridge.scene.scene import Scene

#: forms of a scene file with their use; templates have the same names
FORMS = {
    "pattern": "a repeated unit cell of spheres and cylinders of one or more materials",
    "cylinders": "equal cylinders that cross at angles, as in the paper",
    "spheres": "equal or tapered spheres",
    "impact": "two spheres, or a sphere and a plane, that approach each other",
    "raw": "masses, stiffnesses and velocities as numbers",
}
#: name of the scene in every template, and the names that Scene allows
_NAME, _NAMES = "my-chain", re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,99}")
#: the table [measurement], with which every template ends
_MEASUREMENT = """
#[measurement]                 # measured values beside the scene: dem-bridge study measurement FILE
#file = "laser.csv"            # columns time_s, body, velocity_m_per_s, uncertainty_m_per_s (standard uncertainty)
#source = "who measured what"
#kind = "measured"             # or "digitised" (a published figure), or "synthetic"
#fit = ["stiffness"]           # parameters to fit
#[measurement.parameters]      # standard uncertainties, here relative to the scene's values
#stiffness = 0.02             # standard uncertainty, relative
"""
#: comment on the first line of a scene file
_FOR_EDITORS = "(The line above is for editors; the file that it names is written by: dem-bridge schema -o FILE)"


def template(form: str, name: str) -> str:
    """Return the scene file of a form (a key of FORMS) with the scene's name ``name``."""
    from dem_bridge.scene.file.editor_schema import SCHEMA_FILE
    from dem_bridge.scene.file.forms import Environment

    text = (
        resources.files("dem_bridge").joinpath("scene", "file", "templates", f"{form}.toml").read_text(encoding="utf-8")
    )
    head, *keys = Environment.template_lines()
    text = text.replace(f'"{_NAME}"', f'"{name}"', 1).replace(head, "\n".join([head, *keys]))
    return f"#:schema ./{SCHEMA_FILE}\n# {_FOR_EDITORS}\n{text}{_MEASUREMENT}"


@make_command(
    "new",
    Argument("file", "[NAME.toml]", FILE, value="my-chain.toml", required=False),
    Option("form", "Form of the scene file; see below.", tuple(FORMS), default="pattern", value="pattern"),
    replace(options.FORCE, help="Replace the file if it exists."),
    epilog=f"Forms: {'. '.join(f'{form}: {use}' for form, use in FORMS.items())}.",
)
def new(file: Path, form: str, force: bool) -> None:
    """Write a new scene file in which every key is explained.

    The scene can be run without changes; optional parts are commented out. The default file is my-chain.toml. The name
    of the scene is that of the file.
    """
    if not file.name:
        raise UsageError(f"{file}: the path is a folder; name a file, such as {_NAME}.toml")
    if file.suffix != ".toml":
        file = file.with_name(f"{file.name}.toml")
    if not _NAMES.fullmatch(file.stem):
        raise UsageError(
            f"{file}: {file.stem!r} is not a valid name of a scene; allowed: 1 to 100 of the characters"
            " A-Z a-z 0-9 . _ -"
        )
    check_new(file, force)
    write_whole(file.parent, {file.name: template(form, file.stem)})
    path = shlex.quote(str(file))
    click.echo(f"written: {file} ({form}: {FORMS[form]})")
    click.echo("edit the file, then run for example:")
    for words in ("run {} --backend reference", "run {} --accuracy 1e-4", "deck {} -o deck/", "verify {} -o report/"):
        click.echo(f"  dem-bridge {words.format(path)}")


@make_command("schema", replace(options.OUTPUT, help="File for the schema.", default="stdout"), options.FORCE)
def schema(force: bool, output: Path | None = None) -> None:
    """Print the JSON Schema of scene files.

    Editors use it to complete keys, to explain them and to mark mistakes while a scene file is written.
    """
    from dem_bridge.scene.file.editor_schema import scene_schema

    text = json_text(scene_schema())
    if output is None:
        click.echo(text)
        return
    check_new(output, force)
    write_whole(output.parent, {output.name: f"{text}\n"})
    click.echo(f"written: {output}")


@make_command(
    "deck",
    Argument("script", "SCRIPT", FILE),
    *options.SCENE_FILE,
    replace(options.DURATION, default="that of the script's runs"),
    replace(options.SAMPLES, default="the frames of the first dump"),
    Option(
        "reverse",
        "Place body 0 at the highest or at the lowest coordinate.",
        bool,
        flags=("--reverse/--no-reverse",),
        default="the end that moves, else the lowest",
    ),
    replace(options.VARIABLES, help="Value of a variable, as LAMMPS accepts it by -var; can be repeated."),
)
def deck(script: Path, output: Path, force: bool, variables: tuple[tuple[str, str], ...], **settings: Any) -> None:
    """Convert SCRIPT, a LAMMPS input script in which every body is a sphere on one line."""
    from dem_bridge.api.scenes import deck_read
    from dem_bridge.lmp.known_defects import known_defects
    from dem_bridge.lmp.reader.mixing import mixing_warning, stated_release

    check_new(output, force)
    read = deck_read(script, variables=dict(variables), **settings)
    text = text_of_file(script)
    for defect in (item for item in known_defects() if item.met_by(text)):
        releases = f"LAMMPS {defect.first} to {defect.last or 'the newest release'}"
        click.echo(f"dem-bridge: warning: {script}: with {releases}, it meets the {defect}", err=True)
    if warning := mixing_warning(read.mixed, stated_release(text)):
        click.echo(f"dem-bridge: warning: {script}: {warning}", err=True)
    _write_scene(read.scene, output, read.notes, max(read.time_steps, default=0.0))


@make_command(
    "csv",
    Argument("bodies", "BODIES", FILE),
    *options.SCENE_FILE,
    Option("contacts", "CSV table of the contacts, if BODIES has none.", FILE, metavar="CSV"),
    replace(options.DURATION, required=True),
    replace(options.SAMPLES, default="500"),
    Option(
        "gravity",
        "Gravity, m/s^2, positive towards the last body.",
        float,
        metavar="G",
        unit="m/s^2",
        limits=FINITE,
        default="0",
    ),
    Option(
        "drag",
        "Drag, 1/s: a force -B m v acts on each body.",
        float,
        metavar="B",
        unit="1/s",
        limits=NOT_NEGATIVE,
        default="0",
    ),
    Option(
        "precompression",
        "Static force on the ends, N; the chain starts in equilibrium with it.",
        float,
        unit="N",
        limits=NOT_NEGATIVE,
        default="0",
    ),
    *(
        Option(
            f"wall_{side}",
            f"Wall {place}: stiffness (N/m^(n-1)), gap (m) and exponent n.",
            wall,
            metavar="K[,GAP[,N]]",
        )
        for side, place in {"left": "before body 0", "right": "behind the last body"}.items()
    ),
)
def csv(bodies: Path, output: Path, force: bool, **settings: Any) -> None:
    """Convert BODIES, a CSV table with a row per body.

    The columns are mass_kg and velocity_m_per_s, and for the contact to the next body stiffness_N_per_m^(n-1), exponent
    and gap_m. The tables bodies and contacts of `dem-bridge export` can be read too.
    """
    check_new(output, force)
    _write_scene(dem_bridge.scene_from_csv(bodies, **settings), output, ())


import_group = click.Group("import", [deck, csv], help="Convert CSV tables or a LAMMPS input script to a scene file.")


def _write_scene(scene: Scene, output: Path, notes: Iterable[str], step: float = 0.0) -> None:
    """Write the scene file and print a summary of the scene; ``step`` is the time step of the script, s."""
    from dem_bridge.scene.file.write import scene_toml

    write_whole(output.parent, {output.name: scene_toml(scene)})
    for note in notes:
        click.echo(f"read: {note}")
    for part, text in summary_lines(scene):
        click.echo(f"{part:14} {text}")
    click.echo(f"written: {output}")
    if step > 0.0:
        click.echo(
            f"not tested: the script's time step, {step:.12g} s; a scene has no time step, and verify chooses its own"
        )
        click.echo(
            f"next: dem-bridge run {output} --backend lammps-granular --dt {step:.12g}  # accuracy at the script's step"
        )
    click.echo(f"next: dem-bridge verify {output}")


def summary_lines(scene: Scene) -> Iterable[tuple[str, str]]:
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
    for part, unit in {"gravity": "m/s^2", "precompression": "N", "drag": "1/s"}.items():
        if value := getattr(scene, part):
            yield part, f"{value:.6g} {unit}"
    if scene.damping is not None:
        yield "damping", scene.damping.law
    yield "duration", f"{scene.duration:.6g} s, {scene.samples} samples"
