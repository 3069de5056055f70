"""Baselines read, their scenes run again, and what is not the same as last time.

Nothing is taken from the store: code and engine have to answer now.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from dem_bridge.backends.base import BACKENDS, ENGINE_BACKENDS, Resolution, Sampling, backend, supports_of
from dem_bridge.campaign import Progress, Result, run_cases
from dem_bridge.errors import BackendUnavailable, RunBroken, SceneError, UsageError
from dem_bridge.lmp.engine import Engine
from dem_bridge.planning.bars import resolution_for
from dem_bridge.regression.baseline import Baseline, read_baseline
from dem_bridge.regression.compare import Change, Comparison, accuracy_words, compare, judged
from dem_bridge.regression.provenance import baseline_of, roundoff_tolerance
from dem_bridge.runs.case import Case
from dem_bridge.scene import Scene
from dem_bridge.scene_file import load_scene, shipped_scenes
from dem_bridge.trajectory import Trajectory

SCHEMA = "dem-bridge/regression/1"
FOLDER = Path("reports/baselines")
#: of a scene that has no baselines yet, where they can do it
NEW_BACKENDS = ("lammps-granular", "lammps-table", "verlet", "reference")
#: what errors are against; of the reference itself, the other one, and only where it has changed: that one is slow
REFERENCE, SECOND = "reference", "scipy"
#: times in a baseline, beside t = 0
SAMPLES = 20
#: wanted of new baselines: steps are coarse, for what is asked is whether a run is the same
ACCURACY = 1e-3


@dataclass(frozen=True, kw_only=True)
class Asked:
    """One comparison to be made."""

    scene: Scene
    backend: str
    resolution: Resolution
    sampling: Sampling
    tolerance: float
    source: str = ""
    baseline: Baseline | None = None

    def case(self, engine: Engine | None, *, bars: bool) -> Case:
        return Case(
            scene=self.scene,
            backend=self.backend,
            resolution=replace(self.resolution, bars=bars),
            sampling=self.sampling,
            engine=engine if self.backend in ENGINE_BACKENDS else None,
        )

    @property
    def judge(self) -> Case:
        return Case(scene=self.scene, backend=REFERENCE, resolution=Resolution(), sampling=self.sampling)


@dataclass(frozen=True, kw_only=True)
class Regression:
    """All comparisons. ``texts``: file name -> baseline, where they are to be written; ``named``: backends that were
    asked for by name."""

    comparisons: tuple[Comparison, ...]
    title: str
    texts: Mapping[str, str]
    named: tuple[str, ...] = ()

    def count(self, change: Change) -> int:
        return sum(one.change is change for one in self.comparisons)

    @property
    def exit_code(self) -> int:
        """2 a backend that was asked for by name did not run, 3 a run broke, 1 CHANGED or GONE, 0 otherwise; the first
        of these that occurs."""
        if any(one.change is Change.NOT_RUN and one.backend in self.named for one in self.comparisons):
            return 2
        if self.count(Change.BROKEN):
            return 3
        return 1 if any(one.change.fails for one in self.comparisons) else 0

    @property
    def bisect_code(self) -> int:
        """For ``git bisect run``: 1 what changed, broke or is gone, 125 what did not run and so says nothing, 0."""
        if any(one.change.fails for one in self.comparisons):
            return 1
        return 125 if self.count(Change.NOT_RUN) else 0

    def as_json(self) -> dict[str, Any]:
        return {
            "schema": SCHEMA,
            "title": self.title,
            "exit_code": self.exit_code,
            "comparisons": [one.as_json() for one in self.comparisons],
        }


def regress_scenes(
    scenes: Sequence[Scene | str | Path] = (),
    *,
    backends: Sequence[str] = (),
    folder: Path = FOLDER,
    update: bool = False,
    accuracy: float | None = None,
    dt: float | None = None,
    engine: Engine | None = None,
    jobs: int | None = None,
    progress: Progress | None = None,
) -> Regression:
    """Run again what has a baseline in ``folder``, all or only these scenes and backends; what has none is NEW.

    ``accuracy`` and ``dt`` (s): of new baselines, and with ``update`` of all; None: what the baseline has.
    ``update``: ``texts`` has what is to be written, for all that is NEW or CHANGED.
    """
    _check_backends(backends)
    asked, gone = _asked(scenes, backends, folder, accuracy, dt, update)
    if not asked and not gone:
        raise UsageError(
            f"{folder}: there are no baselines{' of what was asked for' if scenes or backends else ''};"
            " name scenes, and with --update they are made"
        )
    # bars cost runs: what is only compared has those of its baseline
    cases = [one.case(engine, bars=update or one.baseline is None or one.backend == REFERENCE) for one in asked]
    judges = [one.judge for one in asked]
    results = run_cases([*cases, *judges], jobs=jobs, progress=progress, everything=True)
    found: list[Comparison] = [*gone]
    texts: dict[str, str] = {}
    for one, result, judge in zip(asked, results[: len(asked)], results[len(asked) :], strict=True):
        run = result.trajectory
        if run is None:
            found.append(_absent(one, result))
            continue
        reference = None if one.backend == REFERENCE else judge.trajectory
        comparison = _compared(one, run, reference)
        changed = comparison.change is Change.CHANGED or (update and comparison.change is Change.NEW)
        if changed and one.backend == REFERENCE:
            reference = _second(one, run)
            comparison = _compared(one, run, reference)
        found.append(comparison)
        if update and changed:
            made = _made(one, run, reference)
            texts[made.file_name] = made.text()
    found.sort(key=lambda one: (one.scene, _place(one.backend)))
    return Regression(
        comparisons=tuple(found), title=f"{len(found)} beside their baselines", texts=texts, named=tuple(backends)
    )


def against(
    scenes: Sequence[Scene | str | Path],
    other: Engine,
    *,
    backends: Sequence[str] = (),
    folder: Path = FOLDER,
    accuracy: float | None = None,
    dt: float | None = None,
    engine: Engine | None = None,
    jobs: int | None = None,
    progress: Progress | None = None,
) -> Regression:
    """The same decks through two LAMMPS: ``other`` is what was, ``engine`` what is. Without scenes, those that have
    baselines of LAMMPS in ``folder``."""
    _check_backends(backends, ENGINE_BACKENDS)
    asked, _ = _asked(scenes, backends, folder, accuracy, dt, True)
    asked = [one for one in asked if one.backend in ENGINE_BACKENDS]
    if not asked:
        raise UsageError(f"{folder}: there are no baselines of LAMMPS; name scenes to compare two LAMMPS on")
    sides = ((other, True), (engine or Engine.chosen(), False))  # bars are those of the settings: one of them is enough
    cases = [one.case(each, bars=bars) for one in asked for each, bars in sides]
    results = run_cases([*cases, *(one.judge for one in asked)], jobs=jobs, progress=progress, everything=True)
    judges, found, versions = results[len(cases) :], [], {}
    for side in (results[: len(cases) : 2], results[1 : len(cases) : 2]):
        if isinstance(error := side[0].failure, BackendUnavailable) and not any(one.trajectory for one in side):
            raise error
    for nth, one in enumerate(asked):
        was, now = results[2 * nth], results[2 * nth + 1]
        for name, result in (("other", was), ("this", now)):
            if result.trajectory is not None:
                told = result.trajectory.provenance["lammps"]
                versions[name] = f"{told['version']} ({told['run_by']})"
        if was.trajectory is None:
            found.append(replace(_absent(one, was), sentence=f"the other LAMMPS: {was.failure}"))
            continue
        if now.trajectory is None:
            found.append(_absent(one, now))
            continue
        within = roundoff_tolerance(one.scene, one.backend, one.resolution, one.sampling, was.trajectory)
        basis = baseline_of(
            one.scene, was.trajectory, dt=one.resolution.dt, tolerance=one.tolerance, same_within=within
        )
        found.append(compare(basis, now.trajectory, reference=judges[nth].trajectory))
    title = (
        f"the same decks by LAMMPS {versions.get('other', 'that did not run')} and by {versions.get('this', 'none')}"
    )
    return Regression(comparisons=tuple(found), title=title, texts={}, named=tuple(backends))


def with_since(found: Regression, past: Mapping[str, Any], where: str) -> Regression:
    """Beside an earlier answer's JSON: what is new, fixed or still failing. UsageError where it is none."""
    if not isinstance(past, dict) or past.get("schema") != SCHEMA:
        schema = past.get("schema") if isinstance(past, dict) else None
        raise UsageError(f"{where}: schema {schema!r}; allowed: what regress --json wrote, {SCHEMA!r}")
    try:
        failed = {(one["scene"], one["backend"]): Change(one["change"]).fails for one in past["comparisons"]}
    except (KeyError, TypeError, ValueError) as error:
        raise UsageError(
            f"{where}: a part is missing or wrong ({error}); write it again with regress --json"
        ) from error
    told = []
    for one in found.comparisons:
        was, now = failed.get((one.scene, one.backend), False), one.change.fails
        since = "still failing" if was and now else "new" if now else "fixed" if was and _answered(one) else ""
        told.append(replace(one, since=since))
    return replace(found, comparisons=tuple(told))


