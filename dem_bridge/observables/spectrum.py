"""Spectra of the velocity in time and along the chain (paper, section 4b, fig. 4b, c, e, f), as numbers.

A spectrum "cascades" when its centroid moves as the pulse travels. Both spectra are one-sided densities of ``v^2``, so
that their sum over frequency or wavenumber is the integral of v^2 over time or the sum of v^2 over bodies (Parseval;
the relative mismatch is a field). The striker is left out. Only the time until the pulse has reached the last body
counts: later the chain is what the free end left of it.

No window (``"boxcar"``) is the default and meant: the record starts at rest and ends behind the pulse, so nothing is
cut off at its ends that a window could smooth, while a window as long as the record weighs a body by when its pulse
comes and distorts what is near its ends: with ``"hann"`` the wavenumber's centroid at the end of the paper's
accelerating chain of 200 is 0.08 in place of 0.13. Whatever ``scipy.signal.get_window`` knows is taken instead.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dem_bridge.errors import UsageError
from dem_bridge.observables.fits import Slope, inner_contacts, straight_line
from dem_bridge.observables.interpolate import spacing
from dem_bridge.scene import Scene
from dem_bridge.trajectory import Trajectory

Floats = NDArray[np.float64]

Window = str | tuple[str, float]

#: how far the ratio of two centroids must be from 1, either way, for a cascade
CASCADE = 1.2
#: shares of the positions, at the start and at the end, over which centroids are averaged: the one of the ratio first
SHARES = (0.1, 0.05, 0.2)


@dataclass(frozen=True, kw_only=True, eq=False)
class Spectrum:
    """One-sided spectra, one for each position of the pulse.

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
    window: Window


def frequency_spectrum(
    scene: Scene,
    trajectory: Trajectory,
    *,
    window: Window = "boxcar",
    first: int | None = None,
    last: int | None = None,
) -> Spectrum:
    """Spectrum in time of the velocity of bodies ``first`` to ``last``, both included, m^2/s per Hz (fig. 4b, e).

    None: from a tenth of the chain, where the pulse has formed, to a twentieth before its end, where it has passed
    before the record ends. The record: all samples until the last contact is at its first maximal compression. Bodies
    that the pulse does not reach are refused by UsageError. Samples must be much closer than a residence time: the
    density at half the sampling rate is what is folded back.

    >>> import dem_bridge as db
    >>> scene = db.load_scene("accelerating-40")
    >>> spectrum = frequency_spectrum(scene, db.solve(scene, backend="reference", samples=1500, uncertainty=False))
    >>> [f"{1e-3 * spectrum.centroid[j]:.2f} kHz at body {spectrum.position[j]:.0f}" for j in (0, -1)]
    ['5.74 kHz at body 4', '14.01 kHz at body 37']
    >>> spectrum.parseval < 1e-14
    True
    """
    h = spacing(trajectory)
    low, high = inner_contacts(scene)
    bodies = np.arange(low if first is None else first, (high if last is None else last) + 1)
    _check_bodies(scene, bodies)
    arrival = trajectory.crossing_time[bodies - 1]
    if np.any(np.isnan(arrival)):
        raise UsageError(
            f"the pulse never came to body {bodies[np.isnan(arrival)][0]}; take a longer run, or a lower last"
        )
    v = trajectory.velocity[: _passage(scene, trajectory), :][:, bodies]
    return _spectrum(v, h, window=window, position=bodies.astype(float), time=arrival)


def wavenumber_spectrum(
    scene: Scene,
    trajectory: Trajectory,
    *,
    window: Window = "boxcar",
    first: int | None = None,
    last: int | None = None,
) -> Spectrum:
    """Spectrum along bodies 1..n_body-1 of their velocity, m^2/s^2 per (cycle per body), at many times (fig. 4c, f).

    At each sample while the front is between bodies ``first`` and ``last`` (None: as in :func:`frequency_spectrum`, so
    that the whole pulse is in the chain). ``position`` is where the front is, by its arrivals.

    >>> import dem_bridge as db
    >>> scene = db.load_scene("accelerating-40")
    >>> spectrum = wavenumber_spectrum(scene, db.solve(scene, backend="reference", uncertainty=False))
    >>> f"{spectrum.centroid[0]:.3f} to {spectrum.centroid[-1]:.3f} cycles per body", spectrum.parseval < 1e-14
    ('0.128 to 0.134 cycles per body', True)
    """
    spacing(trajectory)
    low, high = inner_contacts(scene)
    bodies = np.arange(low if first is None else first, (high if last is None else last) + 1)
    _check_bodies(scene, bodies)
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
    return _spectrum(v, 1.0, window=window, position=position, time=trajectory.time[rows])


