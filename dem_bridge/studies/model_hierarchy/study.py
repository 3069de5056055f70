"""Study of the model hierarchy of a scene: which model terms and numerical choices an accuracy requires.

Beside the model terms of :mod:`.models` it measures conjectured effects (drag, exponents that fall with the angle,
angles that scatter) and every numerical choice of a run.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from dem_bridge.backends.base import ENGINE_BACKENDS, Resolution, Sampling, supports_of
from dem_bridge.backends.scene_prescan import prescan_scene
from dem_bridge.backends.steps import default_step
from dem_bridge.errors import RunBroken
from dem_bridge.lmp.engine import Engine
from dem_bridge.observables.registry import OBSERVABLES
from dem_bridge.observables.verdict import Outcome
from dem_bridge.report.columns import PERCENT, Column
from dem_bridge.report.study import Panel, Series, Study, Table, check_setting
from dem_bridge.runs.campaign import Jobs, Progress, Result
from dem_bridge.runs.store import Store
from dem_bridge.scene.scene import Scene
from dem_bridge.studies.model_hierarchy import models
from dem_bridge.studies.model_hierarchy.model_terms import (
    DASHPOT,
    PIECES,
    TEXTS,
    angles_soften,
    crossed,
    hertzian,
    named,
)
from dem_bridge.studies.model_hierarchy.models import Bench, Least, LeftOut, ModelHierarchy, Tried
from dem_bridge.studies.model_hierarchy.passage import (
    FIRST,
    JUDGED,
    Effect,
    Effects,
    Readings,
    effects,
    first_counted,
    largest,
)
from dem_bridge.studies.recalled import recall_study
from dem_bridge.studies.scatter import scattered
from dem_bridge.verification.roles import GRANULAR

#: what is only suspected: drag (1/s), the overlap (m) at which softer contacts have Hertz' force
DRAG, ANCHOR = 10.0, 5e-6
#: draws whose range has the median of all draws inside it in 97 of 100 cases: 1 - 2^(1 - 6)
DRAWS = 6
#: backends of the coarsest numerics, which are in the file from the coarsest to the finest
COARSE = ("bca", "adiabatic", "verlet")
#: name of a run, short and in full, its backend and its settings
Choice = tuple[str, str, str, Resolution]
#: numerical choices: name, in words, backend, and step in units of the default one
CHOICES = (
    ("binary collisions", "binary collisions in place of the equations of motion", "bca", None),
    ("the adiabatic wave", "the adiabatic wave in place of the equations of motion", "adiabatic", None),
    *(("velocity-Verlet", "velocity-Verlet", "verlet", steps) for steps in (100.0, 40.0, 10.0, 1.0)),
    ("LAMMPS granular", "LAMMPS, pair_style granular", GRANULAR, 10.0),
    ("LAMMPS table", "LAMMPS, pair_style table", "lammps-table", 10.0),
    ("ode45", "ode45 at MATLAB's default tolerances", "ode45", None),
)
#: whether something may be left out, by outcome
MAY = {"PASS": "yes", "FAIL": "no", "UNDECIDED": "undecided", "NOT_RUN": "not run", "BROKEN": "run broke"}


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
        yield bench.tried(name, what, median_of_draws([effects(first, readings) for readings in others]), observables)


def median_of_draws(draws: Sequence[Effects]) -> Effects:
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
    """Return the numerical choices that the scene has; steps are multiples of its default step."""
    step = default_step(scene, Sampling(count=hierarchy.samples), prescan_scene(scene))
    results = []
    for name, what, code, steps in CHOICES:
        resolution = Resolution(dt=None if steps is None else steps * step)
        results.append((name, what, code, resolution))
        if code == GRANULAR and scene.spacing is not None:
            physical = replace(resolution, geometry="physical")
            results.append(("the same, physical radius", f"{what}, bodies of their physical radius", code, physical))
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


#: below the accuracy, what a figure still shows
LEAST_SHOWN = 1e-3


def study_model_hierarchy(
    scene: Scene,
    *,
    accuracy: float = 0.01,
    observables: Sequence[str] | None = None,
    window: str = "passage",
    dashpot: float = DASHPOT,
    spread: float = 0.5,
    draws: int = 3,
    numerics: bool = True,
    engine: Engine | None = None,
    jobs: Jobs = None,
    progress: Progress | None = None,
    store: Store | None = None,
) -> Study:
    """Find which physics and which numerics a scene needs for an accuracy, and its smallest adequate model.

    Every model term that the scene has, or that follows from its geometry
    (:func:`.model_terms.model_terms_of`), is left out of the full model: each alone, then all that may go together.

    Parameters
    ----------
    scene : Scene
        Chain through which an impulse runs.
    accuracy : float
        Largest relative change of the observables that a simpler model may cause.
    observables : sequence of str
        Observables that must keep the accuracy, by the names that ``dem-bridge plan --help`` lists. None:
        arrival_at_end, residence_time, peak_velocity and first_peak_force (window "whole": peak_force).
    window : str
        "passage": until the front has passed, without what returns from the end; "whole": the whole run.
    dashpot : float
        Damping coefficient that is assumed for contacts without damping, N s/m.
    spread : float
        Standard deviation of the random errors of the contact angles, degrees.
    draws : int
        Number of chains with such errors. With fewer than 6 their median has no uncertainty.
    numerics : bool
        Whether numerical choices (steps, tables, backends) are examined, too.
    engine, jobs, progress, store : as in :func:`dem_bridge.study`

    Returns
    -------
    Study

    Raises
    ------
    UsageError
        For a setting out of its range.
    UnsupportedScene
        If no impulse runs through the chain.
    """
    check_setting("draws", draws, "a whole number of chains from 1 to 1000", least=1, most=1000)
    engine = engine or Engine.chosen()

    def found() -> Study:
        hierarchy = models.model_hierarchy_of(
            scene, accuracy=accuracy, observables=observables, dashpot=dashpot, window=window, store=store
        )
        bench = Bench(hierarchy, jobs=jobs, progress=progress, store=store)
        names = models.judged(bench)
        alone = models.left_out(bench, names)
        below = models.least(bench, alone, names)
        suspected = tuple(doubts(bench, names, spread=spread, draws=draws))
        numerical = tuple(choices(bench, names, engine)) if numerics else ()
        answer = [*_on_physics(hierarchy, alone, below, names, dashpot)]
        if suspected:
            answer.append(TEXTS("suspected", effects=_effects_of(suspected, names, "{}: {}")))
        if numerical:
            coarsest = cheapest(bench, below, names)
            answer += _on_numerics(hierarchy, numerical, coarsest, names)
        tables: dict[str, Sequence[Tried]] = {
            "physics": alone, "down": below.steps, "suspected": suspected, "numerics": numerical
        }  # fmt: skip
        panels = {"(a) left out": alone, "(b) suspected, and numerical choices": (*suspected, *numerical)}
        drawn = [_panel(title, hierarchy, items) for title, items in panels.items() if items]
        texts = {"scene": scene.name, "accuracy": accuracy, "least": LEAST_SHOWN}
        return TEXTS.study(
            texts,
            answer=tuple(answer),
            tables=(*(_table(hierarchy, id, items) for id, items in tables.items() if items), *_start_table(alone)),
            figures=(TEXTS.figure("effects", drawn, **texts, columns=1),) if drawn else (),
            verdicts=tuple(
                TEXTS.verdict("broken", scene=scene.name, **vars(item))
                for item in numerical
                if item.outcome is Outcome.BROKEN
            ),
            notes=tuple(_notes(hierarchy, bench, numerical, names)),
            provenance={"scene": scene.name, "scene_hash": scene.content_hash, "least_hash": below.scene.content_hash},
        )

    settings = {"accuracy": accuracy, "observables": observables, "window": window, "dashpot": dashpot}
    settings |= {"spread": spread, "draws": draws, "numerics": numerics}
    return recall_study("model-hierarchy", store, found, scene, engine, **settings)


def _columns(names: Sequence[str]) -> list[Column]:
    return [Column(OBSERVABLES[name].words, PERCENT) for name in names]


def _table(hierarchy: ModelHierarchy, id: str, items: Sequence[Tried]) -> Table:
    names = hierarchy.tabulated

    def cells(effects: Effects) -> tuple[str | float, ...]:
        if not effects:
            return ("",) * (len(names) + 1)
        bar = max((effect.uncertainty for effect in effects.values() if effect.exists), default=math.nan)
        return (*(effects[name].value for name in names), bar)

    rows = [(item.what, *cells(item.effects), MAY[item.outcome]) for item in items]
    last = (Column("largest uncertainty", PERCENT), f"within {100.0 * hierarchy.accuracy:g} %?")
    return TEXTS.table(id, ("what", *_columns(names), *last), rows, draws=DRAWS)


def _start_table(alone: Sequence[LeftOut]) -> Iterator[Table]:
    """Yield the table of effects on the first bodies; nothing where all bodies count."""
    items = [item for item in alone if item.start]
    if items:
        names = tuple(items[0].start)
        rows = [(item.what, *(item.start[name].value for name in names)) for item in items]
        yield TEXTS.table("start", ("what", *_columns(names)), rows, first=FIRST)


def question_table(requested: Iterable[tuple[ModelHierarchy, Sequence[LeftOut]]], accuracy: float) -> Table:
    """Return the table of model terms that may be left out of several scenes, a row for each term."""
    names = JUDGED["passage"]
    rows = [
        (
            item.term.what,
            hierarchy.scene.name,
            *(item.effects[name].value for name in names),
            MAY[item.outcome],
        )
        for hierarchy, alone in requested
        for item in alone
    ]
    columns = ("left out", "chain", *_columns(names), "may be left out?")
    return TEXTS.table("left-out", columns, rows, accuracy=accuracy, first=FIRST)


def _panel(title: str, hierarchy: ModelHierarchy, items: Sequence[Tried]) -> Panel:
    """Return the sizes of effects and the accuracy, a row for each effect."""
    limit, places = 100.0 * hierarchy.accuracy, np.arange(len(items), dtype=float)
    ends = np.array([-0.5, len(items) - 0.5])
    series = [Series(label="accuracy", style="guide", x=np.array([limit, limit]), y=ends)]
    for nth, name in enumerate(hierarchy.tabulated, start=1):
        sizes = 100.0 * np.abs([item.effects[name].value if item.effects else math.nan for item in items])
        drawn = np.where(np.isfinite(sizes), np.maximum(sizes, LEAST_SHOWN * limit), np.nan)
        series.append(Series(label=OBSERVABLES[name].words, style=f"mark-{nth}", x=drawn, y=places))
    return TEXTS.panel("effects", series, rows=tuple(item.name for item in items), title=title)


def _on_physics(
    hierarchy: ModelHierarchy, alone: Sequence[LeftOut], below: Least, names: Sequence[str], dashpot: float
) -> Iterator[str]:
    if alone:
        rest = TEXTS("nothing")
        if below.without:
            rest = TEXTS("without", names=named(below.without), effect=_words_of(below.effects, names))
        needed = named({item.term.id for item in alone} - below.without) or "none of its physics"
        yield TEXTS("requires", accuracy=hierarchy.accuracy, scene=hierarchy.scene.name, needed=needed, rest=rest)
        effects = "; ".join(f"{named([item.term.id])} {_words_of(item.effects, names)}" for item in alone)
        yield TEXTS("alone", effects=effects)
    else:
        yield TEXTS("none", scene=hierarchy.scene.name)
    for item in alone:
        piece = named([item.term.id])
        if item.bears and item.outcome is Outcome.PASS and item.term.id not in below.without:
            yield TEXTS("kept", bears=named(item.bears), name=piece)
        if item.term.supposed and (worst := abs(largest(item.effects, names)[1].value)) > 0.0:
            yield TEXTS("supposed", name=piece, dashpot=dashpot, enough=dashpot * hierarchy.accuracy / worst)


def _on_numerics(
    hierarchy: ModelHierarchy, numerical: Sequence[Tried], coarsest: Tried | None, names: Sequence[str]
) -> Iterator[str]:
    accuracy = hierarchy.accuracy
    effects = _effects_of([item for item in numerical if item.outcome is Outcome.FAIL], names, "{} ({})")
    yield TEXTS("fail", accuracy=accuracy, effects=effects) if effects else TEXTS("pass", accuracy=accuracy)
    if coarsest is not None:
        yield TEXTS("coarsest", what=coarsest.what, effect=_words_of(coarsest.effects, names))
    else:
        yield TEXTS("finer", accuracy=accuracy)


def _effects_of(items: Sequence[Tried], names: Sequence[str], form: str) -> str:
    """Return what was changed, with its largest effect."""
    return "; ".join(
        form.format(item.what, _words_of(item.effects, names)) for item in items if item.effects is not None
    )


def _words_of(effects: Effects, names: Sequence[str]) -> str:
    """Return the largest effect with its uncertainty and place."""
    name, effect = largest(effects, names)
    words = OBSERVABLES[name].words
    if math.isinf(effect.value):
        return TEXTS("infinite", words=words)
    place = f" of {OBSERVABLES[name].axis[-1]} {effect.at}" if effect.at >= 0 else ""
    numbers = {"value": 100.0 * effect.value, "uncertainty": 100.0 * effect.uncertainty}
    text = "without_uncertainty" if math.isnan(effect.uncertainty) else "effect"
    return TEXTS(text, words=words, place=place, **numbers)


def _notes(hierarchy: ModelHierarchy, bench: Bench, numerical: Sequence[Tried], names: Sequence[str]) -> Iterator[str]:
    yield TEXTS("judged", words=", ".join(OBSERVABLES[name].words for name in names))
    if hierarchy.window == "passage":
        first = first_counted(hierarchy.scene)
        start = TEXTS("start", first=first) if first else ""
        yield TEXTS("passage", until=1e3 * bench.until, duration=1e3 * hierarchy.duration, start=start)
    ids = {term.id for term in hierarchy.model_terms}
    if missing := [id for id in PIECES if id not in ids]:
        yield TEXTS("missing", names=named(missing))
    yield from (item.note for item in numerical if item.note)
