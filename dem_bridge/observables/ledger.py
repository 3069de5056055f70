"""The energy ledger of a run: where the energy of the start is at each sample, contact by contact.

The engine reports no energy of granular contacts, so every entry follows from the motion and the scene's force laws.
Entries are computed independently of each other, so their sum is a check: it is constant for a right run.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dem_bridge.observables.conserved import energy_parts, work
from dem_bridge.observables.interpolate import (
    acceleration,
    contact_motion,
    hermite,
    integrals,
    piston_contact,
    require_forces,
    require_known_forces,
    touch_times,
)
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import Floats, Trajectory


@dataclass(frozen=True, kw_only=True, eq=False)
class Ledger:
    """Energies at samples, J: ``(n_t,)``, or ``(n_t, n_contact)`` for those of contacts.

    Walls are at rest, so that their forces do no work.
    """

    kinetic: Floats
    stored: Floats
    """Energy stored in each contact."""
    potential: Floats
    """Potential energy of weight and loads, 0 at the start."""
    dissipated: Floats
    """Energy dissipated in each contact since the start."""
    drag: Floats
    """Energy dissipated by drag since the start."""
    work: Floats
    """Work of the drive since the start."""
    dissipated_uncertainty: Floats
    """Uncertainty of ``dissipated`` at the end, J, ``(n_contact,)``.

    It has three parts: the run's own uncertainty, the error of the integration between samples, and the contact's share
    of the ``balance``, because damping forces that start with an infinite slope at touch are integrated less accurately
    than the second part tells.
    """

    @property
    def balance(self) -> Floats:
        """Kinetic, stored, potential and dissipated energy less the work of the drive and less the energy of the start.

        It is 0 for a run whose motion obeys the forces of the scene.
        """
        held = self.kinetic + self.stored.sum(axis=1) + self.potential
        total = held + self.dissipated.sum(axis=1) + self.drag - self.work
        return np.asarray(total - total[0])


def energy_ledger(scene: Scene, trajectory: Trajectory) -> Ledger:
    """Return the energy ledger of a run.

    Raises
    ------
    UnsupportedScene
        If the scene has forces whose energy is not known.
    UsageError
        If the run has no contact forces.
    """
    require_known_forces(scene, "energies")
    require_forces(trajectory, "energy ledger")
    kinetic, _, potential = energy_parts(scene, trajectory)
    overlap = np.maximum(contact_motion(scene, trajectory)[0], 0.0)
    dissipated, uncertainty = _dissipated(scene, trajectory)
    ledger = Ledger(
        kinetic=kinetic,
        stored=scene.contacts.energy(overlap, np.arange(scene.n_contact)),
        potential=potential,
        dissipated=dissipated,
        drag=_drag(scene, trajectory),
        work=work(scene, trajectory)[0],
        dissipated_uncertainty=uncertainty,
    )
    share = dissipated[-1] / max(float(dissipated[-1].sum()), np.finfo(float).tiny)
    return replace(ledger, dissipated_uncertainty=uncertainty + share * float(np.max(np.abs(ledger.balance))))


def _dissipated(scene: Scene, trajectory: Trajectory) -> tuple[Floats, Floats]:
    """Return the energy dissipated in each contact until each sample, and its uncertainty at the end, J."""
    c, every = scene.contacts, np.arange(scene.n_contact)
    if not scene.damped:
        return np.zeros((len(trajectory.time), len(every))), np.zeros(len(every))
    overlap, closing = contact_motion(scene, trajectory)
    slope = np.pad(acceleration(scene, trajectory), ((0, 0), (0, 1)))
    relative = slope[:, c.left] - slope[:, c.right]

    def power(pressed: Floats, speed: Floats) -> Floats:
        damping = c.damping_force(pressed, speed, every)
        return (np.maximum(damping, -c.force(pressed, every)) if c.clip else damping) * speed

    def at(when: Floats, nodes: int) -> tuple[Floats, Floats]:
        pressed = hermite(trajectory, overlap, closing, when, nodes=nodes)
        speed = hermite(trajectory, closing, relative, when, nodes=nodes)
        if scene.piston is not None:
            pressed[:, :1], speed[:, :1] = piston_contact(scene, trajectory, when, nodes=nodes)
        return np.maximum(pressed, 0.0), speed

    touches = touch_times(trajectory, overlap, closing)
    if scene.piston is not None:
        touches = np.concatenate([touches, scene.piston.breaks])
    done, uncertainty = integrals(trajectory, lambda when, nodes: power(*at(when, nodes)), touches)
    u_x, u_v = (trajectory.uncertainty[name] for name in ("displacement", "velocity"))
    if not np.isfinite((u_x, u_v)).all():
        return done, np.full(len(every), np.inf)

    def change(when: Floats, nodes: int) -> Floats:
        """Return by how much the power may change where both ends of a contact are off, on opposite sides."""
        pressed, speed = at(when, nodes)
        further = np.where(pressed > 0.0, pressed + 2.0 * u_x, 0.0)
        return np.asarray(np.abs(power(further, speed + np.copysign(2.0 * u_v, speed)) - power(pressed, speed)))

    return done, uncertainty + integrals(trajectory, change, touches)[0][-1]


def _drag(scene: Scene, trajectory: Trajectory) -> Floats:
    """Return the energy dissipated by drag until each sample, J, ``(n_t,)``."""
    slope, mass = acceleration(scene, trajectory), np.array(scene.mass)

    def power(when: Floats, nodes: int) -> Floats:
        velocity = hermite(trajectory, trajectory.velocity, slope, when, nodes=nodes)
        return np.asarray(scene.drag * (velocity**2 @ mass)[:, None])

    return integrals(trajectory, power)[0][:, 0] if scene.drag > 0.0 else np.zeros(len(trajectory.time))
