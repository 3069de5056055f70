"""Fit named parameters of a scene to measured values, with 95 % intervals by the likelihood.

The likelihood has the standard uncertainties of the values and those of all declared parameters that are not fitted:
these are adjusted together with the fitted ones. The declared uncertainty of a fitted parameter is not used: the fit is
what the measurement says alone.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq
from scipy.stats import chi2, norm

from dem_bridge.errors import UsageError
from dem_bridge.studies.measurement.comparison import Joint, Whitening
from dem_bridge.studies.measurement.parameters import Parameter
from dem_bridge.studies.measurement.prediction import Prediction, adjust, derivatives
from dem_bridge.trajectory.trajectory import Floats

#: confidence level of the intervals
LEVEL = 0.95
#: least singular value of the scaled derivatives, relative to the largest, at which the values determine all parameters
LEAST_RANK = 1e-3


@dataclass(frozen=True, kw_only=True)
class Fitted:
    """A fitted parameter: its change from the scene's value, with its interval."""

    parameter: Parameter
    change: float
    uncertainty: float
    """Standard uncertainty to first order."""
    low: float
    high: float


@dataclass(frozen=True, kw_only=True)
class Fit:
    """Result of a fit."""

    fitted: tuple[Fitted, ...]
    joint: Joint
    """The joint comparison with the fitted parameters; the intervals hold if it does not exclude the model."""
    correlation: float
    """Largest correlation of two fitted parameters; 0 for one."""
    values: Floats
    """Values with the fitted parameters, ``(n,)``."""
    declared: Joint | None = None
    """The joint comparison of the fitted changes with the declared uncertainties of the parameters."""
    undetermined: tuple[str, ...] = ()
    """Parameters that the values do not determine, or not apart from each other; nothing is fitted then."""


def fit_parameters(
    prediction: Prediction,
    parameters: Sequence[Parameter],
    others: Sequence[Parameter],
    measured: Floats,
    noise: Floats,
) -> Fit:
    """Fit some parameters to the measured values.

    Parameters
    ----------
    prediction : Prediction
        The scene, its run and the readings.
    parameters : sequence of Parameter
        The parameters to fit.
    others : sequence of Parameter
        Further uncertain parameters, whose effects count as errors of the values.
    measured, noise : ndarray, shape (n,)
        The measured values and their standard uncertainties.

    Returns
    -------
    Fit
    """
    sizes, count = np.array([parameter.uncertainty for parameter in parameters]), len(parameters)
    everything = [*parameters, *others]
    sigma = np.hypot(noise, prediction.numerical)
    names = _undetermined(derivatives(prediction, everything, np.zeros(len(everything))), sigma, parameters)
    if names:
        return _nothing(prediction, others, measured, sigma, names)
    adjusted = adjust(prediction, everything, measured, sigma, free=count)
    names = _undetermined(adjusted.slopes, sigma, parameters)
    if names or not adjusted.converged:  # far off, the best values may be none that a scene can have
        names = names or tuple(parameter.name for parameter in parameters)
        return _nothing(prediction, others, measured, sigma, names)
    every = np.linalg.inv(adjusted.jacobian.T @ adjusted.jacobian).astype(float)
    least = float(np.sum(adjusted.residuals(adjusted.x) ** 2))
    fitted = []
    for k, parameter in enumerate(parameters):
        error = float(np.sqrt(every[k, k]))
        # the direction along which the other parameters stay at their best, to first order
        steps = [np.asarray(side * every[:, k] / error, dtype=np.float64) for side in (-1.0, 1.0)]
        ends = [_end(adjusted.residuals, adjusted.x, step, least) for step in steps]
        low, high = (float(sizes[k] * (adjusted.x[k] + end * error)) for end in (-ends[0], ends[1]))
        change, uncertainty = float(sizes[k] * adjusted.x[k]), float(sizes[k] * error)
        fitted.append(Fitted(parameter=parameter, change=change, uncertainty=uncertainty, low=low, high=high))
    x, covariance = adjusted.x[:count], every[:count, :count]
    errors = np.sqrt(np.diag(covariance))
    return Fit(
        fitted=tuple(fitted),
        joint=Joint(statistic=least, count=max(1, len(noise) - count)),
        correlation=float(np.max(np.abs(covariance / np.outer(errors, errors) - np.eye(count)))),
        values=prediction.at(parameters, (x * sizes).tolist()),
        # in declared uncertainties, whose own covariance is 1
        declared=Joint(statistic=float(x @ np.linalg.solve(covariance + np.eye(count), x)), count=count),
    )


def _nothing(
    prediction: Prediction, others: Sequence[Parameter], measured: Floats, sigma: Floats, names: tuple[str, ...]
) -> Fit:
    """Return a fit without fitted parameters, because the values do not determine some."""
    errors = prediction.simulated - measured
    white = Whitening(sigma, derivatives(prediction, others, np.zeros(len(others))))
    joint = Joint(statistic=float(np.sum(white(errors) ** 2)), count=len(errors))
    return Fit(fitted=(), joint=joint, correlation=1.0, values=prediction.simulated, undetermined=names)


def chosen(parameters: Sequence[Parameter], names: Sequence[str] | None) -> tuple[list[Parameter], list[Parameter]]:
    """Return the parameters to fit and the others; ``names`` None means all that belong to the whole scene.

    Raises
    ------
    UsageError
        If a name is not that of a declared parameter.
    """
    if names is None:
        names = [parameter.name for parameter in parameters if parameter.place is None]
    declared = [parameter.name for parameter in parameters]
    if unknown := [name for name in names if name not in declared]:
        raise UsageError(
            f"fit = {unknown[0]!r} is not declared; allowed: {', '.join(declared[:10]) or 'none'}; add it to"
            " [measurement.parameters] with its standard uncertainty"
        )
    return (
        [parameter for parameter in parameters if parameter.name in names],
        [parameter for parameter in parameters if parameter.name not in names],
    )


def _undetermined(slopes: Floats, sigma: Floats, parameters: Sequence[Parameter]) -> tuple[str, ...]:
    """Return the names of parameters that values do not determine together; empty if they do.

    ``slopes`` are derivatives by these parameters, then by the others, whose effects are errors of the values.
    """
    slopes = Whitening(sigma, slopes[:, len(parameters) :])(slopes[:, : len(parameters)])
    lengths = np.linalg.norm(slopes, axis=0)
    if not np.all(lengths > 0.0):
        return tuple(item.name for item, length in zip(parameters, lengths, strict=True) if not length > 0.0)
    _, sizes, directions = np.linalg.svd(slopes / lengths, full_matrices=False)
    if sizes[-1] > LEAST_RANK * sizes[0]:
        return ()
    return tuple(item.name for item, part in zip(parameters, directions[-1], strict=True) if abs(part) > 0.1)


def _end(misfit: Callable[[Floats], Floats], best: Floats, direction: Floats, least: float) -> float:
    """Return how far along a direction the statistic exceeds its least value by the quantile of chi-square."""
    level = float(chi2.ppf(LEVEL, 1))

    def excess(length: float) -> float:
        return float(np.sum(misfit(best + length * direction) ** 2)) - least - level

    normal = float(norm.ppf(0.5 + 0.5 * LEVEL))
    try:
        return float(brentq(excess, 0.3 * normal, 3.0 * normal, xtol=0.01))
    except (ValueError, UsageError):  # far from normal, or at the limit of what the scene allows
        return normal
