"""A force that drives the first body of a chain: a sine, a chirp, or a table of what was measured."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dem_bridge.checked import checked_number, checked_numbers
from dem_bridge.errors import SceneError

#: what each shape is told by beside its force; what has a default may be left out
KEYS = {
    "sine": ("frequency", "phase", "rise"),
    "chirp": ("frequency", "last_frequency", "sweep", "phase", "rise"),
    "table": ("interval",),
}
_UNITS = {"frequency": "Hz", "last_frequency": "Hz", "sweep": "s", "interval": "s"}


@dataclass(frozen=True, kw_only=True)
class Drive:
    """Outer force on body 0, N, positive towards the last body, beside load and weight.

    ``shape``: "sine", ``a sin(2 pi f t + phase)``; "chirp", the same with an instantaneous frequency that goes linearly
    from ``frequency`` at time 0 to ``last_frequency`` at the time ``sweep`` and stays there; "table", straight lines
    between the values of ``force`` at 0, interval, 2 interval, ... . ``a`` is the ``force`` (> 0), times
    ``sin^2(pi t / (2 rise))`` before the time ``rise``.
    Raises :class:`~dem_bridge.errors.SceneError` for anything else, keys of another shape included.

    >>> hum = Drive(shape="sine", force=0.5, frequency=1000.0, rise=5e-4)
    >>> hum.at([0.0, 2.5e-4, 1.25e-3]).round(12).tolist(), hum.words
    ([0.0, 0.25, 0.5], 'sine of 0.5 N at 1000 Hz, rising over 0.0005 s')
    >>> Drive(shape="table", force=(0.0, 2.0, 1.0), interval=1e-3).at([5e-4, 1.5e-3]).tolist()
    [1.0, 1.5]
    """

    shape: str
    force: float | tuple[float, ...]
    """N: amplitude, of a table its values."""
    frequency: float | None = None
    """Hz; of a chirp at time 0."""
    last_frequency: float | None = None
    """Hz; of a chirp from ``sweep`` on."""
    sweep: float | None = None
    """s; of a chirp."""
    phase: float = 0.0
    """Degrees at time 0."""
    rise: float = 0.0
    """s."""
    interval: float | None = None
    """s; of a table."""

    def __post_init__(self) -> None:
        if not isinstance(self.shape, str) or self.shape not in KEYS:
            raise SceneError("drive.shape", found=self.shape, allowed=" or ".join(KEYS))
        own = KEYS[self.shape]
        for one in fields(self):
            if one.name not in ("shape", "force", *own) and getattr(self, one.name) != one.default:
                allowed = f"{', '.join(('force', *own))}: it belongs to {_owners(one.name)}"
                raise SceneError(f"drive.{one.name}", problem=f"stands beside shape = {self.shape!r}", allowed=allowed)
        checked: dict[str, object] = {}
        if self.shape == "table":
            values = checked_numbers("drive.force", self.force, "a finite number (N)")
            if len(values) < 2:
                raise SceneError("drive.force", problem=f"has {len(values)} entries", allowed="at least 2")
            checked["force"] = values
        else:
            allowed = "a number > 0 (N); with phase = 180 it pulls first"
            checked["force"] = checked_number("drive.force", self.force, allowed, above=0.0)
            checked["phase"] = checked_number("drive.phase", self.phase, "a finite number (degrees)")
            checked["rise"] = checked_number("drive.rise", self.rise, "a number >= 0 (s)", at_least=0.0)
        for key in own:
            if key in _UNITS:
                allowed = f"a number > 0 ({_UNITS[key]})"
                if getattr(self, key) is None:
                    raise SceneError(f"drive.{key}", problem="is missing", allowed=allowed)
                checked[key] = checked_number(f"drive.{key}", getattr(self, key), allowed, above=0.0)
        for name, value in checked.items():
            object.__setattr__(self, name, value)

    def at(self, time: ArrayLike) -> NDArray[np.float64]:
        """Force, N, at times (s) >= 0, of any shape; after its end a table stays at its last value."""
        # in the order of a deck's formula, so that what differs is no phase of many turns, rounded twice
        t = np.asarray(time, dtype=np.float64)
        if self.shape == "table":
            assert self.interval is not None
            values, place = self._knots[1], t / self.interval
            cell = np.minimum(np.floor(place), len(values) - 2)
            low = cell.astype(np.int64)
            inside = np.minimum(place - cell, 1.0)
            return np.asarray(values[low] + (values[low + 1] - values[low]) * inside)
        assert isinstance(self.force, float)  # set when the drive was made
        assert self.frequency is not None
        first = 2.0 * math.pi * self.frequency
        turned = first * t
        if self.shape == "chirp":
            assert self.last_frequency is not None
            assert self.sweep is not None
            last, until = 2.0 * math.pi * self.last_frequency, np.minimum(t, self.sweep)
            turned = (first + 0.5 * (last - first) / self.sweep * until) * until + last * (t - until)
        grown = np.sin(0.5 * math.pi / self.rise * np.minimum(t, self.rise)) ** 2 if self.rise > 0.0 else 1.0
        return np.asarray(self.force * grown * np.sin(turned + math.radians(self.phase)))

    @cached_property
    def _knots(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Times (s) and values (N) of a table."""
        assert self.interval is not None
        values = np.array(self.force, dtype=np.float64)
        return np.asarray(self.interval * np.arange(len(values))), values

    @property
    def end(self) -> float:
        """Until when the force is known, s; inf but for a table."""
        return float(self._knots[0][-1]) if self.shape == "table" else math.inf

    @cached_property
    def peak(self) -> float:
        """The force is never larger than this, N."""
        return float(np.max(np.abs(self.force)))

    @cached_property
    def rate(self) -> float:
        """How fast the force changes at most, rad/s: of sines the highest frequency; of tables the steepest slope over
        the largest force, which of a sine is the same. 0: it is constant."""
        if self.shape == "table":
            time, values = self._knots
            slope = float(np.max(np.abs(np.diff(values)))) / float(time[1])
            return slope / self.peak if self.peak > 0.0 else 0.0
        assert self.frequency is not None
        highest = 2.0 * math.pi * max(self.frequency, self.last_frequency or 0.0)
        return highest + (math.pi / self.rise if self.rise > 0.0 else 0.0)

    @cached_property
    def breaks(self) -> NDArray[np.float64]:
        """Times (s) > 0 at which the force is not smooth: the end of a rise or a sweep, knots where a table bends."""
        if self.shape == "table":
            time, values = self._knots
            return np.asarray(time[1:-1][np.diff(values, 2) != 0.0])
        return np.unique([moment for moment in (self.rise, self.sweep or 0.0) if moment > 0.0])

    def times(self, factor: float) -> Drive:
        """The same with a force so many times as large, ``factor`` > 0."""
        force = self.force
        return replace(self, force=tuple(factor * f for f in force) if isinstance(force, tuple) else factor * force)

    @property
    def words(self) -> str:
        """It in a few words."""
        if self.shape == "table":
            time, values = self._knots
            return f"table of {len(values)} forces, one in {time[1]:.6g} s, of up to {self.peak:.6g} N"
        parts = [f"{self.shape} of {self.force:.6g} N at {self.frequency:.6g} Hz"]
        if self.shape == "chirp":
            parts[0] += f" to {self.last_frequency:.6g} Hz in {self.sweep:.6g} s"
        if self.phase != 0.0:
            parts.append(f"from {self.phase:.6g} degrees")
        if self.rise > 0.0:
            parts.append(f"rising over {self.rise:.6g} s")
        return ", ".join(parts)

    def __getstate__(self) -> dict[str, object]:
        """What is found again travels to no other process."""
        return {field.name: getattr(self, field.name) for field in fields(self)}


def _owners(key: str) -> str:
    return " and ".join(shape for shape, keys in KEYS.items() if key in keys)
