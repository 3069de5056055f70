"""The command ``dem-bridge export``: tables of a scene for papers, spreadsheets and LAMMPS."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from dem_bridge.cli import terminal
from dem_bridge.cli.options import (
    accuracy_option,
    check_not_input,
    engine_options,
    geometry_option,
    samples_option,
    scene_argument,
    step_option,
    types_option,
)

#: repeated here so that --help does not import numpy; a test compares them with the package
TABLES = ("contacts", "pair-coeffs", "bodies", "observables", "stiffness-curve", "angles")
FORMATS = ("csv", "json", "md", "tex", "parquet", "lammps")


def _names(ctx: click.Context, param: click.Parameter, value: str | None) -> list[str] | None:
    """Return the names of a list with commas."""
    return None if value is None else [name.strip() for name in value.split(",")]


def _degrees(ctx: click.Context, param: click.Parameter, value: str | None) -> list[float] | None:
    """Return the numbers of a list with commas."""
    try:
        return None if value is None else [float(angle) for angle in value.split(",")]
    except ValueError as error:
        raise click.BadParameter(f"{error}; allowed: numbers separated by commas") from None


def export_command(backends: tuple[str, ...]) -> click.Command:
    """Return the command ``export``; ``backends`` are the allowed names of --backend."""

    @click.command("export")
    @scene_argument
    @click.option("--table", type=click.Choice(TABLES), required=True, help="Table to write.")
    @click.option(
        "--format", type=click.Choice(FORMATS), help="Format of the table.  [default: by the ending of FILE, else csv]"
    )
    @click.option(
        "--columns", callback=_names, metavar="A,B", help="Columns to write, by their names in csv.  [default: all]"
    )
    @click.option(
        "--backend", type=click.Choice(backends), help="Backend of the run in the table.  [default: reference]"
    )
    @step_option
    @accuracy_option
    @samples_option
    @click.option("--no-run", is_flag=True, help="Write the table contacts without results of a run.")
    @geometry_option
    @types_option
    @click.option(
        "--surrogate-radius",
        type=float,
        metavar="M",
        help="Radius of the bodies in the deck, m.  [default: a power of two above the largest overlap]",
    )
    @click.option(
        "--law",
        type=click.Choice(["paper", "exact"]),
        help="Stiffness law of the table angles.  [default: the scene's law]",
    )
    @click.option(
        "--within",
        type=float,
        metavar="R",
        help="Relative error of the stiffness from which the angle tolerances follow.  [default: 0.01]",
    )
    @click.option(
        "--angles",
        callback=_degrees,
        metavar="A,B",
        help="Angles of the table stiffness-curve, degrees.  [default: 0.1 to 90]",
    )
    @click.option("--radius", type=float, metavar="M", help="Radius of the cylinders, m.  [default: the scene's]")
    @click.option(
        "--youngs-modulus",
        type=float,
        metavar="PA",
        help="Young's modulus of the cylinders, Pa.  [default: the scene's]",
    )
    @click.option(
        "--poissons-ratio", type=float, metavar="NU", help="Poisson's ratio of the cylinders.  [default: the scene's]"
    )
    @engine_options
    @click.option(
        "-o", "output", type=click.Path(path_type=Path), metavar="FILE", help="File to write.  [default: stdout]"
    )
    def export(scene: str, table: str, format: str | None, output: Path | None, no_run: bool, **settings: Any) -> None:
        """Write a table of SCENE.

        The tables have contacts, bodies, LAMMPS coefficients, results of a run, or contact angles.
        """
        from dem_bridge.api.tables import export_table
        from dem_bridge.exports.formats import format_for

        check_not_input(scene, output)
        chosen = format_for("csv" if format is None and output is None else format, output, table)
        if chosen == "parquet" and output is None:
            raise click.UsageError("parquet is a binary format and cannot be printed; name a file: -o FILE.parquet.")
        keywords = {key: value for key, value in settings.items() if value is not None}
        if no_run:
            keywords["with_run"] = False
        with terminal.fraction(f"table {table} of {scene}"):
            data, content = export_table(scene, table=table, format=chosen, path=output, **keywords)
        if chosen in ("csv", "parquet"):  # the other formats contain the notes
            for note in data.notes:
                click.echo(f"dem-bridge: note: {note}", err=True)
        if output is None:
            click.echo(content, nl=False)
        else:
            click.echo(f"written: {output}")

    return export
