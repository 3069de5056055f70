"""Compiled motion of chains of powers of the overlap: bit for bit what :mod:`.kernels` answers, several times sooner.

No contact damps, pulls or adheres, and no body is driven. A step of a fixed-step method is one loop along the line,
which compilers make vectors of. Other powers than Hertz's are taken of the few contacts that are closed. Each kernel is
compiled for Hertz's law alone, where ``power`` is None, and for other powers. Arrays are along the line as in
:mod:`.kernels`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dem_bridge.foundation.compiled import Floats, Ints, kernel
from dem_bridge.judging.kernels import DRIFT_FIRST, MOST_ADAPTIVE_STEPS, RK4, VERLET, System, largest_error, reached

#: fixed-step methods that are here
METHODS = (VERLET, DRIFT_FIRST, RK4)
#: steps after which it is looked again how far a front is: a disturbance goes one body further in each
_LOOK = 8


class Line(NamedTuple):
    """The numbers of a chain of powers of the overlap; see :class:`~dem_bridge.judging.kernels.System`."""

    mass: Floats
    velocity: Floats
    free: Floats
    stiffness: Floats
    gap: Floats
    drag: float


def line_of(system: System) -> Line | None:
    """Return the numbers of a system whose forces are powers of the overlap alone; None if it has anything else."""
    driven = system.driven
    moved = driven.amplitude != 0.0 or len(driven.values) > 0 or driven.piston.moves
    if moved or system.damped or system.adhesive or system.pulls:
        return None
    return Line(system.mass, system.velocity, system.free, system.stiffness, system.gap, system.drag)


def power_of(system: System) -> Floats | None:
    """Return the power of the overlap that is the force of each contact; None if all contacts are Hertz's."""
    return None if system.hertz else system.exponent - 1.0


@kernel(nogil=False)
def raise_overlaps(count: int, line: Line, power: Floats, f: Floats) -> None:
    """Write the forces of the contacts up to ``count`` in place of their overlaps in ``f``, 0 where they are open."""
    for j in range(count + 1):
        if f[j] > 0.0:
            f[j] = line.stiffness[j] * f[j] ** power[j]


@kernel(nogil=False)
def press(x: Floats, count: int, line: Line, power: Floats | None, f: Floats) -> None:
    """Write the forces (N) of the contacts in front of the first ``count`` bodies, and of the next one, into ``f``."""
    stiffness, gap, behind = line.stiffness, line.gap, 0.0
    for j in range(count):
        here = x[j]
        depth = behind - here - gap[j]
        closed = depth if depth > 0.0 else 0.0
        f[j] = stiffness[j] * closed * np.sqrt(closed) if power is None else closed
        behind = here
    depth = behind - x[count] - gap[count] if count < len(x) else behind - gap[count]
    closed = depth if depth > 0.0 else 0.0
    f[count] = stiffness[count] * closed * np.sqrt(closed) if power is None else closed
    if power is not None:
        raise_overlaps(count, line, power, f)


@kernel(nogil=False)
def accelerate(x: Floats, v: Floats, count: int, line: Line, power: Floats | None, f: Floats, a: Floats) -> None:
    """Write the accelerations (m/s^2) of the first ``count`` bodies into ``a``, and the forces into ``f``."""
    mass, free, drag = line.mass, line.free, line.drag
    press(x, count, line, power, f)
    for i in range(count):
        # this division does not look for a mass of zero, which would keep the loop from becoming vectors
        a[i] = np.divide(f[i] - f[i + 1], mass[i]) + free[i] - drag * v[i]


