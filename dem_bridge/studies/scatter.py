"""Scatter of the contact angles: what chains do whose cylinders are not turned quite as wanted.

The paper (section 4a) takes such scatter as the reason why its measured fronts are uneven. A seeded set of chains, each
angle off by a normal deviate, goes through the reference; what comes out is the spread of what is measured.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dem_bridge.backends.base import Resolution, Sampling
from dem_bridge.campaign import Progress, Result, run_cases
from dem_bridge.errors import UnsupportedScene, UsageError
from dem_bridge.geometry import Geometry
from dem_bridge.observables.front import residence_by_crossing
from dem_bridge.runs.case import Case
from dem_bridge.runs.store import Store
from dem_bridge.scene import Scene
from dem_bridge.scene_file.physical import rounded
from dem_bridge.scene_file.physical import scattered as turned_by_chance
from dem_bridge.studies.study import FigureData, Panel, Series, Table
from dem_bridge.verification.roles import REFERENCE

Floats = NDArray[np.float64]
#: no cylinder is turned closer to its neighbour than this, degrees: at 0 the contact is a line
LEAST_ANGLE = 0.05


@dataclass(frozen=True, kw_only=True, eq=False)
class ScatterStudy:
    """A set of chains and the one that was wanted."""

    scene: Scene
    spread: float
    """Standard deviation of each angle, degrees."""
    seed: int
    arrival: Floats
    """``(n_chain, n_body - 1)``, s, by crossing, of the chains that did not break."""
    residence: Floats
    """``(n_chain, n_body - 2)``, s."""
    peak_force: Floats
    """``(n_chain, n_contact)``, N."""
    wanted: dict[str, Floats]
    """The same three of the chain as it was wanted."""

    @property
    def residence_spread(self) -> Floats:
        """Standard deviation of the residence time at body i = 1..n_body-2, relative to the wanted, ``(n_body - 2,)``.

        Not of the wave speed, its inverse: by crossing the wave may be at the next body first, so that times near zero
        and below occur, and a mean of their inverses says nothing.
        """
        return np.asarray(np.nanstd(self.residence / self.wanted["residence"], axis=0))

    @property
    def arrival_shift(self) -> tuple[float, float]:
        """Mean and standard deviation of the arrival at the last body, relative to the wanted."""
        ratio = self.arrival[:, -1] / self.wanted["arrival"][-1]
        return float(np.nanmean(ratio) - 1.0), float(np.nanstd(ratio))

    @property
    def force_spread(self) -> Floats:
        """Standard deviation of the peak force in each contact, relative to the wanted, ``(n_contact,)``."""
        return np.asarray(np.nanstd(self.peak_force / self.wanted["peak_force"], axis=0))

    def as_json(self) -> dict[str, Any]:
        mean, deviation = self.arrival_shift
        return {
            "scene": self.scene.name,
            "scene_hash": self.scene.content_hash,
            "spread_degrees": self.spread,
            "seed": self.seed,
            "chains": len(self.arrival),
            "arrival_shift_mean": mean,
            "arrival_shift_deviation": deviation,
            "residence_spread": self.residence_spread.tolist(),
            "force_spread": self.force_spread.tolist(),
        }


def scattered(scene: Scene, *, spread: float, seed: int) -> Scene:
    """The scene with each contact angle off by a normal deviate of ``spread`` degrees, stiffnesses by its own law.

    Angles are reflected at 90 degrees, where a contact is as it was, and at 0. Raises UnsupportedScene where the scene
    has no angles.
    """
    geometry = _turned(scene)
    known = [k for k, angle in enumerate(geometry.angle) if angle is not None]
    turned = turned_by_chance(tuple(filter(None, geometry.angle)), scatter=spread, seed=seed)
    angles, stiffness = list(geometry.angle), list(scene.stiffness)
    for k, angle in zip(known, turned, strict=True):
        angles[k] = max(angle, LEAST_ANGLE)
    off = replace(geometry, angles=tuple(angles), stiffness=None)
    for k in known:
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
    one = Sampling(count=1)
    return [Case(scene=c, backend=REFERENCE, resolution=Resolution(bars=False), sampling=one) for c in chains]


def study_of(scene: Scene, results: Sequence[Result], *, spread: float, seed: int = 0) -> ScatterStudy:
    """What the results of :func:`cases_of` say; nothing is run here."""
    runs = [result.trajectory for result in results]
    wanted, chains = runs[0], [run for run in runs[1:] if run is not None]
    if wanted is None or not chains:
        raise UnsupportedScene(f"{scene.name}: the reference has no run ({results[0].failure})")
    links = scene.n_body - 1
    if not np.all(np.isfinite(wanted.crossing_time[:links])):
        raise UnsupportedScene(
            f"{scene.name}: the wave does not reach the last body within {scene.duration:g} s, so that there is no"
            " arrival to compare; allowed: a longer duration"
        )
    return ScatterStudy(
        scene=scene,
        spread=spread,
        seed=seed,
        arrival=np.array([run.crossing_time[:links] for run in chains]),
        residence=np.array([residence_by_crossing(scene, run) for run in chains]),
        peak_force=np.array([run.peak_force for run in chains]),
        wanted={
            "arrival": wanted.crossing_time[:links],
            "residence": residence_by_crossing(scene, wanted),
            "peak_force": wanted.peak_force,
        },
    )


def study_scatter(
    scene: Scene,
    *,
    spread: float = 0.5,
    count: int = 200,
    seed: int = 0,
    jobs: int | None = None,
    progress: Progress | None = None,
    store: Store | None = None,
) -> ScatterStudy:
    """Run a seeded set of chains whose angles scatter; see :func:`dem_bridge.study_scatter`."""
    results = run_cases(
        cases_of(scene, spread=spread, count=count, seed=seed), jobs=jobs, progress=progress, store=store
    )
    return study_of(scene, results, spread=spread, seed=seed)


def figure(found: ScatterStudy) -> FigureData:
    """Residence time and peak force along the chain with the middle 90 % of the set."""
    residence = found.residence / found.wanted["residence"]
    force = found.peak_force[:, : found.scene.n_body - 1] / found.wanted["peak_force"][: found.scene.n_body - 1]

    def panel(title: str, what: str, ratio: Floats, first: int) -> Panel:
        x = np.arange(first, first + ratio.shape[1], dtype=float)
        low, middle, high = np.nanpercentile(ratio, [5.0, 50.0, 95.0], axis=0)
        parts = (("95 % below", high, "guide"), ("median", middle, "reference"), ("5 % below", low, "guide"))
        series = tuple(Series(label=label, style=style, x=x, y=y) for label, y, style in parts)
        return Panel(title=title, x_label="cylinder" if first else "contact", y_label=f"{what} / wanted", series=series)

    return FigureData(
        id=f"scatter-{found.scene.name}",
        title=f"Angles that scatter by {found.spread:g}°: {found.scene.name}",
        caption=f"{len(found.arrival)} chains with seeds from {found.seed} on, by the reference; each over the chain"
        " with the angles wanted. A residence time below zero: the next contact is at its peak first.",
        panels=(panel("residence time", "residence time", residence, 1), panel("peak force", "peak force", force, 0)),
    )


def table(studies: Sequence[ScatterStudy]) -> Table:
    """One line a set."""
    return Table(
        id="scatter",
        title="Scatter of the contact angles",
        caption="Standard deviations over seeded sets of chains; relative to the chain with the angles wanted.",
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
                one.scene.name,
                one.spread,
                float(len(one.arrival)),
                100.0 * one.arrival_shift[0],
                100.0 * one.arrival_shift[1],
                100.0 * float(np.nanmedian(one.residence_spread)),
                100.0 * float(np.nanmax(one.residence_spread)),
                100.0 * float(np.nanmedian(one.force_spread)),
            )
            for one in studies
        ),
    )


def _turned(scene: Scene) -> Geometry:
    geometry = scene.geometry
    if geometry is None or all(angle is None for angle in geometry.angle):
        raise UnsupportedScene(
            f"{scene.name} has no contact angles that could scatter; allowed: a scene in physical form with cylinders"
        )
    return geometry
