"""Fits of hypotheses to all samples of a file, by the method and at the step of its code, as far as they are known."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from dem_bridge.foundation.compiled import side_by_side
from dem_bridge.judging import kernels
from dem_bridge.judging.fitting import MOST_STEPS_OF_METHOD, TOLERANCE_OF_DECISION, Data, Fit, Stepping, least
from dem_bridge.judging.hypotheses import Hypothesis, Variant
from dem_bridge.judging.model import resolving_step

Floats = NDArray[np.float64]

#: methods that a right code may have
METHODS_OF_RIGHT_CODES = (kernels.VERLET, kernels.DRIFT_FIRST, kernels.RK4)
#: steps in an interval of samples that are tried
STEPS_IN_INTERVAL = (*range(1, 21), 25, 30, 40, 50, 64, 80, 100)
#: hypotheses for which they are tried leave less than so many times what the best one leaves
LARGEST_MULTIPLE_OF_BEST = 10.0
#: rms in units of the noise at which the search for method and step ends
RMS_NOISES_AT_END = 1.2
#: what a fit leaves, in the error of velocity Verlet at the step, above which errors of other methods change no digit
LARGEST_MULTIPLE_OF_VERLET = 1e4
#: ... above which they do not make it better than another hypothesis, which leaves so many times less
LEAST_MULTIPLE_OF_VERLET, LARGEST_MULTIPLE_OF_RIVAL = 100.0, 30.0
#: ... and below which the method of order 4 is not that of the code
LARGEST_SHARE_OF_VERLET = 0.1
#: errors in units of the noise that digits do not explain
LEAST_RESOLVED_NOISES = 12.0
#: part of a difference that the best step leaves of noise, at least
LEAST_SHARE_OF_NOISE = 0.3
#: parts of the samples that lead a fit to parameters on which late samples depend strongly
SHARES_OF_LEADING_SAMPLES = (0.1, 0.2, 0.4, 0.6, 0.8)
#: most steps of a run for a hypothesis without parameters, which is one run
MOST_STEPS_OF_ONE_RUN = 10_000_000
#: steps that are tried in a row, each found from the error at the one before
MOST_STEPS_IN_A_ROW = 10
#: methods of second order whose errors show what a right method that is not known may make of a step
METHODS_OF_SECOND_ORDER = (kernels.VERLET, kernels.DRIFT_FIRST)
#: error, relative to the scale of a quantity, up to which that of a method that is not known is put down to its step
LARGEST_ERROR_OF_STEP = 0.01
#: largest error of a method of second order, in the largest error of these: with 5, which Adams-Bashforth may reach, a
#: factor of 1.04 on all stiffnesses was taken for another exponent
LARGEST_MULTIPLE_OF_STEP_ERROR = 2.0
#: derivatives of the motion that are kept: fits by several methods and steps start from the same parameters
MOST_DERIVATIVES_KEPT = 4


class Decision:
    """The last fits of hypotheses to one file."""

    def __init__(self, data: Data) -> None:
        self.data, self.rows = data, len(data.time)
        self.base = Variant(data.model.system)
        self.exact = data.predict(self.base, self.rows, TOLERANCE_OF_DECISION)
        self.errors = data.errors(self.exact)
        self.step = self._step()
        #: the last derivatives, by hypothesis and parameters
        self._derivatives: dict[tuple[Hypothesis, bytes], Floats] = {}

    def _step(self) -> float:
        """Return a step (s) that resolves the contacts: that of the file, if runs with it are short."""
        end, model = float(self.data.time[-1]), self.data.model
        if self.data.dt is not None and end / self.data.dt <= MOST_STEPS_OF_METHOD:
            return float(self.data.dt)
        return resolving_step(model, end, MOST_STEPS_OF_METHOD)

    def time_step_error(self) -> list[Floats]:
        """Return the error of velocity Verlet at the step of the search, for each block; 0 where it is unstable."""
        with np.errstate(all="ignore"):
            stepped = self.data.predict(
                self.base, self.rows, TOLERANCE_OF_DECISION, Stepping(kernels.VERLET, self.step)
            )
            out = [np.nan_to_num(after - before) for after, before in zip(stepped, self.exact, strict=True)]
        sane = all(np.max(np.abs(e), initial=0.0) < 3.0 * b.scale for e, b in zip(out, self.data.blocks, strict=True))
        return out if sane else [0.0 * np.nan_to_num(e) for e in self.exact]

    # ------------------------------------------------------------------ fits
    def decide(self, hypothesis: Hypothesis, p: Floats, rival: Fit | None = None) -> Fit:
        """Return the best fit of a hypothesis from parameters ``p``; ``rival`` is the best of other hypotheses."""
        variant = hypothesis.make(p)
        if variant.method is not None:
            if hypothesis.keeps_step and hypothesis.size and variant.dt is not None:
                return self._improved(hypothesis, p, Stepping(variant.method, variant.dt))
            return self._rounded(hypothesis, p)
        best = self._evaluated(hypothesis, p)
        dt, end = self.data.dt, float(self.data.time[-1])
        if best.rms < RMS_NOISES_AT_END or (
            dt is not None and end / dt > (MOST_STEPS_OF_METHOD if hypothesis.size else MOST_STEPS_OF_ONE_RUN)
        ):
            return best
        for trial in self._stepped(hypothesis, best, rival):
            best = trial if trial.rms < best.rms else best
            if best.rms < RMS_NOISES_AT_END or self.data.over:
                break
        return best

    def _stepped(self, hypothesis: Hypothesis, exact: Fit, rival: Fit | None) -> Iterator[Fit]:
        """Yield the best fits by methods of fixed steps: at the step of the file, or at a step that is to be found."""
        p = exact.parameters
        if self.data.dt is not None:
            by_verlet = self._improved(hypothesis, p, Stepping(kernels.VERLET, self.data.dt))
            yield by_verlet
            for method in METHODS_OF_RIGHT_CODES[1:]:
                if not self._decided_by_verlet(by_verlet, method, rival):
                    yield self._improved(hypothesis, p, Stepping(method, self.data.dt))
            return
        # the file was written by one method and step, whatever its cause
        explained = rival is not None and rival.rms < RMS_NOISES_AT_END
        if explained and rival is not None and rival.stepping is not None:
            yield self._improved(hypothesis, p, rival.stepping)
        for method in (kernels.VERLET, kernels.DRIFT_FIRST):
            yield self._found_step(hypothesis, exact, method)
        promising = rival is None or exact.rms < LARGEST_MULTIPLE_OF_BEST * rival.rms
        if self.data.even and promising and not explained:
            # few steps only make a large error
            counts = STEPS_IN_INTERVAL if exact.error < 0.1 else STEPS_IN_INTERVAL[:20]
            for method in METHODS_OF_RIGHT_CODES[::-1]:
                yield from self._tried_steps(hypothesis, p, method, counts)

    @cached_property
    def _error_of_verlet(self) -> Floats:
        """Error of velocity Verlet at the step of the file, in units of the noise."""
        assert self.data.dt is not None
        with np.errstate(all="ignore"):
            stepped = self._predicted(self.base, Stepping(kernels.VERLET, self.data.dt))
        return self.data.residual(stepped) - self.data.residual(self.exact)

    def _decided_by_verlet(self, fit: Fit, method: int, rival: Fit | None) -> bool:
        """Return whether a fit by velocity Verlet shows that another method at this step need not be tried.

        What the fit leaves may be so large that errors of the step are nothing beside it, or that they do not reach
        what the best of the other hypotheses leaves, ``rival``. Or it is so small that the method of order 4, which
        does not err as Verlet does, would leave more: Verlet's error, but for what parameters take of it.
        """
        error = self._error_of_verlet
        size = float(np.sqrt(np.mean(error**2)))
        worse = rival is not None and fit.rms > LARGEST_MULTIPLE_OF_RIVAL * rival.rms
        if fit.rms > (LEAST_MULTIPLE_OF_VERLET if worse else LARGEST_MULTIPLE_OF_VERLET) * size:
            return True
        small = self._relative(error) < LARGEST_ERROR_OF_STEP
        if method != kernels.RK4 or not small or fit.rms > LARGEST_SHARE_OF_VERLET * size:
            return False
        derivative = self._derivative(fit.hypothesis, fit.parameters)
        rest = error + derivative @ least(derivative, -error)
        return fit.rms < LARGEST_SHARE_OF_VERLET * float(np.sqrt(np.mean(rest**2)))

    def _relative(self, residual: Floats) -> float:
        """Return the largest value of a residual relative to the scale of its quantity."""
        sizes = np.concatenate([(block.sigma / block.scale).ravel() for block in self.data.blocks])
        return float(np.max(np.abs(residual) * sizes))

    def _rounded(self, hypothesis: Hypothesis, p: Floats) -> Fit:
        """Return the fit of a method of another code, at a step that divides the interval of samples if one fits."""
        trials = [p]
        if hypothesis.size and self.data.even:
            count = round(math.exp(-p[0]))
            trials += [np.array([-math.log(k)]) for k in range(max(1, count - 2), count + 3)]
        return min((self._fit(hypothesis, trial, self._residual(hypothesis, trial)) for trial in trials), key=_rms)

    def _evaluated(self, hypothesis: Hypothesis, p: Floats) -> Fit:
        """Return the fit by the exact motion, after two linear improvements."""
        derivative = self._derivative(hypothesis, p)
        fits = []
        for _ in range(3 if hypothesis.size else 1):
            residual = self._residual(hypothesis, p)
            fits.append(self._fit(hypothesis, p, residual, derivative))
            p = np.clip(p + least(derivative, -residual), *hypothesis.bounds)
        return min(fits, key=_rms)

    def _improved(self, hypothesis: Hypothesis, p: Floats, stepping: Stepping) -> Fit:
        """Return the best fit by a method of fixed step, whose derivatives are those of the exact motion."""
        derivative = self._derivative(hypothesis, p)
        best = self._linear_steps(hypothesis, p, stepping, derivative)
        if best.rms < RMS_NOISES_AT_END or not hypothesis.size:
            return best
        # late collisions may depend on the parameters too strongly for a linear step: the first samples lead to them
        row_of_each = np.concatenate(
            [np.repeat(np.arange(self.rows), block.values.shape[1]) for block in self.data.blocks]
        )
        for part in SHARES_OF_LEADING_SAMPLES:
            residual = self._residual(hypothesis, p, stepping)
            rows = row_of_each < part * self.rows
            p = np.clip(p + least(derivative[rows], -residual[rows]), *hypothesis.bounds)
        led = self._linear_steps(hypothesis, p, stepping, derivative)
        return led if led.rms < best.rms else best

    def _linear_steps(self, hypothesis: Hypothesis, p: Floats, stepping: Stepping, derivative: Floats) -> Fit:
        """Return the best of some linear improvements by all samples."""
        best: Fit | None = None
        for _ in range(5 if hypothesis.size else 1):
            residual = self._residual(hypothesis, p, stepping)
            fit, before = self._fit(hypothesis, p, residual, derivative, stepping), best
            best = fit if best is None or fit.rms < best.rms else best
            if before is not None and fit.rms > 0.9995 * before.rms:
                break
            p = np.clip(p + least(derivative, -residual), *hypothesis.bounds)
        assert best is not None
        return best

    def _found_step(self, hypothesis: Hypothesis, exact: Fit, method: int) -> Fit:
        """Return the best fit by a method whose step is found from the size of its error.

        The error is taken to grow by a power of the step. The power is 2 at first, and then that of the last two steps:
        damping forces at half-step velocities add an error of order 1. At last the steps nearby are tried, because an
        error at the kink of a contact law depends on where a step meets it. Small values have no more weight than
        large ones, whatever their digits.
        """
        p, dt, power, best = exact.parameters, self.step, 2.0, exact
        weight = self._weight(0.1 * exact.error)
        derivative = self._derivative(hypothesis, p)
        smooth, start, last, nearest = self._residual(hypothesis, p), p, (0.0, 0.0), (math.inf, 0.0, p)
        for _ in range(MOST_STEPS_IN_A_ROW):
            stepping = Stepping(method, dt)
            residual = self._residual(hypothesis, p, stepping)
            fit = self._fit(hypothesis, p, residual, derivative, stepping)
            if fit.rms < RMS_NOISES_AT_END:
                return self._improved(hypothesis, p, stepping)
            best = fit if fit.rms < best.rms else best
            error = residual - smooth - derivative @ (p - start)
            size = float(np.sqrt(np.mean((weight * error) ** 2)))
            if last[0] and abs(math.log(dt / last[0])) > 0.1 and size > 0.0:
                power = min(max(math.log(size / last[1]) / math.log(dt / last[0]), 1.0), 4.0)
            columns = np.column_stack([derivative, error])
            change = least(weight[:, None] * columns, -weight * residual)
            left = residual + columns @ change
            if not last[0]:
                linear = self._fit(hypothesis, p + change[:-1], left)
                best = linear if linear.rms < best.rms else best
            growth = 1.0 + float(change[-1])
            last, p = (dt, size), np.clip(p + change[:-1], *hypothesis.bounds)
            if not 0.0 < growth < 1e9:
                break
            dt = self._whole(dt * growth ** (1.0 / power))
            nearest = min(nearest, (float(np.sqrt(np.mean((weight * left) ** 2))), dt, p), key=lambda item: item[0])
            if float(self.data.time[-1]) / dt > MOST_STEPS_OF_METHOD:
                break
            if dt == last[0]:
                fit = self._improved(hypothesis, p, stepping)
                best = fit if fit.rms < best.rms else best
                break
        if best.rms < RMS_NOISES_AT_END:
            return best
        count = self.data.interval / nearest[1] if nearest[1] else 0.0
        if not self.data.even or count < 2.0 or exact.error > 0.1:
            return best
        counts = range(int(0.88 * count), int(1.12 * count) + 2)
        return min((best, *self._tried_steps(hypothesis, nearest[2], method, counts)), key=_rms)

    def _weight(self, extra: float) -> Floats:
        """Return the factor on residuals in units of the noise for a noise of ``extra`` scales in addition."""
        return np.concatenate(
            [(b.sigma / np.sqrt(b.sigma**2 + (extra * b.scale) ** 2)).ravel() for b in self.data.blocks]
        )

    def _whole(self, dt: float) -> float:
        """Return the step nearby that divides the interval of samples."""
        count = self.data.interval / dt
        near = self.data.even and abs(count - round(count)) < max(0.2, 0.02 * count) and round(count) > 0
        return self.data.interval / round(count) if near else dt

    def _tried_steps(self, hypothesis: Hypothesis, p: Floats, method: int, counts: Sequence[int]) -> Iterator[Fit]:
        """Yield the best fits by a method at steps of which so many make the interval, and at those between."""
        derivative, steps = self._derivative(hypothesis, p), 0.0
        trials = []
        for place, count in enumerate(counts):
            stepping = Stepping(method, self.data.interval / count)
            steps += float(self.data.time[-1]) / stepping.dt
            if steps > 2 * MOST_STEPS_OF_METHOD:
                break
            residual = self._residual(hypothesis, p, stepping)
            change = least(derivative, -residual)
            left = float(np.sqrt(np.mean((residual + derivative @ change) ** 2)))
            trials.append((left, place, np.clip(p + change, *hypothesis.bounds), stepping))
        if not trials:
            return
        _, place, p, stepping = min(trials, key=lambda trial: trial[0])
        yield self._improved(hypothesis, p, stepping)
        below, above = counts[max(place - 1, 0)], counts[min(place + 1, len(counts) - 1)]
        between = [count for count in range(below + 1, above) if count != counts[place]]
        if between:
            yield from self._tried_steps(hypothesis, p, method, between)

    def _residual(self, hypothesis: Hypothesis, p: Floats, stepping: Stepping | None = None) -> Floats:
        """Return the residual of a hypothesis in units of the noise."""
        with np.errstate(all="ignore"):
            return self.data.residual(self.data.predict(hypothesis.make(p), self.rows, TOLERANCE_OF_DECISION, stepping))

    def _derivative(self, hypothesis: Hypothesis, p: Floats) -> Floats:
        """Return the derivative of the residual by each parameter, in units of the noise."""
        key = hypothesis, p.tobytes()
        if key not in self._derivatives:
            while len(self._derivatives) >= MOST_DERIVATIVES_KEPT:
                self._derivatives.pop(next(iter(self._derivatives)))
            self._derivatives[key] = self._computed_derivative(hypothesis, p)
        return self._derivatives[key]

    def _computed_derivative(self, hypothesis: Hypothesis, p: Floats) -> Floats:
        """Return the derivative by two motions for each parameter."""
        if hypothesis.size == 0:
            return np.zeros((sum(block.values.size for block in self.data.blocks), 0))
        step, tolerance = 1e-4, TOLERANCE_OF_DECISION if float(np.max(self.errors)) < 1e-4 else 1e-11

        def residual(q: Floats) -> Floats:
            with np.errstate(all="ignore"):  # which each thread has for itself
                return self.data.residual(self.data.predict(hypothesis.make(q), self.rows, tolerance))

        centre, *moved = side_by_side(residual, [p, *(p + step * np.eye(len(p)))])
        return np.stack([(other - centre) / step for other in moved], axis=1)

    def _fit(
        self,
        hypothesis: Hypothesis,
        p: Floats,
        residual: Floats,
        derivative: Floats | None = None,
        stepping: Stepping | None = None,
    ) -> Fit:
        deviation = np.zeros(len(p))
        rms = float(np.sqrt(np.mean(residual**2)))
        if derivative is not None and len(p):
            norm = np.sqrt(np.maximum(np.sum(derivative**2, axis=0), 1e-300))
            columns = derivative / norm
            alike = np.array([[np.sum(a * b) for b in columns.T] for a in columns.T])
            # each is uncertain by what the others may take
            deviation = max(rms, 1.0) / norm * np.sqrt(np.diag(np.linalg.inv(alike + 1e-13 * np.eye(len(p)))))
        factors = hypothesis.make(p).factors
        scaled = np.concatenate([(b.sigma / (b.scale * abs(factors[b.quantity]))).ravel() for b in self.data.blocks])
        sizes = np.abs(residual) * scaled
        units = [
            np.full(b.values.size, floor / b.scale) for b, floor in zip(self.data.blocks, self.data.floors, strict=True)
        ]
        floors = float(np.max(sizes / np.concatenate(units)))
        largest = float(np.max(np.abs(residual)))
        return Fit(hypothesis, p, rms, largest, float(np.max(sizes)), deviation, stepping, floors)

    # ------------------------------------------------------------------ effects
    def effect(self, fit: Fit) -> float:
        """Return the largest difference between a fit and the scene in floors of the file.

        The floor is the largest of the digits of the file, the time-step error of its code, and what the fit leaves. A
        hypothesis about the method is about the time-step error itself, which is then no part of the floor.
        """
        variant = fit.hypothesis.make(fit.parameters)
        prediction = self.data.predict(variant, self.rows, TOLERANCE_OF_DECISION)
        stepped = prediction
        if fit.stepping is not None:
            stepped = self.data.predict(variant, self.rows, TOLERANCE_OF_DECISION, fit.stepping)
        left, step = self.data.largest(stepped, self._values), self.data.largest(stepped, prediction)
        differences = self.data.largest(prediction, self.exact)
        floors = (max(three) for three in zip(self.data.floors, left, step, strict=True))
        return max(difference / floor for difference, floor in zip(differences, floors, strict=True))

    def effect_of_noise(self, none: Fit) -> float:
        """Return what the scene leaves in floors of the file: its digits and the time-step error of its code.

        A step that is found in noise is none: where the file states no step, the error of a step that resolves the
        contacts counts, and noise is what no step explains.
        """
        stepping = none.stepping if self.data.dt is not None else None
        if stepping is None and none.rms < LEAST_SHARE_OF_NOISE * float(
            np.sqrt(np.mean(self.data.residual(self.exact) ** 2))
        ):
            return 0.0
        by_steps = self.data.predict(
            self.base, self.rows, TOLERANCE_OF_DECISION, stepping or Stepping(kernels.VERLET, self.step)
        )
        left = self.data.largest(by_steps if stepping is not None else self.exact, self._values)
        floors = map(max, self.data.floors, self.data.largest(by_steps, self.exact))
        return max(difference / floor for difference, floor in zip(left, floors, strict=True))

    def within_step(self, fit: Fit) -> bool:
        """Return whether what a fit leaves is no more than a method of second order errs by at the step of the file.

        Right codes have many methods, of which a few are repeated step by step. The errors of others are some times
        those of velocity Verlet.
        """
        variant = fit.hypothesis.make(fit.parameters)
        dt, end = self.data.dt, float(self.data.time[-1])
        if dt is None or end / dt > MOST_STEPS_OF_ONE_RUN or variant.method not in (None, kernels.VERLET):
            return False
        with np.errstate(all="ignore"):
            left = self.data.largest(self._predicted(variant, fit.stepping), self._values)
            free = variant._replace(method=None, dt=None)
            exact = self._predicted(free)
            errors = [self.data.largest(self._predicted(free, Stepping(m, dt)), exact) for m in METHODS_OF_SECOND_ORDER]
        for value, floor, rest, *by_step in zip(exact, self.data.floors, left, *errors, strict=True):
            most = LARGEST_ERROR_OF_STEP * float(np.max(np.abs(value), initial=0.0, where=np.isfinite(value)))
            step = max((error for error in by_step if error < most), default=0.0)
            if not rest <= min(LARGEST_MULTIPLE_OF_STEP_ERROR * step, most) + LEAST_RESOLVED_NOISES * floor:
                return False
        return True

    def _predicted(self, variant: Variant, stepping: Stepping | None = None) -> list[Floats]:
        """Return what the file would hold of a variant, by the exact motion or by a method."""
        return self.data.predict(variant, self.rows, TOLERANCE_OF_DECISION, stepping)

    def adaptive_error(self) -> float:
        """Return the error of an adaptive method that steps through contacts, relative to the scale of a quantity."""
        loose = self.data.predict(self.base, self.rows, 1e-11)
        errors = zip(self.data.largest(loose, self.exact), self.data.blocks, strict=True)
        return max(error / block.scale for error, block in errors)

    def error_at_rest(self) -> float:
        """Return the largest error where bodies have not moved yet, and no code errs, relative to the scale."""
        largest = 0.0
        for block, value in zip(self.data.blocks, self.exact, strict=True):
            start = self.base.system.velocity[block.columns] if block.quantity == 0 else 0.0
            error = np.where(np.abs(value - start) < block.sigma, np.abs(value - block.values), 0.0)
            error = np.where(
                block.present & (block.quantity < 2) & (error > LEAST_RESOLVED_NOISES * block.sigma), error, 0.0
            )
            largest = max(largest, float(np.max(error)) / block.scale)
        return largest

    @property
    def _values(self) -> list[Floats]:
        return [block.values for block in self.data.blocks]


def _rms(fit: Fit) -> float:
    return fit.rms
