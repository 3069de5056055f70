"""The results of work-precision: diagrams of error against cost and of what tables cost, and one tidy table as files.

Tidy: a row is one error (of one setting, in one observable and norm) with all that belongs to it beside, so that any
column can be plotted against any other (Wickham 2014, *J. Stat. Softw.* 59, 10). It is written as CSV and netCDF.
"""

from __future__ import annotations

import io
import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from dem_bridge.observables.registry import OBSERVABLES
from dem_bridge.report.study import FigureData, Panel, Series
from dem_bridge.studies.work_precision.curves import STYLES, TEXTS
from dem_bridge.studies.work_precision.runs import NORMS, REFERENCE, Measured, Point

if TYPE_CHECKING:
    from pandas import DataFrame

ID = "work-precision"
#: observables with a diagram of their own; the others follow from them, and are in the tables and files
DRAWN = ("velocity", "displacement", "peak_force", "arrival", "residence_time")
#: knobs that the diagrams leave out: those of tables have a figure of their own, atol alone changes next to nothing
NOT_DRAWN = ("table_points", "table_lines", "atol")


def figures(measured: Measured) -> Iterator[FigureData]:
    """Yield error against cost for each observable that is drawn, and the cost of tables."""
    for observable in (OBSERVABLES[name] for name in DRAWN if name in measured.observables):
        first = _panel(
            measured, observable.name, "force_evaluations", "(a) against force evaluations", "force evaluations"
        )
        second = _panel(measured, observable.name, "cpu_min", "(b) against CPU time", "CPU time of a run (s)")
        panels = (replace(first, shares_scale_with=(1,)), second)
        scale = observable.scale_name.replace("_", " ")
        figure = TEXTS.figure("errors", panels, observable=observable, scale=scale)
        yield replace(figure, id=f"{ID}-{observable.name.replace('_', '-')}")
    tables = tuple(_table_panels(measured))
    if tables:
        yield TEXTS.figure("work-precision-tables", tables)


def _panel(measured: Measured, observable: str, cost: str, title: str, label: str) -> Panel:
    bar = measured.uncertainty[observable, "max"]
    # what costs nothing has no place on a logarithmic axis
    ran = [
        point
        for point in measured.points
        if point.ran and point.curve.knob not in NOT_DRAWN and getattr(point, cost) > 0.0
    ]
    x = np.array([float(getattr(point, cost)) for point in ran])
    y = np.array([measured.bound(point, observable) for point in ran])
    y = np.where(np.isfinite(y), y, np.nan)
    lines: list[tuple[str, str, list[int]]] = [("Pareto front", "front", front(x.tolist(), y.tolist()))]
    for name in measured.curves:
        at = [place for place, point in enumerate(ran) if point.curve.name == name]
        lines.append((name, _style(ran[at[0]]) if at else "", at))
    below = [
        place
        for place, point in enumerate(ran)
        if point.curve.backend != REFERENCE and math.isfinite(y[place]) and not measured.known(point, observable)
    ]
    lines.append(("less, not known", "below", below))
    series = [Series(label=name, style=style, x=x[at], y=y[at]) for name, style, at in lines if at]
    if bar > 0.0 and math.isfinite(bar) and ran:
        ends = np.array([x.min(), x.max()])
        guide = Series(label="bar of the reference", style="guide", x=ends, y=np.full(2, bar))
        series.insert(1 if lines[0][2] else 0, guide)
    words = observable.replace("_", " ")
    return TEXTS.panel("costs", series, title=title, label=label, observable=words, log=True, tall=True)


def _style(point: Point) -> str:
    """Return the drawing style of a backend and its variant."""
    return f"curve/{point.curve.backend}/{point.curve.variant}".rstrip("/")


def _table_panels(measured: Measured) -> Iterator[Panel]:
    plain = {point.dt: point for point in measured.of("lammps-granular")}
    for title, label, names in (
        ("(a) points of LAMMPS' own table", "points", [f"lammps-table ({style})" for style in STYLES]),
        ("(b) lines of the file", "lines", ["lammps-table (lines)"]),
    ):
        curves = {name: points for name in names if (points := measured.of(name))}
        series: list[Series] = []
        for name, points in curves.items():
            x, y = np.array([[point.value, measured.bound(point, "velocity")] for point in points]).T
            series.append(Series(label=name, style=_style(points[0]), x=x, y=y))
        without = plain.get([*curves.values()][-1][0].dt) if curves else None
        if without is not None:
            ends = np.array([series[0].x.min(), series[0].x.max()])
            error = np.full(2, without.error("velocity"))
            series.append(Series(label="without tables, same step", style="guide", x=ends, y=error))
        if series:
            yield TEXTS.panel("tables", series, title=title, label=label, log=True)


def front(cost: Sequence[float], error: Sequence[float]) -> list[int]:
    """Places of the points that no other beats, by rising cost and falling error; those that are no numbers are none.

    A point is beaten by another with at most its cost and less error, or with less cost and at most its error.

    >>> front([1.0, 2.0, 3.0, 2.5, float("nan")], [0.1, 0.3, 0.01, 0.01, 0.0])
    [0, 3]
    """
    results: list[int] = []
    real = (at for at in range(len(cost)) if math.isfinite(cost[at]) and math.isfinite(error[at]))
    for at in sorted(real, key=lambda at: (cost[at], error[at])):
        if not results or error[at] < error[results[-1]]:
            results.append(at)
    return results


