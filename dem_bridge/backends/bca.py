"""The binary collision approximation: the paper's theory (section 3, eq. 3.3 to 3.7) as a backend.

Other equations than Hertz's chain: the impulse is handed on in a row of two-body collisions, each over before the
next begins. Body i moves with v_i while it crosses from its collision with i-1 to that with i+1, then with what the
collision left it. The answer is a Trajectory of velocity steps: contact forces are nan, peak forces are those of
the two-body collision, and nothing can be said about its error from within (bars inf).
"""

from __future__ import annotations

import math

import numpy as np

from dem_bridge.backends.base import AlwaysAvailable, Resolution, Sampling, run_provenance
from dem_bridge.foundation.stopwatch import Stopwatch
from dem_bridge.physics.exact import two_body_collision
from dem_bridge.scene import features
from dem_bridge.scene.scene import Scene
from dem_bridge.scene.support import Condition, Support
from dem_bridge.trajectory.trajectory import Cost, Trajectory

MOVES_TOWARDS_THE_CHAIN = Condition(
    "body 0 moves towards the chain at the start",
    lambda scene: None if scene.velocity[0] > 0.0 else f"body 0 starts with a velocity of {scene.velocity[0]:g} m/s",
)


def has_contacts(least: int) -> Condition:
    """Require a number of contacts."""
    return Condition(
        f"a chain of at least {least} contact{'s' * (least > 1)}",
        lambda scene: None if scene.n_contact >= least else f"the number of contacts is {scene.n_contact}",
    )


#: the scenes of one pulse, which the theories describe
SINGLE_PULSE = Support(
    {features.OTHER_EXPONENTS, features.GRADED_EXPONENTS},
    conditions=(MOVES_TOWARDS_THE_CHAIN, has_contacts(1)),
    scope="binary collisions describe a single pulse into a free chain of touching bodies at rest",
)


class BinaryCollisions(AlwaysAvailable):
    """A row of exact two-body collisions; single-pulse chains only."""

    name = "bca"
    equations = "binary collisions"
    supports = SINGLE_PULSE

    def run(self, scene: Scene, resolution: Resolution, sampling: Sampling) -> Trajectory:
        """Follow the pulse from one binary collision to the next."""
        watch = Stopwatch()
        times, c, n = sampling.times(scene.duration), scene.contacts, scene.n_body
        arrival = np.zeros(n)  # when body i is set moving
        leaving = np.full(n, math.inf)  # when it has handed its momentum on
        moving, after = np.zeros(n), np.zeros(n)
        moving[0] = scene.velocity[0]
        peak_force = np.zeros(scene.n_contact)
        for k in range(scene.n_contact):
            hit = two_body_collision(
                masses=(scene.mass[k], scene.mass[k + 1]),
                velocities=(moving[k], 0.0),
                stiffness=float(c.stiffness[k]),
                exponent=float(c.exponent[k]),
            )
            after[k], moving[k + 1] = hit.exit_velocity
            leaving[k] = arrival[k + 1] = arrival[k] + hit.half_time
            peak_force[k] = hit.peak_force
        after[-1] = moving[-1]  # the last body flies on
        now = times[:, None]
        # a body stands still until it is reached; body 0 moves from the start
        reached, gone = now >= arrival, now >= leaving
        velocity = np.where(gone, after, np.where(reached, moving, 0.0))
        travel = np.clip(now, arrival, leaving) - arrival
        rest = np.where(gone, now - np.where(np.isfinite(leaving), leaving, 0.0), 0.0)
        crossing = np.where(arrival[1:] <= scene.duration, arrival[1:], np.nan)
        return Trajectory(
            time=times,
            displacement=moving * travel + after * rest,
            velocity=velocity,
            contact_force=np.full((len(times), scene.n_contact), np.nan),
            peak_force=peak_force,
            crossing_time=crossing,
            cost=Cost.since(watch, steps=0, force_evaluations=0),
            provenance=run_provenance(self, scene, {"samples": sampling.count}),
        )
