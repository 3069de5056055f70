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
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from dem_bridge.backends.base import Resolution, Sampling
from dem_bridge.backends.steps import fixed_step_plan
from dem_bridge.backends.tabled import prescan_scene
from dem_bridge.backends.twin import solve_dense, solve_plan
from dem_bridge.errors import UsageError
from dem_bridge.lmp.engine import Engine
from dem_bridge.observables.verdict import Outcome, Verdict
from dem_bridge.report.study import FigureData, Series, Study, Table, check_setting
from dem_bridge.report.texts import Texts, verdict_table
from dem_bridge.runs.campaign import Jobs, Progress, run_cases
from dem_bridge.runs.case import Case
from dem_bridge.runs.store import Store
from dem_bridge.runs.uncertainty.twins import twin_family
from dem_bridge.scene.scene import Scene
from dem_bridge.scene.timescales import contact_time_of
from dem_bridge.studies.horizon import runs
from dem_bridge.studies.horizon.runs import KNOWN, Found, LongRun, horizon_of
from dem_bridge.studies.horizon.verdicts import independent_from, verdicts
from dem_bridge.trajectory.dense import MOST_STEPS
from dem_bridge.trajectory.trajectory import Floats, Trajectory
from dem_bridge.verification.roles import REFERENCE, TWIN, assign_roles

TEXTS = Texts("horizon", "dem_bridge.studies")
#: points of a line of a long run, and least value that is drawn
_POINTS, _LEAST = 1000, 1e-18


def tables(result: Found, judged: Sequence[Verdict]) -> tuple[Table, ...]:
    """Return the horizons, the growth, the long run, and all verdicts."""
    g = result.growth
    horizons = [
        (
            trust.backend,
            trust.horizon,
            trust.horizon / result.contact_time,
            trust.collisions,
            trust.last,
            math.nan if trust.error is None else float(trust.error[-1]),
            math.nan if trust.error is None else horizon_of(result.truth.time, trust.error),
        )
        for trust in result.trusts
    ]
    folding = 1.0 / (g.rate * result.contact_time) if g.exponential else math.nan
    growth = [(g.kind, g.rate, g.bar, folding, *g.window, *g.misfit, g.factor)]
    return (
        TEXTS.table("horizons", horizons),
        TEXTS.table("growth", growth, count=len(result.distance), perturbation=result.perturbation),
        TEXTS.table("long", [_long_row(item) for item in (result.long, result.halved) if item is not None]),
        verdict_table(judged),
    )


def _long_row(long_run: LongRun) -> tuple[str | float, ...]:
    nan, drift = math.nan, long_run.drift
    predicted, swing = long_run.swing
    stored = float(np.mean(long_run.stored))
    return (
        long_run.dt,
        float(long_run.steps),
        float(long_run.time[-1]),
        *(drift.total if drift is not None else (nan, nan)),
        "too short" if drift is None else "yes" if drift.found else "no",
        swing,
        predicted,
        float(np.mean(long_run.kinetic)) / stored if stored > 0.0 else nan,
    )


def figures(result: Found) -> tuple[FigureData, ...]:
    """Return the distances over time, the energy of the long run, and the velocities beyond the horizon."""
    created = [_parting(result)]
    if len(result.long.time) > 2:
        created.append(_energy(result.long))
    first = independent_from(result)
    if first is not None:
        created.append(_distribution(result, first))
    return tuple(created)


def _parting(result: Found) -> FigureData:
    time = 1e3 * result.truth.time
    middle = np.exp(np.mean(np.log(np.maximum(result.distance, _LEAST)), axis=0))

    def line(label: str, style: str, y: Floats) -> Series:
        return Series(label=label, style=style, x=time, y=np.log10(np.maximum(y, _LEAST)))

    perturbations = (
        line(f"inputs moved by {result.perturbation:g}", "reference", middle),
        line("the nearest", "guide", np.min(result.distance, axis=0)),
        line("the farthest", "guide", np.max(result.distance, axis=0)),
    )
    styles = {REFERENCE: "adiabatic", TWIN: "bca"}
    codes = [
        line(f"uncertainty of {trust.backend}", styles.get(trust.backend, trust.backend), trust.bar)
        for trust in result.trusts
    ]
    codes += [
        line(f"{trust.backend} - reference", "fit" if trust.backend == TWIN else "ode45", trust.error)
        for trust in result.trusts
        if trust.error is not None
    ]
    codes.append(Series(label="1 %", style="guide", x=time[[0, -1]], y=np.log10([KNOWN, KNOWN])))
    return TEXTS.figure("horizon", [TEXTS.panel("growth", perturbations), TEXTS.panel("codes", tuple(codes))])


