"""The commands ``dem-bridge import csv`` and ``dem-bridge import deck``, which write scene files."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

import dem_bridge
from dem_bridge.cli.options import check_new, with_options
from dem_bridge.foundation.files import text_of_file, write_whole

if TYPE_CHECKING:
    from dem_bridge.scene.scene import Scene


@with_options("import deck")
def deck(script: Path, output: Path, force: bool, variables: tuple[tuple[str, str], ...], **settings: Any) -> None:
    """Convert SCRIPT, a LAMMPS input script in which every body is a sphere on one line."""
    from dem_bridge.api.scenes import deck_read
    from dem_bridge.lmp.known_defects import known_defects
    from dem_bridge.lmp.mixing import mixing_warning, stated_release

    check_new(output, force)
    read = deck_read(script, variables=dict(variables), **settings)
    text = text_of_file(script)
    for defect in (item for item in known_defects() if item.met_by(text)):
        releases = f"LAMMPS {defect.first} to {defect.last or 'the newest release'}"
        click.echo(f"dem-bridge: warning: {script}: with {releases}, it meets the {defect}", err=True)
    if warning := mixing_warning(read.mixed, stated_release(text)):
        click.echo(f"dem-bridge: warning: {script}: {warning}", err=True)
    _write_scene(read.scene, output, read.notes, max(read.time_steps, default=0.0))


@with_options("import csv")
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
    from dem_bridge.scene.file.text import scene_toml

    write_whole(output.parent, {output.name: scene_toml(scene)})
    for note in notes:
        click.echo(f"read: {note}")
    for part, text in _summary(scene):
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
    for part, unit in {"gravity": "m/s^2", "precompression": "N", "drag": "1/s"}.items():
        if value := getattr(scene, part):
            yield part, f"{value:.6g} {unit}"
    if scene.damping is not None:
        yield "damping", scene.damping.law
    yield "duration", f"{scene.duration:.6g} s, {scene.samples} samples"
