"""Scalar comparisons: arrival and peak of each measured pulse, and quantities that were measured as scalars."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from dem_bridge.studies.measurement.comparison import Comparison, Joint, Word, word_of
from dem_bridge.studies.measurement.prediction import Prediction
from dem_bridge.studies.measurement.readings import QUANTITIES, Reading
from dem_bridge.trajectory.trajectory import Floats

#: least peak, in standard uncertainties of the values, of a pulse whose arrival and peak are read off
LEAST_PEAK = 3.0
#: least duration of a pulse, in parts of it, by which its slope in time is taken
_STEP = 1e-3


@dataclass(frozen=True, kw_only=True, eq=False)
class Scalar:
    """A scalar of one reading: simulated and measured value, with the parts of the validation uncertainty, in SI."""

    name: str
    reading: Reading
    unit: str
    simulated: float
    measured: float
    numerical: float
    """``u_num``."""
    input: float
    """``u_input``."""
    data: float
    """``u_D``."""
    doubt: float
    """Relative uncertainty of ``input``, which comes from a finite number of samples."""
    weights: Floats = field(default_factory=lambda: np.zeros(0))
    """Change of the scalar with each value of the reading, ``(n,)``; empty for a value itself."""

    @property
    def error(self) -> float:
        """``E = S - D``."""
        return self.simulated - self.measured

    @property
    def validation(self) -> float:
        """``u_val``."""
        return float(np.sqrt(self.numerical**2 + self.input**2 + self.data**2))

    def word(self, coverage: float) -> Word:
        """Return whether ``|E|`` is within ``coverage * u_val``; undecided if the samples do not show it."""
        bar = coverage * self.doubt * self.input**2 / self.validation
        return word_of(abs(self.error), coverage * self.validation, bar)


def scalars_of(prediction: Prediction, comparison: Comparison) -> list[Scalar]:
    """Return arrival and peak of each measured pulse of velocity or force, and the scalars that were measured.

    The simulated pulse, multiplied by a factor and shifted in time, is fitted to the measured one. The difference of
    the arrivals is the shift, and the measured peak is the factor times the simulated one, so that noise does not bias
    either. Pulses below the noise are left out.
    """
    scalars: list[Scalar] = []
    for reading in comparison.readings:
        scalars += _pulse(prediction, comparison, reading) if reading.sampled else _direct(comparison, reading)
    return scalars


def _direct(comparison: Comparison, reading: Reading) -> list[Scalar]:
    rows = comparison.rows(reading)
    parts = {name: getattr(comparison, name)[rows].tolist() for name in _PARTS}
    shared: dict[str, Any] = {
        "name": reading.quantity.replace("_", " "),
        "reading": reading,
        "unit": QUANTITIES[reading.quantity].unit,
    }
    return [
        Scalar(**shared, **dict(zip(parts, values, strict=True)), doubt=comparison.doubt)
        for values in zip(*parts.values(), strict=True)
    ]


_PARTS = ("simulated", "measured", "numerical", "input", "data")


def _pulse(prediction: Prediction, comparison: Comparison, reading: Reading) -> list[Scalar]:
    """Return arrival and peak of a series; nothing for displacements, and for a pulse that is not seen."""
    rows = comparison.rows(reading)
    noise, simulated = comparison.noise[rows], comparison.simulated[rows]
    top = int(np.argmax(np.abs(simulated)))
    peak = float(abs(simulated[top]))
    if reading.quantity == "displacement" or len(noise) < 4 or not peak > LEAST_PEAK * float(np.median(noise)):
        return []
    pace = peak / max(float(np.max(np.abs(prediction.slope[rows]))), 1e-300)

    def misfit(x: Floats) -> Floats:
        return np.asarray((x[0] * prediction.series(reading, -x[1] * pace) - reading.value) / noise)

    def slopes(x: Floats) -> Floats:
        early, middle, late = (prediction.series(reading, (step - x[1]) * pace) for step in (-_STEP, 0.0, _STEP))
        return np.asarray(np.stack([middle, -x[0] * (late - early) / (2.0 * _STEP)], axis=1) / noise[:, None])

    fitted = least_squares(misfit, np.array([1.0, 0.0]), jac=slopes)
    columns = slopes(fitted.x)
    if not fitted.success or np.linalg.matrix_rank(columns / np.linalg.norm(columns, axis=0), tol=1e-3) < 2:
        return []
    # factor and shift are linear functionals of the values, and so are their errors
    functional = np.linalg.pinv(columns) / noise * np.array([[peak], [pace]])
    inputs, systematic = (functional @ part[rows] for part in (comparison.of_samples, comparison.of_measurement))
    finite = bool(np.all(np.isfinite(comparison.numerical[rows])))
    numerical = np.abs(functional) @ comparison.numerical[rows] if finite else np.full(2, np.inf)
    of_input = np.sqrt(np.sum(inputs**2, axis=1))
    of_data = np.sqrt(np.sum((functional * noise) ** 2, axis=1) + np.sum(systematic**2, axis=1))
    time = float(reading.time[top])
    what = reading.quantity.replace("contact_", "")
    values = (
        (f"peak {what}", QUANTITIES[reading.quantity].unit, peak, peak * float(fitted.x[0])),
        (f"time of the peak {what}", "s", time, time + pace * float(fitted.x[1])),
    )
    return [
        Scalar(
            name=name,
            reading=reading,
            unit=unit,
            simulated=ours,
            measured=theirs,
            numerical=float(numerical[k]),
            input=float(of_input[k]),
            data=float(of_data[k]),
            doubt=comparison.doubt,
            weights=functional[k],
        )
        for k, (name, unit, ours, theirs) in enumerate(values)
    ]


def joint_of(scalars: Iterable[Scalar], comparison: Comparison) -> Joint | None:
    """Return the joint comparison of the arrivals and peaks of pulses; None without any.

    They are few, so this statistic shows a small common shift of all pulses that is lost among thousands of values.
    """
    pulses = [item for item in scalars if len(item.weights) and np.isfinite(item.numerical)]
    if not pulses:
        return None
    rows = [comparison.rows(item.reading) for item in pulses]
    factor = np.stack([item.weights @ comparison.slopes[row] for item, row in zip(pulses, rows, strict=True)])
    errors = np.array([item.weights @ comparison.linear_error[row] for item, row in zip(pulses, rows, strict=True)])
    covariance = factor @ factor.T + np.diag([item.numerical**2 for item in pulses])
    for i, item in enumerate(pulses):
        for j, other in enumerate(pulses):
            if item.reading is other.reading:
                covariance[i, j] += np.sum(item.weights * other.weights * comparison.noise[rows[i]] ** 2)
    scale = np.sqrt(np.diag(covariance))
    scaled = errors / scale
    statistic = scaled @ np.linalg.solve(covariance / np.outer(scale, scale), scaled)
    return Joint(statistic=float(statistic), count=len(pulses))
