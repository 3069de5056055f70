"""The command ``dem-bridge export``: tables of a scene for papers, spreadsheets and LAMMPS."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from dem_bridge.cli import terminal
from dem_bridge.cli.options import check_output, with_options


@with_options("export")
def export(
    scene: str,
    table: str,
    no_run: bool,
    force: bool,
    format: str | None = None,
    output: Path | None = None,
    **settings: Any,
) -> None:
    """Write a table of SCENE.

    The tables have contacts, bodies, LAMMPS coefficients, results of a run, or contact angles.
    """
    from dem_bridge.api.tables import export_table
    from dem_bridge.formats.tables.text import format_for

    if output is not None:
        check_output(scene, output, force)
    chosen = format_for("csv" if format is None and output is None else format, output, table)
    if chosen == "parquet" and output is None:
        raise click.UsageError("parquet is a binary format and cannot be printed; name a file: -o FILE.parquet.")
    if no_run:
        settings["with_run"] = False
    with terminal.fraction(f"table {table} of {scene}"):
        data, content = export_table(scene, table=table, format=chosen, path=output, **settings)
    if chosen in ("csv", "parquet"):  # the other formats contain the notes
        for note in data.notes:
            click.echo(f"dem-bridge: note: {note}", err=True)
    if output is None:
        click.echo(content, nl=False)
    else:
        click.echo(f"written: {output}")
