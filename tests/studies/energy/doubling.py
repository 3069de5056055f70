"""Measure after how many contacts ode45 at its default tolerances has doubled the energy of three beads between walls.

``python -m tests.studies.energy.doubling`` prints the box of docs/theory/energy.md, and nine others: three gaps with
three random start velocities each. It takes half a minute.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from dem_bridge.backends.base import Resolution, backend
from dem_bridge.scene.scene import Scene, Wall
from dem_bridge.studies.energy_walk import BOX, STIFFNESS, long_run

#: gaps in m, starts with each, and contacts after which a run is given up
GAPS, STARTS, MOST = (2e-5, 5e-5, 2e-4), 3, 6000


def boxes(seed: int = 1) -> Iterator[tuple[str, Scene]]:
    """Yield the box of the study and others, by their names."""
    yield "box of the study", BOX
    chance = np.random.default_rng(seed)
    for gap in GAPS:
        wall = Wall(stiffness=STIFFNESS, gap=gap)
        for start in range(STARTS):
            velocity = tuple(chance.uniform(-0.8, 0.8, 3).tolist())
            scene = replace(BOX, gap=(gap, gap), velocity=velocity, wall_left=wall, wall_right=wall)
            yield f"gap {1e6 * gap:.0f} um, start {start}", scene


def contacts_to_double(scene: Scene) -> tuple[int, float]:
    """Return the number of contacts at the end of a run, and its relative change of energy, which ends it at 1."""
    walk = long_run(backend("ode45"), scene, Resolution(), MOST)
    return int(walk.contacts[-1]), float(walk.error[-1])


if __name__ == "__main__":
    for name, scene in boxes():
        contacts, change = contacts_to_double(scene)
        print(f"{name}: {contacts} contacts, energy {100.0 * change:+.1f} %", flush=True)
