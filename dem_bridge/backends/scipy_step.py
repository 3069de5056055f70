"""Compiled steps of the ``scipy`` backend: DOP853 with scipy's table, rules of step control and dense output.

One step of scipy takes some 13 calls of Python and numpy a trial, far more than the forces of a chain. Here all trials
of a step are one call of a kernel. Where forces are functions of Python, scipy's own step is taken.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.integrate import DOP853

from dem_bridge.backends.scipy_kernels import Floats, Table, component, derivative, wave_at
from dem_bridge.foundation.compiled import Ints, kernel

#: least and largest factor by which a step changes, and the part of the predicted one that is taken, as in scipy
LEAST, MOST, SAFETY = 0.2, 10.0, 0.9


def missed_impulse(power: Floats) -> Floats:
    """Return what a step of DOP853 misses of the integral of ``t^power`` from 0 to 1; last digits where it is whole.

    >>> missed_impulse(np.array([1.5])).round(6).tolist()
    [0.000106]
    """
    stages = DOP853.C[: len(DOP853.B)] ** power[:, None] @ DOP853.B
    return np.asarray(np.maximum(np.abs(stages - 1.0 / (power + 1.0)), np.finfo(float).eps))


class CompiledDop853(DOP853):  # type: ignore[misc]  # scipy has no types
    """DOP853 whose steps, all trials of each, and dense output are computed by :func:`take_step` and :func:`extend`.

    ``system``: state of the contacts, contacts, bodies, drag and drive, as the kernels take them.
    """

    t: float
    y: Floats
    f: Floats
    h_abs: float
    nfev: int

    def __init__(self, system: tuple[Ints, Table, Table, float, Table], *arguments: Any, **named: Any) -> None:
        super().__init__(*arguments, **named)
        self.system = system

    def _step_impl(self) -> tuple[bool, str | None]:
        new = np.empty_like(self.y)
        control = (float(self.t), float(self.h_abs), float(self.t_bound), float(self.rtol), self.error_exponent)
        after, size, trials = take_step.compiled(
            control, self.y, self.f, self.atol, (self.A, self.B, self.C, self.E5, self.E3), self.K, new, *self.system
        )
        self.nfev += trials * self.n_stages
        if not after > self.t:
            return False, self.TOO_SMALL_STEP
        self.h_previous, self.y_old = after - self.t, self.y
        self.t, self.y, self.h_abs, self.f = after, new, size, self.K[self.n_stages].copy()
        return True, None

    def _dense_output_impl(self) -> CompiledDense:
        terms, more = np.empty((len(self.D) + 3, self.n)), (self.A_EXTRA, self.C_EXTRA, self.D)
        step = float(self.t_old), float(self.h_previous)
        extend.compiled(step, self.y_old, self.y, more, self.K_extended, terms, *self.system)
        self.nfev += len(self.A_EXTRA)
        return CompiledDense(self.t_old, self.t, self.y_old, terms)


class CompiledDense:
    """Dense output of DOP853 with scipy's polynomials, ``F (7, n)``; see Hairer, Nørsett and Wanner (1993), II.6."""

    def __init__(self, t_old: float, t: float, y_old: Floats, terms: Floats) -> None:
        self.t_old, self.h, self.y_old, self.F = t_old, t - t_old, y_old, terms

    def __call__(self, t: float | Floats) -> Floats:
        """Return the state ``(n,)`` at a time (s), or the states ``(n, n_t)`` at times ``(n_t,)``."""
        part = np.atleast_1d((np.asarray(t) - self.t_old) / self.h)
        rows = np.empty((len(part), len(self.y_old)))
        interpolate.compiled(part, self.F, self.y_old, rows)
        return rows.T if np.ndim(t) else rows[0]