def _answered(one: Comparison) -> bool:
    return one.change in (Change.SAME, Change.NEW)


def _check_backends(names: Sequence[str], allowed: Sequence[str] = tuple(BACKENDS)) -> None:
    for name in names:
        if name not in allowed:
            raise UsageError(f"backend = {name!r}; allowed: {', '.join(allowed)}")


def _place(name: str) -> int:
    return list(BACKENDS).index(name) if name in BACKENDS else len(BACKENDS)


def _asked(
    scenes: Sequence[Scene | str | Path],
    backends: Sequence[str],
    folder: Path,
    accuracy: float | None,
    dt: float | None,
    update: bool,
) -> tuple[list[Asked], list[Comparison]]:
    """What is to be run, and what is GONE."""
    there = [read_baseline(file) for file in sorted(folder.glob("*.json"))] if folder.is_dir() else []
    wanted = {loaded.name: (loaded, source) for loaded, source in (_loaded(one, folder) for one in scenes)}
    chosen = [one for one in there if (not scenes or one.scene in wanted) and (not backends or one.backend in backends)]
    asked, gone = [], []
    for one in chosen:
        scene, source = wanted.get(one.scene) or _again(one, folder)
        missing = f"there is no scene {one.scene}" if scene is None else ""
        if one.backend not in BACKENDS:
            missing = f"there is no backend {one.backend}"
        if missing or scene is None:
            sentence = f"{missing} any more; bring it back, or name its file, or remove {folder / one.file_name}."
            gone.append(Comparison(scene=one.scene, backend=one.backend, change=Change.GONE, sentence=sentence))
            continue
        step = dt if update and dt is not None and one.dt is not None else one.dt
        tolerance = accuracy if update and accuracy is not None else one.tolerance
        asked.append(
            Asked(
                scene=scene,
                backend=one.backend,
                resolution=Resolution(dt=step),
                sampling=one.sampling,
                tolerance=tolerance,
                source=source,
                baseline=one,
            )
        )
    have = {(one.scene, one.backend) for one in there}
    names = {one.scene: None for one in chosen} | dict.fromkeys(wanted)
    for name in names:
        scene, source = wanted.get(name) or _again(next(one for one in there if one.scene == name), folder)
        if scene is None:
            continue
        of_scene = [one for one in there if one.scene == name]
        fresh = backends or ([] if of_scene else [b for b in NEW_BACKENDS if supports_of(b).covers(scene)])
        lacking = [b for b in fresh if (name, b) not in have]
        if not lacking:
            continue
        wish = accuracy or next((one.tolerance for one in of_scene), ACCURACY)
        sampling = Sampling(count=SAMPLES)
        step = dt or next((one.dt for one in of_scene if one.dt is not None), None)
        for b in lacking:
            fixed = backend(b).order is not None
            if fixed and step is None:
                step = resolution_for(scene, wish, Resolution(), sampling).dt
            asked.append(
                Asked(
                    scene=scene,
                    backend=b,
                    resolution=Resolution(dt=step if fixed else None),
                    sampling=sampling,
                    tolerance=wish,
                    source=source,
                )
            )
    return asked, gone


