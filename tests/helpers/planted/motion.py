"""Integrate a chain by several methods, as other people's codes do: explicit loops over steps, and scipy's DOP853."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from numba import njit
from scipy.integrate import solve_ivp

from tests.helpers.planted.chains import Chain, Floats

#: stages of a step: (forces are computed after the drift, drift in steps, kick in steps)
STAGES = {
    "verlet": ((0, 0.0, 0.5), (1, 1.0, 0.5)),
    "position-verlet": ((1, 0.5, 1.0), (0, 0.5, 0.0)),
    "kick-drift": ((1, 0.0, 1.0), (0, 1.0, 0.0)),
    "drift-kick": ((1, 1.0, 1.0),),
    "euler": ((1, 0.0, 0.0), (0, 1.0, 1.0)),
}


@njit(cache=True)
def _accelerate(x: Any, v: Any, a: Any, chain: Any) -> None:
    """Fill ``a`` with the accelerations; the last entries of x and v are those of the walls, 0."""
    mass, left, right, beta, power, gap, factor, damping_power, flags, steady, drag = chain
    clipped, tension = flags[0], flags[1]
    for i in range(len(mass)):
        a[i] = steady[i] - drag * v[i]
    for k in range(len(left)):
        overlap = x[left[k]] - x[right[k]] - gap[k]
        if overlap <= 0.0:
            if tension:
                pull = beta[k] * (-overlap) ** power[k]
                if left[k] < len(mass):
                    a[left[k]] += pull / mass[left[k]]
                if right[k] < len(mass):
                    a[right[k]] -= pull / mass[right[k]]
            continue
        force = beta[k] * overlap * np.sqrt(overlap) if power[k] == 1.5 else beta[k] * overlap ** power[k]
        if factor[k] != 0.0:
            force += factor[k] * overlap ** damping_power[k] * (v[left[k]] - v[right[k]])
            if clipped and force < 0.0:
                force = 0.0
        if left[k] < len(mass):
            a[left[k]] -= force / mass[left[k]]
        if right[k] < len(mass):
            a[right[k]] += force / mass[right[k]]


@njit(cache=True)
def _split(
    stages: Any, h: float, stride: int, single: bool, origin: Any, x: Any, v: Any, a: Any, half: Any, args: Any
) -> None:
    """Advance the state by ``stride`` steps of drifts and kicks; ``half`` : velocities after the first stage."""
    n = len(half)
    for _ in range(stride):
        for stage in range(len(stages)):
            drift, kick = h * stages[stage, 1], h * stages[stage, 2]
            for i in range(n):
                x[i] += drift * v[i]
            if stages[stage, 0] > 0.0:
                _accelerate(x, v, a, args)
            for i in range(n):
                v[i] += kick * a[i]
                if stage == 0:
                    half[i] = v[i]
        if single:
            for i in range(n):
                x[i] = np.float32(x[i] + origin[i]) - origin[i]
                v[i] = np.float32(v[i])


@njit(cache=True)
def _runge_kutta(h: float, stride: int, x: Any, v: Any, state: Any, slope: Any, sums: Any, args: Any) -> None:
    """Advance the state by ``stride`` steps of the classical Runge-Kutta method."""
    n = len(x) - 1
    for _ in range(stride):
        for i in range(n):
            state[0, i], state[1, i], sums[0, i], sums[1, i] = x[i], v[i], x[i], v[i]
        for stage in range(4):
            _accelerate(state[0], state[1], slope[1], args)
            for i in range(n):
                slope[0, i] = state[1, i]
            weight = h / 6.0 if stage == 0 or stage == 3 else h / 3.0
            ahead = 0.5 * h if stage < 2 else h
            for i in range(n):
                sums[0, i] += weight * slope[0, i]
                sums[1, i] += weight * slope[1, i]
                state[0, i] = x[i] + ahead * slope[0, i]
                state[1, i] = v[i] + ahead * slope[1, i]
        for i in range(n):
            x[i], v[i] = sums[0, i], sums[1, i]


def _arguments(chain: Chain) -> tuple[Any, ...]:
    flags = np.array([chain.clipped, chain.tension])
    steady = chain.gravity + chain.load / chain.mass
    numbers = (chain.mass, chain.left, chain.right, chain.stiffness, chain.power, chain.gap)
    return (*numbers, chain.damping, chain.damping_power, flags, steady, chain.drag)


def advance(
    chain: Chain, method: str, dt: float, stride: int, rows: int, *, single: bool = False, spacing: float = 0.0
) -> tuple[Floats, Floats, Floats]:
    """Return displacements, velocities and velocities half a step earlier, ``(rows, n_body)``, every ``stride`` steps.

    ``single`` rounds the state to single precision after each step; ``spacing`` is then the distance of the bodies in m
    for a code that keeps positions instead of displacements.
    """
    n, args = chain.n_body, _arguments(chain)
    # the last entries are those of the walls
    x, v, a = np.zeros(n + 1), np.append(chain.velocity, 0.0), np.zeros(n + 1)
    origin = np.float32(spacing * np.arange(n)).astype(np.float64)
    work = [np.zeros((2, n + 1)) for _ in range(3)]
    _accelerate(x, v, a, args)
    half = v[:n] - 0.5 * dt * a[:n]
    samples = [(x[:n].copy(), v[:n].copy(), half.copy())]
    for _ in range(rows - 1):
        if method == "rk4":
            _runge_kutta(dt, stride, x, v, work[0], work[1], work[2], args)
        else:
            _split(np.array(STAGES[method]), dt, stride, single, origin, x, v, a, half, args)
        samples.append((x[:n].copy(), v[:n].copy(), half.copy()))
    positions, velocities, earlier = (np.array(values) for values in zip(*samples, strict=True))
    return positions, velocities, earlier


def accelerations(chain: Chain, x: Floats, v: Floats) -> Floats:
    """Return the accelerations in plain numpy: a second writing of the equations, for scipy."""
    x, v = np.append(x, 0.0), np.append(v, 0.0)
    overlap = x[chain.left] - x[chain.right] - chain.gap
    closed = np.maximum(overlap, 0.0)
    force = chain.stiffness * closed**chain.power
    rate = v[chain.left] - v[chain.right]
    force = force + np.where(overlap > 0.0, chain.damping * closed**chain.damping_power * rate, 0.0)
    if chain.clipped:
        force = np.maximum(force, 0.0)
    if chain.tension:
        force = force - chain.stiffness * np.maximum(-overlap, 0.0) ** chain.power
    net = np.zeros(chain.n_body + 1)
    np.add.at(net, chain.left, -force)
    np.add.at(net, chain.right, force)
    return np.asarray((net[:-1] + chain.load) / chain.mass + chain.gravity - chain.drag * v[:-1])


def _compiled(chain: Chain) -> Callable[[Floats, Floats], Floats]:
    """Return the accelerations as a compiled function, for speed."""
    args, n = _arguments(chain), chain.n_body
    state, rate, a = np.zeros(n + 1), np.zeros(n + 1), np.zeros(n + 1)

    def compute(x: Floats, v: Floats) -> Floats:
        state[:n], rate[:n] = x, v
        _accelerate(state, rate, a, args)
        return a[:n]

    return compute


def dop853(chain: Chain, time: Floats, rtol: float = 1e-11, compiled: bool = False) -> tuple[Floats, Floats]:
    """Return displacements and velocities by scipy's DOP853 straight through the contacts."""
    n = chain.n_body
    # displacements in units that give them the size of the velocities
    unit = chain.duration / 10.0
    acceleration = _compiled(chain) if compiled else partial(accelerations, chain)

    def slope(_: float, y: Floats) -> Floats:
        return np.concatenate([y[n:] / unit, acceleration(y[:n] * unit, y[n:])])

    start = np.concatenate([np.zeros(n), chain.velocity])
    # a single sample at the start needs a span, too
    span, largest = (0.0, max(float(time[-1]), 1e-6 * unit)), chain.duration / 100.0
    run = solve_ivp(slope, span, start, method="DOP853", t_eval=time, rtol=rtol, atol=rtol, max_step=largest)
    assert run.success
    return run.y[:n].T * unit, run.y[n:].T


def exact(chain: Chain, interval: float, rows: int, steps: int = 60_000) -> tuple[Floats, Floats]:
    """Return displacements and velocities that are good to about 1e-8 of the largest, mostly to 1e-10.

    Runge-Kutta takes about ``steps`` steps for the duration of the chain; where the force jumps at touch, or its slope
    does, DOP853 is better.
    """
    if np.any((chain.damping > 0.0) & (chain.damping_power == 0.0)) or np.any(chain.power < 1.2):
        return dop853(chain, interval * np.arange(float(rows)), rtol=1e-12, compiled=True)
    stride = max(1, round(steps * interval / chain.duration))
    x, v, _ = advance(chain, "rk4", interval / stride, stride, rows)
    return x, v
