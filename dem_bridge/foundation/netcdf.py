"""Read netCDF files, classic and netCDF-4, in a child process, and write netCDF-4: attributes and arrays.

Shapes are checked before an array is loaded. Links and data sets that refer to other files are left out.
"""

from __future__ import annotations

import io
import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dem_bridge.errors import UsageError
from dem_bridge.foundation.files import MOST_BYTES, opened
from dem_bridge.foundation.isolated import call_isolated

#: largest number of variables and of dimensions of one of them
_MOST_VARIABLES, _MOST_DIMENSIONS = 1000, 6
#: largest number of characters of an attribute
_MOST_TEXT = 10_000_000

Attributes = Mapping[str, str | float]
"""Attributes that are a text or a number; others are left out."""


class Variable(NamedTuple):
    """An array of a file."""

    name: str
    values: NDArray[Any]
    dims: tuple[str, ...]
    attributes: Attributes


class Contents(NamedTuple):
    """Hold attributes and variables of a netCDF file."""

    attributes: Attributes
    variables: list[Variable]


def netcdf_bytes(variables: Mapping[str, tuple[tuple[str, ...], Any, Attributes]], attributes: Attributes) -> bytes:
    """Return a netCDF-4 file of variables (their dimensions, values and attributes), as xarray writes it.

    The file is made in memory, because HDF5 ends the process where a disk or a limit of size stops it.
    """
    import h5netcdf

    buffer = io.BytesIO()
    with h5netcdf.File(buffer, "w") as file:
        for name, (dims, values, about) in variables.items():
            array = np.asarray(values)
            for dim, length in zip(dims, array.shape, strict=True):
                if dim not in file.dimensions:
                    file.dimensions[dim] = length
            fill = np.nan if array.dtype.kind == "f" else None
            file.create_variable(name, dims, data=array, fillvalue=fill).attrs.update(about)
        file.attrs.update(attributes)
    return buffer.getvalue()


def is_netcdf(first: bytes) -> bool:
    """Return True if the first bytes of a file are those of a netCDF file."""
    return first.startswith((b"CDF", b"\x89HDF"))


def read_netcdf(path: Path, *, only_attributes: bool = False) -> Contents:
    """Return the contents of a netCDF file; raise UsageError if it is missing, damaged, too large or no netCDF."""
    try:
        with opened(path, MOST_BYTES) as file:
            first = file.read(8) or b""
    except OSError as error:
        raise UsageError(f"the file cannot be read ({error.strerror}); give a netCDF file") from error
    if not is_netcdf(first):
        raise UsageError("the file is no netCDF file; give a file that Trajectory.save wrote, or of another code")
    classic = first.startswith(b"CDF")
    function = "contents_of_classic" if classic else "contents_of_netcdf4"
    return Contents(*call_isolated("dem_bridge.foundation.netcdf", function, path, only_attributes=only_attributes))


def contents_of_classic(path: Path, only_attributes: bool) -> tuple[Attributes, list[Variable]]:
    """Return the contents of a classic file (in the child process)."""
    from scipy.io import netcdf_file

    with netcdf_file(path, "r", mmap=False) as file:
        variables = [
            _variable(name, variable.data, variable.dimensions, variable._attributes)
            for name, variable in ({} if only_attributes else file.variables).items()
            if variable.data.dtype.kind in "fiu"
        ]
        return _attributes(file._attributes), variables


def contents_of_netcdf4(path: Path, only_attributes: bool) -> tuple[Attributes, list[Variable]]:
    """Return the contents of a netCDF-4 file (in the child process)."""
    import h5py

    with h5py.File(path, "r") as file:
        attributes = _attributes(file.attrs)
        if only_attributes:
            return attributes, []
        if len(file) > _MOST_VARIABLES:
            raise UsageError(f"the file has {len(file)} variables; allowed: {_MOST_VARIABLES}")
        datasets = {name: file[name] for name in file if isinstance(file.get(name, getlink=True), h5py.HardLink)}
        arrays = [(name, dataset) for name, dataset in datasets.items() if _is_array(dataset, h5py.Dataset)]
        _check_sizes((name, dataset.shape, dataset.dtype) for name, dataset in arrays)
        return attributes, [_variable(name, dataset, _dims(name, dataset), dataset.attrs) for name, dataset in arrays]


def _is_array(dataset: Any, kind: type) -> bool:
    """Return True for numbers in this file; a dimension without a coordinate is a data set of zeros."""
    if not isinstance(dataset, kind):
        return False
    data: Any = dataset
    bare = str(_attributes(data.attrs).get("NAME", "")).startswith("This is a netCDF dimension but not")
    return data.dtype.kind in "fiu" and data.shape is not None and not (bare or data.is_virtual or data.external)


def _dims(name: str, dataset: Any) -> tuple[str, ...]:
    """Return the names of the dimensions of a data set; a coordinate is the scale of its own dimension."""
    if dataset.ndim == 1:
        return (name,)
    scales = [next(iter(dim.values()), None) for dim in dataset.dims]
    return tuple("" if scale is None else str(scale.name).strip("/") for scale in scales)


def _check_sizes(arrays: Iterable[tuple[str, tuple[int, ...], np.dtype[Any]]]) -> None:
    """Raise UsageError for arrays that are too large, each or together."""
    total = 0
    for name, shape, dtype in arrays:
        total += math.prod(shape) * dtype.itemsize
        if len(shape) > _MOST_DIMENSIONS or total > MOST_BYTES:
            size = f"the shape {shape}, with the arrays before it more than {MOST_BYTES >> 20} MiB"
            raise UsageError(f"{name!r} has {size}; write fewer samples")


def _variable(name: str, values: Any, dims: tuple[str, ...], attributes: Mapping[str, Any]) -> Variable:
    """Return a variable whose numbers are in memory, in the byte order of this machine."""
    array = np.asarray(values[()])
    return Variable(name, array.astype(array.dtype.newbyteorder("=")), tuple(dims), _attributes(attributes))


def _attributes(attributes: Mapping[str, Any]) -> dict[str, str | float]:
    """Return the attributes that are a text or a number."""
    plain: dict[str, str | float] = {}
    for name, value in attributes.items():
        if isinstance(value, bytes | str) and len(value) <= _MOST_TEXT:
            plain[name] = value.decode("utf-8", "replace") if isinstance(value, bytes) else value
        elif np.size(value) == 1 and np.asarray(value).dtype.kind in "fiu":
            plain[name] = float(np.ravel(value)[0])
    return plain
