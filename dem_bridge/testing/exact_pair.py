"""A backend with closed-form answers: bodies that meet in one linear contact, or none.

It needs no integration, so that everything that takes trajectories can be tested by it, and it is the smallest complete
example of a backend.
"""

from __future__ import annotations

import math

import numpy as np

from dem_bridge.backends.base import Availability, Resolution, Sampling, run_provenance
from dem_bridge.scene import features
from dem_bridge.scene.scene import Scene
from dem_bridge.scene.support import Condition, Exponents, Support
from dem_bridge.trajectory.trajectory import FREE, Floats, Trajectory, Uncertainty

#: relative error of the formulas: each of some ten operations rounds
ROUND_OFF = 20.0 * float(np.finfo(float).eps)


def _bodies(scene: Scene) -> str | None:
    return None if scene.n_body <= 2 else f"the number of bodies is {scene.n_body}"


class ExactPair:
    """One or two bodies; the contact force is stiffness * overlap, the relative motion a sine while they touch.

    >>> from dem_bridge.testing import plain_scene
    >>> run = ExactPair().run(plain_scene(2, exponent=2.0), Resolution(), Sampling(count=10))
    >>> run.velocity[-1].round(3).tolist()
    [-0.089, 0.711]
    """

    name = "exact-pair"
    equations = "hertz"
    order: int | None = None
    supports = Support(
        {features.GAPS, features.INITIAL_OVERLAPS, features.SEVERAL_MOVING}
        | {features.OTHER_EXPONENTS, features.GRAVITY},
        exponents=Exponents(values=(2.0,)),
        conditions=(Condition("at most two bodies", _bodies),),
    )

    def availability(self) -> Availability:
        """Return that it is available everywhere."""
        return Availability(True)

    def run(self, scene: Scene, resolution: Resolution, sampling: Sampling) -> Trajectory:
        """Return the exact motion; ``resolution`` has no effect."""
        time, mass = sampling.times(scene.duration), np.array(scene.mass)
        start = np.array(scene.velocity)
        centre = float(mass @ start / mass.sum())
        displacement = centre * time + 0.5 * scene.gravity * time**2
        velocity = centre + scene.gravity * time
        if scene.n_body == 1:
            moved, moving, force = displacement[:, None], velocity[:, None], np.zeros((len(time), 0))
            peak, crossing = np.zeros(0), np.zeros(0)
        else:
            apart, rate, overlap, deepest, turn = _relative(scene, time)
            share = mass[::-1] / mass.sum() * (1.0, -1.0)
            moved, moving = displacement[:, None] + share * apart[:, None], velocity[:, None] + share * rate[:, None]
            force, peak = scene.stiffness[0] * overlap[:, None], np.array([scene.stiffness[0] * deepest])
            crossing = np.array([turn])
        moved[0], moving[0] = 0.0, start  # without the round-off of the formulas
        return Trajectory(
            time=time,
            displacement=moved,
            velocity=moving,
            contact_force=force,
            peak_force=peak,
            crossing_time=crossing,
            uncertainty=_roundoff(scene, moved, moving, peak),
            cost=FREE,
            provenance=run_provenance(self, scene, {"samples": sampling.count}),
        )


def _relative(scene: Scene, time: Floats) -> tuple[Floats, Floats, Floats, float, float]:
    """Return the motion of body 0 relative to body 1.

    Displacement (m), velocity (m/s) and overlap (m, 0 where open) at the times, the largest overlap until the end (m),
    and the time of the first maximal compression (s, nan: none).
    """
    closing, gap = scene.velocity[0] - scene.velocity[1], float(scene.contacts.gap[0])
    frequency = math.sqrt(scene.stiffness[0] * (1.0 / scene.mass[0] + 1.0 / scene.mass[1]))
    initial = max(-gap, 0.0)
    if initial == 0.0 and closing <= 0.0:
        return closing * time, np.full_like(time, closing), np.zeros_like(time), 0.0, math.nan
    # overlap = amplitude * sin(angle) while the angle is between 0 and pi
    amplitude, angle = math.hypot(initial, closing / frequency), math.atan2(initial, closing / frequency)
    touch = max(gap, 0.0) / closing if gap > 0.0 else 0.0
    opening, turn = touch + (math.pi - angle) / frequency, touch + (0.5 * math.pi - angle) / frequency
    phase = angle + frequency * (time - touch)
    before, after = time < touch, time > opening
    inside = ~before & ~after
    overlap = np.where(inside, amplitude * np.sin(phase), 0.0)
    displacement = np.select(
        [before, after], [closing * time, gap - amplitude * frequency * (time - opening)], overlap + gap
    )
    velocity = np.select([before, after], [closing, -amplitude * frequency], amplitude * frequency * np.cos(phase))
    turned = 0.0 < turn <= scene.duration
    deepest = amplitude if turned else max(initial, float(overlap[-1]))
    return displacement, velocity, overlap, deepest, turn if turned else math.nan


def _roundoff(scene: Scene, displacement: Floats, velocity: Floats, peak: Floats) -> Uncertainty:
    """Return the round-off of the formulas, some ten operations."""
    return Uncertainty(
        velocity=ROUND_OFF * float(np.max(np.abs(velocity))),
        displacement=ROUND_OFF * float(np.max(np.abs(displacement))),
        peak_force=ROUND_OFF * peak,
        crossing_time=np.full(len(peak), ROUND_OFF * scene.duration),
    )
