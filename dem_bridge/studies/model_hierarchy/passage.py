"""What one model changes beside another while the front runs through the chain, observable by observable.

The window is the passage of the front. What comes back from the end is none of it, so a base behind a long chain
matters for its last bodies alone: those from :data:`ENDING` before the end on do not count, but for the arrival there.
In chains of up to 7 bodies all count, for as long as the scene lasts.

=============  ====================================================================================================
arrival        first maximal compression of the last contact of the chain: when the front is at the last body
residence      how long each body holds the impulse, the worst body
peak_velocity  the largest velocity of each body until it hands the impulse on, the worst body
peak_force     the elastic force of each contact at its first maximal compression, the worst contact
velocity       the largest difference at any sample, of all bodies, until the front is at the last body
=============  ====================================================================================================

All are relative: the arrival to itself, the velocities at samples to the largest of all, each residence time, peak
velocity and force to its own, or to a thousandth of the largest of the chain where that is more.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from dem_bridge.errors import UsageError
from dem_bridge.observables.front import peak_velocity_of_front, residence_bar, residence_by_crossing
from dem_bridge.observables.interpolate import FEWER, NODES, hermite
from dem_bridge.scene import Scene
from dem_bridge.trajectory import Trajectory, own_scale
from dem_bridge.verification.verdict import Outcome, judge

Floats = NDArray[np.float64]
#: observable -> whether it is of a "body", a "contact", or of the whole chain ("")
OBSERVABLES: Mapping[str, str] = MappingProxyType(
    {"arrival": "", "residence": "body", "peak_velocity": "body", "peak_force": "contact", "velocity": "body"}
)
#: those that are judged unless others are asked for: a trace is late as a whole where its front is late a little
JUDGED = ("arrival", "residence", "peak_velocity", "peak_force")
#: bodies before the end, the last one included, that feel what stands behind it. A base in place of a free end moves
#: the first maximal compressions by 1e-3, 1e-7, 1e-14 of the last, the last but one and the last but two
ENDING = 2


def checked_observables(names: object) -> tuple[str, ...]:
    """UsageError, in one line, for what is no list of :data:`OBSERVABLES`."""
    known = isinstance(names, Collection) and not isinstance(names, str) and len(names) > 0
    if not known or not set(names) <= set(OBSERVABLES):  # type: ignore[call-overload]
        raise UsageError(f"observables = {names!r}; allowed: a list of {', '.join(OBSERVABLES)}")
    return tuple(name for name in OBSERVABLES if name in names)  # type: ignore[operator]


@dataclass(frozen=True, kw_only=True, eq=False)
class Reading:
    """One observable of one run: ``values`` and ``bars`` ``(..., n)``, the last axis along the chain."""

    values: Floats
    bars: Floats
    first: int
    """Number of the body or contact that comes first."""


@dataclass(frozen=True, kw_only=True)
class Effect:
    """Change of one observable, relative, where along the chain it is largest."""

    value: float
    """With its sign; nan: there is no such observable; inf: one of the two runs has it, the other not."""
    bar: float
    """Of both runs, relative to the same scale."""
    at: int
    """Body or contact; -1: of the chain as a whole."""


Effects = Mapping[str, Effect]


def last_counted(scene: Scene) -> int:
    """Last body and last contact that count.

    >>> import dem_bridge as db
    >>> last_counted(db.load_scene("decelerating-40"))
    38
    """
    last = scene.n_body - 1
    return last - ENDING if last > 3 * ENDING else last


def read(scene: Scene, run: Trajectory, until: float, *, whole: bool = False) -> dict[str, Reading]:
    """All observables of a run; ``until`` (s): when the front of the fullest model is at the end, for the trace.

    ``whole``: of the whole run and all bodies, with the largest force of each contact. ValueError for a run of another
    scene.
    """
    if run.provenance["scene_hash"] != scene.content_hash:
        raise ValueError(f"a run of {run.provenance['scene']!r} is read as one of {scene.name!r}")
    last, links = scene.n_body - 1 if whole else last_counted(scene), scene.n_body - 1
    crossing = np.asarray(run.uncertainty["crossing_time"])[:links]
    peak, bodies = peak_velocity_of_front(scene, run), slice(1, last + 1)
    force, force_bar = run.peak_force[:links], np.asarray(run.uncertainty["peak_force"])[:links]
    if not whole and run.provenance["equations"] == "hertz":
        force, force_bar = _front_force(scene, run)
    rows = run.time <= (math.inf if whole else until)
    trace = run.velocity[rows, : last + 1]
    return {
        "arrival": Reading(values=run.crossing_time[links - 1 : links], bars=crossing[-1:], first=-1),
        "residence": Reading(
            values=residence_by_crossing(scene, run)[:last], bars=residence_bar(scene, run)[:last], first=1
        ),
        "peak_velocity": Reading(values=peak.velocity[bodies], bars=peak.bar[bodies], first=1),
        "peak_force": Reading(values=force[: last + 1], bars=force_bar[: last + 1], first=0),
        "velocity": Reading(values=trace, bars=np.full(trace.shape, run.uncertainty["velocity"]), first=0),
    }


def _front_force(scene: Scene, run: Trajectory) -> tuple[Floats, Floats]:
    """Elastic force of each contact of the chain at its first maximal compression and its bar, N; nan: never.

    Not the largest of the run: that may be another wave's, from the end or behind the first. Dashpots do not act there.
    Theories, whose displacements are not those of forces, know one wave and its peak force.
    """
    links = scene.n_body - 1
    bar = np.asarray(run.uncertainty["peak_force"])[:links]
    c, which, when = scene.contacts, np.arange(links), run.crossing_time[:links]

    def force(nodes: int) -> Floats:
        moved = [
            hermite(run, run.displacement[:, ends], run.velocity[:, ends], when, nodes=nodes)
            for ends in (c.left[:links], c.right[:links])
        ]
        return c.force(np.maximum(moved[0] - moved[1] - c.gap[:links], 0.0), which)

    found = force(NODES)
    return found, bar + np.abs(found - force(FEWER))


def effect(name: str, full: Reading, other: Reading, *, one_sided: bool = False) -> Effect:
    """How far ``other`` is from ``full``. ``one_sided``: the other's own error is what is asked for, not a doubt."""
    scale = np.full(full.values.shape, np.max(np.nan_to_num(np.abs(full.values)), initial=0.0))
    if name != "velocity":
        scale = own_scale(full.values)
    bars = full.bars if one_sided else full.bars + other.bars
    with np.errstate(divide="ignore", invalid="ignore"):
        away, doubt = (other.values - full.values) / scale, bars / scale
    lonely = np.isnan(full.values) != np.isnan(other.values)
    away, doubt = np.where(lonely, math.inf, away), np.where(lonely, 0.0, doubt)
    known = ~np.isnan(away)
    if not known.any():
        return Effect(value=math.nan, bar=math.nan, at=-1)
    size = np.where(known, np.abs(away), -1.0)
    place = np.unravel_index(int(np.argmax(size)), size.shape)
    # another place may be the worst in truth: the bar of all
    bar = float(np.max(doubt[known]))
    return Effect(value=float(away[place]), bar=bar, at=full.first + int(place[-1]) if OBSERVABLES[name] else -1)


