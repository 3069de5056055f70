"""Provide random scenes with every feature and their truths in extended precision, kept in tests/data/many_scenes.npz.

Mostly 2 to 6 bodies, exponents 1.1 to 5, every damping law, adhesion, drag, drives, walls, gaps, precompression, common
velocities; one in ten has a body or a contact of extreme size. The truths are those of :mod:`tests.helpers.truths`. To
compute them anew (a C compiler; a fifth of a second of CPU each), or those of new seeds::

    python -m tests.helpers.many_scenes again
    python -m tests.helpers.many_scenes FIRST LAST
"""

from __future__ import annotations

import math
import sys
import tempfile
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from dem_bridge.errors import SceneError
from dem_bridge.scene.drive import Drive
from dem_bridge.scene.scene import Adhesion, Damping, Scene, Wall
from tests.helpers.kept_truths import load, save
from tests.helpers.truths import DATA, FIRST, Truth, compiled, solved

KEPT = DATA / "many_scenes.npz"
SAMPLES = 4


def six_digits(values: Any) -> Any:
    """Round to six digits, so that a scene takes few bytes."""
    return tuple(float(f"{value:.6g}") for value in np.atleast_1d(values))


def drawn(seed: int) -> Scene | None:
    """Draw a scene; None where the numbers do not make one."""
    rng = np.random.default_rng([20, seed])
    n = int(rng.integers(2, 7)) if rng.uniform() < 0.97 else int(rng.integers(7, 41))
    links = n - 1
    adhesive, driven, kind = rng.uniform() < 0.08, rng.uniform() < 0.12, rng.uniform()
    law = str(rng.choice(["dashpot", "mass_velocity", "kuwabara-kono", "tsuji", "coeff_restitution"]))
    damped = rng.uniform() < 0.3
    lowest = 2.0 if damped and law not in ("dashpot", "mass_velocity") else 1.1
    one = float(rng.choice([2.0, 2.5, 3.0, rng.uniform(lowest, 5.0), 2.000001, max(lowest, 1.5)]))
    one = 2.5 if adhesive else one
    exponent = rng.uniform(lowest, 5.0, links + 2) if rng.uniform() < 0.15 and not adhesive else np.full(links + 2, one)
    mass = 10.0 ** (rng.uniform(-4, 0) + rng.uniform(0, 3) * rng.uniform(-0.5, 0.5, n))
    speed = 10.0 ** rng.uniform(-6, 2)
    # overlaps of 1e-7 to 1e-4 m at that speed, whatever the exponent
    depth = 10.0 ** rng.uniform(-7, -4) * 10.0 ** rng.uniform(-0.5, 0.5, links + 2)
    stiffness = 0.25 * exponent * float(np.median(mass)) * speed**2 / depth**exponent
    if kind < 0.06:
        mass[rng.integers(n)] *= 10.0 ** rng.uniform(-20, 12)
    elif kind < 0.1:
        stiffness[rng.integers(links)] *= 10.0 ** rng.uniform(-6, 9)
    velocity = np.zeros(n)
    velocity[0] = speed
    if rng.uniform() < 0.5:
        velocity = speed * rng.uniform(-1, 1, n)
    if rng.uniform() < 0.05:
        velocity += speed * 10.0 ** rng.uniform(1, 8)
    gap = np.zeros(links + 2)
    if rng.uniform() < 0.6:
        chosen, size = rng.uniform(size=links + 2) < 0.6, depth * 10.0 ** rng.uniform(-3, 1.5, links + 2)
        gap = np.where(chosen, np.where(rng.uniform(size=links + 2) < 0.2, -np.minimum(size, 0.5 * depth), size), 0.0)
    walls = rng.uniform(size=2) < 0.3
    pressed = rng.uniform() < 0.1 and not adhesive
    duration = float(np.median(depth)) / speed * 10.0 ** rng.uniform(0.5, 1.6)
    gravity = float(rng.choice([-1, 1]) * speed / duration * 10.0 ** rng.uniform(-2, 0)) if rng.uniform() < 0.2 else 0.0
    settings: dict[str, Any] = {}
    present = int(links + walls.sum())
    if damped:
        secant = float(np.median(stiffness * depth ** (exponent - 2.0)))
        critical = 2.0 * math.sqrt(secant * float(np.median(mass))) * 10.0 ** rng.uniform(-2.5, 0.3, present)
        coefficient = {
            "dashpot": critical,
            "mass_velocity": critical / float(np.median(mass)),
            "kuwabara-kono": critical / secant,
        }.get(law, rng.uniform(0.2, 1.0, present))
        clip = bool(rng.uniform() < 0.5) and not adhesive
        settings["damping"] = Damping(law=law, coefficient=six_digits(coefficient), clip=clip)
    if adhesive:
        pull = float(np.median(stiffness * depth**1.5)) * 10.0 ** rng.uniform(-3, -0.5)
        settings["adhesion"] = Adhesion(law="dmt", pull_off=six_digits(pull)[0])
        gap = np.abs(gap) + depth * 1e-2
    if driven:
        force = float(np.median(stiffness * depth ** (exponent - 1.0))) * 10.0 ** rng.uniform(-2, 0)
        frequency = 10.0 ** rng.uniform(0, 1.3) / duration
        values = six_digits(force * rng.uniform(-1, 1, 5))
        shape = ("sine", "chirp", "table")[rng.integers(3)]
        wave = {"force": six_digits(force)[0], "frequency": six_digits(frequency)[0]}
        settings["drive"] = {
            "sine": lambda: Drive(shape=shape, **wave, phase=30.0, rise=six_digits(0.2 * duration)[0]),
            "chirp": lambda: Drive(
                shape=shape, **wave, last_frequency=six_digits(2.0 * frequency)[0], sweep=six_digits(0.7 * duration)[0]
            ),
            "table": lambda: Drive(shape=shape, force=values, interval=six_digits(0.3 * duration)[0]),
        }[shape]()

    def wall(at: int) -> Wall | None:
        k = links + at
        gap_here = 0.0 if pressed else six_digits(gap[k])[0]
        parts = {"stiffness": six_digits(stiffness[k])[0], "gap": gap_here, "exponent": six_digits(exponent[k])[0]}
        return Wall(**parts) if walls[at] else None

    try:
        return Scene(
            name=f"many-{seed}",
            duration=six_digits(duration)[0],
            mass=six_digits(mass),
            stiffness=six_digits(stiffness[:links]),
            exponent=six_digits(exponent[:links]),
            velocity=six_digits(velocity),
            gap=0.0 if pressed else six_digits(gap[:links]),
            wall_left=wall(0),
            wall_right=wall(1),
            gravity=six_digits(gravity)[0],
            drag=six_digits(10.0 ** rng.uniform(-2, 0.5) / duration)[0] if rng.uniform() < 0.1 else 0.0,
            precompression=six_digits(0.1 * np.min(stiffness * depth ** (exponent - 1.0)))[0] if pressed else 0.0,
            samples=SAMPLES,
            **settings,
        )
    except SceneError:
        return None


@cache
def many() -> list[tuple[Scene, Truth]]:
    """Return all scenes that are kept, with their truths."""
    return load(KEPT, samples=SAMPLES)


def main(arguments: list[str]) -> None:
    """Compute truths and keep them, also when interrupted: then those that were not computed again stay as they are."""
    old = many() if KEPT.exists() else []
    again = arguments == ["again"]
    pairs = {scene.name: (scene, truth) for scene, truth in old}
    scenes = [scene for scene, _ in old] if again else [drawn(seed) for seed in range(*map(int, arguments))]
    with tempfile.TemporaryDirectory() as folder:
        program = compiled(FIRST, Path(folder))
        try:
            for scene in scenes:
                if scene is None or (scene.name in pairs and not again):
                    continue
                truth = solved(program, scene, FIRST.settings)
                if truth is not None:
                    pairs[scene.name] = (scene, truth)
                else:
                    pairs.pop(scene.name, None)
        finally:
            save(KEPT, list(pairs.values()))


if __name__ == "__main__":
    main(sys.argv[1:])
