"""Provide 500 scenes that are built to be awkward, and their truths, kept in tests/data/awkward_scenes.npz.

Each of the kinds in ``KINDS`` is drawn from a seed: the scene ``awkward-17`` has the kind ``17 % len(KINDS)``. Two
programs that share no code must agree on every scene within what each is unsure of (:mod:`tests.helpers.truths`). To
compute the truths anew (a C compiler; some minutes of CPU), and to list where the programs do not agree::

    python -m tests.helpers.awkward_scenes
"""

from __future__ import annotations

import math
import sys
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import brentq, minimize_scalar

from dem_bridge.scene.drive import Drive
from dem_bridge.scene.scene import Adhesion, Damping, Scene, Wall
from tests.helpers.kept_truths import load, save
from tests.helpers.truths import DATA, FIRST, SECOND, Truth, agreed_truth, compiled, disagreements, solved

KEPT = DATA / "awkward_scenes.npz"
COUNT = 500
SAMPLES = 4
EXPONENTS = (2.5, 2.0, 3.0, 1.5, 2.2, 4.0)
Draw = np.random.Generator


def _half_period(mass: float, stiffness: float, exponent: float, speed: float) -> float:
    """Return the time from touch to the largest overlap of two bodies of this reduced mass, s."""
    depth = (0.5 * exponent * mass * speed**2 / stiffness) ** (1.0 / exponent)
    top, bottom = math.gamma(1.0 + 1.0 / exponent), math.gamma(0.5 + 1.0 / exponent)
    return float(depth / speed * math.sqrt(math.pi) * top / bottom)


def _basis(rng: Draw) -> tuple[float, float, float, float, float]:
    """Draw mass, speed, stiffness and exponent, and the time that a collision of two such bodies needs, s."""
    mass, speed = 10.0 ** rng.uniform(-3, -1), 10.0 ** rng.uniform(-2, 1)
    exponent = float(rng.choice(EXPONENTS))
    depth = 10.0 ** rng.uniform(-6, -4.5)
    stiffness = 0.25 * exponent * mass * speed**2 / depth**exponent
    return mass, speed, stiffness, exponent, 2.0 * _half_period(0.5 * mass, stiffness, exponent, speed)


def _laws(rng: Draw, mass: float, stiffness: float, exponent: float, contact: float) -> dict[str, Any]:
    """Draw damping for two scenes of five: a dashpot, clipped or not, or Kuwabara and Kono's law."""
    kind = rng.integers(5)
    if kind == 0:
        coefficient = mass / contact * 10.0 ** rng.uniform(-1.5, 0.3)
        return {"damping": Damping(law="dashpot", coefficient=coefficient, clip=bool(rng.integers(2)))}
    if kind == 1 and exponent >= 2.0:
        coefficient = contact * 10.0 ** rng.uniform(-2.5, -1)
        return {"damping": Damping(law="kuwabara-kono", coefficient=coefficient, clip=bool(rng.integers(2)))}
    return {}


def _mirrored(half: list[float], odd: bool) -> tuple[float, ...]:
    return (*half, *(half[-2::-1] if odd else half[::-1]))


