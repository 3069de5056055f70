"""The solitary wave of a uniform chain, solved for the discrete chain without a continuum limit or time stepping.

Identical bodies that just touch, ``F = beta overlap^(n-1)`` with n > 2, carry one pulse of unchanging shape (existence:
Friesecke & Wattis 1994, *Commun. Math. Phys.* 161, 391). With overlap_k(t) = r(k - c t), c in grains per second,
Newton's law is equivalent to (English & Pego 2005, *Proc. AMS* 133, 1763)::

    m c^2 r = beta tent * r^(n-1),        tent(x) = max(1 - |x|, 0)

Amplitudes scale, so one profile per exponent, with m = beta = c = 1, serves all. It is positive, even, smooth and
decays faster than exponentially; a cosine series on a finite domain therefore converges to round-off with some tens of
points, and the convolution multiplies the series by sinc^2. A few of Petviashvili's normalised iterations (1976, *Sov.
J. Plasma Phys.* 2, 257), started from the Gaussian of the limit n -> 2 (James & Pelinovsky 2014, *Proc. R. Soc. A* 470,
20130462), lead to the region where Newton's method converges.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from dem_bridge.physics.numbers import above

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import ArrayLike, NDArray

    Floats = NDArray[np.float64]

#: the iteration has converged if both sides differ by less than this fraction of the largest overlap
CONVERGED = 1e-13
#: the last cosine coefficients and the overlap at the domain's edge must be below this fraction of the largest, or
#: below what round-off leaves there as n -> 2
RESOLVED = 1e-14
#: upper bound of Newton's last correction: as n -> 2 the error of the amplitude grows as eps/(n - 2)
DETERMINED = 1e-10
#: largest number of grid points on half the wave, sufficient up to n = 50
MOST_POINTS = 1024


@dataclass(frozen=True, eq=False)
class WaveShape:
    """The wave of one exponent at m = beta = c = 1.

    :func:`wave_shape` computes it.
    """

    exponent: float
    half_length: float
    """Half the length of the domain, grains; at its edge the wave is 1e-16 of the peak."""
    overlap: Floats
    """Cosine coefficients ``(n_point,)`` of the overlap: sum of a_j cos(pi j x / half_length)."""
    velocity: Floats
    """Cosine coefficients ``(n_point,)`` of the velocity."""
    momentum: float
    kinetic: float
    """Kinetic energy, averaged over the passage from grain to grain."""
    potential: float
    residual: float
    """Largest ``|r - tent * r^(n-1)|`` on the grid divided by the largest r."""
    uncertainty: float
    """Newton's last correction divided by the largest r: the error of the profile."""

    def series(self, coefficients: Floats, grains: ArrayLike) -> Floats:
        """Return a cosine series at distances ``grains`` from the centre, of any shape; 0 beyond the domain."""
        import numpy as np

        x = np.asarray(grains, dtype=float)
        waves = np.cos(np.pi / self.half_length * np.multiply.outer(x, np.arange(len(coefficients))))
        return np.where(np.abs(x) < self.half_length, waves @ coefficients, 0.0)

    @functools.cached_property
    def peaks(self) -> tuple[float, float]:
        """Largest overlap and largest velocity, at the centre, where every cosine is 1."""
        return math.fsum(self.overlap), math.fsum(self.velocity)

    @functools.cached_property
    def width(self) -> float:
        """Full width of the force at half its peak, grains."""
        from scipy.optimize import brentq

        half = self.peaks[0] * 0.5 ** (1.0 / (self.exponent - 1.0))  # the overlap there
        outside = 0.999 * self.half_length
        distance = brentq(lambda x: float(self.series(self.overlap, x)) - half, 0.0, outside, xtol=1e-14)
        return 2.0 * float(distance)


