"""Read arrays with names: npz and npy files of numpy, and netCDF files of any code."""

from __future__ import annotations

import io
import math
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dem_bridge.errors import UsageError
from dem_bridge.readers.source import MOST_BYTES
from dem_bridge.readers.tables import Entry, Table


def read_npz(path: Path) -> Table:
    """Read the arrays of an npz file; shapes are checked before the arrays are loaded, and objects are refused."""
    try:
        with zipfile.ZipFile(path) as archive:
            members = [member for member in archive.infolist() if member.filename.endswith(".npy")]
            headers = {}
            for member in members:
                with archive.open(member) as stream:
                    headers[member.filename.removesuffix(".npy")] = _header(stream)
            _check(headers)
            with np.load(path, allow_pickle=False) as loaded:
                arrays = {name: loaded[name] for name in headers}
    except (OSError, ValueError, EOFError, KeyError, zipfile.BadZipFile, NotImplementedError, RuntimeError) as error:
        if isinstance(error, UsageError):
            raise
        raise UsageError(f"the npz file is damaged ({error}); write it again") from error
    if not arrays:
        raise UsageError("the npz file has no arrays; allowed: arrays such as time and velocity")
    return _table(arrays)


def read_npy(content: bytes) -> Table:
    """Read the array of an npy file: a table whose columns have no headings, or a structured array."""
    try:
        stream = io.BytesIO(content)
        _check({"the array": _header(stream)})
        stream.seek(0)
        array = np.load(stream, allow_pickle=False)
    except (OSError, ValueError, EOFError) as error:
        if isinstance(error, UsageError):
            raise
        raise UsageError(f"the npy file is damaged ({error}); write it again") from error
    if array.dtype.names:
        return _table({name: array[name] for name in array.dtype.names})
    if array.ndim != 2:
        raise UsageError(f"the npy file has an array of shape {array.shape}; allowed: a row for each time")
    return Table([Entry(str(k), column) for k, column in enumerate(array.T)], named=False)


def _header(stream: Any) -> tuple[tuple[int, ...], np.dtype[Any]]:
    """Return the shape and the type that the header of an npy file states."""
    version = np.lib.format.read_magic(stream)
    read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, _, dtype = read(stream)
    return shape, dtype


def _check(headers: dict[str, tuple[tuple[int, ...], np.dtype[Any]]]) -> None:
    """Raise UsageError for arrays of objects, or arrays that are too large."""
    for name, (shape, dtype) in headers.items():
        if dtype.hasobject or not (dtype.names or dtype.kind in "fiubSU"):
            raise UsageError(f"{name!r} has the type {dtype}; allowed: numbers; write float64")
        _check_size(name, shape, dtype)
    if sum(math.prod(shape) * dtype.itemsize for shape, dtype in headers.values()) > MOST_BYTES:
        raise UsageError(f"the arrays have more than {MOST_BYTES >> 20} MiB; write fewer samples")


def _check_size(name: str, shape: tuple[int, ...], dtype: np.dtype[Any]) -> None:
    """Raise UsageError for an array that is too large."""
    if math.prod(shape) * dtype.itemsize > MOST_BYTES:
        raise UsageError(f"{name!r} has the shape {shape}, more than {MOST_BYTES >> 20} MiB; write fewer samples")


def _table(arrays: dict[str, NDArray[Any]]) -> Table:
    """Return the arrays as a table; a scalar ``dt`` is the time step."""
    table = Table([])
    for name, array in arrays.items():
        if array.dtype.kind in "SU":
            continue
        if array.size == 1 and name.lower() in ("dt", "timestep", "time_step", "dt_s"):
            table.dt = float(array.ravel()[0])
            table.notes.append(f"the time step is {table.dt:.9g} s, as the file states")
        else:
            table.entries += _entries(name, array, None)
    return table


def _entries(name: str, array: NDArray[Any], unit: str | None) -> Iterator[Entry]:
    """Yield an array, or its components along x, y and z if it has three dimensions."""
    if array.ndim > 2:
        array = np.squeeze(array, axis=tuple(k for k in range(array.ndim - 2) if array.shape[k] == 1))
    if array.ndim == 3 and array.shape[2] in (2, 3):
        for k in range(array.shape[2]):
            yield Entry(name, array[:, :, k], unit, axis=k)
    elif array.ndim <= 2:
        yield Entry(name, array, unit)


def read_netcdf(path: Path, first: bytes) -> Table:
    """Read the variables of a netCDF file (classic or netCDF-4) with their units."""
    import xarray as xr

    engine: Any = "scipy" if first.startswith(b"CDF") else "h5netcdf"
    try:
        with xr.open_dataset(path, engine=engine, decode_times=False) as dataset:
            if dataset.attrs.get("schema", "").startswith("dem-bridge/"):
                return _own(dataset)
            table = Table([])
            for name, variable in dataset.variables.items():
                _check_size(str(name), variable.shape, variable.dtype)
                if variable.dtype.kind in "fiu":
                    unit = str(variable.attrs.get("units", "")).partition(" since ")[0].strip() or None
                    dims = [str(dim) for dim in variable.dims]
                    order = sorted(range(len(dims)), key=lambda k: dims[k] not in ("time", "frame", "t", "step"))
                    array = variable.transpose(*(variable.dims[k] for k in order)).values
                    table.entries += _entries(str(name), array, unit)
            return table
    except UsageError:
        raise
    except Exception as error:  # the libraries raise exceptions of many types for damaged files
        raise UsageError(f"the netCDF file is damaged or of another kind ({error}); write it again") from error


def _own(dataset: Any) -> Table:
    """Return the samples of a file that :meth:`.Trajectory.save` wrote."""
    import json

    names = {"time": "s", "displacement": "m", "velocity": "m/s", "contact_force": "N"}
    table = Table([Entry(name, dataset[name].values, unit) for name, unit in names.items()])
    table.entries = [entry for entry in table.entries if np.all(np.isfinite(entry.values))]
    settings = json.loads(dataset.attrs.get("provenance", "{}")).get("settings", {})
    if isinstance(dt := settings.get("dt"), float):
        table.dt = dt
        table.notes.append(f"the time step is {dt:.9g} s, as the file states")
    return table
