"""Momentum, energy and work of a trajectory, and the drift of energy over a long run.

LAMMPS' granular styles report no contact energy, so it is computed from the contact law.

The energy of velocity-Verlet oscillates within bounds, which is no drift. Velocity-Verlet does not conserve the energy
H but, up to terms of fourth order in the step, a neighbour of it,

    H~ = H + dt^2 (v K v / 12 - F M^-1 F / 24),

with the tangent stiffness K and the net forces F (Hairer, Lubich & Wanner 2006, *Geometric Numerical Integration*, ch.
IX; 2003, *Acta Numerica* 12, 399). H oscillates about it with the motion; a drift is a change of H~. Hertz' law is
smooth except at touch, so H~ takes a small step of either sign with every impact: it is a random walk, and a slope
fitted to a random walk is never zero. The uncertainty of the drift includes that.
"""

from __future__ import annotations

from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np

from dem_bridge.errors import UsageError
from dem_bridge.observables.interpolate import (
    Moving,
    acceleration,
    contact_motion,
    hermite,
    integrals,
    piston_contact,
    require_known_forces,
    touch_times,
)
from dem_bridge.observables.modes import tangent_stiffness
from dem_bridge.observables.observable import Measured, measured, whole
from dem_bridge.scene.contacts import Contacts
from dem_bridge.scene.piston import Piston
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import Floats, Trajectory


def momentum(scene: Scene, trajectory: Moving) -> Floats:
    """Return the total momentum, kg m/s, ``(n_t,)``; it is constant where the scene ``conserves_momentum``.

    Without walls the loads on both ends of a precompressed chain cancel, and damping forces act on both bodies of a
    contact with opposite signs.
    """
    return np.asarray(trajectory.velocity @ np.array(scene.mass))


def momentum_uncertainty(scene: Scene, trajectory: Trajectory) -> Floats:
    """Return the uncertainty of :func:`momentum` by that of all velocities, kg m/s, ``(n_t,)``."""
    return np.full(len(trajectory.time), sum(scene.mass) * trajectory.uncertainty["velocity"])


def energy_parts(scene: Scene, trajectory: Moving, contacts: Contacts | None = None) -> tuple[Floats, Floats, Floats]:
    """Return kinetic, contact and potential energy, J, ``(n_t,)`` each.

    Contacts store ``beta overlap^n / n`` or the energy of their law; the potential energy is ``-(m g + load) x``.
    ``contacts``: those of the scene with other gaps; None: its own.
    """
    require_known_forces(scene, "energies")
    c = contacts or scene.contacts
    return _parts_at(scene, trajectory, c, contact_motion(scene, trajectory, c)[0])


def _parts_at(scene: Scene, trajectory: Moving, c: Contacts, overlap: Floats) -> tuple[Floats, Floats, Floats]:
    """Return what :func:`energy_parts` returns, at overlaps of the contacts, m; negative where they are open."""
    mass = np.array(scene.mass)
    kinetic = 0.5 * trajectory.velocity**2 @ mass
    stored = c.energy(np.maximum(overlap, 0.0), np.arange(scene.n_contact)).sum(axis=1)
    potential = -scene.gravity * trajectory.displacement @ mass - trajectory.displacement @ scene.load
    return np.asarray(kinetic), np.asarray(stored), np.asarray(potential)


def energy(scene: Scene, trajectory: Trajectory) -> Floats:
    """Return the total energy, J, ``(n_t,)``: the sum of :func:`energy_parts`.

    It is constant where the scene ``conserves_energy``; it falls with damping or drag, and changes by the :func:`work`
    of a drive.
    """
    kinetic, stored, potential = energy_parts(scene, trajectory)
    return kinetic + stored + potential


def energy_uncertainty(scene: Scene, trajectory: Trajectory) -> Floats:
    """Return the uncertainty of :func:`energy` by those of velocities and displacements, J, ``(n_t,)``.

    To first order, energy changes by ``m v`` for each velocity, and for each displacement by minus the outer forces and
    by the forces of both contacts.
    """
    return _uncertainty_at(scene, trajectory, contact_motion(scene, trajectory)[0])


def _uncertainty_at(scene: Scene, trajectory: Trajectory, overlap: Floats) -> Floats:
    """Return what :func:`energy_uncertainty` returns, at overlaps of the contacts, m."""
    u_v, u_x = (trajectory.uncertainty[name] for name in ("velocity", "displacement"))
    if not np.isfinite((u_v, u_x)).all():
        return np.full(len(trajectory.time), np.inf)
    mass, c, n = np.array(scene.mass), scene.contacts, scene.n_body
    force = c.force(np.maximum(overlap, 0.0), np.arange(scene.n_contact))
    ends = (c.left < n).astype(float) + (c.right < n)  # a wall does not move
    steady = float(np.sum(np.abs(scene.steady_force)))
    return np.asarray(u_v * (np.abs(trajectory.velocity) @ mass) + u_x * ((np.abs(force) + c.pull_off) @ ends + steady))


