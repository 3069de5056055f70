"""Provide random scenes with damped contacts and drag: n = 2 and 5/2 side by side, gaps, walls, weight, precompression.

Two to 8 bodies over a decade of masses and one and a half of stiffnesses; in two thirds of the contacts a dashpot or
Kuwabara-Kono damping of a hundredth to three times the critical one at the largest overlap; drag in four of ten.
"""

from __future__ import annotations

import numpy as np

from dem_bridge.scene.scene import Damping, Scene, Wall


def random_damped(seed: int, *, severe: bool = False) -> Scene:
    """Return scene ``seed``.

    ``severe``: dashpots alone, of a tenth to ten times critical damping, and all contacts open, so
    that forces jump somewhere within a step."""
    rng = np.random.default_rng([1971, seed])
    n = int(rng.integers(2, 9))
    links = n - 1
    mass = 1e-2 * 10 ** rng.uniform(-0.5, 0.5, n)
    exponent = rng.choice([2.0, 2.5], links + 2)
    v0 = 10 ** rng.uniform(-3, 1)
    hertz = 10 ** rng.uniform(8.5, 10, links + 2)
    # linear contacts are as stiff as Hertzian ones at the depth of an impact of 10 g at v0
    depth = (1.25 * v0**2 * 5e-3 / hertz) ** 0.4
    secant = hertz * depth**0.5
    stiffness = np.where(exponent == 2.5, hertz, secant)
    ratio = 10 ** rng.uniform(-1.0 if severe else -2.0, 1.0 if severe else 0.5, links + 2) * (
        rng.uniform(size=links + 2) < 0.7
    )
    law = "dashpot" if severe else ("dashpot", "kuwabara-kono")[int(rng.integers(2))]
    c = 2.0 * ratio * np.sqrt(secant * 5e-3)
    coefficient = c if law == "dashpot" else c / secant
    walls = rng.uniform(size=2) < 0.3
    gap = np.where(
        rng.uniform(size=links + 2) < (2.0 if severe else 0.4), depth * 10 ** rng.uniform(-1, 1, links + 2), 0.0
    )
    pressed = not severe and bool(rng.uniform() < 0.2)
    if pressed:
        gap[:] = 0.0
    velocity = np.zeros(n)
    velocity[0] = v0
    if rng.uniform() < 0.4:
        velocity = v0 * rng.uniform(-1, 1, n)
    duration = float(np.min(depth / v0)) * 10 ** rng.uniform(0.7, 1.8)
    drag = float(10 ** rng.uniform(-2, 0) / duration) if rng.uniform() < 0.4 else 0.0
    gravity = rng.choice([-1, 1]) * v0 / duration * 10 ** rng.uniform(-2, 0) if rng.uniform() < 0.3 else 0.0

    def wall(at: int) -> Wall | None:
        k = links + at
        if not walls[at]:
            return None
        return Wall(stiffness=float(stiffness[k]), gap=float(gap[k]), exponent=float(exponent[k]))

    present = np.concatenate([np.ones(links, dtype=bool), walls])
    return Scene(
        name=f"damped-{seed}",
        duration=duration,
        mass=tuple(mass.tolist()),
        stiffness=tuple(stiffness[:links].tolist()),
        exponent=tuple(exponent[:links].tolist()),
        velocity=tuple(velocity.tolist()),
        gap=tuple(gap[:links].tolist()),
        wall_left=wall(0),
        wall_right=wall(1),
        gravity=float(gravity),
        drag=drag,
        precompression=float(0.1 * np.min(hertz * depth**1.5)) if pressed else 0.0,
        damping=Damping(law=law, coefficient=tuple(coefficient[present].tolist())),
        samples=12,
    )