@kernel()
def fixed(
    line: Line, power: Floats | None, steps: Ints, dt: float, method: int
) -> tuple[Floats, Floats, Floats, Floats]:
    """Return what :func:`.kernels.fixed` does, by velocity Verlet or by the leapfrog that starts with a drift.

    An evaluation of the forces ends with ``f``; the kick by it is in the loop of the next one.
    """
    mass, velocity, free, stiffness, gap, drag = line
    n, rows, kicks, half = len(mass), len(steps), method == VERLET, 0.5 * dt
    x, v, f, begins = np.zeros(n), velocity.copy(), np.zeros(n + 1), np.zeros(n)
    out_x, out_v, out_a, out_f = np.zeros((rows, n)), np.zeros((rows, n)), np.zeros((rows, n)), np.zeros((rows, n + 1))
    accelerate(x, v, n, line, power, f, begins)
    step, front = 0, 0
    for i in range(n):
        if v[i] != 0.0 or begins[i] != 0.0:
            front = i + 1
    for row in range(rows):
        while step < steps[row]:
            together = steps[row] - step if front == n else min(steps[row] - step, _LOOK)
            count = min(n, front + together)
            for turn in range(together):
                first = step + turn == 0
                pushed, behind = f[0], 0.0
                for i in range(count):
                    ahead, here, u = f[i + 1], x[i], v[i]
                    # this division does not look for a mass of zero, which would keep the loop from becoming vectors
                    a = np.divide(pushed - ahead, mass[i]) + free[i] - drag * u
                    if kicks:
                        if not first:
                            u += half * a
                        u += half * a
                        here += dt * u
                    else:
                        if not first:
                            u += dt * a
                            here += half * u
                        here += half * u
                    x[i], v[i] = here, u
                    depth = behind - here - gap[i]
                    closed = depth if depth > 0.0 else 0.0
                    f[i] = stiffness[i] * closed * np.sqrt(closed) if power is None else closed
                    pushed, behind = ahead, here
                depth = behind - x[count] - gap[count] if count < n else behind - gap[n]
                closed = depth if depth > 0.0 else 0.0
                f[count] = stiffness[count] * closed * np.sqrt(closed) if power is None else closed
                if power is not None:
                    raise_overlaps(count, line, power, f)
            step += together
            while count > front and x[count - 1] == 0.0 and v[count - 1] == 0.0 and f[count] == 0.0:
                count -= 1
            front = count
        accelerate(x, v, n, line, power, f, out_a[row])
        out_x[row], out_v[row], out_f[row] = x, v, f
        if step > 0 and kicks:
            out_v[row] += half * out_a[row]
        elif step > 0:
            out_v[row] += dt * out_a[row]
            out_x[row] += half * out_v[row]
            accelerate(out_x[row], out_v[row], n, line, power, out_f[row], out_a[row])
    return out_x, out_v, out_a, out_f


@kernel()
def runge_kutta(
    line: Line, power: Floats | None, steps: Ints, dt: float, speed: float
) -> tuple[Floats, Floats, Floats, Floats]:
    """Return what :func:`.kernels.fixed` does, by the classical Runge-Kutta method."""
    n, rows = len(line.mass), len(steps)
    x, v, a, f = np.zeros(n), line.velocity.copy(), np.zeros(n), np.zeros(n + 1)
    out_x, out_v, out_a, out_f = np.zeros((rows, n)), np.zeros((rows, n)), np.zeros((rows, n)), np.zeros((rows, n + 1))
    kv, ka, px = np.zeros((4, n)), np.zeros((4, n)), np.zeros(n)
    accelerate(x, v, n, line, power, f, a)
    count, step = reached(v, a, 0, speed), 0
    for row in range(rows):
        while step < steps[row]:
            for stage in range(4):
                part = 0.0 if stage == 0 else dt if stage == 3 else 0.5 * dt
                for i in range(count):
                    px[i] = x[i] + part * kv[stage - 1, i]
                    kv[stage, i] = v[i] + part * ka[stage - 1, i]
                accelerate(px, kv[stage], count, line, power, f, ka[stage])
            for i in range(count):
                x[i] += dt / 6.0 * (kv[0, i] + 2.0 * (kv[1, i] + kv[2, i]) + kv[3, i])
                v[i] += dt / 6.0 * (ka[0, i] + 2.0 * (ka[1, i] + ka[2, i]) + ka[3, i])
            step += 1
            count = reached(v, a, count, speed)
        accelerate(x, v, n, line, power, f, a)
        out_x[row], out_v[row], out_a[row], out_f[row] = x, v, a, f
    return out_x, out_v, out_a, out_f


