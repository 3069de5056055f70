"""Every extreme through every backend: right within its bar, or refused with the reason."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dem_bridge.backends.base import BACKENDS, ENGINE_BACKENDS, Resolution, Sampling, backend, supports_of
from dem_bridge.backends.tabled import prescan_scene
from dem_bridge.campaign import Progress, Result, run_case, run_cases
from dem_bridge.errors import BackendUnavailable, DemBridgeError, UsageError
from dem_bridge.lmp.engine import Engine
from dem_bridge.runs.case import Case
from dem_bridge.runs.store import Store
from dem_bridge.scene import Scene
from dem_bridge.studies.extremes.catalogue import catalogue
from dem_bridge.studies.extremes.entry import Entry, expectation, kinds
from dem_bridge.studies.extremes.judge import Finding, Standard, Word, judge
from dem_bridge.studies.extremes.shown import NOTES, Row, answer, figures, tables
from dem_bridge.studies.extremes.truths import Truth, witness
from dem_bridge.studies.study import Study

#: step of the judged code over that of the twin where that is the truth: a hundredth of the error
FINER = 10.0


@dataclass(frozen=True, kw_only=True)
class _Plan:
    """The runs that one backend needs on one entry; a setting that is refused, or what is left out, has no case."""

    entry: Entry
    backend: str
    own: Case | DemBridgeError
    truths: tuple[tuple[Truth, tuple[Case, ...]], ...]


def study_extremes(
    *,
    match: str | None = None,
    quick: bool = False,
    engine: Engine | None = None,
    jobs: int | None = None,
    progress: Progress | None = None,
    store: Store | None = None,
) -> Study:
    """Run a catalogue of extreme scenes through every backend and check each error against its uncertainty.

    Parameters
    ----------
    match : str, optional
        Part of a name: only extremes whose names contain it are run. None: all.
    quick : bool
        Whether extremes that take more than about 5 s are left out.
    engine, jobs, progress, store : as in :func:`dem_bridge.study`

    Returns
    -------
    Study

    Raises
    ------
    UsageError
        If no extreme is left.
    """
    entries = [
        item for item in catalogue().values() if (match is None or match in item.name) and not (quick and item.slow)
    ]
    if not entries:
        raise UsageError(f"match = {match!r}; allowed: a part of one of: {', '.join(catalogue())}")
    rows = rows_of(entries, engine=engine, jobs=jobs, progress=progress, store=store)
    return Study(
        id="extremes",
        title="Extremes: right within the bar, or refused with the reason",
        answer=answer(rows),
        tables=tables(rows),
        figures=figures(rows),
        verdicts=tuple(row.verdict for row in rows),
        notes=NOTES,
    )


def rows_of(
    entries: Iterable[Entry],
    backends: Sequence[str] = tuple(BACKENDS),
    *,
    engine: Engine | None = None,
    jobs: int | None = None,
    progress: Progress | None = None,
    store: Store | None = None,
) -> list[Row]:
    """Run and judge."""
    plans = [_plan(entry, name, dt, engine) for entry, dt in map(_stepped, entries) for name in backends]
    cases = [
        case
        for plan in plans
        for case in (plan.own, *(item for _, some in plan.truths for item in some))
        if isinstance(case, Case) and not (case is plan.own and plan.backend in plan.entry.instead)
    ]
    result = run_cases(cases, jobs=jobs, progress=progress, store=store, everything=True)
    results = {id(case): result for case, result in zip(cases, result, strict=True)}
    return [_judged(plan, results, engine) for plan in plans]


def _stepped(entry: Entry) -> tuple[Entry, float | None]:
    """Return the settings with the time step for codes that have a fixed step; None: their default."""
    if entry.dt is not None:
        return entry, entry.dt
    frequency = prescan_scene(entry.scene).frequency
    return entry, entry.phase / frequency if frequency > 0.0 else None


def _plan(entry: Entry, name: str, dt: float | None, engine: Engine | None) -> _Plan:
    settings = dict(entry.settings.get(name, {}))

    def case(scene: Scene, by: str, faster: float = 1.0) -> Case:
        which = engine if by in ENGINE_BACKENDS else None
        # a code without a step would be run again for each that it does not use
        step = None if dt is None or backend(by, which).order is None else dt / faster
        resolution = Resolution(dt=step, **(settings if by == name else {}))
        return Case(
            scene=scene, backend=by, resolution=resolution, sampling=Sampling(count=scene.samples), engine=which
        )

    if name in entry.left_out:
        return _Plan(entry=entry, backend=name, own=BackendUnavailable(entry.left_out[name]), truths=())
    try:
        own_value = case(entry.scene, name)
    except UsageError as error:
        return _Plan(entry=entry, backend=name, own=error, truths=())
    if not supports_of(name).covers(entry.scene):
        return _Plan(entry=entry, backend=name, own=own_value, truths=())
    theory = backend(name).equations != "hertz"
    truths = []
    for truth in entry.truths[:1] if theory else entry.truths:
        by = "reference" if theory else name if truth.own else witness(name, entry.scene)
        # a witness with a step has a finer one
        faster = truth.faster * (1.0 if truth.own else FINER)
        truths.append((truth, tuple(case(scene, by, faster) for scene in truth.scenes)))
    return _Plan(entry=entry, backend=name, own=own_value, truths=tuple(truths))


def _judged(plan: _Plan, results: Mapping[int, Result], engine: Engine | None) -> Row:
    expected = expectation(plan.entry, plan.backend)
    if isinstance(plan.own, DemBridgeError):
        word = Word.NOT_RUN if isinstance(plan.own, BackendUnavailable) else Word.REFUSED
        result = Finding(word=word, reason=str(plan.own))
    else:
        standards = [_standard(truth, [results[id(case)] for case in cases], plan) for truth, cases in plan.truths]
        theory = backend(plan.backend).equations != "hertz"
        if plan.backend in plan.entry.instead:
            own_value = run_case(plan.own, everything=True, by=plan.entry.instead[plan.backend](engine))
        else:
            own_value = results[id(plan.own)]
        result = judge(own_value, standards, model=theory)
    return Row(entry=plan.entry, backend=plan.backend, expected=expected, found=result)


def _standard(truth: Truth, results: list[Result], plan: _Plan) -> Standard:
    says = truth.says if truth.own or not results else results[0].case.backend
    runs = [result.trajectory for result in results]
    if any(run is None for run in runs):
        failed = next(result for result in results if result.trajectory is None)
        return Standard(says=says, run=None, reason=f"{failed.case.label}: {failed.failure}")
    created = truth.make([run for run in runs if run is not None])
    # samples of scaled times differ from those of the scene in their last digit
    created = replace(created, time=np.linspace(0.0, plan.entry.scene.duration, len(created.time)))
    return Standard(says=says, run=created, to_the_bit=bool({*truth.to_the_bit} & {*kinds(backend(plan.backend))}))
