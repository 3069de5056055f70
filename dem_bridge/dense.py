"""Peak forces and crossing times of a fixed-step run, from samples that are much denser than the stored ones.

LAMMPS and the twin use the same estimator, so that it cancels in their difference. Between two dense samples the
overlap is a quintic Hermite polynomial through overlap, closing rate and closing acceleration at both ends. Its error
is (omega h)^6 / 46080 of the amplitude, 2e-11 at the spacing omega h = 0.1 of :func:`schedule`, far below the time-step
error of a second-order run.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.polynomial import polynomial as poly
from numpy.typing import NDArray

from dem_bridge.compiled import kernel
from dem_bridge.contacts import Contacts, Floats
from dem_bridge.errors import UsageError

#: largest number of steps that LAMMPS can count in one run
MOST_STEPS = 2e9
#: dense spacing times the highest angular frequency of a contact
PHASE_PER_DENSE_SAMPLE = 0.1
#: bounds of the estimator's error at that spacing: relative for a peak force, in units of the spacing for a crossing
#: time. Measured: 3.4e-11 and 2e-8 on the paper's chains, but 2e-5 where a neighbour opens between the two samples
PEAK_ERROR, CROSSING_ERROR = 1e-10, 2.5e-5


@dataclass(frozen=True, kw_only=True)
class Schedule:
    """Time steps of a run and the steps at which samples are taken.

    :func:`schedule` computes it.
    """

    step: float
    """Time step, s."""
    per_sample: int
    """Time steps between two stored samples."""
    subdivisions: int
    """Dense samples per stored sample."""
    samples: int
    """Number of stored samples after the start."""
    resolved: bool = True
    """False if memory allows fewer dense samples than peaks and crossing times need."""

    @property
    def steps(self) -> int:
        """Total number of time steps."""
        return self.per_sample * self.samples

    @property
    def spacing(self) -> float:
        """Time between dense samples, s."""
        return self.step * self.per_sample / self.subdivisions

    @property
    def dense_steps(self) -> NDArray[np.int64]:
        """Steps of the dense samples, ``ceil(j * per_sample / subdivisions)``; every ``subdivisions``-th is stored."""
        j = np.arange(self.samples * self.subdivisions + 1, dtype=np.int64)
        return -((-j * self.per_sample) // self.subdivisions)


def schedule(
    *, duration: float, samples: int, dt: float, frequency: float, bodies: int, memory: float = 4e8
) -> Schedule:
    """Return steps of at most ``dt`` that fall on the samples, and dense samples that resolve ``frequency``.

    The step is ``interval / ceil(interval / dt)``.

    Parameters
    ----------
    duration : float
        Duration of the run, s.
    samples : int
        Number of stored samples after the start.
    dt : float
        Upper bound of the time step, s.
    frequency : float
        Highest angular frequency of a contact, rad/s.
    bodies : int
        Number of bodies.
    memory : float
        Upper bound of the memory for the dense samples, bytes.

    Raises
    ------
    UsageError
        If the run needs more steps than LAMMPS can count.

    Examples
    --------
    >>> plan = schedule(duration=3e-3, samples=500, dt=1e-8, frequency=2.5e5, bodies=41)
    >>> plan.per_sample, plan.subdivisions, plan.step
    (600, 15, 1e-08)
    """
    if not duration / dt <= MOST_STEPS:
        raise UsageError(
            f"dt = {dt:g} s needs {duration / dt:.2g} steps; allowed: up to {MOST_STEPS:.0e}; choose a larger dt"
        )
    interval = duration / samples
    # a ratio that is an integer up to round-off must not be rounded up
    per_sample = max(1, math.ceil(interval / dt * (1.0 - 1e-12)))
    resolving = math.ceil(interval * frequency / PHASE_PER_DENSE_SAMPLE)
    needed = max(1, min(resolving, per_sample))
    # five numbers per body: overlap, rate, acceleration, force and position
    affordable = max(1, int(memory / (40.0 * bodies * samples)))
    steps = {"per_sample": per_sample, "subdivisions": min(needed, affordable), "samples": samples}
    return Schedule(step=interval / per_sample, **steps, resolved=needed <= affordable)


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
    """Return the largest force (N) and the time of first maximal compression (s) of each contact.

    Parameters
    ----------
    time : ndarray
        Times of the dense samples, s, ``(n_t,)``.
    overlap, rate, acceleration : ndarray
        Overlap (m, negative = open), closing rate (m/s) and closing acceleration (m/s^2), ``(n_t, n_contact)``.
    force : ndarray
        Force of the run, N, ``(n_t, n_contact)``. The force at a peak is that of the nearer sample, extrapolated to the
        peak by the power of the law, so that a wrong stiffness in the run is visible in the result.
    exponent : ndarray
        Exponent n, ``(n_contact,)``.
    resolution : float
        Overlap up to which a contact counts as open, m: the round-off of the run.
    resting : float or ndarray
        Closing acceleration below which a turn is that of a contact at rest, m/s^2, one value or ``(n_contact,)``.
    laws : Contacts, optional
        Contacts whose laws replace the powers.

    Returns
    -------
    peak_force, crossing_time : ndarray
        ``(n_contact,)`` both; the time is nan for a contact that never compresses.
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
        *(np.stack((data[rows, contacts], data[rows + 1, contacts])) for data in (overlap, rate, acceleration, force)),
    )
    return at_turns(turns, peak_force, exponent=exponent, resolution=resolution, laws=laws)


