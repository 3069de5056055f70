"""Provide random scenes with every feature and their truths in extended precision, kept in tests/data/many_scenes.npz.

Mostly 2 to 6 bodies, exponents 1.1 to 5, every damping law, adhesion, drag, drives, walls, gaps, precompression, common
velocities; one in ten has a body or a contact of extreme size. The truth is that of tests/data/truth_any.c, at two
tolerances: their difference is its own uncertainty. To add truths (a C compiler; half a second of CPU each)::

    python -m tests.helpers.many_scenes FIRST LAST
"""

from __future__ import annotations

import json
import math
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dem_bridge.drive import Drive
from dem_bridge.errors import SceneError
from dem_bridge.scene import Adhesion, Damping, Scene, Wall
from dem_bridge.trajectory import SAMPLED, Trajectory

DATA = Path(__file__).parent.parent / "data"
KEPT = DATA / "many_scenes.npz"
TOLERANCES = (1e-18, 1e-16)
SAMPLES = 4
QUANTITIES = ("displacement", "velocity", "peak_force", "crossing_time")
PARTS = {"wall_left": Wall, "wall_right": Wall, "damping": Damping, "adhesion": Adhesion, "drive": Drive}
Floats = NDArray[np.float64]


def _short(values: Any) -> Any:
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
        settings["damping"] = Damping(law=law, coefficient=_short(coefficient), clip=clip)
    if adhesive:
        pull = float(np.median(stiffness * depth**1.5)) * 10.0 ** rng.uniform(-3, -0.5)
        settings["adhesion"] = Adhesion(law="dmt", pull_off=_short(pull)[0])
        gap = np.abs(gap) + depth * 1e-2
    if driven:
        force = float(np.median(stiffness * depth ** (exponent - 1.0))) * 10.0 ** rng.uniform(-2, 0)
        frequency = 10.0 ** rng.uniform(0, 1.3) / duration
        values = _short(force * rng.uniform(-1, 1, 5))
        shape = ("sine", "chirp", "table")[rng.integers(3)]
        wave = {"force": _short(force)[0], "frequency": _short(frequency)[0]}
        settings["drive"] = {
            "sine": lambda: Drive(shape=shape, **wave, phase=30.0, rise=_short(0.2 * duration)[0]),
            "chirp": lambda: Drive(
                shape=shape, **wave, last_frequency=_short(2.0 * frequency)[0], sweep=_short(0.7 * duration)[0]
            ),
            "table": lambda: Drive(shape=shape, force=values, interval=_short(0.3 * duration)[0]),
        }[shape]()

    def wall(at: int) -> Wall | None:
        k = links + at
        gap_here = 0.0 if pressed else _short(gap[k])[0]
        parts = {"stiffness": _short(stiffness[k])[0], "gap": gap_here, "exponent": _short(exponent[k])[0]}
        return Wall(**parts) if walls[at] else None

    try:
        return Scene(
            name=f"many-{seed}",
            duration=_short(duration)[0],
            mass=_short(mass),
            stiffness=_short(stiffness[:links]),
            exponent=_short(exponent[:links]),
            velocity=_short(velocity),
            gap=0.0 if pressed else _short(gap[:links]),
            wall_left=wall(0),
            wall_right=wall(1),
            gravity=_short(gravity)[0],
            drag=_short(10.0 ** rng.uniform(-2, 0.5) / duration)[0] if rng.uniform() < 0.1 else 0.0,
            precompression=_short(0.1 * np.min(stiffness * depth ** (exponent - 1.0)))[0] if pressed else 0.0,
            samples=SAMPLES,
            **settings,
        )
    except SceneError:
        return None


