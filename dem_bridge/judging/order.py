"""The observed order of convergence of several files with different time steps, and the floor of their errors."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from dem_bridge.errors import UsageError
from dem_bridge.judging.reference import FileErrors, QuantityErrors
from dem_bridge.observables.convergence import observed_order
from dem_bridge.trajectory.trajectory import Floats

#: multiple of what digits and reference explain above which an error counts for the order: a tenth of it at most is
#: then another's, which changes an order from a step and its half by 0.15 at most
LEAST_MULTIPLE_OF_FLOOR = 10.0
#: multiple of the same above which the errors of the coarsest file show a shape, along which others are measured
LEAST_MULTIPLE_WITH_SHAPE = 3.0
#: errors that fall by less than this share of what those of first order do, from one time step to a finer one, do not
#: follow the time step any more
LEAST_SHARE_OF_FIRST_ORDER = 0.5
#: order of velocity-Verlet, and the largest uncertainty of an order that leaves a few per cent of the finest error to
#: anything but the time step
ORDER_OF_VERLET, LARGEST_UNCERTAINTY_OF_ORDER = 2.0, 0.05
#: samples that all files need in common; with fewer the errors in the common interval of time are used
FEWEST_COMMON_SAMPLES = 8
Rows = NDArray[np.int64]
#: error and what digits and reference explain of it, for each file from the finest step on
Errors = Sequence[tuple[float, float]]


@dataclass(frozen=True, kw_only=True)
class Order:
    """Observed order of one quantity over several time steps."""

    value: float
    uncertainty: float
    """Largest difference to the order of two adjacent steps and to that of root mean square errors, and the effect of
    the uncertainty of the errors."""
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
    """Root mean square of the part of the errors that has the shape of the coarsest file's, in the quantity's unit.

    Rounding, which has no such shape, averages out. Files without common times have their root mean square errors.
    """
    explained: tuple[float, ...]
    """What digits and reference explain of each of the errors."""
    order: Order | None
    """None: fewer than two errors stand above the floor."""
    flat: float
    """Root mean square error at which errors stop to fall with the time step; nan if they fall to the finest one."""

    @property
    def vanishes(self) -> bool:
        """True if three files or more, all of them, show that the errors fall to nothing at second order or above."""
        order = self.order
        if order is None or len(order.steps) < max(3, len(self.dt)) or not math.isnan(self.flat):
            return False
        return (
            order.value - order.uncertainty > ORDER_OF_VERLET - LARGEST_UNCERTAINTY_OF_ORDER
            and order.uncertainty < LARGEST_UNCERTAINTY_OF_ORDER
        )


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
    parts = (_convergence([file.quantities[name] for file in chosen], rows, with_step) for name in shared)
    return tuple(part for part in parts if part is not None)


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
    if np.count_nonzero(same) >= FEWEST_COMMON_SAMPLES:
        return [rows[same] for rows in near]
    return [np.flatnonzero((time >= start) & (time <= end) & (time > 0.0)) for time in times]


def _convergence(
    parts: Sequence[QuantityErrors], rows: Sequence[Rows], with_step: Sequence[tuple[float, int]]
) -> Convergence | None:
    """Return the convergence of one quantity; ``parts`` are its errors from the finest step on."""
    columns = sorted(set.intersection(*(set(part.columns) for part in parts)))
    if not columns or not all(len(chosen) for chosen in rows):
        return None
    samples: list[tuple[Floats, Floats]] = []
    for part, chosen in zip(parts, rows, strict=True):
        place = [part.columns.index(column) for column in columns]
        samples.append((part.error[chosen][:, place], part.explained[chosen][:, place]))
    whole = [(_root_mean_square(error), _root_mean_square(limit)) for error, limit in samples]
    shape, measured = samples[-1][0], whole
    if len({error.shape for error, _ in samples}) == 1 and whole[-1][0] > LEAST_MULTIPLE_WITH_SHAPE * whole[-1][1]:
        measured = [_along(shape, error, limit, parts[0].reference_uncertainty) for error, limit in samples]
    dt = tuple(step for step, _ in with_step)
    first, flat = _first_that_follows(dt, measured, whole)
    return Convergence(
        quantity=parts[0].quantity,
        dt=dt,
        errors=tuple(error for error, _ in measured),
        explained=tuple(limit for _, limit in measured),
        order=_order(dt[first:], measured[first:], whole[first:]),
        flat=whole[0][0] if flat else math.nan,
    )


def _root_mean_square(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _along(shape: Floats, error: Floats, explained: Floats, reference: float) -> tuple[float, float]:
    """Return the root mean square of the part of an error that has a shape, and what rounding and reference explain.

    Rounding errors are independent and uniform: their standard deviation is the largest over sqrt(3), and two of them
    are taken.
    """
    size, count = float(np.linalg.norm(shape)), math.sqrt(shape.size)
    rounding = float(np.linalg.norm(shape * (explained - reference))) / (math.sqrt(3.0) * size * count)
    return max(float(np.sum(error * shape)) / (size * count), 0.0), 2.0 * rounding + reference


def _first_that_follows(dt: Sequence[float], measured: Errors, whole: Errors) -> tuple[int, bool]:
    """Return the first file, from the finest step on, whose error follows the step, and True if finer ones are flat.

    Errors are flat if they do not fall although coarser ones do, and if digits do not explain that;
    see :data:`LEAST_SHARE_OF_FIRST_ORDER`.
    """
    clear = [error > LEAST_MULTIPLE_OF_FLOOR * limit for error, limit in measured]
    first = next((place for place in range(len(clear)) if all(clear[place:])), len(clear))
    falls = [
        coarse > fine * (1.0 + LEAST_SHARE_OF_FIRST_ORDER * (step / finer - 1.0))
        or fine <= LEAST_MULTIPLE_WITH_SHAPE * limit
        for (finer, step), ((fine, limit), (coarse, _)) in zip(pairwise(dt), pairwise(whole), strict=True)
    ]
    if True not in falls:
        return first, False  # nothing follows the step: the order is that of all clear errors, near 0
    start = falls.index(True)
    return max(first, start), start > 0


def _order(dt: Sequence[float], measured: Errors, whole: Errors) -> Order | None:
    """Return the order fitted to errors that follow the time step, None for fewer than two."""
    if len(dt) < 2:
        return None
    errors = [error for error, _ in measured]
    fit = observed_order(dt, errors)
    others = [observed_order(*pair).order for pair in zip(pairwise(dt), pairwise(errors), strict=True)]
    if all(error > LEAST_MULTIPLE_OF_FLOOR * limit for error, limit in whole):
        others.append(observed_order(dt, [error for error, _ in whole]).order)
    unknown = math.hypot(*(limit / error for error, limit in measured)) / math.log(dt[-1] / dt[0])
    return Order(
        value=fit.order, uncertainty=max(abs(other - fit.order) for other in others) + unknown, steps=fit.steps
    )
