"""Work-precision: the error of every backend and each of its knobs against what it costs.

All runs are timed in one process, one at a time, warm and repeated, with error bars off. Errors are against the
reference, and those below its bar are not known. A run over its limit is NaN and keeps its row.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from textwrap import shorten
from typing import Any

from dem_bridge.backends.base import ENGINE_BACKENDS, Resolution, Sampling
from dem_bridge.backends.scene_prescan import prescan_scene
from dem_bridge.errors import RunBroken
from dem_bridge.lmp.engine import Engine
from dem_bridge.report.columns import MILLISECOND, Column
from dem_bridge.report.study import Study, Table, check_setting
from dem_bridge.runs.campaign import Jobs, Progress, run_cases
from dem_bridge.runs.case import Case
from dem_bridge.runs.store import Store
from dem_bridge.scene.scene import Scene
from dem_bridge.studies.recalled import recall_study
from dem_bridge.studies.work_precision import runs
from dem_bridge.studies.work_precision.curves import STYLES, TEXTS, WHOLE, curves
from dem_bridge.studies.work_precision.figures import ID, as_csv, as_netcdf, figures
from dem_bridge.studies.work_precision.runs import REFERENCE, Measured, Point

TARGETS = (1e-1, 1e-2, 1e-4, 1e-6, 1e-8)
#: errors that grow by more than this factor under refinement have passed their floor
TURNING = 1.5
#: settings among which the cheapest is looked for
GROUPS: dict[str, Callable[[Point], bool]] = {
    "all backends": lambda point: True,
    "fixed steps in house": lambda point: point.curve.knob == "dt" and point.curve.backend not in ENGINE_BACKENDS,
    "LAMMPS": lambda point: point.curve.backend in ENGINE_BACKENDS,
}
#: s of wall time that one run may take
LIMIT = 5.0
REPEATS = 3


def study_work_precision(
    scene: Scene,
    *,
    engine: Engine | None = None,
    jobs: Jobs = None,
    progress: Progress | None = None,
    store: Store | None = None,
    limit: float = LIMIT,
    repeats: int = REPEATS,
    backends: Sequence[str] | None = None,
) -> Study:
    """Measure the error of every backend against its cost, for each of its numerical settings.

    Timed runs are made one at a time; ``jobs`` is for the reference alone. Ctrl-C keeps what was finished.
    A second call has the times of the first; ``recompute`` measures them again.

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
    check_setting("limit", limit, "a number of seconds > 0")
    check_setting("repeats", repeats, "a whole number from 1 to 1000", least=1, most=1000)
    bounds: dict[str, Any] = {"limit": limit, "repeats": repeats}
    engine = engine or Engine.chosen()

    def timed() -> Study:
        return _study(scene, engine, backends, bounds, {"jobs": jobs, "store": store}, progress)

    return recall_study(ID, store, timed, scene, engine, backends=backends, **bounds)


def _study(
    scene: Scene,
    engine: Engine,
    backends: Sequence[str] | None,
    bounds: Mapping[str, Any],
    campaign: Mapping[str, Any],
    progress: Progress | None,
) -> Study:
    """Measure and return the study; ``bounds``: limit and repeats, ``campaign``: how the reference is run."""
    sampling = Sampling(count=scene.samples)
    if progress is not None:
        progress(0.0, 1, f"{scene.name}: {REFERENCE}")
    case = Case(scene=scene, backend=REFERENCE, resolution=Resolution(), sampling=sampling)
    (truth,) = run_cases([case], **campaign)
    if truth.trajectory is None:
        raise RunBroken(f"{scene.name}: without a run of the reference nothing has an error ({truth.failure})")
    requested, notes = curves(scene, sampling, prescan_scene(scene), engine, backends)
    reference = runs.readings_of(scene, truth.trajectory)
    points: list[Point] = []
    interrupted = False
    try:
        for point in runs.measured(requested, scene, sampling, reference, progress=progress, **bounds):
            points.append(point)
    except KeyboardInterrupt:
        interrupted = True
    if progress is not None:
        progress(1.0, 1, "")
    result = Measured(
        scene=scene,
        sampling=sampling,
        limit=bounds["limit"],
        points=tuple(points),
        uncertainty=runs.uncertainties_of(reference),
        provenance={key: truth.trajectory.provenance[key] for key in ("scene_hash", "versions", "machine")},
    )
    counts = {"lost": sum(not point.ran for point in points), "count": len(points)}
    bar = result.uncertainty["velocity", "max"]
    return TEXTS.study(
        {"scene": scene.name},
        answer=tuple(_answer(result)),
        tables=(_cheapest_table(result), _floors_table(result), _runs_table(result)),
        figures=tuple(figures(result)),
        notes=(*TEXTS.notes(bar=bar, limit=bounds["limit"], **counts), *notes),
        interrupted=interrupted,
        provenance=result.provenance,
        files={f"{ID}-all.csv": partial(as_csv, result), f"{ID}.nc": partial(as_netcdf, result)},
    )


