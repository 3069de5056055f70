"""Samples of the times in which forces act, so that a pulse does not pass between two samples of a long run."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dem_bridge.foundation.compiled import Ints
from dem_bridge.judging.model import Model
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import Floats

#: part of 1/omega of the stiffest contact between two frames, some 40 of which are in a contact, and the part above
#: which frames miss the largest error
_SPACING_OF_PERIOD, LARGEST_SPACING_OF_PERIOD = 0.1, 0.4
#: change of a velocity between two samples, relative to the largest velocity
_LARGEST_CHANGE_OF_VELOCITY = 0.02
#: frames times bodies of a dump that are read at most, and samples times bodies that are compared at most
_MOST_VALUES_READ, _MOST_VALUES_COMPARED = 2_000_000, 2_000_000
#: samples by which the part of a run is estimated in which forces act
_PROBES_OF_ACTIVITY = 4000


@dataclass(frozen=True, kw_only=True)
class Spacing:
    """Steps between two frames of the times in which forces act."""

    every: int
    resolves: bool
    """False if a run is so long that velocities change a lot between two frames."""


def spacing_of(scene: Scene | None, dt: float | None, steps: int, bodies: int, frequency: float) -> Spacing:
    """Return the steps between two frames of a run.

    Parameters
    ----------
    scene : Scene, optional
        Scene of the run; None if there is none that our code repeats: forces are then taken to act all the time.
    dt : float, optional
        Time step, s; None if the run has several.
    steps, bodies : int
        Number of steps and of bodies of the run.
    frequency : float
        Frequency of the stiffest contact, rad/s; 0 if it is not known.

    Examples
    --------
    >>> spacing_of(None, 1e-6, 1000, 10, 1e4), spacing_of(None, 1e-6, 10**7, 10, 1e4).resolves
    (Spacing(every=10, resolves=True), False)
    """
    known = dt is not None and frequency > 0.0
    every = max(1, int(_SPACING_OF_PERIOD / (frequency * dt) * (1.0 + 1e-9))) if known and dt is not None else 1
    frames = steps / every
    if frames * bodies > _MOST_VALUES_READ and scene is not None and dt is not None:
        frames *= _share_of_time(scene, dt, steps)
    fewer = max(1.0, frames * bodies / _MOST_VALUES_READ)
    thinned = int(np.ceil(every * fewer))
    resolves = fewer == 1.0 or (dt is not None and known and thinned * dt * frequency <= LARGEST_SPACING_OF_PERIOD)
    return Spacing(every=thinned, resolves=resolves)


def _share_of_time(scene: Scene, dt: float, steps: int) -> float:
    """Return the part of the steps of a run in which a contact is closed, by our code at probes of these steps."""
    model = Model(scene)
    probes = np.unique(np.linspace(0, steps, _PROBES_OF_ACTIVITY).astype(np.int64))
    with np.errstate(all="ignore"):
        force = model.stepped(model.system, probes, dt).force
    # one probe more than are seen: the estimate of a short part is not zero
    return min(1.0, (int(np.sum(np.any(force != 0.0, axis=1))) + 1) / len(probes))


def changing(velocity: Floats) -> Ints:
    """Return the rows between which a velocity changes by more than a small part of the largest; the last one, too.

    Examples
    --------
    >>> changing(np.array([[1.0], [1.0], [0.99], [0.97], [0.5], [0.5], [0.5]])).tolist()
    [0, 3, 4, 6]
    """
    most = max(2, _MOST_VALUES_COMPARED // velocity.shape[1])
    change = _LARGEST_CHANGE_OF_VELOCITY * float(np.max(np.abs(velocity), initial=0.0))
    while True:
        rows, last = [0], velocity[0]
        for row, values in enumerate(velocity):
            if np.abs(values - last).max() > change:
                rows.append(row)
                last = values
        if len(rows) <= most:
            return np.unique(np.array([*rows, len(velocity) - 1], dtype=np.int64))
        change *= 2.0
