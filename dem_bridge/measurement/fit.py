"""Fit named parameters of a scene to measured values, with 95 % intervals by the likelihood.

The likelihood has the standard uncertainties of the values and, to first order, those of all declared parameters that
are not fitted. The declared uncertainty of a fitted parameter is not used: the fit is what the measurement says alone.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq, least_squares
from scipy.stats import chi2, norm

from dem_bridge.errors import UsageError
from dem_bridge.measurement.comparison import Joint, Whitening
from dem_bridge.measurement.parameters import Parameter
from dem_bridge.measurement.prediction import Prediction
from dem_bridge.trajectory import Floats

#: confidence level of the intervals
LEVEL = 0.95
#: step of numeric derivatives, in declared standard uncertainties
STEP = 0.1
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
    sizes = np.array([parameter.uncertainty for parameter in parameters])
    sigma = np.hypot(noise, prediction.numerical)
    factor = _derivatives(prediction, others, np.zeros(len(others)))
    white = Whitening(sigma, factor)

    def misfit(x: Floats) -> Floats:
        return white(prediction.at(parameters, (x * sizes).tolist()) - measured)

    def slopes(x: Floats) -> Floats:
        return white(_derivatives(prediction, parameters, x))

    start = slopes(np.zeros(len(parameters)))
    names = _undetermined(start, parameters)
    result = None
    if not names:
        # far off, the best values may be none that a scene can have
        with suppress(UsageError):
            result = least_squares(misfit, np.zeros(len(parameters)), jac=slopes, x_scale="jac", xtol=1e-6, ftol=1e-10)
            names = _undetermined(result.jac, parameters)
    if result is None or names:
        joint = Joint(statistic=float(np.sum(misfit(np.zeros(len(parameters))) ** 2)), count=len(noise))
        names = names or tuple(parameter.name for parameter in parameters)
        return Fit(fitted=(), joint=joint, correlation=1.0, values=prediction.simulated, undetermined=names)
    covariance = np.linalg.inv(result.jac.T @ result.jac)
    errors = np.sqrt(np.diag(covariance))
    least = float(np.sum(result.fun**2))
    fitted = []
    for k, parameter in enumerate(parameters):
        # the direction along which the other parameters stay at their best, to first order
        direction = covariance[:, k] / errors[k]
        ends = [_end(misfit, result.x, side * direction, least) for side in (-1.0, 1.0)]
        low, high = (sizes[k] * (result.x[k] + end * errors[k]) for end in (-ends[0], ends[1]))
        change, uncertainty = float(sizes[k] * result.x[k]), float(sizes[k] * errors[k])
        fitted.append(
            Fitted(parameter=parameter, change=change, uncertainty=uncertainty, low=float(low), high=float(high))
        )
    correlation = np.abs(covariance / np.outer(errors, errors) - np.eye(len(errors)))
    return Fit(
        fitted=tuple(fitted),
        joint=Joint(statistic=least, count=max(1, len(noise) - len(parameters))),
        correlation=float(np.max(correlation)),
        values=prediction.at(parameters, (result.x * sizes).tolist()),
        # in declared uncertainties, whose own covariance is 1
        declared=Joint(
            statistic=float(result.x @ np.linalg.solve(covariance + np.eye(len(sizes)), result.x)), count=len(sizes)
        ),
    )


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


def _derivatives(prediction: Prediction, parameters: Sequence[Parameter], x: Floats) -> Floats:
    """Return the change of the values by one standard uncertainty of each parameter, ``(n, n_parameter)``."""
    sizes = np.array([parameter.uncertainty for parameter in parameters])
    columns = []
    for k in range(len(parameters)):
        step = STEP * np.eye(len(parameters))[k]
        late, early = (prediction.at(parameters, ((x + side * step) * sizes).tolist()) for side in (1.0, -1.0))
        columns.append((late - early) / (2.0 * STEP))
    return np.stack(columns, axis=1) if columns else np.zeros((len(prediction.simulated), 0))


def _undetermined(slopes: Floats, parameters: Sequence[Parameter]) -> tuple[str, ...]:
    """Return the names of parameters that values with these derivatives do not determine together; empty if they do."""
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
