"""Scatter of the contact angles: the effect of random errors of the angles between cylinders.

The paper (section 4a) states such scatter as the reason why its measured fronts are uneven. A seeded set of chains, in
which each angle differs from the intended one by a normal deviate, is solved by the reference; the result is the spread
of the observables.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from dem_bridge.backends.base import Resolution, Sampling
from dem_bridge.campaign import Jobs, Progress, Result, run_cases
from dem_bridge.ensembles.draw import LEAST_ANGLE as LEAST_ANGLE
from dem_bridge.errors import UnsupportedScene
from dem_bridge.runs.case import Case
from dem_bridge.runs.store import Store
from dem_bridge.scene import Scene
from dem_bridge.scene_file.physical import rounded
from dem_bridge.scene_file.physical import scattered as turned_by_chance
from dem_bridge.studies.study import FigureData, Panel, Series, Study, Table, check_setting
from dem_bridge.studies.texts import Texts
from dem_bridge.sweep import table_of
from dem_bridge.trajectory import Floats
from dem_bridge.verification.roles import REFERENCE

if TYPE_CHECKING:
    import pandas as pd

TEXTS = Texts("scatter")
#: observables that are compared with those of the chain with the intended angles
OBSERVABLES = ("arrival_at_end", "residence_time", "peak_force")


@dataclass(frozen=True, kw_only=True, eq=False)
class ScatteredChains:
    """Sweep over a set of chains with random angle errors, each compared with the chain with the intended angles."""

    scene: Scene
    spread: float
    """Standard deviation of each angle, degrees."""
    seed: int
    table: pd.DataFrame
    """See :func:`dem_bridge.sweep.table_of`; without the chains that broke."""

    @property
    def count(self) -> int:
        """Number of chains."""
        return int(self.table["case"].nunique())

    def ratios(self, observable: str) -> Floats:
        """Return values relative to the chain with the intended angles, ``(n_chain, n_place)``."""
        part = self.table[self.table["observable"] == observable]
        return np.asarray((part["value"] / part["reference_value"]).to_numpy().reshape(self.count, -1))

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
    geometry = scene.geometry
    if geometry is None or all(angle is None for angle in geometry.angle):
        raise UnsupportedScene(
            f"{scene.name} has no contact angles that could scatter; allowed: a scene in physical form with cylinders"
        )
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


def cases_of(scene: Scene, *, spread: float, count: int, seed: int = 0) -> list[Case]:
    """Return the case of the intended chain, then of ``count`` scattered ones, with seeds from ``seed`` on."""
    check_setting("spread", spread, "a number of degrees > 0, up to 45", most=45.0)
    check_setting("count", count, "a whole number of chains from 2 to 100000", least=2, most=100_000)
    # a seed and its negative are the same to random.Random
    check_setting("seed", seed, "a whole number >= 0", least=0, most=math.inf)
    chains = [scene, *(scattered(scene, spread=spread, seed=seed + i) for i in range(count))]
    # crossing times and peak forces are those of the run, not of its samples
    item = Sampling(count=1)
    return [Case(scene=c, backend=REFERENCE, resolution=Resolution(), sampling=item, uncertainty=False) for c in chains]


def chains_of(scene: Scene, results: Sequence[Result], *, spread: float, seed: int = 0) -> ScatteredChains:
    """Read the results of :func:`cases_of`; nothing is run here."""
    intended, *chains = results
    table = table_of(chains, [intended] * len(chains), OBSERVABLES, places=True)
    table = table[table["failure"] == ""]
    if intended.trajectory is None or table.empty:
        raise UnsupportedScene(f"{scene.name}: the reference has no run ({intended.failure})")
    if not np.all(np.isfinite(intended.trajectory.crossing_time[: scene.n_body - 1])):
        raise UnsupportedScene(
            f"{scene.name}: the wave does not reach the last body within {scene.duration:g} s, so that there is no"
            " arrival to compare; allowed: a longer duration"
        )
    return ScatteredChains(scene=scene, spread=spread, seed=seed, table=table)


def study_scatter(
    scene: Scene,
    *,
    spread: float = 0.5,
    count: int = 200,
    seed: int = 0,
    jobs: Jobs = None,
    progress: Progress | None = None,
    store: Store | None = None,
) -> Study:
    """Measure how random errors of the contact angles change arrival, residence times and peak forces.

    A seeded set of chains, each contact angle off by a normal deviate, is solved by the reference.

    Parameters
    ----------
    scene : Scene
        Chain with the intended angles.
    spread : float
        Standard deviation of each angle, degrees.
    count : int
        Number of chains.
    seed : int
        Seed of the first chain; each further chain has the next.
    jobs, progress, store : as in :func:`dem_bridge.study`

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
    cases = cases_of(scene, spread=spread, count=count, seed=seed)
    chains = chains_of(scene, run_cases(cases, jobs=jobs, progress=progress, store=store), spread=spread, seed=seed)
    (mean, deviation), times, force = chains.arrival_shift, chains.residence_spread, chains.force_spread
    spreads = (("residence time of a body", times), ("peak force of a contact", force))
    arrival = {"spread": spread, "mean": mean, "deviation": deviation}
    return TEXTS.study(
        {"scene": scene.name},
        answer=(
            TEXTS("arrival", scene=scene.name, count=chains.count, **arrival),
            *(TEXTS("along", name=name, median=np.nanmedian(v), largest=np.nanmax(v)) for name, v in spreads),
        ),
        tables=(table([chains]), _along(chains)),
        figures=(figure(chains),),
        provenance={"scene": scene.name, "scene_hash": scene.content_hash, "spread": spread, "seed": seed},
    )


def figure(chains: ScatteredChains) -> FigureData:
    """Return residence time and peak force along the chain with the middle 90 % of the set."""
    links, name = chains.scene.n_body - 1, chains.scene.name
    residence, force = chains.ratios("residence_time")[:, 1:-1], chains.ratios("peak_force")[:, :links]

    def panel(id: str, ratio: Floats, first: int) -> Panel:
        x = np.arange(first, first + ratio.shape[1], dtype=float)
        low, middle, high = np.nanpercentile(ratio, [5.0, 50.0, 95.0], axis=0)
        band = Series(label="middle 90 %", style="band", x=x, y=0.5 * (low + high), bar=0.5 * (high - low))
        return TEXTS.panel(id, [band, Series(label="median", style="reference", x=x, y=middle)])

    panels = (panel("body", residence, 1), panel("contact", force, 0))
    settings = {"spread": chains.spread, "count": chains.count, "seed": chains.seed}
    return replace(TEXTS.figure("scatter", panels, scene=name, **settings), id=f"scatter-{name}")


def table(sets: Sequence[ScatteredChains]) -> Table:
    """Return the table of the spreads of several sets, a row for each."""
    rows = []
    for chains in sets:
        times, force = chains.residence_spread, chains.force_spread
        spreads = (*chains.arrival_shift, np.nanmedian(times), np.nanmax(times), np.nanmedian(force))
        shares = [100.0 * float(spread) for spread in spreads]
        rows.append((chains.scene.name, chains.spread, float(chains.count), *shares))
    return TEXTS.table("scatter", rows)


def _along(chains: ScatteredChains) -> Table:
    """Return the table of the spreads at bodies and contacts 0, 1, ...; body 0 has no residence time."""
    force = chains.force_spread[: chains.scene.n_body - 1].tolist()
    spreads = zip((math.nan, *chains.residence_spread.tolist()), force, strict=True)
    return TEXTS.table("along-the-chain", [(float(k), 100.0 * time, 100.0 * f) for k, (time, f) in enumerate(spreads)])
