"""Scenes whose motion is known exactly, with certificates that must be proved."""

from __future__ import annotations

from fractions import Fraction
from functools import cache
from typing import Any

import numpy as np

from dem_bridge.scene.scene import Scene, Wall
from tests.helpers import proofs

#: a collision of two bodies over a gap
PAIR = Scene(
    name="pair",
    duration=1.2e-4,
    mass=(8.1e-3, 1e-2),
    stiffness=(4e9,),
    velocity=(0.8, -0.1),
    gap=(2e-6,),
    samples=2,
)
#: three bodies and a wall with forces that are linear in the overlap, under gravity
LINEAR = Scene(
    name="linear",
    duration=4e-4,
    mass=(8.1e-3, 1e-2, 5e-3),
    stiffness=(4e6, 6e6),
    velocity=(0.8, -0.1, 0.0),
    gap=(2e-6, 1e-6),
    exponent=2.0,
    wall_right=Wall(stiffness=5e6, gap=1e-5, exponent=2.0),
    gravity=9.81,
    samples=6,
)
#: three bodies and a wall with Hertz contacts
HERTZ = Scene(
    name="hertz",
    duration=1.5e-4,
    mass=(8.1e-3, 1e-2, 5e-3),
    stiffness=(4e9, 6e9),
    velocity=(0.8, -0.1, 0.0),
    gap=(2e-6, 1e-6),
    wall_right=Wall(stiffness=5e9, gap=1e-6, exponent=2.5),
    gravity=9.81,
    samples=3,
)
#: three bodies in touch: the last contact feels the blow at once, with a faint force
FAINT = Scene(
    name="faint",
    duration=1e-4,
    mass=(8.1e-3, 1e-2, 5e-3),
    stiffness=(4e9, 6e9),
    velocity=(0.8, 0.0, 0.0),
    samples=1,
)


def random_chain(seed: int, bodies: int) -> Scene:
    """Return a chain of random masses, stiffnesses and velocities with gaps, initial overlaps, a wall or gravity."""
    rng = np.random.default_rng(seed)
    contacts = bodies - 1
    return Scene(
        name=f"random-{seed}",
        duration=3e-4,
        mass=tuple(rng.uniform(5e-3, 2e-2, bodies).tolist()),
        stiffness=tuple(10.0**power for power in rng.uniform(9.5, 10.8, contacts).tolist()),
        velocity=(float(rng.uniform(0.3, 1.0)), *rng.uniform(-0.1, 0.1, contacts).tolist()),
        exponent=tuple(rng.choice([2.5, 2.5, 3.0], contacts).tolist()),
        gap=tuple(rng.choice([0.0, 1e-6, -2e-7], contacts).tolist()),
        wall_right=Wall(stiffness=8e9, gap=1e-6) if seed % 2 else None,
        gravity=9.81 if seed % 3 == 0 else 0.0,
        samples=60,
    )


Radii = list[tuple[Fraction, Fraction]]


def powers(*exponents: tuple[int, int]) -> Radii:
    """Return radii of displacements (m) and velocities (m/s) as negative powers of ten."""
    return [(Fraction(1, 10**x), Fraction(1, 10**v)) for x, v in exponents]


@cache
def pair_motion() -> proofs.Motion:
    return proofs.collision(PAIR)


@cache
def linear_motion() -> proofs.Motion:
    return proofs.linear(LINEAR)


def pair() -> dict[str, Any]:
    """Return a certificate of the collision; its checkpoints are before and after it."""
    times = list(map(proofs.dyadic, (1e-6, 9e-5, 1.1e-4)))
    return proofs.certificate(pair_motion(), times, powers((34, 30), (32, 26), (30, 25)))


def linear() -> dict[str, Any]:
    """Return a certificate of the linear chain up to 0.4 ms less 1e-15 s."""
    times = [proofs.dyadic(1e-4), proofs.dyadic(2.1e-4), proofs.dyadic(4e-4, 60) - Fraction(1, 2**50)]
    return proofs.certificate(linear_motion(), times, powers((36, 31), (32, 27), (24, 19)))


def hertz() -> dict[str, Any]:
    """Return a certificate of the Hertz chain by decimal arithmetic of 40 digits."""
    times = [proofs.dyadic(5e-5, 60), proofs.dyadic(1e-4, 60), proofs.dyadic(1.5e-4, 60) - Fraction(1, 2**50)]
    return proofs.certificate(proofs.digits(HERTZ), times, powers((26, 21), (23, 18), (20, 15)))