def _spectrum(v: Floats, step: float, *, window: Window, position: Floats, time: Floats) -> Spectrum:
    """Return the spectrum of each column of ``v``, sampled at ``step`` along its rows."""
    from scipy.signal import get_window

    count = len(v)
    try:
        weight = get_window(window, count)  # periodic, as the transform is
    except ValueError as error:
        raise UsageError(f"window = {window!r}: {error}; allowed: a name that scipy.signal.get_window knows") from error
    signal = v * weight[:, None]
    frequency = np.asarray(np.fft.rfftfreq(count, step), dtype=np.float64)
    both = np.full(len(frequency), 2.0)  # positive and negative frequencies
    both[0] = 1.0
    if count % 2 == 0:
        both[-1] = 1.0
    density = both[:, None] * np.abs(step * np.fft.rfft(signal, axis=0)) ** 2
    width = 1.0 / (count * step)
    total, direct = width * np.sum(density, axis=0), step * np.sum(signal**2, axis=0)
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
        window=window,
    )


def _passage(scene: Scene, trajectory: Trajectory) -> int:
    """Return the number of samples until the pulse is at the last body; all samples if it never reaches it."""
    return int(np.searchsorted(trajectory.time, trajectory.crossing_time[scene.n_body - 2], side="right"))


def _check_bodies(scene: Scene, bodies: NDArray[np.int64]) -> None:
    if len(bodies) < 2 or bodies[0] < 1 or bodies[-1] > scene.n_body - 1:
        result = f"{bodies[0]}..{bodies[-1]}" if len(bodies) else "none"
        raise UsageError(f"bodies {result}; allowed: two or more of 1..{scene.n_body - 1}, first and last included")


class CentroidSlope(Slope):
    """d ln(centroid) / d ln(position, or what it is set against). ``first`` and ``last`` count positions."""


@dataclass(frozen=True, kw_only=True)
class Cascade:
    """Motion of a spectrum's centroid as the pulse travels. Made by :func:`cascade`."""

    ratio: float
    """Of the geometric mean of centroids over the last tenth of the way to that over the first."""
    stderr: float
    """Of the ratio, from the scatter of the centroids about both means' own lines."""
    spread: tuple[float, float]
    """Least and largest ratio with a twentieth, a tenth and a fifth of the way, whose middles are further in."""
    start: float
    end: float
    """Mean positions in the first and the last tenth: what theory has to be evaluated at."""
    slope: CentroidSlope
    threshold: float
    cascades: bool | None
    """Whether all ratios of ``spread`` are beyond ``threshold``, or its inverse; None: some are."""


def cascade(spectrum: Spectrum, *, against: Floats | None = None, threshold: float = CASCADE) -> Cascade:
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
    >>> [cascade(spectrum(scene, run)).cascades for spectrum in (frequency_spectrum, wavenumber_spectrum)]
    [True, False]
    """
    if not threshold > 1.0:
        raise UsageError(f"threshold = {threshold!r}; allowed: a number > 1, the ratio that counts as a cascade")
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
    beyond = [ratio > threshold or ratio < 1.0 / threshold for ratio in ratios]
    other = np.log(x if against is None else np.asarray(against, dtype=float))
    return Cascade(
        ratio=ratios[0],
        stderr=ratios[0] * error,
        spread=(min(ratios), max(ratios)),
        start=float(np.mean(x[ends[0]])),
        end=float(np.mean(x[ends[1]])),
        slope=straight_line(CentroidSlope, other, y, np.zeros_like(y), 0),
        threshold=threshold,
        cascades=None if any(beyond) != all(beyond) else all(beyond),
    )


def _scatter(x: Floats, y: Floats) -> float:
    """Return the standard error of the mean of y about its line in x; 0 for two points or fewer."""
    if len(x) < 3:
        return 0.0
    rest = y - np.polyval(np.polyfit(x - np.mean(x), y, 1), x - np.mean(x))
    return float(np.sqrt(np.sum(rest**2) / (len(x) - 2) / len(x)))
