"""All that work-precision measured as one tidy table: CSV in long form, and netCDF.

Tidy: a row is one error (of one setting, in one observable and norm) with all that belongs to it beside, so that any
column can be plotted against any other (Wickham 2014, *J. Stat. Softw.* 59, 10).
"""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterator
from typing import Any

import numpy as np

from dem_bridge.observables.registry import OBSERVABLES
from dem_bridge.studies.work_precision.norms import NORMS
from dem_bridge.studies.work_precision.runs import Measured, Point

SCHEMA = "dem-bridge/work-precision/1"
#: columns of a setting -> (unit, what it is)
SETTING: dict[str, tuple[str, str]] = {
    "dt": ("s", "time step as it was run"),
    "steps": ("1", "time steps"),
    "force_evaluations": ("1", "evaluations of all forces; of a Taylor series its coefficients"),
    "wall_min": ("s", "least wall time of a run, from the scene to the trajectory"),
    "wall_median": ("s", "median wall time of a run"),
    "cpu_min": ("s", "least CPU time of a run, with the processes that it starts"),
    "cpu_median": ("s", "median CPU time of a run"),
    "repeats": ("1", "runs that were timed, after one that was not"),
    "engine_loop": ("s", "LAMMPS' own time for its steps, of the last run"),
}


def numbers(point: Point) -> dict[str, float]:
    """The columns of :data:`SETTING`; nan where there is no run."""
    timing = point.timing
    times = (timing.least_wall, timing.median_wall, timing.least_cpu, timing.median_cpu) if timing else (np.nan,) * 4
    repeats = float(len(timing.wall)) if timing else 0.0
    values = (point.dt, point.steps, point.evaluations, *times, repeats, point.loop)
    return dict(zip(SETTING, values, strict=True))


def as_csv(measured: Measured) -> str:
    """Long form: one line for each setting, observable and norm; numbers in full precision, nan where there is none."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    head = ("scene", "backend", "curve", "knob", "value", "settings", *SETTING)
    writer.writerow([*head, "observable", "norm", "error", "reference_uncertainty", "known", "reason"])
    writer.writerows(_rows(measured))
    return text.getvalue()


def _rows(measured: Measured) -> Iterator[tuple[Any, ...]]:
    for point in measured.points:
        curve = point.curve
        first = (measured.scene.name, curve.backend, curve.name, curve.knob, point.value, _settings(point))
        for name in measured.observables:
            for norm in NORMS:
                available = "" if point.timing is None else "yes" if measured.known(point, name, norm) else "no"
                error, bar = point.error(name, norm), measured.uncertainty[name, norm]
                yield (*first, *numbers(point).values(), name, norm, error, bar, available, point.reason)


def as_netcdf(measured: Measured) -> bytes:
    """netCDF-4: dimensions run, observable, norm; units and meanings as attributes. Read it by ``xarray``."""
    import xarray as xr

    points, grid = measured.points, [(name, norm) for name in measured.observables for norm in NORMS]
    shape = (len(measured.observables), len(NORMS))
    error = np.array([[point.error(*item) for item in grid] for point in points]).reshape(len(points), *shape)
    available = np.array([[measured.known(point, *item) for item in grid] for point in points], dtype=np.int8)
    of_runs = [numbers(point) for point in points]
    data: dict[str, Any] = {
        "error": (
            ("run", "observable", "norm"),
            error,
            {"units": "1", "long_name": "error against the reference, relative to the scale of the observable"},
        ),
        "known": (
            ("run", "observable", "norm"),
            available.reshape(error.shape),
            {"long_name": "1: the error is above the bar of the reference; 0: it is below, or there is no run"},
        ),
        "reference_uncertainty": (
            ("observable", "norm"),
            np.array([measured.uncertainty[item] for item in grid]).reshape(shape),
            {"units": "1", "long_name": "what the reference may err by itself, on the same scale"},
        ),
    }
    for name, (unit, meaning) in SETTING.items():
        data[name] = ("run", np.array([of_run[name] for of_run in of_runs]), {"units": unit, "long_name": meaning})
    texts = {
        "backend": [point.curve.backend for point in points],
        "curve": [point.curve.name for point in points],
        "knob": [point.curve.knob for point in points],
        "settings": [_settings(point) for point in points],
        "reason": [point.reason for point in points],
    }
    scales = {name: OBSERVABLES[name].scale_name for name in measured.observables}
    dataset = xr.Dataset(
        data,
        coords={
            "observable": ("observable", list(scales), {"long_name": "observable", "scale": json.dumps(scales)}),
            "norm": ("norm", list(NORMS), {"long_name": "norm over samples and bodies, or over contacts"}),
            "value": ("run", [point.value for point in points], {"long_name": "value of the knob, SI"}),
            **{name: ("run", np.array(values, dtype=object)) for name, values in texts.items()},
        },
        attrs={
            "schema": SCHEMA,
            "scene": measured.scene.name,
            "scene_hash": measured.scene.content_hash,
            "samples": measured.sampling.count,
            "limit_s": measured.limit,
            "provenance": json.dumps(dict(measured.provenance), sort_keys=True),
        },
    )
    buffer = io.BytesIO()
    dataset.to_netcdf(buffer, engine="h5netcdf")
    return buffer.getvalue()


def _settings(point: Point) -> str:
    """All that was asked for as JSON; SI."""
    order = {"order": "richardson"} if point.curve.richardson else {}
    return json.dumps(point.curve.settings(point.value) | order)
