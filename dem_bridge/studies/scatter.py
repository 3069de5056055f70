"""Scatter of the contact angles: what chains do whose cylinders are not turned quite as wanted.

The paper (section 4a) takes such scatter as the reason why its measured fronts are uneven. A seeded set of chains, each
angle off by a normal deviate, goes through the reference; what comes out is the spread of what is measured.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dem_bridge.backends.base import Resolution, Sampling
from dem_bridge.campaign import Progress, Result, run_cases
from dem_bridge.errors import UnsupportedScene, UsageError
from dem_bridge.geometry import Geometry
from dem_bridge.runs.case import Case
from dem_bridge.runs.store import Store
from dem_bridge.scene import Scene
from dem_bridge.scene_file.physical import rounded
from dem_bridge.scene_file.physical import scattered as turned_by_chance
from dem_bridge.studies.study import FigureData, Panel, Series, Study, Table
from dem_bridge.sweep import table_of
from dem_bridge.verification.roles import REFERENCE

if TYPE_CHECKING:
    import pandas as pd

Floats = NDArray[np.float64]
#: no cylinder is turned closer to its neighbour than this, degrees: at 0 the contact is a line
LEAST_ANGLE = 0.05
#: what is compared with the chain with the intended angles
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
    """The scene with each contact angle off by a normal deviate of ``spread`` degrees, stiffnesses by its own law.

    Angles are reflected at 90 degrees, where a contact is as it was, and at 0. Raises UnsupportedScene where the scene
    has no angles.
    """
    geometry = _turned(scene)
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
    """The wanted chain, then ``count`` scattered ones, with seeds from ``seed`` on."""
    if isinstance(spread, bool) or not isinstance(spread, int | float) or not 0.0 < spread <= 45.0:
        raise UsageError(f"spread = {spread!r}; allowed: a number of degrees > 0, up to 45")
    if isinstance(count, bool) or not isinstance(count, int) or not 2 <= count <= 100_000:
        raise UsageError(f"count = {count!r}; allowed: a whole number of chains from 2 to 100000")
    # a seed and its negative are the same to random.Random
    if isinstance(seed, bool) or not isinstance(seed, int) or seed < 0:
        raise UsageError(f"seed = {seed!r}; allowed: a whole number >= 0")
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
    jobs: int | None = None,
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
    return Study(
        id="scatter",
        title=f"Random errors of the contact angles: {scene.name}",
        answer=(
            f"{scene.name}: {chains.count} chains whose angles have random errors of {spread:g} degrees"
            f" (standard deviation). The arrival at the last body changes by {100 * mean:+.2f} % on average, with a"
            f" standard deviation of {100 * deviation:.2f} %.",
            *(
                f"The standard deviation of the {name} is {100 * np.nanmedian(values):.2f} % (median along the chain),"
                f" and at most {100 * np.nanmax(values):.2f} %."
                for name, values in (("residence time of a body", times), ("peak force of a contact", force))
            ),
        ),
        tables=(table([chains]), _along(chains)),
        figures=(figure(chains),),
        provenance={"scene": scene.name, "scene_hash": scene.content_hash, "spread": spread, "seed": seed},
    )


def figure(chains: ScatteredChains) -> FigureData:
    """Show residence time and peak force along the chain with the middle 90 % of the set."""
    links = chains.scene.n_body - 1
    residence, force = chains.ratios("residence_time")[:, 1:-1], chains.ratios("peak_force")[:, :links]

    def panel(quantity: str, ratio: Floats, first: int) -> Panel:
        x = np.arange(first, first + ratio.shape[1], dtype=float)
        low, middle, high = np.nanpercentile(ratio, [5.0, 50.0, 95.0], axis=0)
        parts = (("95 % below", high, "guide"), ("median", middle, "reference"), ("5 % below", low, "guide"))
        series = tuple(Series(label=label, style=style, x=x, y=y) for label, y, style in parts)
        return Panel(
            title=quantity, x_label="body" if first else "contact", y_label=f"{quantity} / intended", series=series
        )

    return FigureData(
        id=f"scatter-{chains.scene.name}",
        title=f"Angles with random errors of {chains.spread:g}°: {chains.scene.name}",
        caption=f"{chains.count} chains with seeds from {chains.seed} on, solved by the reference; each relative"
        " to the chain with the intended angles. A residence time below zero: the next contact reaches its peak first.",
        panels=(panel("residence time", residence, 1), panel("peak force", force, 0)),
    )


def table(sets: Sequence[ScatteredChains]) -> Table:
    """List the spreads of several sets, a row for each."""
    return Table(
        id="scatter",
        title="Random errors of the contact angles",
        caption="Standard deviations over seeded sets of chains, relative to the chain with the intended angles.",
        columns=(
            "chain",
            "angle (degrees)",
            "chains",
            "arrival at the end: mean shift (%)",
            "its deviation (%)",
            "residence time, median deviation along the chain (%)",
            "largest (%)",
            "peak force, median deviation (%)",
        ),
        rows=tuple(
            (
                chains.scene.name,
                chains.spread,
                float(chains.count),
                100.0 * chains.arrival_shift[0],
                100.0 * chains.arrival_shift[1],
                100.0 * float(np.nanmedian(chains.residence_spread)),
                100.0 * float(np.nanmax(chains.residence_spread)),
                100.0 * float(np.nanmedian(chains.force_spread)),
            )
            for chains in sets
        ),
    )


def _along(chains: ScatteredChains) -> Table:
    """List the spreads along the chain: of body and contact 0, 1, ...; body 0 has no residence time."""
    force = chains.force_spread[: chains.scene.n_body - 1].tolist()
    spreads = zip((math.nan, *chains.residence_spread.tolist()), force, strict=True)
    return Table(
        id="along-the-chain",
        title="Spread along the chain",
        caption="Standard deviations at each body and at the contact behind it, relative to the intended chain.",
        columns=("body, contact", "residence time of the body (%)", "peak force of the contact (%)"),
        rows=tuple((float(k), 100.0 * time, 100.0 * force) for k, (time, force) in enumerate(spreads)),
    )


def _turned(scene: Scene) -> Geometry:
    geometry = scene.geometry
    if geometry is None or all(angle is None for angle in geometry.angle):
        raise UnsupportedScene(
            f"{scene.name} has no contact angles that could scatter; allowed: a scene in physical form with cylinders"
        )
    return geometry
