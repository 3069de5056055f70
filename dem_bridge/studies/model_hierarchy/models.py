"""The ladder of models of one scene: which pieces of physics an accuracy asks for, and the least model that is left.

Each piece is left out of the fullest model alone; then all that may be left out are, the one of the smallest effect
first, and every model on the way down is measured against the fullest: two effects of 0.6 % can make 1.2 % together.
What does not stay within the accuracy alone is not left out, for it could only pass where another error cancels it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dem_bridge.accuracy import checked_accuracy
from dem_bridge.backends.base import Resolution, Sampling
from dem_bridge.campaign import Progress, Result, run_cases
from dem_bridge.errors import UnsupportedScene, UsageError
from dem_bridge.runs.case import Case
from dem_bridge.runs.store import Store
from dem_bridge.scene import Scene
from dem_bridge.studies.model_hierarchy.model_terms import DASHPOT, ModelTerm, model, model_terms_of, named, needs
from dem_bridge.studies.model_hierarchy.passage import (
    JUDGED,
    Effects,
    Readings,
    checked_observables,
    decided,
    effects,
    largest,
    last_counted,
    readings_of,
    window_of,
)
from dem_bridge.trajectory import Trajectory
from dem_bridge.verification.roles import REFERENCE, TWIN
from dem_bridge.verification.verdict import Outcome

#: of the arrival at the end of the fullest model: another may be so much later
PASSAGE = 1.3
#: samples to the shortest residence time, and how many there are at least and at most
PER_RESIDENCE, LEAST_SAMPLES, MOST_SAMPLES = 4.0, 200, 4000
#: tolerance of a reference that is adaptive, over the accuracy: its bars are about a hundred times it
RTOL = 1e-6
Pieces = frozenset[str]


@dataclass(frozen=True, kw_only=True, eq=False)
class ModelHierarchy:
    """The models of one scene, as long as what is asked about lasts. Made by :func:`model_hierarchy_of`."""

    scene: Scene
    model_terms: tuple[ModelTerm, ...]
    duration: float
    """s."""
    samples: int
    accuracy: float
    window: str
    """A key of :data:`.passage.JUDGED`."""
    observables: tuple[str, ...]
    """Those that must stay within the accuracy."""
    bears: Mapping[str, Pieces]
    """Id of a switch -> ids of those that cannot be on without it."""

    @property
    def tabulated(self) -> tuple[str, ...]:
        """Observables whose changes are measured: those of the window, velocities at samples, and those judged."""
        return tuple(dict.fromkeys((*JUDGED[self.window], "velocity", *self.observables)))

    def model(self, without: Pieces = frozenset()) -> Scene:
        """The fullest model but for these pieces; with what they bear, for that cannot be without them."""
        for id in without:
            without |= self.bears[id]
        return self.cut(model(self.scene, self.model_terms, without))

    def cut(self, scene: Scene) -> Scene:
        return replace(scene, duration=self.duration)

    def case(self, scene: Scene, backend: str = REFERENCE, resolution: Resolution | None = None) -> Case:
        """A run of a model; by default the reference's, with bars."""
        if resolution is None:
            resolution = Resolution(rtol=min(1e-8, max(3e-14, RTOL * self.accuracy)))
        return Case(scene=scene, backend=backend, resolution=resolution, sampling=Sampling(count=self.samples))

    def alone(self, term: ModelTerm) -> tuple[Pieces, Pieces]:
        """Return the terms left out of the two models whose difference is the effect of this term alone.

        A base that carries a weight can only be left out with the weight, so its own effect is that on the weightless
        chain.
        """
        return self.bears[term.id], self.bears[term.id] | {term.id}

    def cases(self) -> list[Case]:
        """The fullest model, and every other that :meth:`alone` asks for."""
        asked = [frozenset(), *(one for term in self.model_terms for one in self.alone(term))]
        return [self.case(self.model(one)) for one in dict.fromkeys(asked)]


@dataclass(frozen=True, kw_only=True)
class LeftOut:
    """One piece left out alone."""

    term: ModelTerm
    effects: Effects
    outcome: Outcome
    """PASS: may be left out."""
    bears: Pieces
    """What had to be left out of both models."""


