"""Fast motion of a changed scene at the times of a file: exact, or by the method and at the step of another code."""

from __future__ import annotations

import math
import pickle
from dataclasses import dataclass
from functools import cache, lru_cache
from importlib.machinery import ModuleSpec
from importlib.util import find_spec
from pathlib import Path
from runpy import run_path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from dem_bridge.backends.driven import driven_of
from dem_bridge.backends.scales import natural_scales
from dem_bridge.errors import RunBroken
from dem_bridge.judging import kernels, plain_kernels
from dem_bridge.judging.kernels import System, kinds_of
from dem_bridge.scene.scene import Scene

Floats = NDArray[np.float64]

#: tolerance of a step of the adaptive method; the error of velocities is some ten times larger
ADAPTIVE_STEP_TOLERANCE = 1e-11
#: memory of the exact motions that a model keeps, bytes
_KEPT_MEMORY = 30_000_000


def system_of(scene: Scene) -> System:
    """Return the numbers of a scene whose contacts are powers of the overlap."""
    c, n = scene.contacts, scene.n_body
    place = np.where(c.left == n, 0, c.left + 1)

    def along(values: Floats, absent: float) -> Floats:
        out = np.full(n + 1, absent)
        out[place] = values
        return out

    exponent = along(c.exponent, 2.5 if np.all(c.exponent == 2.5) else float(c.exponent[0]))
    damping, pull_off = along(c.damping, 0.0), along(c.pull_off, 0.0)
    return System(
        mass=np.array(scene.mass),
        velocity=np.array(scene.velocity),
        free=scene.free_acceleration,
        stiffness=along(c.stiffness, 0.0),
        exponent=exponent,
        gap=along(c.gap, 0.0),
        damping=damping,
        damping_power=along(c.damping_power, 0.0),
        pull_off=pull_off,
        drag=scene.drag,
        driven=driven_of(scene),
        clipped=bool(c.clip),
        pulls=False,
        first_step=1e-4 * scene.duration,
        **kinds_of(exponent, damping, pull_off),
    )


@dataclass(frozen=True, eq=False)
class Motion:
    """Samples of a motion: displacement, velocity, acceleration ``(n_t, n)``, force along the line ``(n_t, n + 1)``."""

    displacement: Floats
    velocity: Floats
    acceleration: Floats
    force: Floats


class MotionTooLong(RunBroken):
    """The motion of a scene needs so many steps of the adaptive method that it was not followed to its end."""


