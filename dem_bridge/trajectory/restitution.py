"""The restitution of an impact of two bodies, or of a body and a wall, from the samples of its run.

Before it closes and after it opens, a contact is in free flight, whose motion is exact. The velocities where it closes
and opens follow from the start and from a sample of the flight after the impact, so they have the accuracy of the run,
not that of the sample spacing. This module knows arrays, and of a scene only what :func:`impact_facts` returns.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dem_bridge.errors import UsageError
from dem_bridge.scene.derived import derived

if TYPE_CHECKING:
    from dem_bridge.scene.scene import Scene

Floats = NDArray[np.float64]
#: speed of separation, relative to that of approach, that round-off gives to overdamped contacts, which never open
ROUND_OFF = 1e-14


@derived
def impact_facts(scene: Scene) -> dict[str, Any] | None:
    """Return what the restitution of a run depends on in addition to its samples, as JSON types.

    None if the scene has more than one contact, a drive, or a clipped contact whose law is a function.
    """
    c = scene.contacts
    clipped = scene.damped and c.clip
    if len(c.gap) != 1 or scene.drive is not None or (clipped and c.laws):
        return None
    spring = [float(values[0]) for values in (c.stiffness, c.exponent, c.damping, c.damping_power)]
    acceleration = np.append(scene.free_acceleration, 0.0)
    return {
        "bodies": [int(c.left[0]), int(c.right[0])],
        "gap": float(c.gap[0]),
        "acceleration": float(acceleration[c.left[0]] - acceleration[c.right[0]]),
        "drag": scene.drag,
        "clipped_spring": spring if clipped else None,
    }


@dataclass(frozen=True)
class _Flight:
    """A free flight: the overlap (m, negative: apart) and its rate (m/s) at times after a state."""

    overlap: float
    rate: float
    acceleration: float
    drag: float

    def rate_at(self, time: float) -> float:
        """Return the rate of the overlap."""
        return self.rate + (self.acceleration - self.drag * self.rate) * self._lag(time)

    def overlap_at(self, time: float) -> float:
        """Return the overlap."""
        lag = self._lag(time)
        fall = 0.5 * time**2 if self.drag == 0.0 else (time - lag) / self.drag
        return self.overlap + self.rate * lag + self.acceleration * fall

    def _lag(self, time: float) -> float:
        return time if self.drag == 0.0 else -math.expm1(-self.drag * time) / self.drag

    @property
    def turn(self) -> float:
        """Time at which the rate is zero; nan without one."""
        decay = self.acceleration - self.drag * self.rate
        if self.drag == 0.0:
            return -self.rate / decay if decay else math.nan
        share = self.acceleration / decay if decay else math.nan
        return math.log(1.0 / share) / self.drag if share > 0.0 else math.nan


def restitution(
    time: Floats, displacement: Floats, velocity: Floats, crossing_time: float, facts: Mapping[str, Any]
) -> float:
    """Return the speed of separation where the contact opens over the speed of approach where it closes.

    A contact opens where its force ends: at zero overlap, or before if its net force is clipped. Of several impacts it
    is the first. nan if the bodies never meet, never separate, or overlap at the start.

    Parameters
    ----------
    time, displacement, velocity : ndarray
        Samples of the run: ``(n_t,)`` and ``(n_t, n_body)``.
    crossing_time : float
        Time of the first maximal compression, s.
    facts : mapping
        Result of :func:`impact_facts`.

    Raises
    ------
    UsageError
        If no sample lies in the first flight after the impact.
    """
    if not math.isfinite(crossing_time) or facts["gap"] < 0.0:
        return math.nan
    left, right = facts["bodies"]
    at_rest = np.zeros((len(time), 1))
    x, v = (np.hstack([values, at_rest]) for values in (displacement, velocity))
    overlap, rate = x[:, left] - x[:, right] - facts["gap"], v[:, left] - v[:, right]
    free = {"acceleration": facts["acceleration"], "drag": facts["drag"]}
    start = _Flight(overlap[0], rate[0], **free)
    closing = _closing(start, crossing_time)
    approach = float(start.rate_at(closing))
    if not approach > 0.0:
        return math.nan
    spring = facts["clipped_spring"]
    open_again = overlap <= 0.0
    if spring is not None:
        open_again |= (rate < 0.0) & (_net_force(spring, overlap, rate) <= 0.0)
    after = np.flatnonzero(open_again & (time > crossing_time))
    pull, coarse = facts["acceleration"], bool(time[1] > crossing_time - closing)
    if len(after):
        first = int(after[0])
        flight = _Flight(overlap[first], rate[first], **free)
        opening = _opening(flight, crossing_time - time[first], spring)
        separation = -float(flight.rate_at(opening))
        if not separation > ROUND_OFF * approach:
            return math.nan
        # a later impact ends after the flight that follows the first one, which lasts longer than this
        if pull <= 0.0 or time[first] + opening - crossing_time < 2.0 * separation / pull:
            return separation / approach
    elif pull <= 0.0 or not coarse:
        return math.nan
    raise UsageError(
        f"the samples are {time[1] - time[0]:.3g} s apart, and none is in the first flight after the impact at"
        f" {crossing_time:.6g} s, so its restitution is unknown; solve the scene with more samples"
    )


def _net_force(spring: list[float], overlap: Floats | float, rate: Floats | float) -> Floats:
    """Return the net force over ``overlap**power``, with the sign of the net force of a closed contact."""
    stiffness, n, damping, power = spring
    return np.asarray(stiffness * np.maximum(overlap, 0.0) ** (n - 1.0 - power) + damping * rate)


def _closing(flight: _Flight, latest: float) -> float:
    """Return the time at which the contact closes, before the time ``latest``."""
    if flight.overlap == 0.0 and flight.rate > 0.0:
        return 0.0
    turn = flight.turn
    return _root(flight.overlap_at, turn if flight.rate <= 0.0 and turn > 0.0 else 0.0, latest)


def _opening(flight: _Flight, earliest: float, spring: list[float] | None) -> float:
    """Return the time, <= 0 and not before ``earliest``, at which the contact opened that is now in this flight."""
    turn = flight.turn
    latest = turn if flight.rate > 0.0 and turn < 0.0 else 0.0
    touch = _root(flight.overlap_at, earliest, latest) if flight.overlap_at(latest) < 0.0 else latest
    if spring is None:
        return touch

    def net_force(time: float) -> float:
        return float(_net_force(spring, flight.overlap_at(time), flight.rate_at(time)))

    return _root(net_force, earliest, touch)


def _root(function: Callable[[float], float], first: float, last: float) -> float:
    """Return the root between two times; the end with the smaller value if there is none."""
    from scipy.optimize import brentq

    ends = function(first), function(last)
    if not ends[0] * ends[1] < 0.0:
        return first if abs(ends[0]) < abs(ends[1]) else last
    return float(brentq(function, first, last, xtol=1e-15 * abs(last - first), rtol=4.0 * np.finfo(float).eps))
