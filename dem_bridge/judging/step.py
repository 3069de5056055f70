"""The error of a time step and the largest step for an accuracy, by runs of the method of a code on the scene.

Errors are the largest differences from the exact motion, relative to the largest value; :func:`predict_step_error`
answers for a scene, :func:`step_error` for a file whose method a fit has found.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from dem_bridge.judging import kernels
from dem_bridge.judging.decision import Decision
from dem_bridge.judging.fitting import MOST_STEPS_OF_METHOD, TOLERANCE_OF_DECISION, Fit, Stepping
from dem_bridge.judging.model import Model, resolving_step
from dem_bridge.scene.scene import Scene

Floats = NDArray[np.float64]

#: relative errors for which the largest step is told
ACCURACIES = (1e-2, 1e-3, 1e-4)
#: steps that are tried, each twice or half of the one before, and the error above which a step resolves nothing
MOST_DOUBLINGS_OF_STEP, LEAST_UNRESOLVED_ERROR = 16, 0.3
#: part of a step at which the error was too large that is tried next, and how often
SHARE_OF_COARSE_STEP, MOST_TRIALS_OF_STEP = 0.95, 12


@dataclass(frozen=True, kw_only=True)
class StepError:
    """Errors of the first quantity of a file by its time step, relative to the largest value.

    Parameters
    ----------
    dt : float, optional
        Time step of the file, s; None if it is unknown, so that the curve is that of any step.
    stated : bool
        False if the step was found from the errors.
    curve : tuple of (float, float)
        Steps, s, and the errors of the method at these steps, fine to coarse.
    """

    dt: float | None
    stated: bool
    curve: tuple[tuple[float, float], ...]
    largest: Mapping[float, float] = field(default_factory=dict)
    """Largest step, s, for each of some accuracies: runs with these steps are within them."""

    @property
    def error(self) -> float:
        """Error at the time step of the file; nan if the step is unknown."""
        return dict(self.curve).get(self.dt, math.nan) if self.dt is not None else math.nan

    def largest_for(self, error: float) -> float:
        """Return the largest step, s, for an error; nan if it cannot be told.

        If none was tried, it follows from the power of the step that the errors at the two nearest steps show.

        Examples
        --------
        >>> step = StepError(dt=2e-6, stated=True, curve=((1e-6, 1e-3), (2e-6, 4e-3), (4e-6, 1.6e-2)))
        >>> f"{step.largest_for(1e-3):.3g}", f"{step.largest_for(1e-5):.3g}"
        ('1e-06', '1e-07')
        """
        if error in self.largest:
            return self.largest[error]
        if len(self.curve) < 2:
            return math.nan
        over = next((place for place, (_, size) in enumerate(self.curve) if size > error), len(self.curve))
        steps, errors = (np.log(np.array(part)) for part in zip(*self.curve, strict=True))
        place = int(np.clip(over, 1, len(steps) - 1))
        order = (errors[place] - errors[place - 1]) / (steps[place] - steps[place - 1])
        if not order > 0.0:
            return math.nan
        return math.exp(float(steps[place - 1] + (math.log(error) - errors[place - 1]) / order))

    def as_json(self, accuracies: Iterable[float] = ACCURACIES) -> dict[str, object]:
        """Return step, s, its error and the largest step for each accuracy; None in place of nan.

        Examples
        --------
        >>> step = StepError(dt=2e-6, stated=True, curve=((1e-6, 1e-3), (2e-6, 4e-3)), largest={1e-3: 1e-6})
        >>> step.as_json([1e-3])
        {'dt': 2e-06, 'error': 0.004, 'largest_for': {'1e-3': 1e-06}}
        """
        largest = {accuracy_key(accuracy): _known(self.largest_for(accuracy)) for accuracy in accuracies}
        return {"dt": self.dt, "error": _known(self.error), "largest_for": largest}


def accuracy_key(accuracy: float) -> str:
    """Return an accuracy as the key of an answer.

    Examples
    --------
    >>> accuracy_key(1e-2), accuracy_key(2.5e-05)
    ('1e-2', '2.5e-5')
    """
    digits, power = f"{accuracy:.15e}".split("e")
    return f"{float(digits):g}e{int(power)}"


def _known(value: float) -> float | None:
    """Return a number, or None in place of one that is not finite."""
    return value if math.isfinite(value) else None


def predict_step_error(
    scene: Scene,
    dt: float | None = None,
    *,
    accuracies: Iterable[float] = ACCURACIES,
    times: Floats | None = None,
    method: int = kernels.VERLET,
    quantity: str = "velocity",
    stated: bool = True,
) -> StepError | None:
    """Return the error of velocities that a time step makes in a scene, with the largest steps for some accuracies.

    Each of these steps was tried: a run with it, on the times of the samples, is within its accuracy.

    Parameters
    ----------
    scene : Scene
        Any scene whose contact law is a power of the overlap; None is returned for others.
    dt : float, optional
        Time step, s; None: only the largest steps are of interest.
    accuracies : iterable of float
        Permissible errors relative to the largest velocity.
    times : ndarray, optional
        Times of the samples, s, increasing from 0 on; those of the scene by default.
    method : int
        Method of :mod:`.kernels`, velocity Verlet as in LAMMPS by default: damping forces are those at the velocities
        of half a step before.
    quantity : {"velocity", "displacement", "contact_force"}
        Quantity whose errors are told, relative to its largest value.
    stated : bool
        False if the step was found from errors of a file.

    Examples
    --------
    >>> scene = Scene(name="pair", duration=1e-4, mass=(8e-3, 1e-2), stiffness=(4e9,), velocity=(0.8, 0.0))
    >>> step = predict_step_error(scene, 1e-6)
    >>> f"{step.error:.1e}", f"{step.largest_for(1e-4):.1e} s"
    ('2.0e-04', '7.0e-07 s')
    """
    if scene.law is not None:
        return None
    model = Model(scene)
    times = np.linspace(0.0, scene.duration, scene.samples + 1) if times is None else times
    name = quantity.rsplit("_", maxsplit=1)[-1]
    exact = getattr(model.exact(model.system, times, TOLERANCE_OF_DECISION), name)
    scale, end = float(np.max(np.abs(exact))), float(times[-1])
    if not scale > 0.0:
        return None

    def error_at(step: float) -> float:
        with np.errstate(all="ignore"):
            stepped = getattr(model.stepped_at(model.system, times, step, method), name)
            error = float(np.max(np.abs(stepped - exact))) / scale
        return error if math.isfinite(error) else math.inf

    known = {} if dt is None else {dt: error_at(dt)}
    return _curve(
        error_at,
        known or {resolving_step(model, end, MOST_STEPS_OF_METHOD): math.nan},
        dt,
        accuracies,
        end=end,
        stated=True,
    )


def step_error(decision: Decision, fit: Fit, accuracies: Iterable[float] = ACCURACIES) -> StepError | None:
    """Return the error of the step of a fit that explains a file; None if it was explained without a step."""
    if fit.stepping is None:
        return None
    method, dt = fit.stepping
    data = decision.data
    # the step explains the errors of the file, which need no run of the method
    known = {dt: data.largest(decision.exact, [block.values for block in data.blocks])[0] / data.blocks[0].scale}

    def error_at(step: float) -> float:
        variant = fit.hypothesis.make(fit.parameters)
        with np.errstate(all="ignore"):
            stepped = data.predict(variant, decision.rows, TOLERANCE_OF_DECISION, Stepping(method, step))
        error = data.largest(stepped, decision.exact)[0] / data.blocks[0].scale
        return error if math.isfinite(error) else math.inf

    return _curve(error_at, known, dt, accuracies, end=float(data.time[-1]), stated=data.dt is not None)


def _curve(
    error_at: Callable[[float], float],
    known: Mapping[float, float],
    dt: float | None,
    accuracies: Iterable[float],
    *,
    end: float,
    stated: bool,
) -> StepError:
    """Return the errors of steps around a known one: doubled and halved over all accuracies, and close below each."""
    accuracies = sorted(accuracies)
    errors = {step: error_at(step) if math.isnan(error) else error for step, error in known.items()}
    (start,) = errors
    for factor in (2.0, 0.5) if accuracies else ():
        step = start
        for _ in range(MOST_DOUBLINGS_OF_STEP):
            enough = errors[step] > accuracies[-1] if factor > 1.0 else errors[step] < accuracies[0]
            if enough or not errors[step] > 0.0 or end / (factor * step) > MOST_STEPS_OF_METHOD:
                break
            step *= factor
            errors[step] = error_at(step)
    tried = {accuracy: _approach(error_at, errors, accuracy, end) for accuracy in accuracies}
    return StepError(
        dt=dt,
        stated=stated,
        curve=tuple(pair for pair in sorted(errors.items()) if 0.0 < pair[1] < LEAST_UNRESOLVED_ERROR or pair[0] == dt),
        largest={accuracy: step for accuracy, step in tried.items() if math.isfinite(step)},
    )


def _approach(error_at: Callable[[float], float], errors: dict[float, float], accuracy: float, end: float) -> float:
    """Return a step of two digits close below the one that the errors suggest, with which a run is within an accuracy.

    The errors of the steps that are tried are added; nan: there is none, or a run would be too long.
    """
    curve = tuple(pair for pair in sorted(errors.items()) if 0.0 < pair[1] < LEAST_UNRESOLVED_ERROR)
    step = StepError(dt=None, stated=True, curve=curve).largest_for(accuracy)
    for _ in range(MOST_TRIALS_OF_STEP):
        if not end / MOST_STEPS_OF_METHOD <= step <= end:
            break
        step = _two_digits_below(step)
        errors[step] = error_at(step)
        if errors[step] <= accuracy:
            return step
        step *= SHARE_OF_COARSE_STEP
    return math.nan


def _two_digits_below(step: float) -> float:
    """Return the largest number of two digits that is not above a step.

    >>> _two_digits_below(3.59e-7), _two_digits_below(1e-7)
    (3.5e-07, 1e-07)
    """
    power = math.floor(math.log10(step)) - 1
    return float(f"{math.floor(step * 10.0**-power * (1.0 + 1e-12))}e{power}")
