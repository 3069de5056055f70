"""The one result: complete, read-only, labelled, and the same after a trip to the disk."""

from __future__ import annotations

import errno
import json
import math
import pickle
import subprocess
import sys
from dataclasses import FrozenInstanceError, replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import xarray as xr

from dem_bridge.errors import UsageError
from dem_bridge.trajectory.trajectory import (
    QUANTITIES,
    SCHEMA,
    UNKNOWN,
    VOCABULARY,
    Cost,
    Trajectory,
    Uncertainty,
    load_trajectory,
)
from tests.helpers.fake_runs import free_flight, uncertain

ARRAYS = ("time", *VOCABULARY)


def _same(run: Trajectory, other: Trajectory) -> None:
    for name in ARRAYS:
        np.testing.assert_array_equal(getattr(run, name), getattr(other, name), err_msg=name)
    for name in run.uncertainty:
        np.testing.assert_array_equal(run.uncertainty[name], other.uncertainty[name], err_msg=f"bar of {name}")
    assert run.cost == other.cost
    assert dict(run.provenance) == dict(other.provenance)


@pytest.mark.parametrize("name", ARRAYS)
def test_arrays_are_read_only_doubles(name: str) -> None:
    array = getattr(free_flight(), name)
    assert array.dtype == np.float64
    with pytest.raises(ValueError, match="read-only"):
        array[...] = 0.0


def test_bars_are_read_only() -> None:
    run = free_flight()
    with pytest.raises(TypeError):
        run.uncertainty["velocity"] = 0.0  # type: ignore[index]
    with pytest.raises(ValueError, match="read-only"):
        run.uncertainty["peak_force"][0] = 1.0


def test_fields_and_provenance_are_read_only() -> None:
    run = free_flight()
    with pytest.raises(FrozenInstanceError):
        run.time = np.zeros(5)  # type: ignore[misc]
    with pytest.raises(TypeError):
        run.provenance["backend"] = "other"  # type: ignore[index]


def test_a_trajectory_does_not_share_memory_with_what_it_was_made_of() -> None:
    velocity = np.ones((5, 3))
    run = free_flight(velocity=velocity)
    velocity[0, 0] = 7.0
    assert run.velocity[0, 0] == 1.0


def test_an_array_that_can_still_be_written_to_by_its_owner_is_copied() -> None:
    owner = np.ones((5, 3))
    seen = owner.view()
    seen.setflags(write=False)
    of_others = np.frombuffer(bytearray(owner.tobytes())).reshape(5, 3)
    of_others.setflags(write=False)
    for array in (seen, of_others):
        assert not np.shares_memory(free_flight(velocity=array).velocity, array)


def test_arrays_that_nobody_can_write_to_are_shared() -> None:
    run = free_flight()
    again = replace(run, provenance={"backend": "other"})
    assert all(np.shares_memory(getattr(again, name), getattr(run, name)) for name in ARRAYS if getattr(run, name).size)
    content = np.frombuffer(b"\0" + np.ones((5, 3)).tobytes(), np.uint8)
    aligned, shifted = content[1:].tobytes(), content.tobytes()
    velocity = np.frombuffer(aligned).reshape(5, 3)
    assert np.shares_memory(free_flight(velocity=velocity).velocity, velocity)
    # sums over numbers that are not aligned, or have gaps, may differ in their last digits
    assert free_flight(velocity=np.frombuffer(shifted, offset=1).reshape(5, 3)).velocity.flags.aligned
    gaps = np.frombuffer(np.ones((5, 6)).tobytes()).reshape(5, 6)[:, ::2]
    assert free_flight(velocity=gaps).velocity.flags.c_contiguous


@pytest.mark.parametrize(
    ("name", "shape"),
    [
        ("displacement", (5, 2)),
        ("displacement", (4, 3)),
        ("velocity", (4, 3)),
        ("contact_force", (5, 3)),
        ("crossing_time", (3,)),
    ],
)
def test_a_shape_that_does_not_fit_the_others_is_refused(name: str, shape: tuple[int, ...]) -> None:
    changes: dict[str, Any] = {name: np.zeros(shape)}
    with pytest.raises(ValueError, match=f"{name} has shape"):
        free_flight(**changes)


def test_one_bar_per_contact_is_kept_and_one_for_all_is_spread() -> None:
    bars = uncertain(peak_force=[1.0, 2.0], crossing_time=math.inf)
    run = free_flight(uncertainty=bars)
    assert run.uncertainty["peak_force"].tolist() == [1.0, 2.0]
    assert run.uncertainty["crossing_time"].tolist() == [math.inf, math.inf]
    assert isinstance(run.uncertainty["velocity"], float)


def test_an_uncertainty_has_all_four_quantities() -> None:
    with pytest.raises(TypeError, match="displacement"):
        Uncertainty(velocity=0.0)  # type: ignore[call-arg]
    with pytest.raises(KeyError):
        UNKNOWN["contact_force"]


def test_a_run_for_which_nothing_was_estimated_has_an_infinite_uncertainty() -> None:
    run = free_flight(uncertainty=UNKNOWN)
    assert set(run.uncertainty) == set(QUANTITIES)
    assert all(np.all(np.isinf(value)) for value in run.uncertainty.values())
    assert run.uncertainty["peak_force"].shape == (2,)


def test_a_pickled_trajectory_arrives_the_same() -> None:
    run = free_flight(provenance={"backend": "fake", "settings": {"dt": 1e-8}})
    _same(pickle.loads(pickle.dumps(run)), run)


