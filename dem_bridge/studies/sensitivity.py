"""Sensitivity: which contact's error changes which measure, and what tolerance a wanted effect leaves a builder."""

from __future__ import annotations

import math
from collections.abc import Iterator
from concurrent.futures import Executor
from dataclasses import replace
from typing import Any

import numpy as np

from dem_bridge.ensembles.draw import VARIED, Variation
from dem_bridge.ensembles.run import run_ensemble
from dem_bridge.ensembles.sensitivity import Indices, sobol_indices
from dem_bridge.errors import UsageError
from dem_bridge.report.columns import RELATIVE, Column, Unit
from dem_bridge.report.study import FigureData, Map, Series, Study, Table, check_setting
from dem_bridge.report.texts import Texts
from dem_bridge.runs.campaign import Progress
from dem_bridge.runs.store import Store
from dem_bridge.scene.scene import Scene
from dem_bridge.studies.recalled import recall_study
from dem_bridge.trajectory.trajectory import Floats

TEXTS = Texts("sensitivity", "dem_bridge.studies")
INDICES_COLUMNS = (
    "varied number", "arrival: first order", "lower end", "upper end", "arrival: total", "velocity: first order",
    "its lower end", "its upper end", "velocity: total",
)  # fmt: skip
#: parts of the spread at which the deviation of the arrival is measured for the tolerance
_PARTS = (0.25, 0.5, 1.0)
#: chains for each of them
_CHAINS = 512
#: the measures in the table and in the answer; residence times and forces are in the maps
MEASURES = ("arrival at the last body", "velocity of the last body over that of the first")
#: spread without a setting: degrees, relative, or m
_SPREADS = {"angle": 0.5, "mass": 0.01, "stiffness": 0.05, "velocity": 0.01, "gap": 1e-6}


def study_sensitivity(
    scene: Scene,
    *,
    vary: str = "angle",
    spread: float | None = None,
    base: int = 256,
    effect: float = 0.01,
    seed: int = 0,
    executor: Executor | None = None,
    progress: Progress | None = None,
    store: Store | None = None,
) -> Study:
    """Measure how much each contact's or body's error contributes to the spread of arrival, speeds and forces.

    Sobol' indices of every measure are estimated from many chains that differ in the varied numbers only.

    Parameters
    ----------
    scene : Scene
        Intended chain.
    vary : str
        What varies: angle, mass, stiffness, velocity or gap.
    spread : float
        Standard deviation: degrees, relative, or m.  [default: angle 0.5, mass 0.01, stiffness 0.05, velocity 0.01,
        gap 1e-6]
    base : int
        Number of base samples, a power of 2; for d varied numbers base (2 d + 2) chains are solved.
    effect : float
        Wanted relative standard deviation of the arrival, for which the tolerance is computed.
    seed : int
        Seed of the draws.
    executor, progress, store : as in :func:`dem_bridge.ensemble`

    Returns
    -------
    Study

    Raises
    ------
    UnsupportedScene
        If the scene has no angles that could vary, or its chains cannot be solved in lanes.
    UsageError
        For a setting out of its range, and for chains whose wave does not reach the last body.

    References
    ----------
    Owen (2013), *ACM Trans. Model. Comput. Simul.* 23, 11.
    """
    if vary not in VARIED:
        raise UsageError(f"vary = {vary!r}; allowed: {', '.join(VARIED)}")
    check_setting("effect", effect, "a relative standard deviation above 0, up to 1", most=1.0)
    size = _SPREADS[vary] if spread is None else spread
    check_setting("spread", size, "a standard deviation above 0: degrees, relative, or m")
    variation = Variation(scene=scene, vary={vary: size}, seed=seed)

    def estimated() -> Study:
        return _study(variation, base, effect, executor, progress)

    return recall_study(
        "sensitivity", store, estimated, scene, vary=dict(variation.vary), seed=seed, base=base, effect=effect
    )


def _study(
    variation: Variation, base: int, effect: float, executor: Executor | None, progress: Progress | None
) -> Study:
    """Return the study of a variation of one number; arguments as in :func:`study_sensitivity`."""
    scene, seed = variation.scene, variation.seed
    ((vary, size),) = variation.vary.items()
    links = scene.n_body - 1

    def measures(values: dict[str, Floats]) -> Floats:
        ratio = values["peak_velocity"][:, -1] / values["peak_velocity"][:, 0]
        lines = [values["arrival_at_end"], ratio, *values["residence_time"][:, 1:-1].T]
        return np.array([*lines, *values["peak_force"][:, :links].T])

    indices = sobol_indices(variation, measures, base=base, executor=executor, progress=progress)
    tolerances = _tolerances(variation, size, executor)
    unit = {"angle": "degrees", "gap": "m"}.get(vary, "relative")
    allowed = _allowed_spread(tolerances, effect)
    # other chains with the spread that was found
    confirmed = math.nan
    if allowed <= VARIED[vary][1]:
        confirmed = _deviation(replace(variation, vary={vary: allowed}, seed=seed + 1), executor)
    place = "body" if vary in ("mass", "velocity") else "contact"
    named = "(relative)" if unit == "relative" else unit
    texts = {"scene": scene.name, "place": place, "vary": vary, "spread": size, "unit": named, "chains": indices.chains}
    columns = (
        Column("standard deviation of each number", Unit(unit)),
        Column("standard deviation of the arrival", RELATIVE),
    )
    return TEXTS.study(
        {"scene": scene.name},
        answer=(
            TEXTS("arrival", share=indices.deviation[0] / indices.mean[0], **texts),
            *(sentence_on_largest(name, indices, row) for row, name in enumerate(MEASURES)),
            *sentences_on_sum(MEASURES[0], indices, 0),
            TEXTS("tolerance", effect=effect, allowed=allowed, confirmed=confirmed, count=_CHAINS, **texts),
        ),
        tables=(_table(indices), TEXTS.table("tolerance", columns, tolerances)),
        figures=(_figure(indices, links, texts),),
        provenance={"scene": scene.name, "scene_hash": scene.content_hash, "vary": {vary: size}, "seed": seed},
    )


