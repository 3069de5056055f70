"""The solitary wave of a uniform chain of bodies, solved for the discrete chain: no continuum, no time stepping.

Identical bodies that just touch, ``F = beta overlap^(n-1)`` with n > 2, carry one pulse of unchanging shape
(existence: Friesecke & Wattis 1994, *Commun. Math. Phys.* 161, 391). With overlap_k(t) = r(k - c t), c in grains per
second, Newton's law is equivalent to (English & Pego 2005, *Proc. AMS* 133, 1763)::

    m c^2 r = beta tent * r^(n-1),        tent(x) = max(1 - |x|, 0)

and amplitudes scale: one profile per exponent, here with m = beta = c = 1, serves all. It is positive, even, smooth
and falls off faster than exponentially, so that a cosine series on a finite domain converges to round-off with some
tens of points; the convolution is the factor sinc^2 on it. A few of Petviashvili's normalised iterations (1976,
*Sov. J. Plasma Phys.* 2, 257) from the Gaussian of the limit n -> 2 (James & Pelinovsky 2014, *Proc. R. Soc. A* 470,
20130462) lead to where Newton's method converges. Knows nothing of scenes or time.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from dem_bridge.physics.valid import above

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import ArrayLike, NDArray

    Floats = NDArray[np.float64]

#: the fixed point is found when both sides differ by less than this share of the largest overlap
CONVERGED = 1e-13
#: cosine coefficients and the domain's edge must be below this share of their largest: nothing was cut off
RESOLVED = 1e-14
#: Newton's last correction must be below this: as n -> 2 the amplitude is less and less determined, like eps/(n - 2)
DETERMINED = 1e-10
#: largest number of grid points on half the wave; enough up to n = 50
MOST_POINTS = 1024


@dataclass(frozen=True, eq=False)
class WaveShape:
    """The wave at m = beta = c = 1, for one exponent. Made by :func:`wave_shape`."""

    exponent: float
    half_length: float
    """Grains: beyond it from the centre nothing is left (1e-16 of the peak)."""
    overlap: Floats
    """Cosine coefficients ``(n_point,)`` of the overlap: sum of a_j cos(pi j x / half_length)."""
    velocity: Floats
    """The same of the velocity."""
    momentum: float
    kinetic: float
    """Kinetic energy, mean over a passage from grain to grain."""
    potential: float
    residual: float
    """Largest |r - tent * r^(n-1)| on the grid over the largest r."""
    uncertainty: float
    """Newton's last correction over the largest r: the profile's own error."""

    def series(self, coefficients: Floats, grains: ArrayLike) -> Floats:
        """A cosine series at distances ``grains`` from the centre, any shape; 0 beyond the domain."""
        import numpy as np

        x = np.asarray(grains, dtype=float)
        waves = np.cos(np.pi / self.half_length * np.multiply.outer(x, np.arange(len(coefficients))))
        return np.where(np.abs(x) < self.half_length, waves @ coefficients, 0.0)

    @functools.cached_property
    def peaks(self) -> tuple[float, float]:
        """Largest overlap and largest velocity: at the centre every cosine is one."""
        return math.fsum(self.overlap), math.fsum(self.velocity)

    @functools.cached_property
    def width(self) -> float:
        """Full width of the force at half its peak, grains."""
        from scipy.optimize import brentq

        half = self.peaks[0] * 0.5 ** (1.0 / (self.exponent - 1.0))  # the overlap there
        outside = 0.999 * self.half_length
        away = brentq(lambda x: float(self.series(self.overlap, x)) - half, 0.0, outside, xtol=1e-14)
        return 2.0 * float(away)


@dataclass(frozen=True, kw_only=True)
class SolitaryWave:
    """One pulse in a uniform chain. Made by :func:`solitary_wave`."""

    speed: float
    """Grains per second; times the distance between centres it is m/s."""
    peak_velocity: float
    """m/s: the largest of each body."""
    peak_force: float
    """N: the largest in each contact."""
    peak_overlap: float
    """m."""
    momentum: float
    """kg m/s, of the whole pulse."""
    energy: float
    """J, of the whole pulse: constant in time."""
    kinetic_to_potential: float
    """Mean kinetic over mean potential energy: n/2 by the virial theorem, here found and not put in."""
    shift: float
    """m: how far each body has moved once the pulse has passed, momentum / (mass speed)."""
    width: float
    """Grains between the places where the force is half its largest; over ``speed`` it is a time."""
    residual: float
    """Of the fixed point, relative to the largest overlap: at most 1e-13."""
    uncertainty: float
    """Of the profile, relative to its largest value."""
    stiffness: float = field(repr=False)
    shape: WaveShape = field(repr=False)

    def overlap(self, grains: ArrayLike) -> Floats:
        """Overlap, m, of a contact ``grains`` from the contact at its peak; any shape.

        The wave is even: a contact k that peaks at t_k has ``overlap(speed * (t - t_k))`` at time t. Absolute accuracy:
        ``uncertainty`` times the peak, so that far tails are lost in round-off and cut at zero.
        """
        import numpy as np

        return np.maximum(self.peak_overlap * self.shape.series(self.shape.overlap, grains) / self.shape.peaks[0], 0.0)

    def force(self, grains: ArrayLike) -> Floats:
        """Contact force, N, of a contact ``grains`` from the contact at its peak."""
        return self.stiffness * self.overlap(grains) ** (self.shape.exponent - 1.0)

    def velocity(self, grains: ArrayLike) -> Floats:
        """Velocity, m/s, of a body ``grains`` from the body at its peak.

        Body k, between contacts k-1 and k, has its peak halfway between theirs: half a grain over ``speed`` before
        contact k.
        """
        import numpy as np

        return np.maximum(
            self.peak_velocity * self.shape.series(self.shape.velocity, grains) / self.shape.peaks[1], 0.0
        )


def solitary_wave(
    *,
    mass: float,
    stiffness: float,
    exponent: float,
    peak_velocity: float | None = None,
    peak_force: float | None = None,
) -> SolitaryWave:
    """The solitary wave of a chain of bodies ``mass`` (kg), contacts ``stiffness`` (N/m^(n-1)), by its size.

    Give one of ``peak_velocity`` (m/s) and ``peak_force`` (N). Valid for a uniform chain without gaps, precompression,
    walls or dissipation. Raises ValueError for n <= 2 (a linear chain disperses every pulse) and for exponents whose
    wave does not converge here (below 2.00001, above 50). For n = 5/2 the speed is
    0.907470078412 (beta/m)^(2/5) v^(1/5) grains per second.

    >>> wave = solitary_wave(mass=1.0, stiffness=1.0, exponent=2.5, peak_velocity=1.0)
    >>> f"{wave.speed:.12f} {wave.kinetic_to_potential:.12f} {wave.momentum:.10f} {wave.energy:.10f}"
    '0.907470078412 1.250000000000 1.6699712493 1.0693229458'
    >>> same = solitary_wave(mass=1.0, stiffness=1.0, exponent=2.5, peak_force=wave.peak_force)
    >>> f"{same.peak_velocity:.12f} {same.speed / same.peak_force ** (1 / 6):.12f}"
    '1.000000000000 0.905515776419'
    """
    m, beta = above(0.0, "mass", mass, "kg"), above(0.0, "stiffness", stiffness, "N/m^(n-1)")
    if (peak_velocity is None) == (peak_force is None):
        given = "neither is" if peak_force is None else "both are"
        raise ValueError(f"peak_velocity, peak_force: {given} given; allowed: one, the other follows from it")
    shape = wave_shape(exponent)
    n, (top, fastest) = shape.exponent, shape.peaks
    # overlaps scale by A, with m c^2 = beta A^(n-2); forces then by beta A^(n-1), velocities by c A
    if peak_velocity is not None:
        v = above(0.0, "peak_velocity", peak_velocity, "m/s")
        speed = (v / fastest) ** ((n - 2.0) / n) * (beta / m) ** (1.0 / n)
        scale = v / fastest / speed
    else:
        scale = (above(0.0, "peak_force", peak_force, "N") / beta) ** (1.0 / (n - 1.0)) / top
        speed = math.sqrt(beta / m * scale ** (n - 2.0))
    return SolitaryWave(
        speed=speed,
        peak_velocity=speed * scale * fastest,
        peak_force=beta * (scale * top) ** (n - 1.0),
        peak_overlap=scale * top,
        momentum=m * speed * scale * shape.momentum,
        energy=m * (speed * scale) ** 2 * (shape.kinetic + shape.potential),
        kinetic_to_potential=shape.kinetic / shape.potential,
        shift=scale * shape.momentum,
        width=shape.width,
        residual=shape.residual,
        uncertainty=shape.uncertainty,
        stiffness=beta,
        shape=shape,
    )


@functools.lru_cache(maxsize=64)
def wave_shape(exponent: float) -> WaveShape:
    """The wave for one exponent n > 2 at m = beta = c = 1, solved once and kept.

    >>> shape = wave_shape(3.0)
    >>> shape.residual < CONVERGED, f"{shape.kinetic / shape.potential:.12f}"
    (True, '1.500000000000')
    """
    n = above(2.0, "exponent", exponent, why="at n = 2 the chain is linear and disperses every pulse")
    # a Gaussian of width 1/sqrt(n - 2) near 2, a triangle of one grain for large n; 1e-16 of the peak at the edge
    length = 2.0 + 4.0 / math.sqrt(n - 2.0)
    points = 32
    while points < MOST_POINTS:
        points *= 2
        found = _solved(n, length, points)
        if found is not None:
            return found
    why = "the wave is too ill-conditioned as n -> 2" if n < 3.0 else f"its corner is too sharp for {points} points"
    raise ValueError(f"exponent = {exponent!r}: no converged solitary wave, {why}; allowed: 2.00001 to 50")


def _solved(n: float, length: float, points: int) -> WaveShape | None:
    """The fixed point on ``points`` intervals from the centre to ``length``; None where that is not enough."""
    import numpy as np
    from scipy.fft import dct

    p = n - 1.0
    wave_number = np.pi / length * np.arange(points + 1)
    box = np.sinc(wave_number / (2.0 * np.pi))  # Fourier transform of a grain's length; the tent's is its square
    weight = np.full(points + 1, 2.0 * length / points)  # trapezoidal rule over both halves: spectrally accurate
    weight[[0, -1]] *= 0.5

    def filtered(kernel: Floats, values: Floats) -> Floats:
        return np.asarray(dct(kernel * dct(values, type=1), type=1) / (2 * points))

    x = np.linspace(0.0, length, points + 1)
    r = np.exp(-3.0 * (n - 2.0) / p * x**2)
    for _ in range(100):  # Petviashvili: a power of the mismatch keeps the amplitude from running away
        image = np.maximum(filtered(box**2, r**p), 0.0)
        mismatch = (weight @ r**2) / (weight @ (r * image))
        before, r = r, mismatch ** (p / (p - 1.0)) * image
        if np.max(np.abs(r - before)) < 1e-2 * min(n - 2.0, 1.0) * r[0]:
            break
    tent = dct(box[:, None] ** 2 * dct(np.eye(points + 1), type=1, axis=0), type=1, axis=0) / (2 * points)
    correction = np.inf
    for _ in range(20):
        step = np.linalg.solve(np.eye(points + 1) - tent * (p * r ** (p - 1.0)), r - filtered(box**2, r**p))
        r = np.maximum(r - step, 0.0)
        last, correction = correction, float(np.max(np.abs(step)) / r[0])
        if correction >= 0.5 * last:  # round-off: it does not get better
            break
    force = r**p
    residual = float(np.max(np.abs(r - filtered(box**2, force))) / r[0])
    spectrum = np.abs(dct(force, type=1))
    cut = max(float(np.max(spectrum[-4:]) / spectrum[0]), float(r[-1] / r[0]))
    if not (residual < CONVERGED and cut < RESOLVED and correction < DETERMINED):
        return None
    velocity = filtered(box, force)
    return WaveShape(
        exponent=n,
        half_length=length,
        overlap=_coefficients(r),
        velocity=_coefficients(velocity),
        momentum=float(weight @ force),
        kinetic=float(weight @ velocity**2) / 2.0,
        potential=float(weight @ r**n) / n,
        residual=residual,
        uncertainty=correction,
    )


def _coefficients(values: Floats) -> Floats:
    """Cosine coefficients of grid values, read-only."""
    from scipy.fft import dct

    found = dct(values, type=1) / (len(values) - 1)
    found[[0, -1]] *= 0.5
    found.flags.writeable = False
    return found  # type: ignore[no-any-return]
