"""Beside the pieces of physics of a ladder: what is only suspected, and every numerical choice.

What is suspected can be added to the fullest model; of a numerical choice the error is its effect.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dem_bridge.backends.base import ENGINE_BACKENDS, Resolution, Sampling, supports_of
from dem_bridge.backends.steps import default_step
from dem_bridge.backends.tabled import prescan_scene
from dem_bridge.campaign import Result
from dem_bridge.errors import RunBroken
from dem_bridge.lmp.engine import Engine
from dem_bridge.scene import Scene
from dem_bridge.studies.model_hierarchy.model_terms import angles_soften, crossed, hertzian
from dem_bridge.studies.model_hierarchy.models import Bench, Least, ModelHierarchy
from dem_bridge.studies.model_hierarchy.passage import Effect, Effects, Readings, decided, effects
from dem_bridge.studies.scatter import scattered
from dem_bridge.verification.verdict import Outcome

#: what is only suspected: drag (1/s), the overlap (m) at which softer contacts have Hertz' force
DRAG, ANCHOR = 10.0, 5e-6
#: steps of velocity-Verlet over the default one, the coarsest first, and that of LAMMPS
STEPS, OF_ENGINE = (100.0, 40.0, 10.0, 1.0), 10.0
#: what to call a run, short and in full, its backend and its settings
Choice = tuple[str, str, str, Resolution]


@dataclass(frozen=True, kw_only=True)
class Found:
    """Effects of one change, with its name."""

    name: str
    """Short."""
    what: str
    effects: Effects | None
    """None: there is no run."""
    outcome: Outcome
    """PASS: within the accuracy. NOT_RUN or BROKEN without a run."""
    note: str = ""


def doubts(bench: Bench, asked: Sequence[str], *, spread: float, draws: int) -> Iterator[Found]:
    """Yield the effects of terms that can be added to the fullest model."""
    hierarchy, full = bench.hierarchy, bench.hierarchy.model()
    parts: list[tuple[str, str, list[Scene]]] = []
    if crossed(full) and full.drag == 0.0:
        parts.append(("drag", f"drag of {DRAG:g} 1/s on every body", [replace(full, drag=DRAG)]))
    if crossed(full) and hertzian(full):
        what = f"n falling from 2.5 at 90 degrees to 2.2 at the smallest angle, same force at {1e6 * ANCHOR:g} um"
        parts.append(("exponents fall with the angle", what, [angles_soften(full, ANCHOR)]))
        what = f"angles off by {spread:g} degrees (standard deviation; median of {draws} chains)"
        chains = [scattered(full, spread=spread, seed=seed) for seed in range(draws)]
        parts.append(("angles scatter", what, chains))
    bench.of([full, *(one for *_, scenes in parts for one in scenes)])
    for name, what, scenes in parts:
        own, *others = bench.of([full, *scenes])
        found = _median([effects(own, one) for one in others])
        yield Found(name=name, what=what, effects=found, outcome=decided(found, asked, hierarchy.accuracy))


def _median(found: Sequence[Effects]) -> Effects:
    """Return the median of several draws, with an uncertainty that includes all of them."""
    if len(found) == 1:
        return found[0]

    def of(name: str) -> Effect:
        sizes = np.array([abs(one[name].value) for one in found])
        middle = float(np.median(sizes))
        spread = float(np.max(np.abs(sizes - middle))) if np.all(np.isfinite(sizes)) else 0.0
        return Effect(value=middle, uncertainty=spread + max(one[name].uncertainty for one in found), at=-1)

    return {name: of(name) for name in found[0]}


def choices(bench: Bench, asked: Sequence[str], engine: Engine | None) -> Iterator[Found]:
    """Every numerical choice on the fullest model, or on the barest where it cannot do the fullest."""
    hierarchy, full = bench.hierarchy, bench.hierarchy.model()
    barest = _barest(hierarchy)
    wanted = [*_without_engine(full, hierarchy.samples), *_of_engine(full, hierarchy.samples)]
    wanted.append(("ode45", "ode45 at MATLAB's default tolerances", "ode45", Resolution()))
    cases = []
    for *_, name, resolution in wanted:
        on = full if supports_of(name).covers(full) else barest
        case = hierarchy.case(on, name, resolution)
        cases.append(replace(case, engine=engine if name in ENGINE_BACKENDS else None, uncertainty=False))
    truths = bench.of([case.scene for case in cases])
    for (name, what, *_), case, truth, result in zip(wanted, cases, truths, bench.run(cases), strict=True):
        what = what if case.scene is full else f"{what} (of the barest chain)"
        yield _numerical(bench, name, what, truth, result, asked)


def _without_engine(scene: Scene, samples: int) -> Iterator[Choice]:
    """Yield the numerical choices without LAMMPS, from the coarsest to the finest."""
    rough = Resolution()
    yield "binary collisions", "binary collisions in place of the equations of motion", "bca", rough
    yield "the adiabatic wave", "the adiabatic wave in place of the equations of motion", "adiabatic", rough
    for factor in STEPS:
        own = replace(rough, dt=factor * _default_step(scene, samples))
        yield "velocity-Verlet", "velocity-Verlet", "verlet", own


def _of_engine(scene: Scene, samples: int) -> Iterator[Choice]:
    own = Resolution(dt=OF_ENGINE * _default_step(scene, samples))
    yield "LAMMPS granular", "LAMMPS, pair_style granular", "lammps-granular", own
    if scene.spacing is not None:
        large = replace(own, geometry="physical")
        what = "LAMMPS, pair_style granular, bodies of their physical radius"
        yield "the same, physical radius", what, "lammps-granular", large
    yield "LAMMPS table", "LAMMPS, pair_style table", "lammps-table", own


def _default_step(scene: Scene, samples: int) -> float:
    return default_step(scene, Sampling(count=samples), prescan_scene(scene))


def _numerical(bench: Bench, name: str, what: str, truth: Readings, result: Result, asked: Sequence[str]) -> Found:
    run = result.trajectory
    if run is None:
        outcome = Outcome.BROKEN if isinstance(result.failure, RunBroken) else Outcome.NOT_RUN
        return Found(name=name, what=what, effects=None, outcome=outcome, note=f"{what}: {result.failure}")
    dt = run.provenance["settings"].get("dt")
    step = f", dt = {dt:.3g} s" if dt else ""
    own = effects(truth, bench.read(result.case.scene, run), one_sided=True)
    return Found(
        name=f"{name}{step}",
        what=f"{what}{step}",
        effects=own,
        outcome=decided(own, asked, bench.hierarchy.accuracy),
    )


def _barest(hierarchy: ModelHierarchy) -> Scene:
    """All that theories do not know left out; stiffness and the striker's mass as in the fullest model."""
    kept = ("stiffness-law", "striker-stiffness", "striker-mass")
    return hierarchy.model(frozenset(one.id for one in hierarchy.model_terms if one.id not in kept))


def cheapest(bench: Bench, below: Least, asked: Sequence[str]) -> Found | None:
    """The coarsest numerics that keep the accuracy together with all that the least model leaves out."""
    hierarchy, scene = bench.hierarchy, below.scene
    [full] = bench.of([hierarchy.model()])
    wanted = list(_without_engine(scene, hierarchy.samples))
    cases = [hierarchy.case(scene, backend, resolution) for *_, backend, resolution in wanted]
    for (name, what, *_), result in zip(wanted, bench.run(cases), strict=True):
        found = _numerical(bench, name, what, full, result, asked)
        if found.outcome is Outcome.PASS:
            return found
    return None