def setting(point: Point) -> str:
    """Return a curve's name with the value of its knob.

    >>> from dem_bridge.studies.work_precision.curves import Curve
    >>> setting(Point(curve=Curve(name="verlet", backend="verlet", knob="dt"), value=1e-7))
    'verlet at dt = 1e-07 s'
    """
    return f"{point.curve.name} at {_turned(point)}" if point.curve.knob else point.curve.name


def _turned(point: Point) -> str:
    """Return the knob with its value; '' where there is none."""
    knob, value = point.curve.knob, point.value
    digits = f"{value:.0f}" if knob in WHOLE else f"{value:.3g}"
    return f"{knob} = {digits}{' s' if knob == 'dt' else ''}" if knob else ""


def least(
    measured: Measured, points: Iterable[Point], target: float, cost: str = "cpu_min", observable: str = "velocity"
) -> Point | None:
    """Return the point of least cost with an error of at most ``target``; None where there is none."""

    def cost_of(point: Point) -> float:
        return float(getattr(point, cost))

    enough = [point for point in points if measured.bound(point, observable) <= target]
    return min((point for point in enough if math.isfinite(cost_of(point))), key=cost_of, default=None)


def _groups(measured: Measured) -> dict[str, list[Point]]:
    return {name: list(filter(holds, measured.points)) for name, holds in GROUPS.items()}


def _answer(measured: Measured) -> Iterator[str]:
    for target in TARGETS[1:]:
        parts = []
        for name, points in _groups(measured).items():
            best = least(measured, points, target)
            parts.append(f"{name}: {'none' if best is None else f'{setting(best)} ({_ms(best.cpu_min)})'}")
        yield TEXTS("cheapest", target=target, parts="; ".join(parts))
    ends = [_floor(measured, name) for name in measured.curves]
    floors = [
        f"{setting(end[0])} with {end[0].error('velocity'):.1e}"
        for end in ends
        if end is not None and end[1] in ("worse", "floor") and end[0].curve.knob in ("dt", "rtol", "atol")
    ]
    if floors:
        yield TEXTS("floors", floors="; ".join(floors))
    yield from _on_richardson(measured)
    yield from _on_tables(measured)


def _ms(seconds: float) -> str:
    return f"{1e3 * seconds:.3g} ms" if seconds < 1.0 else f"{seconds:.3g} s"


def _floor(measured: Measured, name: str) -> tuple[Point, str] | None:
    """Return the point of least velocity error of a curve, and the text why there is no better; None without runs."""
    points = [point for point in measured.points if point.curve.name == name]
    ran = [point for point in points if math.isfinite(point.error("velocity"))]
    if not ran:
        return None
    errors = [point.error("velocity") for point in ran]
    best = min(errors)
    least = ran[errors.index(best)]
    beyond = errors[errors.index(best) + 1 :]
    flat = len(errors) > 1 and errors[-1] > errors[-2] / TURNING
    if len(points) == 1:
        reason = "no_knob"
    elif not measured.known(least, "velocity"):
        reason = "below"
    elif any(error > TURNING * best for error in beyond):
        reason = "worse"
    elif beyond or flat:
        reason = "floor"
    else:
        reason = "limit" if not all(point.ran for point in points[points.index(least) + 1 :]) else "end"
    return least, reason


