"""The commands of ``dem-bridge study``: questions that take many runs."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

import dem_bridge
from dem_bridge.cli import terminal
from dem_bridge.cli.options import engine_options, jobs_option, scene_argument, scene_names, step_option


def _asked(command: Callable[..., None]) -> Callable[..., None]:
    """The options that every study of :data:`dem_bridge.studies.catalogue.STUDIES` has."""
    options = (
        jobs_option,
        click.option(
            "--no-cache", "recompute", is_flag=True, help="Make all runs anew, those that are stored from before too."
        ),
        click.option(
            "-o", "folder", type=click.Path(path_type=Path), metavar="DIR", help="Keep page, tables, figures."
        ),
        click.option("--json", "as_json", is_flag=True, help="JSON on stdout."),
    )
    for option in reversed(options):
        command = option(command)
    return command


def _answer(name: str, *, folder: Path | None, as_json: bool, **settings: Any) -> None:
    """Ask, show, and leave with the study's exit code; settings that are None are left to the study."""
    with terminal.bar() as progress:
        found = dem_bridge.study(
            name,
            folder=folder,
            progress=progress,
            **{key: value for key, value in settings.items() if value is not None},
        )
    if as_json:
        click.echo(json.dumps(found.as_json(), indent=1, allow_nan=False))
    else:
        terminal.print_study(found)
        if folder is not None:
            click.echo(f"written: {folder / 'index.html'} and, beside it, tables, figures and {name}.json")
    sys.exit(130 if found.interrupted else found.exit_code)


@click.group()
def study() -> None:
    """Questions that take many runs of one scene."""


@study.command()
@scene_argument
@click.option("--spread", type=float, metavar="DEG", help="Standard deviation of each angle, degrees.  [default: 0.5]")
@click.option("--count", type=int, metavar="N", help="Chains.  [default: 200]")
@click.option("--seed", type=int, metavar="N", help="Of the first chain; the next have the next.  [default: 0]")
@jobs_option
@click.option("-o", "folder", type=click.Path(path_type=Path), metavar="DIR", help="Keep scatter.json, .csv and .png.")
@click.option("--json", "as_json", is_flag=True, help="JSON on stdout.")
def scatter(
    scene: str,
    spread: float | None,
    count: int | None,
    seed: int | None,
    jobs: int | None,
    folder: Path | None,
    as_json: bool,
) -> None:
    """Run a seeded set of SCENE's chains whose contact angles are a little off, and say what that does."""
    asked = {"spread": spread, "count": count, "seed": seed}
    settings: dict[str, Any] = {key: value for key, value in asked.items() if value is not None}
    with terminal.bar() as progress:
        found = dem_bridge.study_scatter(scene, folder=folder, jobs=jobs, progress=progress, **settings)
    if as_json:
        click.echo(json.dumps(found.as_json(), indent=1, allow_nan=False))
    else:
        terminal.print_scatter(found)
        if folder is not None:
            click.echo(f"written: {folder / 'scatter.png'} and, beside it, scatter.csv and scatter.json")


@study.command()
@scene_argument
@step_option
@click.option("--lmp", metavar="PATH", help="A LAMMPS binary (default: $DEM_BRIDGE_LMP, or the Python module).")
@click.option("--python", metavar="PATH", help="Another environment's Python, for its lammps module.")
@click.option("-o", "folder", type=click.Path(path_type=Path), metavar="DIR", help="Keep styles.csv, .json and .png.")
@click.option("--json", "as_json", is_flag=True, help="JSON on stdout.")
def styles(
    scene: str, dt: float | None, lmp: str | None, python: str | None, folder: Path | None, as_json: bool
) -> None:
    """Run SCENE through every way LAMMPS has, each beside the twin: styles, walls, suffixes, ranks, a restart."""
    with terminal.bar() as progress:
        found = dem_bridge.study_styles(scene, dt=dt, folder=folder, progress=progress, lmp=lmp, python=python)
    if as_json:
        click.echo(json.dumps(found.as_json(), indent=1, allow_nan=False))
    else:
        terminal.print_styles(found)
        if folder is not None:
            click.echo(f"written: {folder / 'styles.png'} and, beside it, styles.csv and styles.json")
    sys.exit(found.exit_code)