def effects(full: Mapping[str, Reading], other: Mapping[str, Reading], *, one_sided: bool = False) -> dict[str, Effect]:
    """Of all observables; see :func:`effect`."""
    return {name: effect(name, full[name], other[name], one_sided=one_sided) for name in OBSERVABLES}


def decided(found: Effects, observables: Sequence[str], accuracy: float) -> Outcome:
    """PASS where every one of the ``observables`` that there are stays within ``accuracy``, FAIL where one leaves it,
    UNDECIDED where a bar straddles it.

    >>> found = {"arrival": Effect(value=-0.004, bar=1e-9, at=-1), "residence": Effect(value=0.009, bar=0.002, at=3)}
    >>> [decided(found, names, 0.01).value for names in (("arrival",), ("arrival", "residence"))]
    ['PASS', 'UNDECIDED']
    """
    outcomes = {judge(abs(one.value), one.bar, accuracy) for name in observables if known(one := found[name])}
    return next(
        one for one in (Outcome.FAIL, Outcome.UNDECIDED, Outcome.PASS) if one in outcomes or one is Outcome.PASS
    )


def known(one: Effect) -> bool:
    """Whether there is such an observable."""
    return not math.isnan(one.value)


def largest(found: Effects, observables: Sequence[str]) -> tuple[str, Effect]:
    """The largest effect, by the name of its observable."""
    name = max((name for name in observables if known(found[name])), key=lambda name: abs(found[name].value))
    return name, found[name]
