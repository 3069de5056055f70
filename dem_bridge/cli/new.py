"""The commands ``dem-bridge new``, which writes a scene file with comments on every key, and ``dem-bridge schema``."""

from __future__ import annotations

import re
import shlex
from importlib import resources
from pathlib import Path

import click

from dem_bridge.cli.options import check_new, json_text, with_options
from dem_bridge.errors import UsageError
from dem_bridge.foundation.files import write_whole

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
    from dem_bridge.scene.file.forms import Environment
    from dem_bridge.scene.file.schema import SCHEMA_FILE

    text = (
        resources.files("dem_bridge").joinpath("scene", "file", "templates", f"{form}.toml").read_text(encoding="utf-8")
    )
    head, *keys = Environment.template_lines()
    text = text.replace(f'"{_NAME}"', f'"{name}"', 1).replace(head, "\n".join([head, *keys]))
    return f"#:schema ./{SCHEMA_FILE}\n# {_FOR_EDITORS}\n{text}{_MEASUREMENT}"


@with_options("new", epilog=f"Forms: {'. '.join(f'{form}: {use}' for form, use in FORMS.items())}.")
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


@with_options("schema")
def schema(force: bool, output: Path | None = None) -> None:
    """Print the JSON Schema of scene files.

    Editors use it to complete keys, to explain them and to mark mistakes while a scene file is written.
    """
    from dem_bridge.scene.file.schema import scene_schema

    text = json_text(scene_schema())
    if output is None:
        click.echo(text)
        return
    check_new(output, force)
    write_whole(output.parent, {output.name: f"{text}\n"})
    click.echo(f"written: {output}")
