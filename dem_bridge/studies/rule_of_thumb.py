"""DEM's rule of thumb: the error of velocity-Verlet at time steps that are shares of the Rayleigh time.

Granular codes are run at 10 to 40 % of :func:`~dem_bridge.physics.rayleigh.rayleigh_time`, and users then check whether
momentum and energy are conserved. Here the errors of the velocities, for which a chain is simulated, are measured too.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from dem_bridge.backends.base import Resolution, Sampling
from dem_bridge.backends.tabled import prescan_scene
from dem_bridge.campaign import Progress, Result, run_groups
from dem_bridge.lmp.engine import Engine
from dem_bridge.observables.conserved import energy_parts, energy_uncertainty
from dem_bridge.observables.registry import LARGEST, OBSERVABLES, Observable
from dem_bridge.runs.case import Case
from dem_bridge.runs.store import Store
from dem_bridge.scene import Scene
from dem_bridge.scene_file import load_scene, shipped_scenes
from dem_bridge.studies.study import FigureData, Panel, Series, Study, Table
from dem_bridge.sweep import table_of
from dem_bridge.timescales import contact_time_of, rayleigh_time_of

if TYPE_CHECKING:
    import pandas as pd

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
    """Sweep against the reference (:func:`dem_bridge.sweep.table_of`) with a column ``share``."""
    engine: dict[float, float] = field(default_factory=dict)
    """Share -> largest velocity difference between LAMMPS and the twin, relative to the largest velocity."""
    reason: str = ""
    """Why errors are missing."""

    def errors(self, observable: str = "velocity", backend: str = TWIN, column: str = "error") -> dict[float, float]:
        """Return the sizes of relative errors (or another column) by share; shares without a run are missing."""
        if self.table is None:
            return {}
        rows = self.table[(self.table["observable"] == observable) & (self.table["backend"] == backend)]
        rows = rows[rows["error"].notna()]
        return dict(zip(rows["share"].tolist(), rows[column].abs().tolist(), strict=True))


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
    main = next((item for item in scenes if item.name == MAIN), scenes[0])
    cases = [cases_of(item, engine=engine, with_engine=item is main) for item in scenes]
    groups = run_groups(cases, jobs=jobs, progress=progress, store=store)
    errors = [errors_of(item, results) for item, results in zip(scenes, groups, strict=True)]
    return Study(
        id="rule-of-thumb",
        title="Time steps as a share of the Rayleigh time",
        answer=tuple(_answer(errors)),
        tables=(table(errors), _engine_table(errors)),
        figures=(_figure(errors),) if any(error.errors() for error in errors) else (),
        notes=(
            "Rayleigh time: pi R sqrt(rho/G) / (0.1631 nu + 0.8766) of the smallest body (Thornton & Randall 1988; Li,"
            " Xu & Thornton 2005). Each step is the longest within its share that falls on the samples:"
            f" {_smallest_part(errors):.4f} of the share or more.",
            "Errors are relative to the reference, whose uncertainty is not estimated here: its series are accurate to"
            f" 1e-12; where exponents are not half-integer or energy is lost, scipy has a local tolerance of"
            f" {REFERENCE_RTOL:g}.",
        ),
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
    exact = Case(
        scene=scene,
        backend=REFERENCE,
        resolution=Resolution(rtol=REFERENCE_RTOL),
        sampling=sampling,
        uncertainty=False,
    )
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
        reason="no Rayleigh time: the scene has masses and stiffnesses, and no bodies",
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

    def row(scene_errors: SceneErrors) -> tuple[str | float, ...]:
        velocity = scene_errors.errors()
        return (
            scene_errors.scene.name,
            1e6 * scene_errors.rayleigh,
            1e6 * scene_errors.contact,
            1e6 * scene_errors.stable,
            *(100.0 * velocity.get(share, math.nan) for share in SHARES),
            *(scene_errors.errors(log.name).get(SHOWN, math.nan) for log in (MOMENTUM, KINETIC_ENERGY)),
            *((scene_errors.reason,) if reasons else ()),
        )

    return Table(
        id="rule-of-thumb",
        title="Errors at shares of the Rayleigh time",
        caption=(
            "Velocity-Verlet (the twin of LAMMPS) at shares of the Rayleigh time T_R of the smallest body: largest"
            " error of a velocity over all samples and bodies, in % of the largest velocity; and, at"
            f" {100 * SHOWN:g} %, the largest error of the total momentum and the error of the kinetic energy at the"
            " end, both relative. Collision: the shortest of two bodies alone at the largest start velocity."
            " 2/omega: of the stiffest contact at its largest overlap."
        ),
        columns=(
            "scene",
            "T_R (µs)",
            "collision (µs)",
            "2/omega (µs)",
            *(f"velocity at {100 * share:g} % (%)" for share in SHARES),
            f"momentum at {100 * SHOWN:g} %",
            f"kinetic energy at {100 * SHOWN:g} %",
            *(("missing because",) if reasons else ()),
        ),
        rows=tuple(map(row, errors)),
    )


def _engine_table(errors: Sequence[SceneErrors]) -> Table:
    return Table(
        id="rule-of-thumb-lammps",
        title="LAMMPS at the same steps",
        caption="pair_style granular, small surrogate radius; relative to the largest velocity.",
        columns=("scene", "share of T_R (%)", "velocity error (%)", "largest difference from the twin"),
        rows=tuple(
            (error.scene.name, 100.0 * share, 100.0 * error.errors(backend=ENGINE).get(share, math.nan), difference)
            for error in errors
            for share, difference in error.engine.items()
        ),
    )


def _answer(errors: Sequence[SceneErrors]) -> Iterator[str]:
    known_values = [item for item in errors if len(item.errors()) == len(SHARES)]
    if not known_values:
        yield "No scene here has a Rayleigh time: " + "; ".join(f"{item.scene.name}: {item.reason}" for item in errors)
        return
    spans = [
        f"{_span([item.errors()[share] for item in known_values])} at {100 * share:g} %" for share in reversed(SHARES)
    ]
    scenes = known_values[0].scene.name if len(known_values) == 1 else f"{len(known_values)} scenes"
    yield (
        f"At time steps that are shares of the Rayleigh time, the velocity error of velocity-Verlet on {scenes} is"
        f" {', '.join(spans)} (largest error of a velocity, in % of the largest velocity)."
    )
    main = next((item for item in known_values if item.scene.name == MAIN), known_values[0])
    yield (
        f"Conservation does not show this error: on {main.scene.name} (T_R = {1e6 * main.rayleigh:.2f} µs) a step of"
        f" {100 * SHOWN:g} % gives a velocity error of {100 * main.errors()[SHOWN]:.1f} %, while the momentum is"
        f" conserved to {main.errors(MOMENTUM.name)[SHOWN]:.0e} and the kinetic energy at the end has an error of"
        f" {main.errors(KINETIC_ENERGY.name)[SHOWN]:.0e}."
    )
    yield (
        f"Steps at 40 % are {_span([0.4 * item.rayleigh / item.stable for item in known_values])} of 2/omega of the"
        " stiffest"
        f" contact and {_span([0.4 * item.rayleigh / item.contact for item in known_values])} of the shortest"
        " collision, far from"
        " the limit of stability: the rule of thumb ensures stability and nothing more."
    )
    for item in errors:
        for share, difference in item.engine.items():
            error = item.errors(backend=ENGINE).get(share, math.nan)
            yield (
                f"LAMMPS on {item.scene.name} at {100 * share:g} % has a velocity error of {100 * error:.2g} %; it"
                f" differs from the twin by {difference:.0e}, so that this is the error of the method."
            )


def _span(values: Sequence[float]) -> str:
    """Return the range of some values in per cent.

    >>> _span([0.0091, 0.12]), _span([0.03])
    ('0.91 to 12 %', '3 %')
    """
    low, high = (f"{100.0 * value:.2g}" for value in (min(values), max(values)))
    return f"{low} %" if low == high else f"{low} to {high} %"


def _figure(errors: Sequence[SceneErrors]) -> FigureData:
    known_values = [error for error in errors if error.errors()]
    main = next((item for item in known_values if item.scene.name == MAIN), known_values[0])

    def line(scene_errors: SceneErrors, observable: str, label: str, style: str) -> Series:
        steps, values = (
            np.array([*scene_errors.errors(observable, column=column).values()]) for column in ("dt", "error")
        )
        return Series(label=label, style=style, x=100.0 * steps / scene_errors.rayleigh, y=100.0 * values)

    others = [line(item, "velocity", "velocity, other scenes", "guide") for item in known_values if item is not main]
    of_main = (
        line(main, "velocity", f"velocity, {main.scene.name}", "reference"),
        line(main, KINETIC_ENERGY.name, "kinetic energy at the end", "bca"),
        line(main, MOMENTUM.name, "total momentum", "adiabatic"),
    )

    def panel(title: str, series: tuple[Series, ...]) -> Panel:
        return Panel(title=title, x_label="step (% of the Rayleigh time)", y_label="error (%)", series=series, log=True)

    return FigureData(
        id="rule-of-thumb-errors",
        title="Errors at shares of the Rayleigh time",
        caption="Largest error of a velocity in % of the largest velocity, and the relative errors of momentum and"
        " kinetic energy, which a log shows.",
        panels=(
            panel("(a) velocities, all scenes", (*others, of_main[0])),
            panel(f"(b) momentum and energy, {main.scene.name}", of_main),
        ),
    )


def _smallest_part(errors: Sequence[SceneErrors]) -> float:
    """Return the smallest ratio of a step to its share of the Rayleigh time."""
    steps = ((error, share, dt) for error in errors for share, dt in error.errors(column="dt").items())
    return min((dt / (share * step.rayleigh) for step, share, dt in steps), default=1.0)
