"""Synthetic measurements of a row of spheres: by scipy's solve_ivp and numpy alone, with Gaussian noise."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

Floats = NDArray[np.float64]

#: scene file of a striker on three spheres
SCENE = """
name = "row"
duration = 2.5e-4
[chain]
mass = [8e-3, 1e-2, 1e-2, 1e-2]
stiffness = [4e9, 6e9, 6e9]
velocity = [0.8, 0, 0, 0]
"""
MASS, STIFFNESS, SPEED = np.array([8e-3, 1e-2, 1e-2, 1e-2]), np.array([4e9, 6e9, 6e9]), 0.8


def motion(times: Floats, *, stiffness: float = 1.0, speed: float = 1.0, mass: float = 1.0) -> tuple[Floats, Floats]:
    """Return velocities ``(n_t, 4)`` and contact forces ``(n_t, 3)``, with factors on the scene's values."""
    beta, m = stiffness * STIFFNESS, mass * MASS

    def force(x: Floats) -> Floats:
        return np.asarray(beta[:, None] * np.maximum(x[:-1] - x[1:], 0.0) ** 1.5)

    def rates(_: float, y: Floats) -> Floats:
        f = np.concatenate([[0.0], force(y[:4, None])[:, 0], [0.0]])
        return np.concatenate([y[4:], (f[:-1] - f[1:]) / m])

    start = np.array([0.0] * 4 + [speed * SPEED, 0.0, 0.0, 0.0])
    result = solve_ivp(rates, (0.0, 2.5e-4), start, t_eval=times, rtol=1e-9, atol=1e-13, method="DOP853", max_step=2e-6)
    return result.y[4:].T, force(result.y[:4]).T


def table(
    times: Floats, velocity: Floats, noise: float, seed: int, *, bodies: tuple[int, ...] = (1, 3), places: int = 12
) -> str:
    """Return the long layout of some bodies' velocities, with noise of this standard deviation added (m/s)."""
    random = np.random.default_rng(seed)
    rows = ["time_s,body,velocity_m_per_s,uncertainty_m_per_s"]
    for body in bodies:
        noisy = velocity[:, body] + noise * random.standard_normal(len(times))
        rows += [f"{t:.9e},{body},{v:.{places}g},{noise}" for t, v in zip(times, noisy, strict=True)]
    return "\n".join(rows) + "\n"
