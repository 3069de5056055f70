"""Provide one body before a wall, or two bodies, that come near touch or their first maximum of compression at the end.

Before the first touch the way is a closed form in extended precision: drag, weight, a wave, or free flight. After it
scipy integrates overlap and closing rate in units of the touch. ``share`` says how far the gap, or the duration, is
from that at which the bodies just touch, or just cross.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from dem_bridge.scene.drive import Drive
from dem_bridge.scene.scene import Scene, Wall
from dem_bridge.trajectory.trajectory import Trajectory


@dataclass(frozen=True)
class NearTouch:
    """Hold a scene of one contact and what is true of it; the truth is uncertain by a part of 1e-5."""

    scene: Scene
    peak_force: float
    crossing_time: float

    def outside(self, run: Trajectory) -> list[str]:
        """Return the quantities that are further off than the run states."""
        found = []
        bars = {name: float(run.uncertainty[name][0]) for name in ("peak_force", "crossing_time")}
        if not abs(run.peak_force[0] - self.peak_force) <= bars["peak_force"] + 1e-5 * self.peak_force:
            found.append("peak_force")
        same = math.isnan(self.crossing_time) and np.isnan(run.crossing_time[0])
        error = 0.0 if same else abs(run.crossing_time[0] - self.crossing_time)
        if not (error <= bars["crossing_time"] + 1e-12 * self.scene.duration or math.isinf(bars["crossing_time"])):
            found.append("crossing_time")
        return found


def _after_touch(
    *, rate: float, until: float, exponent: float, strength: float, drag: float, push: Callable[[float], float]
) -> tuple[float, float]:
    """Return the largest overlap (m) and the time of its first maximum (s; nan: none) ``until`` seconds after touch.

    ``strength`` is the stiffness over the reduced mass; ``push`` the closing acceleration after a time since touch.
    """
    pushed = max(abs(push(part * until)) for part in np.linspace(0.0, 1.0, 33))
    depth = (0.5 * exponent * rate**2 / strength) ** (1.0 / exponent)
    # the lesser of the times to stop and to the end, for a motion that the force or the push begins
    unit = min(until, depth / rate if depth > 0.0 else until)
    length = rate * unit + 0.5 * pushed * unit**2
    if length == 0.0:
        return 0.0, math.nan

    def slope(t: float, y: Any) -> list[float]:
        own = strength * (length * y[0]) ** (exponent - 1.0) if y[0] > 0.0 else 0.0
        return [y[1], (push(t * unit) - own) * unit**2 / length - drag * unit * y[1]]

    def turn(t: float, y: Any) -> float:
        return float(y[1])

    turn.direction = -1.0  # type: ignore[attr-defined]

    def opening(t: float, y: Any) -> float:
        return float(y[0]) if t > 0.0 else 1.0

    opening.direction, opening.terminal = -1.0, True  # type: ignore[attr-defined]
    run = solve_ivp(slope, (0.0, until / unit), [0.0, rate * unit / length], method="DOP853", rtol=1e-12, atol=1e-15,
                    events=(turn, opening), max_step=max(0.2, 1e-3 * until / unit))  # fmt: skip
    # once it is open again the bodies part for good
    turns = [(t, y[0]) for t, y in zip(run.t_events[0], run.y_events[0], strict=True) if y[0] > 0.0]
    deepest = max([float(run.y[0][-1]), 0.0, *(y for _, y in turns)]) * length
    return deepest, float(turns[0][0] * unit) if turns else math.nan


def dragged(rng: np.random.Generator, share: float) -> NearTouch:
    """Return bodies that drag stops a ``share`` of their way before touch; they touch if it is negative."""
    speed, drag, exponent = 10.0 ** rng.uniform(-2, 1), 10.0 ** rng.uniform(0, 4), _exponent(rng)
    mass, walled = 10.0 ** rng.uniform(-3, -1, 2), bool(rng.uniform() < 0.4)
    stiffness, gap = 10.0 ** rng.uniform(5, 8), speed / drag * (1.0 + share)
    duration = float(rng.uniform(3.0, 40.0)) / drag
    wall = Wall(stiffness=stiffness, gap=gap, exponent=exponent)
    scene = Scene(
        name="dragged", duration=duration, mass=tuple(mass[: 1 if walled else 2].tolist()), drag=drag, samples=20,
        velocity=(speed,) if walled else (speed, 0.0), **_contact(walled, wall),
    )  # fmt: skip
    reduced = mass[0] if walled else mass[0] * mass[1] / (mass[0] + mass[1])
    left = float(1 - Fraction(gap) * Fraction(drag) / Fraction(speed))  # of the speed at touch
    touch = -math.log(left) / drag if left > 0.0 else math.inf
    if touch >= duration:
        return NearTouch(scene, 0.0, math.nan)
    deepest, crossing = _after_touch(rate=speed * left, until=duration - touch, exponent=exponent,
                                     strength=stiffness / reduced, drag=drag, push=lambda t: 0.0)  # fmt: skip
    return NearTouch(scene, stiffness * deepest ** (exponent - 1.0), touch + crossing)


def thrown(rng: np.random.Generator, share: float) -> NearTouch:
    """Return a body that its weight turns a ``share`` of its way before a ceiling; it touches if that is negative."""
    speed, weight, exponent = 10.0 ** rng.uniform(-2, 1), 10.0 ** rng.uniform(0, 4), _exponent(rng)
    mass, stiffness = 10.0 ** rng.uniform(-3, -1), 10.0 ** rng.uniform(5, 8)
    gap = 0.5 * speed**2 / weight * (1.0 + share)
    duration = float(rng.uniform(1.001, 1.9)) * speed / weight
    wall = Wall(stiffness=stiffness, gap=gap, exponent=exponent)
    scene = Scene(name="thrown", duration=duration, mass=(mass,), stiffness=(), velocity=(speed,), gravity=-weight,
                  wall_right=wall, samples=20)  # fmt: skip
    square = float(Fraction(speed) ** 2 - 2 * Fraction(weight) * Fraction(gap))
    if square <= 0.0:
        return NearTouch(scene, 0.0, math.nan)
    rate = math.sqrt(square)
    touch = 2.0 * gap / (speed + rate)
    deepest, crossing = _after_touch(rate=rate, until=duration - touch, exponent=exponent, strength=stiffness / mass,
                                     drag=0.0, push=lambda t: -weight)  # fmt: skip
    return NearTouch(scene, stiffness * deepest ** (exponent - 1.0), touch + crossing)


def shaken(rng: np.random.Generator, share: float) -> NearTouch:
    """Return a body that a sine wave turns a ``share`` of its way before a wall; it touches if that is negative."""
    mass, stiffness, exponent = 10.0 ** rng.uniform(-3, -1), 10.0 ** rng.uniform(5, 8), _exponent(rng)
    frequency, force = 10.0 ** rng.uniform(2, 4), 10.0 ** rng.uniform(-1, 2)
    turn, push = 2.0 * math.pi * frequency, force / mass
    # its velocity is push/turn (0.4 - cos(turn t)), and falls through zero for the first time here
    angle, scale = 2.0 * math.pi - math.acos(0.4), push / turn**2
    top = np.longdouble(scale) * (np.longdouble(0.4) * np.longdouble(angle) - np.sin(np.longdouble(angle)))
    gap, duration = float(top * (1.0 + np.longdouble(share))), angle / turn * float(rng.uniform(1.001, 1.3))
    scene = Scene(
        name="shaken", duration=duration, mass=(mass,), stiffness=(), velocity=(-0.6 * push / turn,), samples=20,
        wall_right=Wall(stiffness=stiffness, gap=gap, exponent=exponent),
        drive=Drive(shape="sine", force=force, frequency=frequency),
    )  # fmt: skip
    beyond = float(top - np.longdouble(gap))
    if beyond <= 0.0:
        return NearTouch(scene, 0.0, math.nan)
    sine = math.sin(angle)

    def back(phase: float) -> float:  # way from the turn, without cancellation
        return float(scale) * (0.4 * (math.sin(phase) - phase) - 2.0 * sine * math.sin(0.5 * phase) ** 2)

    phase = brentq(lambda p: beyond - back(p), -1.0, 0.0, xtol=1e-300, rtol=1e-14)
    rate = push / turn * (0.4 * 2.0 * math.sin(0.5 * phase) ** 2 + sine * math.sin(phase))
    touch = (angle + phase) / turn
    deepest, crossing = _after_touch(rate=rate, until=duration - touch, exponent=exponent, strength=stiffness / mass,
                                     drag=0.0, push=lambda t: push * math.sin(turn * (touch + t)))  # fmt: skip
    return NearTouch(scene, stiffness * deepest ** (exponent - 1.0), touch + crossing)


def arriving(rng: np.random.Generator, share: float) -> NearTouch:
    """Return bodies under drag or weight that touch a ``share`` of the duration after the end, or before."""
    speed, exponent, walled = 10.0 ** rng.uniform(-2, 1), _exponent(rng), bool(rng.uniform() < 0.5)
    mass, stiffness = 10.0 ** rng.uniform(-3, -1, 2), 10.0 ** rng.uniform(5, 8)
    drag, touch = 10.0 ** rng.uniform(0, 4), 0.0
    touch = float(rng.uniform(0.05, 3.0)) / drag
    gap = -math.expm1(-drag * touch) * speed / drag
    left = float(1 - Fraction(gap) * Fraction(drag) / Fraction(speed))
    touch = -math.log(left) / drag
    duration = touch * (1.0 - share)
    wall = Wall(stiffness=stiffness, gap=gap, exponent=exponent)
    scene = Scene(
        name="arriving", duration=duration, mass=tuple(mass[: 1 if walled else 2].tolist()), drag=drag, samples=20,
        velocity=(speed,) if walled else (speed, 0.0), **_contact(walled, wall),
    )  # fmt: skip
    reduced = mass[0] if walled else mass[0] * mass[1] / (mass[0] + mass[1])
    if duration <= touch:
        return NearTouch(scene, 0.0, math.nan)
    deepest, crossing = _after_touch(rate=speed * left, until=duration - touch, exponent=exponent,
                                     strength=stiffness / reduced, drag=drag, push=lambda t: 0.0)  # fmt: skip
    return NearTouch(scene, stiffness * deepest ** (exponent - 1.0), touch + crossing)


def _exponent(rng: np.random.Generator) -> float:
    return float(rng.choice([2.0, 2.5, 3.0, rng.uniform(1.2, 2.0), rng.uniform(2.0, 5.0)]))


def _contact(walled: bool, wall: Wall) -> dict[str, Any]:
    """Return the fields of a scene whose only contact is ``wall``, or is like it."""
    if walled:
        return {"stiffness": (), "wall_right": wall}
    return {"stiffness": (wall.stiffness,), "gap": wall.gap, "exponent": wall.exponent}
