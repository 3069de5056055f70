"""Draw the figures of the report by matplotlib: those that :mod:`.panels` has as data, the convergence, the budgets."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter
from numpy.typing import NDArray

from dem_bridge.backends.steps import order_on
from dem_bridge.report.drawing import SHEET, WIDTH, draw_figure
from dem_bridge.report.drawing_styles import power_of_ten, style_of
from dem_bridge.report.study import FigureData
from dem_bridge.report.styles import BLACK, BLUE, GREEN, VERMILION
from dem_bridge.verification.assess import SceneStudy
from dem_bridge.verification.budget import Budget
from dem_bridge.verification.panels import front_of, maps_of, motion_of
from dem_bridge.verification.roles import TWIN


def spacetime_maps(studies: Sequence[SceneStudy]) -> Figure | None:
    """Draw the velocity of each body against time."""
    return _draw(maps_of(studies))


def front_along_chain(studies: Sequence[SceneStudy]) -> Figure | None:
    """Draw the residence time and the wave speed along each chain."""
    return _draw(front_of(studies))


def motion(studies: Sequence[SceneStudy]) -> Figure | None:
    """Draw the velocities and the contact forces of one scene."""
    return _draw(motion_of(studies))


def _draw(data: FigureData | None) -> Figure | None:
    """Draw a figure, if there is one."""
    return None if data is None else draw_figure(data)


@rc_context(SHEET)
def convergence(studies: Sequence[SceneStudy]) -> Figure | None:
    """Draw the velocity errors of LAMMPS and its twin against the time step, and the difference between the two."""
    shown = [study for study in studies if any(max(errors) > 0.0 for _, errors in study.refinement.values())]
    if not shown:
        return None
    figure, axes = _panels(1, len(shown), width=0.5 * WIDTH, height=2.8)
    for ax, study in zip(axes, shown, strict=True):
        for name, style in (
            (study.engine, {**style_of(study.engine), "label": "LAMMPS - reference"}),
            (TWIN, {"color": GREEN, "linestyle": "none", "marker": "x", "label": "twin - reference"}),
        ):
            if name in study.refinement:
                ax.loglog(*study.refinement[name], **style)
        steps, errors = next(iter(study.refinement.values()))
        guide = np.array([max(steps), min(steps)])
        slope = order_on(study.scene)
        line = errors[0] * (guide / steps[0]) ** slope
        ax.loglog(guide, line, color="0.6", linewidth=1.0, label=f"slope {slope}", zorder=0)
        between = [v for v in study.verdicts if v.backend == study.engine and v.reference == TWIN]
        run = study.run(study.engine)
        if between and run is not None:
            step = run.provenance["settings"]["dt"]
            ax.loglog([step], [between[0].difference], color=BLUE, marker="D", linestyle="none", label="LAMMPS - twin")
        ax.set(title=study.scene.name, xlabel="time step (s)")
        for axis in (ax.xaxis, ax.yaxis):
            axis.set_major_formatter(FuncFormatter(power_of_ten))
            axis.set_minor_formatter(NullFormatter())
        ax.grid(alpha=0.25)
    axes[0].set_ylabel("velocity difference / largest velocity")
    # one legend for all panels, unless their slopes differ
    for ax in axes if len({order_on(study.scene) for study in shown}) > 1 else axes[-1:]:
        ax.legend()
    return figure


@rc_context(SHEET)
def error_budget(studies: Sequence[SceneStudy]) -> Figure | None:
    """Draw the error budget of LAMMPS on one scene for each quantity, with the same axis for all."""
    [study] = studies
    rows = [_values(budget) for budget in study.budgets]
    values = [value for row in rows for value in row.values() if 0.0 < value < np.inf]
    if not values:
        return None
    figure, axes = _panels(-(-len(rows) // 2), min(2, len(rows)), width=0.5 * WIDTH, height=2.0)
    for ax in axes[len(rows) :]:
        ax.remove()
    axes = axes[: len(rows)]
    low, high = 0.3 * max(min(values), 1e-18), 300.0 * max(values)
    for ax, budget in zip(axes, study.budgets, strict=True):
        budget_on(ax, budget, (low, high))
        ax.set_title(budget.quantity.replace("_", " "))
    for ax in axes[::2]:
        ax.invert_yaxis()  # shared by a row
    figure.supxlabel(f"{study.scene.name}: difference / scale of the quantity", fontsize=8.5)
    return figure


def budget_on(ax: Axes, budget: Budget, limits: tuple[float, float] | None = None) -> None:
    """Draw the total error, each contribution and the unexplained error as horizontal bars.

    A dotted line is the allowed unexplained error. ``limits`` are the ends of the axis; the default follows from the
    values.
    """
    row = _values(budget)
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
            bbox={"facecolor": "#ffffff", "edgecolor": "none", "pad": 0.6},
        )
    ax.axvline(budget.allowed, color=VERMILION, linestyle=":", linewidth=1.2)
    ax.set(xscale="log", xlim=(low, high))
    ax.xaxis.set_major_locator(LogLocator(numticks=5))
    ax.xaxis.set_major_formatter(FuncFormatter(power_of_ten))
    ax.grid(axis="x", alpha=0.25)


def _values(budget: Budget) -> dict[str, float]:
    """Return the values of a budget by label."""
    return {"total error": budget.found, **budget.parts, "unexplained": budget.unexplained}


def _panels(rows: int, columns: int, *, width: float, height: float) -> tuple[Figure, NDArray[np.object_]]:
    """Return a figure with axes in rows and columns; ``width`` and ``height`` are those of a panel, inches."""
    figure = Figure(figsize=(width * columns, height * rows), layout="constrained")
    axes = figure.subplots(rows, columns, sharey="row", squeeze=False)
    return figure, axes.ravel()
