"""The diagrams of work-precision: error against cost with the Pareto front, and what tables cost."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import numpy as np

from dem_bridge.observables.registry import OBSERVABLES
from dem_bridge.studies.study import FigureData, Panel, Series
from dem_bridge.studies.work_precision.curves import STYLES
from dem_bridge.studies.work_precision.pareto import front
from dem_bridge.studies.work_precision.runs import REFERENCE, Measured, Point

ID = "work-precision"
#: observables with a diagram of their own; the others follow from them, and are in the tables and files
DRAWN = ("velocity", "displacement", "peak_force", "arrival", "residence_time")


def cpu(point: Point) -> float:
    """Least CPU time of a run, s."""
    return point.cpu


def evaluations(point: Point) -> float:
    """Return the number of evaluations of all contact forces; 0 for theories."""
    return point.evaluations


def figures(measured: Measured) -> Iterator[FigureData]:
    for observable in (OBSERVABLES[name] for name in DRAWN if name in measured.observables):
        yield FigureData(
            id=f"{ID}-{observable.name.replace('_', '-')}",
            title=f"Error of {observable.words} against cost",
            caption=(
                f"Largest error, relative to: {observable.scale_name.replace('_', ' ')}. The wide grey line is the"
                " Pareto front: the settings that no other setting beats in both error and cost. Binary collisions and"
                " the adiabatic wave evaluate no forces in time; the reference counts the coefficients of its series."
            ),
            panels=(
                _panel(measured, observable.name, cpu, "(a) against CPU time", "CPU time of a run (s)", shares=(1,)),
                _panel(measured, observable.name, evaluations, "(b) against force evaluations", "force evaluations"),
            ),
        )
    tables = _table_panels(measured)
    if tables:
        yield FigureData(
            id=f"{ID}-tables",
            title="What the tables of LAMMPS cost",
            caption="Velocity error of LAMMPS with tables at a fixed step, whose own error nothing here can pass.",
            panels=tables,
        )


def _panel(
    measured: Measured,
    observable: str,
    cost: Callable[[Point], float],
    title: str,
    label: str,
    *,
    shares: tuple[int, ...] = (),
) -> Panel:
    bar = measured.uncertainty[observable, "max"]
    # what costs nothing has no place on a logarithmic axis
    ran = [point for point in measured.points if point.timing is not None and _is_drawn(point) and cost(point) > 0.0]
    x = np.array([cost(point) for point in ran])
    y = np.array([measured.bound(point, observable) for point in ran])
    y = np.where(np.isfinite(y), y, np.nan)
    beaten_by_none = front(x.tolist(), y.tolist())
    series = []
    if beaten_by_none:
        series.append(Series(label="Pareto front", style="front", x=x[beaten_by_none], y=y[beaten_by_none]))
    if bar > 0.0 and math.isfinite(bar) and ran:
        ends = np.array([x.min(), x.max()])
        series.append(Series(label="bar of the reference", style="guide", x=ends, y=np.full(2, bar)))
    for name in measured.curves:
        at = [place for place, point in enumerate(ran) if point.curve.name == name]
        if at:
            series.append(Series(label=name, style=_style(ran[at[0]]), x=x[at], y=y[at]))
    below = [
        place
        for place, point in enumerate(ran)
        if point.curve.backend != REFERENCE and math.isfinite(y[place]) and not measured.known(point, observable)
    ]
    if below:
        series.append(Series(label="less, not known", style="below", x=x[below], y=y[below]))
    return Panel(
        title=title,
        x_label=label,
        y_label=f"largest relative error of {observable.replace('_', ' ')}",
        series=tuple(series),
        log=True,
        tall=True,
        shares_scale_with=shares,
    )


def _is_drawn(point: Point) -> bool:
    """Knobs of tables have a figure of their own; atol alone changes next to nothing and is in the table."""
    return point.curve.knob not in ("table_points", "table_lines", "atol")


def _style(point: Point) -> str:
    """Return the drawing style of a backend and its variant."""
    return f"curve/{point.curve.backend}/{point.curve.variant}".rstrip("/")


def _table_panels(measured: Measured) -> tuple[Panel, ...]:
    plain = {point.dt: point for point in measured.of("lammps-granular")}
    panels = []
    for title, label, names in (
        ("(a) points of LAMMPS' own table", "points", [f"lammps-table ({style})" for style in STYLES]),
        ("(b) lines of the file", "lines", ["lammps-table (lines)"]),
    ):
        series: list[Series] = []
        for name in names:
            ran = measured.of(name)
            if ran:
                x, y = np.array([[point.value, measured.bound(point, "velocity")] for point in ran]).T
                series.append(Series(label=name, style=_style(ran[0]), x=x, y=y))
                without = plain.get(ran[0].dt)
        if series and without is not None:
            ends = np.array([series[0].x.min(), series[0].x.max()])
            error = np.full(2, without.error("velocity"))
            series.append(Series(label="without tables, same step", style="guide", x=ends, y=error))
        if series:
            panels.append(
                Panel(
                    title=title,
                    x_label=label,
                    y_label="largest relative velocity error",
                    series=tuple(series),
                    log=True,
                )
            )
    return tuple(panels)