def _name(key: str, *places: int) -> str:
    """Return the name of varied numbers.

    >>> _name("angle", 3), _name("mass", 0, 2, 5)
    ('angle of contact 3', 'mass of bodies 0, 2 and 5')
    """
    one, several = ("body", "bodies") if key in ("mass", "velocity") else ("contact", "contacts")
    *firsts, last = map(str, places)
    return f"{key} of {several} {', '.join(firsts)} and {last}" if firsts else f"{key} of {one} {last}"


def sentence_on_largest(name: str, indices: Indices, row: int) -> str:
    """Return the sentence on the numbers that may contribute most to a measure."""
    if not np.any(indices.leading[row]):
        return TEXTS("constant", name=name)
    most = int(np.nanargmax(indices.first[row]))
    low, high = indices.first_interval[:, row, most]
    shares = {"share": indices.first[row, most], "low": low, "high": high}
    key, place = indices.columns[most]
    if np.sum(indices.leading[row]) == 1:
        return TEXTS("largest", name=name, column=_name(key, place), **shares)
    places = [indices.columns[column][1] for column in np.flatnonzero(indices.leading[row])]
    texts = {"vary": key, "columns": _name(key, *places), "column": _name(key, place)}
    return TEXTS("undecided", name=name, count=len(places), all=len(indices.columns), **texts, **shares)


def sentences_on_sum(name: str, indices: Indices, row: int) -> Iterator[str]:
    """Yield the sentence on the sum of the first-order indices, whose true value is at most 1; none without a sum."""
    low, high = indices.sum_interval[:, row]
    if np.isfinite(high):
        total = float(np.sum(indices.first[row]))
        yield TEXTS("interactions" if high < 1.0 else "additive", name=name, sum=total, low=low, high=high)


def _tolerances(variation: Variation, spread: float, executor: Executor | None) -> list[tuple[float, float]]:
    """Return spreads, and the relative standard deviation of the arrival that each causes."""
    ((key, _),) = variation.vary.items()
    rows = []
    for part in _PARTS:
        rows.append((part * spread, _deviation(replace(variation, vary={key: part * spread}), executor)))
    return rows


def _deviation(variation: Variation, executor: Executor | None) -> float:
    """Return the relative standard deviation of the arrival."""
    arrival = run_ensemble(variation, _CHAINS, checks=0, executor=executor).values["arrival_at_end"]
    return float(np.nanstd(arrival) / np.nanmean(arrival))


def _allowed_spread(tolerances: list[tuple[float, float]], effect: float) -> float:
    """Return the spread that causes the wanted deviation: by interpolation, beyond the measured ones in proportion."""
    spreads, deviations = (np.log(column) for column in np.array(tolerances).T)
    target = math.log(effect)
    if target < deviations[0]:
        return float(np.exp(spreads[0] + target - deviations[0]))
    if target > deviations[-1]:
        return float(np.exp(spreads[-1] + target - deviations[-1]))
    return float(np.exp(np.interp(target, deviations, spreads)))


def _table(indices: Indices) -> Table:
    """Return the indices of :data:`MEASURES` for each varied number."""
    rows = []
    for column, which in enumerate(indices.columns):
        cells: list[float] = []
        for row in (0, 1):
            cells += [indices.first[row, column], *indices.first_interval[:, row, column], indices.total[row, column]]
        rows.append((_name(*which), *map(float, cells)))
    return TEXTS.table("indices", INDICES_COLUMNS, rows)


def _figure(indices: Indices, links: int, texts: dict[str, Any]) -> FigureData:
    """Return the indices of :data:`MEASURES` along the chain, and those of all measures as maps."""
    places = np.array([place for _, place in indices.columns], dtype=float)

    def line(row: int, label: str, style: str) -> Series:
        low, high = indices.first_interval[:, row]
        return Series(label=label, style=style, x=places, y=indices.first[row], bar=0.5 * (high - low))

    lines = (line(0, MEASURES[0], "black line"), line(1, MEASURES[1], "other"))
    bodies = np.arange(1.0, links)
    middle = 2 + len(bodies)
    maps = (
        Map(label="first-order index", x=places, y=bodies, values=indices.first[2:middle]),
        Map(label="first-order index", x=places, y=np.arange(float(links)), values=indices.first[middle:]),
    )
    panels = (
        TEXTS.panel("along", lines, **texts),
        TEXTS.panel("residence", map=maps[0], **texts),
        TEXTS.panel("force", map=maps[1], **texts),
    )
    return replace(TEXTS.figure("sensitivity", panels, **texts), id=f"sensitivity-{texts['scene']}")
