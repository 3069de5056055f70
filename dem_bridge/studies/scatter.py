"""Scatter of the contact angles: the effect of random errors of the angles between cylinders.

The paper (section 4a) states such scatter as the reason why its measured fronts are uneven. Chains in which each angle
differs from the intended one by a normal deviate are solved as an ensemble; the result is the spread of the
observables, and the tolerance of the angles that a wanted spread allows. In the study of the paper each chain has a
seed of its own.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from dem_bridge.backends.base import Resolution, Sampling
from dem_bridge.ensembles.draw import LEAST_ANGLE as LEAST_ANGLE
from dem_bridge.ensembles.draw import VARIED, Chains, Variation
from dem_bridge.ensembles.run import PILOT, run_ensemble
from dem_bridge.ensembles.solve import LANED, check_solvable, solve_chains, steps_for
from dem_bridge.errors import UnsupportedScene
from dem_bridge.observables.fits import inner_bodies
from dem_bridge.report.columns import DEGREE, PERCENT, Column
from dem_bridge.report.study import FigureData, Map, Panel, Series, Study, Table, check_setting
from dem_bridge.report.texts import Texts
from dem_bridge.runs.campaign import Jobs, Progress, Result, run_cases
from dem_bridge.runs.campaign.results import table_of
from dem_bridge.runs.case import Case
from dem_bridge.runs.store import Store
from dem_bridge.scene.file.conversion import rounded
from dem_bridge.scene.file.conversion import scattered as turned_by_chance
from dem_bridge.scene.geometry import Geometry
from dem_bridge.scene.scene import Scene
from dem_bridge.studies.recalled import recall_study
from dem_bridge.trajectory.trajectory import Floats
from dem_bridge.verification.reference_choice import REFERENCE

TEXTS = Texts("scatter", "dem_bridge.studies")
SCATTER_COLUMNS = (
    "chain", Column("angle", DEGREE), "chains", Column("arrival at the end: mean shift", PERCENT),
    Column("its deviation", PERCENT), Column("residence time, median deviation along the chain", PERCENT),
    Column("largest", PERCENT), Column("peak force, median deviation", PERCENT),
)  # fmt: skip
ALONG_THE_CHAIN_COLUMNS = (
    "body, contact", Column("residence time of the body", PERCENT), Column("peak force of the contact", PERCENT),
)  # fmt: skip
TOLERANCES_COLUMNS = (
    "measure", Column("within", PERCENT), Column("angle", DEGREE), Column("confirmed: within", PERCENT),
)  # fmt: skip
#: observables that are compared with those of the chain with the intended angles
OBSERVABLES = ("arrival_at_end", "residence_time", "peak_force")
#: names of the measures of a chain
ARRIVAL, SPEED_RATIO = "arrival at the last body", "V_out/V_in"
#: part of the chains that must keep within a tolerance, and the tolerances in the table
SHARE, EFFECTS = 0.9, (0.01, 0.02, 0.05)
#: standard errors of a part that is found with few chains, by which a tolerance is on the safe side: 95 %, one-sided
_SAFE = 1.645
#: spreads that tolerances are interpolated between, of the spread of the study, and chains with each of them
_PARTS, _CHAINS = (0.02, 0.08, 0.3, 1.0, 3.0, 8.0), 512
#: samples of the maps
_SAMPLES = 120
#: relative error of the observables of chains with their own seeds; the spreads of 150 of them have 6 %
SEEDED_ACCURACY = 1e-6
#: chains that the paper measured
PAPER = ("decelerating-40", "accelerating-40")


@dataclass(frozen=True, kw_only=True, eq=False)
class ScatteredChains:
    """Sweep over a set of chains with random angle errors, each compared with the chain with the intended angles."""

    scene: Scene
    spread: float
    """Standard deviation of each angle, degrees."""
    seed: int
    solver: str
    """The reference, or "ensemble"."""
    own_seeds: bool
    """Each chain has a seed of its own, from ``seed`` on; else all are drawn with one seed."""
    values: Mapping[str, Floats]
    """Observable -> ``(n_chain, n_place)``, without the chains that broke; "velocity" of an ensemble."""
    intended: Mapping[str, Floats]
    """Observable -> ``(n_place,)`` of the chain with the intended angles."""

    @property
    def count(self) -> int:
        """Number of chains."""
        return len(self.values[OBSERVABLES[0]])

    def ratios(self, observable: str) -> Floats:
        """Return values relative to the chain with the intended angles, ``(n_chain, n_place)``."""
        with np.errstate(invalid="ignore", divide="ignore"):  # a wall that is not reached has no force
            return np.asarray(self.values[observable] / self.intended[observable])

    def measures(self) -> dict[str, Floats]:
        """Return arrival and, for more than six bodies, V_out/V_in relative to the intended, ``(n_chain,)``."""
        first, last = inner_bodies(self.scene)
        measures = {ARRIVAL: self.ratios("arrival_at_end")[:, 0]}
        if first < last:
            time = self.ratios("residence_time")
            measures[SPEED_RATIO] = time[:, first] / time[:, last]
        return measures

    @property
    def residence_spread(self) -> Floats:
        """Relative standard deviation of the residence time at body i = 1..n_body-2, ``(n_body - 2,)``.

        The wave speed, its inverse, is not used: by crossing the wave can reach the next body first, so that residence
        times near zero and below occur, and the mean of their inverses has no meaning.
        """
        return np.asarray(np.nanstd(self.ratios("residence_time")[:, 1:-1], axis=0))

    @property
    def arrival_shift(self) -> tuple[float, float]:
        """Mean and standard deviation of the change of the arrival at the last body, relative to the intended."""
        ratio = self.ratios("arrival_at_end")
        return float(np.nanmean(ratio) - 1.0), float(np.nanstd(ratio))

    @property
    def force_spread(self) -> Floats:
        """Standard deviation of the peak force in each contact, relative to the intended, ``(n_contact,)``."""
        return np.asarray(np.nanstd(self.ratios("peak_force"), axis=0))


def scattered(scene: Scene, *, spread: float, seed: int) -> Scene:
    """Return the scene with random errors of the contact angles, and the stiffnesses by its law.

    Errors are normal deviates with a standard deviation of ``spread`` degrees. Angles are reflected at 90 degrees and
    at 0. Raises UnsupportedScene where the scene has no angles.
    """
    geometry = _geometry(scene)
    known_values = [k for k, angle in enumerate(geometry.angle) if angle is not None]
    turned = turned_by_chance(tuple(filter(None, geometry.angle)), scatter=spread, seed=seed)
    angles, stiffness = list(geometry.angle), list(scene.stiffness)
    for k, angle in zip(known_values, turned, strict=True):
        angles[k] = max(angle, LEAST_ANGLE)
    off = replace(geometry, angles=tuple(angles), stiffness=None)
    for k in known_values:
        stiffness[k] = rounded(off.contact(k, off.law).stiffness)
    name = f"{scene.name}.scatter-{spread:g}-{seed}"
    return replace(scene, name=name, stiffness=tuple(stiffness), geometry=off)


def _geometry(scene: Scene) -> Geometry:
    geometry = scene.geometry
    if geometry is None or all(angle is None for angle in geometry.angle):
        raise UnsupportedScene(
            f"{scene.name} has no contact angles that could scatter; allowed: a scene in physical form with cylinders"
        )
    return geometry


def _check_settings(spread: float, count: int, seed: int) -> None:
    check_setting("spread", spread, "a number of degrees > 0, up to 45", most=45.0)
    check_setting("count", count, "a whole number of chains from 2 to 100000", least=2, most=100_000)
    # a seed and its negative are the same to random.Random
    check_setting("seed", seed, "a whole number >= 0", least=0, most=math.inf)


def _check_arrival(scene: Scene, crossing_time: Floats) -> None:
    if not np.all(np.isfinite(crossing_time[: scene.n_body - 1])):
        raise UnsupportedScene(
            f"{scene.name}: the wave does not reach the last body within {scene.duration:g} s, so that there is no"
            " arrival to compare; allowed: a longer duration"
        )


def cases_of(scene: Scene, *, spread: float, count: int, seed: int = 0) -> list[Case]:
    """Return the case of the intended chain, then of ``count`` scattered ones, with seeds from ``seed`` on."""
    # crossing times and peak forces are those of the run, not of its samples
    settings: dict[str, Any] = {"backend": REFERENCE, "resolution": Resolution(), "sampling": Sampling(count=1)}
    return [Case(scene=chain, uncertainty=False, **settings) for chain in _seeded(scene, spread, count, seed)]


def _seeded(scene: Scene, spread: float, count: int, seed: int) -> list[Scene]:
    """Return the intended chain, then ``count`` scattered ones, with seeds from ``seed`` on."""
    _check_settings(spread, count, seed)
    return [scene, *(scattered(scene, spread=spread, seed=seed + i) for i in range(count))]


def chains_of(scene: Scene, results: Sequence[Result], *, spread: float, seed: int = 0) -> ScatteredChains:
    """Read the results of :func:`cases_of`; nothing is run here."""
    intended, *chains = results
    table = table_of(chains, [intended] * len(chains), OBSERVABLES, places=True)
    table = table[table["failure"] == ""]
    if intended.trajectory is None or table.empty:
        raise UnsupportedScene(f"{scene.name}: the reference has no run ({intended.failure})")
    _check_arrival(scene, intended.trajectory.crossing_time)
    values, reference = {}, {}
    for name, part in table.groupby("observable"):
        shape = part["case"].nunique(), -1
        values[name] = part["value"].to_numpy().reshape(shape)
        reference[name] = part["reference_value"].to_numpy().reshape(shape)[0]
    of_draws: dict[str, Any] = {"spread": spread, "seed": seed, "own_seeds": True}
    return ScatteredChains(scene=scene, solver=REFERENCE, values=values, intended=reference, **of_draws)


def solve_seeded(scene: Scene, *, spread: float, count: int, seed: int = 0) -> ScatteredChains:
    """Solve the chains of :func:`cases_of` together, in a tenth of the time, to :data:`SEEDED_ACCURACY`.

    Raises UnsupportedScene for forces that chains in lanes cannot have, such as adhesion or a drive.
    """
    check_solvable(scene)
    chains = Chains.of(_seeded(scene, spread, count, seed))
    steps = steps_for(scene, chains.rows(np.arange(min(len(chains), PILOT))), SEEDED_ACCURACY)
    solved = solve_chains(scene, chains, steps)
    _check_arrival(scene, solved["crossing_time"][0])
    rows = {name: values.reshape(len(chains), -1) for name, values in solved.items()}
    return ScatteredChains(
        scene=scene,
        spread=spread,
        seed=seed,
        solver="ensemble",
        own_seeds=True,
        values={name: values[1:] for name, values in rows.items()},
        intended={name: values[0] for name, values in rows.items()},
    )


def solve_scattered(
    scene: Scene,
    *,
    spread: float,
    count: int,
    seed: int = 0,
    samples: int | None = None,
    executor: Executor | None = None,
    progress: Progress | None = None,
) -> ScatteredChains:
    """Solve an ensemble of chains whose angles fill the normal distributions evenly (Sobol' sequence)."""
    _check_settings(spread, count, seed)
    _geometry(scene)
    variation = Variation(scene=scene, vary={"angle": spread}, seed=seed, sampler="sobol")
    chains = run_ensemble(variation, count, samples=samples, checks=0, executor=executor, progress=progress)
    intended = solve_chains(scene, variation.chains(np.full((1, len(variation.columns)), 0.5)), chains.steps)
    _check_arrival(scene, intended["crossing_time"][0])
    return ScatteredChains(
        scene=scene,
        spread=spread,
        seed=seed,
        solver="ensemble",
        own_seeds=False,
        values={
            name: values.reshape(count, -1) if values.ndim < 3 else values for name, values in chains.values.items()
        },
        intended={name: np.atleast_1d(values[0]) for name, values in intended.items()},
    )


def study_scatter(
    scene: Scene,
    *,
    spread: float = 0.5,
    count: int = 2048,
    seed: int = 0,
    effect: float = 0.01,
    jobs: Jobs = None,
    executor: Executor | None = None,
    progress: Progress | None = None,
    store: Store | None = None,
) -> Study:
    """Measure how random errors of the contact angles change arrival, residence times and peak forces.

    Each contact angle of an ensemble of chains is off by a normal deviate. Chains with forces that an ensemble cannot
    solve, such as adhesion or a drive, are solved one by one by the reference: 1 to 2.5 s of CPU each with 40
    cylinders, so that 2048 chains take 20 to 40 minutes on two cores. The progress shows the time that is left.

    Parameters
    ----------
    scene : Scene
        Chain with the intended angles.
    spread : float
        Standard deviation of each angle, degrees.
    count : int
        Number of chains.
    seed : int
        Seed of the draws.
    effect : float
        Wanted largest relative change of arrival and V_out/V_in in nine chains of ten, for which the tolerance of the
        angles is computed.
    jobs : as in :func:`dem_bridge.study`, for chains that the reference solves
    executor, progress, store : as in :func:`dem_bridge.ensemble`

    Returns
    -------
    Study

    Raises
    ------
    UnsupportedScene
        If the scene has no contact angles, or the wave does not reach the last body.
    UsageError
        For a setting out of its range.
    """
    check_setting("effect", effect, "a relative change above 0, up to 1", most=1.0)
    draws: dict[str, Any] = {"spread": spread, "count": count, "seed": seed}
    if LANED.unsupported_reason(scene):
        cases = cases_of(scene, **draws)
        results = run_cases(cases, jobs=executor or jobs, progress=progress, store=store)
        return study_of(chains_of(scene, results, spread=spread, seed=seed))

    def solved() -> Study:
        run: dict[str, Any] = {"executor": executor, "progress": progress}
        chains = solve_scattered(scene, **draws, samples=_SAMPLES, **run)
        tolerances = find_tolerances(chains, sorted({effect, *EFFECTS}), min(count, _CHAINS), **run)
        return study_of(chains, tolerances, effect)

    _check_settings(**draws)
    return recall_study("scatter", store, solved, scene, effect=effect, **draws)


@dataclass(frozen=True, kw_only=True)
class Tolerance:
    """Spread of the angles by which nine chains of ten have a measure within a relative change of the intended."""

    measure: str
    effect: float
    spread: float
    """Standard deviation of each angle, degrees; nan: beyond the spreads that were tried."""
    confirmed: float
    """Change that nine of ten other chains with that spread keep within."""


def find_tolerances(chains: ScatteredChains, effects: Sequence[float], count: int, **settings: Any) -> list[Tolerance]:
    """Return the spreads for the effects, interpolated between those that are tried, and run each of them."""

    def changes(spread: float, seed: int, share: float) -> dict[str, float]:
        solved = solve_scattered(chains.scene, spread=spread, count=count, seed=seed, **settings)
        return {name: float(np.nanquantile(np.abs(ratio - 1.0), share)) for name, ratio in solved.measures().items()}

    safe = min(SHARE + _SAFE * math.sqrt(SHARE * (1.0 - SHARE) / count), 1.0)

    spreads = [part * chains.spread for part in _PARTS if part * chains.spread <= VARIED["angle"][1]]
    tried = [changes(spread, chains.seed, safe) for spread in spreads]
    rows = []
    for measure in tried[0]:
        curve = np.maximum.accumulate([change[measure] for change in tried])
        for effect in effects:
            allowed = float(np.exp(np.interp(np.log(effect), np.log(curve), np.log(spreads), math.nan, math.nan)))
            confirmed = math.nan if math.isnan(allowed) else changes(allowed, chains.seed + 1, SHARE)[measure]
            rows.append(Tolerance(measure=measure, effect=effect, spread=allowed, confirmed=confirmed))
    return rows


def study_of(chains: ScatteredChains, tolerances: Sequence[Tolerance] = (), effect: float = math.nan) -> Study:
    """Return the study of a set of chains."""
    scene, spread = chains.scene, chains.spread
    (mean, deviation), times, force = chains.arrival_shift, chains.residence_spread, chains.force_spread
    spreads = (("residence time of a body", times), ("peak force of a contact", force))
    arrival = {"spread": spread, "mean": mean, "deviation": deviation}
    answer = [TEXTS("arrival", scene=scene.name, count=chains.count, **arrival)]
    answer += [TEXTS("along", name=name, median=np.nanmedian(v), largest=np.nanmax(v)) for name, v in spreads]
    for name, ratio in chains.measures().items():
        low, high = np.nanquantile(ratio, [0.05, 0.95])
        answer.append(TEXTS("middle", name=name, low=low - 1.0, high=high - 1.0))
    for tolerance in tolerances:
        if tolerance.effect == effect and math.isfinite(tolerance.spread):
            answer.append(TEXTS("tolerance", **vars(tolerance), count=min(chains.count, _CHAINS)))
    if scene.name in PAPER:
        slower = "does not explain that" if mean < deviation else "may contribute to that"
        answer.append(TEXTS("paper", median=np.nanmedian(times), slower=slower, **arrival))
    tables = [table([chains]), _along(chains)]
    if tolerances:
        rows = [(t.measure, t.effect, t.spread, t.confirmed) for t in tolerances]
        tables.append(TEXTS.table("tolerances", TOLERANCES_COLUMNS, rows))
    figures = [figure(chains), distributions(chains)]
    if "velocity" in chains.values:
        figures.append(maps(chains))
    return TEXTS.study(
        {"scene": scene.name},
        answer=tuple(answer),
        tables=tuple(tables),
        figures=tuple(figures),
        provenance={"scene": scene.name, "scene_hash": scene.content_hash, "spread": spread, "seed": chains.seed},
    )


def distributions(chains: ScatteredChains) -> FigureData:
    """Return the distributions of the measures of a chain, and the wave speed along the chain."""
    part = np.linspace(0.005, 0.995, 199)
    styles = ("black line", "other")
    lines = [
        Series(label=name, style=style, x=np.nanquantile(ratio, part), y=part)
        for (name, ratio), style in zip(chains.measures().items(), styles, strict=False)
    ]
    times = chains.values["residence_time"][:, 1:-1]
    x = np.arange(1.0, 1.0 + times.shape[1])
    with np.errstate(divide="ignore"):
        # a time of zero or less is that of a body that the wave passes over: its speed has no upper end
        slow, middle, fast = (chains.scene.spacing or 1.0) / np.nanquantile(times, [0.95, 0.5, 0.05], axis=0)
    bounded = fast > 0.0
    band = Series(
        label="middle 90 %",
        style="band",
        x=x[bounded],
        y=0.5 * (slow + fast)[bounded],
        bar=0.5 * (fast - slow)[bounded],
    )
    speeds = [band, Series(label="median", style="black line", x=x[middle > 0.0], y=middle[middle > 0.0])]
    unit = "bodies/s" if chains.scene.spacing is None else "m/s"
    panels = (TEXTS.panel("distribution", lines), TEXTS.panel("speed", speeds, unit=unit))
    settings = {"spread": chains.spread, "count": chains.count, "scene": chains.scene.name}
    return replace(TEXTS.figure("distributions", panels, **settings), id=f"scatter-distributions-{chains.scene.name}")


def maps(chains: ScatteredChains) -> FigureData:
    """Return the map of the median velocity, and that of the width of the middle 90 %."""
    velocity, scene = chains.values["velocity"], chains.scene
    # sample by sample, so that memory does not grow with the number of chains times samples
    rows = [np.quantile(velocity[:, row], [0.05, 0.5, 0.95], axis=0) for row in range(velocity.shape[1])]
    low, middle, high = np.array(rows).transpose(1, 0, 2)
    bodies, time = np.arange(float(scene.n_body)), np.linspace(0.0, 1e3 * scene.duration, len(rows))
    panels = tuple(
        TEXTS.panel(id, map=Map(label="velocity (m/s)", x=bodies, y=time, values=values))
        for id, values in (("map-median", middle), ("map-width", high - low))
    )
    settings = {"spread": chains.spread, "count": chains.count, "scene": scene.name}
    return replace(TEXTS.figure("maps", panels, **settings), id=f"scatter-maps-{scene.name}")


def figure(chains: ScatteredChains) -> FigureData:
    """Return residence time and peak force along the chain with the middle 90 % of the set."""
    links, name = chains.scene.n_body - 1, chains.scene.name
    residence, force = chains.ratios("residence_time")[:, 1:-1], chains.ratios("peak_force")[:, :links]

    def panel(id: str, ratio: Floats, first: int) -> Panel:
        x = np.arange(first, first + ratio.shape[1], dtype=float)
        low, middle, high = np.nanpercentile(ratio, [5.0, 50.0, 95.0], axis=0)
        band = Series(label="middle 90 %", style="band", x=x, y=0.5 * (low + high), bar=0.5 * (high - low))
        return TEXTS.panel(id, [band, Series(label="median", style="black line", x=x, y=middle)])

    panels = (panel("body", residence, 1), panel("contact", force, 0))
    seeds = f"seeds from {chains.seed} on" if chains.own_seeds else f"seed {chains.seed}"
    solver = "the reference" if chains.solver == REFERENCE else "an ensemble"
    settings = {"spread": chains.spread, "count": chains.count, "seeds": seeds, "solver": solver}
    return replace(TEXTS.figure("scatter", panels, scene=name, **settings), id=f"scatter-{name}")


def table(sets: Sequence[ScatteredChains]) -> Table:
    """Return the table of the spreads of several sets, a row for each."""
    rows = []
    for chains in sets:
        times, force = chains.residence_spread, chains.force_spread
        spreads = (*chains.arrival_shift, np.nanmedian(times), np.nanmax(times), np.nanmedian(force))
        rows.append((chains.scene.name, chains.spread, float(chains.count), *map(float, spreads)))
    return TEXTS.table("scatter", SCATTER_COLUMNS, rows)


def _along(chains: ScatteredChains) -> Table:
    """Return the table of the spreads at bodies and contacts 0, 1, ...; body 0 has no residence time."""
    force = chains.force_spread[: chains.scene.n_body - 1].tolist()
    spreads = zip((math.nan, *chains.residence_spread.tolist()), force, strict=True)
    return TEXTS.table(
        "along-the-chain",
        ALONG_THE_CHAIN_COLUMNS,
        [(float(k), *spread) for k, spread in enumerate(spreads)],
    )
