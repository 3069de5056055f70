"""Provide collisions of two bodies, or of one body with a wall, and their closed form in decimal arithmetic.

The bodies close in at the exact difference u of their velocities, press ``d = (n m u^2 / (2 beta))^(1/n)`` deep, m the
reduced mass, and need ``d/u sqrt(pi) Gamma(1 + 1/n)/Gamma(1/2 + 1/n)`` for it (Landau & Lifshitz, *Theory of
Elasticity*, section 9, for n = 5/2). Afterwards each has twice the velocity of the centre of mass less its own.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from decimal import Decimal, localcontext
from fractions import Fraction
from typing import Any

import numpy as np

from dem_bridge.scene.scene import Scene, Wall
from dem_bridge.trajectory.trajectory import Trajectory


@dataclass(frozen=True)
class Collision:
    """Hold a scene that lasts beyond its only collision, and what happens in it."""

    scene: Scene
    peak_force: float
    crossing_time: float
    velocity: tuple[float, ...]
    """At the end, m/s."""
    displacement: tuple[float, ...]
    """At the end, m."""

    def outside(self, run: Trajectory) -> dict[str, tuple[float, float]]:
        """Return error and uncertainty of each quantity of a run that is further off than it states."""
        bars, eps = run.uncertainty, float(np.finfo(float).eps)
        way = max(map(abs, self.displacement))
        # the Gamma functions of the half-period are rounded, and with them the way since
        pairs: dict[str, tuple[Any, Any, Any]] = {
            "peak_force": (run.peak_force[0], self.peak_force, np.max(bars["peak_force"])),
            "crossing_time": (run.crossing_time[0], self.crossing_time, np.max(bars["crossing_time"])),
            "velocity": (run.velocity[-1], np.array(self.velocity), bars["velocity"]),
            "displacement": (run.displacement[-1], np.array(self.displacement), bars["displacement"] + 16 * eps * way),
        }
        errors = {
            name: (float(np.max(np.abs(value - truth))), float(bar + 16 * eps * np.max(np.abs(truth))))
            for name, (value, truth, bar) in pairs.items()
        }
        return {name: (error, bar) for name, (error, bar) in errors.items() if not error <= bar}


def collision(
    *, mass: tuple[float, ...], velocity: tuple[float, ...], stiffness: float, exponent: float, gap: float, rest: float
) -> Collision | None:
    """Return the collision of bodies with these masses and velocities; one body meets a wall.

    ``gap`` is in units of the depth of the contact, ``rest`` the time after it in units of the half-period. None: the
    bodies do not meet.
    """
    start = [Fraction(float(v)) for v in velocity]
    closing = start[0] - (start[1] if len(start) > 1 else 0)
    if closing <= 0:
        return None
    heavy = [Fraction(float(m)) for m in mass]
    reduced = heavy[0] if len(heavy) == 1 else heavy[0] * heavy[1] / (heavy[0] + heavy[1])
    n, beta = Fraction(exponent), Fraction(stiffness)
    with localcontext() as context:
        context.prec = 45
        power = _decimal(n * reduced * closing**2 / (2 * beta)).ln() / _decimal(n)
        depth = power.exp()
        force = float(_decimal(beta) * (power * _decimal(n - 1)).exp())
        start_gap = float(depth * Decimal(gap))
        gamma = math.sqrt(math.pi) * math.gamma(1.0 + 1.0 / exponent) / math.gamma(0.5 + 1.0 / exponent)
        half = Fraction(float(depth / _decimal(closing) * Decimal(gamma)))
    touch = Fraction(start_gap) / closing
    duration = float(touch + (2 + Fraction(rest)) * half)
    after = Fraction(duration) - touch - 2 * half
    centre = sum((m * v for m, v in zip(heavy, start, strict=True)), start=Fraction(0)) / sum(heavy)
    centre = centre if len(heavy) > 1 else Fraction(0)
    end = [2 * centre - v for v in start]
    way = [float(v * touch + centre * 2 * half + w * after) for v, w in zip(start, end, strict=True)]
    wall = Wall(stiffness=stiffness, gap=start_gap, exponent=exponent)
    scene = Scene(
        name="collision",
        duration=duration,
        mass=mass,
        velocity=velocity,
        stiffness=() if len(mass) == 1 else (stiffness,),
        exponent=2.5 if len(mass) == 1 else exponent,
        gap=0.0 if len(mass) == 1 else start_gap,
        wall_right=wall if len(mass) == 1 else None,
        samples=3,
    )
    return Collision(scene, force, float(touch + half), tuple(map(float, end)), tuple(way))


def random_collision(seed: int) -> Collision | None:
    """Return a collision of bodies whose masses, speeds and gaps are up to 36 decades apart."""
    rng = np.random.default_rng([2077, seed])
    exponents = [2.0, 2.5, 3.0, 2.000001, 1.5, float(rng.uniform(1.3, 2.0)), float(rng.uniform(2.0, 6.0)), 8.0]
    exponent = exponents[rng.integers(len(exponents))]
    first, speed = 10.0 ** rng.uniform(-3, 1), 10.0 ** rng.uniform(-9, 3)
    ratio = 10.0 ** (rng.uniform(-36, 36) if rng.uniform() < 0.5 else rng.uniform(-3, 3))
    drift = 0.0 if rng.uniform() < 0.4 else float(rng.choice([-1, 1])) * speed * 10.0 ** rng.uniform(-2, 12)
    walled = rng.uniform() < 0.2
    return collision(
        mass=(first,) if walled else (first, first * ratio),
        velocity=(speed,) if walled else (drift + speed, drift),
        stiffness=10.0 ** rng.uniform(-2, 14),
        exponent=exponent,
        gap=0.0 if rng.uniform() < 0.3 else 10.0 ** rng.uniform(-6, 6),
        rest=10.0 ** rng.uniform(-1, 5),
    )


def _decimal(number: Fraction) -> Decimal:
    return Decimal(number.numerator) / Decimal(number.denominator)