def symmetric(rng: Draw) -> dict[str, Any]:
    """A chain that is its own mirror image, struck at both ends: contacts touch in pairs."""
    mass, speed, stiffness, exponent, contact = _basis(rng)
    bodies = int(rng.integers(3, 7))
    half = (bodies + 1) // 2
    masses = [mass * 2.0 ** int(rng.integers(-2, 3)) for _ in range(half)]
    links = [stiffness * 2.0 ** int(rng.integers(-3, 4)) for _ in range(bodies // 2)]
    gap = speed * contact * 2.0 ** float(rng.integers(-6, 2))
    gaps = [gap, *(gap * float(rng.choice([0.0, 0.25, 1.0])) for _ in links[1:])]
    still = [0.0] * (bodies - 2)
    walls = {}
    if rng.uniform() < 0.3:
        wall = Wall(stiffness=stiffness, gap=gap * float(rng.choice([0.5, 1.0, 4.0])))
        walls = {"wall_left": wall, "wall_right": wall}
    return {
        "mass": _mirrored(masses, bodies % 2 == 1),
        "velocity": (speed, *still, -speed),
        "stiffness": _mirrored(links, bodies % 2 == 0),
        "gap": _mirrored(gaps, bodies % 2 == 0),
        "exponent": exponent,
        "duration": 4.0 * gap / speed + contact * float(rng.uniform(2.0, 8.0)),
        **walls,
        **_laws(rng, mass, stiffness, exponent, contact),
    }


def simultaneous(rng: Draw) -> dict[str, Any]:
    """Bodies whose speeds and gaps make two or more contacts touch at one time, which a double holds."""
    mass, _, stiffness, exponent, contact = _basis(rng)
    bodies, touch = int(rng.integers(3, 7)), 2.0 ** round(math.log2(contact))
    speed = 2.0 ** float(rng.integers(-4, 3))
    closing = [float(rng.choice([1.0, 1.0, 2.0, 0.5, 4.0])) for _ in range(bodies - 1)]
    velocity = speed * (np.sum(closing) - np.concatenate([[0.0], np.cumsum(closing)]))
    velocity -= velocity[int(rng.integers(bodies))]
    late = [float(rng.choice([1.0, 1.0, 1.0, 2.0])) for _ in closing]
    depth = speed * contact / 8.0
    return {
        "mass": tuple(mass * 2.0 ** float(rng.integers(-3, 4)) for _ in range(bodies)),
        "velocity": tuple(velocity.tolist()),
        "stiffness": tuple(
            0.25 * exponent * mass * speed**2 / depth**exponent * float(rng.uniform(0.5, 2)) for _ in closing
        ),
        "gap": tuple(speed * rate * touch * when for rate, when in zip(closing, late, strict=True)),
        "exponent": exponent,
        "duration": touch * 8.0,
        **_laws(rng, mass, stiffness, exponent, contact),
    }


def grazing(rng: Draw) -> dict[str, Any]:
    """A body that turns in a field just before a wall or another body, or just beyond its surface."""
    mass, speed, stiffness, exponent, _ = _basis(rng)
    share = float(rng.choice([-1, 1])) * 10.0 ** rng.uniform(-11, -3)
    fall = speed * 10.0 ** rng.uniform(2, 4)
    height = speed**2 / (2.0 * fall)
    above = {"mass": (mass,), "stiffness": (), "velocity": (speed,), "exponent": 2.5}
    wall = Wall(stiffness=stiffness, gap=height * (1.0 - share), exponent=exponent)
    second = {}
    if rng.uniform() < 0.5:
        # a second body follows, far enough behind
        above = {"mass": (mass, mass * 2.0), "stiffness": (stiffness,), "velocity": (0.0, speed), "exponent": exponent}
        second = {"gap": height * float(rng.uniform(0.0, 0.5))}
    duration = 1.5 * speed / fall
    return {**above, **second, "wall_right": wall, "gravity": -fall, "duration": duration}


def at_a_step(rng: Draw) -> dict[str, Any]:
    """A collision whose touch falls on a step of any code that divides the duration by a power of two."""
    mass, _, stiffness, exponent, contact = _basis(rng)
    speed, duration = 2.0 ** float(rng.integers(-4, 3)), 2.0 ** math.ceil(math.log2(8.0 * contact))
    depth = speed * contact / 4.0
    third = rng.uniform() < 0.5
    part = float(rng.integers(1, 64)) / 128.0
    rest = (speed * duration * float(rng.integers(1, 64)) / 64.0,) if third else ()
    return {
        "mass": (mass, mass * float(rng.uniform(0.3, 3.0)), *(mass,) * third),
        "velocity": (speed, 0.0, *(0.0,) * third),
        "stiffness": (0.25 * exponent * mass * speed**2 / depth**exponent,) * (1 + third),
        "gap": (speed * duration * part, *rest),
        "exponent": exponent,
        "duration": duration,
        **_laws(rng, mass, stiffness, exponent, contact),
    }


def at_the_end(rng: Draw) -> dict[str, Any]:
    """A touch, a largest overlap or an opening shortly before or after the end of the run."""
    mass, speed, stiffness, exponent, contact = _basis(rng)
    gap = speed * contact * float(rng.uniform(0.1, 3.0))
    other = mass * float(rng.uniform(0.3, 3.0))
    half = _half_period(mass * other / (mass + other), stiffness, exponent, speed)
    what = float(rng.integers(3))
    share = float(rng.choice([-1, 1])) * 10.0 ** rng.uniform(-12, -4)
    return {
        "mass": (mass, other, mass),
        "velocity": (speed, 0.0, 0.0),
        "stiffness": (stiffness, stiffness),
        "gap": (gap, 100.0 * gap),
        "exponent": exponent,
        "duration": (gap / speed + what * half) * (1.0 + share),
    }


def at_samples(rng: Draw) -> dict[str, Any]:
    """Touches, largest overlaps or openings at the times of stored samples."""
    mass, _, _, exponent, contact = _basis(rng)
    speed, samples = 2.0 ** float(rng.integers(-4, 3)), int(rng.choice([4, 8, 16]))
    interval = 2.0 ** math.ceil(math.log2(contact))
    depth = speed * contact / 4.0
    stiffness = 0.25 * exponent * mass * speed**2 / depth**exponent
    bodies = int(rng.integers(2, 5))
    if rng.uniform() < 0.5:
        interval = 2.0 * _half_period(0.5 * mass, stiffness, exponent, speed)
    return {
        "mass": (mass,) * bodies,
        "velocity": (speed, *[0.0] * (bodies - 1)),
        "stiffness": (stiffness,) * (bodies - 1),
        "gap": tuple(speed * interval * float(rng.integers(1, 3)) for _ in range(bodies - 1)),
        "exponent": exponent,
        "duration": interval * samples,
        "samples": samples,
        **_laws(rng, mass, stiffness, exponent, contact),
    }


def unequal_masses(rng: Draw) -> dict[str, Any]:
    """Masses of neighbours that differ by up to twelve decades and more."""
    mass, speed, stiffness, exponent, _ = _basis(rng)
    bodies = int(rng.integers(2, 5))
    masses = mass * 10.0 ** rng.uniform(-7, 7, bodies)
    masses[int(rng.integers(bodies))] *= 10.0 ** float(rng.choice([-6, 6]))
    lightest = float(np.min(masses))
    half = _half_period(lightest, stiffness, exponent, speed)
    gap = speed * half * 10.0 ** rng.uniform(-1, 1)
    return {
        "mass": tuple(masses.tolist()),
        "velocity": (speed, *(speed * rng.uniform(-1, 0.2, bodies - 1)).tolist()),
        "stiffness": (stiffness,) * (bodies - 1),
        "gap": tuple((gap * rng.uniform(0, 1, bodies - 1)).tolist()),
        "exponent": exponent,
        "duration": 20.0 * max(half, gap / speed),
    }


def few_samples(rng: Draw) -> dict[str, Any]:
    """A chain with walls and gaps of which one or two samples are stored."""
    mass, speed, stiffness, exponent, contact = _basis(rng)
    bodies = int(rng.integers(2, 6))
    gaps = speed * contact * rng.uniform(0, 1, bodies - 1) * (rng.uniform(size=bodies - 1) < 0.5)
    return {
        "mass": tuple((mass * rng.uniform(0.2, 3.0, bodies)).tolist()),
        "velocity": (speed, *[0.0] * (bodies - 1)),
        "stiffness": tuple((stiffness * rng.uniform(0.2, 3.0, bodies - 1)).tolist()),
        "gap": tuple(gaps.tolist()),
        "exponent": exponent,
        "wall_right": Wall(stiffness=stiffness, gap=speed * contact * float(rng.integers(3)) / 4.0),
        "duration": contact * float(rng.uniform(3.0, 15.0)),
        "samples": int(rng.integers(1, 3)),
        **_laws(rng, mass, stiffness, exponent, contact),
    }


def sticking(rng: Draw) -> dict[str, Any]:
    """Adhesion that nearly or just holds two bodies together, or damping beyond the critical one."""
    mass, speed, stiffness, exponent, contact = _basis(rng)
    if rng.uniform() < 0.5:
        exponent = 2.5
        stiffness = 0.25 * exponent * mass * speed**2 / 10.0 ** (-5.0 * exponent)
        contact = 2.0 * _half_period(0.5 * mass, stiffness, exponent, speed)
        force = stiffness ** (1 / 2.5) * (1.25 * 0.5 * mass * speed**2) ** 0.6
        law: dict[str, Any] = {"adhesion": Adhesion(law="dmt", pull_off=force * 10.0 ** rng.uniform(-2, 0.3))}
        if rng.uniform() < 0.4:
            law["damping"] = Damping(law="dashpot", coefficient=mass / contact * 10.0 ** rng.uniform(-2, 0.5))
    elif rng.uniform() < 0.5 or exponent < 2.0:
        coefficient = mass / contact * 10.0 ** rng.uniform(0.5, 1.7)
        law = {"damping": Damping(law="dashpot", coefficient=coefficient, clip=bool(rng.integers(2)))}
    else:
        coefficient = contact * 10.0 ** rng.uniform(-0.5, 0.7)
        law = {"damping": Damping(law="kuwabara-kono", coefficient=coefficient, clip=bool(rng.integers(2)))}
    third = bool(rng.integers(2))
    gap = speed * contact * 10.0 ** rng.uniform(-2, 0)
    return {
        "mass": (mass, mass * float(rng.uniform(0.5, 2.0)), *(mass,) * third),
        "velocity": (speed, 0.0, *(-0.5 * speed,) * third),
        "stiffness": (stiffness,) * (1 + third),
        "gap": (gap,) * (1 + third),
        "exponent": exponent,
        "duration": gap / speed + contact * float(rng.uniform(2.0, 8.0)),
        **law,
    }


def terminal_velocity(rng: Draw) -> dict[str, Any]:
    """Drag that stops a body just before or behind a gap, or balances weight or a drive before a wall."""
    mass, speed, stiffness, exponent, contact = _basis(rng)
    drag = 10.0 ** rng.uniform(-0.5, 1.0) / contact
    kind = int(rng.integers(3))
    share = float(rng.choice([-1, 1])) * 10.0 ** rng.uniform(-7, -2)
    if kind == 0:
        parts: dict[str, Any] = {
            "mass": (mass, mass),
            "velocity": (speed, 0.0),
            "stiffness": (stiffness,),
            "gap": speed / drag * (1.0 + share),
            "duration": float(rng.uniform(10.0, 30.0)) / drag,
        }
    else:
        limit = speed * float(rng.uniform(0.3, 1.0))
        way = limit * float(rng.uniform(3.0, 20.0)) / drag
        parts = {
            "mass": (mass, 2.0 * mass),
            "velocity": (0.0, 0.0),
            "stiffness": (stiffness,),
            "gap": 0.2 * way,
            "wall_right": Wall(stiffness=stiffness, gap=way),
            "duration": 2.0 * way / limit,
        }
        if kind == 1:
            parts["gravity"] = limit * drag
        else:
            force = mass * limit * drag
            parts["drive"] = Drive(shape="table", force=(0.0, force, force, force), interval=parts["duration"] / 3.0)
    return {"exponent": exponent, "drag": drag, **parts}


def twice_compressed(rng: Draw) -> dict[str, Any]:
    """Two precompressed bodies between walls; a contact has a shallow largest overlap and a dip, or nearly so."""
    exponent = float(rng.choice([2.0, 2.0, 2.5, 3.0, 2.2]))
    force, mass, stiffness = 10.0 ** rng.uniform(1, 3), 10.0 ** rng.uniform(-3, -1), 10.0 ** rng.uniform(8, 10)
    stiffness *= (1e-5) ** (2.0 - exponent)
    overlap = (force / stiffness) ** (1.0 / (exponent - 1.0))
    tangent = (exponent - 1.0) * force / overlap
    scale = math.sqrt(tangent / mass)
    inner, other = 10.0 ** rng.uniform(0.7, 1.5), 10.0 ** rng.uniform(0.1, 0.5)
    masses = np.array([mass, mass * other])
    # small motions: the closing rate of the contact between the bodies is a sum of two cosines
    matrix = tangent * np.array([[1.0 + inner, -inner], [-inner, 1.0 + inner]]) / np.sqrt(np.outer(masses, masses))
    squares, modes = np.linalg.eigh(matrix)
    shape = modes / np.sqrt(masses)[:, None]
    # each mode closes the contact at the same speed
    shape /= shape[0] - shape[1]
    time = np.linspace(0.0, 12.0 / math.sqrt(squares[0]), 4000)

    def rate(when: Any, part: float) -> Any:
        return np.array([1.0, part]) @ np.cos(np.sqrt(squares)[:, None] * when)

    def dip(part: float) -> float:
        """Return the first minimum of the closing rate for this part of the faster mode."""
        rates = rate(time, part)
        low = np.flatnonzero((rates[1:-1] < rates[:-2]) & (rates[1:-1] <= rates[2:]))
        ends = (time[low[0]], time[low[0] + 2])
        return float(minimize_scalar(lambda when: rate(np.array([when]), part)[0], bounds=ends, method="bounded").fun)

    # where the dip just reaches zero, and a little to either side
    parts = np.linspace(0.2, 1.5, 53)
    dips = np.array([dip(float(part)) for part in parts])
    at = int(np.flatnonzero(dips[:-1] * dips[1:] < 0.0)[0])
    part = float(brentq(dip, parts[at], parts[at + 1]))
    part += float(rng.choice([-1, 1])) * 10.0 ** rng.uniform(-7, -1.5)
    motion = shape @ np.array([1.0, part])
    speed = overlap * scale * 10.0 ** rng.uniform(-5, -2) / float(np.max(np.abs(motion)))
    wall = Wall(stiffness=stiffness)
    return {
        "mass": tuple(masses.tolist()),
        "velocity": tuple((speed * motion).tolist()),
        "stiffness": (stiffness * inner ** (exponent - 1.0),),
        "exponent": exponent,
        "wall_left": wall,
        "wall_right": wall,
        "precompression": force,
        "duration": float(rng.uniform(5.0, 25.0)) / scale,
    }


def tiny_gaps(rng: Draw) -> dict[str, Any]:
    """Gaps from the last digit of a double down to the smallest number, and touch at the start."""
    mass, speed, stiffness, exponent, contact = _basis(rng)
    bodies = int(rng.integers(2, 5))
    gaps = [float(rng.choice([0.0, 5e-324, 1e-300, 1e-30, 2.0**-52, 2.0**-60, 1e-20])) for _ in range(bodies - 1)]
    velocity = (speed, *[0.0] * (bodies - 1)) if rng.uniform() < 0.5 else (speed, *[0.0] * (bodies - 2), -speed)
    return {
        "mass": (mass,) * bodies,
        "velocity": velocity,
        "stiffness": (stiffness,) * (bodies - 1),
        "gap": tuple(gaps),
        "exponent": exponent,
        "duration": contact * float(rng.uniform(1.0, 6.0)),
        **_laws(rng, mass, stiffness, exponent, contact),
    }


KINDS: tuple[Callable[[Draw], dict[str, Any]], ...] = (
    symmetric, simultaneous, grazing, at_a_step, at_the_end, at_samples, unequal_masses, few_samples, sticking,
    terminal_velocity, twice_compressed, tiny_gaps,
)  # fmt: skip


def awkward_scene(number: int) -> Scene:
    """Return the scene of this number."""
    rng = np.random.default_rng([30, number])
    return Scene(name=f"awkward-{number}", **{"samples": SAMPLES, **KINDS[number % len(KINDS)](rng)})


def kind_of(scene: Scene) -> str:
    """Return the kind of an awkward scene."""
    return KINDS[int(scene.name.split("-")[1]) % len(KINDS)].__name__


@cache
def awkward() -> list[tuple[Scene, Truth]]:
    """Return all scenes that are kept, with their truths."""
    return load(KEPT, samples=SAMPLES)


def main() -> int:
    """Compute all truths by both programs and keep them; print where they differ, and return 1 if they do anywhere."""
    pairs, wrong = [], 0
    with tempfile.TemporaryDirectory() as folder:
        programs = {method: compiled(method, Path(folder)) for method in (FIRST, SECOND)}
        for number in range(COUNT):
            scene = awkward_scene(number)
            first, second = (solved(program, scene, method.settings) for method, program in programs.items())
            if first is None or second is None:
                print(scene.name, kind_of(scene), "takes too long", first is None, second is None, flush=True)
                wrong += 1
                continue
            if found := disagreements(first, second):
                print(scene.name, kind_of(scene), found, flush=True)
                wrong += 1
            pairs.append((scene, agreed_truth(first, second)))
            if number % 50 == 49:
                save(KEPT, pairs)
    save(KEPT, pairs)
    unsure = sum(any(np.isinf(values).any() for values in truth.doubt.values()) for _, truth in pairs)
    print(f"{len(pairs)} of {COUNT} scenes; not sure of everything: {unsure}")
    return min(wrong, 1)


if __name__ == "__main__":
    sys.exit(main())