@dataclass(frozen=True, kw_only=True)
class Step:
    """A model on the way down: what is left out of it in all, and what that changes."""

    tried: str
    without: Pieces
    effects: Effects
    outcome: Outcome


@dataclass(frozen=True, kw_only=True, eq=False)
class Least:
    """The least model that stays within the accuracy."""

    scene: Scene
    """As long as the window."""
    without: Pieces
    effects: Effects
    """Against the fullest."""
    steps: tuple[Step, ...]


def model_hierarchy_of(
    scene: Scene,
    *,
    accuracy: float = 0.01,
    add: bool = True,
    observables: object = None,
    dashpot: float = DASHPOT,
    window: str = "passage",
    store: Store | None = None,
) -> ModelHierarchy:
    """All models of a scene; ``add`` and ``dashpot`` as in :func:`.model_terms.model_terms_of`.

    ``window``: "passage", of the front through the chain (a coarse run says how long it takes), or "whole".
    """
    if window not in JUDGED:
        raise UsageError(f"window = {window!r}; allowed: {' or '.join(JUDGED)}")
    names = JUDGED[window] if observables is None else checked_observables(observables)
    if isinstance(dashpot, bool) or not isinstance(dashpot, int | float) or not 0.0 < dashpot < math.inf:
        raise UsageError(f"dashpot = {dashpot!r}; allowed: a number > 0 (N s/m)")
    accuracy = checked_accuracy(accuracy)
    model_terms = model_terms_of(scene, add=add, dashpot=dashpot)
    bears: dict[str, set[str]] = {one.id: set() for one in model_terms}
    for one in model_terms:
        for id in needs(scene, model_terms, one) & bears.keys():
            bears[id].add(one.id)
    full = model(scene, model_terms)
    coarse = Case(scene=full, backend=TWIN, resolution=Resolution(), sampling=Sampling(count=1), uncertainty=False)
    [result] = run_cases([coarse], store=store)
    crossing = _trajectory(result).crossing_time[: scene.n_body - 1]
    duration = scene.duration
    # of a chain whose last body counts the end counts, too
    if window == "passage" and last_counted(scene) < scene.n_body - 1 and np.isfinite(crossing[-1]):
        duration = float(f"{min(PASSAGE * crossing[-1], duration):.3g}")
    residence = np.diff(crossing)[: last_counted(scene)]
    shortest = float(np.min(residence[residence > 0.0], initial=duration))
    samples = int(np.clip(math.ceil(PER_RESIDENCE * duration / shortest), LEAST_SAMPLES, MOST_SAMPLES))
    return ModelHierarchy(
        scene=scene,
        model_terms=model_terms,
        duration=duration,
        samples=samples,
        accuracy=accuracy,
        window=window,
        observables=names,
        bears={id: frozenset(ids) for id, ids in bears.items()},
    )


class Bench:
    """Runs models and reads them, each once."""

    def __init__(
        self,
        hierarchy: ModelHierarchy,
        *,
        jobs: int | None = None,
        progress: Progress | None = None,
        store: Store | None = None,
    ) -> None:
        self.hierarchy, self._jobs, self._tell, self._store = hierarchy, jobs, progress, store
        self._read: dict[str, Readings] = {}
        self.until = math.inf

    def run(self, cases: Sequence[Case]) -> tuple[Result, ...]:
        return run_cases(cases, jobs=self._jobs, progress=self._tell, store=self._store)

    def take(self, results: Sequence[Result]) -> None:
        """Read the results of :meth:`ModelHierarchy.cases`, the first of which is the fullest model."""
        if math.isinf(self.until):
            run = _trajectory(results[0])
            arrival = run.crossing_time[self.hierarchy.scene.n_body - 2 : self.hierarchy.scene.n_body - 1]
            self.until = float(arrival[0]) if len(arrival) and np.isfinite(arrival[0]) else self.hierarchy.duration
        for one in results:
            self._read[one.case.scene.content_hash] = self.read(one.case.scene, _trajectory(one))

    def read(self, scene: Scene, run: Trajectory) -> Readings:
        window = window_of(scene, self.until, whole=self.hierarchy.window == "whole")
        return readings_of(scene, run, window, self.hierarchy.tabulated)

    def of(self, scenes: Sequence[Scene]) -> list[Readings]:
        """Return the readings of these scenes by the reference; scenes that were not run yet are run."""
        new = [self.hierarchy.case(one) for one in scenes if one.content_hash not in self._read]
        if new:
            self.take(self.run(new))
        return [self._read[one.content_hash] for one in scenes]


