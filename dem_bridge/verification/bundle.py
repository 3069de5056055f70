"""Write a bundle with which a reviewer can repeat a verification by one command.

A bundle contains the scenes, decks, numbers and report, the exact versions, and the source of dem_bridge.
"""

from __future__ import annotations

import hashlib
import json
import platform
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

import numpy as np
from packaging.requirements import Requirement

from dem_bridge.backends.base import BACKENDS, backend
from dem_bridge.backends.lammps import LammpsGranular
from dem_bridge.errors import OF_DAMAGED_DATA, RunBroken, UnsupportedScene, UsageError
from dem_bridge.foundation.files import text_of_file, write_whole
from dem_bridge.lmp.engine import Engine
from dem_bridge.observables.verdict import Verdict, plain
from dem_bridge.report.page import fill
from dem_bridge.report.study import Table
from dem_bridge.scene.file.write import scene_toml
from dem_bridge.verification.assess import SceneStudy
from dem_bridge.verification.verification import Verification
from dem_bridge.version import __version__

SCHEMA = "dem-bridge/bundle/1"
#: the file that marks a folder as a bundle, and the file with the checksums
_MARK, _SUMS = "bundle.json", "SHA256SUMS"
_NAME = "dem-bridge"
_PACKAGE = Path(__file__).parents[1]


def check_bundle(folder: Path) -> None:
    """Raise UsageError unless ``folder`` is new, empty or a bundle."""
    if not folder.exists() or (folder.is_dir() and (not any(folder.iterdir()) or _files_of(folder))):
        return
    raise UsageError(
        f"{folder}: the folder contains files that are not a bundle; allowed: a new or empty folder, or a bundle, which"
        " is replaced"
    )


def write_bundle(
    verification: Verification,
    folder: Path,
    *,
    report: Mapping[str, str | bytes] | None = None,
    engine: Engine | None = None,
    words: Sequence[str] | None = None,
) -> None:
    """Write the bundle of a verification into ``folder``, all of it or nothing.

    Parameters
    ----------
    verification : Verification
        Verification to repeat.
    folder : Path
        New or empty folder, or a bundle, which is replaced.
    report : mapping of str to str, optional
        Files of the report; the default is to write them.
    engine : Engine, optional
        LAMMPS of the verification.
    words : sequence of str, optional
        Scenes on the command line of the repeated verification; the default is "paper" for a verification of the
        paper, else the files of the scenes.

    Raises
    ------
    UsageError
        If the folder contains files that are not a bundle.
    """
    check_bundle(folder)
    before = _files_of(folder) if folder.exists() else []
    files = bundle_files(verification, report=report, engine=engine, words=words)
    write_whole(folder, files)
    for name in before:
        if name not in files:
            (folder / name).unlink(missing_ok=True)


def bundle_files(
    verification: Verification,
    *,
    report: Mapping[str, str | bytes] | None = None,
    engine: Engine | None = None,
    words: Sequence[str] | None = None,
) -> dict[str, str | bytes]:
    """Return the contents of every file by name; see :func:`write_bundle`.

    Raises UsageError if the version of a package is unknown.
    """
    engine = engine or Engine.chosen()
    scenes, functions = _scenes(verification)
    if words is None:
        words = ("paper",) if verification.claims else tuple(scenes)
    pins = pinned(_NAME)
    mark = {
        "schema": SCHEMA,
        "verify": [*words, *_options(verification, engine)],
        "not_replayed": functions,
        "python": platform.python_version(),
    }
    files: dict[str, str | bytes] = {
        "README.md": _readme(verification, functions, pins, engine),
        _MARK: json.dumps(mark, indent=1, ensure_ascii=False) + "\n",
        "replay.sh": fill("replay.sh", __package__),
        "replay.py": (_PACKAGE / "verification" / "replay.py").read_bytes(),
        "requirements.txt": "".join(f"{name}=={version}\n" for name, version in pins.items()),
        **scenes,
        **dict(_decks(verification)),
        **dict(_sheets(verification)),
        **{f"report/{name}": text for name, text in (report or verification.page_files()).items()},
        **dict(_source()),
    }
    return files | {_SUMS: _sums(files)}


def pinned(name: str) -> dict[str, str]:
    """Return the versions of all packages that a distribution needs, by name, without the distribution itself.

    Raises UsageError if one of them is not installed.

    >>> pins = pinned("dem-bridge")
    >>> {"numpy", "lammps", "llvmlite"} <= set(pins), "dem-bridge" in pins
    (True, False)
    """
    versions: dict[str, str] = {}
    waiting = [Requirement(name)]
    while waiting:
        requirement = waiting.pop()
        try:
            package = distribution(requirement.name)
        except PackageNotFoundError:
            raise UsageError(
                f"{requirement.name} is not installed, so the bundle cannot state its version; install it"
            ) from None
        if (package_name := package.metadata["Name"]) in versions:
            continue
        versions[package_name] = package.version
        extras = ("", *requirement.extras)
        needed = (Requirement(line) for line in package.requires or ())
        waiting += [r for r in needed if r.marker is None or any(r.marker.evaluate({"extra": e}) for e in extras)]
    return {key: versions[key] for key in sorted(versions, key=str.lower) if key != name}


def _files_of(folder: Path) -> list[str]:
    """Return the names of the files of the bundle in ``folder``; empty if there is no bundle."""
    try:
        schema = json.loads(text_of_file(folder / _MARK))["schema"]
        names = [line.split("  ", 1)[1] for line in text_of_file(folder / _SUMS).splitlines()]
    except (OSError, *OF_DAMAGED_DATA):
        return []
    inside = [name for name in names if (folder / name).resolve().is_relative_to(folder.resolve())]
    return [*inside, _SUMS] if schema == SCHEMA else []


