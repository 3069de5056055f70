"""Faults that are planted in the right code by the author of the grader, with the item and the cause of each."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

import numpy as np

from dem_bridge.scene.file.write import scene_json
from dem_bridge.scene.scene import Scene
from tests.judging.conformance import right_code

Document = dict[str, Any]
Numbers = dict[str, Any]
Code = Callable[[Scene, float, Path], None]
#: change of the numbers of a scene
Change = Callable[[Numbers, Document], None]
#: change of times, displacements and velocities
Rows = Callable[[Any, Any, Any], tuple[Any, Any, Any]]


def code(change: Change | None = None, rows: Rows | None = None) -> Code:
    """Return the right code, with a change of its numbers, or of its samples."""

    def run(scene: Scene, dt: float, path: Path) -> None:
        document = json.loads(scene_json(scene))
        numbers = right_code.numbers(document)
        if change is not None:
            change(numbers, document)
        interval = scene.duration / scene.samples
        every = max(1, round(interval / dt))
        x, v = right_code.verlet(**numbers, dt=interval / every, every=every, samples=scene.samples)
        samples = (interval * np.arange(scene.samples + 1), x, v)
        right_code.write(path, *(samples if rows is None else rows(*samples)))

    return run


def _contact(place: int) -> Change:
    """Leave out a contact between bodies, counted from 0, or from the end if it is negative."""

    def change(n: Numbers, d: Document) -> None:
        del d
        count = len(n["m"]) - 1
        if -count <= place < count:
            for key in ("k", "c"):
                n[key][1:-1][place] = 0.0

    return change


def _without_contacts(n: Numbers, d: Document) -> None:
    """Leave out all contacts between bodies."""
    del d
    for key in ("k", "c"):
        n[key][1:-1] = 0.0


def _gravity(factor: float) -> Change:
    """Change gravity by a factor."""

    def change(n: Numbers, d: Document) -> None:
        n["free"] = n["free"] + (factor - 1.0) * d.get("environment", {}).get("gravity", 0.0)

    return change


def _without_load(n: Numbers, d: Document) -> None:
    """Leave out the forces that hold static overlaps."""
    n["free"][:] = d.get("environment", {}).get("gravity", 0.0)


def _tsuji(n: Numbers, d: Document) -> None:
    """Leave out sqrt 2 in the law tsuji."""
    if d["chain"].get("damping", {}).get("law") == "tsuji":
        n["c"] = n["c"] / 2**0.5


#: fault -> (change of the numbers, item that fails, cause)
OF_NUMBERS: dict[str, tuple[Change, str, str]] = {
    "exponent": (lambda n, d: n["n"].__setitem__(n["n"] == 2.5, 2.6), "exponent", "exponent"),
    "stiffness": (lambda n, d: n.update(k=1.1 * n["k"]), "law", "stiffness-scale"),
    "stiffness by sqrt 2": (lambda n, d: n.update(k=2**0.5 * n["k"]), "law", "stiffness-scale"),
    "no walls": (lambda n, d: n["wall"].__setitem__(slice(None), False), "walls", "missed-contact"),
    "one wall": (lambda n, d: n["k"].__setitem__(-1, 0.5 * n["k"][-1]), "walls", "stiffness"),
    "no gaps": (lambda n, d: n.update(gap=np.minimum(n["gap"], 0.0)), "gaps", "start-position"),
    "no gravity": (_gravity(0.0), "gravity", "gravity"),
    "rounded gravity": (_gravity(9.80 / 9.81), "gravity", "gravity"),
    "no load": (_without_load, "precompression", "start-position"),
    "one velocity": (lambda n, d: n["v"].__setitem__(slice(1, None), 0.0), "several-moving", "start-velocity"),
    "one mass": (lambda n, d: n["m"].__setitem__(slice(None), n["m"][0]), "mixing", "mass"),
    "mean": (lambda n, d: n["k"].__setitem__(slice(1, -1), n["k"][1:-1].mean()), "mixing", "stiffness"),
    "last mass": (lambda n, d: n["m"].__setitem__(-1, 1.03 * n["m"][-1]), "contacts", "mass"),
    "mass of motion": (lambda n, d: n["m"].__setitem__(1, 1.1 * n["m"][1]), "contacts", "mass"),
    "third contact": (_contact(2), "contacts", "missed-contact"),
    "last contact": (_contact(-1), "contacts", "missed-contact"),
    "no contact": (_without_contacts, "contacts", "missed-contact"),
    "hooke": (lambda n, d: n["n"].__setitem__(n["n"] == 2.0, 2.5), "hooke", "exponent"),
    "tsuji": (_tsuji, "restitution", "LAMMPS tsuji without sqrt 2"),
    "no clip": (lambda n, d: n.update(clip=False), "restitution", "clip"),
    "always clipped": (lambda n, d: n.update(clip=True), "restitution", "clip"),
    "prepared": (
        lambda n, d: n.update(k=n["k"] * (1.05 if "unseen" in d["name"] else 1.0)), "unseen", "stiffness-scale"
    ),
}  # fmt: skip


def _round(digits: int) -> Rows:
    """Return a change of samples to a number of digits."""

    def rounded(array: np.ndarray) -> np.ndarray:
        return np.array([[float(f"{value:.{digits}g}") for value in row] for row in array])

    return lambda t, x, v: (t, rounded(x), rounded(v))


#: fault -> (change of what is written, item that fails, cause)
OF_OUTPUT: dict[str, tuple[Rows, str, str]] = {
    "six digits": (_round(6), "digits", "few-digits"),
    "single": (lambda t, x, v: (t, *(np.float64(np.float32(a)) for a in (x, v))), "digits", "single-precision"),
    "ms": (lambda t, x, v: (1e3 * t, x, v), "units", "units"),
    "mm": (lambda t, x, v: (t, 1e3 * x, v), "units", "units"),
    "sign": (lambda t, x, v: (t, -x, -v), "units", "sign"),
    "reverse": (lambda t, x, v: (t, x[:, ::-1], v[:, ::-1]), "units", "order-of-bodies"),
    "late samples": (
        lambda t, x, v: (t, x[[0, *range(len(x) - 1)]], v[[0, *range(len(v) - 1)]]), "phase", "sampling-shift"
    ),
    "late times": (lambda t, x, v: (t + 0.3 * t[1], x, v), "phase", "time-shift"),
}  # fmt: skip


def _forces(numbers: Numbers, x: Any, v: Any) -> Any:
    """Return the force of each contact along the line."""
    out, force = np.zeros(len(x) + 1), cast(Any, right_code.force)
    force(x, v, *(numbers[key] for key in ("wall", "k", "n", "gap", "c", "power", "clip")), out)
    return out


def leapfrog(scene: Scene, dt: float, path: Path) -> None:
    """Run the right code, and write the velocities of half a step before."""
    document = json.loads(scene_json(scene))
    time, x, v = right_code.solve(document, dt)
    numbers = right_code.numbers(document)
    for row in range(1, len(time)):
        f = _forces(numbers, x[row], v[row])
        v[row] -= 0.5 * dt * (numbers["free"] + (f[:-1] - f[1:]) / numbers["m"])
    right_code.write(path, time, x, v)


def own_step(scene: Scene, dt: float, path: Path) -> None:
    """Run the right code at a step of its own."""
    del dt
    right_code.write(path, *right_code.solve(json.loads(scene_json(scene)), scene.duration / scene.samples / 3))


def _stepped(reaction: float, *, euler: bool) -> Code:
    """Return a code that steps in Python: forces on right bodies are ``reaction`` times those on left bodies."""

    def run(scene: Scene, dt: float, path: Path) -> None:
        numbers = right_code.numbers(json.loads(scene_json(scene)))
        interval, m = scene.duration / scene.samples, numbers["m"]
        factor = np.full(len(m), reaction)
        factor[0] = 1.0  # the wall acts on the first body
        every = max(1, round(interval / dt))
        step, x, v = interval / every, np.zeros(len(m)), numbers["v"]
        xs, vs = [x], [v]

        def acceleration(x: Any, v: Any) -> Any:
            f = _forces(numbers, x, v)
            return numbers["free"] + (factor * f[:-1] - f[1:]) / m

        a = acceleration(x, v)
        for count in range(1, scene.samples * every + 1):
            if euler:
                x, v = x + step * v, v + step * a
                a = acceleration(x, v)
            else:
                half = v + 0.5 * step * a
                x = x + step * half
                a = acceleration(x, half + 0.5 * step * a)
                v = half + 0.5 * step * a
            if count % every == 0:
                xs.append(x)
                vs.append(v)
        right_code.write(path, interval * np.arange(scene.samples + 1), np.array(xs), np.array(vs))

    return run


#: fault -> (code, item that fails, cause)
OF_METHOD: dict[str, tuple[Code, str, str]] = {
    "leapfrog": (leapfrog, "phase", "half-step-velocity"),
    "own step": (own_step, "order", "step-ignored"),
    "euler": (_stepped(1.0, euler=True), "order", "first-order-integrator"),
    "reaction": (_stepped(0.97, euler=False), "momentum", "momentum"),
}

PLANTED: dict[str, tuple[Code, str, str]] = {
    **{name: (code(change), item, cause) for name, (change, item, cause) in OF_NUMBERS.items()},
    **{name: (code(rows=rows), item, cause) for name, (rows, item, cause) in OF_OUTPUT.items()},
    **OF_METHOD,
}
