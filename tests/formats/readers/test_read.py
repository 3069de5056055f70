"""Files of any code: what an independent writer writes is read to rounding, whatever the format and its habits."""

from __future__ import annotations

import gzip
import io
import zipfile
import zlib
from base64 import b64encode
from collections.abc import Callable
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

import dem_bridge as db
from dem_bridge.errors import UsageError
from dem_bridge.formats.readers import Record, read_record
from dem_bridge.trajectory.trajectory import Trajectory
from tests.helpers.export_chains import CROSSED, PAIR
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
    # ... also after a first time that is no multiple
    (tmp_path / "run.csv").write_text(_table("t,v0", 1e-7 + time, np.cos(time), number="%.6g"))
    record = read_record(tmp_path / "run.csv", scene)
    np.testing.assert_allclose(record.time, 1e-7 + time, rtol=1e-6, atol=1e-13)
    assert np.max(record.rounding["time"]) < 1e-12 < 0.5e-6 * time[-1]
    assert any("multiples of 3.33333333e-06 s after 1e-07 s" in sentence for sentence in record.recognised)


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


_KINDS = {"f4": "Float32", "f8": "Float64", "i4": "Int32"}


class _Vtu:
    """Write an unstructured grid of XML with every encoding that VTK has."""

    def __init__(self, encoding: str, *, packed: bool = False, word: str = "<u4") -> None:
        self.encoding, self.packed, self.word, self.appended = encoding, packed, word, b""

    def _block(self, content: bytes) -> tuple[bytes, bytes]:
        """Return the header and the data of an array, in two blocks if they are compressed."""
        if not self.packed:
            return np.array([len(content)], self.word).tobytes(), content
        size = max(8, len(content) // 2)
        parts = [content[at : at + size] for at in range(0, len(content), size)]
        last = len(parts[-1]) % size
        blocks = list(map(zlib.compress, parts))
        return np.array([len(parts), size, last, *map(len, blocks)], self.word).tobytes(), b"".join(blocks)

    def array(self, name: str, values: np.ndarray) -> str:
        """Return the element of an array."""
        values = np.ascontiguousarray(values)
        width = f' NumberOfComponents="{values.shape[1]}"' if values.ndim > 1 else ""
        head = f'<DataArray type="{_KINDS[values.dtype.str[1:]]}" Name="{name}"{width}'
        if self.encoding == "ascii":
            return f'{head} format="ascii">{" ".join(map(repr, values.ravel().tolist()))}</DataArray>'
        header, data = self._block(values.tobytes())
        text = b64encode(header) + b64encode(data) if self.packed else b64encode(header + data)
        if self.encoding == "binary":
            return f'{head} format="binary">\n{text.decode()}\n</DataArray>'
        element = f'{head} format="appended" offset="{len(self.appended)}"/>'
        self.appended += text if self.encoding == "base64" else header + data
        return element

    def file(self, k: int, *, kind: str = "f8", time: bool = True) -> bytes:
        """Return the file of a sample, with names of YADE."""
        points = np.outer(PLACES + RUN.displacement[k], [0.0, 1.0, 0.0]).astype(kind)
        velocity = np.outer(RUN.velocity[k], [0.0, 1.0, 0.0]).astype(kind)
        field = f"<FieldData>{self.array('TimeValue', RUN.time[k : k + 1])}</FieldData>" if time else ""
        data = (
            self.array("linVelVec", velocity)
            + self.array("radii", np.full(N, 9e-3))
            + self.array("id", np.arange(N, dtype="i4"))
        )
        text = f'<VTKFile type="UnstructuredGrid" byte_order="LittleEndian" header_type="UInt{8 * int(self.word[2:])}"'
        text += ' compressor="vtkZLibDataCompressor"' * self.packed
        text += f'><UnstructuredGrid>{field}<Piece NumberOfPoints="{N}" NumberOfCells="0">'
        text += (
            f"<PointData>{data}</PointData><Points>{self.array('Points', points)}</Points></Piece></UnstructuredGrid>"
        )
        coded = "base64" if self.encoding == "base64" else "raw"
        tail = b'<AppendedData encoding="%s">\n_%s\n</AppendedData>' % (coded.encode(), self.appended)
        self.appended, content = b"", self.appended
        return b'<?xml version="1.0"?>\n' + text.encode() + (tail if content else b"") + b"</VTKFile>\n"


def test_legacy_files_of_newer_vtk_have_metadata_and_cells_in_two_arrays(tmp_path: Path) -> None:
    """As the library of VTK writes version 5.1, with the time as a field and three points in a line."""
    note = "METADATA\nINFORMATION 1\nNAME L2_NORM_RANGE LOCATION vtkDataArray\nDATA 2 0 1\n\n"
    for k in range(N_T):
        points, velocity = (
            " ".join(f"{value:.17g} 0 0" for value in row) for row in (PLACES + RUN.displacement[k], RUN.velocity[k])
        )
        text = "# vtk DataFile Version 5.1\nvtk output\nASCII\nDATASET POLYDATA\n"
        text += (
            f"FIELD FieldData 1\nTimeValue 1 1 double\n{RUN.time[k]:.17g}\n{note}POINTS {N} double\n{points}\n{note}"
        )
        text += f"VERTICES {N + 1} {N}\nOFFSETS vtktypeint64\n0 1 2 3 4\nCONNECTIVITY vtktypeint64\n0 1 2 3\n"
        text += f"POINT_DATA {N}\nFIELD FieldData 2\nid 1 {N} int\n1 2 3 4\n{note}v 3 {N} double\n{velocity}\n{note}"
        (tmp_path / f"chain{k}.vtk").write_text(text)
    record = read_record(tmp_path, CROSSED)
    _agrees(record)
    assert set(record.values) == {"velocity", "displacement"}


@pytest.mark.parametrize("encoding", ["ascii", "binary", "raw", "base64"])
@pytest.mark.parametrize(("packed", "word"), [(False, "<u4"), (False, "<u8"), (True, "<u4"), (True, "<u8")])
def test_xml_of_vtk_is_read_in_every_encoding(encoding: str, packed: bool, word: str, tmp_path: Path) -> None:
    writer = _Vtu(encoding, packed=packed, word=word)
    for k in range(N_T):
        (tmp_path / f"chain.{k}.vtu").write_bytes(writer.file(k))
    _agrees(read_record(tmp_path, CROSSED))


def test_a_folder_is_also_a_complete_trajectory(tmp_path: Path) -> None:
    path, how = _written("liggghts files", tmp_path)
    for each in (path, path.parent):
        run = db.read_trajectory(each, CROSSED, **how)
        np.testing.assert_allclose(run.velocity, RUN.velocity, atol=1e-11)
        assert len(run.provenance["file"]["sha256"]) == 64
    with pytest.raises(UsageError, match="there is no such file; allowed: a file, a folder or a pattern of files"):
        read_record(tmp_path / "none*.vtk", CROSSED)


def test_a_series_of_vtk_has_the_times_of_its_list(tmp_path: Path) -> None:
    sets = []
    for k in range(N_T):
        (tmp_path / f"chain_{k}.vtu").write_bytes(_Vtu("raw").file(k, kind="f4", time=False))
        sets.append(f'<DataSet timestep="{RUN.time[k]:.9g}" part="0" file="chain_{k}.vtu"/>')
    (tmp_path / "chain.pvd").write_text(
        f'<VTKFile type="Collection"><Collection>{"".join(sets)}</Collection></VTKFile>'
    )
    record = read_record(tmp_path / "chain.pvd", CROSSED)
    _agrees(record)
    # single precision: half an ulp of the value
    assert np.max(record.rounding["velocity"]) == 0.5 * np.spacing(np.float32(np.max(np.abs(RUN.velocity))))
    (tmp_path / "chain_3.vtu").unlink()
    with pytest.raises(UsageError, match=r"the data set chain_3\.vtu of the series is missing; copy all files"):
        read_record(tmp_path / "chain.pvd", CROSSED)


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


#: what stopped new users: each is read now, and what was assumed is said
FIRST = RUN.velocity[:, :1]
_TRIED = {
    "no ending": (_table("t,v0,v1,v2,v3", RUN.time, RUN.velocity), "run", ""),
    "t without unit": (_table("t,v0,v1,v2,v3", RUN.time, RUN.velocity), "run.csv", "time has no unit in the file"),
    "two bodies": (_table("t,v1,v3", RUN.time, RUN.velocity[:, [1, 3]]), "run.csv", "velocity of 2 of 4 bodies"),
    "velocities alone": (_table("time_s,v_0_m_per_s", RUN.time, FIRST), "run.csv", ""),
    "later times": (_table("t,v0,x1", RUN.time[5:], FIRST[5:], FIRST[5:]), "run.csv", "positions are not used"),
    "other columns": (_table("t,v0,ke", RUN.time, FIRST, RUN.time), "run.csv", "not used: 'ke'"),
    "no headings": (_table("", RUN.time, RUN.velocity, delimiter=" "), "run.txt", "its first row shows"),
    "steps": (_table("# step v0", np.arange(N_T), FIRST, delimiter=" "), "run.txt", "step numbers times"),
    "comment with dt": ("# dt = 2e-7\n" + _table("t,v0", RUN.time, FIRST), "run.csv", "time step is 2e-07 s"),
    "decimal commas": (_table("t;v0", RUN.time, FIRST, delimiter=";").replace(".", ","), "a", "decimal commas"),
    "Fortran": (_table("t v0", RUN.time, FIRST, number="%.16e", delimiter=" ").replace("e", "D"), "a", ""),
}


@pytest.mark.parametrize("kind", _TRIED)
def test_what_stopped_new_users_is_read_and_said(kind: str, tmp_path: Path) -> None:
    text, name, said = _TRIED[kind]
    record = _read(tmp_path, text, name, dt=INTERVAL if kind == "steps" else None)
    later = {key: getattr(RUN, key)[5:] for key in ("time", "velocity", "displacement", "contact_force")}
    _agrees(record, replace(RUN, **later) if kind == "later times" else RUN)
    assert any(said in sentence for sentence in record.recognised) or not said, record.recognised
    if kind == "comment with dt":
        assert record.dt == 2e-7


@pytest.mark.parametrize(
    ("comment", "dt"),
    [("dt = 0.2 us", 2e-7), ("time step [ms]: 2e-4", 2e-7), ("dt = 2e-7, 3 runs", 2e-7), ("dt = 2e-7 days", None)],
)
def test_a_time_step_in_a_comment_has_the_unit_that_it_names(comment: str, dt: float | None, tmp_path: Path) -> None:
    record = _read(tmp_path, f"# {comment}\n" + _table("t,v0", RUN.time, FIRST), "run.csv")
    assert record.dt == (None if dt is None else pytest.approx(dt))


#: two samples of two bodies, as other codes and programs write them
_HABITS = {
    "a row of units": "t,v0,v1\nms,mm/s,mm/s\n0,800,0\n1e-3,700,100\n",
    "units in a comment": "# t v0 v1\n# [ms] [mm/s] [mm/s]\n0 800 0\n1e-3 700 100\n",
    "prose before headings": "# Output of code\n# t v0 v1\n0 .8 0\n1e-6 .7 .1\n",
    "prose alone": "# Output of code\n0 .8 0\n1e-6 .7 .1\n",
    "a separator line": "sep=;\nt;v0;v1\n0;0,8;0\n1e-6;0,7;0,1\n",
    "tabs at the ends": "t\tv0\tv1\t\n0\t.8\t0\t\n1e-6\t.7\t.1\t\n",
    "commas at the ends": "t,v0,v1\n0,.8,0,\n1e-6,.7,.1,\n",
    "brackets and blanks": "# time [s]   v_0 [m/s]   v_1 [m/s]\n0 .8 0\n1e-6 .7 .1\n",
    "quotes": '"time [s]","v_0 [m/s]","v_1 [m/s]"\n"0","0.8","0"\n"1e-6","0.7","0.1"\n',
    "fix ave/time": "# Time-averaged data for fix 1\n# TimeStep v_vx1 v_vx2\n0 .8 0\n10 .7 .1\n",
    "plot of YADE": "# i\tt\tv0\tv1\n0\t0\t0.8\t0\n10\t1e-6\t.7\t.1\n",
    "index of pandas": ",t,v0,v1\n0,0,.8,0\n1,1e-6,.7,.1\n",
    "sorted by body": "time,body,v\n0,0,.8\n1e-6,0,.7\n0,1,0\n1e-6,1,.1\n",
    "ids from 1": "time,id,vx,vy,vz\n0,1,.8,0,0\n0,2,0,0,0\n1e-6,1,.7,0,0\n1e-6,2,.1,0,0\n",
    "vectors": "t,vx0,vy0,vz0,vx1,vy1,vz1\n0,0,0,.8,0,0,0\n1e-6,0,0,.7,0,0,.1\n",
    "plain XYZ": "2\nTimestep: 0\n1 0 0 0 .8 0 0\n1 1 0 0 0 0 0\n2\nTimestep: 10\n1 0 0 0 .7 0 0\n1 1 0 0 .1 0 0\n",
}


@pytest.mark.parametrize("habit", _HABITS)
def test_habits_of_text_files(habit: str, tmp_path: Path) -> None:
    (tmp_path / "run").write_text(_HABITS[habit])
    record = read_record(tmp_path / "run", PAIR, dt=1e-7)
    np.testing.assert_allclose(record.values["velocity"], [[0.8, 0.0], [0.7, 0.1]], rtol=1e-15)
    np.testing.assert_allclose(record.time, [0.0, 1e-6], rtol=1e-15)
    assert record.columns["velocity"] == (0, 1)


@pytest.mark.parametrize(
    ("head", "used"),
    [
        ("t,F0,F1,F2", True), ("t,f_1,f_2,f_3", True), ("t,contact_force_0,contact_force_1,contact_force_2", True),
        ("t,contact 0 force (N),contact 1 force (N),contact 2 force (N)", True),
        ("t,contact_0_N,contact_1_N,contact_2_N", True),
        ("t,v0,fx,f1", False),
    ],
)  # fmt: skip
def test_forces_are_those_of_contacts_only_if_they_say_so_or_are_as_many(head: str, used: bool, tmp_path: Path) -> None:
    record = _read(tmp_path, _table(head, RUN.time, RUN.contact_force))
    assert record.columns == ({"contact_force": (0, 1, 2)} if used else {"velocity": (0,)})
    if used:
        _agrees(record)
    else:
        assert any("forces are not used" in sentence for sentence in record.recognised)


def test_a_long_table_of_contacts_is_read(tmp_path: Path) -> None:
    columns = (np.repeat(RUN.time, 3), np.tile(np.arange(3), N_T), RUN.contact_force.ravel())
    record = _read(tmp_path, _table("time_s,contact,force_N", *columns))
    _agrees(record)
    assert record.columns == {"contact_force": (0, 1, 2)}


@pytest.mark.parametrize(
    "before", ["# " + "a[" * 200_000, "# x\n" * 50_000 + "# y", "#" + " (" * 100_000], ids=["a[", "x", "("]
)
def test_long_comments_neither_stop_nor_slow_down_the_reading(before: str, tmp_path: Path) -> None:
    record = _read(tmp_path, f"{before}\nt,v0\n0,0.8\n1e-6,0.7\n")
    assert record.values["velocity"].tolist() == [[0.8], [0.7]]


def test_a_body_that_occurs_twice_is_named(tmp_path: Path) -> None:
    (tmp_path / "run").write_text("t,body,v\n0,0,1\n0,1,1\n1,0,1\n1,1,1\n1,1,2\n")
    with pytest.raises(
        UsageError, match="body 1 occurs twice at 1 s; allowed: once at each time; write times with more"
    ):
        read_record(tmp_path / "run", PAIR)


def test_columns_without_headings_that_are_not_all_bodies_are_to_be_named(tmp_path: Path) -> None:
    text = _table("", RUN.time, RUN.velocity[:, [1, 3]], delimiter=" ")
    with pytest.raises(UsageError, match="has 3 columns without headings; give their meaning in their order"):
        _read(tmp_path, text, "run.txt")


@pytest.mark.parametrize(
    ("how", "found"),
    [
        ({}, r"has no times; name their column \(--columns\), such as 'time \[s\]'; its columns are 'a', 'b', 'c'"),
        ({"columns": {"z": "time"}}, "columns has 'z', which the file does not have; it has 'a', 'b', 'c'"),
        ({"columns": {"a": "tome"}}, "columns names 'a' as 'tome', which is unknown; allowed: time, step, body"),
        ({"columns": ["t", "v0"]}, "2 headings were given in columns, the file has 3 columns; give one for each"),
        ({"columns": ["t", "v", "u"]}, "columns of velocity without the number of a body, .* crossed_3 has 4; number"),
        ({"columns": ["t", "v0", "v7"]}, "velocity of body 7; the scene crossed_3 has 4: allowed are 0 to 3"),
        ({"columns": ["t", "v0", "v1 (knots)"]}, "the unit 'knots' of velocity is unknown; allowed: m/s, mm/s"),
        ({"columns": ["t", "v0", "v1"], "bodies": [0]}, "1 bodies were given, the file has 2 columns of velocity"),
        ({"columns": ["t", "v0", "v0"]}, "velocity of body 0 twice"),
        ({"columns": ["step", "v0", "v1"]}, r"step numbers but no times; give the time step in s \(FILE@DT\)"),
        ({"columns": ["v0", "v1", "t"]}, "sample 1 is at 1 s and sample 0 at 1 s; allowed: increasing times"),
        ({"units": "lj"}, "units = 'lj' is unknown; allowed: si, cgs"),
        ({"units": {"time": "h"}}, "the unit 'h' of time is unknown; allowed: s, sec"),
        ({"units": {"speed": "m/s"}}, "units of 'speed'; allowed: time, velocity"),
        ({"axis": "w"}, "axis = 'w'; allowed: x, y or z"),
        ({"dt": 0.0}, r"dt = 0\.0; allowed: a number above 0 \(s\)"),
    ],
)  # fmt: skip
def test_what_cannot_be_read_is_refused_in_one_line(how: dict[str, Any], found: str, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=found) as error:
        _read(tmp_path, "a,b,c\n0,0.8,1\n1e-6,0.7,1\n", **how)
    assert "\n" not in str(error.value)


def test_what_is_stated_is_obeyed(tmp_path: Path) -> None:
    text = _table("a,b,c", 1e3 * RUN.time, 1e3 * RUN.velocity[:, 2], RUN.velocity[:, 0])
    names = {"a": "time [ms]", "b": "velocity 2 [mm/s]", "c": "v0"}
    for how in (
        {"columns": names},
        {"columns": list(names.values())},
        {"columns": ["t", "v2 (mm/s)", "v0 (m/s)"], "units": {"time": "ms"}},
        {"columns": ["t [ms]", "v [mm/s]", "v [m/s]"], "bodies": [2, 0]},
    ):
        record = _read(tmp_path, text, **how)
        _agrees(record)
        assert sorted(record.columns["velocity"]) == [0, 2]


def _frame(x: np.ndarray, v: np.ndarray, ids: np.ndarray, names: str = "id x vx", step: int = 0) -> str:
    rows = [f"{i} {a!r} {b!r}" for i, a, b in zip(ids.tolist(), x.tolist(), v.tolist(), strict=True)]
    head = ["ITEM: TIMESTEP", str(step), "ITEM: NUMBER OF ATOMS", str(len(x)), "ITEM: BOX BOUNDS ff ff ff"]
    return "\n".join([*head, *["0 1"] * 3, f"ITEM: ATOMS {names}", *rows]) + "\n"


def test_the_order_of_atoms_is_that_of_their_positions_and_a_mirrored_chain_is_turned(tmp_path: Path) -> None:
    x, v = PLACES + RUN.displacement, RUN.velocity
    ids = np.array([7, 3, 9, 1])
    frames = [_frame(x[k], v[k], ids, step=k) for k in range(N_T)]
    record = _read(tmp_path, "".join(frames), "run.dump", dt=INTERVAL)
    _agrees(record)
    assert any("order of their positions" in sentence for sentence in record.recognised)
    mirrored = [_frame(1.0 - x[k], -v[k], np.arange(1, N + 1), step=k) for k in range(N_T)]
    record = _read(tmp_path, "".join(mirrored), "run.dump", dt=INTERVAL)
    assert any("mirrored" in sentence for sentence in record.recognised)
    np.testing.assert_array_equal(record.values["velocity"], v)
    # ids in the reverse order are believed: to name the cause is the judge's part
    reverse = [_frame(x[k], v[k], np.arange(N, 0, -1), step=k) for k in range(N_T)]
    record = _read(tmp_path, "".join(reverse), "run.dump", dt=INTERVAL)
    np.testing.assert_array_equal(record.values["velocity"], v[:, ::-1])


def test_a_dump_of_some_bodies_or_of_velocities_alone_is_read(tmp_path: Path) -> None:
    x, two = PLACES + RUN.displacement, [1, 3]
    some = [_frame(x[k, two], RUN.velocity[k, two], np.array([2, 4]), step=k) for k in range(N_T)]
    record = _read(tmp_path, "".join(some), "run.dump", dt=INTERVAL)
    _agrees(record)
    assert record.columns["velocity"] == (1, 3)
    alone = [_frame(RUN.velocity[k], RUN.velocity[k], np.arange(1, N + 1), "id c_1 vx", k) for k in range(N_T)]
    record = _read(tmp_path, "".join(alone), "run.dump", dt=INTERVAL)
    _agrees(record)
    assert set(record.values) == {"velocity"}


@pytest.mark.parametrize(("stride", "dt"), [(60, INTERVAL / 60), (1, None)])
def test_the_time_step_follows_from_step_numbers_unless_they_count_frames(
    stride: int, dt: float | None, tmp_path: Path
) -> None:
    ids = np.arange(1, N + 1)
    frames = [_frame(PLACES, RUN.velocity[k], ids, step=stride * k) for k in range(N_T)]
    times = [f"ITEM: TIME\n{time!r}\n" for time in RUN.time.tolist()]
    record = _read(tmp_path, "".join(map("".join, zip(times, frames, strict=True))), "run.dump")
    assert record.dt == (None if dt is None else pytest.approx(dt, rel=1e-8))


def test_values_that_contradict_the_scene_are_not_refused(tmp_path: Path) -> None:
    record = _read(tmp_path, _table("t,v0,v1,v2,v3", RUN.time, 1e3 * RUN.velocity[:, ::-1]))
    np.testing.assert_allclose(record.values["velocity"], 1e3 * RUN.velocity[:, ::-1], rtol=1e-15)


@pytest.mark.parametrize("word", ["nan", "inf", "-NaN"])
def test_a_run_that_failed_is_refused_where_it_did(word: str, tmp_path: Path) -> None:
    text = f"t,v0\n0,0.8\n1e-6,{word}\n"
    with pytest.raises(UsageError, match=r"velocity of body 0 at 1e-06 s is -?(nan|inf); allowed: finite"):
        _read(tmp_path, text)


def test_objects_and_arrays_of_another_size_are_never_loaded(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="'v' has the type object; allowed: numbers; write float64"):
        read_record(_npz(tmp_path, time=RUN.time, v=np.array([None, {}], dtype=object)), CROSSED)
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(header, {"descr": "<f8", "fortran_order": False, "shape": (10**9, 40)})
    with zipfile.ZipFile(tmp_path / "huge.npz", "w") as archive:
        archive.writestr("v.npy", header.getvalue())
    with pytest.raises(UsageError, match=r"'v' has the shape \(1000000000, 40\), more than 512 MiB; write fewer"):
        read_record(tmp_path / "huge.npz", CROSSED)


@pytest.mark.parametrize("kind", ["csv", *(kind for kind in FORMATS if kind != "liggghts files")])
def test_damage_is_refused_in_one_line_or_does_no_harm(kind: str, tmp_path: Path) -> None:
    how: dict[str, Any] = {}
    if kind == "csv":
        content = _table("t,v0,v1,v2,v3", RUN.time, RUN.velocity).encode()
    else:
        path, how = _written(kind, tmp_path)
        if path.is_dir():
            path = next(file for file in path.iterdir() if "bounding" not in file.name)
        content = path.read_bytes()
    rng, refused = np.random.default_rng(0), 0
    for _ in range(12):
        at, cut, new = (
            rng.integers(len(content)),
            rng.choice([0, 1, 100, len(content)]),
            rng.bytes(int(rng.integers(9))),
        )
        damaged = tmp_path / "damaged"
        damaged.write_bytes(content[:at] + new + content[at + cut :])
        refusal = _refusal(damaged, how)
        refused += bool(refusal)
        assert "\n" not in refusal
        assert len(refusal) < 700
    assert refused >= 3


_LONG = "1" + 450 * "0"


@pytest.mark.parametrize(
    "text",
    [
        f"t,v0,v1\n0,{_LONG},0\n1,0,0\n",
        f"ITEM: TIMESTEP\n0\nITEM: NUMBER OF ATOMS\n1\nITEM: ATOMS id x vx\n1 0 {_LONG}\n",
        f"1\nProperties=species:S:1:pos:R:3\nX 0 0 {_LONG}\n",
        f"# vtk DataFile Version 3.0\nx\nASCII\nDATASET POLYDATA\nPOINTS 1 float\n0 0 {_LONG}\n",
        "<VTKFile><PolyData><Piece><Points><DataArray type='Float64' format='ascii'>0 0"
        f" {_LONG}</DataArray></Points></Piece></PolyData></VTKFile>",
    ],
    ids=("csv", "dump", "xyz", "vtk", "vtp"),
)
def test_a_long_number_does_not_take_its_memory_for_every_number(text: str, tmp_path: Path) -> None:
    (tmp_path / "long").write_text(text)
    assert "numbers of up to 451 characters; allowed: up to 400" in _refusal(tmp_path / "long", {})


def test_lines_values_and_characters_together_are_limited(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "table").write_text("t,v0,v1\n" + "0,0,0\n" * 21)
    for name, problem in {
        "read.MOST_LINES": "more than 20 lines",
        "tables._MOST_VALUES": "more than 20 values",
        "rounding._MOST_CHARACTERS": "has 21 numbers of up to 1 characters",
    }.items():
        with monkeypatch.context() as patch:
            patch.setattr(f"dem_bridge.formats.readers.{name}", 20)
            assert problem in _refusal(tmp_path / "table", {})


def _refusal(path: Path, how: dict[str, Any]) -> str:
    """Return the message with which a file is refused, or "" if it is read."""
    try:
        read_record(path, CROSSED, **how)
    except UsageError as error:
        return str(error)
    return ""


_DUMP = "ITEM: UNITS\nsi\nITEM: TIME\n{0}\nITEM: TIMESTEP\n0\nITEM: NUMBER OF ATOMS\n1\nITEM: ATOMS id x\n1 0\n"
_NO_POINTS = (
    "# vtk DataFile Version 3.0\nrun\nASCII\nDATASET POLYDATA\nPOINTS 0 double\nPOINT_DATA 0\nVECTORS velocity double\n"
)


def _packed_npz(change: Callable[[bytes], bytes], save: Callable[..., None] = np.savez) -> bytes:
    stream = io.BytesIO()
    save(stream, time=RUN.time, velocity=RUN.velocity)
    return change(stream.getvalue())


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("t,v0,v1,v2,v3\n0,1,0,0,\u0663\n1e-5,1,0,0,0\n", "beyond ASCII"),
        (_DUMP.format("\u0663"), "beyond ASCII"),
        ('1\nProperties=species:S:1:pos:R:3 Time="\u0663"\nH 0 0 0\n', "beyond ASCII"),
        (_NO_POINTS, "no atoms|no points"),
        (_packed_npz(lambda content: content.replace(b"'descr'", b"('escr'", 1)), "npz file is damaged"),
        (
            _packed_npz(lambda content: content[:60] + b"\xff" * 40 + content[100:], np.savez_compressed),
            "npz file is damaged",
        ),
    ],
)
def test_damage_is_refused_by_the_reader_itself_and_not_by_the_guard_around_it(
    content: str | bytes, words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("dem_bridge.formats.readers.read.OF_DAMAGED_DATA", ())
    with pytest.raises(UsageError, match=words):
        _read(tmp_path, content)


def test_times_that_all_are_negative_are_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("dem_bridge.formats.readers.read.OF_DAMAGED_DATA", ())
    rows = "".join(f"{-9e-5 + k * 1e-5:.0e},1,0,0,0\n" for k in range(5))
    time = _read(tmp_path, f"t,v0,v1,v2,v3\n{rows}").time
    assert time == pytest.approx([-9e-5, -8e-5, -7e-5, -6e-5, -5e-5], rel=1e-15)  # restored to a few rounding errors


def test_a_time_step_of_xyz_that_is_no_number_is_ignored(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("dem_bridge.formats.readers.read.OF_DAMAGED_DATA", ())
    frame = "4\nProperties=species:S:1:pos:R:3:velo:R:3 Time={0} dt=1-2\n" + "".join(
        f"H {k} 0 0 {v} 0 0\n" for k, v in enumerate(CROSSED.velocity)
    )
    assert _read(tmp_path, frame.format(0) + frame.format(1e-5)).dt is None


@pytest.mark.parametrize(
    ("text", "place"),
    [
        ("t,v0,v1\n0,1,0\n1,,0\n2,1,0\n", r"line 3, column 2 \('v0'\): the cell is empty; allowed: finite numbers"),
        ("# a comment\n\nt,v0,v1\n0,1,0\n\n1,1,\n2,1,\n", r"line 6, column 3 \('v1'\): the cell is empty, as 1 more"),
        ("t;v0;v1\n0;1;0\n;1;0\n", r"line 3, column 1 \('t'\)"),
        ("t,id,v\n0,1,1\n0,2,0\n1,1,1\n1,,0\n", r"line 5, column 2 \('id'\)"),
        ("t,ke,v0,v1\n0,,1,0\n1,5,1,nan\n", "the velocity of body 1 at 1 s is nan; allowed: finite numbers"),
    ],
)
def test_an_empty_cell_is_refused_with_its_line_and_column(text: str, place: str, tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.write_text(text)
    pair = db.Scene(name="pair", duration=1e-4, mass=(8e-3, 1e-2), stiffness=(4e9,), velocity=(0.8, 0.0))
    with pytest.raises(UsageError, match=place):
        read_record(path, pair)


@pytest.mark.parametrize(
    ("text", "columns", "sentence"),
    [
        ("t,v0,v2,v3\n0,1,0,0\n1,1,0,0\n", (0, 2, 3), "velocity of 3 of 4 bodies, counted from 0; body 1 is missing"),
        ("t,v1,v2,v4\n0,1,0,0\n1,1,0,0\n", (0, 1, 3), "velocity of 3 of 4 bodies, counted from 1; body 3 is missing"),
        ("t,id,v\n0,1,1\n0,2,0\n0,3,0\n1,1,1\n1,2,0\n1,3,0\n", (0, 1, 2), "counted from 1; body 4 is missing"),
        ("t,body,v\n0,1,1\n0,2,0\n0,3,0\n1,1,1\n1,2,0\n1,3,0\n", (1, 2, 3), "counted from 0; body 0 is missing"),
        ("t,v0,v1,v2,v3\n0,1,,0,0\n1,1,,0,0\n", (0, 2, 3), "velocity of body 1 has no values"),
        ("t,id,v\n0,1,1\n0,2,0\n0,3,0\n0,4,0\n1,1,1\n1,2,0\n1,4,0\n2,1,1\n2,2,0\n2,3,0\n2,4,0\n", (0, 1, 2, 3),
         "1 of 3 times lack a body and are not used: 1 s lacks body 3"),
    ],
)  # fmt: skip
def test_a_body_that_is_missing_is_named(text: str, columns: tuple[int, ...], sentence: str, tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.write_text(text)
    record = read_record(path, CROSSED)
    assert record.columns["velocity"] == columns
    assert any(sentence in note for note in record.recognised), record.recognised
