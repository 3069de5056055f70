"""The stored files of a code: their hashes, by which a changed file is found, and the line in it."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from dem_bridge.errors import UsageError
from dem_bridge.foundation.files import MOST_BYTES, bytes_of_file

#: lines of a file that have hashes of their own, so that a change can be placed
MOST_LINES = 10_000
#: hexadecimal digits of the hash of a line: it places a change that the hash of the file has found
_DIGITS_OF_LINE = 4
#: folder of the files of the code
FILES = "files"


def hashes_of(folder: Path) -> dict[str, dict[str, str]]:
    """Return the hashes of all files of the code below a folder, by their paths in it."""
    paths = sorted(path for path in (folder / FILES).rglob("*") if path.is_file())
    return {path.relative_to(folder).as_posix(): _hashes(bytes_of_file(path, MOST_BYTES)) for path in paths}


def _hashes(content: bytes) -> dict[str, str]:
    """Return the hash of a content and of its lines."""
    lines = content.splitlines()
    each = "" if len(lines) > MOST_LINES or b"\0" in content else "".join(map(_line_hash, lines))
    return {"sha256": hashlib.sha256(content).hexdigest(), "lines": each}


def _line_hash(line: bytes) -> str:
    """Return the short hash of a line."""
    return hashlib.sha256(line).hexdigest()[:_DIGITS_OF_LINE]


def check_hashes(folder: Path, recorded: Mapping[str, Any]) -> None:
    """Raise UsageError if the files of the code below a folder are not those that were recorded.

    The record is a file beside them, so that this is no proof against somebody who changes both.
    """
    found = hashes_of(folder)
    for name in sorted({*recorded, *found}):
        if name not in found:
            raise UsageError(f"{folder / name}: the file is missing; restore it, or run the code again")
        if name not in recorded:
            raise UsageError(f"{folder / name}: the file was not recorded; remove it, or run the code again")
        before = recorded[name] if isinstance(recorded[name], Mapping) else {}
        if before.get("sha256") != found[name]["sha256"]:
            place = _changed_line(str(before.get("lines", "")), found[name]["lines"])
            raise UsageError(
                f"{folder / name}: the file was changed after it was recorded{place}; restore it, or run the code again"
            )


def _changed_line(before: str, after: str) -> str:
    """Return where the first changed line is, in words; '' if it is not known."""
    if not before or not after:
        return ""
    size = _DIGITS_OF_LINE
    pairs = zip(range(0, len(before), size), range(0, len(after), size), strict=False)
    for at, _ in pairs:
        if before[at : at + size] != after[at : at + size]:
            return f": line {at // size + 1} is another one"
    return f": it has {len(after) // size} lines in place of {len(before) // size}"
