"""A small code of somebody: a chain in a dozen lines of numpy, with faults as people make them, and its CSV file.

Nothing of dem_bridge is used; a fault is a change of the numbers, of the loop or of what is written.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Chain:
    """The numbers of a chain, in SI units."""

    mass: Floats
    stiffness: Floats
    gap: Floats
    velocity: Floats
    duration: float
    exponent: float = 1.5
    """Power of the overlap in the force."""
    damping: float = 0.0
    """N s/m."""
    clipped: bool = True
    gravity: float = 0.0
    pulls: bool = False

    def forces(self, x: Floats, v: Floats) -> Floats:
        """Return the force of each contact, N."""
        overlap = x[:-1] - x[1:] - self.gap
        force = self.stiffness * np.maximum(overlap, 0.0) ** self.exponent
        if self.damping:
            force = force + np.where(overlap > 0.0, self.damping * (v[:-1] - v[1:]), 0.0)
        if self.clipped:
            force = np.maximum(force, 0.0)
        if self.pulls:
            force = force - self.stiffness * np.maximum(-overlap, 0.0) ** self.exponent
        return np.asarray(force)

    def accelerations(self, x: Floats, v: Floats) -> Floats:
        """Return the acceleration of each body, m/s^2."""
        force = self.forces(x, v)
        return np.asarray((np.append(0.0, force) - np.append(force, 0.0)) / self.mass + self.gravity)

    def scene(self, name: str) -> str:
        """Return the scene file."""

        def row(values: Floats) -> str:
            return f"[{', '.join(repr(float(value)) for value in values)}]"

        lines = [f'name = "{name}"', f"duration = {self.duration!r}", "[chain]", f"mass = {row(self.mass)}"]
        lines += [f"stiffness = {row(self.stiffness)}", f"exponent = {self.exponent + 1.0!r}", f"gap = {row(self.gap)}"]
        lines += [f"velocity = {row(self.velocity)}"]
        if self.damping:
            clip = str(self.clipped).lower()
            lines += ["[chain.damping]", 'law = "dashpot"', f"coefficient = {self.damping!r}", f"clip = {clip}"]
        if self.gravity:
            lines += ["[environment]", f"gravity = {self.gravity!r}"]
        return "\n".join(lines) + "\n"


@dataclass(frozen=True, kw_only=True)
class Output:
    """How the code runs and what it writes."""

    dt: float
    every: int
    """Steps between two rows."""
    length: float = 1.0
    """Length of the run over the duration of the chain."""
    method: str = "verlet"
    half: bool = False
    """Velocities are those of half a step before."""
    single: bool = False
    start: float = 0.0
    """Displacement of body 1 at the start, m."""


@dataclass(frozen=True, eq=False)
class Rows:
    """What the code writes: times, displacements and velocities ``(n_t, n_body)``, and forces ``(n_t, n_contact)``."""

    time: Floats
    displacement: Floats
    velocity: Floats
    force: Floats


def run(chain: Chain, output: Output) -> Rows:
    """Return the rows of a run."""
    x, v, dt = np.zeros(len(chain.mass)), chain.velocity.astype(float), output.dt
    x[1] += output.start
    a = chain.accelerations(x, v)
    rows = []
    for step in range(round(output.length * chain.duration / dt) + 1):
        if step % output.every == 0:
            rows.append((step * dt, x.copy(), v - 0.5 * dt * a if output.half else v.copy(), chain.forces(x, v)))
        if output.method == "verlet":
            x = x + dt * (v + 0.5 * dt * a)
            half = v + 0.5 * dt * a
            a = chain.accelerations(x, half)
            v = half + 0.5 * dt * a
        elif output.method == "symplectic":
            v = v + dt * chain.accelerations(x, v)
            x = x + dt * v
        else:  # explicit Euler
            x, v = x + dt * v, v + dt * chain.accelerations(x, v)
        if output.single:
            x, v = x.astype(np.float32).astype(float), v.astype(np.float32).astype(float)
    return Rows(*(np.array(part) for part in zip(*rows, strict=True)))


def write(path: Path, rows: Rows, digits: int = 12, *, forces: bool = False) -> Path:
    """Write rows as CSV."""
    bodies = range(rows.velocity.shape[1])
    heads = ["time [s]", *(f"x{k} [m]" for k in bodies), *(f"v{k} [m/s]" for k in bodies)]
    columns = [rows.time[:, None], rows.displacement, rows.velocity]
    if forces:
        heads += [f"contact force {k} [N]" for k in bodies[:-1]]
        columns.append(rows.force)
    lines = [",".join(f"{value:.{digits - 1}e}" for value in row) for row in np.hstack(columns)]
    path.write_text("\n".join([",".join(heads), *lines]) + "\n")
    return path


def chain(seed: int, *, damped: bool = False, gaps: bool = False, gravity: float = 0.0) -> Chain:
    """Return a chain of 4 to 9 unlike bodies, whose first one strikes the others."""
    rng = np.random.default_rng([seed, 33])
    n = int(rng.integers(4, 10))
    mass, stiffness = rng.uniform(4e-3, 2e-2, n), rng.uniform(3e9, 2e10, n - 1)
    speed = float(rng.uniform(0.3, 1.5))
    contact = 2.94 * (1.25 * 0.5 * float(np.mean(mass)) / float(np.mean(stiffness))) ** 0.4 * speed**-0.2
    free = rng.uniform(1e-6, 4e-6, n - 1) if gaps else np.zeros(n - 1)
    return Chain(
        mass=mass,
        stiffness=stiffness,
        gap=free,
        velocity=np.append(speed, np.zeros(n - 1)),
        duration=float(f"{0.8 * n * contact + 2.0 * float(np.sum(free)) / speed:.2g}"),
        damping=float(rng.uniform(5.0, 20.0)) if damped else 0.0,
        gravity=gravity,
    )


Planted = tuple[Chain, Output, Callable[[Rows], Rows]]
Fault = Callable[[Chain, Output], Planted]


def _same(rows: Rows) -> Rows:
    return rows


def _numbers(change: Callable[[Chain], Chain]) -> Fault:
    """Return the fault of a code that runs another chain."""
    return lambda chain, output: (change(chain), output, _same)


def _writing(change: Callable[[Rows], Rows]) -> Fault:
    """Return the fault of a code that writes its rows otherwise."""
    return lambda chain, output: (chain, output, change)


def _at(values: Floats, place: int, factor: float) -> Floats:
    values = values.copy()
    values[place] *= factor
    return values


def _other_bodies(chain: Chain) -> Chain:
    """Return a chain of as many other bodies."""
    rng = np.random.default_rng(len(chain.mass))
    return replace(chain, mass=rng.permutation(chain.mass) * rng.uniform(0.6, 1.6, len(chain.mass)))


def _swapped(values: Floats) -> Floats:
    return values[:, [1, 0, *range(2, values.shape[1])]]


#: cause -> faults with this cause; the first is the one of the quick test
FAULTS: dict[str, list[Fault]] = {
    "none": [lambda chain, output: (chain, output, _same)],
    "half-step-velocity": [lambda chain, output: (chain, replace(output, half=True), _same)],
    "first-order-integrator": [
        lambda chain, output: (chain, replace(output, method="euler"), _same),
    ],
    "exponent": [_numbers(lambda c: replace(c, exponent=c.exponent - 0.05))],
    "stiffness-scale": [
        _numbers(lambda c: replace(c, stiffness=1.03 * c.stiffness)),
        _numbers(lambda c: replace(c, stiffness=0.5 * c.stiffness)),
    ],
    "mass": [
        _numbers(lambda c: replace(c, mass=_at(c.mass, 2, 1.05))),
        _numbers(lambda c: replace(c, mass=_at(c.mass, 0, 0.7))),
    ],
    "stiffness": [_numbers(lambda c: replace(c, stiffness=_at(c.stiffness, 1, 1.1)))],
    "damping": [_numbers(lambda c: replace(c, damping=0.5 * c.damping if c.damping else 10.0))],
    "clip": [_numbers(lambda c: replace(c, clipped=not c.clipped))],
    "gravity": [_numbers(lambda c: replace(c, gravity=c.gravity + 9.81))],
    "tension": [_numbers(lambda c: replace(c, pulls=True, clipped=False))],
    "missed-contact": [_numbers(lambda c: replace(c, stiffness=_at(c.stiffness, 2, 0.0)))],
    "time-shift": [_writing(lambda rows: replace(rows, time=rows.time + 0.3 * rows.time[1]))],
    "time-scale": [_writing(lambda rows: replace(rows, time=1.02 * rows.time))],
    "sampling-shift": [_writing(lambda rows: replace(rows, time=rows.time + rows.time[1]))],
    "units": [
        _writing(lambda rows: replace(rows, velocity=1e3 * rows.velocity, displacement=1e3 * rows.displacement)),
        _writing(lambda rows: replace(rows, velocity=1e3 * rows.velocity)),
    ],
    "order-of-bodies": [
        _writing(
            lambda rows: replace(rows, velocity=_swapped(rows.velocity), displacement=_swapped(rows.displacement))
        ),
        _writing(lambda rows: replace(rows, velocity=rows.velocity[:, ::-1], displacement=rows.displacement[:, ::-1])),
    ],
    "single-precision": [lambda chain, output: (chain, replace(output, single=True), _same)],
    "start-velocity": [
        _numbers(lambda c: replace(c, velocity=1.03 * c.velocity)),
        _numbers(lambda c: replace(c, velocity=np.append(0.0, c.velocity[1:]))),
    ],
    "start-position": [
        _numbers(lambda c: replace(c, gap=c.gap + np.eye(len(c.gap))[1] * 1e-6)),
        lambda chain, output: (chain, replace(output, start=5e-7), _same),
        _numbers(lambda c: replace(c, gap=np.append(c.gap[0] + 5e-7, c.gap[1:]))),
    ],
    "sign": [
        _writing(lambda rows: replace(rows, velocity=-rows.velocity, displacement=-rows.displacement)),
        _writing(lambda rows: replace(rows, velocity=-rows.velocity)),
    ],
    "wrong-scene": [_numbers(_other_bodies)],
}


def planted(folder: Path, cause: str, which: int, seed: int, output: Output, **kinds: object) -> tuple[Path, Path]:
    """Write the file of a code with a fault, and the scene that it should be of; return both paths."""
    right = chain(seed, **kinds)  # type: ignore[arg-type]
    wrong, how, writing = FAULTS[cause][which](right, output)
    scene = folder / "scene.toml"
    scene.write_text(right.scene("mine"))
    return write(folder / "mine.csv", writing(run(wrong, how))), scene