def _on_richardson(measured: Measured) -> Iterator[str]:
    """Yield the cost of extrapolation relative to plain runs of the same error."""
    for name in measured.curves:
        extrapolated = f"{name} (Richardson)"
        tried = [point for point in measured.points if point.curve.name == extrapolated]
        if not tried:
            continue
        details: dict[float, str] = {}
        for target in TARGETS[1:]:  # a setting that meets several says the most at the last
            plain, better, slow, fewer = (
                least(measured, measured.of(curve), target, cost)
                for cost in ("cpu_min", "force_evaluations")
                for curve in (name, extrapolated)
            )
            if better and plain and fewer and slow:
                evaluations = fewer.force_evaluations / slow.force_evaluations
                cpu = better.cpu_min / plain.cpu_min
                details[better.value] = TEXTS("gain", target=target, cpu=cpu, evaluations=evaluations)
            elif better:
                details[better.value] = TEXTS("alone", target=target)
        said = ", ".join(details.values()) or "it meets no target within the limit"
        refused = sum("no extrapolation" in point.reason for point in tried)
        yield TEXTS("richardson", curve=name, details=said, refused=refused, tried=len(tried))


def _on_tables(measured: Measured) -> Iterator[str]:
    plain, tabled = (
        {point.value: point for point in measured.of(name)} for name in ("lammps-granular", "lammps-table")
    )
    if both := set(plain) & set(tabled):
        law, table = plain[min(both)], tabled[min(both)]
        times = {"plain_time": _ms(law.cpu_min), "tabled_time": _ms(table.cpu_min)}
        yield TEXTS("tables", dt=min(both), tabled=table.error("velocity"), plain=law.error("velocity"), **times)
    for style in STYLES:
        points = measured.of(f"lammps-table ({style})")
        if points:
            parts = ", ".join(f"{point.error('velocity'):.1e} with {point.value:g}" for point in points)
            yield TEXTS("points", style=style, dt=points[0].dt, parts=parts)


def _cheapest_table(measured: Measured) -> Table:
    rows = []
    for observable in measured.observables:
        for target in TARGETS:
            cells: list[str | float] = [observable, target]
            for points in _groups(measured).values():
                best = least(measured, points, target, observable=observable)
                cells += ["-", math.nan] if best is None else [setting(best), best.cpu_min]
            rows.append(cells)
    heads = (head for name in GROUPS for head in (name, Column(f"{name}: CPU", MILLISECOND)))
    return TEXTS.table("cheapest", ("observable", "wanted error", *heads), rows)


def _floors_table(measured: Measured) -> Table:
    others = [name for name in measured.observables if name != "velocity"]
    rows: list[tuple[str | float, ...]] = []
    for name in measured.curves:
        floor = _floor(measured, name)
        if floor is None:
            reason = next(point.reason for point in measured.points if point.curve.name == name)
            rows.append((name, "-", *[math.nan] * (len(others) + 2), reason))
            continue
        best, reason = floor[0], TEXTS(floor[1], limit=measured.limit)
        points = measured.of(name)
        least = (min((measured.bound(point, other) for point in points), default=math.inf) for other in others)
        rows.append((name, _turned(best), measured.bound(best, "velocity"), best.cpu_min, *least, reason))
    heads = (
        "curve",
        "setting",
        "velocity error",
        Column("CPU", MILLISECOND),
        *(f"least error of {name}" for name in others),
    )
    return TEXTS.table("floors", (*heads, "what ends it (velocity)"), rows)


def _runs_table(measured: Measured) -> Table:
    rows = [
        (
            *(point.curve.name, _turned(point)),
            *(point.cpu_min, point.wall_median, float(point.force_evaluations)),
            *map(point.error, measured.observables),
            shorten(point.reason, 60, placeholder=" ..."),
        )
        for point in measured.points
    ]
    times = (Column("CPU, least", MILLISECOND), Column("wall, median", MILLISECOND))
    heads = ("curve", "setting", *times, "force evaluations", *measured.observables)
    return TEXTS.table("runs", (*heads, "reason"), rows)