class Turns(NamedTuple):
    """Turns of contacts from closing to opening: the dense samples before and after each, in the order of time."""

    contact: NDArray[np.int64]
    """Index of the contact, (n_turn,)."""
    time: NDArray[np.floating[Any]]
    """Time of the sample before, s, (n_turn,)."""
    width: Floats
    """Time from the sample before to the sample after, s, (n_turn,)."""
    overlap: Floats
    """Overlap before and after, m, (2, n_turn); the arrays below have the same shape."""
    rate: Floats
    """Closing rate, m/s."""
    acceleration: Floats
    """Closing acceleration, m/s^2."""
    force: Floats
    """Force of the run, N."""


def at_turns(
    turns: Turns, largest: Floats, *, exponent: Floats, resolution: float = 0.0, laws: Contacts | None = None
) -> tuple[Floats, Floats]:
    """Return the same as :func:`extremes` for turns that are already known.

    ``largest (n_contact,)`` is the largest force of the dense samples, N; the other parameters are those of
    :func:`extremes`.
    """
    peak_force, crossing = largest.copy(), np.full(len(largest), np.nan)
    deep = np.flatnonzero(np.max(turns.overlap, axis=0, initial=-np.inf) > resolution)
    if len(deep) == 0:
        return peak_force, crossing
    contacts, time, width, overlap, rate, acceleration, force = (np.asarray(data)[..., deep] for data in turns)
    fraction, top = _turn(overlap, rate, acceleration, width)
    first = fraction < 0.5
    nearer = np.where(first, overlap[0], overlap[1])
    compressed = (top > resolution) & (nearer > 0.0)
    ratio = np.where(compressed, top / np.where(compressed, nearer, 1.0), 0.0)
    force = np.where(first, force[0], force[1])
    if laws is None:
        power = exponent[contacts] - 1.0
        # where the law is stiff and the nearer sample shallow, a tiny force times a huge ratio: two roots of it do
        with np.errstate(over="ignore"):
            force_ratio = ratio**power
            huge = np.isinf(force_ratio)
            root = ratio[huge] ** (0.5 * power[huge])
            force_ratio[huge], force[huge] = root, force[huge] * root
    else:
        nearer_force = laws.force(np.where(compressed, nearer, 0.0), contacts)
        force_ratio = np.divide(
            laws.force(np.maximum(top, 0.0), contacts), nearer_force, out=ratio, where=nearer_force > 0.0
        )
    with np.errstate(over="ignore", invalid="ignore"):  # a force beyond doubles is infinite
        peaks = np.nan_to_num(force * force_ratio, nan=np.inf, posinf=np.inf)
    np.maximum.at(peak_force, contacts, peaks)
    when = time + fraction * width
    for contact, instant in zip(contacts[compressed][::-1], when[compressed][::-1], strict=True):
        crossing[contact] = instant  # backwards in time, so that the first maximum remains
    return peak_force, crossing


