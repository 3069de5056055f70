"""The largest time step for an accuracy, by the errors of runs at several steps.

There is one rule for verifications, judgements and checks. A step is *measured* if a run with it was computed and is
within the accuracy. Else it is interpolated between two steps that were computed, or follows from the order of the
error beyond them, and the computed steps beside it are said with it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import groupby

import numpy as np

#: relative errors for which the largest step is told
ACCURACIES = (1e-2, 1e-3, 1e-4)
#: steps that are tried, each twice or half of the one before, and the error above which a step resolves nothing
MOST_DOUBLINGS_OF_STEP, LEAST_UNRESOLVED_ERROR = 16, 0.3
#: part of a step at which the error was too large that is tried next, and how often
SHARE_OF_COARSE_STEP, MOST_TRIALS_OF_STEP = 0.95, 12
#: largest factor by which a step may differ from all that were computed if no run confirms it
LARGEST_FACTOR_WITHOUT_RUN = 64.0
#: relative difference of two steps that are one
_ROUNDOFF_OF_STEPS = 1e-9


@dataclass(frozen=True, kw_only=True)
class LargestStep:
    """The largest time step for an accuracy, with the computed steps beside it."""

    dt: float
    """Step, s."""
    measured: bool = True
    """True if a run with this step was computed and is within the accuracy."""
    finer: float = math.nan
    """Nearest finer step, s, that was computed; nan: none is finer."""
    coarser: float = math.nan
    """Nearest coarser step, s, that was computed; nan: none is coarser."""

    def source(self, words: Callable[[float], str]) -> str:
        """Return in words what the step rests on; ``words`` returns a step (s) with its unit.

        Examples
        --------
        >>> LargestStep(dt=3e-7, measured=False, finer=2e-7, coarser=4e-7).source("{:g} s".format)
        'between 2e-07 s and 4e-07 s, which were run'
        >>> LargestStep(dt=3e-7).source("{:g} s".format)
        'measured'
        """
        if self.measured:
            return "measured"
        if math.isnan(self.coarser):
            return f"above {words(self.finer)}, the coarsest that was run"
        if math.isnan(self.finer):
            return f"below {words(self.coarser)}, the finest that was run"
        return f"between {words(self.finer)} and {words(self.coarser)}, which were run"


def with_sources(steps: Sequence[tuple[str, LargestStep]], words: Callable[[float], str]) -> str:
    """Return phrases on steps in a row, each with what it rests on, or once behind the last of those that share it.

    Examples
    --------
    >>> with_sources([("2e-7 s gives 1 %", LargestStep(dt=2e-7)), ("1e-7 s gives 0.1 %", LargestStep(dt=1e-7))], str)
    '2e-7 s gives 1 %, 1e-7 s gives 0.1 % (measured)'
    """
    groups = groupby(steps, key=lambda item: item[1].source(words))
    return ", ".join(f"{', '.join(text for text, _ in group)} ({source})" for source, group in groups)


@dataclass(frozen=True, kw_only=True)
class StepError:
    """Errors of one quantity by the time step, relative to its largest value.

    Parameters
    ----------
    dt : float, optional
        Time step of a file or a script, s; None if it is unknown, so that the curve is that of any step.
    stated : bool
        False if the step was found from the errors.
    curve : tuple of (float, float)
        Steps, s, and the errors of runs with these steps, fine to coarse.
    largest : mapping
        Steps, s, that were tried for some accuracies and are within them.
    """

    dt: float | None = None
    stated: bool = True
    curve: tuple[tuple[float, float], ...]
    largest: Mapping[float, float] = field(default_factory=dict)

    @property
    def error(self) -> float:
        """Error at the time step of the file; nan if the step is unknown."""
        return dict(self.curve).get(self.dt, math.nan) if self.dt is not None else math.nan

    def largest_step(
        self, accuracy: float, *, order: float | None = None, most: float = math.inf
    ) -> LargestStep | None:
        """Return the largest step whose error, and that of all finer computed ones, is within an accuracy.

        Parameters
        ----------
        accuracy : float
            Permissible error relative to the largest value.
        order : float, optional
            Order of the error in the step, by which it is continued beyond the computed steps. None: that of the two
            nearest steps.
        most : float
            Longest step, s, that is possible, such as that of stability.

        Returns
        -------
        LargestStep or None
            None if it cannot be told: too few steps were computed, or all are too far from it. A step that was not
            tried is rounded down to two digits.

        Examples
        --------
        >>> errors = StepError(curve=((1e-6, 1e-3), (2e-6, 4e-3), (4e-6, 1.6e-2)))
        >>> errors.largest_step(1e-3)
        LargestStep(dt=1e-06, measured=True, finer=nan, coarser=nan)
        >>> errors.largest_step(2e-3).source("{:g} s".format)
        'between 1e-06 s and 2e-06 s, which were run'
        >>> errors.largest_step(1e-4).source("{:g} s".format)
        'below 1e-06 s, the finest that was run'
        """
        tried = self.largest.get(accuracy)
        if tried is not None and tried <= most:
            return LargestStep(dt=tried)
        dt = tried if tried is not None else self._interpolated(accuracy, order)
        if math.isnan(dt):
            return None
        dt = most if dt > most else dt if tried is not None else two_digits_below(dt)
        known = self.curve if tried is None else (*self.curve, (tried, accuracy))
        same = [error for step, error in known if math.isclose(step, dt, rel_tol=_ROUNDOFF_OF_STEPS)]
        if same and max(same) <= accuracy:
            return LargestStep(dt=dt)
        steps = [step for step, _ in known]
        finer = max((step for step in steps if step <= dt), default=math.nan)
        coarser = min((step for step in steps if step > dt), default=math.nan)
        return LargestStep(dt=dt, measured=False, finer=finer, coarser=coarser)

    def _interpolated(self, accuracy: float, order: float | None = None) -> float:
        """Return the step, s, at which errors pass an accuracy, from the finest step on; nan if it cannot be told."""
        curve = [pair for pair in sorted(self.curve) if 0.0 < pair[1] < math.inf]
        over = next((place for place, (_, size) in enumerate(curve) if size > accuracy), len(curve))
        inside = 0 < over < len(curve)
        if not curve or (len(curve) < 2 and order is None):
            return math.nan
        if inside or order is None:
            steps, errors = (np.log(np.array(part)) for part in zip(*curve, strict=True))
            place = min(max(over, 1), len(curve) - 1)
            order = float((errors[place] - errors[place - 1]) / (steps[place] - steps[place - 1]))
        if not order > 0.0:
            return math.nan
        dt, error = curve[max(over - 1, 0)]
        factor = (accuracy / error) ** (1.0 / order)
        return dt * factor if 1.0 / LARGEST_FACTOR_WITHOUT_RUN <= factor <= LARGEST_FACTOR_WITHOUT_RUN else math.nan

    def largest_for(self, accuracy: float) -> float:
        """Return the largest step, s, for an accuracy; nan if it cannot be told."""
        step = self.largest_step(accuracy)
        return math.nan if step is None else step.dt

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


def two_digits_below(step: float) -> float:
    """Return the largest number of two digits that is not above a step.

    >>> two_digits_below(3.59e-7), two_digits_below(1e-7)
    (3.5e-07, 1e-07)
    """
    power = math.floor(math.log10(step) + 1e-12) - 1
    return float(f"{math.floor(step * 10.0**-power * (1.0 + 1e-9))}e{power}")


def measure_steps(
    error_at: Callable[[float], float],
    known: Mapping[float, float],
    accuracies: Iterable[float],
    *,
    shortest: float,
    longest: float,
    dt: float | None = None,
    stated: bool = True,
) -> StepError:
    """Return the errors of runs at steps around a known one: doubled and halved, and close below each accuracy.

    Parameters
    ----------
    error_at : callable
        Runs with a step (s) and returns its error, relative to the largest value.
    known : mapping
        One step, s, with its error, or nan where it is not computed yet.
    accuracies : iterable of float
        Permissible errors, for each of which a step of two digits is tried.
    shortest, longest : float
        Bounds of the steps, s, for which a run is short enough and has a step at all.
    dt, stated
        As in :class:`StepError`.

    Examples
    --------
    >>> errors = measure_steps(lambda dt: (dt / 1e-5) ** 2, {2e-6: math.nan}, [1e-3], shortest=1e-9, longest=1e-4)
    >>> errors.largest_step(1e-3)
    LargestStep(dt=3.1e-07, measured=True, finer=nan, coarser=nan)
    """
    accuracies = sorted(accuracies)
    errors = {step: error_at(step) if math.isnan(error) else error for step, error in known.items()}
    (start,) = errors
    for factor in (2.0, 0.5) if accuracies else ():
        step = start
        for _ in range(MOST_DOUBLINGS_OF_STEP):
            enough = errors[step] > accuracies[-1] if factor > 1.0 else errors[step] < accuracies[0]
            if enough or not errors[step] > 0.0 or factor * step < shortest:
                break
            step *= factor
            errors[step] = error_at(step)
    tried = {accuracy: _approach(error_at, errors, accuracy, shortest, longest) for accuracy in accuracies}
    return StepError(
        dt=dt,
        stated=stated,
        curve=tuple(pair for pair in sorted(errors.items()) if 0.0 < pair[1] < LEAST_UNRESOLVED_ERROR or pair[0] == dt),
        largest={accuracy: step for accuracy, step in tried.items() if math.isfinite(step)},
    )


def _approach(
    error_at: Callable[[float], float], errors: dict[float, float], accuracy: float, shortest: float, longest: float
) -> float:
    """Return a step of two digits close below the one that the errors suggest, with which a run is within an accuracy.

    The errors of the steps that are tried are added; nan: there is none, or a run would be too long.
    """
    curve = tuple(pair for pair in sorted(errors.items()) if 0.0 < pair[1] < LEAST_UNRESOLVED_ERROR)
    step = StepError(curve=curve).largest_for(accuracy)
    for _ in range(MOST_TRIALS_OF_STEP):
        if not shortest <= step <= longest:
            break
        step = two_digits_below(step)
        errors[step] = error_at(step)
        if errors[step] <= accuracy:
            return step
        step *= SHARE_OF_COARSE_STEP
    return math.nan