@dataclass(frozen=True)
class Truth:
    """Hold what a scene ends with, and how far two tolerances of the truth are apart."""

    values: dict[str, Floats]
    doubt: dict[str, Floats]

    def outside(self, run: Trajectory, quantity: str) -> float:
        """Return the largest ratio of error to uncertainty; inf for a finite uncertainty of what does not exist."""
        value, truth = getattr(run, quantity), self.values[quantity]
        value = value[-1] if quantity in SAMPLED else value
        bar = np.broadcast_to(np.asarray(run.uncertainty[quantity]), truth.shape)
        missing = np.isnan(value) != np.isnan(truth)
        error = np.where(missing, math.inf, np.nan_to_num(np.abs(value - truth)))
        # the truth is rounded to a double, and is unsure by what two tolerances differ
        allowed = (
            bar + 2.0 * np.nan_to_num(self.doubt[quantity], nan=math.inf) + 2.0**-52 * np.nan_to_num(np.abs(truth))
        )
        ratio = np.divide(error, allowed, out=np.zeros_like(error), where=(error > 0.0) & np.isfinite(allowed))
        return float(np.max(np.where((error > 0.0) & (allowed == 0.0), math.inf, ratio), initial=0.0))

    def width(self, run: Trajectory, quantity: str) -> float:
        """Return the median of uncertainty over error of all bodies or contacts; nan where no error is known."""
        value, truth = getattr(run, quantity), self.values[quantity]
        error = np.abs((value[-1] if quantity in SAMPLED else value) - truth)
        bar = np.broadcast_to(np.asarray(run.uncertainty[quantity]), truth.shape)
        sure = np.isfinite(bar) & (error > 0.0)
        return float(np.median(bar[sure] / error[sure])) if np.any(sure) else math.nan


def make_truth(program: Path, scene: Scene) -> Truth | None:
    """Return the truth of a scene at both tolerances; None where it takes too long."""
    runs = []
    for tolerance in TOLERANCES:
        try:
            done = subprocess.run(
                [program], input=_problem(scene, tolerance), capture_output=True, check=True, text=True
            )
        except subprocess.CalledProcessError:
            return None
        motion, *contacts = [[float.fromhex(word) for word in line.split()] for line in done.stdout.splitlines()]
        table, n = np.array(contacts).reshape(-1, 2), scene.n_body
        runs.append(dict(zip(QUANTITIES, (np.array(motion[:n]), np.array(motion[n:]), *table.T), strict=True)))
    fine, coarse = runs
    apart = {name: np.abs(fine[name] - coarse[name]) for name in QUANTITIES}
    same = {name: np.isnan(fine[name]) & np.isnan(coarse[name]) for name in QUANTITIES}
    return Truth(fine, {name: np.where(same[name], 0.0, apart[name]) for name in QUANTITIES})


def _problem(scene: Scene, tolerance: float) -> str:
    """Return the input of truth_any.c."""
    c, duration, drive = scene.contacts, scene.duration, scene.drive
    mobility = np.append(1.0 / np.array(scene.mass), 0.0)
    fall = abs(scene.gravity) * duration
    push = 0.0 if drive is None else float(np.max(np.abs(drive.force))) * duration / scene.mass[0]
    speed = max(map(abs, scene.velocity)) + fall
    squares = (np.abs(scene.velocity) + fall + push * (np.arange(scene.n_body) == 0)) ** 2
    overlap = np.maximum(-c.gap, 0.0)
    stored = 0.0 if scene.precompression else float(np.sum(c.stiffness * overlap**c.exponent / c.exponent))
    energy = 0.5 * float(np.array(scene.mass) @ squares) + stored
    deep = (c.exponent * energy / c.stiffness) ** (1.0 / c.exponent)
    meet = (0.5 * c.exponent * speed**2 / (mobility[c.left] + mobility[c.right]) / c.stiffness) ** (1.0 / c.exponent)
    deep = np.minimum(deep, 1e3 * meet) if speed > 0.0 and not scene.precompression else deep
    held = scene.precompression > 0.0 or scene.gravity != 0.0 or scene.adhesive
    rest = 1e-10 * c.stiffness * overlap ** (c.exponent - 1.0) * (mobility[c.left] + mobility[c.right]) * held
    numbers: list[Any] = []
    breaks: list[Any] = []
    shape = 0
    if drive is not None:
        shape = 2 if drive.shape == "table" else 1
        if shape == 2:
            forces = np.atleast_1d(drive.force).tolist()
            interval = float(drive.interval or 0.0)
            numbers, breaks = [interval, *forces], [interval * i for i in range(1, len(forces))]
        else:
            chirp = (drive.last_frequency, drive.sweep) if drive.shape == "chirp" else (0.0, 0.0)
            numbers = [drive.force, drive.frequency, *chirp, math.radians(drive.phase), drive.rise]
            breaks = [time for time in (drive.rise, chirp[1]) if time]
    lines = [f"{scene.n_body} {scene.n_contact} {scene.samples} {duration.hex()} {tolerance!r}"]
    lines.append(f"{int(c.clip)} {float(scene.drag).hex()} {shape} {len(numbers)}")
    lines += [" ".join(float(number).hex() for number in part) for part in (numbers,)]
    lines += [f"{len(breaks)}", " ".join(float(time).hex() for time in breaks)]
    lines += [
        " ".join(float(value).hex() for value in row)
        for row in zip(scene.mass, scene.velocity, scene.free_acceleration.tolist(), strict=True)
    ]
    for k in range(scene.n_contact):
        row = (c.stiffness, c.exponent, c.gap, c.damping, c.damping_power, c.pull_off, rest, deep)
        lines.append(f"{c.left[k]} {c.right[k]} " + " ".join(float(values[k]).hex() for values in row))
    return "\n".join([*lines, float(max(speed, math.sqrt(2.0 * energy / sum(scene.mass)))).hex()])


