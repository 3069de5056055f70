"""Spectra of the velocity in time and along the chain (paper, section 4b, fig. 4b, c, e, f), as numbers.

A spectrum cascades if its centroid moves as the pulse travels. Both spectra are one-sided densities of ``v^2``, so that
their sum over frequency or wavenumber is the integral of v^2 over time or the sum of v^2 over bodies (Parseval; the
relative mismatch is a field). The striker is left out. Only the time until the pulse has reached the last body counts;
later the free end has changed the motion.

No window is applied. The record starts at rest and ends behind the pulse, so no motion is cut off at its ends that a
window could smooth. A window as long as the record would weigh bodies by the time of their pulse: with Hann's window
the centroid of the wavenumber at the end of the paper's accelerating chain of 200 is 0.08 instead of 0.13.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dem_bridge.errors import UsageError
from dem_bridge.observables.fits import Slope, inner_contacts, straight_line
from dem_bridge.observables.interpolate import spacing
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import Floats, Trajectory

#: shares of the positions, at the start and at the end, over which centroids are averaged: the one of the ratio first
SHARES = (0.1, 0.05, 0.2)


@dataclass(frozen=True, kw_only=True, eq=False)
class Spectrum:
    """Hold one-sided spectra, one for each position of the pulse.

    Made by :func:`frequency_spectrum` and :func:`wavenumber_spectrum`.
    """

    frequency: Floats
    """``(n_f,)``: Hz, or cycles per body (times 2 pi over the spacing: rad/m)."""
    density: Floats
    """``(n_f, n_position)``: m^2/s per Hz, or m^2/s^2 per (cycle per body)."""
    position: Floats
    """``(n_position,)``: number of the body, or of the body that the front is at (its time: ``time``)."""
    time: Floats
    """``(n_position,)``, s: when the pulse arrives at the body, or when the spectrum was taken."""
    centroid: Floats
    """``(n_position,)``: mean frequency, weighted by the density."""
    width: Floats
    """``(n_position,)``: root of the density's second moment about the centroid."""
    parseval: float
    """Largest relative mismatch, over positions, of the density's sum and that of v^2."""


def frequency_spectrum(
    scene: Scene,
    trajectory: Trajectory,
    *,
    first: int | None = None,
    last: int | None = None,
) -> Spectrum:
    """Return the spectrum in time of the velocity of bodies ``first`` to ``last`` (both included), m^2/s per Hz.

    These are figures 4b and 4e of the paper. None: from a tenth of the chain, where the pulse has formed, to a
    twentieth before its end, where it has passed before the record ends. The record has all samples until the last
    contact is at its first maximal compression. Samples must be much closer than a residence time, because the spectrum
    above half the sampling rate is folded back. Raises UsageError for bodies that the pulse does not reach.

    >>> import dem_bridge as db
    >>> scene = db.load_scene("accelerating-40")
    >>> spectrum = frequency_spectrum(scene, db.solve(scene, backend="reference", samples=1500, uncertainty=False))
    >>> [f"{1e-3 * spectrum.centroid[j]:.2f} kHz at body {spectrum.position[j]:.0f}" for j in (0, -1)]
    ['5.74 kHz at body 4', '14.01 kHz at body 37']
    >>> spectrum.parseval < 1e-14
    True
    """
    h = spacing(trajectory)
    bodies = _bodies(scene, first, last)
    arrival = trajectory.crossing_time[bodies - 1]
    if np.any(np.isnan(arrival)):
        raise UsageError(
            f"the pulse never came to body {bodies[np.isnan(arrival)][0]}; take a longer run, or a lower last"
        )
    v = trajectory.velocity[: _passage(scene, trajectory), :][:, bodies]
    return _spectrum(v, h, position=bodies.astype(float), time=arrival)


def wavenumber_spectrum(
    scene: Scene,
    trajectory: Trajectory,
    *,
    first: int | None = None,
    last: int | None = None,
) -> Spectrum:
    """Return the spectrum along bodies 1..n_body-1 of their velocity at many times, m^2/s^2 per (cycle per body).

    These are figures 4c and 4f of the paper. Spectra are taken at each sample while the front is between bodies
    ``first`` and ``last`` (None: as in :func:`frequency_spectrum`, so that the whole pulse is in the chain).
    ``position`` is where the front is, by its arrivals.

    >>> import dem_bridge as db
    >>> scene = db.load_scene("accelerating-40")
    >>> spectrum = wavenumber_spectrum(scene, db.solve(scene, backend="reference", uncertainty=False))
    >>> f"{spectrum.centroid[0]:.3f} to {spectrum.centroid[-1]:.3f} cycles per body", spectrum.parseval < 1e-14
    ('0.128 to 0.134 cycles per body', True)
    """
    spacing(trajectory)
    bodies = _bodies(scene, first, last)
    arrival = trajectory.crossing_time[bodies - 1]
    available = np.isfinite(arrival)
    if np.count_nonzero(available) < 2:
        raise UsageError(f"the pulse never came to bodies {bodies[0]}..{bodies[-1]}; take a longer run")
    bodies, arrival = bodies[available], arrival[available]
    rows = np.flatnonzero((trajectory.time >= arrival[0]) & (trajectory.time <= arrival[-1]))
    if len(rows) == 0:
        raise UsageError("no sample falls while the pulse is in the chain; take more samples")
    position = np.interp(trajectory.time[rows], arrival, bodies)
    v = trajectory.velocity[rows, 1:].T
    return _spectrum(v, 1.0, position=position, time=trajectory.time[rows])


