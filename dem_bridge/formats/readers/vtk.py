"""Read the points and point data of VTK files: legacy, XML (VTU, VTP) and series (PVD)."""

from __future__ import annotations

import base64
import binascii
import re
import struct
import zlib
from collections.abc import Iterator, Mapping
from typing import Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from dem_bridge.errors import UsageError
from dem_bridge.formats.readers.dumps import EXTRA_COLUMNS, GROUPS, grouped
from dem_bridge.formats.readers.headings import heading_of
from dem_bridge.formats.readers.rounding import texts_of

#: numpy types of the type names of legacy and XML files
_TYPES = {
    "char": "i1", "unsigned_char": "u1", "short": "i2", "unsigned_short": "u2", "int": "i4", "unsigned_int": "u4",
    "long": "i8", "unsigned_long": "u8", "vtktypeint64": "i8", "vtkidtype": "i8", "float": "f4", "double": "f8",
    "Int8": "i1", "UInt8": "u1", "Int16": "i2", "UInt16": "u2", "Int32": "i4", "UInt32": "u4", "Int64": "i8",
    "UInt64": "u8", "Float32": "f4", "Float64": "f8",
}  # fmt: skip
#: names of point data of other codes
_OTHERS = {"linvelvec": "velocity", "forcevec": "force", "radii": "radius"}
#: largest number of values of one array
_MOST_VALUES = 10**8

Arrays = dict[str, NDArray[Any]]


def read_legacy(content: bytes) -> tuple[Arrays, str | None]:
    """Return the arrays of a legacy file, with the points as ``points``, and the time as text."""
    lines = content.split(b"\n", 3)
    if len(lines) < 4 or lines[2].strip().upper() not in (b"ASCII", b"BINARY"):
        raise UsageError("the VTK file has no line ASCII or BINARY; write it again")
    reader = _Legacy(lines[3], binary=lines[2].strip().upper() == b"BINARY")
    arrays = dict(reader.arrays())
    time = next((arrays[name] for name in ("TIME", "TimeValue", "time") if name in arrays), None)
    return arrays, None if time is None or time.size != 1 else _text(time.ravel()[0])


def _text(value: Any) -> str:
    return value.decode() if isinstance(value, bytes) else repr(float(value))


class _Legacy:
    """The sections of a legacy file after its third line."""

    def __init__(self, content: bytes, *, binary: bool) -> None:
        self.content, self.binary, self.at = content, binary, 0

    def line(self) -> list[str] | None:
        """Return the words of the next line that is not blank, or None at the end."""
        while self.at < len(self.content):
            end = self.content.find(b"\n", self.at)
            end = len(self.content) if end < 0 else end
            words = self.content[self.at : end].decode("latin-1").split()
            self.at = end + 1
            if words:
                return words
        return None

    def values(self, count: int, kind: str) -> NDArray[Any]:
        """Return the next numbers: texts of an ASCII file, else numbers."""
        if kind.lower() not in _TYPES or not 0 <= count <= _MOST_VALUES:
            raise UsageError(
                f"the VTK file has {count} values of the type {kind!r}; allowed: up to {_MOST_VALUES} numbers"
            )
        if self.binary:
            dtype = np.dtype(">" + _TYPES[kind.lower()])
            end = self.at + count * dtype.itemsize
            if end > len(self.content):
                raise UsageError("the VTK file is cut off; write it again")
            array = np.frombuffer(self.content[self.at : end], dtype=dtype)
            self.at = end
            return array.astype(dtype.newbyteorder("="))
        # a word and the blank behind it have two characters or more
        words_read: list[bytes] = []
        while len(words_read) < count:
            words = self.line()
            if words is None:
                raise UsageError("the VTK file is cut off; write it again")
            words_read += [word.encode("latin-1") for word in words]
        return texts_of(words_read[:count])

    def arrays(self) -> Iterator[tuple[str, NDArray[Any]]]:
        """Yield the points, the point data and the field data of the file; cells are skipped."""
        tuples, of_points = 0, True
        while (words := self.line()) is not None:
            word = words[0].upper()
            if word == "POINTS":
                yield "points", self.values(3 * int(words[1]), words[2]).reshape(-1, 3)
            elif word in ("POINT_DATA", "CELL_DATA"):
                tuples, of_points = int(words[1]), word == "POINT_DATA"
            elif word in ("VECTORS", "NORMALS", "SCALARS"):
                width = 3 if word != "SCALARS" else int(words[3]) if len(words) > 3 else 1
                if word == "SCALARS":
                    self.line()
                values = self.values(width * tuples, words[2]).reshape(tuples, width)
                if of_points:
                    yield words[1], values[:, 0] if width == 1 else values
            elif word == "FIELD":
                for _ in range(int(words[2])):
                    field = self.line()
                    while field is not None and (len(field) != 4 or field[3].lower() not in _TYPES):
                        field = self.line()  # the metadata of the array before
                    if field is None:
                        raise UsageError("the VTK file is cut off; write it again")
                    values = self.values(int(field[1]) * int(field[2]), field[3]).reshape(int(field[2]), int(field[1]))
                    if of_points:
                        yield field[0], values[:, 0] if values.shape[1] == 1 else values
            elif word in ("VERTICES", "CELLS", "LINES", "POLYGONS", "CELL_TYPES"):
                self.values(int(words[2]) if len(words) > 2 else int(words[1]), "int")