def measure_momentum(scene: Scene, trajectory: Trajectory) -> tuple[Floats, Floats, float]:
    """Return the momentum, its uncertainty and its scale, the total mass times the largest velocity, kg m/s."""
    scale = sum(scene.mass) * np.max(np.abs(trajectory.velocity), initial=0.0)
    return momentum(scene, trajectory), momentum_uncertainty(scene, trajectory), float(scale)


#: parts of the energy and their uncertainty of each trajectory that still exists: two observables need them
_energies: WeakKeyDictionary[Trajectory, tuple[Scene, tuple[Floats, Floats, Floats], Floats]] = WeakKeyDictionary()


def _energies_of(scene: Scene, trajectory: Trajectory) -> tuple[tuple[Floats, Floats, Floats], Floats]:
    """Return :func:`energy_parts` and :func:`energy_uncertainty` of a run, from one motion of its contacts."""
    kept = _energies.get(trajectory)
    if kept is None or kept[0] != scene:
        require_known_forces(scene, "energies")
        overlap = contact_motion(scene, trajectory)[0]
        parts = _parts_at(scene, trajectory, scene.contacts, overlap)
        kept = _energies[trajectory] = scene, parts, _uncertainty_at(scene, trajectory, overlap)
    return kept[1], kept[2]


def measure_energy(scene: Scene, trajectory: Trajectory) -> tuple[Floats, Floats, float]:
    """Return the energy, its uncertainty and its scale, the largest sum of the magnitudes of its parts, J."""
    parts, uncertainty = _energies_of(scene, trajectory)
    kinetic, stored, potential = parts
    scale = np.max(sum(map(np.abs, parts)), initial=0.0)
    return kinetic + stored + potential, uncertainty, float(scale)


def measure_energy_less_work(scene: Scene, trajectory: Trajectory) -> tuple[Floats, Floats, float]:
    """Return the energy less the work of the drive, its uncertainty and its scale, J.

    The scale is the largest sum of the energy in motion and the magnitude of the work.
    """
    (kinetic, stored, potential), uncertainty = _energies_of(scene, trajectory)
    done, unknown = work(scene, trajectory)
    scale = np.max(kinetic + np.abs(done), initial=0.0)
    return kinetic + stored + potential - done, uncertainty + unknown, float(scale)


def work(scene: Scene, trajectory: Trajectory) -> tuple[Floats, float]:
    """Return the work of the drive on body 0 until each sample, J, ``(n_t,)``, and its uncertainty; 0 without a drive.

    That of a piston is the work of the force that moves body 0 as prescribed against all others. The uncertainty is
    that of :func:`~dem_bridge.observables.interpolate.integrals`. nan where a trajectory has no contact forces.
    """
    if scene.piston is not None:
        return _work_of_piston(scene, scene.piston, trajectory)
    time, drive = trajectory.time, scene.driving_force
    if drive is None:
        return np.zeros(len(time)), 0.0
    velocity, slope = trajectory.velocity[:, :1], acceleration(scene, trajectory)[:, :1]

    def power(when: Floats, nodes: int) -> Floats:
        return np.asarray(drive.at(when) * hermite(trajectory, velocity, slope, when, nodes=nodes))

    done, uncertainty = integrals(trajectory, power, drive.breaks)
    return done[:, 0], float(uncertainty[0])


def _work_of_piston(scene: Scene, piston: Piston, trajectory: Trajectory) -> tuple[Floats, float]:
    """Return what :func:`work` returns for a piston.

    Kinetic energy and the work of weight and load follow from its motion. The work against drag and the first contact
    is integrated, with the motion of body 1 between samples; its uncertainty includes that of the run.
    """
    c, mass, first = scene.contacts, scene.mass[0], np.array([0])
    u_x, u_v = (trajectory.uncertainty[name] for name in ("displacement", "velocity"))

    def power(overlap: Floats, rate: Floats, speed: Floats) -> Floats:
        force = c.force(np.maximum(overlap, 0.0), first) + c.damping_force(overlap, rate, first)
        return np.asarray(((np.maximum(force, 0.0) if c.clip else force) + scene.drag * mass * speed) * speed)

    def at(when: Floats, nodes: int) -> tuple[Floats, Floats, Floats]:
        return *piston_contact(scene, trajectory, when, nodes=nodes), piston.at(when)

    def change(when: Floats, nodes: int) -> Floats:
        overlap, rate, speed = at(when, nodes)
        further = np.where(overlap > 0.0, overlap + u_x, overlap)
        return np.asarray(np.abs(power(further, rate + np.copysign(u_v, rate), speed) - power(overlap, rate, speed)))

    overlap, closing = contact_motion(scene, trajectory)
    breaks = np.concatenate([piston.breaks, touch_times(trajectory, overlap[:, :1], closing[:, :1])])
    done, uncertainty = integrals(trajectory, lambda when, nodes: power(*at(when, nodes)), breaks)
    unknown = float(integrals(trajectory, change, breaks)[0][-1, 0]) if np.isfinite((u_x, u_v)).all() else np.inf
    speed, way = piston.at(trajectory.time), piston.displacement(trajectory.time)
    own = 0.5 * mass * (speed**2 - speed[0] ** 2) - scene.steady_force[0] * way
    return done[:, 0] + own, float(uncertainty[0]) + unknown


