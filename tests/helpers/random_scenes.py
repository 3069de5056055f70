"""Provide the random scenes for error bars: seeded, Hertzian, and as unlike each other as users' chains are.

Their truths, in extended precision and by a method of its own, are in tests/data/random_scenes.npz; run this module to
make them again (a C compiler and an hour).

Two to 60 bodies; masses and stiffnesses over up to four decades (in a tenth of the scenes a body of another six, in
another tenth a contact of another eight); gaps and overlaps of any size beside what an impact makes; walls; one or
several moving bodies; weight; impact speeds from 1e-9 to 1e3 m/s; 10 to 3000 of the shortest contact times.
"""

from __future__ import annotations

import json
import math
import subprocess
import sys
import tempfile
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dem_bridge.scene.scene import Scene, Wall
from dem_bridge.trajectory.trajectory import Trajectory

DATA = Path(__file__).parent.parent / "data"
COUNT = 300
#: conditions of 1e9 and more: extended precision does not know their truth to nine digits, so no bar can be tried on it
LEFT_OUT = (
    3,
    18,
    46,
    48,
    52,
    87,
    96,
    107,
    116,
    122,
    123,
    129,
    136,
    147,
    150,
    181,
    188,
    204,
    227,
    253,
    254,
    264,
    273,
    277,
    293,
    303,
    304,
    314,
)
DRAWS = [draw for draw in range(COUNT + len(LEFT_OUT)) if draw not in LEFT_OUT]
#: local tolerance of the truth: ten times finer moves it by 1e-15 of v0 on the paper's decelerating chain
TOLERANCE = 3e-19
Floats = NDArray[np.float64]

#: contact time of two bodies over d/v (PHYSICS: Gamma functions at n = 5/2)
CONTACT_TIME = 2.943275184325
SAMPLES = 8


def drawn(seed: int) -> Scene:
    """Draw a scene; its last digits depend on a library's powers, so the scenes that are used are stored."""
    rng = np.random.default_rng([2018, seed])
    n = round(math.exp(rng.uniform(math.log(2), math.log(60))))
    links = n - 1

    def spread(count: int, middle: float, decades: float) -> Floats:
        return middle * 10.0 ** (decades * rng.uniform(-0.5, 0.5, count))

    mass = spread(n, 10.0 ** rng.uniform(-4, 0), rng.uniform(0, 4))
    stiffness = spread(links + 2, 10.0 ** rng.uniform(8, 11), rng.uniform(0, 4))
    kind = rng.uniform()
    if kind < 0.1:
        mass[rng.integers(n)] = mass.max() if rng.uniform() < 0.5 else 1e-6 * mass.min()
        mass[rng.integers(n)] = 1e6 * mass.min()
    elif kind < 0.2:
        stiffness[rng.integers(links)] = 1e8 * stiffness.min()
    v0 = 10.0 ** rng.uniform(-9, 3)
    velocity = np.zeros(n)
    velocity[0] = v0
    if rng.uniform() < 0.5:
        moving = rng.uniform(size=n) < 0.5
        velocity[moving] = v0 * rng.uniform(-1, 1, int(moving.sum()))
    inverse = 1.0 / mass
    mobility = np.concatenate([inverse[:-1] + inverse[1:], [inverse[0], inverse[-1]]])
    depth = (1.25 * v0**2 / mobility / stiffness) ** 0.4
    gap = np.zeros(links + 2)
    if rng.uniform() < 0.5:
        chosen = rng.uniform(size=links + 2) < rng.uniform()
        size = depth * 10.0 ** rng.uniform(-3, 2, links + 2)
        overlap = rng.uniform(size=links + 2) < 0.25
        gap = np.where(chosen, np.where(overlap, -np.minimum(size, 0.5 * depth), size), 0.0)
    walls = rng.uniform(size=2) < 0.3
    present = np.concatenate([np.ones(links, dtype=bool), walls])
    shortest = float(np.min((CONTACT_TIME * depth / v0)[present]))
    duration = shortest * 10.0 ** rng.uniform(1, 3.5)
    gravity = rng.choice([-1, 1]) * v0 / duration * 10.0 ** rng.uniform(-2, 0) if rng.uniform() < 0.25 else 0.0

    def wall(at: int) -> Wall | None:
        return Wall(stiffness=float(stiffness[links + at]), gap=float(gap[links + at])) if walls[at] else None

    return Scene(
        name=f"random-{seed}",
        duration=duration,
        mass=tuple(mass.tolist()),
        stiffness=tuple(stiffness[:links].tolist()),
        velocity=tuple(velocity.tolist()),
        gap=tuple(gap[:links].tolist()),
        wall_left=wall(0),
        wall_right=wall(1),
        gravity=float(gravity),
        samples=SAMPLES,
    )


def shortest_contact(scene: Scene) -> float:
    """Return the shortest time, s, that a contact would last if its two bodies met at the largest start speed."""
    mobility = np.append(1.0 / np.array(scene.mass), 0.0)
    c, speed = scene.contacts, max(abs(v) for v in scene.velocity)
    depth = (1.25 * speed**2 / (mobility[c.left] + mobility[c.right]) / c.stiffness) ** 0.4
    return float(np.min(CONTACT_TIME * depth / speed))