SCHEMA = "dem-bridge/work-precision/1"
#: columns of the files that are attributes of a point -> unit and meaning, as attributes of netCDF
MEANINGS = {
    "dt": {"units": "s", "long_name": "time step of the run"},
    "steps": {"units": "1", "long_name": "time steps"},
    "force_evaluations": {
        "units": "1",
        "long_name": "evaluations of all contact forces; for a Taylor series, the orders computed",
    },
    "wall_min": {"units": "s", "long_name": "smallest wall time of a run, from scene to trajectory"},
    "wall_median": {"units": "s", "long_name": "median wall time of a run"},
    "cpu_min": {"units": "s", "long_name": "smallest CPU time of a run, including the processes that it starts"},
    "cpu_median": {"units": "s", "long_name": "median CPU time of a run"},
    "repeats": {"units": "1", "long_name": "number of timed runs, after one that is not timed"},
    "engine_loop": {"units": "s", "long_name": "time that LAMMPS reports for its steps, in the last run"},
}
VARIABLES = {
    "error": {"units": "1", "long_name": "error against the reference, relative to the scale of the observable"},
    "known": {
        "long_name": "1: the error is above the uncertainty of the reference; 0: it is below, or there is no run"
    },
    "reference_uncertainty": {"units": "1", "long_name": "uncertainty of the reference, on the same scale"},
    "norm": {"long_name": "norm over samples and bodies, or over contacts"},
    "value": {"long_name": "value of the setting, SI"},
}


def as_frame(measured: Measured) -> DataFrame:
    """Return one row for each setting, observable and norm; numbers are nan where there is no run."""
    from pandas import DataFrame

    columns = [
        *("scene", "backend", "curve", "knob", "value", "settings", *MEANINGS),
        *("observable", "norm", "error", "reference_uncertainty", "known", "reason"),
    ]
    rows = []
    for point in measured.points:
        curve = point.curve
        # all that was asked for, in SI
        settings = json.dumps(curve.settings(point.value) | ({"order": "richardson"} if curve.richardson else {}))
        texts = (measured.scene.name, curve.backend, curve.name, curve.knob, point.value, settings)
        numbers = [float(getattr(point, name)) for name in MEANINGS]
        for (name, norm), bar in measured.uncertainty.items():
            above = "" if not point.ran else "yes" if measured.known(point, name, norm) else "no"
            rows.append((*texts, *numbers, name, norm, point.error(name, norm), bar, above, point.reason))
    # as objects, so that a whole number is written as one
    return DataFrame(rows, columns=columns, dtype=object)


def as_csv(measured: Measured) -> str:
    """Return the rows as CSV; numbers in full precision, nan where there is none."""
    return str(as_frame(measured).to_csv(index=False, na_rep="nan", lineterminator="\n"))


def as_netcdf(measured: Measured) -> bytes:
    """Return netCDF-4: dimensions run, observable, norm; units and meanings as attributes. Read it by ``xarray``."""
    import xarray as xr

    frame, observables = as_frame(measured), measured.observables
    grid = ("run", "observable", "norm")
    shape = (len(measured.points), len(observables), len(NORMS))
    runs = frame[:: shape[1] * shape[2]]
    bars = np.array(list(measured.uncertainty.values())).reshape(shape[1:])
    data: dict[str, Any] = {
        "error": (grid, frame["error"].to_numpy(float).reshape(shape), VARIABLES["error"]),
        "known": (grid, (frame["known"] == "yes").to_numpy(np.int8).reshape(shape), VARIABLES["known"]),
        "reference_uncertainty": (grid[1:], bars, VARIABLES["reference_uncertainty"]),
        **{name: ("run", runs[name].to_numpy(float), meaning) for name, meaning in MEANINGS.items()},
    }
    scales = {"scale": json.dumps({name: OBSERVABLES[name].scale_name for name in observables})}
    coordinates: dict[str, Any] = {
        "observable": ("observable", list(observables), {"long_name": "observable"} | scales),
        "norm": ("norm", list(NORMS), VARIABLES["norm"]),
        "value": ("run", runs["value"].to_numpy(float), VARIABLES["value"]),
    }
    for name in ("backend", "curve", "knob", "settings", "reason"):
        coordinates[name] = ("run", runs[name].to_numpy(object))
    attributes = {
        "schema": SCHEMA,
        "scene": measured.scene.name,
        "scene_hash": measured.scene.content_hash,
        "samples": measured.sampling.count,
        "limit_s": measured.limit,
        "provenance": json.dumps(dict(measured.provenance), sort_keys=True),
    }
    buffer = io.BytesIO()
    xr.Dataset(data, coords=coordinates, attrs=attributes).to_netcdf(buffer, engine="h5netcdf")
    return buffer.getvalue()
