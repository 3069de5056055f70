"""Adjust uncertain parameters to measured values by least squares.

With errors ``sigma`` of the values and declared standard uncertainties of the parameters, the sum of

    ((S(x) - D) / sigma)^2 over the values and x^2 over the declared parameters, x in their standard uncertainties,

is least at the most probable parameters. For a linear S(x) the least sum is ``E^T V^-1 E`` with the covariance ``V`` of
all errors, and it is distributed as chi-square with as many degrees of freedom as there are values if the model is
right. Where S is not linear over the declared uncertainties it still is linear to a good approximation over the much
smaller uncertainties that the measured values leave, so the least sum keeps this distribution, while a covariance that
was taken at the scene's own parameters, or from samples of them, does not describe the errors.

References
----------
Tarantola, *Inverse Problem Theory*, SIAM 2005, chapter 3.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from dem_bridge.errors import UsageError
from dem_bridge.measurement.parameters import Parameter
from dem_bridge.measurement.prediction import Prediction
from dem_bridge.trajectory import Floats

#: step of numeric derivatives, in declared standard uncertainties
STEP = 0.1
#: first trust region, in declared standard uncertainties
_RADIUS = 10.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Adjusted:
    """Parameters that agree best with the measured values and with their declared uncertainties."""

    x: Floats
    """Changes in declared standard uncertainties, ``(n_parameter,)``."""
    values: Floats
    """Simulated values with these changes, ``(n,)``."""
    slopes: Floats
    """Derivatives of the values there, by one standard uncertainty of each parameter, ``(n, n_parameter)``."""
    residuals: Callable[[Floats], Floats]
    """Terms of the sum at any changes: of the values, then of the declared parameters."""
    jacobian: Floats
    """Derivatives of these terms at ``x``."""

    @property
    def linear(self) -> Floats:
        """Values without changes by the linear model that touches the simulation at ``x``, ``(n,)``."""
        return np.asarray(self.values - self.slopes @ self.x)


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

    Raises
    ------
    UsageError
        If the best changes are at the limit of what a scene can have.
    """
    sizes = np.array([parameter.uncertainty for parameter in parameters])
    weight, declared = 1.0 / np.where(np.isnan(sigma), np.inf, sigma), np.eye(len(parameters))[free:]

    def values(x: Floats) -> Floats:
        return prediction.at(parameters, (x * sizes).tolist())

    def residuals(x: Floats) -> Floats:
        return np.concatenate([weight * (values(x) - measured), x[free:]])

    def within(x: Floats) -> Floats:
        try:
            return residuals(x)
        except UsageError:  # no such scene: the step is made shorter
            return np.full(len(measured) + len(declared), np.inf)

    def jacobian(x: Floats) -> Floats:
        return np.vstack([weight[:, None] * derivatives(prediction, parameters, x), declared])

    x = np.zeros(len(parameters))
    if len(x):
        x = least_squares(within, x, jac=jacobian, x_scale=_RADIUS, xtol=1e-5, ftol=1e-7).x
    slopes = derivatives(prediction, parameters, x)
    terms = np.vstack([weight[:, None] * slopes, declared])
    return Adjusted(x=x, values=values(x), slopes=slopes, residuals=residuals, jacobian=terms)
