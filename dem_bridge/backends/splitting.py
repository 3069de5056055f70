"""Runs of splitting methods, kicks and drifts in turn: velocity-Verlet, and what has more of both in a step.

The plain kernel :func:`integrate` has everything: any law, tables, damping, drag, a drive or a piston, overlaps
or positions. Where all is Hertz's law alone :mod:`.fused` does the same bit for bit, several times sooner.
"""

from __future__ import annotations

from collections.abc import Mapping
from operator import call
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dem_bridge.backends.base import Named
from dem_bridge.backends.curves import CELLS, Curves, curve_force, curves_of
from dem_bridge.backends.driven import Driven, driven_of, driving_force, piston_motion
from dem_bridge.backends.fused import PADDING, advance
from dem_bridge.backends.scales import resting_acceleration
from dem_bridge.backends.steps import Dense, check_finite, read_off, touching_in_flight
from dem_bridge.foundation.compiled import Floats, Ints, interruptible, kernel
from dem_bridge.foundation.stopwatch import Stopwatch
from dem_bridge.lmp.table_cell import pair_force
from dem_bridge.scene import features
from dem_bridge.scene.contacts import Contacts
from dem_bridge.scene.scene import Scene
from dem_bridge.scene.support import Support
from dem_bridge.trajectory.dense import Schedule, Turns, at_turns
from dem_bridge.trajectory.trajectory import Trajectory

#: radius of the bodies, m, or that of each along their line, walls included
Radius = float | NDArray[np.float64]


class Method(NamedTuple):
    """A splitting method: parts of the step by which bodies are kicked before, between and after they drift.

    Both are the same backwards. The last kick has the force of the end of the step, where the next one begins: there
    is one evaluation of the forces for each drift.
    """

    drifts: NDArray[np.float64]
    kicks: NDArray[np.float64]


class Tables(NamedTuple):
    """Interpolated laws of contacts, for the kernel.

    Damped contacts with a table may become tensile: LAMMPS adds the damping to the table, and no sum can be clipped.
    """

    diameter: float
    """m, of the bodies that the tables are for."""
    law: NDArray[np.int64]
    """Row below for each contact; -1: the law itself. Empty: all have the law itself."""
    frame: NDArray[np.float64]
    """``(n_law, 4)``: the numbers that :func:`~dem_bridge.lmp.table_cell.pair_force` takes."""
    value: NDArray[np.float64]
    second: NDArray[np.float64]


#: contacts evaluate their law itself
EXACT = Tables(0.0, np.zeros(0, dtype=np.int64), np.zeros((0, 4)), np.zeros((0, 0)), np.zeros((0, 0)))


#: steps times bodies of a run that ends within a few ms, before anybody misses Ctrl-C
_SHORT = 1_000_000
#: what the fast kernel can do
FUSED = Support(
    {features.WALLS, features.GAPS, features.INITIAL_OVERLAPS, features.SEVERAL_MOVING}
    | {features.GRAVITY, features.PRECOMPRESSION}
)


def solve(
    code: Named,
    method: Method,
    scene: Scene,
    plan: Schedule,
    *,
    radius: Radius = 0.0,
    tables: Tables = EXACT,
    cells: int = CELLS,
    full: bool = True,
) -> tuple[Trajectory, Dense]:
    """Return a run on given steps and its dense samples.

    ``radius`` (m): as :func:`~dem_bridge.backends.twin.solve_plan` has it; ``cells``: of laws that are functions. If
    not ``full``, only the samples are kept where that is enough, and the second result is those.
    """
    watch = Stopwatch()
    settings: dict[str, float] = {"dt": plan.step, "samples": plan.samples}
    if not isinstance(radius, np.ndarray) and radius > 0.0:
        settings["surrogate_radius"] = radius
    if len(tables.law):
        settings["table_points"] = tables.value.shape[1]
    costs: Mapping[str, Any] = {"watch": watch, "evaluations": len(method.drifts) * plan.steps + 1}
    if len(tables.law) == 0 and FUSED.covers(scene):
        dense, farthest, largest, turns = run_kernel(method, scene, scene.contacts, plan, radius, full)

        def peaks() -> tuple[Floats, Floats]:
            return at_turns(turns, largest, exponent=scene.contacts.exponent, resolution=touching_in_flight(farthest))

        return read_off(code, scene, plan, dense, settings, peaks=peaks, **costs), dense
    dense = _stepped(method, scene, scene.contacts, plan, radius, tables, cells)
    return read_off(code, scene, plan, dense, settings, **costs), dense


