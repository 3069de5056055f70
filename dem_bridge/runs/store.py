"""Results on disk, each under a key of everything that determines it (:mod:`.keys`): they are not computed again.

An entry is one file: a line with the sha256 of the rest, a line of JSON with type and shape of each array, the arrays'
bytes. One that does not fit its checksum is set aside and computed again. It is written under another name and renamed,
which is atomic on local and on network file systems; no file is ever locked. Processes that make runs say so by
locks (:mod:`.locks`), which are advice.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dem_bridge.errors import OF_DAMAGED_DATA, UsageError
from dem_bridge.foundation.files import check_folder, checked_file
from dem_bridge.foundation.leftovers import LOCK, owned, sweep
from dem_bridge.runs.code import changed_since_start
from dem_bridge.runs.keys import SCHEMA, determined_by
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import QUANTITIES, VOCABULARY, Cost, Trajectory, Uncertainty
from dem_bridge.version import schema_fault

#: names the folder; empty: no store
VARIABLE = "DEM_BRIDGE_STORE"
#: its largest size in MB; beyond, what was not used for the longest time goes first
LIMIT_VARIABLE = "DEM_BRIDGE_STORE_LIMIT"
LIMIT = 2_000_000_000
SUFFIX = ".run"
#: ... of an entry that was damaged
DAMAGED = ".damaged"
#: ... of one that is being written
_PART = ".part"
#: bytes of the first line of an entry
_CHECKSUM = 65
#: s for which the answer holds that the code is that of this process; it takes 3 ms
_SAME_CODE = 1.0
#: s, after which what a killed process of another machine left half written goes
_LEFT_BEHIND = 86_400.0
Array = NDArray[Any]


def default_folder() -> Path | None:
    """Return ``$DEM_BRIDGE_STORE``, or dem-bridge in the user's cache; None where the variable is empty: no store."""
    variable = os.environ.get(VARIABLE)
    if variable is not None:
        return Path(os.path.abspath(Path(variable).expanduser())) if variable else None
    cache_home = Path(os.environ.get("XDG_CACHE_HOME", ""))
    return (cache_home if cache_home.is_absolute() else Path("~/.cache").expanduser()) / "dem-bridge"


def _limit() -> int:
    """Return the largest size of a store, bytes."""
    text = os.environ.get(LIMIT_VARIABLE, "")
    try:
        limit = 1e6 * float(text) if text else LIMIT
        if not 0.0 <= limit < math.inf:
            raise ValueError
    except ValueError:
        raise UsageError(f"{LIMIT_VARIABLE} = {text!r}; allowed: the largest size of the store in MB") from None
    return int(limit)


class StoreNote(str):
    """A note that a store keeps nothing, so that a second call takes as long as the first."""


