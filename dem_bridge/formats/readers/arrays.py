"""Read arrays with names: npz and npy files of numpy, and netCDF files of any code."""

from __future__ import annotations

import io
import json
import math
import tokenize
import warnings
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dem_bridge.errors import UsageError
from dem_bridge.formats.readers.tables import Entry, Table
from dem_bridge.foundation.files import MOST_BYTES
from dem_bridge.foundation.netcdf import Variable, read_netcdf

#: variables of a file that :meth:`.Trajectory.save` wrote which are read
_OWN = ("time", "displacement", "velocity", "contact_force")
#: exceptions of numpy for a damaged array; its header is a literal of Python
_DAMAGED = (OSError, ValueError, EOFError, SyntaxError, tokenize.TokenError)


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
    except UsageError:
        raise
    except (*_DAMAGED, KeyError, zipfile.BadZipFile, NotImplementedError, RuntimeError, zlib.error) as error:
        raise UsageError(f"the npz file is damaged ({_short(error)}); write it again") from error
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
    except UsageError:
        raise
    except _DAMAGED as error:
        raise UsageError(f"the npy file is damaged ({_short(error)}); write it again") from error
    if array.dtype.names:
        return _table({name: array[name] for name in array.dtype.names})
    if array.ndim != 2:
        raise UsageError(f"the npy file has an array of shape {array.shape}; allowed: a row for each time")
    return Table([Entry(str(k), column) for k, column in enumerate(array.T)], has_headings=False)


def _header(stream: Any) -> tuple[tuple[int, ...], np.dtype[Any]]:
    """Return the shape and the type that the header of an npy file states."""
    version = np.lib.format.read_magic(stream)
    read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    try:
        with warnings.catch_warnings(action="error"):  # a name of a type that numpy abandons, and does not write
            shape, _, dtype = read(stream)
    except (TypeError, DeprecationWarning) as error:  # numpy sorts the keys, which may be of several types
        raise ValueError(f"its header cannot be read: {error}") from error
    if min(shape, default=0) < 0:
        raise ValueError("its header has a length below 0")
    return shape, dtype


def _check(headers: dict[str, tuple[tuple[int, ...], np.dtype[Any]]]) -> None:
    """Raise UsageError for arrays of objects, or arrays that are too large."""
    for name, (shape, dtype) in headers.items():
        if dtype.hasobject or not (dtype.names or dtype.kind in "fiubSU"):
            raise UsageError(f"{name!r} has the type {dtype}; allowed: numbers; write float64")
        _check_size(name, shape, dtype)
    if sum(_size(shape, dtype) for shape, dtype in headers.values()) > MOST_BYTES:
        raise UsageError(f"the arrays have more than {MOST_BYTES >> 20} MiB; write fewer samples")


def _check_size(name: str, shape: tuple[int, ...], dtype: np.dtype[Any]) -> None:
    """Raise UsageError for an array that is too large."""
    if _size(shape, dtype) > MOST_BYTES:
        raise UsageError(f"{name!r} has the shape {shape}, more than {MOST_BYTES >> 20} MiB; write fewer samples")


def _size(shape: tuple[int, ...], dtype: np.dtype[Any]) -> int:
    """Return the bytes of an array, as if a length of 0 were 1: beside one, any other length would be allowed."""
    return math.prod(max(length, 1) for length in shape) * dtype.itemsize


def _table(arrays: dict[str, NDArray[Any]]) -> Table:
    """Return the arrays as a table; a scalar ``dt`` is the time step."""
    table = Table([])
    for name, array in arrays.items():
        if array.dtype.kind in "SU":
            continue
        if array.size == 1 and name.lower() in ("dt", "timestep", "time_step", "dt_s"):
            _state_step(table, float(array.ravel()[0]))
        else:
            table.entries += _entries(name, array, None)
    return table


def _state_step(table: Table, dt: Any) -> None:
    """Set the time step of a table and say so, if it is a number above 0."""
    if isinstance(dt, float) and 0.0 < dt < math.inf:
        table.dt = dt
        table.notes.append(f"the time step is {dt:.9g} s, as the file states")


def _entries(name: str, array: NDArray[Any], unit: str | None) -> Iterator[Entry]:
    """Yield an array, or its components along x, y and z if it has three dimensions."""
    while array.ndim > 2 and 1 in array.shape:
        array = np.squeeze(array, axis=array.shape.index(1))
    if array.ndim == 3 and array.shape[2] in (2, 3):
        for k in range(array.shape[2]):
            yield Entry(name, array[:, :, k], unit, axis=k)
    elif array.ndim <= 2:
        yield Entry(name, array, unit)


def table_of_netcdf(path: Path) -> Table:
    """Read the variables of a netCDF file (classic or netCDF-4) with their units."""
    attributes, variables = read_netcdf(path)
    is_own = str(attributes.get("schema", "")).startswith("dem-bridge/")
    table = Table([])
    for variable in variables:
        if not is_own or variable.name in _OWN:
            table.entries += _variable(variable)
    if is_own:
        with suppress(ValueError, RecursionError, AttributeError):
            settings = json.loads(str(attributes.get("provenance", "{}"))).get("settings", {})
            _state_step(table, settings.get("dt"))
    return table


def own_netcdf(path: Path) -> bool | None:
    """Return True if :meth:`.Trajectory.save` wrote a netCDF-4 file, None if the file is no such file or damaged."""
    try:
        return str(read_netcdf(path, only_attributes=True).attributes.get("schema", "")).startswith(
            "dem-bridge/trajectory/"
        )
    except UsageError:
        return None


def _variable(variable: Variable) -> Iterator[Entry]:
    """Yield a variable with time as its first dimension, or its components along x, y and z."""
    array, attributes = variable.values, variable.attributes
    for name, apply in (("scale_factor", np.multiply), ("add_offset", np.add)):
        if isinstance(factor := attributes.get(name), float):
            array = apply(array, factor)
    order = sorted(range(array.ndim), key=lambda k: variable.dims[k] not in ("time", "frame", "t", "step"))
    unit = str(attributes.get("units", "")).partition(" since ")[0].strip() or None
    array = array.transpose(order)
    if variable.name not in _OWN or np.all(np.isfinite(array)):
        yield from _entries(variable.name, array, unit)


def _short(error: Exception) -> str:
    """Return the message of another library's exception in one short line."""
    return " ".join(str(error).split())[:120]
