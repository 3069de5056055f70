"""The prescan of any scene: of laws that are functions it is a run of the twin. The latest of a process are kept."""

from __future__ import annotations

import threading
from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray

from dem_bridge.backends.driven import rate_of
from dem_bridge.backends.prescan import Prescan, prescan_hertz
from dem_bridge.backends.twin import solve_dense
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.dense import schedule

#: prescans of contacts without laws of their own, by the content hash of their scene: the latest of this process
PRESCANS: dict[str, Prescan] = {}
_MOST_PRESCANS = 256
#: fraction of 1/omega that is the step of a coarse run
_STEP = 0.1
_LOCK = threading.Lock()


def prescan_scene(scene: Scene, load: Callable[[Callable[[], Prescan]], Prescan] | None = None) -> Prescan:
    """:func:`~dem_bridge.backends.prescan.prescan_hertz` of a scene whose contacts may have laws of their own.

    There the coarse run is one of the twin. It steps by the stiffest contact that the energy at hand could make;
    the frequency is that of the overlaps it finds. ``load`` returns a prescan that is kept elsewhere, or what its
    argument makes; it is not asked for contacts with laws, nor for a prescan that this process has had.
    """
    c = scene.contacts
    if scene.law is None:
        with _LOCK:  # a run and its twins need it at the same time
            if scene.content_hash not in PRESCANS:
                make = partial(prescan_hertz, scene)
                PRESCANS[scene.content_hash] = make() if load is None else load(make)
                while len(PRESCANS) > _MOST_PRESCANS:
                    del PRESCANS[next(iter(PRESCANS))]
            return PRESCANS[scene.content_hash]
    if (top := _frequency(scene, c.reach[c.law])) == 0.0:
        return prescan_hertz(scene)
    plan = schedule(duration=scene.duration, samples=1, dt=_STEP / top, frequency=top, bodies=scene.n_body)
    _, dense = solve_dense(scene, plan, 0.0)
    peak = np.max(dense.overlap, axis=0, initial=0.0)
    return Prescan(
        peak_overlap=peak,
        frequency=_frequency(scene, peak),
        max_acceleration=float(np.max(np.abs(dense.acceleration))),
        lowest=float(np.min(dense.displacement)),
        highest=float(np.max(dense.displacement)),
        steps=plan.steps,
    )


def _frequency(scene: Scene, deepest: NDArray[np.float64]) -> float:
    """Highest angular frequency, or rate, of contacts (rad/s) with overlaps up to ``deepest`` (m), ``(n_contact,)``."""
    c, inverse_mass = scene.contacts, scene.mobility
    mobility = inverse_mass[c.left] + inverse_mass[c.right]
    touched = np.flatnonzero(deepest > 0.0)
    # 256 chords: a law can be steepest anywhere
    overlap = np.linspace(0.0, deepest[touched], 257)
    slope = np.max(np.diff(c.force(overlap, touched), axis=0) / np.diff(overlap, axis=0), axis=0)
    damped = np.max(c.damping[touched] * mobility[touched], initial=max(scene.drag, rate_of(scene)))
    return max(float(np.max(np.sqrt(slope * mobility[touched]), initial=0.0)), float(damped))
