"""Return what the figures of the report show, as data: nothing is drawn here, and matplotlib is not imported.

Panels that are compared share their scales. The motion of a scene has its velocities and contact forces.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import cast

import numpy as np

from dem_bridge.backends.base import ENGINE_BACKENDS
from dem_bridge.observables.registry import OBSERVABLES
from dem_bridge.report.study import FigureData, Map, Panel, Series
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import Floats, Trajectory
from dem_bridge.verification.assess import SceneStudy
from dem_bridge.verification.chains import MOST_LINES_DRAWN, body_noun, time_after_front
from dem_bridge.verification.closed_form import closed_form
from dem_bridge.verification.reference_choice import REFERENCE
from dem_bridge.verification.roles import THEORY

#: in place of a scene, for observables that are read off a run alone
NO_SCENE = cast(Scene, None)
#: labels of backends in figures
LABELS = {**dict.fromkeys(ENGINE_BACKENDS, "LAMMPS"), REFERENCE: "reference", THEORY: "BCA"}
#: forms of lines that differ in grey
_FORMS_OF_LINES = (0, 3, 4, 5)


def maps_of(studies: Sequence[SceneStudy]) -> FigureData | None:
    """Return maps of the velocity of each body against time, with the arrivals of the BCA.

    They are figures 2a and 2c of the paper. The runs are those of LAMMPS, or of the reference without it. All panels
    share the colour scale. None without a run.
    """
    runs = [(study, study.run(study.engine) or study.run(REFERENCE)) for study in studies]
    shown = [(study, run) for study, run in runs if run is not None and study.scene.n_body > 2]
    if not shown:
        return None
    ends = [time_after_front(run) for _, run in shown]
    if max(ends) < 2.0 * min(ends):
        ends = [max(ends)] * len(ends)  # chains of similar duration share the time axis
    panels = []
    for (study, run), end in zip(shown, ends, strict=True):
        theory = study.run(THEORY)
        panels.append(
            spacetime_panel(
                run,
                f"{study.scene.name} ({_shown_backend(study)})",
                fronts={} if theory is None else {THEORY: theory},
                until=end,
                first=1 if study.scene.drive is None else 0,
                body=body_noun(study.scene),
            )
        )
    return _figure([replace(panel, shares_scale_with=tuple(range(len(shown)))) for panel in panels])


def spacetime_panel(
    run: Trajectory,
    title: str,
    *,
    fronts: Mapping[str, Trajectory] = MappingProxyType({}),
    until: float | None = None,
    first: int = 0,
    body: str = "body",
) -> Panel:
    """Return a panel with the velocity of the bodies from index ``first`` on against time.

    ``until`` is the last time, s; the default is shortly after the front has passed. ``fronts`` are the runs of
    theories whose arrivals are drawn as lines, by name. ``body`` is the label of the axis of bodies.
    """
    end = time_after_front(run) if until is None else until
    rows = max(1, int(np.searchsorted(run.time, end, side="right")))
    bodies = np.arange(float(first), run.velocity.shape[1])
    arrival = OBSERVABLES["arrival"].value
    lines = {name: arrival(NO_SCENE, theory)[1:] for name, theory in fronts.items()}
    return Panel(
        title=title,
        x_label=body,
        y_label="time (ms)",
        map=Map(label="velocity (m/s)", x=bodies, y=1e3 * run.time[:rows], values=run.velocity[:rows, first:]),
        series=tuple(
            Series(
                label=f"front by {LABELS.get(name, name)}", style=name, x=np.arange(1.0, 1.0 + len(line)), y=1e3 * line
            )
            for name, line in lines.items()
        ),
    )


def along_panel(
    runs: Mapping[str, Trajectory],
    title: str,
    y_label: str,
    name: str,
    *,
    scene: Scene | None = None,
    factor: float = 1.0,
    styles: Sequence[str] | None = None,
    body: str = "body",
) -> Panel:
    """Return a panel with an observable of bodies 1 to n_body-2 along the chain, for runs by label.

    ``factor`` is that from the observable's unit to that of the label. ``styles`` are the styles of the runs; the
    default follows from their backends. ``scene`` is not needed for times of the front.
    """
    styles = [run.provenance["backend"] for run in runs.values()] if styles is None else styles
    parts = (OBSERVABLES[name].value, OBSERVABLES[name].uncertainty)
    series = []
    for (label, run), style in zip(runs.items(), styles, strict=True):
        value, uncertainty = (factor * part(scene or NO_SCENE, run)[1:-1] for part in parts)
        series.append(Series(label=label, style=style, x=np.arange(1.0, len(value) + 1.0), y=value, bar=uncertainty))
    return Panel(title=title, x_label=body, y_label=y_label, series=tuple(series))


def residence_panel(
    runs: Mapping[str, Trajectory], title: str, *, styles: Sequence[str] | None = None, body: str = "body"
) -> Panel:
    """Return a panel with the residence time of the impulse at each body."""
    label = "residence time (µs)"
    return along_panel(runs, title, label, "residence_time", factor=1e6, styles=styles, body=body)


def front_of(studies: Sequence[SceneStudy]) -> FigureData | None:
    """Return residence time and wave speed along each chain by reference, LAMMPS and BCA (figure 3 of the paper).

    None without a scene that has a front and at least two residence times.
    """
    # a driven chain has no single front
    shown = [
        study
        for study in studies
        if study.scene.n_body > 3 and study.scene.drive is None and study.run(REFERENCE) is not None
    ]
    if not shown:
        return None
    labelled = [
        {LABELS[name]: run for name in (REFERENCE, THEORY, study.engine) if (run := study.run(name)) is not None}
        for study in shown
    ]
    rows = [
        [
            residence_panel(runs, study.scene.name, body=body_noun(study.scene))
            for study, runs in zip(shown, labelled, strict=True)
        ]
    ]
    if all(study.scene.spacing is not None for study in shown):
        rows.append(
            [
                along_panel(
                    runs,
                    study.scene.name,
                    "wave speed (m/s)",
                    "wave_speed",
                    scene=study.scene,
                    body=body_noun(study.scene),
                )
                for study, runs in zip(shown, labelled, strict=True)
            ]
        )
    panels = [
        replace(panel, shares_scale_with=tuple(range(nth * len(row), (nth + 1) * len(row))))
        for nth, row in enumerate(rows)
        for panel in row
    ]
    return _figure(panels, columns=len(shown))


def motion_of(studies: Sequence[SceneStudy]) -> FigureData | None:
    """Return the velocities and the contact forces of one scene; None without a run."""
    [study] = studies
    run = study.run(study.engine) or study.run(REFERENCE)
    if run is None:
        return None
    return _figure([_velocities(study, run), _forces(study.scene, run)])


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


def _figure(panels: Sequence[Panel], columns: int | None = None) -> FigureData:
    """Return panels as a figure."""
    return FigureData(id="", title="", caption="", panels=tuple(panels), columns=columns or len(panels))


def _shown_backend(study: SceneStudy) -> str:
    """Return the label of the run that is drawn: LAMMPS, or the reference without LAMMPS."""
    return "LAMMPS" if study.run(study.engine) is not None else "reference"
