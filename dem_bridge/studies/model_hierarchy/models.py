"""The models of one scene: which pieces of physics an accuracy requires, and the least model that is left.

Each piece is left out of the fullest model alone; then all that may be left out are, the one of the smallest effect
first, and every model on the way down is measured against the fullest: two effects of 0.6 % can make 1.2 % together.
What does not stay within the accuracy alone is not left out, for it could only pass where another error cancels it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from dem_bridge.backends.base import Resolution, Sampling
from dem_bridge.errors import UnsupportedScene, UsageError
from dem_bridge.observables.convergence import checked_accuracy
from dem_bridge.observables.registry import OBSERVABLES
from dem_bridge.observables.verdict import Outcome
from dem_bridge.report.study import check_setting
from dem_bridge.runs.campaign import Jobs, Progress, Result, run_cases
from dem_bridge.runs.case import Case
from dem_bridge.runs.store import Store
from dem_bridge.scene.scene import Scene
from dem_bridge.studies.model_hierarchy import passage
from dem_bridge.studies.model_hierarchy.model_terms import DASHPOT, ModelTerm, model, model_terms_of, named, needs
from dem_bridge.studies.model_hierarchy.passage import JUDGED, Effects, Readings, effects, last_counted
from dem_bridge.trajectory.trajectory import Trajectory
from dem_bridge.verification.reference_choice import REFERENCE
from dem_bridge.verification.roles import TWIN

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
        """Return the fullest model but for these pieces, and for what they bear, which cannot be without them."""
        for id in without:
            without |= self.bears[id]
        return replace(model(self.scene, self.model_terms, without), duration=self.duration)

    def case(self, scene: Scene, backend: str = REFERENCE, resolution: Resolution | None = None) -> Case:
        """Return the case of a model; by default that of the reference, with its uncertainty."""
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
        """List the cases of the fullest model, and of every other that :meth:`alone` needs."""
        models = [frozenset[str](), *(without for term in self.model_terms for without in self.alone(term))]
        return [self.case(self.model(without)) for without in dict.fromkeys(models)]


@dataclass(frozen=True, kw_only=True)
class Tried:
    """One change of the fullest model or of the numerics, with its effects."""

    name: str
    """Short."""
    what: str
    effects: Effects = field(default_factory=dict)
    """Empty: there is no run."""
    outcome: Outcome
    """PASS: within the accuracy. NOT_RUN or BROKEN without a run."""
    note: str = ""


@dataclass(frozen=True, kw_only=True)
class LeftOut(Tried):
    """One piece left out alone; PASS: it may be left out."""

    term: ModelTerm
    bears: Pieces
    """Pieces that had to be left out of both models."""
    start: Effects = field(default_factory=dict)
    """On the bodies before the first that counts; empty where all count."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Least:
    """The least model that stays within the accuracy."""

    scene: Scene
    """As long as the window."""
    without: Pieces
    effects: Effects
    """Against the fullest."""
    steps: tuple[Tried, ...]
    """The models that were tried on the way down, each named after the piece that it is without for the first time."""


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
    names = JUDGED[window] if observables is None else passage.checked_observables(observables)
    check_setting("dashpot", dashpot, "a number > 0 (N s/m)")
    accuracy = checked_accuracy(accuracy)
    model_terms = model_terms_of(scene, add=add, dashpot=dashpot)
    needed = {term.id: needs(scene, model_terms, term) for term in model_terms}
    bears = {id: frozenset(other for other, ids in needed.items() if id in ids) for id in needed}
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
        bears=bears,
    )


