"""Measure how a change of the model or of the numerics changes observables while the front runs through the chain.

In the window "passage" nothing that returns from the end of the chain counts: samples end when the front of the fullest
model is at the last body, and bodies and contacts from :data:`ENDING` before the end on are left out, but for the
arrival there. Nor do the bodies before :data:`FIRST`, in which the striker's contact forms the pulse: a change of that
contact alone changes their residence times by a quarter, and those behind them by a percent. Their effects are the
window "start", apart. In chains too short for this all bodies count, and in those of up to 7 bodies the whole scene.
The window "whole" is the whole run. In both, body 0, which brings the impulse, has part in samples alone: it has no
arrival, and its peak is its start.

Changes are relative to the scales of the observables in the window.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from dem_bridge.errors import UsageError
from dem_bridge.observables.differences import Reading, Window, read, relative_to
from dem_bridge.observables.registry import OBSERVABLES
from dem_bridge.observables.verdict import Outcome, judge
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import Trajectory

_TIMES = ("arrival_at_end", "residence_time", "peak_velocity")
#: window -> observables that are judged unless others are named. Velocities at samples are not: where the front is a
#: little late, they are late everywhere
JUDGED: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {"passage": (*_TIMES, "first_peak_force"), "whole": (*_TIMES, "peak_force")}
)
#: number of bodies before the end, the last one included, that feel what stands behind it. A base in place of a free
#: end moves the first maximal compressions by 1e-3, 1e-7, 1e-14 of the last, the last but one and the last but two
ENDING = 2
#: first body, and contact, that counts in the passage, and how many must count for those before it to be left out
FIRST, COUNTED = 5, 3


def checked_observables(names: object) -> tuple[str, ...]:
    """Return the names of registered observables, each once; UsageError for anything else."""
    several = isinstance(names, Collection) and not isinstance(names, str) and len(names) > 0
    if not several or not set(names) <= set(OBSERVABLES):  # type: ignore[call-overload]
        raise UsageError(f"observables = {names!r}; allowed: a list of {', '.join(OBSERVABLES)}")
    return tuple(dict.fromkeys(names))  # type: ignore[call-overload]


@dataclass(frozen=True, kw_only=True)
class Effect:
    """Relative change of one observable, where along the chain it is largest."""

    value: float
    """With its sign; nan: no run has the observable; inf: only one of the two runs has it."""
    uncertainty: float
    """Of both runs, relative to the same scale."""
    at: int
    """Body or contact; -1: the chain as a whole."""

    @property
    def exists(self) -> bool:
        """Return whether any run has the observable."""
        return not math.isnan(self.value)


Effects = Mapping[str, Effect]
Readings = Mapping[str, Reading]


def last_counted(scene: Scene) -> int:
    """Return the number of the last body, and of the last contact, that counts in the passage of the front.

    Examples
    --------
    >>> import dem_bridge as db
    >>> last_counted(db.load_scene("decelerating-40"))
    38

    """
    last = scene.n_body - 1
    return last - ENDING if last > 3 * ENDING else last


def first_counted(scene: Scene) -> int:
    """Return the number of the first body, and of the first contact, that counts in the passage of the front.

    Examples
    --------
    >>> import dem_bridge as db
    >>> first_counted(db.load_scene("decelerating-40"))
    5

    """
    return FIRST if last_counted(scene) - FIRST >= COUNTED else 0


def window_of(scene: Scene, until: float, *, whole: bool = False, start: bool = False) -> Window:
    """Return the window in which effects are measured, without the contacts of walls, which not all models have.

    ``until`` (s) is when the front of the fullest model is at the end. ``start``: that of the bodies before the first
    that counts, which is empty where all count.
    """
    links = scene.n_body - 1
    if whole:
        return Window(bodies=range(scene.n_body), contacts=range(links))
    first, last = first_counted(scene), last_counted(scene)
    if start:
        return Window(until=until, bodies=range(first), contacts=range(first))
    return Window(until=until, bodies=range(first, last + 1), contacts=range(first, min(last + 1, links)))


def readings_of(scene: Scene, run: Trajectory, window: Window, names: Iterable[str]) -> Readings:
    """Return the named observables of a run in a window; ValueError for a run of another scene."""
    if run.provenance["scene_hash"] != scene.content_hash:
        raise ValueError(f"a run of {run.provenance['scene']!r} is read as one of {scene.name!r}")
    bodies = window.bodies or range(scene.n_body)
    behind = replace(window, bodies=range(max(bodies.start, 1), bodies.stop))
    return {name: read(name, scene, run, behind if OBSERVABLES[name].axis == ("body",) else window) for name in names}


def effect(full: Reading, other: Reading, *, one_sided: bool = False) -> Effect:
    """Return the largest change from ``full`` to ``other``.

    ``one_sided``: leave out the uncertainty of ``other``, whose error is what is measured.
    """
    errors = relative_to(full, other)
    if errors.worst is None:
        return Effect(value=math.nan, uncertainty=math.nan, at=-1)
    both = ~np.isnan(errors.uncertainty + errors.reference_uncertainty)
    total = errors.reference_uncertainty + (0.0 if one_sided else errors.uncertainty)
    axis = full.observable.axis
    along = axis[-1] if axis and axis[-1] != "time" else ""
    return Effect(
        value=float(errors.values[errors.worst]),
        # the largest of all places, because another place may have the largest change in truth
        uncertainty=float(np.max(total[both], initial=0.0)),
        at=full.window.first(along) + errors.worst[-1] if along else -1,
    )


def effects(full: Readings, other: Readings, *, one_sided: bool = False) -> dict[str, Effect]:
    """Return the :func:`effect` of every observable."""
    return {name: effect(reading, other[name], one_sided=one_sided) for name, reading in full.items()}


def decided(changes: Effects, observables: Sequence[str], accuracy: float) -> Outcome:
    """Decide whether the changes of all ``observables`` that exist stay within ``accuracy``.

    PASS: they do; FAIL: one does not; UNDECIDED: an uncertainty leaves it open.

    Examples
    --------
    >>> found = {"arrival_at_end": Effect(value=-0.004, uncertainty=1e-9, at=-1),
    ...          "residence_time": Effect(value=0.009, uncertainty=0.002, at=3)}
    >>> [decided(found, names, 0.01).value for names in (("arrival_at_end",), ("arrival_at_end", "residence_time"))]
    ['PASS', 'UNDECIDED']

    """
    effects_there = (changes[name] for name in observables if changes[name].exists)
    outcomes = {judge(abs(change.value), change.uncertainty, accuracy) for change in effects_there}
    return next((outcome for outcome in (Outcome.FAIL, Outcome.UNDECIDED) if outcome in outcomes), Outcome.PASS)


def largest(changes: Effects, observables: Sequence[str]) -> tuple[str, Effect]:
    """Return the name of the observable that changes most, and its effect."""
    name = max((name for name in observables if changes[name].exists), key=lambda name: abs(changes[name].value))
    return name, changes[name]