@dataclass(frozen=True, kw_only=True, eq=False)
class Approaches:
    """Turns of open contacts and their smallest separations, arrays ``(n_turn,)``."""

    contact: NDArray[np.int64]
    """Index of the contact."""
    time: Floats
    """Time of the turn, s."""
    overlap: Floats
    """Overlap at the turn, m; > 0 if the bodies touched between two samples without any force in the run."""
    bend: Floats
    """Acceleration of opening at the turn, m/s^2, > 0."""


def approaches(*, time: NDArray[np.floating[Any]], overlap: Floats, rate: Floats, acceleration: Floats) -> Approaches:
    """Return the turns from closing to opening between two samples at which the contact is open.

    The parameters are those of :func:`extremes`.

    Examples
    --------
    Two bodies that turn at a distance of 1e-9 m, with samples every millisecond:

    >>> t = np.array([[0.0], [1e-3]])
    >>> motion = {"overlap": -1e-9 - 0.5 * (t - 4e-4) ** 2, "rate": 4e-4 - t, "acceleration": 0.0 * t - 1.0}
    >>> [f"{values[0]:.6g}" for values in vars(approaches(time=t[:, 0], **motion)).values()]
    ['0', '0.0004', '-1e-09', '1']
    """
    rows, contacts = np.nonzero((rate[:-1] > 0.0) & (rate[1:] <= 0.0) & (overlap[:-1] <= 0.0) & (overlap[1:] <= 0.0))
    width = np.asarray(time[rows + 1] - time[rows], dtype=np.float64)
    series = (overlap, rate, acceleration)
    value, slope, curve = (np.stack((data[rows, contacts], data[rows + 1, contacts])) for data in series)
    fraction, top = _turn(value, slope, curve, width)
    when = np.asarray(time[rows] + fraction * width, dtype=np.float64)
    return Approaches(contact=contacts, time=when, overlap=top, bend=np.max(-curve, axis=0))


def _turn(overlap: Floats, rate: Floats, acceleration: Floats, width: Floats) -> tuple[Floats, Floats]:
    """Return where between two samples the quintic polynomial of each overlap turns, 0 to 1, and its value there."""
    polynomial = _quintic(overlap, rate, acceleration, width)
    fraction: Floats = _turning_point(polynomial)
    top = np.zeros_like(fraction)
    for coefficient in polynomial[::-1]:
        top = top * fraction + coefficient
    return fraction, top