@dataclass(eq=False)
class Bench:
    """Runs models and reads them, each once."""

    hierarchy: ModelHierarchy
    jobs: Jobs = None
    progress: Progress | None = None
    store: Store | None = None
    until: float = math.inf
    """When the front of the fullest model is at the end, s; inf: not run yet."""
    _read: dict[str, Readings] = field(default_factory=dict)
    _start: dict[str, Readings] = field(default_factory=dict)

    def run(self, cases: Sequence[Case]) -> tuple[Result, ...]:
        """Run cases."""
        return run_cases(cases, jobs=self.jobs, progress=self.progress, store=self.store)

    def take(self, results: Sequence[Result]) -> None:
        """Read the results of :meth:`ModelHierarchy.cases`, the first of which is the fullest model."""
        if math.isinf(self.until):
            arrivals = _trajectory(results[0]).crossing_time[: self.hierarchy.scene.n_body - 1]
            self.until = float(arrivals[-1]) if np.isfinite(arrivals[-1:]).any() else self.hierarchy.duration
        for result in results:
            scene, run = result.case.scene, _trajectory(result)
            self._read[scene.content_hash] = self.read(scene, run)
            start = passage.window_of(scene, self.until, start=True)
            names = [name for name in self.hierarchy.tabulated if OBSERVABLES[name].axis in (("body",), ("contact",))]
            if self.hierarchy.window == "passage" and len(start.bodies or ()):
                self._start[scene.content_hash] = passage.readings_of(scene, run, start, names)

    def read(self, scene: Scene, run: Trajectory) -> Readings:
        """Return the observables of a run in the window."""
        window = passage.window_of(scene, self.until, whole=self.hierarchy.window == "whole")
        return passage.readings_of(scene, run, window, self.hierarchy.tabulated)

    def of(self, scenes: Sequence[Scene]) -> list[Readings]:
        """Return the readings of these scenes by the reference; scenes that were not run yet are run."""
        new = [self.hierarchy.case(scene) for scene in scenes if scene.content_hash not in self._read]
        if new:
            self.take(self.run(new))
        return [self._read[scene.content_hash] for scene in scenes]

    def start_of(self, scenes: Sequence[Scene]) -> Effects:
        """Return the effects between two scenes that have run on the bodies that the striker's contact forms.

        They are empty where all bodies count.
        """
        readings = [self._start[scene.content_hash] for scene in scenes if scene.content_hash in self._start]
        return effects(*readings) if len(readings) == len(scenes) else {}

    def tried(self, name: str, what: str, changes: Effects, observables: Sequence[str]) -> Tried:
        """Return a change with its outcome."""
        outcome = passage.decided(changes, observables, self.hierarchy.accuracy)
        return Tried(name=name, what=what, effects=changes, outcome=outcome)


def left_out(bench: Bench, observables: Sequence[str]) -> tuple[LeftOut, ...]:
    """Leave out every piece alone; the largest effect is the first."""
    hierarchy = bench.hierarchy
    bench.of([case.scene for case in hierarchy.cases()])
    results = []
    for term in hierarchy.model_terms:
        both = [hierarchy.model(without) for without in hierarchy.alone(term)]
        changes, start = effects(*bench.of(both)), bench.start_of(both)
        outcome, bears = passage.decided(changes, observables, hierarchy.accuracy), hierarchy.bears[term.id]
        what = f"{term.what}, of a chain without {named(bears)}" if bears else term.what
        name = term.id.replace("-", " ")
        results.append(
            LeftOut(name=name, what=what, effects=changes, outcome=outcome, term=term, bears=bears, start=start)
        )
    return tuple(sorted(results, key=lambda item: -abs(passage.largest(item.effects, observables)[1].value)))


def least(bench: Bench, alone: Sequence[LeftOut], observables: Sequence[str]) -> Least:
    """Return the fullest model without all that may be left out together; see the module's docstring."""
    hierarchy = bench.hierarchy
    [full] = bench.of([hierarchy.model()])
    without, changes, steps = frozenset[str](), effects(full, full), []
    may = [item for item in reversed(alone) if item.outcome is Outcome.PASS]
    # what bears another comes after it
    for item in sorted(may, key=lambda item: len(item.bears)):
        if not item.bears <= without:
            continue
        fewer = without | {item.term.id}
        [readings] = bench.of([hierarchy.model(fewer)])
        effects_of_all = effects(full, readings)
        outcome = passage.decided(effects_of_all, observables, hierarchy.accuracy)
        steps.append(Tried(name=item.term.id, what=f"without {named(fewer)}", effects=effects_of_all, outcome=outcome))
        if outcome is Outcome.PASS:
            without, changes = fewer, effects_of_all
    return Least(scene=hierarchy.model(without), without=without, effects=changes, steps=tuple(steps))


def judged(bench: Bench) -> tuple[str, ...]:
    """Return the judged observables that the fullest model has; UnsupportedScene where it has none of them."""
    scene, observables = bench.hierarchy.scene, bench.hierarchy.observables
    [full] = bench.of([bench.hierarchy.model()])
    changes = effects(full, full)
    names = tuple(name for name in observables if changes[name].exists)
    if not names:
        raise UnsupportedScene(
            f"{scene.name}: no impulse runs through the chain within {scene.duration:g} s, so that there is no"
            f" {' or '.join(observables)}; allowed: a longer duration, or observables = ('velocity',)"
        )
    return names


def least_scene(
    scene: Scene,
    *,
    accuracy: float,
    observables: object,
    window: str,
    jobs: Jobs = None,
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
    names = judged(bench)
    without = least(bench, left_out(bench, names), names).without
    if not without:
        return scene
    gone = f"without {named(without)}, at {100.0 * accuracy:g} %"
    return replace(
        model(scene, hierarchy.model_terms, without),
        name=f"{scene.name[:94]}.least",
        description=f"{scene.description}; {gone}" if scene.description else gone,
    )


def _trajectory(result: Result) -> Trajectory:
    if result.trajectory is None:
        assert result.failure is not None
        raise result.failure
    return result.trajectory
