"""Errors of a file against the reference at its own times, and what its digits and the reference explain of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dem_bridge.formats.readers import Record
from dem_bridge.judging.reference import UNITS, ReferenceSamples, reference_at
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.relative import relative_size
from dem_bridge.trajectory.trajectory import Floats

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