def _energy(long: LongRun) -> FigureData:
    every = max(1, len(long.time) // _POINTS)
    time, drift = long.time[::every], long.drift
    energy, kept = ((item - long.conserved[0]) / long.scale for item in (long.total, long.conserved))
    unit = 10.0 ** math.floor(math.log10(max(float(np.max(np.abs(energy))), _LEAST)))
    series = [
        Series(label="energy", style="guide", x=time, y=energy[::every] / unit),
        Series(label="conserved by the method", style="reference", x=time, y=kept[::every] / unit),
    ]
    panel = TEXTS.panel("energy", unit=unit)
    if drift is not None:
        line = float(np.mean(kept)) + drift.slope * (time - float(np.mean(long.time)))
        series.append(Series(label="fitted drift", style="fit", x=time, y=line / unit))
        total, bar = drift.total
        note = f"drift {total:+.1e} +- {bar:.1e} over {long.steps:.3g} steps of {long.dt:.3g} s"
        panel = replace(panel, notes=(note,))
    return TEXTS.figure("horizon-energy", [replace(panel, series=tuple(series))])


def _distribution(result: Found, first: int) -> FigureData:
    root = np.sqrt(np.array(result.scene.mass))
    edges = np.linspace(-4.0, 4.0, 41)
    middle = 0.5 * (edges[1:] + edges[:-1])

    def density(label: str, style: str, runs: Sequence[Trajectory]) -> Series:
        values = np.concatenate([(run.velocity[first:] * root).ravel() for run in runs])
        scaled = values / np.sqrt(np.mean(values**2))
        return Series(label=label, style=style, x=middle, y=np.histogram(scaled, bins=edges, density=True)[0])

    series = [density("reference, independent runs", "reference", (result.truth, *result.ensemble))]
    for trust in result.trusts[1:]:
        series.append(density(trust.backend, "bca" if trust.backend == TWIN else trust.backend, [trust.run]))
    normal = np.exp(-0.5 * middle**2) / math.sqrt(2.0 * math.pi)
    series.append(Series(label="normal", style="guide", x=middle, y=normal))
    panel = TEXTS.panel("velocities", tuple(series), scene=result.scene.name)
    return TEXTS.figure("horizon-distribution", [panel], ms=1e3 * float(result.truth.time[first]))


def answer(result: Found, judged: Sequence[Verdict]) -> Iterator[str]:
    """Yield the answer in sentences, the horizons first."""
    g, scene, contact_time = result.growth, result.scene, result.contact_time

    def in_contact_times(key: str, time: float) -> str:
        # a chain that is driven from rest has no collision to count by
        return TEXTS(key, number=time / contact_time) if math.isfinite(contact_time) else ""

    for trust in result.trusts:
        if math.isinf(trust.horizon):
            yield TEXTS("known", trust=trust, scene=scene)
            continue
        at = TEXTS("at", dt=result.plan.step) if trust.backend != REFERENCE else ""
        contacts = in_contact_times("contact_times", trust.horizon)
        yield TEXTS("until", trust=trust, scene=scene, at=at, ms=1e3 * trust.horizon, contacts=contacts)
    fits = TEXTS("fits", g=g)
    if g.kind != "exponential":
        yield TEXTS("neither" if g.kind == "neither" else "power", g=g, fits=fits)
    else:
        time = 1.0 / g.rate
        contacts, count = in_contact_times("in_contact_times", time), len(result.distance)
        yield TEXTS("exponential", g=g, fits=fits, time=time, contacts=contacts, count=count, digit=2.302585 * time)
    drift = result.long.drift
    if drift is not None:
        significant = "significantly different" if drift.found else "not significantly different"
        yield TEXTS("drift", long=result.long, drift=drift, significant=significant)
        if result.halved is not None:
            until = float(result.halved.time[-1])
            ratio = result.long.predicted_swing(until) / result.halved.predicted_swing(until)
            yield TEXTS("halved", ratio=ratio, until=until)
    beyond = [item for item in judged if item.quantity != "velocity"]
    yield TEXTS("beyond", passed=sum(item.outcome is Outcome.PASS for item in beyond), count=len(beyond))


#: relative perturbation of every input, and of one in its last digit
PERTURBATION, DIGIT = 1e-10, 2.0**-52
#: realisations of the last digit: of the reference and of the twin
DIGITS, TWIN_DIGITS = 6, 2
SAMPLES = 1000
#: s of one core for a body and step of the twin, roughly
_PER_STEP = 5e-9
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
    if duration is not None:
        check_setting("duration", duration, "a number > 0 (s), or None for the scene's")
    if steps is not None:
        check_setting("steps", steps, f"a whole number from 1 to {MOST_STEPS:.0e}, or None", least=1, most=MOST_STEPS)
    check_setting("perturbations", perturbations, "a whole number from 2 to 1000", least=2, most=1000)
    check_setting("seed", seed, f"a whole number from 0 to {_OTHER - 1000}", least=0, most=_OTHER - 1000)
    scene = replace(scene, duration=duration or scene.duration, samples=max(SAMPLES, scene.samples))
    sampling = Sampling(count=scene.samples)
    plan = fixed_step_plan(scene, Resolution(dt=dt), sampling, prescan_scene(scene))
    judged = assign_roles(scene).engine
    moved = [runs.perturbed(scene, PERTURBATION, seed + i) for i in range(perturbations)]
    digits = [runs.perturbed(scene, DIGIT, _OTHER + seed + i) for i in range(DIGITS)]
    cases = [
        Case(scene=each, backend=REFERENCE, resolution=Resolution(), sampling=sampling, uncertainty=False)
        for each in (scene, *moved, *digits)
    ]
    cases.append(replace(cases[0], backend=judged, resolution=Resolution(dt=plan.step), engine=engine))
    requested = plan.steps if steps is None else steps
    # seconds, roughly: for the share that each part of the work has in its progress
    compared, stepped = sum(case.expected for case in cases), _PER_STEP * scene.n_body * requested
    first, second, third = _stages(progress, (compared, stepped, 0.25 * stepped))
    *references, lmp = run_cases(cases, jobs=jobs, progress=first, store=store)
    for reference in references:
        if reference.failure is not None:
            raise reference.failure
    truth, *others = (reference.trajectory for reference in references if reference.trajectory is not None)
    ensemble, last = others[:perturbations], others[perturbations:]
    scale = float(np.max(np.abs(truth.velocity)))
    if scale == 0.0:
        raise UsageError(f"nothing moves in {scene.name}, so that nothing can part; allowed: a scene with an impact")
    distance = np.array([runs.apart(item.velocity, truth.velocity, scale) for item in ensemble])
    own_value, dense = solve_dense(scene, plan, 0.0)
    twins = twin_family(scene, Resolution(dt=plan.step), sampling)
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
        judged: by_step + runs.round_off_bar(twin_velocity, positional, plan, scale),
    }
    solved = {REFERENCE: truth, TWIN: own_value} | ({judged: lmp.trajectory} if lmp.trajectory is not None else {})
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

    between_walls = scene.wall_left is not None and scene.wall_right is not None
    long = runs.long_run(scene, plan.step, requested, progress=second)
    halved = runs.long_run(scene, 0.5 * plan.step, max(requested // 4, 1), progress=third) if long.complete else None
    result = runs.Found(
        scene=scene,
        plan=plan,
        perturbation=PERTURBATION,
        distance=distance,
        growth=runs.growth_of(truth.time, distance, PERTURBATION, closed=between_walls),
        trusts=tuple(trust(name, run) for name, run in solved.items()),
        ensemble=tuple(ensemble),
        long=long,
        halved=halved if halved is not None and halved.complete else None,
        contact_time=contact_time_of(scene) or math.nan,
    )
    created = verdicts(result)
    not_run = () if lmp.failure is None else (TEXTS("engine", failure=lmp.failure),)
    return TEXTS.study(
        {"scene": scene.name},
        answer=tuple(answer(result, created)),
        tables=tables(result, created),
        figures=figures(result),
        verdicts=created,
        notes=(*not_run, *TEXTS.notes()),
        interrupted=result.halved is None,
        provenance={
            "scene": scene.name,
            "scene_hash": scene.content_hash,
            "dt": plan.step,
            "steps": long.steps,
            "perturbations": perturbations,
            "seed": seed,
        },
    )


def _stages(progress: Progress | None, sizes: tuple[float, ...]) -> list[Progress | None]:
    """Return for each part of the work its share of the progress, so that all parts together go once from 0 to 1."""
    if progress is None:
        return [None] * len(sizes)
    report, whole = progress, sum(sizes)

    def stage(before: float, size: float) -> Progress:
        return lambda done, total, label: report((before + size * done / total) / whole, 1, label)

    return [stage(sum(sizes[:nth]), size) for nth, size in enumerate(sizes)]
