"""The algorithmic twin of LAMMPS: the same velocity-Verlet, written in overlap variables and compiled.

LAMMPS (``fix nve``) half-kicks, drifts, evaluates the forces and half-kicks again (Swope et al. 1982); so does
this, in the same order of operations. But it carries the overlap of each contact as a variable of its own, so no
position is ever subtracted from another: what LAMMPS loses there is what the two differ by. Asked for a
``gauge_radius`` it keeps absolute positions instead, as LAMMPS does, and then loses the same.
"""

from __future__ import annotations

import math
import time
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from dem_bridge.backends.bars import UNKNOWN, Twins, with_bars
from dem_bridge.backends.base import Availability, Resolution, Sampling, birth_certificate
from dem_bridge.backends.survey import Survey, survey
from dem_bridge.compiled import interruptible
from dem_bridge.dense import MOST_STEPS, Schedule, extremes, rivals, schedule
from dem_bridge.errors import RunBroken
from dem_bridge.scene import Scene
from dem_bridge.trajectory import Cost, Trajectory

#: default step: the next of the 1-2-5 series below this fraction of 1/omega of the stiffest contact
DEFAULT_PHASE = 2.5e-3


class Verlet:
    """Velocity-Verlet in overlap variables (numba). Any masses, exponents, gaps, walls; gravity."""

    name = "verlet"
    equations = "hertz"
    order: int | None = 2

    def availability(self) -> Availability:
        return Availability(True)

    def refusal(self, scene: Scene) -> str | None:
        return None

    def run(self, scene: Scene, resolution: Resolution, sampling: Sampling) -> Trajectory:
        """Solve; with ``gauge_radius`` in absolute positions, as LAMMPS. The bars come from three more runs."""
        look = survey(scene)
        plan = fixed_step_plan(scene, resolution, sampling, look)
        run = solve_plan(scene, plan, resolution.gauge_radius or 0.0)
        if not resolution.bars:
            return run
        return with_twin_bars(run, scene, plan, look, radius=resolution.gauge_radius or look.gauge_radius)


def round_step(dt: float) -> float:
    """The largest of 1, 2, 5 times a power of ten that is at most ``dt`` (up to round-off).

    >>> round_step(1.3e-8), round_step(9.9e-9), round_step(1e-8)
    (1e-08, 5e-09, 1e-08)
    """
    power = math.floor(math.log10(dt))
    series = [float(f"{digit}e{decade}") for decade in (power - 1, power, power + 1) for digit in (1, 2, 5)]
    return max(step for step in series if step <= dt * (1.0 + 1e-12))


def default_step(scene: Scene, sampling: Sampling, look: Survey) -> float:
    """Step of a fixed-step run that was asked for none, s."""
    if look.frequency > 0.0:
        return round_step(DEFAULT_PHASE / look.frequency)
    return scene.duration / sampling.count


def fixed_step_plan(scene: Scene, resolution: Resolution, sampling: Sampling, look: Survey) -> Schedule:
    """The steps of a fixed-step run, the same for LAMMPS and twin."""
    dt = resolution.dt if resolution.dt is not None else default_step(scene, sampling, look)
    return schedule(
        duration=scene.duration, samples=sampling.count, dt=dt, frequency=look.frequency, bodies=scene.n_body
    )


def with_twin_bars(run: Trajectory, scene: Scene, plan: Schedule, look: Survey, *, radius: float) -> Trajectory:
    """``run`` (of LAMMPS or of the twin, on the steps of ``plan``) with bars from twins; see :mod:`.bars`.

    ``radius`` (m): of the bodies, for a code that keeps positions.
    """
    is_own = run.provenance["backend"] == Verlet.name and "gauge_radius" not in run.provenance["settings"]
    # one step per sample leaves no coarser step that falls on the samples
    ratios = (2.0, 1.0 / 3.0) if plan.per_sample > 1 else (0.5, 1.0 / 3.0)
    if plan.steps > min(ratios) * MOST_STEPS:
        return run  # no finer run can be had, so nothing can be said
    others = {}
    for ratio in ratios:
        other = fixed_step_plan(scene, Resolution(dt=ratio * plan.step), Sampling(count=plan.samples), look)
        others[other.step / plan.step] = solve_plan(scene, other)
    positional, dense = _solved(scene, plan, radius)
    thinned = _extremes(scene, plan, dense, every=2)
    own = run if is_own else solve_plan(scene, plan)
    return with_bars(
        run,
        Twins(
            plan=plan,
            own=own,
            others=others,
            positional=positional,
            thinned=thinned,
            rivals=rivals(dense.force),
        ),
    )


def solve_plan(scene: Scene, plan: Schedule, radius: float = 0.0) -> Trajectory:
    """One twin run on the given steps, without bars.

    ``radius`` (m) above 0: as a code does that keeps absolute positions of bodies of this radius and subtracts them.
    Nothing but round-off differs, so the difference to the run with 0 is the round-off of such a code.
    """
    return _solved(scene, plan, radius)[0]


class _Dense(NamedTuple):
    """What :func:`integrate` returns."""

    velocity: NDArray[np.float64]
    displacement: NDArray[np.float64]
    acceleration: NDArray[np.float64]
    overlap: NDArray[np.float64]
    force: NDArray[np.float64]


