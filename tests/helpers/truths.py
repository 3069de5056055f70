"""Compute truths of scenes in extended precision by two programs that share no code, with what each is unsure of.

``tests/data/truth_any.c`` extrapolates between events, ``tests/data/truth_again.c`` solves for whole steps at once.
Each runs at two settings, whose difference is its own doubt; it names the contacts whose crossing round-off decides. A
doubt is infinite where a quantity is not sure.
"""

from __future__ import annotations

import math
import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dem_bridge.scene.drive import Drive
from dem_bridge.scene.scene import Scene
from dem_bridge.trajectory.trajectory import SAMPLED, Trajectory

DATA = Path(__file__).parent.parent / "data"
QUANTITIES = ("displacement", "velocity", "peak_force", "crossing_time")
Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Method:
    """Name a program and the two settings at which it runs, the finer one first."""

    source: str
    settings: tuple[float, float]


#: settings are tolerances of the first, and numbers of nodes of the second
FIRST, SECOND = Method("truth_any.c", (1e-18, 1e-16)), Method("truth_again.c", (28, 22))
#: some hundred last digits of an extended double (2^-64), relative to the largest value
ROUNDOFF = 2.0**-57
#: factor on the doubts of two truths that are compared, since each is an estimate, and a part of the largest value: the
#: round-off of both programs grows by a few decades where a scene is ill-conditioned
MARGIN, RESOLVED = 4.0, 2.0**-47


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
        doubt = np.nan_to_num(self.doubt[quantity], nan=math.inf, posinf=math.inf)
        allowed = bar + 2.0 * doubt + 2.0**-52 * np.nan_to_num(np.abs(truth))
        ratio = np.divide(error, allowed, out=np.zeros_like(error), where=(error > 0.0) & np.isfinite(allowed))
        return float(np.max(np.where((error > 0.0) & (allowed == 0.0), math.inf, ratio), initial=0.0))

    def width(self, run: Trajectory, quantity: str) -> float:
        """Return the median of uncertainty over error of all bodies or contacts; nan where no error is known."""
        value, truth = getattr(run, quantity), self.values[quantity]
        error = np.abs((value[-1] if quantity in SAMPLED else value) - truth)
        bar = np.broadcast_to(np.asarray(run.uncertainty[quantity]), truth.shape)
        sure = np.isfinite(bar) & (error > 0.0)
        return float(np.median(bar[sure] / error[sure])) if np.any(sure) else math.nan


def compiled(method: Method, folder: Path, *, source: str | None = None) -> Path:
    """Return the program of a method, compiled in a folder; ``source`` replaces its text."""
    text, program = folder / method.source, folder / Path(method.source).stem
    text.write_text((DATA / method.source).read_text() if source is None else source)
    subprocess.run(["cc", "-O2", "-o", program, text, "-lm"], check=True)
    return program


def solved(program: Path, scene: Scene, settings: tuple[float, float]) -> Truth | None:
    """Return the truth of a scene by a program at both settings; None where it takes too long."""
    runs, unsure = [], np.zeros(scene.n_contact, dtype=bool)
    for setting in settings:
        try:
            text = problem(scene, setting)
            done = subprocess.run([program], input=text, capture_output=True, check=True, text=True)
        except subprocess.CalledProcessError:
            return None
        motion, *contacts, whole = [[float.fromhex(word) for word in line.split()] for line in done.stdout.splitlines()]
        table, n = np.array(contacts).reshape(-1, 3), scene.n_body
        runs.append(dict(zip(QUANTITIES, (np.array(motion[:n]), np.array(motion[n:]), *table.T[:2]), strict=True)))
        if setting == settings[0]:
            unsure, all_unsure = table[:, 2] != 0.0, whole[0] != 0.0
    fine, coarse = runs
    floor = roundoff(scene, fine)
    doubt = {name: apart(fine[name], coarse[name]) + floor[name] for name in QUANTITIES}
    doubt["crossing_time"][unsure] = math.inf
    if all_unsure:
        doubt = {name: np.full(len(values), math.inf) for name, values in doubt.items()}
    return Truth(fine, doubt)