@study.command()
@scene_argument
@click.option("--accuracy", type=float, metavar="A", help="What models may be off, relative.  [default: 0.01]")
@click.option(
    "--observable",
    "observables",
    multiple=True,
    metavar="O",
    help="arrival, residence, peak_velocity, peak_force, velocity; can be repeated.  [default: all but velocity]",
)
@click.option("--window", metavar="W", help='"passage" of the front, or "whole" run.  [default: passage]')
@click.option("--dashpot", type=float, metavar="C", help="Supposed in contacts without damping, N s/m.  [default: 1]")
@click.option("--spread", type=float, metavar="DEG", help="Standard deviation of angles that scatter.  [default: 0.5]")
@click.option("--draws", type=int, metavar="N", help="Chains with such angles.  [default: 3]")
@click.option("--no-numerics", is_flag=True, help="Ask about the physics alone.")
@engine_options
@_asked
def model_hierarchy(observables: tuple[str, ...], no_numerics: bool, **settings: Any) -> None:
    """Say what SCENE requires: each piece of physics and each numerical choice left out, and the least model."""
    _answer("model-hierarchy", observables=observables or None, numerics=False if no_numerics else None, **settings)


@study.command("rule-of-thumb")
@click.argument("scene", required=False, shell_complete=scene_names)
@engine_options
@_asked
def rule_of_thumb(scene: str | None, folder: Path | None, as_json: bool, **settings: Any) -> None:
    """Judge steps of 5, 10, 20 and 40 % of the Rayleigh time, on SCENE or on every shipped one."""
    _answer("rule-of-thumb", scene=scene, folder=folder, as_json=as_json, **settings)


@study.command("work-precision")
@scene_argument
@click.option("--limit", type=float, metavar="S", help="Longest wall time of one run, s.  [default: 5]")
@click.option("--repeats", type=int, metavar="N", help="Timed calls of each setting, at most.  [default: 3]")
@click.option("-b", "--backend", "backends", multiple=True, metavar="NAME", help="One of them only; can be repeated.")
@engine_options
@_asked
def work_precision(scene: str, folder: Path | None, as_json: bool, backends: tuple[str, ...], **settings: Any) -> None:
    """Error of SCENE against cost, for every backend and each of its knobs, one run at a time."""
    _answer("work-precision", scene=scene, folder=folder, as_json=as_json, backends=backends or None, **settings)


@study.command()
@click.argument("scene", required=False, shell_complete=scene_names)
@click.option(
    "--gain", type=float, metavar="X", help="Growth of the energy in motion that is called unstable.  [default: 1]"
)
@click.option("--points", type=int, metavar="N", help="Scenes in each family.  [default: 7]")
@engine_options
@_asked
def stability(scene: str | None, folder: Path | None, as_json: bool, **settings: Any) -> None:
    """Largest stable and largest accurate steps of velocity-Verlet, for SCENE (decelerating-40) and four families."""
    _answer("stability", scene=scene, folder=folder, as_json=as_json, **settings)


@study.command()
@scene_argument
@click.option("--duration", type=float, metavar="S", help="Of the runs that are compared, s.  [default: the scene's]")
@step_option
@click.option(
    "--steps", type=int, metavar="N", help="Of the twin's long run.  [default: as many as the duration takes]"
)
@click.option("--nudges", type=int, metavar="N", help="Runs with inputs moved by 1e-10.  [default: 8]")
@click.option("--seed", type=int, metavar="N", help="Of the first nudge; the next have the next.  [default: 0]")
@engine_options
@_asked
def horizon(scene: str, folder: Path | None, as_json: bool, **settings: Any) -> None:
    """How long single velocities of SCENE can be trusted, and what holds beyond: conserved quantities, statistics."""
    _answer("horizon", scene=scene, folder=folder, as_json=as_json, **settings)


@study.command()
@click.option("-k", "names", metavar="NAME", help="Extremes with this in their name only.")
@click.option("--quick", is_flag=True, help="Leave out what takes more than about 5 s.")
@engine_options
@_asked
def extremes(quick: bool, **settings: Any) -> None:
    """Stretch every backend: right within its bar, or refused with the reason, and never wrong in silence."""
    _answer("extremes", quick=quick or None, **settings)


@study.command()
@scene_argument
@click.option("--tolerance", type=float, metavar="A", help="Of each edge, relative.  [default: 0.01]")
@engine_options
@_asked
def bands(scene: str, folder: Path | None, as_json: bool, **settings: Any) -> None:
    """Band edges of SCENE, pressed and driven, by three codes, beside the infinite chain's dispersion relation."""
    _answer("bands", scene=scene, folder=folder, as_json=as_json, **settings)
