"""What netCDF files have: read here in this process, where elsewhere a child does it, whose lines are not counted."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from scipy.io import netcdf_file

from dem_bridge.errors import UsageError
from dem_bridge.foundation import isolated_child, netcdf
from dem_bridge.foundation.netcdf import contents_of_classic, contents_of_netcdf4


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """Return a file with two variables of a dimension "time", and things that are no variables."""
    with h5py.File(tmp_path / "run.nc", "w") as data:
        data["time"] = np.array([0.0, 1.0, 2.0])
        data["time"].make_scale("time")
        data["velocity"] = np.arange(6, dtype=">f4").reshape(3, 2)
        data["velocity"].dims[0].attach_scale(data["time"])
        data["velocity"].attrs.update(
            {"units": "m/s", "code": np.bytes_(b"\xff"), "factor": np.array([2]), "many": [1, 2]}
        )
        data["name"] = "text"
        data.create_group("group")
        data["bare"] = np.zeros(2)
        data["bare"].attrs["NAME"] = "This is a netCDF dimension but not a netCDF variable.         2"
        data.attrs["schema"] = "ours"
    return tmp_path / "run.nc"


def test_variables_have_numbers_dimensions_and_attributes(file: Path) -> None:
    attributes, variables = contents_of_netcdf4(file, only_attributes=False)
    assert attributes == {"schema": "ours"}
    time, velocity = variables
    assert (time.name, time.dims, time.values.tolist()) == ("time", ("time",), [0.0, 1.0, 2.0])
    assert (velocity.name, velocity.dims) == ("velocity", ("time", ""))
    assert (velocity.values.tolist(), velocity.values.dtype) == ([[0.0, 1.0], [2.0, 3.0], [4.0, 5.0]], np.float32)
    # of several numbers, and of things that are neither a number nor a text, nothing is kept
    assert velocity.attributes == {"units": "m/s", "code": "\ufffd", "factor": 2.0}
    assert contents_of_netcdf4(file, only_attributes=True) == ({"schema": "ours"}, [])


@pytest.mark.parametrize(
    ("limit", "value", "message"),
    [
        ("_MOST_VARIABLES", 4, "the file has 5 variables; allowed: 4"),
        ("_MOST_DIMENSIONS", 1, "'velocity' has the shape (3, 2), with the arrays before it more than 512 MiB; write"),
        ("MOST_BYTES", 24, "'velocity' has the shape (3, 2), with the arrays before it more than 0 MiB; write fewer"),
    ],
)
def test_what_is_too_large_is_refused_before_it_is_loaded(
    limit: str, value: int, message: str, file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(netcdf, limit, value)
    with pytest.raises(UsageError) as refused:
        contents_of_netcdf4(file, only_attributes=False)
    assert message in str(refused.value)


def test_a_classic_file_has_the_same(tmp_path: Path) -> None:
    with netcdf_file(tmp_path / "run.nc", "w") as data:
        data.createDimension("time", 2)
        data.createVariable("time", "f8", ("time",))[:] = [0.0, 1.0]
        data.createVariable("word", "c", ("time",))[:] = b"ab"
        data.schema = b"ours"
    attributes, [time] = contents_of_classic(tmp_path / "run.nc", only_attributes=False)
    assert (attributes, time.name, time.dims, time.values.tolist()) == (
        {"schema": "ours"},
        "time",
        ("time",),
        [0.0, 1.0],
    )
    assert contents_of_classic(tmp_path / "run.nc", only_attributes=True) == ({"schema": "ours"}, [])


def _too_much(_: Path) -> Any:
    raise MemoryError


def _refused(_: Path) -> Any:
    raise UsageError("the file has no time; add it")


def _broken(_: Path) -> Any:
    raise KeyError("two\nlines")


@pytest.mark.parametrize(
    ("function", "reply"),
    [
        ("_too_much", "the file needs too much memory; write fewer samples"),
        ("_refused", "the file has no time; add it"),
        ("_broken", "the file is damaged or of another kind ('two\\nlines'); write it again"),
    ],
)
def test_the_child_answers_every_exception_by_a_line(function: str, reply: str, tmp_path: Path) -> None:
    assert sys.modules[__name__]
    assert isolated_child.answer(__name__, function, str(tmp_path), {}) == (False, reply)
