"""Peak forces and crossing times of a fixed-step run, from samples much closer than those that are kept.

Used alike for LAMMPS and for the twin, so that the estimator cancels in their difference. Between two dense
samples the overlap is a quintic Hermite polynomial through overlap, closing rate and closing acceleration
at both ends; its error is (omega h)^6 / 46080 of the amplitude, 2e-11 at the spacing omega h = 0.1 that
:func:`schedule` asks for, far below the time-step error of a second-order run.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.polynomial import polynomial as poly
from numpy.typing import NDArray

from dem_bridge.contacts import Contacts
from dem_bridge.errors import UsageError

Floats = NDArray[np.float64]

#: what LAMMPS can count in one run
MOST_STEPS = 2e9
#: dense spacing times the highest angular frequency of a contact
PHASE_PER_DENSE_SAMPLE = 0.1
#: what the estimator may err by at that spacing: of a peak force, and in units of the spacing for a crossing time.
#: 3.4e-11 and 2e-8 were found on the paper's chains, but 2e-5 where a neighbour opens between the two samples
PEAK_ERROR, CROSSING_ERROR = 1e-10, 2.5e-5


@dataclass(frozen=True, kw_only=True)
class Schedule:
    """Time steps of a run and the steps at which it is looked at. Made by :func:`schedule`."""

    step: float
    """s."""
    per_sample: int
    """Time steps between two kept samples."""
    subdivisions: int
    """Dense samples per kept sample."""
    samples: int
    resolved: bool = True
    """False: memory allowed fewer dense samples than peaks and crossing times need."""

    @property
    def steps(self) -> int:
        return self.per_sample * self.samples

    @property
    def spacing(self) -> float:
        """Between dense samples, s."""
        return self.step * self.per_sample / self.subdivisions

    @property
    def dense_steps(self) -> NDArray[np.int64]:
        """Steps of the dense samples, ``ceil(j * per_sample / subdivisions)``; kept ones are every
        ``subdivisions``-th of them."""
        j = np.arange(self.samples * self.subdivisions + 1, dtype=np.int64)
        return -((-j * self.per_sample) // self.subdivisions)


def schedule(
    *, duration: float, samples: int, dt: float, frequency: float, bodies: int, memory: float = 4e8
) -> Schedule:
    """Steps of at most ``dt`` that fall on the samples, and dense samples for the given top ``frequency``.

    ``duration`` and ``dt`` in s; ``frequency`` in rad/s; ``memory`` in bytes bounds the dense samples. The step is
    ``interval / ceil(interval / dt)``.

    >>> plan = schedule(duration=3e-3, samples=500, dt=1e-8, frequency=2.5e5, bodies=41)
    >>> plan.per_sample, plan.subdivisions, plan.step
    (600, 15, 1e-08)
    """
    if not duration / dt <= MOST_STEPS:
        raise UsageError(
            f"dt = {dt:g} s needs {duration / dt:.2g} steps; allowed: up to {MOST_STEPS:.0e}, so a larger dt"
        )
    interval = duration / samples
    # a ratio that is whole up to round-off must not be rounded up to the next step
    per_sample = max(1, math.ceil(interval / dt * (1.0 - 1e-12)))
    wanted = math.ceil(interval * frequency / PHASE_PER_DENSE_SAMPLE)
    needed = max(1, min(wanted, per_sample))
    # overlap, rate, acceleration, force and position of each body
    affordable = max(1, int(memory / (40.0 * bodies * samples)))
    return Schedule(
        step=interval / per_sample,
        per_sample=per_sample,
        subdivisions=min(needed, affordable),
        samples=samples,
        resolved=needed <= affordable,
    )


def extremes(
    *,
    time: NDArray[np.floating[Any]],
    overlap: Floats,
    rate: Floats,
    acceleration: Floats,
    force: Floats,
    exponent: Floats,
    resolution: float = 0.0,
    resting: Floats | float = 0.0,
    laws: Contacts | None = None,
) -> tuple[Floats, Floats]:
    """Largest force (N) and first maximal compression (s; nan: never) of each contact, ``(n_contact,)`` both.

    ``time (n_t,)``; ``overlap`` (m, negative = open), ``rate`` and ``acceleration`` of closing and the run's own
    ``force`` (N), all ``(n_t, n_contact)``; ``exponent (n_contact,)``. Overlaps up to ``resolution`` are round-off of
    the run, not contact, and turns with less closing acceleration than ``resting`` (m/s^2; ``(n_contact,)`` or one
    for all) those of a contact at rest. The force at a peak is the run's own at the nearer sample, carried to the peak
    by the law's power, so that a wrong stiffness in the run shows in it; ``laws``: by these in place of powers.
    """
    peak_force = np.max(force, axis=0)
    touching = np.maximum(overlap[:-1], overlap[1:]) > resolution
    moved = np.maximum(np.abs(acceleration[:-1]), np.abs(acceleration[1:])) >= resting
    turning = (rate[:-1] > 0.0) & (rate[1:] <= 0.0) & touching & moved
    rows, contacts = np.nonzero(turning)
    turns = Turns(
        contacts,
        time[rows],
        np.asarray(time[rows + 1] - time[rows], dtype=np.float64),
        *(np.stack((one[rows, contacts], one[rows + 1, contacts])) for one in (overlap, rate, acceleration, force)),
    )
    return at_turns(turns, peak_force, exponent=exponent, resolution=resolution, laws=laws)


class Turns(NamedTuple):
    """Where contacts turn from closing to opening: the dense samples before and after each, in the order of time."""

    contact: NDArray[np.int64]
    """(n_turn,)."""
    time: NDArray[np.floating[Any]]
    """(n_turn,), s: of the sample before."""
    width: Floats
    """(n_turn,), s: from there to the sample after."""
    overlap: Floats
    """(2, n_turn), m: before and after, as all below."""
    rate: Floats
    acceleration: Floats
    force: Floats


def at_turns(
    turns: Turns, largest: Floats, *, exponent: Floats, resolution: float = 0.0, laws: Contacts | None = None
) -> tuple[Floats, Floats]:
    """As :func:`extremes`, where the turns are known; ``largest (n_contact,)``: force of the dense samples, N."""
    peak_force, crossing = largest.copy(), np.full(len(largest), np.nan)
    deep = np.flatnonzero(np.max(turns.overlap, axis=0, initial=-np.inf) > resolution)
    if len(deep) == 0:
        return peak_force, crossing
    contacts, time, width, overlap, rate, acceleration, force = (np.asarray(one)[..., deep] for one in turns)
    polynomial = _quintic((overlap[0], overlap[1]), (rate[0], rate[1]), (acceleration[0], acceleration[1]), width)
    where: Floats = _turning_point(np.array(polynomial))
    top = np.zeros_like(where)
    for coefficient in polynomial[::-1]:
        top = top * where + coefficient
    first = where < 0.5
    beside = np.where(first, overlap[0], overlap[1])
    compressed = (top > resolution) & (beside > 0.0)
    ratio = np.where(compressed, top / np.where(compressed, beside, 1.0), 0.0)
    if laws is None:
        grown = ratio ** (exponent[contacts] - 1.0)
    else:
        told = laws.force(np.where(compressed, beside, 0.0), contacts)
        grown = np.divide(laws.force(np.maximum(top, 0.0), contacts), told, out=ratio, where=told > 0.0)
    np.maximum.at(peak_force, contacts, np.where(first, force[0], force[1]) * grown)
    when = time + where * width
    for contact, moment in zip(contacts[compressed][::-1], when[compressed][::-1], strict=True):
        crossing[contact] = moment  # backwards in time, so that the first one stays
    return peak_force, crossing


@dataclass(frozen=True, kw_only=True, eq=False)
class Approaches:
    """Turns of open contacts: how near they came to touch. Arrays ``(n_turn,)``."""

    contact: NDArray[np.int64]
    time: Floats
    """s."""
    overlap: Floats
    """m; above 0 where bodies have touched between two samples, and no force was felt."""
    bend: Floats
    """m/s^2: how fast they were turning back, > 0."""


def approaches(*, time: NDArray[np.floating[Any]], overlap: Floats, rate: Floats, acceleration: Floats) -> Approaches:
    """Where closing rates fall through zero between two samples at which the contact is open; arguments as those of
    :func:`extremes`.

    Two bodies that turn 1e-9 m apart, looked at every millisecond:

    >>> t = np.array([[0.0], [1e-3]])
    >>> told = {"overlap": -1e-9 - 0.5 * (t - 4e-4) ** 2, "rate": 4e-4 - t, "acceleration": 0.0 * t - 1.0}
    >>> [f"{one[0]:.6g}" for one in vars(approaches(time=t[:, 0], **told)).values()]
    ['0', '0.0004', '-1e-09', '1']
    """
    rows, contacts = np.nonzero((rate[:-1] > 0.0) & (rate[1:] <= 0.0) & (overlap[:-1] <= 0.0) & (overlap[1:] <= 0.0))
    width = np.asarray(time[rows + 1] - time[rows], dtype=np.float64)
    value, slope, curve = ((one[rows, contacts], one[rows + 1, contacts]) for one in (overlap, rate, acceleration))
    polynomial = _quintic(value, slope, curve, width)
    where: Floats = _turning_point(np.array(polynomial))
    return Approaches(
        contact=contacts,
        time=np.asarray(time[rows] + where * width, dtype=np.float64),
        overlap=np.asarray(sum(c * where**power for power, c in enumerate(polynomial))),
        bend=np.maximum(-curve[0], -curve[1]),
    )


def damped_peaks(
    *,
    time: NDArray[np.floating[Any]],
    overlap: Floats,
    rate: Floats,
    acceleration: Floats,
    force: Floats,
    contacts: Contacts,
) -> Floats:
    """Largest force of each contact, N, ``(n_contact,)``, where damping is added to the elastic force.

    It need not be at maximal compression, and a dashpot's may be at touch, where the force jumps, or right behind.
    It is looked for on the quintic polynomials of :func:`extremes`, at the touch between an open and a closed sample
    and on a polynomial from there; the run's own force at a sample beside is carried there by the law. Arguments
    as there.
    """
    found: Floats = np.max(force, axis=0)
    width = np.asarray(np.diff(time), dtype=np.float64)
    part = np.linspace(0.0, 1.0, 17)
    for k in np.flatnonzero((contacts.damping > 0.0) & (found > 0.0)).tolist():
        c, power, mine = contacts.damping[k], contacts.damping_power[k], np.array([k])
        delta, closing, own = np.maximum(overlap[:, k], 0.0), rate[:, k], force[:, k]
        told = contacts.force(delta[:, None], mine)[:, 0] + c * delta**power * closing
        share = np.where((own > 0.0) & (told > 0.0), own / np.where(told > 0.0, told, 1.0), 1.0)
        # polynomials of the overlap, their widths, and the shares at both ends
        pieces: list[tuple[Floats, Floats, Floats, Floats]] = []
        touch = np.flatnonzero((overlap[:-1, k] <= 0.0) & (delta[1:] > 0.0))
        if power == 0.0 and len(touch):
            speed, after = _touch(overlap[touch, k], closing[touch], acceleration[touch, k])
            found[k] = max(found[k], np.max(share[touch + 1] * c * speed))
            rest = width[touch] - after
            some = rest > 1e-6 * width[touch]
            first, rest = touch[some] + 1, rest[some]
            from_touch = _quartic(speed[some], delta[first], closing[first], acceleration[first, k], rest)
            pieces.append((from_touch, rest, share[first], share[first]))
        closed = (delta[:-1] > 0.0) & (delta[1:] > 0.0)
        rows = np.flatnonzero(closed & (np.maximum(own[:-1], own[1:]) > 0.8 * found[k]))
        value, slope, curve = ((one[rows, k], one[rows + 1, k]) for one in (overlap, rate, acceleration))
        pieces.append((np.array(_quintic(value, slope, curve, width[rows])), width[rows], share[rows], share[rows + 1]))
        # time runs along the rows of the pieces
        polynomial, span, early, late = (np.concatenate(parts, axis=-1) for parts in zip(*pieces, strict=True))
        if len(span) == 0:
            continue
        between = np.maximum(poly.polyval(part, polynomial), 0.0)
        velocity = poly.polyval(part, poly.polyder(polynomial)) / span[:, None]
        law = contacts.force(between[..., None], mine)[..., 0] + c * between**power * velocity
        # a parabola through the largest of them and its two neighbours
        top = np.clip(np.argmax(law, axis=1), 1, len(part) - 2)
        low, middle, high = (law[np.arange(len(span)), top + side] for side in (-1, 0, 1))
        bend = 2.0 * middle - low - high
        inner = (bend > 0.0) & (np.abs(high - low) < bend)
        most = np.where(inner, middle + (high - low) ** 2 / (8.0 * np.where(inner, bend, 1.0)), np.max(law, axis=1))
        found[k] = max(found[k], np.max(np.where(top < len(part) // 2, early, late) * most))
    return found


def _touch(overlap: Floats, closing: Floats, acceleration: Floats) -> tuple[Floats, Floats]:
    """Closing speed at touch (m/s) and the time until then (s), from an open sample on with the acceleration there."""
    speed = np.sqrt(np.maximum(closing**2 - 2.0 * acceleration * overlap, 0.0))
    both = closing + speed
    # one of the two ways to write a root, whichever subtracts nothing
    coming = np.where(both > 0.0, -2.0 * overlap / np.where(both > 0.0, both, 1.0), 0.0)
    turning = (speed - closing) / np.where(acceleration != 0.0, acceleration, 1.0)
    return speed, np.maximum(np.where(closing >= 0.0, coming, turning), 0.0)


def secondary_peak_force(force: Floats) -> Floats:
    """Largest force of each contact, N, outside the collision that has its largest: ``(n_t, n_contact)`` to
    ``(n_contact,)``. A collision ends where the force falls below a tenth of its peak.

    >>> secondary_peak_force(np.array([[0.0, 5.0, 0.1, 3.0, 4.0, 0.0]]).T).tolist()
    [4.0]
    """
    found = np.zeros(force.shape[1])
    top = np.argmax(force, axis=0)
    for contact, row in enumerate(top.tolist()):
        series = force[:, contact]
        low = np.flatnonzero(series < 0.1 * series[row])
        where = int(np.searchsorted(low, row))
        before = series[: low[where - 1]] if where > 0 else series[:0]
        after = series[low[where] :] if where < len(low) else series[:0]
        found[contact] = max(np.max(before, initial=0.0), np.max(after, initial=0.0))
    return found


def _quintic(
    value: tuple[Floats, Floats],
    slope: tuple[Floats, Floats],
    curvature: tuple[Floats, Floats],
    width: Floats,
) -> list[Floats]:
    """Coefficients c_0..c_5 in u = (t - t_0)/width of the Hermite quintic."""
    s0, s1 = value
    d0, d1 = slope[0] * width, slope[1] * width
    a0, a1 = 0.5 * curvature[0] * width**2, 0.5 * curvature[1] * width**2
    rise, turn, bend = s1 - s0 - d0 - a0, d1 - d0 - 2.0 * a0, a1 - a0
    return [
        s0,
        d0,
        a0,
        10.0 * rise - 4.0 * turn + bend,
        -15.0 * rise + 7.0 * turn - 2.0 * bend,
        6.0 * rise - 3.0 * turn + bend,
    ]


def _quartic(speed: Floats, value: Floats, slope: Floats, curvature: Floats, width: Floats) -> Floats:
    """Coefficients c_0..c_5 of an overlap from touch at this ``speed`` on; its acceleration, which jumps there, is
    known at the end alone."""
    rise, turn, bend = value - speed * width, (slope - speed) * width, 0.5 * curvature * width**2
    c4 = bend + 3.0 * rise - 2.0 * turn
    c3 = turn - 2.0 * rise - 2.0 * c4
    return np.array([np.zeros_like(width), speed * width, rise - c3 - c4, c3, c4, np.zeros_like(width)])


@njit(cache=True)  # type: ignore[misc,unused-ignore]
def _turning_point(polynomial):  # type: ignore[no-untyped-def]
    """Root in [0, 1] of each derivative, ``(6, m)`` to ``(m,)``, by bisection: it is > 0 at 0 and <= 0 at 1."""
    found = np.zeros(polynomial.shape[1])
    for one in range(polynomial.shape[1]):
        low, high = 0.0, 1.0
        for _ in range(54):  # one bit each, to the last
            middle, slope = 0.5 * (low + high), 0.0
            for power in range(5, 0, -1):
                slope = slope * middle + power * polynomial[power, one]
            if slope > 0.0:
                low = middle
            else:
                high = middle
        found[one] = 0.5 * (low + high)
    return found
