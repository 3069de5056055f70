"""Write binary LAMMPS dumps, from the layout of LAMMPS' dump_custom.cpp, revision 2."""

from __future__ import annotations

import struct
from collections.abc import Sequence


def frame(
    step: int,
    rows: Sequence[Sequence[float]],
    *,
    units: str = "si",
    time: float | None = 0.0,
    columns: str = "id type x y z vx fx",
    triclinic: bool = False,
    chunks: int = 1,
    magic: bytes = b"DUMPCUSTOM",
    revision: int = 2,
) -> bytes:
    """Return one frame; ``chunks`` is the number of MPI ranks that wrote it."""
    head = struct.pack("=q", -len(magic)) + magic + struct.pack("=iiqqi", 1, revision, step, len(rows), int(triclinic))
    head += struct.pack("=6i", *[1] * 6) + struct.pack("=6d", *[0.0, 1.0] * 3)
    if triclinic:
        head += struct.pack("=3d", 0.0, 0.0, 0.0)
    head += struct.pack("=i", len(rows[0])) + struct.pack("=i", len(units)) + units.encode()
    head += b"\0" if time is None else b"\1" + struct.pack("=d", time)
    head += struct.pack("=i", len(columns)) + columns.encode() + struct.pack("=i", chunks)
    body = b""
    for chunk in range(chunks):
        values = [value for row in rows[chunk::chunks] for value in row]
        body += struct.pack("=i", len(values)) + struct.pack(f"={len(values)}d", *values)
    return head + body
