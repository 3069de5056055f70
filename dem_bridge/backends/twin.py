"""The kernel of the twin: velocity-Verlet in overlap variables, or in absolute positions, on given steps.

Forces that depend on velocities are evaluated as LAMMPS does, with the velocity of the half step: such runs are of
first order. Given :class:`Tables` it finds forces as LAMMPS' ``pair_style table`` does, with the same errors; laws that
are functions it has as :mod:`.curves`.
"""

from __future__ import annotations

import time
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from dem_bridge.backends.base import Identity
from dem_bridge.backends.curves import CELLS, curve_force, curves_of
from dem_bridge.backends.steps import Dense, read_off
from dem_bridge.compiled import interruptible
from dem_bridge.dense import Schedule
from dem_bridge.lmp.cell import pair_force
from dem_bridge.scene import Scene
from dem_bridge.trajectory import Trajectory

TWIN = Identity(name="verlet", equations="hertz")


class Tables(NamedTuple):
    """Interpolated laws of contacts, for the kernel. Damped contacts with a table may pull: LAMMPS adds the damping
    beside the table, where no sum can be clipped."""

    diameter: float
    """m, of the bodies that the tables are for."""
    law: NDArray[np.int64]
    """Row below for each contact; -1: the law itself. Empty: all have the law itself."""
    frame: NDArray[np.float64]
    """``(n_law, 4)``: the numbers that :func:`~dem_bridge.lmp.cell.pair_force` takes."""
    value: NDArray[np.float64]
    second: NDArray[np.float64]


#: contacts evaluate their law itself
EXACT = Tables(0.0, np.zeros(0, dtype=np.int64), np.zeros((0, 4)), np.zeros((0, 0)), np.zeros((0, 0)))


def solve_plan(
    scene: Scene,
    plan: Schedule,
    radius: float | NDArray[np.float64] = 0.0,
    tables: Tables = EXACT,
    cells: int = CELLS,
) -> Trajectory:
    """One twin run on the given steps, without bars. ``cells``: of laws that are functions.

    ``radius`` (m) above 0: as a code does that keeps absolute positions of bodies of this radius, or of these
    ``(n_contact + 1,)`` along the line of bodies, walls included, and subtracts them. Nothing but round-off differs, so
    the difference to the run with 0 is the round-off of such a code.
    """
    return solve_dense(scene, plan, radius, tables, cells)[0]


def solve_dense(
    scene: Scene,
    plan: Schedule,
    radius: float | NDArray[np.float64],
    tables: Tables = EXACT,
    cells: int = CELLS,
) -> tuple[Trajectory, Dense]:
    """As :func:`solve_plan`, with all that was looked at between the samples."""
    began = time.perf_counter(), time.process_time()
    settings: dict[str, float] = {"dt": plan.step, "samples": plan.samples}
    if not isinstance(radius, np.ndarray) and radius > 0.0:
        settings["gauge_radius"] = radius
    if len(tables.law):
        settings["table_points"] = tables.value.shape[1]
    c = scene.contacts
    v, x, a, overlap, force = interruptible(
        integrate,
        np.array(scene.mass),
        np.array(scene.velocity),
        c.left,
        c.right,
        len(scene.stiffness),
        c.stiffness,
        c.exponent,
        c.gap,
        c.damping,
        c.damping_power,
        scene.drag,
        scene.gravity,
        scene.load,
        plan.step,
        plan.dense_steps,
        *_frame(scene, radius),
        tables,
        curves_of(scene, cells),
    )
    dense = Dense(velocity=v, displacement=x, acceleration=a, overlap=overlap, force=force)
    return read_off(TWIN, scene, plan, dense, settings, began=began, evaluations=plan.steps + 1), dense


