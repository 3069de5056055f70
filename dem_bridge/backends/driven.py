"""The force on body 0 inside compiled kernels, operation by operation as LAMMPS has it in a deck's formula."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dem_bridge.foundation.compiled import kernel
from dem_bridge.scene.scene import Scene


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


def driven_of(scene: Scene) -> Driven:
    """Return the drive of body 0 as a tuple of numbers; its amplitude is 0 and it has no values where there is none."""
    drive = scene.drive
    if drive is None:
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
    """Return the largest rate at which the force on body 0 changes, rad/s; 0 where there is none."""
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
