"""The commands for a first look: ``dem-bridge demo`` and ``dem-bridge show``."""

from __future__ import annotations

import os
import re
import sys
import tempfile
import textwrap
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

import dem_bridge
from dem_bridge.cli import terminal, waiting
from dem_bridge.cli.options import DT_OF_FILE, FOLDER, LAMMPS, SCENE_OF_FILE, UNITS
from dem_bridge.cli.parameters import Argument, Option, make_command, scene_names
from dem_bridge.errors import UnsupportedScene, UsageError
from dem_bridge.foundation.files import check_report_folder

if TYPE_CHECKING:
    from dem_bridge.scene.scene import Scene
    from dem_bridge.trajectory.trajectory import Trajectory

#: columns of a line for people, where the terminal is not narrower
_WIDTH = 80
#: backends that draw a scene, the cheapest first, and their step as a part of the shortest contact time
_DRAWN_BY, _STEP_OF_CONTACT_TIME = ("verlet", "reference", "scipy"), 1.0 / 50.0
#: colours of the shades of a map
_TINTS = {"░": "blue", "▒": "cyan", "▓": "green", "█": "yellow"}


@make_command(
    "demo",
    Option(
        "show_page",
        "Open the page in a browser, where a terminal has a screen.",
        bool,
        flags=("--open/--no-open",),
        default="open",
        value=True,
    ),
    replace(FOLDER, help="Folder for the page.", default="a new temporary one"),
    *LAMMPS,
)
def demo(show_page: bool, folder: Path | None = None, **settings: Any) -> None:
    """Show in ten seconds what this is.

    LAMMPS solves a chain of spheres. Five lines and a page say how large its error is, what causes it, and which time
    step an accuracy needs.
    """
    if folder is not None:
        check_report_folder(folder)
    waiting.announce_compiling("taylor")
    with waiting.bar(label="LAMMPS, its twin and the reference solve a chain") as tell:
        from dem_bridge.lmp.engine import Engine
        from dem_bridge.verification.demo import demonstrate

        study = demonstrate(Engine.chosen(**settings), tell)
        folder = Path(tempfile.mkdtemp(prefix="dem-bridge-demo-")) if folder is None else folder
        study.save(folder)
    for sentence in study.answer:
        click.echo(sentence)
    page = folder / "index.html"
    opened = show_page and _has_display() and click.launch(str(page)) == 0
    click.echo(f"Page:  {page}{' (opened)' if opened else ''}")


@make_command(
    "show",
    Argument("drawn", "SCENE|RUN", completion=scene_names),
    replace(SCENE_OF_FILE, help="Scene of a run.", default="the one that the file holds or names"),
    UNITS,
    replace(DT_OF_FILE, help="Time step of a file of step numbers, s."),
)
def show(drawn: str, scene: str | None = None, **settings: Any) -> None:
    """Draw a chain and its motion in the terminal.

    SCENE|RUN is a scene, which is solved for the drawing alone, or a trajectory file. Files of other programs need
    --scene.
    """
    path = Path(drawn)
    is_run = path.is_file() and path.suffix.lower() != ".toml"
    if not is_run:
        waiting.announce_compiling()
    with waiting.fraction(f"{drawn} is {'read' if is_run else 'solved for the drawing'}"):
        from dem_bridge.report.chain_text import Canvas, chain_lines, front_sentences, motion_lines

        if is_run:
            run = dem_bridge.read_trajectory(path, scene, **settings)
            known, how = _scene_of(run, scene), f"run by {run.provenance.get('backend', 'another program')}"
        else:
            known = dem_bridge.load_scene(drawn)
            run, how = _run_for_drawing(known)
    encoding = (getattr(sys.stdout, "encoding", None) or "ascii").lower().replace("-", "")
    canvas = Canvas(width=min(_WIDTH, terminal.columns()), blocks=encoding.startswith("utf"))
    lines = textwrap.wrap(_heading(run, known, how), canvas.width)
    lines += [] if known is None else chain_lines(known, canvas)
    lines += [*map(_tinted, motion_lines(run, canvas)), *front_sentences(run)]
    for line in lines:
        click.echo(line if canvas.blocks else line.replace("µ", "u"))


def _heading(run: Trajectory, scene: Scene | None, how: str) -> str:
    """Return the first line: the chain, how long it moves, and which run is drawn."""
    name = scene.name if scene is not None else run.provenance.get("scene", "a chain")
    bodies, contacts = run.velocity.shape[1], len(run.peak_force)
    return (
        f"{name}: {bodies} bod{'ies' if bodies != 1 else 'y'}, {contacts} contact{'s' * (contacts != 1)},"
        f" {1e3 * float(run.time[-1]):.4g} ms; {how}"
    )


def _scene_of(run: Trajectory, scene: str | None) -> Scene | None:
    """Return the scene of a run; None if neither the caller nor the run names it."""
    from dem_bridge.api.files import scene_of_run

    try:
        return scene_of_run(scene, run)
    except UsageError:
        if scene is not None:
            raise
        return None


def _run_for_drawing(scene: Scene) -> tuple[Trajectory, str]:
    """Return a run that is accurate enough for a drawing, and how it was made."""
    from dem_bridge.scene.timescales import contact_time_of

    shortest = contact_time_of(scene)
    dt = None if shortest is None else shortest * _STEP_OF_CONTACT_TIME
    for backend in _DRAWN_BY:
        settings: dict[str, Any] = {"dt": dt} if backend == "verlet" and dt else {}
        try:
            run = dem_bridge.solve(scene, backend=backend, uncertainty=False, **settings)
        except UnsupportedScene as error:
            reason = error
        else:
            step = f" at a step of {dt:.2g} s" if settings else ""
            return run, f"by {backend}{step}, for this drawing alone"
    raise reason


def _tinted(line: str) -> str:
    """Return a line of a map with colours, on a terminal without NO_COLOR."""
    if not sys.stdout.isatty() or os.environ.get("NO_COLOR"):
        return line
    return re.sub("░+|▒+|▓+|█+", lambda found: click.style(found[0], fg=_TINTS[found[0][0]]), line)


def _has_display() -> bool:
    """Return True if a person sits at a terminal on a screen that can show a page."""
    return sys.stdout.isatty() and bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
