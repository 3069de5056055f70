"""Open files of any code: recognise the format by the content, and read text with bounded memory."""

from __future__ import annotations

import bz2
import gzip
import lzma
import math
import zlib
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np

from dem_bridge.errors import OF_DAMAGED_DATA, UsageError
from dem_bridge.foundation.checked import LARGEST, SMALLEST
from dem_bridge.foundation.files import MOST_BYTES, opened

#: a file of a code, with or without its time step
File = str | Path | tuple[str | Path, float | None]
#: most lines of a text
MOST_LINES = 2**25
_PACKED: dict[bytes, Any] = {b"\x1f\x8b": gzip.open, b"BZh": bz2.open, b"\xfd7zXZ": lzma.open}


@contextmanager
def damage_as_usage_error(path: Path) -> Iterator[None]:
    """Turn the exceptions that damaged data cause into a UsageError with the name of the file."""
    try:
        with np.errstate(all="ignore"):
            yield
    except UsageError as error:
        raise UsageError(f"{path}: {error}") from error
    except MemoryError as error:
        raise UsageError(f"{path}: the file needs too much memory; write fewer samples") from error
    except (OSError, *OF_DAMAGED_DATA) as error:
        # a reader checks its data itself; the fuzzing counts what comes here as a fault
        raise UsageError(
            f"{path}: the file is damaged or not in its format ({type(error).__name__}); write it again"
        ) from error


def read_bytes(path: Path) -> bytes:
    """Return the contents of a file, decompressed; raise UsageError if it is missing, damaged or too large."""
    try:
        with opened(path, MOST_BYTES) as file:
            content = file.read(MOST_BYTES + 1) or b""
            opener = next((opener for magic, opener in _PACKED.items() if content.startswith(magic)), None)
            if opener is not None:
                file.seek(0)
                with opener(file, "rb") as stream:
                    content = stream.read(MOST_BYTES + 1)
    except (OSError, EOFError, lzma.LZMAError, zlib.error, ValueError) as error:
        reason = error.strerror or error if isinstance(error, OSError) else error
        raise UsageError(f"the file cannot be read ({reason}); write it again") from error
    if len(content) > MOST_BYTES:
        raise UsageError(f"the file has more than {MOST_BYTES >> 20} MiB; write fewer samples or use npz or netCDF")
    return bytes(content)


def text_of(content: bytes) -> str:
    """Return the contents of a text file; raise UsageError for a binary file."""
    if content.startswith((b"\xff\xfe", b"\xfe\xff")):
        return content.decode("utf-16", errors="replace")
    if not content.strip():
        raise UsageError("the file is empty; allowed: a file with at least one frame or row")
    if content.count(b"\n") > MOST_LINES:
        raise UsageError(f"the file has more than {MOST_LINES} lines; write fewer samples or use npz or netCDF")
    start = content[:4096]
    foreign = sum(byte > 126 for byte in start)
    if any(byte < 9 or 13 < byte < 32 for byte in start) or foreign > 0.3 * len(start):
        raise UsageError(
            "the file is not text and of no known format; allowed: CSV, text columns, npz, netCDF, text dumps of LAMMPS"
            " and LIGGGHTS, extended XYZ, ASE trajectories, VTK; convert a binary dump with LAMMPS' binary2txt"
        )
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        return content.decode("latin-1")


def with_step(file: File) -> tuple[Path, float | None]:
    """Return the path and the time step of a file that was given as FILE, FILE@DT or (path, dt).

    >>> with_step("run.csv@1e-7"), with_step("run.csv")[1], with_step(("run.csv", 2e-7))[1]
    ((PosixPath('run.csv'), 1e-07), None, 2e-07)
    """
    if isinstance(file, tuple):
        path, step = Path(file[0]), file[1]
    else:
        name, sign, text = str(file).rpartition("@")
        if not sign or Path(file).exists():
            return Path(file), None
        path, step = Path(name), math.nan
        with suppress(ValueError):
            step = float(text)
    if step is not None and not SMALLEST <= step <= LARGEST:
        raise UsageError(
            f"{path}: the time step is not a number above 0 ({SMALLEST:g} to {LARGEST:g});"
            f" give FILE@DT with DT in s, such as {path}@1e-7"
        )
    return path, step