@dataclass(frozen=True)
class RandomTruth:
    """Hold the truth of one scene at its samples, rounded to doubles."""

    displacement: Floats
    velocity: Floats
    peak_force: Floats
    crossing_time: Floats

    def error(self, run: Trajectory, quantity: str) -> Floats:
        """Return the largest error of samples ``(1,)``, or that of each contact; inf where only one run has a value."""
        values, other = getattr(run, quantity), getattr(self, quantity)
        away = np.abs(values - other)
        if quantity in ("velocity", "displacement"):
            return np.array([np.max(away)])
        return np.where(np.isnan(values) & np.isnan(other), 0.0, np.where(np.isnan(away), math.inf, away))

    def outside(self, run: Trajectory, quantity: str) -> float:
        """Return the largest ratio of error to bar; 0 where a value is right to the last digit."""
        error = self.error(run, quantity)
        bar = np.broadcast_to(np.atleast_1d(run.uncertainty[quantity]), error.shape)
        ratio = [0.0 if e == 0.0 or math.isinf(b) else e / b if b > 0.0 else math.inf
                 for e, b in zip(error, bar, strict=True)]  # fmt: skip
        return max(ratio, default=0.0)


@cache
def _stored() -> tuple[dict[str, Floats], list[dict[str, Any]]]:
    with np.load(DATA / "random_scenes.npz") as data:
        parts = dict(data)
    return parts, json.loads(parts.pop("scenes").tobytes())


@cache
def random_scene(seed: int) -> Scene:
    """Return scene ``seed`` (0 to 299) of those with a stored truth."""
    parts = dict(_stored()[1][seed])
    for side in ("wall_left", "wall_right"):
        if parts[side] is not None:
            parts[side] = Wall(**parts[side])
    return Scene(**parts)


def random_truth(seed: int) -> RandomTruth:
    """Return the stored truth of ``random_scene(seed)``."""
    data, scenes = _stored()
    bodies = [len(parts["mass"]) for parts in scenes]
    rows = slice(*((SAMPLES + 1) * sum(bodies[:end]) for end in (seed, seed + 1)))
    contacts = slice(*(sum(random_scene(before).n_contact for before in range(end)) for end in (seed, seed + 1)))
    return RandomTruth(
        displacement=data["displacement"][rows].reshape(SAMPLES + 1, -1),
        velocity=data["velocity"][rows].reshape(SAMPLES + 1, -1),
        peak_force=data["peak_force"][contacts],
        crossing_time=data["crossing_time"][contacts],
    )


def make_truth(program: Path, scene: Scene, tolerance: float) -> RandomTruth:
    """Run tests/data/truth.c, compiled as ``program``."""
    c = scene.contacts
    lines = [f"{scene.n_body} {scene.n_contact} {scene.samples} {scene.duration.hex()} {tolerance!r}"]
    lines += [f"{m.hex()} {v.hex()} {scene.gravity.hex()}" for m, v in zip(scene.mass, scene.velocity, strict=True)]
    lines += [
        f"{c.left[k]} {c.right[k]} {float(c.stiffness[k]).hex()} {float(c.exponent[k]).hex()} {float(c.gap[k]).hex()}"
        for k in range(scene.n_contact)
    ]
    done = subprocess.run([program], input="\n".join(lines), capture_output=True, check=True, text=True)
    table = [[float.fromhex(word) for word in line.split()] for line in done.stdout.splitlines()]
    motion, contacts = np.array(table[: scene.samples + 1]), np.array(table[scene.samples + 1 :]).reshape(-1, 3)
    n = scene.n_body
    return RandomTruth(motion[:, :n], motion[:, n:], contacts[:, 1], contacts[:, 2])


def save(scenes: list[Scene], truths: list[RandomTruth]) -> None:
    """Keep scenes and truths together, so that one cannot change without the other."""
    keys = ("name", "duration", "mass", "stiffness", "velocity", "gap", "wall_left", "wall_right", "gravity", "samples")
    kept = [{key: value for key, value in asdict(scene).items() if key in keys} for scene in scenes]
    names = ("displacement", "velocity", "peak_force", "crossing_time")
    parts = {name: np.concatenate([getattr(truth, name).ravel() for truth in truths]) for name in names}
    text = np.frombuffer(json.dumps(kept).encode(), dtype=np.uint8)
    np.savez_compressed(DATA / "random_scenes.npz", scenes=text, **parts)  # type: ignore[arg-type]


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        program = Path(folder) / "truth"
        subprocess.run(["cc", "-O2", "-o", program, DATA / "truth.c", "-lm"], check=True)
        scenes, truths = [drawn(draw) for draw in DRAWS], []
        for seed, scene in enumerate(scenes):
            truths.append(make_truth(program, scene, TOLERANCE))
            print(f"\r{seed + 1} of {COUNT}", end="", file=sys.stderr)
    save(scenes, truths)


if __name__ == "__main__":
    main()
