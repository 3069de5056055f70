"""The command ``dem-bridge export``: tables of a scene for papers, spreadsheets and LAMMPS."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from dem_bridge.cli import terminal
from dem_bridge.cli.options import accuracy_option, engine_options, not_the_input, scene_argument, step_option

#: named again here so that --help needs no numpy; a test holds them together
TABLES = ("contacts", "pair-coeffs", "bodies", "observables", "stiffness-curve", "angles")
FORMATS = ("csv", "json", "md", "tex", "parquet", "lammps")


def _listed(ctx: click.Context, param: click.Parameter, value: str | None) -> list[str] | None:
    return None if value is None else [one.strip() for one in value.split(",")]


def _degrees(ctx: click.Context, param: click.Parameter, value: str | None) -> list[float] | None:
    try:
        return None if value is None else [float(one) for one in value.split(",")]
    except ValueError as error:
        raise click.BadParameter(f"{error}; allowed: numbers with commas between them") from None


def export_command(backends: tuple[str, ...]) -> click.Command:
    """The command; ``backends`` that may be named."""

    @click.command("export")
    @scene_argument
    @click.option("--table", type=click.Choice(TABLES), required=True, help="What to tabulate.")
    @click.option("--format", type=click.Choice(FORMATS), help="How.  [default: by the ending of the file, else csv]")
    @click.option("--columns", callback=_listed, metavar="A,B", help="Only these, by their names in csv.")
    @click.option("--backend", type=click.Choice(backends), help="Whose results.  [default: reference]")
    @step_option
    @accuracy_option
    @click.option("--samples", type=int, metavar="N", help="Samples in time (default: the scene's).")
    @click.option("--no-run", is_flag=True, help="Contacts without what a run finds.")
    @click.option(
        "--geometry", type=click.Choice(["surrogate", "physical"]), help="Radius in the deck.  [default: surrogate]"
    )
    @click.option("--types", type=click.Choice(["euler", "per-body"]), help="Atom types of the deck.  [default: euler]")
    @click.option(
        "--surrogate-radius", type=float, metavar="M", help="Radius in the deck, m.  [default: least that serves]"
    )
    @click.option("--law", type=click.Choice(["paper", "exact"]), help="Of angles.  [default: the scene's]")
    @click.option(
        "--within", type=float, metavar="R", help="Error of stiffness that tolerances allow.  [default: 0.01]"
    )
    @click.option("--angles", callback=_degrees, metavar="A,B", help="Degrees, of the stiffness curve.")
    @click.option("--radius", type=float, metavar="M", help="Of the cylinders, m.  [default: the scene's]")
    @click.option("--youngs-modulus", type=float, metavar="PA", help="... Pa.  [default: the scene's]")
    @click.option("--poissons-ratio", type=float, metavar="NU", help="... no unit.  [default: the scene's]")
    @engine_options
    @click.option("-o", "output", type=click.Path(path_type=Path), metavar="FILE", help="Where.  [default: stdout]")
    def export(scene: str, table: str, format: str | None, output: Path | None, no_run: bool, **settings: Any) -> None:
        """Write a table of SCENE: its contacts, bodies, coefficients for LAMMPS, results, angles to set."""
        from dem_bridge.api.tables import exported
        from dem_bridge.exports.formats import format_for

        not_the_input(scene, output)
        chosen = format_for("csv" if format is None and output is None else format, output, table)
        if chosen == "parquet" and output is None:
            raise click.UsageError("parquet is no text for a terminal; name a file: -o FILE.parquet.")
        given = {key: value for key, value in settings.items() if value is not None}
        if no_run:
            given["found"] = False
        with terminal.fraction(f"table {table} of {scene}"):
            found, content = exported(scene, table=table, format=chosen, path=output, **given)
        if chosen in ("csv", "parquet"):  # the others have them in their text
            for note in found.notes:
                click.echo(f"dem-bridge: note: {note}", err=True)
        if output is None:
            click.echo(content, nl=False)
        else:
            click.echo(f"written: {output}")

    return export
