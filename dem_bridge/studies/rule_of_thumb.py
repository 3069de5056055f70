"""DEM's rule of thumb judged: what velocity-Verlet errs by at a share of the Rayleigh time.

Granular codes are run at 10 to 40 % of :func:`~dem_bridge.physics.rayleigh.rayleigh_time`, and what users then look at
is whether momentum and energy hold. Here the velocities are looked at too, which are what a chain is run for.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from dem_bridge.backends.base import Resolution, Sampling
from dem_bridge.backends.tabled import prescan_scene
from dem_bridge.campaign import Progress, Result, run_cases
from dem_bridge.differences import difference
from dem_bridge.lmp.engine import Engine
from dem_bridge.observables.conserved import energy_parts, momentum
from dem_bridge.runs.case import Case
from dem_bridge.runs.store import Store
from dem_bridge.scene import Scene
from dem_bridge.scene_file import load_scene, shipped_scenes
from dem_bridge.studies.study import FigureData, Panel, Series, Study, Table
from dem_bridge.timescales import contact_time_of, rayleigh_time_of
from dem_bridge.trajectory import Trajectory

#: of the Rayleigh time; each step is a whole number of the finer ones
SHARES = (0.05, 0.10, 0.20, 0.40)
#: shares at which LAMMPS itself is run, for one scene
ENGINE_SHARES = (0.10, 0.20)
TWIN, ENGINE, TRUTH = "verlet", "lammps-granular", "reference"
#: local tolerance of the reference where it answers through scipy: errors are below 1e-6, those looked at above 1e-4
TRUTH_RTOL = 1e-8
MOST_SAMPLES = 2000


@dataclass(frozen=True, kw_only=True)
class Shared:
    """What a run at a share of the Rayleigh time errs by, all against the reference."""

    share: float
    """Of the Rayleigh time, as it was run: so that steps fall on samples, a little less than what was asked."""
    velocity: float
    """Largest over all samples and bodies, relative to the largest velocity."""
    momentum: float
    """Largest over all samples, relative to the largest momentum."""
    kinetic: float
    """Of the kinetic energy at the end, which is what a log ends with; relative."""


@dataclass(frozen=True, kw_only=True)
class Judged:
    """One scene at all shares; none where it has no Rayleigh time, with the reason."""

    scene: Scene
    rayleigh: float
    """s; nan: the scene does not say what its bodies are."""
    contact: float
    """s: shortest two-body collision at the largest start velocity; nan where nothing moves."""
    stable: float
    """s: 2/omega of the stiffest contact of a coarse run, the limit of stability of one contact alone."""
    found: dict[float, Shared]
    """By the share that was asked for."""
    engine: dict[float, tuple[float, float]]
    """Share -> velocity error of LAMMPS, and its largest difference to the twin; both relative."""
    reason: str = ""
    """Why something is not there."""


def study_rule_of_thumb(
    scene: Scene | None = None,
    *,
    engine: Engine | None = None,
    jobs: int | None = None,
    progress: Progress | None = None,
    store: Store | None = None,
) -> Study:
    """Measure the error of velocity-Verlet at time steps of 5, 10, 20 and 40 % of the Rayleigh time.

    LAMMPS itself runs one scene (decelerating-40, or the first) at two of these steps, to show that its error is the
    same.

    Parameters
    ----------
    scene : Scene, optional
        Scene to be solved. None: every shipped scene.
    engine, jobs, progress, store : as in :func:`dem_bridge.study`

    Returns
    -------
    Study
    """
    scenes = [scene] if scene is not None else [load_scene(name) for name in shipped_scenes()]
    own = next((one for one in scenes if one.name == "decelerating-40"), scenes[0])
    asked = [cases_of(one, engine=engine, with_engine=one is own) for one in scenes]
    results = iter(run_cases([case for cases in asked for case in cases], jobs=jobs, progress=progress, store=store))
    judged = [judged_of(one, [next(results) for _ in cases]) for one, cases in zip(scenes, asked, strict=True)]
    return Study(
        id="rule-of-thumb",
        title="The rule of thumb judged: time steps as a share of the Rayleigh time",
        answer=tuple(_answer(judged)),
        tables=(table(judged), _engine_table(judged)),
        figures=(_figure(judged),) if any(one.found for one in judged) else (),
        notes=(
            "Rayleigh time: pi R sqrt(rho/G) / (0.1631 nu + 0.8766) of the smallest body (Thornton & Randall 1988; Li,"
            " Xu & Thornton 2005). Steps are the largest at most so long that fall on the samples:"
            f" {_least_kept(judged):.4f} of them or more.",
            "Errors are against the reference, without bars of its own here: series good to 1e-12, or scipy at a local"
            f" tolerance of {TRUTH_RTOL:g} where forces are no half-integer powers or energy is lost.",
        ),
    )


def steps_at(scene: Scene, rayleigh: float) -> tuple[Sampling, dict[float, float]]:
    """One sampling for all shares, and the step (s) at each: at most the share of ``rayleigh`` (s), on the samples.

    >>> sampling, steps = steps_at(load_scene("decelerating-40"), 8.36e-6)
    >>> sampling.count, [f"{step / 8.36e-6:.4f}" for step in steps.values()]
    (898, ['0.0500', '0.0999', '0.1998', '0.3996'])
    """
    longest = max(SHARES)
    steps = math.ceil(scene.duration / (longest * rayleigh))
    apart = math.ceil(steps / MOST_SAMPLES)  # steps between two samples
    sampling = Sampling(count=max(1, math.ceil(steps / apart)))
    coarse = scene.duration / (sampling.count * apart)
    return sampling, {share: coarse * share / longest for share in SHARES}


def cases_of(scene: Scene, *, engine: Engine | None = None, with_engine: bool = False) -> list[Case]:
    """The reference, the twin at all shares and, if asked for, LAMMPS at :data:`ENGINE_SHARES`; none without T_R."""
    rayleigh = rayleigh_time_of(scene)
    if rayleigh is None:
        return []
    sampling, steps = steps_at(scene, rayleigh)
    truth = Resolution(rtol=TRUTH_RTOL)
    runs = [(TRUTH, truth, None), *((TWIN, Resolution(dt=steps[share]), None) for share in SHARES)]
    if with_engine:
        runs += [(ENGINE, Resolution(dt=steps[share]), engine) for share in ENGINE_SHARES]  # type: ignore[misc]
    return [
        Case(scene=scene, backend=name, resolution=resolution, sampling=sampling, engine=which, uncertainty=False)
        for name, resolution, which in runs
    ]


def judged_of(scene: Scene, results: Sequence[Result]) -> Judged:
    """What the results of :func:`cases_of` say; only the coarse run is made here."""
    frequency = prescan_scene(scene).frequency
    rayleigh, contact = rayleigh_time_of(scene), contact_time_of(scene)
    found: dict[float, Shared] = {}
    engine: dict[float, tuple[float, float]] = {}
    reason = "no Rayleigh time: the scene has masses and stiffnesses, and no bodies" if rayleigh is None else ""
    if rayleigh is not None:
        truth, twins, others = results[0], results[1 : 1 + len(SHARES)], results[1 + len(SHARES) :]
        reason = "; ".join(dict.fromkeys(str(one.failure) for one in results if one.failure is not None))
        twin_at = dict(zip(SHARES, (one.trajectory for one in twins), strict=True))
        for share, run in twin_at.items():
            if run is not None and truth.trajectory is not None:
                found[share] = _shared(scene, run, truth.trajectory, rayleigh)
        for share, other in zip(ENGINE_SHARES, others, strict=False):
            twin, run = twin_at[share], other.trajectory
            if run is not None and twin is not None and truth.trajectory is not None:
                engine[share] = (
                    difference("velocity", run, truth.trajectory).value,
                    difference("velocity", run, twin).value,
                )
    return Judged(
        scene=scene,
        rayleigh=math.nan if rayleigh is None else rayleigh,
        contact=math.nan if contact is None else contact,
        stable=2.0 / frequency if frequency > 0.0 else math.nan,
        found=found,
        engine=engine,
        reason=reason,
    )


def _shared(scene: Scene, run: Trajectory, truth: Trajectory, rayleigh: float) -> Shared:
    mine, other = momentum(scene, run), momentum(scene, truth)
    kinetic, true = (energy_parts(scene, one)[0][-1] for one in (run, truth))
    return Shared(
        share=run.provenance["settings"]["dt"] / rayleigh,
        velocity=difference("velocity", run, truth).value,
        momentum=_over(float(np.max(np.abs(mine - other))), float(np.max(np.abs(other)))),
        kinetic=_over(abs(float(kinetic - true)), float(true)),
    )


def _over(value: float, scale: float) -> float:
    return value / scale if scale > 0.0 else math.nan


def table(judged: Sequence[Judged]) -> Table:
    """One line a scene."""
    shown = 0.20
    reasons = any(one.reason for one in judged)

    def row(one: Judged) -> tuple[str | float, ...]:
        at = one.found.get(shown)
        return (
            one.scene.name,
            1e6 * one.rayleigh,
            1e6 * one.contact,
            1e6 * one.stable,
            *(100.0 * one.found[share].velocity if share in one.found else math.nan for share in SHARES),
            at.momentum if at else math.nan,
            at.kinetic if at else math.nan,
            *((one.reason,) if reasons else ()),
        )

    return Table(
        id="rule-of-thumb",
        title="The rule of thumb judged",
        caption=(
            "Velocity-Verlet (the twin of LAMMPS) at shares of the Rayleigh time T_R of the smallest body: largest"
            " error of a velocity over all samples and bodies, in % of the largest velocity. Beside it what a user"
            f" looks at, at {100 * shown:g} %: the largest error of the total momentum, and that of the kinetic energy"
            " at the end, both relative. Collision: the shortest of two bodies alone at the largest start velocity;"
            " 2/omega: of the stiffest contact at its largest overlap."
        ),
        columns=(
            "scene",
            "T_R (µs)",
            "collision (µs)",
            "2/omega (µs)",
            *(f"velocity at {100 * share:g} % (%)" for share in SHARES),
            f"momentum at {100 * shown:g} %",
            f"kinetic energy at {100 * shown:g} %",
            *(("not there",) if reasons else ()),
        ),
        rows=tuple(map(row, judged)),
    )


def _engine_table(judged: Sequence[Judged]) -> Table:
    return Table(
        id="rule-of-thumb-lammps",
        title="LAMMPS at the same steps",
        caption="pair_style granular, small gauge radius; relative to the largest velocity.",
        columns=("scene", "share of T_R (%)", "velocity error (%)", "largest difference to the twin"),
        rows=tuple(
            (one.scene.name, 100.0 * share, 100.0 * error, apart)
            for one in judged
            for share, (error, apart) in one.engine.items()
        ),
    )


def _answer(judged: Sequence[Judged]) -> Iterator[str]:
    known = [one for one in judged if len(one.found) == len(SHARES)]
    if not known:
        yield "No scene here has a Rayleigh time: " + "; ".join(f"{one.scene.name}: {one.reason}" for one in judged)
        return
    of = {share: [one.found[share].velocity for one in known] for share in SHARES}
    spans = [f"{_span(of[share])} at {100 * share:g} %" for share in reversed(SHARES)]
    scenes = known[0].scene.name if len(known) == 1 else f"{len(known)} scenes"
    yield (
        f"As a share of the Rayleigh time, velocity-Verlet errs on {scenes} by {', '.join(spans)} (largest error of a"
        " velocity, in % of the largest velocity)."
    )
    main = next((one for one in known if one.scene.name == "decelerating-40"), known[0])
    at = main.found[0.20]
    yield (
        f"The trap: on {main.scene.name} (T_R = {1e6 * main.rayleigh:.2f} µs) a step of 20 % errs by"
        f" {100 * at.velocity:.1f} % while momentum holds to {at.momentum:.0e} and the kinetic energy at the end is off"
        f" by {at.kinetic:.0e}: neither of them shows it."
    )
    yield (
        f"Steps at 40 % are {_span([0.4 * one.rayleigh / one.stable for one in known])} of 2/omega of the stiffest"
        f" contact and {_span([0.4 * one.rayleigh / one.contact for one in known])} of the shortest collision: far from"
        " unstable, and that is all such a share can promise."
    )
    for one in judged:
        for share, (error, apart) in one.engine.items():
            yield (
                f"LAMMPS itself on {one.scene.name} at {100 * share:g} %: {100 * error:.2g} %; it differs from the twin"
                f" by {apart:.0e}, so this is the error of the method."
            )


def _span(values: Sequence[float]) -> str:
    """In per cent.

    >>> _span([0.0091, 0.12]), _span([0.03])
    ('0.91 to 12 %', '3 %')
    """
    low, high = (f"{100.0 * value:.2g}" for value in (min(values), max(values)))
    return f"{low} %" if low == high else f"{low} to {high} %"


def _figure(judged: Sequence[Judged]) -> FigureData:
    known = [one for one in judged if one.found]
    main = next((one for one in known if one.scene.name == "decelerating-40"), known[0])

    def line(one: Judged, what: str, label: str, style: str) -> Series:
        points = [one.found[share] for share in SHARES if share in one.found]
        x = np.array([100.0 * point.share for point in points])
        return Series(label=label, style=style, x=x, y=np.array([100.0 * getattr(point, what) for point in points]))

    others = [line(one, "velocity", "velocity, other scenes", "guide") for one in known if one is not main]
    of_main = (
        line(main, "velocity", f"velocity, {main.scene.name}", "reference"),
        line(main, "kinetic", "kinetic energy at the end", "bca"),
        line(main, "momentum", "total momentum", "adiabatic"),
    )

    def panel(title: str, series: tuple[Series, ...]) -> Panel:
        return Panel(title=title, x_label="step (% of the Rayleigh time)", y_label="error (%)", series=series, log=True)

    return FigureData(
        id="rule-of-thumb-errors",
        title="Errors at a share of the Rayleigh time",
        caption="Largest error of a velocity in % of the largest velocity, and beside it what a user looks at.",
        panels=(
            panel("(a) velocities, all scenes", (*others, of_main[0])),
            panel(f"(b) what a log shows beside, {main.scene.name}", of_main),
        ),
    )


def _least_kept(judged: Sequence[Judged]) -> float:
    """Least ratio of a step as it was run to the step asked for."""
    return min((shared.share / share for one in judged for share, shared in one.found.items()), default=1.0)