def test_a_saved_file_is_the_one_that_xarray_writes(tmp_path: Path) -> None:
    run = free_flight(uncertainty=uncertain(velocity=math.inf, peak_force=[1e-300, math.inf]))
    run.save(tmp_path / "ours.nc")
    run.to_xarray().to_netcdf(tmp_path / "theirs.nc", engine="h5netcdf")
    with xr.open_dataset(tmp_path / "ours.nc") as ours, xr.open_dataset(tmp_path / "theirs.nc") as theirs:
        xr.testing.assert_identical(ours, theirs)
        assert {name: ours[name].dtype for name in ours.variables} == {n: theirs[n].dtype for n in theirs.variables}
    with h5py.File(tmp_path / "ours.nc") as mine, h5py.File(tmp_path / "theirs.nc") as other:  # as ncdump shows them
        assert set(mine) == set(other)  # the order differs: coordinates come first
        for name in other:
            assert (mine[name].shape, mine[name].dtype) == (other[name].shape, other[name].dtype)
            assert set(mine[name].attrs) == set(other[name].attrs)


def test_saving_imports_no_xarray(tmp_path: Path) -> None:
    code = (
        "import sys; from dem_bridge.foundation.netcdf import netcdf_bytes\n"
        "netcdf_bytes({'v': (('time',), [1.0], {})}, {});"
        "print(*{'xarray', 'pandas', 'dask', 'pyarrow'} & set(sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=tmp_path)
    assert done.stdout.split() == []


def test_the_dataset_has_labels_units_and_bars() -> None:
    dataset = free_flight().to_xarray()
    assert dict(dataset.sizes) == {"time": 5, "body": 3, "contact": 2}
    for name, (unit, _, dims) in VOCABULARY.items():
        assert dataset[name].attrs["units"] == unit
        assert dataset[name].dims == dims
    assert dataset["time"].attrs["units"] == "s"
    assert {name for name in dataset.data_vars if str(name).endswith("_uncertainty")} == {
        f"{name}_uncertainty" for name in QUANTITIES
    }
    assert dataset.attrs["schema"] == SCHEMA
    assert json.loads(dataset.attrs["provenance"]) == {"backend": "fake"}


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"uncertainty": uncertain(velocity=math.inf, peak_force=[1e-300, math.inf])},
        {
            "uncertainty": uncertain(
                parts={"time_step": 0.1},
                roundoff_floor=1e-300,
                sampling={"velocity": 0.0},
                cost=Cost(wall=1.0, cpu=math.nan, steps=2, force_evaluations=3),
            )
        },
        {"crossing_time": [math.nan, 0.1], "contact_force": np.full((5, 2), np.nan)},
        {"provenance": {"backend": "fake", "settings": {"dt": 1e-8}, "lammps": {"packages": ["GRANULAR"]}}},
        {"contacts": 0},
        {"bodies": 1, "contacts": 0, "samples": 1},
    ],
    ids=["plain", "uncertainty", "parts of the uncertainty", "nan", "provenance", "no contacts", "smallest"],
)
def test_what_is_saved_is_loaded_bit_for_bit(tmp_path: Path, changes: dict[str, Any]) -> None:
    run = free_flight(**changes)
    run.save(tmp_path / "run.nc")
    _same(load_trajectory(tmp_path / "run.nc"), run)
    assert [path.name for path in tmp_path.iterdir()] == ["run.nc"]


def test_saving_replaces_an_older_file(tmp_path: Path) -> None:
    file = tmp_path / "run.nc"
    free_flight(samples=9).save(file)
    free_flight(samples=2).save(str(file))
    assert len(load_trajectory(file).time) == 3


def test_a_save_that_fails_leaves_the_older_file_and_no_part(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "run.nc"
    free_flight(samples=9).save(file)

    def full_disk(path: Path, content: bytes) -> int:
        with path.open("wb") as part:
            part.write(content[: len(content) // 2])
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", full_disk)
    with pytest.raises(UsageError, match="No space left"):
        free_flight(samples=2).save(file)
    monkeypatch.undo()
    assert len(load_trajectory(file).time) == 10
    assert [path.name for path in tmp_path.iterdir()] == ["run.nc"]


def test_a_missing_file_is_refused_by_name(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"nope\.nc: no such file"):
        load_trajectory(tmp_path / "nope.nc")


@pytest.mark.parametrize("content", [b"", b"time,velocity\n0,1\n"], ids=["empty", "text"])
def test_a_file_of_another_kind_is_refused_by_name(tmp_path: Path, content: bytes) -> None:
    file = tmp_path / "run.nc"
    file.write_bytes(content)
    with pytest.raises(UsageError, match=r"run\.nc: not a netCDF-4 file"):
        load_trajectory(file)


def test_half_a_file_is_refused_by_name(tmp_path: Path) -> None:
    file = tmp_path / "run.nc"
    free_flight().save(file)
    file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
    with pytest.raises(UsageError, match=r"run\.nc: not a netCDF-4 file"):
        load_trajectory(file)


@pytest.mark.parametrize(("version", "advice"), [(0, ""), (99, "; a newer dem_bridge wrote it: update")])
def test_another_schema_is_refused_by_its_name(tmp_path: Path, version: int, advice: str) -> None:
    file = tmp_path / "run.nc"
    dataset = free_flight().to_xarray()
    dataset.attrs["schema"] = f"dem-bridge/trajectory/{version}"
    dataset.to_netcdf(file, engine="h5netcdf")
    with pytest.raises(UsageError) as refused:
        load_trajectory(file)
    read = "'dem-bridge/trajectory/1', 'dem-bridge/trajectory/2'"
    assert str(refused.value) == f"{file}: schema = 'dem-bridge/trajectory/{version}'; allowed: {read}{advice}"
