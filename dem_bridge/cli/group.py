"""The command line: words in, words out, exit codes. No science, and nothing heavy imported before it is needed.

Answers go to stdout, progress to stderr and only on a terminal. Exit codes: 0 all pass, 1 a check failed, 2 wrong use
or a bad scene, 3 a run broke, 4 undecided.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

import dem_bridge
from dem_bridge.backends.catalogue import BACKENDS
from dem_bridge.cli import terminal
from dem_bridge.cli.convert import compare_command, convert_command
from dem_bridge.cli.export import export_command
from dem_bridge.cli.imports import import_group
from dem_bridge.cli.new import new_command
from dem_bridge.cli.options import (
    accuracy_option,
    engine_options,
    jobs_option,
    not_the_input,
    scene_argument,
    scene_names,
    step_option,
)
from dem_bridge.cli.plan import plan_command
from dem_bridge.cli.regress import regress_command
from dem_bridge.cli.studies import study as study_group
from dem_bridge.errors import DemBridgeError, UnsupportedScene
from dem_bridge.files import check_file, write_whole

if TYPE_CHECKING:
    from dem_bridge.trajectory import Trajectory


class _Group(click.Group):
    """A group in which every error of dem_bridge is one line and an exit code, never a traceback."""

    def invoke(self, ctx: click.Context) -> Any:
        try:
            return super().invoke(ctx)
        except UnsupportedScene as error:
            _complain(f"NOT_RUN: {error}")
            ctx.exit(2)
        except DemBridgeError as error:
            _complain(str(error))
            ctx.exit(error.exit_code)
        except click.UsageError as error:
            command = error.ctx.command_path if error.ctx else "dem-bridge"
            _complain(f"{error.format_message()} See: {command} --help")
            ctx.exit(2)
        except (OSError, ArithmeticError, MemoryError) as error:
            _complain(f"{type(error).__name__}: {error}; the run was given up")
            ctx.exit(3)
        except KeyboardInterrupt:
            _complain("interrupted; the run was given up")
            ctx.exit(130)


def _complain(text: str) -> None:
    click.echo(f"dem-bridge: {' '.join(text.split())}", err=True)


def _form(command: Callable[..., None]) -> Callable[..., None]:
    """The options that say how a deck is laid out."""
    options = (
        click.option(
            "--geometry",
            type=click.Choice(["surrogate", "physical"]),
            help="Radius in the deck: the smallest that serves, or the scene's own.  [default: surrogate]",
        ),
        click.option(
            "--types",
            type=click.Choice(["euler", "per-body"]),
            help="Atom types: as few as can be, or one a body.  [default: euler]",
        ),
    )
    for option in reversed(options):
        command = option(command)
    return command


@click.group(cls=_Group, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.version_option(dem_bridge.__version__, prog_name="dem-bridge")
def main() -> None:
    """Verify simulations of one-dimensional granular chains against LAMMPS.

    A SCENE is the name of a shipped scene (see `dem-bridge scenes`) or the path of a .toml file.
    """


@main.command()
@click.option("--json", "as_json", is_flag=True, help="JSON on stdout.")
def scenes(as_json: bool) -> None:
    """List the shipped scenes."""
    found = [dem_bridge.load_scene(name) for name in dem_bridge.shipped_scenes()]
    if as_json:
        click.echo(
            json.dumps(
                [
                    {
                        "name": s.name,
                        "bodies": s.n_body,
                        "contacts": s.n_contact,
                        "duration": s.duration,
                        "description": s.description,
                        "hash": s.content_hash,
                    }
                    for s in found
                ],
                indent=1,
            )
        )
        return
    terminal.print_scenes(found)


@main.command()
@scene_argument
@click.option(
    "--backend", type=click.Choice(BACKENDS), help="Which code; with an accuracy, by default the cheapest for it."
)
@step_option
@accuracy_option
@click.option("--rtol", type=float, metavar="R", help="Relative tolerance of scipy and ode45.")
@click.option("--atol", type=float, metavar="A", help="Absolute tolerance of ode45, m and m/s.")
@click.option("--samples", type=int, metavar="N", help="Samples in time (default: the scene's).")
@_form
@engine_options
@click.option("-o", "output", type=click.Path(path_type=Path), help="Keep the trajectory as netCDF-4.")
@click.option("--json", "as_json", is_flag=True, help="JSON on stdout.")
def run(
    scene: str,
    backend: str | None,
    dt: float | None,
    accuracy: float | None,
    rtol: float | None,
    atol: float | None,
    samples: int | None,
    geometry: str | None,
    types: str | None,
    lmp: str | None,
    lmp_args: str | None,
    python: str | None,
    ranks: int | None,
    output: Path | None,
    as_json: bool,
) -> None:
    """Solve SCENE with one backend and print what was found, with error bars."""
    if backend is None and accuracy is None:
        raise click.UsageError("Missing option '--backend', or an '--accuracy' from which it follows.")
    if output is not None:
        not_the_input(scene, output)
        check_file(output)
    asked: dict[str, Any] = {"dt": dt, "accuracy": accuracy, "rtol": rtol, "atol": atol, "samples": samples}
    asked |= {"geometry": geometry, "types": types, "lmp": lmp, "lmp_args": lmp_args, "python": python, "ranks": ranks}
    settings = {key: value for key, value in asked.items() if value is not None}
    with terminal.fraction(f"{scene} by {backend or 'the cheapest backend'}"):
        result = dem_bridge.solve(scene, backend=backend, **settings)
    _warn(result)
    if output is not None:
        result.save(output)
    summary = _summary(result)
    if as_json:
        click.echo(json.dumps(summary, indent=1, allow_nan=False))
        return
    if backend is None:
        click.echo(f"{'chosen as the cheapest':30} {summary['backend']} (why: dem-bridge plan)")
    for key, value in summary.items():
        if key not in ("settings", "versions"):
            click.echo(f"{key.replace('_', ' '):30} {f'{value:.7g}' if isinstance(value, float) else value}")
    if output is not None:
        click.echo(f"{'written':30} {output}")


@main.command()
@scene_argument
@click.option("--style", type=click.Choice(["granular", "table"]), default="granular", show_default=True)
@step_option
@_form
@click.option("-o", "folder", required=True, type=click.Path(path_type=Path), metavar="DIR")
def deck(scene: str, style: str, dt: float | None, geometry: str | None, types: str | None, folder: Path) -> None:
    """Write the LAMMPS deck of SCENE into DIR; it runs there by `lmp -in in.NAME`."""
    asked = {"dt": dt, "geometry": geometry, "types": types}
    settings = {key: value for key, value in asked.items() if value is not None}
    for path in dem_bridge.write_deck(scene, folder, style=style, **settings):
        click.echo(path)


@main.command()
@click.argument("scenes", nargs=-1, metavar="[SCENE]...", shell_complete=scene_names)
@accuracy_option
@engine_options
@jobs_option
@click.option(
    "--no-cache", "recompute", is_flag=True, help="Make all runs anew, those that are stored from before too."
)
@click.option(
    "-o",
    "folder",
    type=click.Path(path_type=Path),
    default=Path("reports/latest"),
    show_default=True,
    metavar="DIR",
    help="Where index.html and verdicts.json go.",
)
@click.option(
    "--bundle", type=click.Path(path_type=Path), metavar="DIR", help="All that a reviewer needs to run it again, too."
)
@click.option("--json", "json_file", type=click.Path(path_type=Path), metavar="FILE", help="Verdicts as JSON too.")
@click.option(
    "--junit", "junit_file", type=click.Path(path_type=Path), metavar="FILE", help="Verdicts as JUnit XML too."
)
def verify(
    scenes: tuple[str, ...],
    accuracy: float | None,
    lmp: str | None,
    lmp_args: str | None,
    python: str | None,
    ranks: int | None,
    jobs: int | None,
    recompute: bool,
    folder: Path,
    bundle: Path | None,
    json_file: Path | None,
    junit_file: Path | None,
) -> None:
    """Verify scenes and write the report; `paper` (the default): all shipped ones, with the paper's claims."""
    for file in (json_file, junit_file):
        if file is not None:
            check_file(file)
    asked = {"accuracy": accuracy, "lmp": lmp, "lmp_args": lmp_args, "python": python, "ranks": ranks}
    settings: dict[str, Any] = {key: value for key, value in asked.items() if value is not None}
    with terminal.bar() as progress:
        found = dem_bridge.verify(
            list(scenes) or None,
            folder=folder,
            bundle=bundle,
            jobs=jobs,
            progress=progress,
            recompute=recompute,
            **settings,
        )
    if json_file is not None:
        write_whole(json_file.parent, {json_file.name: (folder / "verdicts.json").read_text(encoding="utf-8")})
    if junit_file is not None:
        from dem_bridge.report.junit import junit

        write_whole(junit_file.parent, {junit_file.name: junit(found.verdicts)})
    for note in found.notes:
        _complain(f"warning: {note}")
    for study in found.studies:
        if (of_lammps := study.run(study.engine)) is not None:
            _warn(of_lammps)
    terminal.print_verdicts(found)
    click.echo(f"report: {folder / 'index.html'}")
    if bundle is not None:
        click.echo(f"bundle: {bundle}; again by: sh {bundle / 'replay.sh'}")
    sys.exit(found.exit_code)


