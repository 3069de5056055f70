"""The reference solution at the times of a file, and the errors of the file against it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dem_bridge.backends.base import Resolution, Sampling, backend, unsupported_reason
from dem_bridge.errors import UnsupportedScene, UsageError
from dem_bridge.formats.readers import Record
from dem_bridge.observables.traces import contact_force_uncertainty
from dem_bridge.runs.cache import RunCache
from dem_bridge.runs.case import Case
from dem_bridge.runs.uncertainty.estimate import solve
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.relative import relative_size
from dem_bridge.trajectory.trajectory import Floats

#: quantities of a file that can be judged, with their units
UNITS: Mapping[str, str] = MappingProxyType({"velocity": "m/s", "displacement": "m", "contact_force": "N"})


@dataclass(frozen=True, kw_only=True, eq=False)
class ReferenceSamples:
    """The reference solution at given times, see :func:`reference_at`."""

    time: Floats
    """Times, s, ``(n_t,)``."""
    values: Mapping[str, Floats]
    """"velocity" and "displacement", ``(n_t, n_body)``, and "contact_force", ``(n_t, n_contact)``; SI."""
    uncertainty: Mapping[str, float]
    """Largest error of each quantity over all samples, in its unit."""
    bounds: Mapping[str, Floats]
    """Largest error of each quantity at each sample: that of forces is large where a damped contact closes."""
    largest: Mapping[str, float]
    """Largest magnitude of each quantity over all bodies or contacts and times: the scale of errors."""


def reference_at(scene: Scene, time: Floats) -> ReferenceSamples:
    """Solve the reference at given times, which need not be even nor end with the scene.

    Parameters
    ----------
    scene : Scene
        Any scene that the backend "reference" supports. Its duration and number of samples are not used.
    time : ndarray, shape (n_t,)
        Times from 0 on, s, increasing.

    Raises
    ------
    UsageError
        If times are negative, do not increase or are not finite, or if none is later than 0.
    UnsupportedScene
        If the backend "reference" does not support the scene.

    Examples
    --------
    >>> scene = Scene(name="pair", duration=1e-4, mass=(8e-3, 1e-2), stiffness=(4e9,), velocity=(0.8, 0.0))
    >>> samples = reference_at(scene, np.array([1e-6, 5e-5, 3e-4]))
    >>> samples.values["velocity"].shape, samples.uncertainty["velocity"] < 1e-12
    ((3, 2), True)
    """
    time = np.asarray(time, dtype=np.float64)
    if not (time.ndim == 1 and np.all(np.isfinite(time)) and np.all(np.diff(time) > 0.0)):
        raise UsageError("the times of the samples do not increase or are not finite; give increasing times (s)")
    if not len(time) or time[0] < 0.0 or time[-1] <= 0.0:
        first, last = (time[0], time[-1]) if len(time) else (np.nan, np.nan)
        raise UsageError(
            f"the samples go from {first:.6g} to {last:.6g} s; allowed: from the start of the scene, 0 s, to any later"
            " time"
        )
    if reason := unsupported_reason(backend("reference"), scene):
        raise UnsupportedScene(f"there is no reference solution of {scene.name}, so nothing can be judged: {reason}")
    instants = time if time[0] == 0.0 else np.concatenate([[0.0], time])
    scene = replace(scene, duration=float(time[-1]))
    sampling = Sampling(given=tuple(instants.tolist()))
    run = solve(Case(scene=scene, backend="reference", resolution=Resolution(), sampling=sampling), RunCache())
    rows = slice(len(instants) - len(time), None)
    values = {name: getattr(run, name)[rows] for name in UNITS}
    largest = {name: run.uncertainty[name] for name in ("velocity", "displacement")}
    bounds = {name: np.broadcast_to(bound, values[name].shape) for name, bound in largest.items()}
    bounds["contact_force"] = contact_force_uncertainty(scene, run)[rows]
    return ReferenceSamples(
        time=time,
        values=values,
        uncertainty={name: float(np.max(bound, initial=0.0)) for name, bound in bounds.items()},
        bounds=bounds,
        largest={name: float(np.max(np.abs(array), initial=0.0)) for name, array in values.items()},
    )


#: difference of two programs of one method and step, relative to the scale: the order of their operations differs
ROUNDOFF_OF_SAME_METHOD = 1e-9


@dataclass(frozen=True, kw_only=True, eq=False)
class QuantityErrors:
    """Errors of one quantity of a file; SI."""

    quantity: str
    scale: float
    """Largest magnitude of the reference over all bodies or contacts at the times of all files."""
    error: Floats
    """File minus reference, ``(n_t, n_columns)``."""
    explained: Floats
    """Largest error that digits and the uncertainty of the reference explain, ``(n_t, n_columns)``."""
    columns: tuple[int, ...]
    """Body or contact of each column."""
    reference_uncertainty: float
    """Uncertainty of the reference alone."""

    @property
    def unit(self) -> str:
        """Unit of error and scale."""
        return UNITS[self.quantity]

    @property
    def value(self) -> float:
        """Largest error over all samples and columns."""
        return float(np.max(np.abs(self.error)))

    @property
    def uncertainty(self) -> float:
        """Uncertainty of the largest error: how much larger it may be; it is never smaller by more than that."""
        return float(np.max(np.abs(self.error) + self.explained)) - self.value

    @property
    def floor(self) -> float:
        """Largest error that digits and reference explain."""
        return float(np.max(self.explained))

    @property
    def worst(self) -> tuple[int, int]:
        """Sample and column of the largest error."""
        row, column = np.unravel_index(int(np.argmax(np.abs(self.error))), self.error.shape)
        return int(row), int(column)

    @property
    def place(self) -> str:
        """Body or contact of the largest error, in words."""
        return f"{'contact' if self.quantity == 'contact_force' else 'body'} {self.columns[self.worst[1]]}"

    def relative(self, value: float) -> float:
        """Return a value relative to the scale, as :func:`~dem_bridge.trajectory.relative.relative_size` has it."""
        return relative_size(value, self.scale)


@dataclass(frozen=True, kw_only=True, eq=False)
class FileErrors:
    """Errors of all quantities of one file."""

    record: Record
    quantities: Mapping[str, QuantityErrors]

    def first_divergence(self, scene: Scene, by_step: Mapping[str, Floats] | None = None) -> dict[str, Any] | None:
        """Return time, body and quantity of the first error that digits and reference do not explain; None without.

        A divergence of contact forces has the contact, too; its body is the one on the struck side. ``by_step`` has
        the errors of a method and step in the scene, for each quantity ``(n_t, n_columns)``, which explain as much.
        """
        first: tuple[float, float, QuantityErrors, int] | None = None
        for part in self.quantities.values():
            error, allowed = part.error, part.explained
            if by_step is not None:
                error, allowed = error - by_step[part.quantity], allowed + ROUNDOFF_OF_SAME_METHOD * part.scale
            excess = (np.abs(error) - allowed) / (part.scale or 1.0)
            rows = np.flatnonzero((excess > 0.0).any(axis=1))
            if len(rows):
                column = int(np.argmax(excess[rows[0]]))
                candidate = (float(self.record.time[rows[0]]), -float(excess[rows[0], column]), part, column)
                first = candidate if first is None or candidate[:2] < first[:2] else first
        if first is None:
            return None
        time, _, part, column = first
        place = part.columns[column]
        if part.quantity != "contact_force":
            return {"time": time, "body": place, "quantity": part.quantity}
        left, right = int(scene.contacts.left[place]), int(scene.contacts.right[place])
        body = left if left < scene.n_body else right
        return {"time": time, "body": body, "quantity": part.quantity, "contact": place}

    def until(self, rows: int) -> FileErrors:
        """Return the errors of the first ``rows`` samples; the record is that of all."""
        parts = {
            name: replace(part, error=part.error[:rows], explained=part.explained[:rows])
            for name, part in self.quantities.items()
        }
        return replace(self, quantities=parts)


def file_errors(scene: Scene, records: Sequence[Record]) -> tuple[FileErrors, ...]:
    """Return the errors of each file; one solution of the reference serves all of them."""
    late, early = zip(*(_shifted_times(record) for record in records), strict=True)
    times = np.unique(np.concatenate([*(record.time for record in records), *late, *early]))
    samples = reference_at(scene, times)
    return tuple(
        _errors(record, samples, [np.searchsorted(times, part) for part in (record.time, *shifted)])
        for record, *shifted in zip(records, late, early, strict=True)
    )


def _shifted_times(record: Record) -> tuple[Floats, Floats]:
    """Return the latest and the earliest times that the digits of a file allow."""
    rounding = record.rounding["time"]
    return record.time + rounding, np.maximum(record.time - rounding, 0.0)


def _errors(record: Record, samples: ReferenceSamples, rows: Sequence[NDArray[np.int64]]) -> FileErrors:
    """Return the errors of a file; ``rows`` are those of the reference at its times and at the latest and earliest."""
    quantities = {}
    for name, values in record.values.items():
        columns = record.columns[name]
        now, late, early = (samples.values[name][part][:, columns] for part in rows)
        by_time = np.maximum(np.abs(late - now), np.abs(early - now))
        quantities[name] = QuantityErrors(
            quantity=name,
            scale=samples.largest[name],
            error=values - now,
            explained=record.rounding[name] + by_time + samples.bounds[name][rows[0]][:, columns],
            columns=tuple(columns),
            reference_uncertainty=samples.uncertainty[name],
        )
    return FileErrors(record=record, quantities=quantities)
