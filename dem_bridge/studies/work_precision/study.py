"""Work-precision: the error of every backend and each of its knobs against what it costs.

All runs are timed in one process, one at a time, warm and repeated, with error bars off. Errors are against the
reference, and those below its bar are not known. A run over its limit is NaN and keeps its row.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from dem_bridge.backends.base import Resolution, Sampling
from dem_bridge.backends.tabled import prescan_scene
from dem_bridge.campaign import Progress, run_cases
from dem_bridge.errors import RunBroken, UsageError
from dem_bridge.lmp.engine import Engine
from dem_bridge.runs.case import Case
from dem_bridge.runs.store import Store
from dem_bridge.scene import Scene
from dem_bridge.studies.study import Study
from dem_bridge.studies.work_precision.curves import curves
from dem_bridge.studies.work_precision.runs import REFERENCE, Measured, Point, measured, readings_of, uncertainties_of
from dem_bridge.studies.work_precision.shown import shown

#: s of wall time that one run may take
LIMIT = 5.0
REPEATS = 3


def study_work_precision(
    scene: Scene,
    *,
    engine: Engine | None = None,
    jobs: int | None = None,
    progress: Progress | None = None,
    store: Store | None = None,
    limit: float = LIMIT,
    repeats: int = REPEATS,
    backends: Sequence[str] | None = None,
) -> Study:
    """Measure the error of every backend against its cost, for each of its numerical settings.

    Timed runs are made one at a time; ``jobs`` is for the reference alone. Ctrl-C keeps what was finished.

    Parameters
    ----------
    scene : Scene
        Scene to be solved.
    limit : float
        Longest wall time of one run, s.
    repeats : int
        Largest number of timed calls of each setting; long runs are called fewer times.
    backends : sequence of str, optional
        Names of the backends. None: all.
    engine, jobs, progress, store : as in :func:`dem_bridge.study`

    Returns
    -------
    Study

    Raises
    ------
    UsageError
        For a setting out of its range.
    RunBroken
        If the reference has no run.
    """
    if isinstance(limit, bool) or not isinstance(limit, int | float) or not 0.0 < limit < math.inf:
        raise UsageError(f"limit = {limit!r}; allowed: a number of seconds > 0")
    if isinstance(repeats, bool) or not isinstance(repeats, int) or not 1 <= repeats <= 1000:
        raise UsageError(f"repeats = {repeats!r}; allowed: a whole number from 1 to 1000")
    sampling = Sampling(count=scene.samples)
    if progress is not None:
        progress(0.0, 1, f"{scene.name}: {REFERENCE}")
    case = Case(scene=scene, backend=REFERENCE, resolution=Resolution(), sampling=sampling)
    (truth,) = run_cases([case], jobs=jobs, store=store)
    if truth.trajectory is None:
        raise RunBroken(f"{scene.name}: without a run of the reference nothing has an error ({truth.failure})")
    requested, notes = curves(scene, sampling, prescan_scene(scene), engine, backends)
    reference = readings_of(scene, truth.trajectory)
    points: list[Point] = []
    interrupted = False
    try:
        for point in measured(requested, scene, sampling, reference, limit=limit, repeats=repeats, progress=progress):
            points.append(point)
    except KeyboardInterrupt:
        interrupted = True
    if progress is not None:
        progress(1.0, 1, "")
    result = Measured(
        scene=scene,
        sampling=sampling,
        limit=limit,
        points=tuple(points),
        uncertainty=uncertainties_of(reference),
        provenance={key: truth.trajectory.provenance[key] for key in ("scene_hash", "versions", "machine")},
    )
    return shown(result, notes=notes, interrupted=interrupted)