@main.command()
@click.option("--json", "as_json", is_flag=True, help="JSON on stdout.")
@engine_options
def doctor(as_json: bool, lmp: str | None, lmp_args: str | None, python: str | None, ranks: int | None) -> None:
    """Say what is there and, for what is missing, what to do. Exit code 3 if a default run cannot be made."""
    from dem_bridge.doctor import examine
    from dem_bridge.lmp.engine import Engine

    found = examine(Engine.chosen(lmp=lmp, lmp_args=lmp_args, python=python, ranks=ranks))
    if as_json:
        click.echo(json.dumps([finding.as_dict() for finding in found], indent=1))
    else:
        for finding in found:
            click.echo(str(finding))
    sys.exit(0 if all(finding.fine or not finding.needed for finding in found) else 3)


main.add_command(study_group)
main.add_command(new_command)
main.add_command(plan_command(tuple(BACKENDS)))
main.add_command(export_command(tuple(BACKENDS)))
main.add_command(regress_command(tuple(BACKENDS)))
main.add_command(convert_command)
main.add_command(compare_command)
main.add_command(import_group)


def _warn(run: Trajectory) -> None:
    """Say on stderr what a user should know of how LAMMPS was run."""
    if note := run.provenance.get("lammps", {}).get("note"):
        click.echo(f"dem-bridge: warning: {run.provenance['scene']}: {note}", err=True)


