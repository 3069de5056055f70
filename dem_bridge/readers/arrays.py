"""Read arrays with names: npz and npy files of numpy, and netCDF files of any code."""

from __future__ import annotations

import io
import json
import math
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dem_bridge.errors import UsageError
from dem_bridge.readers.source import MOST_BYTES
from dem_bridge.readers.tables import Entry, Table

#: variables of a file that :meth:`.Trajectory.save` wrote which are read
_OWN = ("time", "displacement", "velocity", "contact_force")


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
    except (OSError, ValueError, EOFError) as error:
        if isinstance(error, UsageError):
            raise
        raise UsageError(f"the npy file is damaged ({_short(error)}); write it again") from error
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


def read_netcdf(path: Path, first: bytes) -> Table:
    """Read the variables of a netCDF file (classic or netCDF-4) with their units."""
    try:
        with ExitStack() as stack:
            read = _classic if first.startswith(b"CDF") else _netcdf4
            attributes, variables = read(path, stack)
            own = _text(attributes.get("schema", "")).startswith("dem-bridge/")
            table = Table([])
            for variable in variables:
                if not own or variable.name in _OWN:
                    table.entries += _variable(variable)
            if own:
                settings = json.loads(_text(attributes.get("provenance", "{}"))).get("settings", {})
                _state_step(table, settings.get("dt"))
            return table
    except UsageError:
        raise
    except Exception as error:  # the libraries raise exceptions of many types for damaged files
        raise UsageError(f"the netCDF file is damaged or of another kind ({_short(error)}); write it again") from error


def own_netcdf(path: Path) -> bool | None:
    """Return True if :meth:`.Trajectory.save` wrote a netCDF-4 file, None if the file is no such file or damaged."""
    import h5py

    try:
        with h5py.File(path, "r") as file:
            return _text(file.attrs.get("schema", "")).startswith("dem-bridge/trajectory/")
    except (OSError, RuntimeError, ValueError):
        return None


@dataclass(frozen=True)
class _Variable:
    """Hold a variable of a netCDF file: ``values[()]`` are its numbers."""

    name: str
    values: Any
    dims: tuple[str, ...]
    attributes: Mapping[str, Any]


def _classic(path: Path, stack: ExitStack) -> tuple[Mapping[str, Any], list[_Variable]]:
    """Return the attributes and the variables of a classic file."""
    from scipy.io import netcdf_file

    file = stack.enter_context(netcdf_file(path, "r", mmap=False))
    return file._attributes, [
        _Variable(name, variable.data, variable.dimensions, variable._attributes)
        for name, variable in file.variables.items()
    ]


def _netcdf4(path: Path, stack: ExitStack) -> tuple[Mapping[str, Any], list[_Variable]]:
    """Return the attributes and the variables of a netCDF-4 file."""
    import h5py

    file = stack.enter_context(h5py.File(path, "r"))
    variables = []
    for name, dataset in file.items():
        # a dimension without a coordinate is a data set of zeros
        bare = _text(dataset.attrs.get("NAME", "")).startswith("This is a netCDF dimension but not")
        if isinstance(dataset, h5py.Dataset) and dataset.dtype.kind in "fiu" and not bare:
            scales = [next(iter(dim.values()), None) for dim in dataset.dims]
            dims = tuple("" if scale is None else str(scale.name).strip("/") for scale in scales)
            # a coordinate is the scale of its own dimension
            variables.append(_Variable(name, dataset, (name,) if dataset.ndim == 1 else dims, dict(dataset.attrs)))
    return dict(file.attrs), variables


def _variable(variable: _Variable) -> Iterator[Entry]:
    """Yield a variable with time as its first dimension, or its components along x, y and z."""
    shape, dtype = variable.values.shape, variable.values.dtype
    if dtype.kind not in "fiu":
        return
    _check_size(variable.name, shape, dtype)
    array = np.asarray(variable.values[()])
    array = array.astype(array.dtype.newbyteorder("="))
    attributes = variable.attributes
    for name, apply in (("scale_factor", np.multiply), ("add_offset", np.add)):
        if name in attributes:
            array = apply(array, float(np.ravel(attributes[name])[0]))
    order = sorted(range(array.ndim), key=lambda k: variable.dims[k] not in ("time", "frame", "t", "step"))
    unit = _text(attributes.get("units", "")).partition(" since ")[0].strip() or None
    array = array.transpose(order)
    if variable.name not in _OWN or np.all(np.isfinite(array)):
        yield from _entries(variable.name, array, unit)


def _text(value: Any) -> str:
    """Return an attribute as text."""
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)


def _short(error: Exception) -> str:
    """Return the message of another library's exception in one short line."""
    return " ".join(str(error).split())[:120]
