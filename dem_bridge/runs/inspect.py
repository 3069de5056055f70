"""Look into a store: list and check its entries, say why one is not used again, and remove entries."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dem_bridge.errors import OF_DAMAGED_DATA, UsageError, one_line
from dem_bridge.foundation.numbers import check_number
from dem_bridge.runs.keys import present
from dem_bridge.runs.store import DAMAGED, SUFFIX, OtherSchema, Store, unpacked
from dem_bridge.scene.scene import Scene

#: the parts that determine a result beside its settings, in the order in which a difference is named, in words
_PARTS = {
    "scenes": "the scene",
    "engine": "LAMMPS",
    "code": "the code",
    "versions": "versions",
    "digits": "the last digits of the machine",
    "machine": "the processor or the C library",
    "variables": "environment variables",
    "schema": "the format of the store",
}
#: bytes of an entry's line of JSON, at most
_MOST_JSON = 10_000_000


@dataclass(frozen=True, kw_only=True)
class Entry:
    """One entry of a store, without its arrays."""

    key: str
    size: int
    """Bytes."""
    made: str
    """Date of its computation, ISO 8601, UTC; empty if the entry cannot be read."""
    used: float
    """Time of its last use, s since 1970."""
    what: str
    """What it is, in a few words."""
    scene: str
    """Name of the scene of a run; empty for others."""
    determined_by: Mapping[str, Any] | None
    """Everything that determined it; None for entries of earlier versions."""


def entries(store: Store) -> Iterator[Entry]:
    """Yield the entries of a store, the latest used first; only the first lines of the files are read."""
    files = []
    with suppress(FileNotFoundError), os.scandir(store.folder) as folder:
        for file in folder:
            with suppress(OSError):  # another process was here, or a circle of links
                if file.name.endswith(SUFFIX) and file.name.isprintable() and file.is_file():
                    files.append((file.stat().st_mtime, file.stat().st_size, Path(file.path)))
    for used, size, path in sorted(files, reverse=True):
        details = _details(path)
        yield Entry(
            key=path.stem,
            size=size,
            made=one_line(str(details.get("made", ""))),
            used=used,
            what=one_line(_what(details)),
            scene=one_line(str((details.get("provenance") or {}).get("scene", ""))),
            determined_by=details.get("determined_by"),
        )


def _details(path: Path) -> dict[str, Any]:
    """Return the line of JSON of an entry; empty if it cannot be read."""
    try:
        with path.open("rb") as file:
            file.readline(100)
            details = json.loads(file.readline(_MOST_JSON))
    except (OSError, ValueError, RecursionError):
        return {}
    line = details if isinstance(details, dict) else {}
    provenance = line.get("provenance") or {}
    settings = provenance.get("settings") if isinstance(provenance, dict) else provenance
    of_form = isinstance(settings or {}, dict) and isinstance(line.get("determined_by") or {}, dict)
    return line if of_form and isinstance(line.get("arrays") or {}, dict) else {}


def _what(details: Mapping[str, Any]) -> str:
    """Return what an entry is: scene, backend and settings of a run, or the values that were read from runs."""
    if not details:
        return "damaged"
    provenance = details.get("provenance")
    if not isinstance(provenance, Mapping):
        return f"{len(details.get('arrays', ()))} arrays of a study"
    settings = provenance.get("settings")
    words = " ".join(f"{k}={v:g}" for k, v in settings.items() if isinstance(v, float)) if settings else ""
    return f"{provenance.get('scene', '?')} by {provenance.get('backend', '?')} {words}".rstrip()


def check(store: Store) -> tuple[int, list[str]]:
    """Check every entry against its checksum; damaged ones are set aside.

    Returns
    -------
    tuple
        Number of entries, and a line for each damaged one.
    """
    count, damaged = 0, []
    for entry in list(entries(store)):
        path, count = store.folder / f"{entry.key}{SUFFIX}", count + 1
        try:
            unpacked(entry.key, path.read_bytes())
        except OtherSchema:
            continue  # another version of dem_bridge, which may be in use beside this one, reads it
        except FileNotFoundError:
            count -= 1  # another process removed it
        except (OSError, *OF_DAMAGED_DATA) as error:
            with suppress(OSError):
                path.replace(path.with_suffix(DAMAGED))
            damaged.append(f"{path.name}: {error}; set aside as {path.stem}{DAMAGED}")
    return count, damaged


def prune(store: Store, *, days: float | None = None, megabytes: float | None = None) -> tuple[int, int]:
    """Remove entries that were not used for so many days, then the longest unused ones down to a size.

    Returns
    -------
    tuple
        Number of entries removed, and their bytes. Entries that were set aside are removed, too.
    """
    if days is None and megabytes is None:
        raise UsageError("prune needs a limit; allowed: days (--days), megabytes (--megabytes), or both")
    for name, value in (("days", days), ("megabytes", megabytes)):
        if value is not None:
            check_number(name, value, "a number >= 0", at_least=0.0)
    kept = removed = freed = 0
    for entry in list(entries(store)):
        old = days is not None and time.time() - entry.used > 86_400.0 * days
        if old or (megabytes is not None and kept + entry.size > 1e6 * megabytes):
            with suppress(FileNotFoundError):
                (store.folder / f"{entry.key}{SUFFIX}").unlink()
                removed, freed = removed + 1, freed + entry.size
        else:
            kept += entry.size
    for path in store.folder.glob(f"*{DAMAGED}"):
        path.unlink(missing_ok=True)
    return removed, freed


def why(store: Store, scene: Scene) -> list[tuple[Entry, str]]:
    """Say of each entry of a scene, by its name, whether it is used again, and if not, what has changed since."""
    out = []
    for entry in entries(store):
        if entry.scene != scene.name:
            continue
        before = entry.determined_by
        if before is None:
            out.append((entry, "not used again: an earlier version of dem_bridge wrote it, without what determined it"))
            continue
        changes = list(_changes(before, present(before, scene)))
        out.append((entry, f"not used again: {' and '.join(changes)} changed" if changes else "used again"))
    return out


def _changes(before: Mapping[str, Any], now: Mapping[str, Any]) -> Iterator[str]:
    """Yield the parts of what determines a result that differ, in words; of code and versions also which."""
    for part, words in _PARTS.items():
        old, new = before.get(part), now[part]
        if old == new:
            continue
        if isinstance(old, Mapping) and isinstance(new, Mapping):
            names = sorted(name for name in {*old, *new} if old.get(name) != new.get(name))
            yield f"{words} ({', '.join(names)})"
        else:
            yield words
