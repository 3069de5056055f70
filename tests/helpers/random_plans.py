"""Provide random scenes for the planner: seeded, as different as those of users.

Of ten, six are chains of 2 to 40 bodies with an impact: graded or random stiffnesses, n = 5/2 mostly, gaps, walls,
weight, precompression; one has an exponent for which the reference has no series; two are of :mod:`.random_scenes`,
whose masses and stiffnesses go over decades; one is of :mod:`.random_damped`.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from dem_bridge.scene.scene import Scene, Wall
from tests.helpers.random_damped import random_damped
from tests.helpers.random_scenes import drawn

#: bodies at most
MOST_BODIES = 40


def planned_scene(seed: int) -> Scene:
    """Return scene ``seed``."""
    kind = seed % 10
    if kind in (3, 7):
        scene = drawn(seed)
        return planned_scene(seed + 100_000) if scene.n_body > MOST_BODIES else scene
    return random_damped(seed) if kind == 9 else _chain(seed, exotic=kind == 5)


def _chain(seed: int, *, exotic: bool) -> Scene:
    rng = np.random.default_rng([1687, seed])
    n = round(math.exp(rng.uniform(math.log(2), math.log(MOST_BODIES))))
    links = n - 1
    middle, v0 = 10.0 ** rng.uniform(-3, -1), 10.0 ** rng.uniform(-2, 1)
    mass = middle * 10.0 ** (rng.uniform(0, 1) * rng.uniform(-0.5, 0.5, n))
    grade = np.linspace(0.0, 1.0, links + 2) if rng.uniform() < 0.5 else rng.uniform(0, 1, links + 2)
    hertz = 10.0 ** (rng.uniform(8.5, 10.5) + rng.uniform(-1.5, 1.5) * grade)
    exponent = float(rng.choice([2.2, 2.35, 3.2])) if exotic else float(rng.choice([2.5, 2.5, 2.5, 2.5, 2.0, 3.0]))
    depth = (1.25 * v0**2 * 0.5 * middle / hertz) ** 0.4
    # another law is as stiff as Hertz' at the depth of an impact
    stiffness = hertz * depth ** (2.5 - exponent)
    pressed = bool(rng.uniform() < 0.2)
    gap = np.where(rng.uniform(size=links + 2) < rng.uniform(0, 0.8), depth * 10.0 ** rng.uniform(-1, 1), 0.0)
    if pressed or rng.uniform() < 0.5:
        gap[:] = 0.0
    velocity = np.zeros(n)
    velocity[0] = v0
    if rng.uniform() < 0.25:
        velocity = v0 * rng.uniform(-1, 1, n)
    walls = rng.uniform(size=2) < 0.25
    crossing = float(np.sum((depth + gap) / v0)) + 2.0 * float(np.max(depth)) / v0
    duration = crossing * rng.uniform(0.7, 5.0)
    gravity = float(rng.choice([-1, 1]) * v0 / duration * 10.0 ** rng.uniform(-2, 0)) if rng.uniform() < 0.25 else 0.0

    def wall(at: int) -> Wall | None:
        return Wall(stiffness=float(stiffness[links + at]), gap=float(gap[links + at])) if walls[at] else None

    parts: dict[str, Any] = {
        "mass": tuple(mass.tolist()),
        "stiffness": tuple(stiffness[:links].tolist()),
        "gap": tuple(gap[:links].tolist()),
        "velocity": tuple(velocity.tolist()),
        "exponent": exponent,
        "wall_left": wall(0),
        "wall_right": wall(1),
        "gravity": gravity,
    }
    if pressed:
        force = float(np.min(hertz * depth**1.5))
        parts["precompression"] = force * 10.0 ** rng.uniform(-2, 0.5)
    samples = int(rng.choice([20, 100, 500]))
    return Scene(name=f"planned-{seed}", duration=duration, samples=samples, **parts)
