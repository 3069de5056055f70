"""Write ode45 a second time, as documented by Shampine & Reichelt (1997), step for step in numpy and for any ODE.

Its tableau is scipy's and its continuous extension that of ntrp45 in the paper's form; no code of the package is used.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import RK45

Floats = NDArray[np.float64]

#: the matrix BI of ntrp45, by column: powers s, s^2, s^3, s^4
BI = np.array(
    [
        [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        [-183 / 64, 0.0, 1500 / 371, -125 / 32, 9477 / 3392, -11 / 7, 3 / 2],
        [37 / 12, 0.0, -1000 / 159, 125 / 12, -729 / 106, 11 / 3, -4.0],
        [-145 / 128, 0.0, 1000 / 371, -375 / 64, 25515 / 6784, -55 / 28, 5 / 2],
    ]
).T


@dataclass(frozen=True)
class Solution:
    y: Floats
    accepted: int
    failed: int
    evaluations: int
    cut: int
    """Steps that failed by more than the least factor of 0.1."""
    halved: int
    """Steps that failed again."""


def ode45(
    odefun: Callable[[float, Floats], Floats], tspan: Floats, y0: Floats, *, reltol: float, abstol: float
) -> Solution:
    """Return states at ``tspan (n_t,)``, ``(n_t, n_y)``; the first step is chosen as if only the ends were passed."""
    t, tfinal, y = float(tspan[0]), float(tspan[-1]), np.array(y0)
    threshold, hmax, power = abstol / reltol, 0.1 * (tspan[-1] - tspan[0]), 1 / 5
    f0 = odefun(t, y)
    evaluations, accepted, failed, cut, halved = 1, 0, 0, 0, 0
    absh = min(hmax, tfinal - t)
    rh = np.linalg.norm(f0 / np.maximum(np.abs(y), threshold), np.inf) / (0.8 * reltol**power)
    if absh * rh > 1:
        absh = 1 / rh
    absh = max(absh, 16 * np.spacing(t))
    out = [y.copy()]
    done = False
    while not done:
        hmin = 16 * np.spacing(t)
        absh = min(hmax, max(hmin, absh))
        h = absh
        if 1.1 * absh >= abs(tfinal - t):
            h = tfinal - t
            absh = abs(h)
            done = True
        nofailed = True
        while True:
            f = np.zeros((len(y), 7))
            f[:, 0] = f0
            for stage in range(1, 6):
                f[:, stage] = odefun(t + h * RK45.C[stage], y + h * (f[:, :stage] @ RK45.A[stage, :stage]))
            tnew = tfinal if done else t + h
            ynew = y + h * (f[:, :6] @ RK45.B)
            h = tnew - t
            f[:, 6] = odefun(tnew, ynew)
            evaluations += 6
            weight = np.maximum(np.maximum(np.abs(y), np.abs(ynew)), threshold)
            err = absh * np.linalg.norm((f @ RK45.E) / weight, np.inf)
            if err <= reltol:
                break
            failed += 1
            if absh <= hmin:
                raise ArithmeticError("unable to meet integration tolerances")
            if nofailed:
                factor = 0.8 * (reltol / err) ** power
                cut += factor < 0.1
                absh = max(hmin, absh * max(0.1, factor))
            else:
                halved += 1
                absh = max(hmin, 0.5 * absh)
            nofailed = done = False
            h = absh
        accepted += 1
        while len(out) < len(tspan) and tspan[len(out)] <= tnew:
            s = (tspan[len(out)] - t) / h
            out.append(ynew if tspan[len(out)] == tnew else y + f @ (h * BI) @ np.cumprod(np.full(4, s)))
        if nofailed:
            temp = 1.25 * (err / reltol) ** power
            absh = absh / temp if temp > 0.2 else 5 * absh
        t, y, f0 = tnew, ynew, f[:, 6]
    return Solution(np.array(out), accepted, failed, evaluations, cut, halved)
