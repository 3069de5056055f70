"""Search among hypotheses: linear ranking where a difference begins, fits in growing windows, and a last fit of all."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dem_bridge.judging import kernels
from dem_bridge.judging.fitting import DECISION, MOST_STEPS, SEARCH, Data, Fit, Fitter, Stepping, least
from dem_bridge.judging.hypotheses import LOG_STARTS, Changes, Hypothesis, Variant, global_hypotheses
from dem_bridge.judging.model import Model
from dem_bridge.judging.samples import half_steps, sample_hypotheses
from dem_bridge.scene import Scene

Floats = NDArray[np.float64]

#: difference relative to the scale of a quantity up to which it counts as linear in its cause
LINEAR = 0.1
#: masses and stiffnesses of single bodies and contacts that are fitted after the linear ranking
PLACES = 4
#: hypotheses that are fitted in the first window, and by all samples
FITTED, FINALISTS = 24, 6
#: ... and of one cause
SAME = 4
#: part of the samples in the first window
SHORTEST = 40
#: steps in an interval of samples that are tried
DIVISORS = (1, 2, 3, 4, 5, 6, 8, 10, 12, 15, 16, 20, 25, 30, 32, 40, 50, 64, 80, 100)
#: part of the scene's own residual that a hypothesis may leave to be fitted further
LEFT = 0.6


@dataclass(frozen=True, eq=False)
class Candidate:
    """A hypothesis with parameters and the residual that it leaves, relative to that of the scene."""

    hypothesis: Hypothesis
    parameters: Floats
    left: float


class Search:
    """The search for the cause of the difference between one file and its scene."""

    def __init__(self, scene: Scene, record: Any, floor: Mapping[str, float]) -> None:
        self.scene, self.model = scene, Model(scene)
        self.data = Data(record, self.model, floor)
        self.base = Variant(self.model.system)
        self.none = Hypothesis("none", lambda p: self.base, "The scene itself.")
        self.rows = len(self.data.time)
        self.exact = self.data.predict(self.base, self.rows, DECISION)
        self.errors = self.data.errors(self.exact)
        self.step = self._step()
        self.nuisance = self._nuisance(self.base, kernels.VERLET, self.exact)
        size = float(np.max(self.errors))
        # the model errs by up to ten thousand tolerances of its steps, where bodies collide often
        tolerance = SEARCH if size > 1e-2 else DECISION if size < 1e-4 else 1e-11
        self.fitter = Fitter(self.data, self.nuisance, tolerance)

    def _step(self) -> float:
        """Return a step (s) that resolves the contacts: that of the file, if runs with it are short."""
        end = float(self.data.time[-1])
        if self.data.dt is not None and end / self.data.dt <= MOST_STEPS:
            return float(self.data.dt)
        system, depth = self.model.system, max(self.model.depth, 1e-15)
        stiffness = (system.exponent - 1.0) * system.stiffness * depth ** (system.exponent - 2.0)
        rate = math.sqrt(float(np.max(stiffness)) * 2.0 / float(np.min(system.mass)))
        return max(min(end / 2e4, 0.1 / rate if rate > 0.0 else end), end / MOST_STEPS)

    def _nuisance(self, variant: Variant, method: int, exact: list[Floats]) -> list[Floats]:
        """Return the time-step error of a method at the step of the search, for each block."""
        with np.errstate(all="ignore"):
            stepped = self.data.predict(variant, self.rows, DECISION, Stepping(method, self.step))
            out = [np.nan_to_num(after - before) for after, before in zip(stepped, exact, strict=True)]
        # a step at which the method is unstable says nothing
        sane = all(np.max(np.abs(e), initial=0.0) < 3.0 * b.scale for e, b in zip(out, self.data.blocks, strict=True))
        return out if sane else [0.0 * np.nan_to_num(e) for e in exact]

    # ------------------------------------------------------------------ ranking
    def windows(self) -> list[int]:
        """Return numbers of samples: until the difference is no longer linear in its cause, and twice as many each."""
        over = np.flatnonzero(self.errors > LINEAR)
        # time-step errors are below a fiftieth of an effect that can be named
        first = int(np.flatnonzero(self.errors >= min(1e-2, 0.05 * float(np.max(self.errors))))[0])
        linear = int(over[0]) + 1 - first if len(over) else self.rows
        length, windows = max(min(linear, self.rows // SHORTEST), 8), []
        while first + length < self.rows:
            windows.append(first + length)
            length *= 2
        return [*windows, self.rows]

    def rank(self, hypotheses: Iterable[Hypothesis], rows: int) -> list[Candidate]:
        """Return the hypotheses with first parameters, those that leave least first."""
        extra = 1e-3 * float(np.max(self.errors[:rows]))
        start = self.fitter.residual(self.base, rows, extra)
        size = math.sqrt(float(np.sum(start**2)))
        # methods of other codes have a time-step error of their own
        whole = self.data.residual([value[:rows] for value in self.exact], extra)
        large = float(np.max(self.errors[:rows])) > LINEAR
        out = []
        for hypothesis in hypotheses:
            best = Candidate(hypothesis, np.array(hypothesis.starts[0]), math.inf)
            trials = (
                [np.clip(np.array(p), *hypothesis.bounds) for p in hypothesis.starts]
                if large or hypothesis.size == 0
                else []
            )
            if hypothesis.size > 0 and hypothesis.probe is not None:
                probe = np.array(hypothesis.starts[0])
                probe[0] = hypothesis.probe
                variant = hypothesis.make(probe)
                origin = start if variant.method is None else whole
                change = self.fitter.residual(variant, rows, extra) - origin
                norm = float(np.sum(change**2))
                if norm > 0.0:
                    factor = -float(np.sum(change * origin)) / norm
                    left = math.sqrt(float(np.sum((origin + factor * change) ** 2))) / size
                    if hypothesis.logarithmic:
                        guess = hypothesis.probe + (math.log(factor) if factor > 0.0 else -3.0)
                        left = left if factor > 0.0 else 1.0
                    else:
                        guess = hypothesis.probe * factor
                    guess = float(np.clip(guess, *hypothesis.bounds))
                    limit = hypothesis.reach
                    best = Candidate(hypothesis, np.clip(np.array([guess]), -limit, limit), left)
                    if large:
                        trials.append(best.parameters)
                        best = Candidate(hypothesis, best.parameters, math.sqrt(left))
            for trial in trials:
                left = math.sqrt(float(np.sum(self.fitter.residual(hypothesis.make(trial), rows, extra) ** 2))) / size
                if left < best.left:
                    best = Candidate(hypothesis, trial, left)
            out.append(best)
        return sorted(out, key=lambda candidate: candidate.left)

    def places(self, rows: int) -> list[Hypothesis]:
        """Return the masses and stiffnesses of single bodies and contacts that resemble the difference most."""
        change, scene = Changes(self.scene, self.model), self.scene
        masses = [
            Hypothesis(
                "mass", change.one_mass(i), f"The mass of body {i} is {{0:.6g}} +- {{1:.2g}} of the scene's.",
                starts=LOG_STARTS, where=f"body {i}", value=math.exp,
            )
            for i in range(scene.n_body)
        ]  # fmt: skip
        stiffnesses = [
            Hypothesis(
                "stiffness", change.one_stiffness(int(place)),
                f"The stiffness of contact {k} is {{0:.6g}} +- {{1:.2g}} of the scene's.",
                starts=LOG_STARTS, where=f"contact {k}", value=math.exp, bounds=(-12.0, 12.0),
            )
            for k, place in enumerate(change.places())
        ]  # fmt: skip
        missed = {
            f"contact {k}": Hypothesis(
                "missed-contact", _missed(change, int(place)), f"Contact {k} never acts.", where=f"contact {k}"
            )
            for k, place in enumerate(change.places())
        }
        first = [candidate.hypothesis for candidate in self.rank(masses, rows)[:PLACES]]
        second = [candidate.hypothesis for candidate in self.rank(stiffnesses, rows)[:PLACES]]
        return [*first, *second, *(missed[hypothesis.where] for hypothesis in second)]

    def everywhere(self) -> list[Hypothesis]:
        """Return the hypotheses that do not concern a single place."""
        everywhere = [*sample_hypotheses(self.data, self.exact), *half_steps(self.data, self.step)]
        return [*everywhere, *global_hypotheses(self.scene, self.model)]

    # ------------------------------------------------------------------ fits
    def finalists(self) -> list[Candidate]:
        """Return the hypotheses that leave least of the difference, fitted by all samples."""
        kept = self._fitted(self.windows()) or self._fitted([self.rows])
        # a factor on all masses is nearly the inverse factor on all stiffnesses: neither is examined without the other
        factors = {
            candidate.hypothesis.cause: candidate for candidate in kept if candidate.hypothesis.family == "factor"
        }
        if len(factors) == 1:
            one = next(iter(factors.values()))
            for hypothesis in global_hypotheses(self.scene, self.model):
                if hypothesis.family == "factor" and hypothesis.cause != one.hypothesis.cause:
                    kept.insert(kept.index(one) + 1, Candidate(hypothesis, -one.parameters, one.left))
        return kept

    def _fitted(self, windows: list[int]) -> list[Candidate]:
        """Return the hypotheses that leave least in each of the windows."""
        everywhere, kept = self.everywhere(), list[Candidate]()
        # where a difference begins it is linear in its cause, and a little later causes differ more
        for rows in dict.fromkeys((windows[0], windows[min(2, len(windows) - 1)])):
            ranked = [
                candidate for candidate in self.rank([*everywhere, *self.places(rows)], rows) if candidate.left < 0.97
            ]
            for candidate in ranked:
                same = [other for other in kept if other.hypothesis.cause == candidate.hypothesis.cause]
                again = any(_alike(other, candidate) for other in same)
                if len(same) < SAME and len(kept) < FITTED and not again:
                    kept.append(candidate)
        for rows in windows:
            extra = 1e-3 * float(np.max(self.errors[:rows]))
            start = float(np.sqrt(np.mean(self.fitter.residual(self.base, rows, extra) ** 2)))
            fitted = []
            for candidate in kept:
                p, rms = self.fitter.fit(candidate.hypothesis, candidate.parameters, rows, extra)
                fitted.append(Candidate(candidate.hypothesis, p, rms / start))
            fitted.sort(key=lambda candidate: candidate.left)
            least = fitted[0].left if fitted else 0.0
            kept = [
                candidate for candidate in fitted if candidate.left < LEFT and candidate.left < max(30.0 * least, 0.1)
            ]
        return kept

    # ------------------------------------------------------------------ decision
    def decide(self, candidate: Candidate) -> Fit:
        """Return the fit of a hypothesis by the method and step of the file, as far as they are known."""
        if candidate.hypothesis.make(candidate.parameters).method is not None:
            return self._rounded(candidate.hypothesis, candidate.parameters)
        best = self._evaluated(candidate.hypothesis, candidate.parameters, None)
        if best.rms < 1.2:
            return best
        dt, end = self.data.dt, float(self.data.time[-1])
        if dt is not None and end / dt > MOST_STEPS:
            return best
        for method in (kernels.VERLET, kernels.DRIFT_FIRST, kernels.RK4):
            if dt is not None:
                trial = self._improved(candidate.hypothesis, candidate.parameters, Stepping(method, dt), rounds=5)
            elif method != kernels.RK4:
                trial = self._found_step(candidate.hypothesis, candidate.parameters, method, best)
            else:
                trial = self._tried_steps(candidate.hypothesis, best, kernels.RK4)
            if trial.rms < best.rms:
                best = trial
            if best.rms < 1.2:
                break
        if best.stepping is not None and best.rms < 3.0 and dt is None:
            converged = self._improved(candidate.hypothesis, best.parameters, best.stepping, rounds=4)
            best = converged if converged.rms < best.rms else best
        return best

    def _rounded(self, hypothesis: Hypothesis, p: Floats) -> Fit:
        """Return the fit of a method of another code, at a step that divides the interval of samples if one fits."""
        trials = [p]
        if hypothesis.size and self.data.even:
            count = round(math.exp(-p[0]))
            trials += [np.array([-math.log(k)]) for k in range(max(1, count - 2), count + 3)]
        fits = []
        for trial in trials:
            residual = self.data.residual(self.data.predict(hypothesis.make(trial), self.rows, DECISION))
            fits.append(self._fit(hypothesis, trial, residual, None, None))
        return min(fits, key=lambda fit: fit.rms)

    def effect(self, fit: Fit) -> float:
        """Return the largest difference between a fit and the scene in floors of the file.

        The floor is the largest of the digits of the file, the time-step error of its code, and what the fit leaves. A
        hypothesis about the method is about the time-step error itself, which is then no part of the floor.
        """
        variant = fit.hypothesis.make(fit.parameters)
        prediction = self.data.predict(variant, self.rows, DECISION)
        left = self.data.largest(self.data.predict(variant, self.rows, DECISION, fit.stepping), self._values)
        step = [0.0] * len(left)
        if fit.stepping is not None:
            step = self.data.largest(self.data.predict(variant, self.rows, DECISION, fit.stepping), prediction)
        differences = self.data.largest(prediction, self.exact)
        floors = (max(three) for three in zip(self.data.floors, left, step, strict=True))
        return max(difference / floor for difference, floor in zip(differences, floors, strict=True))

    def effect_of_noise(self, none: Fit) -> float:
        """Return what the scene leaves in floors of the file: its digits and the time-step error of its code."""
        method, dt = none.stepping or Stepping(kernels.VERLET, self.data.dt or self.step)
        by_steps = self.data.predict(self.base, self.rows, DECISION, Stepping(method, dt))
        left = self.data.largest(by_steps if none.stepping is not None else self.exact, self._values)
        floors = map(max, self.data.floors, self.data.largest(by_steps, self.exact))
        return max(difference / floor for difference, floor in zip(left, floors, strict=True))

    def adaptive_error(self) -> float:
        """Return the error of an adaptive method that steps through contacts, relative to the scale of a quantity."""
        loose = self.data.predict(self.base, self.rows, 1e-11)
        return max(
            error / block.scale
            for error, block in zip(self.data.largest(loose, self.exact), self.data.blocks, strict=True)
        )

    @property
    def _values(self) -> list[Floats]:
        return [block.values for block in self.data.blocks]

    def _derivative(self, hypothesis: Hypothesis, p: Floats) -> Floats:
        """Return the derivative of the residual by each parameter, in units of the noise."""
        if hypothesis.size == 0:
            return np.zeros((sum(block.values.size for block in self.data.blocks), 0))
        step = 1e-4

        def residual(q: Floats) -> Floats:
            return self.data.residual(
                self.data.predict(hypothesis.make(q), self.rows, min(self.fitter.tolerance, 1e-11))
            )

        centre = residual(p)
        return np.stack([(residual(p + step * unit) - centre) / step for unit in np.eye(len(p))], axis=1)

    def _evaluated(self, hypothesis: Hypothesis, p: Floats, stepping: Stepping | None) -> Fit:
        """Return the fit at these parameters, after one linear improvement if no step is to be repeated."""
        if stepping is None:
            derivative = self._derivative(hypothesis, p)
            for _ in range(2 if hypothesis.size else 1):
                residual = self.data.residual(self.data.predict(hypothesis.make(p), self.rows, DECISION))
                fit = self._fit(hypothesis, p, residual, derivative, None)
                if hypothesis.size:
                    p = p + least(derivative, -residual)
                    p = np.clip(p, *hypothesis.bounds)
            if hypothesis.size:
                residual = self.data.residual(self.data.predict(hypothesis.make(p), self.rows, DECISION))
                last = self._fit(hypothesis, p, residual, derivative, None)
                fit = last if last.rms < fit.rms else fit
            return fit
        prediction = self.data.predict(hypothesis.make(p), self.rows, DECISION, stepping)
        return self._fit(hypothesis, p, self.data.residual(prediction), None, stepping)

    def _fit(
        self, hypothesis: Hypothesis, p: Floats, residual: Floats, derivative: Floats | None, stepping: Stepping | None
    ) -> Fit:
        deviation = np.zeros(len(p))
        rms = float(np.sqrt(np.mean(residual**2)))
        if derivative is not None and len(p):
            normal = np.maximum(np.sum(derivative**2, axis=0), 1e-300)
            deviation = max(rms, 1.0) / np.sqrt(normal)
        factors = hypothesis.make(p).factors
        scaled = np.concatenate([(b.sigma / (b.scale * abs(factors[b.quantity]))).ravel() for b in self.data.blocks])
        error = float(np.max(np.abs(residual) * scaled))
        return Fit(hypothesis, p, rms, float(np.max(np.abs(residual))), error, deviation, stepping)

    def _improved(self, hypothesis: Hypothesis, p: Floats, stepping: Stepping, rounds: int) -> Fit:
        """Return the best fit by a method of fixed step, whose derivatives are those of the exact motion."""
        derivative = self._derivative(hypothesis, p)
        best: Fit | None = None
        for _ in range(rounds if hypothesis.size else 1):
            prediction = self.data.predict(hypothesis.make(p), self.rows, DECISION, stepping)
            residual = self.data.residual(prediction)
            fit = self._fit(hypothesis, p, residual, derivative, stepping)
            if best is not None and fit.rms > 0.9995 * best.rms:
                best = fit if fit.rms < best.rms else best
                break
            best = fit
            if hypothesis.size:
                p = np.clip(p + least(derivative, -residual), *hypothesis.bounds)
        assert best is not None
        return best

    def _found_step(self, hypothesis: Hypothesis, p: Floats, method: int, exact: Fit) -> Fit:
        """Return the best fit by a method whose step is found from the size of its error."""
        variant = hypothesis.make(p)
        smooth = self.data.predict(variant, self.rows, DECISION)
        shape = self.fitter_shape(self._nuisance(variant, method, smooth))
        derivative = np.column_stack([self._derivative(hypothesis, p), shape])
        residual = self.data.residual(smooth)
        change = least(derivative, -residual)
        amplitude = float(change[-1])
        left = residual + np.sum(derivative * change, axis=1)
        best = self._fit(hypothesis, p + change[:-1], left, None, None)
        best = best if best.rms < exact.rms else exact
        if amplitude <= 0.0:
            return best
        p = np.clip(p + change[:-1], *hypothesis.bounds)
        end = float(self.data.time[-1])
        # damping forces at half-step velocities make the methods first order
        power = 1.0 if variant.system.damped else 2.0
        for _ in range(4):
            dt = self.step * amplitude ** (1.0 / power)
            count = self.data.interval / dt
            if self.data.even and abs(count - round(count)) < max(0.2, 0.02 * count) and round(count) > 0:
                dt = self.data.interval / round(count)
            if end / dt > MOST_STEPS:
                break
            stepping = Stepping(method, dt)
            residual = self.data.residual(self.data.predict(hypothesis.make(p), self.rows, DECISION, stepping))
            fit = self._fit(hypothesis, p, residual, derivative[:, :-1], stepping)
            if fit.rms < best.rms:
                best = fit
            if fit.rms < 1.2:
                break
            change = least(derivative, -residual)
            p, after = np.clip(p + change[:-1], *hypothesis.bounds), (dt / self.step) ** power + float(change[-1])
            if after <= 0.0:
                break
            amplitude = after
        return best

    def _tried_steps(self, hypothesis: Hypothesis, exact: Fit, method: int) -> Fit:
        """Return the best fit by a method at steps that divide the interval of samples."""
        p, end, best = exact.parameters, float(self.data.time[-1]), exact
        if not self.data.even or exact.error > 0.1:
            return exact
        fits = []
        for count in DIVISORS:
            dt = self.data.interval / count
            if end / dt > MOST_STEPS / 10:
                break
            with np.errstate(all="ignore"):
                stepping = Stepping(method, dt)
                prediction = self.data.predict(hypothesis.make(p), self.rows, DECISION, stepping)
                fits.append(self._fit(hypothesis, p, self.data.residual(prediction), None, stepping))
        least_left = min(fits, key=lambda fit: fit.rms, default=exact)
        if least_left.rms < 0.5 * best.rms and least_left.stepping is not None:
            best = self._improved(hypothesis, p, least_left.stepping, rounds=4)
        return best

    def fitter_shape(self, nuisance: list[Floats]) -> Floats:
        """Return a nuisance in units of the noise."""
        return np.concatenate([(e / b.sigma).ravel() for e, b in zip(nuisance, self.data.blocks, strict=True)])


def _alike(first: Candidate, second: Candidate) -> bool:
    """Return whether two candidates are one hypothesis with nearly one start."""
    one, other = first.hypothesis, second.hypothesis
    same = (one.cause, one.where, one.evidence) == (other.cause, other.where, other.evidence)
    return same and bool(np.allclose(first.parameters, second.parameters, rtol=0.3, atol=1e-12))


def _missed(change: Changes, place: int) -> Any:
    factor = np.ones(change.scene.n_body + 1)
    factor[place] = 0.0
    return lambda p: Variant(change.with_factors(stiffness=factor))
