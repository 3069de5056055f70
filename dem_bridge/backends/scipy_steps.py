"""scipy's DOP853 with a compiled step: its table, rules of step control and dense output are those of scipy.

One step of scipy takes some 13 calls of Python and numpy a trial, far more than the forces of a chain. Here all trials
of a step are one call of a kernel. Where forces or drives are functions of Python, scipy's own step is taken.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.integrate import DOP853

from dem_bridge.backends.scipy_kernels import Floats, Table, derivative
from dem_bridge.foundation.compiled import Ints, kernel

#: least and largest factor by which a step changes, and the part of the predicted one that is taken, as in scipy
LEAST, MOST, SAFETY = 0.2, 10.0, 0.9


class CompiledDop853(DOP853):  # type: ignore[misc]  # scipy has no types
    """DOP853 whose steps, all trials of each, are computed by :func:`take_step`.

    ``system``: state of the contacts, contacts, bodies and drag, as :func:`~.scipy_kernels.derivative` takes them.
    """

    t: float
    y: Floats
    f: Floats
    h_abs: float
    nfev: int

    def __init__(self, system: tuple[Ints, Table, Table, float], *arguments: Any, **named: Any) -> None:
        super().__init__(*arguments, **named)
        self.system = system

    def _step_impl(self) -> tuple[bool, str | None]:
        new = np.empty_like(self.y)
        control = (float(self.t), float(self.h_abs), float(self.t_bound), float(self.rtol), self.error_exponent)
        after, size, trials = take_step.compiled(
            control, self.y, self.f, self.atol, (self.A, self.B, self.E5, self.E3), self.K, new, *self.system
        )
        self.nfev += trials * self.n_stages
        if not after > self.t:
            return False, self.TOO_SMALL_STEP
        self.h_previous, self.y_old = after - self.t, self.y
        self.t, self.y, self.h_abs, self.f = after, new, size, self.K[self.n_stages].copy()
        return True, None


@kernel(nogil=False)
def take_step(
    control: tuple[float, float, float, float, float], y: Floats, f: Floats, atol: Floats,
    table: tuple[Floats, Floats, Floats, Floats], stages: Floats, new: Floats, state: Ints, contacts: Table,
    bodies: Table, drag: float,
) -> tuple[float, float, int]:  # fmt: skip
    """Take one step, write the state after it into ``new``, and return its time, the next size (s) and the trials.

    The time is that before the step where its size would be too small. ``control``: time, size, end, relative
    tolerance and exponent of the error; ``table``: coefficients of scipy; ``stages (n_stages + 1, n)``: room.
    """
    t, size, end, rtol, exponent = control
    a, b, fifth, third = table
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
            derivative(trial, state, elastic, contacts, bodies, drag, 0.0, stages[s])
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
        if of_fifth > 0.0 or of_third > 0.0:
            error = size * of_fifth / np.sqrt((of_fifth + 0.01 * of_third) * n)
        if error < 1.0:
            factor = MOST if error == 0.0 else min(MOST, SAFETY * error**exponent)
            return after, size * (min(1.0, factor) if rejected else factor), trials
        # a trial far too long may end beyond doubles
        size *= max(LEAST, SAFETY * error**exponent) if error < np.inf else LEAST
        rejected = True
    return t, size, trials
