"""DEM's rule of thumb: the error of velocity-Verlet at time steps that are shares of the Rayleigh time.

Granular codes are run at 10 to 40 % of :func:`~dem_bridge.scene.timescales.rayleigh_time`, and users then check whether
momentum and energy are conserved. Here the errors of the velocities, for which a chain is simulated, are measured too.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from dem_bridge.backends.base import Resolution, Sampling
from dem_bridge.backends.scene_prescan import prescan_scene
from dem_bridge.errors import RunBroken
from dem_bridge.lmp.engine import Engine
from dem_bridge.observables.conserved import energy_parts, energy_uncertainty
from dem_bridge.observables.observable import LARGEST, Observable
from dem_bridge.observables.registry import OBSERVABLES
from dem_bridge.report.columns import MICROSECOND, PERCENT, Column
from dem_bridge.report.study import FigureData, Series, Study, Table
from dem_bridge.report.texts import Texts
from dem_bridge.runs.campaign import Jobs, Progress, Result, run_groups
from dem_bridge.runs.campaign.results import table_of
from dem_bridge.runs.case import Case
from dem_bridge.runs.store import Store
from dem_bridge.scene.file import load_scene, shipped_scenes
from dem_bridge.scene.scene import Scene
from dem_bridge.scene.timescales import contact_time_of, rayleigh_time_of
from dem_bridge.studies.recalled import Unfinished, recall_study

if TYPE_CHECKING:
    import pandas as pd

TEXTS = Texts("rule-of-thumb", "dem_bridge.studies")
RULE_OF_THUMB_COLUMNS = (
    "scene", Column("T_R", MICROSECOND), Column("collision", MICROSECOND), Column("2/omega", MICROSECOND),
    Column("velocity at 5 %", PERCENT), Column("velocity at 10 %", PERCENT), Column("velocity at 20 %", PERCENT),
    Column("velocity at 40 %", PERCENT), "momentum at 20 %", "kinetic energy at 20 %",
)  # fmt: skip
RULE_OF_THUMB_LAMMPS_COLUMNS = (
    "scene", Column("share of T_R", PERCENT), Column("velocity error", PERCENT), "largest difference from the twin",
)  # fmt: skip
#: of the Rayleigh time; each step is a whole number of the finer ones
SHARES = (0.05, 0.10, 0.20, 0.40)
#: shares at which LAMMPS itself is run, for one scene
ENGINE_SHARES = (0.10, 0.20)
#: share whose errors of momentum and energy are shown
SHOWN = 0.20
TWIN, ENGINE, REFERENCE = "verlet", "lammps-granular", "reference"
#: local tolerance of the reference where scipy solves the scene: its error is below 1e-6, those measured are above 1e-4
REFERENCE_RTOL = 1e-8
MOST_SAMPLES = 2000
MAIN = "decelerating-40"
#: what a log shows: the momentum relative to its largest value, and the kinetic energy of the last line
MOMENTUM = replace(OBSERVABLES["momentum"], scale=LARGEST)
KINETIC_ENERGY = Observable(
    name="kinetic_energy_at_end",
    definition="Kinetic energy of all bodies at the end of the run.",
    unit="J",
    axis=(),
    value=lambda scene, run: energy_parts(scene, run)[0][-1],
    uncertainty=lambda scene, run: energy_uncertainty(scene, run)[-1],
)


@dataclass(frozen=True, kw_only=True, eq=False)
class SceneErrors:
    """Errors of one scene at all shares; without errors if it has no Rayleigh time, with the reason."""

    scene: Scene
    rayleigh: float
    """s; nan: the scene does not describe its bodies."""
    contact: float
    """s: shortest two-body collision at the largest start velocity; nan where nothing moves."""
    stable: float
    """s: 2/omega of the stiffest contact of a coarse run, the limit of stability of one contact alone."""
    table: pd.DataFrame | None = None
    """Sweep against the reference (:func:`dem_bridge.runs.campaign.results.table_of`) with a column ``share``."""
    engine: dict[float, float] = field(default_factory=dict)
    """Share -> largest velocity difference between LAMMPS and the twin, relative to the largest velocity."""
    reason: str = ""
    """Why errors are missing."""

    def errors(self, observable: str = "velocity", backend: str = TWIN, column: str = "error") -> dict[float, float]:
        """Return the sizes of relative errors (or another column) by share; shares without a run are missing.

        Momentum that walls, gravity, drag or a drive change has none: its error says nothing about conservation.
        """
        if self.table is None or (observable == MOMENTUM.name and not self.scene.conserves_momentum):
            return {}
        rows = self.table[(self.table["observable"] == observable) & (self.table["backend"] == backend)]
        rows = rows[rows["error"].notna()]
        return dict(zip(rows["share"].tolist(), rows[column].abs().tolist(), strict=True))


def study_rule_of_thumb(
    scene: Scene | None = None,
    *,
    engine: Engine | None = None,
    jobs: Jobs = None,
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
    main = next((item for item in scenes if item.name == MAIN), scenes[0])
    engine = engine or Engine.chosen()

    def measured() -> Study:
        cases = [cases_of(item, engine=engine, with_engine=item is main) for item in scenes]
        groups = run_groups(cases, jobs=jobs, progress=progress, store=store)
        study = study_of([errors_of(item, results) for item, results in zip(scenes, groups, strict=True)])
        if any(isinstance(result.failure, RunBroken) for results in groups for result in results):
            raise Unfinished(study)
        return study

    return recall_study("rule-of-thumb", store, measured, scenes, engine)


def study_of(errors: Sequence[SceneErrors]) -> Study:
    """Show the errors of some scenes; nothing is run here."""
    return TEXTS.study(
        {"part": _smallest_part(errors), "rtol": REFERENCE_RTOL},
        answer=tuple(_answer(errors)),
        tables=(table(errors), _engine_table(errors)),
        figures=(_figure(errors),) if any(error.errors() for error in errors) else (),
    )


def steps_at(scene: Scene, rayleigh: float) -> tuple[Sampling, dict[float, float]]:
    """Return one sampling for all shares and the step (s) at each: the longest within the share that is on the samples.

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
    """List the reference, the twin at all shares and, if wanted, LAMMPS at :data:`ENGINE_SHARES`.

    There are no cases for a scene without a Rayleigh time.
    """
    rayleigh = rayleigh_time_of(scene)
    if rayleigh is None:
        return []
    sampling, steps = steps_at(scene, rayleigh)
    resolution = Resolution(rtol=REFERENCE_RTOL)
    exact = Case(scene=scene, backend=REFERENCE, resolution=resolution, sampling=sampling, uncertainty=False)
    twins = [replace(exact, backend=TWIN, resolution=Resolution(dt=steps[share])) for share in SHARES]
    engines = [replace(twins[SHARES.index(share)], backend=ENGINE, engine=engine) for share in ENGINE_SHARES]
    return [exact, *twins, *(engines if with_engine else ())]


