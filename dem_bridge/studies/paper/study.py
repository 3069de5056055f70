"""Run the whole study of the paper: its runs, verdicts, claims, tables and figures, in this order."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from itertools import chain
from typing import Any

from dem_bridge.backends.base import BACKENDS
from dem_bridge.lmp.engine import Engine
from dem_bridge.observables.convergence import checked_accuracy
from dem_bridge.observables.differences import difference
from dem_bridge.report.study import PARTS, Claim, FigureData, Margin, Table
from dem_bridge.runs.cache import RunCache
from dem_bridge.runs.campaign import Jobs, Progress, Result, map_in_threads, run_groups
from dem_bridge.runs.case import Case
from dem_bridge.runs.recall import recall
from dem_bridge.runs.store import Store
from dem_bridge.scene.file import load_scene
from dem_bridge.scene.scene import Scene
from dem_bridge.studies import rule_of_thumb, scatter
from dem_bridge.studies.model_hierarchy.models import Bench, LeftOut, ModelHierarchy, left_out, model_hierarchy_of
from dem_bridge.studies.model_hierarchy.passage import JUDGED
from dem_bridge.studies.model_hierarchy.study import question_table
from dem_bridge.studies.paper import PAPER, figures, opening, overview
from dem_bridge.studies.paper.claims import with_margins
from dem_bridge.studies.paper.claims_force import forces, ratios
from dem_bridge.studies.paper.claims_numbers import NEGLIGIBLE, numbers
from dem_bridge.studies.paper.claims_pulses import spectra
from dem_bridge.studies.paper.claims_wave import waves
from dem_bridge.studies.paper.criteria import CRITERIA
from dem_bridge.studies.paper.effects import (
    AS_IS,
    VARIANTS,
    Effect,
    budget_table,
    effect,
    reference_uncertainty,
)
from dem_bridge.studies.paper.measures import fits_table, pulses_table, split_table, theories_table
from dem_bridge.studies.paper.runs import (
    ACCELERATING,
    DECELERATING,
    LONG,
    MAIN,
    OTHER_ACCURACY,
    Runs,
    beside,
    mass_gradients,
    matched,
    scenes_of_paper,
    steeper_tapers,
    variants,
)
from dem_bridge.studies.paper.summary import NOT_VERIFIED, answer
from dem_bridge.studies.paper.validity import contacts_table, scenes_table
from dem_bridge.studies.scatter import ScatteredChains
from dem_bridge.verification.assess import SceneStudy
from dem_bridge.verification.reference_choice import REFERENCE, SCIPY
from dem_bridge.verification.under_way import UnderWay
from dem_bridge.verification.verification import Verification, verification_of
from dem_bridge.verification.verify import DEFAULT_ACCURACY, ScenePlan, assess_when_ended, check_jobs, plan_scene

CLAIMS_COLUMNS = ("claim", "where", "outcome", "kind", "finding", "margin", "another outcome by")


@dataclass(frozen=True, kw_only=True)
class Extent:
    """Hold the extent of the study of the paper; smaller ones are for tests."""

    scenes: tuple[str, ...] | None = None
    """Shipped scenes; None: all."""
    chains: int = 150
    """Scattered chains of each of the two main ones."""
    spread: float = 0.5
    """Standard deviation of their angles, degrees; the paper names none. With more, angles of 2 degrees come near 0."""
    hierarchy: bool = True
    """Whether it asks what may be left out of the two main ones."""


#: codes and theories whose errors stand in the budget
TERMS = ("lammps", SCIPY, "ode45", "bca", "adiabatic")


def verify_paper(
    *,
    accuracy: float = DEFAULT_ACCURACY,
    jobs: Jobs = None,
    progress: Progress | None = None,
    engine: Engine | None = None,
    store: Store | None = None,
    extent: Extent | None = None,
    under_way: UnderWay | None = None,
) -> Verification:
    """Run and judge all shipped scenes and the paper's claims; arguments as of :func:`dem_bridge.verify`.

    ``under_way`` is given each scene as soon as its runs have ended.
    """
    began, extent = time.perf_counter(), extent or Extent()
    check_jobs(jobs)
    checked_accuracy(accuracy)
    scenes, cache = scenes_of_paper(extent.scenes), RunCache(store)
    if progress is not None:
        progress(0.0, 1, "choosing time steps")
    # what chooses them is mostly compiled, and leaves the interpreter to others
    plans = map_in_threads(partial(_plan, accuracy=accuracy, engine=engine, cache=cache), scenes, jobs)
    main = [load_scene(name) for name in MAIN]
    hierarchies = (
        [model_hierarchy_of(scene, accuracy=NEGLIGIBLE, store=store) for scene in main] if extent.hierarchy else []
    )
    models = [hierarchy.cases() for hierarchy in hierarchies]
    thumbs = [rule_of_thumb.cases_of(scene) for scene in scenes]
    changed = [*variants(), *mass_gradients(engine), *matched(), *steeper_tapers()]
    parts: tuple[list[Sequence[Case]], ...] = ([plan.cases for plan in plans], [changed], [*models], [*thumbs])
    together = list(chain.from_iterable(parts))
    under_way = under_way or UnderWay(accuracy=accuracy)
    ended = assess_when_ended(plans, under_way, store)
    groups = iter(run_groups(together, jobs=jobs, progress=progress, store=store, cache=cache, ended=ended))
    of_scenes, [of_changed], of_models, of_thumbs = ([next(groups) for _ in part] for part in parts)
    if progress is not None:
        progress(1.0, 1, "reading claims")
    studies = tuple(under_way.studies[number] for number in range(len(plans)))

    def read() -> dict[str, Any]:
        runs = Runs.of((*chain.from_iterable(of_scenes), *of_changed))
        scattered = [scatter.solve_seeded(scene, spread=extent.spread, count=extent.chains) for scene in main]
        requested = [
            (hierarchy, _left_out(hierarchy, of_model))
            for hierarchy, of_model in zip(hierarchies, of_models, strict=True)
        ]
        judged = [rule_of_thumb.errors_of(scene, of_thumb) for scene, of_thumb in zip(scenes, of_thumbs, strict=True)]
        return read_paper(studies, accuracy, runs, scattered, requested, (rule_of_thumb.table(judged),))

    results = [*chain(*of_scenes, of_changed, *of_models, *of_thumbs)]
    paper = _recalled(store, results, read, accuracy=accuracy, extent=asdict(extent))
    verification = verification_of(
        studies,
        accuracy=accuracy,
        wall=time.perf_counter() - began,
        notes=(store.trouble,) if store is not None and store.trouble else (),
    )
    return with_paper(verification, paper)


def _recalled(
    store: Store | None, results: Sequence[Result], read: Callable[[], dict[str, Any]], **settings: Any
) -> dict[str, Any]:
    """Return what was read off runs, from the store if these runs have been read with these settings."""
    keys, scenes = [result.key for result in results], [result.case.scene for result in results]
    return recall(store, "paper", keys, read, kinds=PARTS, scenes=scenes, **settings)


def _plan(scene: Scene, *, accuracy: float, engine: Engine | None, cache: RunCache) -> ScenePlan:
    """Return the plan of a shipped scene: main scenes are verified in full, others to :data:`OTHER_ACCURACY`."""
    main = scene.name in MAIN
    plan = plan_scene(
        scene,
        accuracy if main else max(accuracy, OTHER_ACCURACY),
        engine=engine,
        cache=cache,
        full=main,
        others=tuple(beside(scene)),
    )
    # claims are read off main runs alone
    return plan if plan.error is None else replace(plan, others=())


def with_paper(verification: Verification, paper: Mapping[str, Any]) -> Verification:
    """Return a verification with what :func:`read_paper` has read off the runs."""
    return replace(
        verification,
        id="paper",
        title=PAPER("title"),
        played=MAIN,
        headlines=paper["headlines"],
        abstract=paper["abstract"],
        answer=paper["answer"],
        not_verified=(*NOT_VERIFIED, *verification.not_verified),
        claims=paper["claims"],
        tables=(*paper["tables"], *verification.tables),
        figures=paper["figures"],
    )


def read_paper(
    studies: Sequence[SceneStudy],
    accuracy: float,
    runs: Runs,
    scattered: list[ScatteredChains],
    requested: Sequence[tuple[ModelHierarchy, Sequence[LeftOut]]] = (),
    more: tuple[Table, ...] = (),
) -> dict[str, Any]:
    """Read answer, claims, tables and figures of the paper off the runs; nothing is run here.

    ``more``: further tables, behind the others.
    """
    claims = claims_of(runs, scattered)
    names = [study.scene.name for study in studies]
    effects = list(_effects(runs))
    contacts = [contacts_table(runs, name) for name in MAIN]
    scale = overview.scale_of_differences(studies, effects, runs, accuracy)
    of_paper = list(figures_of(runs, scattered))
    drawn = (
        *of_paper[:1],
        scale,
        *of_paper[1:],
        overview.tornado(effects),
        overview.validity_figure(runs),
        overview.all_scenes(runs, names),
    )
    return {
        "headlines": opening.headlines(claims, studies, runs),
        "abstract": opening.abstract(claims, effects, studies, runs, accuracy),
        "answer": answer(claims, effects, studies),
        "claims": claims,
        "tables": (
            claims_table(claims),
            opening.wrong_table(claims),
            budget_table(effects),
            split_table(effects),
            *([question_table(requested, NEGLIGIBLE)] if requested else []),
            theories_table(runs, names),
            pulses_table(runs, names),
            fits_table(runs, names),
            coverage_table(runs, names, accuracy),
            scenes_table(runs, names),
            *(of_chain for of_chain in contacts if of_chain is not None),
            scatter.table(scattered),
            *more,
        ),
        "figures": tuple(figure for figure in drawn if figure is not None),
    }


def claims_of(runs: Runs, scattered: list[ScatteredChains]) -> tuple[Claim, ...]:
    """Return all claims in the order of the paper, with their margins."""
    claims = (*numbers(runs), *waves(runs, scattered), *spectra(runs), *forces(runs))
    return tuple(with_margins(claims, runs, CRITERIA))


def claims_table(claims: Sequence[Claim]) -> Table:
    """Return the table of the claims with their outcomes."""
    rows = []
    for claim in claims:
        margin = claim.margin or Margin(sentence="")
        row = (claim.id, claim.where, claim.outcome.value, claim.kind, claim.sentence, margin.sentence, margin.changes)
        rows.append(row)
    return PAPER.table("claims", CLAIMS_COLUMNS, rows)


def _left_out(hierarchy: ModelHierarchy, results: Sequence[Result]) -> tuple[LeftOut, ...]:
    """Return the model terms that may be left out of a chain; empty where one of its runs failed."""
    if any(result.trajectory is None for result in results):
        return ()
    bench = Bench(hierarchy)
    bench.take(results)
    return left_out(bench, JUDGED["passage"])


def _effects(runs: Runs) -> Iterator[Effect]:
    """Yield all terms of the budget of both chains."""
    for name in MAIN:
        truth, base = runs.truth(name), runs.truth(f"{name}.{AS_IS}")
        if truth is None:
            continue
        scene = runs.scenes[name]
        yield reference_uncertainty(scene, truth)
        for backend in TERMS:
            if (run := runs.run(name, backend)) is not None:
                yield effect(backend, scene, truth, run)
        for variant in VARIANTS:
            run = runs.truth(f"{name}.{variant.id}")
            if run is not None and base is not None and variant.id != AS_IS:
                yield effect(variant.id, scene, base, run)


def coverage_table(runs: Runs, names: Sequence[str], accuracy: float = DEFAULT_ACCURACY) -> Table:
    """Return the largest velocity error of each backend on each scene; empty where a backend does not support it."""
    others = [name for name in BACKENDS if name != REFERENCE]
    rows: list[tuple[str | float, ...]] = []
    for name in names:
        truth, row = runs.truth(name), []
        for other in others:
            run = runs.run(name, other)
            fits = run is not None and truth is not None
            row.append(difference("velocity", run, truth).value if fits else "")  # type: ignore[arg-type]
        rows.append((name, *row))
    return PAPER.table("coverage", ("scene", *others), rows, main=accuracy, others=max(accuracy, OTHER_ACCURACY))


def figures_of(runs: Runs, scattered: Sequence[ScatteredChains]) -> Iterator[FigureData]:
    """Yield the paper's figures whose scenes have run, and those of chains with scattered angles."""

    def runs_of(name: str) -> figures.ChainRuns:
        return figures.ChainRuns(runs.scenes[name], runs.by_backend(name))

    if all(runs.has(name) for name in MAIN):
        yield figures.figure_2(runs_of(DECELERATING), runs_of(ACCELERATING))
        yield figures.figure_3(runs_of(DECELERATING), runs_of(ACCELERATING))
    if all(runs.has(name) for name in LONG):
        yield figures.figure_4(*map(runs_of, LONG))
        yield figures.figure_4_spectra(*map(runs_of, LONG))
        yield figures.figure_5(*map(runs_of, LONG))
    maps = [f"{name}-{way}" for name in MAIN for way in ("lighter", "heavier")]
    if all(runs.has(name) for name in maps):
        yield figures.figure_6([runs_of(name) for name in maps], *(ratios(runs, name) for name in MAIN))
    yield from (scatter.figure(item) for item in scattered)
