"""Files that are cut, of another type, or of a kind that is not supported are refused with what they have."""

from __future__ import annotations

import io
import zipfile
from base64 import b64encode
from pathlib import Path

import numpy as np
import pytest

from dem_bridge.errors import UsageError
from dem_bridge.formats.readers import read_record
from dem_bridge.formats.readers.arrays import read_npy
from tests.helpers.export_chains import CROSSED
from tests.helpers.export_runs import made_up

RUN = made_up(CROSSED)
LEGACY = b"# vtk DataFile Version 3.0\nchain\n"
XML = b"<VTKFile%b><Piece><Points>%b</Points></Piece></VTKFile>"
ATOMS = "Properties=species:S:1:pos:R:3:momenta:R:3:mass:R:1{}\nX 0 0 0 1 0 0 {}\n"


def _array(content: bytes, kind: bytes = b"Float64") -> bytes:
    return b'<DataArray type="%b" format="binary">%b</DataArray>' % (kind, content)


def _words(*numbers: int) -> bytes:
    return b64encode(np.array(numbers, "<u4").tobytes())


def _zip(**shapes: tuple[int, ...]) -> bytes:
    """Return an npz file whose arrays are headers alone."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        for name, shape in shapes.items():
            header = io.BytesIO()
            np.lib.format.write_array_header_1_0(header, {"descr": "<f8", "fortran_order": False, "shape": shape})
            archive.writestr(f"{name}.npy", header.getvalue())
    return file.getvalue()


def _npy(array: np.ndarray) -> bytes:
    file = io.BytesIO()
    np.save(file, array)
    return file.getvalue()


ZLIB = b' compressor="vtkZLibDataCompressor"'
REFUSED: dict[str, tuple[bytes | str, str]] = {
    "vtk of no encoding": (LEGACY + b"ASCI\nDATASET POLYDATA\n", "has no line ASCII or BINARY"),
    "vtk cut in a field": (LEGACY + b"ASCII\nPOINT_DATA 1\nFIELD f 1\n", "the VTK file is cut off"),
    "vtk cut in numbers": (LEGACY + b"ASCII\nPOINTS 2 double\n0 0 0\n", "the VTK file is cut off"),
    "vtk cut in bytes": (LEGACY + b"BINARY\nPOINTS 2 double\n1234", "the VTK file is cut off"),
    "vtk of texts": (LEGACY + b"ASCII\nPOINTS 1 string\n0 0 0\n", "has 3 values of the type 'string'; allowed: up to"),
    "xml with a document type": (b"<!DOCTYPE x><VTKFile/>", "has a document type; allowed: a file without one"),
    "xml without a piece": (b"<VTKFile/>", "has no piece with points; allowed: an unstructured grid"),
    "xml of another compressor": (XML % (b' compressor="vtkLZ4DataCompressor"', b""), "compressed by vtkLZ4DataCompr"),
    "xml of texts": (XML % (b"", _array(b"", b"String")), "values of the type 'String'; allowed: Int8"),
    "xml of many blocks": (XML % (ZLIB, _array(_words(10**6, 8, 0))), r"damaged \(1000000 blocks\)"),
    "xml of large blocks": (XML % (ZLIB, _array(_words(99, 4 * 10**9, 0))), "99 blocks of 4000000000 bytes"),
    "xml that is cut": (XML % (b"", _array(_words(80, 1))), r"damaged \(the data are cut off\)"),
    "npz without arrays": (_zip(), "has no arrays; allowed: arrays such as time and velocity"),
    "npz of large arrays": (_zip(v=(10**7, 4), x=(10**7, 4)), "the arrays have more than 512 MiB; write fewer"),
    "npy of three dimensions": (_npy(np.zeros((2, 2, 2))), r"an array of shape \(2, 2, 2\); allowed: a row for each"),
    "npy of objects": (_npy(np.array([None])), "has the type object; allowed: numbers; write float64"),
    "npy that is cut": (_npy(np.zeros((5, 5)))[:-8], "the npy file is damaged"),
    "xyz without masses": ("1\n" + ATOMS.format("", 0), "masses that are not above 0; allowed: positive masses"),
    "xyz of few columns": ("1\n" + ATOMS.format(":f:R:3", 1), "8 columns, the property list has more"),
    "xyz with one time": ("1\nTime=0 " + ATOMS.format("", 1) + "1\n" + ATOMS.format("", 1), "1 of 2 frames have a ti"),
    "bodies by halves": ("t,body,v\n0,0,1\n0,0.5,1\n", "'body' has numbers that are not whole"),
    "never all bodies": ("t,body,v\n0,0,1\n1,1,1\n", "no time has all bodies of the file"),
    "few numbers": ("t,v0,v\n0,1,1\n1,1,1\n", "only some columns of velocity have the number of a body"),
}  # fmt: skip


@pytest.mark.parametrize("kind", REFUSED)
def test_what_is_cut_or_not_supported_is_named(kind: str, tmp_path: Path) -> None:
    content, why = REFUSED[kind]
    (tmp_path / "run").write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(UsageError, match=why) as refused:
        read_record(tmp_path / "run", CROSSED)
    assert "\n" not in str(refused.value)


def test_a_series_without_files_is_refused(tmp_path: Path) -> None:
    (tmp_path / "run.pvd").write_text('<VTKFile type="Collection"><Collection/></VTKFile>')
    with pytest.raises(UsageError, match="the PVD file has no data sets; allowed: a time and a file for each"):
        read_record(tmp_path / "run.pvd", CROSSED)


def test_structured_arrays_utf_16_and_arrays_with_a_dimension_of_one_are_read(tmp_path: Path) -> None:
    names = ["t", *(f"v{k}" for k in range(CROSSED.n_body))]
    rows = np.column_stack([RUN.time, RUN.velocity])
    np.save(tmp_path / "run.npy", np.array([tuple(row) for row in rows], dtype=[(name, "f8") for name in names]))
    lines = [",".join(names), *(",".join(map(repr, row)) for row in rows.tolist())]
    (tmp_path / "run.csv").write_text("\n".join(lines), encoding="utf-16")
    step = (RUN.time[1] - RUN.time[0]) / 4
    np.savez(tmp_path / "run.npz", time=RUN.time, velocity=RUN.velocity[:, :, None], dt=step, code=np.array("ours"))
    for name in ("run.npy", "run.csv", "run.npz"):
        np.testing.assert_array_equal(read_record(tmp_path / name, CROSSED).values["velocity"], RUN.velocity)
    assert read_record(tmp_path / "run.npz", CROSSED).dt == step


@pytest.mark.parametrize(
    ("time", "velocity", "name"),
    [((0,), (0, 2), "time"), ((0,), (0,), "time"), ((3,), (3, 0), "velocity"), ((3,), (0, 0), "velocity")],
)
def test_an_array_without_values_is_refused_by_its_name(
    time: tuple[int, ...], velocity: tuple[int, ...], name: str, tmp_path: Path
) -> None:
    np.savez(tmp_path / "run.npz", time=np.arange(np.prod(time)) * 1.0, velocity=np.zeros(velocity))
    with pytest.raises(UsageError, match=rf"'{name}' has no values; allowed: a value for each of two or more times"):
        read_record(tmp_path / "run.npz", CROSSED)


@pytest.mark.parametrize(
    "header",
    [
        pytest.param(b"{'descr': '<f8', 1: 2, 'shape': (2, 2), 'fortran_order': False}", id="keys-of-several-types"),
        pytest.param(b"{'descr': '|a8', 'shape': (2, 2), 'fortran_order': False}", id="abandoned-name-of-a-type"),
        pytest.param(b"{'descr': '<f8', 'shape': (0, 2%b), 'fortran_order': False}" % (b"0" * 30), id="beyond-64-bits"),
        pytest.param(b"{'descr': '<f8', 'shape': (2, -9223372036854775809), 'fortran_order': False}", id="below-0"),
    ],
)
def test_a_header_of_an_npy_file_that_numpy_does_not_write_is_refused(header: bytes, tmp_path: Path) -> None:
    header = header.ljust(117) + b"\n"
    path = tmp_path / "run.npy"
    path.write_bytes(b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header + b"\0" * 32)
    with pytest.raises(
        UsageError, match=r"the npy file is damaged .*write it again|more than 512 MiB; write fewer samples"
    ):
        read_npy(path.read_bytes())