class Store:
    """A folder of entries; several processes may use one folder.

    Trouble with the folder never stops a run: ``trouble`` says what it is. ``limit``: bytes. ``recompute``: no entry is
    read, and all are written anew.
    """

    def __init__(self, folder: str | Path, *, limit: int = LIMIT, recompute: bool = False) -> None:
        self.folder, self.limit, self.recompute = Path(os.path.abspath(folder)), limit, recompute
        self.trouble = ""
        """Problem with the folder in one line, for the user; '' if there is none."""
        self._writes = True
        self._same_code_until = 0.0
        """Time (monotonic, s) up to which entries are read without another look at the code."""
        self._room = 0
        """Bytes that may be written before the folder is looked at again."""
        try:
            check_folder(self.folder)
        except UsageError as error:
            self._cannot_write(error)
        sweep(self.folder)

    @classmethod
    def opened(cls, choice: object = True, *, recompute: bool = False) -> Store | None:
        """Open the default store for True (see :func:`default_folder`) or that in a folder; False: None.

        Raises UsageError for anything else.
        """
        if isinstance(choice, bool):
            try:
                folder = default_folder() if choice else None
            except RuntimeError:  # a user without a home
                folder = None
        elif isinstance(choice, str | Path) and str(choice):
            folder = Path(choice).expanduser()
        else:
            raise UsageError(f"store = {choice!r}; allowed: True, False or the path of a folder")
        return None if folder is None else cls(folder, limit=_limit(), recompute=recompute)

    def load(self, key: str, scene: Scene) -> Trajectory | None:
        """Return the trajectory of a key, None if there is none.

        Its provenance has the name of ``scene`` and, in ``stored``, the date of its computation (ISO 8601, UTC).
        """
        entry = self._read(key)
        if entry is None:
            return None
        arrays, details = entry
        try:
            return Trajectory(
                **{name: arrays[name] for name in ("time", *VOCABULARY)},
                uncertainty=Uncertainty.from_json(
                    {name: arrays[f"{name}_uncertainty"] for name in QUANTITIES}, details["uncertainty"]
                ),
                cost=Cost(**details["cost"]),
                provenance=details["provenance"] | {"scene": scene.name, "stored": details["made"]},
            )
        except OF_DAMAGED_DATA as error:
            self._say(f"{self._path(key)}: has another form ({type(error).__name__}); it is computed again")
            return None

    def has(self, key: str) -> bool:
        """Return True if there is an entry of a key, damaged or not."""
        return self._path(key).exists()

    def save(self, key: str, run: Trajectory) -> bool:
        """Keep a trajectory; return False if it could not be kept."""
        arrays = {name: getattr(run, name) for name in ("time", *VOCABULARY)}
        arrays |= {f"{name}_uncertainty": value for name, value in run.uncertainty.items()}
        details = {"cost": asdict(run.cost), "uncertainty": run.uncertainty.as_json()}
        return self._write(key, arrays, {**details, "provenance": dict(run.provenance)})

    def load_arrays(self, key: str) -> dict[str, Array] | None:
        """Return the arrays that :meth:`save_arrays` kept, None if there are none."""
        entry = self._read(key)
        return None if entry is None else {name: array.copy() for name, array in entry[0].items()}

    def save_arrays(self, key: str, arrays: Mapping[str, Array]) -> None:
        """Keep named arrays, of any kind of number."""
        self._write(key, arrays, {})

    def _path(self, key: str) -> Path:
        return self.folder / f"{key}{SUFFIX}"

    def _read(self, key: str) -> tuple[dict[str, Array], dict[str, Any]] | None:
        if self.recompute:
            return None
        if (now := time.monotonic()) > self._same_code_until:
            if self._outdated():
                return None
            self._same_code_until = now + _SAME_CODE
        path = self._path(key)
        try:
            entry = unpacked(key, checked_file(path, 2**63).read_bytes())
        except FileNotFoundError:
            return None
        except OSError as error:
            self._say(f"{path}: cannot be read ({error.strerror}); it is computed again")
            return None
        except OF_DAMAGED_DATA as error:
            with suppress(OSError):  # a folder that may only be read: it is not trusted next time either
                path.replace(path.with_suffix(DAMAGED))
            self._say(f"{path}: is damaged ({error}); it is set aside as {DAMAGED} and computed again")
            return None
        with suppress(OSError):  # likewise: what is only read has no last use
            os.utime(path)
        return entry

    def _write(self, key: str, arrays: Mapping[str, Array], details: Mapping[str, Any]) -> bool:
        if not self._writes or self._outdated():
            return False
        date = datetime.now(UTC).isoformat(timespec="seconds")
        about = {"schema": SCHEMA, "key": key, "made": date, "determined_by": determined_by(key)}
        whole = _packed({**about, **details}, arrays)
        if len(whole) > self.limit // 2:
            return False
        try:
            self._place(key, whole)
            self._room -= len(whole)
            if self._room < 0:
                self.make_room()
        except (UsageError, OSError) as error:
            self._cannot_write(error)
        return self._writes

    def _place(self, key: str, whole: bytes) -> None:
        """Write an entry under a name of this process and rename it: at any time it is there as a whole or not."""
        part = self.folder / f"{owned(key[:12])}{os.urandom(4).hex()}{_PART}"
        try:
            with part.open("xb") as file:
                file.write(whole)
            part.replace(self._path(key))
        finally:
            part.unlink(missing_ok=True)

    def make_room(self) -> None:
        """Remove the oldest entries down to nine tenths of the limit, where it is passed, and files left behind."""
        entries, now = [], time.time()
        for entry in os.scandir(self.folder):
            with suppress(FileNotFoundError):  # another process was here
                about = entry.stat(follow_symlinks=False)
                if entry.name.endswith(SUFFIX):
                    entries.append((about.st_mtime_ns, about.st_size, entry.path))
                # a file from the future is old: the clock was set back
                elif entry.name.endswith((_PART, DAMAGED, LOCK)) and abs(now - about.st_mtime) > _LEFT_BEHIND:
                    os.unlink(entry.path)
        total = sum(size for _, size, _ in entries)
        if total > self.limit:
            for _, size, path in sorted(entries):
                if total <= 0.9 * self.limit:
                    break
                Path(path).unlink(missing_ok=True)
                total -= size
        self._room = min(self.limit - total, self.limit // 20)

    def _outdated(self) -> bool:
        """Return True if the code on disk is younger than this process, so that it is unknown which of the two ran."""
        if not changed_since_start():
            return False
        self._say("dem_bridge has changed on disk since this process began: nothing is stored; start it again")
        return True

    def _cannot_write(self, error: Exception) -> None:
        self._writes = False
        self._say(f"nothing is stored: {error}")

    def _say(self, text: str) -> None:
        self.trouble = self.trouble or StoreNote(f"store: {' '.join(text.split())}")


def _packed(details: Mapping[str, Any], arrays: Mapping[str, Array]) -> bytes:
    parts = {name: np.asarray(array, order="C") for name, array in arrays.items()}
    forms = {name: (part.dtype.str, part.shape) for name, part in parts.items()}
    if any(part.dtype.hasobject for part in parts.values()):
        raise TypeError("arrays of objects cannot be kept in the store")
    line = json.dumps({**details, "arrays": forms}).encode()
    # numbers begin at a multiple of 8 bytes, so that they can be taken as they are
    line += b" " * (-(_CHECKSUM + len(line) + 1) % 8)
    content = b"\n".join([line, b"".join(part.tobytes() for part in parts.values())])
    return hashlib.sha256(content).hexdigest().encode() + b"\n" + content


class OtherSchema(ValueError):
    """Report an entry of another version of the store, which has no fault."""


def unpacked(key: str, whole: bytes) -> tuple[dict[str, Array], dict[str, Any]]:
    """Return the arrays and details of an entry; ValueError unless they are as written, and under that key.

    The arrays are views of ``whole``: nothing is copied, because entries have megabytes.
    """
    first = whole.find(b"\n") + 1
    second = whole.find(b"\n", first) + 1
    content = memoryview(whole)[first:]
    if not 0 < first < second or whole[: first - 1] != hashlib.sha256(content).hexdigest().encode():
        raise ValueError("its checksum does not fit")
    try:
        details = json.loads(whole[first:second])
        if details["key"] != key:
            raise ValueError("it is the entry of another key")
        if details["schema"] != SCHEMA:
            raise OtherSchema(schema_fault(details["schema"], SCHEMA))
        arrays, start = {}, second
        for name, (form, shape) in details["arrays"].items():
            arrays[name] = np.ndarray(shape, form, whole, start)
            start += arrays[name].nbytes
    except (KeyError, TypeError, AttributeError) as error:
        raise ValueError(f"it is no entry of a store: {error!r}") from error
    return arrays, dict(details)