def errors_of(scene: Scene, results: Sequence[Result]) -> SceneErrors:
    """Read the results of :func:`cases_of`; only the prescan is run here."""
    frequency, contact = prescan_scene(scene).frequency, contact_time_of(scene)
    errors = SceneErrors(
        scene=scene,
        rayleigh=math.nan,
        contact=math.nan if contact is None else contact,
        stable=2.0 / frequency if frequency > 0.0 else math.nan,
        reason=TEXTS("no_bodies"),
    )
    rayleigh = rayleigh_time_of(scene)
    if rayleigh is None:
        return errors
    exact, *runs = results
    shares = (*SHARES, *ENGINE_SHARES)
    sweep = table_of(runs, [exact] * len(runs), ("velocity", MOMENTUM, KINETIC_ENERGY))
    twins = [runs[SHARES.index(share)] for share in ENGINE_SHARES]
    engines = table_of(runs[len(SHARES) :], twins[: len(runs) - len(SHARES)], ("velocity",))
    differences = dict(zip(ENGINE_SHARES, engines["error"].tolist(), strict=False))
    return replace(
        errors,
        rayleigh=rayleigh,
        table=sweep.assign(share=[shares[case] for case in sweep["case"]]),
        engine={share: difference for share, difference in differences.items() if math.isfinite(difference)},
        reason="; ".join(dict.fromkeys(str(result.failure) for result in results if result.failure is not None)),
    )


def table(errors: Sequence[SceneErrors]) -> Table:
    """List the errors, a row for each scene."""
    reasons = any(error.reason for error in errors)
    columns = (*RULE_OF_THUMB_COLUMNS, *(["missing because"] if reasons else []))
    rows = [
        (
            error.scene.name,
            *(error.rayleigh, error.contact, error.stable),
            *(error.errors().get(share, math.nan) for share in SHARES),
            *(error.errors(log.name).get(SHOWN, math.nan) for log in (MOMENTUM, KINETIC_ENERGY)),
            *([error.reason] if reasons else []),
        )
        for error in errors
    ]
    return TEXTS.table("rule-of-thumb", columns, rows, shown=SHOWN)