#: verifications judge their drift, where a scene conserves them
DECLARED = (
    measured(
        lambda scene, run: Measured(*measure_momentum(scene, run)),
        name="momentum",
        definition="Total momentum of the bodies at each sample.",
        unit="kg m/s",
        axis=("time",),
        scale=whole("total mass times largest velocity"),
        follows="velocity",
    ),
    measured(
        lambda scene, run: Measured(*measure_energy(scene, run)),
        name="energy",
        definition="Energy of motion, contacts and height at each sample.",
        unit="J",
        axis=("time",),
        scale=whole("most energy in motion, contacts and height"),
        follows="velocity",
    ),
    measured(
        lambda scene, run: Measured(*measure_energy_less_work(scene, run)),
        name="energy_less_work",
        definition="Energy at each sample less the work that the drive has done.",
        unit="J",
        axis=("time",),
        # what a precompressed chain stores is no measure of a small wave
        scale=whole("most energy in motion and work done"),
        follows="velocity",
    ),
)


#: number of blocks of a series: with fewer its uncertainty is not known, with more the means are not independent
BLOCKS = 20
#: probability with which the uncertainty covers the true slope
CONFIDENCE = 0.95


@dataclass(frozen=True, kw_only=True)
class Drift:
    """Hold the slope of a series in time, and its standard errors; :func:`drift_of` returns it."""

    slope: float
    """In the series' unit per second."""
    bar: float
    """Half width of the 95 % interval of the slope: the larger of those of a walk and of a swing."""
    walk: float
    """Standard error of the slope if the series walks at random: from the scatter of its steps from block to block."""
    swing: float
    """Standard error if it swings about a line: from the scatter of the blocks about that line."""
    duration: float
    """s."""

    @property
    def total(self) -> tuple[float, float]:
        """Return the drift of the series over the duration, and its uncertainty."""
        return self.slope * self.duration, self.bar * self.duration

    @property
    def found(self) -> bool:
        """Return whether the slope differs from zero by more than its uncertainty."""
        return abs(self.slope) > self.bar


def drift_of(time: Floats, series: Floats) -> Drift:
    """Return the slope of ``series (n_t,)`` over ``time`` (s, evenly spaced), by means over 20 blocks.

    The slope is that of a line through the means. Its uncertainty covers a random walk, for which the differences of
    the means are independent, and an oscillation, for which their distances from the line are. Raises UsageError for
    fewer than 40 samples.

    >>> time = np.linspace(0.0, 1.0, 2001)
    >>> swing = drift_of(time, 3e-6 * time + 1e-6 * np.sin(1000.0 * time))
    >>> f"{swing.slope:.2e}", swing.found, drift_of(time, np.sin(1000.0 * time)).found
    ('2.99e-06', True, False)
    """
    from scipy.stats import t as student

    if len(series) < 2 * BLOCKS:
        raise UsageError(f"{len(series)} samples of a series; allowed: at least {2 * BLOCKS}, for a drift with a bar")
    when, means = (
        np.array([np.mean(part) for part in np.array_split(values - values[0], BLOCKS)]) for values in (time, series)
    )
    middle = when - np.mean(when)
    slope = float(np.sum(middle * means) / np.sum(middle**2))
    away = means - np.mean(means) - slope * middle
    swing = float(np.sqrt(np.sum(away**2) / (BLOCKS - 2) / np.sum(middle**2)))
    steps = np.diff(means)
    # means over blocks of a walk differ by 2/3 of the variance that it gathers in a block, and the slope of a line
    # through a walk has 6/5 of the variance of (last - first)/duration
    walk = float(np.sqrt(1.2 * 1.5 * np.var(steps, ddof=1) * len(steps)) / (when[-1] - when[0]))
    factor = float(student.ppf(0.5 + 0.5 * CONFIDENCE, BLOCKS - 2))
    return Drift(slope=slope, bar=factor * max(walk, swing), walk=walk, swing=swing, duration=float(time[-1] - time[0]))


def swing_of(scene: Scene, run: Trajectory, dt: float) -> Floats:
    """Return ``H~ - H`` at each sample for the step ``dt`` (s), J, ``(n_t,)``: the energy's oscillation.

    Raises UnsupportedScene for n < 2.
    """
    overlap, closing = contact_motion(scene, run)
    stiffness = tangent_stiffness(scene, overlap)
    bent = np.sum(stiffness * closing**2, axis=1) / 12.0
    pushed = acceleration(scene, run) ** 2 @ np.array(scene.mass) / 24.0
    return np.asarray(dt**2 * (bent - pushed))
