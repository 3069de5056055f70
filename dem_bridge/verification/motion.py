"""Draw the velocities and the contact forces of a scene."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from dem_bridge.report.drawing import draw_figure
from dem_bridge.report.study import FigureData, Map, Panel, Series
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import Floats, Trajectory
from dem_bridge.verification.assess import SceneStudy
from dem_bridge.verification.chains import MOST_LINES_DRAWN, body_noun
from dem_bridge.verification.closed_form import closed_form
from dem_bridge.verification.figures import spacetime_panel
from dem_bridge.verification.reference import REFERENCE
from dem_bridge.verification.roles import THEORY

#: forms of lines that differ in grey
_FORMS_OF_LINES = (0, 3, 4, 5)


def motion(studies: Sequence[SceneStudy]) -> Figure | None:
    """Draw the velocities and the contact forces of one scene; None without a run."""
    [study] = studies
    layout = motion_panels(study)
    return None if layout is None else draw_figure(layout)


def motion_panels(study: SceneStudy) -> FigureData | None:
    """Return the panels of :func:`motion`: velocities and forces; None without a run."""
    run = study.run(study.engine) or study.run(REFERENCE)
    if run is None:
        return None
    panels = (_velocities(study, run), _forces(study.scene, run))
    return FigureData(id="", title="", caption="", panels=panels, columns=2)


def _velocities(study: SceneStudy, run: Trajectory) -> Panel:
    """Return v(t) of every body, or the map of many."""
    scene = study.scene
    if scene.n_body > MOST_LINES_DRAWN:
        theory = study.run(THEORY)
        fronts = {} if theory is None else {THEORY: theory}
        return spacetime_panel(run, "Velocity", fronts=fronts, first=0 if scene.drive else 1, body=body_noun(scene))
    series = _lines([f"body {k}" for k in range(scene.n_body)], run, run.velocity)
    exact = closed_form(scene)
    if exact is not None:
        series += [_level("closed form", run, speed) for speed in exact.exit_velocity[: scene.n_body]]
    return Panel(title="Velocity of the bodies", x_label="time (ms)", y_label="velocity (m/s)", series=tuple(series))


def _forces(scene: Scene, run: Trajectory) -> Panel:
    """Return F(t) of every contact, or the map of many."""
    count = run.contact_force.shape[1]
    if count > MOST_LINES_DRAWN:
        end = 1.15 * float(np.nanmax(run.crossing_time, initial=0.0)) or float(run.time[-1])
        rows = max(2, int(np.searchsorted(run.time, end, side="right")))
        forces = Map(
            label="force (N)", x=np.arange(float(count)), y=1e3 * run.time[:rows], values=run.contact_force[:rows]
        )
        return Panel(title="Contact force", x_label="contact", y_label="time (ms)", map=forces)
    walls = [side for side in ("wall_left", "wall_right") if getattr(scene, side) is not None]
    names = [f"contact {k}" for k in range(count - len(walls))] + [name.replace("_", " ") for name in walls]
    series = _lines(names, run, run.contact_force)
    exact = closed_form(scene)
    if exact is not None and not scene.damped:
        series.append(_level("closed form", run, exact.peak_force))
    return Panel(title="Force of the contacts", x_label="time (ms)", y_label="force (N)", series=tuple(series))


def _lines(names: Sequence[str], run: Trajectory, values: Floats) -> list[Series]:
    """Return a line over time for each column of ``values``."""
    styles = [f"line/{k}/{_FORMS_OF_LINES[k % len(_FORMS_OF_LINES)]}" for k in range(len(names))]
    x, columns = 1e3 * run.time, values.T
    return [Series(label=name, style=style, x=x, y=y) for name, style, y in zip(names, styles, columns, strict=True)]


def _level(label: str, run: Trajectory, value: float) -> Series:
    """Return a horizontal line over the whole time."""
    return Series(label=label, style="guide", x=1e3 * run.time[[0, -1]], y=np.full(2, value))
