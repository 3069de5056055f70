"""Velocity-Verlet in the precisions of LAMMPS' accelerator packages, for Hertz' contacts in absolute positions.

The modes differ in the numbers that are single precision (float32): in "force" the law of the contacts alone; in
"mixed" (packages GPU and INTEL) also the positions that are subtracted for it, while bodies move in double precision;
in "kokkos-mixed" all but the sum of the forces on a body; in "single" all. In "double" the kernel repeats the
positional twin bit for bit. It is a twin of these packages' arithmetic, not of their pair styles.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dem_bridge.backends.splitting import FUSED, line_of, places_of
from dem_bridge.errors import UnsupportedScene
from dem_bridge.foundation.compiled import interruptible, kernel
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.dense import Schedule

_WIDE, _NARROW = np.float64, np.float32
#: mode -> types of positions and velocities, of the positions that are subtracted, of the law, of the sum of forces
PRECISIONS: Mapping[str, tuple[Any, Any, Any, Any]] = {
    "double": (_WIDE, _WIDE, _WIDE, _WIDE),
    "force": (_WIDE, _WIDE, _NARROW, _WIDE),
    "mixed": (_WIDE, _NARROW, _NARROW, _WIDE),
    "kokkos-mixed": (_NARROW, _NARROW, _NARROW, _WIDE),
    "single": (_NARROW, _NARROW, _NARROW, _NARROW),
}


def velocities_in(precision: str, scene: Scene, plan: Schedule, radius: float) -> NDArray[np.float64]:
    """Return the velocities (m/s) at the samples of a plan, ``(n_t, n_body)``.

    Parameters
    ----------
    precision : str
        Key of :data:`PRECISIONS`.
    scene : Scene
        Scene of Hertz' contacts without damping, drag and drive.
    plan : Schedule
        Steps and samples.
    radius : float
        Radius of the bodies, m, which sets the size of the positions.

    Raises
    ------
    UnsupportedScene
        If the scene has anything else.
    """
    if reason := FUSED.unsupported_reason(scene):
        raise UnsupportedScene(f"precision of {scene.name}: {reason}")
    state, near, law, total = PRECISIONS[precision]
    c, n, (reach, start, wall) = scene.contacts, scene.n_body, places_of(scene, radius)
    first, line = int(scene.wall_left is None), line_of(scene)

    def bodies(values: Any, rest: float = 0.0, last: float = 0.0) -> NDArray[np.float64]:
        return np.concatenate([[rest], np.asarray(values, dtype=np.float64), [last]])

    def contacts(values: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.concatenate([np.zeros(first), values[line], np.zeros(n + 1 - first - len(line))])

    sides = (float(np.sum(wall[side])) for side in (c.left == n, c.right == n))
    return np.asarray(
        interruptible(
            _advance,
            bodies(start, *sides).astype(state),
            bodies(scene.velocity).astype(state),
            (plan.step / bodies(scene.mass, np.inf, np.inf)).astype(state),
            bodies(scene.steady_force).astype(total),
            contacts(c.stiffness).astype(law),
            contacts(reach).astype(near),
            np.zeros(n + 2, dtype=near),
            state(plan.step),
            state(0.5),
            plan.samples,
            plan.per_sample,
        )
    )


@kernel()
def _advance(
    place: Any, velocity: Any, rate: Any, weight: Any, stiffness: Any, reach: Any, near: Any, dt: Any, half: Any,
    samples: int, per_sample: int,
) -> Any:  # fmt: skip
    """Integrate by half a kick, a drift and half a kick; each array keeps its type, and arithmetic is in it."""
    n = len(place) - 2
    out = np.zeros((samples + 1, n))
    force, depth, net = np.zeros_like(stiffness), np.zeros_like(stiffness), np.zeros_like(weight)
    nothing = depth[0]
    for step in range(samples * per_sample + 1):
        for i in range(1, n + 1):
            if step > 0:
                velocity[i] += half * rate[i] * net[i]
                place[i] += dt * velocity[i]
        for i in range(n + 2):
            near[i] = place[i]
        for k in range(n + 1):
            depth[k] = reach[k] - (near[k + 1] - near[k])
            closed = max(depth[k], nothing)
            force[k] = stiffness[k] * closed * np.sqrt(closed)
        for i in range(1, n + 1):
            net[i] = weight[i]
            net[i] += force[i - 1]
            net[i] -= force[i]
            if step > 0:
                velocity[i] += half * rate[i] * net[i]
        if step % per_sample == 0:
            for i in range(n):
                out[step // per_sample, i] = velocity[i + 1]
    return out
