"""Study of the model hierarchy of a scene: which model terms and numerical choices an accuracy requires.

Beside the model terms of :mod:`.models` it measures conjectured effects (drag, exponents that fall with the angle,
angles that scatter) and every numerical choice of :mod:`.choices`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from dem_bridge.campaign import Progress
from dem_bridge.errors import UsageError
from dem_bridge.lmp.engine import Engine
from dem_bridge.observables.registry import OBSERVABLES
from dem_bridge.runs.store import Store
from dem_bridge.scene import Scene
from dem_bridge.studies.model_hierarchy.choices import Found, cheapest, choices, doubts
from dem_bridge.studies.model_hierarchy.model_terms import DASHPOT, PIECES, named
from dem_bridge.studies.model_hierarchy.models import (
    Bench,
    Least,
    LeftOut,
    ModelHierarchy,
    judged,
    least,
    left_out,
    model_hierarchy_of,
)
from dem_bridge.studies.model_hierarchy.passage import JUDGED, Effect, Effects, largest
from dem_bridge.studies.study import FigureData, Panel, Series, Study, Table
from dem_bridge.verification.verdict import Outcome, Verdict

#: whether something may be left out
MAY = {
    Outcome.PASS: "yes",
    Outcome.FAIL: "no",
    Outcome.UNDECIDED: "undecided",
    Outcome.NOT_RUN: "not run",
    Outcome.BROKEN: "run broke",
}
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
    jobs: int | None = None,
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
        Number of chains with such errors.
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
    if isinstance(draws, bool) or not isinstance(draws, int) or not 1 <= draws <= 1000:
        raise UsageError(f"draws = {draws!r}; allowed: a whole number of chains from 1 to 1000")
    hierarchy = model_hierarchy_of(
        scene, accuracy=accuracy, observables=observables, dashpot=dashpot, window=window, store=store
    )
    bench = Bench(hierarchy, jobs=jobs, progress=progress, store=store)
    asked = judged(bench)
    alone = left_out(bench, asked)
    below = least(bench, alone, asked)
    suspected = tuple(doubts(bench, asked, spread=spread, draws=draws))
    numerical = tuple(choices(bench, asked, engine)) if numerics else ()
    coarsest = cheapest(bench, below, asked) if numerics else None
    pieces, beside = tuple(_pieces(alone)), (*suspected, *numerical)
    parts = (
        ("physics", "Physics left out of the fullest model, each alone", _ALONE, pieces),
        ("down", "The way down: left out together", _TOGETHER, tuple(_down(below))),
        ("suspected", "What is only suspected, added to the fullest model", _SUSPECTED, suspected),
        ("numerics", "Numerical choices", _NUMERICS, numerical),
    )
    return Study(
        id="model-hierarchy",
        title=f"What {scene.name} requires at {_percent(accuracy)}",
        answer=tuple(_answer(hierarchy, alone, below, suspected, numerical, coarsest, asked, dashpot)),
        tables=tuple(_table(hierarchy, id, title, said, found) for id, title, said, found in parts if found),
        figures=(_figure(hierarchy, pieces, beside),) if pieces or beside else (),
        verdicts=tuple(_broken(scene, one) for one in numerical if one.outcome is Outcome.BROKEN),
        notes=tuple(_notes(hierarchy, bench, numerical, asked)),
        provenance={"scene": scene.name, "scene_hash": scene.content_hash, "least_hash": below.scene.content_hash},
    )


def _broken(scene: Scene, found: Found) -> Verdict:
    return Verdict(
        scene=scene.name,
        quantity=found.what,
        backend=found.name,
        reference="reference",
        outcome=Outcome.BROKEN,
        sentence=found.note or f"{found.what}: the run broke.",
    )


# tables

_ALONE = (
    "Change by leaving out each piece alone, with its sign, where along the chain it is largest; the largest first."
    " What bears another piece is judged with that left out of both models."
)
_TOGETHER = (
    "Every model that was tried against the fullest, the piece of the smallest effect first. What fails is put back."
)
_SUSPECTED = (
    "Of these nothing is known but that they are likely: the effects are those of the values taken. A median of draws"
    " has no sign, and its bar takes in all draws."
)
_NUMERICS = (
    "Errors against the reference on the fullest model; of what refuses that, on the barest chain: without all that it"
    " cannot do. Their bars are those of the reference."
)


def _pieces(alone: Sequence[LeftOut]) -> Iterator[Found]:
    for one in alone:
        borne = f", of a chain without {named(one.bears)}" if one.bears else ""
        name = one.term.id.replace("-", " ")
        yield Found(name=name, what=f"{one.term.what}{borne}", effects=one.effects, outcome=one.outcome)


def _down(below: Least) -> Iterator[Found]:
    for step in below.steps:
        what = f"without {named(step.without)}"
        yield Found(name=step.tried, what=what, effects=step.effects, outcome=step.outcome)


def _table(hierarchy: ModelHierarchy, id: str, title: str, caption: str, found: Sequence[Found]) -> Table:
    names = hierarchy.tabulated

    def cells(effects: Effects | None) -> tuple[str | float, ...]:
        if effects is None:
            return ("",) * (len(names) + 1)
        bar = max((one.uncertainty for one in effects.values() if one.exists), default=math.nan)
        return (*(100.0 * effects[name].value for name in names), 100.0 * bar)

    return Table(
        id=id,
        title=title,
        caption=caption,
        columns=(
            "what",
            *(f"{OBSERVABLES[name].words} (%)" for name in names),
            "largest uncertainty (%)",
            f"within {_percent(hierarchy.accuracy)}?",
        ),
        rows=tuple((one.what, *cells(one.effects), MAY[one.outcome]) for one in found),
    )


def question_table(found: Iterable[tuple[ModelHierarchy, Sequence[LeftOut]]], accuracy: float) -> Table:
    """Return the table of model terms that may be left out of several scenes, a row for each term."""
    names = JUDGED["passage"]
    return Table(
        id="left-out",
        title=f"What may be left out at {_percent(accuracy)}",
        caption=(
            "Each piece of physics left out of the fullest model that the paper's words allow: the chain upright on a"
            " base, pressed by its weight, with Hertz' exact stiffness, the striker as heavy as its radius says, and"
            " losses in contacts, whose size is supposed, for the paper gives none. Changes of the first passage in per"
            " cent, of the worst body or contact but for the last ones, which feel the end; the arrival is that at the"
            " last cylinder. The base is judged on the weightless chain, for a weight needs it."
        ),
        columns=("left out", "chain", *(f"{OBSERVABLES[name].words} (%)" for name in names), "may be left out?"),
        rows=tuple(
            (
                one.term.what,
                hierarchy.scene.name,
                *(100.0 * one.effects[name].value for name in names),
                MAY[one.outcome],
            )
            for hierarchy, alone in found
            for one in alone
        ),
    )


# figure


def _figure(hierarchy: ModelHierarchy, pieces: Sequence[Found], beside: Sequence[Found]) -> FigureData:
    """Sizes of all effects beside the accuracy."""
    parts = (("(a) left out", pieces), ("(b) suspected, and numerical choices", beside))
    return FigureData(
        id="effects",
        title=f"Effects beside the accuracy: {hierarchy.scene.name}",
        caption=(
            f"Size of the change of each observable; the line is the accuracy, {_percent(hierarchy.accuracy)}. What is"
            f" smaller than {LEAST_SHOWN:g} of it stands at the left edge; the tables have the numbers."
        ),
        panels=tuple(_panel(title, hierarchy, found) for title, found in parts if found),
        columns=1,
    )


def _panel(title: str, hierarchy: ModelHierarchy, found: Sequence[Found]) -> Panel:
    limit = 100.0 * hierarchy.accuracy
    places = np.arange(len(found), dtype=float)

    def series(name: str, nth: int) -> Series:
        sizes = 100.0 * np.abs([math.nan if one.effects is None else one.effects[name].value for one in found])
        shown = np.where(np.isfinite(sizes), np.maximum(sizes, LEAST_SHOWN * limit), np.nan)
        return Series(label=OBSERVABLES[name].words, style=f"mark-{nth}", x=shown, y=places)

    line = Series(label="accuracy", style="guide", x=np.array([limit, limit]), y=np.array([-0.5, len(found) - 0.5]))
    return Panel(
        title=title,
        x_label="size of the change (%)",
        y_label="",
        series=(line, *(series(name, nth) for nth, name in enumerate(hierarchy.tabulated, start=1))),
        rows=tuple(one.name for one in found),
    )


# words


def _answer(
    hierarchy: ModelHierarchy,
    alone: Sequence[LeftOut],
    below: Least,
    suspected: Sequence[Found],
    numerical: Sequence[Found],
    coarsest: Found | None,
    asked: Sequence[str],
    dashpot: float,
) -> Iterator[str]:
    wanted, name = _percent(hierarchy.accuracy), hierarchy.scene.name
    ids = {one.term.id for one in alone}
    if not alone:
        yield f"{name} has no physics that could be left out."
    else:
        needed = named(ids - below.without)
        yield f"At {wanted} {name} requires {needed or 'none of its physics'}; {_given_up(below, asked)}."
        said = "; ".join(f"{named([one.term.id])} {_said(one.effects, asked)}" for one in alone)
        yield f"Left out alone, each changes at most: {said}."
    for one in alone:
        piece = named([one.term.id])
        if one.bears and one.outcome is Outcome.PASS and one.term.id not in below.without:
            yield f"Without {named(one.bears)} {piece} could go, too: it stays for what it bears."
        if one.term.supposed and (worst := abs(largest(one.effects, asked)[1].value)) > 0.0:
            yield (
                f"Of {piece} nothing is known but that it is there: {dashpot:g} N s/m is supposed, and in proportion"
                f" {dashpot * hierarchy.accuracy / worst:.2g} N s/m could be left out."
            )
    if suspected:
        said = "; ".join(f"{one.what}: {_said(one.effects, asked)}" for one in suspected if one.effects is not None)
        yield f"What is only suspected, added to it: {said}."
    if numerical:
        fail = [one for one in numerical if one.outcome is Outcome.FAIL and one.effects is not None]
        words = "; ".join(f"{one.what} ({_said(one.effects, asked)})" for one in fail if one.effects is not None)
        found = f"these do not stay within {wanted}: {words}" if words else f"all stay within {wanted}"
        yield f"Of the numerical choices {found}."
        if coarsest is not None and coarsest.effects is not None:
            yield (
                f"The least model by the coarsest of them that serves it, {coarsest.what}, is off the fullest by at"
                f" most {_said(coarsest.effects, asked)}: model and numerics together."
            )
        else:
            yield f"No numerical choice tried keeps {wanted} together with what the least model leaves out."


def _given_up(below: Least, asked: Sequence[str]) -> str:
    if not below.without:
        return "nothing may be left out"
    return f"{named(below.without)} may be left out, which changes in all at most {_said(below.effects, asked)}"


def _said(found: Effects, asked: Sequence[str]) -> str:
    """The largest effect with its bar and place."""
    name, one = largest(found, asked)
    if math.isinf(one.value):
        return f"the {OBSERVABLES[name].words}, which only one of the two has"
    return (
        f"{100.0 * one.value:+.3g} % ± {100.0 * one.uncertainty:.1g} % ({OBSERVABLES[name].words}{_place(name, one)})"
    )


def _place(name: str, one: Effect) -> str:
    return f" of {OBSERVABLES[name].axis[-1]} {one.at}" if one.at >= 0 else ""


def _percent(share: float) -> str:
    return f"{100.0 * share:g} %"


def _notes(hierarchy: ModelHierarchy, bench: Bench, numerical: Sequence[Found], asked: Sequence[str]) -> Iterator[str]:
    there = {one.id for one in hierarchy.model_terms}
    judged_by = ", ".join(OBSERVABLES[name].words for name in asked)
    yield f"Judged: {judged_by}. Where the front is late, velocities at samples are late everywhere."
    if hierarchy.window == "passage":
        yield (
            f"Passage of the front: until {1e3 * bench.until:.4g} ms in the fullest model, runs of"
            f" {1e3 * hierarchy.duration:g} ms. Bodies and contacts that feel the end do not count, but for the"
            " arrival."
        )
    if missing := [id for id in PIECES if id not in there]:
        yield f"Not there, so that there is nothing to switch: {named(missing)}."
    yield from (one.note for one in numerical if one.note)
