"""Terms that are only suspected, which can be added to the fullest model, and every numerical choice with its error."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from dem_bridge.backends.base import ENGINE_BACKENDS, Resolution, Sampling, supports_of
from dem_bridge.backends.steps import default_step
from dem_bridge.backends.tabled import prescan_scene
from dem_bridge.errors import RunBroken
from dem_bridge.lmp.engine import Engine
from dem_bridge.observables.verdict import Outcome
from dem_bridge.runs.campaign import Result
from dem_bridge.scene.scene import Scene
from dem_bridge.studies.model_hierarchy.model_terms import TEXTS, angles_soften, crossed, hertzian
from dem_bridge.studies.model_hierarchy.models import Bench, Least, ModelHierarchy, Tried
from dem_bridge.studies.model_hierarchy.passage import Effect, Effects, Readings, effects
from dem_bridge.studies.scatter import scattered

#: what is only suspected: drag (1/s), the overlap (m) at which softer contacts have Hertz' force
DRAG, ANCHOR = 10.0, 5e-6
#: draws whose range has the median of all draws inside it in 97 of 100 cases: 1 - 2^(1 - 6)
DRAWS = 6
#: backends of the coarsest numerics, which are in the file from the coarsest to the finest
COARSE = ("bca", "adiabatic", "verlet")
#: name of a run, short and in full, its backend and its settings
Choice = tuple[str, str, str, Resolution]


def doubts(bench: Bench, observables: Sequence[str], *, spread: float, draws: int) -> Iterator[Tried]:
    """Yield the effects of terms that can be added to the fullest model."""
    full = bench.hierarchy.model()
    parts: list[tuple[str, str, list[Scene]]] = []
    if crossed(full) and full.drag == 0.0:
        parts.append(("drag", TEXTS("drag", drag=DRAG), [replace(full, drag=DRAG)]))
    if crossed(full) and hertzian(full):
        soft = [angles_soften(full, ANCHOR)]
        parts.append(("exponents fall with the angle", TEXTS("exponents", anchor=1e6 * ANCHOR), soft))
        chains = [scattered(full, spread=spread, seed=seed) for seed in range(draws)]
        parts.append(("angles scatter", TEXTS("angles", spread=spread, draws=draws), chains))
    bench.of([full, *(scene for *_, scenes in parts for scene in scenes)])
    for name, what, scenes in parts:
        first, *others = bench.of([full, *scenes])
        yield bench.tried(name, what, _median([effects(first, readings) for readings in others]), observables)


def _median(draws: Sequence[Effects]) -> Effects:
    """Return the median of several draws, with an uncertainty that includes all of them.

    It is nan for fewer than :data:`DRAWS`, whose range says little about the median of all draws.
    """
    if len(draws) == 1:
        return draws[0]

    def of(name: str) -> Effect:
        sizes = np.array([abs(draw[name].value) for draw in draws])
        middle = float(np.median(sizes))
        spread = float(np.max(np.abs(sizes - middle))) if np.all(np.isfinite(sizes)) else 0.0
        spread = spread if len(draws) >= DRAWS else math.nan
        return Effect(value=middle, uncertainty=spread + max(draw[name].uncertainty for draw in draws), at=-1)

    return {name: of(name) for name in draws[0]}


def choices(bench: Bench, observables: Sequence[str], engine: Engine | None) -> Iterator[Tried]:
    """Yield the errors of every numerical choice on the fullest model, or on the barest where it cannot do that."""
    hierarchy, full = bench.hierarchy, bench.hierarchy.model()
    # all that theories do not know is left out; stiffnesses are those of the fullest model
    kept = ("stiffness-law", "striker-stiffness")
    barest = hierarchy.model(frozenset(term.id for term in hierarchy.model_terms if term.id not in kept))
    runs, cases = _choices(hierarchy, full), []
    for *_, name, resolution in runs:
        case = hierarchy.case(full if supports_of(name).covers(full) else barest, name, resolution)
        cases.append(replace(case, engine=engine if name in ENGINE_BACKENDS else None, uncertainty=False))
    truths = bench.of([case.scene for case in cases])
    for (name, what, *_), truth, result in zip(runs, truths, bench.run(cases), strict=True):
        what = what if result.case.scene is full else f"{what} (of the barest chain)"
        yield _numerical(bench, name, what, truth, result, observables)


def _choices(hierarchy: ModelHierarchy, scene: Scene) -> list[Choice]:
    """Return the numerical choices of the file that the scene has; steps are multiples of its default step."""
    step = default_step(scene, Sampling(count=hierarchy.samples), prescan_scene(scene))
    results = []
    for item in TEXTS.data["choices"]:
        settings = {"dt": item["steps"] * step if "steps" in item else None, **item.get("settings", {})}
        if "geometry" not in settings or scene.spacing is not None:
            results.append((item["name"], item["what"], item["backend"], Resolution(**settings)))
    return results


def _numerical(
    bench: Bench, name: str, what: str, truth: Readings, result: Result, observables: Sequence[str]
) -> Tried:
    run = result.trajectory
    if run is None:
        outcome = Outcome.BROKEN if isinstance(result.failure, RunBroken) else Outcome.NOT_RUN
        return Tried(name=name, what=what, outcome=outcome, note=f"{what}: {result.failure}")
    dt = run.provenance["settings"].get("dt")
    step = f", dt = {dt:.3g} s" if dt else ""
    errors = effects(truth, bench.read(result.case.scene, run), one_sided=True)
    return bench.tried(f"{name}{step}", f"{what}{step}", errors, observables)


def cheapest(bench: Bench, below: Least, observables: Sequence[str]) -> Tried | None:
    """Return the coarsest numerics that keep the accuracy together with all that the least model leaves out."""
    hierarchy = bench.hierarchy
    [full] = bench.of([hierarchy.model()])
    runs = [choice for choice in _choices(hierarchy, below.scene) if choice[2] in COARSE]
    results = bench.run([hierarchy.case(below.scene, backend, resolution) for *_, backend, resolution in runs])
    tried = (
        _numerical(bench, name, what, full, result, observables)
        for (name, what, *_), result in zip(runs, results, strict=True)
    )
    return next((item for item in tried if item.outcome is Outcome.PASS), None)
