"""Write certificates of motions that are known without the package: by closed forms and by 40 or more digits.

:func:`collision` has the closed form of two bodies, :func:`linear` follows contacts of exponent 2 by exponentials of
matrices from touch to touch, both in balls of 400 bits; :func:`digits` takes the decimal solution of Hertz contacts.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from decimal import Decimal, localcontext
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from flint import arb, arb_mat, ctx, fmpq
from scipy.integrate import solve_ivp

from dem_bridge.scene.scene import Scene
from tests.helpers import decimal_chain

BITS = 400
State = list[Fraction]


@dataclass(frozen=True)
class Motion:
    """A scene, its state (displacements, then velocities) at any time, and its touches: time, contact, closes."""

    scene: Scene
    at: Callable[[Fraction], State]
    touches: list[tuple[Fraction, int, bool]]
    doubt: Fraction
    """How far off a state may be, m and m/s, and how far off the time of a touch, s, relative to the duration."""


def exact(value: float) -> Fraction:
    """Return a double as a fraction."""
    return Fraction(float(value))


def ends(scene: Scene, k: int) -> list[int | str]:
    """Return the bodies of a contact as a file names them."""
    c = scene.contacts
    names: list[int | str] = ["left" if side == 0 else "right" for side in (0, 1)]
    return [int(b) if b < scene.n_body else names[i] for i, b in enumerate((c.left[k], c.right[k]))]


def block(scene: Scene) -> dict[str, Any]:
    """Return the block of a file that describes a scene."""
    c = scene.contacts
    numbers = zip(c.stiffness.tolist(), c.exponent.tolist(), c.gap.tolist(), strict=True)
    keys = ("stiffness", "exponent", "gap")
    contacts = [
        {"bodies": ends(scene, k), **dict(zip(keys, map(float.hex, each), strict=True))}
        for k, each in enumerate(numbers)
    ]
    return {
        "name": scene.name,
        "hash": scene.content_hash,
        "mass": [float(m).hex() for m in scene.mass],
        "contacts": contacts,
        "velocity": [float(v).hex() for v in scene.velocity],
        "gravity": float(scene.gravity).hex(),
        "constant_force": [float(f).hex() for f in scene.load],
        "duration": float(scene.duration).hex(),
        "count": scene.samples,
    }


def text(value: Fraction, digits: int = 60) -> str:
    """Return a number rounded to a power of ten."""
    return f"{round(value * 10**digits)}e-{digits}"


def ball(middle: Fraction, radius: Fraction) -> list[str]:
    """Return a ball, its radius rounded up."""
    return [text(middle), f"{int(radius * 10**60) + 2}e-60"] if radius else [text(middle), "0"]


def certificate(
    motion: Motion, times: Sequence[Fraction], radii: Sequence[tuple[Fraction, Fraction]]
) -> dict[str, Any]:
    """Return a file with checkpoints at these times, and with these radii of displacements and velocities."""
    scene, n = motion.scene, motion.scene.n_body
    zero = ["0x0.0p+0", "0"]
    start = {"time": "0/1", "displacement": [zero] * n, "velocity": [[float(v).hex(), "0"] for v in scene.velocity]}
    points = [start | {"closed": [bool(g < 0) for g in scene.contacts.gap]}]
    for time, (rx, rv) in zip(times, radii, strict=True):
        state = motion.at(time)
        x, v = ([ball(value, r) for value in part] for part, r in ((state[:n], rx), (state[n:], rv)))
        points.append({"time": ratio(time), "displacement": x, "velocity": v, "closed": closed(motion, state)})
    return sealed(
        {
            "schema": "dem-bridge/proof/1",
            "scene": block(scene),
            "bits": BITS,
            "checkpoints": points,
            "touches": [
                {
                    "contact": k,
                    "closes": closes,
                    "time": ball(t, 2 * motion.doubt * exact(scene.duration) + radii[-1][0]),
                }
                for t, k, closes in motion.touches
                if t <= times[-1]
            ],
            "samples": samples(motion, times[-1], radii[-1]),
            "proved_until": ratio(times[-1]),
        }
    )


def samples(motion: Motion, until: Fraction, radius: tuple[Fraction, Fraction]) -> dict[str, Any]:
    """Return the samples of a file; their radii are 16 times those of the last checkpoint."""
    scene, n = motion.scene, motion.scene.n_body
    every = exact(scene.duration) / scene.samples
    times = [every * i for i in range(scene.samples + 1) if every * i <= until]
    states = [[Fraction(0)] * n + list(map(exact, scene.velocity)), *map(motion.at, times[1:])]
    parts = (("displacement", 0, radius[0]), ("velocity", n, radius[1]))
    rows = {key: [[ball(v, 16 * r) for v in s[o : o + n]] for s in states] for key, o, r in parts}
    return {"time": list(map(ratio, times)), **rows}


def closed(motion: Motion, state: State) -> list[bool]:
    """Return which overlaps are positive."""
    c, x = motion.scene.contacts, [*state[: motion.scene.n_body], Fraction(0)]
    return [x[left] - x[right] > exact(gap) for left, right, gap in zip(c.left, c.right, c.gap, strict=True)]


def ratio(value: Fraction) -> str:
    """Return a fraction as a text."""
    return f"{value.numerator}/{value.denominator}"


def sealed(file: dict[str, Any]) -> dict[str, Any]:
    """Return a file with the digest of its content."""
    rest = {key: value for key, value in file.items() if key != "digest"}
    digest = hashlib.sha256(json.dumps(rest, sort_keys=True, separators=(",", ":")).encode()).hexdigest()
    return rest | {"digest": digest}


def written(file: dict[str, Any], folder: Path) -> Path:
    """Write a file and return its path."""
    path = folder / "proof.json"
    path.write_text(json.dumps(file))
    return path


def dyadic(value: float, bits: int = 40) -> Fraction:
    """Return a number near a value that has a power of 2 as denominator."""
    return Fraction(round(value * 2**bits), 2**bits)


def as_fraction(value: arb) -> Fraction:
    """Return the middle of a ball."""
    middle = value.mid().fmpq()
    return Fraction(int(middle.p), int(middle.q))


def as_ball(value: Fraction) -> arb:
    """Return the narrowest ball of a fraction."""
    return arb(fmpq(value.numerator, value.denominator))


def collision(scene: Scene) -> Motion:
    """Return the motion of two bodies that meet once, before and after their contact."""
    beta, n, gap = (
        exact(value[0]) for value in (scene.contacts.stiffness, scene.contacts.exponent, scene.contacts.gap)
    )
    m, v = list(map(exact, scene.mass)), list(map(exact, scene.velocity))
    with ctx.workprec(BITS):
        reduced, closing = m[0] * m[1] / sum(m), v[0] - v[1]
        p = as_ball(1 / n)
        depth = as_ball(n * reduced * closing**2 / (2 * beta)) ** p
        half = depth / as_ball(closing) * arb.pi().sqrt() * (1 + p).gamma() / (arb(0.5) + p).gamma()
        touch, pressed = gap / closing, as_fraction(2 * half)
    centre = (m[0] * v[0] + m[1] * v[1]) / sum(m)

    def at(time: Fraction) -> State:
        if time <= touch:
            return [u * time for u in v] + v
        if time < touch + pressed:
            raise ValueError("the state within the contact has no closed form; give a time before or after it")
        after = [2 * centre - u for u in v]
        rest = time - touch - pressed
        return [u * touch + centre * pressed + w * rest for u, w in zip(v, after, strict=True)] + after

    touches = [(touch, 0, True)] * (gap > 0) + [(touch + pressed, 0, False)]
    return Motion(scene, at, touches, Fraction(1, 10**90))


def linear(scene: Scene) -> Motion:
    """Return the motion of a chain whose contacts all have exponent 2, from touch to touch."""
    n, c = scene.n_body, scene.contacts
    total = exact(scene.duration)
    with ctx.workprec(BITS):
        state = [arb(0)] * n + [as_ball(exact(v)) for v in scene.velocity] + [arb(1)]
        pressed = [bool(gap < 0) or bool(gap == 0 and _rate(scene, k, state) > 0) for k, gap in enumerate(c.gap)]
        parts, touches = [(Fraction(0), state, list(pressed))], []
        while parts[-1][0] < total:
            event = _next_touch(scene, *parts[-1], total)
            if event is None:
                break
            time, k = event
            state = _moved(scene, parts[-1], time)
            pressed = list(parts[-1][2])
            pressed[k] = not pressed[k]
            touches.append((time, k, pressed[k]))
            parts.append((time, state, pressed))

    def at(time: Fraction) -> State:
        with ctx.workprec(BITS):
            part = next(part for part in reversed(parts) if part[0] <= time)
            return list(map(as_fraction, _moved(scene, part, time)[:-1]))

    return Motion(scene, at, touches, Fraction(1, 10**80))


def _rate(scene: Scene, k: int, state: Sequence[arb]) -> Any:
    n, c = scene.n_body, scene.contacts
    v: list[arb] = [*state[n : 2 * n], arb(0)]
    return v[c.left[k]] - v[c.right[k]]


def _overlap(scene: Scene, k: int, state: Sequence[arb]) -> Any:
    c = scene.contacts
    x: list[arb] = [*state[: scene.n_body], arb(0)]
    return x[c.left[k]] - x[c.right[k]] - as_ball(exact(c.gap[k]))


def _moved(scene: Scene, part: tuple[Fraction, list[arb], list[bool]], time: Fraction) -> list[arb]:
    """Return the state at a time from that at the start of a part, with the contacts that press in it."""
    start, state, pressed = part
    n, c = scene.n_body, scene.contacts
    rates = [[arb(0)] * (2 * n + 1) for _ in range(2 * n + 1)]
    for i in range(n):
        rates[i][n + i] = arb(1)
        rates[n + i][2 * n] = as_ball(exact(scene.gravity) + exact(scene.load[i]) / exact(scene.mass[i]))
    for k in (k for k, on in enumerate(pressed) if on):
        beta, gap = exact(c.stiffness[k]), exact(c.gap[k])
        for body, sign in ((int(c.left[k]), -1), (int(c.right[k]), 1)):
            if body < n:
                for other, way in ((int(c.left[k]), 1), (int(c.right[k]), -1)):
                    if other < n:
                        rates[n + body][other] += as_ball(sign * way * beta / exact(scene.mass[body]))
                rates[n + body][2 * n] -= as_ball(sign * beta * gap / exact(scene.mass[body]))
    h = as_ball(time - start)
    moved = arb_mat([[rate * h for rate in row] for row in rates]).exp() * arb_mat([[value] for value in state])
    return [moved[i, 0] for i in range(2 * n + 1)]


def _next_touch(
    scene: Scene, start: Fraction, state: list[arb], pressed: list[bool], total: Fraction
) -> tuple[Fraction, int] | None:
    """Return the next time at which an overlap changes its sign, found on a grid and by Newton's method."""
    part, pieces = (start, state, pressed), 400
    for i in range(1, pieces + 1):
        time = start + (total - start) * i / pieces
        at = _moved(scene, part, time)
        changed = [k for k, on in enumerate(pressed) if (float(_overlap(scene, k, at).mid()) > 0) != on]
        if changed:
            found = []
            for k in changed:
                root = time
                for _ in range(14):
                    near = _moved(scene, part, root)
                    root -= as_fraction(_overlap(scene, k, near) / _rate(scene, k, near))
                    root = dyadic_far(root)
                found.append((root, k))
            return min(found)
    return None


