"""Draw chains whose bodies start at tiny gaps or overlaps, graze a wall, touch at the end, or stick to each other."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from dem_bridge.scene.scene import Adhesion, Damping, Scene, Wall
from tests.helpers.decimal_chain import largest_overlap

LAWS = ("kuwabara-kono", "dashpot", "mass_velocity", "tsuji", "coeff_restitution")


def tiny_gaps(seed: int) -> Scene:
    """Return 2 to 4 bodies with gaps, or initial overlaps, of 5e-324 to 4e-15 m."""
    rng = np.random.default_rng([7, 3, seed])
    n = int(rng.integers(2, 5))
    exponents = (2.0, 2.5, 3.0, 3.5, 4.0, 4.5, 5.0)
    exponent = np.full(n + 1, rng.choice([2.0, 2.5, 3.0, 5.0, *exponents]))
    if rng.uniform() < 0.2:
        exponent = rng.choice(exponents, n + 1)
    mass, speed = 10.0 ** rng.uniform(-3, 0) * 10.0 ** rng.uniform(-1.5, 1.5, n), 10.0 ** rng.uniform(-3, 1)
    depth = 10.0 ** rng.uniform(-7, -4) * 10.0 ** rng.uniform(-0.5, 0.5, n + 1)
    stiffness = 0.25 * exponent * float(np.median(mass)) * speed**2 / depth**exponent
    sizes = ((-52.0 * np.log10(2.0), -14.4), (-40, -12), (-322, -40), (-323.3, -323.3), (-20, -12))
    low, high = sizes[rng.integers(5)]
    gap = 10.0 ** rng.uniform(low, high, n + 1) * rng.choice([1, 1, 1, -1], n + 1) * rng.choice([0, 1, 1, 1], n + 1)
    velocity = speed * np.array([1.0, *np.zeros(n - 1)]) if rng.uniform() < 0.6 else speed * rng.uniform(-1, 1, n)
    duration = float(np.median(depth)) / speed * 10.0 ** rng.uniform(0.3, 1.3)
    walls: dict[str, Any] = {
        side: Wall(stiffness=float(stiffness[at]), gap=float(gap[at]), exponent=float(exponent[at]))
        for side, at in (("wall_left", n - 1), ("wall_right", n))
        if rng.uniform() < 0.3
    }
    return Scene(
        name=f"tiny-{seed}",
        duration=duration,
        mass=tuple(mass),
        velocity=tuple(velocity),
        stiffness=tuple(stiffness[: n - 1]),
        exponent=tuple(exponent[: n - 1]),
        gap=tuple(gap[: n - 1]),
        gravity=float(rng.uniform(-1, 1) * speed / duration) if rng.uniform() < 0.2 else 0.0,
        samples=3,
        **walls,
    )


def graze(seed: int, *, damped: bool = False) -> Scene | None:
    """Return 2 to 4 bodies of which the last turns 1e-20 to 1e-12 m beyond a wall, or before it, by its weight.

    None: it does not turn.
    """
    rng = np.random.default_rng([7, 4, seed])
    n = int(rng.choice([2, 3, 3, 4]))
    exponent = float(rng.choice([2.0, 2.5, 2.5, 3.0, 4.0, 5.0, rng.uniform(2, 5)]))
    mass, speed = 10.0 ** rng.uniform(-2, -1) * 10.0 ** rng.uniform(-0.7, 0.7, n), 10.0 ** rng.uniform(-3, 0.5)
    depth = 10.0 ** rng.uniform(-7, -5)
    stiffness = (
        0.25 * exponent * float(np.median(mass)) * speed**2 / depth**exponent * 10.0 ** rng.uniform(-0.5, 0.5, n)
    )
    duration = depth / speed * 10.0 ** rng.uniform(0.8, 1.6)
    velocity = speed * rng.uniform(0.2, 1, n) if rng.uniform() < 0.5 else np.zeros(n)
    velocity[0] = speed
    scene = Scene(
        name=f"graze-{seed}",
        duration=duration,
        mass=tuple(mass),
        velocity=tuple(velocity),
        stiffness=tuple(stiffness[: n - 1]),
        exponent=exponent,
        gap=tuple(np.where(rng.uniform(size=n - 1) < 0.5, 0.0, depth * 10.0 ** rng.uniform(-2, 1, n - 1))),
        gravity=-speed / duration * rng.uniform(1.0, 8.0),
        wall_right=Wall(stiffness=float(stiffness[-1]), gap=1.0, exponent=exponent),
        damping=_damping(rng, float(np.min(mass)), depth / speed, clip=bool(rng.integers(2))) if damped else None,
        samples=3,
    )
    return _beyond_the_wall(scene, rng.choice([1, 1, 1, -1]) * 10.0 ** rng.uniform(-20, -12))


def arrival(seed: int) -> Scene:
    """Return damped bodies, under drag or not, that touch 1e-18 to 1e-12 of the duration before the end, or after."""
    scene, speed, depth = _soft([7, 11, seed])
    rng = np.random.default_rng([7, 12, seed])
    duration = depth / speed * 10.0 ** rng.uniform(-1, 1.5)
    drag = float(10.0 ** rng.uniform(-1, 1) / duration) if rng.uniform() < 0.5 else 0.0
    way = -speed * math.expm1(-drag * duration) / drag if drag else speed * duration
    gap, n = float(way * (1.0 - rng.choice([1, 1, 1, -1]) * 10.0 ** rng.uniform(-18, -12))), scene.n_body
    assert scene.wall_right is not None
    assert scene.damping is not None
    alone = n == 1
    return replace(
        scene,
        name=f"arrival-{seed}",
        duration=duration,
        drag=drag,
        velocity=(speed, *np.zeros(n - 1)),
        gap=() if alone else (gap, *scene.contacts.gap[1 : n - 1].tolist()),
        wall_right=replace(scene.wall_right, gap=gap) if alone else None,
        damping=replace(scene.damping, coefficient=np.asarray(scene.damping.coefficient).item(0)),
        samples=int(rng.choice([1, 3, 20])),
    )


def soft_graze(seed: int) -> Scene | None:
    """Return damped bodies, n from 1.2 to 2.5, of which the last turns 1e-22 to 1e-12 m beyond a wall, or before it.

    None: it does not turn.
    """
    scene, speed, depth = _soft([7, 13, seed])
    rng = np.random.default_rng([7, 14, seed])
    duration = depth / speed * 10.0 ** rng.uniform(0, 1.3)
    velocity = speed * rng.uniform(0.2, 1, scene.n_body)
    velocity[0] = speed
    scene = replace(
        scene,
        name=f"soft-graze-{seed}",
        duration=duration,
        velocity=tuple(velocity),
        gravity=-speed / duration * rng.uniform(1.0, 4.0),
        drag=float(10.0 ** rng.uniform(-1.5, 0.5) / duration) if rng.uniform() < 0.4 else 0.0,
        samples=3,
    )
    return _beyond_the_wall(scene, rng.choice([1, 1, 1, -1]) * 10.0 ** rng.uniform(-22, -12))


def _soft(seed: list[int]) -> tuple[Scene, float, float]:
    """Return 1 to 3 damped bodies before a wall, the speed (m/s) and the overlap (m) of their impacts."""
    rng = np.random.default_rng(seed)
    n, law, exponent = int(rng.integers(1, 4)), LAWS[seed[-1] % len(LAWS)], float(rng.uniform(1.2, 2.5))
    # below n = 2 the force of the other laws is infinite at touch
    exponent = exponent if law in ("dashpot", "mass_velocity") else float(rng.choice([2.0, 2.5, rng.uniform(2.0, 2.5)]))
    mass, speed, depth = 10.0 ** rng.uniform(-3, -1, n), 10.0 ** rng.uniform(-2, 1), 10.0 ** rng.uniform(-7, -5)
    stiffness = 0.5 * exponent * float(np.median(mass)) * speed**2 / depth**exponent
    scene = Scene(
        name="soft",
        duration=1.0,
        mass=tuple(mass),
        velocity=(speed, *np.zeros(n - 1)),
        stiffness=(stiffness,) * (n - 1),
        exponent=exponent,
        gap=(0.3 * depth,) * (n - 1),
        wall_right=Wall(stiffness=stiffness, gap=1.0, exponent=exponent),
        damping=_damping(rng, float(np.min(mass)), depth / speed, clip=bool(rng.integers(2)), law=law),
    )
    return scene, speed, depth


def _beyond_the_wall(scene: Scene, beyond: float) -> Scene | None:
    """Return the scene with its wall where the last body turns ``beyond`` m behind it; None: it does not turn."""
    far = largest_overlap(scene, scene.n_contact - 1)
    if far is None or far <= -1:
        return None
    assert scene.wall_right is not None
    return replace(scene, wall_right=replace(scene.wall_right, gap=float(1 + far - type(far)(beyond))))


def sticky(seed: int) -> Scene:
    """Return a damped impact of two bodies, or of a body on a wall, with DMT adhesion up to 1,000 times its force."""
    rng = np.random.default_rng([7, 8, seed])
    n = 1 if rng.uniform() < 0.4 else 2
    mass, speed, depth = 10.0 ** rng.uniform(-6, 1, n), 10.0 ** rng.uniform(-6, 1.5), 10.0 ** rng.uniform(-8, -4)
    reduced = 1.0 / float(np.sum(1.0 / mass))
    stiffness = 1.25 * reduced * speed**2 / depth**2.5
    pull_off = stiffness * depth**1.5 * 10.0 ** rng.uniform(-4, 3)
    held = max(depth, (pull_off / stiffness) ** (2.0 / 3.0))
    period = 3.0 * (reduced / (1.5 * stiffness * held**0.5)) ** 0.5
    gap = depth * 10.0 ** rng.uniform(-3, 1) if rng.uniform() < 0.5 else 0.0
    return Scene(
        name=f"sticky-{seed}",
        duration=period * 10.0 ** rng.uniform(-0.3, 1.3) + gap / speed,
        mass=tuple(mass),
        velocity=(speed, 0.0)[:n],
        stiffness=(stiffness,)[: n - 1],
        gap=gap if n > 1 else 0.0,
        wall_right=None if n > 1 else Wall(stiffness=stiffness, gap=gap, exponent=2.5),
        damping=_damping(rng, reduced, period, clip=False),
        adhesion=Adhesion(law="dmt", pull_off=pull_off),
        samples=int(rng.choice([1, 3, 50])),
    )


def _damping(rng: np.random.Generator, mass: float, period: float, *, clip: bool, law: str = "") -> Damping:
    """Return damping that is weak to over-critical at this period, by any law unless one is given."""
    law, part = law or LAWS[max(int(rng.integers(-2, len(LAWS))), 0)], 10.0 ** rng.uniform(-2.5, 1.0)
    coefficient = {"dashpot": part * mass / period, "mass_velocity": part / period, "kuwabara-kono": part * period}
    return Damping(law=law, coefficient=coefficient.get(law, float(rng.uniform(0.05, 0.99))), clip=clip)
