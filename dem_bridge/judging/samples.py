"""Hypotheses about the way in which a motion was written into a file: times, units, order, and half steps."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from dem_bridge.judging import kernels
from dem_bridge.judging.fitting import MOST_STEPS_OF_METHOD, TOLERANCE_OF_SEARCH, Data
from dem_bridge.judging.hypotheses import Hypothesis, Variant

Floats = NDArray[np.float64]

#: powers of ten by which times or values may be off
POWERS_OF_UNITS = tuple(k for k in range(-9, 10) if k != 0)
#: names of the quantities of a file in sentences
WORDS = ("velocities", "displacements", "forces")
#: bodies whose order is examined, and values that are compared for it
MOST_BODIES_TO_ORDER, MOST_VALUES_TO_ORDER = 500, 10_000_000
#: part of the squared difference that another order of bodies may leave to be examined
LARGEST_SHARE_OF_OTHER_ORDER = 0.5


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
        yield Hypothesis("sampling-shift", _always(Variant(base, lag=lag)), words)
    n = data.model.scene.n_body
    for sign in (1.0, -1.0):
        words = f"The bodies are in reversed order{'' if sign > 0.0 else ', and the axis is reversed'}."
        order = tuple(range(n - 1, -1, -1))
        variant = Variant(base, order=order, factors=(sign, sign, 1.0))
        yield Hypothesis("order-of-bodies", _always(variant), words)
    yield from _other_origin(data)
    yield from _other_orders(data)
    yield from _other_signs(data, exact)
    yield from _flipped_columns(data, exact)
    yield from _units(data, exact)
    yield from _factors(data, exact)


def _always(variant: Variant) -> Callable[[Floats], Variant]:
    """Return the function that makes one variant, whatever the parameters: nothing is fitted."""
    return lambda p: variant


def _other_origin(data: Data) -> Iterator[Hypothesis]:
    """Yield displacements from other places than those of the start, if the first sample is not 0 at the start."""
    n = data.model.scene.n_body
    for block in data.blocks:
        if block.quantity != 1 or data.time[0] != 0.0 or data.from_first:
            continue
        offset = np.zeros(n)
        offset[block.columns] = np.where(np.abs(block.values[0]) > block.rounding[0], block.values[0], 0.0)
        if np.any(np.nan_to_num(offset)):
            variant = Variant(data.model.system, offset=tuple(offset.tolist()))
            words = f"Displacements are up to {np.max(np.abs(offset)):.6g} m at the start: they have another origin."
            yield Hypothesis("start-position", _always(variant), words)


def _other_orders(data: Data) -> Iterator[Hypothesis]:
    """Yield the order of bodies in which the columns of a file are most like the motion, if it is not the scene's."""
    base, n, rows = data.model.system, data.model.scene.n_body, len(data.time)
    blocks = [block for block in data.blocks if block.quantity < 2]
    if (
        not blocks
        or n > MOST_BODIES_TO_ORDER
        or any(list(block.columns) != list(blocks[0].columns) for block in blocks)
    ):
        return
    bodies, motion = blocks[0].columns, data.motion(Variant(base), rows, TOLERANCE_OF_SEARCH, None)[0]
    own, every, of_scene = np.arange(len(bodies)), -(-rows * n * n // MOST_VALUES_TO_ORDER), math.inf
    for sign in (1.0, -1.0):
        misfit = np.zeros((len(bodies), n))
        for block in blocks:
            moved = (motion.velocity, motion.displacement)[block.quantity]
            difference = (block.values[::every, :, None] - sign * moved[::every, None, :]) / block.scale
            misfit += np.sum(np.nan_to_num(difference, nan=0.0, posinf=1e150, neginf=-1e150) ** 2, axis=0)
        whole = float(np.sum(misfit[own, bodies]))
        # bodies that move alike, such as those ahead of a front, stay in the scene's order
        misfit[own, bodies] -= 1e-9 * whole / n
        of_scene, least = min(of_scene, whole), np.min(misfit, axis=1)
        # no order leaves less than the least of each column, and it must leave less than the scene
        if np.all(misfit[own, bodies] == least) or float(np.sum(least)) > of_scene:
            continue
        places = _best_places(misfit)
        moved_bodies = np.flatnonzero(places != bodies)
        if not len(moved_bodies) or float(np.sum(misfit[own, places])) > LARGEST_SHARE_OF_OTHER_ORDER * whole:
            continue
        order = np.full(n, -1)
        order[bodies] = places
        order[order < 0] = np.setdiff1d(np.arange(n), places)
        if np.all(np.diff(order) == -1):  # which is a hypothesis of its own
            continue
        few = ", ".join(f"body {bodies[k]} of the file is body {places[k]} of the scene" for k in moved_bodies[:3])
        words = f"The bodies are in another order: {few}{' and so on' if len(moved_bodies) > 3 else ''}."
        variant = Variant(base, order=tuple(order.tolist()), factors=(sign, sign, 1.0))
        yield Hypothesis("order-of-bodies", _always(variant), words)


def _best_places(misfit: Floats) -> NDArray[np.int64]:
    """Return the body for each column, all different, with which the sum of misfits is least."""
    from scipy.optimize import linear_sum_assignment  # 0.3 s to import, and few files need it

    return np.asarray(linear_sum_assignment(misfit)[1])


def _other_signs(data: Data, exact: Sequence[Floats]) -> Iterator[Hypothesis]:
    """Yield the signs of quantities with which they are most like the motion, and a start in the other direction."""
    base, signs, words = data.model.system, [1.0, 1.0, 1.0], []
    for block, value in zip(data.blocks, exact, strict=True):
        if float(np.sum(np.nan_to_num(value / block.scale * block.values))) < 0.0:
            signs[block.quantity] = -1.0
            words.append(WORDS[block.quantity])
    if words:
        fixed = (signs[0], signs[1], signs[2])
        sentence = f"All {' and '.join(words)} have the other sign."
        yield Hypothesis("sign", lambda p: Variant(base, factors=fixed), sentence)
    sentence = "All start velocities have the other sign."
    yield Hypothesis("sign", lambda p: Variant(base.changed(velocity=-base.velocity)), sentence)


def _flipped_columns(data: Data, exact: Sequence[Floats]) -> Iterator[Hypothesis]:
    """Yield the columns of some bodies that are more like the motion with the other sign, if not all are."""
    flipped: list[tuple[int, int]] = []
    count = 0
    for block, value in zip(data.blocks, exact, strict=True):
        if block.quantity < 2:
            same, other = (np.sum(np.nan_to_num(block.values - sign * value) ** 2, axis=0) for sign in (1.0, -1.0))
            flipped += [
                (block.quantity, int(body))
                for body in np.asarray(block.columns)[other < LARGEST_SHARE_OF_OTHER_ORDER * same]
            ]
            count += len(block.columns)
    if not flipped or len(flipped) == count:
        return
    bodies = sorted({body for _, body in flipped})
    names = " and ".join(WORDS[quantity] for quantity in sorted({quantity for quantity, _ in flipped}))
    few = ", ".join(map(str, bodies[:3])) + (" and others" if len(bodies) > 3 else "")
    places = f"bod{'y' if len(bodies) == 1 else 'ies'} {few}"
    yield Hypothesis(
        "sign",
        _always(Variant(data.model.system, flipped=tuple(flipped))),
        f"The {names} of {places} have the other sign.",
        where=places if len(bodies) == 1 else "",
    )


def _factors(data: Data, exact: Sequence[Floats]) -> Iterator[Hypothesis]:
    """Yield factors on all values of a quantity, or on all lengths, in whatever unit they are."""
    base, ratios = data.model.system, dict[int, float]()
    for block, value in zip(data.blocks, exact, strict=True):
        size, common = (float(np.sum(np.nan_to_num(value * other))) for other in (value, block.values))
        if size > 0.0 and common > 0.0:
            ratios[block.quantity] = math.log(common / size)
    kinds = [(quantity,) for quantity in ratios] + ([(0, 1)] if {0, 1} <= set(ratios) else [])
    for kind in kinds:

        def make(p: Floats, kind: tuple[int, ...] = kind) -> Variant:
            velocity, displacement, force = (math.exp(clipped(p[0])) if k in kind else 1.0 for k in range(3))
            return Variant(base, factors=(velocity, displacement, force))

        words = " and ".join(WORDS[quantity] for quantity in kind)
        yield Hypothesis(
            "units",
            make,
            f"All {words} of the file are {{0:.9g}} +- {{1:.2g}} times those of the scene.",
            ((0.0,), (ratios[kind[0]],)),
            value=lambda p: math.exp(clipped(p)),
            reach=50.0,
        )


def clipped(logarithm: float) -> float:
    """Return a logarithm whose number is finite."""
    return min(max(logarithm, -50.0), 50.0)


def _units(data: Data, exact: Sequence[Floats]) -> Iterator[Hypothesis]:
    """Yield the powers of ten by which times, and the values of each quantity, may be off."""
    base, rows = data.model.system, len(data.time)
    end, whole = float(data.time[-1]), data.model.scene.duration
    for power in (0, *POWERS_OF_UNITS):
        scale = 10.0**power
        if power != 0 and not 1e-3 * whole < end * scale < 3.0 * whole:
            continue
        prediction = data.predict(Variant(base, scale=scale), rows) if power else exact
        factors, words = [1.0, 1.0, 1.0], [f"times {_times(1.0 / scale)}"] if power else []
        for block, value in zip(data.blocks, prediction, strict=True):
            size, other = (float(np.sqrt(np.sum(np.nan_to_num(v) ** 2))) for v in (value, block.values))
            ratio = other / size if size > 0.0 else 1.0
            nearest = round(math.log10(ratio)) if ratio > 0.0 else 0
            if nearest and abs(math.log10(ratio) - nearest) < 0.15:
                factors[block.quantity] = 10.0**nearest
                words.append(f"{WORDS[block.quantity]} {_times(10.0**nearest)}")
        if words:
            sentence = f"Units: {' and '.join(words)} SI."
            fixed = (factors[0], factors[1], factors[2])
            yield Hypothesis("units", _always(Variant(base, scale=scale, factors=fixed)), sentence)


def _times(factor: float) -> str:
    """Return what values of another unit are, beside SI: 'are 1000 times', or 'are 1/1000 of'."""
    return f"are {factor:.6g} times" if factor > 1.0 else f"are 1/{1.0 / factor:.6g} of"


def half_steps(data: Data, first_step: float, dt: float | None = None) -> Iterator[Hypothesis]:
    """Yield velocities of half steps and methods of first order, at the step of the file or at one to be fitted.

    ``dt`` is a step (s) that has been found for a file which states none.
    """
    base, dt, unit = data.model.system, data.dt if dt is None else dt, data.interval
    end = float(data.time[-1])
    if dt is not None and end / dt > 10 * MOST_STEPS_OF_METHOD:
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
            step = dt if dt is not None else unit * math.exp(clipped(p[0]))
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
            bounds=(math.log(min(5.0 * end / MOST_STEPS_OF_METHOD, unit) / unit), 0.0),
            probe=start,
            logarithmic=True,
            reach=20.0,
        )
