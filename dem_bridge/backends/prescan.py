"""A coarse run of a scene before the real run: the depth and rate of its contacts, and the range of its bodies.

Decks need it for the surrogate radius (:mod:`.surrogate_radius`), fixed-step runs for the spacing of dense samples. It
is velocity-Verlet with a step that follows the stiffest contact of the moment, accurate to about a per cent, or a few
with damping.
"""

from __future__ import annotations

import math
import sys
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dem_bridge.backends.driven import Driven, driven_of, driving_force, piston_motion, rate_of
from dem_bridge.errors import RunBroken
from dem_bridge.foundation.compiled import interruptible, kernel
from dem_bridge.scene.scene import Scene

#: one number for each body or contact: an array, or a list for the interpreter
Row = Any
#: fraction of 1/omega taken as the step
_STEP = 0.1
#: contacts times steps that are interpreted in less time than the compiler takes to load; steps of most scenes
MOST_INTERPRETED, _USUAL_STEPS = 150_000, 2_000


@dataclass(frozen=True, kw_only=True)
class Prescan:
    """Result of :func:`prescan_hertz`."""

    peak_overlap: NDArray[np.float64]
    """(n_contact,), m."""
    frequency: float
    """rad/s: highest angular frequency of a contact between its two bodies; or rate, where damping or drag stops a
    body, or a drive changes, faster than that."""
    max_acceleration: float
    """m/s^2."""
    lowest: float
    """m: least displacement of any body."""
    highest: float
    """m: largest displacement of any body."""
    steps: int


def prescan_hertz(scene: Scene, *, max_steps: int = 200_000_000) -> Prescan:
    """Coarse run of the whole scene. Raises RunBroken where it would take more than ``max_steps``."""
    c = scene.contacts
    inverse_mass = scene.mobility
    bodies = (inverse_mass, np.append(np.array(scene.velocity), 0.0), np.zeros(scene.n_body + 1))
    contacts = (c.left, c.right, c.stiffness, c.exponent, c.damping, c.damping_power, c.clip, c.pull_off)
    numbers = (
        scene.drag,
        scene.free_acceleration,
        driven_of(scene),
        _pace(scene),
        scene.duration,
        _fraction(scene),
    )
    arguments = (*bodies, contacts, -c.gap, np.zeros(scene.n_contact), *numbers)
    peak, frequency, acceleration, low, high, steps = _interpreted(scene, arguments) or interruptible(
        _run, *arguments, max_steps
    )
    peak = np.asarray(peak)
    if steps >= max_steps:
        raise RunBroken(
            f"the coarse run of {scene.name} needs more than {max_steps} steps: a contact of frequency"
            f" {frequency:.3g} rad/s over {scene.duration:g} s; shorten the duration or soften the stiffest contact"
        )
    mobility = inverse_mass[c.left] + inverse_mass[c.right]
    damped = np.where(peak > 0.0, c.damping * peak**c.damping_power * mobility, 0.0)
    return Prescan(
        peak_overlap=peak,
        frequency=max(frequency, rate_of(scene), float(np.max(damped, initial=scene.drag))),
        max_acceleration=acceleration,
        lowest=low,
        highest=high,
        steps=steps,
    )


def _fraction(scene: Scene) -> float:
    """Return the fraction of 1/omega that is the step; with damping and adhesion, of first order, a tenth."""
    return 0.1 * _STEP if scene.damped or scene.adhesive else _STEP


def interpretable(scene: Scene) -> bool:
    """Return whether to interpret the kernel of a prescan: its compiler is not loaded, and loading it takes longer.

    On lists of floats the interpreter does the same operations in the same order by the same C library, so every bit is
    that of the kernel. For the functions of a drive numpy has code of its own.
    """
    steps = _USUAL_STEPS * (_STEP / _fraction(scene))
    return "numba" not in sys.modules and scene.drive is None and scene.n_contact * steps <= MOST_INTERPRETED


def _interpreted(scene: Scene, arguments: tuple[Any, ...]) -> Any:
    """Return what the kernel returns, without its compiler; None if the interpreter is not to be taken."""
    most = MOST_INTERPRETED // max(scene.n_contact, 1)
    with suppress(ArithmeticError):  # where C goes on with inf
        if interpretable(scene) and (result := _run.interpret(*_as_lists((*arguments, most))))[-1] < most:
            return result
    return None


def _as_lists(value: Any) -> Any:
    """Return an argument of the kernel with lists in place of arrays, which are faster to interpret."""
    if isinstance(value, np.ndarray):
        return value.tolist()
    return tuple(map(_as_lists, value)) if type(value) is tuple else value


def _pace(scene: Scene) -> float:
    """rad/s: how fast a drive changes, or moves a contact of body 0 that holds against it; 0 without."""
    if scene.drive is None or scene.drive.peak == 0.0:
        return 0.0
    if scene.piston is not None:
        return max(scene.piston.rate, 1.0 / scene.duration)
    c, inverse_mass = scene.contacts, scene.mobility
    driven = (c.left == 0) | (c.right == 0)
    beta, n = c.stiffness[driven], c.exponent[driven]
    slope = (n - 1.0) * beta * (scene.drive.peak / beta) ** ((n - 2.0) / (n - 1.0))
    mobility = (inverse_mass[c.left] + inverse_mass[c.right])[driven]
    return float(np.max(np.sqrt(slope * mobility), initial=scene.drive.rate))


