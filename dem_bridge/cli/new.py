"""The command ``dem-bridge new``: a scene file to change, with every key explained in it."""

from __future__ import annotations

import re
import shlex
from importlib import resources
from pathlib import Path

import click

from dem_bridge.cli.options import check_new
from dem_bridge.errors import UsageError
from dem_bridge.files import write_whole

#: each form of a scene file with what it is for; a template has its name
FORMS = {
    "pattern": "a unit cell of spheres and cylinders, repeated; several materials",
    "cylinders": "equal cylinders that cross at angles, as the paper's",
    "spheres": "spheres, equal or tapered",
    "raw": "masses, stiffnesses and velocities as numbers",
}
#: in every template, and as Scene has it
_NAME, _NAMES = "my-chain", re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,99}")


def template(form: str, name: str) -> str:
    """The scene file of a form (a key of FORMS), for a scene of that name."""
    text = resources.files("dem_bridge").joinpath("scene_file", "templates", f"{form}.toml").read_text(encoding="utf-8")
    return text.replace(f'"{_NAME}"', f'"{name}"', 1)


@click.command("new", epilog=f"Forms: {'. '.join(f'{form}: {what}' for form, what in FORMS.items())}.")
@click.argument("file", type=click.Path(path_type=Path), metavar="[NAME.toml]", default=Path(f"{_NAME}.toml"))
@click.option("--form", type=click.Choice(tuple(FORMS)), default="pattern", show_default=True, help="What is given.")
@click.option("--force", is_flag=True, help="Replace a file that is there.")
def new_command(file: Path, form: str, force: bool) -> None:
    """Write a scene file to be changed, with every key explained.

    It runs as it is; optional parts are commented out. NAME.toml: my-chain.toml where nothing is said; the scene has
    its name.
    """
    if not file.name:
        raise UsageError(f"{file}: is a folder; name a file, such as {_NAME}.toml")
    if file.suffix != ".toml":
        file = file.with_name(f"{file.name}.toml")
    if not _NAMES.fullmatch(file.stem):
        raise UsageError(f"{file}: {file.stem!r} names no scene; allowed: 1 to 100 of A-Z a-z 0-9 . _ -")
    check_new(file, force)
    write_whole(file.parent, {file.name: template(form, file.stem)})
    path = shlex.quote(str(file))
    click.echo(f"written: {file} ({form}: {FORMS[form]})")
    click.echo("change what you like in it, then:")
    for words in ("run {} --backend reference", "run {} --accuracy 1e-4", "deck {} -o deck/", "verify {} -o report/"):
        click.echo(f"  dem-bridge {words.format(path)}")
