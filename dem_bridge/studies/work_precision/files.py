"""All that work-precision measured as one tidy table: CSV in long form, and netCDF.

Tidy: a row is one error (of one setting, in one observable and norm) with all that belongs to it beside, so that any
column can be plotted against any other (Wickham 2014, *J. Stat. Softw.* 59, 10).
"""

from __future__ import annotations

import io
import json
from typing import TYPE_CHECKING, Any

import numpy as np

from dem_bridge.observables.registry import OBSERVABLES
from dem_bridge.studies.work_precision.curves import TEXTS
from dem_bridge.studies.work_precision.runs import NORMS, Measured

if TYPE_CHECKING:
    from pandas import DataFrame

SCHEMA = "dem-bridge/work-precision/1"


def as_frame(measured: Measured) -> DataFrame:
    """Return one row for each setting, observable and norm; numbers are nan where there is no run."""
    from pandas import DataFrame

    columns = [
        *("scene", "backend", "curve", "knob", "value", "settings", *TEXTS.data["columns"]),
        *("observable", "norm", "error", "reference_uncertainty", "known", "reason"),
    ]
    rows = []
    for point in measured.points:
        curve = point.curve
        # all that was asked for, in SI
        settings = json.dumps(curve.settings(point.value) | ({"order": "richardson"} if curve.richardson else {}))
        texts = (measured.scene.name, curve.backend, curve.name, curve.knob, point.value, settings)
        numbers = [float(getattr(point, name)) for name in TEXTS.data["columns"]]
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

    frame, observables, meanings = as_frame(measured), measured.observables, TEXTS.data["variables"]
    grid = ("run", "observable", "norm")
    shape = (len(measured.points), len(observables), len(NORMS))
    runs = frame[:: shape[1] * shape[2]]
    bars = np.array(list(measured.uncertainty.values())).reshape(shape[1:])
    data: dict[str, Any] = {
        "error": (grid, frame["error"].to_numpy(float).reshape(shape), meanings["error"]),
        "known": (grid, (frame["known"] == "yes").to_numpy(np.int8).reshape(shape), meanings["known"]),
        "reference_uncertainty": (grid[1:], bars, meanings["reference_uncertainty"]),
        **{name: ("run", runs[name].to_numpy(float), meaning) for name, meaning in TEXTS.data["columns"].items()},
    }
    scales = {"scale": json.dumps({name: OBSERVABLES[name].scale_name for name in observables})}
    coordinates: dict[str, Any] = {
        "observable": ("observable", list(observables), {"long_name": "observable"} | scales),
        "norm": ("norm", list(NORMS), meanings["norm"]),
        "value": ("run", runs["value"].to_numpy(float), meanings["value"]),
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