def read_xml(content: bytes) -> tuple[Arrays, str | None]:
    """Return the arrays of a VTU or VTP file, with the points as ``points``, and the time as text."""
    if b"<!DOCTYPE" in content[:4096] or b"<!ENTITY" in content:
        raise UsageError("the VTK file has a document type; allowed: a file without one")
    head, appended = content, b""
    if (begin := content.find(b"<AppendedData")) >= 0:
        mark = content.find(b"_", content.find(b">", begin))
        head, appended = content[:begin] + b"</VTKFile>", content[mark + 1 :]
    root = _xml(head)
    encoded = b'encoding="base64"' in content[begin : begin + 200] if begin >= 0 else False
    data = _Xml(root, appended, encoded)
    piece = root.find(".//Piece")
    if piece is None:
        raise UsageError("the VTK file has no piece with points; allowed: an unstructured grid or poly data")
    points = piece.find("Points/DataArray")
    arrays = {} if points is None else {"points": data.array(points).reshape(-1, 3)}
    for part in piece.findall("PointData/DataArray"):
        width = int(part.get("NumberOfComponents", "1"))
        values = data.array(part)
        arrays[part.get("Name", "")] = values if width == 1 else values.reshape(-1, width)
    time = next(
        (part for part in root.findall(".//FieldData/DataArray") if part.get("Name") in ("TimeValue", "TIME")), None
    )
    return arrays, None if time is None else _text(data.array(time).ravel()[0])


def _xml(text: bytes) -> ElementTree.Element:
    try:
        return ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise UsageError(f"the VTK file is damaged ({error}); write it again") from error


