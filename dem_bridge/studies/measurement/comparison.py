"""Compare measured values with a scene in the manner of ASME V&V 20: E = S - D beside its validation uncertainty.

``u_val = sqrt(u_num^2 + u_input^2 + u_D^2)``; the error of the model lies within ``E +- k u_val``. Errors of parameters
act on all values at once, so the values are also compared jointly: by ``E^T V^-1 E`` with the covariance ``V`` of all
errors, whose distribution is chi-square if the model is right. ``E`` and ``V`` are those of the linear model that
touches the simulation at the parameters that agree best with the measurement
(:mod:`dem_bridge.studies.measurement.prediction`). No number of samples enters.

References
----------
ASME V&V 20-2009, *Standard for Verification and Validation in Computational Fluid Dynamics and Heat Transfer*.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2, norm

from dem_bridge.runs.campaign import Progress
from dem_bridge.studies.measurement.parameters import Parameter
from dem_bridge.studies.measurement.prediction import Prediction, adjust
from dem_bridge.studies.measurement.readings import Reading
from dem_bridge.trajectory.trajectory import Floats

#: outcome of a comparison of |E| with k u_val
Word = Literal["within", "larger", "undecided"]


class Whitening:
    """Transform errors of covariance ``diag(sigma^2) + factor factor^T`` to independent ones of variance 1.

    >>> errors = np.array([3.0, 3.1])
    >>> alone, common = (Whitening(np.array([1.0, 1.0]), np.array(factor)) for factor in ([[], []], [[3.0], [3.0]]))
    >>> [round(float(np.sum(white(errors) ** 2)), 2) for white in (alone, common)]
    [18.61, 0.98]
    """

    def __init__(self, sigma: Floats, factor: Floats) -> None:
        self.sigma, self._factor = sigma, factor / sigma[:, None]
        squares, vectors = np.linalg.eigh(self._factor.T @ self._factor)
        squares = np.maximum(squares, np.finfo(float).tiny)
        # (1 + s^2)^(-1/2) - 1 along each singular vector, without cancellation; the vector is factor @ vectors / s
        shrink = -1.0 / (np.sqrt(1.0 + squares) * (1.0 + np.sqrt(1.0 + squares)))
        self._inner = vectors * shrink @ vectors.T

    def __call__(self, errors: Floats) -> Floats:
        """Return the transformed errors, ``(n,)`` or ``(n, m)`` as given."""
        scaled = (errors.T / self.sigma).T
        return np.asarray(scaled + self._factor @ (self._inner @ (self._factor.T @ scaled)))


def deviations_of(p: float) -> float:
    """Return the number of standard deviations of a normal number that is exceeded with probability ``p``, at most 40.

    >>> [round(deviations_of(p), 1) for p in (1.0, 0.3173, 0.0455, 0.0)]
    [0.0, 1.0, 2.0, 40.0]
    """
    return float(min(norm.isf(0.5 * p), 40.0)) if p < 1.0 else 0.0


@dataclass(frozen=True, kw_only=True)
class Joint:
    """The joint comparison of several values."""

    statistic: float
    """``E^T V^-1 E``."""
    count: int
    """Degrees of freedom: number of values, less fitted parameters."""

    @property
    def p(self) -> float:
        """Probability of a statistic at least as large if the model is right."""
        return float(chi2.sf(self.statistic, self.count))

    @property
    def deviations(self) -> float:
        """Number of standard deviations of a normal number that is exceeded as rarely, on both sides."""
        return deviations_of(self.p)


def word_of(error: float, limit: float, bar: float) -> Word:
    """Return whether an error is within a limit that is known to within ``bar``."""
    if error + bar <= limit:
        return "within"
    return "larger" if error - bar > limit else "undecided"


@dataclass(frozen=True, kw_only=True, eq=False)
class Comparison:
    """All measured values beside the simulated ones; arrays are ``(n,)``, the readings one after the other."""

    readings: tuple[Reading, ...]
    simulated: Floats
    measured: Floats
    numerical: Floats
    """``u_num``."""
    input: Floats
    """``u_input``: standard deviation over the samples of the parameters."""
    data: Floats
    """``u_D``: of the values themselves, and of gain and time of the measurement."""
    of_samples: Floats
    """Changes by samples of the parameters of the scene, ``(n, n_sample)``: ``input^2`` is the sum of their squares."""
    of_measurement: Floats
    """Changes by one standard uncertainty of each parameter of the measurement, ``(n, n_parameter)``."""
    linear_error: Floats
    """``E`` of the linear model at the adjusted parameters; ``E = S - D`` itself for a linear simulation."""
    slopes: Floats
    """Derivatives of that model by one standard uncertainty of each parameter, ``(n, n_parameter)``."""
    linear: bool
    """Whether that model holds within the uncertainties of the adjusted parameters: joint statistics are chi-square."""
    noise: Floats
    """Standard uncertainties of the values themselves."""
    count: int
    """Number of samples of the parameters."""

    @property
    def error(self) -> Floats:
        """``E = S - D``."""
        return self.simulated - self.measured

    @property
    def validation(self) -> Floats:
        """``u_val``."""
        return np.asarray(np.sqrt(self.numerical**2 + self.input**2 + self.data**2))

    def rows(self, reading: Reading) -> slice:
        """Return the place of a reading in the arrays."""
        sizes = [len(item.value) for item in self.readings]
        nth = self.readings.index(reading)
        return slice(sum(sizes[:nth]), sum(sizes[: nth + 1]))

    def share_within(self, coverage: float, rows: slice = slice(None)) -> float:
        """Return the part of the values with ``|E| <= coverage * u_val``."""
        return float(np.mean(np.abs(self.error[rows]) <= coverage * self.validation[rows]))

    def words(self, coverage: float) -> list[Word]:
        """Return whether each ``|E|`` is within ``coverage * u_val``; undecided if the samples do not show it."""
        limit = coverage * self.validation
        bar = coverage * self.doubt * self.input**2 / self.validation
        values = zip(np.abs(self.error).tolist(), limit.tolist(), bar.tolist(), strict=True)
        return [word_of(*value) for value in values]

    @property
    def doubt(self) -> float:
        """Relative uncertainty of a standard deviation over the samples."""
        return float(1.0 / np.sqrt(2.0 * (self.count - 1)))

    def joint(self, quantity: str | None = None) -> Joint:
        """Return the joint comparison of all values of a quantity, or of all."""
        rows = self.of(quantity)
        sigma = np.hypot(self.noise, self.numerical)[rows]
        whitened = Whitening(sigma, self.slopes[rows])(self.linear_error[rows])
        return Joint(statistic=float(np.sum(whitened**2)), count=int(np.sum(rows)))

    def decides(self, quantity: str, coverage: float) -> bool:
        """Return False if the uncertainties of a quantity are unknown, or as large as the quantity itself."""
        rows = self.of(quantity)
        largest = float(np.max(np.abs(self.simulated[rows])))
        typical = coverage * float(np.median(self.validation[rows]))
        return bool(np.all(np.isfinite(self.error[rows]))) and typical < largest

    def of(self, quantity: str | None) -> NDArray[np.bool_]:
        """Return which values are of a quantity, ``(n,)``; None means all."""
        parts = [np.full(len(item.value), quantity in (None, item.quantity)) for item in self.readings]
        return np.concatenate(parts)


def compare(
    prediction: Prediction,
    parameters: Sequence[Parameter],
    *,
    count: int,
    seed: int,
    progress: Progress | None = None,
) -> Comparison:
    """Compare the readings of a prediction with it.

    Parameters
    ----------
    prediction : Prediction
        The scene, its run and the readings.
    parameters : sequence of Parameter
        The uncertain parameters.
    count, seed : int
        Number and seed of the samples of the parameters, by which ``u_input`` of single values is estimated.
    progress : callable, optional
        Function that is called with (done, total, label).
    """
    readings = prediction.readings
    noise = np.concatenate([reading.uncertainty for reading in readings])
    of_scene = [parameter for parameter in parameters if not parameter.of_measurement]
    _, changes = prediction.samples(of_scene, count=count, seed=seed, progress=progress)
    spread = (changes - np.mean(changes, axis=0)) / np.sqrt(count - 1.0)
    systematic = measurement_effects(prediction, parameters)
    measured = np.concatenate([reading.value for reading in readings])
    adjusted = adjust(prediction, parameters, measured, np.hypot(noise, prediction.numerical))
    return Comparison(
        readings=readings,
        simulated=prediction.simulated,
        measured=measured,
        numerical=prediction.numerical,
        input=np.sqrt(np.sum(spread**2, axis=0)),
        data=np.sqrt(noise**2 + np.sum(systematic**2, axis=1)),
        of_samples=spread.T if of_scene else np.zeros((len(noise), 0)),
        of_measurement=systematic,
        linear_error=adjusted.linear - measured,
        slopes=adjusted.slopes,
        linear=adjusted.decides(),
        noise=noise,
        count=count,
    )


def measurement_effects(prediction: Prediction, parameters: Sequence[Parameter]) -> Floats:
    """Return the effect of one standard uncertainty of each parameter of the measurement, ``(n, n_parameter)``."""
    columns = [
        prediction.at([item], [item.uncertainty]) - prediction.simulated for item in parameters if item.of_measurement
    ]
    return np.stack(columns, axis=1) if columns else np.zeros((len(prediction.simulated), 0))