class Model:
    """The motion of a scene with other numbers, at given times."""

    def __init__(self, scene: Scene) -> None:
        self.scene, self.system = scene, system_of(scene)
        speed, depth = natural_scales(scene)
        self.speed = speed if speed > 0.0 else 1.0
        self.depth = float(np.max(depth, initial=0.0))
        table = _dop853()
        weights = np.array(table.B)
        self._pair = np.array(table.A[: len(weights), : len(weights)]), weights, np.array([table.E3, table.E5])
        self._kept: dict[bytes, Motion] = {}
        self._kept_memory = 0

    def exact(self, system: System, times: Floats, tolerance: float = ADAPTIVE_STEP_TOLERANCE) -> Motion:
        """Return the motion at ``times`` (s, not falling, from 0) by an adaptive method of order 8.

        Velocities of another system than that of the scene are nan from where they need too many steps. A motion that
        was computed before is returned again: a search comes back to up to a third of its systems.

        Raises
        ------
        MotionTooLong
            If the motion of the scene itself needs too many steps.
        """
        key = pickle.dumps((system, times, tolerance))
        if (motion := self._kept.get(key)) is None:
            motion = self._integrated(system, times, tolerance)
            self._keep(key, motion)
        return motion

    def _keep(self, key: bytes, motion: Motion) -> None:
        """Keep a motion, and forget all others where they would take too much memory."""
        arrays = (motion.displacement, motion.velocity, motion.acceleration, motion.force)
        memory = len(key) + sum(array.nbytes for array in arrays)
        for array in arrays:
            array.flags.writeable = False
        if self._kept_memory + memory > _KEPT_MEMORY:
            self._kept.clear()
            self._kept_memory = 0
        self._kept[key] = motion
        self._kept_memory += memory

    def _integrated(self, system: System, times: Floats, tolerance: float) -> Motion:
        line, power = plain_kernels.line_of(system), plain_kernels.power_of(system)
        rest = (np.array(times, dtype=np.float64), self.speed, tolerance, *self._pair)
        *motion, end = (
            kernels.adaptive(system, *rest)
            if line is None
            else plain_kernels.adaptive(line, power, system.first_step, *rest)
        )
        if system is self.system and end < times[-1]:
            raise MotionTooLong(
                f"the exact motion of {self.scene.name} takes more than {kernels.MOST_ADAPTIVE_STEPS} steps to"
                f" {times[-1]:.3g} s (it was followed to {end:.3g} s): give an earlier end"
            )
        return Motion(*motion)

    def stepped(self, system: System, steps: NDArray[np.int64], dt: float, method: int = kernels.VERLET) -> Motion:
        """Return the motion after ``steps`` steps of ``dt`` (s) by a method of :mod:`.kernels`."""
        line, power = plain_kernels.line_of(system), plain_kernels.power_of(system)
        if line is None or method not in plain_kernels.METHODS:
            return Motion(*kernels.fixed(system, steps, dt, method, self.speed))
        if method == kernels.RK4:
            return Motion(*plain_kernels.runge_kutta(line, power, steps, dt, self.speed))
        return Motion(*plain_kernels.fixed(line, power, steps, dt, method))

    def stepped_at(
        self, system: System, times: Floats, dt: float, method: int = kernels.VERLET, rows: int | None = None
    ) -> Motion:
        """Return the motion at ``times`` (s) by steps of ``dt`` (s), interpolated where times are between steps.

        The interpolation is Hermite's of third degree, in displacements by velocities, in velocities by accelerations.
        With ``rows`` the motion ends after so many of the times, at which it is the same.
        """
        place = times / dt
        below = np.floor(place + 1e-5).astype(np.int64)
        fraction = place - below
        on_steps = np.max(np.abs(fraction)) < 2e-5 + 1e-9 * float(np.max(place))
        below, fraction = below[:rows], fraction[:rows]
        if on_steps:
            return self.stepped(system, below, dt, method)
        steps, inverse = np.unique(np.concatenate([below, below + 1]), return_inverse=True)
        motion = self.stepped(system, steps, dt, method)
        low, high = np.split(inverse, 2)
        s = fraction[:, None]

        def between(value: Floats, slope: Floats) -> Floats:
            first, last = value[low], value[high]
            rise, bend = last - first, dt * slope[low]
            return np.asarray(
                first
                + s * (bend + s * (3 * rise - 2 * bend - dt * slope[high] + s * (bend + dt * slope[high] - 2 * rise)))
            )

        def line(value: Floats) -> Floats:
            return np.asarray(value[low] + s * (value[high] - value[low]))

        return Motion(
            between(motion.displacement, motion.velocity),
            between(motion.velocity, motion.acceleration),
            line(motion.acceleration),
            line(motion.force),
        )


@lru_cache(maxsize=1)
def model_of(scene: Scene) -> Model:
    """Return the model of a scene: fits and errors of steps of one file need the same motions."""
    return Model(scene)


@cache
def _dop853() -> Any:
    """Return scipy's table of DOP853 by its file, because scipy.integrate brings half of scipy for it (0.4 s)."""
    (folder,) = cast(ModuleSpec, find_spec("scipy")).submodule_search_locations or ("",)
    path = Path(folder, "integrate", "_ivp", "dop853_coefficients.py")
    if path.exists():
        return SimpleNamespace(**run_path(str(path)))
    from scipy.integrate import DOP853

    return DOP853


def resolving_step(model: Model, end: float, most: int) -> float:
    """Return a step (s) that resolves the contacts, of which at most ``most`` go to the time ``end`` (s)."""
    system, depth = model.system, max(model.depth, 1e-15)
    stiffness = (system.exponent - 1.0) * system.stiffness * depth ** (system.exponent - 2.0)
    rate = math.sqrt(float(np.max(stiffness)) * 2.0 / float(np.min(system.mass)))
    return max(min(end / 2e4, 0.1 / rate if rate > 0.0 else end), end / most)
