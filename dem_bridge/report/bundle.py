"""A bundle for a reviewer: everything a verification was made of and found, and one command that runs it again.

It is whole: scenes, decks, numbers, the report, the exact versions, and dem_bridge's own source.
"""

from __future__ import annotations

import hashlib
import json
import platform
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

from packaging.requirements import Requirement

from dem_bridge.backends.base import BACKENDS, backend
from dem_bridge.backends.lammps import LammpsGranular
from dem_bridge.errors import RunBroken, UnsupportedScene, UsageError
from dem_bridge.files import write_whole
from dem_bridge.lmp.engine import Engine
from dem_bridge.report.page import report_files, title
from dem_bridge.scene_file.text import scene_toml
from dem_bridge.studies.study import Table
from dem_bridge.studies.verify import Verification
from dem_bridge.verification.assess import SceneStudy
from dem_bridge.verification.verdict import Verdict, plain
from dem_bridge.version import __version__

SCHEMA = "dem-bridge/bundle/1"
#: what names a folder as a bundle, and lists its files
_MARK, _SUMS = "bundle.json", "SHA256SUMS"
_NAME = "dem-bridge"
_PACKAGE = Path(__file__).parents[1]

_REPLAY = """\
#!/bin/sh
# Makes an environment with the versions of requirements.txt, verifies again and compares verdict by verdict.
set -eu
cd "$(dirname "$0")"
[ -x venv/bin/python ] || "${PYTHON:-python3}" -m venv venv
venv/bin/python -m pip install --quiet --disable-pip-version-check -r requirements.txt
exec venv/bin/python replay.py "$@"
"""


def check_bundle(folder: Path) -> None:
    """Whether a bundle may be written into ``folder``: UsageError for one that has other things in it."""
    if not folder.exists() or (folder.is_dir() and (not any(folder.iterdir()) or _files_of(folder))):
        return
    raise UsageError(f"{folder}: is there and no bundle; allowed: a new or empty folder, or a bundle to write again")


def write_bundle(
    found: Verification,
    folder: Path,
    *,
    report: Mapping[str, str] | None = None,
    engine: Engine | None = None,
    words: Sequence[str] | None = None,
) -> None:
    """Write the bundle of a verification into ``folder``: all of it, or nothing.

    ``report``: its files where they are made already. ``engine``: which LAMMPS was asked for. ``words``: what
    ``dem-bridge verify`` is told when it is run again (None: "paper" where it was that, else the scenes' files). What
    an earlier bundle there had and this one has not goes. UsageError where there are other things in the folder.
    """
    check_bundle(folder)
    before = _files_of(folder) if folder.exists() else []
    files = bundle_files(found, report=report, engine=engine, words=words)
    write_whole(folder, files)
    for name in before:
        if name not in files:
            (folder / name).unlink(missing_ok=True)


def bundle_files(
    found: Verification,
    *,
    report: Mapping[str, str] | None = None,
    engine: Engine | None = None,
    words: Sequence[str] | None = None,
) -> dict[str, str | bytes]:
    """Name -> content of every file; see :func:`write_bundle`. UsageError where the versions in use are not known."""
    engine = engine or Engine.chosen()
    scenes, functions = _scenes(found)
    if words is None:
        words = ("paper",) if found.paper else tuple(scenes)
    pins = pinned(_NAME)
    told = {
        "schema": SCHEMA,
        "verify": [*words, *_options(found, engine)],
        "not_replayed": functions,
        "python": platform.python_version(),
    }
    files: dict[str, str | bytes] = {
        "README.md": _readme(found, functions, pins, engine),
        _MARK: json.dumps(told, indent=1, ensure_ascii=False) + "\n",
        "replay.sh": _REPLAY,
        "replay.py": (_PACKAGE / "report" / "replay.py").read_bytes(),
        "requirements.txt": "".join(f"{name}=={version}\n" for name, version in pins.items()),
        **scenes,
        **dict(_decks(found)),
        **dict(_sheets(found)),
        **{f"report/{name}": text for name, text in (report_files(found) if report is None else report).items()},
        **dict(_source()),
    }
    return files | {_SUMS: _sums(files)}


