"""Draw the figure with which the report of a scene opens: motion, forces, and the errors of LAMMPS on one scale."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np
from matplotlib.figure import Figure

from dem_bridge.observables.verdict import Outcome
from dem_bridge.report.drawing import draw_figure
from dem_bridge.report.study import FigureData, Map, Panel, Series
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import Floats, Trajectory
from dem_bridge.verification.assess import SceneStudy
from dem_bridge.verification.closed_form import closed_form
from dem_bridge.verification.figures import body_noun, spacetime_panel
from dem_bridge.verification.roles import REFERENCE, SCIPY, THEORY

#: most bodies or contacts that are drawn as lines
_LINES = 7
#: forms of lines that differ in grey
_FORMS = (0, 3, 4, 5)


def motion(studies: Sequence[SceneStudy]) -> Figure | None:
    """Draw the velocities, the contact forces and the errors of LAMMPS of one scene; None without a run."""
    [study] = studies
    run = study.run(study.engine) or study.run(REFERENCE)
    if run is None:
        return None
    panels = [_velocities(study, run), _forces(study.scene, run)]
    scale = error_scale(study)
    if scale is None:
        layout = FigureData(id="", title="", caption="", panels=tuple(panels), columns=2)
    else:
        layout = FigureData(id="", title="", caption="", panels=(*panels, scale), columns=1, last_beside=True)
    return draw_figure(layout)


def _velocities(study: SceneStudy, run: Trajectory) -> Panel:
    """Return v(t) of every body, or the map of many."""
    scene = study.scene
    if scene.n_body > _LINES:
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
    if count > _LINES:
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
    styles = [f"line/{k}/{_FORMS[k % len(_FORMS)]}" for k in range(len(names))]
    x, columns = 1e3 * run.time, values.T
    return [Series(label=name, style=style, x=x, y=y) for name, style, y in zip(names, styles, columns, strict=True)]


def _level(label: str, run: Trajectory, value: float) -> Series:
    """Return a horizontal line over the whole time."""
    return Series(label=label, style="guide", x=1e3 * run.time[[0, -1]], y=np.full(2, value))


def error_scale(study: SceneStudy) -> Panel | None:
    """Return the parts of the velocity error on one logarithmic scale; None where none is known."""
    rows = dict(_errors(study))
    if not rows:
        return None
    y = np.arange(float(len(rows)))
    series = [Series(label="velocity error", style="mark-2", x=np.array(list(rows.values())), y=y)]
    tolerances = [v.tolerance for v in study.verdicts if (v.quantity, v.reference) == ("velocity", REFERENCE)]
    positive = [value for value in tolerances if value is not None and math.isfinite(value) and value > 0.0]
    if positive:
        ends = np.array([-0.5, len(rows) - 0.5])
        series.append(Series(label="tolerance", style="guide", x=np.full(2, max(positive)), y=ends))
    return Panel(
        title="Errors of velocity on one scale",
        x_label="error / largest velocity (1)",
        y_label="",
        series=tuple(series),
        rows=tuple(rows),
    )


def _errors(study: SceneStudy) -> Iterator[tuple[str, float]]:
    """Yield the rows of the scale with their values, which are above zero."""
    if study.budgets:
        budget = study.budgets[0]
        parts = {"uncertainty of reference": "reference", "round-off": "round-off", "force tables": "table"}
        for label, part in (parts | {"time step": "time step"}).items():
            if 0.0 < budget.parts[part] < math.inf:
                yield label, budget.parts[part]
        if 0.0 < budget.found < math.inf:
            yield "LAMMPS, total", budget.found
    for verdict in study.verdicts:
        if (verdict.quantity, verdict.backend, verdict.reference) != ("velocity", SCIPY, REFERENCE):
            continue
        if verdict.outcome is not Outcome.NOT_RUN and 0.0 < verdict.difference < math.inf:
            yield "second reference", verdict.difference
