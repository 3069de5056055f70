"""The observed order of convergence of several files with different time steps, and the floor of their errors."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from dem_bridge.accuracy import observed_order
from dem_bridge.errors import UsageError
from dem_bridge.judging.error import FileErrors, QuantityErrors
from dem_bridge.trajectory import Floats

#: multiple of what digits and reference explain above which an error counts for the order: it biases the order by 1 %
ABOVE_FLOOR = 10.0
#: errors that fall by less than this factor from one time step to a finer one do not follow the time step any more
FLAT = 1.2
#: samples that all files need in common; with fewer the errors in the common interval of time are used
COMMON = 8
Rows = NDArray[np.int64]


@dataclass(frozen=True, kw_only=True)
class Order:
    """Observed order of one quantity over several time steps."""

    value: float
    uncertainty: float
    """Largest difference to the order of two adjacent steps and to that of the largest errors, and the effect of the
    uncertainty of the errors."""
    steps: tuple[float, ...]
    """Time steps that were used, s, coarse to fine."""

    @property
    def ends(self) -> tuple[float, float]:
        """Coarsest and finest time step, s."""
        return self.steps[0], self.steps[-1]


@dataclass(frozen=True, kw_only=True)
class Convergence:
    """Errors of one quantity against the time step."""

    quantity: str
    dt: tuple[float, ...]
    """Time steps, s, fine to coarse."""
    errors: tuple[float, ...]
    """Root mean square errors over the common samples, in the unit of the quantity."""
    largest: tuple[float, ...]
    """Largest errors over the common samples."""
    explained: tuple[float, ...]
    """Root mean square of what digits and reference explain."""
    order: Order | None
    """None: fewer than two errors stand above the floor."""
    flat: float
    """Largest error at which the errors stop to fall with the time step; nan if they fall to the finest one."""


def convergence(files: Sequence[FileErrors]) -> tuple[Convergence, ...]:
    """Return errors and order of each quantity that all files have; none for fewer than two files with a time step.

    Raises
    ------
    UsageError
        If two files have the same time step, or if the files have no times or bodies in common.
    """
    with_step = sorted((file.record.dt, number) for number, file in enumerate(files) if file.record.dt is not None)
    chosen = [files[number] for _, number in with_step]
    for (dt, first), (other, second) in pairwise(with_step):
        if math.isclose(dt, other, rel_tol=1e-9):
            names = " and ".join(files[number].record.name for number in sorted((first, second)))
            raise UsageError(f"{names} have the same time step, {dt:.6g} s; give each file its own time step, FILE@DT")
    if len(chosen) < 2:
        return ()
    rows = _common_rows([file.record.time for file in chosen], [file.record.name for file in chosen])
    shared = [name for name in chosen[0].quantities if all(name in file.quantities for file in chosen)]
    found = (_convergence([file.quantities[name] for file in chosen], rows, with_step) for name in shared)
    return tuple(part for part in found if part is not None)


def _common_rows(times: Sequence[Floats], names: Sequence[str]) -> list[Rows]:
    """Return the samples of each file at common times, or those in the common interval where times differ."""
    start, end = max(time[0] for time in times), min(time[-1] for time in times)
    if not start < end:
        first = int(np.argmin([time[-1] for time in times]))
        last = int(np.argmax([time[0] for time in times]))
        raise UsageError(
            f"{names[first]} ends at {times[first][-1]:.6g} s and {names[last]} begins at {times[last][0]:.6g} s; an"
            " order of convergence needs files with times in common: judge them one by one"
        )
    width = 1e-6 * min(float(np.min(np.diff(time))) for time in times)
    finest = min(times, key=len)
    near: list[Rows] = [np.minimum(np.searchsorted(time, finest - width), len(time) - 1) for time in times]
    same = np.all([np.abs(time[rows] - finest) <= width for time, rows in zip(times, near, strict=True)], axis=0)
    # the start has no error
    same &= finest > 0.0
    if np.count_nonzero(same) >= COMMON:
        return [rows[same] for rows in near]
    return [np.flatnonzero((time >= start) & (time <= end) & (time > 0.0)) for time in times]


def _convergence(
    parts: Sequence[QuantityErrors], rows: Sequence[Rows], with_step: Sequence[tuple[float, int]]
) -> Convergence | None:
    """Return the convergence of one quantity; ``parts`` are its errors from the finest step on."""
    columns = sorted(set.intersection(*(set(part.columns) for part in parts)))
    if not columns or not all(len(chosen) for chosen in rows):
        return None
    errors, largest, explained = [], [], []
    for part, chosen in zip(parts, rows, strict=True):
        place = [part.columns.index(column) for column in columns]
        error, limit = (values[chosen][:, place] for values in (part.error, part.explained))
        errors.append(float(np.sqrt(np.mean(error**2))))
        largest.append(float(np.max(np.abs(error))))
        explained.append(float(np.sqrt(np.mean(limit**2))))
    dt = tuple(step for step, _ in with_step)
    first, flat = _first_above_floor(errors, explained)
    return Convergence(
        quantity=parts[0].quantity,
        dt=dt,
        errors=tuple(errors),
        largest=tuple(largest),
        explained=tuple(explained),
        order=_order(dt[first:], errors[first:], largest[first:], explained[first:]),
        flat=largest[first - 1] if flat else math.nan,
    )


def _first_above_floor(errors: Sequence[float], explained: Sequence[float]) -> tuple[int, bool]:
    """Return the first file, from the finest step on, whose error follows the step, and True if finer ones are flat.

    Errors are flat if they do not fall by :data:`FLAT` although coarser ones do.
    """
    clear = [error > ABOVE_FLOOR * limit for error, limit in zip(errors, explained, strict=True)]
    falls = [coarse > FLAT * fine for fine, coarse in pairwise(errors)]
    first = next((place for place in range(len(errors)) if clear[place] and all(clear[place:])), len(errors))
    if not any(falls[first:]):
        return first, False  # nothing follows the step: the order is that of all clear errors, near 0
    start = next(place for place in range(first, len(falls)) if falls[place])
    return start, start > first


def _order(
    dt: Sequence[float], errors: Sequence[float], largest: Sequence[float], explained: Sequence[float]
) -> Order | None:
    """Return the order fitted to errors that follow the time step, None for fewer than two."""
    if len(dt) < 2:
        return None
    fit = observed_order(dt, errors)
    pairs = [observed_order(dt[k : k + 2], errors[k : k + 2]).order for k in range(len(dt) - 1)]
    spread = max(abs(order - fit.order) for order in (*pairs, observed_order(dt, largest).order))
    relative = [limit / error for limit, error in zip(explained, errors, strict=True)]
    unknown = math.hypot(*relative) / math.log(dt[-1] / dt[0])
    return Order(value=fit.order, uncertainty=spread + unknown, steps=fit.steps)
