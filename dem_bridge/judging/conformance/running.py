"""The runs of a code on the scenes, each with a time limit; a run that fails costs its scene only."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dem_bridge.errors import DemBridgeError, RunBroken, one_line
from dem_bridge.foundation.files import MOST_BYTES
from dem_bridge.judging.conformance.scenes import Probe, steps_of
from dem_bridge.judging.foreign import Command, OutOfTime, foreign_runs
from dem_bridge.scene.file.write import scene_json
from dem_bridge.scene.scene import Scene

#: time limit of a run, s: the scenes have at most some 10,000 steps of at most six bodies
TIME_LIMIT_S = 60.0
#: file of a scene beside the files of a code
SCENE = "scene.json"
#: scenes in a row that do not end in time, after which no further one is run
MOST_HANGING_SCENES = 3
#: a function in place of a command: it writes the samples of a scene at a time step (s) into a file
Function = Callable[[Scene, float, Path], object]


@dataclass(frozen=True, kw_only=True)
class Run:
    """One run of the code under test."""

    scene: str
    dt: float
    """Time step, s."""
    out: str = ""
    """File, folder or pattern of files of the samples, relative to the folder of all; '' if the run failed."""
    problem: str = ""
    """Why the run failed, in a sentence; '' if it did not."""
    cpu: float = 0.0
    """CPU time of the process, s."""

    def as_json(self) -> dict[str, Any]:
        """Return the fields."""
        return {"scene": self.scene, "dt": self.dt, "out": self.out, "problem": self.problem, "cpu": self.cpu}


def run_all(
    code: Command | Function,
    probes: Sequence[Probe],
    folder: Path,
    *,
    time_limit: float = TIME_LIMIT_S,
    progress: Callable[[float, int, str], None] | None = None,
) -> list[Run]:
    """Run a code on all scenes at their time steps, and on the first one at large steps, into ``folder``.

    The files of a scene are in ``files/SCENE/NUMBER``. After a run that fails, the further steps of its scene are
    left out, so that a code that hangs takes at most the time limit for each scene, and three times that in all.
    """
    runs: list[Run] = []
    total = len(probes) + 1
    hanging = 0
    for number, probe in enumerate(probes):
        if hanging == MOST_HANGING_SCENES:
            return runs
        if progress is not None:
            progress(number, total, f"{probe.scene.name} at {len(probe.steps)} steps")
        of_scene, in_time = _scene_runs(code, probe.scene, probe.steps, folder, time_limit, go_on=False)
        runs += of_scene
        hanging = 0 if in_time else hanging + 1
    if probes and probes[0].frozen and all(not run.problem for run in runs if run.scene == probes[0].scene.name):
        scene, counts = steps_of(probes[0])
        if progress is not None:
            progress(len(probes), total, "the largest step")
        interval = scene.duration / scene.samples
        # from fine to coarse: a code that hangs at a large step is not run at larger ones
        steps = [interval / count for count in reversed(counts)]
        runs += _scene_runs(code, scene, steps, folder, time_limit, go_on=True)[0]
    return runs


def _scene_runs(
    code: Command | Function, scene: Scene, steps: Sequence[float], folder: Path, time_limit: float, *, go_on: bool
) -> tuple[list[Run], bool]:
    """Run a code on one scene at several steps, and tell whether all runs ended in time.

    ``go_on``: also after a run that failed within the time limit.
    """
    home = folder / "files" / scene.name
    home.mkdir(parents=True)
    (home / SCENE).write_text(scene_json(scene), encoding="utf-8")
    runs = []
    for number, dt in enumerate(steps, start=1):
        place = home / str(number)
        place.mkdir()
        try:
            out, cpu = _run(code, scene, dt, place, time_limit)
            runs.append(Run(scene=scene.name, dt=dt, out=str(out.relative_to(folder)), cpu=cpu))
        except RunBroken as error:
            runs.append(Run(scene=scene.name, dt=dt, problem=str(error)))
            if isinstance(error, OutOfTime):
                return runs, False
            if not go_on:
                break
    return runs, True


def _run(code: Command | Function, scene: Scene, dt: float, place: Path, time_limit: float) -> tuple[Path, float]:
    """Run a code once; return its output, which is kept in ``place``, and its CPU time, s."""
    if not isinstance(code, Command):
        out = place / "out.csv"
        try:
            code(scene, dt, out)
        except Exception as error:  # a fault of the code under test is an outcome
            raise RunBroken(one_line(f"the function raised {type(error).__name__}: {error}")) from error
        if not out.exists():
            raise RunBroken(f"the function wrote no file {out.name}")
        return out, 0.0
    try:
        with foreign_runs(code, scene, [dt], time_limit=time_limit) as (run,):
            return _kept(run.out, place), run.cpu
    except RunBroken:
        raise
    except (DemBridgeError, OSError) as error:
        raise RunBroken(f"{code.name} could not be run: {error}") from error


def _kept(out: Path, place: Path) -> Path:
    """Copy an output, a file, a folder or a pattern of files, and return its copy."""
    sources = [out] if out.exists() else sorted(out.parent.glob(out.name))
    files = [file for source in sources for file in ([source] if source.is_file() else source.rglob("*"))]
    if sum(file.lstat().st_size for file in files) > MOST_BYTES:
        raise RunBroken(f"the output has more than {MOST_BYTES >> 20} MiB; write the samples of the scene only")
    if any(not file.is_file() or file.is_symlink() for file in files if not file.is_dir()):
        raise RunBroken("the output is not a regular file; write the samples into a file")
    for source in sources:
        if source.is_dir():
            shutil.copytree(source, place / source.name)
        else:
            shutil.copyfile(source, place / source.name)
    return place / out.name