def _engine_table(errors: Sequence[SceneErrors]) -> Table:
    rows = [
        (error.scene.name, share, error.errors(backend=ENGINE).get(share, math.nan), difference)
        for error in errors
        for share, difference in error.engine.items()
    ]
    return TEXTS.table("rule-of-thumb-lammps", RULE_OF_THUMB_LAMMPS_COLUMNS, rows)


def _main(errors: Sequence[SceneErrors]) -> SceneErrors:
    """Return the scene that figure and answer show: decelerating-40, or the first."""
    return next((item for item in errors if item.scene.name == MAIN), errors[0])


def _answer(errors: Sequence[SceneErrors]) -> Iterator[str]:
    complete = [item for item in errors if len(item.errors()) == len(SHARES)]
    if not complete:
        yield TEXTS("none", reasons="; ".join(f"{item.scene.name}: {item.reason}" for item in errors))
        return
    spans = ", ".join(
        f"{_span([item.errors()[share] for item in complete])} at {100 * share:g} %" for share in reversed(SHARES)
    )
    yield TEXTS(
        "errors", scenes=complete[0].scene.name if len(complete) == 1 else f"{len(complete)} scenes", spans=spans
    )
    main = _main(complete)
    velocity, energy = (main.errors(name)[SHOWN] for name in ("velocity", KINETIC_ENERGY.name))
    momentum = main.errors(MOMENTUM.name).get(SHOWN, math.nan)
    text = "conservation" if main.scene.conserves_momentum else "conservation_of_energy"
    values = {"velocity": velocity, "momentum": momentum, "energy": energy, "shown": SHOWN}
    yield TEXTS(text, scene=main.scene.name, rayleigh=1e6 * main.rayleigh, **values)
    stable, contact = (
        _span([0.4 * item.rayleigh / getattr(item, time) for item in complete]) for time in ("stable", "contact")
    )
    yield TEXTS("stability", stable=stable, contact=contact)
    for item in errors:
        for share, difference in item.engine.items():
            error = item.errors(backend=ENGINE).get(share, math.nan)
            yield TEXTS("engine", scene=item.scene.name, share=share, error=error, difference=difference)


def _span(values: Sequence[float]) -> str:
    """Return the range of some values in per cent.

    >>> _span([0.0091, 0.12]), _span([0.03])
    ('0.91 to 12 %', '3 %')
    """
    low, high = (f"{100.0 * value:.2g}" for value in (min(values), max(values)))
    return f"{low} %" if low == high else f"{low} to {high} %"


def _figure(errors: Sequence[SceneErrors]) -> FigureData:
    complete = [error for error in errors if error.errors()]
    main = _main(complete)

    def line(scene_errors: SceneErrors, observable: str, label: str, style: str) -> Series:
        steps, values = (
            np.array([*scene_errors.errors(observable, column=column).values()]) for column in ("dt", "error")
        )
        return Series(label=label, style=style, x=100.0 * steps / scene_errors.rayleigh, y=100.0 * values)

    name = main.scene.name
    velocity = line(main, "velocity", f"velocity, {name}", "black line")
    kinetic = line(main, KINETIC_ENERGY.name, "kinetic energy at the end", "vermilion squares")
    momentum = line(main, MOMENTUM.name, "total momentum", "purple triangles")
    others = [line(item, "velocity", "velocity, other scenes", "guide") for item in complete if item is not main]
    logged = (velocity, kinetic, momentum) if main.scene.conserves_momentum else (velocity, kinetic)
    panels = (
        TEXTS.panel("errors", (*others, velocity), title="(a) velocities, all scenes", log=True),
        TEXTS.panel("errors", logged, title=f"(b) what a log shows, {name}", log=True),
    )
    return TEXTS.figure("rule-of-thumb-errors", panels)


def _smallest_part(errors: Sequence[SceneErrors]) -> float:
    """Return the smallest ratio of a step to its share of the Rayleigh time."""
    steps = ((error, share, dt) for error in errors for share, dt in error.errors(column="dt").items())
    return min((dt / (share * step.rayleigh) for step, share, dt in steps), default=1.0)
