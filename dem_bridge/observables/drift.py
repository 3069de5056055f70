"""Energy drift of a long run, and the bounded oscillation of velocity-Verlet's energy, which is no drift.

Velocity-Verlet does not conserve the energy H but, up to terms of fourth order in the step, a neighbour of it,

    H~ = H + dt^2 (v K v / 12 - F M^-1 F / 24),

with the tangent stiffness K and the net forces F (Hairer, Lubich & Wanner 2006, *Geometric Numerical Integration*, ch.
IX; 2003, *Acta Numerica* 12, 399). H oscillates about it with the motion; a drift is a change of H~. Hertz' law is
smooth except at touch, so H~ takes a small step of either sign with every impact: it is a random walk, and a slope
fitted to a random walk is never zero. The uncertainty of the drift includes that.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dem_bridge.errors import UsageError
from dem_bridge.observables.interpolate import acceleration, contact_motion
from dem_bridge.observables.modes import tangent_stiffness
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import Floats, Trajectory

#: number of blocks of a series: with fewer its uncertainty is not known, with more the means are not independent
BLOCKS = 20
#: probability with which the uncertainty covers the true slope
CONFIDENCE = 0.95


@dataclass(frozen=True, kw_only=True)
class Drift:
    """Hold the slope of a series in time, and its standard errors; :func:`drift_of` returns it."""

    slope: float
    """In the series' unit per second."""
    bar: float
    """Half width of the 95 % interval of the slope: the larger of those of a walk and of a swing."""
    walk: float
    """Standard error of the slope if the series walks at random: from the scatter of its steps from block to block."""
    swing: float
    """Standard error if it swings about a line: from the scatter of the blocks about that line."""
    duration: float
    """s."""

    @property
    def total(self) -> tuple[float, float]:
        """Return the drift of the series over the duration, and its uncertainty."""
        return self.slope * self.duration, self.bar * self.duration

    @property
    def found(self) -> bool:
        """Return whether the slope differs from zero by more than its uncertainty."""
        return abs(self.slope) > self.bar


def drift_of(time: Floats, series: Floats) -> Drift:
    """Return the slope of ``series (n_t,)`` over ``time`` (s, evenly spaced), by means over 20 blocks.

    The slope is that of a line through the means. Its uncertainty covers a random walk, for which the differences of
    the means are independent, and an oscillation, for which their distances from the line are. Raises UsageError for
    fewer than 40 samples.

    >>> time = np.linspace(0.0, 1.0, 2001)
    >>> swing = drift_of(time, 3e-6 * time + 1e-6 * np.sin(1000.0 * time))
    >>> f"{swing.slope:.2e}", swing.found, drift_of(time, np.sin(1000.0 * time)).found
    ('2.99e-06', True, False)
    """
    from scipy.stats import t as student

    if len(series) < 2 * BLOCKS:
        raise UsageError(f"{len(series)} samples of a series; allowed: at least {2 * BLOCKS}, for a drift with a bar")
    when, means = (
        np.array([np.mean(part) for part in np.array_split(values - values[0], BLOCKS)]) for values in (time, series)
    )
    middle = when - np.mean(when)
    slope = float(np.sum(middle * means) / np.sum(middle**2))
    away = means - np.mean(means) - slope * middle
    swing = float(np.sqrt(np.sum(away**2) / (BLOCKS - 2) / np.sum(middle**2)))
    steps = np.diff(means)
    # means over blocks of a walk differ by 2/3 of the variance that it gathers in a block, and the slope of a line
    # through a walk has 6/5 of the variance of (last - first)/duration
    walk = float(np.sqrt(1.2 * 1.5 * np.var(steps, ddof=1) * len(steps)) / (when[-1] - when[0]))
    factor = float(student.ppf(0.5 + 0.5 * CONFIDENCE, BLOCKS - 2))
    return Drift(slope=slope, bar=factor * max(walk, swing), walk=walk, swing=swing, duration=float(time[-1] - time[0]))


def swing_of(scene: Scene, run: Trajectory, dt: float) -> Floats:
    """Return ``H~ - H`` at each sample for the step ``dt`` (s), J, ``(n_t,)``: the energy's oscillation.

    Raises UnsupportedScene for n < 2.
    """
    overlap, closing = contact_motion(scene, run)
    stiffness = tangent_stiffness(scene, overlap)
    bent = np.sum(stiffness * closing**2, axis=1) / 12.0
    pushed = acceleration(scene, run) ** 2 @ np.array(scene.mass) / 24.0
    return np.asarray(dt**2 * (bent - pushed))
