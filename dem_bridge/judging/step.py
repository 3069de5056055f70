"""The error of the time step of a code, and the steps that give other errors: by the method that explains its file."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from dem_bridge.judging.decision import Decision
from dem_bridge.judging.fitting import DECISION, MOST_STEPS, Fit, Stepping

#: relative errors between which steps are tried
LARGEST, LEAST = 1e-2, 1e-3
#: steps that are tried, each twice or half of the one before, and the error above which a step resolves nothing
ROUNDS, UNRESOLVED = 12, 0.3


@dataclass(frozen=True, kw_only=True)
class StepError:
    """Errors of the first quantity of a file by its time step, relative to the largest value.

    Parameters
    ----------
    dt : float
        Time step of the file, s.
    stated : bool
        False if the step was found from the errors.
    curve : tuple of (float, float)
        Steps, s, and the errors of the method at these steps, fine to coarse.
    """

    dt: float
    stated: bool
    curve: tuple[tuple[float, float], ...]

    @property
    def error(self) -> float:
        """Error at the time step of the file."""
        return dict(self.curve)[self.dt]

    def largest_for(self, error: float) -> float:
        """Return the largest step, s, for an error: by the power of the step that the two nearest steps show.

        Examples
        --------
        >>> step = StepError(dt=2e-6, stated=True, curve=((1e-6, 1e-3), (2e-6, 4e-3), (4e-6, 1.6e-2)))
        >>> f"{step.largest_for(1e-3):.3g}", f"{step.largest_for(1e-5):.3g}"
        ('1e-06', '1e-07')
        """
        steps, errors = (np.log(np.array(part)) for part in zip(*self.curve, strict=True))
        if len(steps) < 2:
            return math.nan
        place = int(np.clip(np.searchsorted(errors, math.log(error)), 1, len(steps) - 1))
        order = (errors[place] - errors[place - 1]) / (steps[place] - steps[place - 1])
        if not order > 0.0:
            return math.nan
        return math.exp(float(steps[place - 1] + (math.log(error) - errors[place - 1]) / order))


def step_error(decision: Decision, fit: Fit) -> StepError | None:
    """Return the error of the step of a fit that explains a file; None if it was explained without a step."""
    if fit.stepping is None:
        return None
    method, dt = fit.stepping
    data = decision.data
    end = float(data.time[-1])
    # the step explains the errors of the file, which need no run of the method
    errors = {dt: data.largest(decision.exact, [block.values for block in data.blocks])[0] / data.blocks[0].scale}
    for factor in (2.0, 0.5):
        step = dt
        for _ in range(ROUNDS):
            enough = errors[step] > LARGEST if factor > 1.0 else errors[step] < LEAST
            if enough or not errors[step] > 0.0 or end / (factor * step) > MOST_STEPS:
                break
            step = factor * step
            errors[step] = _error(decision, fit, Stepping(method, step))
    known = [(step, error) for step, error in sorted(errors.items()) if 0.0 < error < UNRESOLVED or step == dt]
    return StepError(dt=dt, stated=data.dt is not None, curve=tuple(known))


def _error(decision: Decision, fit: Fit, stepping: Stepping) -> float:
    """Return the largest error of a method at a step, of the first quantity and relative to its scale."""
    data = decision.data
    variant = fit.hypothesis.make(fit.parameters)
    with np.errstate(all="ignore"):
        stepped = data.predict(variant, decision.rows, DECISION, stepping)
    error = data.largest(stepped, decision.exact)[0] / data.blocks[0].scale
    return error if math.isfinite(error) else math.inf
