"""Files of any code: what an independent writer writes is read to rounding, whatever the format and its habits."""

from __future__ import annotations

import gzip
from dataclasses import replace
from pathlib import Path
from typing import Any

import ase
import ase.io
import numpy as np
import pytest
import xarray as xr
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.io import netcdf_file

from dem_bridge.readers import Record, read_record
from dem_bridge.trajectory import Trajectory
from tests.helpers.export_chains import CROSSED
from tests.helpers.export_runs import made_up

RUN = made_up(CROSSED)
N, N_T = CROSSED.n_body, len(RUN.time)
PLACES = 0.018 * np.arange(N)
#: interval of RUN, s, and a time step of which it is a multiple
INTERVAL = CROSSED.duration / (N_T - 1)
EPS = float(np.finfo(float).eps)


def _agrees(record: Record, run: Trajectory = RUN) -> None:
    """Assert that all values are those of the run to the rounding errors that the record states."""
    assert record.values
    for name, values in record.values.items():
        truth = getattr(run, name)[:, list(record.columns[name])]
        assert values.shape == truth.shape == record.rounding[name].shape
        off = np.abs(values - truth) - record.rounding[name]
        # differences of positions round once more
        assert np.max(off) <= 4.0 * EPS * np.max(np.abs(truth)) + 1e-16 * record.displacement_from_first, name
    np.testing.assert_allclose(record.time, run.time, rtol=1e-12, atol=1e-18)


def _table(head: str, *columns: np.ndarray, number: str = "%.17g", delimiter: str = ",") -> str:
    rows = np.column_stack(columns)
    return "\n".join([head, *(delimiter.join(number % value for value in row) for row in rows)]) + "\n"


def _read(tmp_path: Path, content: str | bytes, name: str = "run.csv", **how: Any) -> Record:
    (tmp_path / name).write_bytes(content if isinstance(content, bytes) else content.encode())
    return read_record(tmp_path / name, CROSSED, **how)


@pytest.mark.parametrize(
    ("head", "unit_t", "unit_v"),
    [
        ("t,v0,v1,v2,v3", 1.0, 1.0),
        ("time,v_0,v_1,v_2,v_3", 1.0, 1.0),
        ("t_s,vx_0,vx_1,vx_2,vx_3", 1.0, 1.0),
        ("time [s],v[0],v[1],v[2],v[3]", 1.0, 1.0),
        ("time_ms,v0,v1,v2,v3", 1e-3, 1.0),
        ("t/us,v0 (mm/s),v1 (mm/s),v2 (mm/s),v3 (mm/s)", 1e-6, 1e-3),
        ("Time (s),body 0 velocity [m/s],body 1 velocity [m/s],body 2 velocity [m/s],body 3 velocity [m/s]", 1.0, 1.0),
        ("t (ns),v_0_cm_per_s,v_1_cm_per_s,v_2_cm_per_s,v_3_cm_per_s", 1e-9, 1e-2),
        ("t,v_1,v_2,v_3,v_4", 1.0, 1.0),
    ],
)
@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
def test_headings_of_many_habits_are_recognised(
    head: str, unit_t: float, unit_v: float, delimiter: str, tmp_path: Path
) -> None:
    text = _table(head.replace(",", delimiter), RUN.time / unit_t, RUN.velocity / unit_v, delimiter=delimiter)
    record = _read(tmp_path, text)
    _agrees(record)
    assert record.columns == {"velocity": (0, 1, 2, 3)}
    assert ("time has no unit in the file and is read in s" in record.recognised) == (
        head[:2] in ("t,", "ti") and unit_t == 1.0 and "s]" not in head
    )
    assert any("count from 1" in sentence for sentence in record.recognised) == ("v_4" in head)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=40)
