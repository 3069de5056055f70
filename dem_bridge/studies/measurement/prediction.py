"""Predict the measured values by runs of the scene, and adjust uncertain parameters to them by least squares.

The values of a run are interpolated to the times of the measurement by polynomials through six samples. Changes of the
parameters are those of velocity-Verlet at a coarse step, relative to its own run of the scene as it is: the error of
the step cancels in the difference but for a part of the change.

With errors ``sigma`` of the values and declared standard uncertainties of the parameters, the sum of

    ((S(x) - D) / sigma)^2 over the values and x^2 over the declared parameters, x in their standard uncertainties,

is least at the most probable parameters. For a linear S(x) the least sum is ``E^T V^-1 E`` with the covariance ``V`` of
all errors, and it is distributed as chi-square with as many degrees of freedom as there are values if the model is
right. Where S is not linear over the declared uncertainties it mostly is over the smaller uncertainties that the
measured values leave, and the least sum keeps this distribution. Where it is not even there, or where no least sum is
found (contacts that open and close, with small errors of many values), the sum is too large for a right model and
decides nothing: see :attr:`Adjusted.decides`.

References
----------
Tarantola, *Inverse Problem Theory*, SIAM 2005, chapter 3.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lstsq
from scipy.stats import norm, qmc

from dem_bridge.backends.base import Resolution, Sampling
from dem_bridge.backends.scene_prescan import prescan_scene
from dem_bridge.errors import UsageError
from dem_bridge.observables.registry import OBSERVABLES
from dem_bridge.runs.cache import RunCache
from dem_bridge.runs.campaign import Progress
from dem_bridge.runs.case import Case
from dem_bridge.runs.uncertainty.estimate import solve
from dem_bridge.scene.scene import Scene
from dem_bridge.studies.measurement.parameters import Parameter, changed
from dem_bridge.studies.measurement.readings import Reading
from dem_bridge.trajectory.trajectory import Floats, Trajectory

#: step of the fast runs and time between samples, as parts of 1/omega of the stiffest contact: the error of the step is
#: below 1e-3 of the largest velocity, that of the interpolation below 1e-5
STEP_PHASE, SAMPLE_PHASE = 0.05, 0.25
#: least and largest number of samples of a run
FEWEST, MOST = 500, 20_000
#: samples that carry a polynomial, and those of the coarser one that estimates its error
NODES, FEWER = 6, 4


@dataclass(frozen=True, kw_only=True, eq=False)
class Prediction:
    """Predict the values of some readings on a scene; arrays ``(n,)`` have all readings, one after the other."""

    scene: Scene
    readings: tuple[Reading, ...]
    parameters: tuple[Parameter, ...] = ()
    backend: str = "reference"
    """Code of the run that is compared."""
    dt: float | None = None
    """Its time step, s; None is that of the code."""
    cache: RunCache = field(default_factory=RunCache)

    @cached_property
    def frequency(self) -> float:
        """Highest angular frequency of a contact, rad/s."""
        return float(prescan_scene(self.scene).frequency)

    @cached_property
    def sampling(self) -> Sampling:
        """Times of the samples that are interpolated."""
        return Sampling(count=int(np.clip(self.scene.duration * self.frequency / SAMPLE_PHASE, FEWEST, MOST)))

    @cached_property
    def run(self) -> Trajectory:
        """The run of the scene, with its uncertainty."""
        resolution = Resolution(dt=self.dt)
        case = Case(scene=self.scene, backend=self.backend, resolution=resolution, sampling=self.sampling)
        return solve(case, self.cache)

    @cached_property
    def simulated(self) -> Floats:
        """Values of the scene as it is, ``(n,)``."""
        return self._values(self.scene, self.run)

    @cached_property
    def numerical(self) -> Floats:
        """Numerical standard uncertainty ``u_num`` of each value: of the run, and of its interpolation, ``(n,)``."""
        coarse = self._values(self.scene, self.run, nodes=FEWER)
        return np.asarray(np.hypot(self._of_run(), self.simulated - coarse))

    def _of_run(self) -> Floats:
        parts = []
        for reading in self.readings:
            errors = np.asarray(OBSERVABLES[reading.quantity].uncertainty(self.scene, self.run))
            worst = np.max(errors, axis=0) if reading.sampled else errors
            parts.append(np.full(len(reading.value), worst[reading.place]))
        return np.concatenate(parts)

    @cached_property
    def slope(self) -> Floats:
        """Slope of each value in time, ``(n,)``: -1 for an arrival, 0 for peaks, which a shift of the clock leaves."""
        step = 0.5 * self.scene.duration / self.sampling.count
        later, earlier = (self._values(self.scene, self.run, shift=shift) for shift in (step, -step))
        return np.asarray((later - earlier) / (2.0 * step))

    @cached_property
    def _own(self) -> Floats:
        """Values of the scene as it is by the fast code, ``(n,)``."""
        return self._fast(self.scene, 0.0)

    def at(self, parameters: Sequence[Parameter], changes: Sequence[float]) -> Floats:
        """Return the values with these changes of parameters, ``(n,)``."""
        gain, shift = (
            sum(change for item, change in zip(parameters, changes, strict=True) if item.kind == kind)
            for kind in ("gain", "time")
        )
        scene = changed(self.scene, parameters, changes)
        base = self.simulated if shift == 0.0 else self._values(self.scene, self.run, shift=shift)
        if scene is not self.scene:
            base = base + self._fast(scene, shift) - (self._own if shift == 0.0 else self._fast(self.scene, shift))
        return np.asarray((1.0 + gain * self._amplified) * base)

    @cached_property
    def _amplified(self) -> Floats:
        """1 for values that a gain multiplies, 0 for times."""
        return np.concatenate([np.full(len(item.value), float(item.quantity != "arrival")) for item in self.readings])

    def samples(
        self, parameters: Sequence[Parameter], *, count: int, seed: int, progress: Progress | None = None
    ) -> tuple[Floats, Floats]:
        """Return ``count`` samples of the parameters, and the changes of the values with each.

        The samples are a Latin hypercube of normal numbers, ``(count, n_parameter)`` in standard uncertainties; the
        changes are ``(count, n)``.
        """
        if not parameters:
            return np.zeros((count, 0)), np.zeros((count, len(self.simulated)))
        uniform = qmc.LatinHypercube(d=len(parameters), rng=np.random.default_rng(seed)).random(count)
        normal = np.asarray(norm.ppf(uniform))
        sizes = np.array([parameter.uncertainty for parameter in parameters])
        changes = np.empty((count, len(self.simulated)))
        for nth, row in enumerate(normal):
            if progress is not None:
                progress(nth, count, "samples of the parameters")
            changes[nth] = self.at(parameters, (row * sizes).tolist()) - self.simulated
        return normal, changes

    def _fast(self, scene: Scene, shift: float) -> Floats:
        """Return the values of a scene by velocity-Verlet at a coarse step, ``(n,)``."""
        resolution = Resolution(dt=STEP_PHASE / self.frequency if self.frequency > 0.0 else None)
        case = Case(scene=scene, backend="verlet", resolution=resolution, sampling=self.sampling, uncertainty=False)
        return self._values(scene, case.solve(), shift=shift)

    def series(self, reading: Reading, shift: float = 0.0) -> Floats:
        """Return the values of the scene as it is for a series in time, ``(n,)``, at times later by ``shift`` (s)."""
        return _interpolated(self.run, reading, *self._weights_at(reading.time + shift, NODES))

    def _values(self, scene: Scene, run: Trajectory, *, nodes: int = NODES, shift: float = 0.0) -> Floats:
        """Return the values of a run at the places and times of the readings, ``(n,)``, at times later by ``shift``."""
        first, weight = self._unshifted[nodes] if shift == 0.0 else self._weights_at(self._times + shift, nodes)
        parts, at = [], 0
        for reading in self.readings:
            rows = slice(at, at := at + len(reading.value))
            if reading.sampled:
                parts.append(_interpolated(run, reading, first[rows], weight[rows]))
                continue
            value = OBSERVABLES[reading.quantity].value(scene, run)[reading.place]
            parts.append(np.full(len(reading.value), value - shift * (reading.quantity == "arrival")))
        for reading, part in zip(self.readings, parts, strict=True):
            if not np.all(np.isfinite(part)):
                raise UsageError(
                    f"{reading.label} is measured, but {self.backend} has no value of it on {scene.name} within"
                    f" {scene.duration:g} s; leave it out, choose a longer duration or another backend"
                )
        return np.concatenate(parts)

    @cached_property
    def _unshifted(self) -> dict[int, tuple[NDArray[np.int64], Floats]]:
        return {nodes: self._weights_at(self._times, nodes) for nodes in (FEWER, NODES)}

    @cached_property
    def _times(self) -> Floats:
        return np.concatenate([reading.time for reading in self.readings])

    def _weights_at(self, time: Floats, nodes: int) -> tuple[NDArray[np.int64], Floats]:
        count = self.sampling.count
        # the scene is at rest, or as it is, before its start and after its end
        place = np.clip(np.nan_to_num(time) / self.scene.duration, 0.0, 1.0) * count
        first = np.clip(np.floor(place).astype(np.int64) - (nodes // 2 - 1), 0, count + 1 - nodes)
        from_first = (place - first)[:, None] - np.arange(nodes)
        weight = np.ones((len(time), nodes))
        for j in range(nodes):
            for i in range(nodes):
                if i != j:
                    weight[:, j] *= from_first[:, i] / (j - i)
        return first, weight


def _interpolated(run: Trajectory, reading: Reading, first: NDArray[np.int64], weight: Floats) -> Floats:
    """Return the values of a run for a series in time, from the samples from ``first`` on and their weights."""
    series = getattr(run, reading.quantity)[:, reading.place]
    return np.asarray(np.sum(weight * series[first[:, None] + np.arange(weight.shape[1])], axis=1))


#: step of numeric derivatives, in declared standard uncertainties
STEP = 0.1
#: largest number of steps of Gauss and Newton, and of halvings of a step
_STEPS, _HALVINGS = 8, 5
#: decrease of the sum that is not looked for: the adjusted parameters are within a tenth of their uncertainty before
#: the last step
_LEAST_DECREASE = 0.01
#: number of points at which the linear model is tested
_POINTS = 8
#: largest mean sum of squares of its errors there, in standard deviations of the sum, sqrt(2 n)
_NONLINEAR = 0.5


@dataclass(frozen=True, kw_only=True, eq=False)
class Adjusted:
    """Parameters that agree best with the measured values and with their declared uncertainties."""

    x: Floats
    """Changes in declared standard uncertainties, ``(n_parameter,)``."""
    values: Floats
    """Simulated values with these changes, ``(n,)``."""
    slopes: Floats
    """Derivatives of the values, by one standard uncertainty of each parameter, ``(n, n_parameter)``; those before the
    last step, which is at most a tenth of the uncertainties that the values leave."""
    residuals: Callable[[Floats], Floats]
    """Terms of the sum at any changes: of the values, then of the declared parameters."""
    jacobian: Floats
    """Derivatives of these terms at ``x``."""
    converged: bool
    """Whether the least sum was found."""

    @property
    def linear(self) -> Floats:
        """Values without changes by the linear model that touches the simulation at ``x``, ``(n,)``."""
        return np.asarray(self.values - self.slopes @ self.x)

    def decides(self) -> bool:
        """Return whether the least sum was found and has the distribution chi-square.

        Where the linear model is right over the uncertainties that the measured values leave, its sum of squares is:
        it is tested at some points that are drawn with the covariance of the adjusted parameters.
        """
        if not (self.converged and len(self.x)):
            return self.converged
        spread = np.linalg.cholesky(np.linalg.inv(self.jacobian.T @ self.jacobian))
        steps = np.random.default_rng(0).standard_normal((_POINTS, len(self.x))) @ spread.T
        least = self.residuals(self.x)
        errors = [self.residuals(self.x + step) - least - self.jacobian @ step for step in steps]
        return bool(np.mean(np.sum(np.square(errors), axis=1)) <= _NONLINEAR * np.sqrt(2.0 * len(self.values)))


def derivatives(prediction: Prediction, parameters: Sequence[Parameter], x: Floats) -> Floats:
    """Return the change of the values by one standard uncertainty of each parameter, ``(n, n_parameter)``."""
    sizes = np.array([parameter.uncertainty for parameter in parameters])
    columns = []
    for step in STEP * np.eye(len(parameters)):
        late, early = (prediction.at(parameters, ((x + side * step) * sizes).tolist()) for side in (1.0, -1.0))
        columns.append((late - early) / (2.0 * STEP))
    return np.stack(columns, axis=1) if columns else np.zeros((len(prediction.simulated), 0))


def adjust(
    prediction: Prediction, parameters: Sequence[Parameter], measured: Floats, sigma: Floats, *, free: int = 0
) -> Adjusted:
    """Adjust parameters to the measured values.

    Parameters
    ----------
    prediction : Prediction
        The scene, its run and the readings.
    parameters : sequence of Parameter
        Uncertain parameters, of the scene and of the measurement.
    measured, sigma : ndarray, shape (n,)
        The measured values, and standard uncertainties of their differences from the simulation with right parameters.
    free : int
        Number of parameters, the first ones, whose declared uncertainty is not used.

    Returns
    -------
    Adjusted
    """
    sizes = np.array([parameter.uncertainty for parameter in parameters])
    weight, declared = 1.0 / np.where(np.isnan(sigma), np.inf, sigma), np.eye(len(parameters))[free:]

    def residuals(x: Floats) -> Floats:
        try:
            values = prediction.at(parameters, (x * sizes).tolist())
        except UsageError:  # no scene has these parameters
            return np.full(len(measured) + len(declared), np.inf)
        return np.concatenate([weight * (values - measured), x[free:]])

    x, converged = np.zeros(len(parameters)), not len(parameters)
    best = residuals(x)
    slopes = derivatives(prediction, parameters, x)
    for _ in range(_STEPS if len(x) else 0):
        jacobian = np.vstack([weight[:, None] * slopes, declared])
        step = -lstsq(jacobian, best, lapack_driver="gelsy")[0]
        converged = bool(best @ best - np.sum((best + jacobian @ step) ** 2) < _LEAST_DECREASE)
        trials = (x + 0.5**halving * step for halving in range(_HALVINGS))
        found = next(((trial, terms) for trial in trials if (terms := residuals(trial)) @ terms < best @ best), None)
        if converged or found is None:
            x, best = found or (x, best)
            break
        try:
            slopes = derivatives(prediction, parameters, found[0])
        except UsageError:  # at the limit of what a scene can have
            break
        x, best = found
    return Adjusted(
        x=x,
        values=prediction.at(parameters, (x * sizes).tolist()),
        slopes=slopes,
        residuals=residuals,
        jacobian=np.vstack([weight[:, None] * slopes, declared]),
        converged=converged,
    )