def _scenes(verification: Verification) -> tuple[dict[str, str], list[str]]:
    """Return the files of the scenes, and the names of scenes that cannot be written to a file."""
    files, functions = {}, []
    for study in verification.studies:
        try:
            files[f"scenes/{study.scene.name}.toml"] = scene_toml(study.scene)
        except UnsupportedScene:
            functions.append(study.scene.name)
    return files, functions


def _options(verification: Verification, engine: Engine) -> list[str]:
    """Return options of ``dem-bridge verify``, without the path of LAMMPS, which other machines do not have."""
    words = ["--accuracy", repr(verification.accuracy)]
    words += [] if verification.dt is None else ["--dt", repr(verification.dt)]
    words += ["--ranks", str(engine.ranks)] if engine.ranks > 1 else []
    words += [f"--lmp-args={' '.join(engine.lmp_args)}"] if engine.lmp_args else []
    return words


def _decks(verification: Verification) -> Iterator[tuple[str, str]]:
    """Yield the deck of each scene's main run; raise RunBroken if it differs from the deck that was run."""
    for study in verification.studies:
        run = study.run(study.engine)
        if run is None or "deck_hash" not in run.provenance:
            continue
        assert study.runs is not None
        case = study.runs.engine.case
        writer = backend(case.backend, case.engine)
        assert isinstance(writer, LammpsGranular)
        deck = writer.deck(case.scene, case.resolution, case.sampling)
        if deck.content_hash != run.provenance["deck_hash"]:
            raise RunBroken(
                f"the deck of {case.scene.name} differs from the deck that was run; verify again without the store"
                " (--no-cache)"
            )
        yield from ((f"decks/{case.scene.name}/{name}", text) for name, text in deck.files.items())


def _sheets(verification: Verification) -> Iterator[tuple[str, str]]:
    """Yield CSV files in full precision: verdicts, contacts of each scene by backend, and claims."""
    columns = tuple(field.name for field in fields(Verdict))
    rows = tuple(tuple(_cell(plain(getattr(verdict, name))) for name in columns) for verdict in verification.verdicts)
    yield "csv/verdicts.csv", _csv(columns, rows)
    for study in verification.studies:
        yield f"csv/contacts-{study.scene.name}.csv", _contacts(study)
    if verification.claims:
        columns = ("claim", "outcome", "name", "by", "value", "uncertainty", "unit")
        yield "csv/claims.csv", _csv(columns, tuple(
            (claim.id, claim.outcome.value, value.name, value.backend, value.value, value.uncertainty, value.unit)
            for claim in verification.claims
            for value in claim.values
        ))  # fmt: skip


def _contacts(study: SceneStudy) -> str:
    """Return CSV with the peak force and the crossing time of each contact by each backend of the verification."""
    columns = (
        "backend", "contact", "peak_force (N)", "peak_force uncertainty (N)", "crossing_time (s)",
        "crossing_time uncertainty (s)",
    )  # fmt: skip
    rows: list[tuple[str | float, ...]] = []
    for name in BACKENDS:
        if (run := study.run(name)) is not None:
            force, crossing = run.uncertainty["peak_force"], run.uncertainty["crossing_time"]
            values = np.stack([run.peak_force, force, run.crossing_time, crossing], axis=1).tolist()
            rows += [(name, k, *row) for k, row in enumerate(values)]
    return _csv(columns, tuple(rows))


def _csv(columns: tuple[str, ...], rows: tuple[tuple[str | float, ...], ...]) -> str:
    """Return a table as CSV."""
    return Table(id="", title="", caption="", columns=columns, rows=rows).as_csv()


def _cell(value: object) -> str | float:
    """Return a value as a cell of a table."""
    return "" if value is None else value if isinstance(value, str | float) else str(value)


def _source() -> Iterator[tuple[str, str | bytes]]:
    """Yield the files of the package, which the version number alone does not identify, and its metadata."""
    for file in sorted(_PACKAGE.rglob("*")):
        if file.is_file() and "__pycache__" not in file.parts:
            yield f"source/dem_bridge/{file.relative_to(_PACKAGE).as_posix()}", file.read_bytes()
    metadata = f"Metadata-Version: 2.1\nName: {_NAME}\nVersion: {__version__}\n"
    yield f"source/dem_bridge-{__version__}.dist-info/METADATA", metadata


def _sums(files: Mapping[str, str | bytes]) -> str:
    """Return the checksums of the files in the format of ``sha256sum``."""

    def digest(content: str | bytes) -> str:
        return hashlib.sha256(content if isinstance(content, bytes) else content.encode()).hexdigest()

    return "".join(f"{digest(files[name])}  {name}\n" for name in sorted(files))


def _readme(verification: Verification, functions: Sequence[str], pins: Mapping[str, str], engine: Engine) -> str:
    """Return the README of the bundle."""
    runs = [run for study in verification.studies if (run := study.run(study.engine)) is not None]
    return fill(
        "bundle.md.j2",
        __package__,
        verification=verification,
        version=__version__,
        python=platform.python_version_tuple(),
        lammps=next((run.provenance["lammps"] for run in runs if "lammps" in run.provenance), None),
        other_lammps=engine.lmp or engine.python,
        functions=functions,
        pins=pins,
    )
