"""A prescribed velocity of the first body of a chain: a piston that is constant, a sine, or a table of values."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dem_bridge.errors import SceneError
from dem_bridge.foundation.numbers import Numbers, check_fields
from dem_bridge.scene.drive import checked_table

#: parameters of each shape in addition to its velocity; those with a default are optional
PISTON_KEYS = {"constant": (), "sine": ("frequency", "phase"), "table": ("interval",)}
_NUMBERS = {
    "frequency": Numbers("a number > 0 (Hz)", {"above": 0.0}),
    "interval": Numbers("a number > 0 (s)", {"above": 0.0}),
    "phase": Numbers("a finite number (degrees)"),
}
#: velocities of a Piston that is no table
_VELOCITY = {
    "constant": Numbers("a finite number (m/s)"),
    "sine": Numbers("a number > 0 (m/s); with phase = 180 it moves back first", {"above": 0.0}),
}

#: part of the largest velocity by which the start velocity of body 0 may differ from that of the piston
SAME_START = 1e-9


@dataclass(frozen=True, kw_only=True)
class Piston:
    """Prescribed velocity of body 0, m/s, positive towards the last body, whatever forces act on it.

    ``shape`` is one of

    * "constant": ``velocity`` at all times;
    * "sine": ``velocity sin(2 pi frequency t + phase)``;
    * "table": linear interpolation between the values of ``velocity`` at the times 0, interval, 2 interval, ... .

    The mass of body 0 does not act on the motion, except through damping laws that depend on the effective mass of a
    contact, in which a piston counts with its mass as in LAMMPS' ``fix move``. It is part of momentum and energy.

    Raises
    ------
    SceneError
        If a parameter is invalid or belongs to another shape.

    Examples
    --------
    >>> shaker = Piston(shape="sine", velocity=0.5, frequency=1000.0, phase=90.0)
    >>> shaker.at([0.0, 2.5e-4]).round(12).tolist(), shaker.words
    ([0.5, 0.0], 'sine of 0.5 m/s at 1000 Hz, from 90 degrees')
    >>> ramp = Piston(shape="table", velocity=(0.0, 2.0, 2.0), interval=1e-3)
    >>> ramp.at([5e-4, 1.5e-3]).tolist(), ramp.displacement([1e-3, 2e-3]).tolist()
    ([1.0, 2.0], [0.001, 0.003])
    """

    shape: str
    velocity: float | tuple[float, ...]
    """Velocity, m/s: of a sine its amplitude, of a table its values."""
    frequency: float | None = None
    """Frequency of a sine, Hz."""
    phase: float = 0.0
    """Phase of a sine at time 0, degrees."""
    interval: float | None = None
    """Time between two values of a table, s."""

    def __post_init__(self) -> None:
        if not isinstance(self.shape, str) or self.shape not in PISTON_KEYS:
            allowed = f"{' or '.join(PISTON_KEYS)}, with velocity; a chirp has a force only"
            raise SceneError("drive.shape", value=self.shape, allowed=allowed)
        keys = PISTON_KEYS[self.shape]
        for key in _NUMBERS:
            value, default = getattr(self, key), 0.0 if key == "phase" else None
            if key not in keys and value != default:
                problem = f"does not apply to shape = {self.shape!r} with velocity"
                raise SceneError(f"drive.{key}", problem=problem, allowed=", ".join(("velocity", *keys)))
            if key in keys and value is None:
                raise SceneError(f"drive.{key}", problem="is missing", allowed=_NUMBERS[key].allowed)
        if self.shape == "table":
            object.__setattr__(self, "velocity", checked_table("drive.velocity", self.velocity, "m/s"))
        else:
            check_fields(self, {"velocity": _VELOCITY[self.shape]}, "drive.")
        check_fields(self, {key: _NUMBERS[key] for key in keys}, "drive.")

    def __str__(self) -> str:
        """Return the piston in words."""
        return f"Piston: {self.words}"

    def at(self, time: ArrayLike) -> NDArray[np.float64]:
        """Return the velocity at times >= 0 (s) of any shape, m/s; after its end a table keeps its last value."""
        t = np.asarray(time, dtype=np.float64)
        if self.shape == "constant":
            return np.full(t.shape, self.velocity)
        if self.shape == "sine":
            return np.asarray(self.peak * np.sin(self.turn * t + math.radians(self.phase)))
        cell, fraction = self._places(t)
        values = np.array(self.velocity)
        return np.asarray(values[cell] + (values[cell + 1] - values[cell]) * np.minimum(fraction, 1.0))

    def start(self, velocity: float) -> float:
        """Return the velocity at time 0, m/s; SceneError unless ``velocity``, that of body 0 in a scene, is 0 or this.

        Last digits may differ, so that scenes can be perturbed.
        """
        start = float(self.at(0.0))
        if velocity != 0.0 and abs(velocity - start) > SAME_START * self.peak:
            problem = f"= {velocity!r}, but the piston starts at {start!r} m/s"
            raise SceneError("velocity[0]", problem=problem, allowed="0, which stands for that of the piston")
        return start

    def displacement(self, time: ArrayLike) -> NDArray[np.float64]:
        """Return the displacement since the start at times >= 0 (s), m: the integral of the velocity."""
        t = np.asarray(time, dtype=np.float64)
        if self.shape == "constant":
            return np.asarray(self.velocity * t)
        if self.shape == "sine":
            phase = math.radians(self.phase)
            return np.asarray(self.peak / self.turn * (math.cos(phase) - np.cos(self.turn * t + phase)))
        cell, fraction = self._places(t)
        values, within = np.array(self.velocity), np.minimum(fraction, 1.0)
        bent = values[cell] * within + 0.5 * (values[cell + 1] - values[cell]) * within * within
        return np.asarray(self.knots[cell] + (self.interval or 0.0) * (bent + values[-1] * (fraction - within)))

    def acceleration(self, time: ArrayLike) -> NDArray[np.float64]:
        """Return the acceleration at times >= 0 (s), m/s^2; at a bend of a table that of the time after it."""
        t = np.asarray(time, dtype=np.float64)
        if self.shape == "constant":
            return np.zeros(t.shape)
        if self.shape == "sine":
            return np.asarray(self.peak * self.turn * np.cos(self.turn * t + math.radians(self.phase)))
        cell, fraction = self._places(t)
        slope = np.diff(self.velocity) / (self.interval or math.nan)
        return np.asarray(np.where(fraction < 1.0, slope[cell], 0.0))

    def _places(self, time: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Return the cell of a table at each time, and the time since its start in intervals, above 1 after the end."""
        place = time / (self.interval or math.nan)
        cell = np.minimum(np.floor(place), len(self.knots) - 2)
        return cell.astype(np.int64), np.asarray(place - cell)

    @cached_property
    def knots(self) -> NDArray[np.float64]:
        """Displacement at the time of each value of a table, m; empty for the other shapes."""
        if self.shape != "table":
            return np.zeros(0)
        values = np.array(self.velocity)
        return np.concatenate([[0.0], np.cumsum(0.5 * (self.interval or math.nan) * (values[1:] + values[:-1]))])

    @property
    def turn(self) -> float:
        """Angular frequency of a sine, rad/s; 0 for the other shapes."""
        return 2.0 * math.pi * (self.frequency or 0.0)

    @property
    def end(self) -> float:
        """Time until which the velocity is defined, s; inf unless it is a table."""
        return (self.interval or math.nan) * (len(self.knots) - 1) if self.shape == "table" else math.inf

    @cached_property
    def peak(self) -> float:
        """Largest magnitude of the velocity, m/s."""
        return float(np.max(np.abs(self.velocity)))

    @cached_property
    def rate(self) -> float:
        """Largest acceleration divided by the largest velocity, rad/s; 0 for a constant velocity."""
        if self.shape == "table" and self.peak > 0.0:
            return float(np.max(np.abs(np.diff(self.velocity)))) / (self.interval or math.nan) / self.peak
        return self.turn

    @cached_property
    def breaks(self) -> NDArray[np.float64]:
        """Times > 0 at which the acceleration jumps, s: knots at which a table bends."""
        if self.shape != "table":
            return np.zeros(0)
        bends = 1 + np.flatnonzero(np.diff(self.velocity, 2))
        return np.asarray((self.interval or math.nan) * bends)

    def variation(self, duration: float) -> float:
        """Return an upper bound of the total variation of the velocity within ``duration`` (s), m/s."""
        if self.shape == "sine":
            # 4 amplitudes a period, and at most 2 more in a part of one
            return (4.0 * (self.frequency or 0.0) * duration + 2.0) * self.peak
        return float(np.sum(np.abs(np.diff(np.atleast_1d(self.velocity)))))

    def times(self, factor: float) -> Piston:
        """Return the same piston with a velocity multiplied by ``factor`` > 0."""
        velocity = self.velocity
        scaled = tuple(factor * v for v in velocity) if isinstance(velocity, tuple) else factor * velocity
        return replace(self, velocity=scaled)

    @property
    def words(self) -> str:
        """Short description of the velocity."""
        if self.shape == "table":
            count = len(self.knots)
            return f"table of {count} velocities at intervals of {self.interval:.6g} s, at most {self.peak:.6g} m/s"
        if self.shape == "constant":
            return f"constant velocity of {self.velocity:.6g} m/s"
        start = f", from {self.phase:.6g} degrees" if self.phase != 0.0 else ""
        return f"sine of {self.velocity:.6g} m/s at {self.frequency:.6g} Hz{start}"

    def __getstate__(self) -> dict[str, object]:
        """Return the fields alone; cached values are not sent to other processes."""
        return {field.name: getattr(self, field.name) for field in fields(self)}


def check_place(bodies: int, walls: tuple[bool, bool], *, powers: bool) -> None:
    """Raise SceneError unless body 0 of a scene can be a piston.

    Parameters
    ----------
    bodies : int
        Number of bodies.
    walls : tuple of bool
        Whether there is a left and a right wall.
    powers : bool
        Whether all contact forces are powers of the overlap. Other laws are checked up to the energy of the scene,
        which a piston that presses bodies against a wall does not limit.
    """
    problem = ""
    if bodies == 1:
        problem, allowed = "prescribes the motion of body 0, which is the only one", "at least two bodies"
    elif walls[0]:
        problem, allowed = "prescribes the motion of body 0, on which a wall behind it cannot act", "no wall_left"
    elif walls[1] and not powers:
        problem = "sets no limit to the energy between a piston and a wall, up to which contact laws are checked"
        allowed = "no wall_right, or contact forces that are powers"
    if problem:
        raise SceneError("drive.velocity", problem=problem, allowed=allowed)
