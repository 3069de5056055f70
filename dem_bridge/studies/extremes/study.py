"""Every extreme through every backend: right within its bar, or refused with the reason."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from dem_bridge.backends.base import BACKENDS, ENGINE_BACKENDS, Resolution, Sampling, backend, supports_of
from dem_bridge.backends.scene_prescan import prescan_scene
from dem_bridge.errors import BackendUnavailable, DemBridgeError, UsageError
from dem_bridge.lmp.engine import Engine
from dem_bridge.observables.verdict import Outcome, Verdict
from dem_bridge.report.study import FigureData, Series, Study, Table
from dem_bridge.report.texts import Texts
from dem_bridge.runs.campaign import Jobs, Progress, Result, run_case, run_cases
from dem_bridge.runs.case import Case
from dem_bridge.runs.store import Store
from dem_bridge.scene.scene import Scene
from dem_bridge.studies.extremes.catalogue import Entry, catalogue, expectation, kinds
from dem_bridge.studies.extremes.judge import Expected, Finding, Standard, Word, judge, outcome
from dem_bridge.studies.extremes.truths import Truth, witness
from dem_bridge.studies.recalled import recall_study

TEXTS = Texts("extremes", "dem_bridge.studies")
FINDINGS_COLUMNS = {
    "entry.name": "extreme", "backend": "backend", "outcome": "outcome", "finding.word": "found",
    "expected": "expected", "finding.quantity": "quantity", "finding.error": "error", "finding.bar": "uncertainty",
    "finding.standard_bar": "uncertainty of the truth", "finding.ratio": "error / uncertainties",
    "finding.velocity_bar": "uncertainty of velocity", "finding.unsaid": "without uncertainty",
    "finding.standard": "compared with", "finding.reason": "reason",
}  # fmt: skip
ENTRIES_COLUMNS = {"name": "extreme", "asks": "question", "scene.n_body": "bodies", "sources": "truths"}
#: errors that are less, or more, than this part of both bars are drawn here
LEAST, MOST = 1e-3, 1e3
#: names beside one pair of axes
_ROWS = 18
#: step of the judged code over that of the twin where that is the truth: a hundredth of the error
FINER = 10.0


@dataclass(frozen=True, kw_only=True)
class _Plan:
    """The runs that one backend needs on one entry; a setting that is refused, or what is left out, has no case."""

    entry: Entry
    backend: str
    case: Case | DemBridgeError
    truths: tuple[tuple[Truth, tuple[Case, ...]], ...] = ()

    @property
    def is_theory(self) -> bool:
        """Return whether the backend solves other equations."""
        return backend(self.backend).equations != "hertz"

    @property
    def cases(self) -> list[Case]:
        """List the cases that a campaign runs: a backend with a defect is run apart."""
        cases = [case for _, some in self.truths for case in some]
        if isinstance(self.case, Case) and self.backend not in self.entry.instead:
            cases.insert(0, self.case)
        return cases


@dataclass(frozen=True, kw_only=True)
class Row:
    """One backend on one entry."""

    entry: Entry
    backend: str
    expected: Expected
    finding: Finding

    @property
    def outcome(self) -> Outcome:
        """Return PASS if the finding is the expected one, otherwise FAIL."""
        return outcome(self.finding, self.expected)

    @property
    def verdict(self) -> Verdict:
        """Return the outcome with its numbers."""
        result, bars = self.finding, (self.finding.bar, self.finding.standard_bar)
        numbers = {"difference": result.error, "uncertainty": bars[0], "reference_uncertainty": bars[1]}
        reason = f" ({result.reason})" if result.reason else ""
        return TEXTS.verdict("extreme", row=self, outcome=self.outcome, reason=reason, tolerance=sum(bars), **numbers)


def study_extremes(
    *,
    match: str | None = None,
    quick: bool = False,
    engine: Engine | None = None,
    jobs: Jobs = None,
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
    chosen = engine or Engine.chosen()

    def judged() -> Study:
        rows = rows_of(entries, engine=chosen, jobs=jobs, progress=progress, store=store)
        verdicts = tuple(row.verdict for row in rows)
        return TEXTS.study(answer=answer(rows), tables=tables(rows), figures=figures(rows), verdicts=verdicts)

    # the scenes are part of the package, as its code is
    return recall_study("extremes", store, judged, [], chosen, entries=[entry.name for entry in entries])


def rows_of(
    entries: Iterable[Entry],
    backends: Sequence[str] = tuple(BACKENDS),
    *,
    engine: Engine | None = None,
    **campaign: Any,
) -> list[Row]:
    """Run each backend on each entry and judge it; ``campaign``: arguments of ``run_cases``."""
    plans = []
    for entry in entries:
        dt = _step(entry)
        plans += [_plan(entry, name, dt, engine) for name in backends]
    cases = [case for plan in plans for case in plan.cases]
    result = run_cases(cases, **campaign, everything=True)
    results = {id(case): result for case, result in zip(cases, result, strict=True)}
    return [_judged(plan, results, engine) for plan in plans]


def _step(entry: Entry) -> float | None:
    """Return the time step for codes that have a fixed step, s; None: their default."""
    if entry.dt is not None:
        return entry.dt
    frequency = prescan_scene(entry.scene).frequency
    return entry.phase / frequency if frequency > 0.0 else None


def _plan(entry: Entry, name: str, dt: float | None, engine: Engine | None) -> _Plan:
    def case(scene: Scene, by: str, faster: float = 1.0) -> Case:
        which = engine if by in ENGINE_BACKENDS else None
        # a code without a step would be run again for each that it does not use
        step = None if dt is None or backend(by, which).order is None else dt / faster
        resolution = Resolution(dt=step, **(entry.settings.get(name, {}) if by == name else {}))
        sampling = Sampling(count=scene.samples)
        return Case(scene=scene, backend=by, resolution=resolution, sampling=sampling, engine=which)

    if name in entry.left_out:
        return _Plan(entry=entry, backend=name, case=BackendUnavailable(entry.left_out[name]))
    try:
        plan = _Plan(entry=entry, backend=name, case=case(entry.scene, name))
    except UsageError as error:
        return _Plan(entry=entry, backend=name, case=error)
    if not supports_of(name).covers(entry.scene):
        return plan
    truths = []
    for truth in entry.truths[:1] if plan.is_theory else entry.truths:
        by = "reference" if plan.is_theory else name if truth.by_itself else witness(name, entry.scene)
        # a witness with a step has a finer one
        faster = truth.faster * (1.0 if truth.by_itself else FINER)
        truths.append((truth, tuple(case(scene, by, faster) for scene in truth.scenes)))
    return replace(plan, truths=tuple(truths))


def _judged(plan: _Plan, results: Mapping[int, Result], engine: Engine | None) -> Row:
    if isinstance(plan.case, DemBridgeError):
        word = Word.NOT_RUN if isinstance(plan.case, BackendUnavailable) else Word.REFUSED
        finding = Finding(word=word, reason=str(plan.case))
    else:
        standards = [_standard(truth, [results[id(case)] for case in cases], plan) for truth, cases in plan.truths]
        faulty = plan.entry.instead.get(plan.backend)
        result = run_case(plan.case, everything=True, by=faulty(engine)) if faulty else results[id(plan.case)]
        finding = judge(result, standards, model=plan.is_theory)
    return Row(entry=plan.entry, backend=plan.backend, expected=expectation(plan.entry, plan.backend), finding=finding)


def _standard(truth: Truth, results: list[Result], plan: _Plan) -> Standard:
    says = truth.says if truth.by_itself or not results else results[0].case.backend
    runs = []
    for result in results:
        if result.trajectory is None:
            return Standard(says=says, run=None, reason=f"{result.case.label}: {result.failure}")
        runs.append(result.trajectory)
    run = truth.make(runs)
    # samples of scaled times differ from those of the scene in their last digit
    run = replace(run, time=np.linspace(0.0, plan.entry.scene.duration, len(run.time)))
    return Standard(says=says, run=run, to_the_bit=bool({*truth.to_the_bit} & {*kinds(backend(plan.backend))}))


def answer(rows: Sequence[Row]) -> tuple[str, ...]:
    """Return the answer: whether any backend is wrong without saying so."""
    count = Counter(row.finding.word for row in rows)
    wrong, judged, vague = (_with(word, rows) for word in (Word.WRONG, Word.RIGHT, Word.NO_BAR))
    failed = [row for row in rows if row.outcome in (Outcome.FAIL, Outcome.BROKEN)]
    start = TEXTS("wrong", wrong=len(wrong), count=len(rows), named=_named(wrong)) if wrong else TEXTS("right")
    details = ", ".join(
        f"{count[Word(word)]} {what}" for word, what in TEXTS.data["words"].items() if count[Word(word)]
    )
    entries, backends = ({row.entry.name for row in rows}, {row.backend for row in rows})
    sentences = [TEXTS("summary", start=start, entries=len(entries), backends=len(backends), details=details)]
    if judged:
        nearest = max(judged, key=lambda row: row.finding.ratio)
        sentences.append(TEXTS("nearest", median=np.median([row.finding.ratio for row in judged]), row=nearest))
    if vague:
        sentences.append(TEXTS("vague", named=_named(vague)))
    if without := sum(bool(row.finding.unsaid) for row in judged):
        sentences.append(TEXTS("without", count=without))
    exceptions = f"; not so: {_named(failed)}" if failed else ""
    return (*sentences, TEXTS("expected", passed=len(rows) - len(failed), count=len(rows), failed=exceptions))


def _with(word: Word, rows: Sequence[Row]) -> list[Row]:
    return [row for row in rows if row.finding.word is word]


def _named(rows: Sequence[Row]) -> str:
    """Return the first few entries with their backends."""
    by_entry: dict[str, list[str]] = {}
    for row in rows:
        by_entry.setdefault(row.entry.name, []).append(row.backend)
    details = [f"{name}: {', '.join(backends)}" for name, backends in by_entry.items()]
    more = len(details) - 8
    return "; ".join(details[:8]) + (f"; and {more} more" if more > 0 else "")


def tables(rows: Sequence[Row]) -> tuple[Table, ...]:
    """Return counts, the matrix of outcomes, all numbers, and the catalogue."""
    entries = {row.entry.name: row.entry for row in rows}
    backends = {row.backend: [other for other in rows if other.backend == row.backend] for row in rows}
    words = [word for word in Word if _with(word, rows)]
    cells: dict[str, dict[str, str]] = {}
    for row in rows:
        mark = "" if row.outcome in (Outcome.PASS, Outcome.NOT_RUN) else f" [{row.outcome}]"
        cells.setdefault(row.entry.name, {})[row.backend] = row.finding.cell + mark
    return (
        TEXTS.table(
            "counts",
            ("backend", "as expected", *words, "largest error / uncertainties where right"),
            [(name, *_counts(some, words)) for name, some in backends.items()],
            count=len(entries),
        ),
        TEXTS.table(
            "outcomes",
            ("extreme", *backends),
            [(name, *(line[backend] for backend in backends)) for name, line in cells.items()],
        ),
        TEXTS.table("findings", FINDINGS_COLUMNS, rows),
        TEXTS.table("entries", ENTRIES_COLUMNS, entries.values()),
    )


def _counts(rows: Sequence[Row], words: Sequence[Word]) -> tuple[float, ...]:
    """Return the numbers of expected findings and of each word, and the largest ratio of those that are right."""
    expected = sum(row.outcome is Outcome.PASS for row in rows)
    ratios = (row.finding.ratio for row in _with(Word.RIGHT, rows))
    return (float(expected), *(float(len(_with(word, rows))) for word in words), max(ratios, default=math.nan))


def figures(rows: Sequence[Row]) -> tuple[FigureData, ...]:
    """Return the error over both bars, a row for each extreme; nothing without a number to draw."""
    judged = [row for row in rows if not math.isnan(row.finding.ratio)]
    names = list(dict.fromkeys(row.entry.name for row in judged))
    panels = []
    for begin in range(0, len(names), _ROWS):
        some = names[begin : begin + _ROWS]
        series = [Series(label="error = bars", style="guide", x=np.ones(2), y=np.array([-0.5, len(some) - 0.5]))]
        for name in dict.fromkeys(row.backend for row in judged):
            drawn = [row for row in judged if row.backend == name and row.entry.name in some]
            x = np.array([min(max(row.finding.ratio, LEAST), MOST) for row in drawn])
            y = np.array([float(some.index(row.entry.name)) for row in drawn])
            series.append(Series(label=name, style=f"mark/{name}", x=x, y=y))
        panels.append(TEXTS.panel("errors", series, rows=tuple(some), letter=chr(97 + begin // _ROWS)))
    return (TEXTS.figure("error-over-bars", panels, least=LEAST, most=MOST),) if panels else ()
