"""Moments of a run at which it is nearly undecided whether a contact closes, or whether its compression is largest.

Three kinds: an open contact turns back, or the run ends, near touch; the closing rate of a closed contact is extreme
near zero; the run ends near the first maximum of compression.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dem_bridge.backends.scales import resting_acceleration
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.dense import Schedule, extreme_slopes, first_turns, quintics
from dem_bridge.trajectory.trajectory import Floats

if TYPE_CHECKING:
    from dem_bridge.backends.steps import Dense

#: moments are kept up to so many uncertainties of displacement and velocity from zero: twice, because two bodies err,
#: and twice that, because the largest error of the samples need not be that between them
NEAR = 4.0
#: steps before the end since which a touch is in no run: two of the coarser run, which is at twice the step
RECENT = 4.0
Indices = NDArray[np.int64]
Booleans = NDArray[np.bool_]
#: time, overlap, closing rate and closing acceleration of the contacts at dense samples
Seen = Mapping[str, NDArray[Any]]


@dataclass(frozen=True, kw_only=True, eq=False)
class Moments:
    """Moments of a run, arrays ``(n_moment,)``."""

    contact: Indices
    """Index of the contact."""
    time: Floats
    """s."""
    last: Booleans
    """The moment is the end of the run."""
    overlap: Floats
    """Overlap, m; > 0 at a turn if the bodies touched between two samples without any force in the run."""
    lost: Floats
    """Change of the overlap, m, from sample to sample beside that by the accelerations at both: a touch between them
    has changed it, and the overlap in between is uncertain by as much."""
    rate: Floats
    """Closing rate, m/s; 0 at a turn."""
    bend: Floats
    """Acceleration of opening, m/s^2; the larger of both samples at a turn."""
    touches: Booleans
    """The overlap is largest, so that the contact may close."""
    felt: Booleans
    """The contact is closed at a sample beside the moment, so that the run has its force."""
    stops: Booleans
    """The closing rate of a closed contact is nearest to zero, so that its compression may be largest."""
    fresh: Booleans
    """The contact has closed in the last steps before the end, so that no run has all of its impulse."""
    speed: Floats = field(default_factory=lambda: np.zeros(0))
    """Largest closing rate since the contact may have closed, m/s; see :func:`with_ways`."""
    lasting: Floats = field(default_factory=lambda: np.zeros(0))
    """Time since then, s."""
    fastest: Floats = field(default_factory=lambda: np.zeros(0))
    """Largest closing or opening rate of the contact before, m/s."""

    def __len__(self) -> int:
        return len(self.contact)


def undecided_moments(
    scene: Scene, plan: Schedule, dense: Dense, seen: Seen, crossing: Floats, *, displacement: float, velocity: float
) -> Moments:
    """Return the moments of a run that errors of ``displacement`` (m) and ``velocity`` (m/s) could decide otherwise.

    ``seen`` is the run as :func:`~dem_bridge.backends.steps.approach_of` returns it. ``crossing (n_contact,)`` is the
    first maximum of compression in the run; what is later is left out.
    """
    reach, slow, least = NEAR * displacement, NEAR * velocity, dense.overlap_in_flight
    moved = np.abs(seen["acceleration"]) >= resting_acceleration(scene)
    ends = _ends(seen, moved, reach, slow, least, RECENT * plan.step)
    kinds = (_turns(seen, moved, reach), _pauses(seen, moved, slow, least), ends)
    rows, contact = np.concatenate([kind.rows for kind in kinds]), np.concatenate([kind.contact for kind in kinds])
    part = np.concatenate([kind.part for kind in kinds])
    touches, stops = np.concatenate([kind.touches for kind in kinds]), np.concatenate([kind.stops for kind in kinds])
    fresh = np.concatenate([kind.fresh for kind in kinds])
    time = np.asarray(seen["time"][rows] + part * (seen["time"][rows + 1] - seen["time"][rows]), dtype=np.float64)
    last = (rows == len(seen["time"]) - 2) & (part == 1.0)
    stops &= _before_the_crossing(seen, rows, contact, time, crossing)
    kept = touches | stops
    rows, contact, touches, stops, fresh = rows[kept], contact[kept], touches[kept], stops[kept], fresh[kept]
    time, last = time[kept], last[kept]
    overlap, rate = read_at(seen, contact, time)
    felt = np.maximum(seen["overlap"][rows, contact], seen["overlap"][rows + 1, contact]) > 0.0
    bends = -np.stack((seen["acceleration"][rows, contact], seen["acceleration"][rows + 1, contact]))
    return Moments(
        contact=contact,
        time=time,
        last=last,
        overlap=overlap,
        lost=np.where(last, 0.0, _lost(seen, rows, contact)),
        rate=np.where(touches & ~last, 0.0, rate),
        bend=np.where(last, bends[1], np.max(bends, axis=0)),
        touches=touches,
        felt=felt,
        stops=stops,
        fresh=fresh,
    )


def _lost(seen: Seen, rows: Indices, contact: Indices) -> Floats:
    """Return the change of overlaps from the samples ``rows`` to the next that no linear acceleration makes, m."""
    width = seen["time"][rows + 1] - seen["time"][rows]
    before, after = ({name: seen[name][row, contact] for name in seen if name != "time"} for row in (rows, rows + 1))
    expected = width * (before["rate"] + width * (2.0 * before["acceleration"] + after["acceleration"]) / 6.0)
    return np.asarray(np.abs(after["overlap"] - before["overlap"] - expected), dtype=np.float64)


def with_ways(moments: Moments, seen: Seen, overlap: Floats) -> Moments:
    """Return moments with what the contact did before, since it came within ``overlap`` of touch and since the start.

    ``seen`` is the run as :func:`~dem_bridge.backends.steps.approach_of` returns it; ``overlap (n_moment,)`` in m.
    """
    speed, lasting, fastest = np.zeros(len(moments)), np.zeros(len(moments)), np.zeros(len(moments))
    rows = np.searchsorted(seen["time"], moments.time, side="right")
    for each, (row, k) in enumerate(zip(rows.tolist(), moments.contact.tolist(), strict=True)):
        far = np.flatnonzero(seen["overlap"][:row, k] < -overlap[each])
        first = int(far[-1]) if len(far) else 0
        speed[each] = np.max(seen["rate"][first : row + 1, k], initial=0.0)
        lasting[each] = moments.time[each] - seen["time"][first]
        fastest[each] = np.max(np.abs(seen["rate"][:row, k]))
    return replace(moments, speed=speed, lasting=lasting, fastest=fastest)


def read_at(seen: Seen, contact: Indices, time: Floats) -> tuple[Floats, Floats]:
    """Return overlap (m) and closing rate (m/s) of contacts at any times of a run, from its dense samples."""
    rows = np.clip(np.searchsorted(seen["time"], time, side="right") - 1, 0, len(seen["time"]) - 2)
    polynomial, width = _polynomials(seen, rows, contact)
    part = (time - seen["time"][rows]) / width
    overlap, rate = np.zeros_like(part), np.zeros_like(part)
    for power in range(5, -1, -1):
        overlap = overlap * part + polynomial[power]
        rate = rate * part + (power + 1) * polynomial[power + 1] if power < 5 else rate
    return overlap, rate / width


def _polynomials(seen: Seen, rows: Indices, contact: Indices) -> tuple[Floats, Floats]:
    """Return the quintic polynomials of the overlaps after the samples ``rows``, and the time to the next sample."""
    width = np.asarray(seen["time"][rows + 1] - seen["time"][rows], dtype=np.float64)
    series = (seen[name] for name in ("overlap", "rate", "acceleration"))
    value, slope, curvature = (np.stack((data[rows, contact], data[rows + 1, contact])) for data in series)
    return quintics(value, slope, curvature, width), width


class Reached(NamedTuple):
    """Overlaps (m) and closing rates (m/s) of the contacts of a run, arrays ``(n_contact,)``."""

    nearest: Floats
    """Largest overlap; negative if the contact never closed."""
    nearest_rate: Floats
    """Closing rate at that sample."""
    last: Floats
    """Overlap at the end."""
    last_rate: Floats
    """Closing rate at the end."""


def reached(seen: Seen) -> Reached:
    """Return what the contacts of a run reached; ``seen`` is as for :func:`with_ways`."""
    overlap, rate = seen["overlap"], seen["rate"]
    rows, columns = np.argmax(overlap, axis=0), np.arange(overlap.shape[1])
    return Reached(overlap[rows, columns], rate[rows, columns], overlap[-1], rate[-1])


class _Kind(NamedTuple):
    """Moments of one kind, arrays ``(n_moment,)``."""

    rows: Indices
    """Index of the sample before."""
    contact: Indices
    part: Floats
    """Part of the interval after that sample."""
    touches: Booleans
    stops: Booleans
    fresh: Booleans


def _turns(seen: Seen, moved: Booleans, reach: float) -> _Kind:
    """Return where contacts turn from closing to opening near touch."""
    rate = seen["rate"]
    rows, contact = np.nonzero((rate[:-1] > 0.0) & (rate[1:] <= 0.0) & (moved[:-1] | moved[1:]))
    polynomial, width = _polynomials(seen, rows, contact)
    part = first_turns(polynomial, rate[rows + 1, contact] * width)
    top = np.zeros_like(part)
    for coefficient in polynomial[::-1]:
        top = top * part + coefficient
    # between two open samples a touch is not felt, however deep
    unfelt = np.maximum(seen["overlap"][rows, contact], seen["overlap"][rows + 1, contact]) <= 0.0
    near = (top >= -reach) & (unfelt | (top <= reach))
    yes = np.ones(int(np.sum(near)), dtype=bool)
    return _Kind(rows[near], contact[near], part[near], touches=yes, stops=~yes, fresh=~yes)


def _pauses(seen: Seen, moved: Booleans, slow: float, least: float) -> _Kind:
    """Return where the closing rate of a closed contact is extreme near zero."""
    rate, bend, overlap = seen["rate"], seen["acceleration"], seen["overlap"]
    width = np.diff(seen["time"])[:, None]
    # within an interval a rate changes by no more than this
    change = np.maximum(np.abs(bend[:-1]), np.abs(bend[1:])) * width
    near = np.minimum(np.abs(rate[:-1]), np.abs(rate[1:])) <= slow + change
    closed = np.maximum(overlap[:-1], overlap[1:]) > least
    rows, contact = np.nonzero((bend[:-1] * bend[1:] < 0.0) & closed & near & (moved[:-1] | moved[1:]))
    polynomial, span = _polynomials(seen, rows, contact)
    part, slope = extreme_slopes(polynomial, np.sign(bend[rows, contact]))
    near_zero = np.abs(slope) <= slow * span
    yes = np.ones(int(np.sum(near_zero)), dtype=bool)
    return _Kind(rows[near_zero], contact[near_zero], part[near_zero], touches=~yes, stops=yes, fresh=~yes)


def _ends(seen: Seen, moved: Booleans, reach: float, slow: float, least: float, recent: float) -> _Kind:
    """Return which contacts are near touch, or near their first maximum of compression, when the run ends.

    Those that have closed since ``recent`` seconds before it are near touch.
    """
    overlap, rate, bend = (seen[name][-1] for name in ("overlap", "rate", "acceleration"))
    # a contact that is pressed on has closed, if ever so little; one that nothing has moved is where it was
    pressed, still = (overlap >= 0.0) & (bend > 0.0), np.all(seen["rate"] == 0.0, axis=0)
    fresh = (overlap > 0.0) & (seen["overlap"][-2] <= 0.0) & (overlap <= recent * rate)
    touches = fresh | ((rate >= 0.0) & (np.abs(overlap) <= reach) & ~pressed & ~still)
    spacing = seen["time"][-1] - seen["time"][-2]
    stops = (overlap > least) & (rate > 0.0) & (bend < 0.0) & moved[-1] & (rate <= slow - bend * spacing)
    contact = np.flatnonzero(touches | stops)
    rows = np.full(len(contact), len(seen["time"]) - 2)
    kinds = {"touches": touches[contact], "stops": stops[contact], "fresh": fresh[contact]}
    return _Kind(rows, contact, np.ones(len(contact)), **kinds)


def _before_the_crossing(seen: Seen, rows: Indices, contact: Indices, time: Floats, crossing: Floats) -> Booleans:
    """Return which moments are not later than the first maximum of compression, or are part of it."""
    earlier = ~(time > crossing[contact])  # nan: it never crosses
    later, closing = np.flatnonzero(~earlier), seen["rate"]
    now = read_at(seen, contact[later], time[later])[1]
    for k in np.unique(contact[later]):
        of_contact = contact[later] == k
        row, rate = rows[later[of_contact]], now[of_contact]
        after = int(np.searchsorted(seen["time"], crossing[k]))
        # the closing rate has fallen from zero to this moment, and is not at a later extreme
        rises = np.flatnonzero(~(np.diff(closing[after:, k]) <= 0.0))
        lowest = after + int(rises[0]) if len(rises) else len(closing)
        sampled = row >= after
        first = np.where(sampled, closing[min(after, len(closing) - 1), k], rate)
        before = np.where(sampled, closing[row, k], math.inf)
        earlier[later[of_contact]] = (first <= 0.0) & (row <= lowest) & (rate <= before)
    return earlier