def _spectrum(v: Floats, step: float, *, position: Floats, time: Floats) -> Spectrum:
    """Return the spectrum of each column of ``v``, sampled at ``step`` along its rows."""
    count = len(v)
    frequency = np.asarray(np.fft.rfftfreq(count, step), dtype=np.float64)
    both = np.full(len(frequency), 2.0)  # positive and negative frequencies
    both[0] = 1.0
    if count % 2 == 0:
        both[-1] = 1.0
    density = both[:, None] * np.abs(step * np.fft.rfft(v, axis=0)) ** 2
    width = 1.0 / (count * step)
    total, direct = width * np.sum(density, axis=0), step * np.sum(v**2, axis=0)
    if not np.all(direct > 0.0):
        raise UsageError("a body or time has no motion at all in the record: it has no spectrum; take inner bodies")
    share = density / np.sum(density, axis=0)
    centroid = frequency @ share
    spread = np.sqrt(np.maximum(frequency**2 @ share - centroid**2, 0.0))
    return Spectrum(
        frequency=frequency,
        density=density,
        position=position,
        time=time,
        centroid=centroid,
        width=spread,
        parseval=float(np.max(np.abs(total / direct - 1.0))),
    )


def _passage(scene: Scene, trajectory: Trajectory) -> int:
    """Return the number of samples until the pulse is at the last body; all samples if it never reaches it."""
    return int(np.searchsorted(trajectory.time, trajectory.crossing_time[scene.n_body - 2], side="right"))


def _bodies(scene: Scene, first: int | None, last: int | None) -> NDArray[np.int64]:
    """Return the bodies from ``first`` to ``last``, or those between the ends; UsageError if these are too few."""
    low, high = inner_contacts(scene)
    bodies = np.arange(low if first is None else first, (high if last is None else last) + 1)
    if len(bodies) < 2 or bodies[0] < 1 or bodies[-1] > scene.n_body - 1:
        result = f"{bodies[0]}..{bodies[-1]}" if len(bodies) else "none"
        raise UsageError(f"bodies {result}; allowed: two or more of 1..{scene.n_body - 1}, first and last included")
    return bodies


@dataclass(frozen=True, kw_only=True)
class Cascade:
    """Hold how the centroid of a spectrum moves as the pulse travels; :func:`cascade` returns it."""

    ratio: float
    """Of the geometric mean of centroids over the last tenth of the way to that over the first."""
    early: float
    late: float
    """Geometric means of the centroid over the first and the last tenth of the way; their quotient is ``ratio``."""
    stderr: float
    """Of the ratio, from the scatter of the centroids about both means' own lines."""
    spread: tuple[float, float]
    """Least and largest ratio with a twentieth, a tenth and a fifth of the way, whose middles are further in."""
    start: float
    end: float
    """Mean positions in the first and the last tenth: what theory has to be evaluated at."""
    slope: Slope
    """d ln(centroid) / d ln(position, or the values that the power law is in); its windows count positions."""


def cascade(spectrum: Spectrum, *, against: Floats | None = None) -> Cascade:
    """Return the ratio of the centroid at the end of the chain to that at its start, and its power law.

    ``against``: what the power law is in, > 0, one per position (None: the position; the stiffness of
    :func:`~dem_bridge.observables.front.local_stiffness` should give 1/n = 0.4 for frequencies and 0 for wavenumbers).
    The wavenumber's centroid swings by 5 % as the pulse goes from body to body; means over a tenth of the way take it
    out. In the paper's chains of 200 the frequency's ratio is 0.501 (decelerating) and 1.921 (accelerating), where the
    ratio of stiffnesses at ``start`` and ``end`` to the 2/5 is 0.496 and 1.875; the wavenumber's is 1.020 and 1.024. In
    its decelerating chain of 40 several pulses share one spectrum, whose centroid then says little: 0.90 and 1.74.

    >>> import dem_bridge as db
    >>> scene = db.load_scene("accelerating-40")
    >>> run = db.solve(scene, backend="reference", samples=1500, uncertainty=False)
    >>> [f"{cascade(spectrum(scene, run)).ratio:.2f}" for spectrum in (frequency_spectrum, wavenumber_spectrum)]
    ['2.25', '1.07']
    """
    x, y = spectrum.position, np.log(spectrum.centroid)
    if len(x) < 4:
        raise UsageError(f"a spectrum at {len(x)} positions; a cascade needs 4 or more: take more samples or bodies")
    results = []
    for share in SHARES:
        reach = share * (x[-1] - x[0])
        ends = x <= x[0] + reach, x >= x[-1] - reach
        results.append((ends, [float(np.mean(y[end])) for end in ends]))
    ratios = [float(np.exp(late - early)) for _, (early, late) in results]
    ends = results[0][0]
    error = float(np.sqrt(sum(_scatter(x[end], y[end]) ** 2 for end in ends)))
    other = np.log(x if against is None else np.asarray(against, dtype=float))
    return Cascade(
        ratio=ratios[0],
        early=float(np.exp(results[0][1][0])),
        late=float(np.exp(results[0][1][1])),
        stderr=ratios[0] * error,
        spread=(min(ratios), max(ratios)),
        start=float(np.mean(x[ends[0]])),
        end=float(np.mean(x[ends[1]])),
        slope=straight_line(other, y, np.zeros_like(y), 0),
    )


def _scatter(x: Floats, y: Floats) -> float:
    """Return the standard error of the mean of y about its line in x; 0 for two points or fewer."""
    if len(x) < 3:
        return 0.0
    rest = y - np.polyval(np.polyfit(x - np.mean(x), y, 1), x - np.mean(x))
    return float(np.sqrt(np.sum(rest**2) / (len(x) - 2) / len(x)))
