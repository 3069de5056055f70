"""Compiled motion of a chain, written for the diagnosis: an adaptive method, and the fixed-step methods of other codes.

Arrays are along the line: contact j is between body j - 1 and body j, contact 0 that with the left wall, contact n that
with the right wall; a contact without stiffness is absent. The package's other codes share nothing with this module.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from dem_bridge.backends.driven import Driven, driving_force, piston_motion
from dem_bridge.foundation.compiled import Floats, Ints, kernel

#: fixed-step methods: velocity Verlet, leapfrog that starts with a drift, symplectic Euler that starts with a kick or
#: with a drift, explicit Euler, and the classical Runge-Kutta method of order 4
VERLET, DRIFT_FIRST, KICK_EULER, DRIFT_EULER, EXPLICIT_EULER, RK4 = range(6)
#: part of the largest speed below which a body ahead of a front counts as at rest
_SHARE_OF_SPEED_AT_REST = 1e-22
#: bodies ahead of a front that are worked on
_BODIES_AHEAD_OF_FRONT = 5
#: the adaptive method gives up after so many steps, and two more for each of its times
MOST_ADAPTIVE_STEPS = 60_000


class System(NamedTuple):
    """The numbers of a scene along its line: contact j is in front of body j, contacts 0 and n are with walls."""

    mass: Floats
    velocity: Floats
    free: Floats
    """Acceleration of each body without contacts, m/s^2."""
    stiffness: Floats
    exponent: Floats
    gap: Floats
    damping: Floats
    damping_power: Floats
    pull_off: Floats
    drag: float
    driven: Driven
    clipped: bool
    pulls: bool
    hertz: bool
    damped: bool
    adhesive: bool
    first_step: float

    def changed(self, **values: Any) -> System:
        """Return the system with other numbers."""
        system = self._replace(**values)
        return system._replace(**kinds_of(system.exponent, system.damping, system.pull_off))


def kinds_of(exponent: Floats, damping: Floats, pull_off: Floats) -> dict[str, Any]:
    """Return the kinds of forces that a system has."""
    return {
        "hertz": bool(np.all(exponent == 2.5)),
        "damped": bool(np.any(damping > 0.0)),
        "adhesive": bool(np.any(pull_off > 0.0)),
    }


@kernel(nogil=False)
def forces(x: Floats, v: Floats, count: int, system: System, f: Floats) -> None:
    """Write the forces (N) of the contacts in front of the first ``count`` bodies, and of the next one, into ``f``."""
    n = len(system.mass)
    last = min(count, n - 1)
    gap, stiffness = system.gap, system.stiffness
    f[0] = 0.0 - gap[0] - x[0]
    for j in range(1, last + 1):
        f[j] = x[j - 1] - x[j] - gap[j]
    if count >= n:
        f[n] = x[n - 1] - gap[n]
        last = n
    if system.hertz and not system.damped and not system.pulls and not system.adhesive:
        for j in range(last + 1):
            depth = f[j] if f[j] > 0.0 else 0.0
            f[j] = stiffness[j] * depth * np.sqrt(depth)
        return
    for j in range(last + 1):
        depth, force = f[j], 0.0
        if depth > 0.0:
            if system.hertz:
                force = stiffness[j] * depth * np.sqrt(depth)
            else:
                force = stiffness[j] * depth ** (system.exponent[j] - 1.0)
            force -= system.pull_off[j]
            if system.damping[j] > 0.0:
                rate = (v[j - 1] if j > 0 else 0.0) - (v[j] if j < n else 0.0)
                power = system.damping_power[j]
                force += system.damping[j] * rate * (depth**power if power > 0.0 else 1.0)
                if system.clipped and force < 0.0:
                    force = 0.0
        elif system.pulls and depth < 0.0:
            force = -stiffness[j] * (-depth) ** (system.exponent[j] - 1.0)
        f[j] = force


@kernel(nogil=False)
def accelerations(t: float, x: Floats, v: Floats, count: int, system: System, f: Floats, a: Floats) -> None:
    """Write the acceleration (m/s^2) of the first ``count`` bodies at time ``t`` (s) into ``a``.

    A piston is put where it is at this time, in ``x`` and ``v``, and its acceleration is 0: methods need not move it.
    """
    if system.driven.piston.moves:
        x[0], v[0] = piston_motion(max(t, 0.0), system.driven.piston)[:2]
    forces(x, v, count, system, f)
    for i in range(count):
        a[i] = (f[i] - f[i + 1]) / system.mass[i] + system.free[i] - system.drag * v[i]
    if system.driven.amplitude != 0.0 or len(system.driven.values) > 0:
        a[0] += driving_force(max(t, 0.0), system.driven) / system.mass[0]
    if system.driven.piston.moves:
        a[0] = 0.0


@kernel(nogil=False)
def reached(v: Floats, a: Floats, count: int, speed: float) -> int:
    """Return the number of bodies to work on: those that move, and some ahead of them, ``count`` at least."""
    last = len(v)
    while (
        last > count - _BODIES_AHEAD_OF_FRONT
        and last > 0
        and abs(v[last - 1]) <= _SHARE_OF_SPEED_AT_REST * speed
        and a[last - 1] == 0.0
    ):
        last -= 1
    return min(len(v), max(count, last + _BODIES_AHEAD_OF_FRONT))


@kernel(nogil=False)
def largest_error(ka: Floats, errors: Floats, h: float, count: int, third: Floats, fifth: Floats) -> float:
    """Return the error of the velocities of a step of DOP853; ``third`` and ``fifth`` have room for its two estimates.

    Hairer, E., Norsett, S. P. & Wanner, G. 1993, *Solving Ordinary Differential Equations I*, section II.10.
    """
    third[:count], fifth[:count] = 0.0, 0.0
    for j in range(errors.shape[1]):
        for i in range(count):
            third[i] += errors[0, j] * ka[j, i]
            fifth[i] += errors[1, j] * ka[j, i]
    largest = 0.0
    for i in range(count):
        total = fifth[i] * fifth[i] + 0.01 * third[i] * third[i]
        if total > 0.0:
            largest = max(largest, h * fifth[i] * fifth[i] / np.sqrt(total))
    return largest


@kernel()
def adaptive(
    system: System, times: Floats, speed: float, tolerance: float, method: Floats, weights: Floats, errors: Floats
) -> tuple[Floats, Floats, Floats, Floats, float]:
    """Integrate by an explicit Runge-Kutta pair of order 8 (Dormand & Prince) that steps onto each of ``times``.

    ``tolerance`` is that of the velocities in a step, relative to ``speed``. ``method``, ``weights``, ``errors``: its
    coefficients. The results are displacement, velocity, acceleration ``(n_t, n)``, force ``(n_t, n + 1)`` and the time
    (s) that was reached, from which on velocities are nan if the steps were too many.
    """
    n, stages, rows = len(system.mass), len(weights), len(times)
    most = MOST_ADAPTIVE_STEPS + 2 * rows
    x, v, a, f = np.zeros(n), system.velocity.copy(), np.zeros(n), np.zeros(n + 1)
    out_x, out_v, out_a, out_f = np.zeros((rows, n)), np.zeros((rows, n)), np.zeros((rows, n)), np.zeros((rows, n + 1))
    kv, ka = np.zeros((stages + 1, n)), np.zeros((stages + 1, n))
    new_x, new_v, third, fifth = np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n)
    accelerations(0.0, x, v, n, system, f, a)
    count = reached(v, a, 0, speed)
    t, steps, size = 0.0, 0, system.first_step
    for row in range(rows):
        while t < times[row]:
            if steps == most:
                out_v[row:] = np.nan
                return out_x, out_v, out_a, out_f, t
            steps += 1
            left = times[row] - t
            lands = size >= 0.999 * left
            h = left if lands else min(size, 0.5 * left)
            for i in range(count):
                kv[0, i], ka[0, i] = v[i], a[i]
            for stage in range(1, stages):
                part = 0.0
                for i in range(count):
                    new_x[i], new_v[i] = x[i], v[i]
                for j in range(stage):
                    weight = h * method[stage, j]
                    part += method[stage, j]
                    if weight != 0.0:
                        for i in range(count):
                            new_x[i] += weight * kv[j, i]
                            new_v[i] += weight * ka[j, i]
                kv[stage, :count] = new_v[:count]
                accelerations(t + part * h, new_x, new_v, count, system, f, ka[stage])
            for i in range(count):
                new_x[i], new_v[i] = x[i], v[i]
            for j in range(stages):
                weight = h * weights[j]
                if weight != 0.0:
                    for i in range(count):
                        new_x[i] += weight * kv[j, i]
                        new_v[i] += weight * ka[j, i]
            accelerations(t + h, new_x, new_v, count, system, f, ka[stages])
            ratio = largest_error(ka, errors, h, count, third, fifth) / (tolerance * speed)
            if not ratio < np.inf:
                # the motion of such numbers is none
                out_v[row:] = np.nan
                return out_x, out_v, out_a, out_f, times[-1]
            if ratio <= 1.0 or h < 1e-13 * times[-1]:
                t = times[row] if lands else t + h
                x[:count], v[:count], a[:count] = new_x[:count], new_v[:count], ka[stages, :count]
                count = reached(v, a, count, speed)
                grown = 6.0 if ratio < 1e-8 else min(6.0, 0.9 * ratio**-0.125)
                size = max(size, h * grown) if lands and h < 0.5 * size else h * grown
            else:
                size = h * max(0.1, 0.9 * ratio**-0.125)
        forces(x, v, n, system, f)
        out_x[row], out_v[row], out_a[row], out_f[row] = x, v, a, f
        if system.driven.piston.moves:
            out_a[row, 0] = piston_motion(t, system.driven.piston)[2]
    return out_x, out_v, out_a, out_f, times[-1]


@kernel()
def fixed(system: System, steps: Ints, dt: float, method: int, speed: float) -> tuple[Floats, Floats, Floats, Floats]:
    """Integrate by one of the fixed-step methods and return the state after each of ``steps`` (increasing numbers).

    The results are displacement, velocity, acceleration ``(n_t, n)`` and force ``(n_t, n + 1)``, with the acceleration
    of the last kick, so that velocities at half steps follow from it.
    """
    n, rows = len(system.mass), len(steps)
    x, v, a, f = np.zeros(n), system.velocity.copy(), np.zeros(n), np.zeros(n + 1)
    out_x, out_v, out_a, out_f = np.zeros((rows, n)), np.zeros((rows, n)), np.zeros((rows, n)), np.zeros((rows, n + 1))
    kv, ka, px, pv = np.zeros((4, n)), np.zeros((4, n)), np.zeros(n), np.zeros(n)
    accelerations(0.0, x, v, n, system, f, a)
    count, step = reached(v, a, 0, speed), 0
    for row in range(rows):
        while step < steps[row]:
            t = step * dt
            if method == VERLET:
                for i in range(count):
                    v[i] += 0.5 * dt * a[i]
                    x[i] += dt * v[i]
                accelerations(t + dt, x, v, count, system, f, a)
                for i in range(count):
                    v[i] += 0.5 * dt * a[i]
            elif method == DRIFT_FIRST:
                for i in range(count):
                    x[i] += 0.5 * dt * v[i]
                accelerations(t + 0.5 * dt, x, v, count, system, f, a)
                for i in range(count):
                    v[i] += dt * a[i]
                    x[i] += 0.5 * dt * v[i]
            elif method == KICK_EULER:
                accelerations(t, x, v, count, system, f, a)
                for i in range(count):
                    v[i] += dt * a[i]
                    x[i] += dt * v[i]
            elif method == DRIFT_EULER:
                for i in range(count):
                    x[i] += dt * v[i]
                accelerations(t + dt, x, v, count, system, f, a)
                for i in range(count):
                    v[i] += dt * a[i]
            elif method == EXPLICIT_EULER:
                accelerations(t, x, v, count, system, f, a)
                for i in range(count):
                    x[i] += dt * v[i]
                    v[i] += dt * a[i]
            else:
                for stage in range(4):
                    part = 0.0 if stage == 0 else dt if stage == 3 else 0.5 * dt
                    for i in range(count):
                        px[i] = x[i] + part * kv[stage - 1, i]
                        pv[i] = v[i] + part * ka[stage - 1, i]
                    kv[stage, :count] = pv[:count]
                    accelerations(t + part, px, pv, count, system, f, ka[stage])
                for i in range(count):
                    x[i] += dt / 6.0 * (kv[0, i] + 2.0 * (kv[1, i] + kv[2, i]) + kv[3, i])
                    v[i] += dt / 6.0 * (ka[0, i] + 2.0 * (ka[1, i] + ka[2, i]) + ka[3, i])
            step += 1
            count = reached(v, a, count, speed)
        if method != VERLET:
            accelerations(step * dt, x, v, n, system, f, a)
        pv[:] = v
        if method == VERLET and step > 0:
            # codes of this method write the forces that they have: those at the velocities of half a step before
            pv -= 0.5 * dt * a
        forces(x, pv, n, system, f)
        out_x[row], out_v[row], out_a[row], out_f[row] = x, v, a, f
        if system.driven.piston.moves:
            out_a[row, 0] = piston_motion(step * dt, system.driven.piston)[2]
    return out_x, out_v, out_a, out_f
