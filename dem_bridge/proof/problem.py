"""The exact numbers of a scene that can be proved, and the bits that its proof needs, from a run in doubles."""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from dem_bridge.backends.base import Resolution, Sampling, backend
from dem_bridge.errors import UnsupportedScene
from dem_bridge.scene.features import (
    GAPS,
    GRADED_EXPONENTS,
    GRAVITY,
    INITIAL_OVERLAPS,
    OTHER_EXPONENTS,
    PRECOMPRESSION,
    SEVERAL_MOVING,
    WALLS,
)
from dem_bridge.scene.scene import Scene
from dem_bridge.scene.support import Exponents, Support

#: scenes that can be proved: the force is a whole power of the root of the overlap, and nothing else depends on it
SUPPORT = Support(
    {WALLS, GAPS, INITIAL_OVERLAPS, SEVERAL_MOVING, OTHER_EXPONENTS, GRADED_EXPONENTS, GRAVITY, PRECOMPRESSION},
    exponents=Exponents(values=(2.0, 2.5, 3.0, 3.5, 4.0, 4.5, 5.0)),
)
#: samples of the run from which the growth of radii follows, and terms of the exponential between two of them
_PRESCAN_SAMPLES, _TERMS = 2000, 16


@dataclass(frozen=True, kw_only=True)
class Problem:
    """The numbers of a scene as exact fractions; contacts in the order of a Trajectory, a wall is body ``n_body``."""

    mass: tuple[Fraction, ...]
    left: tuple[int, ...]
    right: tuple[int, ...]
    stiffness: tuple[Fraction, ...]
    doubled: tuple[int, ...]
    """Twice the exponent of the force, 2 (n - 1)."""
    gap: tuple[Fraction, ...]
    velocity: tuple[Fraction, ...]
    acceleration: tuple[Fraction, ...]
    """Constant acceleration of each body: gravity and the load of a precompression."""
    duration: Fraction
    count: int


@dataclass(frozen=True, kw_only=True)
class Scale:
    """What a run in doubles says of a scene: its speed, its shortest time, and how radii of balls grow."""

    speed: float
    """Largest speed of any body, m/s."""
    time: float
    """1/omega of the stiffest contact, s."""
    growth: float
    """Bits that plain balls lose until the end."""


def problem_of(scene: Scene) -> Problem:
    """Return the exact numbers of a scene.

    Raises
    ------
    UnsupportedScene
        If the scene has a feature that cannot be proved; the message names it.

    Examples
    --------
    >>> import dem_bridge as db
    >>> pair = db.Scene(name="pair", duration=1e-4, mass=(8e-3, 1e-2), stiffness=(4e9,), velocity=(0.8, 0.0))
    >>> problem_of(pair).doubled
    (3,)
    """
    if reason := SUPPORT.unsupported_reason(scene):
        raise UnsupportedScene(f"{scene.name} cannot be proved: {reason}")
    c = scene.contacts
    mass = tuple(map(Fraction, scene.mass))
    loads = zip(mass, scene.load.tolist(), strict=True)
    return Problem(
        mass=mass,
        left=tuple(c.left.tolist()),
        right=tuple(c.right.tolist()),
        stiffness=tuple(map(Fraction, c.stiffness.tolist())),
        doubled=tuple(round(2.0 * (n - 1.0)) for n in c.exponent.tolist()),
        gap=tuple(map(Fraction, c.gap.tolist())),
        velocity=tuple(map(Fraction, scene.velocity)),
        acceleration=tuple(Fraction(scene.gravity) + Fraction(load) / m for m, load in loads),
        duration=Fraction(scene.duration),
        count=scene.samples,
    )


def measure_scale(scene: Scene) -> Scale:
    """Return speed, shortest time and growth of radii of a scene, from a run of the reference.

    Radii grow at most like the solution of e' = v, v' = |J| e with the magnitudes of the Jacobian along the run.
    """
    run = backend("reference").run(scene, Resolution(), Sampling(count=_PRESCAN_SAMPLES))
    c, n = scene.contacts, scene.n_body
    shift = np.column_stack([run.displacement, np.zeros(len(run.time))])
    overlap = np.maximum(shift[:, c.left] - shift[:, c.right] - c.gap, 0.0)
    slope = (c.exponent - 1.0) * c.stiffness * overlap ** (c.exponent - 2.0) * (overlap > 0.0)
    mobility = scene.mobility
    fastest = math.sqrt(float(np.max(slope * (mobility[c.left] + mobility[c.right]), initial=0.0)))
    speed = float(np.max(np.abs(run.velocity), initial=0.0))
    time = min(1.0 / fastest if fastest > 0.0 else scene.duration, scene.duration)
    x, v, bits = np.full(n + 1, time), np.ones(n + 1), 0.0
    step = scene.duration / _PRESCAN_SAMPLES
    for gains in np.maximum(slope[:-1], slope[1:]):
        terms_x, terms_v = x, v
        for term in range(1, _TERMS):
            force = gains * (terms_x[c.left] + terms_x[c.right])
            push = np.bincount(c.left, force, n + 1) + np.bincount(c.right, force, n + 1)
            terms_x, terms_v = terms_v * step / term, push * mobility * step / term
            terms_x[n] = 0.0
            x, v = x + terms_x, v + terms_v
        largest = float(v.max())
        x, v, bits = x / largest, v / largest, bits + math.log2(largest)
    if speed == 0.0:
        speed = float(np.max(np.abs(scene.free_acceleration), initial=0.0)) * time or 1.0
    return Scale(speed=speed, time=time, growth=bits)
