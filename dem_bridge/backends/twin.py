"""The algorithmic twin's runs: velocity-Verlet in overlap variables, or in absolute positions, on given steps.

Forces that depend on velocities are evaluated as LAMMPS does, with the velocity of the half step: such runs are of
first order. Given :class:`~.splitting.Tables` it finds forces as LAMMPS' ``pair_style table`` does, with the same
errors; laws that are functions it has as :mod:`.curves`.
"""

from __future__ import annotations

import numpy as np

from dem_bridge.backends import splitting
from dem_bridge.backends.curves import CELLS
from dem_bridge.backends.splitting import EXACT, Method, Motion, Radius, Tables
from dem_bridge.backends.steps import Dense
from dem_bridge.scene.contacts import Contacts
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.dense import Schedule
from dem_bridge.trajectory.trajectory import Trajectory


class TWIN:
    """Name and equations of the twin."""

    name = "verlet"
    equations = "hertz"


#: half a kick, a drift, half a kick
VERLET = Method(drifts=np.array([1.0]), kicks=np.array([0.5, 0.5]))


def solve_plan(
    scene: Scene, plan: Schedule, radius: Radius = 0.0, tables: Tables = EXACT, cells: int = CELLS
) -> Trajectory:
    """Return one twin run on the given steps; ``cells``: of laws that are functions.

    ``radius`` (m) above 0: the run keeps absolute positions of bodies of this radius, or of these ``(n_contact + 1,)``
    along the line of bodies, walls included, and subtracts them. Only round-off differs, so the difference to the run
    with 0 is the round-off of such a code.
    """
    return splitting.solve(TWIN, VERLET, scene, plan, radius=radius, tables=tables, cells=cells, full=False)[0]


def solve_motion(scene: Scene, plan: Schedule, contacts: Contacts | None = None) -> Motion:
    """Return the motion of the twin on given steps, see :func:`~dem_bridge.backends.splitting.solve_motion`."""
    return splitting.solve_motion(TWIN, VERLET, scene, plan, contacts)


def solve_dense(scene: Scene, plan: Schedule, radius: Radius, tables: Tables = EXACT) -> tuple[Trajectory, Dense]:
    """Return one twin run and its dense samples, see :func:`solve_plan`."""
    return splitting.solve(TWIN, VERLET, scene, plan, radius=radius, tables=tables)
