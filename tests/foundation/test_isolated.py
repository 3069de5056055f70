"""Functions called in a child process: results, crashes, endless loops, and too much memory."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest

from dem_bridge.errors import UsageError
from dem_bridge.foundation import isolated
from dem_bridge.foundation.isolated import call_isolated
from dem_bridge.foundation.netcdf import read_netcdf


@pytest.fixture
def file(tmp_path: Path) -> Path:
    (tmp_path / "data").write_text("some text")
    return tmp_path / "data"


def test_a_result_and_an_exception_of_any_kind_come_back(file: Path) -> None:
    assert call_isolated("posixpath", "basename", file) == "data"
    with pytest.raises(UsageError, match="is damaged or of another kind"):
        call_isolated("json", "load", file)


def test_the_child_serves_for_many_files_and_is_started_again_after_a_crash(file: Path) -> None:
    call_isolated("posixpath", "basename", file)
    first = isolated._children[0].process.pid
    call_isolated("posixpath", "basename", file)
    assert isolated._children[0].process.pid == first
    with pytest.raises(UsageError, match="reading it crashed and was stopped"):
        call_isolated("tests.helpers.hostile", "crash", file)
    assert call_isolated("posixpath", "basename", file) == "data"
    assert isolated._children[0].process.pid != first


@pytest.mark.parametrize("function", ["endless", "asleep"])
def test_what_does_not_end_is_stopped(function: str, file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(isolated, "CPU_SECONDS", 0.2)
    monkeypatch.setattr(isolated, "WALL_FACTOR", 2.0)
    with pytest.raises(UsageError, match="reading it took more than"):
        call_isolated("tests.helpers.hostile", function, file)


def test_too_much_memory_is_an_error_of_one_line(file: Path) -> None:
    with pytest.raises(UsageError, match="needs too much memory"):
        call_isolated("tests.helpers.hostile", "greedy", file)


def test_shapes_are_checked_before_anything_is_loaded(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "sparse.nc", "w") as file:
        file.create_dataset("velocity", shape=(10**6, 10**6), chunks=(1000, 1000), dtype="f8")
    with pytest.raises(UsageError, match=r"'velocity' has the shape \(1000000, 1000000\)"):
        read_netcdf(tmp_path / "sparse.nc")


def test_data_of_other_files_are_left_out(tmp_path: Path) -> None:
    (tmp_path / "secret").write_bytes(np.arange(4.0).tobytes())
    with h5py.File(tmp_path / "other.nc", "w") as file:
        file["inner"] = np.ones(3)
    with h5py.File(tmp_path / "links.nc", "w") as file:
        file["own"] = np.arange(3)
        file["linked"] = h5py.ExternalLink(str(tmp_path / "other.nc"), "/inner")
        file.create_dataset("outside", shape=(4,), dtype="f8", external=[(str(tmp_path / "secret"), 0, 32)])
        layout = h5py.VirtualLayout(shape=(3,), dtype="f8")
        layout[:] = h5py.VirtualSource(str(tmp_path / "other.nc"), "inner", shape=(3,))
        file.create_virtual_dataset("virtual", layout)
        file.attrs["schema"] = np.array([1, 2, 3])
    contents = read_netcdf(tmp_path / "links.nc")
    assert [variable.name for variable in contents.variables] == ["own"]
    assert contents.attributes == {}
