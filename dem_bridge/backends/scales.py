"""Large and small values of a scene: speeds, overlaps and accelerations, from its energy and its forces."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dem_bridge.scene.derived import derived, frozen
from dem_bridge.scene.scene import Scene, Wall
from dem_bridge.trajectory.trajectory import Trajectory

#: part of a static force that is round-off: codes that keep positions lose a few digits of their overlaps
RESTING = 1e-10


def natural_scales(scene: Scene) -> tuple[float, NDArray[np.float64]]:
    """Largest speed (m/s) and overlap of each contact (m) that the energy at hand allows, roughly: what is small.

    Energy stored in an equilibrium cannot become motion: it counts for the overlaps of a precompressed chain alone.
    What a drive adds is what it gives to body 0 alone before it turns; a piston gives its velocity to all bodies.
    """
    c, mass, v = scene.contacts, np.array(scene.mass), np.abs(scene.velocity)
    if (push := scene.driving_force) is not None:
        v[0] += push.peak / scene.mass[0] / max(push.rate, 1.0 / scene.duration)
    if scene.piston is not None:
        # whatever its mass, it can bring all bodies to its velocity
        v = np.maximum(v, scene.piston.peak)
        mass[0] = 0.0
    fall = abs(scene.gravity) * scene.duration
    initial = np.maximum(-c.gap, 0.0)
    held = scene.precompression > 0.0
    stored = 0.0 if held else float(np.sum(c.energy(initial, np.arange(scene.n_contact))))
    # adhesion does work down to the overlap at which forces balance
    stored += float(np.sum(c.pull_off * (c.pull_off / c.stiffness) ** (1.0 / (c.exponent - 1.0))))
    energy = 0.5 * float(np.sum(mass * (v**2 + fall**2))) + stored
    speed = max(float(np.max(np.abs(v))) + fall, math.sqrt(2.0 * stored / float(np.sum(mass))))
    if scene.law is not None:
        return speed, c.reach[c.law]
    depth = (c.exponent * energy / c.stiffness) ** (1.0 / c.exponent)
    return speed, depth + initial if held else depth


#: part of the overlap that the energy of a scene allows, and of its largest speed, below which no force matters
UNFELT = 1e-12


def unfelt_overlap(scene: Scene) -> NDArray[np.float64]:
    """Return the overlap of each contact, m, ``(n_contact,)``, below which it has no force that could matter.

    It is 1e-12 of the overlap that the energy of the scene allows, and with n < 2 that of a collision at 1e-12 of the
    largest speed. Bodies that are too light to carry that energy make less deep contacts, and less is felt there.
    """
    speed, depth = natural_scales(scene)
    if scene.law is None and scene.precompression == 0.0 and speed > 0.0:
        depth = np.minimum(depth, 1e3 * pair_overlap(scene, speed))
    return np.asarray(UNFELT ** np.maximum(1.0, 2.0 / scene.contacts.exponent) * depth)


def pair_overlap(scene: Scene, speed: float) -> NDArray[np.float64]:
    """Return the overlap of each contact, m, ``(n_contact,)``, if its two bodies alone met at ``speed`` (m/s)."""
    c, mobility = scene.contacts, scene.mobility
    square = speed / (mobility[c.left] + mobility[c.right]) * speed
    return np.asarray((0.5 * c.exponent * square / c.stiffness) ** (1.0 / c.exponent))


def in_common_frame(scene: Scene) -> tuple[Scene, float]:
    """Return the scene as seen by its slowest body, and the velocity (m/s) of that body, if all move the same way.

    A velocity that all bodies have in common would leave few digits for those at which they meet. Drag is proportional
    to velocity: it slows the frame as it would a free body, and the equations in it are the same. With a wall or a
    piston there is a frame at rest: the scene is returned as it is, with a velocity of 0.
    """
    slowest = min(scene.velocity, key=abs)
    held = scene.wall_left is not None or scene.wall_right is not None or scene.piston is not None
    if held or not all(velocity * slowest > 0.0 for velocity in scene.velocity):
        return scene, 0.0
    return replace(scene, velocity=tuple(velocity - slowest for velocity in scene.velocity)), slowest


def frame_velocity(velocity: float, drag: float, time: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the velocity (m/s) at ``time`` (s) of a frame that starts at ``velocity`` and is slowed by drag (1/s)."""
    return np.asarray(velocity * np.exp(-drag * time))


