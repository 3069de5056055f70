"""Provide random scenes with a piston, and the same motion without one: a force on a body of a mass beyond all others.

The truths of :mod:`.truths` know no piston. A body that is 1e18 times heavier than the others, under the force that
gives it the acceleration of the piston alone, moves as the piston to 1e-18; so they share no code with a piston.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from dem_bridge.errors import SceneError
from dem_bridge.scene.drive import Drive
from dem_bridge.scene.piston import Piston
from dem_bridge.scene.scene import Damping, Scene
from tests.helpers.many_scenes import drawn, six_digits

#: mass in place of the piston's over the largest of the others
HEAVY = 1e18


def pushed_at_random(seed: int) -> Scene | None:
    """Draw a scene with a piston of constant or sinusoidal velocity; None where the numbers do not make one.

    It is one of :mod:`.many_scenes`, without what moves a heavy body, too (weight, drag, static forces), without
    adhesion, and without damping by the effective mass, which has the mass of the piston.
    """
    scene = drawn(seed)
    if scene is None:
        return None
    rng = np.random.default_rng([21, seed])
    speed = max(map(abs, scene.velocity)) * 10.0 ** rng.uniform(-1.5, 0.3)
    piston = Piston(shape="constant", velocity=six_digits(speed)[0] * float(rng.choice([-1.0, 1.0, 1.0, 1.0])))
    if rng.uniform() < 0.5:
        frequency, phase = (
            six_digits(10.0 ** rng.uniform(-1.0, 1.0) / scene.duration)[0],
            float(rng.integers(-180, 181)),
        )
        piston = Piston(shape="sine", velocity=six_digits(speed)[0], frequency=frequency, phase=phase)
    settings: dict[str, Any] = {
        "drive": piston,
        "wall_left": None,
        "velocity": (0.0, *scene.velocity[1:]),
        "damping": _without_left_wall(scene),
        "gap": 0.0 if scene.precompression > 0.0 else scene.gap,
        **dict.fromkeys(("gravity", "drag", "precompression"), 0.0),
    }
    try:
        return replace(scene, name=f"pushed-{seed}", adhesion=None, **settings)
    except SceneError:
        return None


def _without_left_wall(scene: Scene) -> Damping | None:
    """Return the damping without that of a left wall; None for laws of the effective mass."""
    damping, links = scene.damping, len(scene.stiffness)
    if damping is None or damping.law not in ("dashpot", "kuwabara-kono"):
        return None
    if scene.wall_left is None or not isinstance(damping.coefficient, tuple):
        return damping
    return replace(damping, coefficient=damping.coefficient[:links] + damping.coefficient[links + 1 :])


def with_heavy_body(scene: Scene) -> Scene:
    """Return a scene with a piston as one in which a force moves a heavy body in its place."""
    piston, mass = scene.piston, HEAVY * max(scene.mass[1:])
    assert piston is not None
    drive = None
    if piston.shape == "sine":
        # the derivative of a sine is one with a phase that is 90 degrees ahead
        force = mass * piston.peak * piston.turn
        drive = Drive(shape="sine", force=force, frequency=piston.frequency, phase=piston.phase + 90.0)
    return replace(scene, mass=(mass, *scene.mass[1:]), drive=drive)