def dyadic_far(value: Fraction) -> Fraction:
    """Return a fraction with a short denominator near one with a long one."""
    return Fraction(round(value * 2**380), 2**380)


def digits(scene: Scene) -> Motion:
    """Return the motion of a chain in decimal arithmetic; its touches are those of a Runge-Kutta method."""

    def at(time: Fraction) -> State:
        with localcontext() as context:
            context.prec, context.Emin, context.Emax = decimal_chain.DIGITS, -999_999, 999_999
            chain = decimal_chain.Chain(replace(scene, duration=2.0 * float(scene.duration)))
            chain.end = Decimal(time.numerator) / Decimal(time.denominator)
            chain.solved()
            return list(map(Fraction, (*chain.x[: scene.n_body], *chain.v[: scene.n_body])))

    return Motion(scene, at, _located(scene), Fraction(1, 10**8))


def _located(scene: Scene) -> list[tuple[Fraction, int, bool]]:
    """Return the touches of a scene by DOP853 with located events; those at the start do not count."""
    c, n, m = scene.contacts, scene.n_body, np.array(scene.mass)

    def overlaps(x: np.ndarray) -> np.ndarray:
        far = np.append(x, 0.0)
        return np.asarray(far[c.left] - far[c.right] - c.gap)

    def field(_: float, state: np.ndarray) -> np.ndarray:
        force = c.stiffness * np.maximum(overlaps(state[:n]), 0.0) ** (c.exponent - 1.0)
        pull = scene.steady_force - np.bincount(c.left, force, n + 1)[:n] + np.bincount(c.right, force, n + 1)[:n]
        return np.concatenate([state[n:], pull / m])

    events = [lambda _, state, k=k: overlaps(state[:n])[k] for k in range(scene.n_contact)]
    start = np.concatenate([np.zeros(n), scene.velocity])
    scale = np.repeat([1e-15, 1e-9], n)
    run = solve_ivp(field, (0.0, scene.duration), start, "DOP853", rtol=1e-12, atol=scale * 1e-4, events=events)
    out = []
    for k, (times, states) in enumerate(zip(run.t_events, run.y_events, strict=True)):
        for time, state in zip(times, states, strict=True):
            rate = np.append(state[n:], 0.0)[c.left[k]] - np.append(state[n:], 0.0)[c.right[k]]
            if time > 1e-9 * scene.duration:
                out.append((exact(time), k, bool(rate > 0)))
    return sorted(out)
