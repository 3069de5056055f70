"""Momentum, energy and work of a trajectory.

LAMMPS' granular styles report no contact energy, so it is computed from the contact law.
"""

from __future__ import annotations

from weakref import WeakKeyDictionary

import numpy as np

from dem_bridge.observables.interpolate import (
    Moving,
    acceleration,
    contact_motion,
    hermite,
    integrals,
    require_known_forces,
)
from dem_bridge.observables.observable import Measured, measured, whole
from dem_bridge.scene.contacts import Contacts
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

    The uncertainty is that of :func:`~dem_bridge.observables.interpolate.integrals`. nan where a trajectory has no
    contact forces.
    """
    time, drive = trajectory.time, scene.drive
    if drive is None:
        return np.zeros(len(time)), 0.0
    velocity, slope = trajectory.velocity[:, :1], acceleration(scene, trajectory)[:, :1]

    def power(when: Floats, nodes: int) -> Floats:
        return np.asarray(drive.at(when) * hermite(trajectory, velocity, slope, when, nodes=nodes))

    done, uncertainty = integrals(trajectory, power, drive.breaks)
    return done[:, 0], float(uncertainty[0])


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
