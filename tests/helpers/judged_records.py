"""Records of a chain as other codes would write them: by integrators of a few lines, in memory."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from dem_bridge.formats.readers import Record
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import Floats

CHAIN = Scene(
    name="five",
    duration=2e-4,
    mass=(8e-3, 1e-2, 1.2e-2, 1e-2, 1.1e-2),
    stiffness=(4e9, 5e9, 4.5e9, 6e9),
    velocity=(0.8, 0.0, 0.0, 0.0, 0.0),
    samples=40,
)


def force(scene: Scene, x: Floats) -> tuple[Floats, Floats]:
    """Return the forces of the contacts and the accelerations of the bodies of a Hertz chain without walls."""
    contact = np.array(scene.stiffness) * np.maximum(x[:-1] - x[1:] - scene.contacts.gap, 0.0) ** 1.5
    net = np.zeros(len(x))
    net[:-1] -= contact
    net[1:] += contact
    return contact, net / np.array(scene.mass)


def integrate(scene: Scene, dt: float, method: str) -> tuple[Floats, dict[str, Floats]]:
    """Return times and samples by "verlet", by "leapfrog" with velocities of half a step before, or by "euler"."""
    every = round(scene.duration / scene.samples / dt)
    x, v = np.zeros(len(scene.mass)), np.array(scene.velocity)
    contact, a = force(scene, x)
    half, rows = v.copy(), [(x, v, contact)]
    for step in range(1, every * scene.samples + 1):
        half = v + 0.5 * dt * a if method != "euler" else v + dt * a
        x = x + dt * half
        contact, a = force(scene, x)
        v = half + 0.5 * dt * a if method != "euler" else half
        if step % every == 0:
            rows.append((x, half if method == "leapfrog" else v, contact))
    columns = ("displacement", "velocity", "contact_force")
    samples = {name: np.array([row[k] for row in rows]) for k, name in enumerate(columns)}
    return np.linspace(0.0, scene.duration, scene.samples + 1), samples


def record(
    scene: Scene = CHAIN,
    dt: float = 1e-6,
    method: str = "verlet",
    *,
    quantities: tuple[str, ...] = ("velocity", "displacement", "contact_force"),
    change: Callable[[dict[str, Floats]], None] | None = None,
    rounding: float = 0.0,
    name: str = "",
    known: bool = True,
) -> Record:
    """Return a record by a method; ``change`` plants a fault, and values are rounded to multiples of ``rounding``."""
    time, samples = integrate(scene, dt, method)
    if change is not None:
        change(samples)
    values = {key: samples[key] for key in quantities}
    if rounding:
        values = {key: rounding * np.round(part / rounding) for key, part in values.items()}
    return Record(
        name=name or f"{method}-{dt:g}",
        time=time,
        values=values,
        columns={key: tuple(range(part.shape[1])) for key, part in values.items()},
        rounding={key: np.full(part.shape, 0.5 * rounding) for key, part in values.items()}
        | {"time": np.zeros(len(time))},
        dt=dt if known else None,
    )