def _scene_of(parts: dict[str, Any]) -> Scene:
    parts = {key: tuple(value) if isinstance(value, list) else value for key, value in parts.items()}
    for key, part in PARTS.items():
        if parts.get(key) is not None:
            fields = {name: tuple(v) if isinstance(v, list) else v for name, v in parts[key].items()}
            parts[key] = part(**fields)
    return Scene(**parts, samples=SAMPLES)


def _kept_fields(scene: Scene) -> dict[str, Any]:
    """Return the fields of a scene that are not defaults, so that they make it again."""
    keys = ("name", "duration", "mass", "stiffness", "exponent", "velocity", "gap", "gravity", "precompression", "drag")
    fields = {key: value for key, value in asdict(scene).items() if key in (*keys, *PARTS) and value not in (None, 0.0)}
    if scene.precompression:
        del fields["gap"]
    return {
        key: {name: v for name, v in value.items() if not name.startswith("_") and v not in (None, "")}
        if isinstance(value, dict)
        else value
        for key, value in fields.items()
    }


@cache
def many() -> list[tuple[Scene, Truth]]:
    """Return all scenes that are kept, with their truths."""
    with np.load(KEPT) as data:
        lines, numbers = json.loads(data["scenes"].tobytes()), data["numbers"]
    pairs, at = [], 0
    for parts in lines:
        scene = _scene_of(parts)
        sizes = [scene.n_body] * 2 + [scene.n_contact] * 2
        blocks = []
        for size in sizes:
            blocks.append(numbers[at : at + size])
            at += size
        doubts = [numbers[at + i] for i in range(4)]
        at += 4
        values = dict(zip(QUANTITIES, blocks, strict=True))
        spread = {name: np.full(len(values[name]), doubt) for name, doubt in zip(QUANTITIES, doubts, strict=True)}
        pairs.append((scene, Truth(values, spread)))
    return pairs


def save(pairs: list[tuple[Scene, Truth]]) -> None:
    """Keep scenes and truths together."""
    numbers: list[float] = []
    for _, truth in pairs:
        numbers += [float(value) for name in QUANTITIES for value in truth.values[name]]
        numbers += [float(np.max(truth.doubt[name], initial=0.0)) for name in QUANTITIES]
    text = np.frombuffer(json.dumps([_kept_fields(scene) for scene, _ in pairs]).encode(), dtype=np.uint8)
    np.savez_compressed(KEPT, scenes=text, numbers=np.array(numbers))


def new_truths(seeds: range) -> Iterator[tuple[Scene, Truth]]:
    """Yield scenes with their truths."""
    with tempfile.TemporaryDirectory() as folder:
        program = Path(folder) / "truth"
        subprocess.run(["cc", "-O2", "-o", program, DATA / "truth_any.c", "-lm"], check=True)
        for seed in seeds:
            scene = drawn(seed)
            truth = None if scene is None else make_truth(program, scene)
            if scene is not None and truth is not None:
                yield scene, truth


if __name__ == "__main__":
    first, last = map(int, sys.argv[1:])
    old = many() if KEPT.exists() else []
    names = {scene.name for scene, _ in old}
    for number, pair in enumerate(new_truths(range(first, last)), start=1):
        if pair[0].name not in names:
            old.append(pair)
        if number % 20 == 0:
            save(old)
    save(old)
