"""Open files of any code: recognise the format by the content, and read text with bounded memory."""

from __future__ import annotations

import bz2
import gzip
import lzma
import zlib
from pathlib import Path
from typing import Any

from dem_bridge.errors import UsageError

#: largest size of a file, after decompression, bytes
MOST_BYTES = 2**29
_PACKED: dict[bytes, Any] = {b"\x1f\x8b": gzip.open, b"BZh": bz2.open, b"\xfd7zXZ": lzma.open}


def read_bytes(path: Path) -> bytes:
    """Return the contents of a file, decompressed; raise UsageError if it is missing, damaged or too large."""
    try:
        with path.open("rb") as file:
            first = file.read(8)
        opener = next((opener for magic, opener in _PACKED.items() if first.startswith(magic)), None)
        with opener(path, "rb") if opener else path.open("rb") as stream:
            content = stream.read(MOST_BYTES + 1)
    except (OSError, EOFError, lzma.LZMAError, zlib.error) as error:
        raise UsageError(f"the file cannot be read ({error}); write it again") from error
    if len(content) > MOST_BYTES:
        raise UsageError(f"the file has more than {MOST_BYTES >> 20} MiB; write fewer samples or use npz or netCDF")
    return bytes(content)


def text_of(content: bytes) -> str:
    """Return the contents of a text file; raise UsageError for a binary file."""
    if content.startswith((b"\xff\xfe", b"\xfe\xff")):
        return content.decode("utf-16", errors="replace")
    if b"\0" in content[:4096]:
        raise UsageError(
            "the file is binary and of no known format; allowed: CSV, text columns, npz, netCDF, text dumps of LAMMPS"
            " and LIGGGHTS, extended XYZ, ASE trajectories, VTK; convert it to one of these"
        )
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        return content.decode("latin-1")