@given(
    number=st.sampled_from(["%.6g", "%.6f", "%.17g", "%.9e", "%.12g", "%.4e", "%.10f"]),
    seed=st.integers(0, 10**6),
    form=st.sampled_from(["wide", "long", "blanks", "comment"]),
    chosen=st.sets(st.integers(0, N - 1), min_size=1),
)
def test_what_is_written_is_read_to_the_rounding_of_its_digits(
    number: str, seed: int, form: str, chosen: set[int], tmp_path: Path
) -> None:
    run, bodies = made_up(CROSSED, seed=seed), sorted(chosen)
    velocity = run.velocity[:, bodies]
    if form == "long":
        columns = (np.repeat(run.time, len(bodies)), np.tile(bodies, N_T), velocity.ravel())
        text = _table("time [s],body,velocity [m/s]", *columns, number=number)
    else:
        heads = ["t", *(f"v_{body}" for body in bodies)]
        mark = "# " if form == "comment" else ""
        delimiter = "," if form == "wide" else " "
        text = _table(mark + delimiter.join(heads), run.time, velocity, number=number, delimiter=delimiter)
    if number in ("%.6f", "%.4e", "%.10f") and form == "long":
        return  # times or bodies of few digits are no keys of a long table
    record = _read(tmp_path, text)
    one_based = bodies[0] == 1 and bodies[-1] == N
    assert record.columns["velocity"] == tuple(bodies)
    assert not one_based
    off = np.abs(record.values["velocity"] - velocity)
    rounding = record.rounding["velocity"]
    assert np.all(off <= rounding * (1.0 + 1e-9) + EPS * np.abs(velocity))
    # ... and no more than twice what the digits permit
    digits = {"%.6g": 6, "%.17g": 17, "%.9e": 10, "%.12g": 12, "%.4e": 5}.get(number)
    if digits is not None:
        assert np.all(rounding <= 10.0 ** (1 - digits) * np.abs(velocity) + EPS * np.abs(velocity))
    else:
        assert np.all(rounding <= 10.0 ** -int(number[2:-1]) + EPS)
    if number != "%.17g":
        np.testing.assert_allclose(record.time, run.time, rtol=1e-12, err_msg="times are restored")
        assert any("restored" in sentence for sentence in record.recognised)


def test_uneven_times_of_few_digits_are_not_restored(tmp_path: Path) -> None:
    time = np.array([0.0, 1e-6, 3e-6, 3.5e-6, 9e-6])
    record = _read(tmp_path, _table("t,v0", time, RUN.velocity[:5, 0], number="%.3g"))
    np.testing.assert_array_equal(record.time, time)
    assert not any("restored" in sentence for sentence in record.recognised)
    assert np.max(record.rounding["time"]) >= 1e-10


def test_rounded_times_are_restored_to_the_interval_of_the_scene_or_of_the_time_step(tmp_path: Path) -> None:
    scene = replace(CROSSED, samples=60)
    time = np.arange(61) * scene.duration / 60
    text = _table("t,v0", time, np.cos(time), number="%.7f")
    (tmp_path / "run.csv").write_text(text)
    np.testing.assert_allclose(read_record(tmp_path / "run.csv", scene).time, time, rtol=1e-15)
    other = np.arange(61) * 37.0 * 9e-8
    (tmp_path / "run.csv").write_text(_table("t,v0", other, np.cos(time), number="%.8f"))
    record = read_record(tmp_path / "run.csv", scene, dt=9e-8)
    np.testing.assert_allclose(record.time, other, rtol=1e-15)
    assert record.dt == 9e-8


def _npz(tmp_path: Path, **arrays: Any) -> Path:
    np.savez(tmp_path / "run.npz", **arrays)
    return tmp_path / "run.npz"


def _ase_frames(positions: np.ndarray = PLACES) -> list[ase.Atoms]:
    frames = []
    for k in range(N_T):
        atoms = ase.Atoms("X" * N, positions=np.outer(positions + RUN.displacement[k], [0, 1, 0]), masses=CROSSED.mass)
        atoms.set_velocities(np.outer(RUN.velocity[k], [0, 1, 0]))
        atoms.info["Time"] = float(RUN.time[k])
        frames.append(atoms)
    return frames


def _liggghts(k: int, number: str = "%.12g") -> str:
    """Return a frame as LIGGGHTS dumps it: no units, no times, a blank at the ends of lines, ids in any order."""
    lines = ["ITEM: TIMESTEP", str(50 * k), "ITEM: NUMBER OF ATOMS", str(N), "ITEM: BOX BOUNDS ff ff ff", *["-1 1"] * 3]
    lines.append("ITEM: ATOMS id type x y z ix iy iz vx vy vz fx fy fz omegax omegay omegaz radius ")
    for i in np.random.default_rng(k).permutation(N):
        numbers = (PLACES[i] + RUN.displacement[k, i], RUN.velocity[k, i])
        x, v = (number % value for value in numbers)
        lines.append(f"{i + 1} 1 0 0 {x} 0 0 0 0 0 {v} 0 0 0 0 0 0 0.009 ")
    return "\n".join(lines) + "\n"