@kernel()
def _press(k: int, overlap: float, v: Row, a: Row, inverse_mass: Row, contacts: Any) -> float:
    """Add what a closed contact does to its bodies to their accelerations ``a``, and return its elastic force, N."""
    left, right, stiffness, exponent, damping, damping_power, clip, pull_off = contacts
    elastic: float
    if exponent[k] == 2.5:
        elastic = stiffness[k] * overlap * math.sqrt(overlap)
    else:
        elastic = stiffness[k] * overlap ** (exponent[k] - 1.0)
    force = elastic - pull_off[k]
    if damping[k] > 0.0:
        force += damping[k] * overlap ** damping_power[k] * (v[left[k]] - v[right[k]])
    if clip:
        force = max(force, 0.0)
    a[left[k]] -= force * inverse_mass[left[k]]
    a[right[k]] += force * inverse_mass[right[k]]
    return elastic


@kernel()
def _run(
    inverse_mass: Row, velocity: Row, still: Row, contacts: Any, overlap: Row, elastic: Row, drag: float, free: Row,
    driven: Driven, pace: float, duration: float, fraction: float, max_steps: int,
) -> tuple[Row, float, float, float, float, int]:  # fmt: skip
    """Integrate the scene coarsely, and return the largest values of what a Prescan has.

    All arrays may be lists. Index n_body is the wall: no inverse mass, no velocity; ``still (n_body + 1,)`` and
    ``elastic (n_contact,)`` are zeros, ``overlap`` is that of the start and is changed. ``contacts``: the arrays of a
    scene's contacts from ``left`` to ``pull_off``, without the gaps. ``free (n_body,)``: acceleration without
    contact; ``pace``, rad/s: the rate of the drive, which limits the step.
    """
    left, right, stiffness, exponent, damping, damping_power, _, pull_off = contacts
    n_body, n_contact = len(inverse_mass) - 1, len(left)
    v, x, a, peak = velocity.copy(), still.copy(), still.copy(), elastic.copy()
    top_frequency, top_acceleration, low, high = 0.0, 0.0, 0.0, 0.0
    time, steps = 0.0, 0
    falls = False
    for i in range(n_body):
        a[i] = free[i]
        falls = falls or free[i] != 0.0
    moved = driven.piston.moves
    a[0] += driving_force(0.0, driven) * inverse_mass[0]
    for k in range(n_contact):
        if overlap[k] > 0.0:
            peak[k] = overlap[k]
            elastic[k] = _press(k, overlap[k], v, a, inverse_mass, contacts)
    while time < duration and steps < max_steps:
        # frequency each contact would reach if its two bodies were alone from here on
        squared, rate = 0.0, 0.0
        for k in range(n_contact):
            closing = v[left[k]] - v[right[k]]
            if overlap[k] <= 0.0 and closing <= 0.0 and a[left[k]] <= a[right[k]]:
                continue
            mobility = inverse_mass[left[k]] + inverse_mass[right[k]]
            n = exponent[k]
            energy = 0.5 * closing * closing / mobility
            if overlap[k] > 0.0:
                energy += elastic[k] * overlap[k] / n
            # n-th power of the deepest overlap; powers are what takes the time here
            deepest = n * energy / stiffness[k]
            if pull_off[k] > 0.0:  # without a speed it is pulled to a depth of its own
                deepest = (deepest ** (1.0 / n) + (n * pull_off[k] / stiffness[k]) ** (1.0 / (n - 1.0))) ** n
            if deepest > 0.0:
                squared = max(squared, (n - 1.0) * stiffness[k] * deepest ** ((n - 2.0) / n) * mobility)
                if damping[k] > 0.0:
                    rate = max(rate, damping[k] * deepest ** (damping_power[k] / n) * mobility)
        top_frequency = max(top_frequency, math.sqrt(squared))
        dt = duration - time
        if squared > 0.0:
            dt = min(dt, fraction / max(math.sqrt(squared), rate))
        elif falls or a[0] != 0.0:
            dt = min(dt, 1e-3 * duration)
        if pace > 0.0:
            dt = min(dt, fraction / pace)
        slower = math.exp(-drag * dt)  # stable however strong
        for i in range(n_body):
            v[i] += 0.5 * dt * a[i]
            if moved and i == 0:
                v[0] = (piston_motion(time + dt, driven.piston)[0] - x[0]) / dt
            x[i] += dt * v[i]
            a[i] = free[i]
            if x[i] < low:  # faster to interpret than min and max
                low = x[i]
            elif x[i] > high:
                high = x[i]
        a[0] += driving_force(time + dt, driven) * inverse_mass[0]
        for k in range(n_contact):
            overlap[k] += dt * (v[left[k]] - v[right[k]])
            if overlap[k] > 0.0:
                peak[k] = max(peak[k], overlap[k])
                elastic[k] = _press(k, overlap[k], v, a, inverse_mass, contacts)
        for i in range(n_body):
            v[i] = (v[i] + 0.5 * dt * a[i]) * slower
            if moved and i == 0:
                v[0], a[0] = piston_motion(time + dt, driven.piston)[1:]
            if abs(a[i]) > top_acceleration:
                top_acceleration = abs(a[i])
        time += dt
        steps += 1
    return peak, top_frequency, top_acceleration, low, high, steps
