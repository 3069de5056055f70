"""Study of the predictability horizon: the time up to which single trajectories are known, and what holds beyond it.

Small differences grow: as a power of time in an open chain, whose bodies fly apart in the end, and exponentially, with
a Lyapunov exponent, in a closed one between two walls, where three and more bodies touch at once for ever. From some
time on two correct codes give different velocities, and a verdict on them says nothing. The study measures the growth
of a small perturbation of the input, and the time at which the uncertainty of each code's velocities (time step and
round-off, from the twins) exceeds 1 %: its horizon. Beyond it conserved quantities and statistics are judged, and
single velocities are UNDECIDED. A long run of the twin shows whether its energy drifts.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from dem_bridge.backends.base import Resolution, Sampling
from dem_bridge.backends.scene_prescan import prescan_scene
from dem_bridge.backends.steps import fixed_step_plan
from dem_bridge.backends.twin import solve_dense, solve_plan
from dem_bridge.errors import UsageError
from dem_bridge.lmp.engine import Engine
from dem_bridge.report.study import Study, check_setting
from dem_bridge.runs.campaign import Jobs, Progress, Result, run_cases
from dem_bridge.runs.case import Case
from dem_bridge.runs.costs import predicted_cost
from dem_bridge.runs.store import Store
from dem_bridge.runs.uncertainty.from_twins import twin_family
from dem_bridge.scene.scene import Scene
from dem_bridge.scene.timescales import contact_time_of
from dem_bridge.studies.horizon import runs
from dem_bridge.studies.horizon.verdicts import TEXTS, answer, figures, tables, verdicts
from dem_bridge.studies.recalled import recall_study
from dem_bridge.trajectory.dense import MOST_STEPS, Schedule
from dem_bridge.trajectory.trajectory import Trajectory
from dem_bridge.verification.reference_choice import REFERENCE
from dem_bridge.verification.roles import TWIN, assign_roles

#: relative perturbation of every input, and of one in its last digit
PERTURBATION, DIGIT = 1e-10, 2.0**-52
#: realisations of the last digit: of the reference and of the twin
DIGITS, TWIN_DIGITS = 6, 2
SAMPLES = 1000
#: seeds of perturbations by the last digit are apart from those of perturbations
_OTHER = 1_000_000


def study_horizon(
    scene: Scene,
    *,
    duration: float | None = None,
    dt: float | None = None,
    steps: int | None = None,
    perturbations: int = 8,
    seed: int = 0,
    engine: Engine | None = None,
    jobs: Jobs = None,
    progress: Progress | None = None,
    store: Store | None = None,
) -> Study:
    """Measure how long single velocities are predictable, and check what is conserved beyond that time.

    Parameters
    ----------
    scene : Scene
        Scene with an impact.
    duration : float, optional
        Duration of the runs that are compared, s. None: that of the scene.
    dt : float, optional
        Largest time step of LAMMPS and the twin, s. None: that of the backend.
    steps : int, optional
        Number of time steps of the long run of the twin. None: those of the duration.
    perturbations : int
        Number of runs of the reference whose inputs are changed by 1e-10.
    seed : int
        Seed of the first perturbation; each further one has the next.
    engine, jobs, progress, store : as in :func:`dem_bridge.study`

    Returns
    -------
    Study

    Raises
    ------
    UsageError
        For a setting out of its range, and for a scene in which nothing moves.
    """
    _check_settings(duration, steps, perturbations, seed)
    scene = replace(scene, duration=duration or scene.duration, samples=max(SAMPLES, scene.samples))
    plan = fixed_step_plan(scene, Resolution(dt=dt), Sampling(count=scene.samples), prescan_scene(scene))
    requested = plan.steps if steps is None else steps
    engine = engine or Engine.chosen()
    draws = {"perturbations": perturbations, "seed": seed}

    def measured() -> Study:
        return _measured(scene, plan, requested, draws, engine, {"jobs": jobs, "store": store}, progress)

    return recall_study("horizon", store, measured, scene, engine, step=plan.step, steps=requested, **draws)


def _measured(
    scene: Scene,
    plan: Schedule,
    requested: int,
    draws: Mapping[str, int],
    engine: Engine,
    campaign: Mapping[str, Any],
    progress: Progress | None,
) -> Study:
    """Run and judge; ``requested``: steps of the long run, ``draws``: number and first seed of the perturbations."""
    perturbations, seed = draws["perturbations"], draws["seed"]
    digits = [runs.perturbed(scene, DIGIT, _OTHER + seed + i) for i in range(DIGITS)]
    moved = [runs.perturbed(scene, PERTURBATION, seed + i) for i in range(perturbations)]
    cases = _cases([scene, *moved, *digits], plan.step, engine)
    # seconds, roughly: for the share that each part of the work has in its progress
    compared = sum(case.expected for case in cases)
    stepped = predicted_cost(TWIN, scene, steps=requested, samples=SAMPLES)
    first, second, third = _stages(progress, (compared, stepped, 0.25 * stepped))
    *references, lmp = run_cases(cases, progress=first, **campaign)
    if failures := [reference.failure for reference in references if reference.failure is not None]:
        raise failures[0]
    truth, *others = (reference.trajectory for reference in references if reference.trajectory is not None)
    ensemble, last = others[:perturbations], others[perturbations:]
    scale = float(np.max(np.abs(truth.velocity)))
    if scale == 0.0:
        raise UsageError(f"nothing moves in {scene.name}, so that nothing can part; allowed: a scene with an impact")
    distance = np.array([runs.apart(item.velocity, truth.velocity, scale) for item in ensemble])
    trusts = _trusts(scene, plan, truth, last, digits, lmp)
    between_walls = scene.wall_left is not None and scene.wall_right is not None
    long = runs.long_run(scene, plan.step, requested, progress=second)
    halved = runs.long_run(scene, 0.5 * plan.step, max(requested // 4, 1), progress=third) if long.complete else None
    result = runs.Found(
        scene=scene,
        plan=plan,
        perturbation=PERTURBATION,
        distance=distance,
        growth=runs.growth_of(truth.time, distance, PERTURBATION, closed=between_walls),
        trusts=trusts,
        ensemble=tuple(ensemble),
        long=long,
        halved=halved if halved is not None and halved.complete else None,
        contact_time=contact_time_of(scene) or math.nan,
    )
    return _study(result, lmp, draws)


def _study(result: runs.Found, lmp: Result, settings: Mapping[str, int]) -> Study:
    """Return the study of what was found; ``settings`` are those that its provenance adds to the time step."""
    scene, created = result.scene, verdicts(result)
    not_run = () if lmp.failure is None else (TEXTS("engine", failure=lmp.failure),)
    stepped = {"dt": result.plan.step, "steps": result.long.steps}
    return TEXTS.study(
        {"scene": scene.name},
        answer=tuple(answer(result, created)),
        tables=tables(result, created),
        figures=figures(result),
        verdicts=created,
        notes=(*not_run, *TEXTS.notes()),
        interrupted=result.halved is None,
        provenance={"scene": scene.name, "scene_hash": scene.content_hash, **stepped, **settings},
    )


def _check_settings(duration: float | None, steps: int | None, perturbations: int, seed: int) -> None:
    """Raise UsageError for a setting out of its range."""
    if duration is not None:
        check_setting("duration", duration, "a number > 0 (s), or None for the scene's")
    if steps is not None:
        check_setting("steps", steps, f"a whole number from 1 to {MOST_STEPS:.0e}, or None", least=1, most=MOST_STEPS)
    check_setting("perturbations", perturbations, "a whole number from 2 to 1000", least=2, most=1000)
    check_setting("seed", seed, f"a whole number from 0 to {_OTHER - 1000}", least=0, most=_OTHER - 1000)


def _cases(scenes: Sequence[Scene], step: float, engine: Engine | None) -> list[Case]:
    """Return a case of the reference for each scene, and one of LAMMPS for the first."""
    sampling = Sampling(count=scenes[0].samples)
    cases = [
        Case(scene=each, backend=REFERENCE, resolution=Resolution(), sampling=sampling, uncertainty=False)
        for each in scenes
    ]
    judged = assign_roles(scenes[0]).engine
    return [*cases, replace(cases[0], backend=judged, resolution=Resolution(dt=step), engine=engine)]


def _trusts(
    scene: Scene, plan: Schedule, truth: Trajectory, last: Sequence[Trajectory], digits: Sequence[Scene], lmp: Result
) -> tuple[runs.Trust, ...]:
    """Return how long the velocities of the reference, the twin and LAMMPS are known.

    ``last`` are the runs of the reference of the scenes ``digits``, whose inputs differ in the last digit.
    """
    scale = float(np.max(np.abs(truth.velocity)))
    own_value, dense = solve_dense(scene, plan, 0.0)
    twins = twin_family(scene, Resolution(dt=plan.step), Sampling(count=scene.samples))
    if twins is None:
        raise UsageError(
            f"dt = {plan.step:g} s takes {plan.steps:.2g} steps, too many for twins at finer ones to make a bar of;"
            " allowed: a larger dt or a shorter duration"
        )
    rounded = [solve_plan(digit, plan).velocity for digit in digits[:TWIN_DIGITS]]
    twin_velocity, positional, by_step = own_value.velocity, [twins.positional.velocity], runs.step_bar(twins, scale)
    bars = {
        REFERENCE: runs.reference_bar(truth.velocity, [item.velocity for item in last], scale),
        TWIN: by_step + runs.round_off_bar(twin_velocity, rounded, plan, scale),
        lmp.case.backend: by_step + runs.round_off_bar(twin_velocity, positional, plan, scale),
    }
    solved = {REFERENCE: truth, TWIN: own_value}
    if lmp.trajectory is not None:
        solved[lmp.case.backend] = lmp.trajectory
    closed = np.sum((dense.overlap[1:] > 0.0) & (dense.overlap[:-1] <= 0.0), axis=1)
    when = plan.dense_steps[1:] * plan.step

    def trust(name: str, run: Trajectory) -> runs.Trust:
        horizon = runs.horizon_of(truth.time, bars[name])
        return runs.Trust(
            backend=name,
            bar=bars[name],
            error=None if name == REFERENCE else runs.apart(run.velocity, truth.velocity, scale),
            run=run,
            horizon=horizon,
            collisions=float(np.sum(closed[when <= horizon])) if plan.resolved else math.nan,
        )

    return tuple(trust(name, run) for name, run in solved.items())


def _stages(progress: Progress | None, sizes: tuple[float, ...]) -> list[Progress | None]:
    """Return for each part of the work its share of the progress, so that all parts together go once from 0 to 1."""
    if progress is None:
        return [None] * len(sizes)
    report, whole = progress, sum(sizes)

    def stage(before: float, size: float) -> Progress:
        return lambda done, total, label: report((before + size * (done / total)) / whole, 1, label)

    return [stage(sum(sizes[:nth]), size) for nth, size in enumerate(sizes)]
