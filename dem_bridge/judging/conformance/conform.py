"""Run and grade a code, store its files, and grade stored files again without the code."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from dem_bridge.errors import OF_DAMAGED_DATA, DemBridgeError, UsageError
from dem_bridge.formats.readers import read_record
from dem_bridge.foundation.files import MOST_BYTES, check_future_report_folder, text_of_file
from dem_bridge.foundation.numbers import check_number
from dem_bridge.judging.conformance import stored
from dem_bridge.judging.conformance.answer import RECORD, SCHEMA, Conformance
from dem_bridge.judging.conformance.behaviour import Behaviour, behaviour_of
from dem_bridge.judging.conformance.grade import grade
from dem_bridge.judging.conformance.items import Item
from dem_bridge.judging.conformance.limit import Samples, samples_of
from dem_bridge.judging.conformance.properties import LargeStep
from dem_bridge.judging.conformance.running import SCENE, TIME_LIMIT_S, Function, Run, run_all
from dem_bridge.judging.conformance.scenes import SET, Probe, checked_features, frozen_probes, steps_of, unseen_probes
from dem_bridge.judging.conformance.sequence import Evidence
from dem_bridge.judging.conformance.truth import truth_of
from dem_bridge.judging.foreign import Command
from dem_bridge.lmp.process import workspace
from dem_bridge.scene.file.write import scene_json
from dem_bridge.scene.scene import Scene

#: unseen scenes of a grade
UNSEEN_SCENES = 10
#: most unseen scenes: a run each at three steps
MOST_UNSEEN_SCENES = 10_000
#: kinetic energy, relative to that at the start, above which a run is unstable
_LARGEST_ENERGY_GAIN = 2.0

Progress = Callable[[float, int, str], None]


def conform_code(
    command: str | Sequence[str] | Function,
    *,
    features: Sequence[str] | str = ("hertz",),
    scenes: int = UNSEEN_SCENES,
    seed: int = 0,
    folder: Path | None = None,
    time_limit: float = TIME_LIMIT_S,
    progress: Progress | None = None,
) -> Conformance:
    """Run a code on the frozen scenes and on ``scenes`` unseen ones, and grade it; see :func:`dem_bridge.conform`."""
    names, count, number = _settings(features, scenes, seed)
    check_number("time_limit", time_limit, "a number above 0 (s)", above=0.0)
    code = command if callable(command) else Command.of(command)
    words = code.words if isinstance(code, Command) else (getattr(code, "__name__", "a function"),)
    with ExitStack() as stack:
        if folder is None:
            home = stack.enter_context(workspace())
        else:
            check_future_report_folder(folder)
            if (folder / stored.FILES).exists():
                raise UsageError(
                    f"{folder / stored.FILES}: there are files of an earlier grade; name a new folder, or remove it"
                )
            home = folder
        runs = run_all(code, _probes(names, count, number), home, time_limit=time_limit, progress=progress)
        record = {
            "schema": SCHEMA,
            "set": SET,
            "command": list(words),
            "features": list(names),
            "seed": number,
            "scenes": count,
            "runs": [run.as_json() for run in runs],
            "files": stored.hashes_of(home),
        }
        answer = Conformance(record=record, answers=_graded(home, names, count, number, runs))
        if folder is not None:
            answer.save(folder)
    return answer


def conform_stored(folder: Path) -> Conformance:
    """Grade the stored files of a code again, without running it.

    Raises
    ------
    UsageError
        If there is no grade in the folder, or a file is not the one that was recorded.
    """
    path = folder / RECORD
    document = _document(path)
    try:
        names, count, seed = _settings(document["features"], document["scenes"], document["seed"])
        runs = [Run(**{**run, "dt": float(run["dt"])}) for run in document["runs"]]
        parts = {run.out: Path(run.out).parts for run in runs if run.out}
        outside = [out for out, words in parts.items() if ".." in words or words[0] != stored.FILES]
        before = {(item["name"], item["scene"]): item["outcome"] for item in document["items"]}
        recorded = dict(document["files"])
    except OF_DAMAGED_DATA as error:
        raise UsageError(f"{path}: is damaged ({error}); restore the file, or run the code again") from error
    if outside:
        raise UsageError(f"{path}: out = {outside[0]!r}; allowed: a file below {stored.FILES}")
    stored.check_hashes(folder, recorded)
    for probe in _probes(names, count, seed):
        scene = folder / stored.FILES / probe.scene.name / SCENE
        if scene.exists() and scene.read_text(encoding="utf-8") != scene_json(probe.scene):
            raise UsageError(f"{scene}: is not the scene of this name in this dem-bridge; run the code again")
    items = _graded(folder, names, count, seed, runs)
    changed = tuple(
        f"{item.name} ({item.scene or 'all scenes'}): recorded {was}, found {item.outcome.value}"
        for item in items
        if (was := before.get((item.name, item.scene))) != item.outcome.value
    )
    record = {key: document[key] for key in ("schema", "set", "command", "features", "seed", "scenes", "runs", "files")}
    return Conformance(record=record, answers=items, changed=changed)


def _settings(features: Sequence[str] | str, scenes: int, seed: int) -> tuple[tuple[str, ...], int, int]:
    """Return checked features, number of unseen scenes and seed."""
    allowed = f"a whole number from 0 to {MOST_UNSEEN_SCENES}"
    count = check_number("scenes", scenes, allowed, whole=True, at_least=0, at_most=MOST_UNSEEN_SCENES)
    number = check_number("seed", seed, "a whole number >= 0", whole=True, at_least=0)
    return checked_features(features), int(count), int(number)


def _document(path: Path) -> Mapping[str, Any]:
    """Return a stored record."""
    if not path.is_file():
        raise UsageError(f"{path}: there is no such file; allowed: a folder that dem-bridge conform -o has written")
    try:
        document = json.loads(text_of_file(path, MOST_BYTES))
    except ValueError as error:
        raise UsageError(f"{path}: is not JSON ({error}); restore the file, or run the code again") from None
    for key, value in (("schema", SCHEMA), ("set", SET)):
        if not isinstance(document, dict) or document.get(key) != value:
            raise UsageError(f"{path}: has another {key}; allowed: {value!r}; use the dem-bridge that wrote it")
    return dict(document)


def _probes(features: Sequence[str], count: int, seed: int) -> tuple[Probe, ...]:
    """Return the scenes that a code with these features can be asked."""
    frozen = tuple(probe for probe in frozen_probes() if probe.features <= {*features})
    return (*frozen, *unseen_probes(features, count, seed))


def _graded(folder: Path, features: Sequence[str], count: int, seed: int, runs: Sequence[Run]) -> tuple[Item, ...]:
    """Return the items of runs whose files are below a folder."""
    probes = _probes(features, count, seed)
    behaviours: dict[str, Behaviour] = {}
    problems: dict[str, str] = {}
    for probe in probes:
        own = sorted((run for run in runs if run.scene == probe.scene.name), key=lambda run: -run.dt)
        if not own:
            continue
        problem = next((f"At dt = {run.dt:.4g} s: {run.problem}" for run in own if run.problem), "")
        files = []
        for run in () if problem else own:
            try:
                files.append(_samples(folder / run.out, probe, run.dt))
            except (DemBridgeError, OSError) as error:
                problem = f"At dt = {run.dt:.4g} s: {str(error).replace(str(folder) + '/', '')}"
                break
        if problem:
            problems[probe.scene.name] = problem
        else:
            truth = truth_of(probe)
            behaviours[probe.scene.name] = behaviour_of(probe, truth, files)
    large = _large_steps(folder, probes[0], runs, behaviours) if probes else ()
    return grade(Evidence(probes, behaviours, problems, tuple(large)), features)


def _samples(path: Path, probe: Probe, dt: float) -> Samples:
    """Return the samples of a file of a code."""
    return samples_of(read_record(path, probe.scene, dt=dt), probe)


def _large_steps(
    folder: Path, probe: Probe, runs: Sequence[Run], behaviours: Mapping[str, Behaviour]
) -> list[LargeStep]:
    """Return the runs of the first scene at all steps, those at large ones included, from fine to coarse.

    The errors are those against the reference; of a code with another law those against its own limit.
    """
    behaviour = behaviours.get(probe.scene.name)
    if behaviour is None or "velocity" not in behaviour.limits:
        return []
    exact = behaviour.limits["velocity"].values
    steps = [
        _large_step(dt / probe.contact_time, file.values["velocity"][-len(exact) :], exact, probe.scene)
        for dt, file in zip(probe.steps, behaviour.files, strict=True)
    ]
    scene, _ = steps_of(probe)
    coarse = exact[-1 :: -(probe.scene.samples // scene.samples)][::-1]
    coarse = coarse[-scene.samples :]
    for run in (run for run in runs if run.scene == scene.name):
        values = np.full_like(coarse, math.inf)
        if not run.problem:
            try:
                read = _samples(folder / run.out, replace(probe, scene=scene), run.dt)
                values = read.values["velocity"][-len(coarse) :]
            except (DemBridgeError, OSError, KeyError):
                pass  # a run at a large step that has no values is unstable, which infinite values say
        steps.append(_large_step(run.dt / probe.contact_time, values, coarse, probe.scene))
    return sorted(steps, key=lambda step: step.share)


def _large_step(share: float, values: Any, exact: Any, scene: Scene) -> LargeStep:
    """Return error and stability of the velocities of one run."""
    with np.errstate(all="ignore"):
        error = float(np.max(np.abs(values - exact))) / float(np.max(np.abs(exact)))
        mass = np.array(scene.mass)
        energy = float(np.max(values**2 @ mass)) / float(np.square(scene.velocity) @ mass)
    finite = math.isfinite(error) and math.isfinite(energy)
    return LargeStep(share, error if finite else math.inf, finite and energy <= _LARGEST_ENERGY_GAIN)