def apart(one: Floats, other: Floats) -> Floats:
    """Return how far two values are apart; 0 where neither exists, inf where only one does."""
    distance = np.abs(one - other)
    return np.where(np.isnan(one) & np.isnan(other), 0.0, np.where(np.isnan(distance), math.inf, distance))


def roundoff(scene: Scene, values: dict[str, Floats]) -> dict[str, float]:
    """Return what each quantity is unsure of by the round-off of a sum in extended precision."""
    c = scene.contacts
    # forces in balance cancel but for their last digits
    stored = c.stiffness * np.maximum(-c.gap, 0.0) ** c.exponent
    balanced = math.sqrt(float(np.max(stored, initial=0.0)) / min(scene.mass))
    speed = max(balanced, *map(abs, (*scene.velocity, *values["velocity"].tolist())))
    scales = {
        "displacement": max(speed * scene.duration, float(np.max(np.abs(values["displacement"])))),
        "velocity": speed,
        "peak_force": float(np.max(values["peak_force"], initial=0.0)),
        "crossing_time": scene.duration,
    }
    return {name: ROUNDOFF * scale for name, scale in scales.items()}


def disagreements(one: Truth, other: Truth) -> dict[str, list[int]]:
    """Return the bodies or contacts of each quantity on which two truths differ by more than both are unsure of.

    Where one of them is not sure at all, they do not disagree.
    """
    found = {}
    for name in QUANTITIES:
        first, second = one.values[name], other.values[name]
        scale = float(np.max(np.abs(np.nan_to_num(first)), initial=0.0))
        allowed = MARGIN * (one.doubt[name] + other.doubt[name]) + RESOLVED * scale
        if wrong := np.flatnonzero(apart(first, second) > allowed).tolist():
            found[name] = wrong
    return found


def agreed_truth(one: Truth, other: Truth) -> Truth:
    """Return the first truth; its doubt includes that of the second, and is infinite where they disagree."""
    wrong = disagreements(one, other)
    doubt = {}
    for name in QUANTITIES:
        unsure = ~np.isfinite(other.doubt[name])
        unsure[wrong.get(name, [])] = True
        doubt[name] = np.where(unsure, math.inf, one.doubt[name])
    return Truth(one.values, doubt)


def problem(scene: Scene, tolerance: float) -> str:
    """Return the input of both programs."""
    c, duration, drive = scene.contacts, scene.duration, scene.drive
    assert drive is None or isinstance(drive, Drive), "the program knows no piston"
    mass, mobility = np.array(scene.mass), np.append(1.0 / np.array(scene.mass), 0.0)
    fall = abs(scene.gravity) * duration
    push = 0.0 if drive is None else float(np.max(np.abs(drive.force))) * duration / scene.mass[0]
    # bodies that nothing holds meet at the speeds that they have against each other
    walled = scene.wall_left is not None or scene.wall_right is not None
    velocity = np.array(scene.velocity)
    velocity -= 0.0 if walled else velocity[0] + mass @ (velocity - velocity[0]) / np.sum(mass)
    speed = float(np.max(np.abs(velocity))) + fall
    squares = (np.abs(velocity) + fall + push * (np.arange(scene.n_body) == 0)) ** 2
    overlap = np.maximum(-c.gap, 0.0)
    stored = 0.0 if scene.precompression else float(np.sum(c.stiffness * overlap**c.exponent / c.exponent))
    energy = 0.5 * float(mass @ squares) + stored
    deep = (c.exponent * energy / c.stiffness) ** (1.0 / c.exponent)
    meet = (0.5 * c.exponent * speed**2 / (mobility[c.left] + mobility[c.right]) / c.stiffness) ** (1.0 / c.exponent)
    deep = np.minimum(deep, 1e3 * meet) if speed > 0.0 and not scene.precompression else deep
    speed = max(speed, math.sqrt(2.0 * energy / float(np.sum(mass)))) or 1.0
    deep = np.where(deep > 0.0, deep, np.maximum(overlap, speed * duration))
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
    lines = [f"{scene.n_body} {scene.n_contact} {duration.hex()} {tolerance!r}"]
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
    return "\n".join([*lines, f"{speed.hex()}\n"])