def pinned(name: str) -> dict[str, str]:
    """Name -> version of all that a distribution needs here, by name and without itself; UsageError if it is none.

    >>> pins = pinned("dem-bridge")
    >>> {"numpy", "lammps", "llvmlite"} <= set(pins), "dem-bridge" in pins
    (True, False)
    """
    found: dict[str, str] = {}
    waiting = [Requirement(name)]
    while waiting:
        wanted = waiting.pop()
        try:
            one = distribution(wanted.name)
        except PackageNotFoundError:
            raise UsageError(
                f"{wanted.name} is not installed here, so the bundle cannot say which; install it"
            ) from None
        if (own := one.metadata["Name"]) in found:
            continue
        found[own] = one.version
        extras = ("", *wanted.extras)
        needed = (Requirement(line) for line in one.requires or ())
        waiting += [r for r in needed if r.marker is None or any(r.marker.evaluate({"extra": e}) for e in extras)]
    return {key: found[key] for key in sorted(found, key=str.lower) if key != name}


def _files_of(folder: Path) -> list[str]:
    """Names of the files of the bundle in ``folder``; none where there is no bundle."""
    try:
        schema = json.loads((folder / _MARK).read_text(encoding="utf-8"))["schema"]
        names = [line.split("  ", 1)[1] for line in (folder / _SUMS).read_text(encoding="utf-8").splitlines()]
    except (OSError, ValueError, KeyError, TypeError, IndexError):
        return []
    inside = [name for name in names if (folder / name).resolve().is_relative_to(folder.resolve())]
    return [*inside, _SUMS] if schema == SCHEMA else []


def _scenes(found: Verification) -> tuple[dict[str, str], list[str]]:
    """Files of the scenes, and the names of those that no file can hold."""
    files, functions = {}, []
    for study in found.studies:
        try:
            files[f"scenes/{study.scene.name}.toml"] = scene_toml(study.scene)
        except UnsupportedScene:
            functions.append(study.scene.name)
    return files, functions


def _options(found: Verification, engine: Engine) -> list[str]:
    """Words for ``dem-bridge verify``. Which binary of LAMMPS is not told: a path says nothing elsewhere."""
    words = ["--accuracy", repr(found.accuracy)]
    words += ["--ranks", str(engine.ranks)] if engine.ranks > 1 else []
    words += [f"--lmp-args={' '.join(engine.lmp_args)}"] if engine.lmp_args else []
    return words


def _decks(found: Verification) -> Iterator[tuple[str, str]]:
    """The deck of each scene's main run; RunBroken where it is not the one that was run."""
    for study in found.studies:
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
                f"the deck of {case.scene.name} is not the one that was run: verify again without the store"
            )
        yield from ((f"decks/{case.scene.name}/{name}", text) for name, text in deck.files.items())


def _sheets(found: Verification) -> Iterator[tuple[str, str]]:
    """Verdicts, and of each scene the contacts by all codes, as CSV in full precision."""
    columns = tuple(one.name for one in fields(Verdict))
    rows = tuple(tuple(_cell(plain(getattr(one, name))) for name in columns) for one in found.verdicts)
    yield "csv/verdicts.csv", _csv(columns, rows)
    for study in found.studies:
        yield f"csv/contacts-{study.scene.name}.csv", _contacts(study)
    if found.paper is not None:
        columns = ("claim", "outcome", "name", "by", "value", "uncertainty", "unit")
        yield "csv/claims.csv", _csv(columns, tuple(
            (claim.id, claim.outcome.value, one.name, one.backend, one.value, one.uncertainty, one.unit)
            for claim in found.paper.claims
            for one in claim.values
        ))  # fmt: skip


