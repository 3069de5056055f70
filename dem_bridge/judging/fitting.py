"""Comparison of hypotheses with the samples of a file: predictions, residuals in units of the noise, and fits."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dem_bridge.judging.hypotheses import Hypothesis, Variant
from dem_bridge.judging.model import Model, Motion

Floats = NDArray[np.float64]

QUANTITIES = ("velocity", "displacement", "contact_force")
#: accuracy of the model relative to the scale of a quantity, where it repeats a method step by step
ERROR_OF_REPEATED_METHOD = 1e-11
#: runs by the method of another code are limited to so many steps
MOST_STEPS_OF_METHOD = 400_000
#: durations of the scene up to which its motion is computed, if the file does not go further
MOST_DURATIONS = 3.0
#: tolerance of the adaptive method in a search and for the decision
TOLERANCE_OF_SEARCH, TOLERANCE_OF_DECISION = 1e-9, 1e-13


class Block(NamedTuple):
    """Samples of a quantity: its number, values, bodies or places of contacts, noise, which are finite, and scale."""

    quantity: int
    values: Floats
    columns: NDArray[np.int64]
    sigma: Floats
    present: NDArray[np.bool_]
    scale: float
    rounding: Floats


class Stepping(NamedTuple):
    """A fixed-step method of another code with its step, s."""

    method: int
    dt: float


@dataclass(frozen=True, eq=False)
class Fit:
    """A hypothesis with its best parameters; ``rms`` and ``largest`` of its residual are in units of the noise."""

    hypothesis: Hypothesis
    parameters: Floats
    rms: float
    largest: float
    error: float
    """Largest residual relative to the scale of its quantity."""
    deviation: Floats
    stepping: Stepping | None = None
    floors: float = 0.0
    """Largest residual in units of the rounding of the largest value."""


class Data:
    """The samples of a file beside the motion of its scene."""

    until: float = math.inf
    """Processor time of this process, s, at which the search for a cause ends."""

    def __init__(self, record: Any, model: Model, floor: Mapping[str, float]) -> None:
        self.model, self.time, self.dt = model, np.asarray(record.time, dtype=np.float64), record.dt
        self.from_first = bool(getattr(record, "displacement_from_first", False))
        scene = model.scene
        contacts = scene.contacts
        places = np.where(contacts.left == scene.n_body, 0, contacts.left + 1)
        #: latest time of a motion, s: a hypothesis about times may go far beyond scene and file, and says no more there
        self.farthest = max(MOST_DURATIONS * scene.duration, float(self.time[-1]))
        base = model.exact(model.system, np.maximum(self.time, 0.0))
        late = record.rounding.get("time")
        late = np.zeros(len(self.time)) if late is None else np.asarray(late)
        self.blocks: list[Block] = []
        self.floors: list[float] = []
        for quantity, name in enumerate(QUANTITIES):
            if name not in record.values:
                continue
            values, columns = np.asarray(record.values[name], dtype=np.float64), np.array(record.columns[name])
            if name == "contact_force":
                columns = places[columns]
            truth = (base.velocity, base.displacement, base.force)[quantity]
            scale = float(np.max(np.abs(truth))) or float(np.nanmax(np.abs(values))) or 1.0
            rounding = np.broadcast_to(np.asarray(record.rounding.get(name, 0.0), dtype=np.float64), values.shape)
            slope = np.abs((base.acceleration, base.velocity, np.gradient(base.force, self.time, axis=0))[quantity])
            noise = (rounding**2 + (late[:, None] * slope[:, columns]) ** 2) / 3.0
            # in another unit values may be far smaller than those of the scene
            size = min(scale, float(np.nanmax(np.abs(values), initial=0.0)) or scale)
            sigma = np.sqrt(noise + (ERROR_OF_REPEATED_METHOD * size) ** 2 + floor.get(name, 0.0) ** 2)
            self.blocks.append(Block(quantity, values, columns, sigma, np.isfinite(values), scale, rounding))
            digits = float(np.max(np.where(np.isfinite(values), rounding, 0.0), initial=0.0))
            self.floors.append(max(digits, 1e-12 * size, floor.get(name, 0.0)))
        steps = np.diff(self.time)
        self.interval = float(np.median(steps))
        self.even = bool(np.ptp(steps) < 1e-6 * self.interval)
        #: False if the step of the file is in another unit of time than its rows, which are no multiples of it
        count = self.interval / self.dt if self.dt is not None else 1.0
        self.whole = not self.even or abs(count - round(count)) < 1e-3 * max(count, 1.0)

    @property
    def over(self) -> bool:
        """True once no further fit is to be begun."""
        return time.process_time() > self.until

    def motion(self, variant: Variant, rows: int, tolerance: float, stepping: Stepping | None) -> tuple[Motion, Floats]:
        """Return the motion of a variant at the first ``rows`` times of the file, and its times (s)."""
        time = self.time
        if variant.lag:
            ahead = time[0] - np.arange(abs(variant.lag), 0, -1) * self.interval
            behind = time[-1] + np.arange(1, abs(variant.lag) + 1) * self.interval
            time = np.concatenate([ahead, time]) if variant.lag > 0 else np.concatenate([time, behind])[-variant.lag :]
        times = variant.scale * time[:rows] - variant.shift
        positive = np.clip(times, 0.0, self.farthest)
        if variant.method is not None and variant.dt is not None:
            stepping = Stepping(variant.method, variant.dt)
        if stepping is None:
            return self.model.exact(variant.system, positive, tolerance), times
        dt = stepping.dt * (variant.scale if self.whole else 1.0)
        return self.model.stepped_at(variant.system, positive, dt, stepping.method), times

    def predict(
        self, variant: Variant, rows: int, tolerance: float = TOLERANCE_OF_SEARCH, stepping: Stepping | None = None
    ) -> list[Floats]:
        """Return what the file would hold, for each block; nan where a sample is before the start."""
        motion, times = self.motion(variant, rows, tolerance, stepping)
        early = times < -1e-9 * self.interval
        out = []
        for block in self.blocks:
            value = (motion.velocity, motion.displacement, motion.force)[block.quantity]
            if block.quantity == 0 and variant.late:
                value = value - variant.late * motion.acceleration
                early = early | (times <= 0.0)
            columns = block.columns
            if block.quantity == 1 and variant.offset is not None:
                value = value + np.array(variant.offset)
            if variant.order is not None and block.quantity < 2:
                columns = np.array(variant.order)[columns]
            elif variant.order is not None and variant.order[0] > variant.order[-1]:
                columns = value.shape[1] - 1 - columns
            value = value[:, columns] * variant.factors[block.quantity]
            for quantity, body in variant.flipped:
                value[:, (block.quantity == quantity) & (block.columns == body)] *= -1.0
            # an unstable motion is no absent sample
            value[~np.isfinite(value)] = np.inf
            if block.quantity == 1 and self.from_first:
                value = value - value[0]
            if early.any():
                value[early] = np.nan
            out.append(value)
        return out

    def residual(self, prediction: Sequence[Floats], extra: float = 0.0) -> Floats:
        """Return prediction less values in units of the noise and of ``extra`` scales; 0 where one is absent."""
        parts = []
        for block, value in zip(self.blocks, prediction, strict=True):
            rows = len(value)
            sigma = block.sigma[:rows]
            if extra > 0.0:
                sigma = np.sqrt(sigma**2 + (extra * block.scale) ** 2)
            parts.append(np.nan_to_num((value - block.values[:rows]) / sigma).ravel())
        return np.clip(np.concatenate(parts), -1e150, 1e150)

    def errors(self, prediction: Sequence[Floats]) -> Floats:
        """Return the largest difference of each sampled time relative to the scale of its quantity."""
        out = np.zeros(len(prediction[0]))
        for block, value in zip(self.blocks, prediction, strict=True):
            difference = np.nan_to_num(np.abs(value - block.values[: len(value)]), nan=0.0, posinf=1e150)
            out = np.maximum(out, np.max(difference, axis=1, initial=0.0) / block.scale)
        return out

    def largest(self, first: Sequence[Floats], second: Sequence[Floats]) -> list[float]:
        """Return the largest difference of each block."""
        return [
            float(np.max(np.nan_to_num(np.abs(a - b), nan=0.0), initial=0.0))
            for a, b in zip(first, second, strict=True)
        ]

    def coverage(self, prediction: Sequence[Floats]) -> float:
        """Return the part of the samples that a prediction speaks of."""
        return float(np.mean(np.concatenate([np.isfinite(value).ravel() for value in prediction])))


class Fitter:
    """Fits of hypotheses to one file, with the time-step error of its code as a nuisance of unknown amplitude."""

    def __init__(self, data: Data, nuisance: list[Floats] | None, tolerance: float) -> None:
        self.data, self.nuisance, self.tolerance = data, nuisance, tolerance
        self._shapes: dict[tuple[int, float], tuple[Floats, float]] = {}

    def residual(self, variant: Variant, rows: int, extra: float, stepping: Stepping | None = None) -> Floats:
        """Return the residual of a variant after the nuisance has been fitted."""
        prediction = self.data.predict(variant, rows, self.tolerance, stepping)
        if self.data.coverage(prediction) < 0.5:
            return np.full(sum(value.size for value in prediction), 1e6)
        residual = self.data.residual(prediction, extra)
        if self.nuisance is None or stepping is not None or variant.method is not None:
            return residual
        shape, size = self.shape(rows, extra)
        return residual - shape * (float(np.sum(shape * residual)) / size) if size > 0.0 else residual

    def shape(self, rows: int, extra: float) -> tuple[Floats, float]:
        """Return the nuisance in units of the noise, and the sum of its squares."""
        if (rows, extra) in self._shapes:
            return self._shapes[rows, extra]
        assert self.nuisance is not None
        scaled = [
            value[:rows] / np.sqrt(block.sigma[:rows] ** 2 + (extra * block.scale) ** 2)
            for block, value in zip(self.data.blocks, self.nuisance, strict=True)
        ]
        shape = np.concatenate([value.ravel() for value in scaled])
        self._shapes[rows, extra] = shape, float(np.sum(shape**2))
        return self._shapes[rows, extra]

    def fit(
        self,
        hypothesis: Hypothesis,
        start: Floats,
        rows: int,
        extra: float,
        stepping: Stepping | None = None,
        most: int = 12,
    ) -> tuple[Floats, float]:
        """Return fitted parameters and the rms of the residual."""

        def misfit(p: Floats) -> Floats:
            return self.residual(hypothesis.make(p), rows, extra, stepping)

        if hypothesis.size == 0:
            residual = misfit(start)
            return start, float(np.sqrt(np.mean(residual**2)))
        low, high = hypothesis.bounds
        step = 1e-4
        p = np.clip(start, low, high)
        residual = misfit(p)
        cost = float(np.sum(residual**2))
        for _ in range(most):
            derivative = np.stack([(misfit(p + step * unit) - residual) / step for unit in np.eye(len(p))], axis=1)
            move = np.clip(least(derivative, -residual), -1.5, 1.5)
            improved = False
            for _ in range(5):
                trial = np.clip(p + move, low, high)
                after = misfit(trial)
                if float(np.sum(after**2)) < cost:
                    improved = True
                    break
                move = 0.3 * move
            if not improved:
                break
            gained = cost - float(np.sum(after**2))
            p, residual, cost = trial, after, cost - gained
            if gained < 1e-3 * cost or np.max(np.abs(move)) < 1e-12:
                break
        return p, float(np.sqrt(cost / len(residual)))


def least(derivative: Floats, target: Floats) -> Floats:
    """Return the least-squares solution by normal equations of scaled columns.

    Sums replace the library of linear algebra, whose threads take longer to start than such a sum takes.
    """
    norm = np.sqrt(np.sum(derivative**2, axis=0))
    norm[~(norm > 0.0)] = 1.0
    columns = (derivative / norm).T
    normal = np.array([[np.sum(a * b) for b in columns] for a in columns]).reshape(len(norm), len(norm))
    right = np.array([np.sum(a * target) for a in columns])
    normal[np.diag_indices(len(norm))] += 1e-13
    if not (np.all(np.isfinite(normal)) and np.all(np.isfinite(right))):
        return np.zeros(len(norm))
    return np.asarray(np.linalg.solve(normal, right) / norm)