def left_out(bench: Bench, observables: Sequence[str]) -> tuple[LeftOut, ...]:
    """Every piece alone, the largest effect first."""
    hierarchy = bench.hierarchy
    bench.of([case.scene for case in hierarchy.cases()])
    found = []
    for term in hierarchy.model_terms:
        full, other = bench.of([hierarchy.model(one) for one in hierarchy.alone(term)])
        own = effects(full, other)
        found.append(
            LeftOut(
                term=term,
                effects=own,
                outcome=decided(own, observables, hierarchy.accuracy),
                bears=hierarchy.bears[term.id],
            )
        )
    return tuple(sorted(found, key=lambda one: -abs(largest(one.effects, observables)[1].value)))


def least(bench: Bench, alone: Sequence[LeftOut], observables: Sequence[str]) -> Least:
    """The fullest model without all that may be left out together; see the module's docstring."""
    hierarchy = bench.hierarchy
    [full] = bench.of([hierarchy.model()])
    without, found, steps = frozenset[str](), effects(full, full), []
    may = [one for one in reversed(alone) if one.outcome is Outcome.PASS]
    # what bears another comes after it
    for one in sorted(may, key=lambda one: len(one.bears)):
        if not one.bears <= without:
            continue
        [readings] = bench.of([hierarchy.model(without | {one.term.id})])
        own = effects(full, readings)
        outcome = decided(own, observables, hierarchy.accuracy)
        steps.append(Step(tried=one.term.id, without=without | {one.term.id}, effects=own, outcome=outcome))
        if outcome is Outcome.PASS:
            without, found = without | {one.term.id}, own
    return Least(scene=hierarchy.model(without), without=without, effects=found, steps=tuple(steps))


def judged(bench: Bench) -> tuple[str, ...]:
    """Return the judged observables that the fullest model has; UnsupportedScene where it has none of them."""
    asked = bench.hierarchy.observables
    [full] = bench.of([bench.hierarchy.model()])
    own = effects(full, full)
    found = tuple(name for name in asked if own[name].exists)
    if not found:
        raise UnsupportedScene(
            f"{bench.hierarchy.scene.name}: no impulse runs through the chain within"
            f" {bench.hierarchy.scene.duration:g} s, so that there is no {' or '.join(asked)};"
            " allowed: a longer duration, or observables = ('velocity',)"
        )
    return found


def least_scene(
    scene: Scene,
    *,
    accuracy: float,
    observables: object,
    window: str,
    jobs: int | None = None,
    progress: Progress | None = None,
    store: Store | None = None,
) -> Scene:
    """See :func:`dem_bridge.api.studies.minimal`."""
    hierarchy = model_hierarchy_of(
        scene, accuracy=accuracy, add=False, observables=observables, window=window, store=store
    )
    if not hierarchy.model_terms:
        return scene
    bench = Bench(hierarchy, jobs=jobs, progress=progress, store=store)
    asked = judged(bench)
    found = least(bench, left_out(bench, asked), asked)
    if not found.without:
        return scene
    gone = f"without {named(found.without)}, at {100.0 * accuracy:g} %"
    return replace(
        model(scene, hierarchy.model_terms, found.without),
        name=f"{scene.name[:94]}.least",
        description=f"{scene.description}; {gone}" if scene.description else gone,
    )


def _trajectory(result: Result) -> Trajectory:
    if result.trajectory is None:
        assert result.failure is not None
        raise result.failure
    return result.trajectory