@kernel(nogil=False)
def take_step(
    control: tuple[float, float, float, float, float], y: Floats, f: Floats, atol: Floats,
    table: tuple[Floats, Floats, Floats, Floats, Floats], stages: Floats, new: Floats, state: Ints, contacts: Table,
    bodies: Table, drag: float, wave: Table,
) -> tuple[float, float, int]:  # fmt: skip
    """Take one step, write the state after it into ``new``, and return its time, the next size (s) and the trials.

    The time is that before the step where its size would be too small. ``control``: time, size, end, relative
    tolerance and exponent of the error; ``table``: coefficients of scipy; ``stages (n_stages + 1, n)``: room.
    """
    t, size, end, rtol, exponent = control
    a, b, c, fifth, third = table
    count, n, elastic, trial = len(b), len(y), np.empty(0), np.empty_like(y)
    smallest = 10.0 * (np.nextafter(t, np.inf) - t)
    size, rejected, trials = max(size, smallest), False, 0
    while size >= smallest:
        after = min(t + size, end)
        size = after - t
        stages[0] = f
        for s in range(1, count + 1):
            weights = a[s] if s < count else b
            trial[:] = 0.0
            for q in range(s):
                if weights[q] != 0.0:
                    for i in range(n):
                        trial[i] += weights[q] * stages[q, i]
            for i in range(n):
                trial[i] = y[i] + size * trial[i]
            push = wave_at(wave[0], t + c[s] * size if s < count else after)
            derivative(trial, state, elastic, contacts, bodies, drag, push, stages[s])
        new[:] = trial
        trials += 1
        of_fifth, of_third = 0.0, 0.0
        for i in range(n):
            scale, five, three = atol[i] + max(abs(y[i]), abs(new[i])) * rtol, 0.0, 0.0
            for q in range(count + 1):
                five += fifth[q] * stages[q, i]
                three += third[q] * stages[q, i]
            of_fifth += (five / scale) ** 2
            of_third += (three / scale) ** 2
        error = 0.0
        if not (of_fifth == 0.0 and of_third == 0.0):  # nan after a trial far too long, which is refused
            error = size * of_fifth / np.sqrt((of_fifth + 0.01 * of_third) * n)
        if error < 1.0:
            factor = MOST if error == 0.0 else min(MOST, SAFETY * error**exponent)
            return after, size * (min(1.0, factor) if rejected else factor), trials
        # a trial far too long may end beyond doubles
        size *= max(LEAST, SAFETY * error**exponent) if error < np.inf else LEAST
        rejected = True
    return t, size, trials


@kernel(nogil=False)
def extend(
    step: tuple[float, float], y_old: Floats, y: Floats, more: tuple[Floats, Floats, Floats], stages: Floats,
    terms: Floats, state: Ints, contacts: Table, bodies: Table, drag: float, wave: Table,
) -> None:  # fmt: skip
    """Write the terms of the dense output of a step, ``(7, n)``, from its stages and three more.

    ``step``: its start and size (s); ``more``: scipy's coefficients and times of further stages, and of the terms.
    """
    (t, size), (a, c, d) = step, more
    n, elastic, trial, first = len(y), np.empty(0), np.empty_like(y), len(stages) - len(c)
    for s in range(first, len(stages)):
        trial[:] = 0.0
        for q in range(s):
            for i in range(n):
                trial[i] += a[s - first, q] * stages[q, i]
        for i in range(n):
            trial[i] = y_old[i] + size * trial[i]
        push = wave_at(wave[0], t + c[s - first] * size)
        derivative(trial, state, elastic, contacts, bodies, drag, push, stages[s])
    for i in range(n):
        change = y[i] - y_old[i]
        terms[0, i], terms[1, i] = change, size * stages[0, i] - change
        terms[2, i] = 2.0 * change - size * (stages[first - 1, i] + stages[0, i])
    for p in range(len(d)):
        terms[3 + p] = 0.0
        for q in range(len(stages)):
            for i in range(n):
                terms[3 + p, i] += d[p, q] * stages[q, i]
        for i in range(n):
            terms[3 + p, i] *= size


@kernel(nogil=False)
def interpolate(parts: Floats, terms: Floats, start: Floats, rows: Floats) -> None:
    """Write the states at parts of a step, 0 to 1, into ``rows (n_part, n)``."""
    for row in range(len(parts)):
        for i in range(len(start)):
            rows[row, i] = component(parts[row], terms, start, i)
