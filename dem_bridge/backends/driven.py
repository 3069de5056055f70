"""The force on body 0, or its prescribed motion, in compiled kernels, operation by operation as in a deck's formula."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dem_bridge.foundation.compiled import kernel
from dem_bridge.scene.scene import Scene


class Moved(NamedTuple):
    """A :class:`~dem_bridge.scene.piston.Piston` as kernels take it."""

    moves: bool = False
    """Whether body 0 is moved."""
    speed: float = 0.0
    """Constant velocity, or amplitude of a sine, m/s."""
    turn: float = 0.0
    """rad/s of a sine; 0: the velocity is constant, or a table."""
    phase: float = 0.0
    """rad."""
    interval: float = 0.0
    """s, of a table."""
    values: NDArray[np.float64] = np.zeros(0)
    """Velocities of a table, m/s, the last one twice, for what lies beside it at the end. Empty: it is no table."""
    knots: NDArray[np.float64] = np.zeros(0)
    """Displacements at the times of these velocities, m."""


class Driven(NamedTuple):
    """A :class:`~dem_bridge.scene.drive.Drive` as kernels take it; of a wave all but the last two, of a table these."""

    amplitude: float = 0.0
    """N."""
    phase: float = 0.0
    """rad."""
    turn: float = 0.0
    """rad/s at time 0."""
    growth: float = 0.0
    """Half of what ``turn`` grows by in a second."""
    sweep: float = math.inf
    """s; until when it grows."""
    last_turn: float = 0.0
    """rad/s after that."""
    rise: float = 0.0
    """s."""
    interval: float = 0.0
    """s."""
    values: NDArray[np.float64] = np.zeros(0)
    """N; the last one twice, for what lies beside it at the end. Empty: a wave, or nothing."""
    piston: Moved = Moved()


def driven_of(scene: Scene) -> Driven:
    """Return the drive of body 0 as a tuple of numbers; its amplitude is 0 and it has no values without a force."""
    if (piston := scene.piston) is not None:
        values = np.array(piston.velocity if isinstance(piston.velocity, tuple) else ())
        knots = piston.knots
        if len(values):
            values = np.append(values, values[-1])
            knots = np.append(knots, knots[-1] + (piston.interval or 0.0) * values[-1])
        speed = 0.0 if isinstance(piston.velocity, tuple) else piston.velocity
        phase, interval = math.radians(piston.phase), piston.interval or 0.0
        return Driven(piston=Moved(True, speed, piston.turn, phase, interval, values, knots))
    if (drive := scene.driving_force) is None:
        return Driven()
    if drive.shape == "table":
        assert isinstance(drive.force, tuple)  # set when the drive was made
        assert drive.interval is not None
        return Driven(interval=drive.interval, values=np.array((*drive.force, drive.force[-1])))
    assert isinstance(drive.force, float)
    assert drive.frequency is not None
    first = 2.0 * math.pi * drive.frequency
    wave = Driven(amplitude=drive.force, phase=math.radians(drive.phase), turn=first, rise=drive.rise)
    if drive.shape == "sine":
        return wave
    assert drive.last_frequency is not None
    assert drive.sweep is not None
    last = 2.0 * math.pi * drive.last_frequency
    return wave._replace(growth=0.5 * (last - first) / drive.sweep, sweep=drive.sweep, last_turn=last)


def rate_of(scene: Scene) -> float:
    """Return the largest rate at which the force on body 0, or its prescribed velocity, changes, rad/s; 0 without."""
    return 0.0 if scene.drive is None else scene.drive.rate


@kernel(nogil=False)
def driving_force(time: float, driven: Driven) -> float:
    """N, at a time (s); scalar, for kernels."""
    if len(driven.values) > 0:
        place = time / driven.interval
        cell = np.floor(place)
        at = min(int(cell), len(driven.values) - 2)
        return float(driven.values[at] + (driven.values[at + 1] - driven.values[at]) * (place - cell))
    if driven.amplitude == 0.0:
        return 0.0
    grown = 1.0
    if driven.rise > 0.0:
        grown = np.sin(0.5 * np.pi / driven.rise * min(time, driven.rise)) ** 2
    until = min(time, driven.sweep)
    turned = (driven.turn + driven.growth * until) * until + driven.last_turn * (time - until)
    return float(driven.amplitude * grown * np.sin(turned + driven.phase))


@kernel(nogil=False)
def piston_motion(time: float, piston: Moved) -> tuple[float, float, float]:
    """Return displacement (m), velocity (m/s) and acceleration (m/s^2) of body 0 at a time (s); scalar, for kernels."""
    if len(piston.values) > 0:
        place = time / piston.interval
        cell = np.floor(place)
        at = min(int(cell), len(piston.values) - 2)
        part, low = place - at, piston.values[at]
        rise = piston.values[at + 1] - low
        way = piston.knots[at] + piston.interval * (low * part + 0.5 * rise * part * part)
        return float(way), float(low + rise * part), float(rise / piston.interval)
    if piston.turn == 0.0:
        return piston.speed * time, piston.speed, 0.0
    angle = piston.turn * time + piston.phase
    way = piston.speed / piston.turn * (np.cos(piston.phase) - np.cos(angle))
    return float(way), float(piston.speed * np.sin(angle)), float(piston.speed * piston.turn * np.cos(angle))