class _Xml:
    """The data arrays of an XML file: ASCII, base64 or appended, with or without compression by zlib."""

    def __init__(self, root: ElementTree.Element, appended: bytes, encoded: bool) -> None:
        self.order = "<" if root.get("byte_order", "LittleEndian") == "LittleEndian" else ">"
        self.word = np.dtype(self.order + _TYPES[root.get("header_type", "UInt32")])
        self.packed = root.get("compressor")
        if self.packed not in (None, "vtkZLibDataCompressor"):
            raise UsageError(f"the VTK file is compressed by {self.packed}; allowed: zlib or none")
        self.appended, self.encoded = appended, encoded

    def array(self, part: ElementTree.Element) -> NDArray[Any]:
        """Return the numbers of a data array; texts if it is ASCII."""
        kind = part.get("type", "")
        if kind not in _TYPES:
            raise UsageError(f"the VTK file has values of the type {kind!r}; allowed: {', '.join(list(_TYPES)[12:])}")
        if part.get("format") == "ascii":
            return texts_of((part.text or "").encode("latin-1").split())
        try:
            if part.get("format") == "appended":
                source = self.appended[int(part.get("offset", "0")) :]
                content = self._decoded(source) if self.encoded else self._plain(source)
            else:
                content = self._decoded("".join((part.text or "").split()).encode("latin-1"))
            return np.frombuffer(content, dtype=self.order + _TYPES[kind]).astype(_TYPES[kind])
        except (ValueError, struct.error, binascii.Error, zlib.error, IndexError) as error:
            raise UsageError(f"the VTK file is damaged ({error}); write it again") from error

    def _header(self, content: bytes) -> tuple[int, list[int]]:
        """Return the number of bytes of the header, and the sizes of the blocks that follow it."""
        size = self.word.itemsize
        if self.packed is None:
            return size, [int(np.frombuffer(content[:size], self.word)[0])]
        blocks = int(np.frombuffer(content[:size], self.word)[0])
        if blocks > _MOST_VALUES // 1000:
            raise ValueError(f"{blocks} blocks")
        words = np.frombuffer(content[: (3 + blocks) * size], self.word)
        if int(words[1]) * blocks > 8 * _MOST_VALUES:
            raise ValueError(f"{blocks} blocks of {words[1]} bytes")
        return (3 + blocks) * size, [int(word) for word in words[3:]]

    def _plain(self, content: bytes) -> bytes:
        """Return the bytes of an array that begins with a header."""
        at, sizes = self._header(content)
        if len(content) < at + sum(sizes):
            raise ValueError("the data are cut off")
        return self._unpacked(content[at:], sizes)

    def _decoded(self, content: bytes) -> bytes:
        """Return the bytes of an array that is encoded as base64, its header apart if it is compressed."""
        size = self.word.itemsize
        if self.packed is None:
            sizes = self._header(base64.b64decode(content[: 4 * -(-size // 3)]))[1]
            return self._plain(base64.b64decode(content[: 4 * -(-(size + sizes[0]) // 3)]))
        first = base64.b64decode(content[: 4 * -(-(3 * size) // 3)])
        blocks = int(np.frombuffer(first[:size], self.word)[0])
        length = 4 * -(-((3 + blocks) * size) // 3)
        _, sizes = self._header(base64.b64decode(content[:length]))
        return self._unpacked(base64.b64decode(content[length : length + 4 * -(-sum(sizes) // 3)]), sizes)

    def _unpacked(self, content: bytes, sizes: list[int]) -> bytes:
        if self.packed is None:
            return content[: sizes[0]]
        parts, at = [], 0
        for size in sizes:
            part = zlib.decompressobj()
            parts.append(part.decompress(content[at : at + size], 8 * _MOST_VALUES))
            at += size
        return b"".join(parts)


def read_pvd(content: bytes) -> list[tuple[str, str]]:
    """Return time and file of each data set of a series."""
    datasets = [(part.get("timestep", ""), part.get("file", "")) for part in _xml(content).findall(".//DataSet")]
    if not datasets or not all(file for _, file in datasets):
        raise UsageError("the PVD file has no data sets; allowed: a time and a file for each")
    return datasets


def places(position: NDArray[Any]) -> NDArray[np.int64]:
    """Return the numbers of points without ids: their order in the file if it is that along the chain, else that."""
    points = position.astype(np.float64)
    along = points[:, int(np.argmax(np.ptp(points, axis=0)))]
    steps = np.diff(along)
    if np.all(steps > 0.0) or np.all(steps < 0.0):
        return np.arange(len(along))
    return np.argsort(np.argsort(along, kind="stable"))


def frame_of(arrays: Mapping[str, NDArray[Any]]) -> tuple[NDArray[np.int64] | None, dict[str, NDArray[Any]]]:
    """Return the ids of the points (None without) and their columns, as :class:`.Frames` has them."""
    columns, scalars, ids = dict[str, NDArray[Any]](), dict[str, NDArray[Any]](), None
    for name, values in arrays.items():
        plain = re.sub(r"\s*[\[(].*", "", name.strip()).lower()
        if name == "points":
            columns["position"] = values
        elif plain in (*EXTRA_COLUMNS, *sum(GROUPS.values(), ())) and values.ndim == 1:
            scalars[plain] = values
        elif plain in ("id", "ids", "particle_id", "global_id") and values.ndim == 1:
            ids = values.astype(np.float64).astype(np.int64)
        else:
            try:
                heading = heading_of(name)
            except UsageError:
                heading = None
            quantity = _OTHERS.get(plain) or (heading.quantity if heading and heading.index is None else "")
            if quantity in ("velocity", "force") and values.ndim == 2 and values.shape[1] == 3:
                columns[quantity] = values
            elif quantity == "displacement" and values.ndim == 2 and values.shape[1] == 3:
                columns["displacements"] = values
            elif quantity in ("mass", "radius", "diameter") and values.ndim == 1:
                columns[quantity] = values
    return ids, grouped(scalars, len(next(iter(scalars.values())))) | columns if scalars else columns
