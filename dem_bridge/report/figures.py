"""Figures of the report, as matplotlib Figures; panels that belong together share their scales.

Colours are the Okabe-Ito set (legible for colour-blind readers); lines and markers also differ in form, so that a page
printed in grey keeps its meaning.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from types import MappingProxyType

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator
from numpy.typing import NDArray

from dem_bridge.backends.base import ENGINE_BACKENDS
from dem_bridge.backends.steps import order_on
from dem_bridge.observables.front import (
    arrival_by_crossing,
    residence_bar,
    residence_by_crossing,
    wave_speed_by_crossing,
)
from dem_bridge.report.drawing import drawn
from dem_bridge.report.strokes import BLACK, BLUE, GREEN, STYLES, VERMILION
from dem_bridge.scene import Scene
from dem_bridge.studies.study import FigureData, Map, Panel, Series
from dem_bridge.trajectory import Trajectory
from dem_bridge.verification.assess import SceneStudy
from dem_bridge.verification.budget import Budget
from dem_bridge.verification.roles import REFERENCE, THEORY, TWIN

Floats = NDArray[np.float64]
#: what backends are called in a figure
LABELS = {**dict.fromkeys(ENGINE_BACKENDS, "LAMMPS"), REFERENCE: "reference", THEORY: "BCA"}


def called(scene: Scene) -> str:
    """What the bodies behind the first are: "cylinder" or "sphere" where all are one of them, else "body".

    >>> import dem_bridge as db
    >>> [called(db.load_scene(name)) for name in ("decelerating-40", "dimer-1-1", "sphere-cylinder-sphere")]
    ['cylinder', 'sphere', 'body']
    """
    shapes = set() if scene.geometry is None else {body.shape for body in scene.geometry.bodies[1:]}
    return shapes.pop() if len(shapes) == 1 else "body"


def spacetime_maps(studies: Sequence[SceneStudy]) -> Figure | None:
    """Velocity over body and time for each scene (the paper's figures 2a and 2c), LAMMPS' where there is a run, with
    the arrival that binary collisions predict. One colour scale for all. None without a run to show."""
    runs = [(study, study.run(study.engine) or study.run(REFERENCE)) for study in studies]
    shown = [(study, run) for study, run in runs if run is not None and study.scene.n_body > 2]
    if not shown:
        return None
    ends = [_front_has_passed(run) for _, run in shown]
    if max(ends) < 2.0 * min(ends):
        ends = [max(ends)] * len(ends)  # chains that compare share their axis
    panels = []
    for (study, run), end in zip(shown, ends, strict=True):
        theory = study.run(THEORY)
        panels.append(
            spacetime_panel(
                run,
                f"{study.scene.name} ({_who(study)})",
                fronts={} if theory is None else {THEORY: theory},
                until=end,
                first=1 if study.scene.drive is None else 0,
                body=called(study.scene),
            )
        )
    return _drawn([replace(panel, shares_scale_with=tuple(range(len(shown)))) for panel in panels])


def spacetime_panel(
    run: Trajectory,
    title: str,
    *,
    fronts: Mapping[str, Trajectory] = MappingProxyType({}),
    until: float | None = None,
    first: int = 0,
    body: str = "body",
) -> Panel:
    """Velocity of the bodies from ``first`` on over time, up to ``until`` (s; None: until a little after the front has
    passed). ``fronts``: theory -> its run, whose arrivals are drawn over it; ``body``: what bodies are called.
    """
    rows = max(1, int(np.searchsorted(run.time, _front_has_passed(run) if until is None else until, side="right")))
    bodies = np.arange(float(first), run.velocity.shape[1])
    lines = {name: arrival_by_crossing(None, theory) for name, theory in fronts.items()}
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
    value: Callable[[Trajectory], Floats],
    *,
    bar: Callable[[Trajectory], Floats] | None = None,
    styles: Sequence[str] | None = None,
    body: str = "body",
) -> Panel:
    """What each of ``runs`` (label -> run) says of bodies 1 to n_body-2. ``styles``: of each; None: by its backend."""
    styles = [run.provenance["backend"] for run in runs.values()] if styles is None else styles
    return Panel(
        title=title,
        x_label=body,
        y_label=y_label,
        series=tuple(
            Series(
                label=label,
                style=style,
                x=np.arange(1.0, run.velocity.shape[1] - 1),
                y=value(run),
                bar=None if bar is None else bar(run),
            )
            for (label, run), style in zip(runs.items(), styles, strict=True)
        ),
    )


def residence_panel(
    runs: Mapping[str, Trajectory], title: str, *, styles: Sequence[str] | None = None, body: str = "body"
) -> Panel:
    """How long each body holds the impulse: an :func:`along_panel`."""
    return along_panel(
        runs,
        title,
        "residence time (µs)",
        lambda run: 1e6 * residence_by_crossing(None, run),
        bar=lambda run: 1e6 * residence_bar(None, run),
        styles=styles,
        body=body,
    )


def front_along_chain(studies: Sequence[SceneStudy]) -> Figure | None:
    """Residence time and wave speed along each chain (the paper's figure 3) by reference, LAMMPS and BCA."""
    # one residence time is no line along a chain, and a wave that goes on and comes back has no front to speak of
    shown = [
        study
        for study in studies
        if study.scene.n_body > 3 and study.scene.drive is None and study.run(REFERENCE) is not None
    ]
    if not shown:
        return None
    named = [
        {LABELS[name]: run for name in (REFERENCE, THEORY, study.engine) if (run := study.run(name)) is not None}
        for study in shown
    ]
    rows = [
        [residence_panel(runs, one.scene.name, body=called(one.scene)) for one, runs in zip(shown, named, strict=True)]
    ]
    if all(study.scene.spacing is not None for study in shown):
        rows.append(
            [
                along_panel(
                    runs,
                    one.scene.name,
                    "wave speed (m/s)",
                    partial(wave_speed_by_crossing, one.scene),
                    body=called(one.scene),
                )
                for one, runs in zip(shown, named, strict=True)
            ]
        )
    panels = [
        replace(panel, shares_scale_with=tuple(range(at * len(row), (at + 1) * len(row))))
        for at, row in enumerate(rows)
        for panel in row
    ]
    return _drawn(panels, columns=len(shown))


def convergence(studies: Sequence[SceneStudy]) -> Figure | None:
    """Velocity error against step for LAMMPS and twin, with what is left between the two: where an error comes from."""
    shown = [study for study in studies if any(max(errors) > 0.0 for _, errors in study.refinement.values())]
    if not shown:
        return None
    figure, axes = _panels(1, len(shown), width=5.0, height=3.6)
    for ax, study in zip(axes, shown, strict=True):
        for name, style in (
            (study.engine, {**STYLES[study.engine], "label": "LAMMPS - reference"}),
            (TWIN, {"color": GREEN, "linestyle": "none", "marker": "x", "label": "twin - reference"}),
        ):
            if name in study.refinement:
                ax.loglog(*study.refinement[name], **style)
        steps, errors = next(iter(study.refinement.values()))
        guide = np.array([max(steps), min(steps)])
        slope = order_on(study.scene)
        line = errors[0] * (guide / steps[0]) ** slope
        ax.loglog(guide, line, color="0.6", linewidth=1.0, label=f"slope {slope}", zorder=0)
        left = [v for v in study.verdicts if v.backend == study.engine and v.reference == TWIN]
        run = study.run(study.engine)
        if left and run is not None:
            step = run.provenance["settings"]["dt"]
            ax.loglog([step], [left[0].difference], color=BLUE, marker="D", linestyle="none", label="LAMMPS - twin")
        ax.set(title=study.scene.name, xlabel="time step (s)")
        ax.grid(alpha=0.25)
    axes[0].set_ylabel("velocity difference / largest velocity")
    # one legend for all, unless their guides differ
    for ax in axes if len({order_on(study.scene) for study in shown}) > 1 else axes[-1:]:
        ax.legend()
    return figure


def error_budget(study: SceneStudy) -> Figure | None:
    """Error of LAMMPS by quantity, the parts it is made of, and what they leave unexplained. One scale for all."""
    rows = [_bars_of(one) for one in study.budgets]
    values = [value for row in rows for value in row.values() if 0.0 < value < np.inf]
    if not values:
        return None
    figure, axes = _panels(1, len(rows), width=3.1, height=2.9)
    low, high = 0.3 * max(min(values), 1e-18), 300.0 * max(values)
    for ax, budget in zip(axes, study.budgets, strict=True):
        budget_on(ax, budget, (low, high))
        ax.set_title(budget.quantity.replace("_", " "))
    axes[0].invert_yaxis()  # shared by all
    figure.supxlabel(f"{study.scene.name}: difference / scale of the quantity", fontsize=10)
    return figure


def budget_on(ax: Axes, budget: Budget, limits: tuple[float, float] | None = None) -> None:
    """A bar for what was found, each part, and what they leave unexplained, with its allowance as dotted line.

    ``limits``: least and largest value of the axis; None: as the values ask for.
    """
    row = _bars_of(budget)
    values = [value for value in row.values() if 0.0 < value < np.inf] or [1e-16]
    low, high = (0.3 * max(min(values), 1e-18), 300.0 * max(values)) if limits is None else limits
    colours = [BLACK, *[BLUE] * len(budget.parts), VERMILION]
    ax.barh(list(row), [min(max(value, low), high) for value in row.values()], color=colours)
    for place, value in enumerate(row.values()):
        ax.annotate(
            "0" if value == 0.0 else f"{value:.1e}" if np.isfinite(value) else "unknown",
            (min(max(value, low), high), place),
            xytext=(3, 0),
            textcoords="offset points",
            va="center",
            fontsize=8,
            bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.6},
        )
    ax.axvline(budget.allowed, color=VERMILION, linestyle=":", linewidth=1.2)
    ax.set(xscale="log", xlim=(low, high))
    ax.xaxis.set_major_locator(LogLocator(numticks=5))
    ax.grid(axis="x", alpha=0.25)


def _front_has_passed(run: Trajectory) -> float:
    """A little after the last body is reached, s; the end where it never is."""
    last = float(run.crossing_time[-1]) if len(run.crossing_time) else np.nan
    return min(1.15 * last, float(run.time[-1])) if np.isfinite(last) else float(run.time[-1])


def _bars_of(budget: Budget) -> dict[str, float]:
    return {"found": budget.found, **budget.parts, "unexplained": budget.unexplained}


def _drawn(panels: Sequence[Panel], columns: int | None = None) -> Figure:
    return drawn(FigureData(id="", title="", caption="", panels=tuple(panels), columns=columns or len(panels)))


def _panels(
    rows: int, columns: int, *, width: float, height: float, sharey: bool = True
) -> tuple[Figure, NDArray[np.object_]]:
    figure = Figure(figsize=(width * columns, height * rows), layout="constrained")
    axes = figure.subplots(rows, columns, sharey="row" if sharey else False, squeeze=False)
    return figure, axes.ravel()


def _who(study: SceneStudy) -> str:
    return "LAMMPS" if study.run(study.engine) is not None else "reference"


__all__ = [
    "LABELS",
    "budget_on",
    "convergence",
    "error_budget",
    "front_along_chain",
    "residence_panel",
    "spacetime_maps",
    "spacetime_panel",
]