@kernel(nogil=False)
def add_stages(x: Floats, v: Floats, kv: Floats, ka: Floats, h: float, weights: Floats, used: Ints, count: int) -> None:
    """Add ``h weights`` times the slopes of the ``used`` stages to ``count`` bodies, up to three stages in a loop."""
    j, terms = 0, len(used)
    while j < terms:
        left, p, q, r = terms - j, used[j], used[min(j + 1, terms - 1)], used[min(j + 2, terms - 1)]
        first, second, third = h * weights[p], h * weights[q], h * weights[r]
        if left > 2:
            for i in range(count):
                x[i] = x[i] + first * kv[p, i] + second * kv[q, i] + third * kv[r, i]
                v[i] = v[i] + first * ka[p, i] + second * ka[q, i] + third * ka[r, i]
        elif left == 2:
            for i in range(count):
                x[i] = x[i] + first * kv[p, i] + second * kv[q, i]
                v[i] = v[i] + first * ka[p, i] + second * ka[q, i]
        else:
            for i in range(count):
                x[i] += first * kv[p, i]
                v[i] += first * ka[p, i]
        j += 3


@kernel()
def adaptive(
    line: Line, power: Floats | None, first_step: float, times: Floats, speed: float, tolerance: float,
    method: Floats, weights: Floats, errors: Floats,
) -> tuple[Floats, Floats, Floats, Floats, float]:  # fmt: skip
    """Return what :func:`.kernels.adaptive` does: the motion at ``times`` by the pair of order 8."""
    n, stages, rows = len(line.mass), len(weights), len(times)
    most = MOST_ADAPTIVE_STEPS + 2 * rows
    x, v, a, f = np.zeros(n), line.velocity.copy(), np.zeros(n), np.zeros(n + 1)
    out_x, out_v, out_a, out_f = np.zeros((rows, n)), np.zeros((rows, n)), np.zeros((rows, n)), np.zeros((rows, n + 1))
    kv, ka, new_x = np.zeros((stages + 1, n)), np.zeros((stages + 1, n)), np.zeros(n)
    third, fifth, every = np.zeros(n), np.zeros(n), np.concatenate((method, weights.reshape(1, stages)))
    used, number = np.zeros((stages + 1, stages), dtype=np.int64), np.zeros(stages + 1, dtype=np.int64)
    for stage in range(1, stages + 1):
        for j in range(stage):
            used[stage, number[stage]] = j
            number[stage] += every[stage, j] != 0.0
    accelerate(x, v, n, line, power, f, a)
    count = reached(v, a, 0, speed)
    t, steps, size = 0.0, 0, first_step
    for row in range(rows):
        while t < times[row]:
            if steps == most:
                out_v[row:] = np.nan
                return out_x, out_v, out_a, out_f, t
            steps += 1
            left = times[row] - t
            lands = size >= 0.999 * left
            h = left if lands else min(size, 0.5 * left)
            kv[0, :count], ka[0, :count] = v[:count], a[:count]
            for stage in range(1, stages + 1):
                for i in range(count):
                    new_x[i], kv[stage, i] = x[i], v[i]
                add_stages(new_x, kv[stage], kv, ka, h, every[stage], used[stage, : number[stage]], count)
                accelerate(new_x, kv[stage], count, line, power, f, ka[stage])
            ratio = largest_error(ka, errors, h, count, third, fifth) / (tolerance * speed)
            if not ratio < np.inf:
                # the motion of such numbers is none
                out_v[row:] = np.nan
                return out_x, out_v, out_a, out_f, times[-1]
            if ratio <= 1.0 or h < 1e-13 * times[-1]:
                t = times[row] if lands else t + h
                x[:count], v[:count], a[:count] = new_x[:count], kv[stages, :count], ka[stages, :count]
                count = reached(v, a, count, speed)
                grown = 6.0 if ratio < 1e-8 else min(6.0, 0.9 * ratio**-0.125)
                size = max(size, h * grown) if lands and h < 0.5 * size else h * grown
            else:
                size = h * max(0.1, 0.9 * ratio**-0.125)
        press(x, n, line, power, f)
        out_x[row], out_v[row], out_a[row], out_f[row] = x, v, a, f
    return out_x, out_v, out_a, out_f, times[-1]