@dataclass(frozen=True, kw_only=True)
class SolitaryWave:
    """One pulse in a uniform chain.

    :func:`solitary_wave` computes it.
    """

    speed: float
    """Speed, grains per second; multiplied by the distance between centres it is in m/s."""
    peak_velocity: float
    """Peak velocity of each body, m/s."""
    peak_force: float
    """Peak force of each contact, N."""
    peak_overlap: float
    """Peak overlap of each contact, m."""
    momentum: float
    """Momentum of the whole pulse, kg m/s."""
    energy: float
    """Energy of the whole pulse, J, constant in time."""
    kinetic_to_potential: float
    """Mean kinetic energy divided by mean potential energy: n/2 by the virial theorem, here a result, not an input."""
    shift: float
    """Displacement of each body after the pulse has passed, momentum / (mass speed), m."""
    width: float
    """Distance between the points where the force is half its peak, grains; divided by ``speed`` it is a time."""
    residual: float
    """Residual of the fixed point divided by the largest overlap: at most 1e-13."""
    uncertainty: float
    """Error of the profile divided by its largest value."""
    stiffness: float = field(repr=False)
    shape: WaveShape = field(repr=False)

    def overlap(self, grains: ArrayLike) -> Floats:
        """Return the overlap of a contact at ``grains`` from the contact at its peak, m.

        The wave is even: a contact k that peaks at t_k has ``overlap(speed * (t - t_k))`` at time t. The absolute error
        is ``uncertainty`` times the peak, so far tails are lost in round-off; negative values there are set to zero.

        Parameters
        ----------
        grains : array_like
            Distances, grains, of any shape.
        """
        import numpy as np

        return np.maximum(self.peak_overlap * self.shape.series(self.shape.overlap, grains) / self.shape.peaks[0], 0.0)

    def force(self, grains: ArrayLike) -> Floats:
        """Return the force of a contact at ``grains`` from the contact at its peak, N."""
        return self.stiffness * self.overlap(grains) ** (self.shape.exponent - 1.0)

    def velocity(self, grains: ArrayLike) -> Floats:
        """Return the velocity of a body at ``grains`` from the body at its peak, m/s.

        Body k lies between contacts k-1 and k, and its peak is halfway between theirs: half a grain divided by
        ``speed`` before the peak of contact k.
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
    """Return the solitary wave of a uniform chain with a peak velocity or a peak force.

    It is valid for chains without gaps, precompression, walls or dissipation. For n = 5/2 the speed is
    0.907470078412 (beta/m)^(2/5) v^(1/5) grains per second.

    Parameters
    ----------
    mass : float
        Mass of each body, kg.
    stiffness : float
        Stiffness beta of each contact, N/m^(n-1).
    exponent : float
        Exponent n.
    peak_velocity : float, optional
        Peak velocity of each body, m/s.
    peak_force : float, optional
        Peak force of each contact, N. Give either this or ``peak_velocity``.

    Raises
    ------
    ValueError
        If n <= 2 (a linear chain disperses every pulse), if the wave does not converge (n below 2.00001 or above 50),
        or if another parameter is outside its range.

    References
    ----------
    English & Pego (2005), *Proc. AMS* 133, 1763; Friesecke & Wattis (1994), *Commun. Math. Phys.* 161, 391.

    Examples
    --------
    >>> wave = solitary_wave(mass=1.0, stiffness=1.0, exponent=2.5, peak_velocity=1.0)
    >>> f"{wave.speed:.12f} {wave.kinetic_to_potential:.12f} {wave.momentum:.10f} {wave.energy:.10f}"
    '0.907470078412 1.250000000000 1.6699712493 1.0693229458'
    >>> same = solitary_wave(mass=1.0, stiffness=1.0, exponent=2.5, peak_force=wave.peak_force)
    >>> f"{same.peak_velocity:.12f} {same.speed / same.peak_force ** (1 / 6):.12f}"
    '1.000000000000 0.905515776419'
    """
    m, beta = above(0.0, "mass", mass, "kg"), above(0.0, "stiffness", stiffness, "N/m^(n-1)")
    if (peak_velocity is None) == (peak_force is None):
        count = "neither is" if peak_force is None else "both are"
        raise ValueError(
            f"peak_velocity, peak_force: {count} given; allowed: exactly one, since it determines the other"
        )
    shape = wave_shape(exponent)
    n, (top, fastest) = shape.exponent, shape.peaks
    # overlaps scale with A, where m c^2 = beta A^(n-2); then forces scale with beta A^(n-1), velocities with c A
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


@dataclass(frozen=True, kw_only=True)
class LongWave:
    """The solitary wave of Nesterenko's long-wave theory at m = beta = 1, an approximation.

    :func:`long_wave` computes it.
    """

    speed_by_velocity: float
    """Speed over ``v_max^((n-2)/n)``, grains per second."""
    speed_by_force: float
    """Speed over ``F_max^((n-2)/(2 (n-1)))``, grains per second."""
    width: float
    """Full width of the force at half its peak, grains."""


def long_wave(exponent: float) -> LongWave:
    """Return the solitary wave of a uniform chain by Nesterenko's long-wave theory.

    With p = n - 1 and x in grains the overlap is ``A cos^(2/(p-1))(x (p-1) sqrt(6/(p (p+1))))``, the speed
    ``sqrt(2/(p+1)) A^((p-1)/2)`` and the peak velocity ``c A``. The theory supposes a wave that is long beside a grain;
    for n = 5/2 it is 1.41 grains wide. So the result is an approximation, and :func:`solitary_wave` says of what.

    Parameters
    ----------
    exponent : float
        Exponent n > 2.

    Raises
    ------
    ValueError
        If n <= 2.

    References
    ----------
    Nesterenko (2001), *Dynamics of Heterogeneous Materials*, ch. 1.

    Examples
    --------
    >>> theory, wave = long_wave(2.5), solitary_wave(mass=1.0, stiffness=1.0, exponent=2.5, peak_velocity=1.0)
    >>> f"{theory.speed_by_velocity / wave.speed - 1.0:+.4f} {theory.width / wave.width - 1.0:+.4f}"
    '+0.0079 +0.0560'
    """
    n = above(2.0, "exponent", exponent, why="at n = 2 the chain is linear and disperses every pulse")
    p = n - 1.0
    by_overlap = math.sqrt(2.0 / n)
    narrowing = (p - 1.0) * math.sqrt(6.0 / (p * n))
    return LongWave(
        speed_by_velocity=by_overlap ** (2.0 / n),
        speed_by_force=by_overlap,
        width=2.0 * math.acos(0.5 ** ((p - 1.0) / (2.0 * p))) / narrowing,
    )


@functools.lru_cache(maxsize=64)
def wave_shape(exponent: float) -> WaveShape:
    """Return the wave of one exponent n > 2 at m = beta = c = 1; each is solved once and cached.

    Examples
    --------
    >>> shape = wave_shape(3.0)
    >>> shape.residual < CONVERGED, f"{shape.kinetic / shape.potential:.12f}"
    (True, '1.500000000000')
    """
    n = above(2.0, "exponent", exponent, why="at n = 2 the chain is linear and disperses every pulse")
    # the wave is a Gaussian of width 1/sqrt(n - 2) near 2, a triangle of one grain for large n; 1e-16 of its peak
    # remains
    # at the edge
    length = 2.0 + 4.0 / math.sqrt(n - 2.0)
    points = 32
    while points < MOST_POINTS:
        points *= 2
        shape = _solved(n, length, points)
        if shape is not None:
            return shape
    why = "the wave is too ill-conditioned as n -> 2" if n < 3.0 else f"its corner is too sharp for {points} points"
    raise ValueError(f"exponent = {exponent!r}: no converged solitary wave, {why}; allowed: 2.00001 to 50")


def _solved(n: float, length: float, points: int) -> WaveShape | None:
    """Return the fixed point on ``points`` intervals from the centre to ``length``, or None if it is not resolved."""
    import numpy as np
    from scipy.fft import dct

    p = n - 1.0
    box, weight = grid(length, points)
    x = np.linspace(0.0, length, points + 1)
    r = np.exp(-3.0 * (n - 2.0) / p * x**2)
    for _ in range(100):  # Petviashvili: a power of the mismatch stabilises the amplitude
        image = np.maximum(filtered(box**2, r**p), 0.0)
        mismatch = (weight @ r**2) / (weight @ (r * image))
        before, r = r, mismatch ** (p / (p - 1.0)) * image
        if np.max(np.abs(r - before)) < 1e-2 * min(n - 2.0, 1.0) * r[0]:
            break
    tent = filtered(box**2, np.eye(points + 1))
    correction = np.inf
    for _ in range(20):
        step = np.linalg.solve(np.eye(points + 1) - tent * (p * r ** (p - 1.0)), r - filtered(box**2, r**p))
        r = np.maximum(r - step, 0.0)
        last, correction = correction, float(np.max(np.abs(step)) / r[0])
        if correction >= 0.5 * last:  # round-off is reached
            break
    force = r**p
    residual = float(np.max(np.abs(r - filtered(box**2, force))) / r[0])
    spectrum = np.abs(dct(force, type=1))
    cut = max(float(np.max(spectrum[-4:]) / spectrum[0]), float(r[-1] / r[0]))
    resolved = max(RESOLVED, 2.0**-52 / (n - 2.0))
    if not (residual < CONVERGED and cut < resolved and correction < DETERMINED):
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


def grid(length: float, points: int) -> tuple[Floats, Floats]:
    """Return the Fourier transform of a grain's length at the cosines of a grid, and the weights of its quadrature.

    The square of the transform is that of the tent. The weights are those of the trapezoidal rule over both halves,
    which is spectrally accurate.
    """
    import numpy as np

    weight = np.full(points + 1, 2.0 * length / points)
    weight[[0, -1]] *= 0.5
    wave_number = np.pi / length * np.arange(points + 1)
    return np.sinc(wave_number / (2.0 * np.pi)), weight


def filtered(kernel: Floats, values: Floats) -> Floats:
    """Return values on a grid (first axis), each cosine of them multiplied by its entry of ``kernel``."""
    from scipy.fft import dct

    product = (kernel * dct(values, type=1, axis=0).T).T
    result: Floats = dct(product, type=1, axis=0) / (2 * (len(kernel) - 1))
    return result


def _coefficients(values: Floats) -> Floats:
    """Return the cosine coefficients of grid values as a read-only array."""
    from scipy.fft import dct

    coefficients: Floats = dct(values, type=1) / (len(values) - 1)
    coefficients[[0, -1]] *= 0.5
    coefficients.flags.writeable = False
    return coefficients
