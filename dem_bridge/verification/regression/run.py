"""Run the scenes of baselines again and compare the results with the baselines, or two LAMMPS with each other.

No result is taken from the store, because the present code and engine are under test.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from dem_bridge.backends.base import BACKENDS, ENGINE_BACKENDS, Resolution, Sampling, backend, supports_of
from dem_bridge.errors import BackendUnavailable, RunBroken, SceneError, UsageError
from dem_bridge.foundation.wording import counted, summary
from dem_bridge.lmp.engine import Engine
from dem_bridge.lmp.known_defects import defects_between
from dem_bridge.runs.campaign import Jobs, Progress, Result, fingerprint_of, run_cases
from dem_bridge.runs.case import Case
from dem_bridge.runs.digits import made_at
from dem_bridge.runs.uncertainty.step_choice import step_for_accuracy
from dem_bridge.scene.file import load_scene, shipped_scenes
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import Trajectory
from dem_bridge.verification.regression.baseline import Baseline, read_baseline
from dem_bridge.verification.regression.compare import Change, Comparison, accuracy_words, assess, compare
from dem_bridge.verification.regression.provenance import baseline_of
from dem_bridge.verification.roles import assign_roles
from dem_bridge.version import schema_fault

SCHEMA = "dem-bridge/regression/1"
FOLDER = Path("reports/baselines")
#: backends of new baselines, if they support the scene
NEW_BACKENDS = ("lammps-granular", "lammps-table", "verlet", "reference")
#: backend that errors are measured against, and the slower one that the reference is compared with if it has changed
REFERENCE, SECOND = "reference", "scipy"
#: number of samples of a new baseline, t = 0 not counted
SAMPLES_OF_BASELINES = 20
#: accuracy of new baselines; coarse steps suffice to detect a change
ACCURACY_OF_BASELINES = 1e-3


@dataclass(frozen=True, kw_only=True)
class Task:
    """Hold one run to be compared, without its engine, and what it is compared with."""

    case: Case
    tolerance: float
    """Relative tolerance of the velocity error."""
    source: str
    """Name or path from which the scene is loaded again."""
    baseline: Baseline | None = None
    """Baseline to compare with; None if there is none yet."""

    @property
    def reference(self) -> Case:
        """Return the run of the reference with the same samples."""
        return replace(self.case, backend=REFERENCE, resolution=Resolution())

    def run_by(self, engine: Engine | None, *, uncertainty: bool) -> Case:
        """Return the run by an engine, with an estimate of its uncertainty if ``uncertainty`` is True."""
        in_engine = self.case.backend in ENGINE_BACKENDS
        return replace(self.case, engine=engine if in_engine else None, uncertainty=uncertainty)

    def outcome(self, change: Change, sentence: str, **details: Any) -> Comparison:
        """Return the outcome of the comparison."""
        scene, backend = self.case.scene.name, self.case.backend
        return Comparison(
            scene=scene, backend=backend, change=change, sentence=sentence, tolerance=self.tolerance, **details
        )

    def compare(self, run: Trajectory, reference: Trajectory | None) -> Comparison:
        """Return the comparison of a run with its baseline, or NEW without a baseline."""
        if self.baseline is not None:
            return compare(self.baseline, run, reference=reference)
        after = assess(run, reference, self.tolerance)
        words = accuracy_words({}, after)
        sentence = f"there is no baseline yet{f'; {words}' if words else ''}; regress --update writes it."
        return self.outcome(Change.NEW, sentence, after=after)

    def describe_failure(self, result: Result) -> Comparison:
        """Return the comparison for a run that broke or was not possible."""
        broken = isinstance(result.failure, RunBroken)
        return self.outcome(Change.BROKEN if broken else Change.NOT_RUN, " ".join(str(result.failure).split()))

    def baseline_of(self, run: Trajectory, reference: Trajectory | None = None) -> Baseline:
        """Return the baseline that a run becomes."""
        return baseline_of(self.case, run, reference, tolerance=self.tolerance, source=self.source)


@dataclass(frozen=True, kw_only=True)
class Regression:
    """Hold all comparisons of a regression and the baselines to be written."""

    comparisons: tuple[Comparison, ...]
    title: str
    texts: Mapping[str, str]
    """Texts of the baselines to be written, by file name."""
    required_backends: tuple[str, ...] = ()
    """Backends that were requested by name; if one does not run, the exit code is 2."""

    def __str__(self) -> str:
        """Return at most 15 lines: the comparisons that are not SAME, and the number by outcome."""
        changed = [each for each in self.comparisons if each.change is not Change.SAME]
        lines = (f"{each.change.value} {each.scene} {each.backend}: {each.sentence}" for each in changed)
        return summary(lines, [counted(each.change.value for each in self.comparisons)], title=self.title)

    __repr__ = __str__

    def count(self, change: Change) -> int:
        """Return the number of comparisons with an outcome."""
        return sum(comparison.change is change for comparison in self.comparisons)

    @property
    def fails(self) -> bool:
        """Return True if an outcome is a failure."""
        return any(comparison.change.fails for comparison in self.comparisons)

    @property
    def exit_code(self) -> int:
        """Return the exit code of the command line.

        It is the first that applies of 2 (a backend requested by name did not run), 3 (a run broke), 1 (CHANGED or
        GONE) and 0.
        """
        not_run = {comparison.backend for comparison in self.comparisons if comparison.change is Change.NOT_RUN}
        if not_run & {*self.required_backends}:
            return 2
        return 3 if self.count(Change.BROKEN) else int(self.fails)

    @property
    def bisect_code(self) -> int:
        """Return the exit code for ``git bisect run``: 1 failure, 125 a backend did not run, 0 otherwise."""
        return 1 if self.fails else 125 if self.count(Change.NOT_RUN) else 0

    def as_json(self) -> dict[str, Any]:
        """Return the regression as a JSON document of the schema :data:`SCHEMA`."""
        return {
            "schema": SCHEMA,
            "title": self.title,
            "exit_code": self.exit_code,
            "comparisons": [comparison.as_json() for comparison in self.comparisons],
        }


@dataclass(frozen=True, kw_only=True)
class Selection:
    """Select the runs to compare: those of the baselines in a folder, and new ones."""

    scenes: Sequence[Scene | str | Path] = ()
    """Scenes to compare; the default is all with baselines."""
    backends: Sequence[str] = ()
    """Backends to compare; the default is all with baselines."""
    folder: Path = FOLDER
    accuracy: float | None = None
    """Relative accuracy of the velocities in new baselines, and with ``update`` in all."""
    dt: float | None = None
    """Upper bound of the time step, s, of new baselines, and with ``update`` of all."""
    update: bool = False

    def tasks(self) -> tuple[list[Task], list[Comparison]]:
        """Return the comparisons to make, and the comparisons of baselines that are GONE."""
        files = sorted(self.folder.glob("*.json")) if self.folder.is_dir() else []
        existing = [read_baseline(file) for file in files]
        requested = {scene.name: (scene, source) for scene, source in map(self._load, self.scenes)}
        selected = [
            baseline
            for baseline in existing
            if (not self.scenes or baseline.scene in requested)
            and (not self.backends or baseline.backend in self.backends)
        ]
        tasks, gone = [], []
        for baseline in selected:
            scene, source = requested.get(baseline.scene) or self._reload(baseline)
            missing = f"the scene {baseline.scene} no longer exists" if scene is None else ""
            if baseline.backend not in BACKENDS:
                missing = f"the backend {baseline.backend} no longer exists"
            if missing or scene is None:
                sentence = f"{missing}; restore it, or name its file, or remove {self.folder / baseline.file_name}."
                gone.append(
                    Comparison(scene=baseline.scene, backend=baseline.backend, change=Change.GONE, sentence=sentence)
                )
                continue
            changed = self if self.update else Selection()
            step = baseline.dt if baseline.dt is None or changed.dt is None else changed.dt
            resolution, tolerance = Resolution(dt=step), changed.accuracy or baseline.tolerance
            case = Case(scene=scene, backend=baseline.backend, resolution=resolution, sampling=baseline.sampling)
            tasks.append(Task(case=case, tolerance=tolerance, source=source, baseline=baseline))
        for name in {baseline.scene: None for baseline in selected} | dict.fromkeys(requested):
            of_scene = [baseline for baseline in existing if baseline.scene == name]
            scene, source = requested.get(name) or self._reload(of_scene[0])
            if scene is not None:
                tasks += self._new_tasks(scene, source, of_scene)
        return tasks, gone

    def _new_tasks(self, scene: Scene, source: str, existing: Sequence[Baseline]) -> list[Task]:
        """Return the comparisons of a scene for backends without a baseline, with settings of existing baselines."""
        default = [] if existing else [name for name in NEW_BACKENDS if supports_of(name).covers(scene)]
        tolerance = self.accuracy or next((baseline.tolerance for baseline in existing), ACCURACY_OF_BASELINES)
        step = self.dt or next((baseline.dt for baseline in existing if baseline.dt is not None), None)
        sampling, tasks = Sampling(count=SAMPLES_OF_BASELINES), []
        for name in self.backends or default:
            if name in {baseline.backend for baseline in existing}:
                continue
            fixed = backend(name).order is not None
            if fixed and step is None:
                step = step_for_accuracy(scene, tolerance, Resolution(), sampling).dt
            resolution = Resolution(dt=step if fixed else None)
            case = Case(scene=scene, backend=name, resolution=resolution, sampling=sampling)
            tasks.append(Task(case=case, tolerance=tolerance, source=source))
        return tasks

    def _load(self, scene: Scene | str | Path) -> tuple[Scene, str]:
        """Return a scene and its source: the name of a shipped scene, or the path relative to the baselines."""
        if isinstance(scene, Scene):
            return scene, scene.name if scene.name in shipped_scenes("all") else ""
        shipped = str(scene) in shipped_scenes("all")
        return load_scene(scene), str(scene) if shipped else os.path.relpath(scene, self.folder)

    def _reload(self, baseline: Baseline) -> tuple[Scene | None, str]:
        """Return the scene of a baseline and its source; None if the scene no longer exists."""
        source = baseline.provenance["source"]
        shipped = source in shipped_scenes("all")
        if not source or not (shipped or (self.folder / source).is_file()):
            return None, source
        try:
            scene = load_scene(source if shipped else self.folder / source)
        except SceneError as error:
            allowed = "the scene of the baseline"
            raise SceneError("", problem=str(error), allowed=allowed, where=baseline.file_name) from error
        return (scene, source) if shipped or scene.name == baseline.scene else (None, source)


def _check_backends(names: Sequence[str], allowed: Sequence[str]) -> None:
    """Raise UsageError unless all names of backends are allowed."""
    for name in names:
        if name not in allowed:
            raise UsageError(f"backend = {name!r}; allowed: {', '.join(allowed)}")


def regress_scenes(
    selection: Selection, *, engine: Engine | None = None, jobs: Jobs = None, progress: Progress | None = None
) -> Regression:
    """Run the selected scenes again and compare them with their baselines; a scene without a baseline is NEW.

    With ``update``, ``texts`` of the result has the baselines to write for all that is NEW or CHANGED.
    """
    _check_backends(selection.backends, list(BACKENDS))
    tasks, comparisons = selection.tasks()
    if not tasks and not comparisons:
        chosen = " of these scenes and backends" if selection.scenes or selection.backends else ""
        raise UsageError(
            f"{selection.folder}: the folder has no baselines{chosen}; write some: name scenes and add --update"
        )
    # an uncertainty costs runs; a run that is only compared has the uncertainty of its baseline
    cases = [
        task.run_by(engine, uncertainty=selection.update or task.baseline is None or task.case.backend == REFERENCE)
        for task in tasks
    ]
    cases += [task.reference for task in tasks]
    results = run_cases(cases, jobs=jobs, progress=progress, everything=True)
    texts: dict[str, str] = {}
    place = fingerprint_of(jobs) if isinstance(jobs, Executor) else ""
    for task, result, answer in zip(tasks, results[: len(tasks)], results[len(tasks) :], strict=True):
        run = result.trajectory
        if run is None:
            comparisons.append(task.describe_failure(result))
            continue
        is_reference = task.case.backend == REFERENCE
        reference = None if is_reference else answer.trajectory
        with made_at(place):
            comparison = task.compare(run, reference)
        changed = comparison.change is Change.CHANGED or (selection.update and comparison.change is Change.NEW)
        if changed and is_reference and assign_roles(task.case.scene).solver != SECOND:
            [second] = run_cases([replace(task.reference, backend=SECOND)], jobs=1, everything=True)
            reference = second.trajectory
            with made_at(place):
                comparison = task.compare(run, reference)
        comparisons.append(comparison)
        if selection.update and changed:
            with made_at(place):
                baseline = task.baseline_of(run, reference)
            texts[baseline.file_name] = baseline.text()
    # in the order of the backends; one that no longer exists is last
    comparisons.sort(key=lambda entry: (entry.scene, [*BACKENDS, entry.backend].index(entry.backend)))
    title = f"{len(comparisons)} comparisons with baselines"
    return Regression(
        comparisons=tuple(comparisons), title=title, texts=texts, required_backends=tuple(selection.backends)
    )


def compare_engines(
    selection: Selection,
    other: Engine,
    *,
    engine: Engine | None = None,
    jobs: Jobs = None,
    progress: Progress | None = None,
) -> Regression:
    """Run the same decks with two LAMMPS and compare the results of ``engine`` with those of ``other``.

    Without scenes, the decks are those of the LAMMPS baselines in the folder.
    """
    _check_backends(selection.backends, ENGINE_BACKENDS)
    tasks = [task for task in replace(selection, update=True).tasks()[0] if task.case.backend in ENGINE_BACKENDS]
    if not tasks:
        raise UsageError(
            f"{selection.folder}: the folder has no baselines of LAMMPS; name the scenes on which to compare"
        )
    # the uncertainty follows from the settings, which both sides share, so one side estimates it
    sides = ((other, True), (engine or Engine.chosen(), False))
    cases = [task.run_by(each, uncertainty=estimated) for each, estimated in sides for task in tasks]
    cases += [task.reference for task in tasks]
    results = run_cases(cases, jobs=jobs, progress=progress, everything=True)
    old, new, references = (results[k : k + len(tasks)] for k in range(0, len(results), len(tasks)))
    versions, releases, comparisons = [], [], []
    for side in (old, new):
        runs = [result.trajectory for result in side if result.trajectory is not None]
        if not runs and isinstance(error := side[0].failure, BackendUnavailable):
            raise error
        lammps = runs[-1].provenance["lammps"] if runs else None
        versions.append(f"{lammps['version']} ({lammps['run_by']})" if lammps else "(not run)")
        releases += [lammps["version"]] if lammps else []
    for task, was, now, reference in zip(tasks, old, new, references, strict=True):
        if was.trajectory is None:
            comparisons.append(replace(task.describe_failure(was), sentence=f"the other LAMMPS: {was.failure}"))
        elif now.trajectory is None:
            comparisons.append(task.describe_failure(now))
        else:
            baseline = task.baseline_of(was.trajectory)
            comparisons.append(compare(baseline, now.trajectory, reference=reference.trajectory))
    title = f"the same decks with LAMMPS {versions[0]} and LAMMPS {versions[1]}"
    if len(releases) == 2 and (defects := defects_between(*releases)):
        title += f"; known defects {defects}"
    return Regression(
        comparisons=tuple(comparisons), title=title, texts={}, required_backends=tuple(selection.backends)
    )


def with_since(regression: Regression, past: Mapping[str, Any], where: str) -> Regression:
    """Return the regression with the changes of outcomes since an earlier one.

    ``past`` is the JSON document of the earlier regression and ``where`` names it in messages. Raises UsageError if it
    is not such a document.
    """
    if not isinstance(past, dict) or past.get("schema") != SCHEMA:
        schema = past.get("schema") if isinstance(past, dict) else None
        raise UsageError(f"{where}: {schema_fault(schema, SCHEMA)}; write such a file with regress --json")
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
