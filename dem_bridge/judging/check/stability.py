"""The largest time step at which velocity Verlet is stable on a chain as it is compressed."""

from __future__ import annotations

import math
from contextlib import suppress

import numpy as np

from dem_bridge.errors import UnsupportedScene
from dem_bridge.judging.model import Model
from dem_bridge.observables.modes import highest_mode
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import Floats

#: kinetic energy, relative to the largest of the reference, above which a run is unstable
_LARGEST_ENERGY_GAIN = 2.0
#: part of a step that is tried next, how many steps are tried, and how many in a row must be stable
_RATIO_OF_STEPS_TRIED, _MOST_STEPS_TRIED, _STABLE_IN_A_ROW = 0.95, 12, 2
#: samples times bodies of a run that are looked at, at most
_MOST_VALUES_KEPT = 1_000_000


def stability_limit(scene: Scene, displacement: Floats, velocity: Floats, end: float, frequency: float) -> float:
    """Return the largest time step, s, that is stable on a chain; nan if no contact closes.

    On a linear chain velocity Verlet is stable up to 2/omega of its highest mode, in which a body between two contacts
    has the stiffness of both. A chain of contacts that open and close may be unstable at steps that are a little
    shorter: from this limit on, steps are tried on our code until the kinetic energy does not grow.

    Parameters
    ----------
    scene : Scene
        The chain.
    displacement, velocity : ndarray
        Samples of the reference, m and m/s, ``(n_t, n_body)``, at which contacts are pressed the most.
    end : float
        Time, s, after which no force acts.
    frequency : float
        Highest frequency of a contact alone, or rate of a damping, rad/s.

    Examples
    --------
    >>> scene = Scene(name="pair", duration=1e-4, mass=(8e-3, 1e-2), stiffness=(4e9,), velocity=(0.8, 0.0))
    >>> still = np.zeros((1, 2))
    >>> f"{stability_limit(scene, still, still + 0.8, 1e-4, 1e5):.2g} s"
    '2e-05 s'
    """
    with suppress(UnsupportedScene):  # the frequency of the contacts alone is known
        frequency = max(frequency, highest_mode(scene, displacement))
    if not frequency > 0.0:
        return math.nan
    step = 2.0 / frequency
    if scene.law is not None:
        return step
    model, energy = Model(scene), float(np.max(velocity**2 @ np.array(scene.mass)))
    stable: list[float] = []
    for _ in range(_MOST_STEPS_TRIED):
        stable = [*stable, step] if _is_stable(model, step, end, _LARGEST_ENERGY_GAIN * energy) else []
        if len(stable) == _STABLE_IN_A_ROW:
            break
        step *= _RATIO_OF_STEPS_TRIED
    return stable[0] if stable else step


def _is_stable(model: Model, step: float, end: float, most: float) -> bool:
    """Return True if the kinetic energy of all bodies, times two, stays below ``most`` (J)."""
    count = max(1, math.ceil(end / step))
    mass = np.array(model.scene.mass)
    rows = np.unique(np.linspace(0, count, min(count, max(2, _MOST_VALUES_KEPT // len(mass))) + 1).astype(np.int64))
    with np.errstate(all="ignore"):
        energy = model.stepped(model.system, rows, step).velocity ** 2 @ mass
    return bool(np.all(energy <= most))