def damped_peaks(
    *,
    time: NDArray[np.floating[Any]],
    overlap: Floats,
    rate: Floats,
    acceleration: Floats,
    force: Floats,
    contacts: Contacts,
) -> Floats:
    """Return the largest force of each contact with damping in addition to the elastic force, N, ``(n_contact,)``.

    With damping the largest force need not be at maximal compression; that of a dashpot may be at touch, where the
    force jumps, or just after it. The maximum is searched on the quintic polynomials of :func:`extremes`, at the touch
    between an open and a closed sample, and on a polynomial that starts there. The run's own force at a neighbouring
    sample is extrapolated to the maximum by the law. The parameters are those of :func:`extremes`.
    """
    peaks: Floats = np.max(force, axis=0)
    width = np.asarray(np.diff(time), dtype=np.float64)
    part = np.linspace(0.0, 1.0, 17)
    for k in np.flatnonzero((contacts.damping > 0.0) & (peaks > 0.0)).tolist():
        c, power, which = contacts.damping[k], contacts.damping_power[k], np.array([k])
        delta, closing, series = np.maximum(overlap[:, k], 0.0), rate[:, k], force[:, k]
        by_law = contacts.force(delta[:, None], which)[:, 0] + c * delta**power * closing
        share = np.where((series > 0.0) & (by_law > 0.0), series / np.where(by_law > 0.0, by_law, 1.0), 1.0)
        # polynomials of the overlap, their widths, and the ratios of force to law at both ends
        pieces: list[tuple[Floats, Floats, Floats, Floats]] = []
        touch = np.flatnonzero((overlap[:-1, k] <= 0.0) & (delta[1:] > 0.0))
        if power == 0.0 and len(touch):
            speed, after = _touch(overlap[touch, k], closing[touch], acceleration[touch, k])
            peaks[k] = max(peaks[k], np.max(share[touch + 1] * (c * speed - contacts.pull_off[k])))
            rest = width[touch] - after
            long_enough = rest > 1e-6 * width[touch]
            first, rest = touch[long_enough] + 1, rest[long_enough]
            from_touch = _quartic(speed[long_enough], delta[first], closing[first], acceleration[first, k], rest)
            pieces.append((from_touch, rest, share[first], share[first]))
        closed = (delta[:-1] > 0.0) & (delta[1:] > 0.0)
        rows = np.flatnonzero(closed & (np.maximum(series[:-1], series[1:]) > 0.8 * peaks[k]))
        value, slope, curve = (np.stack((data[rows, k], data[rows + 1, k])) for data in (overlap, rate, acceleration))
        pieces.append((_quintic(value, slope, curve, width[rows]), width[rows], share[rows], share[rows + 1]))
        # each row is one piece; time runs along it
        polynomial, span, early, late = (np.concatenate(parts, axis=-1) for parts in zip(*pieces, strict=True))
        if len(span) == 0:
            continue
        # closed, at touch too: an overlap of 0 would be without the pull-off
        between = np.maximum(poly.polyval(part, polynomial), np.nextafter(0.0, 1.0))
        velocity = poly.polyval(part, poly.polyder(polynomial)) / span[:, None]
        law = contacts.force(between[..., None], which)[..., 0] + c * between**power * velocity
        # a parabola through the largest value and its two neighbours
        top = np.clip(np.argmax(law, axis=1), 1, len(part) - 2)
        low, middle, high = (law[np.arange(len(span)), top + side] for side in (-1, 0, 1))
        curvature = 2.0 * middle - low - high
        inner = (curvature > 0.0) & (np.abs(high - low) < curvature)
        most = np.where(
            inner, middle + (high - low) ** 2 / (8.0 * np.where(inner, curvature, 1.0)), np.max(law, axis=1)
        )
        peaks[k] = max(peaks[k], np.max(np.where(top < len(part) // 2, early, late) * most))
    return peaks


def _touch(overlap: Floats, closing: Floats, acceleration: Floats) -> tuple[Floats, Floats]:
    """Return closing speed (m/s) at touch and the time until touch (s), from an open sample and its acceleration."""
    speed = np.sqrt(np.maximum(closing**2 - 2.0 * acceleration * overlap, 0.0))
    both = closing + speed
    # of the two forms of the root, use the one without cancellation
    coming = np.where(both > 0.0, -2.0 * overlap / np.where(both > 0.0, both, 1.0), 0.0)
    turning = (speed - closing) / np.where(acceleration != 0.0, acceleration, 1.0)
    return speed, np.maximum(np.where(closing >= 0.0, coming, turning), 0.0)


def secondary_peak_force(force: Floats) -> Floats:
    """Return the largest force of each contact outside the collision with its overall maximum, N.

    A collision ends where the force falls below a tenth of its peak.

    Parameters
    ----------
    force : ndarray
        Forces, N, ``(n_t, n_contact)``.

    Examples
    --------
    >>> secondary_peak_force(np.array([[0.0, 5.0, 0.1, 3.0, 4.0, 0.0]]).T).tolist()
    [4.0]
    """
    secondary = np.zeros(force.shape[1])
    top = np.argmax(force, axis=0)
    for contact, row in enumerate(top.tolist()):
        series = force[:, contact]
        low = np.flatnonzero(series < 0.1 * series[row])
        end = int(np.searchsorted(low, row))
        before = series[: low[end - 1]] if end > 0 else series[:0]
        after = series[low[end] :] if end < len(low) else series[:0]
        secondary[contact] = max(np.max(before, initial=0.0), np.max(after, initial=0.0))
    return secondary


def _quintic(value: Floats, slope: Floats, curvature: Floats, width: Floats) -> Floats:
    """Return the coefficients c_0..c_5 in u = (t - t_0)/width of the Hermite quintic, from data at both ends."""
    return np.array(quintic.py_func(*value, *(slope * width), *(curvature * width**2)))


@kernel(nogil=False)
def quintic(value0, value1, slope0, slope1, curvature0, curvature1):  # type: ignore[no-untyped-def]
    """Return the coefficients c_0..c_5 of the Hermite quintic on [0, 1], from numbers or arrays at both ends."""
    half0 = 0.5 * curvature0
    rise, turn, bend = value1 - value0 - slope0 - half0, slope1 - slope0 - 2.0 * half0, 0.5 * curvature1 - half0
    c3, c4 = 10.0 * rise - 4.0 * turn + bend, -15.0 * rise + 7.0 * turn - 2.0 * bend
    return value0, slope0, half0, c3, c4, 6.0 * rise - 3.0 * turn + bend


def _quartic(speed: Floats, value: Floats, slope: Floats, curvature: Floats, width: Floats) -> Floats:
    """Return the coefficients c_0..c_5 of an overlap that starts at touch with this ``speed``.

    The acceleration jumps at touch, so only its value at the end is used.
    """
    rise, turn, bend = value - speed * width, (slope - speed) * width, 0.5 * curvature * width**2
    c4 = bend + 3.0 * rise - 2.0 * turn
    c3 = turn - 2.0 * rise - 2.0 * c4
    return np.array([np.zeros_like(width), speed * width, rise - c3 - c4, c3, c4, np.zeros_like(width)])


@kernel(nogil=False)
def _turning_point(polynomial):  # type: ignore[no-untyped-def]
    """Return the root in [0, 1] of each derivative, ``(6, m)`` to ``(m,)``; see :func:`turning_point`."""
    roots = np.zeros(polynomial.shape[1])
    for column in range(polynomial.shape[1]):
        _, c1, c2, c3, c4, c5 = polynomial[:, column]
        roots[column] = turning_point(c1, c2, c3, c4, c5)
    return roots


@kernel(nogil=False)
def turning_point(c1, c2, c3, c4, c5):  # type: ignore[no-untyped-def]
    """Return the root in [0, 1] of the derivative of a polynomial, by Newton's method within a bracket.

    The derivative is > 0 at 0 and <= 0 at 1.
    """
    low, high, root = 0.0, 1.0, 0.5
    for _ in range(60):
        slope = c1 + root * (2.0 * c2 + root * (3.0 * c3 + root * (4.0 * c4 + root * 5.0 * c5)))
        curvature = 2.0 * c2 + root * (6.0 * c3 + root * (12.0 * c4 + root * 20.0 * c5))
        if slope > 0.0:
            low = root
        else:
            high = root
        following = root - slope / curvature if curvature < 0.0 else 0.5 * (low + high)
        if abs(following - root) < 1e-15:
            return root
        root = following if low < following < high else 0.5 * (low + high)
    return root