def in_rest_frame(run: Trajectory, velocity: float, drag: float) -> Trajectory:
    """Return a run of a scene in a frame that starts at ``velocity`` (m/s), and has its drag, in the frame at rest."""
    if velocity == 0.0:
        return run
    time = run.time[:, None]
    way = -velocity * np.expm1(-drag * time) / drag if drag > 0.0 else velocity * time
    moved = run.velocity + frame_velocity(velocity, drag, time)
    return replace(run, velocity=moved, displacement=run.displacement + way)


def before_wall(scene: Scene) -> Scene:
    """Return the bodies before a piston of constant velocity as it sees them: before a wall at rest, moving against it.

    A static force has no such frame, because it holds the ends of the chain: there must be no precompression.
    """
    speed, wall = scene.velocity[0], scene.contacts
    first = Wall(stiffness=scene.stiffness[0], gap=float(wall.gap[0]), exponent=float(wall.exponent[0]))
    return replace(
        scene,
        mass=scene.mass[1:],
        stiffness=scene.stiffness[1:],
        exponent=scene.exponent[1:] if isinstance(scene.exponent, tuple) else scene.exponent,
        gap=scene.gap[1:] if isinstance(scene.gap, tuple) else scene.gap,
        velocity=tuple(velocity - speed for velocity in scene.velocity[1:]),
        wall_left=first,
        drive=None,
        geometry=None,
    )


def behind_piston(run: Trajectory, scene: Scene) -> Trajectory:
    """Return a run of :func:`before_wall` of a scene as one of the scene, with its piston, in the frame at rest."""
    speed, links = scene.velocity[0], len(scene.stiffness) - 1
    way = speed * run.time[:, None]
    # the contact with the wall is behind those of the chain
    order = [links, *range(links), *range(links + 1, scene.n_contact)]
    return replace(
        run,
        velocity=np.hstack([np.full_like(way, speed), run.velocity + speed]),
        displacement=np.hstack([way, run.displacement + way]),
        contact_force=run.contact_force[:, order],
        peak_force=run.peak_force[order],
        crossing_time=run.crossing_time[order],
    )


def resting_speed(scene: Scene) -> float:
    """Speed (m/s) that the force of a precompressed contact gives to a body over the contact's overlap; 0 without.

    Forces in balance cancel but for their last digits, so this, times that digit, is how slow nothing can be told
    from rest.
    """
    if scene.precompression == 0.0:
        return 0.0
    c, mobility = scene.contacts, scene.mobility
    lighter = np.maximum(mobility[c.left], mobility[c.right])
    return math.sqrt(float(np.max(c.stiffness * (-c.gap) ** c.exponent * lighter, initial=0.0)))


@derived
def resting_acceleration(scene: Scene) -> NDArray[np.float64]:
    """Return the closing acceleration (m/s^2) of each contact, ``(n_contact,)``, below which it counts as at rest.

    Ahead of a front the forces on a body of a precompressed chain cancel but for round-off, and the closing rate
    passes zero all the time: maximal compressions are only those that a force ends. The same holds for a stack whose
    initial overlaps carry its weight, and for adhesion in equilibrium. 0 without precompression, weight and adhesion.
    """
    c, mobility = scene.contacts, scene.mobility
    held = scene.precompression > 0.0 or scene.gravity != 0.0 or scene.adhesive
    force = c.stiffness * np.maximum(-c.gap, 0.0) ** (c.exponent - 1.0) if held else np.zeros(scene.n_contact)
    return frozen(RESTING * force * (mobility[c.left] + mobility[c.right]))