def _solved(scene: Scene, plan: Schedule, radius: float) -> tuple[Trajectory, _Dense]:
    wall, cpu = time.perf_counter(), time.process_time()
    settings: dict[str, float] = {"dt": plan.step, "samples": plan.samples}
    if radius > 0.0:
        settings["gauge_radius"] = radius
    c = scene.contacts
    dense = _Dense(
        *interruptible(
            integrate,
            np.array(scene.mass),
            np.array(scene.velocity),
            c.left,
            c.right,
            len(scene.stiffness),
            c.stiffness,
            c.exponent,
            c.gap,
            scene.gravity,
            plan.step,
            plan.dense_steps,
            *_frame(scene, radius),
        )
    )
    if not np.all(np.isfinite(dense.velocity)):
        raise RunBroken(f"verlet on {scene.name}: velocities are not finite; dt = {plan.step:g} s is beyond stability")
    peak_force, crossing = _extremes(scene, plan, dense)
    keep = slice(None, None, plan.subdivisions)
    run = Trajectory(
        time=Sampling(count=plan.samples).times(scene.duration),
        displacement=dense.displacement[keep, :-1],
        velocity=dense.velocity[keep, :-1],
        contact_force=dense.force[keep],
        peak_force=peak_force,
        crossing_time=crossing,
        uncertainty=UNKNOWN,
        cost=Cost(
            wall=time.perf_counter() - wall,
            cpu=time.process_time() - cpu,
            steps=plan.steps,
            force_evaluations=plan.steps + 1,
        ),
        provenance=birth_certificate(Verlet(), scene, settings),
    )
    return run, dense


def _extremes(
    scene: Scene, plan: Schedule, dense: _Dense, every: int = 1
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Peak forces and crossing times from one in ``every`` dense samples."""
    c, rows = scene.contacts, slice(None, None, every)
    v, a = dense.velocity[rows], dense.acceleration[rows]
    return extremes(
        time=plan.dense_steps[rows] * plan.step,
        overlap=dense.overlap[rows],
        rate=v[:, c.left] - v[:, c.right],
        acceleration=a[:, c.left] - a[:, c.right],
        force=dense.force[rows],
        exponent=c.exponent,
        # bodies that fly in touch overlap by the last digit of their way: that is no collision
        resolution=4.0 * math.ulp(float(np.max(np.abs(dense.displacement)))),
    )


def _frame(scene: Scene, radius: float) -> tuple[float, NDArray[np.float64], NDArray[np.float64]]:
    """Diameter, start positions of the bodies and position of the wall of each contact, m."""
    c, links = scene.contacts, len(scene.stiffness)
    start = np.concatenate([[0.0], np.cumsum(2.0 * radius + c.gap[:links])])
    wall = np.zeros(scene.n_contact)
    for k in range(links, scene.n_contact):
        reach = 2.0 * radius + c.gap[k]
        wall[k] = start[0] - reach if c.left[k] == scene.n_body else start[-1] + reach
    return 2.0 * radius, start, wall


@njit(cache=True, nogil=True)
def integrate(  # type: ignore[no-untyped-def]
    mass, velocity, left, right, links, stiffness, exponent, gap, gravity, dt, dense_steps, diameter, start, wall
):
    """Velocity, displacement, acceleration ``(n_dense, n_body + 1)`` (last column: the walls, 0), overlap and force
    ``(n_dense, n_contact)`` at ``dense_steps``. The first ``links`` contacts are those of the chain.

    With n = 5/2 the force is ``beta s sqrt(s)``: only exact powers of two appear when v0 -> 32 v0 and
    dt -> dt/2, so such runs repeat bit for bit.
    """
    n_body, n_contact, n_dense = mass.shape[0], left.shape[0], dense_steps.shape[0]
    hertz = np.all(exponent == 2.5)
    v = np.zeros(n_body + 1)
    v[:n_body] = velocity
    x = np.zeros(n_body + 1)
    force = np.zeros(n_contact)
    net = np.zeros(n_body + 1)
    kick = np.zeros(n_body + 1)
    kick[:n_body] = 0.5 * dt / mass
    weight = np.zeros(n_body + 1)
    weight[:n_body] = mass * gravity
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
                if diameter == 0.0:
                    for k in range(links):
                        overlap[k] += dt * (v[k] - v[k + 1])
                    for k in range(links, n_contact):
                        overlap[k] += dt * (v[left[k]] - v[right[k]])
                else:
                    for i in range(n_body):
                        position[i] += dt * v[i]
                        x[i] = position[i] - start[i]
                    for k in range(links):
                        overlap[k] = diameter - (position[k + 1] - position[k])
                    for k in range(links, n_contact):
                        if left[k] == n_body:
                            overlap[k] = diameter - (position[right[k]] - wall[k])
                        else:
                            overlap[k] = diameter - (wall[k] - position[left[k]])
            if hertz:
                for k in range(n_contact):
                    closed = max(overlap[k], 0.0)
                    force[k] = stiffness[k] * closed * np.sqrt(closed)
            else:
                for k in range(n_contact):
                    closed = max(overlap[k], 0.0)
                    force[k] = stiffness[k] * closed ** (exponent[k] - 1.0)
            for i in range(n_body):
                net[i] = weight[i]
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