def _contacts(study: SceneStudy) -> str:
    """Largest force and first crossing of each contact, by each code at the main resolution."""
    columns = ("backend", "contact", "peak_force (N)", "bar (N)", "crossing_time (s)", "bar (s)")
    made = {result.case.backend for result in study.results}
    rows: list[tuple[str | float, ...]] = []
    for name in BACKENDS:
        if name not in made or (run := study.run(name)) is None:
            continue
        values = (run.peak_force, run.uncertainty["peak_force"], run.crossing_time, run.uncertainty["crossing_time"])
        rows += [(name, k, *row) for k, row in enumerate(zip(*(v.tolist() for v in values), strict=True))]
    return _csv(columns, tuple(rows))


def _csv(columns: tuple[str, ...], rows: tuple[tuple[str | float, ...], ...]) -> str:
    return Table(id="", title="", caption="", columns=columns, rows=rows).as_csv()


def _cell(value: object) -> str | float:
    return "" if value is None else value if isinstance(value, str | float) else str(value)


def _source() -> Iterator[tuple[str, str | bytes]]:
    """The package itself: what was run, and not what its version number says. With its metadata, by which an
    environment knows it."""
    for file in sorted(_PACKAGE.rglob("*")):
        if file.is_file() and "__pycache__" not in file.parts:
            yield f"source/dem_bridge/{file.relative_to(_PACKAGE).as_posix()}", file.read_bytes()
    metadata = f"Metadata-Version: 2.1\nName: {_NAME}\nVersion: {__version__}\n"
    yield f"source/dem_bridge-{__version__}.dist-info/METADATA", metadata


def _sums(files: Mapping[str, str | bytes]) -> str:
    """As ``sha256sum`` writes and checks them."""

    def digest(content: str | bytes) -> str:
        return hashlib.sha256(content if isinstance(content, bytes) else content.encode()).hexdigest()

    return "".join(f"{digest(files[name])}  {name}\n" for name in sorted(files))


def _readme(found: Verification, functions: Sequence[str], pins: Mapping[str, str], engine: Engine) -> str:
    runs = [run for study in found.studies if (run := study.run(study.engine)) is not None]
    lammps = next((run.provenance["lammps"] for run in runs if "lammps" in run.provenance), None)
    versions = [f"dem_bridge {__version__} (in source/)", f"Python {platform.python_version()}"]
    if lammps:
        versions.append(f"LAMMPS {lammps['version']} ({lammps['run_by']})")
    own = ""
    if engine.lmp or engine.python:
        own = "\nLAMMPS was the author's own: name yours by `sh replay.sh --lmp PATH`, or the one pinned here runs.\n"
    if functions:
        own += (
            f"\nNot replayed, for their contact laws are functions, which no file can hold: {', '.join(functions)}.\n"
        )
    return f"""\
# {title(found)}

Run it again, in an environment of its own with the same versions, and compare verdict by verdict:

    sh replay.sh

Needed: Python {".".join(platform.python_version_tuple()[:2])} (another by PYTHON=python3.x), Linux, and PyPI for the
{len(pins)} packages in requirements.txt. It ends with 0 where every verdict is the same, and with 1 where one changed;
more words go to `dem-bridge verify`, such as `-j 2`.
{own}
Made with {", ".join(versions)}; wanted accuracy {found.accuracy:g}.

| what | where |
|---|---|
| the report, with its figures and tables as CSV | report/index.html, report/figures/, report/tables/ |
| verdicts, claims, budgets, provenance as JSON | report/verdicts.json |
| verdicts, claims, and peak forces and crossing times of all contacts by all codes, as CSV | csv/ |
| scenes, every number in full | scenes/ |
| LAMMPS decks as they were run; each runs in its folder by `lmp -in in.NAME` | decks/ |
| versions | requirements.txt |
| dem_bridge itself | source/ |
| all files with their SHA-256 (`sha256sum -c SHA256SUMS`) | SHA256SUMS |
"""