def _frame(
    scene: Scene, radius: float | NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Distance at touch of each contact, start positions of the bodies and position of the wall of each contact, m."""
    c, links = scene.contacts, len(scene.stiffness)
    first = int(scene.wall_left is not None)

    def along(values: NDArray[Any]) -> NDArray[Any]:
        """From the order of the contacts to that of the line: the left wall's first."""
        return np.concatenate([values[links : links + first], values[:links], values[links + first :]])

    if isinstance(radius, np.ndarray):
        reach = radius[:-1] + radius[1:]
        line = np.concatenate([[0.0], np.cumsum(reach + along(c.gap))])
        line -= line[first]
        reach = np.concatenate([reach[first : first + links], reach[:first], reach[first + links :]])
    else:
        reach = np.full(scene.n_contact, 2.0 * radius)
        gaps = np.concatenate([[0.0], np.cumsum(along(c.gap), dtype=np.longdouble)])
        gaps -= gaps[first]
        line = 2.0 * radius * (np.arange(scene.n_contact + 1) - first)
        # all on the grid of the farthest, so that bodies in touch are so to the last digit
        grid = np.spacing(np.max(np.abs(line + gaps)).astype(float))
        line = line + (np.rint(gaps / grid) * grid).astype(float)
    start = line[first : first + scene.n_body]
    wall = np.where(c.left == scene.n_body, line[0], line[-1])
    return reach, start, wall


@njit(cache=True, nogil=True)
def integrate(  # type: ignore[no-untyped-def]
    mass,
    velocity,
    left,
    right,
    links,
    stiffness,
    exponent,
    gap,
    damping,
    damping_power,
    drag,
    gravity,
    load,
    dt,
    dense_steps,
    reach,
    start,
    wall,
    tables,
    curves,
):
    """Velocity, displacement, acceleration ``(n_dense, n_body + 1)`` (last column: the walls, 0), overlap and force
    ``(n_dense, n_contact)`` at ``dense_steps``. The first ``links`` contacts are those of the chain; ``load (n_body,)``
    is the constant force on each body beside its weight, N.

    With n = 5/2 the force is ``beta s sqrt(s)``: only exact powers of two appear when v0 -> 32 v0 and
    dt -> dt/2, so such runs repeat bit for bit.
    """
    n_body, n_contact, n_dense = mass.shape[0], left.shape[0], dense_steps.shape[0]
    tabled, curved = tables.law.shape[0] > 0, curves.law.shape[0] > 0
    hertz, damped = np.all(exponent == 2.5), np.any(damping > 0.0)
    positional = np.any(reach > 0.0)
    v = np.zeros(n_body + 1)
    v[:n_body] = velocity
    x = np.zeros(n_body + 1)
    force = np.zeros(n_contact)
    net = np.zeros(n_body + 1)
    kick = np.zeros(n_body + 1)
    kick[:n_body] = 0.5 * dt / mass
    weight = np.zeros(n_body + 1)
    weight[:n_body] = mass * gravity + load
    overlap = -gap
    position = start.copy()
    out_v = np.zeros((n_dense, n_body + 1))
    out_x = np.zeros((n_dense, n_body + 1))
    out_a = np.zeros((n_dense, n_body + 1))
    out_overlap = np.zeros((n_dense, n_contact))
    out_force = np.zeros((n_dense, n_contact))
    step = 0
    for row in range(n_dense):
        while step <= dense_steps[row]:
            if step > 0:
                for i in range(n_body):
                    v[i] += kick[i] * net[i]
                    x[i] += dt * v[i]
                if not positional:
                    for k in range(links):
                        overlap[k] += dt * (v[k] - v[k + 1])
                    for k in range(links, n_contact):
                        overlap[k] += dt * (v[left[k]] - v[right[k]])
                else:
                    for i in range(n_body):
                        position[i] += dt * v[i]
                        x[i] = position[i] - start[i]
            if positional:
                # at the start too: there gaps are as rounded positions have them
                for k in range(links):
                    overlap[k] = reach[k] - (position[k + 1] - position[k])
                for k in range(links, n_contact):
                    if left[k] == n_body:
                        overlap[k] = reach[k] - (position[right[k]] - wall[k])
                    else:
                        overlap[k] = reach[k] - (wall[k] - position[left[k]])
            if tabled:
                for k in range(n_contact):
                    row_of = tables.law[k]
                    closed = max(overlap[k], 0.0)
                    if closed == 0.0:
                        force[k] = 0.0
                    elif row_of < 0 and curved:
                        force[k] = curve_force(k, closed, curves)
                    elif row_of < 0:
                        force[k] = stiffness[k] * closed ** (exponent[k] - 1.0)
                    else:
                        r = tables.diameter - closed
                        frame = tables.frame[row_of]
                        # beyond the table LAMMPS stops; a coarse twin beside it goes on with its innermost force
                        squared = max(r * r, frame[0])
                        value, second = tables.value[row_of], tables.second[row_of]
                        force[k] = r * pair_force(squared, frame[0], frame[1], frame[2], frame[3], value, second)
            elif curved:
                for k in range(n_contact):
                    force[k] = curve_force(k, overlap[k], curves) if overlap[k] > 0.0 else 0.0
            elif hertz:
                for k in range(n_contact):
                    closed = max(overlap[k], 0.0)
                    force[k] = stiffness[k] * closed * np.sqrt(closed)
            else:
                for k in range(n_contact):
                    closed = max(overlap[k], 0.0)
                    force[k] = stiffness[k] * closed ** (exponent[k] - 1.0)
            if damped:
                # v is that of the half step here
                for k in range(n_contact):
                    if overlap[k] > 0.0 and damping[k] > 0.0:
                        rate = v[left[k]] - v[right[k]]
                        force[k] += damping[k] * overlap[k] ** damping_power[k] * rate
                        if not tabled or tables.law[k] < 0:
                            force[k] = max(force[k], 0.0)
            for i in range(n_body):
                net[i] = weight[i]
            if drag > 0.0:
                for i in range(n_body):
                    net[i] -= drag * mass[i] * v[i]
            for k in range(links):
                net[k] -= force[k]
                net[k + 1] += force[k]
            for k in range(links, n_contact):
                net[left[k]] -= force[k]
                net[right[k]] += force[k]
            if step > 0:
                for i in range(n_body):
                    v[i] += kick[i] * net[i]
            step += 1
        out_v[row] = v
        out_x[row] = x
        out_overlap[row] = overlap
        out_force[row] = force
        for i in range(n_body):
            out_a[row, i] = net[i] / mass[i]
    return out_v, out_x, out_a, out_overlap, out_force
