"""Adjust uncertain parameters to measured values by least squares.

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
from dataclasses import dataclass

import numpy as np
from scipy.linalg import lstsq

from dem_bridge.errors import UsageError
from dem_bridge.studies.measurement.parameters import Parameter
from dem_bridge.studies.measurement.prediction import Prediction
from dem_bridge.trajectory.trajectory import Floats

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