class Motion(NamedTuple):
    """The motion of a scene at the samples of a schedule: a solve without peaks, cost and provenance."""

    time: Floats
    """s, ``(n_t,)``."""
    displacement: Floats
    """m, ``(n_t, n_body)``; velocity (m/s) likewise."""
    velocity: Floats


def solve_motion(code: Named, method: Method, scene: Scene, plan: Schedule, contacts: Contacts | None = None) -> Motion:
    """Return the motion at the samples of a schedule, bit for bit that of :func:`solve`, for searches of many solves.

    ``contacts``: those of the scene with other gaps (None: its own); the duration is that of the schedule. Raises
    RunBroken where velocities are not finite.
    """
    c = scene.contacts if contacts is None else contacts
    if FUSED.covers(scene):
        dense = run_kernel(method, scene, c, plan, 0.0, full=False)[0]
    else:
        dense = _stepped(method, scene, c, plan, 0.0, EXACT, CELLS)
    check_finite(code, scene, plan, dense.velocity)
    keep = slice(None, None, (len(dense.velocity) - 1) // plan.samples)
    time = np.linspace(0.0, plan.steps * plan.step, plan.samples + 1)
    return Motion(time, dense.displacement[keep, :-1], dense.velocity[keep, :-1])


def _stepped(
    method: Method, scene: Scene, c: Contacts, plan: Schedule, radius: Radius, tables: Tables, cells: int
) -> Dense:
    """Run the plain kernel, and return its dense samples."""
    arrays = interruptible(
        integrate,
        np.array(scene.mass),
        np.array(scene.velocity),
        Laws(c.left, c.right, c.stiffness, c.exponent, c.gap, c.damping, c.damping_power, c.clip, c.pull_off),
        len(scene.stiffness),
        scene.drag,
        scene.gravity,
        scene.load,
        driven_of(scene),
        method,
        plan.step,
        plan.dense_steps,
        places_of(scene, radius),
        tables,
        curves_of(scene, cells),
    )
    return Dense(*arrays)


def run_kernel(
    method: Method, scene: Scene, c: Contacts, plan: Schedule, radius: Radius, full: bool
) -> tuple[Dense, float, NDArray[np.float64], Turns]:
    """Run the fast kernel, and return its results in the order of the scene.

    They are the kept samples, the farthest displacement (m), the largest force of each contact at the dense samples (N)
    and the turns.
    """
    n = scene.n_body
    line = line_of(scene)
    first, last = int(scene.wall_left is None), n + int(scene.wall_right is not None)

    def bodies(values: Any, rest: float = 0.0) -> NDArray[np.float64]:
        return np.concatenate([[rest], np.asarray(values, dtype=np.float64), np.full(1 + PADDING, rest)])

    def along(values: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.concatenate([np.zeros(first), values[line], np.zeros(n + 2 + PADDING - last)])

    reach, start = np.zeros(n + 2 + PADDING), np.zeros(n + 2 + PADDING)
    positional = bool(np.any(np.asarray(radius) > 0.0))
    if positional:
        distance, places, wall = places_of(scene, radius)
        reach, start = along(distance), bodies(places)
        # the walls' own: where there is none nothing is pressed
        start[0], start[n + 1 :] = (np.sum(wall[side]) for side in (c.left == n, c.right == n))
    # a thread takes 0.1 ms to start, as long as the solves of a search take
    run = interruptible if plan.steps * n > _SHORT else call
    kept, top, farthest, where, sides = run(
        advance,
        n,
        first,
        last,
        bodies(scene.mass, np.inf),
        bodies(scene.velocity),
        bodies(scene.steady_force),
        along(c.stiffness),
        along(0.0 - c.gap),
        positional,
        reach,
        start,
        *method,
        plan.step,
        plan.dense_steps,
        1 if full else plan.subdivisions,
        full,
        along(resting_acceleration(scene)),
    )
    times = plan.dense_steps * plan.step
    before, after = times[where[:, 0] - 1], times[where[:, 0]]
    largest = np.empty(scene.n_contact)
    largest[line] = top[first:last]
    turns = Turns(line[where[:, 1] - first], before, after - before, *sides.reshape(-1, 2, 4).transpose(2, 1, 0))
    return Dense(*kept), farthest, largest, turns


def line_of(scene: Scene) -> NDArray[np.int64]:
    """Return the contact of the scene at each place of the line, a left wall's first."""
    c, every = scene.contacts, np.arange(scene.n_contact)
    return np.argsort(np.where(c.left == scene.n_body, -1, every), kind="stable")


class Frame(NamedTuple):
    """Where the contacts of a scene are if bodies have positions; all are 0 without a radius."""

    reach: Floats
    """Distance at touch of each contact, m."""
    start: Floats
    """Positions of the bodies at the start, m."""
    wall: Floats
    """Position of the wall of each contact, m."""


def places_of(scene: Scene, radius: Radius) -> Frame:
    """Return the distances at touch, the start positions of the bodies and the positions of the walls."""
    c, links = scene.contacts, len(scene.stiffness)
    first, gap = int(scene.wall_left is not None), c.gap[line_of(scene)]
    if isinstance(radius, np.ndarray):
        reach = radius[:-1] + radius[1:]
        line = np.concatenate([[0.0], np.cumsum(reach + gap)])
        line -= line[first]
        reach = np.concatenate([reach[first : first + links], reach[:first], reach[first + links :]])
    else:
        reach = np.full(scene.n_contact, 2.0 * radius)
        gaps = np.concatenate([[0.0], np.cumsum(gap, dtype=np.longdouble)])
        gaps -= gaps[first]
        line = 2.0 * radius * (np.arange(scene.n_contact + 1) - first)
        # all on the grid of the farthest, so that bodies in touch are so to the last digit
        grid = np.spacing(np.max(np.abs(line + gaps)).astype(float))
        line = line + (np.rint(gaps / grid) * grid).astype(float)
    start = line[first : first + scene.n_body]
    wall = np.where(c.left == scene.n_body, line[0], line[-1])
    return Frame(reach, start, wall)


class Laws(NamedTuple):
    """The arrays of a scene's contacts that the kernel needs; see :class:`~dem_bridge.scene.contacts.Contacts`."""

    left: Ints
    right: Ints
    stiffness: Floats
    exponent: Floats
    gap: Floats
    damping: Floats
    damping_power: Floats
    clip: bool
    pull_off: Floats


@kernel(nogil=False)
def table_force(row: int, overlap: float, tables: Tables) -> float:
    """Force, N, at an overlap > 0 by one of the tables; scalar, for kernels."""
    r = tables.diameter - overlap
    cells = tables.frame[row]
    # beyond the table LAMMPS stops; a coarse twin beside it goes on with its innermost force
    squared = max(r * r, cells[0])
    return r * pair_force(squared, cells[0], cells[1], cells[2], cells[3], tables.value[row], tables.second[row])


@kernel(nogil=False)
def overlaps_of_positions(position: Floats, frame: Frame, contacts: Laws, links: int, overlap: Floats) -> None:
    """Write the overlap of each contact, as positions that are rounded have it."""
    walls = position.shape[0]
    for k in range(links):
        overlap[k] = frame.reach[k] - (position[k + 1] - position[k])
    for k in range(links, overlap.shape[0]):
        if contacts.left[k] == walls:
            overlap[k] = frame.reach[k] - (position[contacts.right[k]] - frame.wall[k])
        else:
            overlap[k] = frame.reach[k] - (frame.wall[k] - position[contacts.left[k]])


@kernel(nogil=False)
def add_contact_forces(force: Floats, contacts: Laws, links: int, net: Floats) -> None:
    """Add contact forces to the net forces of bodies from the left to the right, that of a left wall first."""
    walls = net.shape[0] - 1
    for k in range(links, force.shape[0]):
        if contacts.left[k] == walls:
            net[contacts.right[k]] += force[k]
    for k in range(links):
        net[k] -= force[k]
        net[k + 1] += force[k]
    for k in range(links, force.shape[0]):
        if contacts.right[k] == walls:
            net[contacts.left[k]] -= force[k]


@kernel()
def integrate(
    mass: Floats, velocity: Floats, contacts: Laws, links: int, drag: float, gravity: float, load: Floats,
    driven: Driven, method: Method, dt: float, dense_steps: Ints, frame: Frame, tables: Tables, curves: Curves,
) -> tuple[Floats, Floats, Floats, Floats, Floats]:  # fmt: skip
    """Integrate a scene by the kicks and drifts of a :class:`Method`.

    The results are velocity, displacement, acceleration ``(n_dense, n_body + 1)`` (last column: the walls, 0), overlap
    and force ``(n_dense, n_contact)`` at ``dense_steps``. The first ``links`` of the contacts are those of the chain;
    ``load (n_body,)``: the constant force on each body beside its weight, N; ``driven``: the drive of body 0.

    With n = 5/2 the force is ``beta s sqrt(s)``: only exact powers of two appear when v0 -> 32 v0 and
    dt -> dt/2, so such runs repeat bit for bit.
    """
    left, right, stiffness, exponent, gap, damping, damping_power, clip, pull_off = contacts
    (drifts, kicks), reach, start = method, frame.reach, frame.start
    n_body, n_contact, n_dense = mass.shape[0], left.shape[0], dense_steps.shape[0]
    tabled, curved = tables.law.shape[0] > 0, curves.law.shape[0] > 0
    hertz, damped, adhesive = np.all(exponent == 2.5), np.any(damping > 0.0), np.any(pull_off > 0.0)
    pushed = driven.amplitude > 0.0 or len(driven.values) > 0
    moved = driven.piston.moves
    # of a step, where the forces of each stage are: the last at its end to the last digit
    ends = np.cumsum(drifts)
    ends[-1] = 1.0
    positional = np.any(reach > 0.0)
    v, x, force = np.zeros(n_body + 1), np.zeros(n_body + 1), np.zeros(n_contact)
    v[:n_body] = velocity
    net, push, weight = np.zeros(n_body + 1), np.zeros(n_body + 1), np.zeros(n_body + 1)
    push[:n_body], weight[:n_body] = dt / mass, mass * gravity + load
    _, given, bend = piston_motion(0.0, driven.piston)
    if moved:
        push[0] = 0.0
    overlap, position = -gap, start.copy()
    out_v, out_x = np.zeros((n_dense, n_body + 1)), np.zeros((n_dense, n_body + 1))
    out_a = np.zeros((n_dense, n_body + 1))
    out_overlap, out_force = np.zeros((n_dense, n_contact)), np.zeros((n_dense, n_contact))
    step = 0
    for row in range(n_dense):
        while step <= dense_steps[row]:
            # at the start the forces alone
            for stage in range(len(drifts) if step > 0 else 1):
                if step > 0:
                    drift = dt * drifts[stage]
                    if stage == 0:
                        for i in range(n_body):
                            v[i] += kicks[0] * push[i] * net[i]
                    if moved:
                        # its mean velocity in the drift, so that it arrives where it shall be
                        way, given, bend = piston_motion((step - 1 + ends[stage]) * dt, driven.piston)
                        v[0] = (way - x[0]) / drift
                    for i in range(n_body):
                        x[i] += drift * v[i]
                    if not positional:
                        for k in range(links):
                            overlap[k] += drift * (v[k] - v[k + 1])
                        for k in range(links, n_contact):
                            overlap[k] += drift * (v[left[k]] - v[right[k]])
                    else:
                        for i in range(n_body):
                            position[i] += drift * v[i]
                            x[i] = position[i] - start[i]
                    if moved:
                        # LAMMPS' damping, too, has its velocity at the end of the step
                        v[0] = given
                if positional:
                    # at the start too: there gaps are as rounded positions have them
                    overlaps_of_positions(position, frame, contacts, links, overlap)
                for k in range(n_contact):
                    closed = max(overlap[k], 0.0)
                    row_of = tables.law[k] if tabled else -1
                    if closed == 0.0:
                        force[k] = 0.0
                    elif row_of >= 0:
                        force[k] = table_force(row_of, closed, tables)
                    elif curved:
                        force[k] = curve_force(k, closed, curves)
                    elif hertz and not tabled:
                        force[k] = stiffness[k] * closed * np.sqrt(closed)
                    else:
                        force[k] = stiffness[k] * closed ** (exponent[k] - 1.0)
                if adhesive:
                    for k in range(n_contact):
                        if overlap[k] > 0.0:
                            force[k] -= pull_off[k]
                if damped:
                    # v is that of the half step here
                    for k in range(n_contact):
                        if overlap[k] > 0.0 and damping[k] > 0.0:
                            rate = v[left[k]] - v[right[k]]
                            force[k] += damping[k] * overlap[k] ** damping_power[k] * rate
                            if clip and (not tabled or tables.law[k] < 0):
                                force[k] = max(force[k], 0.0)
                for i in range(n_body):
                    net[i] = weight[i]
                if pushed:
                    net[0] += driving_force((step - 1 + ends[stage]) * dt if step > 0 else 0.0, driven)
                if drag > 0.0:
                    for i in range(n_body):
                        net[i] -= drag * mass[i] * v[i]
                add_contact_forces(force, contacts, links, net)
                if step > 0:
                    for i in range(n_body):
                        v[i] += kicks[stage + 1] * push[i] * net[i]
            step += 1
        out_v[row] = v
        out_x[row] = x
        out_overlap[row] = overlap
        out_force[row] = force
        for i in range(n_body):
            out_a[row, i] = net[i] / mass[i]
        if moved:
            out_a[row, 0] = bend
    return out_v, out_x, out_a, out_overlap, out_force
