"""Peak forces and crossing times of a fixed-step run, from samples that are much denser than the stored ones.

LAMMPS and the twin use the same estimator, so that it cancels in their difference. Between two dense samples the
overlap is a quintic Hermite polynomial through overlap, closing rate and closing acceleration at both ends. Its error
is (omega h)^6 / 46080 of the amplitude, 2e-11 at the spacing omega h = 0.1 of :func:`schedule`, far below the time-step
error of a second-order run.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.polynomial import polynomial as poly
from numpy.typing import NDArray

from dem_bridge.errors import UsageError
from dem_bridge.foundation.compiled import kernel
from dem_bridge.scene.contacts import Contacts, Floats

#: a number, or an array of them
Number = TypeVar("Number", float, Floats)

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
    closed, moved = overlap > resolution, np.abs(acceleration) >= resting
    with np.errstate(over="ignore", invalid="ignore"):  # of rates and accelerations beyond 1e150
        turning = may_turn.py_func(rate[:-1], rate[1:], acceleration[:-1], acceleration[1:], np.diff(time)[:, None])
    rows, contacts = np.nonzero(turning & (closed[:-1] | closed[1:]) & (moved[:-1] | moved[1:]))
    turns = Turns(
        contacts,
        time[rows],
        np.asarray(time[rows + 1] - time[rows], dtype=np.float64),
        *(np.stack((data[rows, contacts], data[rows + 1, contacts])) for data in (overlap, rate, acceleration, force)),
    )
    return at_turns(turns, peak_force, exponent=exponent, resolution=resolution, laws=laws)


class Turns(NamedTuple):
    """Possible turns of contacts from closing to opening: the dense samples before and after each, in order of time.

    Between two samples of one sign of the closing rate a contact may or may not turn, see :func:`may_turn`.
    """

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


def _turn(overlap: Floats, rate: Floats, acceleration: Floats, width: Floats) -> tuple[Floats, Floats]:
    """Return where between two samples the quintic polynomial of each overlap first turns, 0 to 1, and its value there.

    Both are nan where it does not turn.
    """
    polynomial = quintics(overlap, rate, acceleration, width)
    fraction: Floats = first_turns(polynomial, rate[1] * width)
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
        pieces.append((quintics(value, slope, curve, width[rows]), width[rows], share[rows], share[rows + 1]))
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
    for contact in np.flatnonzero(np.any(force, axis=0)).tolist():
        row, series = int(top[contact]), force[:, contact]
        low = np.flatnonzero(series < 0.1 * series[row])
        end = int(np.searchsorted(low, row))
        before = series[: low[end - 1]] if end > 0 else series[:0]
        after = series[low[end] :] if end < len(low) else series[:0]
        secondary[contact] = max(np.max(before, initial=0.0), np.max(after, initial=0.0))
    return secondary


def quintics(value: Floats, slope: Floats, curvature: Floats, width: Floats) -> Floats:
    """Return the coefficients c_0..c_5 in u = (t - t_0)/width of the Hermite quintic, from data at both ends."""
    return np.array(quintic.py_func(*value, *(slope * width), *(curvature * width**2)))


@kernel(nogil=False)
def quintic(
    value0: Number, value1: Number, slope0: Number, slope1: Number, curvature0: Number, curvature1: Number
) -> tuple[Number, Number, Number, Number, Number, Number]:
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
def may_turn(rate0: Number, rate1: Number, bend0: Number, bend1: Number, width: Number) -> Any:
    """Return whether a closing rate may fall through zero between two samples, from numbers or arrays at both.

    It does where it is positive before and not after. With one sign at both samples it may dip below zero, or rise
    above it, where the accelerations ``bend0`` and ``bend1`` bend it so far that its tangents meet beyond zero.
    """
    dips = (rate0 > 0.0) & (rate1 > 0.0) & (bend0 < 0.0) & (bend1 > 0.0)
    rises = (rate0 <= 0.0) & (rate1 <= 0.0) & (bend0 > 0.0) & (bend1 < 0.0)
    beyond = bend0 * (rate1 - bend1 * width) >= bend1 * rate0
    return ((rate0 > 0.0) & (rate1 <= 0.0)) | ((dips | rises) & beyond)


@kernel(nogil=False)
def first_turns(polynomial: Floats, last: Floats) -> Floats:
    """Return where polynomials ``(6, m)`` with the slopes ``last (m,)`` at their ends turn; see :func:`first_turn`."""
    turns = np.zeros(polynomial.shape[1])
    for column in range(polynomial.shape[1]):
        _, c1, c2, c3, c4, c5 = polynomial[:, column]
        turns[column] = first_turn(c1, c2, c3, c4, c5, last[column])
    return turns


@kernel(nogil=False)
def first_turn(c1: float, c2: float, c3: float, c4: float, c5: float, last: float) -> float:
    """Return where in [0, 1] a polynomial first turns from rising to falling; nan if it does not.

    ``last`` is its slope at 1, whose sign the sum of the coefficients may miss by round-off.
    """
    if c1 > 0.0 and last <= 0.0:
        return turning_point(c1, c2, c3, c4, c5, 0.0, 1.0)
    # the slope has one sign at both ends: it falls through zero before its minimum, or after its maximum
    sign = -1.0 if c1 > 0.0 else 1.0
    extreme, slope = extreme_slope(c1, c2, c3, c4, c5, sign)
    if sign * slope <= 0.0:
        return np.nan
    low, high = (0.0, extreme) if sign < 0.0 else (extreme, 1.0)
    return turning_point(c1, c2, c3, c4, c5, low, high)


@kernel(nogil=False)
def extreme_slopes(polynomial: Floats, signs: Floats) -> tuple[Floats, Floats]:
    """Return where the slopes of polynomials ``(6, m)`` are extreme, and these slopes; see :func:`extreme_slope`."""
    parts, slopes = np.zeros(polynomial.shape[1]), np.zeros(polynomial.shape[1])
    for column in range(polynomial.shape[1]):
        _, c1, c2, c3, c4, c5 = polynomial[:, column]
        parts[column], slopes[column] = extreme_slope(c1, c2, c3, c4, c5, signs[column])
    return parts, slopes


@kernel(nogil=False)
def extreme_slope(c1: float, c2: float, c3: float, c4: float, c5: float, sign: float) -> tuple[float, float]:
    """Return where in [0, 1] the slope of a polynomial is largest, or smallest if ``sign`` is -1, and the slope there.

    The slope rises at 0 and falls at 1, or the opposite.
    """
    part = turning_point(sign * 2.0 * c2, sign * 3.0 * c3, sign * 4.0 * c4, sign * 5.0 * c5, 0.0, 0.0, 1.0)
    return part, c1 + part * (2.0 * c2 + part * (3.0 * c3 + part * (4.0 * c4 + part * 5.0 * c5)))


@kernel(nogil=False)
def turning_point(c1: float, c2: float, c3: float, c4: float, c5: float, low: float, high: float) -> float:
    """Return the root in [low, high] of the derivative of a polynomial, by Newton's method within a bracket.

    The derivative is > 0 at ``low`` and <= 0 at ``high``.
    """
    root = 0.5 * (low + high)
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