def _summary(run: Trajectory) -> dict[str, Any]:
    """What a person asks first of a trajectory; JSON-able."""
    import numpy as np

    def estimate(name: str) -> float | None:
        value = float(np.nanmax(run.uncertainty[name], initial=0.0))
        return value if np.isfinite(value) else None

    errors = ("predicted_error", "measured_error") if "table" in run.provenance else ()
    floor = run.uncertainty.roundoff_floor
    crossed = run.crossing_time[np.isfinite(run.crossing_time)]
    return {
        "scene": run.provenance["scene"],
        "backend": run.provenance["backend"],
        "settings": run.provenance["settings"],
        "samples": len(run.time) - 1,
        "largest_velocity_m_per_s": float(np.max(np.abs(run.velocity))),
        "velocity_uncertainty_m_per_s": estimate("velocity"),
        "largest_force_N": float(np.max(run.peak_force, initial=0.0)),
        "force_uncertainty_N": estimate("peak_force"),
        "last_crossing_s": float(crossed[-1]) if len(crossed) else None,
        "crossing_uncertainty_s": estimate("crossing_time"),
        "roundoff_floor_relative": floor if np.isfinite(floor) else None,
        **{f"table_{name}_relative": run.provenance["table"][name] for name in errors},
        "steps": run.cost.steps,
        "force_evaluations": run.cost.force_evaluations,
        "wall_s": round(run.cost.wall, 4),
        "cpu_s": round(run.cost.cpu, 4),
        "versions": run.provenance["versions"],
    }


def command() -> None:
    """:func:`main` as a program: once all is said it ends at once, for the interpreter's own farewell takes 0.3 s."""
    code: str | int | None = 1
    try:
        main()
    except SystemExit as end:
        code = end.code
    if "multiprocessing.process" in sys.modules or isinstance(code, str):
        sys.exit(code)  # what else is running is waited for
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code or 0)


if __name__ == "__main__":
    command()
