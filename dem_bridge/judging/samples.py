"""Hypotheses about the way in which a motion was written into a file: times, units, order, and half steps."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from dem_bridge.judging import kernels
from dem_bridge.judging.fitting import MOST_STEPS, Data
from dem_bridge.judging.hypotheses import Hypothesis, Variant

Floats = NDArray[np.float64]

#: powers of ten by which times or values may be off
POWERS = tuple(k for k in range(-9, 10) if k != 0)


def sample_hypotheses(data: Data, exact: Sequence[Floats]) -> Iterator[Hypothesis]:
    """Yield shifts in time, other units and a reversed order."""
    base = data.model.system
    unit = data.interval
    yield Hypothesis(
        "time-shift",
        lambda p: Variant(base, shift=p[0] * unit),
        "The file is late by {0:.6g} +- {1:.2g} s.",
        ((0.0,), (1.0,), (-1.0,), (3.0,), (-3.0,), (10.0,), (-10.0,)),
        value=lambda p: p * unit,
        reach=1e4,
    )
    for lag in (1, -1):
        words = f"Each sample is that of the {'previous' if lag > 0 else 'next'} time."
        yield Hypothesis("sampling-shift", lambda p, lag=lag: Variant(base, lag=lag), words)  # type: ignore[misc]
    n = data.model.scene.n_body
    for sign in (1.0, -1.0):
        words = f"The bodies are in reversed order{'' if sign > 0.0 else ', and the axis is reversed'}."
        order = tuple(range(n - 1, -1, -1))
        yield Hypothesis(
            "order-of-bodies",
            lambda p, sign=sign, order=order: Variant(base, order=order, factors=(sign, sign, 1.0)),  # type: ignore[misc]
            words,
        )
    yield from _units(data, exact)


def _units(data: Data, exact: Sequence[Floats]) -> Iterator[Hypothesis]:
    """Yield the powers of ten by which times, and the values of each quantity, may be off."""
    base, rows = data.model.system, len(data.time)
    end, whole = float(data.time[-1]), data.model.scene.duration
    for power in (0, *POWERS):
        scale = 10.0**power
        if power != 0 and not 1e-3 * whole < end * scale < 3.0 * whole:
            continue
        prediction = data.predict(Variant(base, scale=scale), rows) if power else exact
        factors, words = [1.0, 1.0, 1.0], [f"times by {scale:g}"] if power else []
        for block, value in zip(data.blocks, prediction, strict=True):
            size, other = (float(np.sqrt(np.sum(np.nan_to_num(v) ** 2))) for v in (value, block.values))
            ratio = other / size if size > 0.0 else 1.0
            nearest = round(math.log10(ratio)) if ratio > 0.0 else 0
            if nearest and abs(math.log10(ratio) - nearest) < 0.15:
                factors[block.quantity] = 10.0**nearest
                words.append(f"{('velocities', 'displacements', 'forces')[block.quantity]} by {10.0**-nearest:g}")
        if words:
            sentence = f"Units: {' and '.join(words)} give SI."
            fixed = (factors[0], factors[1], factors[2])
            yield Hypothesis(
                "units",
                lambda p, scale=scale, fixed=fixed: Variant(base, scale=scale, factors=fixed),  # type: ignore[misc]
                sentence,
            )


def half_steps(data: Data, first_step: float) -> Iterator[Hypothesis]:
    """Yield velocities of half steps and methods of first order, at the step of the file or at one to be fitted."""
    base, dt, unit = data.model.system, data.dt, data.interval
    end = float(data.time[-1])
    if dt is not None and end / dt > 10 * MOST_STEPS:
        return
    kinds: list[tuple[str, int, float, str]] = [
        ("half-step-velocity", kernels.VERLET, 0.5, "Velocities are those of half a step before the times of the file"),
        ("half-step-velocity", kernels.VERLET, -0.5, "Velocities are those of half a step after the times of the file"),
        ("first-order-integrator", kernels.KICK_EULER, 0.0, "The method is symplectic Euler, velocities first"),
        ("first-order-integrator", kernels.DRIFT_EULER, 0.0, "The method is symplectic Euler, positions first"),
        ("first-order-integrator", kernels.EXPLICIT_EULER, 0.0, "The method is explicit Euler"),
    ]
    for cause, method, part, words in kinds:

        def make(p: Floats, method: int = method, part: float = part) -> Variant:
            step = dt if dt is not None else unit * math.exp(min(max(p[0], -50.0), 50.0))
            return Variant(base, late=part * step, method=method, dt=step)

        if dt is not None:
            yield Hypothesis(cause, make, f"{words} (dt = {dt:.6g} s).")
            continue
        start = math.log(first_step / unit)
        yield Hypothesis(
            cause,
            make,
            f"{words} (dt = {{0:.6g}} s, fitted).",
            ((start,), (-1.4,), (-2.3,), (-3.4,), (-4.6,)),
            value=lambda p: unit * math.exp(p),
            bounds=(math.log(min(5.0 * end / MOST_STEPS, unit) / unit), 0.0),
            probe=start,
            logarithmic=True,
            reach=20.0,
        )
