"""A time-dependent force on the first body of a chain: a sine, a chirp, or a table of measured values."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dem_bridge.errors import SceneError
from dem_bridge.foundation.numbers import Numbers, check_fields, checked_numbers

#: parameters of each shape in addition to its force; those with a default are optional
KEYS = {
    "sine": ("frequency", "phase", "rise"),
    "chirp": ("frequency", "last_frequency", "sweep", "phase", "rise"),
    "table": ("interval",),
}
_POSITIVE = {"above": 0.0}
_NUMBERS = {
    **dict.fromkeys(("frequency", "last_frequency"), Numbers("a number > 0 (Hz)", _POSITIVE)),
    **dict.fromkeys(("sweep", "interval"), Numbers("a number > 0 (s)", _POSITIVE)),
    "phase": Numbers("a finite number (degrees)"),
    "rise": Numbers("a number >= 0 (s)", {"at_least": 0.0}),
    "force": Numbers("a number > 0 (N); with phase = 180 it pulls first", _POSITIVE),
}


@dataclass(frozen=True, kw_only=True)
class Drive:
    """Time-dependent outer force on body 0, N, positive towards the last body, in addition to load and weight.

    ``shape`` is one of

    * "sine": ``a sin(2 pi f t + phase)``;
    * "chirp": a sine whose instantaneous frequency changes linearly from ``frequency`` at time 0 to ``last_frequency``
      at the time ``sweep``, and then stays constant;
    * "table": linear interpolation between the values of ``force`` at the times 0, interval, 2 interval, ... .

    ``a`` is the ``force`` (> 0), multiplied by ``sin^2(pi t / (2 rise))`` before the time ``rise``.

    Raises
    ------
    SceneError
        If a parameter is invalid or belongs to another shape.

    Examples
    --------
    >>> hum = Drive(shape="sine", force=0.5, frequency=1000.0, rise=5e-4)
    >>> hum.at([0.0, 2.5e-4, 1.25e-3]).round(12).tolist(), hum.words
    ([0.0, 0.25, 0.5], 'sine of 0.5 N at 1000 Hz, rising over 0.0005 s')
    >>> Drive(shape="table", force=(0.0, 2.0, 1.0), interval=1e-3).at([5e-4, 1.5e-3]).tolist()
    [1.0, 1.5]
    """

    shape: str
    force: float | tuple[float, ...]
    """Amplitude, N; for a table its values."""
    frequency: float | None = None
    """Frequency, Hz; for a chirp at time 0."""
    last_frequency: float | None = None
    """Frequency of a chirp from the time ``sweep`` on, Hz."""
    sweep: float | None = None
    """Time during which the frequency of a chirp changes, s."""
    phase: float = 0.0
    """Phase at time 0, degrees."""
    rise: float = 0.0
    """Time during which the amplitude rises, s."""
    interval: float | None = None
    """Time between two values of a table, s."""

    def __post_init__(self) -> None:
        if not isinstance(self.shape, str) or self.shape not in KEYS:
            raise SceneError("drive.shape", value=self.shape, allowed=" or ".join(KEYS))
        keys = KEYS[self.shape]
        for item in fields(self):
            value = getattr(self, item.name)
            unset = value is item.default or (isinstance(value, int | float) and value == item.default)
            if item.name not in ("shape", "force", *keys) and not unset:
                problem = f"does not apply to shape = {self.shape!r}, only to {_owners(item.name)}"
                raise SceneError(f"drive.{item.name}", problem=problem, allowed=", ".join(("force", *keys)))
        for key in keys:
            if getattr(self, key) is None:
                raise SceneError(f"drive.{key}", problem="is missing", allowed=_NUMBERS[key].allowed)
        if self.shape == "table":
            object.__setattr__(self, "force", checked_table("drive.force", self.force, "N"))
        else:
            check_fields(self, {"force": _NUMBERS["force"]}, "drive.")
        check_fields(self, {key: _NUMBERS[key] for key in keys}, "drive.")

    def __str__(self) -> str:
        """Return the drive in words."""
        return f"Drive: {self.words}"

    def at(self, time: ArrayLike) -> NDArray[np.float64]:
        """Return the force at times >= 0 (s) of any shape, N; after its end a table keeps its last value."""
        # evaluated in the order of a deck's formula, so that large phases are rounded in the same way
        t = np.asarray(time, dtype=np.float64)
        if self.shape == "table":
            times, values = self._knots
            place = t / times[1]
            cell = np.minimum(np.floor(place), len(values) - 2)
            low = cell.astype(np.int64)
            fraction = np.minimum(place - cell, 1.0)
            return np.asarray(values[low] + (values[low + 1] - values[low]) * fraction)
        frequency, last_frequency, sweep = self._numbers
        first, last = 2.0 * math.pi * frequency, 2.0 * math.pi * last_frequency
        angle = first * t
        if self.shape == "chirp":
            swept = np.minimum(t, sweep)
            angle = (first + 0.5 * (last - first) / sweep * swept) * swept + last * (t - swept)
        envelope = np.sin(0.5 * math.pi / self.rise * np.minimum(t, self.rise)) ** 2 if self.rise > 0.0 else 1.0
        return np.asarray(self.peak * envelope * np.sin(angle + math.radians(self.phase)))

    def function(self) -> Callable[[float], float]:
        """Return a function of one time, s, with the values of :meth:`at`, N, for integrators that evaluate one by one.

        It takes a microsecond where :meth:`at` takes ten.

        Examples
        --------
        >>> hum = Drive(shape="sine", force=0.5, frequency=1000.0, rise=5e-4)
        >>> round(hum.function()(2.5e-4 / 2.0), 12) == round(float(hum.at(2.5e-4 / 2.0)), 12)
        True
        """
        if self.shape == "table":
            knots, forces = self._knots
            interval, values, last = float(knots[1]), forces.tolist(), len(forces) - 2

            def interpolated(t: float) -> float:
                place = t / interval
                cell = min(int(place), last)
                return float(values[cell] + (values[cell + 1] - values[cell]) * min(place - cell, 1.0))

            return interpolated
        frequency, last_frequency, sweep = self._numbers
        first, last_turn = 2.0 * math.pi * frequency, 2.0 * math.pi * last_frequency
        growth = 0.5 * (last_turn - first) / sweep if self.shape == "chirp" else 0.0
        peak, rise, phase, chirps = self.peak, self.rise, math.radians(self.phase), self.shape == "chirp"

        def wave(t: float) -> float:
            swept = min(t, sweep)
            angle = (first + growth * swept) * swept + last_turn * (t - swept) if chirps else first * t
            envelope = math.sin(0.5 * math.pi / rise * min(t, rise)) ** 2 if rise > 0.0 else 1.0
            return peak * envelope * math.sin(angle + phase)

        return wave

    @cached_property
    def _knots(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Times (s) and values (N) of a table."""
        values = np.array(self.force, dtype=np.float64)
        return np.asarray((self.interval or math.nan) * np.arange(len(values))), values

    @property
    def _numbers(self) -> tuple[float, float, float]:
        """Frequency and last frequency, Hz, and sweep, s; 0 for those that the shape does not have."""
        return self.frequency or 0.0, self.last_frequency or 0.0, self.sweep or 0.0

    @property
    def end(self) -> float:
        """Time until which the force is defined, s; inf unless it is a table."""
        return float(self._knots[0][-1]) if self.shape == "table" else math.inf

    @cached_property
    def peak(self) -> float:
        """Upper bound of the magnitude of the force, N."""
        return float(np.max(np.abs(self.force)))

    @cached_property
    def rate(self) -> float:
        """Largest rate of change of the force divided by its amplitude, rad/s; 0 for a constant force.

        For sines it is the highest angular frequency. For a table it is the steepest slope divided by the largest
        force, which agrees with the definition for a sine.
        """
        if self.shape == "table":
            time, values = self._knots
            slope = float(np.max(np.abs(np.diff(values)))) / float(time[1])
            return slope / self.peak if self.peak > 0.0 else 0.0
        highest = 2.0 * math.pi * max(self._numbers[:2])
        return highest + (math.pi / self.rise if self.rise > 0.0 else 0.0)

    @cached_property
    def breaks(self) -> NDArray[np.float64]:
        """Times > 0 at which the force is not smooth, s: the end of a rise or a sweep, knots at which a table bends."""
        if self.shape == "table":
            knots, values = self._knots
            return np.asarray(knots[1:-1][np.diff(values, 2) != 0.0])
        return np.unique([time for time in (self.rise, self.sweep or 0.0) if time > 0.0])

    def times(self, factor: float) -> Drive:
        """Return the same drive with a force multiplied by ``factor`` > 0."""
        force = self.force
        return replace(self, force=tuple(factor * f for f in force) if isinstance(force, tuple) else factor * force)

    @property
    def words(self) -> str:
        """Short description of the drive."""
        if self.shape == "table":
            time, values = self._knots
            return f"table of {len(values)} forces at intervals of {time[1]:.6g} s, at most {self.peak:.6g} N"
        parts = [f"{self.shape} of {self.force:.6g} N at {self.frequency:.6g} Hz"]
        if self.shape == "chirp":
            parts[0] += f" to {self.last_frequency:.6g} Hz in {self.sweep:.6g} s"
        if self.phase != 0.0:
            parts.append(f"from {self.phase:.6g} degrees")
        if self.rise > 0.0:
            parts.append(f"rising over {self.rise:.6g} s")
        return ", ".join(parts)

    def __getstate__(self) -> dict[str, object]:
        """Return the fields alone; cached values are not sent to other processes."""
        return {field.name: getattr(self, field.name) for field in fields(self)}


def checked_table(key: str, values: Sequence[float] | float, unit: str) -> tuple[float, ...]:
    """Return the values of a table, of which there are at least two; ``key`` and ``unit`` are for messages.

    Raises
    ------
    SceneError
        If there are fewer, or one is not finite.

    Examples
    --------
    >>> checked_table("drive.force", [0, 2.5], "N")
    (0.0, 2.5)
    """
    numbers = checked_numbers(key, values, f"a finite number ({unit})")
    if len(numbers) < 2:
        raise SceneError(key, problem=f"has {len(numbers)} entries", allowed="at least 2")
    return numbers


def _owners(key: str) -> str:
    """Return the names of the shapes that have this parameter."""
    return " and ".join(shape for shape, keys in KEYS.items() if key in keys)
