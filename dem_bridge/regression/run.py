"""Run the scenes of baselines again and compare the results with the baselines, or two LAMMPS with each other.

No result is taken from the store, because the present code and engine are under test.
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
from dem_bridge.regression.baseline import Baseline, read_baseline
from dem_bridge.regression.compare import Change, Comparison, accuracy_words, assess, compare
from dem_bridge.regression.provenance import baseline_of, roundoff_tolerance
from dem_bridge.runs.case import Case
from dem_bridge.scene import Scene
from dem_bridge.scene_file import load_scene, shipped_scenes
from dem_bridge.trajectory import Trajectory
from dem_bridge.uncertainty.step_choice import step_for_accuracy

SCHEMA = "dem-bridge/regression/1"
FOLDER = Path("reports/baselines")
#: backends of new baselines, if they support the scene
NEW_BACKENDS = ("lammps-granular", "lammps-table", "verlet", "reference")
#: backend that errors are measured against, and the slower one that the reference is compared with if it has changed
REFERENCE, SECOND = "reference", "scipy"
#: number of samples of a new baseline, t = 0 not counted
SAMPLES = 20
#: accuracy of new baselines; coarse steps suffice to detect a change
ACCURACY = 1e-3


@dataclass(frozen=True, kw_only=True)
class Task:
    """Hold the settings of one comparison."""

    scene: Scene
    backend: str
    resolution: Resolution
    sampling: Sampling
    tolerance: float
    """Relative tolerance of the velocity error."""
    source: str = ""
    """Name or path from which the scene is loaded again."""
    baseline: Baseline | None = None
    """Baseline to compare with; None if there is none yet."""

    def case(self, engine: Engine | None, *, uncertainty: bool) -> Case:
        """Return the run of the scene, with an estimate of its uncertainty if ``uncertainty`` is True."""
        return Case(
            scene=self.scene,
            backend=self.backend,
            resolution=self.resolution,
            sampling=self.sampling,
            engine=engine if self.backend in ENGINE_BACKENDS else None,
            uncertainty=uncertainty,
        )

    @property
    def reference(self) -> Case:
        """Return the run of the reference with the same samples."""
        return Case(scene=self.scene, backend=REFERENCE, resolution=Resolution(), sampling=self.sampling)


@dataclass(frozen=True, kw_only=True)
class Regression:
    """Hold all comparisons of a regression and the baselines to be written."""

    comparisons: tuple[Comparison, ...]
    title: str
    texts: Mapping[str, str]
    """Texts of the baselines to be written, by file name."""
    required_backends: tuple[str, ...] = ()
    """Backends that were requested by name; if one does not run, the exit code is 2."""

    def count(self, change: Change) -> int:
        """Return the number of comparisons with an outcome."""
        return sum(comparison.change is change for comparison in self.comparisons)

    @property
    def exit_code(self) -> int:
        """Return the exit code of the command line.

        It is the first that applies of 2 (a backend requested by name did not run), 3 (a run broke), 1 (CHANGED or
        GONE) and 0.
        """
        if any(
            comparison.change is Change.NOT_RUN and comparison.backend in self.required_backends
            for comparison in self.comparisons
        ):
            return 2
        if self.count(Change.BROKEN):
            return 3
        return 1 if any(comparison.change.fails for comparison in self.comparisons) else 0

    @property
    def bisect_code(self) -> int:
        """Return the exit code for ``git bisect run``: 1 failure, 125 a backend did not run, 0 otherwise."""
        if any(comparison.change.fails for comparison in self.comparisons):
            return 1
        return 125 if self.count(Change.NOT_RUN) else 0

    def as_json(self) -> dict[str, Any]:
        """Return the regression as a JSON document of the schema :data:`SCHEMA`."""
        return {
            "schema": SCHEMA,
            "title": self.title,
            "exit_code": self.exit_code,
            "comparisons": [comparison.as_json() for comparison in self.comparisons],
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
    """Run the scenes of the baselines in ``folder`` again and compare; a scene without a baseline is NEW.

    ``scenes`` and ``backends`` select baselines; the default is all. ``accuracy`` and ``dt`` (s) are those of new
    baselines, and with ``update`` of all; None keeps those of a baseline. With ``update``, ``texts`` of the result has
    the baselines to write for all that is NEW or CHANGED.
    """
    _check_backends(backends)
    tasks, gone = _tasks(scenes, backends, folder, accuracy, dt, update)
    if not tasks and not gone:
        selection = " of these scenes and backends" if scenes or backends else ""
        raise UsageError(f"{folder}: the folder has no baselines{selection}; write some: name scenes and add --update")
    # an uncertainty costs runs; a run that is only compared has the uncertainty of its baseline
    cases = [
        task.case(engine, uncertainty=update or task.baseline is None or task.backend == REFERENCE) for task in tasks
    ]
    references = [task.reference for task in tasks]
    results = run_cases([*cases, *references], jobs=jobs, progress=progress, everything=True)
    comparisons: list[Comparison] = [*gone]
    texts: dict[str, str] = {}
    for task, result, answer in zip(tasks, results[: len(tasks)], results[len(tasks) :], strict=True):
        run = result.trajectory
        if run is None:
            comparisons.append(_without_run(task, result))
            continue
        reference = None if task.backend == REFERENCE else answer.trajectory
        comparison = _compare(task, run, reference)
        changed = comparison.change is Change.CHANGED or (update and comparison.change is Change.NEW)
        if changed and task.backend == REFERENCE:
            reference = _second_reference(task, run)
            comparison = _compare(task, run, reference)
        comparisons.append(comparison)
        if update and changed:
            baseline = _new_baseline(task, run, reference)
            texts[baseline.file_name] = baseline.text()
    comparisons.sort(key=lambda comparison: (comparison.scene, _rank(comparison.backend)))
    return Regression(
        comparisons=tuple(comparisons),
        title=f"{len(comparisons)} comparisons with baselines",
        texts=texts,
        required_backends=tuple(backends),
    )


def compare_engines(
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
    """Run the same decks with two LAMMPS and compare the results of ``engine`` with those of ``other``.

    Without scenes, the decks are those of the LAMMPS baselines in ``folder``.
    """
    _check_backends(backends, ENGINE_BACKENDS)
    tasks, _ = _tasks(scenes, backends, folder, accuracy, dt, True)
    tasks = [task for task in tasks if task.backend in ENGINE_BACKENDS]
    if not tasks:
        raise UsageError(f"{folder}: the folder has no baselines of LAMMPS; name the scenes on which to compare")
    # the uncertainty follows from the settings, which both sides share, so one side estimates it
    sides = ((other, True), (engine or Engine.chosen(), False))
    cases = [task.case(each, uncertainty=estimated) for task in tasks for each, estimated in sides]
    results = run_cases([*cases, *(task.reference for task in tasks)], jobs=jobs, progress=progress, everything=True)
    references, comparisons, versions = results[len(cases) :], [], {}
    for side in (results[: len(cases) : 2], results[1 : len(cases) : 2]):
        if isinstance(error := side[0].failure, BackendUnavailable) and not any(result.trajectory for result in side):
            raise error
    for nth, task in enumerate(tasks):
        was, now = results[2 * nth], results[2 * nth + 1]
        for name, result in (("other", was), ("this", now)):
            if result.trajectory is not None:
                lammps = result.trajectory.provenance["lammps"]
                versions[name] = f"{lammps['version']} ({lammps['run_by']})"
        if was.trajectory is None:
            comparisons.append(replace(_without_run(task, was), sentence=f"the other LAMMPS: {was.failure}"))
            continue
        if now.trajectory is None:
            comparisons.append(_without_run(task, now))
            continue
        tolerances = roundoff_tolerance(task.scene, task.backend, task.resolution, task.sampling, was.trajectory)
        baseline = baseline_of(
            task.scene, was.trajectory, dt=task.resolution.dt, tolerance=task.tolerance, same_within=tolerances
        )
        comparisons.append(compare(baseline, now.trajectory, reference=references[nth].trajectory))
    names = [versions.get(side, "(not run)") for side in ("other", "this")]
    title = f"the same decks with LAMMPS {names[0]} and LAMMPS {names[1]}"
    return Regression(comparisons=tuple(comparisons), title=title, texts={}, required_backends=tuple(backends))


def with_since(regression: Regression, past: Mapping[str, Any], where: str) -> Regression:
    """Return the regression with the changes of outcomes since an earlier one.

    ``past`` is the JSON document of the earlier regression and ``where`` names it in messages. Raises UsageError if it
    is not such a document.
    """
    if not isinstance(past, dict) or past.get("schema") != SCHEMA:
        schema = past.get("schema") if isinstance(past, dict) else None
        raise UsageError(f"{where}: schema = {schema!r}; allowed: {SCHEMA!r}, as written by regress --json")
    try:
        failed = {(entry["scene"], entry["backend"]): Change(entry["change"]).fails for entry in past["comparisons"]}
    except (KeyError, TypeError, ValueError) as error:
        raise UsageError(
            f"{where}: an entry is missing or wrong ({error}); write the file again with regress --json"
        ) from error
    comparisons = []
    for comparison in regression.comparisons:
        was, now = failed.get((comparison.scene, comparison.backend), False), comparison.change.fails
        good = comparison.change in (Change.SAME, Change.NEW)
        since = "still failing" if was and now else "new" if now else "fixed" if was and good else ""
        comparisons.append(replace(comparison, since=since))
    return replace(regression, comparisons=tuple(comparisons))


def _check_backends(names: Sequence[str], allowed: Sequence[str] = tuple(BACKENDS)) -> None:
    """Raise UsageError unless all names of backends are allowed."""
    for name in names:
        if name not in allowed:
            raise UsageError(f"backend = {name!r}; allowed: {', '.join(allowed)}")


def _rank(name: str) -> int:
    """Return the place of a backend in lists."""
    return list(BACKENDS).index(name) if name in BACKENDS else len(BACKENDS)


def _tasks(
    scenes: Sequence[Scene | str | Path],
    backends: Sequence[str],
    folder: Path,
    accuracy: float | None,
    dt: float | None,
    update: bool,
) -> tuple[list[Task], list[Comparison]]:
    """Return the comparisons to make, and the comparisons of baselines that are GONE."""
    existing = [read_baseline(file) for file in sorted(folder.glob("*.json"))] if folder.is_dir() else []
    requested = {loaded.name: (loaded, source) for loaded, source in (_load(scene, folder) for scene in scenes)}
    selected = [
        baseline
        for baseline in existing
        if (not scenes or baseline.scene in requested) and (not backends or baseline.backend in backends)
    ]
    tasks, gone = [], []
    for baseline in selected:
        scene, source = requested.get(baseline.scene) or _reload(baseline, folder)
        missing = f"the scene {baseline.scene} no longer exists" if scene is None else ""
        if baseline.backend not in BACKENDS:
            missing = f"the backend {baseline.backend} no longer exists"
        if missing or scene is None:
            sentence = f"{missing}; restore it, or name its file, or remove {folder / baseline.file_name}."
            gone.append(
                Comparison(scene=baseline.scene, backend=baseline.backend, change=Change.GONE, sentence=sentence)
            )
            continue
        step = dt if update and dt is not None and baseline.dt is not None else baseline.dt
        tasks.append(
            Task(
                scene=scene,
                backend=baseline.backend,
                resolution=Resolution(dt=step),
                sampling=baseline.sampling,
                tolerance=accuracy if update and accuracy is not None else baseline.tolerance,
                source=source,
                baseline=baseline,
            )
        )
    names = {baseline.scene: None for baseline in selected} | dict.fromkeys(requested)
    for name in names:
        of_scene = [baseline for baseline in existing if baseline.scene == name]
        scene, source = requested.get(name) or _reload(of_scene[0], folder)
        if scene is not None:
            tasks += _new_tasks(scene, source, of_scene, backends, accuracy, dt)
    return tasks, gone


def _new_tasks(
    scene: Scene,
    source: str,
    existing: Sequence[Baseline],
    backends: Sequence[str],
    accuracy: float | None,
    dt: float | None,
) -> list[Task]:
    """Return the comparisons of a scene for backends without a baseline, with the settings of existing baselines."""
    names = backends or ([] if existing else [name for name in NEW_BACKENDS if supports_of(name).covers(scene)])
    tolerance = accuracy or next((baseline.tolerance for baseline in existing), ACCURACY)
    step = dt or next((baseline.dt for baseline in existing if baseline.dt is not None), None)
    sampling, tasks = Sampling(count=SAMPLES), []
    for name in names:
        if name in {baseline.backend for baseline in existing}:
            continue
        fixed = backend(name).order is not None
        if fixed and step is None:
            step = step_for_accuracy(scene, tolerance, Resolution(), sampling).dt
        tasks.append(
            Task(
                scene=scene,
                backend=name,
                resolution=Resolution(dt=step if fixed else None),
                sampling=sampling,
                tolerance=tolerance,
                source=source,
            )
        )
    return tasks


def _load(scene: Scene | str | Path, folder: Path) -> tuple[Scene, str]:
    """Return a scene and its source: the name of a shipped scene, or the path relative to the baselines."""
    if isinstance(scene, Scene):
        return scene, scene.name if scene.name in shipped_scenes() else ""
    loaded = load_scene(scene)
    return loaded, str(scene) if str(scene) in shipped_scenes() else os.path.relpath(scene, folder)


def _reload(baseline: Baseline, folder: Path) -> tuple[Scene | None, str]:
    """Return the scene of a baseline and its source; None if the scene no longer exists."""
    source = baseline.provenance["source"]
    if not source:
        return None, ""
    try:
        if source in shipped_scenes():
            return load_scene(source), source
        if not (folder / source).is_file():
            return None, source
        scene = load_scene(folder / source)
    except SceneError as error:
        allowed = "the scene of the baseline"
        raise SceneError("", problem=str(error), allowed=allowed, where=baseline.file_name) from error
    return (scene, source) if scene.name == baseline.scene else (None, source)


def _compare(task: Task, run: Trajectory, reference: Trajectory | None) -> Comparison:
    """Return the comparison of a run with its baseline, or NEW without a baseline."""
    if task.baseline is not None:
        return compare(task.baseline, run, reference=reference)
    after = assess(run, reference, task.tolerance)
    words = accuracy_words({}, after)
    return Comparison(
        scene=task.scene.name,
        backend=task.backend,
        change=Change.NEW,
        sentence=f"there is no baseline yet{f'; {words}' if words else ''}; regress --update writes it.",
        tolerance=task.tolerance,
        after=after,
    )


def _second_reference(task: Task, run: Trajectory) -> Trajectory | None:
    """Return the run of the second reference; None if the reference itself used that integrator."""
    if run.provenance.get("answered_by") == SECOND:
        return None
    [result] = run_cases([replace(task.reference, backend=SECOND)], jobs=1, everything=True)
    return result.trajectory


def _without_run(task: Task, result: Result) -> Comparison:
    """Return the comparison for a run that broke or was not possible."""
    broken = isinstance(result.failure, RunBroken)
    return Comparison(
        scene=task.scene.name,
        backend=task.backend,
        change=Change.BROKEN if broken else Change.NOT_RUN,
        sentence=" ".join(str(result.failure).split()),
        tolerance=task.tolerance,
    )


def _new_baseline(task: Task, run: Trajectory, reference: Trajectory | None) -> Baseline:
    """Return the baseline that a run becomes."""
    return baseline_of(
        task.scene,
        run,
        dt=task.resolution.dt,
        tolerance=task.tolerance,
        same_within=roundoff_tolerance(task.scene, task.backend, task.resolution, task.sampling, run),
        accuracy=assess(run, reference, task.tolerance),
        source=task.source,
    )
