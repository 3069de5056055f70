"""Provide precompressed linear chains in which the closing rate of a contact almost stops, and their closed form.

Contacts of n = 2 that stay closed make a sum of normal modes: the closing rate of a contact is ``sum a_i cos(w_i t)``.
The amplitudes of two modes are such that the rate is extreme at a chosen moment and has a chosen value there: below
zero after a closing, it is a first, shallow maximum of compression; above zero it is none.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from dem_bridge.scene.scene import Scene, Wall
from dem_bridge.trajectory.trajectory import Trajectory

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class DoubleCompression:
    """Hold a scene and the crossing time of its contacts; nan: never."""

    scene: Scene
    contact: int
    """The contact whose closing rate almost stops."""
    crossing_time: tuple[float, ...]

    def outside(self, run: Trajectory) -> list[int]:
        """Return the contacts whose crossing is further off than the run states."""
        truth, bar = np.array(self.crossing_time), np.asarray(run.uncertainty["crossing_time"])
        error = np.where(np.isnan(truth) != np.isnan(run.crossing_time), np.inf, np.abs(run.crossing_time - truth))
        # the sums of modes are rounded
        rounding = 1e-13 * self.scene.duration
        return np.flatnonzero(np.nan_to_num(error, nan=0.0, posinf=np.inf) > bar + rounding).tolist()


def double_compression(seed: int, depth: float) -> DoubleCompression | None:
    """Return a chain between walls with an extreme closing rate of ``depth`` times the largest, beyond zero.

    A negative ``depth`` keeps the rate on its side of zero. None: the drawn numbers do not make such a motion.
    """
    rng = np.random.default_rng([30, seed])
    n = int(rng.integers(2, 5))
    mass, stiffness = 10.0 ** rng.uniform(-3, -1, n), 10.0 ** rng.uniform(7, 9.5, n + 1)
    root = np.sqrt(mass)
    pressed = np.diag(stiffness[:-1] + stiffness[1:]) - np.diag(stiffness[1:-1], 1) - np.diag(stiffness[1:-1], -1)
    squares, modes = np.linalg.eigh(pressed / np.outer(root, root))
    omega, shapes = np.sqrt(squares), modes / root[:, None]
    padded = np.vstack([np.zeros(n), shapes, np.zeros(n)])
    rates = padded[:-1] - padded[1:]  # closing rate of each contact in each mode
    contact = int(rng.integers(n + 1))
    moment = float(rng.uniform(0.5, 6.0)) / float(rng.choice(omega))
    first, second = rng.choice(n, 2, replace=False)
    amplitude = rng.uniform(-1.0, 1.0, n)
    chosen = [first, second]
    side = float(rng.choice([-1.0, 1.0]))  # 1: a closing that dips below zero; -1: an opening that rises above it
    share = np.delete(np.arange(n), chosen)
    scale = float(np.max(np.abs(rates[contact])))
    table = rates[contact] * np.array([np.cos(omega * moment), -omega * np.sin(omega * moment)])
    wanted = np.array([-side * depth * scale, 0.0]) - table[:, share] @ amplitude[share]
    try:
        amplitude[chosen] = np.linalg.solve(table[:, chosen], wanted)
    except np.linalg.LinAlgError:
        return None
    velocity = shapes @ amplitude
    bent = side * float(-np.cos(omega * moment) @ (rates[contact] * amplitude * squares))
    if bent <= 0.0 or np.max(np.abs(amplitude)) > 50.0:
        return None
    # until the rate falls through zero, if it does
    times = np.linspace(0.0, moment - 2.0 * np.sqrt(2.0 * max(depth, 1e-4) * scale / bent), 2000)
    if times[-1] <= 0.0 or np.any(side * np.cos(np.outer(times, omega)) @ (rates[contact] * amplitude) <= 0.0):
        return None
    amplitude *= 0.5 / np.max(np.abs(velocity))
    velocity = shapes @ amplitude
    duration = moment + float(rng.uniform(3.0, 12.0)) / float(omega[0])
    times = np.linspace(0.0, duration, 20_001)
    overlaps = (np.sin(np.outer(times, omega)) / omega) @ (rates * amplitude).T
    force = 1.5 * float(np.max(np.abs(overlaps) * stiffness))
    scene = Scene(
        name=f"double-{seed}",
        duration=duration,
        mass=tuple(mass.tolist()),
        stiffness=tuple(stiffness[1:-1].tolist()),
        exponent=2.0,
        velocity=tuple(velocity.tolist()),
        wall_left=Wall(stiffness=float(stiffness[0]), exponent=2.0),
        wall_right=Wall(stiffness=float(stiffness[-1]), exponent=2.0),
        precompression=force,
        samples=20,
    )
    crossings = [_first_fall(omega, rates[k] * amplitude, duration) for k in range(n + 1)]
    # a scene has the chain's contacts first, then those of the walls
    order = [*range(1, n), 0, n]
    return DoubleCompression(scene, order.index(contact), tuple(crossings[k] for k in order))


def _first_fall(omega: Floats, weights: Floats, duration: float) -> float:
    """Return the first time at which ``sum w_p cos(omega_p t)`` falls through zero; nan: not before ``duration``."""

    def rate(time: float) -> float:
        return float(weights @ np.cos(omega * time))

    def bend(time: float) -> float:
        return float(-(weights * omega) @ np.sin(omega * time))

    times = np.linspace(0.0, duration, int(duration * omega.max() * 60.0) + 2).tolist()
    # brackets: sampled times, and each extreme between two of them
    marks = [times[0]]
    for here, there in pairwise(times):
        if bend(here) * bend(there) < 0.0:
            marks.append(brentq(bend, here, there, xtol=1e-300, rtol=1e-15))
        marks.append(there)
    for here, there in pairwise(marks):
        if rate(here) > 0.0 >= rate(there):
            return float(brentq(rate, here, there, xtol=1e-300, rtol=1e-15))
    return float("nan")