def _vtk(k: int, *, ids: bool = True, binary: bool = False) -> bytes:
    order = np.random.default_rng(k).permutation(N) if ids else np.arange(N)
    points = np.outer(PLACES + RUN.displacement[k], [1, 0, 0])[order]
    velocity = np.outer(RUN.velocity[k], [1, 0, 0])[order]

    def block(values: np.ndarray, kind: str) -> bytes:
        if binary:
            return values.astype(kind).tobytes() + b"\n"
        return b"\n".join(b" ".join(b"%.17g" % v for v in row) for row in np.atleast_2d(values.T).T) + b"\n"

    parts = [b"# vtk DataFile Version 3.0\nchain\n", b"BINARY\n" if binary else b"ASCII\n", b"DATASET POLYDATA\n"]
    parts += [b"POINTS %d double\n" % N, block(points, ">f8"), b"VERTICES %d %d\n" % (N, 2 * N)]
    parts += [block(np.column_stack([np.ones(N), np.arange(N)]), ">i4"), b"POINT_DATA %d\n" % N]
    parts += [b"VECTORS v double\n", block(velocity, ">f8")]
    if ids:
        parts += [b"FIELD FieldData 1\nid 1 %d int\n" % N, block(order + 1, ">i4")]
    return b"".join(parts)


def _netcdf(path: Path) -> Path:
    data = xr.Dataset(
        {"v": (("body", "time"), RUN.velocity.T[[1, 3]], {"units": "m s-1"})},
        coords={"time": ("time", RUN.time * 1e6, {"units": "us"}), "body": [1, 3]},
    )
    data.to_netcdf(path, engine="h5netcdf")
    return path


def _amber(path: Path) -> Path:
    """Write what LAMMPS' ``dump netcdf`` writes: AMBER's convention, ids in any order."""
    zero = np.zeros_like(RUN.velocity)
    order = np.stack([np.random.default_rng(k).permutation(N) for k in range(N_T)])
    with netcdf_file(path, "w", version=2) as file:
        for name, size in (("frame", N_T), ("atom", N), ("spatial", 3)):
            file.createDimension(name, size)
        parts = {
            "coordinates": (np.stack([zero, PLACES + RUN.displacement, zero], axis=2), 1e-10, "angstrom"),
            "velocities": (np.stack([zero, RUN.velocity, zero], axis=2), 1e2, "angstrom/picosecond"),
        }
        for name, (values, unit, word) in parts.items():
            variable = file.createVariable(name, "f8", ("frame", "atom", "spatial"))
            variable[:] = np.take_along_axis(values, order[:, :, None], axis=1) / unit
            variable.units = word
        file.createVariable("id", "i4", ("frame", "atom"))[:] = order + 1
        time = file.createVariable("time", "f8", ("frame",))
        time[:] = RUN.time / 1e-12
        time.units = "picosecond"
    return path


def _written(kind: str, folder: Path) -> tuple[Path, dict[str, Any]]:
    """Write RUN in a format by a writer that is not the package's; return the file and how to read it."""
    path, dt = folder / "run", {"dt": INTERVAL / 50}
    if kind in ("npz", "npz of rows"):
        arrays = {"time": RUN.time, "velocity": RUN.velocity, "x": PLACES + RUN.displacement}
        rows = {"t_ms": 1e3 * RUN.time, "v": RUN.velocity.T}
        return _npz(folder, **(arrays if kind == "npz" else rows)), {}
    if kind in ("xarray", "amber"):
        return (_netcdf if kind == "xarray" else _amber)(path), {}
    if kind == "traj":
        ase.io.write(path, _ase_frames(), format="traj")
        return path, {}
    if kind == "extxyz":
        ase.io.write(path, _ase_frames(), format="extxyz")
        return path, {}
    if kind in ("liggghts", "liggghts.gz"):
        content = "".join(map(_liggghts, range(N_T))).encode()
        path.write_bytes(gzip.compress(content) if kind.endswith("gz") else content)
        return path, dt
    path.mkdir()
    for k in range(N_T):
        if kind == "liggghts files":
            (path / f"dump{50 * k}.liggghts").write_text(_liggghts(k))
        else:
            (path / f"chain_{50 * k}.vtk").write_bytes(_vtk(k, ids="ids" in kind, binary="binary" in kind))
            (path / f"chain_{50 * k}_boundingBox.vtk").write_text("# vtk DataFile Version 3.0\n")
    return (path / "dump*.liggghts" if kind == "liggghts files" else path), dt


FORMATS = ("npz", "npz of rows", "xarray", "amber", "traj", "extxyz", "liggghts", "liggghts.gz", "liggghts files",
           "vtk", "vtk with ids", "vtk binary with ids")  # fmt: skip


@pytest.mark.parametrize("kind", FORMATS)
def test_every_format_is_read_whatever_the_name_of_its_file(kind: str, tmp_path: Path) -> None:
    path, how = _written(kind, tmp_path)
    record = read_record(path, CROSSED, **how)
    _agrees(record)
    assert record.dt == how.get("dt")
    assert "velocity" in record.values
    assert ("displacement" in record.values) == (kind not in ("npz of rows", "xarray"))
