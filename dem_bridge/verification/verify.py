"""Verify scenes: judge whether a LAMMPS simulation of them can be trusted, and how large each part of its error is.

It has three steps: :func:`dem_bridge.verification.roles.list_cases` lists the runs, ``run_cases`` makes them, and
:func:`dem_bridge.verification.assess.assess_scene` judges them.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from typing import Any

from dem_bridge.backends.base import Resolution, Sampling
from dem_bridge.errors import RunBroken, UnsupportedScene, UsageError
from dem_bridge.lmp.engine import Engine
from dem_bridge.observables.convergence import checked_accuracy
from dem_bridge.observables.verdict import Outcome, Verdict
from dem_bridge.report.drawer import prepare_drawing
from dem_bridge.report.study import check_setting
from dem_bridge.runs.cache import RunCache
from dem_bridge.runs.campaign import Jobs, Progress, Result, run_groups
from dem_bridge.runs.case import Case
from dem_bridge.runs.recall import recall, recall_prescan
from dem_bridge.runs.store import Store
from dem_bridge.runs.uncertainty.step_choice import step_for_accuracy
from dem_bridge.scene.scene import Scene
from dem_bridge.verification import checks
from dem_bridge.verification.assess import SceneStudy, assess_scene, named_failures
from dem_bridge.verification.budget import Budget
from dem_bridge.verification.pictures import begin_budget, begin_motion
from dem_bridge.verification.reference_choice import REFERENCE
from dem_bridge.verification.roles import Roles, Runs, assign_roles, list_cases
from dem_bridge.verification.under_way import UnderWay
from dem_bridge.verification.verification import TEXTS, Verification, verification_of

#: wanted accuracy of velocities where none is named; the paper's chains reach it at dt = 1e-8 s
DEFAULT_ACCURACY = 5e-6


def verify_scenes(
    scenes: Sequence[Scene],
    *,
    accuracy: float = DEFAULT_ACCURACY,
    jobs: Jobs = 1,
    progress: Progress | None = None,
    engine: Engine | None = None,
    store: Store | None = None,
    dt: float | None = None,
    under_way: UnderWay | None = None,
) -> Verification:
    """Run and judge scenes; the arguments are those of :func:`dem_bridge.verify`.

    ``under_way`` is given each scene as soon as its runs have ended.
    """
    start = time.perf_counter()
    names = [scene.name for scene in scenes]
    if len(set(names)) < len(names):
        raise UsageError(f"two scenes have the same name among {', '.join(names)}; give each its own")
    check_jobs(jobs)
    checked_accuracy(accuracy)
    cache = RunCache(store)
    plans = [plan_scene(scene, accuracy, engine=engine, cache=cache, dt=dt) for scene in scenes]
    under_way = under_way or UnderWay(accuracy=accuracy)
    assess = assess_when_ended(plans, under_way, store)

    def ended(number: int, results: Sequence[Result]) -> None:
        assess(number, results)
        if number < len(plans):
            begin_budget(under_way.studies[number])
        else:
            begin_motion(SceneStudy(roles=plans[number - len(plans)].roles, others=tuple(results), verdicts=()))

    groups = [*(plan.cases for plan in plans), *(plan.moving for plan in plans)]
    run_groups(groups, jobs=jobs, progress=progress, store=store, cache=cache, ended=ended)
    studies = tuple(under_way.studies[number] for number in range(len(plans)))
    notes = (store.trouble,) if store is not None and store.trouble else ()
    verification = verification_of(studies, accuracy=accuracy, wall=time.perf_counter() - start, notes=notes)
    return replace(verification, dt=dt)


@dataclass(frozen=True, kw_only=True)
class ScenePlan:
    """The runs to be made for one scene, or the reason why they could not be chosen."""

    roles: Roles
    accuracy: float
    runs: Runs[Case] | None = None
    """None: no settings could be chosen, and ``error`` says why."""
    others: tuple[Case, ...] = ()
    """Cases that no check reads: they stand beside the others in tables and figures."""
    error: RunBroken | UnsupportedScene | UsageError | None = None

    @property
    def cases(self) -> tuple[Case, ...]:
        """All cases, those of the roles first."""
        return (*(self.runs or ()), *self.others)

    @property
    def moving(self) -> tuple[Case, ...]:
        """The cases that the pictures of the motion show, in the order of :attr:`cases`."""
        return () if self.runs is None else (self.runs.theory, self.runs.engine)

    def assess(self, results: Sequence[Result], store: Store | None = None) -> SceneStudy:
        """Judge the results of :attr:`cases`, given in their order, unless the store has their verdicts."""
        if self.error is not None:
            study = study_without_runs(self.roles, self.error)
            runs = [result.trajectory for result in results if result.trajectory is not None]
            # the default step is made for the default accuracy, and there is no run at a finer one
            tolerance = max(self.accuracy, DEFAULT_ACCURACY)
            conserved = [verdict for run in runs for verdict in checks.conserved(self.roles, run, tolerance)]
            return replace(study, verdicts=(*study.verdicts, *conserved))
        assert self.runs is not None
        count = len(results) - len(self.others)
        filled = self.runs.filled(results[:count])

        def judge() -> dict[str, Any]:
            study = assess_scene(self.roles, filled, self.accuracy)
            return {name: getattr(study, name) for name in ("verdicts", "refinement", "budgets", "observables")}

        keys = [result.key for result in filled]
        how: dict[str, Any] = {"kinds": (Budget, Outcome, Verdict), "scenes": [self.roles.scene]}
        judged = recall(store, "assessment", keys, judge, accuracy=self.accuracy, **how)
        study = SceneStudy(roles=self.roles, runs=filled, others=tuple(results[count:]), **judged)
        verdicts = named_failures(study.scene.name, study.engine, study.run(study.engine), study.verdicts)
        return replace(study, verdicts=tuple(verdicts))


def assess_when_ended(
    plans: Sequence[ScenePlan], under_way: UnderWay, store: Store | None
) -> Callable[[int, Sequence[Result]], None]:
    """Return the function that judges the results of each plan as soon as all of them are there.

    It is called with the number of a group; groups beyond those of the plans are not judged.
    """
    under_way.scenes = tuple(plan.roles.scene.name for plan in plans)

    def assess(number: int, results: Sequence[Result]) -> None:
        if number < len(plans):
            under_way.studies[number] = plans[number].assess(results, store)

    return assess


def plan_scene(
    scene: Scene,
    accuracy: float,
    *,
    engine: Engine | None = None,
    cache: RunCache | None = None,
    full: bool = True,
    others: Sequence[Case] = (),
    dt: float | None = None,
) -> ScenePlan:
    """Choose the settings of the main runs and list the cases of a scene.

    ``dt``: time step of the main runs, s; None: it follows from the accuracy. ``cache`` keeps the runs of the choice,
    which are runs of the verification, and has the store of choices. A scene for which no settings can be chosen has a
    plan with the reason. Where no time step reaches the accuracy (no step does beyond the predictability horizon) one
    run at the default step is left, to judge conserved quantities by.
    """
    roles = assign_roles(scene)
    try:
        recall_prescan(None if cache is None else cache.store, scene)
        main = main_resolution(roles, accuracy, cache) if dt is None else Resolution(dt=dt)
        runs = list_cases(roles, main, engine=engine, full=full)
        return ScenePlan(roles=roles, accuracy=accuracy, runs=runs, others=tuple(others))
    except (RunBroken, UnsupportedScene) as error:
        return ScenePlan(roles=roles, accuracy=accuracy, error=error)
    except UsageError as error:
        names: dict[str, Any] = {"backend": roles.engine, "engine": engine, "uncertainty": False}
        default = Case(scene=scene, resolution=Resolution(), sampling=Sampling(count=scene.samples), **names)
        return ScenePlan(roles=roles, accuracy=accuracy, error=error, others=(default,))


def main_resolution(roles: Roles, accuracy: float, cache: RunCache | None = None) -> Resolution:
    """Choose the step of the main runs: the largest whose velocity uncertainty of LAMMPS is within ``accuracy``."""
    scene, tables, sampling = roles.scene, roles.takes_tables, Sampling(count=roles.scene.samples)
    store = cache.store if cache is not None else None

    def choose() -> float | None:
        prepare_drawing()  # further runs will follow
        try:
            return step_for_accuracy(scene, accuracy, Resolution(tables=tables), sampling, cache=cache).dt
        except UsageError:
            if not tables:
                raise
            # the error of the tables alone is too large at any step: verdicts then say how large it is
            return step_for_accuracy(scene, accuracy, Resolution(), sampling, cache=cache).dt

    return Resolution(dt=recall(store, "main step", [], choose, scenes=[scene], accuracy=accuracy, tables=tables))


def study_without_runs(roles: Roles, error: RunBroken | UnsupportedScene | UsageError) -> SceneStudy:
    """Return the study of a scene for which not even the runs could be chosen: one verdict with the reason."""
    outcomes = {RunBroken: Outcome.BROKEN, UnsupportedScene: Outcome.NOT_RUN, UsageError: Outcome.UNDECIDED}
    names = {"scene": roles.scene.name, "backend": roles.engine, "reference": REFERENCE}
    verdict = TEXTS.verdict("without_runs", **names, outcome=outcomes[type(error)], error=error)
    return SceneStudy(roles=roles, verdicts=(verdict,))


def check_jobs(jobs: object) -> None:
    """Raise UsageError unless ``jobs`` is a positive integer, an executor or None."""
    if jobs is not None and not isinstance(jobs, Executor):
        check_setting("jobs", jobs, "a whole number >= 1, or None for all cores", least=1)
