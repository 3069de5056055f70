"""Runs that are made to be judged: a foreign code beside ours, and a deck with what limits it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from dem_bridge.backends.base import Resolution, Sampling, backend, unsupported_reason
from dem_bridge.errors import DemBridgeError, UsageError
from dem_bridge.formats.readers import Record, read_record
from dem_bridge.foundation.notebook import quantity as amount
from dem_bridge.foundation.wording import share
from dem_bridge.judging.deck import DeckRun, deck_run
from dem_bridge.judging.foreign import TIME_LIMIT_S, Command, ForeignRun, default_steps, foreign_runs
from dem_bridge.judging.judgement import Addition, Judgement
from dem_bridge.judging.limits import deck_limits
from dem_bridge.judging.records import judge_records
from dem_bridge.judging.reference import reference_at
from dem_bridge.lmp.engine import Engine
from dem_bridge.report.columns import SECOND, Column
from dem_bridge.report.study import FigureData, Series
from dem_bridge.report.texts import Texts
from dem_bridge.runs.case import Case
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.relative import relative_size

TEXTS = Texts("judge", "dem_bridge.judging")
WORK_PRECISION_COLUMNS = (
    "code", Column("time step", SECOND), "relative error", "order", Column("wall time", SECOND),
    Column("CPU time", SECOND),
)  # fmt: skip
LIMITS_COLUMNS = ("property", "in the deck", "relative effect", "what to do")
#: codes that run beside a foreign one, with their names on the page and their styles of drawing
BESIDE = {"verlet": ("our twin", "curve/verlet"), "lammps-granular": ("LAMMPS", "curve/lammps-granular")}


@dataclass(frozen=True, kw_only=True)
class CodeRun:
    """Error and cost of one run of one code."""

    code: str
    dt: float
    error: float
    """Largest error relative to the largest value of the reference."""
    wall: float
    cpu: float


def judge_command(
    scene: Scene,
    command: str | Sequence[str],
    steps: Sequence[float] | None = None,
    *,
    tolerance: float | None = None,
    time_limit: float = TIME_LIMIT_S,
    **reading: Any,
) -> Judgement:
    """Run a foreign code over a series of time steps, and judge it beside our twin and LAMMPS at the same steps.

    ``reading`` are the keywords of :func:`~dem_bridge.formats.readers.read_record`.
    """
    parsed = Command.of(command)
    with foreign_runs(parsed, scene, default_steps(scene) if steps is None else steps, time_limit=time_limit) as runs:
        records = [_record(run.out, scene, run.name, run.dt, reading) for run in runs]
    judgement = judge_records(scene, records, tolerance=tolerance)
    return replace(judgement, addition=_work_precision(judgement, parsed.name, runs, time_limit))


def judge_decks(
    scene: Scene,
    files: Sequence[tuple[Path, float | None]],
    decks: Sequence[Path],
    *,
    tolerance: float | None = None,
    time_limit: float = TIME_LIMIT_S,
    engine: Engine | None = None,
    variables: Mapping[str, str] | None = None,
    **reading: Any,
) -> Judgement:
    """Judge decks, which are run for it by an engine with these variables, and files."""
    with ExitStack() as stack:
        records = [read_record(path, scene, dt=dt, **reading) for path, dt in files]
        runs = [
            stack.enter_context(deck_run(path, scene, engine=engine, variables=variables, time_limit=time_limit))
            for path in decks
        ]
        records += [
            replace(_record(run.out, scene, run.deck.path.name, run.dt, reading), stated=run.deck.stated(scene))
            for run in runs
        ]
    judgement = judge_records(scene, records, tolerance=tolerance)
    additions = [_limits(judgement, run) for run in runs]
    return replace(
        judgement,
        addition=Addition(
            lines=tuple(line for item in additions for line in item.lines),
            tables=tuple(table for item in additions for table in item.tables),
        ),
    )


def _record(path: Path, scene: Scene, name: str, dt: float | None, reading: Mapping[str, Any]) -> Record:
    """Read the output of a run; its name is that of the run, because the file is removed."""
    try:
        return replace(read_record(path, scene, dt=dt, **reading), name=name)
    except UsageError as error:
        raise UsageError(str(error).replace(str(path), f"output of {name}")) from error


def _work_precision(judgement: Judgement, name: str, runs: Sequence[ForeignRun], time_limit: float) -> Addition:
    """Return error and cost of a foreign code, of our twin and of LAMMPS at the same steps."""
    quantity = next(iter(judgement.worst))
    by_dt = {file.record.dt: file.quantities[quantity] for file in judgement.files}
    parts = {run.dt: by_dt[run.dt] for run in runs}
    results = [
        CodeRun(code=name, dt=dt, error=part.relative(part.value), wall=run.wall, cpu=run.cpu)
        for run, (dt, part) in zip(runs, parts.items(), strict=True)
    ]
    notes = []
    for code in BESIDE:
        try:
            results += _own_runs(judgement.scene, code, quantity, sorted(parts, reverse=True), time_limit)
        except DemBridgeError as problem:
            notes.append(TEXTS("not_beside", code=BESIDE[code][0], problem=problem))
    rows = [(run.code, run.dt, run.error, _order_to_next(results, run), run.wall, run.cpu) for run in results]
    words = quantity.replace("_", " ")
    finest = results[len(runs) - 1]
    others = [run for run in results[len(runs) :] if run.dt == finest.dt]
    text = TEXTS("cost", code=finest.code, dt=amount(finest.dt, "s"), error=finest.error, cpu=finest.cpu)
    texts_of_others = [TEXTS("cost_beside", code=run.code, error=run.error, cpu=run.cpu) for run in others]
    return Addition(
        lines=(("cost", "; ".join((text, *texts_of_others))),),
        tables=(TEXTS.table("work-precision", WORK_PRECISION_COLUMNS, rows, quantity=words),),
        figures=(_figure(results, words),),
        notes=(TEXTS("whole_process"), *notes),
    )


def _own_runs(scene: Scene, code: str, quantity: str, steps: Sequence[float], time_limit: float) -> list[CodeRun]:
    """Return error and cost of one of our codes at these steps."""
    chosen = backend(code)
    if reason := unsupported_reason(chosen, scene) or chosen.availability().reason:
        raise DemBridgeError(reason)
    sampling = Sampling(count=scene.samples)
    reference = reference_at(scene, sampling.times(scene.duration))
    results = []
    for dt in (steps[0], *steps):  # the first one is repeated, because it may load the engine or compile
        case = Case(
            scene=scene,
            backend=code,
            resolution=Resolution(dt=dt, time_limit=time_limit),
            sampling=sampling,
            uncertainty=False,
        )
        run = case.solve(chosen)
        error = float(np.max(np.abs(getattr(run, quantity) - reference.values[quantity])))
        relative = relative_size(error, reference.largest[quantity])
        results.append(CodeRun(code=BESIDE[code][0], dt=dt, error=relative, wall=run.cost.wall, cpu=run.cost.cpu))
    return results[1:]


def _order_to_next(results: Sequence[CodeRun], run: CodeRun) -> float:
    """Return the order between a run and that of the same code with the next larger step; nan for the largest."""
    larger = [other for other in results if other.code == run.code and other.dt > run.dt]
    if not larger or not run.error > 0.0:
        return math.nan
    other = min(larger, key=lambda item: item.dt)
    return math.log(other.error / run.error) / math.log(other.dt / run.dt) if other.error > 0.0 else math.nan


def _figure(results: Sequence[CodeRun], quantity: str) -> FigureData:
    """Return error against time step and error against CPU time of all codes."""
    styles = dict(BESIDE.values())
    panels = []
    for id, cost in (("by-step", "dt"), ("by-cost", "cpu")):
        series = []
        for code in dict.fromkeys(run.code for run in results):
            points = [run for run in results if run.code == code and run.error > 0.0 and getattr(run, cost) > 0.0]
            x = np.array([getattr(run, cost) for run in points])
            y = np.array([run.error for run in points])
            if len(points):
                series.append(Series(label=code, style=styles.get(code, "line/1/0"), x=x, y=y))
        panels.append(TEXTS.panel(id, series, quantity=quantity, log=True))
    return TEXTS.figure("work-precision", panels, quantity=quantity)


def _limits(judgement: Judgement, run: DeckRun) -> Addition:
    """Return what limits the accuracy of a deck."""
    name = run.deck.path.name
    file = next(file for file in judgement.files if file.record.name == name)
    limits = deck_limits(judgement.scene, run, file)
    rows = [(limit.what, limit.found, limit.effect, limit.advice) for limit in limits]
    suspects = [limit for limit in limits if limit.effect != 0.0]
    shown = [
        f"{limit.what} ({limit.found})" + ("" if math.isnan(limit.effect) else f" {share(limit.effect)}")
        for limit in suspects
    ]
    table = TEXTS.table("limits", LIMITS_COLUMNS, rows, name=name)
    return Addition(
        lines=(("limits", TEXTS("limits", name=name, limits="; ".join(shown))),),
        tables=(replace(table, id=f"limits-{name}".replace(".", "-")),),
    )