def _loaded(given: Scene | str | Path, folder: Path) -> tuple[Scene, str]:
    """A scene, and where it is found again: its shipped name, or its file as seen from the baselines."""
    if isinstance(given, Scene):
        return given, given.name if given.name in shipped_scenes() else ""
    scene = load_scene(given)
    return scene, str(given) if str(given) in shipped_scenes() else os.path.relpath(given, folder)


def _again(one: Baseline, folder: Path) -> tuple[Scene | None, str]:
    source = one.birth["source"]
    if not source:
        return None, ""
    try:
        if source in shipped_scenes():
            return load_scene(source), source
        if not (folder / source).is_file():
            return None, source
        scene = load_scene(folder / source)
    except SceneError as error:
        raise SceneError("", problem=str(error), allowed="a scene as of its baseline", where=one.file_name) from error
    return (scene, source) if scene.name == one.scene else (None, source)


def _compared(one: Asked, run: Trajectory, reference: Trajectory | None) -> Comparison:
    if one.baseline is not None:
        return compare(one.baseline, run, reference=reference)
    after = judged(run, reference, one.tolerance)
    words = accuracy_words({}, after)
    return Comparison(
        scene=one.scene.name,
        backend=one.backend,
        change=Change.NEW,
        sentence=f"there is no baseline yet{f'; {words}' if words else ''}; it is made by regress --update.",
        tolerance=one.tolerance,
        after=after,
    )


def _second(one: Asked, run: Trajectory) -> Trajectory | None:
    """The other reference, for the reference; None where it was that which answered."""
    if run.provenance.get("answered_by") == SECOND:
        return None
    [result] = run_cases([replace(one.judge, backend=SECOND)], jobs=1, everything=True)
    return result.trajectory


def _absent(one: Asked, result: Result) -> Comparison:
    broken = isinstance(result.failure, RunBroken)
    return Comparison(
        scene=one.scene.name,
        backend=one.backend,
        change=Change.BROKEN if broken else Change.NOT_RUN,
        sentence=" ".join(str(result.failure).split()),
        tolerance=one.tolerance,
    )


def _made(one: Asked, run: Trajectory, reference: Trajectory | None) -> Baseline:
    return baseline_of(
        one.scene,
        run,
        dt=one.resolution.dt,
        tolerance=one.tolerance,
        same_within=roundoff_tolerance(one.scene, one.backend, one.resolution, one.sampling, run),
        accuracy=judged(run, reference, one.tolerance),
        source=one.source,
    )
