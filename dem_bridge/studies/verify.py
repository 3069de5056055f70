"""Verify scenes: can a LAMMPS simulation of them be trusted, and what does it differ by?

Each difference isolates one cause:

=========================  ==========================================================================
LAMMPS minus twin          same algorithm, same step, same tables if any: implementation and round-off
  ... twin in positions    the same round-off too: implementation alone
twin minus reference       same equations: the time step
LAMMPS minus reference     both, the error a user has
scipy minus reference      nothing: two methods that share no code, each within its bar; where the reference is scipy's
                           own answer, the method of Blanes & Moan stands for it
BCA minus reference        other equations: a model difference, never pass or fail
=========================  ==========================================================================
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dem_bridge.accuracy import checked_accuracy
from dem_bridge.backends.base import Resolution, Sampling, backend
from dem_bridge.backends.blanes_moan import PHASE
from dem_bridge.backends.reference import series_fit
from dem_bridge.backends.steps import default_step
from dem_bridge.backends.tabled import prescan_scene
from dem_bridge.campaign import Case, Progress, Result, run_cases
from dem_bridge.compare import difference
from dem_bridge.errors import RunBroken, UnsupportedScene, UsageError
from dem_bridge.lmp.engine import Engine
from dem_bridge.notebook import verification_html
from dem_bridge.planning.bars import resolution_for
from dem_bridge.scene import Scene
from dem_bridge.store import Store, study_key
from dem_bridge.studies.study import Paper
from dem_bridge.trajectory import Trajectory
from dem_bridge.verification import checks
from dem_bridge.verification.budget import Budget, allowance, budgets
from dem_bridge.verification.checks import FINER, REFERENCE, SECOND, TABLE, THEORY, THIRD, TWIN, engine_for
from dem_bridge.verification.verdict import Outcome, Verdict, exit_code

#: wanted accuracy of velocities where none is named; the paper's chains reach it at dt = 1e-8 s
DEFAULT_ACCURACY = 5e-6
#: steps of the convergence ladder, in units of the main step
REFINEMENT = (10.0, 5.0, 2.5, 1.25)


@dataclass(frozen=True, kw_only=True)
class SceneStudy:
    """All that was found for one scene."""

    scene: Scene
    results: tuple[Result, ...]
    verdicts: tuple[Verdict, ...]
    refinement: dict[str, tuple[list[float], list[float]]]
    """backend -> (steps in s, velocity errors relative to the reference's largest velocity)."""
    budgets: tuple[Budget, ...] = ()
    """Of LAMMPS' main run, one per quantity."""

    @property
    def engine(self) -> str:
        """The backend that is verified."""
        return engine_for(self.scene)

    def run(self, backend: str) -> Trajectory | None:
        """The run of that backend at the main resolution."""
        return _main(self.results, backend).trajectory if self.results else None


@dataclass(frozen=True, kw_only=True)
class Verification:
    """Result of :func:`verify_scenes`."""

    studies: tuple[SceneStudy, ...]
    accuracy: float
    wall: float
    """s, for all of it."""
    paper: Paper | None = None
    """What was found for the paper as a whole, where that was asked."""
    notes: tuple[str, ...] = ()
    """What a user should know of how it was made, a line each."""

    @property
    def verdicts(self) -> tuple[Verdict, ...]:
        return tuple(verdict for study in self.studies for verdict in study.verdicts)

    @property
    def exit_code(self) -> int:
        return exit_code(verdict.outcome for verdict in self.verdicts)

    def _repr_html_(self) -> str:
        return verification_html(self)


def verify_scenes(
    scenes: Sequence[Scene],
    *,
    accuracy: float = DEFAULT_ACCURACY,
    jobs: int | None = 1,
    progress: Progress | None = None,
    engine: Engine | None = None,
    store: Store | None = None,
) -> Verification:
    """Run and judge scenes; arguments as of :func:`dem_bridge.verify`."""
    began = time.perf_counter()
    names = [scene.name for scene in scenes]
    if len(set(names)) < len(names):
        raise UsageError(f"two scenes have the same name among {', '.join(names)}; give each its own")
    check_jobs(jobs)
    checked_accuracy(accuracy)
    cases: list[Case] = []
    lost: dict[str, SceneStudy] = {}
    for scene in scenes:
        try:
            cases += cases_of(scene, accuracy, engine, store)
        except (RunBroken, UnsupportedScene, UsageError) as error:  # this scene's, not the others'
            lost[scene.name] = hopeless(scene, error)
            if isinstance(error, UsageError):
                cases.append(beyond(scene, engine))
    results = run_cases(cases, jobs=jobs, progress=progress, store=store)
    studies = []
    for scene in scenes:
        mine = tuple(r for r in results if r.case.scene.name == scene.name)
        found = lost.get(scene.name)
        studies.append(study_of(scene, mine, accuracy) if found is None else with_conserved(found, mine, accuracy))
    notes = (store.trouble,) if store is not None and store.trouble else ()
    return Verification(studies=tuple(studies), accuracy=accuracy, wall=time.perf_counter() - began, notes=notes)


def check_jobs(jobs: object) -> None:
    """Whether so many runs can be made at a time; UsageError, in one line, if not."""
    if jobs is not None and (isinstance(jobs, bool) or not isinstance(jobs, int) or jobs < 1):
        raise UsageError(f"jobs = {jobs!r}; allowed: a whole number >= 1, or None for all cores")


def hopeless(scene: Scene, error: RunBroken | UnsupportedScene | UsageError) -> SceneStudy:
    """A scene for which not even the runs could be chosen."""
    outcomes = {RunBroken: Outcome.BROKEN, UnsupportedScene: Outcome.NOT_RUN, UsageError: Outcome.UNDECIDED}
    verdict = Verdict(
        scene=scene.name,
        quantity="velocity",
        backend=engine_for(scene),
        reference=REFERENCE,
        outcome=outcomes[type(error)],
        sentence=f"{error}.",
    )
    return SceneStudy(scene=scene, results=(), verdicts=(verdict,), refinement={})


def beyond(scene: Scene, engine: Engine | None = None) -> Case:
    """The one run of a scene whose velocities no step decides (beyond their horizon none does): at the default step."""
    judged, sampling = engine_for(scene), Sampling(count=scene.samples)
    return Case(scene=scene, backend=judged, resolution=Resolution(bars=False), sampling=sampling, engine=engine)


def with_conserved(study: SceneStudy, results: tuple[Result, ...], accuracy: float) -> SceneStudy:
    """A scene without verdicts on velocities with those on what is conserved, from the run of :func:`beyond`."""
    runs = [one.trajectory for one in results if one.trajectory is not None]
    # the default step is made for the default accuracy, and no other was to be had
    made = [v for run in runs for v in checks.conserved(study.scene, run, max(accuracy, DEFAULT_ACCURACY))]
    return replace(study, verdicts=(*study.verdicts, *made))


def cases_of(
    scene: Scene, accuracy: float, engine: Engine | None = None, store: Store | None = None, *, full: bool = True
) -> list[Case]:
    """The runs that a verdict on one scene needs; the main run of each backend first. ``engine``: which LAMMPS;
    ``full``: with the longer steps from which the order of convergence is told, and with scipy's own error bars."""
    sampling, judged = Sampling(count=scene.samples), engine_for(scene)
    key = study_key("main step", [scene], accuracy=accuracy, tables=judged == TABLE) if store is not None else None
    known = store.load_arrays(key) if store is not None and key is not None else None
    if known is not None:
        main = Resolution(dt=float(known["dt"]))
    else:
        main = _main_resolution(scene, accuracy, sampling, tables=judged == TABLE)
        if store is not None and key is not None:
            store.save_arrays(key, {"dt": np.array(main.dt)})
    assert main.dt is not None
    coarse = [replace(main, dt=factor * main.dt, bars=False) for factor in REFINEMENT if full]
    references = [(REFERENCE, Resolution())]
    if series_fit(scene):
        references.append((SECOND, Resolution(bars=full)))
    elif backend(THIRD).refusal(scene) is None:
        # the reference is scipy's own answer
        step = default_step(scene, sampling, prescan_scene(scene), PHASE) / FINER
        references.append((THIRD, Resolution(dt=step)))
    runs = [*references, (THEORY, Resolution())]
    runs += [(name, settings) for name in (TWIN, judged) for settings in (main, *coarse)]
    # beside the twin, step by step on the way to what LAMMPS does: its tables, if any, then positions
    beside = replace(main, tables=judged == TABLE, bars=False)
    runs += [(TWIN, beside)] if beside.tables else []
    runs.append((TWIN, replace(beside, surrogate_radius=prescan_scene(scene).surrogate_radius)))
    return [
        Case(
            scene=scene,
            backend=name,
            resolution=settings,
            sampling=sampling,
            engine=engine if name == judged else None,
        )
        for name, settings in runs
    ]


def _main_resolution(scene: Scene, accuracy: float, sampling: Sampling, *, tables: bool) -> Resolution:
    """Settings of the main runs, with the step for LAMMPS' own bar."""
    try:
        found = resolution_for(scene, accuracy, Resolution(tables=tables), sampling)
    except UsageError:
        if not tables:
            raise
        # no step makes room for the error of the tables: with that of the laws the verdicts say how large it is
        found = resolution_for(scene, accuracy, Resolution(), sampling)
    return replace(found, tables=False)


def study_of(scene: Scene, results: tuple[Result, ...], accuracy: float) -> SceneStudy:
    """Judge the results of one scene; nothing is run here."""
    truth = _main(results, REFERENCE).trajectory
    verdicts: list[Verdict] = []
    refinement: dict[str, tuple[list[float], list[float]]] = {}
    budget: tuple[Budget, ...] = ()
    judged = engine_for(scene)
    for name in (REFERENCE, SECOND, TWIN, judged, THEORY):
        failed = _main(results, name)
        if failed.failure is not None:
            verdicts.append(checks.absent(scene, name, failed))
    second = _second(results)
    if second.case.backend == THIRD and second.failure is not None:
        verdicts.append(checks.absent(scene, THIRD, second))
    engine, twin, theory = (_main(results, name).trajectory for name in (judged, TWIN, THEORY))
    *tables, positional = (r.trajectory for r in results if _is_beside(r))
    tabled = tables[0] if tables else None
    if engine is not None and "table" in engine.provenance:
        verdicts += checks.table(scene, engine)
    if engine is not None and twin is not None:
        verdicts.append(checks.implementation(scene, engine, tabled or twin))
        if positional is not None and truth is not None:
            budget = budgets(engine, twin, positional, truth, tabled)
            allowed = {one.quantity: one.allowed for one in budget}
            # contact forces have no bar of their own, but they are explained all the same
            allowed["contact_force"] = allowance("contact_force", twin, positional, tabled)
            verdicts += [
                checks.explained(scene, quantity, engine, positional, allowed=bound)
                for quantity, bound in allowed.items()
            ]
    if truth is not None:
        if second.trajectory is not None:
            verdicts.append(checks.two_methods(scene, second.trajectory, truth))
        for name in (TWIN, judged):
            run = _main(results, name).trajectory
            if run is None:
                continue
            verdicts += checks.accuracy(scene, name, run, truth, accuracy)
            refinement[name] = _refinement(results, name, truth)
            known = truth
            if name == judged and tabled is not None and twin is not None:
                # what tables miss falls with no step: of errors below it no order can be told
                bar = truth.uncertainty["velocity"] + float(np.max(np.abs(tabled.velocity - twin.velocity)))
                known = replace(truth, uncertainty={**truth.uncertainty, "velocity": bar})
            if len(refinement[name][0]) > 1:
                verdicts.append(checks.order(scene, name, refinement[name], known))
        if theory is not None:
            verdicts += checks.model(scene, theory, truth)
    if engine is not None:
        verdicts += checks.conserved(scene, engine, accuracy, truth)
    return SceneStudy(scene=scene, results=results, verdicts=tuple(verdicts), refinement=refinement, budgets=budget)


def _main(results: tuple[Result, ...], backend: str) -> Result:
    # where the reference is scipy's own answer, its run stands for scipy's
    names = (SECOND, REFERENCE) if backend == SECOND else (backend,)
    return next(r for name in names for r in results if r.case.backend == name)


def _second(results: tuple[Result, ...]) -> Result:
    """What stands beside the reference: scipy, or where that is the reference another method, or nothing else."""
    if any(r.case.backend == SECOND for r in results):
        return _main(results, SECOND)
    # it may have been run for other questions, too, without bars
    with_bars = (r for r in results if r.case.backend == THIRD and r.case.resolution.bars)
    return next(with_bars, _main(results, REFERENCE))


def _is_beside(result: Result) -> bool:
    """Whether it is the twin with what LAMMPS has beside the law: tables, positions."""
    how = result.case.resolution
    return result.case.backend == TWIN and (how.tables or how.surrogate_radius is not None)


def _refinement(results: tuple[Result, ...], name: str, truth: Trajectory) -> tuple[list[float], list[float]]:
    mine = [r for r in results if r.case.backend == name and not _is_beside(r)]
    runs = [r.trajectory for r in mine if r.trajectory is not None]
    steps = [float(run.provenance["settings"]["dt"]) for run in runs]
    errors = [difference("velocity", run, truth).value for run in runs]
    order = np.argsort(steps)[::-1]
    return [steps[i] for i in order], [errors[i] for i in order]
